"""Broad phase: partners over bonds, within a berg and of other bergs, and which pairs may come into contact in a step.

Explicit schemes take groups of bergs that may come into contact: only within a group may one result depend on another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.run_state import RunState
from riftberg.ocean.grid import Grid
from riftberg.parameters import KernelParameters, Parameters
from riftberg.physics.geometry import separation
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import OTHER_BERG, SAME_BERG, PairList, adjacency, find_pairs, near_pairs, no_pairs
from riftberg.state.population import numbered
from riftberg.state.variables import Shown

NEWBORN_CHILD = -1.0
"""Foot of a child of footloose calving that takes no part in contact yet."""

REACH_FACTOR = 1.5
"""Distances of contact within which a pair may come into contact in a step, whatever its speed: forces accelerate it."""

SPEED_MARGIN = 0.3
"""Part of the path by their relative speed by which two elements may miss each other and still be a candidate pair.

Both are generous rather than derived: a candidate pair that does not touch costs a few distances, one that is missed is
found a step too late, deep inside another berg.
"""

SEARCH_MARGIN = 1.001
"""Factor on the search radius: round-off in the search must not lose a pair."""


NO_PAIRS: Final = (np.zeros(0, np.int64), np.zeros(0, np.int64))
"""Elements of no pairs."""


class CellSearch(NamedTuple):
    """How far the reference looks for partners in the cells of the ocean's grid: columns and rows to each side (equations 5.1).

    ``cyclic_columns`` is the number of columns of a cyclic grid, else 0.
    """

    columns: int
    rows: int
    cyclic_columns: int

    def within(self, cells: int) -> CellSearch:
        """Return a search over so many cells to each side."""
        return CellSearch(cells, cells, self.cyclic_columns)


def contact_cells(p: Parameters, grid: Grid | None) -> CellSearch | None:
    """Return the cells in which bergs that touch are looked for (equations 5.1); None where it is done by distance.

    As many columns as bring any corner of the grid ``contact.distance`` farther east, as many rows as it has in the south.
    """
    if grid is None or not p.quirks.contact_by_cells:
        return None
    g, distance = grid.arrays, p.contact.distance
    degree = math.radians(p.earth.radius) if g.latlon else 1.0
    parallel = degree * (np.cos(np.radians(g.lat)) if g.latlon else np.ones_like(g.lat))
    columns = 1
    while columns < g.ni and ((g.lon[:, columns:] - g.lon[:, :-columns]) * parallel[:, :-columns] < distance).any():
        columns += 1
    rows = math.ceil(distance / (degree * float(g.lat[1, 0] - g.lat[0, 0])))
    return CellSearch(columns, max(rows, 1), g.ni if g.cyclic else 0)


class NeighbourSearch:
    """Finds the partners of each element; bonded pairs are listed anew only when bonds have changed."""

    def __init__(self) -> None:
        self._bonded: tuple[PairList, Ints] | None = None
        self._listed: tuple[bytes, int, int] = (b"", -1, -1)

    def bonded(self, el: Elements, bonds: Bonds) -> tuple[PairList, Ints]:
        """Partners over unbroken bonds and the bond of each entry."""
        # A new bond raises the largest identifier; elements that are removed change their number.
        listed = bonds.status.tobytes(), int(bonds.id.max(initial=0)), el.size
        if self._bonded is None or listed != self._listed:
            self._bonded = adjacency(bonds.first, bonds.second, bonds.status, el.size)
            self._listed = listed
        return self._bonded

    def springs(self, el: Elements, bonds: Bonds, p: KernelParameters) -> tuple[PairList, Floats]:
        """Partners over spring bonds, and the rest length (m) of each entry; none with the reference's rule."""
        partners, bond = self.bonded(el, bonds)
        return partners, np.zeros(0) if p.rest_length_from_sizes else bonds.rest_length[bond]

    def find(
        self, el: Elements, reach: float, rule: int, c: KernelParameters, cells: CellSearch | None = None
    ) -> PairList:
        """Partners within ``reach`` metres by the positions that others see, and within some cells."""
        if el.size < 2 or reach <= 0.0:
            return no_pairs(el.size)
        pairs = find_pairs(el.lon_pair, el.lat_pair, el.berg, reach, rule, c.latlon, c.earth_radius, c.period)
        if cells is not None:
            pairs = within_cells(pairs, el, cells)
        # A child of footloose calving lies on the rim of its parent until it has drifted off.
        newborn = el.life.fl_k == NEWBORN_CHILD
        return with_both(pairs, ~newborn) if newborn.any() else pairs

    def collisions(self, el: Elements, sizes: Sizes, c: KernelParameters, cells: CellSearch | None = None) -> PairList:
        """Partners of other bergs within reach of contact."""
        if not c.interactions or not (el.berg != el.berg[0]).any():
            return no_pairs(el.size)
        # The largest distance at which two elements can be in contact.
        return self.find(el, max(2.0 * float(sizes.radius.max()), c.contact_distance), OTHER_BERG, c, cells)

    def same_berg(
        self, el: Elements, bonds: Bonds, reach: float, c: KernelParameters, cells: CellSearch | None = None
    ) -> PairList:
        """Unbonded partners of the same berg within ``reach``."""
        return excluding(self.find(el, reach, SAME_BERG, c, cells), self.bonded(el, bonds)[0])


