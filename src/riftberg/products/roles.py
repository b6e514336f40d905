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
    ("lat", re.compile(r"^(nav_?)?lat(itude|cell|c)?s?([_.].*|\d*)$|^gphi|^geolat|^[tuvqce]?lat[tuvq]?$|^xlat|^y_?lat|_lat$")),
    ("lon", re.compile(r"^(nav_?)?lon(gitude|cell|c)?s?([_.].*|\d*)$|^glam|^geolon|^[tuvqce]?lon[tuvq]?$|^xlong|^x_?lon|_lon$")),
    ("time", re.compile(r"^(valid_|ocean_|initial_|model_)?time(s|_counter|_centered|\d+.*|_hours)?$|^(t|date|dates|mt|xtime)$")),
    ("level", re.compile(
        r"^(nav_)?(dept|lev|plev|height|altitude|sigma|isobaric|pressure|hybrid|bottom_top|lv_|siglay|siglev|s_rho|s_w|nz)"
        r"|^(z|zl|zi|z_l|z_i|z_t|zt|zt_ocean|st_ocean|zlev|zlevel|zax|olevel|kdep|model_level|k|lay)$")),
    ("member", re.compile(r"^(number|member|member_id|members|ens|ensemble|ensemble_member|realization|realisation)$")),
)  # fmt: skip


_OF_FIELDS = re.compile(
    r"^sea_floor_depth|^sea_surface|velocity|wind|temperature|salinity|thickness|area_fraction|stress"
)
"""Standard names of fields, whose variables may be called like a coordinate (deptho)."""


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
    if variable.dtype.kind in "SU" or _OF_FIELDS.search(standard_name(variable)):
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


_LENGTHS = {"m", "meter", "meters", "metre", "metres", "km", "ft", "feet", "cm"}
_PRESSURES = {"pa", "hpa", "mb", "mbar", "millibar", "millibars", "dbar", "decibar", "decibars"}
_NO_HEIGHTS = re.compile(
    r"^(surface|mean_?sea(_?level)?|x|y|xc|yc|xt|yt|easting|northing|.*(mapping|crs|projection).*)$"
)


def _height_of_any_name(name: str, variable: xr.Variable, declared: bool) -> Role:
    """Return ``"level"`` for a single number in metres or hPa that a file declares as a coordinate, whatever it is called."""
    if not declared or variable.size != 1 or variable.ndim > 1 or variable.dtype.kind not in "iuf":
        return ""
    metres = units_of(variable).strip().lower() in (_LENGTHS | _PRESSURES)
    on_map = str(variable.attrs.get("axis", "")).upper() in ("X", "Y")
    return "level" if metres and not on_map and not _NO_HEIGHTS.match(name.lower()) else ""


def _on_points(ds: xr.Dataset, variable: xr.Variable) -> bool:
    """Tell whether latitudes stand on the dimension of a variable with one dimension, other than along an axis of them."""
    return variable.ndim == 1 and any(
        other.dims == variable.dims and str(name) not in other.dims and role_of(name, other) == "lat"
        for name, other in ds.variables.items()
    )


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
        role: Role = role_of(other, variable) or _height_of_any_name(other, variable, declared)
        if role == "level" and other not in field.dims and _on_points(ds, variable):
            continue  # the depth of the water at scattered points
        if role and not (variable.ndim > 1 and role in ("level", "member", "x", "y")):
            yield other, role, declared


def bounds_of(ds: xr.Dataset, axis: xr.DataArray) -> xr.Variable | None:
    """Return the two bounds of each value of a coordinate, as the file states them (CF ``bounds``)."""
    bounds = ds.variables.get(str(axis.attrs.get("bounds", axis.encoding.get("bounds", ""))))
    return bounds if bounds is not None and bounds.shape == (*axis.shape, 2) else None
