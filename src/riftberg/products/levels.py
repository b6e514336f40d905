"""Where a field holds in the vertical, by whatever coordinate says it: read and judged, never dropped unseen.

Winds must be those at 10 m, currents must begin near the surface. The meaning of a coordinate follows from its units, its
standard name and its name, in this order.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.products.cf import find_bounds, find_coordinates, read_units, role_by_name, standard_name
from riftberg.products.quantities import QUANTITIES, conversion, labelled, unit_change
from riftberg.products.vectors import horizontal_dims, interpolate_like
from riftberg.state import Floats

Kind = Literal["depth", "height", "pressure", "sigma", "number"]

SURFACE = 30.0
"""Currents down to this depth (m) count as those of the surface: OSCAR is a mean over the top 30 m."""

WIND_HEIGHTS = (9.0, 11.0)
"""Heights (m) that count as 10 m."""

WINDS = ("ua", "va")
CURRENTS = ("uo", "vo")
_WATER = (*CURRENTS, "sst", "sss")
_PRESSURES = ("pa", "hpa", "mb", "mbar", "millibar", "millibars")
_TOLD = re.compile(
    r"(\d+(?:\.\d+)?)\s*[- ]?(hpa|mbar|mb|millibars?|m|met(?:re|er)s?)(?:\b|_)(?!\s*(?:/|s\b|s-1|s\*\*))", re.I
)


def judge_levels(
    ds: xr.Dataset, name: str, field: xr.DataArray, quantity: str, *, where: str
) -> tuple[xr.DataArray, list[str]]:
    """Return a field on ``depth`` or without levels, and remarks on it."""
    _judge_words(field, name, quantity, where)
    levels = [c for c, role, _ in find_coordinates(ds, name) if role == "level" and set(ds[c].dims) <= set(field.dims)]
    remarks: list[str] = []
    # A dimension is one of levels if a coordinate along it says so, or, without any, by its name.
    dims = [
        dim
        for dim in map(str, field.dims)
        if dim in {str(d) for c in levels for d in ds[c].dims} or role_by_name(dim) == "level"
    ]
    if len(dims) > 1:
        raise ForcingError(
            f"{name} has {len(dims)} dimensions of levels ({', '.join(dims)})", where=where,
            remedy=f"Choose one entry first, in Python: ds.isel({dims[-1]}=0)",
        )  # fmt: skip
    scalars = [c for c in levels if ds[c].ndim == 0]
    # A level of the air beside a field of the sea belongs to another variable of the same file.
    native = [c for c in levels if not _is_air_level(ds[c], quantity)]
    for scalar in scalars:
        if scalar not in native and (native or quantity == "ssh"):  # of the other variables of the file
            remarks.append(f"{scalar} = {_level_value(ds[scalar]):g} says nothing of {name}")
        else:
            remarks += _judge_single(ds[scalar], _edges(ds, scalar), name, quantity, where)
        field = field.drop_vars(scalar, errors="ignore")
    if not dims:
        return field, remarks
    dim = dims[0]
    # The coordinate with the name of its dimension is the axis; others along it may count something else.
    axis = next((c for c in sorted(levels, key=lambda c: c != dim) if ds[c].dims == (dim,)), None)
    if axis is None:
        return _unplaced(field, name, dim, quantity, where), remarks
    if field.sizes[dim] == 1:
        remarks += _judge_single(ds[axis].isel({dim: 0}), _edges(ds, axis), name, quantity, where)
        return field.isel({dim: 0}, drop=True).drop_vars(axis, errors="ignore"), remarks
    field, more = _several(field, ds[axis], _edges(ds, axis), name, dim, quantity, where)
    return field, remarks + more


def level_kind(axis: xr.DataArray) -> Kind:
    """Return the kind of a vertical coordinate."""
    units, metadata, name = read_units(axis).strip().lower(), standard_name(axis), str(axis.name).lower()
    # Units say most, then the standard name, and only then the name.
    if units in _PRESSURES or metadata in ("air_pressure", "pressure"):
        return "pressure"
    if any(word in f"{metadata} {name}" for word in ("sigma", "ocean_s_", "hybrid", "s_rho", "siglay", "eta")):
        return "sigma"
    if units in ("1", "level", "levels", "layer", "count") or metadata == "model_level_number":
        return "number"
    metres = units in ("m", "meter", "meters", "metre", "metres", "km", "cm", "centimeter", "centimeters")
    if metadata in ("height", "altitude", "height_above_mean_sea_level") or (
        name.startswith(("height", "alt")) and metadata != "depth"
    ):
        return "height"
    if (
        metadata == "depth"
        or name.startswith("dep")
        or (metres and str(axis.attrs.get("positive", "")).lower() == "down")
    ):
        return "depth"
    if metres:
        return "height" if str(axis.attrs.get("positive", "")).lower() == "up" else "depth"
    return "number"


def _is_air_level(axis: xr.DataArray, quantity: str) -> bool:
    """Tell whether a level of a field of the sea can only be one of the air: a pressure, a sigma above 0, a height."""
    if quantity not in (*_WATER, "ssh"):
        return False
    kind, above = level_kind(axis), float(np.nanmax(np.asarray(axis.values, float), initial=-np.inf)) > 0.0
    return kind == "pressure" or (kind in ("sigma", "height") and above)


def _judge_words(field: xr.DataArray, name: str, quantity: str, where: str) -> None:
    """Refuse a wind whose own description names another height or a pressure, and a current far below the surface."""
    if quantity in CURRENTS:
        deep = re.search(
            r"\bat (?:a depth of )?(\d+(?:\.\d+)?) ?(?:m|met(?:re|er)s?)\b(?! ?/)",
            str(field.attrs.get("long_name", "")),
        )
        if deep and float(deep[1]) > SURFACE:
            raise _too_deep(name, f"{deep[1]} m (its description reads {field.attrs['long_name']!r})", where)
    if quantity not in WINDS:
        return
    words = " ".join(str(field.attrs.get(k, "")) for k in ("long_name", "level_desc", "var_desc", "GRIB_name"))
    on_level = str(field.attrs.get("GRIB_typeOfLevel", "")).lower()
    if "isobaric" in on_level or "hybrid" in on_level or re.search(r"\bpressure level", words, re.I):
        raise _no_surface_wind(name, f"on a pressure or model level ({words.strip() or on_level})", where)
    heights = _TOLD.findall(words)
    if any(
        unit.lower() in ("m", "metre", "meter", "metres", "meters") and float(number) == 10.0
        for number, unit in heights
    ):
        return
    for number, unit in heights:
        metres = unit.lower().startswith("m") and not unit.lower().startswith(("mb", "mil"))
        if not metres or not WIND_HEIGHTS[0] <= float(number) <= WIND_HEIGHTS[1]:
            raise _no_surface_wind(name, f"at {number} {unit} (its description reads {words.strip()!r})", where)
    match = re.fullmatch(r"(?:[uv]a?s?|[uv]_?wi?nd|wind_[uv])_?(\d{2,4}(?=m?$)|\d(?=m$))m?", name.lower())
    if match and not WIND_HEIGHTS[0] <= float(match[1]) <= WIND_HEIGHTS[1]:
        raise _no_surface_wind(name, f"at {match[1]} m or hPa by its name", where)


def _no_surface_wind(name: str, level: str, where: str) -> ForcingError:
    return ForcingError(
        f"{name} is the wind {level}, not that at 10 m", where=where, remedy="Give a file of the wind at 10 m"
    )


def _level_value(axis: xr.DataArray) -> float:
    value = np.ravel(axis.values)
    return float(value[0]) if value.dtype.kind in "iuf" else float("nan")


def _edges(ds: xr.Dataset, axis: str) -> Floats | None:
    """Return the edges of the layers that a vertical coordinate stands for, lowest and highest number of them all."""
    bounds = find_bounds(ds, ds[axis])
    if bounds is None or bounds.dtype.kind not in "iuf":
        return None
    edges = np.abs(np.asarray(bounds.values, float))
    return np.array([edges.min(), edges.max()]) if np.isfinite(edges).all() else None


def _judge_single(axis: xr.DataArray, edges: Floats | None, name: str, quantity: str, where: str) -> list[str]:
    """Refuse a field on a single level elsewhere than it is needed; return a remark where the level is worth one."""
    kind, value, units = level_kind(axis), _level_value(axis), read_units(axis)
    level = f"{axis.name} = {value:g} {units if units != '1' else ''}".rstrip()
    if quantity in WINDS:
        if kind in ("height", "depth") and WIND_HEIGHTS[0] <= abs(value) * _metres(units) <= WIND_HEIGHTS[1]:
            return []
        if (
            not units
            and kind == "number"
            and WIND_HEIGHTS[0] <= value <= WIND_HEIGHTS[1]
            and "height" in str(axis.name).lower()
        ):
            return []
        raise _no_surface_wind(name, f"at {level}", where)
    if quantity in _WATER or quantity == "ssh":
        if kind in ("depth", "height"):
            depth = abs(value) * _metres(units)
            # The middle of a thick layer lies deep although the layer begins at the surface.
            if edges is not None and depth > SURFACE and edges[0] * _metres(units) <= SURFACE:
                top, bottom = edges * _metres(units)
                return [f"{name} is the mean from {top:.3g} to {bottom:.3g} m: taken for all depths"]
            if depth <= SURFACE:
                return [f"{name} holds at {depth:.3g} m: taken as the surface"] if depth > 0.0 else []
            raise _too_deep(name, level, where)
        # The uppermost of ten layers or more has its middle at -0.05.
        if kind == "sigma" and abs(value) <= 0.06:
            return [f"{name} is of the uppermost layer ({level})"]
        if kind == "number" and not units and str(axis.name).lower().startswith(("lev", "k")) and value in (0.0, 1.0):
            return [f"{name} is of level {value:g}: taken as the uppermost"]
        raise ForcingError(
            f"{name} holds at {level}, and nothing says that this is the surface", where=where,
            remedy=f"If it is, write so into the file: {axis.name} = 0 with units m and positive down",
        )  # fmt: skip
    return []


def _metres(units: str) -> float:
    """Return the metres in a unit of lengths; others, which are judged elsewhere, count as metres."""
    return (unit_change(units, "m") or (1.0, 0.0))[0]


def _too_deep(name: str, level: str, where: str) -> ForcingError:
    return ForcingError(
        f"{name} begins at {level}; between there and the surface nothing is known", where=where,
        remedy=f"Give levels from the surface on (the first at {SURFACE:g} m or less)",
    )  # fmt: skip


def _unplaced(field: xr.DataArray, name: str, dim: str, quantity: str, where: str) -> xr.DataArray:
    """Refuse levels without a coordinate: numbers of rows are no depths."""
    if quantity not in (*WINDS, *_WATER) and field.sizes[dim] == 1:
        return field.isel({dim: 0}, drop=True)
    raise ForcingError(
        f"the dimension {dim} of {name} ({field.sizes[dim]} levels) has no coordinate that says where they lie", where=where,
        remedy=f"Write it, in Python: ds.assign_coords({dim}=('{dim}', values, {{'units': 'm', 'positive': 'down'}}))",
    )  # fmt: skip


def _several(
    field: xr.DataArray, axis: xr.DataArray, edges: Floats | None, name: str, dim: str, quantity: str, where: str
) -> tuple[xr.DataArray, list[str]]:
    """Return a field with several levels: all of a current, temperature or salinity; of a wind the one at 10 m."""
    kind, values = level_kind(axis), np.asarray(axis.values, float)
    if quantity in WINDS:
        metres = np.abs(values) * _metres(read_units(axis))
        right = np.flatnonzero((metres >= WIND_HEIGHTS[0]) & (metres <= WIND_HEIGHTS[1]))
        if kind not in ("height", "depth") or right.size != 1:
            listed = ", ".join(f"{value:g}" for value in values[:6])
            raise _no_surface_wind(name, f"on {values.size} levels ({axis.name} = {listed} {read_units(axis)})", where)
        return field.isel({dim: int(right[0])}, drop=True).drop_vars(str(axis.name), errors="ignore"), [
            f"{name} is taken at 10 m of {values.size} heights"
        ]
    if quantity not in _WATER:
        raise ForcingError(
            f"{name} has {values.size} entries along {dim}", where=where,
            remedy=f"Choose one first, in Python: ds.isel({dim}=0)",
        )  # fmt: skip
    if kind == "sigma" and values.size:
        field = field.drop_vars(str(axis.name), errors="ignore")
        if quantity in CURRENTS:
            return field.rename({dim: "s_level"}) if dim != "s_level" else field, []
        if values.max() < -0.1 or values.max() > 1e-6:
            raise _too_deep(name, f"{axis.name} = {values.max():g}", where)
        return field.isel({dim: int(values.argmax())}, drop=True), [f"{name} is of the uppermost layer"]
    depth = depths(axis, where=where)
    top = float(depth.min()) if edges is None else float(edges[0]) * _metres(read_units(axis))
    if top > SURFACE:
        raise _too_deep(name, f"{axis.name} = {depth.min():g} m", where)
    field = field.drop_vars(str(axis.name), errors="ignore").rename({dim: "depth"} if dim != "depth" else {})
    field = field.assign_coords(depth=("depth", depth, {"units": "m"})).sortby("depth")
    return field, []


def depths(axis: xr.DataArray, *, where: str) -> Floats:
    """Return the depths (m, positive) of an axis of levels; refuse one that counts something else."""
    kind, values, units = level_kind(axis), np.asarray(axis.values, float), read_units(axis)
    # 0, 1, 2, ... or 1, 2, 3, ... without units are numbers of rows.
    counted = values.size > 1 and any(np.array_equal(values, np.arange(values.size) + first) for first in (0, 1))
    if not np.isfinite(values).all():
        raise ForcingError(f"the levels {axis.name} are not all numbers", where=where, remedy="Correct the file")
    if kind in ("pressure", "sigma") or (not units and counted) or (kind == "number" and units):
        listed = ", ".join(f"{value:g}" for value in values[:4])
        raise ForcingError(
            f"the levels {axis.name} = {listed} ... {units or '(no units)'} are no depths in metres", where=where,
            remedy="Turn them into depths first (cdo intlevel or xgcm), or write their units",
        )  # fmt: skip
    factor, _ = conversion(QUANTITIES["depth_below_surface"], units or "m", where=f"{where}, axis {axis.name}")
    if (values > 0.0).any() and (values < 0.0).any():
        raise ForcingError(
            f"the levels {axis.name} lie above and below 0", where=where, remedy="Give depths, positive down"
        )
    return np.asarray(np.abs(values) * factor)


def uppermost(ds: xr.Dataset, names: Iterable[str]) -> xr.Dataset:
    """Return a canonical dataset with the named fields at their uppermost level; without depths that none has any more."""
    deep = [name for name in names if name in ds and "depth" in ds[name].dims]
    ds = ds.assign({name: ds[name].isel(depth=0, drop=True) for name in deep})
    return ds if any("depth" in field.dims for field in ds.values()) else ds.drop_vars("depth", errors="ignore")


# Levels that follow the sea floor (s and sigma coordinates of ROMS, CROCO, FVCOM), turned into depths.
#
# The depth of a level follows from the depth of the sea floor h, with the free surface at 0 (CF appendix D):
#
#     sigma:  z = s h,    g1:  z = h_c s + (h - h_c) C,    g2:  z = h (h_c s + h C) / (h_c + h).


DEPTHS = (
    *range(0, 20, 5), *range(20, 60, 10), 60, *range(75, 300, 25), *range(300, 500, 50), *range(500, 801, 100),
)  # fmt: skip
"""Depths (m) that currents on such levels are interpolated to."""

LEVEL = "s_level"
UPPERMOST = 0.1
"""An uppermost level within this share of the water is at the surface."""


def on_depths(ds: xr.Dataset, field: xr.DataArray, axis: xr.DataArray, locate: Any, *, where: str) -> xr.DataArray:
    """Return a placed field on ``depth`` instead of ``s_level``; NaN below the sea floor."""
    s = np.asarray(axis.values, float)
    if s.min() < -1.0 - 1e-6 or s.max() > 1e-6 or s.max() < -UPPERMOST:
        raise ForcingError(
            f"the levels {axis.name} = {s.max():g} ... {s.min():g} do not begin at the surface (0)", where=where,
            remedy="Give a file with the uppermost levels",
        )  # fmt: skip
    floor, stretch, critical, kind = _terms(ds, axis, where)
    h = locate(floor)
    h = h if horizontal_dims(h) == horizontal_dims(field) and _same_points(h, field) else interpolate_like(h, field)
    water = np.asarray(h.values, float)
    column = (slice(None), *([None] * water.ndim))
    share, bend = s[column], stretch[column]
    if kind == "g2":
        depth = -water * (critical * share + water * bend) / (critical + water)
    else:
        depth = -(critical * share + (water - critical) * bend) if kind == "g1" else -share * water
    order = np.argsort(-s)
    targets = np.array([d for d in DEPTHS if d <= np.nanmax(h.values)] or [0], float)
    plane = horizontal_dims(field)

    def apply(values: Floats) -> Floats:
        return _interpolated(np.take(values, order, axis=-1 - len(plane)), depth[order], np.asarray(h.values), targets)

    core = [LEVEL, *plane]
    lazy = field.chunk({dim: -1 for dim in core}) if field.chunks is not None else field
    result: xr.DataArray = xr.apply_ufunc(
        apply, lazy, input_core_dims=[core], output_core_dims=[["depth", *plane]], dask="parallelized", keep_attrs=True,
        output_dtypes=[np.float64], dask_gufunc_kwargs={"output_sizes": {"depth": targets.size}},
    )  # fmt: skip
    return result.assign_coords(depth=("depth", targets, {"units": "m"}))


def _same_points(a: xr.DataArray, b: xr.DataArray) -> bool:
    # Rows of u on straight axes are those of the cells: their longitudes alone tell them apart.
    return all(a[axis].shape == b[axis].shape for axis in ("lat", "lon")) and bool(
        np.allclose(a["lat"], b["lat"], equal_nan=True) and np.allclose(a["lon"], b["lon"], equal_nan=True)
    )


def _terms(ds: xr.Dataset, axis: xr.DataArray, where: str) -> tuple[str, Floats, float, str]:
    """Return the name of the floor's depth, stretching C, critical depth and kind of formula."""
    words = str(axis.attrs.get("formula_terms", "")).replace(":", ": ").split()
    terms = {word[:-1]: words[k + 1] for k, word in enumerate(words[:-1]) if word.endswith(":")}
    floor = next((name for name in (terms.get("depth"), "h") if name and name in ds.variables), None)
    metadata_name = standard_name(axis)
    transform = next((float(np.ravel(ds[n].values)[0]) for n in ("Vtransform",) if n in ds.variables), None)
    # Files from before ROMS had a choice do not name the transform: theirs is the first, as in CF's "ocean_s_coordinate".
    stretched = transform is None and (metadata_name == "ocean_s_coordinate" or "C" in terms)
    kind = (
        "g1"
        if "g1" in metadata_name or transform == 1.0
        else "g2"
        if "g2" in metadata_name or transform == 2.0
        else "g1"
        if stretched
        else "sigma"
    )
    if "sigma" in metadata_name:
        kind = "sigma"
    c_name = next((n for n in (terms.get("C"), "Cs_r", "Cs_rho") if n and n in ds.variables), None)
    hc_name = next((n for n in (terms.get("depth_c"), "hc", "Tcline") if n and n in ds.variables), None)
    lacking = [word for word, name in (("h", floor), ("Cs_r", c_name), ("hc", hc_name)) if name is None]
    if floor is None or (kind != "sigma" and lacking):
        raise ForcingError(
            f"the levels {axis.name} follow the sea floor, and the file lacks {', '.join(lacking)} to turn them into depths",
            where=where, remedy="Add it from the grid or history file of the model: ncks -A -v h,hc,Cs_r GRID FILE",
        )  # fmt: skip
    stretch = np.asarray(ds[c_name].values, float) if kind != "sigma" and c_name else np.asarray(axis.values, float)
    critical = float(np.ravel(ds[hc_name].values)[0]) if kind != "sigma" and hc_name else 0.0
    if stretch.shape != axis.shape:
        raise ForcingError(
            f"{c_name} and {axis.name} differ in length", where=where, remedy="Cut both to the same levels"
        )
    return floor, stretch, critical, kind


