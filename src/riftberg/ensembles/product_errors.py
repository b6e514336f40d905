"""How large the errors of a product are: what it states itself, and what two products that differ say of both.

The difference of two products holds the sum of the errors of both and nothing of what they share, so what is estimated from it
is a lower bound of the error of either, if both err alike.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from riftberg.config.units import to_unit
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.errors import ForcingError, InputError
from riftberg.ocean.errors import SizeField
from riftberg.products.cf import role_of, units_of
from riftberg.products.levels import uppermost
from riftberg.products.registry import open_all
from riftberg.state import Floats
from riftberg.system.input_files import check_file, reading
from riftberg.system.netcdf_lock import open_lazily

LEAST: Final = 0.3
"""Correlation down to which the curve is fitted: below, the few independent pairs of a box make it noise."""

_ERROR: Final = re.compile(r"(^|_)(err(or)?s?|uncertainty|std_?dev)(_|$)")
_EAST, _NORTH = (re.compile(pattern) for pattern in (r"^(u|eastward|x_)", r"^(v|northward|y_)"))


@lru_cache(maxsize=4)  # each member of a worker reads the same file
def stated_error(path: str) -> SizeField:
    """Return the standard deviation of each component of the current as a product states it, m s-1.

    Variables of errors are found by their names or standard names (``uo_err``, ``err_ugosa``,
    ``eastward_eulerian_current_velocity_error``, standard name with ``standard_error``). Records and both components are
    brought together as the root of their mean square, the uppermost level counts.

    Raises
    ------
    ForcingError
        If the file states none on axes of longitude and latitude.
    """
    remedy = (
        "Give the file of a product that has variables such as uo_err and vo_err, or a number (current_error.speed)"
    )
    check_file(Path(path), remedy=remedy)
    with reading(Path(path), "cannot be read", remedy, ForcingError), open_lazily(path) as ds:
        pair = [name for way in (_EAST, _NORTH) if (name := _error_variable(ds, way))]
        if len(pair) < 2:
            raise ForcingError("states no error of its current", where=path, remedy=remedy)
        square: Any = 0.0
        for name in pair:
            field = ds[name]
            axes = {role: dim for dim in field.dims if dim in ds.variables and (role := role_of(dim, ds[dim].variable))}
            if not {"lon", "lat"} <= set(axes):
                raise ForcingError(f"{name} is not on axes of longitude and latitude", where=path, remedy=remedy)
            field = field.isel(
                {dim: 0 for dim in field.dims if dim not in (axes["lon"], axes["lat"], axes.get("time"))}
            )
            factor = to_unit(f"1 {units_of(field) or 'm s-1'}", "m s-1")
            field = field.transpose(..., axes["lat"], axes["lon"])
            values = (factor * field.astype(float)) ** 2
            square = square + 0.5 * (values.mean([axes["time"]]) if "time" in axes and values.ndim > 2 else values)
        lon, lat = (np.asarray(ds[axes[role]].values, float) for role in ("lon", "lat"))
        size = np.sqrt(np.asarray(square))
    if not np.isfinite(size).any():
        raise ForcingError(f"{pair[0]} holds no value", where=path, remedy=remedy)
    size = np.where(np.isfinite(size), size, np.nanmean(size))[np.argsort(lat)][:, np.argsort(lon)]
    return SizeField(np.sort(lon), np.sort(lat), size, Path(path).name)


def _error_variable(ds: xr.Dataset, way: re.Pattern[str]) -> str:
    """Return the variable of the error of a component; empty if there is none."""
    for name in map(str, ds.data_vars):
        standard = str(ds[name].attrs.get("standard_name", ""))
        bare = _ERROR.sub("_", name.lower()).strip("_")
        if (bare != name.lower() and way.match(bare)) or ("standard_error" in standard and way.match(standard)):
            return name
    return ""


class Estimate(NamedTuple):
    """Size and scales of the error of a current, as `riftberg forecast` takes them."""

    speed: float  # Standard deviation of each component, m s-1
    length: float  # L of exp(-r2 / 2 L2), m
    time: float  # T of exp(-t / T), s; NaN of a single record
    points: int  # of the grid
    records: int

    @property
    def vary(self) -> list[str]:
        """The options that give them to a forecast."""
        found = [f"current_error.speed={self.speed:.2g} m/s", f"current_error.length={self.length / 1e3:.2g} km"]
        return found + ([f"current_error.time={self.time / 86400.0:.2g} day"] if np.isfinite(self.time) else [])


def estimated(
    first: str | Path | Sequence[str], second: str | Path | Sequence[str], *,
    longitude: tuple[float, float] | None = None, latitude: tuple[float, float] | None = None,
) -> Estimate:  # fmt: skip
    """Estimate the errors of the current from the differences of two products.

    Parameters
    ----------
    first, second : path, or sequence of them
        Files of two products of the same days and area, on axes of longitude and latitude.
    longitude, latitude : pair of float, optional
        Box, degrees; by default what both cover.

    Returns
    -------
    Estimate
        The standard deviation is the difference over the root of two: that of either product if both err alike and by
        themselves. What they share is not in it, so it is a lower bound.

    Raises
    ------
    InputError
        If the products do not overlap, or have no current on such axes.
    """
    one, other = (_currents(path) for path in (first, second))
    if _spacing(one) < _spacing(other):
        one, other = other, one  # on the points of the coarser one
    for axis, wanted in (("lon", longitude), ("lat", latitude)):
        low, high = (f(float(one[axis][k]), float(other[axis][k])) for f, k in ((max, 0), (min, -1)))
        low, high = (low, high) if wanted is None else (max(low, wanted[0]), min(high, wanted[1]))
        one = one.sel({axis: slice(low, high)})
    first_date, last_date = (f(one["time"].values[k], other["time"].values[k]) for f, k in ((max, 0), (min, -1)))
    one = one.sel(time=slice(first_date, last_date))
    if min(one.sizes[axis] for axis in ("lon", "lat")) < 4 or not one.sizes["time"]:
        raise InputError(
            "the products do not share four by four points and a date", where=f"{first}, {second}",
            remedy="Give files of the same days and area, or a larger box",
        )  # fmt: skip
    there = other.interp(lon=one["lon"], lat=one["lat"])
    there = there.interp(time=one["time"]) if other.sizes["time"] > 1 else there.isel(time=[0])
    apart = [np.asarray(one[name].values - there[name].values, float) / np.sqrt(2.0) for name in ("uo", "vo")]
    speed = float(np.sqrt(np.nanmean([np.nanmean(a**2) for a in apart])))
    if not speed > 1e-6:  # m s-1; what interpolation leaves is smaller
        raise InputError("the products do not differ", where=f"{first}, {second}", remedy="Give two products")
    days = (one["time"].values - one["time"].values[0]) / np.timedelta64(1, "s")
    return Estimate(speed, _length(apart, one), _time(apart, days), one.sizes["lon"] * one.sizes["lat"], days.size)


def _currents(path: Any) -> xr.Dataset:
    """Return the current of a product at its uppermost level, on rising axes, over the length of the file."""
    paths = [str(p) for p in ([path] if isinstance(path, str | Path) else path)]
    ds = next((ds for ds in open_all(paths) if "uo" in ds and "vo" in ds), None)
    where = ", ".join(paths)
    if ds is None:
        raise InputError("no current", where=where, remedy="Give the file of an ocean product")
    ds = uppermost(ds, ("uo", "vo"))[["uo", "vo"]]
    if not {"time", "lat", "lon"} <= set(ds.dims):
        raise InputError(
            "no current by date on axes of longitude and latitude", where=where, remedy="Interpolate it to such axes"
        )
    return ds.sortby(["time", "lat", "lon"])


def _spacing(ds: xr.Dataset) -> float:
    return float(np.median(np.diff(ds["lat"].values)))


def _length(apart: Sequence[Floats], ds: xr.Dataset) -> float:
    """Return L from the correlation of each component along its own direction: exp(-r2 / 2 L2) of a stream function."""
    lat = np.asarray(ds["lat"].values, float)
    across = DEGREE * EARTH_RADIUS_A68 * _spacing(ds)
    along = DEGREE * EARTH_RADIUS_A68 * float(np.median(np.diff(ds["lon"].values))) * float(np.cos(lat.mean() * DEGREE))
    r, rho, pairs = [], [], []
    for values, axis, step in ((apart[0], -1, along), (apart[1], -2, across)):
        for lag, correlation, count in _correlations(values, axis):
            r.append(lag * step)
            rho.append(correlation)
            pairs.append(count)
    return float(_fitted(lambda x, scale: np.exp(-0.5 * (x / scale) ** 2), r, rho, pairs, start=2.0 * along))


def _time(apart: Sequence[Floats], seconds: Floats) -> float:
    """Return T from the correlation in time: exp(-t / T)."""
    if seconds.size < 3:
        return float("nan")
    step = float(np.median(np.diff(seconds)))
    found = [row for values in apart for row in _correlations(values, 0)]
    r, rho, pairs = ([row[k] * (step if k == 0 else 1.0) for row in found] for k in range(3))
    return float(_fitted(lambda x, scale: np.exp(-x / scale), r, rho, pairs, start=step))


def _correlations(values: Floats, axis: int) -> list[tuple[int, float, int]]:
    """Return lag, correlation and number of pairs along an axis, as far as the correlation stays above `LEAST`."""
    values = np.moveaxis(values, axis, -1)
    rows: list[tuple[int, float, int]] = []
    variance = float(np.nanmean(values**2))
    for lag in range(1, values.shape[-1] // 2 + 1):
        products = values[..., :-lag] * values[..., lag:]
        correlation = float(np.nanmean(products)) / variance
        if rows and correlation < LEAST:
            break
        rows.append((lag, correlation, int(np.isfinite(products).sum())))
    return rows


def _fitted(curve: Any, r: Sequence[float], rho: Sequence[float], pairs: Sequence[float], *, start: float) -> float:
    from scipy.optimize import curve_fit

    (scale,), _ = curve_fit(
        curve,
        np.array(r),
        np.array(rho),
        p0=[start],
        sigma=1.0 / np.sqrt(np.array(pairs, float)),
        bounds=(1e-3, np.inf),
    )
    return float(scale)
