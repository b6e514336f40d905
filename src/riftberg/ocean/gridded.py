"""Forcing from gridded fields in time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from riftberg.config.values import moment, number, required
from riftberg.errors import ForcingError
from riftberg.ocean.cells import (
    DEPTH_BIQUADRATIC,
    DEPTH_OF_CELL,
    DEPTH_ZONE,
    DepthAtPoint,
    Fields,
    GridArrays,
    Points,
    blend_around,
    fill_depth,
    locate_points,
    points_from_corners,
    sample_gridded,
)
from riftberg.ocean.forcing import Forcing, SharedLock
from riftberg.ocean.grid import ZERO_ON_LAND, Grid, first_gap, usable
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import listed

DepthRule = Literal["cell", "biquadratic", "zone"]
TimeRule = Literal["linear", "previous"]
Records = Fields | Sequence[Fields] | Callable[[int], Fields]

DEPTH_RULES = {"cell": DEPTH_OF_CELL, "biquadratic": DEPTH_BIQUADRATIC, "zone": DEPTH_ZONE}
"""Names of the depth rules: constant in a cell (STS), biquadratic (MTS), dry quadrant (A68) (equations 3.2)."""

MARGIN = 3
"""Cells around the elements whose fields are blended in time; interpolation reaches two."""

NO_CELLS: Ints = np.empty(0, dtype=np.int64)

TIME_TOLERANCE = 1e-6
"""Times this close (s) outside the records count as inside, for round-off in sums of time steps."""


@dataclass(frozen=True)
class FieldRules:
    """How fields on a grid reach the elements.

    Parameters
    ----------
    depth_rule : {"biquadratic", "cell", "zone"}
        How the depth under an element is found.
    zone : tuple of float, optional
        (longitude, latitude) of the south-west point of the dry quadrant, for ``depth_rule="zone"``.
    interpolation : {"linear", "previous"}
        Between records: linear, or the record before.
    stepwise : sequence of str
        Fields that keep the record before although the others are interpolated (sea level in the A68 run, equations 10.5).
    coastal_drift, tidal_drift : float
        Drift away from land and random current near land, m s-1.
    mirrored, even_parity : bool
        Quirks Q22 and Q20.
    listed_draws : bool
        Elements of a cell draw their random current in the order of the reference's lists; else the last row first.
    sea_level_gaps : bool
        Let gaps (NaN) in the sea level over water through: a slope that would need such a value is 0, as in the
        reference (equations 3.2). Only with ``depth_rule="zone"``, where the depth does not ask for the sea level.

    Raises
    ------
    ForcingError
        If a rule is not known, or two of them cannot be combined.
    """

    depth_rule: DepthRule = "biquadratic"
    zone: tuple[float, float] | None = None
    interpolation: TimeRule = "linear"
    stepwise: Sequence[str] = ()
    coastal_drift: float = 0.0
    tidal_drift: float = 0.0
    mirrored: bool = False
    even_parity: bool = False
    listed_draws: bool = False
    sea_level_gaps: bool = False

    def __post_init__(self) -> None:
        for name in ("coastal_drift", "tidal_drift"):
            object.__setattr__(self, name, number(getattr(self, name), "m s-1", where=name, kind=ForcingError))
        if self.depth_rule not in DEPTH_RULES:
            raise ForcingError(f"depth_rule = {self.depth_rule!r}", remedy=f"Use one of {', '.join(DEPTH_RULES)}")
        if self.depth_rule == "zone" and self.zone is None:
            raise ForcingError("depth_rule = 'zone' without a zone", remedy="Give zone=(longitude, latitude)")
        if self.interpolation not in ("linear", "previous"):
            raise ForcingError(f"interpolation = {self.interpolation!r}", remedy="Use 'linear' or 'previous'")
        if self.sea_level_gaps and self.depth_rule != "zone":
            raise ForcingError("sea_level_gaps with a depth that needs the sea level", remedy="Fill the gaps")
        unknown = sorted(set(self.stepwise) - set(Fields._fields))
        if unknown:
            raise ForcingError(f"stepwise names {unknown[0]!r}", remedy=f"Fields are {', '.join(Fields._fields)}")


class GriddedForcing(Forcing):
    """Ocean, air, sea ice and sea floor from fields on a grid, constant or in records over time.

    Implements `riftberg.ocean.forcing.Forcing`.

    Parameters
    ----------
    grid : Grid
        Grid of the fields.
    records : Fields or sequence of Fields or callable
        One state, states in time, or a function that returns state number k (counted from 0) when it is needed.
        NaN may stand on land. Arrays that are the same object in successive records are not interpolated in time, so
        share the fields that do not change.
    times : array_like, optional
        Times of the records, s since the start of the run, increasing. Not needed for a single state, which then
        holds from then on.
    rules : FieldRules, optional
        How the fields reach the elements.
    start : date, optional
        Date of time 0, named in messages.
    source : str
        Where the fields come from, for `describe`.
    """

    def __init__(
        self, grid: Grid, records: Records, times: ArrayLike | None = None, rules: FieldRules | None = None, *,
        start: datetime | date | str | np.datetime64 | None = None, source: str = "",
    ) -> None:  # fmt: skip
        required(grid, Grid, "a Grid, for example Grid.cartesian(20, 20, 1000.0)", where="grid", kind=ForcingError)
        rules = FieldRules() if rules is None else rules
        self.grid: Grid | None = grid
        self._grid = grid
        self.rules, self.source = rules, source
        self.start = None if start is None else moment(start, where="start")
        self.notices: tuple[str, ...] = ()
        zone_lon, zone_lat = (float(z) for z in rules.zone) if rules.zone else (0.0, 0.0)
        self._depth_rule = DepthAtPoint(DEPTH_RULES[rules.depth_rule], zone_lon, zone_lat, bool(rules.even_parity))
        self._held = frozenset(Fields._fields if rules.interpolation == "previous" else rules.stepwise)
        self._store = _Records(grid, records, {"ssh"} if rules.sea_level_gaps else set())
        self._times = _checked_times(times, self._store.count)

    @property
    def times(self) -> list[float] | None:
        """Times of the records, s since the start of the run; None for a constant state."""
        return None if self._times is None else list(self._times)

    @property
    def cover(self) -> tuple[float, float]:
        """First and last time covered, s since the start of the run; infinite for a constant state."""
        if self._times is None:
            return -np.inf, np.inf
        return self._times[0], self._times[-1]

    def _date(self, time: float) -> str:
        if self.start is None or not np.isfinite(time):
            return f"{time:g} s"
        return f"{time:g} s ({self.start + timedelta(seconds=time):%Y-%m-%d %H:%M:%S})"

    def _require_cover(self, first: float, last: float) -> None:
        begin, end = self.cover
        if first < begin - TIME_TOLERANCE or last > end + TIME_TOLERANCE:
            need = self._date(first) if first == last else f"{self._date(first)} to {self._date(last)}"
            raise ForcingError(
                f"the run needs {need}, the records cover {self._date(begin)} to {self._date(end)}",
                where="forcing", remedy="Add records, or shorten or shift the run",
            )  # fmt: skip

    def _between(self, time: float) -> tuple[int, float]:
        """Record before a time, and the weight of the record after it."""
        if self._times is None:
            return 0, 0.0
        self._require_cover(time, time)
        k = min(max(bisect_right(self._times, time) - 1, 0), len(self._times) - 1)
        if k == len(self._times) - 1:
            return k, 0.0
        weight = (time - self._times[k]) / (self._times[k + 1] - self._times[k])
        return k, max(weight, 0.0)

    def replace(self, fields: Fields) -> None:
        """Put one constant state in the place of all records; for models that go on with another ocean."""
        self._store = _Records(self._grid, fields, {"ssh"} if self.rules.sea_level_gaps else set())
        self._times = None

    def fields_at(self, time: float, cell_i: Ints | None = None, cell_j: Ints | None = None) -> Fields:
        """Return the fields at a time.

        Parameters
        ----------
        time : float
            Seconds since the start of the run.
        cell_i, cell_j : ndarray, optional
            Array cells near which the fields are needed; everywhere if not given. Elsewhere old values may stand.

        Returns
        -------
        Fields
            Not to be written to.
        """
        k, weight = self._between(time)
        earlier = self._store[k]
        if weight == 0.0:
            return earlier
        later = self._store[k + 1]
        # A negative weight makes the kernel leave a field unchanged: it is shared with the earlier record.
        same = [first is last or name in self._held for name, first, last in zip(Fields._fields, earlier, later)]
        # New arrays in every call: two models in two threads may share this forcing.
        blended = Fields(*(b if is_same else np.empty_like(b) for b, is_same in zip(earlier, same)))
        i, j = (NO_CELLS, NO_CELLS) if cell_i is None or cell_j is None else (cell_i, cell_j)
        blend_around(i, j, MARGIN, earlier, later, np.where(same, -1.0, weight), blended)
        return blended

    def sample(
        self, elements: Elements, time: float, *, tide: bool = True, drawn_in: tuple[Ints, Ints] | None = None
    ) -> None:
        """Fill the environment of the elements (``uo`` ... ``vorticity``) at their positions and cells.

        Parameters
        ----------
        elements : Elements
            Their ``lon``, ``lat``, ``cell_i``, ``cell_j``, ``xi`` and ``eta`` are read.
        time : float
            Seconds since the start of the run.
        tide : bool, optional
            With the random current near land.
        drawn_in : tuple of int arrays, optional
            Columns and rows of the cells in which the elements draw the numbers of that current; those in which they are if
            left out. In a stage of a step they stay at its start.
        """
        if elements.lon.size == 0:
            return
        fields, grid = self.fields_at(time, elements.cell_i, elements.cell_j), self._grid.arrays
        rules = self.rules
        sample_gridded(elements, grid, fields, self._depth_rule, rules.coastal_drift, bool(rules.mirrored))
        if tide and rules.tidal_drift > 0.0:
            columns, rows = (elements.cell_i, elements.cell_j) if drawn_in is None else drawn_in
            order = listed(elements, columns, rows) if rules.listed_draws else None
            draws = tidal_draws(columns, rows, fields.ssh, grid.halo, order)
            add_tidal_drift(elements, grid, draws, rules.tidal_drift, bool(rules.mirrored))

    def check(self, elements: Elements, start: float, end: float) -> None:
        """Raise `ForcingError` unless the forcing covers these elements from ``start`` to ``end`` (s).

        Refused are elements off the grid or on land, times that no record covers, and gaps (NaN) over water.
        """
        self._require_cover(start, end)
        self._check_elements(elements)
        (first, _), (last, weight) = self._between(start), self._between(end)
        for k in range(first, last + 1 + (weight > 0.0)):
            gap = self._store.gap(k)
            if gap:
                raise self._gap_error(k, *gap)

    def _check_elements(self, elements: Elements) -> None:
        g, i, j = self._grid.arrays, elements.cell_i, elements.cell_j
        inside = self._grid.has_in_domain(elements)
        wet = inside & (g.mask[np.where(inside, j, 0), np.where(inside, i, 0)] >= 0.5)
        if not wet.all():
            row = int(np.flatnonzero(~wet)[0])
            how = "on land" if inside[row] else "in no cell of the domain"
            raise ForcingError(
                f"element {elements.id[row]} at ({elements.lon[row]:.6g}, {elements.lat[row]:.6g}) is {how}",
                where="forcing", remedy="Call grid.locate(elements) first; move the berg, or correct the land mask",
            )  # fmt: skip

    def _gap_error(self, record: int, name: str, i: int, j: int) -> ForcingError:
        g = self._grid.arrays
        when = "" if self._times is None else f" at {self._date(self._times[record])}"
        return ForcingError(
            f"{name} is NaN over water in cell ({i - g.halo + 1}, {j - g.halo + 1}) "
            f"near ({g.lon_centre[j, i]:.6g}, {g.lat_centre[j, i]:.6g}), record {record}{when}",
            where=self.source or "forcing",
            remedy="Fill the gap, for example with the nearest valid value, or make the cell land in the mask",
        )

    def land(self, lon: Floats, lat: Floats) -> NDArray[np.bool_]:
        """Return which points lie in cells of land."""
        points = self._located(lon, lat, dry=True)
        return ((points.i >= 0) & (self._grid.arrays.mask[points.j, points.i] < 0.5)).reshape(np.shape(lon))

    def _located(self, lon: Floats, lat: Floats, *, dry: bool = False) -> Points:
        """Return points in their cells, with -1 outside and, unless ``dry`` ones count, on land."""
        x, y = (np.ascontiguousarray(q, dtype=np.float64).ravel() for q in (lon, lat))
        i, j = np.empty(x.size, dtype=np.int64), np.empty(x.size, dtype=np.int64)
        xi, eta = np.empty(x.size), np.empty(x.size)
        locate_points(x, y, self._grid.arrays, False, i, j, xi, eta)
        if not dry:
            i[(i >= 0) & (self._grid.arrays.mask[j, i] < 0.5)] = -1
        return Points(x, y, i, j, xi, eta)

    def currents(self, lon: Floats, lat: Floats, time: float) -> tuple[Floats, Floats]:
        """Return the ocean current (m s-1) at arrays of points, for maps; NaN outside and on land."""
        _, _, i, j, xi, eta = self._located(lon, lat)
        fields = self.fields_at(time)
        u, v = np.full(i.size, np.nan), np.full(i.size, np.nan)
        points_from_corners(fields.uo, fields.vo, i, j, xi, eta, self._grid.arrays, u, v)
        return u.reshape(np.shape(lon)), v.reshape(np.shape(lon))

    def depth(self, lon: Floats, lat: Floats) -> Floats:
        """Return the depth of water (m) below mean sea level at arrays of points; NaN outside and on land."""
        depth = self._store[0].depth
        return self._by_depth_rule(lon, lat, depth, np.zeros_like(depth), np.nan)

    def sea_level(self, lon: Floats, lat: Floats, time: float) -> Floats:
        """Return the sea level (m) that the depth of water of elements has beside `depth`, at arrays of points."""
        if self.rules.depth_rule == "zone":  # which knows no sea level
            return np.zeros(np.shape(lon))
        level = self.fields_at(time).ssh
        return np.nan_to_num(self._by_depth_rule(lon, lat, np.zeros_like(level), level, 0.0))

    def _by_depth_rule(self, lon: Floats, lat: Floats, depth: Floats, level: Floats, outside: float) -> Floats:
        points = self._located(lon, lat)
        out = np.full(points.i.size, outside)
        fill_depth(points, self._grid.arrays, depth, level, self._depth_rule, out)
        return out.reshape(np.shape(lon))

    def describe(self) -> str:
        """Return kind, source and coverage of this forcing in plain words."""
        (begin, end), rules = self.cover, self.rules
        if self._times is None:
            time = "constant in time"
        else:
            between = "linear between them" if rules.interpolation == "linear" else "each held until the next"
            time = f"{len(self._times)} records from {self._date(begin)} to {self._date(end)}, {between}"
        depth = f"within a quadrant at {rules.zone}" if rules.depth_rule == "zone" else rules.depth_rule
        lines = ["gridded fields" + (f" from {self.source}" if self.source else ""), time, f"depth: {depth}"]
        if self._held and rules.interpolation == "linear":
            lines.append(f"held until the next record: {', '.join(sorted(self._held))}")
        if rules.sea_level_gaps:
            lines.append("no slope of the sea surface beside gaps in the sea level")
        for name in ("coastal_drift", "tidal_drift"):
            if getattr(rules, name) > 0.0:
                lines.append(f"{name.replace('_', ' ')} {getattr(rules, name):g} m/s")
        return "\n".join([*lines, *self.notices, self._grid.describe()])


def _checked_times(times: ArrayLike | None, count: int) -> list[float] | None:
    if times is None:
        if count != 1:
            raise ForcingError("records without times", where="forcing", remedy="Give times=, s since the start")
        return None
    values = np.asarray(times, dtype=np.float64)
    if values.ndim != 1 or values.size == 0 or not np.isfinite(values).all() or not (np.diff(values) > 0.0).all():
        raise ForcingError("times are not a rising sequence of finite numbers", where="forcing", remedy="Sort them")
    if count not in (values.size, -1):
        raise ForcingError(f"{values.size} times for {count} records", where="forcing", remedy="Give one per record")
    return [float(t) for t in values]


class _Records:
    """Records made usable for the kernels, and the gaps found in them.

    States given as arrays are prepared once, at the start; shared arrays are prepared once and stay shared. States
    from a function are loaded when needed; the last two are kept.
    """

    def __init__(self, grid: Grid, records: Records, with_gaps: Set[str]) -> None:
        self._mask, self._halo, self._with_gaps = grid.arrays.mask, grid.arrays.halo, with_gaps
        self._prepared: dict[int, tuple[Floats, Floats, tuple[int, int]]] = {}
        self._kept: dict[int, tuple[Fields, tuple[str, int, int] | None]] = {}
        self._load: Callable[[int], Fields] | None = None
        self._lock = SharedLock()
        self.count = -1
        if callable(records):
            self._load = records
            return
        states = (records,) if isinstance(records, Fields) else tuple(records)
        if not states:
            raise ForcingError("no records", where="forcing", remedy="Give at least one state")
        self.count = len(states)
        self._kept = {k: self._prepare(state) for k, state in enumerate(states)}

    def _prepare(self, state: Fields) -> tuple[Fields, tuple[str, int, int] | None]:
        gap: tuple[str, int, int] | None = None
        arrays = []
        for name, raw in zip(Fields._fields, state, strict=True):
            array, (i, j) = self._field(name, raw)
            arrays.append(array)
            if i >= 0 and gap is None:
                gap = name, i, j
        return Fields(*arrays), gap

    def _field(self, name: str, raw: Floats) -> tuple[Floats, tuple[int, int]]:
        if np.shape(raw) != self._mask.shape:
            raise ForcingError(
                f"{name} has shape {np.shape(raw)}, the grid {self._mask.shape} with its halo",
                where="forcing", remedy="Use grid.fields(...) or grid.extended(...)",
            )  # fmt: skip
        if name in self._with_gaps:
            return np.require(raw, dtype=np.float64, requirements=["C", "W"]), (-1, -1)
        zero_on_land = name in ZERO_ON_LAND
        key = 2 * id(raw) + zero_on_land
        prepared = self._prepared.get(key)
        if prepared is None:
            values = np.require(raw, dtype=np.float64, requirements=["C", "W"])
            # The raw array is kept too, so that its id stays its own.
            prepared = raw, usable(values, self._mask, zero_on_land), first_gap(values, self._mask, self._halo)
            self._prepared[key] = prepared
        return prepared[1], prepared[2]

    def _get(self, k: int) -> tuple[Fields, tuple[str, int, int] | None]:
        cached = self._kept.get(k)
        if cached is not None:
            return cached
        with self._lock:  # another thread may have loaded it meanwhile
            return self._kept.get(k) or self._loaded(k)

    def _loaded(self, k: int) -> tuple[Fields, tuple[str, int, int] | None]:
        if self._load is None:
            raise IndexError(k)
        prepared = self._prepare(self._load(k))
        # The dictionary is replaced, never changed: other threads look into it without the lock.
        spared = sorted(self._kept, key=lambda old: (abs(old - k) <= 1, old))[-1:]
        self._kept = {**{old: self._kept[old] for old in spared}, k: prepared}
        in_use = {id(a) for state, _ in self._kept.values() for a in state}
        self._prepared = {key: v for key, v in self._prepared.items() if id(v[1]) in in_use}
        return prepared

    def __getitem__(self, k: int) -> Fields:
        return self._get(k)[0]

    def gap(self, k: int) -> tuple[str, int, int] | None:
        """First gap over water in record ``k``: name of the field and array indices (i, j), or None."""
        return self._get(k)[1]


def cell_seed(i: int, j: int, ssh: float, halo: int) -> int:
    """Return the seed of a cell: i + 10000 j + int(16384 |sin(262144 ssh)|), i and j counted from 1 in the domain.

    ``ssh``: sea level in the cell, m.
    """
    return (i - halo + 1) + 10_000 * (j - halo + 1) + int(16384.0 * abs(math.sin(262144.0 * ssh)))


def tidal_draws(cell_i: Ints, cell_j: Ints, ssh: Floats, halo: int, order: Ints | None = None) -> tuple[Floats, Floats]:
    """Two numbers in [-1, 1] per element; elements of a cell draw in ``order``, or the last row first (equations 1.6)."""
    east, north = np.empty(cell_i.size), np.empty(cell_i.size)
    members: dict[tuple[int, int], list[int]] = {}
    for row in range(cell_i.size - 1, -1, -1) if order is None else order.tolist():
        members.setdefault((int(cell_j[row]), int(cell_i[row])), []).append(row)
    for (j, i), rows in members.items():
        stream = np.random.RandomState(cell_seed(i, j, float(ssh[j, i]), halo) % 2**32)
        # The reference makes each number of one 32-bit word; RandomState.random_sample would use two.
        words = stream.randint(0, 2**32, size=2 * len(rows), dtype=np.uint32)
        numbers = 2.0 * (words.astype(np.float64) / (2.0**32 - 1.0)) - 1.0
        east[rows], north[rows] = numbers[0::2], numbers[1::2]
    return east, north


def tidal_increment(mask: Floats, i: Ints, j: Ints, east: Floats, north: Floats) -> tuple[Floats, Floats]:
    """Return the current in cells (i, j) per unit of amplitude, for draws in [-1, 1]; 0 away from land (equations 3.2)."""
    to_west, to_east, to_south, to_north = mask[j, i - 1], mask[j, i + 1], mask[j - 1, i], mask[j + 1, i]
    along = np.minimum(0.0, east) * to_west + np.maximum(0.0, east) * to_east
    across = np.minimum(0.0, north) * to_south + np.maximum(0.0, north) * to_north
    here = mask[j, i]
    return along * (1.0 - to_south * to_north) * here, across * (1.0 - to_west * to_east) * here


def interpolate_corners(q: Floats, e: Elements, mirrored: bool) -> Floats:
    """Return a field of corners at elements: linear in their cells."""
    i, j, xi, eta = e.place.cell_i, e.place.cell_j, e.place.xi, e.place.eta
    x, y = (1.0 - xi, 1.0 - eta) if mirrored else (xi, eta)
    return (q[j, i] * x + q[j, i - 1] * (1.0 - x)) * y + (q[j - 1, i] * x + q[j - 1, i - 1] * (1.0 - x)) * (1.0 - y)


def add_tidal_drift(
    elements: Elements, grid: GridArrays, draws: tuple[Floats, Floats], amplitude: float, mirrored: bool = False
) -> None:
    """Add the random current near land to sampled currents ``uo vo ui vi`` (docs/explanation/equations.md, 3.2).

    ``draws``: two random numbers in [-1, 1] of each element; ``amplitude``: largest current added, m s-1.
    """
    e = elements
    along, across = (amplitude * q for q in tidal_increment(grid.mask, e.cell_i, e.cell_j, *draws))
    c, s = interpolate_corners(grid.cos_angle, e, mirrored), interpolate_corners(grid.sin_angle, e, mirrored)
    du, dv = c * along + s * across, c * across - s * along
    e.uo[:] += du
    e.ui[:] += du
    e.vo[:] += dv
    e.vi[:] += dv
