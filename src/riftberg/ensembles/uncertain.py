"""Uncertain inputs beside the parameters: position and shape of the berg at the start, and errors of its surroundings.

These are keys of `--vary` like the parameters, and hold for any experiment: they change a model at its start. The size of
the errors of a product stands here too: the product states it, or it is estimated from the difference of two products. The
difference holds the sum of both errors without the error that they share, so the estimate is a lower bound of the error of
either, if both err alike.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from riftberg.config.units import to_unit
from riftberg.config.values import Section, key, parse_date
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.errors import ForcingError, InputError
from riftberg.experiments.changes import started
from riftberg.ocean.errors import Errors, FieldError, SizeField, UncertainForcing
from riftberg.state import Floats
from riftberg.system.input_files import check_file, is_seen, read_csv_rows, reading

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.runs.model import Model


class StartError(Section):
    """The berg at the start, relative to the experiment."""

    east: float = key(0.0, "m", "distance by which the berg starts farther east", ge=-1e6, le=1e6)
    north: float = key(0.0, "m", "distance by which the berg starts farther north", ge=-1e6, le=1e6)
    error: float = key(1.0, "1", "factor on east and north, so that starts may differ in their errors", ge=0, le=1e6)
    turn: float = key(0.0, "degree", "turn of the berg at the start, counter-clockwise", ge=-360, le=360)
    thickness: float = key(1.0, "1", "factor on the thickness, and so on the mass", gt=0, le=10)
    size: float = key(1.0, "1", "factor on length and width of the outline and of each element", gt=0, le=10)
    strength: float = key(1.0, "1", "factor on the strength of all bonds", gt=0, le=100)


class CurrentError(Section):
    """Error of the current: a factor, and a random error of the sea level with the current that balances it."""

    scale: float = key(1.0, "1", "factor on the current and the slope of the sea surface everywhere", ge=0, le=10)
    speed: float = key(0.0, "m s-1", "standard deviation of each component of the current's error", ge=0, le=10)
    length: float = key(50e3, "m", "length L of the correlation exp(-r2 / 2 L2) of the level's error", gt=0, le=1e7)
    time: float = key(3 * 86400.0, "s", "time T of the correlation exp(-t / T)", gt=0, le=1e9)
    field: str | None = key(
        None, "", "file of a product that states its own error of the current: its size by place, in place of speed"
    )


class WindError(Section):
    """Error of the wind: a factor, and a random error without divergence."""

    scale: float = key(1.0, "1", "factor on the wind everywhere", ge=0, le=10)
    speed: float = key(0.0, "m s-1", "standard deviation of each component of the wind's error", ge=0, le=100)
    length: float = key(300e3, "m", "length L of the correlation exp(-r2 / 2 L2) of the stream function", gt=0, le=1e7)
    time: float = key(86400.0, "s", "time T of the correlation exp(-t / T)", gt=0, le=1e9)


class FloorError(Section):
    """Error of the depth of water."""

    offset: float = key(0.0, "m", "depth that is added everywhere", ge=-1e4, le=1e4)
    scale: float = key(1.0, "1", "factor on the depth everywhere", gt=0, le=10)
    spread: float = key(0.0, "m", "standard deviation of a random field on the depth, at least", ge=0, le=1e4)
    share: float = key(0.0, "1", "the same in parts of the depth; the larger of both counts", ge=0, le=1)
    length: float = key(10e3, "m", "length L of the correlation exp(-r2 / 2 L2) of that field", gt=0, le=1e7)


class Seed(Section):
    """Seed of the random fields."""

    seed: int = key(1, "", "seed of the random fields of a member, drawn unless it is given", ge=0)


UNCERTAIN: Final[dict[str, Any]] = {
    "start": StartError, "current_error": CurrentError, "wind_error": WindError, "floor_error": FloorError, "errors": Seed
}  # fmt: skip
"""Groups that are no parameters."""

SEED: Final = "errors.seed"


def is_uncertain(name: str) -> bool:
    """Whether a name is one of these, and no parameter."""
    return "." in name and name.partition(".")[0] in UNCERTAIN  # ``start`` alone is the date in an experiment file


def has_fields(names: Any) -> bool:
    """Whether members with these inputs have random fields."""
    return any(name.endswith(("_error.speed", "_error.spread", "_error.share", "_error.field")) for name in names)


def check_sizes(names: Collection[str]) -> None:
    """Refuse the length or time of a random error that has no size: it would do nothing."""
    sizes = {"current_error": ("speed", "field"), "wind_error": ("speed",), "floor_error": ("spread", "share")}
    for group, keys in sizes.items():
        scales = [name for name in names if name in (f"{group}.length", f"{group}.time")]
        if scales and not any(f"{group}.{size}" in names for size in keys):
            raise InputError(
                "the scale of an error that has no size", where=f"--vary {scales[0]}",
                remedy=f"Give {' or '.join(f'{group}.{size}' for size in keys)} too, or leave it out",
            )  # fmt: skip


def with_errors(model: Model, values: Mapping[str, Any]) -> Model:
    """Apply the uncertain inputs to a model at its start."""
    keys: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        if is_uncertain(name):
            group, _, key_ = name.partition(".")
            keys.setdefault(group, {})[key_] = value
    if not keys:
        return model
    sections: dict[str, Any] = {group: kind(**keys.get(group, {})) for group, kind in UNCERTAIN.items()}
    started_model = _change_start(model, sections["start"])
    c, w, f = sections["current_error"], sections["wind_error"], sections["floor_error"]
    size = None
    if c.field is not None:
        size = stated_error(c.field)
    speed = c.speed if size is None else 1.0  # the field holds the size
    errors = Errors(
        current=FieldError(speed, c.length, c.time) if speed > 0.0 else None, current_size=size,
        wind=FieldError(w.speed, w.length, w.time) if w.speed > 0.0 else None,
        floor=FieldError(1.0, f.length) if f.spread > 0.0 or f.share > 0.0 else None,
        floor_offset=f.offset, floor_scale=f.scale, floor_spread=f.spread, floor_share=f.share,
        current_scale=c.scale, wind_scale=w.scale, seed=sections["errors"].seed,
    )  # fmt: skip
    if errors != Errors(seed=errors.seed):
        earth = model.parameters.earth
        plane = earth.f_plane or not earth.latlon
        started_model.take_forcing(UncertainForcing(
            started_model.forcing, errors, started_model.elements, latlon=earth.latlon,
            latitude=earth.reference_latitude if plane else None,
        ))  # fmt: skip
    return started_model


def _change_start(model: Model, start: StartError) -> Model:
    """Return the model anew with its berg moved, turned and changed."""
    if start == StartError():
        return model
    if model.life is not None and start.size != 1.0:
        raise InputError(
            "melt of a berg whose size is varied is not possible", where="start.size", remedy="Vary start.thickness"
        )
    return started(
        model, east=start.error * start.east, north=start.error * start.north, turn=start.turn, size=start.size,
        thickness=start.thickness,
        strength=start.strength,
    )  # fmt: skip


# --- several observed starts ---------------------------------------------------------------------------------------------

COLUMNS: Final = ("date", "lon", "lat", "error_km", "age_hours", "outline")
"""Columns of a table of starts; `lon` with `lat`, all others by themselves."""

SPEED_OF_AGE: Final = 0.12
"""Speed (m s-1, along each axis) by which the error of a position grows with its age.

