"""JRA-55 (GRIB converted by NCL) and JRA55-do (input4MIPs) 10 m wind.

Written from documentation only: no original file was to be had (the JRA-55 fields of the A68a experiment are another
layout, see `riftberg.products.experiment`).
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.product import DAY_SECONDS, Product, Source, text_of

_EAST = ("UGRD_GDS4_HTGL", "UGRD_GDS0_HTGL", "uas", "uas_10m")
_NORTH = ("VGRD_GDS4_HTGL", "VGRD_GDS0_HTGL", "vas", "vas_10m")


def _matches(ds: xr.Dataset) -> bool:
    names = set(ds.variables)
    if any(str(name).startswith(("UGRD_GDS", "VGRD_GDS")) for name in names):
        return True
    return bool(names & {*_EAST, *_NORTH}) and "jra" in text_of(ds, "source_id", "source", "title", "institution_id")


def _named(ds: xr.Dataset) -> xr.Dataset:
    """Name the axes of NCL's conversion from GRIB."""
    axes = {}
    for name in ds.dims:
        text = str(name)
        if text.startswith("initial_time"):
            axes[name] = "time"
        elif text.startswith(("g4_lat", "g0_lat")):
            axes[name] = "lat"
        elif text.startswith(("g4_lon", "g0_lon")):
            axes[name] = "lon"
    return ds.rename(axes)


PRODUCT = Product(
    name="jra55",
    title="JRA-55 or JRA55-do, 10 m wind",
    citation="Kobayashi et al. 2015, J. Meteorol. Soc. Japan 93, 5; Tsujino et al. 2018, Ocean Modell. 130, 79",
    evidence="documentation",
    matches=_matches,
    sources=(Source("ua", _EAST, "m s-1"), Source("va", _NORTH, "m s-1")),
    reshape=_named,
    longest_step=DAY_SECONDS,
    notes=("values at their stamp: 6-hourly (JRA-55) or 3-hourly (JRA55-do)",),
)
