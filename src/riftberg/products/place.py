"""The horizontal place of a field: which of its coordinates are its positions, the kind of grid that they make, and its axes.

Numbers of rows and columns are never positions: a dimension counts as a position only through a coordinate with values.
"""

from __future__ import annotations

import re
from typing import Any, cast

import numpy as np
import xarray as xr

from riftberg.config.values import nanoseconds
from riftberg.errors import ForcingError
from riftberg.products.cf import NAMED, find_coordinates, read_units, role_by_name, standard_name
from riftberg.products.product import noted
from riftberg.products.quantities import unit_change
from riftberg.state import Floats

EAST = {"standard_name": "longitude", "units": "degrees_east", "axis": "X"}
NORTH = {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"}
"""Attributes of positions in a canonical dataset."""

_SOUTH_OR_WEST = re.compile(r"deg(?:ree)?s?[ _]?(?:s|south|w|west)", re.IGNORECASE)
"""Units of positions that count the other way; CF does not know them, and files have them."""

METRES_PER_DEGREE = 111e3

EXACT = 0.02
"""Positions by a projection may differ from those of the file by this part of a cell, and by `CLOSE` metres."""

CLOSE = 11.0

LOST_RADIUS = 50e3
"""A radius of the Earth that a grid mapping does not state explains no larger distance, m."""

SEAM = 60.0
"""Latitude (degrees) up to which nominal axes of tripolar grids are positions; beyond, rows bend towards poles on land."""

_NOMINAL = re.compile(r"nominal|^[xy][hq](_\w+)?$|^(grid_)?[xy][tu]?_ocean")
"""Words and names of axes that tell where rows and columns would be without that bend, such as those of MOM."""

_NO_POSITIONS = f"{{}} and {{}} are nominal axes: north of {SEAM:g} N, where tripolar grids bend, they are no positions"

_ROTATED = re.compile(r"rotat|^r_?l(at|on)|grid_l(at|ong)itude")

_STEM = re.compile(r"longitude|latitude|long?|lat|glam|gphi")

_STAGGERED = re.compile(r"(?:^|_)(t|rho|u|v|c|q|f|psi)$")
"""What is left of names such as TLAT, gphiu, XLONG_V, geolat_c or lat_rho says on which points of a cell they lie."""

_POINTS = {"t": ("t", "rho", "", "u", "c"), "u": ("u", "c", "q", "v"), "v": ("v", "u", "c", "q")}
"""Points on which models have a field of a cell, and the components along its rows and columns, in the order of belief."""

STRAIGHT = 1e-5
"""Two-dimensional positions that differ by less (degrees) along a row or column make ordinary axes."""


def place_field(ds: xr.Dataset, name: str, field: xr.DataArray, *, where: str, point: str = "t") -> xr.DataArray:
    """Return a field on ``lat`` and ``lon``, on ``y`` and ``x`` with positions, or on ``node``.

    The point of a cell ("t", "u" or "v") decides where a file has positions of several and the field names none.
    """
    field, rest = _without_singles(ds, name, field, where)
    coordinates = list(find_coordinates(ds, name))
    projected = _projected(ds, name, field, rest, coordinates)
    if projected is not None:
        return projected
    lat, lon, aside = _pair(ds, coordinates, rest, name, point, where)
    north, east = (_checked_degrees(ds[c], where) for c in (lat, lon))
    low, high = float(north.min()), float(north.max())
    if low < -90.001 or high > 90.001:
        raise ForcingError(
            f"{lat} runs from {low:g} to {high:g}: that is no latitude", where=where,
            remedy="Give positions in degrees; for axes in metres the file needs a grid_mapping",
        )  # fmt: skip
    bare = field.drop_vars([c for c in field.coords if c not in ("time", "depth")])
    if north.ndim == 1 and north.dims != east.dims:
        _check_axes(ds, lat, lon, north, east, where)
        # By way of names that no file has: a file may call its columns lat.
        bare = bare.rename({str(north.dims[0]): "lat_", str(east.dims[0]): "lon_"}).rename(lat_="lat", lon_="lon")
        bare = bare.assign_coords(lat=("lat", north.values, NORTH), lon=("lon", east.values, EAST))
        return _cut_at_seam(bare, aside, where) if aside else bare
    if north.ndim == 1:
        bare = bare.rename({str(north.dims[0]): "node"})
        return bare.assign_coords(lat=("node", north.values, NORTH), lon=("node", east.values, EAST))
    north, east = _without_origin(north, east.transpose(*north.dims), lat, lon, where)
    rows, columns = (str(dim) for dim in north.dims)
    bare = bare.rename({rows: "y_", columns: "x_"}).rename(y_="y", x_="x").assign_attrs(placed=aside)
    lat2, lon2 = north.values, east.values
    axes = _straight(lat2, lon2)
    if axes is not None:
        bare = bare.rename(y="lat", x="lon")
        return bare.assign_coords(lat=("lat", axes[0], NORTH), lon=("lon", axes[1], EAST))
    return bare.assign_coords(lat=(("y", "x"), lat2, NORTH), lon=(("y", "x"), lon2, EAST))


def _without_origin(
    north: xr.DataArray, east: xr.DataArray, lat: str, lon: str, where: str
) -> tuple[xr.DataArray, xr.DataArray]:
    """Return two-dimensional positions without repeated (0, 0), which stand for none; refuse such as do not spread."""
    nowhere = (north == 0.0) & (east == 0.0)
    # One point may well lie at (0, 0); several cannot.
    if int(nowhere.sum()) > 1:
        north, east = north.where(~nowhere), east.where(~nowhere)
    valid = np.isfinite(north.values) & np.isfinite(east.values)
    if valid.sum() < 4 or (np.ptp(north.values[valid]) == 0.0 and np.ptp(east.values[valid]) == 0.0):
        raise ForcingError(
            f"{lat} and {lon} hold no positions: they are the same everywhere", where=where,
            remedy="Take the positions from the grid file of the model",
        )  # fmt: skip
    return north, east


def _without_singles(ds: xr.Dataset, name: str, field: xr.DataArray, where: str) -> tuple[xr.DataArray, list[str]]:
    """Drop dimensions of length one that are no place; refuse longer ones that are none; return the horizontal dimensions."""
    place_dims = {
        str(dim)
        for c, role, _ in find_coordinates(ds, name) if role in ("lat", "lon", "x", "y")
        for dim in ds[c].dims
    }  # fmt: skip
    rest = [str(dim) for dim in field.dims if dim not in ("time", "depth", "s_level")]
    for dim in list(rest):
        is_horizontal = dim in place_dims or role_by_name(dim) in ("lat", "lon")
        if field.sizes[dim] == 1 and not is_horizontal:
            field = field.isel({dim: 0}, drop=True)
            rest.remove(dim)
    extra = [dim for dim in rest if dim not in place_dims and role_by_name(dim) not in ("lat", "lon")]
    if len(rest) > 2:
        culprit = extra[0] if extra else rest[0]
        kind = " (members of an ensemble)" if role_by_name(culprit) == "member" else ""
        raise ForcingError(
            f"{name} has {field.sizes[culprit]} entries along the dimension {culprit}{kind}", where=where,
            remedy=f"Choose one first: ncks -d {culprit},0 FILE OUT, or in Python ds.isel({culprit}=0)",
        )  # fmt: skip
    return field, rest


def _pair(
    ds: xr.Dataset, coordinates: list[tuple[str, Any, bool]], rest: list[str], name: str, point: str, where: str
) -> tuple[str, str, str]:
    """Return the names of the latitude and the longitude that belong to a field, together on all dims of place, and a remark.

    Axes that lie aside of two-dimensional positions on the same dimensions are nominal ones: the latter are taken.
    """
    lats = [(declared, c) for c, role, declared in coordinates if role == "lat" and ds[c].ndim in (1, 2)]
    lons = [(declared, c) for c, role, declared in coordinates if role == "lon" and ds[c].ndim in (1, 2)]
    listed = str(ds[name].encoding.get("coordinates", "")).split()
    believed = _POINTS[point]

    def doubt(lat: str, lon: str) -> int:
        stems = [_STEM.sub("", c.lower(), count=1) for c in (lat, lon)]
        on = _STAGGERED.search(stems[0].strip("_"))
        at = on[1] if on else ""
        return len(believed) + 1 if stems[0] != stems[1] else believed.index(at) if at in believed else len(believed)

    fitting = [
        (any(NAMED not in ds[c].attrs for c in (lat, lon)), not (lat in listed and lon in listed), not (d1 and d2),
         ds[lat].ndim, doubt(lat, lon), lat, lon)
        for d1, lat in lats for d2, lon in lons
        if {*map(str, ds[lat].dims), *map(str, ds[lon].dims)} == set(rest) and ds[lat].ndim == ds[lon].ndim
        and ds[lat].size > 0
    ]  # fmt: skip
    if fitting:
        # First pairs that the variable names itself, then those declared as coordinates, then axes before
        # two-dimensional positions.
        best = min(fitting)
        lat, lon = best[5:]
        if ds[lat].ndim == 2 or ds[lat].dims == ds[lon].dims:
            return lat, lon, _choice(ds, name, best, fitting, len(believed), where)
        # Those that the user or the variable names are meant, unless they are called nominal, or rotated.
        true = [pair[5:] for pair in sorted(fitting) if pair[3] == 2]
        strange = _is_nominal(ds, lat, lon) or any(_ROTATED.search(_said(ds, c)) for c in (lat, lon))
        if NAMED in ds[lat].attrs or (lat in listed and lon in listed and not strange):
            return lat, lon, ""
        for north, east in true:
            if off := _aside(ds, (lat, lon), (north, east), where):
                remark = f"positions are those of {north} and {east}: the axes {lat} and {lon} lie up to {off:.2g} degrees aside"
                return north, east, remark
        if true:
            return lat, lon, ""
    mapping = str(ds[name].attrs.get("grid_mapping", ds[name].encoding.get("grid_mapping", "")))
    turned = mapping in ds.variables and "rotated" in str(ds[mapping].attrs.get("grid_mapping_name", ""))
    for c in [c for c, *_ in coordinates if ds[c].dims in {(dim,) for dim in rest}]:
        true_name = standard_name(ds[c]) in ("latitude", "longitude")
        if NAMED not in ds[c].attrs and (
            _ROTATED.search(_said(ds, c)) or (turned and role_by_name(c) and not true_name)
        ):
            raise ForcingError(
                f"{c} is an axis of a rotated grid: its numbers are no latitudes and longitudes", where=where,
                remedy=f"Write both for each point into the file, named in the attribute 'coordinates' of {name}, or the grid "
                "mapping of its pole (grid_mapping)",
            )  # fmt: skip
    if fitting:
        return lat, lon, _NO_POSITIONS.format(lat, lon) if _is_nominal(ds, lat, lon) else ""
    lacking = [f"{dim} ({ds[name].sizes.get(dim, 0)})" for dim in rest]
    if not rest:
        raise ForcingError(
            f"{name} is a single value in space", where=where, remedy="Give a field on a grid of latitude and longitude"
        )
    raise ForcingError(
        f"no latitudes and longitudes are given for {name} on its dimensions {', '.join(lacking)}", where=where,
        remedy="Numbers of rows are no positions: write latitude and longitude (degrees_north, degrees_east) into the "
        "file and name them in the attribute 'coordinates' of the variable",
    )  # fmt: skip


def _choice(
    ds: xr.Dataset, name: str, best: tuple[Any, ...], fitting: list[tuple[Any, ...]], undecided: int, where: str
) -> str:
    """Return a remark where positions of other points of the cells lie beside those taken; refuse where nothing decides."""
    lat, lon = best[5:]
    positions = [_checked_degrees(ds[c], where) for c in (lat, lon)]
    for other in sorted(fitting)[1:]:
        if other[:4] != best[:4] or {lat, lon} & {*other[5:]}:
            continue
        off = [np.abs(a - _checked_degrees(ds[c], where)) for a, c in zip(positions, other[5:], strict=True)]
        if float(off[0].max()) <= STRAIGHT and float(np.minimum(off[1], np.abs(off[1] - 360.0)).max()) <= STRAIGHT:
            continue
        if best[4] == other[4] or best[4] >= undecided:
            raise ForcingError(
                f"{lat}, {lon} and {other[5]}, {other[6]} both hold positions of {name}, and nothing says on which it lies",
                where=where,
                remedy=f"Name them: names: {{lat: {lat}, lon: {lon}}}, or --names lat={lat},lon={lon}, or in its attribute "
                "'coordinates'",
            )  # fmt: skip
        return f"positions of {name} are those of {lat} and {lon}, not of {other[5]} and {other[6]}"
    return ""


def _said(ds: xr.Dataset, axis: str) -> str:
    return f"{axis.lower()} {standard_name(ds[axis])} {str(ds[axis].attrs.get('long_name', '')).lower()}"


def is_nominal_name(name: str) -> bool:
    """Tell whether axes of that name are nominal ones."""
    return bool(_NOMINAL.search(name.lower()))


def _is_nominal(ds: xr.Dataset, lat: str, lon: str) -> bool:
    """Tell whether axes are nominal by their names or descriptions; an axis with a standard name is a position."""
    names = [c for c in (lat, lon) if standard_name(ds[c]) not in ("latitude", "longitude")]
    return any(
        _NOMINAL.search(text) for c in names for text in (c.lower(), str(ds[c].attrs.get("long_name", "")).lower())
    )


def _cut_at_seam(field: xr.DataArray, remark: str, where: str) -> xr.DataArray:
    """Return a field on nominal axes where these are positions, with a remark; refuse one that lies beyond."""
    rows = np.flatnonzero(field["lat"].values <= SEAM)
    remedy = (
        "Put the grid file of the model with those of all points (geolat, geolon: *static*.nc) into the same folder"
    )
    if rows.size < min(2, field.sizes["lat"]):
        raise ForcingError(remark, where=where, remedy=remedy)
    cut = " and nothing is read" if rows.size < field.sizes["lat"] else ""
    return field.isel(lat=rows).assign_attrs(placed=f"{remark}{cut}. {remedy}")


def nominal_axes(ds: xr.Dataset) -> str:
    """Return the remark on nominal axes of a canonical dataset, behind a blank; empty if its positions are true."""
    return next(
        (
            f" ({remark.split('. ')[0]})"
            for remark in str(ds.attrs.get("told", "")).split("; ")
            if "nominal axes" in remark
        ),
        "",
    )


def _aside(ds: xr.Dataset, axes: tuple[str, str], pair: tuple[str, str], where: str) -> float:
    """Return how far (degrees) axes lie from two-dimensional positions; 0 where these agree or are none."""
    dims = (*ds[axes[0]].dims, *ds[axes[1]].dims)
    lat, lon = (_checked_degrees(ds[c].transpose(*dims), where).values for c in pair)
    lat, lon = (np.where((lat == 0.0) & (lon == 0.0), np.nan, values) for values in (lat, lon))
    north, east = (np.asarray(ds[c].values, float) for c in axes)
    off = np.hypot(lat - north[:, None], ((lon - east + 180.0) % 360.0 - 180.0) * np.cos(np.deg2rad(lat)))
    valid = np.isfinite(lat) & np.isfinite(lon)
    if valid.sum() < 4 or (np.ptp(lat[valid]) == 0.0 and np.ptp(lon[valid]) == 0.0):
        return 0.0
    largest = float(np.nan_to_num(off[valid], nan=360.0).max())
    return largest if largest > EXACT * median_step(north) + 1e-4 else 0.0


def _checked_degrees(variable: xr.DataArray, where: str) -> xr.DataArray:
    """Return degrees north or east, without impossible ones (fill values become NaN)."""
    values = variable.values.astype(float)
    if variable.dtype == np.float32:  # the noise beyond the sixth decimal is of single precision
        values = np.round(values, 6)
    units = read_units(variable)
    if units.lower().startswith("rad"):
        values = np.rad2deg(values)
    if _SOUTH_OR_WEST.fullmatch(units.strip()):
        values = -values
    # Fill values of grids are larger than any number of turns.
    values = np.where(np.abs(values) > 1e4, np.nan, values)
    if not np.isfinite(values).any():
        raise ForcingError(f"{variable.name} holds no position at all", where=where, remedy="Fetch the file again")
    return variable.copy(data=values)


def _check_axes(ds: xr.Dataset, lat: str, lon: str, north: xr.DataArray, east: xr.DataArray, where: str) -> None:
    """Refuse axes that hold no number, latitudes beyond the poles, and bare counts of rows and columns."""
    for name, axis in ((lat, north), (lon, east)):
        if not np.isfinite(axis.values).all():
            raise ForcingError(
                f"{name} is not a number everywhere", where=where, remedy="Correct the axis or fetch again"
            )
    for name, axis in ((lat, north), (lon, east)):  # which of two fields at a place is meant cannot be known
        distinct, times = np.unique(axis.values, return_counts=True)
        if (times > 1).any():
            remedy = f"Keep one of each: ds.drop_duplicates('{name}')"
            raise ForcingError(f"{name} has {distinct[times > 1][0]:g} twice", where=where, remedy=remedy)
    steps = np.diff(north.values)
    if steps.size and not ((steps > 0.0).all() or (steps < 0.0).all()):
        raise ForcingError(
            f"{lat} neither rises nor falls throughout", where=where, remedy=f"Sort it: ds.sortby('{lat}')"
        )
    bare = all(not read_units(ds[name]) and not standard_name(ds[name]) for name in (lat, lon))
    counted = all(
        any(np.array_equal(axis.values, np.arange(axis.size) + first) for first in (0, 1)) for axis in (north, east)
    )
    if bare and counted:
        raise ForcingError(
            f"{lat} and {lon} only count rows and columns (no units)", where=where,
            remedy="Write the positions in degrees, with units degrees_north and degrees_east",
        )  # fmt: skip


def _straight(lat: Floats, lon: Floats) -> tuple[Floats, Floats] | None:
    """Return axes where latitudes vary along rows only and longitudes along columns only; else None."""
    if lat.shape[0] < 2 or lat.shape[1] < 2 or not (np.isfinite(lat).all() and np.isfinite(lon).all()):
        return None
    # Rows may stand on different branches of longitude.
    turned = (lon - lon[:1] + 180.0) % 360.0 - 180.0
    if np.ptp(lat, axis=1).max() > STRAIGHT or np.abs(turned).max() > STRAIGHT:
        return None
    axis, steps = lat[:, 0], np.diff(lat[:, 0])
    # Columns that repeat a meridian make no axis.
    distinct = np.unique(np.round(lon[0] % 360.0, 6)).size == lon.shape[1]
    return (axis, lon[0]) if distinct and ((steps > 0.0).all() or (steps < 0.0).all()) else None


def find_mapping(ds: xr.Dataset, name: str) -> xr.Variable | None:
    """Return the variable that describes the map projection of a field, if there is one."""
    mapping = str(ds[name].attrs.get("grid_mapping", ds[name].encoding.get("grid_mapping", ""))).split(":")[0].strip()
    if mapping in ds.variables:
        return ds.variables[mapping]
    mappings = [v for v in ds.variables.values() if v.ndim == 0 and "grid_mapping_name" in v.attrs]
    return mappings[0] if len(mappings) == 1 else None


def _projected(
    ds: xr.Dataset, name: str, field: xr.DataArray, rest: list[str], coordinates: list[tuple[str, Any, bool]]
) -> xr.DataArray | None:
    """Return a field on the axes of a map projection that the file or the product describes; None if it is on none."""
    if len(rest) != 2:
        return None
    axes = {dim: c for c, _, _ in coordinates for dim in rest if ds[c].dims == (dim,)}
    if set(axes) != set(rest):
        return None
    roles: dict[str, str] = {}
    for dim, c in axes.items():
        metadata, direction = standard_name(ds[c]), str(ds[c].attrs.get("axis", "")).upper()
        for kind, called in (("x", "longitude"), ("y", "latitude")):
            names = (f"projection_{kind}_coordinate", f"grid_{called}")
            if metadata in names or direction == kind.upper() or c.lower() in (kind, f"{kind}c", f"r{called[:3]}"):
                roles.setdefault(dim, kind)
    if set(roles.values()) != {"x", "y"} or set(roles) != set(rest):
        return None
    ready = "crs_wkt" in ds.attrs
    mapping = find_mapping(ds, name)
    crs = ds.attrs["crs_wkt"] if ready else read_crs(mapping) if mapping is not None else None
    units = {kind: read_units(ds[axes[dim]]).strip().lower() for dim, kind in roles.items()}
    degrees = all(unit.startswith("deg") for unit in units.values())
    if crs is None:
        return None
    candidates = [
        [c for c, role, _ in coordinates if role == kind and set(ds[c].dims) == set(rest)] for kind in ("lat", "lon")
    ]
    factor = {kind: unit_in_metres(unit or "m") for kind, unit in units.items()}
    if not degrees and not all(factor.values()) and (ready or crs.is_projected) and (ready or not all(candidates)):
        wrong = next(unit for kind, unit in units.items() if not factor[kind])
        raise ForcingError(
            f"the axes of the map of {name} count {wrong!r}, which is no length", where=str(ds.encoding.get("source", "")),
            remedy="Write them in m or km",
        )  # fmt: skip
    if not ready:  # lengths on a map or degrees on a rotated pole; bare counts of rows and columns are neither
        rotated = bool(getattr(crs, "is_derived", False)) and not crs.is_projected
        if not (rotated if degrees else crs.is_projected and all(map(unit_in_metres, units.values()))):
            return None
    x_dim, y_dim = (next(dim for dim in rest if roles[dim] == kind) for kind in ("x", "y"))
    x, y = (ds[axes[dim]].values.astype(float) for dim in (x_dim, y_dim))
    bare = field.drop_vars([c for c in field.coords if c not in ("time", "depth")])
    bare = bare.rename({x_dim: "x_", y_dim: "y_"}).rename(x_="x", y_="y").transpose(..., "y", "x")
    if not degrees:
        x, y = x * factor["x"], y * factor["y"]
    pair = tuple(names[0] for names in candidates) if all(candidates) else ()
    radius = ready or mapping is None or not {*RADII, *_TEXTS}.isdisjoint(mapping.attrs)
    off = _distance(ds, crs, x, y, pair, (y_dim, x_dim)) if pair else 0.0
    spacing = max((float(abs(axis[1] - axis[0])) for axis in (x, y) if axis.size > 1), default=0.0)
    spacing *= METRES_PER_DEGREE if degrees else 1.0
    # Half a cell is more than any rounding of positions: one of the two is wrong, and nothing says which.
    if off > max(0.5 * spacing, 0.0 if radius else LOST_RADIUS) + CLOSE:
        raise ForcingError(
            f"projection and positions of the file differ by {off / 1000.0:.1f} km",
            where=str(ds.encoding.get("source", "")),
            remedy="The file's grid mapping is wrong or missing: check its header",
        )
    if pair and off > EXACT * spacing + CLOSE:
        why = "" if radius else ", whose radius of the Earth is not given"
        remark = f"the latitudes and longitudes of the file are taken, {off / 1000.0:.1f} km from its projection{why}"
        lat, lon = (_checked_degrees(ds[c].transpose(y_dim, x_dim), name).values for c in pair)
        bare = bare.assign_coords(lat=(("y", "x"), lat, NORTH), lon=(("y", "x"), lon, EAST))
        return bare.assign_attrs(placed=remark)
    if degrees:  # of a rotated pole
        lon, lat = to_degrees(crs, *np.meshgrid(x, y))
        return bare.assign_coords(lat=(("y", "x"), lat, NORTH), lon=(("y", "x"), lon, EAST))
    placed: xr.DataArray = bare.assign_coords(x=("x", x, {"units": "m"}), y=("y", y, {"units": "m"}))
    for kind, position, attributes in zip(("lat", "lon"), pair, (NORTH, EAST), strict=False):
        values = ds[position].transpose(y_dim, x_dim).values
        placed = placed.assign_coords({kind: (("y", "x"), values, attributes)})
    if not radius and not pair:
        remark = "the projection states no radius of the Earth: WGS84 is taken, a sphere would lead some 10 km aside"
        placed = placed.assign_attrs(placed=remark)
    return placed.assign_attrs(crs_wkt=crs if ready else crs.to_wkt())


def _distance(ds: xr.Dataset, crs: Any, x: Floats, y: Floats, pair: tuple[str, ...], dims: tuple[str, str]) -> float:
    """Return the largest distance (m) of positions by a projection from those that the file gives beside it."""
    rows, columns = (np.unique(np.linspace(0, axis.size - 1, 9).astype(int)) for axis in (y, x))
    lon, lat = to_degrees(crs, *np.meshgrid(x[columns], y[rows]))
    stated = [ds[c].transpose(*dims).values[np.ix_(rows, columns)].astype(float) for c in pair]
    east = ((lon - stated[1] + 180.0) % 360.0 - 180.0) * np.cos(np.deg2rad(lat))
    off = np.hypot(east, lat - stated[0]) * METRES_PER_DEGREE
    off = off[np.isfinite(off) & (np.abs(stated[0]) <= 90.0)]
    return float(off.max(initial=0.0))


# Fields on a map projection: axes in metres, positions by pyproj.


def unit_in_metres(unit: str) -> float:
    """Return the metres in a unit of map axes, also with a number before it (100 km); 0 if it is no length."""
    return 0.0 if (change := unit_change(unit, "m")) is None else change[0]


_TEXTS = ("crs_wkt", "spatial_ref", "proj4_string", "proj4", "proj4text", "proj_params", "proj_string")

RADII = frozenset((
    "earth_radius", "semi_major_axis", "semi_minor_axis", "inverse_flattening", "reference_ellipsoid_name", "crs_wkt",
    "horizontal_datum_name", "geographic_crs_name",
))  # fmt: skip
"""Attributes of a grid mapping that say how large the Earth is."""


def projected(ds: xr.Dataset, fallback: str) -> xr.Dataset:
    """Note the projection of a product's map as ``crs_wkt``: from its grid mapping, else the fallback."""
    from pyproj import CRS

    mappings = [v for v in ds.variables.values() if v.ndim == 0 and "grid_mapping_name" in v.attrs]
    projections = [crs for crs in map(read_crs, mappings) if crs is not None]
    return ds.assign_attrs(crs_wkt=(projections[0] if projections else CRS.from_user_input(fallback)).to_wkt())


def _transformer(crs: Any) -> Any:
    from pyproj import CRS, Transformer

    crs = CRS.from_user_input(crs)
    # A projection and its own ellipsoid have no datum shift between them: so the products define their positions.
    return Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)


