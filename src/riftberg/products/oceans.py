"""OSCAR surface currents, mean over the top 30 m: third-degree v1 (retired), v2.0 (quarter degree, daily), v3.

Checked against published headers of v1 and v2.0 (no real file was to be had). v3 is not released: its reader follows
the announcement only (dimensions time, latitude, longitude; the same variable names).
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from riftberg.products.product import DAY, DAY_SECONDS, Product, Source, stamped_at_noon, text_of, without_single

_CURRENTS = (Source("uo", ("u",), "m s-1"), Source("vo", ("v",), "m s-1"))


def _matches_v1(ds: xr.Dataset) -> bool:
    return {"u", "um"} <= set(ds.variables) and "depth" in ds.dims and "year" in ds.variables


def _has_v2_fields(ds: xr.Dataset) -> bool:
    names = set(ds.variables)
    return {"u", "v"} <= names and bool({"ug", "uw"} & names) and {"latitude", "longitude"} <= set(ds.dims)


def _matches_v3(ds: xr.Dataset) -> bool:
    new = "v3" in text_of(ds, "product_version", "title", "id") or "uw" in ds.variables
    return _has_v2_fields(ds) and new


def _matches_v2(ds: xr.Dataset) -> bool:
    return _has_v2_fields(ds) and not _matches_v3(ds)


def _without_level(ds: xr.Dataset) -> xr.Dataset:
    """Drop the single level at 15 m: OSCAR is a mean over the top 30 m."""
    return without_single(ds, "depth", "year", what="OSCAR v1 has one level at 15 m; give the original file")


def _drop_year_axis(ds: xr.Dataset) -> xr.Dataset:
    """Drop the decimal year, a second name of the time axis with a dimension of its own."""
    return _without_level(ds.drop_vars("year", errors="ignore"))


def _by_coordinate(ds: xr.Dataset) -> xr.Dataset:
    """Use the coordinate variables ``lat`` and ``lon`` as axes: dimensions are called otherwise, in changing order."""
    pairs = {"latitude": "lat", "longitude": "lon"}
    return ds.swap_dims({dim: name for dim, name in pairs.items() if name in ds.variables and dim in ds.dims})


def _finish_v2(ds: xr.Dataset) -> xr.Dataset:
    return stamped_at_noon(ds)


_NOTES = (
    "total current (geostrophic + Ekman + thermal wind), mean over the top 30 m",
    "not accurate within about 100 km of coasts",
)

V1 = Product(
    name="oscar-v1",
    title="OSCAR third-degree surface currents, 5-day (v1, retired)",
    citation="ESR 2009, OSCAR third deg., PO.DAAC, doi:10.5067/OSCAR-03D01; Bonjean and Lagerloef 2002",
    evidence="layout",
    matches=_matches_v1,
    sources=_CURRENTS,
    reshape=_drop_year_axis,
    longest_step=6 * DAY_SECONDS,
    notes=(*_NOTES, "one record about every five days", "longitudes 20..420: the repeated part is dropped"),
)
V2 = Product(
    name="oscar-v2",
    title="OSCAR L4 surface currents v2.0, 0.25 degree daily (final, interim or nrt)",
    citation="Dohan, K. 2021, OSCAR L4 v2.0, PO.DAAC, doi:10.5067/OSCAR-25F20",
    evidence="layout",
    matches=_matches_v2,
    sources=_CURRENTS,
    reshape=_by_coordinate,
    finish=_finish_v2,
    averaging=DAY,
    notes=(*_NOTES, "daily means: stamps put at 12:00 UTC", "file order is (time, longitude, latitude)"),
)
V3 = Product(
    name="oscar-v3",
    title="OSCAR L4 surface currents v3 (announced layout)",
    citation="OSCAR L4 v3, PO.DAAC (in preparation)",
    evidence="documentation",
    matches=_matches_v3,
    sources=_CURRENTS,
    reshape=_by_coordinate,
    finish=_finish_v2,
    averaging=np.timedelta64(86400, "s"),
    notes=(*_NOTES, "daily means: stamps put at 12:00 UTC", "not released when this reader was written"),
)
