"""Vectors along the axes of a grid, turned to east and north; components on different points brought together.

The angle alpha from east to the first axis of the grid, counter-clockwise, comes from the file (``angle`` of ROMS and
CROCO, cosine and sine of MOM6 and WRF), from its map projection, or from its two-dimensional positions:

    u_east = u cos(alpha) - v sin(alpha),    u_north = u sin(alpha) + v cos(alpha).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.plane import unit_vectors
from riftberg.products.cf import read_units, standard_name
from riftberg.products.mesh import Located, build_mesh
from riftberg.products.place import to_degrees
from riftberg.products.product import noted
from riftberg.products.quantities import QUANTITIES
from riftberg.products.records import VECTORS, named
from riftberg.state import Floats

COMPONENTS = frozenset(name for pair in VECTORS for name in pair)
_TRUE_NAMES = frozenset({
    "vozocrte", "vomecrtn", "u_eastward", "v_northward", "u_east", "v_north", "water_u", "water_v", "u10", "v10",
    "uwnd", "vwnd",
})  # fmt: skip
_ANGLES = ("angle", "ANGLE", "ANGLET", "grid_angle_rho")
_COSINES = (
    ("COSALPHA", "SINALPHA"),
    ("cos_rot", "sin_rot"),
    ("cosrot", "sinrot"),
    ("gcost", "gsint"),
    ("gcosu", "gsinu"),
)
_TOLERANCE = 0.2
"""Largest median difference (rad) between an angle of the file and the direction of its grid."""

_CLOSE = 0.02
"""Median difference (rad) up to which the direction of the grid tells that an angle without a unit is in degrees."""

_OVERLAP = 0.8
"""Share of the points of one component that must lie on the grid of the other."""


def is_true(field: xr.DataArray, name: str) -> bool:
    """Tell whether a component points east or north, by its grid, standard name, description or name."""
    metadata_name = standard_name(field)
    # What the standard name says comes before the names of dimensions and variables, which many models share.
    if metadata_name.startswith("grid_"):
        return False
    if set(field.dims) >= {"lat", "lon"} or "eastward" in metadata_name or "northward" in metadata_name:
        return True
    if "_x_" in f"_{metadata_name}" or "_y_" in f"_{metadata_name}":
        return False
    words = str(field.attrs.get("long_name", "")).lower()
    return name in _TRUE_NAMES or "eastward" in words or "northward" in words


def with_angle(ds: xr.Dataset, field: xr.DataArray, name: str, locate: Any, *, where: str) -> xr.DataArray:
    """Return a component along the grid with the angle of the grid at its points as the coordinate ``grid_angle``."""
    if "node" in field.dims:
        raise ForcingError(
            f"{name} ({standard_name(ds[name]) or 'no standard name'}) lies on scattered points, and the file does not say "
            "that it points east or north", where=where,
            remedy="If it does, write its standard name (eastward_sea_water_velocity and so on) into the file",
        )  # fmt: skip
    if "crs_wkt" in field.attrs:  # of the first axis of the map, from points a little before and after
        x, y = np.meshgrid(field["x"].values, field["y"].values)
        small = 1e-3 * max(1.0, float(np.abs(np.diff(field["x"].values)).min(initial=1e9)))
        behind, here, after = (
            unit_vectors(*to_degrees(field.attrs["crs_wkt"], x + sign * small, y)) for sign in (-1.0, 0.0, 1.0)
        )
        angle = _direction(here, after - behind)
    else:
        lon, lat = np.asarray(field["lon"].values), np.asarray(field["lat"].values)
        read = _read_angles(ds, lon, lat, locate)
        angle = _grid_direction(lon, lat, name, where, any_hand=bool(read))
        if read:
            # The median, for a few cells at a pole or a seam may point anywhere.
            misfits = [np.nanmedian(np.abs((candidate - angle + np.pi) % (2.0 * np.pi) - np.pi)) for candidate in read]
            # A small angle in degrees lies near that of any unturned grid: it is believed where it fits closely alone.
            chosen = int(np.argmin(misfits)) if min(misfits) < _CLOSE else 0
            of_file, off = read[chosen], misfits[chosen]
            if off > _TOLERANCE:
                raise ForcingError(
                    f"the angle that the file gives differs from the direction of its grid by {np.rad2deg(off):.0f} degrees",
                    where=where, remedy="Correct the angle (radians from east to the first axis) or its units",
                )  # fmt: skip
            angle = np.where(np.isfinite(of_file), of_file, angle)
    return field.assign_coords(grid_angle=(("y", "x"), angle)).assign_attrs(along="grid")


def _direction(points: Floats, step: Floats) -> Floats:
    """Return the angle from east of steps (rows, columns, 3) at points."""
    east = np.stack([-points[..., 1], points[..., 0], np.zeros(points.shape[:-1])], axis=-1)
    # At a pole there is no east: its length is kept above 0, for it is divided by.
    east /= np.maximum(np.linalg.norm(east, axis=-1, keepdims=True), 1e-12)
    north = np.cross(points, east)
    return np.asarray(np.arctan2((step * north).sum(-1), (step * east).sum(-1)))


def _grid_direction(lon: Floats, lat: Floats, name: str, where: str, *, any_hand: bool) -> Floats:
    """Return the angle of the rows of a grid; refuse a grid whose second axis lies to the right of the first."""
    points = unit_vectors(lon, lat)
    along, across = np.gradient(points, axis=1), np.gradient(points, axis=0)
    # The two axes and the way up: positive where the second axis lies to the left of the first.
    handed = np.nanmedian((np.cross(along, across) * points).sum(-1))
    if not handed > 0.0 and not any_hand:
        raise ForcingError(
            f"{name} follows a grid whose rows and columns are mirrored: its direction cannot be known", where=where,
            remedy="Turn the rows round first, or give eastward and northward components",
        )  # fmt: skip
    return _direction(points, along)


def _read_angles(ds: xr.Dataset, lon: Floats, lat: Floats, locate: Any) -> list[Floats]:
    """Return the angle (rad) that the file gives, at positions of a component; if it tells no unit, read in both."""
    for name in _ANGLES:
        if name in ds.variables and ds[name].ndim >= 2:
            angle, units = locate(name), read_units(ds[name]).lower()
            values = np.asarray(angle.values, float)
            # Radians never come near numbers beyond a turn; below, many files leave the unit out.
            if units.startswith("deg") or np.nanmax(np.abs(values)) > 2.0 * np.pi + 0.1:
                may_be = [np.deg2rad(values)]
            else:
                may_be = [values] if units.startswith("rad") else [values, np.deg2rad(values)]
            angles = (_interpolate_angle(angle, np.cos(candidate), np.sin(candidate), lon, lat) for candidate in may_be)
            return [candidate for candidate in angles if candidate is not None]
    for cosine, sine in _COSINES:
        if {cosine, sine} <= set(ds.variables):
            placed = locate(cosine)
            at_points = _interpolate_angle(placed, placed.values, locate(sine).values, lon, lat)
            return [] if at_points is None else [at_points]
    return []


def _interpolate_angle(placed: xr.DataArray, cosine: Floats, sine: Floats, lon: Floats, lat: Floats) -> Floats | None:
    if placed.dims != ("y", "x"):
        return None
    if (
        cosine.shape == lon.shape
        and np.allclose(placed["lat"], lat, equal_nan=True)
        and np.allclose(placed["lon"], lon, equal_nan=True)
    ):
        return np.arctan2(sine, cosine)
    # Cosine and sine are brought there apart, for an angle itself jumps by a whole turn somewhere.
    points = Located(build_mesh(placed), lon, lat)
    return np.asarray(np.arctan2(points.take(sine), points.take(cosine)))


def horizontal_dims(field: xr.Dataset | xr.DataArray) -> tuple[str, ...]:
    """Return the dimensions of place of a placed field."""
    if "node" in field.dims:
        return ("node",)
    return ("lat", "lon") if "lat" in field.dims else ("y", "x")


def interpolate_like(field: xr.DataArray, like: xr.DataArray | xr.Dataset) -> xr.DataArray:
    """Return a field on the points of another one: over the known points around, lazily; NaN where there are none."""
    if "lon" not in like.coords:
        raise ForcingError("the components lie on different points of a map", remedy="Give both on the same points")
    lon, lat = np.asarray(like["lon"].values, float), np.asarray(like["lat"].values, float)
    points = Located(build_mesh(field), *(np.meshgrid(lon, lat) if "lat" in like.dims else (lon, lat)))
    # A staggered grid sticks out by half a cell on one side; grids of two places hardly meet.
    if points.outside.mean() > 1.0 - _OVERLAP:
        raise ForcingError(
            f"the grids of {like.name or 'one field'} and {field.name} lie apart: {points.outside.mean():.0%} of the points "
            "of the one are not on the other", remedy="Give both components on grids of the same place",
        )  # fmt: skip
    coords = {name: c for name, c in like.coords.items() if set(c.dims) <= set(horizontal_dims(like))}
    return interpolate_field(field, points, horizontal_dims(like)).assign_coords(coords)


def interpolate_field(field: xr.DataArray, points: Located, dims: tuple[str, ...]) -> xr.DataArray:
    """Return a field at positions whose dimensions are ``dims``, lazily if it is lazy."""
    plane = horizontal_dims(field)

    def apply(values: Floats) -> Floats:
        return points.take(values if len(plane) == 2 else values[..., None, :])

    # Coordinates of the old plane do not belong to the new one, and apply_ufunc would refuse them.
    bare = field.drop_vars([name for name, c in field.coords.items() if set(c.dims) & set(plane)])
    temporary = [f"_{dim}" for dim in dims]
    if bare.chunks is not None:
        # Points around may stand in any chunk: the plane is one, time and depth stay in parts.
        bare = bare.chunk({dim: -1 for dim in plane})
    result: xr.DataArray = xr.apply_ufunc(
        apply, bare, input_core_dims=[list(plane)], output_core_dims=[temporary], dask="parallelized",
        output_dtypes=[np.float64], keep_attrs=True,
        dask_gufunc_kwargs={"output_sizes": dict(zip(temporary, points.shape, strict=True))},
    )  # fmt: skip
    return result.rename(dict(zip(temporary, dims, strict=True)))


def pair_vectors(datasets: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Bring both components of each vector to the same points, and turn those along a grid to east and north."""
    paired = list(datasets)
    for east, north in VECTORS:
        for k, ds in enumerate(paired):
            if east not in ds.data_vars:
                continue
            if north not in ds.data_vars:
                partner = next((m for m, other in enumerate(paired) if m != k and _fits(ds[east], other, north)), None)
                if partner is None:
                    continue
                other = paired[partner]
                try:
                    across = interpolate_like(other[north], ds[east])
                except ForcingError as error:
                    raise ForcingError(error.what, where=named(ds), remedy=error.remedy) from error
                source = ", ".join(
                    dict.fromkeys([*str(ds.attrs["source"]).split(", "), *str(other.attrs["source"]).split(", ")])
                )
                ds = ds.assign({north: across}).assign_attrs(source=source)
                paired[partner] = other.drop_vars(north)
            paired[k] = _turn_vectors(ds, east, north)
    for ds in paired:
        for name in [name for pair in VECTORS for name in pair if name in ds.data_vars]:
            if ds[name].attrs.get("along") == "grid":
                pair = next(pair for pair in VECTORS if name in pair)
                partner_name = pair[1 - pair.index(name)]
                original = ds[name].attrs.get("original_name", name)
                raise ForcingError(
                    f"{original} points along the rows or columns of its grid, and no file gives the other component "
                    f"({QUANTITIES[partner_name].long_name}) with the same records: without it the vector cannot be turned to "
                    "east and north", where=named(ds), remedy=f"Add the file with the partner of {original}",
                )  # fmt: skip
    return [ds.drop_vars("grid_angle", errors="ignore") for ds in paired if ds.data_vars]


