"""Diagonals of square lattices that are isotropic: springs between elements that meet at a corner.

A lattice of squares without them has half of the shear modulus that E and Poisson's ratio promise. They are no bonds: they have
no facet, no strength and no place in the state. The diagonal from A to C holds as long as one of the ways A-B-C around the
corner is left, of two unbroken bonds, so that any set of broken bonds that parts two pieces frees all diagonals between them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.bergs.bonding import Metric, separations
from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import partners_over_bonds

RIGHT_ANGLE = 0.5
"""Largest cosine between two bonds of one element that go around a corner; those of one row have 1."""


class Diagonals(NamedTuple):
    """Pairs of elements that are joined around a corner, each once."""

    first: Ints  # shape (diagonals,)
    second: Ints
    way: Ints  # Bonds of the two ways around the corner, -1 where there is but one; shape (diagonals, 2, 2)


NO_DIAGONALS = Diagonals(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2, 2), np.int64))


def find_diagonals(el: Elements, bonds: Bonds, p: KernelParameters) -> Diagonals:
    """Return the diagonals of unbroken square lattices; none where bonds are those of the published model."""
    if not p.isotropic:
        return NO_DIAGONALS
    start, partner, bond = partners_over_bonds(bonds.first, bonds.second, bonds.status, el.size)
    metric = Metric(p.latlon, p.earth_radius, p.period)
    lon, lat = el.place.lon, el.place.lat
    ways: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for e in np.flatnonzero(np.where(el.body.sides > 0, el.body.sides, p.max_sides) == 4):
        near, own = partner[start[e] : start[e + 1]], bond[start[e] : start[e + 1]]
        x, y = separations(metric, lon[near], lat[near], lon[e], lat[e])
        length = np.hypot(x, y)
        cosine = (np.outer(x, x) + np.outer(y, y)) / np.outer(length, length)
        for m, n in zip(*np.nonzero(np.triu(abs(cosine) < RIGHT_ANGLE, 1)), strict=True):
            # In order of the elements: which end of a bond is its first one must not matter.
            (a, along), (c, on) = sorted([(int(near[m]), int(own[m])), (int(near[n]), int(own[n]))])
            ways.setdefault((a, c), []).append((along, on))
    if not ways:
        return NO_DIAGONALS
    pairs = sorted(ways)
    first, second = np.array(pairs, np.int64).T.copy()
    return Diagonals(first, second, np.array([(*ways[k], (-1, -1))[:2] for k in pairs], np.int64))


@kernel
def holds(way: Ints, d: int, status: Ints) -> bool:
    """Whether a way around the corner of diagonal ``d`` is left."""
    one = status[way[d, 0, 0]] == 0 and status[way[d, 0, 1]] == 0
    return bool(one or (way[d, 1, 0] >= 0 and status[way[d, 1, 0]] == 0 and status[way[d, 1, 1]] == 0))


@kernel
def diagonal_length(way: Ints, d: int, rest: Floats, status: Ints) -> float:
    """Length at rest (m) of diagonal ``d``, by the lengths of the bonds around its corner; not a number where these are not."""
    # By the first way that is left: after a restart it is the first that is found.
    n = 0 if status[way[d, 0, 0]] == 0 and status[way[d, 0, 1]] == 0 else 1
    return math.hypot(rest[way[d, n, 0]], rest[way[d, n, 1]])


def diagonal_lengths(diagonals: Diagonals, bonds: Bonds) -> Floats:
    """Lengths at rest (m) of diagonals."""
    of_all = range(diagonals.first.size)
    return np.array([diagonal_length(diagonals.way, d, bonds.rest_length, bonds.status) for d in of_all])
