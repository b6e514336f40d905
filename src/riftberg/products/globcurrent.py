"""GlobCurrent surface currents, whose files say ``Unit`` where CF says ``units`` (checked against a real file)."""

from __future__ import annotations

import xarray as xr

from riftberg.products.product import Product, Source

_EAST = "eastward_eulerian_current_velocity"
_NORTH = "northward_eulerian_current_velocity"


def _matches(ds: xr.Dataset) -> bool:
    return _EAST in ds.variables or _NORTH in ds.variables


def _mend(ds: xr.Dataset) -> xr.Dataset:
    """Call ``Unit`` by its CF name, so that xarray reads the dates; degrees get a direction."""
    degrees = {"lon": "degrees_east", "lat": "degrees_north"}
    for name, variable in ds.variables.items():
        unit = variable.attrs.pop("Unit", None)
        if unit is not None and "units" not in variable.attrs:
            variable.attrs["units"] = degrees.get(str(name), unit)
    return ds


PRODUCT = Product(
    name="globcurrent",
    title="GlobCurrent L4 surface current",
    citation="Rio, Mulet and Picot 2014, Geophys. Res. Lett. 41, 8918, doi:10.1002/2014GL061773",
    evidence="sample",
    matches=_matches,
    sources=(Source("uo", (_EAST,), "m s-1"), Source("vo", (_NORTH,), "m s-1")),
    mend=_mend,
    variants=(("15 m files", "documentation"),),
    notes=("geostrophic + Ekman current; the hs files are at the surface, those of 15 m at that depth",),
)