def to_projection(crs: Any, lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
    """Return projected positions (m) of longitudes and latitudes (degrees)."""
    x, y = _transformer(crs).transform(lon, lat)
    return np.asarray(x, float), np.asarray(y, float)


def to_degrees(crs: Any, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return longitudes and latitudes (degrees) of projected positions (m; degrees on a rotated pole)."""
    from pyproj.enums import TransformDirection

    lon, lat = _transformer(crs).transform(x, y, direction=TransformDirection.INVERSE)
    return np.asarray(lon, float), np.asarray(lat, float)


def read_crs(mapping: xr.Variable) -> Any:
    """Return the projection that a grid mapping variable describes; None if pyproj understands none of its words."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    attributes = _plain_attributes(mapping.attrs)
    texts = [attributes[key] for key in _TEXTS if key in attributes]
    readings = [(cast(Any, CRS).from_cf, attributes), *((cast(Any, CRS).from_user_input, t) for t in texts)]
    if not RADII & set(attributes):  # a text may say which; without one the library takes WGS84
        readings = [*readings[1:], readings[0]]
    for reading, stated in readings:
        try:
            return reading(stated)
        except (CRSError, KeyError, ValueError, TypeError, AttributeError):
            continue
    return None


def _plain_attributes(attributes: Any) -> dict[str, Any]:
    """Return attributes with lists instead of arrays; a tangent cone has one standard parallel."""
    plain = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in attributes.items()}
    parallels = plain.get("standard_parallel")
    if (
        isinstance(parallels, list)
        and len(set(parallels)) == 1
        and "conformal_conic" in str(plain.get("grid_mapping_name"))
    ):
        plain["standard_parallel"] = parallels[0]
    return plain


# Axes of the canonical dataset: named alike, ascending, on one branch, with real UTC dates.

_OTHER_YEARS = (
    "Leave out the other records, or put model years on dates of the run, in Python: ds.assign_coords(time=dates)"
)


def tidy_axes(ds: xr.Dataset, *, where: str) -> xr.Dataset:
    """Sort the axes, put longitudes on one branch and dates on the standard calendar, and order the dimensions."""
    if "time" in ds.variables:
        ds = tidy_time(ds, where=where)
    if "depth" in ds.dims:  # in metres since its levels were judged
        attributes = {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}
        ds = _ascending(ds.assign_coords(depth=("depth", ds["depth"].values, attributes)), "depth")
    if "lat" in ds.dims and "lon" in ds.dims:
        ds = tidy_longitude(_ascending(ds, "lat"))
    for axis in ("y", "x"):
        if axis in ds.dims and axis in ds.coords:
            ds = _ascending(ds, axis)
    order = [name for name in ("time", "depth", "lat", "lon", "y", "x", "node") if name in ds.dims]
    return ds.transpose(*order, ...)


def tidy_time(ds: xr.Dataset, *, where: str) -> xr.Dataset:
    """Return the dataset with ``time`` as ``datetime64[ns]``, in whole seconds.

    Parts of a second are rounding: with them neither dates of two files would be the same, nor midnight be midnight. Dates of
    other calendars are taken by their label (year, month, day, ...): products that state a Julian calendar write the ordinary
    date.
    """
    time, values = ds["time"], ds["time"].values
    if time.dtype == object:
        calendar = str(getattr(np.ravel(values)[0], "calendar", "standard")) if time.size else "standard"
        if calendar not in ("standard", "gregorian", "proleptic_gregorian"):
            ds = noted(ds, doubt=f"its dates are those of the calendar {calendar}, and are taken as they are written")
        stamps = [_by_label(date, where) for date in np.atleast_1d(values)]
        values = np.array(stamps, dtype="datetime64[us]").reshape(time.shape)
    values = nanoseconds(values, where=where, kind=ForcingError, remedy=_OTHER_YEARS)
    values = (values + np.timedelta64(500, "ms")).astype("datetime64[s]").astype(values.dtype)
    if np.isnat(values).any():
        raise ForcingError(
            f"{int(np.isnat(values).sum())} of {values.size} dates are missing",
            where=where,
            remedy="Correct the time axis",
        )
    ds = ds.assign_coords(time=(time.dims, values, {"standard_name": "time", "axis": "T", "long_name": "time (UTC)"}))
    if "time" not in ds.dims:
        ds = ds.expand_dims("time")
    ds = ds.sortby("time") if np.any(np.diff(ds["time"].values) < np.timedelta64(0)) else ds
    _, first = np.unique(ds["time"].values, return_index=True)
    if first.size == ds.sizes["time"]:
        return ds
    lost = ds.sizes["time"] - first.size
    return noted(ds.isel(time=first), doubt=f"{lost} record(s) repeat a date: the first of each is taken")


def _by_label(date: Any, where: str) -> np.datetime64:
    """Return the date of another calendar that is written the same; refuse one that the ordinary calendar lacks."""
    try:
        return np.datetime64(date.isoformat(), "us")
    except ValueError as error:
        calendar = str(getattr(date, "calendar", "")) or "another"
        raise ForcingError(
            f"the date {date.isoformat()} of its calendar ({calendar}) does not exist",
            where=where,
            remedy="Convert the file to the standard calendar, for example with xarray's convert_calendar('standard')",
        ) from error


def _ascending(ds: xr.Dataset, name: str) -> xr.Dataset:
    values = ds[name].values
    return ds.isel({name: slice(None, None, -1)}) if values.size > 1 and values[0] > values[-1] else ds


def median_step(values: Floats) -> float:
    """Return the median spacing of an axis; 0 for a single value."""
    return float(np.median(np.abs(np.diff(values)))) if values.size > 1 else 0.0


def goes_round(lon: Floats) -> bool:
    """Tell whether ascending longitudes (degrees) cover the whole circle."""
    step = median_step(lon)
    return bool(lon.size > 1 and lon[-1] - lon[0] + 1.5 * step >= 360.0)


def tidy_longitude(ds: xr.Dataset) -> xr.Dataset:
    """Sort longitudes, drop columns that repeat a meridian (OSCAR v1 runs 20..420) and shift them to -180..180."""
    ds = _ascending(ds, "lon")
    lon = ds["lon"].values
    if lon.size > 1 and not np.all(np.diff(lon) > 0.0):
        # They jump (177..180, -180..-177): round the globe from the largest gap on, each meridian once.
        turned, first = np.unique(np.round(lon % 360.0, 9) % 360.0, return_index=True)
        gaps = np.diff(np.append(turned, turned[0] + 360.0))
        start = (int(np.argmax(gaps)) + 1) % turned.size
        lon = np.roll(turned, -start)
        lon = np.where(lon < lon[0], lon + 360.0, lon)
        ds = ds.isel(lon=np.roll(first, -start)).assign_coords(lon=("lon", lon, EAST))
    # Columns that repeat a meridian are left out before the branch is chosen.
    return on_branch(ds.isel(lon=slice(0, int((lon < lon[0] + 360.0 - 1e-6).sum()))), -180.0)


def on_branch(ds: xr.Dataset, west: float) -> xr.Dataset:
    """Return the dataset with ascending longitudes that start at or east of ``west`` (degrees).

    A field that goes round the earth is rolled so that it begins at ``west``; a regional one is only shifted by whole
    turns and may therefore reach beyond ``west + 360``.
    """
    lon = ds["lon"].values
    attributes = ds["lon"].attrs
    if not goes_round(lon):
        turns = 360.0 * np.floor((lon[0] - west + 1e-9) / 360.0)
        return ds.assign_coords(lon=("lon", lon - turns, attributes))
    # Whole turns are subtracted (a remainder would add rounding that differs from branch to branch).
    wrapped = lon - 360.0 * np.floor((lon - west + 1e-9) / 360.0)
    order = np.argsort(wrapped, kind="stable")
    if not np.array_equal(order, np.arange(order.size)):
        ds = ds.isel(lon=order)
    return ds.assign_coords(lon=("lon", wrapped[order], attributes))
