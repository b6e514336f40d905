"""Records of a data product as the elements need them: read when asked for, in blocks, converted once, never changed."""

from __future__ import annotations

from bisect import bisect_right
from datetime import datetime
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.config.units import place_text
from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.ocean.at_elements import SURFACE, Blend
from riftberg.ocean.forcing import SharedLock
from riftberg.ocean.grid import wind_from_stress
from riftberg.products.levels import layer_limits
from riftberg.products.quantities import QUANTITIES, unlikely
from riftberg.products.records import (
    MAY_BE_EMPTY,
    Gap,
    cover_of,
    gap_error,
    gap_limit,
    minute,
    named,
    outside_remedy,
    values_of,
)
from riftberg.products.repair import VALID
from riftberg.products.window import utc
from riftberg.state import Floats

BLOCK_BYTES: Final = 64e6
"""Fields that are read at once, about: a record by itself would unpack a whole chunk of the file."""

MOST_RECORDS: Final = 48
"""Records that are read at once at most."""

KEPT_BLOCKS: Final = 2
"""Blocks in memory: two neighbouring records may lie in two of them."""

PLANES: Final = (("lat", "lon"), ("y", "x"), ("node",))
"""Horizontal dimensions of a canonical dataset."""

TIME_TOLERANCE: Final = 1e-6
"""Times this close (s) outside the records count as inside, for round-off in sums of time steps."""

Block = dict[str, Floats]


class Between(NamedTuple):
    """Two records around a time, and the weight of the second."""

    before: int
    after: int
    weight: float


class ProductRecords:
    """Fields of one canonical dataset in time, on its own points down to the deepest draft ``keel`` (m)."""

    def __init__(self, ds: xr.Dataset, start: datetime, *, keel: float = np.inf) -> None:
        for name, field in ds.data_vars.items():  # what a dimension beside time, depth and the plane means is not known
            beyond = set(map(str, field.dims)) - {"time", "depth", *plane_dims(field)}
            if beyond or not plane_dims(field):
                raise ForcingError(
                    f"{name} has the dimensions ({', '.join(map(str, field.dims))})",
                    where=named(ds) or "forcing",
                    remedy="Give fields on (time, depth, lat, lon); choose one entry of any other dimension",
                )
        self.ds, self._limits = ds, SURFACE
        if "depth" in ds.dims:  # down to the keel
            limits = layer_limits(ds["depth"].values)
            layers = int(np.clip(np.searchsorted(limits, keel, side="left"), 1, limits.size - 1))
            self.ds, self._limits = ds.isel(depth=slice(0, layers)), limits[: layers + 1]
        self.start = start
        self.dates: NDArray[np.datetime64] = (
            ds["time"].values.astype("datetime64[ns]") if "time" in ds.dims else np.empty(0, "datetime64[ns]")
        )
        self.times = [float(t) for t in _seconds(self.dates, start)]
        self.names = _as_they_act(tuple(map(str, ds.data_vars)))
        self._length = records_at_once(
            sum(field.size for field in ds.data_vars.values()) / max(1, ds.sizes.get("time", 1))
        )
        self._blocks: dict[int, Block] = {}
        self._lock = SharedLock()

    @property
    def cover(self) -> tuple[float, float]:
        """First and last time covered, s since the start; infinite for fields without time."""
        if not self.times:
            return -np.inf, np.inf
        own = _seconds(self.ds["time"].values[[0, -1]], self.start)
        before, after = np.abs(_seconds(np.array(cover_of(self.ds)), self.start) - own)
        return self.times[0] - float(before), self.times[-1] + float(after)

    @property
    def limits(self) -> Floats:
        """Limits (m) of the layers of the levels; two for fields without levels."""
        return self._limits

    @property
    def has_levels(self) -> bool:
        """Whether there are currents on more than one level."""
        return self.on_levels("uo") or self.on_levels("vo")

    def on_levels(self, name: str) -> bool:
        """Whether a field is on more than one level."""
        return self._limits.size > 2 and name in self.ds and "depth" in self.ds[name].dims

    def moment(self, name: str, time: float) -> Blend:
        """Return a field at a time."""
        around = self._between(time)
        before = self._record(around.before)[name]
        after = self._record(around.after)[name] if around.weight > 0.0 else before
        limits = self._limits if before.shape[0] > 1 else SURFACE
        return Blend(before, after, around.weight, limits, 0.0 if name in MAY_BE_EMPTY else np.nan)

    def check(self, start: float, end: float) -> None:
        """Read all records from ``start`` to ``end`` (s)."""
        first, last = self._between(start), self._between(end)
        for record in range(first.before, last.after + 1):
            if record < last.after:
                self._check_gap(record, max(start, self.times[record]))
            self._record(record)

    def _between(self, time: float) -> Between:
        if len(self.times) < 2:
            self._require_cover(time)
            return Between(0, 0, 0.0)
        self._require_cover(time)
        k = bisect_right(self.times, time) - 1
        if k < 0 or k >= len(self.times) - 1:
            k = max(k, 0)
            return Between(k, k, 0.0)
        self._check_gap(k, time)
        weight = (time - self.times[k]) / (self.times[k + 1] - self.times[k])
        return Between(k, k + 1 if weight > 0.0 else k, weight)

    def _require_cover(self, time: float) -> None:
        first, last = self.cover
        if first - TIME_TOLERANCE <= time <= last + TIME_TOLERANCE:
            return
        raise ForcingError(
            f"{minute(self._date(time))} lies outside the records {minute(self.dates[0])}..{minute(self.dates[-1])}",
            where=named(self.ds),
            remedy=outside_remedy(self.ds),
        )

    def _check_gap(self, record: int, time: float) -> None:
        gap = Gap(self.dates[record], self.dates[record + 1])
        limit = gap_limit(self.ds)
        if gap.seconds > limit and self.times[record] < time < self.times[record + 1]:
            raise gap_error(self.ds, gap, limit, self._date(time))

    def _date(self, time: float) -> np.datetime64:
        return utc(self.start) + np.timedelta64(round(time), "s")

    def _record(self, number: int) -> Block:
        first = number // self._length * self._length
        block = self._blocks.get(first)
        if block is None:
            with self._lock:  # another thread may have read it meanwhile
                block = self._blocks.get(first) or self._read(slice(first, first + self._length))
                # The dictionary is replaced, never changed: other threads look into it without the lock.
                spared = sorted(self._blocks, key=lambda old: abs(old - first))[: KEPT_BLOCKS - 1]
                self._blocks = {**{old: self._blocks[old] for old in spared}, first: block}
        # A field without time beside others has one record.
        return {name: values[number - first if len(values) > 1 else 0] for name, values in block.items()}

    def _read(self, records: slice) -> Block:
        """Read some records; refuse those without a value, and values that cannot be true."""
        part = self.ds.isel(time=records) if self.times else self.ds
        block = {str(name): as_block(field, named(self.ds)) for name, field in part.data_vars.items()}
        for name, values in block.items():
            check_not_empty(name, values, self.ds, self.dates[records])
            check_believable(name, values, part, self.dates[records])
        if "taux" in block and "tauy" in block and "ua" not in block:
            block["ua"], block["va"] = wind_from_stress(block.pop("taux"), block.pop("tauy"))
        if "wave_direction" in block:  # from where they come; its parts can be interpolated, degrees cannot
            angle = np.deg2rad(block.pop("wave_direction"))
            block["wave_x"], block["wave_y"] = -np.sin(angle), -np.cos(angle)
        if "depth_below_surface" in block:  # land counts as depth 0, so that shores shoal
            block["depth_below_surface"] = np.nan_to_num(block["depth_below_surface"])
        return block


