"""Forcing along a track: a series in time that is the same everywhere, such as values that another program or a station gives.

A series is linear between its times, or holds the mean of each interval. A slope of the sea surface that is not given balances
the current of the series, averaged like a current from files (`riftberg.ocean.balance`), with f of each element.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, Sequence
from datetime import date, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypedDict, Unpack

import numpy as np

from riftberg.config.units import count_text, minute_text
from riftberg.config.values import check_names, duration, moment, native, numbers
from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError, InputError, nearest
from riftberg.ocean.balance import (
    balancing_slope,
    checked_wind_layer,
    decided,
    layer_text,
    slow_current_weights,
    wind_drift,
)
from riftberg.ocean.formulas import SUMMED, Formula
from riftberg.ocean.needs import DEPTH, OVER_DRAFT, SeaLevel
from riftberg.products.quantities import QUANTITIES
from riftberg.products.records import GAP_FACTOR
from riftberg.state import Elements, Floats
from riftberg.system.input_files import read_csv_rows, value_shown

VALUES: Final = ("uo", "vo", "ua", "va", "ice_fraction", "ice_thickness", "ui", "vi", "wave_height", "sst", "sss")
"""What a series gives by time, named and measured as in `riftberg.products.quantities`."""

SLOPES: Final = ("ssh_slope_x", "ssh_slope_y")
"""Columns of a given slope of the sea surface, to the east and north."""

PAIRS: Final = (("uo", "vo"), ("ua", "va"), ("ui", "vi"))
"""Components that one does not come without the other."""

DEPTH_IS_ONE_NUMBER: Final = "the depth of a series is one number, that at the start; a varying one is refused"

STEEPEST: Final = 0.01
"""Slope of the sea surface that no sea has."""

JUMP: Final = 1e-3
"""Time (s) in which a series of means goes from one interval to the next."""

FINE: Final = 3600.0
"""Interval (s) at which the current is taken for the means that the sea surface balances."""

TOLERANCE: Final = 60.0
"""Seconds by which a run may begin before a series or end after it: dates of programs are a few off the full minute."""

_ZONE: Final = re.compile(r"\d(?:\s*T\s*|\s+)[\d:.,]+\s*([+-]\d\d(?::?\d\d)?)$", re.IGNORECASE)
"""A time of day with its distance from UTC."""


class SeriesOptions(TypedDict, total=False):
    """Options of a series, as `Series` documents them."""

    ua: Any
    va: Any
    depth: Any
    ice_fraction: Any
    ice_thickness: Any
    ui: Any
    vi: Any
    wave_height: Any
    sst: Any
    sss: Any
    ssh_slope: Any
    hold: Any
    max_gap: Any
    wind_layer: Any
    latitude: float | None


class Series(Formula):
    """A series in time, uniform in space; `Forcing.along` makes it.

    Parameters
    ----------
    times : sequence of date or float
        Dates (UTC; datetime64, datetime or text), or seconds since the start of the run, rising.
    uo, vo : float or array_like
        Eastward and northward current, m s-1: a number, or one at each time; NaN at the end is no more.
    ua, va : float or array_like, optional
        Wind at 10 m, m s-1.
    depth : float, optional
        Depth of water at the start, m: one number, for a depth along another track is none of this berg's.
    ice_fraction, ice_thickness, ui, vi : float or array_like, optional
        Sea ice: the part of the sea that it covers, its thickness (m) and its velocity (m s-1).
    wave_height : float or array_like, optional
        Significant height of waves that go with the wind, m.
    sst, sss : float or array_like, optional
        Temperature (degrees Celsius) and salinity (1e-3) of the sea.
    ssh_slope : pair of float or array_like, optional
        Slope of the sea surface to the east and north.
    means : bool, optional
        A value is the mean over the interval that ends at its time (the first one: at its time), constant within; otherwise
        values are linear between their times.
    sea_level : str, optional
        ``"files"``: the slope that is given. ``"geostrophic"``: that which balances the current. ``"none"``: no slope.
        ``"auto"``: that which is given, else that which balances the current, with a notice.
    start : date, optional
        Date of the model's time 0 (UTC); by default the first of the times, if these are dates.
    hold : float or str, optional
        How long the first and last value are held (s, or text with a unit: ``"6 h"``).
    max_gap : float or str, optional
        Longest time between two values that is interpolated across, else 2.5 usual ones; means have none.
    wind_layer : float, optional
        Share of the wind that is taken out of the current and its slope, as for `riftberg.ocean.datasets.DatasetForcing`.
    latitude : float, optional
        Latitude (degrees) of the Coriolis parameter on an f-plane; by default the latitude of each element.

    Raises
    ------
    ForcingError
        If times do not rise or have a time zone, a value is missing between others or not possible, or the depth varies.
    """

    def __init__(
        self, times: Any, *, uo: Any, vo: Any, means: bool = False, sea_level: SeaLevel = "auto",
        start: datetime | date | str | np.datetime64 | None = None, **options: Unpack[SeriesOptions],
    ) -> None:  # fmt: skip
        check_names(options, SeriesOptions)
        self.latlon, self.latitude, self.means = True, options.get("latitude"), means
        if self.latitude is not None and not abs(self.latitude) <= 90.0:
            raise ForcingError(
                f"{value_shown(self.latitude)} is no latitude", where="latitude", remedy="Give -90 to 90"
            )
        seconds, self.start = _as_seconds(times, start)
        slope, depth, max_gap = options.get("ssh_slope"), options.get("depth"), options.get("max_gap")
        every: dict[str, Any] = {"uo": uo, "vo": vo, **options}
        given = {name: every[name] for name in VALUES if every.get(name) is not None}
        for eastward, northward in PAIRS:
            if (eastward in given) != (northward in given):
                present, absent = (eastward, northward) if eastward in given else (northward, eastward)
                raise ForcingError(f"{present} without {absent}", where="Forcing.along", remedy="Give both components")
        choice = decided(
            sea_level, {"uo", *(() if slope is None else ("ssh",))}, where="sea_level",
            level_wanted="Give ssh_slope, or leave sea_level out: then the slope balances the current",
            currents_wanted="Give uo and vo",
        )  # fmt: skip
        self.assumes_slope = sea_level == "auto" and choice == "geostrophic"
        self.wind_layer = checked_wind_layer(options.get("wind_layer", 0.0))
        if self.wind_layer and "ua" not in given:
            raise ForcingError(
                "a share of the wind is taken out of the current, and the series has none", where="wind_layer",
                remedy="Give ua and va, or leave wind_layer out",
            )  # fmt: skip
        columns = {name: _column(name, value, *_believable(name), seconds.size) for name, value in given.items()}
        if choice == "files":
            for name, value in zip(SLOPES, _slope_pair(slope), strict=True):
                columns[name] = _column(name, value, "1", (-STEEPEST, STEEPEST), seconds.size)
        self._water = np.array([np.inf if depth is None else _single_depth(depth)])
        self._times, self.times = seconds, seconds
        length = min(self._last_known(name, values) for name, values in columns.items())
        hold = duration(options.get("hold", 0.0), where="hold", kind=ForcingError)
        self.cover = float(seconds[0]) - hold, float(seconds[length]) + hold
        step = float(np.median(np.diff(seconds))) if seconds.size > 1 else np.inf
        limit = GAP_FACTOR * step if max_gap is None else duration(max_gap, where="max_gap", kind=ForcingError)
        gaps = [] if means else np.flatnonzero(np.diff(seconds[: length + 1]) > limit).tolist()
        self._gaps = [(float(seconds[k]), float(seconds[k + 1])) for k in gaps]
        self._times, self._values = _nodes(
            seconds[: length + 1], {k: v[: length + 1] for k, v in columns.items()}, means
        )
        if choice == "geostrophic":
            self._add_slow_current(means or step < SECONDS_PER_DAY)
        self.provides = frozenset({*given, *(("depth",) if np.isfinite(self._water[0]) else ())} | (
            set() if choice == "none" else {"slope_x", "slope_y"}
        ))  # fmt: skip
        self.ice_drift_known = not {"ice_thickness", "ice_fraction"} & self.provides or "ui" in self.provides
        near_surface = (
            "the current of a series counts as that of the whole draft; near the surface it holds wind drift, "
        )
        near_surface += "without a slope"
        self.slope_remarks = (layer_text(self.wind_layer) if self.wind_layer else near_surface,)

    def _last_known(self, name: str, values: Floats) -> int:
        """Return the number of the last time at which a value is given; refuse one that is missing before."""
        is_given = np.isfinite(values)
        if not is_given.any():
            raise ForcingError(f"{name} has no value", where="Forcing.along", remedy="Give numbers, or leave it out")
        last = int(np.flatnonzero(is_given)[-1])
        if not is_given[: last + 1].all():
            gap = int(np.flatnonzero(~is_given)[0])
            raise ForcingError(
                f"{name} is missing at {self._when(float(self.times[gap]))}, and given later", where="Forcing.along",
                remedy="Give the value, or leave the time out: values are linear across it. Missing at the end means no more",
            )  # fmt: skip
        return last

    def _add_slow_current(self, averaged: bool) -> None:
        """Keep the current that the sea surface balances: its mean over 25 hours, twice, or the current itself."""
        slowed = ("uo", "vo", "ua", "va") if self.wind_layer else ("uo", "vo")
        at, slow = self._times, {name: self._values[name][0] for name in slowed}
        slow_times = at
        if averaged and at[-1] - at[0] > FINE:
            fine, numbers, weights = _slow_weights(float(at[0]), float(at[-1]))
            slow_times, slow = (
                fine[numbers],
                {name: weights @ np.interp(fine, at, values) for name, values in slow.items()},
            )
        self._times = np.union1d(at, slow_times)
        self._values = {
            **{name: np.interp(self._times, at, values[0])[None] for name, values in self._values.items()},
            **{f"slow_{name}": np.interp(self._times, slow_times, values)[None] for name, values in slow.items()},
        }

    @classmethod
    def side_by_side(cls, series: Sequence[Series]) -> Series:
        """Return several series as one: element 1 has the first one, element 2 the second, and so on.

        A series is the same everywhere, so that a berg may be put anywhere on its parallel. The floor varies with longitude: each
        series has a sector of its own, the first from 180 W, as many as there are series.
        """
        joined = copy.copy(series[0])
        missing = {
            name for member in series for name in member._values if any(name not in other._values for other in series)
        }
        if missing:
            raise ForcingError(
                f"{min(missing)} is given by some series alone", where="Forcing.along", remedy="Give it to all of them"
            )
        joined._times = np.unique(np.concatenate([member._times for member in series]))
        joined._values = {
            name: np.stack([np.interp(joined._times, member._times, member._values[name][0]) for member in series])
            for name in series[0]._values
        }
        joined._water = np.array([member._water[0] for member in series])
        joined.cover, joined._gaps = (-np.inf, np.inf), []
        return joined

    def without_assumed_slope(self) -> Series:
        """Return the same series without a slope of the sea surface that was not asked for: a sum has another one."""
        other = copy.copy(self)
        other.assumes_slope, other.provides = False, self.provides - {"slope_x", "slope_y"}
        other._values = {name: values for name, values in self._values.items() if not name.startswith("slow_")}
        return other

    def add_to(self, elements: Elements, time: float) -> None:
        """Add current, wind, ice and slope; depth, waves and water as far as the series gives them."""
        e, lat = elements.environment, elements.place.lat
        row = 0 if self._water.size == 1 else elements.body.id - 1
        at = {name: value[row] for name, value in self._now(time).items()}
        for name in SUMMED:
            if name in at:
                getattr(e, name)[:] += at[name]
        balance_lat = lat if self.latitude is None else np.full(lat.shape, self.latitude)
        if self.wind_layer:
            drift = wind_drift(balance_lat, at["ua"], at["va"], self.wind_layer)
            e.uo[:] -= drift[0]
            e.vo[:] -= drift[1]
        if "slow_uo" in at:
            u, v = at["slow_uo"], at["slow_vo"]
            if self.wind_layer:
                drift = wind_drift(balance_lat, at["slow_ua"], at["slow_va"], self.wind_layer)
                u, v = u - drift[0], v - drift[1]
            slopes = balancing_slope(balance_lat, u, v)
        else:
            slopes = tuple(at.get(name, 0.0) for name in SLOPES)  # type: ignore[assignment]
        e.slope_x[:] += slopes[0]
        e.slope_y[:] += slopes[1]
        np.minimum(e.depth, self._water[row], out=e.depth)
        if "ice_fraction" in at:
            np.maximum(e.ice_fraction, at["ice_fraction"], out=e.ice_fraction)
        if "wave_height" in at:
            e.wave_height[:], e.wave_x[:], e.wave_y[:], e.wave_period[:] = at["wave_height"], e.ua, e.va, 0.0
        for name in OVER_DRAFT.keys() & at.keys():
            getattr(e, name)[:] = at[name]
            getattr(e, OVER_DRAFT[name])[:] = np.nan  # the value at the surface counts, whatever another term has set

    def _now(self, time: float) -> dict[str, Floats]:
        """Return the values at a time by name, one for each row; beyond the ends the end values."""
        k = int(np.clip(np.searchsorted(self._times, time), 1, self._times.size - 1))
        time_before = self._times[k - 1]
        weight = min(max((time - time_before) / (self._times[k] - time_before), 0.0), 1.0)
        return {name: v[:, k - 1] * (1.0 - weight) + v[:, k] * weight for name, v in self._values.items()}

    def current_series(self, times: Floats) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at times (s)."""
        u, v = (np.interp(times, self._times, self._values[name][0]) for name in ("uo", "vo"))
        return u, v

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `ForcingError` unless the series has values from ``start`` to ``end`` (s), and no gap too long between."""
        first, last = self.cover
        if start < first - TOLERANCE or end > last + TOLERANCE:
            beyond = self._when(start if start < first - TOLERANCE else end)
            raise ForcingError(
                f"{beyond} lies outside the series, which goes from {self._when(first)} to {self._when(last)}",
                where="Forcing.along", remedy="Run within it, give more of it, or hold its ends longer: hold",
            )  # fmt: skip
        for gap_start, gap_end in self._gaps:
            if gap_start < end and gap_end > start:
                days = (gap_end - gap_start) / SECONDS_PER_DAY
                raise ForcingError(
                    f"no value between {self._when(gap_start)} and {self._when(gap_end)}: a gap of {days:.3g} days",
                    where="Forcing.along", remedy="Give the missing times, or allow a longer gap: max_gap",
                )  # fmt: skip

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the current (m s-1) at arrays of points."""
        values, shape = self._now(time), np.shape(lon)
        return np.full(shape, values["uo"][0]), np.full(shape, values["vo"][0])

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) at arrays of points."""
        sector = np.floor((np.asarray(lon, float) + 180.0) % 360.0 * (self._water.size / 360.0)).astype(int)
        return np.asarray(self._water[np.minimum(sector, self._water.size - 1)])

    def land(self, lon: Floats, lat: Floats) -> Any:
        """Return that no point is land."""
        return np.zeros(np.shape(lon), bool)

    def describe(self) -> str:
        """Return the fields of the series and its dates in words."""
        first, last = (self._when(float(self.times[k])) for k in (0, -1))
        names = ", ".join(name for name in VALUES if name in self.provides)
        lines = [
            f"series at {count_text(self.times.size, 'time')} from {first} to {last}, uniform in space: {names}"
            + (", means over the intervals" if self.means else "")
        ]
        if np.isfinite(self._water[0]):
            lines.append(f"depth {self._water[0]:g} m everywhere, that at the start")
        if self.wind_layer:
            lines.append(layer_text(self.wind_layer))
        if "slow_uo" in self._values:
            why = ", for no sea level is given" if self.assumes_slope else ""
            lines.append(
                f"slope of the sea surface: in geostrophic balance with the mean current over 25 hours, taken twice{why}"
            )
        return "\n".join(lines)

    def _when(self, seconds: float) -> str:
        if self.start is None:
            return f"{seconds / 3600.0:g} h"
        return minute_text((self.start + timedelta(seconds=round(seconds))).isoformat())


def read_series(path: str | Path, **options: Any) -> Series:
    """Return the series of a table.

    Parameters
    ----------
    path : path
        CSV with a column ``time`` (dates in UTC, or seconds since the start) and columns named as the arguments of `Series`;
        ``ssh_slope_x`` and ``ssh_slope_y`` are a slope. Empty cells at the end mean no more; ``lon`` and ``lat`` are not read.
    **options
        As for `Series`.

    Raises
    ------
    ForcingError
        If a column is not known, or a cell holds no number.
    """
    rows, separator = read_csv_rows(Path(path), ForcingError)
    return make_series(list(enumerate(rows, start=2)), separator, path, **options)


def make_series(
    rows: Sequence[tuple[int, Mapping[str, str]]], separator: str, path: str | Path, **options: Any
) -> Series:
    """Return the series of some rows of a table, each with its line; the columns berg and start say whose they are."""
    names = {(name or "").strip().lower(): name for name in rows[0][1] if name is not None}
    columns = ("time", *VALUES, "depth", *SLOPES)
    missing = next((name for name in ("time", "uo", "vo") if name not in names), None)
    strange = next((name for name in names if name not in (*columns, "lon", "lat", "berg", "start")), None)
    if missing or strange:
        raise ForcingError(
            f"no column {missing!r}" if missing else f"a column {strange!r}", where=str(path),
            remedy=f"{'' if missing else nearest(str(strange), columns)}Columns are {', '.join(columns)}",
        )  # fmt: skip
    values: dict[str, Any] = {
        name: _column_numbers([row[names[name]] for _, row in rows], separator, path, name, rows[0][0])
        for name in columns[1:] if name in names
    }  # fmt: skip
    slopes = [values.pop(name) for name in SLOPES if name in values]
    if slopes:
        values["ssh_slope"] = tuple(slopes)
    try:
        return Series(_plain_times([(row[names["time"]] or "").strip() for _, row in rows]), **{**values, **options})
    except InputError as error:
        raise ForcingError(error.what, where=f"{path}, {error.where}", remedy=error.remedy) from error


def _plain_times(texts: list[str]) -> list[Any]:
    try:
        return [float(text) for text in texts]
    except ValueError:
        return list(texts)


def _column_numbers(texts: Sequence[str | None], separator: str, path: str | Path, name: str, line: int) -> Floats:
    """Return a column as numbers, NaN where a cell is empty; ``line``: of the first one."""
    values = np.full(len(texts), np.nan)
    for k, text in enumerate(texts):
        cell = (text or "").strip()
        try:
            if cell:
                values[k] = float(cell if separator == "," else cell.replace(",", "."))
        except ValueError as error:
            raise ForcingError(
                f"{value_shown(cell)} is no number", where=f"{path}, line {line + k}, {name}",
                remedy="Give a number, or leave the cell empty",
            ) from error  # fmt: skip
    return values


def _as_seconds(times: Any, start: Any) -> tuple[Floats, datetime | None]:
    """Return times in seconds since the start, and its date where it is known."""
    listed = np.asarray(times)
    listed = np.atleast_1d(listed) if listed.dtype.kind in "fiuM" else np.array(list(np.ravel(times)), object)
    if listed.ndim != 1 or listed.size == 0:
        raise ForcingError(
            f"{value_shown(times)} are no times", where="times", remedy="Give a list of dates or seconds"
        )
    begin = None if start is None else moment(start, where="start")
    dated = listed.dtype.kind == "M"
    dates: Any
    if not dated and all(isinstance(native(value), int | float) for value in listed.tolist()):
        dates = seconds = listed.astype(np.float64)
    else:
        dates = np.array(listed if dated else [_utc(value) for value in listed.tolist()], "datetime64[us]")
        if np.isnat(dates).any():
            raise ForcingError("a time is missing", where="times", remedy="Give a date to each value")
        begin = begin or dates[0].item()
        seconds = (dates - np.datetime64(begin)) / np.timedelta64(1, "s")
    if not np.isfinite(seconds).all():
        raise ForcingError("a time is no number", where="times", remedy="Give a time to each value")
    wrong = np.flatnonzero(np.diff(seconds) <= 0.0)
    if wrong.size:
        k = int(wrong[0])
        fault = "stands twice" if dates[k] == dates[k + 1] else f"comes after {dates[k]}"
        raise ForcingError(f"{dates[k + 1]} {fault}", where="times", remedy="Sort the times, each given once")
    return seconds, begin


def _utc(value: Any) -> datetime:
    """Return a date in UTC; one of another time zone is refused, for a table of them is easily read a few hours off."""
    plain = native(value)
    zone = _ZONE.search(plain) if isinstance(plain, str) else None
    offset = getattr(plain, "utcoffset", lambda: None)() if not isinstance(plain, str) else None
    if (zone is not None and zone[1].strip("+-0:")) or offset:
        raise ForcingError(f"{value_shown(str(plain))} has another time zone than UTC", where="times",
                           remedy="Give the times in UTC, without a zone")  # fmt: skip
    try:
        return moment(value, where="times")
    except InputError as error:
        raise ForcingError(error.what, where=error.where, remedy=error.remedy) from error


def _believable(name: str) -> tuple[str, tuple[float, float]]:
    quantity = QUANTITIES[name]
    return ("degC" if name == "sst" else "1" if name == "sss" else quantity.units), quantity.range


def _column(name: str, value: Any, unit: str, limits: tuple[float, float], count: int) -> Floats:
    """Return the values of a name at all times, within believable limits."""
    values = numbers(value, unit, where=name, kind=ForcingError)
    if values.ndim and values.shape != (count,):
        raise ForcingError(
            f"{name} has the shape {values.shape} for {count_text(count, 'time')}", where=name,
            remedy="Give a number, or one for each time",
        )  # fmt: skip
    low, high = limits
    beyond = values[(values < low) | (values > high)]
    if beyond.size:
        raise ForcingError(
            f"{name} = {beyond[0]:g} is not possible", where=name, remedy=f"Give {low:g} to {high:g} ({unit})"
        )
    return np.array(np.broadcast_to(values, count))


def _slope_pair(pair: Any) -> tuple[Any, Any]:
    if not isinstance(pair, Sequence | np.ndarray) or len(pair) != 2:
        raise ForcingError(
            f"{value_shown(pair)} is no pair", where="ssh_slope", remedy="Give the slopes to the east and to the north"
        )
    return pair[0], pair[1]


def _single_depth(depth: Any) -> Any:
    """Return the depth (m), which is one number."""
    values = numbers(depth, "m", where="depth", kind=ForcingError)
    finite = values[np.isfinite(values)]
    if finite.size and not np.ptp(finite) == 0.0:
        raise ForcingError(DEPTH_IS_ONE_NUMBER, where="depth", remedy=f"Give {finite.flat[0]:g}, that at the start")
    if not finite.size or not 0.0 < finite.flat[0] <= 1e5:
        raise ForcingError(
            f"depth = {values.flat[0]:g} is not possible", where="depth", remedy="Give 0 to 100000 m, or leave it out"
        )
    return np.inf if finite.flat[0] >= DEPTH.default else float(finite.flat[0])


def _nodes(seconds: Floats, columns: Mapping[str, Floats], means: bool) -> tuple[Floats, dict[str, Floats]]:
    """Return times between which values are linear, at least two, and the values there, one row each."""
    if seconds.size == 1:
        seconds, columns = np.append(seconds, seconds + 1.0), {name: v.repeat(2) for name, v in columns.items()}
    elif means:  # the next mean begins at the end of the one before: steps take the value at their begin
        seconds = np.concatenate([seconds[:1], seconds[:1] + JUMP,
                                  np.column_stack([seconds[1:-1] - JUMP, seconds[1:-1]]).ravel(), seconds[-1:]])  # fmt: skip
        columns = {name: np.append(v[0], v[1:].repeat(2)) for name, v in columns.items()}
    return seconds, {name: v[None] for name, v in columns.items()}


@lru_cache(maxsize=64)
def _slow_weights(first: float, last: float) -> tuple[Floats, list[int], Floats]:
    """Return fine times, at which of them the slow current is taken, and the weights of all of them in each."""
    fine = np.linspace(first, last, int(np.ceil((last - first) / FINE)) + 1)
    numbers, shares = slow_current_weights(fine)
    weights = np.zeros((len(numbers), fine.size))
    for k, share in enumerate(shares):
        weights[k, share.first : share.first + share.weights.size] = share.weights
    return fine, numbers, weights
