"""What a coordinate of a file is: latitude, longitude, map axis, date, level, member; told by CF metadata, then by name."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterator
from typing import Literal

import cf_xarray.criteria as cf
import numpy as np
import xarray as xr

Role = Literal["lat", "lon", "x", "y", "time", "level", "member", ""]

_CRITERIA = cf.coordinate_criteria
_MEMBERS = {"realization", "realization_weights"}
_NAMES: tuple[tuple[Role, re.Pattern[str]], ...] = (
    ("lat", re.compile(r"^(nav_?)?lat(itude|cell|c)?s?([_.].*|\d*)$|^gphi|^geolat|^[tuvq]?lat[tuvq]?$|^xlat|^y_?lat|_lat$")),
    ("lon", re.compile(r"^(nav_?)?lon(gitude|cell|c)?s?([_.].*|\d*)$|^glam|^geolon|^[tuvq]?lon[tuvq]?$|^xlong|^x_?lon|_lon$")),
    ("time", re.compile(r"^(valid_|ocean_|initial_|model_)?time(s|_counter|_centered|\d+.*|_hours)?$|^(t|date|dates|mt|xtime)$")),
    ("level", re.compile(
        r"^(nav_)?(dept|lev|plev|height|altitude|sigma|isobaric|pressure|hybrid|bottom_top|lv_|siglay|siglev|s_rho|s_w|nz)"
        r"|^(z|zl|zi|z_l|z_i|z_t|zt|zt_ocean|st_ocean|zlev|zlevel|zax|olevel|kdep|model_level|k|lay)$")),
    ("member", re.compile(r"^(number|member|member_id|members|ens|ensemble|ensemble_member|realization|realisation)$")),
)  # fmt: skip


def standard_name(variable: xr.Variable | xr.DataArray) -> str:
    """Return the standard name in lower case, without the suffix for staggered points; empty if there is none."""
    name = str(variable.attrs.get("standard_name", "")).strip().lower()
    return re.sub(r"_at_[a-z]+_location$", "", name)


def units_of(variable: xr.Variable | xr.DataArray) -> str:
    """Return the units as written, empty if there are none."""
    values = (variable.attrs[key] for key in ("units", "Units", "Unit", "unit") if key in variable.attrs)
    return str(next(values, ""))


def holds_dates(variable: xr.Variable | xr.DataArray) -> bool:
    """Tell whether values are dates, as numpy's or cftime's."""
    if variable.dtype.kind == "M":
        return True
    if variable.dtype != object or not variable.size:
        return False
    return hasattr(np.ravel(variable.values)[0], "calendar")


def _by_metadata(variable: xr.Variable | xr.DataArray) -> Role:
    name, units = standard_name(variable), units_of(variable).replace("-", "_").lower()
    axis = str(variable.attrs.get("axis", variable.attrs.get("cartesian_axis", ""))).upper()
    if name in ("projection_x_coordinate", "grid_longitude", "projection_x_angular_coordinate"):
        return "x"
    if name in ("projection_y_coordinate", "grid_latitude", "projection_y_angular_coordinate"):
        return "y"
    for role, kind in (("lat", "latitude"), ("lon", "longitude")):
        known = {text.lower() for text in _CRITERIA[kind]["units"]}
        if name == kind or units in known:
            return "lat" if role == "lat" else "lon"
    if name in _MEMBERS:
        return "member"
    levels = {*_CRITERIA["Z"]["standard_name"], *_CRITERIA["vertical"]["standard_name"]}
    if variable.ndim <= 1 and (name in levels or "sigma" in name or axis == "Z" or "positive" in variable.attrs):
        return "level"
    if name == "time" or axis == "T":
        return "time"
    return ""


def role_of(name: Hashable, variable: xr.Variable | xr.DataArray) -> Role:
    """Return what a variable is as a coordinate; empty if it is none."""
    if variable.dtype.kind in "SU":
        return ""
    if holds_dates(variable):
        return "time"
    role = _by_metadata(variable)
    return role or role_of_name(name)


def role_of_name(name: Hashable) -> Role:
    """Return what the name of a dimension or coordinate says; empty if nothing."""
    return next((role for role, pattern in _NAMES if pattern.search(str(name).lower())), "")


def _says_where(name: str, variable: xr.Variable) -> bool:
    """Tell whether a number beside the fields says when or where: a date or a level, not a constant of the model."""
    if _by_metadata(variable) or holds_dates(variable):
        return True
    return "_" not in name and role_of(name, variable) in ("time", "level", "member")


def coordinates_of(ds: xr.Dataset, name: Hashable) -> Iterator[tuple[str, Role, bool]]:
    """Yield the coordinates of a field: name, role, and whether the file declares them as such.

    Declared are those that the attribute ``coordinates`` names, and variables named like a dimension. Other variables
    count if their metadata or names make them positions, dates or levels on dimensions of the field.
    """
    field = ds[name]
    listed = str(field.encoding.get("coordinates", field.attrs.get("coordinates", ""))).split()
    for other in map(str, ds.variables):
        variable = ds.variables[other]
        if other == str(name) or not set(variable.dims) <= set(field.dims):
            continue
        declared = other in listed or other in field.dims
        if variable.ndim == 0 and not declared and other in ds.data_vars and not _says_where(other, variable):
            continue
        role = role_of(other, variable)
        if role and not (variable.ndim > 1 and role in ("level", "member", "x", "y")):
            yield other, role, declared
