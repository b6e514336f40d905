"""Records of a data product, and its fields at the elements: once in time, once in space, on the product's own points.

Records are read when asked for, in blocks, converted once, and never changed.

In space a field is bilinear over the four points around an element, as far as they know it, their weights brought
to a sum of 1; where none of them is known (land) the nearest known point within `REACH` points counts. In time it is
linear between two records; where only one of them knows a value that one is taken. Currents on levels are averaged
over the draft at each point first.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from datetime import datetime
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel
from riftberg.config.units import place_text
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.errors import ForcingError
from riftberg.ocean.forcing import SharedLock
from riftberg.ocean.grid import wind_from_stress
from riftberg.physics.elementary import cos, cos_array, sin_array
from riftberg.products.levels import layer_limits
from riftberg.products.mesh import Places, ProductPoints, beside, beside_parallel, utc
from riftberg.products.quantities import QUANTITIES, unlikely
from riftberg.products.records import (
    MAY_BE_EMPTY,
    Gap,
    cover_of,
    field_values,
    gap_error,
    gap_limit,
    minute,
    named,
    outside_remedy,
)
from riftberg.products.repair import VALID
from riftberg.state import Floats, Ints

REACH: Final = 2
"""Points inland that the nearest known value is used."""

RINGS: Final = np.array(
    sorted(
        ((dj, di) for dj in range(-REACH, REACH + 1) for di in range(-REACH, REACH + 1) if math.hypot(dj, di) <= REACH),
        key=lambda ring: (math.hypot(*ring), ring),
    )
)
"""Rows and columns to a point near by, the nearest first."""

NO_RINGS: Final = RINGS[:0]
"""For maps: land stays land."""

SURFACE: Final = np.array([0.0, 1.0])
"""Limits (m) of the only layer of a field without levels."""


class Blend(NamedTuple):
    """Fields at one time, between two records: the layers of all in turn, each field from the surface down."""

    before: Floats  # Records around the time; NaN where nothing is known; shape (layers, rows, columns)
    after: Floats  # Records around the time; NaN where nothing is known; shape (layers, rows, columns)
    weight: float  # Weight of ``after``
    bounds: Ints  # First layer of each field, and the end of the last; shape (fields + 1,)
    limits: Floats  # Depths (m) of the limits of the levels' layers; shape (levels + 1,)
    absent: Floats  # Value of each field where a record knows nothing; NaN if the other record is to count

    @classmethod
    def of(
        cls, before: Floats, after: Floats, weight: float = 0.0, limits: Floats = SURFACE, absent: float = np.nan
    ) -> Blend:
        """Return the blend of two records of one field."""
        return cls(before, after, weight, np.array([0, len(before)]), limits, np.array([absent]))


class Wanted(NamedTuple):
    """Fields of a blend that are wanted at some places."""

    field: Ints  # Numbers among the fields of the blend
    over_draft: NDArray[np.bool_]  # As means over the draft, not at the surface
    unknown: Floats  # Value outside and where the field is unknown

    @classmethod
    def of(cls, *fields: tuple[int, bool, float]) -> Wanted:
        """Return fields by number, whether over the draft, and value where unknown."""
        numbers, over_draft, unknown = zip(*fields, strict=True)
        return cls(np.array(numbers, np.int64), np.array(over_draft, np.bool_), np.array(unknown, np.float64))


ONLY_FIELD: Final = Wanted.of((0, False, np.nan))
"""The first field of a blend at the surface, NaN where it is unknown."""

NO_CORNERS: Final = np.empty((0, 4, 0))
"""Where the values at the corners are not wanted."""


@kernel
def mean_to_draft(record: Floats, first: int, end: int, limits: Floats, draft: float, j: int, i: int) -> float:
    """Return the mean from the surface to a draft at one point; NaN where there is no water.

    ``u(D) = sum(u_l w_l) / sum(w_l)`` over the levels with water, ``w_l`` being the part of the layer of level ``l`` (between
    the limits ``l`` and ``l + 1``) that lies above ``D``. In water shallower than the draft the mean ends at the sea floor;
    below the last limit the last counts. A field without levels has its only value.

    ``record``: the field from layer ``first`` to before ``end``; ``limits``: depths (m) of the limits, ascending from 0.
    """
    surface: float = record[first, j, i]
    if end == first + 1:
        return surface
    total, water = 0.0, 0.0
    for level in range(end - first):
        share = min(draft, limits[level + 1]) - limits[level]
        if share <= 0.0:
            break
        value = record[first + level, j, i]
        if value == value:
            total += share * value
            water += share
    return total / water if water > 0.0 else math.nan


@kernel
def blend_known(sw: float, se: float, nw: float, ne: float, xi: float, eta: float) -> float:
    """Return the bilinear value of those corners that are known (not NaN), weights brought to a sum of 1; else NaN."""
    total, share = 0.0, 0.0
    for k in range(4):
        # A loop over four numbers, not four blocks: south-west, south-east, north-west, north-east.
        value = sw if k == 0 else (se if k == 1 else (nw if k == 2 else ne))
        weight = (xi if k % 2 == 1 else 1.0 - xi) * (eta if k >= 2 else 1.0 - eta)
        if value == value:
            total += weight * value
            share += weight
    # A share below this is rounding of a weight that ought to be zero.
    return total / share if share > 1e-9 else math.nan


@kernel
def in_time(earlier: float, later: float, weight: float, absent: float) -> float:
    """Return the value between two records; where only one of them knows a value that one counts."""
    earlier = earlier if earlier == earlier else absent
    later = later if later == later else absent
    # At the very time of a record that one counts alone, gaps included.
    if weight <= 0.0 or later != later:
        return earlier if earlier == earlier or weight <= 0.0 else later
    return later if earlier != earlier else (1.0 - weight) * earlier + weight * later


@kernel
def _nearest_known(
    record: Floats, first: int, end: int, limits: Floats, draft: float, j: int, i: int, columns: int, rings: Ints
) -> float:
    """Value of the nearest point that knows one, in the order of ``rings``; NaN if none does."""
    for k in range(rings.shape[0]):
        row, column = j + rings[k, 0], i + rings[k, 1]
        column = column % columns if columns > 0 else column
        if 0 <= row < record.shape[1] and 0 <= column < record.shape[2]:
            value = mean_to_draft(record, first, end, limits, draft, row, column)
            if value == value:
                return value
    return math.nan


@borrower
def fill_values(
    blend: Blend,
    wanted: Wanted,
    located: Places,
    draft: Floats,
    columns: int,
    rings: Ints,
    out: Floats,
    corners: Floats,
) -> None:
    """Fill fields at many places, and the corners of their cells with the first of these fields.

    ``draft``: drafts, m; ``out``: shape (fields wanted, places); ``corners``: values south-west, south-east, north-west and
    north-east of each place, of as many of the fields as there is room for, shape (fields, 4, places).
    """
    before, after, weight, bounds, limits, absent = blend
    for n in range(located.row.size):
        j, i, j1, i1 = located.row[n], located.column[n], located.next_row[n], located.next_column[n]
        xi, eta = located.xi[n], located.eta[n]
        near_j, near_i = j1 if eta > 0.5 else j, i1 if xi > 0.5 else i  # the corner nearest to the place
        for k in range(wanted.field.size):
            if j < 0:
                out[k, n] = wanted.unknown[k]
                continue
            field, deep = wanted.field[k], draft[n] if wanted.over_draft[k] else 1.0
            first, end, nothing = bounds[field], bounds[field + 1], absent[field]
            sw = later_sw = mean_to_draft(before, first, end, limits, deep, j, i)
            se = later_se = mean_to_draft(before, first, end, limits, deep, j, i1)
            nw = later_nw = mean_to_draft(before, first, end, limits, deep, j1, i)
            ne = later_ne = mean_to_draft(before, first, end, limits, deep, j1, i1)
            value = blend_known(sw, se, nw, ne, xi, eta)
            if value != value:
                value = _nearest_known(before, first, end, limits, deep, near_j, near_i, columns, rings)
            later_value = value
            if weight > 0.0:
                later_sw = mean_to_draft(after, first, end, limits, deep, j, i)
                later_se = mean_to_draft(after, first, end, limits, deep, j, i1)
                later_nw = mean_to_draft(after, first, end, limits, deep, j1, i)
                later_ne = mean_to_draft(after, first, end, limits, deep, j1, i1)
                later_value = blend_known(later_sw, later_se, later_nw, later_ne, xi, eta)
                if later_value != later_value:
                    later_value = _nearest_known(after, first, end, limits, deep, near_j, near_i, columns, rings)
            value = in_time(value, later_value, weight, nothing)
            out[k, n] = value if value == value else wanted.unknown[k]
            if k < corners.shape[0]:
                corners[k, 0, n] = in_time(sw, later_sw, weight, nothing)
                corners[k, 1, n] = in_time(se, later_se, weight, nothing)
                corners[k, 2, n] = in_time(nw, later_nw, weight, nothing)
                corners[k, 3, n] = in_time(ne, later_ne, weight, nothing)


def values_at(
    blend: Blend, located: Places, columns: int, wanted: Wanted = ONLY_FIELD, *, draft: Floats | None = None,
    rings: Ints = RINGS, corners: Floats = NO_CORNERS,
) -> Floats:  # fmt: skip
    """Return fields at places, shape (fields, places); the arguments are those of `fill_values`."""
    out = np.empty((wanted.field.size, located.row.size))
    fill_values(
        blend, wanted, located, np.ones(located.row.size) if draft is None else draft, columns, rings, out, corners
    )
    return out


@kernel
def gradient(q_xi: float, q_eta: float, along: tuple[float, float], across: tuple[float, float]) -> tuple[float, float]:
    """Return the slope to the east and north from the changes of a quantity along both sides of a cell.

    ``(dq/dxi, dq/deta) = J (dq/dE, dq/dN)``, the rows of ``J`` being the sides (east, north) in m: grids may be turned or
    skewed. 0 where the sides enclose nothing.
    """
    area = along[0] * across[1] - along[1] * across[0]
    if area == 0.0 or area != area:
        return 0.0, 0.0
    return (q_xi * across[1] - q_eta * along[1]) / area, (along[0] * q_eta - across[0] * q_xi) / area


@kernel
def _across_cell(sw: float, se: float, nw: float, ne: float, xi: float, eta: float) -> tuple[float, float]:
    """Changes of a bilinear quantity along both sides of a cell."""
    return (1.0 - eta) * (se - sw) + eta * (ne - nw), (1.0 - xi) * (nw - sw) + xi * (ne - se)


@borrower
def fill_vorticity(
    corners: Floats, located: Places, points: ProductPoints, lon: Floats, lat: Floats, out: Floats
) -> None:
    """Fill the vorticity ``dv/dE - du/dN`` (s-1) of a current; 0 where a point around does not know it.

    ``corners``: eastward and northward current at the corners of the cells, as `fill_values` fills them; ``lon``, ``lat``:
    positions of the places, degrees.
    """
    x, y = points.lon, points.lat
    for n in range(out.size):
        j, i, j1, i1 = located.row[n], located.column[n], located.next_row[n], located.next_column[n]
        xi, eta = located.xi[n], located.eta[n]
        cosine = cos(lat[n] * DEGREE)
        e0, n0 = beside_parallel(x[j, i], y[j, i], lon[n], lat[n], cosine)
        e1, n1 = beside_parallel(x[j, i1], y[j, i1], lon[n], lat[n], cosine)
        e2, n2 = beside_parallel(x[j1, i], y[j1, i], lon[n], lat[n], cosine)
        e3, n3 = beside_parallel(x[j1, i1], y[j1, i1], lon[n], lat[n], cosine)
        along_x, across_x = _across_cell(e0, e1, e2, e3, xi, eta)
        along_y, across_y = _across_cell(n0, n1, n2, n3, xi, eta)
        u_xi, u_eta = _across_cell(corners[0, 0, n], corners[0, 1, n], corners[0, 2, n], corners[0, 3, n], xi, eta)
        v_xi, v_eta = _across_cell(corners[1, 0, n], corners[1, 1, n], corners[1, 2, n], corners[1, 3, n], xi, eta)
        _, u_north = gradient(u_xi, u_eta, (along_x, along_y), (across_x, across_y))
        v_east, _ = gradient(v_xi, v_eta, (along_x, along_y), (across_x, across_y))
        turn = (v_east - u_north) / EARTH_RADIUS_A68
        out[n] = turn if turn == turn else 0.0


@kernel
def _faces(position: float, first: int, last: int, count: int) -> tuple[int, int, float]:
    """Two neighbouring faces around a position between points, and the weight of the second one.

    Face ``k`` lies half-way between the points ``k`` and ``k + 1``; beyond the outermost the outermost counts.
    """
    # Up to the middle of the cell the place lies behind face ``first``, from there on before it.
    lower = first if position >= 0.5 else first - 1
    weight = position - 0.5 if position >= 0.5 else position + 0.5
    if count > 0:
        return lower % count, (lower + 1) % count, weight
    return min(max(lower, 0), last), min(max(lower + 1, 0), last), weight


@kernel
def _change(
    at: tuple[Floats, Floats, Floats, Floats], layer: int, weight: float, absent: float, ends: tuple[int, int, int, int],
    lon: float, lat: float, cosine: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Change of a field, and of the position to the east and north (rad), from one point to the next."""
    before, after, x, y = at
    j, i, j1, i1 = ends
    e0, n0 = beside_parallel(x[j, i], y[j, i], lon, lat, cosine)
    e1, n1 = beside_parallel(x[j1, i1], y[j1, i1], lon, lat, cosine)
    first = in_time(before[layer, j, i], after[layer, j, i], weight, absent)
    last = in_time(before[layer, j1, i1], after[layer, j1, i1], weight, absent)
    step = last - first
    return (step if step == step else 0.0), e1 - e0, n1 - n0


