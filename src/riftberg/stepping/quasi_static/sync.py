"""Bodies of a run in which elements came, went, were moved or parted between two steps.

A fragment to which nothing has happened stays as it is, whatever is born or melts away elsewhere: to make its body anew from
where its elements stand would take its displacements by load for its shape, again and again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.numbering import rows_of
from riftberg.stepping.bodies.pose import Bodies, free_bodies, place, regrouped
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.fragments.connectivity import connected_parts


class Left(NamedTuple):
    """Elements as a step has left them: identifiers, places (degrees or m), motion (m s-1, rad s-1), supports, loads (N)."""

    id: Ints
    lon: Floats
    lat: Floats
    u: Floats
    v: Floats
    spin: Floats
    static: Floats
    free_y: Floats
    load_x: Floats
    load_y: Floats

    def is_still(self, el: Elements) -> bool:
        """Whether the elements are as they were left."""
        return all(now.tobytes() == then.tobytes() for now, then in zip(_of(el), self, strict=True))


def _of(el: Elements) -> Left:
    place, motion, body = el.place, el.motion, el.body
    return Left(
        body.id, place.lon, place.lat, motion.u, motion.v, motion.spin, body.static, body.free_y, body.load_x, body.load_y
    )  # fmt: skip


def left_by(el: Elements) -> Left:
    """Return a copy of the elements as they are."""
    return Left._make([array.copy() for array in _of(el)])


def followed(
    el: Elements, bonds: Bonds, old: Bodies, left: Left, p: KernelParameters
) -> tuple[Bodies, NDArray[np.bool_]]:
    """Return the bodies of the elements as they are now, from those that a step has left.

    A fragment that is as it was keeps its body. Where elements went, or bonds broke, the pieces get bodies of their own with
    the shape that they had. Where elements were born, bonded to others or moved, the fragment is made anew from the places of
    its elements without the displacements that load had given them.

    Returns ``unknown``: fragments whose velocity is not in ``bodies``: that of their elements counts, which were born,
    pushed or held.
    """
    body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
    count = int(body.max()) + 1
    row, known = rows_of(left.id, el.body.id)
    now = _of(el)
    other = dict(zip(Left._fields, (a != b[row] for a, b in zip(now, left, strict=True)), strict=True))
    moved = ~known | other["lon"] | other["lat"]
    pushed = ~known | other["u"] | other["v"] | other["spin"] | other["static"] | other["free_y"]
    source, anew = _sources(body, count, old.body[row], moved)
    whole = ~anew & (np.bincount(body, minlength=count) == np.bincount(old.body)[source])
    new = Bodies(
        body, np.zeros((el.size, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((el.size, 3))
    )  # fmt: skip
    stays = whole[body]
    new.shape[stays], new.bend[stays] = old.shape[row[stays]], old.bend[row[stays]]
    new.pose[whole], new.rate[whole] = old.pose[source[whole]], old.rate[source[whole]]
    parted = ~anew & ~whole
    if parted.any():
        inside = parted[body]
        kept = row[inside]
        of_old = Bodies(old.body[kept], old.shape[kept], old.pose, old.rate, old.bend[kept])
        mass = el.body.mass[inside]
        inertia = 0.5 * mass * interaction_sizes(el, p).bond_radius[inside] ** 2
        _put(new, parted, regrouped(of_old, _numbers(parted)[body[inside]], mass, inertia, p.latlon, p.earth_radius))
    if anew.any():
        inside = anew[body]
        lon, lat = _without_load(el, old, left, row, known, p)
        made = free_bodies(
            lon[inside], lat[inside], _numbers(anew)[body[inside]], el.body.mass[inside], p.latlon, p.earth_radius, p.period
        )  # fmt: skip
        _put(new, anew, made)
    unknown = anew.copy()
    unknown[body[pushed]] = True
    return new, unknown


def _sources(body: Ints, count: int, before: Ints, moved: NDArray[np.bool_]) -> tuple[Ints, NDArray[np.bool_]]:
    """Body that each fragment was a part of, and which fragments must be made anew: moved ones and those of several bodies."""
    anew, lowest, highest = np.zeros(count, bool), np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    anew[body[moved]] = True
    np.minimum.at(lowest, body, before)
    np.maximum.at(highest, body, before)
    return lowest, anew | (lowest != highest)


def _numbers(some: NDArray[np.bool_]) -> Ints:
    """New numbers 0, 1, ... of some fragments, by their old ones."""
    return np.asarray(np.cumsum(some) - 1, np.int64)


def _put(new: Bodies, some: NDArray[np.bool_], made: Bodies) -> None:
    """Write the bodies of some fragments where they belong."""
    inside = some[new.body]
    new.shape[inside], new.bend[inside] = made.shape, made.bend
    new.pose[some], new.rate[some] = made.pose, made.rate


def _without_load(
    el: Elements, old: Bodies, left: Left, row: Ints, known: NDArray[np.bool_], p: KernelParameters
) -> tuple[Floats, Floats]:
    """Places of the elements now, less the displacements by load with which the step has left them."""
    lon, lat = left.lon.copy(), left.lat.copy()
    straight = old._replace(bend=np.zeros_like(old.bend))
    place(straight, lon, lat, np.zeros(lon.size), p.latlon, p.earth_radius, p.period)
    return (
        el.place.lon - np.where(known, (left.lon - lon)[row], 0.0),
        el.place.lat - np.where(known, (left.lat - lat)[row], 0.0),
    )