def candidate_pairs(el: Elements, berg: Ints, sizes: Sizes, dt: float, c: KernelParameters) -> tuple[Ints, Ints]:
    """Pairs of elements of different bergs (or fragments, ``berg``), each once, that may come into contact within ``dt`` s."""
    if not c.interactions or el.size < 2 or not (berg != berg[0]).any():
        return NO_PAIRS
    shown, reach = el.shown, np.empty(el.size)
    _fill_reach(shown, sizes.radius, dt, c.contact_distance, reach)
    first, second = near_pairs(shown.lon_pair, shown.lat_pair, berg, reach, c.latlon, c.earth_radius, c.period)
    if first.size == 0:
        return NO_PAIRS
    may_touch = np.empty(first.size, np.bool_)
    _test_paths(shown, el.life.fl_k, sizes.radius, first, second, dt, c, may_touch)
    return first[may_touch], second[may_touch]


@kernel
def _fill_reach(shown: Shown, radius: Floats, dt: float, contact_distance: float, reach: Floats) -> None:
    """Find how far contact of each element may reach in ``dt`` s, m.

    Each as far as it can come by itself: one that is large or quick must not widen the search of all others.
    """
    u, v, count = 0.0, 0.0, radius.size
    for e in range(count):
        u += shown.u_pair[e] / count
        v += shown.v_pair[e] / count
    for e in range(count):
        speed = math.hypot(shown.u_pair[e] - u, shown.v_pair[e] - v)
        path = (1.0 + SPEED_MARGIN) * dt * speed if math.isfinite(speed) else 0.0
        reach[e] = SEARCH_MARGIN * (REACH_FACTOR * max(radius[e], 0.5 * contact_distance) + path)