@borrower
def fill_slopes(
    blend: Blend, field: int, located: Places, points: ProductPoints, lon: Floats, lat: Floats, out_x: Floats,
    out_y: Floats,
) -> None:  # fmt: skip
    """Fill the slope of the sea surface to the east and north.

    Changes half-way between points, 0 beside land, are interpolated linearly to the place (as in equations 3.2), and so are
    the distances between the points: the slope of a plane is exact on any grid.

    ``field``: number of the sea level (m) in the blend.
    """
    rows, columns = points.lon.shape
    at, layer, absent = (blend.before, blend.after, points.lon, points.lat), blend.bounds[field], blend.absent[field]
    for n in range(out_x.size):
        j, i, j1, i1 = located.row[n], located.column[n], located.next_row[n], located.next_column[n]
        xi, eta = located.xi[n], located.eta[n]
        west, east, right = _faces(xi, i, columns - 2, points.columns)
        south, north, upper = _faces(eta, j, rows - 2, 0)
        q_xi = e_xi = n_xi = q_eta = e_eta = n_eta = 0.0
        cosine = cos(lat[n] * DEGREE)
        for k in range(4):
            second = k % 2 == 1
            side = (right if second else 1.0 - right) * (eta if k >= 2 else 1.0 - eta)
            column, row = east if second else west, j1 if k >= 2 else j
            beyond = (column + 1) % points.columns if points.columns > 0 else column + 1
            q, e, m = _change(at, layer, blend.weight, absent, (row, column, row, beyond), lon[n], lat[n], cosine)
            q_xi, e_xi, n_xi = q_xi + side * q, e_xi + side * e, n_xi + side * m
            side = (upper if second else 1.0 - upper) * (xi if k >= 2 else 1.0 - xi)
            row, column = north if second else south, i1 if k >= 2 else i
            q, e, m = _change(at, layer, blend.weight, absent, (row, column, row + 1, column), lon[n], lat[n], cosine)
            q_eta, e_eta, n_eta = q_eta + side * q, e_eta + side * e, n_eta + side * m
        # Positions are in rad, so the slope is per rad until it is divided by the radius.
        slope = gradient(q_xi, q_eta, (e_xi, n_xi), (e_eta, n_eta))
        out_x[n], out_y[n] = slope[0] / EARTH_RADIUS_A68, slope[1] / EARTH_RADIUS_A68