class DayMeans(ProductRecords):
    """Currents of other records as running means over a day, which shift inwards at the ends of a series.

    Inertial motion, tides and gusts are faster: they have no slope of the sea surface in geostrophic balance.
    """

    def __init__(self, of: ProductRecords) -> None:
        super().__init__(of.ds[["uo", "vo"]], of.start)
        self._of, self._limits, self.dates, self.times, self._length = of, of.limits, of.dates, of.times, of._length

    def _read(self, records: slice) -> Block:
        numbers = range(*records.indices(len(self.times))) if self.times else range(1)
        means = [self._mean(number) for number in numbers]
        return {name: np.stack([mean[name] for mean in means]) for name in self.names}

    def _mean(self, number: int) -> Block:
        """Return the mean over a day around a record, of currents that change linearly from record to record."""
        times = np.asarray(self.times)
        if times.size < 2 or np.median(np.diff(times)) >= SECONDS_PER_DAY:
            return self._of._record(number)
        first = min(max(times[number] - 0.5 * SECONDS_PER_DAY, times[0]), max(times[-1] - SECONDS_PER_DAY, times[0]))
        weights = _weights_over(times, float(first), float(min(first + SECONDS_PER_DAY, times[-1])))
        near = {int(k): self._of._record(int(k)) for k in np.flatnonzero(weights)}
        mean = {}
        for name in self.names:
            known = sum(weights[k] * np.isfinite(block[name]) for k, block in near.items())
            total = sum(weights[k] * np.nan_to_num(block[name]) for k, block in near.items())
            with np.errstate(invalid="ignore"):
                mean[name] = np.asarray(total / np.where(known, known, np.nan))
        return mean

    def _check_gap(self, record: int, time: float) -> None:
        self._of._check_gap(record, time)


