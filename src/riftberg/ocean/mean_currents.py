"""Currents as means over 25 hours, taken twice: those that the slope of the sea surface balances (`riftberg.ocean.balance`)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import SECONDS_PER_DAY
from riftberg.ocean.balance import slow_current_weights
from riftberg.ocean.product_records import ProductRecords, Record
from riftberg.state import Floats

KEPT_BYTES: Final = 128e6
"""Memory for means that are kept, for the members of an ensemble that share them."""

FEWEST: Final = 16
"""Means that are kept at least: so many are whole at once at the end of a series."""


@kernel
def add_share(values: Floats, weight: float, total: Floats, known_weight: Floats) -> None:
    """Add a record with its weight to a mean where the record has a value."""
    for n in range(values.size):
        value = values[n]
        total[n] += weight * value if value == value else 0.0
        known_weight[n] += weight if value == value else 0.0


class _Sums(NamedTuple):
    """A mean that is being taken: weighted sum and weight of the known values; flat."""

    total: Floats
    known_weight: Floats


class MeanCurrents(ProductRecords):
    """Currents of other records, or their winds (``pair``), as means over 25 hours, taken twice, at some of their dates.

    Each record is read once and added to the means that hold it; means are kept, so that a further member of an ensemble reads
    none. A mean is a sum over its records in their order, wherever a run began.
    """

    def __init__(self, of: ProductRecords, pair: tuple[str, str] = ("uo", "vo")) -> None:
        self._of, self._pair = of, list(pair)
        self._means: dict[int, Record] = {}
        self._open: dict[int, _Sums] = {}
        self._next = -1  # The record that is to be added next to the sums that are open
        super().__init__(of.ds[self._pair], of.start, keel=float(of.limits[-1]))
        times = np.asarray(of.times)
        numbers, self._shares = slow_current_weights(times)
        self.dates, self.times = of.dates[numbers], [float(t) for t in times[numbers]]
        self._firsts = np.array([share.first for share in self._shares])
        self._ends = np.array([share.first + share.weights.size for share in self._shares])

    @property
    def cover(self) -> tuple[float, float]:
        """First and last time covered, s since the start."""
        return self._of.cover

    def reach(self, keel: float) -> None:
        """Average levels down to a draft (m) from now on."""
        with self._lock:
            self._of.reach(keel)
            if self._of.limits.size != self._limits.size or not self._means:
                self.ds, self._limits = self._of.ds[self._pair], self._of.limits
                self._means, self._open, self._next = {}, {}, -1

    def check(self, start: float, end: float) -> None:
        """Take the means from ``start`` to ``end`` (s), if they can all be kept."""
        first, last = self._between(start), self._between(end)
        values = sum(field.size for field in self.ds.data_vars.values()) / max(1, self.ds.sizes.get("time", 1))
        if 8.0 * values * (last.after + 1 - first.before) <= KEPT_BYTES:
            for number in range(first.before, last.after + 1):
                self._record(number)

    def _check_gap(self, record: int, time: float) -> None:
        """Pass: the records of the currents check their own gaps."""

    def _record(self, number: int) -> Record:
        mean = self._means.get(number)
        if mean is None:
            with self._lock:  # another thread may have taken it meanwhile
                mean = self._means.get(number) or self._taken(number)
        return mean

    def _taken(self, number: int) -> Record:
        """Add records until a mean is whole; those that begin later go on growing."""
        if number not in self._open:
            self._open, self._next = {}, self._shares[number].first
        while number not in self._means:
            self._add_record(self._next)
            self._next += 1
        return self._means[number]

    def _add_record(self, record: int) -> None:
        """Add a record to all means that hold it and have had those before it; keep the means that it completes."""
        source, levels = self._of._record(record), self._limits.size - 1  # another thread may have gone deeper
        spans = [source.bounds[k : k + 2] for k in map(self._of.names.index, self.names)]
        fields = [source.layers[first : min(end, first + levels)] for first, end in spans]
        block = np.concatenate(fields)
        behind, ahead = np.searchsorted(self._ends, record, "right"), np.searchsorted(self._firsts, record, "right")
        for number in range(int(behind), int(ahead)):
            first, weights = self._shares[number]
            if record == first and number not in self._means:
                self._open[number] = _Sums(np.zeros(block.size), np.zeros(block.size))
            if number not in self._open:
                continue
            add_share(block.reshape(-1), weights[record - first], *self._open[number])
            if record == first + weights.size - 1:
                total, known_weight = self._open.pop(number)
                with np.errstate(invalid="ignore", divide="ignore"):
                    mean = np.where(known_weight > 0.0, total / known_weight, np.nan).reshape(block.shape)
                self._keep(number, Record(mean, np.cumsum([0, *map(len, fields)]), self._limits))

    def _keep(self, number: int, mean: Record) -> None:
        """Keep a mean; the farthest in time are forgotten where there is no room."""
        most = max(FEWEST, int(KEPT_BYTES // max(1, mean.layers.nbytes)))
        # The dictionary is replaced, never changed: other threads look into it without the lock.
        spared = sorted(self._means, key=lambda old: abs(old - number))[: most - 1]
        self._means = {**{k: self._means[k] for k in spared}, number: mean}


def mean_currents(records: ProductRecords, pair: tuple[str, str] = ("uo", "vo")) -> ProductRecords:
    """Return currents (or winds) that the sea surface balances: means over 25 hours twice, if records are shorter than a day."""
    times = np.asarray(records.times)
    if times.size < 2 or np.median(np.diff(times)) >= SECONDS_PER_DAY:
        return records
    return MeanCurrents(records, pair)
