"""Fragments that meet in a quasi-static step: only they take short steps, island by island.

Bodies that may touch each other in a step, directly or by way of others, make an island. Each island goes through the step
by itself (`riftberg.stepping.contact.island_step`). Bodies that touch nothing on the way take the long step as if nobody were
near; the others get their velocities at its end, and what that makes of the forces, here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import plain
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.bodies.dynamics import BodyMotion, Loading, add_forces, add_totals_and_slopes
from riftberg.stepping.contact.island_step import cross_islands
from riftberg.stepping.forces.interactions import pair_law
from riftberg.stepping.forces.media import FORCES
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fragments.connectivity import connected_parts


class Islands(NamedTuple):
    """Bodies that may meet, island by island.

    ``members`` are bodies, those of island k from ``start[k]`` to ``start[k + 1]``; ``rows`` their elements, from
    ``row_start[k]``; ``own`` the place of each element's body in its island. ``first`` and ``second`` are places in the rows
    of the island of the pairs that may meet, those of island k from ``pair_start[k]``; ``order`` are their places in the list
    that was given.
    """

    members: Ints
    start: Ints
    rows: Ints
    row_start: Ints
    own: Ints
    first: Ints
    second: Ints
    pair_start: Ints
    order: Ints


class Blow(NamedTuple):
    """The heaviest load by contact that each bonded fragment bore in a step, on its elements ``rows`` (N, N, N m).

    ``turn`` are cosine and sine of the fragment's axis against east then, for each row; ``spin`` is that of each of
    ``bodies`` (rad s-1).
    """

    rows: Ints
    force: Floats
    turn: Floats
    bodies: Ints
    spin: Floats


class Meeting(NamedTuple):
    """What contact made of a step, for the ``bodies`` that touched others and their elements ``rows``."""

    bodies: Ints
    rows: Ints
    mean: Floats  # Velocities on the way and at the end; shape (bodies, 3)
    rate: Floats  # Velocities on the way and at the end; shape (bodies, 3)
    applied: Floats  # Changes of velocity by all forces but contact, m s-1; shape (rows, forces, 2)
    first: Ints  # Elements of the pairs that touched, each once
    second: Ints  # Elements of the pairs that touched, each once
    shortest: float  # Shortest sub-step, s
    blow: Blow


def find_islands(body: Ints, count: int, first: Ints, second: Ints) -> Islands:
    """Find the islands among ``count`` bodies by the pairs of elements that may meet, each once."""
    part = connected_parts(count, body[first], body[second], np.zeros(first.size, np.int64))
    some = np.zeros(count, bool)
    some[body[first]] = some[body[second]] = True
    members = np.flatnonzero(some)
    members = members[np.argsort(part[members], kind="stable")]
    numbers, start = np.unique(part[members], return_index=True)
    place = np.zeros(count, np.int64)
    place[members] = np.arange(members.size) - np.repeat(start, np.diff(np.append(start, members.size)))
    rows = np.flatnonzero(some[body])
    rows = rows[np.argsort(part[body[rows]], kind="stable")]
    row_start = np.searchsorted(part[body[rows]], numbers)
    at = np.zeros(body.size, np.int64)
    at[rows] = np.arange(rows.size) - np.repeat(row_start, np.diff(np.append(row_start, rows.size)))
    island = part[body[first]]
    # Within an island in the order of the rows: what happens elsewhere has no say.
    order = np.lexsort((second, first, island))
    return Islands(
        members, np.append(start, members.size), rows, np.append(row_start, rows.size), place[body[rows]],
        at[first[order]], at[second[order]], np.append(np.searchsorted(island[order], numbers), order.size), order,
    )  # fmt: skip


def meet(
    el: Elements, motion: BodyMotion, rate: Floats, first: Ints, second: Ints, span: float, sizes: Sizes,
    p: KernelParameters,
) -> Meeting | None:  # fmt: skip
    """Take the bodies that may meet through ``span`` s.

    ``rate``: velocities at the start (shape (bodies, 3)).
    """
    if first.size == 0:
        return None
    count = motion.mobility.shape[0]
    i = find_islands(motion.body, count, first, second)
    one, other = first[i.order], second[i.order]
    members, rows = i.members, i.rows
    bonded = np.bincount(motion.body, minlength=count)[members] > 1
    shown = el.shown
    touched, moved, after, applied, force, turn, spin, shortest = cross_islands(
        i.start, i.row_start, i.own, i.first, i.second, i.pair_start, motion.elements[rows], _on(rows, motion.load),
        motion.inertia[members], motion.mobility[members], motion.floor[members], rate[members], bonded,
        shown.lon_pair[one], shown.lat_pair[one], shown.lon_pair[other], shown.lat_pair[other],
        sizes.radius[one] + sizes.radius[other], np.minimum(sizes.mass[one], sizes.mass[other]), span,
        plain(pair_law)(p),
    )  # fmt: skip
    if not shortest > 0.0:
        raise FloatingPointError
    if not touched.any():
        return None
    took_part = np.zeros(count, bool)
    took_part[motion.body[one[touched]]] = took_part[motion.body[other[touched]]] = True
    mine, inside = took_part[members], took_part[motion.body[rows]]
    struck = mine & bonded
    hit = np.zeros(count, bool)
    hit[members[struck]] = True
    beaten = hit[motion.body[rows]]
    blow = Blow(rows[beaten], force[beaten], turn[beaten], members[struck], spin[struck])
    return Meeting(
        members[mine], rows[inside], moved[mine] / span, after[mine], applied[inside], one[touched], other[touched],
        shortest, blow,
    )  # fmt: skip


def caught_up(
    meeting: Meeting, before: BodyMotion, after: BodyMotion, rate: Floats, span: float
) -> tuple[Floats, Meeting]:
    """Give bodies that met their velocities, with half of what the media at the end of the step make different.

    Held media are those of the start; with this, they are taken by the trapezoidal rule.

    ``rate``: velocities at the end of the bodies that did not meet (shape (bodies, 3)); ``span``: length of the step,
    s.
    """
    some, rows, half = meeting.bodies, meeting.rows, 0.5 * span
    place = np.empty(rate.shape[0], np.int64)
    place[some] = np.arange(some.size)
    own, everybody = place[after.body[rows]], np.ones(some.size, np.bool_)
    start, end = (_OfSome(own, m.elements[rows], _on(rows, m.load)) for m in (before, after))
    new, mobility = meeting.rate.copy(), after.mobility[some]
    (old, was), (acted, now) = _forces(start, new), _forces(end, new)
    for _ in range(2):  # Newton's method, from what is nearly right
        unused, slope = np.zeros(new.shape), np.zeros((*new.shape, 3))
        add_totals_and_slopes(own, end.elements, new, end.load, everybody, unused, slope)
        matrix = np.eye(3) + half * mobility @ slope
        pushed = half * mobility @ (now - was)[:, :, None]
        new += np.linalg.solve(matrix, pushed + (meeting.rate - new)[:, :, None])[:, :, 0]
        acted, now = _forces(end, new)
    rate[some] = new
    return rate, meeting._replace(rate=new, applied=meeting.applied + half * (acted - old))


class _OfSome(NamedTuple):
    """What moves some bodies at one moment, as in `BodyMotion`: their elements' bodies and motion, and what acts on these."""

    own: Ints
    elements: Floats
    load: Loading


def _on(rows: Ints, load: Loading) -> Loading:
    """Return what acts on some elements."""
    return load._replace(**{name: part[rows] for name, part in load._asdict().items() if not isinstance(part, bool)})


def _forces(moment: _OfSome, rate: Floats) -> tuple[Floats, Floats]:
    """Accelerations of the elements by each medium, and the forces on the bodies, at these velocities."""
    count = moment.own.size
    acted, force, total = np.zeros((count, len(FORCES), 2)), np.empty((count, 3)), np.zeros(rate.shape)
    add_forces(moment.own, moment.elements, rate, moment.load, acted, force, total)
    return acted, total


def blow_on_all(blow: Blow, elements: int, bodies: int) -> tuple[Floats, Floats, Floats]:
    """Force (N, N, N m) on all elements, cosine and sine of their axes, and spins of all bodies (rad s-1); 0 where no blow is."""
    force, turn, spin = np.zeros((elements, 3)), np.zeros((elements, 2)), np.zeros(bodies)
    force[blow.rows], turn[blow.rows], spin[blow.bodies] = blow.force, blow.turn, blow.spin
    return force, turn, spin
