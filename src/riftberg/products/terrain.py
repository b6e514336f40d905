"""Levels that follow the sea floor (s and sigma coordinates of ROMS, CROCO, FVCOM), turned into depths.

The depth of a level follows from the depth of the sea floor h, with the free surface at 0 (CF appendix D):

    sigma:  z = s h,    g1:  z = h_c s + (h - h_c) C,    g2:  z = h (h_c s + h C) / (h_c + h).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.errors import ForcingError
from riftberg.products.roles import standard_name
from riftberg.products.vectors import on_points_of, plane_of

Floats = NDArray[np.float64]

DEPTHS = (
    0,
    5,
    10,
    15,
    20,
    30,
    40,
    50,
    60,
    75,
    100,
    125,
    150,
    175,
    200,
    225,
    250,
    275,
    300,
    350,
    400,
    450,
    500,
    600,
    700,
    800,
)
"""Depths (m) that currents on such levels are interpolated to."""

LEVEL = "s_level"
UPPERMOST = 0.1
"""An uppermost level within this share of the water is at the surface."""


def on_depths(ds: xr.Dataset, field: xr.DataArray, axis: xr.DataArray, place: Any, *, where: str) -> xr.DataArray:
    """Return a placed field on ``depth`` instead of ``s_level``; NaN below the sea floor."""
    s = np.asarray(axis.values, float)
    if s.min() < -1.0 - 1e-6 or s.max() > 1e-6 or s.max() < -UPPERMOST:
        raise ForcingError(
            f"the levels {axis.name} = {s.max():g} ... {s.min():g} do not begin at the surface (0)", where=where,
            remedy="Give a file with the uppermost levels",
        )  # fmt: skip
    floor, stretch, critical, kind = _terms(ds, axis, where)
    h = place(floor)
    h = h if plane_of(h) == plane_of(field) and _same_points(h, field) else on_points_of(h, field)
    depth = _depth_of(s, stretch, critical, kind, np.asarray(h.values, float))
    order = np.argsort(-s)
    targets = np.array([d for d in DEPTHS if d <= np.nanmax(h.values)] or [0], float)
    plane = plane_of(field)

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
    kind = (
        "g1"
        if "g1" in metadata_name or transform == 1.0
        else "g2"
        if "g2" in metadata_name or transform == 2.0
        else "sigma"
    )
    if "sigma" in metadata_name:
        kind = "sigma"
    c_name = next((n for n in (terms.get("C"), "Cs_r", "Cs_rho", "sc_r") if n and n in ds.variables), None)
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


def _depth_of(s: Floats, stretch: Floats, critical: float, kind: str, h: Floats) -> Floats:
    """Return depths (m, positive down) of all levels over a floor of depth ``h``."""
    column = (slice(None), *([None] * h.ndim))
    s, stretch = s[column], stretch[column]
    if kind == "g2":
        return np.asarray(-h * (critical * s + h * stretch) / (critical + h))
    if kind == "g1":
        return np.asarray(-(critical * s + (h - critical) * stretch))
    return np.asarray(-s * h)


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
            part = np.clip(np.where(bottom > top, (target - top) / (bottom - top), 0.0), 0.0, 1.0)
        index = [
            k[(None,) * (lead + 1)] * np.ones((*values.shape[:lead], 1, *k.shape), np.int64) for k in (lower, upper)
        ]
        a, b = (np.take_along_axis(values, k, axis=lead)[(slice(None),) * lead + (0,)] for k in index)
        columns.append(np.where(floor >= target, (1.0 - part) * a + part * b, np.nan))
    return np.stack(columns, axis=lead)