Half of the giant bergs north of 60 S are 12.5 km away after a day (`riftberg verify-tracks`, staying put): the median of a
normal distribution in two dimensions with a standard deviation of 10.6 km along each axis.
"""


def read_starts(path: str | Path) -> dict[str, str]:
    """Return the inputs that a table of starts varies, row after row in turn, as `riftberg.forecast` takes it.

    Parameters
    ----------
    path : path
        Table (CSV) with some of the columns ``date`` (members start then; at or before the start of the experiment), ``lon``
        and ``lat`` (degrees, of the middle of the berg), ``error_km`` (standard deviation along each axis), ``age_hours``
        (how old the position is at the start: the error grows by 0.12 m/s) and ``outline`` (file, as ``berg.outline.file``).

    Returns
    -------
    dict of str
        Distributions by name.

    Raises
    ------
    InputError
        If the table has none of these columns, or a row that cannot be read.
    """
    rows = [
        {str(key).strip().lower(): (value or "").strip() for key, value in row.items()}
        for row in read_csv_rows(Path(path))[0]
    ]
    present = [name for name in COLUMNS if name in rows[0]]
    other = [name for name in rows[0] if name not in COLUMNS]
    if not present or other or ("lon" in present) != ("lat" in present):
        fault = f"a column {other[0]!r}" if other else "no column of a start" if not present else "lon without lat"
        raise InputError(fault, where=str(path), remedy=f"Columns are {', '.join(COLUMNS)}")
    values_by_name: dict[str, list[str]] = {}
    for number, row in enumerate(rows, start=2):
        for name, value in _read_row(row, f"{path}, line {number}").items():
            values_by_name.setdefault(name, []).append(value)
    varied = {name: f"~each({', '.join(values)})" for name, values in values_by_name.items()}
    if "start.error" in varied:
        varied |= dict.fromkeys(("start.east", "start.north"), "~normal(0 m, 1 m)")
    return varied


def _read_row(row: dict[str, str], where: str) -> dict[str, str]:
    """Return the values of one start by the names of `--vary`."""

    def number(name: str, low: float, high: float) -> float:
        try:
            value = float(row[name])
        except ValueError as error:
            raise InputError(f"{name}: no number", where=where, remedy="Give a number in every row") from error
        if not low <= value <= high:
            raise InputError(f"{name}: {value:g}", where=where, remedy=f"Give {low:g} to {high:g}")
        return value

    values: dict[str, Any] = {}
    if "date" in row:
        values["start"] = parse_date(row["date"], where=where)[0].isoformat(sep=" ")
    if "lon" in row:
        position = number("lon", -540.0, 540.0), number("lat", -90.0, 90.0)
        if not is_seen(*position):
            raise InputError("latitude 0, longitude 0 are no position", where=where, remedy="Leave the row out")
        values["berg.placement"] = f"[{position[0]:.10g}, {position[1]:.10g}]"
    if "error_km" in row or "age_hours" in row:
        error = 1e3 * number("error_km", 0.0, 500.0) if "error_km" in row else 0.0
        age = 3600.0 * number("age_hours", 0.0, 2400.0) if "age_hours" in row else 0.0
        values["start.error"] = f"{math.hypot(error, SPEED_OF_AGE * age):.6g}"
    if "outline" in row:
        if not row["outline"]:
            raise InputError("outline: no file", where=where, remedy="Name a file in every row")
        values["berg.outline.file"] = row["outline"]
    return values


# --- how large the errors of products are -------------------------------------------------------------------------------

LEAST: Final = 0.3
"""Correlation down to which the curve is fitted: below, the few independent pairs of a box make it noise."""

_ERROR: Final = re.compile(r"(^|_)(err(or)?s?|uncertainty|std_?dev)(_|$)")
_EAST, _NORTH = (re.compile(pattern) for pattern in (r"^(u|eastward|x_)", r"^(v|northward|y_)"))


@lru_cache(maxsize=4)  # each member of a worker reads the same file
def stated_error(path: str) -> SizeField:
    """Return the standard deviation of each component of the current as a product states it, m s-1.

    Variables of errors are found by their names or standard names (``uo_err``, ``err_ugosa``,
    ``eastward_eulerian_current_velocity_error``, standard name with ``standard_error``). Records and both components are
    brought together as the root of their mean square, the uppermost level counts. Where the product states none, its
    nearest place that has one counts.

    Raises
    ------
    ForcingError
        If the file states none on axes of longitude and latitude.
    """
    # Here, for each run looks up what may be uncertain: to load xarray and all products would make its start half as long again.
    from scipy.spatial import cKDTree

    from riftberg.plane import unit_vectors
    from riftberg.products.cf import find_role, read_units
    from riftberg.system.netcdf_lock import open_lazily

    remedy = (
        "Give the file of a product that has variables such as uo_err and vo_err, or a number (current_error.speed)"
    )
    check_file(Path(path), remedy=remedy)
    with reading(Path(path), "cannot be read", remedy, ForcingError), open_lazily(path) as ds:
        pair = [name for pattern in (_EAST, _NORTH) if (name := _error_variable(ds, pattern))]
        if len(pair) < 2:
            raise ForcingError("states no error of its current", where=path, remedy=remedy)
        square: Any = 0.0
        for name in pair:
            field = ds[name]
            axes = {
                role: dim for dim in field.dims if dim in ds.variables and (role := find_role(dim, ds[dim].variable))
            }
            if not {"lon", "lat"} <= set(axes):
                raise ForcingError(f"{name} is not on axes of longitude and latitude", where=path, remedy=remedy)
            field = field.isel(
                {dim: 0 for dim in field.dims if dim not in (axes["lon"], axes["lat"], axes.get("time"))}
            )
            factor = to_unit(f"1 {read_units(field) or 'm s-1'}", "m s-1")
            field = field.transpose(..., axes["lat"], axes["lon"])
            values = (factor * field.astype(float)) ** 2
            square = square + 0.5 * (values.mean([axes["time"]]) if "time" in axes and values.ndim > 2 else values)
        lon, lat = (np.asarray(ds[axes[role]].values, float) for role in ("lon", "lat"))
        size = np.sqrt(np.asarray(square))
    if not np.isfinite(size).any():
        raise ForcingError(f"{pair[0]} holds no value", where=path, remedy=remedy)
    if not np.isfinite(size).all():
        points, valid = unit_vectors(*np.meshgrid(lon, lat)), np.isfinite(size)
        size[~valid] = size[valid][cKDTree(points[valid]).query(points[~valid])[1]]  # the nearest, also across the seam
    size = size[np.argsort(lat)][:, np.argsort(lon)]
    return SizeField(np.sort(lon), np.sort(lat), size, Path(path).name)


def _error_variable(ds: xr.Dataset, pattern: re.Pattern[str]) -> str:
    """Return the variable of the error of a component; empty if there is none."""
    for name in map(str, ds.data_vars):
        standard = str(ds[name].attrs.get("standard_name", ""))
        bare = _ERROR.sub("_", name.lower()).strip("_")
        if (bare != name.lower() and pattern.match(bare)) or ("standard_error" in standard and pattern.match(standard)):
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
        options = [f"current_error.speed={self.speed:.2g} m/s", f"current_error.length={self.length / 1e3:.2g} km"]
        return options + ([f"current_error.time={self.time / 86400.0:.2g} day"] if np.isfinite(self.time) else [])


def estimate_errors(
    first: str | Path | Sequence[str], second: str | Path | Sequence[str], *,
    longitude: tuple[float, float] | None = None, latitude: tuple[float, float] | None = None,
) -> Estimate:  # fmt: skip
    """Estimate the errors of the current from the differences of two products.

    Parameters
    ----------
    first, second : path, or sequence of them
        Files of two products of the same days and area, on axes of longitude and latitude.
    longitude, latitude : pair of float, optional
        Box, degrees; by default the area that both cover.

    Returns
    -------
    Estimate
        The standard deviation is the difference over the root of two: the error of either product if both err alike and
        independently. The error that they share is not in it, so it is a lower bound.

    Raises
    ------
    InputError
        If the products do not overlap, or have no current on such axes.
    """
    from riftberg.products.mesh import longitudes_near

    coarse, fine = (_currents(path) for path in (first, second))
    if _spacing(coarse) < _spacing(fine):
        coarse, fine = fine, coarse  # on the points of the coarser one
    # Both on the branch of the box, or of the narrower one, for they may stand on either side of 180.
    west, east = longitude or min(((float(ds["lon"][0]), float(ds["lon"][-1])) for ds in (coarse, fine)), key=np.ptp)
    east = east if east >= west else east + 360.0
    coarse, fine = (longitudes_near(ds, west, east) for ds in (coarse, fine))
    for axis, limits in (("lon", longitude and (west, east)), ("lat", latitude)):
        low, high = (f(float(coarse[axis][k]), float(fine[axis][k])) for f, k in ((max, 0), (min, -1)))
        low, high = (low, high) if limits is None else (max(low, limits[0]), min(high, limits[1]))
        coarse = coarse.sel({axis: slice(low, high)})
    first_date, last_date = (f(coarse["time"].values[k], fine["time"].values[k]) for f, k in ((max, 0), (min, -1)))
    coarse = coarse.sel(time=slice(first_date, last_date))
    if min(coarse.sizes[axis] for axis in ("lon", "lat")) < 4 or not coarse.sizes["time"]:
        raise InputError(
            "the products do not share four by four points and a date", where=f"{first}, {second}",
            remedy="Give files of the same days and area, or a larger box",
        )  # fmt: skip
    sampled = fine.interp(lon=coarse["lon"], lat=coarse["lat"])
    sampled = sampled.interp(time=coarse["time"]) if fine.sizes["time"] > 1 else sampled.isel(time=[0])
    errors = [np.asarray(coarse[name].values - sampled[name].values, float) / np.sqrt(2.0) for name in ("uo", "vo")]
    speed = float(np.sqrt(np.nanmean([np.nanmean(a**2) for a in errors])))
    if not speed > 1e-6:  # m s-1; what interpolation leaves is smaller
        raise InputError("the products do not differ", where=f"{first}, {second}", remedy="Give two products")
    days = (coarse["time"].values - coarse["time"].values[0]) / np.timedelta64(1, "s")
    return Estimate(
        speed, _length(errors, coarse), _time(errors, days), coarse.sizes["lon"] * coarse.sizes["lat"], days.size
    )


def _currents(path: Any) -> xr.Dataset:
    """Return the current of a product at its uppermost level, on rising axes, over the length of the file."""
    from riftberg.products.levels import uppermost
    from riftberg.products.registry import open_all

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


def _length(errors: Sequence[Floats], ds: xr.Dataset) -> float:
    """Return L from the correlation of each component along its own direction: exp(-r2 / 2 L2) of a stream function."""
    lat = np.asarray(ds["lat"].values, float)
    across = DEGREE * EARTH_RADIUS_A68 * _spacing(ds)
    along = DEGREE * EARTH_RADIUS_A68 * float(np.median(np.diff(ds["lon"].values))) * float(np.cos(lat.mean() * DEGREE))
    r, rho, pairs = [], [], []
    for values, axis, step in ((errors[0], -1, along), (errors[1], -2, across)):
        for lag, correlation, count in _correlations(values, axis):
            r.append(lag * step)
            rho.append(correlation)
            pairs.append(count)
    return float(_fitted(lambda x, scale: np.exp(-0.5 * (x / scale) ** 2), r, rho, pairs, start=2.0 * along))


def _time(errors: Sequence[Floats], seconds: Floats) -> float:
    """Return T from the correlation in time: exp(-t / T)."""
    if seconds.size < 3:
        return float("nan")
    step = float(np.median(np.diff(seconds)))
    correlations = [row for values in errors for row in _correlations(values, 0)]
    r, rho, pairs = ([row[k] * (step if k == 0 else 1.0) for row in correlations] for k in range(3))
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