# Many arguments: what others see, and how far they reach.
@kernel
def _test_paths(
    shown: Shown, foot: Floats, radius: Floats, first: Ints, second: Ints, dt: float, c: KernelParameters,
    may_touch: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Find which pairs may come into contact within ``dt`` s, on straight paths with margins for a change of velocity.

    Each pair is decided by itself, so that the result does not depend on bergs elsewhere. ``foot``: of footloose calving.
    """
    lon, lat = shown.lon_pair, shown.lat_pair
    for k in range(first.size):
        i, j = first[k], second[k]
        dx, dy = separation(lon[i], lat[i], lon[j], lat[j], c.latlon, c.earth_radius, c.period)
        du, dv = shown.u_pair[i] - shown.u_pair[j], shown.v_pair[i] - shown.v_pair[j]
        squared = du * du + dv * dv
        when = min(max(-(dx * du + dy * dv) / squared, 0.0), dt) if squared > 0.0 else 0.0
        nearest = math.hypot(dx + when * du, dy + when * dv)
        touching = max(radius[i] + radius[j], c.contact_distance)
        # A child of footloose calving lies on the rim of its parent until it has drifted off.
        newborn = foot[i] == NEWBORN_CHILD or foot[j] == NEWBORN_CHILD
        may_touch[k] = not newborn and nearest < REACH_FACTOR * touching + SPEED_MARGIN * math.sqrt(squared) * dt


def with_partners(pairs: PairList, allowed: np.ndarray) -> PairList:
    """Return ``pairs`` with only those partners that are allowed (Q21: partners with fewer than ``max_bonds`` bonds)."""
    return _selected(pairs, allowed[pairs.partner])


def with_both(pairs: PairList, allowed: np.ndarray) -> PairList:
    """Return the pairs whose two elements are both allowed."""
    return _selected(pairs, allowed[pairs.partner] & allowed[_owners(pairs)])


def within_cells(pairs: PairList, el: Elements, cells: CellSearch) -> PairList:
    """Return ``pairs`` with only those whose cells are so near to each other."""
    i, j, owner = el.place.cell_i, el.place.cell_j, _owners(pairs)
    across, up = np.abs(i[owner] - i[pairs.partner]), np.abs(j[owner] - j[pairs.partner])
    if cells.cyclic_columns:
        across = np.minimum(across, cells.cyclic_columns - across)
    return _selected(pairs, (across <= cells.columns) & (up <= cells.rows))


def excluding(pairs: PairList, excluded: PairList) -> PairList:
    """Return ``pairs`` without the pairs of ``excluded``."""
    count = pairs.start.size - 1
    excluded_keys = _owners(excluded) * count + excluded.partner
    return _selected(pairs, ~np.isin(_owners(pairs) * count + pairs.partner, excluded_keys))


def _owners(pairs: PairList) -> Ints:
    """Return the element to whose list each entry belongs."""
    return np.repeat(np.arange(pairs.start.size - 1), np.diff(pairs.start))


def _selected(pairs: PairList, chosen: NDArray[np.bool_]) -> PairList:
    """Return ``pairs`` with some of their entries."""
    number = np.bincount(_owners(pairs)[chosen], minlength=pairs.start.size - 1)
    return PairList(np.concatenate([[0], np.cumsum(number)]), pairs.partner[chosen])


CONTACT_STEP: Final = 0.4
"""Longest sub-step times the frequency of a contact: below what damped contact is stable with (0.57)."""


def group_substeps(run: RunState, sizes: Sizes, first: Ints, second: Ints) -> Ints:
    """Return the number of sub-steps of each element in a long step.

    Bergs that may come into contact go through the sub-steps together, in the largest number that one of them needs, or
    that the stiffest of their contacts does.
    """
    el, alone = run.elements, run.elements.body.substeps
    if first.size == 0:
        return alone
    needed = contact_substeps(run, sizes, first, second)
    numbers, berg = numbered(el.berg)
    group = connected_parts(numbers.size, berg[first], berg[second], np.zeros(first.size, np.int64))[berg]
    most = np.zeros(int(group.max()) + 1, np.int64)
    np.maximum.at(most, group, alone)
    np.maximum.at(most, group[first], needed)
    return most[group]


def contact_substeps(run: RunState, sizes: Sizes, first: Ints, second: Ints) -> Ints:
    """Return the number of sub-steps that the contact of each pair needs in a long step.

    A power of 2, so that few groups differ, and one pair hardly changes its number from step to step.
    """
    c, rest = run.constants, sizes.radius[first] + sizes.radius[second]
    stiffness = np.full(first.size, c.contact_spring) if c.contact_spring >= 0.0 else c.modulus / rest**2
    needed = run.parameters.time_step * np.sqrt(stiffness) / CONTACT_STEP
    return np.asarray(2.0 ** np.ceil(np.log2(np.maximum(needed, 1.0)))).astype(np.int64)


def contact_rows(el: Elements, pairs: PairList, sizes: Sizes, p: KernelParameters) -> tuple[Ints, Ints]:
    """Elements of the pairs of a list that are within reach of contact, each pair once."""
    if pairs.partner.size == 0:
        return NO_PAIRS
    shown = el.shown
    in_reach = _in_reach(shown.lon_pair, shown.lat_pair, sizes.radius, pairs, p)
    first = np.repeat(np.arange(el.size), np.diff(pairs.start))
    once = in_reach & (first < pairs.partner)
    return first[once], pairs.partner[once]


def concatenate_pairs(pairs: Sequence[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    """Return the pairs of several lists as one."""
    filled = [pair for pair in pairs if pair[0].size]
    if not filled:
        return NO_PAIRS
    return np.concatenate([pair[0] for pair in filled]), np.concatenate([pair[1] for pair in filled])


def contact_groups(el: Elements, collisions: PairList, radius: Floats, p: KernelParameters) -> Ints:
    """Number the groups of bergs that are within reach of each other, directly or by way of others; ``radius`` in m."""
    if (el.body.berg == el.body.berg[:1]).all():
        return np.zeros(0, np.int64)
    numbers, berg = numbered(el.body.berg)
    shown = el.shown
    in_reach = _in_reach(shown.lon_pair, shown.lat_pair, radius, collisions, p)
    owner = np.repeat(np.arange(el.size), np.diff(collisions.start))[in_reach]
    first, second = berg[owner], berg[collisions.partner[in_reach]]
    return connected_parts(numbers.size, first, second, np.zeros(first.size, np.int64))[berg]


@kernel
def _in_reach(x: Floats, y: Floats, radius: Floats, pairs: PairList, p: KernelParameters) -> NDArray[np.bool_]:
    """Whether the elements of each pair of the list are as near as forces between bergs reach (equations 5.2)."""
    in_reach = np.zeros(pairs.partner.size, np.bool_)
    for e in range(pairs.start.size - 1):
        for k in range(pairs.start[e], pairs.start[e + 1]):
            c = pairs.partner[k]
            rx, ry = separation(x[e], y[e], x[c], y[c], p.latlon, p.earth_radius, p.period)
            reach = max(radius[e] + radius[c], p.contact_distance)
            in_reach[k] = rx * rx + ry * ry < reach * reach
    return in_reach
