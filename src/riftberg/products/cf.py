"""Any other file that follows CF (or common habit): fields found by standard name, then by a table of usual names.

Covers, among others, the Copernicus Marine wind, current and sea ice products and most regional model output, also on
projected and curvilinear grids. Documentation only: each file is taken at its word.
"""

from __future__ import annotations

import re

import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.canonical import QUANTITIES
from riftberg.products.product import Product, Source
from riftberg.products.roles import standard_name

_STANDARD: dict[str, tuple[str, ...]] = {
    "uo": ("eastward_sea_water_velocity", "surface_eastward_sea_water_velocity"),
    "vo": ("northward_sea_water_velocity", "surface_northward_sea_water_velocity"),
    "ssh": ("sea_surface_height_above_geoid",),
    "sst": ("sea_surface_temperature", "sea_water_surface_temperature"),
    "sss": ("sea_surface_salinity",),
    "ua": ("eastward_wind",),
    "va": ("northward_wind",),
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
    "uo": ("uo", "water_u", "u_eastward", "uoe", "ugo", "unod", "ssu"),
    "vo": ("vo", "water_v", "v_northward", "von", "vgo", "vnod", "ssv"),
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
    "depth_below_surface": ("deptho", "depth_below_surface", "bathymetry"),
}


USUAL_NAMES = frozenset(name for names in _USUAL.values() for name in names)
"""All names that fields usually have."""

_ALONG_THE_GRID: dict[str, tuple[str, ...]] = {
    "uo": ("sea_water_x_velocity", "surface_sea_water_x_velocity"),
    "vo": ("sea_water_y_velocity", "surface_sea_water_y_velocity"),
    "ua": ("x_wind", "grid_eastward_wind"),
    "va": ("y_wind", "grid_northward_wind"),
    "taux": ("surface_downward_x_stress",),
    "tauy": ("surface_downward_y_stress",),
    "ui": ("sea_ice_x_velocity",),
    "vi": ("sea_ice_y_velocity",),
}


_OTHERS = re.compile(
    r"tid|stokes|geostrophic|anomaly|error|wave_to|gust|barotropic|(velocity|temperature|salinity)_at_sea_floor|bottom|"
    r"westward|southward|upward_(east|north|x_|y_)"
)
"""Standard names of what a run does not take: parts of a current, other levels, other signs."""

_SPREADS = re.compile(
    r"\b(time|t|realization|ensemble|member|number)\s*:\s*"
    r"(standard_deviation|variance|maximum|minimum|range|mid_range|sum_of_squares|root_mean_square|sum)\b"
)
_WORDS_OF_SPREAD = re.compile(
    r"\b(standard[ _-](error|deviation)|std\.? ?dev|uncertainty|variance|anomal(y|ies)|(wind )?gusts?|ensemble spread)\b",
    re.I,
)


def _candidates(ds: xr.Dataset, quantity: str) -> list[str]:
    """Return the variables that may hold a quantity: by standard name (true components first), else by usual name."""
    held = [name for name in map(str, ds.variables) if ds.variables[name].ndim or quantity == "depth_below_surface"]
    for names in (_STANDARD[quantity], _ALONG_THE_GRID.get(quantity, ())):
        by_name = [name for name in held if standard_name(ds.variables[name]) in names and name not in ds.dims]
        by_name = [name for name in by_name if not statistic(ds.variables[name], quantity)] or by_name
        if by_name:
            return sorted(by_name, key=lambda name: _rank(quantity, name))
    usual = [name for name in _USUAL[quantity] if name in ds.variables and name not in ds.dims]
    return [name for name in usual if standard_name(ds.variables[name]) in ("", "unknown") or _near_enough(ds, name)]


def by_standard_name(ds: xr.Dataset, quantity: str) -> str:
    """Return the one variable whose standard name is that of a quantity; empty if there is none, or several."""
    names = _STANDARD.get(quantity, ())
    held = [n for n in map(str, ds.data_vars) if ds[n].ndim > 1 and standard_name(ds.variables[n]) in names]
    return held[0] if len(held) == 1 else ""


def _near_enough(ds: xr.Dataset, name: str) -> bool:
    """Tell whether a standard name that is not in the tables leaves a usual name believable: no tides, no Stokes drift."""
    return not _OTHERS.search(standard_name(ds.variables[name]))


def turned_away(ds: xr.Dataset) -> str:
    """Return which variables have a usual name and a standard name of something else, in words; empty if none."""
    names = [name for name in map(str, ds.variables) if name in USUAL_NAMES and not _near_enough(ds, name)]
    return "; ".join(f"{name} is {standard_name(ds.variables[name])}, which is none of these" for name in names[:4])


def statistic(variable: xr.Variable | xr.DataArray, quantity: str) -> str:
    """Return in words which statistic of a field a variable is, rather than the field itself; empty if it is none.

    Parameters
    ----------
    variable : xarray.Variable or DataArray
        With the attributes of the file.
    quantity : str
        Canonical name of the field.
    """
    match = _SPREADS.search(str(variable.attrs.get("cell_methods", "")))
    if match:
        return f"{match[2]} over {match[1]} (cell_methods)"
    words = str(variable.attrs.get("long_name", ""))
    found = _WORDS_OF_SPREAD.search(words)
    # The topography of models is called an anomaly too, and is the one that is wanted.
    return f"described as {words!r}" if found and not (quantity == "ssh" and "anom" in found[0].lower()) else ""


def _rank(quantity: str, name: str) -> int:
    usual = _USUAL[quantity]
    return usual.index(name) if name in usual else len(usual)


def _selected(ds: xr.Dataset) -> dict[str, tuple[str, str]]:
    """Return the variable of each quantity, with a remark where others could be it too.

    Raises
    ------
    ForcingError
        If several variables could be it and none has a usual name.
    """
    chosen: dict[str, tuple[str, str]] = {}
    for quantity in _STANDARD:
        candidates = _candidates(ds, quantity)
        if not candidates:
            continue
        first, *others = candidates
        if others and _rank(quantity, first) == len(_USUAL[quantity]):
            raise ForcingError(
                f"{len(candidates)} variables could be {quantity} ({QUANTITIES[quantity].long_name}): {', '.join(candidates)}",
                where=str(ds.encoding.get("source", "")),
                remedy=f"Keep one of them, for example: ncks -x -v {','.join(others)} FILE OUT",
            )
        remark = f"{quantity} is taken from {first}; {', '.join(others)} could be it too" if others else ""
        chosen[quantity] = (first, remark)
    return chosen


def _matches(ds: xr.Dataset) -> bool:
    """Tell whether any field is found."""
    return any(_candidates(ds, quantity) for quantity in _STANDARD)


PRODUCT = Product(
    name="cf",
    title="File that follows the CF conventions",
    citation="see the file",
    evidence="documentation",
    matches=_matches,
    sources=tuple(Source(quantity, (quantity,)) for quantity in _STANDARD),
    select=_selected,
    notes=("taken at its word: names, units and signs are those that the file states",),
)