def _weights_over(times: Floats, first: float, last: float) -> Floats:
    """Return the weights of records in the integral from ``first`` to ``last`` (s) of a series that is linear between them."""
    begins, ends = times[:-1], times[1:]
    low, high = np.maximum(begins, first), np.minimum(ends, last)
    length, share = np.maximum(high - low, 0.0), (0.5 * (low + high) - begins) / (ends - begins)
    weights = np.zeros(times.size)
    weights[:-1] += length * (1.0 - share)
    weights[1:] += length * share
    return weights


def records_at_once(values: float) -> int:
    """Return how many records of so many values are read at once."""
    return int(np.clip(BLOCK_BYTES / (8 * max(values, 1)), 1, MOST_RECORDS))


def _as_they_act(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of fields; wind stress becomes wind, the direction of waves its two parts."""
    if "wave_direction" in names:
        names = (*(name for name in names if name != "wave_direction"), "wave_x", "wave_y")
    if not {"taux", "tauy"} <= set(names):
        return names
    others = tuple(name for name in names if name not in ("taux", "tauy"))
    return others if "ua" in others else (*others, "ua", "va")


def _seconds(dates: NDArray[np.datetime64], start: datetime) -> Floats:
    """Return dates as seconds since a start; three centuries apart are more nanoseconds than a difference holds."""
    whole: Any = dates.astype("datetime64[s]")
    since, part = whole - utc(start).astype("datetime64[us]"), dates - whole.astype(dates.dtype)
    return np.asarray(since / np.timedelta64(1, "s") + part / np.timedelta64(1, "s"), np.float64)


def plane_dims(field: xr.DataArray | xr.Dataset) -> tuple[str, ...]:
    """Return the horizontal dimensions."""
    return next((plane for plane in PLANES if set(plane) <= set(field.dims)), ())


def as_block(field: xr.DataArray, where: str) -> Floats:
    """Return values in the order (time, level, row, column); axes that a field lacks have length 1."""
    plane = plane_dims(field)
    lead = [name for name in ("time", "depth") if name in field.dims]
    values = np.asarray(values_of(field.transpose(*lead, *plane), where), np.float64)
    shape = [field.sizes.get(name, 1) for name in ("time", "depth")]
    rows = [1] if len(plane) == 1 else []
    return np.ascontiguousarray(values.reshape(*shape, *rows, *(field.sizes[name] for name in plane)))


def check_not_empty(name: str, values: Floats, ds: xr.Dataset, dates: NDArray[np.datetime64]) -> None:
    """Raise `ForcingError` where a record of a field holds no value at all: it would count as 0."""
    if name in MAY_BE_EMPTY:
        return
    for number, record in enumerate(values):
        if not np.isfinite(record).any():
            when = f" at {minute(dates[number])}" if dates.size else ""
            valid = str(ds[name].attrs.get(VALID, "")) if name in ds else ""
            only = f", or outside of what the file calls valid ({valid})" if valid else ""
            raise ForcingError(
                f"{name} has no value{when}: all land or missing{only}", where=named(ds),
                remedy="Leave this record out, or give one with values: ds.dropna('time', how='all')" if dates.size
                else "Leave the field out, or give one with values there",
            )  # fmt: skip


def check_believable(name: str, values: Floats, ds: xr.Dataset, dates: NDArray[np.datetime64]) -> None:
    """Raise `ForcingError` where values (record, level, row, column) of a field cannot be true."""
    known = values[~np.isnan(values)]  # an infinite one is no missing value: it is beyond every range
    fault = unlikely(name, float(known.min()), float(known.max())) if known.size else ""
    if not fault:
        return
    least, most = QUANTITIES[name].range
    beyond = np.argwhere((values < least) | (values > most))
    place = beyond[0] if beyond.size else np.argwhere(~np.isnan(values))[0]
    record, _, row, column = (int(k) for k in place)
    when = f"{minute(dates[record])}, " if dates.size else ""
    units = QUANTITIES[name].units.removeprefix("1")
    raise ForcingError(
        f"{name} is {values[tuple(place)]:.3g}{f' {units}' if units else ''} at {when}{_place(ds, row, column)}; {fault}",
        where=named(ds),
        remedy="Is it a missing value that the file does not declare, or another unit or sign? Correct the file's attributes",
    )


def _place(ds: xr.Dataset, row: int, column: int) -> str:
    """Return the position of a point in words; its numbers where positions are not stored point by point."""
    if not {"lat", "lon"} <= set(ds.coords):
        return f"row {row}, column {column}"
    lat, lon = ds["lat"].values, ds["lon"].values
    if lat.ndim == 2:
        return place_text(lon[row, column], lat[row, column], latlon=True)
    return place_text(lon[column], lat[row if "lat" in ds.dims else column], latlon=True)