@borrower
def add_shore_drift(
    corners: Floats, located: Places, points: ProductPoints, lon: Floats, lat: Floats, speed: float, out_x: Floats,
    out_y: Floats,
) -> None:  # fmt: skip
    """Add a current away from land (m s-1): ``speed`` times how much more water there is on one side of the cell.

    ``corners``: a current at the corners of the cells, shape (4, places).
    """
    x, y = points.lon, points.lat
    for n in range(out_x.size):
        j, i, j1, i1 = located.row[n], located.column[n], located.next_row[n], located.next_column[n]
        sw, se = 1.0 * (corners[0, n] == corners[0, n]), 1.0 * (corners[1, n] == corners[1, n])
        nw, ne = 1.0 * (corners[2, n] == corners[2, n]), 1.0 * (corners[3, n] == corners[3, n])
        eastward, northward = 0.5 * (se + ne - sw - nw), 0.5 * (nw + ne - sw - se)
        e0, n0 = beside(x[j, i], y[j, i], lon[n], lat[n])
        e1, n1 = beside(x[j, i1], y[j, i1], lon[n], lat[n])
        e2, n2 = beside(x[j1, i], y[j1, i], lon[n], lat[n])
        length, height = math.hypot(e1 - e0, n1 - n0), math.hypot(e2 - e0, n2 - n0)
        if length > 0.0 and height > 0.0:
            out_x[n] += speed * (eastward * (e1 - e0) / length + northward * (e2 - e0) / height)
            out_y[n] += speed * (eastward * (n1 - n0) / length + northward * (n2 - n0) / height)


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
"""Records of fields by name, each of shape (times, levels, rows, columns)."""