def _interpolated(values: Floats, depth: Floats, floor: Floats, targets: Floats) -> Floats:
    """Interpolate (..., level, place) at depths; constant above the first and below the last level, NaN in the floor."""
    columns = []
    lead = values.ndim - depth.ndim
    for target in targets:
        below = (depth <= target).sum(axis=0)
        lower = np.clip(below - 1, 0, len(depth) - 2) if len(depth) > 1 else np.zeros_like(below)
        upper = np.minimum(lower + 1, len(depth) - 1)
        top, bottom = (np.take_along_axis(depth, k[None], axis=0)[0] for k in (lower, upper))
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.clip(np.where(bottom > top, (target - top) / (bottom - top), 0.0), 0.0, 1.0)
        index = [
            k[(None,) * (lead + 1)] * np.ones((*values.shape[:lead], 1, *k.shape), np.int64) for k in (lower, upper)
        ]
        a, b = (np.take_along_axis(values, k, axis=lead)[(slice(None),) * lead + (0,)] for k in index)
        columns.append(np.where(floor >= target, (1.0 - share) * a + share * b, np.nan))
    return np.stack(columns, axis=lead)


# Currents over the draft: the mean from the surface to the keel, for one draft or for a field of drafts.
#
# A berg of 200 m draft moves with the water along its whole side, not with the surface. Levels of a product are taken
# as layers whose limits lie half-way between levels (the first begins at the surface); within a layer the current is
# constant. The mean runs over water only: in water shallower than the draft it ends at the sea floor.


