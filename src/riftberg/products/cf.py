"""Meaning of the variables and coordinates of a file: by CF metadata (standard names, units), then by a table of usual names.

By these alone any other file that follows CF (or common habit) is read: among others the Copernicus Marine wind, current and
sea ice products and most regional model output, also on projected and curvilinear grids. Documentation only: each file is
taken at its word.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Hashable, Iterable, Iterator
from typing import Literal

import cf_xarray.criteria as cf
import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.product import Product, Source
from riftberg.products.quantities import QUANTITIES, unit_change

# Coordinates: latitude, longitude, map axis, date, level, member.

Role = Literal["lat", "lon", "x", "y", "time", "level", "member", ""]

NAMED = "named_by_user"
"""Attribute of a coordinate that the user names: it goes before all that a file says."""

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


def read_units(variable: xr.Variable | xr.DataArray) -> str:
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
    name, units = standard_name(variable), read_units(variable).replace("-", "_").lower()
    axis = str(variable.attrs.get("axis", variable.attrs.get("cartesian_axis", ""))).upper()
    if name in ("projection_x_coordinate", "grid_longitude", "projection_x_angular_coordinate"):
        return "x"
    if name in ("projection_y_coordinate", "grid_latitude", "projection_y_angular_coordinate"):
        return "y"
    for role, kind in (("lat", "latitude"), ("lon", "longitude")):
        spellings = {text.lower() for text in _CRITERIA[kind]["units"]}
        if name == kind or units in spellings:
            return "lat" if role == "lat" else "lon"
    if name in _MEMBERS:
        return "member"
    levels = {*_CRITERIA["Z"]["standard_name"], *_CRITERIA["vertical"]["standard_name"]}
    if variable.ndim <= 1 and (name in levels or "sigma" in name or axis == "Z" or "positive" in variable.attrs):
        return "level"
    if name == "time" or axis == "T":
        return "time"
    return ""


def find_role(name: Hashable, variable: xr.Variable | xr.DataArray) -> Role:
    """Return the role of a variable as a coordinate; empty if it is none."""
    if variable.dtype.kind in "SU" or _OF_FIELDS.search(standard_name(variable)):
        return ""
    if holds_dates(variable):
        return "time"
    role = _by_metadata(variable)
    return role or role_by_name(name)


def role_by_name(name: Hashable) -> Role:
    """Return the role that the name of a dimension or coordinate states; empty if none."""
    return next((role for role, pattern in _NAMES if pattern.search(str(name).lower())), "")


def _says_where(name: str, variable: xr.Variable) -> bool:
    """Tell whether a number beside the fields says when or where: a date or a level, not a constant of the model."""
    if _by_metadata(variable) or holds_dates(variable):
        return True
    return "_" not in name and find_role(name, variable) in ("time", "level", "member")


_LENGTHS = {"m", "meter", "meters", "metre", "metres", "km", "ft", "feet", "cm"}
_PRESSURES = {"pa", "hpa", "mb", "mbar", "millibar", "millibars", "dbar", "decibar", "decibars"}
_NO_HEIGHTS = re.compile(
    r"^(surface|mean_?sea(_?level)?|x|y|xc|yc|xt|yt|easting|northing|.*(mapping|crs|projection).*)$"
)


def _declared_height(name: str, variable: xr.Variable, declared: bool) -> Role:
    """Return ``"level"`` for a single number in metres or hPa that a file declares as a coordinate, whatever it is called."""
    if not declared or variable.size != 1 or variable.ndim > 1 or variable.dtype.kind not in "iuf":
        return ""
    metres = read_units(variable).strip().lower() in (_LENGTHS | _PRESSURES)
    on_map = str(variable.attrs.get("axis", "")).upper() in ("X", "Y")
    return "level" if metres and not on_map and not _NO_HEIGHTS.match(name.lower()) else ""


def _on_points(ds: xr.Dataset, variable: xr.Variable) -> bool:
    """Tell whether latitudes stand on the dimension of a variable with one dimension, other than along an axis of them."""
    return variable.ndim == 1 and any(
        other.dims == variable.dims and str(name) not in other.dims and find_role(name, other) == "lat"
        for name, other in ds.variables.items()
    )


def find_coordinates(ds: xr.Dataset, name: Hashable) -> Iterator[tuple[str, Role, bool]]:
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
        role: Role = find_role(other, variable) or _declared_height(other, variable, declared)
        if role == "level" and other not in field.dims and _on_points(ds, variable):
            continue  # the depth of the water at scattered points
        if role and not (variable.ndim > 1 and role in ("level", "member", "x", "y")):
            yield other, role, declared


def find_bounds(ds: xr.Dataset, axis: xr.DataArray) -> xr.Variable | None:
    """Return the two bounds of each value of a coordinate, as the file states them (CF ``bounds``)."""
    bounds = ds.variables.get(str(axis.attrs.get("bounds", axis.encoding.get("bounds", ""))))
    return bounds if bounds is not None and bounds.shape == (*axis.shape, 2) else None


# Fields.

_HEIGHTS = ("height_above_mean_sea_level", "height_above_geoid", "surface_altitude", "bedrock_altitude", "altitude")
"""Standard names of the height of the ground, which is the sea floor where it is negative."""

USUAL_NAMES = frozenset(name for quantity in QUANTITIES.values() for name in quantity.usual)
"""All names that fields usually have."""

_OTHERS = re.compile(
    r"tid|stokes|geostrophic|anomaly|error|(wind|swell)_wave|gust|barotropic|(velocity|temperature|salinity)_at_sea_floor|bottom|"
    r"westward|southward|upward_(east|north|x_|y_)|_correction_|sea_surface_height_above_sea_level|steric|change"
)
"""Standard names of what a run does not take: parts of a current or of the sea level, other levels, other signs."""

_SPREADS = re.compile(
    r"\b(time|t|realization|ensemble|member|number)\s*:\s*"
    r"(standard_deviation|variance|maximum|minimum|range|mid_range|sum_of_squares|root_mean_square|sum)\b"
)
_WORDS_OF_SPREAD = re.compile(
    r"\b(standard[ _-](error|deviation)|std\.? ?dev|uncertainty|variance|anomal(y|ies)|(wind )?gusts?|ensemble spread)\b",
    re.I,
)


def _standard_names(quantity: str) -> tuple[str, ...]:
    return QUANTITIES[quantity].standard_name, *QUANTITIES[quantity].also


def _candidates(ds: xr.Dataset, quantity: str) -> list[str]:
    """Return the variables that may hold a quantity: by standard name (true components first), else by usual name."""
    variables = [
        name for name in map(str, ds.variables) if ds.variables[name].ndim or quantity == "depth_below_surface"
    ]
    row = QUANTITIES[quantity]
    for names in (_standard_names(quantity), _HEIGHTS if quantity == "depth_below_surface" else row.along):
        by_name = [name for name in variables if standard_name(ds.variables[name]) in names and name not in ds.dims]
        by_name = [name for name in by_name if not statistic(ds.variables[name], quantity)] or by_name
        if names is _HEIGHTS:  # an axis of heights is none of the ground
            by_name = [name for name in by_name if ds.variables[name].ndim > 1]
        if by_name:
            return sorted(by_name, key=lambda name: _rank(quantity, name))
    for level_name in row.on_levels:
        by_name = [
            name for name in variables if standard_name(ds.variables[name]) == level_name and name not in ds.dims
        ]
        # Only where something says at which depths it holds.
        by_name = [name for name in by_name if any(role == "level" for _, role, _ in find_coordinates(ds, name))]
        by_name = [name for name in by_name if not statistic(ds.variables[name], quantity)]
        if len(by_name) == 1:  # one of several would be a guess; that none is taken is told
            return by_name
    usual = [name for name in row.usual if name in ds.variables and name not in ds.dims]
    usual = [name for name in usual if name != "elevation" or ds.variables[name].ndim > 1]
    # Names such as t02 are those of temperatures too.
    usual = [n for n in usual if quantity != "wave_period" or unit_change(read_units(ds.variables[n]), "s") is not None]
    usual = [name for name in usual if quantity != "ssh" or not above_ellipsoid(ds.variables[name])]
    return [name for name in usual if standard_name(ds.variables[name]) in ("", "unknown") or _near_enough(ds, name)]


def by_standard_name(ds: xr.Dataset, quantity: str) -> str:
    """Return the one variable with the standard name of a quantity; empty if there is none, or several."""
    names = _standard_names(quantity)
    matches = [n for n in map(str, ds.data_vars) if ds[n].ndim > 1 and standard_name(ds.variables[n]) in names]
    return matches[0] if len(matches) == 1 else ""


def _near_enough(ds: xr.Dataset, name: str) -> bool:
    """Tell whether a standard name that is not in the tables leaves a usual name believable: no tides, no Stokes drift."""
    # WAVEWATCH III calls the waves of the whole spectrum wind waves there.
    return name in ("t01", "t02", "t0m1") or not _OTHERS.search(standard_name(ds.variables[name]))


def above_ellipsoid(variable: xr.Variable | xr.DataArray) -> bool:
    """Tell whether a sea level counts from the ellipsoid: it holds the slope of the geoid, which moves nothing."""
    standard, words = standard_name(variable), str(variable.attrs.get("long_name", "")).lower()
    return "ellipsoid" in standard or ("ellipsoid" in words and "geoid" not in standard + words)


def misnamed_fields(ds: xr.Dataset) -> str:
    """Return which variables have a usual name and a standard name of something else, in words; empty if none."""
    usual = {name: ds.variables[name] for name in map(str, ds.variables) if name in USUAL_NAMES}
    others = {
        name: standard_name(variable) or str(variable.attrs.get("long_name", ""))
        for name, variable in usual.items()
        if not _near_enough(ds, name) or (name in QUANTITIES["ssh"].usual and above_ellipsoid(variable))
    }
    return "; ".join(f"{name} is {meaning}, which is none of these" for name, meaning in list(others.items())[:4])


def is_height(variable: xr.Variable | xr.DataArray, name: str) -> bool:
    """Tell whether a variable is the height of the ground, positive up, rather than the depth of the sea floor."""
    standard = standard_name(variable)
    if standard in _HEIGHTS or str(variable.attrs.get("positive", "")).lower() == "up":
        return True
    return name == "elevation" and standard not in _standard_names("depth_below_surface")


def strange_height(variable: xr.Variable | xr.DataArray) -> bool:
    """Tell whether nothing but the name, or the sign, of a variable says that it is a height."""
    return standard_name(variable) not in ("", *_HEIGHTS)


_FAMILIES: dict[str, tuple[tuple[str, ...], re.Pattern[str]]] = {
    "sea state": (("wave_height",), re.compile(r"(?<!long)(?<!short)_waves?_|swell|significant_\w*height")),
    "wave period": (("wave_period",), re.compile(
        r"wave\w*_(period|frequency)|^(fp|[rv]?tpk?|pp1d|perpw(sfc)?|rtpeak|tpsmoo|tps|tper)_|(peak|dominant)_(period|frequency)"
    )),
    "current": (("uo",), re.compile(r"sea_water_(\w+_)?(velocity|speed)|sea_water_speed|\bcurrents?\b")),
    "sea level": (("ssh",), re.compile(r"sea_surface_(height|elevation)|sea_level|dynamic_topography")),
    "wind": (("ua", "taux"), re.compile(r"wind|surface_(downward|upward)_\w*stress")),
    "sea floor": (("depth_below_surface",), re.compile(r"sea_floor|bathymetr|topograph|elevation|height_above_mean_sea")),
    "sea ice": (("ice_fraction", "ice_thickness", "ui"), re.compile(r"sea_?ice")),
    "temperature": (("sst",), re.compile(r"sea_(water|surface)_(\w+_)?temperature")),
    "salinity": (("sss",), re.compile(r"sea_(water|surface)_(\w+_)?salinity")),
}  # fmt: skip
"""What a run takes: the quantities of which one is enough, and the words that speak of it."""

_ASIDE = re.compile(r"error|deviation|quality|flag|mask|number_of|_at_|status|uncertainty")
"""Words of what stands beside a field and says nothing of its own."""


def unread_fields(ds: xr.Dataset, quantities: Iterable[str], names: Iterable[str]) -> list[str]:
    """Return in words which variables speak of something that a run takes and that nothing else in the file gives."""
    provided, read = set(quantities), set(names)
    by_family: dict[str, list[str]] = {}
    for name in map(str, ds.data_vars):
        variable = ds.variables[name]
        if name in read or variable.ndim < 2 or variable.dtype.kind not in "iuf":
            continue
        words = (standard_name(variable) or f"{name} {variable.attrs.get('long_name', '')}").lower().replace(" ", "_")
        if not _ASIDE.search(words.replace("_period_at_", "_period ")):
            by_family.setdefault(_family(name, words, provided), []).append(
                f"{name} ({stated})" if (stated := standard_name(variable)) else name
            )
    by_family.pop("", None)
    if "wave_height" not in provided:
        by_family.pop("wave period", None)
    why = {"wave period": ": a mean of all waves is wanted, and it follows from the height"}
    return [
        f"no {family} is taken from this file; not read: {', '.join(listed[:4])}{why.get(family, '')}"
        for family, listed in by_family.items()
    ]


def _family(name: str, words: str, provided: set[str]) -> str:
    """Return the family of quantities of a variable, if a run takes it and nothing gives it yet."""
    for family, (quantities, speaks) in _FAMILIES.items():
        usual = any(name in QUANTITIES[quantity].usual for quantity in quantities)
        if (usual or speaks.search(words)) and not provided & set(quantities):
            return family
    return ""


def statistic(variable: xr.Variable | xr.DataArray, quantity: str) -> str:
    """Return in words which statistic of a field a variable is, rather than the field itself; empty if it is none."""
    match = _SPREADS.search(str(variable.attrs.get("cell_methods", "")))
    if match:
        return f"{match[2]} over {match[1]} (cell_methods)"
    words = str(variable.attrs.get("long_name", ""))
    word = _WORDS_OF_SPREAD.search(words)
    # The topography of models is called an anomaly too, and is the one that is wanted.
    return f"described as {words!r}" if word and not (quantity == "ssh" and "anom" in word[0].lower()) else ""


def _rank(quantity: str, name: str) -> int:
    usual = QUANTITIES[quantity].usual
    return usual.index(name) if name in usual else len(usual)


def _selected(ds: xr.Dataset, spared: Collection[str] = ()) -> dict[str, tuple[str, str]]:
    """Return the variable of each quantity but those ``spared``, with a remark where others could be it too."""
    chosen: dict[str, tuple[str, str]] = {}
    for quantity in QUANTITIES:
        if quantity in spared:
            continue
        candidates = _candidates(ds, quantity)
        if not candidates:
            continue
        first, *others = candidates
        if others and _rank(quantity, first) == len(QUANTITIES[quantity].usual):
            raise ForcingError(
                f"{len(candidates)} variables could be {quantity} ({QUANTITIES[quantity].long_name}): {', '.join(candidates)}",
                where=str(ds.encoding.get("source", "")),
                remedy=f"Name the right one: names: {{{quantity}: {first}}}, or --names {quantity}={first}",
            )
        remark = f"{quantity} is taken from {first}; {', '.join(others)} could be it too" if others else ""
        chosen[quantity] = (first, remark)
    return chosen


def holds_fields(ds: xr.Dataset) -> bool:
    """Tell whether any field is found."""
    return any(_candidates(ds, quantity) for quantity in QUANTITIES)


PRODUCT = Product(
    name="cf",
    title="File that follows the CF conventions",
    citation="see the file",
    evidence="documentation",
    matches=lambda heading: False,  # by its fields, not by its heading: see `holds_fields`
    sources=tuple(Source(quantity, (quantity,)) for quantity in QUANTITIES),
    select=_selected,
    cautions=("taken at its word: names, units and signs are those that the file states",),
)