class Record(NamedTuple):
    """All fields of a product at one date, as in a `Blend`."""

    layers: Floats  # Shape (layers, rows, columns)
    bounds: Ints  # First layer of each field, and the end of the last
    limits: Floats  # Depths (m) of the limits of the levels' layers


class Between(NamedTuple):
    """Two records around a time, and the weight of the second."""

    before: int
    after: int
    weight: float


class ProductRecords:
    """Fields of one canonical dataset in time, on its own points down to the deepest draft ``keel`` (m)."""

    def __init__(self, ds: xr.Dataset, start: datetime, *, keel: float = np.inf) -> None:
        for name, field in ds.data_vars.items():  # any other dimension has no known meaning
            beyond = set(map(str, field.dims)) - {"time", "depth", *plane_dims(field)}
            if beyond or not plane_dims(field):
                raise ForcingError(
                    f"{name} has the dimensions ({', '.join(map(str, field.dims))})",
                    where=named(ds) or "forcing",
                    remedy="Give fields on (time, depth, lat, lon); choose one entry of any other dimension",
                )
        self.ds, self._whole, self._limits = ds, ds, SURFACE[:1]
        self.levelled = frozenset(str(name) for name, field in ds.data_vars.items() if field.sizes.get("depth", 1) > 1)
        # Some records each, shape (times, layers, rows, columns), with bounds and limits of their layers.
        self._blocks: dict[int, Record] = {}
        self._judged: frozenset[int] = frozenset()  # First records of the blocks that have been read, and are sound
        self._lock = SharedLock()
        self.reach(keel)
        self.start = start
        self.dates: NDArray[np.datetime64] = (
            ds["time"].values.astype("datetime64[ns]") if "time" in ds.dims else np.empty(0, "datetime64[ns]")
        )
        self.times = [float(t) for t in _seconds(self.dates, start)]
        self.names = _as_they_act(tuple(map(str, ds.data_vars)))
        self._absent = np.array([0.0 if name in MAY_BE_EMPTY else np.nan for name in self.names])
        self._length = block_length(sum(field.size // field.sizes.get("time", 1) for field in ds.data_vars.values()))

    def reach(self, keel: float) -> None:
        """Read levels down to a draft (m) from now on; a member of an ensemble may be thicker than the berg of the others."""
        if "depth" not in self._whole.dims:
            self._limits = SURFACE
            return
        limits = layer_limits(self._whole["depth"].values)
        layers = int(np.clip(np.searchsorted(limits, keel, side="left"), 1, limits.size - 1))
        with self._lock:
            if layers >= self._limits.size:
                self.ds, self._limits, self._blocks = self._whole.isel(depth=slice(0, layers)), limits[: layers + 1], {}
                self._judged = frozenset()

    @cached_property  # asked for at every date
    def cover(self) -> tuple[float, float]:
        """First and last time covered, s since the start; infinite for fields without time."""
        if not self.times:
            return -np.inf, np.inf
        ends = _seconds(self.ds["time"].values[[0, -1]], self.start)
        held_before, held_after = np.abs(_seconds(np.array(cover_of(self.ds)), self.start) - ends)
        return self.times[0] - float(held_before), self.times[-1] + float(held_after)

    @cached_property
    def _wide(self) -> frozenset[int]:
        """Records after which the next one comes later than is allowed."""
        limit = gap_limit(self.ds)
        return frozenset(k for k in range(len(self.times) - 1) if Gap(self.dates[k], self.dates[k + 1]).seconds > limit)

    @property
    def limits(self) -> Floats:
        """Limits (m) of the layers of the levels; two for fields without levels."""
        return self._limits

    @property
    def has_levels(self) -> bool:
        """Whether there are currents on more than one level."""
        return self.on_levels("uo") or self.on_levels("vo")

    def on_levels(self, name: str) -> bool:
        """Whether a field is on more than one level, of those that are read."""
        return self._limits.size > 2 and name in self.levelled

    def blend(self, time: float) -> Blend:
        """Return all fields at a time, in the order of ``names``."""
        bracket = self._between(time)
        earlier = later = self._record(bracket.before)
        if bracket.weight > 0.0:
            later = self._record(bracket.after)
            while len(earlier.layers) != len(later.layers):  # another thread has gone deeper between the two
                earlier, later = self._record(bracket.before), self._record(bracket.after)
        return Blend(earlier.layers, later.layers, bracket.weight, earlier.bounds, earlier.limits, self._absent)

    def field(self, name: str, time: float) -> Blend:
        """Return one field at a time."""
        blend, number = self.blend(time), self.names.index(name)
        first, end = blend.bounds[number : number + 2]
        absent = float(self._absent[number])
        return Blend.of(blend.before[first:end], blend.after[first:end], blend.weight, blend.limits, absent)

    def check(self, start: float, end: float) -> None:
        """Read all records from ``start`` to ``end`` (s) that have not been read before."""
        first, last = self._between(start), self._between(end)
        for record in range(first.before, last.after + 1):
            if record < last.after:
                self._check_gap(record, max(start, self.times[record]))
            if record // self._length * self._length not in self._judged:
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
        if time > self.times[k]:
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
        """Refuse a time from a record to the next where these are too far apart."""
        if record in self._wide:
            gap = Gap(self.dates[record], self.dates[record + 1])
            raise gap_error(self.ds, gap, gap_limit(self.ds), self._date(time))

    def _date(self, time: float) -> np.datetime64:
        return utc(self.start) + np.timedelta64(round(time), "s")

    def _record(self, number: int) -> Record:
        first = number // self._length * self._length
        block = self._blocks.get(first)
        if block is None:
            with self._lock:  # another thread may have read it meanwhile
                block = self._blocks.get(first) or self._stacked(self._read(slice(first, first + self._length)))
                # The dictionary is replaced, never changed: other threads look into it without the lock.
                spared = sorted(self._blocks, key=lambda old: abs(old - first))[: KEPT_BLOCKS - 1]
                self._blocks = {**{old: self._blocks[old] for old in spared}, first: block}
                self._judged |= {first}
        # Fields that all lack time have one record.
        return block._replace(layers=block.layers[min(number - first, len(block.layers) - 1)])

    def _stacked(self, block: Block) -> Record:
        """Return records with the layers of all fields in one array; a field without time beside others has one record."""
        shapes = [block[name].shape for name in self.names]
        bounds = np.cumsum([0, *(levels for _, levels, _, _ in shapes)])
        layers = np.empty((max(count for count, *_ in shapes), bounds[-1], *shapes[0][2:]))
        for name, first, end in zip(self.names, bounds[:-1], bounds[1:], strict=True):
            layers[:, first:end] = block[name]
        return Record(layers, bounds, self._limits)

    def _read(self, records: slice) -> Block:
        """Read some records; refuse those without a value, and values that cannot be true."""
        excerpt = self.ds.isel(time=records) if self.times else self.ds
        block = {str(name): as_block(field, named(self.ds)) for name, field in excerpt.data_vars.items()}
        for name, values in block.items():
            check_not_empty(name, values, self.ds, self.dates[records])
            check_believable(name, values, excerpt, self.dates[records])
        if "taux" in block and "tauy" in block and "ua" not in block:
            block["ua"], block["va"] = wind_from_stress(block.pop("taux"), block.pop("tauy"))
        if "wave_direction" in block:  # from where they come; its parts can be interpolated, degrees cannot
            angle = np.deg2rad(block.pop("wave_direction"))
            block["wave_x"], block["wave_y"] = -sin_array(angle), -cos_array(angle)
        if "depth_below_surface" in block:  # land counts as depth 0, so that shores shoal
            block["depth_below_surface"] = np.nan_to_num(block["depth_below_surface"])
        return block


def block_length(values: float) -> int:
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
    whole_seconds: Any = dates.astype("datetime64[s]")
    since, remainder = whole_seconds - utc(start).astype("datetime64[us]"), dates - whole_seconds.astype(dates.dtype)
    return np.asarray(since / np.timedelta64(1, "s") + remainder / np.timedelta64(1, "s"), np.float64)


def plane_dims(field: xr.DataArray | xr.Dataset) -> tuple[str, ...]:
    """Return the horizontal dimensions."""
    return next((plane for plane in PLANES if set(plane) <= set(field.dims)), ())


def as_block(field: xr.DataArray, where: str) -> Floats:
    """Return values in the order (time, level, row, column); axes that a field lacks have length 1."""
    plane = plane_dims(field)
    lead = [name for name in ("time", "depth") if name in field.dims]
    values = np.asarray(field_values(field.transpose(*lead, *plane), where), np.float64)
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
    present = values[~np.isnan(values)]  # an infinite one is no missing value: it is beyond every range
    fault = unlikely(name, float(present.min()), float(present.max())) if present.size else ""
    if not fault:
        return
    least, most = QUANTITIES[name].range
    beyond = np.argwhere((values < least) | (values > most))
    index = beyond[0] if beyond.size else np.argwhere(~np.isnan(values))[0]
    record, _, row, column = (int(k) for k in index)
    when = f"{minute(dates[record])}, " if dates.size else ""
    units = QUANTITIES[name].units.removeprefix("1")
    raise ForcingError(
        f"{name} is {values[tuple(index)]:.3g}{f' {units}' if units else ''} at {when}{_place(ds, row, column)}; {fault}",
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