def _fits(field: xr.DataArray, other: xr.Dataset, name: str) -> bool:
    """Tell whether another dataset holds the partner of a component, of the same records, levels and kind."""
    if name not in other.data_vars or other[name].attrs.get("along") != field.attrs.get("along"):
        return False
    for axis in ("time", "depth"):
        mine, yours = (a[axis].values if axis in a.dims else np.array([]) for a in (field, other[name]))
        if mine.size != yours.size:
            return False
        dates = mine.dtype.kind == "M"
        # Two files of one run may round the same date or depth in their own way.
        slack: Any = np.timedelta64(1, "s") if dates else 1e-3 * max(1.0, float(np.abs(mine).max(initial=0.0)))
        if mine.size and not np.all(np.abs(mine - yours) <= slack):
            return False
    return True


def _turn_vectors(ds: xr.Dataset, east: str, north: str) -> xr.Dataset:
    along = {ds[name].attrs.get("along") for name in (east, north)}
    if along == {None}:
        return ds
    if along != {"grid"}:
        raise ForcingError(
            f"of {east} and {north} one points along the grid and the other does not", where=named(ds),
            remedy="Correct the standard names in the file",
        )  # fmt: skip
    cosine, sine = np.cos(ds["grid_angle"]), np.sin(ds["grid_angle"])
    u, v = ds[east], ds[north]
    turned = {east: u * cosine - v * sine, north: u * sine + v * cosine}
    for name, old in ((east, u), (north, v)):
        turned[name] = turned[name].astype(float).transpose(*old.dims)
        turned[name].attrs = {key: value for key, value in old.attrs.items() if key != "along"}
    remark = f"{east}, {north} are turned from the axes of the grid to east and north"
    return noted(ds.assign(turned), told=remark)
