"""Diagonals of square lattices that are isotropic: springs between elements that meet at a corner.

A lattice of squares without them has half of the shear modulus that E and Poisson's ratio promise. They are no bonds: they have
no facet, no strength and no place in the state. The diagonal from A to C holds as long as one of the ways A-B-C around the
corner is left, of two unbroken bonds, so that any set of broken bonds that parts two pieces frees all diagonals between them.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.bergs.bonding import Metric, separations
from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import partners_over_bonds

RIGHT_ANGLE = 0.5
"""Largest cosine between two bonds of one element that go around a corner; those of one row have 1."""


Rows = NDArray[np.int32]
"""Rows in the state: half of the memory of longer numbers, and there are two diagonals for each element."""


class Diagonals(NamedTuple):
    """Pairs of elements that are joined around a corner, each once."""

    first: Rows  # shape (diagonals,)
    second: Rows
    way: Rows  # Bonds of the two ways around the corner, -1 where there is but one; shape (diagonals, 2, 2)


NO_DIAGONALS = Diagonals(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 2, 2), np.int32))


def find_diagonals(el: Elements, bonds: Bonds, p: KernelParameters) -> Diagonals:
    """Return the diagonals of unbroken square lattices; none where bonds are those of the published model."""
    if not p.isotropic:
        return NO_DIAGONALS
    start, *rows = partners_over_bonds(bonds.first, bonds.second, bonds.status, el.size)
    partner, bond = (each.astype(np.int32) for each in rows)
    around, lon, lat = np.repeat(np.arange(el.size, dtype=np.int32), np.diff(start)), el.place.lon, el.place.lat
    x, y = separations(Metric(p.latlon, p.earth_radius, p.period), lon[partner], lat[partner], lon[around], lat[around])
    length, corners = np.hypot(x, y), np.flatnonzero(np.where(el.body.sides > 0, el.body.sides, p.max_sides) == 4)
    most, found = int(np.diff(start)[corners].max(initial=0)), []
    for m, n in combinations(range(most), 2):  # two bonds of an element, of all elements at once
        e = corners[start[corners] + n < start[corners + 1]]
        one, two = start[e] + m, start[e] + n
        turns = abs((x[one] * x[two] + y[one] * y[two]) / (length[one] * length[two])) < RIGHT_ANGLE
        e, one, two = e[turns], one[turns], two[turns]
        # In order of the elements: which end of a bond is its first one must not matter.
        one, two = np.where(partner[one] < partner[two], (one, two), (two, one))
        found.append((partner[one], partner[two], e, bond[one], bond[two]))
    if not found:
        return NO_DIAGONALS
    first, second, e, along, on = (np.concatenate(each) for each in zip(*found, strict=True))
    order = np.lexsort((e, second, first))
    first, second, ways = first[order], second[order], np.column_stack([along, on])[order]
    again = np.zeros(first.size + 1, np.bool_)
    again[1:-1] = (first[1:] == first[:-1]) & (second[1:] == second[:-1])
    begins = np.flatnonzero(~again[:-1])
    other = np.where(again[begins + 1][:, None], ways[np.minimum(begins + 1, first.size - 1)], np.int32(-1))
    return Diagonals(first[begins], second[begins], np.stack([ways[begins], other], axis=1))


def with_diagonals(
    el: Elements, bonds: Bonds, p: KernelParameters, some: Any = slice(None)
) -> tuple[Ints, Ints, Floats]:
    """Return both ends, and the length at rest (m), of some bonds, and behind them of the diagonals of all unbroken ones."""
    diagonals = find_diagonals(el, bonds, p)
    first = np.concatenate([bonds.first[some], diagonals.first], dtype=np.int64)
    second = np.concatenate([bonds.second[some], diagonals.second], dtype=np.int64)
    return first, second, np.append(bonds.rest_length[some], diagonal_lengths(diagonals, bonds))


@kernel
def holds(way: Rows, d: int, status: Ints) -> bool:
    """Whether a way around the corner of diagonal ``d`` is left."""
    one = status[way[d, 0, 0]] == 0 and status[way[d, 0, 1]] == 0
    return bool(one or (way[d, 1, 0] >= 0 and status[way[d, 1, 0]] == 0 and status[way[d, 1, 1]] == 0))


@kernel
def diagonal_length(way: Rows, d: int, rest: Floats, status: Ints) -> float:
    """Length at rest (m) of diagonal ``d``, by the lengths of the bonds around its corner; not a number where these are not."""
    # By the first way that is left: after a restart it is the first that is found.
    n = 0 if status[way[d, 0, 0]] == 0 and status[way[d, 0, 1]] == 0 else 1
    return math.hypot(rest[way[d, n, 0]], rest[way[d, n, 1]])


def diagonal_lengths(diagonals: Diagonals, bonds: Bonds) -> Floats:
    """Lengths at rest (m) of diagonals: `diagonal_length` of all."""
    left = (bonds.status[diagonals.way[:, 0]] == 0).all(axis=1)
    along, on = np.where(left[:, None], diagonals.way[:, 0], diagonals.way[:, 1]).T
    return np.asarray(np.hypot(bonds.rest_length[along], bonds.rest_length[on]))
