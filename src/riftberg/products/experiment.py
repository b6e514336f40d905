"""Forcing files of the A68a experiment (Huth et al. 2022) on a 1/8 degree grid.

Fields uo, vo | SSH | ua, va | taux, tauy | elevation. Checked against the real monthly files (ORAS5, JRA-55, GEBCO).
The hourly files come in two forms: with ``lon``, ``lat`` and ``time``, or bare. Bare files get their positions from the
grid file ``*_grid.nc`` beside them, read as the model's driver reads it (its positions are the north-east corners of
cells, where currents and winds live; sea level lives half a cell to the south-west), and their hours from the month in
their name (record 1 = first of the month, 00:00). A single record without time means a field constant in time.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import xarray as xr

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.products.cf import USUAL_NAMES, role_of
from riftberg.products.models import grid_of
from riftberg.products.product import Evidence, Heading, Product, Source, noted

_FIELDS = {"uo", "vo", "SSH", "ssh_bgrid", "ua", "va", "taux", "tauy", "elevation"}
_AT_CENTRES = {"SSH", "elevation"}
_MONTHS = dict(
    zip(("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"), range(1, 13), strict=True)
)
_ZERO_LAND = (("uo", "vo"),)


_NAMED = re.compile(r"a68_experiment|(jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)\d{4}_hourly", re.IGNORECASE)
"""Names of the files of the experiment."""

_SIZES = {"lat": 152, "lon": 232}
"""Its grid."""


def _is_named(heading: Heading) -> bool:
    return _NAMED.search(Path(heading.source).name) is not None


def _matches(heading: Heading) -> bool:
    """Tell the bare style: fields named as in the model, no units; by its name or grid, for others have no units too."""
    if not _is_named(heading) and {name: heading.sizes.get(name) for name in _SIZES} != _SIZES:
        return False
    held = _FIELDS & heading.names
    bare = held and all(
        "units" not in heading.variables[name] and "Unit" not in heading.variables[name] for name in held
    )
    alone = not (USUAL_NAMES - _FIELDS) & heading.names  # a file of others has fields that these never have
    return (
        bool(bare)
        and alone
        and {"lat", "lon"} <= set(heading.sizes)
        and not str(heading.attributes.get("title", "")).startswith("The GEBCO")
    )


def _has_positions(ds: xr.Dataset) -> bool:
    """Tell whether other variables give the latitudes and longitudes of the dimensions ``lat`` and ``lon``."""
    roles = {role_of(name, variable) for name, variable in ds.variables.items() if {"lat", "lon"} & set(variable.dims)}
    return {"lat", "lon"} <= roles


def _positioned(ds: xr.Dataset) -> xr.Dataset:
    """Give the file its latitudes and longitudes, those of cell centres where the field lives there."""
    centred = bool(_AT_CENTRES & set(map(str, ds.data_vars)))
    if {"actual_lon", "actual_lat"} <= set(ds.variables) and centred:
        lon, lat = ds["actual_lon"].values, ds["actual_lat"].values
        return ds.drop_vars(["actual_lon", "actual_lat"]).assign_coords(lon=("lon", lon), lat=("lat", lat))
    if {"lon", "lat"} <= set(ds.variables) or _has_positions(ds):
        return ds
    where = str(ds.encoding.get("source", ""))
    size = ds.sizes["lat"], ds.sizes["lon"]
    wanted = ("longitude", "latitude")
    grid = grid_of(ds, ("*_grid.nc",), wanted, lambda other: other["latitude"].shape == size) if where else None
    if grid is None and not _is_named(Heading.of(ds)):
        return ds  # not a file of the experiment: what it lacks is said in general words
    if grid is None:
        raise ForcingError(
            "has no positions", where=where, remedy="Put the experiment's grid file *_grid.nc in the same folder"
        )
    lon, lat = grid["longitude"].values[0], grid["latitude"].values[:, 0]
    shift = 0.5 * (lon[1] - lon[0]) if centred else 0.0
    ds = noted(ds, told=grid.attrs["told"])
    return ds.assign_coords(lon=("lon", lon - shift), lat=("lat", lat - shift))


def _dated(ds: xr.Dataset) -> xr.Dataset:
    """Date the hourly records of a bare file by the month in its name; drop the time of a single undated record."""
    if "time" not in ds.dims or "since" in str(ds.variables.get("time", xr.Variable((), 0)).attrs.get("units", "")):
        return ds
    if ds.sizes["time"] == 1:
        return ds.isel(time=0, drop=True)
    where = str(ds.encoding.get("source", ""))
    named = re.search(
        r"(jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)(\d{4}).*hourly", Path(where).name, re.IGNORECASE
    )
    if named is None:
        remedy = "Write time units on it, or keep the original name with month and HOURLY (dec2020_HOURLY)"
        raise ForcingError("has records without dates", where=where, remedy=remedy)
    units = f"hours since {named[2]}-{_MONTHS[named[1].lower()]:02d}-01 00:00:00"
    hours = np.arange(ds.sizes["time"])
    return ds.assign_coords(time=("time", hours, {"units": units, "calendar": "standard"}))


def _mend(ds: xr.Dataset) -> xr.Dataset:
    """Give the file the positions and dates that it leaves out."""
    return _dated(_positioned(ds))


def _without_zeros(ds: xr.Dataset) -> xr.Dataset:
    """Turn the zeros that stand for land into NaN: both currents exactly zero in an unpacked field.

    Packed files are left alone: there a zero may be slack water rounded to the packing step.
    """
    for east, north in _ZERO_LAND:
        if {east, north} <= set(ds.data_vars) and "scale_factor" not in ds[east].encoding:
            wet = (ds[east] != 0.0) | (ds[north] != 0.0)
            ds = ds.assign({name: ds[name].where(wet) for name in (east, north)})
    return ds


def _finish(ds: xr.Dataset) -> xr.Dataset:
    from riftberg.products.oceans import depth_from_elevation

    return depth_from_elevation(_without_zeros(ds))


def _sources(east: str, north: str) -> tuple[Source, ...]:
    return (
        Source("uo", (east,), "m s-1"),
        Source("vo", (north,), "m s-1"),
        Source("ssh", ("SSH", "ssh_bgrid"), "m"),
        Source("ua", ("ua",), "m s-1"),
        Source("va", ("va",), "m s-1"),
        Source("taux", ("taux",), "Pa"),
        Source("tauy", ("tauy",), "Pa"),
        Source("depth_below_surface", ("elevation",), "m"),
    )


_NOTES = (
    "units are not in the files: m s-1, m and Pa are taken, as the experiment does",
    "currents of exactly zero in unpacked files are land",
    "sea level and depth live at cell centres, currents and winds at cell corners",
    "bare hourly files have no positions: those of the grid file are taken as corners, as the experiment's driver does",
)
_CITATION = "Huth, Adcroft, Sergienko and Khan 2022, Sci. Adv. 8, eabq6974, doi:10.1126/sciadv.abq6974"

_VARIANTS: tuple[tuple[str, Evidence], ...] = (("hourly files", "documentation"),)

PRODUCT = Product(
    name="a68a",
    title="Forcing files of the A68a experiment of Huth et al. (2022)",
    citation=_CITATION,
    evidence="sample",
    matches=_matches,
    sources=_sources("uo", "vo"),
    mend=_mend,
    finish=_finish,
    longest_step=31 * SECONDS_PER_DAY,
    notes=_NOTES,
    variants=_VARIANTS,
)
KEEL_MEAN = Product(
    name="a68a-keel-mean",
    title="Forcing files of the A68a experiment, currents averaged from the surface to 200 m",
    citation=_CITATION,
    evidence="sample",
    matches=lambda heading: False,
    sources=_sources("uo_mean_over_berg_depth", "vo_mean_over_berg_depth"),
    mend=_mend,
    finish=_finish,
    longest_step=31 * SECONDS_PER_DAY,
    variants=_VARIANTS,
    notes=(*_NOTES, "uo, vo are means from the surface to 200 m"),
)
