"""One step of rigid bodies in a few compiled calls: to its end before the environment is known there, and the moment after it.

To hand the arrays of a berg of some hundred elements to compiled code takes as long as its laws do, so the parts of a step
(`riftberg.stepping.bodies.pose`, `riftberg.stepping.bodies.dynamics`) are called together. All room comes from Python
(`riftberg.compiled.kernels.borrower`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints, Motion, Shown
from riftberg.stepping.bodies.pose import Bodies, find_element_motion, mean_bend, move_frames, place, without_mean
from riftberg.stepping.bodies.dynamics import (
    Acting,
    BodyMotion,
    BodyRoom,
    Booleans,
    Loading,
    Touching,
    add_contact,
    add_forces,
    add_inertia_and_floor,
    allocate_loading,
    check_passes,
    close_step,
    fill_loading,
    find_held,
    invert,
    keep_forces,
    open_step,
    take_velocities,
)
from riftberg.stepping.contact.groups import NOBODY
from riftberg.stepping.contact.islands import Meeting
from riftberg.stepping.forces.media import FORCES, MEDIA, Seen
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.lattice.equilibrium import balance_loads


class Standing(NamedTuple):
    """All that is known at one time: bodies, forces at their velocities, and the balanced loads of the lattice (N, N, N m).

    ``force`` are the forces on the elements (N, N, N m), with the drag of the sea floor.
    """

    time: float
    bodies: Bodies
    motion: BodyMotion
    acting: Acting
    force: Floats
    load: Floats


def depart(
    el: Elements, now: Standing, seat: Floats, h: float, p: KernelParameters, room: BodyRoom, met: Meeting | None = None
) -> Bodies:
    """Move fragments over ``h`` s, with the velocities that they have in the middle of the step; elements are placed.

    ``seat``: displacements that elements are placed with (shape (elements, 3)).
    """
    bodies, motion = now.bodies, now.motion
    some, mean = (met.bodies, met.mean) if met else (NOBODY[0], bodies.rate[:0])
    rate, pose = np.empty_like(bodies.rate), np.empty_like(bodies.pose)
    _depart(
        bodies, seat, motion.elements, motion.mobility, motion.floor, now.acting.total, h, p.latlon, p.earth_radius,
        p.period, el.body.static, el.place.lon, el.place.lat, el.motion.rotation, rate, pose, some, mean,
        room,
    )  # fmt: skip
    return Bodies(bodies.body, bodies.shape, pose, rate, bodies.bend)


@borrower
def _depart(
    bodies: Bodies, seat: Floats, motion: Floats, mobility: Floats, floor: Floats, total: Floats, h: float, latlon: bool,
    radius: float, period: float, static: Floats, lon: Floats, lat: Floats, rotation: Floats, rate: Floats, pose: Floats,
    met: Ints, mean: Floats, room: BodyRoom,
) -> None:  # fmt: skip
    """See `depart`."""
    body = bodies.body
    open_step(mobility, floor, bodies.rate, total, 0.5 * h, rate, room)
    for k in range(met.size):
        for i in range(3):
            rate[met[k], i] = mean[k, i]
    move_frames(bodies.pose, rate, h, latlon, radius, pose, room.small[0])
    for e in range(body.size):
        m, q = motion[e], rate[body[e]]
        rotation[e] += h * (m[6] * q[0] + m[7] * q[1] + m[8] * q[2])
    place(Bodies(body, bodies.shape, pose, rate, seat), lon, lat, static, latlon, radius, period)


def motion_at(
    el: Elements, sizes: Sizes, bodies: Bodies, touching: Touching, p: KernelParameters, room: BodyRoom
) -> BodyMotion:
    """Find what moves the fragments, from the environment that the elements carry; all of them are free to move."""
    count = bodies.pose.shape[0]
    load, elements = allocate_loading(el, p), np.empty((el.size, 11))
    inertia, floor, mobility = np.zeros((3, count, 3, 3))
    # The groups that it needs: to hand the whole state to compiled code takes longer than the forces of a small berg.
    seen, acts, nothing = Seen(el.place, el.body, el.environment), np.ones(len(MEDIA), np.bool_), np.empty((1, 0, 0))
    _find_motion(seen, sizes, p, bodies, elements, load, acts, nothing, inertia, floor, mobility, room)
    return BodyMotion(bodies.body, elements, load, touching, inertia, mobility, floor)


@borrower
def _find_motion(
    el: Seen, sizes: Sizes, p: KernelParameters, bodies: Bodies, motion: Floats, load: Loading, acts: Booleans,
    nothing: Floats, inertia: Floats, floor: Floats, mobility: Floats, room: BodyRoom,
) -> None:  # fmt: skip
    """See `motion_at`."""
    find_element_motion(bodies, p.latlon, p.earth_radius, motion)
    fill_loading(el, sizes, p, acts, nothing, load)
    add_inertia_and_floor(bodies.body, motion, load, inertia, floor)
    invert(inertia, mobility, room.small)


def arrive(
    el: Elements, flat: Floats, bodies: Bodies, motion: BodyMotion, time: float, before: Floats | None, half: float,
    room: BodyRoom,
) -> Standing:  # fmt: skip
    """Find velocities, forces and loads of a moment; all elements take on the velocities of their fragments.

    ``flat``: places of the elements in their fragments, m (shape (elements, 2)); ``before``: velocities at the start of
    the step (shape (fragments, 3)); ``half``: half the step, s.
    """
    opened, closes = bodies.rate, before is not None
    rate = opened if before is None else 2.0 * opened - before
    count = el.size
    acted, total = np.zeros((count, len(FORCES), 2)), np.zeros_like(rate)
    force, load, sums = np.empty((count, 3)), np.empty((count, 3)), np.empty((rate.shape[0], 7))
    passes = _arrive(
        bodies.body, motion.elements, motion.load, motion.touching, motion.inertia, motion.mobility, motion.floor, flat,
        opened, rate, half, closes, acted, total, force, load, el.motion, el.shown, el.kicks.spin_rate, sums, room,
    )  # fmt: skip
    check_passes(passes)
    return Standing(time, bodies._replace(rate=rate), motion, Acting(acted, total), force, load)


@borrower
def _arrive(
    body: Ints, elements: Floats, load: Loading, touching: Touching, inertia: Floats, mobility: Floats, floor: Floats,
    flat: Floats, opened: Floats, rate: Floats, half: float, closes: bool, acted: Floats, total: Floats, force: Floats,
    balanced: Floats, own: Motion, shown: Shown, spin_rate: Floats, sums: Floats, room: BodyRoom,
) -> int:  # fmt: skip
    """See `arrive`; returns passes of Newton's method, -1 where velocities do not settle."""
    passes = 0
    if closes:
        room.sought[:] = True
        passes = close_step(body, elements, load, inertia, mobility, floor, opened, rate, half, room)
    add_forces(body, elements, rate, load, acted, force, total)
    if touching.first.size > 0:
        add_contact(body, elements, rate, touching, force, total)
    take_velocities(body, elements, rate, load, force, own, shown)
    for b in range(rate.shape[0]):
        turning = 0.0
        for i in range(3):
            f = total[b, i]
            for j in range(3):
                f -= floor[b, i, j] * rate[b, j]
            turning += mobility[b, 2, i] * f
        room.miss[b, 2] = turning
    for e in range(body.size):
        spin_rate[e] = room.miss[body[e], 2]
    balance_loads(body, flat, elements, 9, force, load.mass, load.inertia, rate, sums, balanced)
    return passes


