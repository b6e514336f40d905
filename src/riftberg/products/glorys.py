"""GLORYS12V1 ocean reanalysis (Copernicus Marine), 1/12 degree with depth: native packed files and toolbox subsets.

Checked against a real native file (int16 packed, hours since 1950). Toolbox subsets (float32, other epochs, sometimes a
scalar time) follow the documentation. The sample has a depth axis of five levels; files have up to fifty.
"""

from __future__ import annotations

from dataclasses import replace

import xarray as xr

from riftberg.products.means import in_mid_month
from riftberg.products.product import DAY, Product, Source, stamped_at_noon, text_of
from riftberg.products.records import usual_interval
from riftberg.products.stated import DAY_SECONDS

_NAMES = {"uo", "vo", "zos", "siconc", "sithick", "usi", "vsi", "thetao", "so"}


def _matches(ds: xr.Dataset) -> bool:
    words = text_of(ds, "title", "source", "institution", "references", "product", "id", "credit")
    mercator = any(
        word in words for word in ("mercator", "glorys", "global_multiyear_phy", "global_analysisforecast_phy")
    )
    return mercator and bool(_NAMES & set(ds.variables))


_FORECASTS = ("analysisforecast", "analysis_forecast", "_anfc", "001_024", "psy4", "forecast", "near real time", "nrt")
_PAST = ("multiyear", "reanalysis", "001_030", "glorys")


def _is_forecast(ds: xr.Dataset) -> bool:
    words = (
        text_of(ds, "title", "source", "product", "id", "comment", "field_type")
        + str(ds.encoding.get("source", "")).lower()
    )
    return _matches(ds) and any(word in words for word in _FORECASTS) and not any(word in words for word in _PAST)


def _with_time(ds: xr.Dataset) -> xr.Dataset:
    """Give a scalar time a dimension."""
    if "time" in ds.variables and "time" not in ds.dims:
        ds = ds.set_coords("time").expand_dims("time")
    return ds


def _in_the_middle(ds: xr.Dataset) -> xr.Dataset:
    """Stamp daily means at noon and monthly means in the middle of the month, whatever the file wrote.

    Which of them these are stands in the file, or else follows from the time between the records of all files.
    """
    if "time" not in ds.dims:
        return ds
    stated = float(ds.attrs.get("stated_seconds", 0.0))
    step = min((s for s in (stated, usual_interval(ds["time"].values)) if s > 0.0), default=0.0)
    if step == 0.0:
        doubt = (
            "one record, and nothing in the file tells whether it is the mean of a day or of a month: taken as a day"
        )
        return stamped_at_noon(ds).assign_attrs(doubt=doubt)
    if step < DAY_SECONDS:  # hourly products are instants at their stamp
        return ds.assign_attrs(averaging_seconds=0.0)
    if step < 20 * DAY_SECONDS:
        return stamped_at_noon(ds)
    return in_mid_month(ds)


PRODUCT = Product(
    name="glorys",
    title="GLORYS12V1 global ocean reanalysis, 1/12 degree",
    citation="E.U. Copernicus Marine Service, GLOBAL_MULTIYEAR_PHY_001_030, doi:10.48670/moi-00021",
    evidence="sample",
    matches=_matches,
    sources=(
        Source("uo", ("uo",), "m s-1"),
        Source("vo", ("vo",), "m s-1"),
        Source("ssh", ("zos",), "m"),
        Source("sst", ("thetao",), "degrees_C"),
        Source("sss", ("so",), "1e-3"),
        Source("ice_fraction", ("siconc",), "1", "documentation"),
        Source("ice_thickness", ("sithick",), "m", "documentation"),
        Source("ui", ("usi",), "m s-1", "documentation"),
        Source("vi", ("vsi",), "m s-1", "documentation"),
    ),
    reshape=_with_time,
    variants=(("toolbox subset", "documentation"), ("monthly means", "documentation")),
    settle=_in_the_middle,
    averaging=DAY,
    notes=(
        "daily means: stamps put at 12:00 UTC (native files write 12:00, toolbox subsets 00:00); monthly means in mid-month",
        "currents keep their levels: runs take the mean over the draft of each element",
        "sst is the potential temperature of the first level",
    ),
)
FORECAST = replace(
    PRODUCT,
    name="mercator-forecast",
    title="Mercator global ocean analysis and forecast, 1/12 degree (near real time, no reanalysis)",
    citation="E.U. Copernicus Marine Service, GLOBAL_ANALYSISFORECAST_PHY_001_024, doi:10.48670/moi-00016",
    evidence="documentation",
    matches=_is_forecast,
    kind_matters=False,
)
