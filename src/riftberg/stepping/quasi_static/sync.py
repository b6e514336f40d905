"""Bodies of a run in which elements came, went, were moved or parted between two steps.

A fragment to which nothing has happened keeps its body, whatever is born or melts away elsewhere: a body made anew from the
positions of its elements would take their displacements by load into its reference coordinates, again and again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import rows_of
from riftberg.stepping.bodies.pose import Bodies, bodies_from_elements, place_elements, split_bodies
from riftberg.stepping.fragments.connectivity import connected_parts


class StepSnapshot(NamedTuple):
    """The elements at the end of a step; arrays of shape (elements,)."""

    id: Ints
    lon: Floats  # Degrees or m
    lat: Floats
    u: Floats  # m s-1
    v: Floats
    spin: Floats  # rad s-1
    static: Floats  # Supports
    free_y: Floats
    load_x: Floats  # Given forces, N
    load_y: Floats

    def is_current(self, el: Elements) -> bool:
        """Whether nothing of this has changed since."""
        return self.id.size == el.size and bool(_are_equal(_arrays_of(el), self))


@borrower
def _are_equal(now: StepSnapshot, then: StepSnapshot) -> bool:
    """Whether all numbers of as many elements are equal."""
    for k in range(len(now.id)):
        if (
            now.id[k] != then.id[k] or now.lon[k] != then.lon[k] or now.lat[k] != then.lat[k] or now.u[k] != then.u[k]
            or now.v[k] != then.v[k] or now.spin[k] != then.spin[k] or now.static[k] != then.static[k]
            or now.free_y[k] != then.free_y[k] or now.load_x[k] != then.load_x[k] or now.load_y[k] != then.load_y[k]
        ):  # fmt: skip
            return False
    return True


def _arrays_of(el: Elements) -> StepSnapshot:
    place, motion, body = el.place, el.motion, el.body
    return StepSnapshot(
        body.id, place.lon, place.lat, motion.u, motion.v, motion.spin, body.static, body.free_y, body.load_x, body.load_y
    )  # fmt: skip


def take_snapshot(el: Elements) -> StepSnapshot:
    """Return a copy of the elements as they are."""
    return StepSnapshot._make([array.copy() for array in _arrays_of(el)])


def sync_bodies(
    el: Elements, bonds: Bonds, old: Bodies, snapshot: StepSnapshot, p: KernelParameters
) -> tuple[Bodies, NDArray[np.bool_]]:
    """Return the bodies of the elements as they are now, and which of them have to take the velocity of their elements.

    A fragment that is as it was keeps its body. Where elements went, or bonds broke, the pieces get bodies of their own with
    the reference coordinates that they had. Where elements were born, bonded to others or moved, the body is made anew from
    the positions of its elements, less their displacements by load. The velocity of the elements counts where they were
    born, pushed or held.
    """
    body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
    count = int(body.max()) + 1
    row, known = rows_of(snapshot.id, el.body.id)
    now = _arrays_of(el)
    differs = {name: a != b[row] for name, a, b in zip(StepSnapshot._fields, now, snapshot, strict=True)}
    moved = ~known | differs["lon"] | differs["lat"]
    pushed = ~known | differs["u"] | differs["v"] | differs["spin"] | differs["static"] | differs["free_y"]

    # A fragment comes from one old body (``source``), unless some of its elements were moved or came from several.
    anew, source, last = np.zeros(count, bool), np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    anew[body[moved]] = True
    np.minimum.at(source, body, old.body[row])
    np.maximum.at(last, body, old.body[row])
    anew |= source != last
    whole = ~anew & (np.bincount(body, minlength=count) == np.bincount(old.body)[source])

    new = Bodies(
        body, np.zeros((el.size, 3)), np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros((el.size, 3))
    )  # fmt: skip
    stays = whole[body]
    new.reference[stays], new.displacement[stays] = old.reference[row[stays]], old.displacement[row[stays]]
    new.pose[whole], new.twist[whole] = old.pose[source[whole]], old.twist[source[whole]]
    parted = ~anew & ~whole
    if parted.any():
        inside = parted[body]
        was = row[inside]
        of_old = Bodies(old.body[was], old.reference[was], old.pose, old.twist, old.displacement[was])
        numbers, mass = _renumbered(parted)[body[inside]], el.body.mass[inside]
        _insert(new, parted, split_bodies(of_old, numbers, mass, p.latlon, p.earth_radius))
    if anew.any():
        inside = anew[body]
        lon, lat = _without_load(el, old, snapshot, row, known, p)
        made = bodies_from_elements(
            lon[inside], lat[inside], _renumbered(anew)[body[inside]], el.body.mass[inside], p.latlon, p.earth_radius,
            p.period,
        )  # fmt: skip
        _insert(new, anew, made)
    unknown = anew.copy()
    unknown[body[pushed]] = True
    return new, unknown


def _renumbered(chosen: NDArray[np.bool_]) -> Ints:
    """New numbers 0, 1, ... of some fragments, by their old ones."""
    return np.asarray(np.cumsum(chosen) - 1, np.int64)


def _insert(new: Bodies, chosen: NDArray[np.bool_], made: Bodies) -> None:
    """Write the bodies of some fragments to their places among all."""
    inside = chosen[new.body]
    new.reference[inside], new.displacement[inside] = made.reference, made.displacement
    new.pose[chosen], new.twist[chosen] = made.pose, made.twist


def _without_load(
    el: Elements, old: Bodies, snapshot: StepSnapshot, row: Ints, known: NDArray[np.bool_], p: KernelParameters
) -> tuple[Floats, Floats]:
    """Positions of the elements now, less the displacements by load that they had at the end of the step."""
    lon, lat = snapshot.lon.copy(), snapshot.lat.copy()
    undeformed = old._replace(displacement=np.zeros_like(old.displacement))
    place_elements(undeformed, lon, lat, np.zeros(lon.size), p.latlon, p.earth_radius, p.period)
    return (
        el.place.lon - np.where(known, (snapshot.lon - lon)[row], 0.0),
        el.place.lat - np.where(known, (snapshot.lat - lat)[row], 0.0),
    )