def close_alone(motion: BodyMotion, opened: Floats, before: Floats, half: float, met: Ints, room: BodyRoom) -> Floats:
    """Find the velocities at the end of a step of the fragments that touched no other, as `arrive` does.

    ``opened``, ``before``: velocities in the middle and at the start of the step (shape (fragments, 3)); ``half``: half
    the step, s.
    """
    rate, m = 2.0 * opened - before, motion
    room.sought[:] = True
    room.sought[met] = False
    check_passes(close_step(m.body, m.elements, m.load, m.inertia, m.mobility, m.floor, opened, rate, half, room))
    return rate


def relax(bodies: Bodies, load: Loading, flat: Floats, bend: Floats, rotation: Floats, shifted: Booleans) -> bool:
    """Take the mean displacement off the displacements ``bend`` of an equilibrium, in place, and turn the elements by it.

    ``flat``: places of the elements in their fragments, m (shape (elements, 2)); ``bend``:  (shape (elements, 3));
    ``rotation``: of the elements, rad (shape (elements,)); ``shifted``: fragments that keep their mean displacement:
    those with supports (shape (fragments,)).
    """
    count = bodies.pose.shape[0]
    mean, first = np.empty((count, 3)), np.empty((count, 4))
    return bool(_relax(bodies.body, flat, bend, bodies.bend, rotation, load.mass, load.inertia, shifted, mean, first))


@borrower
def _relax(
    body: Ints, flat: Floats, bend: Floats, before: Floats, rotation: Floats, mass: Floats, inertia: Floats,
    shifted: Booleans, mean: Floats, first: Floats,
) -> bool:  # fmt: skip
    """See `relax`."""
    for e in range(body.size):
        for i in range(3):
            if not np.isfinite(bend[e, i]):
                return False
    mean_bend(body, flat, bend, mass, inertia, mean, first)
    for b in range(mean.shape[0]):
        if shifted[b]:
            mean[b, :] = 0.0
    without_mean(body, flat, bend, mean, first)
    for e in range(body.size):
        rotation[e] += bend[e, 2] - before[e, 2]
    return True


def keep_applied_forces(
    before: Standing, after: Standing, half: float, part: float, applied: Floats, room: BodyRoom
) -> None:
    """Add to ``applied`` the forces of a step: those of both its ends, by their ``part`` of the long step.

    ``half``: half the step, s.
    """
    middle, held = np.empty_like(before.bodies.rate), np.empty_like(before.bodies.rate)
    first, last = before.motion, after.motion
    _keep_applied(
        first.body, first.elements, first.load.floor, first.mobility, first.floor, before.bodies.rate, before.acting,
        last.elements, last.load.floor, last.mobility, last.floor, after.bodies.rate, after.acting, half, part, middle,
        held, applied, room,
    )  # fmt: skip


@borrower
def _keep_applied(
    body: Ints, motion: Floats, grip: Floats, mobility: Floats, floor: Floats, rate: Floats, acting: Acting,
    last_motion: Floats, last_grip: Floats, last_mobility: Floats, last_floor: Floats, last_rate: Floats, last: Acting,
    half: float, part: float, middle: Floats, held: Floats, applied: Floats, room: BodyRoom,
) -> None:  # fmt: skip
    """See `keep_applied_forces`."""
    open_step(mobility, floor, rate, acting.total, half, middle, room)
    find_held(mobility, floor, acting.total, middle, half, held, room.small)
    keep_forces(body, motion, acting.acted, grip, held, part, applied)
    find_held(last_mobility, last_floor, last.total, last_rate, half, held, room.small)
    keep_forces(body, last_motion, last.acted, last_grip, held, part, applied)
