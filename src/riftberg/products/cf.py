"""Any other file that follows CF (or common habit): fields found by standard name, then by a table of usual names.

Covers, among others, the Copernicus Marine wind, current and sea ice products and most regional model output on
longitude-latitude grids. Documentation only: each file is taken at its word.
"""

from __future__ import annotations

import xarray as xr

from riftberg.products.product import Product, Source, without_single

_STANDARD: dict[str, tuple[str, ...]] = {
    "uo": ("eastward_sea_water_velocity", "surface_eastward_sea_water_velocity"),
    "vo": ("northward_sea_water_velocity", "surface_northward_sea_water_velocity"),
    "ssh": ("sea_surface_height_above_geoid",),
    "sst": ("sea_surface_temperature", "sea_water_surface_temperature"),
    "sss": ("sea_surface_salinity",),
    "ua": ("eastward_wind", "x_wind"),
    "va": ("northward_wind", "y_wind"),
    "taux": ("surface_downward_eastward_stress",),
    "tauy": ("surface_downward_northward_stress",),
    "ice_fraction": ("sea_ice_area_fraction",),
    "ice_thickness": ("sea_ice_thickness",),
    "ui": ("eastward_sea_ice_velocity",),
    "vi": ("northward_sea_ice_velocity",),
    "wave_height": ("sea_surface_wave_significant_height",),
    "wave_period": ("sea_surface_wave_mean_period",),
    "wave_direction": ("sea_surface_wave_from_direction",),
    "depth_below_surface": ("sea_floor_depth_below_geoid", "sea_floor_depth_below_sea_level", "sea_floor_depth"),
}
_USUAL: dict[str, tuple[str, ...]] = {
    "uo": ("uo", "water_u", "u_eastward", "uoe", "ugo"),
    "vo": ("vo", "water_v", "v_northward", "von", "vgo"),
    "ssh": ("ssh", "zos", "zeta", "surf_el", "SSH"),
    "sst": ("sst", "tos", "analysed_sst"),
    "sss": ("sss", "sos"),
    "ua": ("ua", "u10", "U10", "uas", "eastward_wind"),
    "va": ("va", "v10", "V10", "vas", "northward_wind"),
    "taux": ("taux", "tauuo"),
    "tauy": ("tauy", "tauvo"),
    "ice_fraction": ("siconc", "aice", "ice_conc", "ice_fraction"),
    "ice_thickness": ("sithick", "hice", "ice_thickness"),
    "ui": ("usi", "ui"),
    "vi": ("vsi", "vi"),
    "wave_height": ("VHM0", "swh", "hs"),
    "wave_period": ("VTM02", "mwp"),
    "wave_direction": ("VMDR", "mwd"),
    "depth_below_surface": ("deptho", "depth_below_surface"),
}


def _name_of(ds: xr.Dataset, quantity: str) -> str | None:
    """Return the variable that holds a quantity: by standard name first, by usual name next."""
    for name, variable in ds.data_vars.items():
        if str(variable.attrs.get("standard_name", "")) in _STANDARD[quantity]:
            return str(name)
    return next((name for name in _USUAL[quantity] if name in ds.data_vars), None)


def _found(ds: xr.Dataset) -> dict[str, str]:
    names = {quantity: _name_of(ds, quantity) for quantity in _STANDARD}
    return {name: quantity for quantity, name in names.items() if name is not None}


def _matches(ds: xr.Dataset) -> bool:
    """Tell whether any field is found on one-dimensional axes with latitudes and longitudes among the variables."""
    return bool(_found(ds))


def _called(ds: xr.Dataset) -> xr.Dataset:
    """Give the fields found their canonical names; drop heights and other single levels that are not a depth."""
    ds = ds.rename({name: quantity for name, quantity in _found(ds).items() if name != quantity})
    return without_single(ds, "height", "height_10m", "heightAboveGround", "level")


PRODUCT = Product(
    name="cf",
    title="File that follows the CF conventions",
    citation="see the file",
    evidence="documentation",
    matches=_matches,
    sources=tuple(Source(quantity, (quantity,)) for quantity in _STANDARD),
    reshape=_called,
    notes=("taken at its word: names, units and signs are those that the file states",),
)