def layer_limits(depth: Floats) -> Floats:
    """Return the limits (m) of the layers around the levels ``depth`` (m, ascending): one more than levels."""
    depth = np.asarray(depth, float)
    if depth.size == 1:
        return np.array([0.0, 2.0 * depth[0]])
    middle = 0.5 * (depth[:-1] + depth[1:])
    return np.concatenate([[0.0], middle, [2.0 * depth[-1] - middle[-1]]])


def keel_mean(ds: xr.Dataset, draft: float | xr.DataArray) -> xr.Dataset:
    """Replace currents on levels by their mean from the surface to the draft.

    ``draft``: draft (m, positive).
    """
    where = str(ds.attrs.get("source", ""))
    names = [name for name in ("uo", "vo") if name in ds.data_vars and "depth" in ds[name].dims]
    if not names:
        raise ForcingError(
            "has no currents on levels of depth", where=where,
            remedy="Use a product with depth (GLORYS12), or run with surface currents",
        )  # fmt: skip
    limits = layer_limits(ds["depth"].values)
    low, high, deepest = float(np.nanmin(draft)), float(np.nanmax(draft)), float(limits[-1])
    if low <= 0.0 or high > deepest * (1.0 + 1e-9):
        raise ForcingError(
            f"drafts {low:g}..{high:g} m are outside the layers of the data, 0..{deepest:g} m", where=where,
            remedy="Fetch deeper levels, or give a draft above zero",
        )  # fmt: skip
    top = xr.DataArray(limits[:-1], dims="depth", coords={"depth": ds["depth"].values})
    thick = xr.DataArray(np.diff(limits), dims="depth", coords={"depth": ds["depth"].values})
    share = (draft - top).clip(0.0, None)
    weight = share.where(share < thick, thick)
    means = {}
    for name in names:
        water = weight.where(ds[name].notnull(), 0.0)
        total = water.sum("depth")
        mean = (ds[name].fillna(0.0) * water).sum("depth") / total.where(total > 0.0)
        means[name] = labelled(mean, QUANTITIES[name]).assign_attrs(cell_methods="depth: mean (surface to draft)")
    draft_text = f"{float(draft):g} m" if np.ndim(draft) == 0 else "a draft that varies"
    history = f"currents averaged from the surface to {draft_text}; {ds.attrs.get('history', '')}"
    return ds.drop_vars([*names, "depth"]).assign(means).assign_attrs(history=history)
