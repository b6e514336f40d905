"""Bergs of one element that meet nobody in a time step: a path of their own, so that a population costs what it must.

Events cut the time step of the bergs that they happen to: a contact anywhere would otherwise divide the step of all bergs.
A lone berg has no lattice, and its matrices are numbers: the two half kicks of `riftberg.stepping.bodies.dynamics` with

    W = 1 + z + z^2 / 2,   P = 1 + z / 2,   z = h c / 2

where c is the linear drag of the sea floor (s-1). Its results are those of `TimeStep` to round-off. Where something happens to
it, land or a change between afloat and aground, it is put back to the start and goes with the others.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.ocean.cells import settle_elements
from riftberg.state import Floats, Ints
from riftberg.state.population import Population, cut_out
from riftberg.stepping.bodies.dynamics import (
    MAX_ITERATIONS,
    Booleans,
    ElementForcing,
    allocate_forcing,
    check_converged,
    drag_and_jacobian,
    evaluate_forcing,
    has_converged,
    longest_trial_step,
    relative_change,
    spin_torque,
)
from riftberg.stepping.bodies.pose import Bodies, move_poses, place_elements
from riftberg.stepping.contact.broad_phase import candidate_pairs
from riftberg.stepping.contact.faces import FaceContact
from riftberg.stepping.contact.land import land_corrections
from riftberg.stepping.forces.media import CORIOLIS, MEDIA, SEA_FLOOR, ForcedElements
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.run_state import RunState

MIN_LONE_BERGS = 2000
"""Lone bergs from which on they go by themselves: with fewer it costs as much to copy the others out and back."""


def find_lone_bergs(model: RunState, bodies: Bodies, sizes: Sizes, faces: FaceContact) -> tuple[Ints, Booleans] | None:
    """Return the rows of lone bergs, and which other elements belong to fragments that nobody may touch in a time step.

    None where they are too few, or fewer than the others.
    """
    el, body = model.elements, bodies.body
    least = max(MIN_LONE_BERGS, el.size // 2 + 1)
    if el.size < least or np.count_nonzero(alone := np.bincount(body)[body] == 1) < least:
        return None
    alone &= (el.body.static < 0.5) & (el.body.free_y >= 0.5)
    if model.constants.interactions:
        sizes = sizes._replace(radius=np.maximum(sizes.radius, faces.reach(model)))
    meets = np.zeros(bodies.pose.shape[0], np.bool_)
    for rows in candidate_pairs(el, body, sizes, model.parameters.stepping.time_step, model.constants):
        meets[body[rows]] = True
    unreachable = ~meets[body]
    lone = np.flatnonzero(alone & unreachable)
    return (lone, unreachable & ~alone) if lone.size >= least else None


def run_of(model: RunState, rows: Ints) -> tuple[RunState, Ints]:
    """Return a run of some of the elements, as copies, and the rows of their bonds."""
    elements, bonds, bond_rows = cut_out(model.elements, model.bonds, rows)
    some = RunState(
        Population(elements, bonds), model.forcing, model.parameters, model.constants, model.fragments, model.start, model.time,
        model.step_number, model.contacts, model.outlines, model.laws,
    )  # fmt: skip
    return some, bond_rows


def bodies_of(bodies: Bodies, rows: Ints) -> tuple[Bodies, Ints]:
    """Return the bodies of some elements, and their numbers among all; all elements of a body must be among them."""
    numbers, body = np.unique(bodies.body[rows], return_inverse=True)
    some = Bodies(body, bodies.reference[rows], bodies.pose[numbers], bodies.twist[numbers], bodies.displacement[rows])
    return some, numbers


def joined_bodies(body: Ints, parts: tuple[tuple[Ints, Bodies], ...]) -> Bodies:
    """Return all bodies, ``body`` of each element, from those of parts of the elements, given with their rows."""
    count = int(body.max()) + 1
    reference, displacement = np.empty((2, body.size, 3))
    pose, twist = np.empty((count, 3, 3)), np.empty((count, 3))
    for rows, part in parts:
        reference[rows], displacement[rows] = part.reference, part.displacement
        pose[body[rows]], twist[body[rows]] = part.pose[part.body], part.twist[part.body]
    return Bodies(body, reference, pose, twist, displacement)


class LoneStep(NamedTuple):
    """What a time step has made of lone bergs."""

    rows: Ints  # Those to which nothing happened
    bodies: Bodies


def step_lone_bergs(
    model: RunState, bodies: Bodies, unknown: Booleans | None, lone: Ints, sizes: Sizes, applied: Floats
) -> LoneStep:
    """Take lone bergs through a time step; all other elements stay as they are.

    ``unknown``: bodies that take the velocities of their elements; None where all are as the last step has left them.
    ``applied`` takes the mean accelerations of lone bergs to which nothing happens, shape (elements, forces, 2).
    """
    el, c, grid, stepping = model.elements, model.constants, model.forcing.grid, model.parameters.stepping
    start = [array.copy() for group in (el.place, el.shown, el.environment) for array in group]
    own = bodies.body[lone]
    mine = Bodies(
        np.arange(lone.size), bodies.reference[lone], bodies.pose[own], bodies.twist[own], bodies.displacement[lone]
    )
    if unknown is not None:
        mine.twist[unknown[own]] = np.column_stack([el.u, el.v, el.spin])[lone[unknown[own]]]
    twist, pose, turned = mine.twist, mine.pose, np.zeros(lone.size)
    static, lon, lat = np.zeros(lone.size), el.lon[lone], el.lat[lone]
    middle, scratch, spin_rate = np.empty_like(twist), np.empty((3, 3)), np.zeros(lone.size)
    forcing, after = allocate_forcing(el, c), allocate_forcing(el, c)
    _evaluate(model, sizes, forcing)
    aground = forcing.aground > 0.0
    happened = np.zeros(el.size, np.bool_)
    dt = stepping.time_step
    parts = math.ceil(dt / longest_trial_step(forcing, dt) - 1e-9)
    h = dt / parts
    for n in range(parts):
        _kick(lone, twist, forcing, 0.5 * h, 0.5 / parts, middle, applied)
        new = np.empty_like(pose)
        move_poses(pose, middle, h, c.latlon, c.earth_radius, new, scratch)
        pose = new
        moved = Bodies(mine.body, mine.reference, pose, middle, mine.displacement)
        place_elements(moved, lon, lat, static, c.latlon, c.earth_radius, c.period)
        el.place.lon[lone], el.place.lat[lone] = lon, lat
        turned += h * middle[:, 2]
        if grid is not None:
            far_lon, far_lat = el.lon.copy(), el.lat.copy()
            settle_elements(el, grid.arrays, c)
            happened |= land_corrections(el, far_lon, far_lat, c).any(axis=1)
            lon, lat = el.lon[lone], el.lat[lone]
        model.forcing.sample(el, model.time + (n + 1) * h)
        _evaluate(model, sizes, after)
        if stepping.landing_steps > 1:  # else touch-down is no event
            happened |= (after.aground > 0.0) != aground
        twist = 2.0 * middle - twist  # first guess: the second half changes it as the first has done
        check_converged(_solve(lone, middle, twist, after, 0.5 * h, 0.5 / parts, spin_rate, applied))
        forcing, after = after, forcing
    quiet = ~happened[lone]
    rows, twist = lone[quiet], twist[quiet]
    stays = np.ones(el.size, np.bool_)
    stays[rows] = False
    others = np.flatnonzero(stays)  # a few: found once, not for each array
    for array, before in zip((a for group in (el.place, el.shown, el.environment) for a in group), start, strict=True):
        array[others] = before[others]
    u, v, spin = twist.T
    motion, shown = el.motion, el.shown
    for array, values in (
        (motion.u, u), (motion.v, v), (motion.u_sync, u), (motion.v_sync, v), (motion.spin, spin), (shown.u_pair, u),
        (shown.v_pair, v), (shown.lon_pair, lon[quiet]), (shown.lat_pair, lat[quiet]), (el.kicks.spin_rate, spin_rate[quiet]),
    ):  # fmt: skip
        array[rows] = values
    motion.rotation[rows] += turned[quiet]
    if not quiet.all():
        applied[lone[~quiet]] = 0.0
    return LoneStep(
        rows,
        Bodies(np.arange(rows.size), mine.reference[quiet], pose[quiet], twist, mine.displacement[quiet]),
    )


def _evaluate(model: RunState, sizes: Sizes, forcing: ElementForcing) -> None:
    """Take the coefficients of all forces from the environment that the elements carry."""
    el = model.elements
    seen = ForcedElements(el.place, el.body, el.environment)
    evaluate_forcing(seen, sizes, model.constants, np.ones(len(MEDIA), np.bool_), np.empty((1, 0, 0)), forcing)


@kernel
def _acceleration(
    forcing: ElementForcing, e: int, u: float, v: float, part: float, applied: Floats
) -> tuple[float, float, float, float, float, float]:
    """Acceleration (m s-2) of an element by all forces but the linear drag of the sea floor, with what follows from it.

    Then come minus its derivatives xx, xy and yy (s-1), and the Coriolis parameter, which enters beside xy with both signs.
    ``part`` of each acceleration goes into ``applied``, if it is not 0. Forces are summed in the order of
    `riftberg.stepping.bodies.dynamics.add_forces`.
    """
    media, mass = forcing.media, forcing.mass
    ax = ay = jxx = jxy = jyy = f = 0.0
    if forcing.media_act:
        f = forcing.coriolis[e]
        ax, ay = f * v, -f * u
        if part != 0.0:
            applied[e, CORIOLIS, 0] += part * ax
            applied[e, CORIOLIS, 1] += part * ay
    for k in range(len(MEDIA)):
        if forcing.media_act or (k == SEA_FLOOR and forcing.floor_acts):
            dx, dy, dxx, dxy, dyy, _ = drag_and_jacobian(media[e, k], u, v)
            ax += dx
            ay += dy
            jxx += dxx
            jxy += dxy
            jyy += dyy
            if part != 0.0:
                applied[e, k, 0] += part * dx
                applied[e, k, 1] += part * dy
    return ax + forcing.push_x[e] / mass[e], ay + forcing.push_y[e] / mass[e], jxx, jxy, jyy, f


@kernel
def _apply_floor(
    forcing: ElementForcing, e: int, u: float, v: float, ax: float, ay: float, half_dt: float, part: float, applied: Floats
) -> None:  # fmt: skip
    """Add ``part`` of the linear drag of the sea floor in half a step to (u, v), under other forces (ax, ay).

    At the velocity of `riftberg.stepping.bodies.dynamics.mean_drag_velocity`.
    """
    c = forcing.floor_rate[e]
    if c > 0.0:
        applied[e, SEA_FLOOR, 0] -= part * c * (u + 0.5 * half_dt * (c * u - ax))
        applied[e, SEA_FLOOR, 1] -= part * c * (v + 0.5 * half_dt * (c * v - ay))


@kernel
def _kick(
    rows: Ints, twist: Floats, forcing: ElementForcing, half_dt: float, part: float, new: Floats, applied: Floats
) -> None:
    """First half kick: velocities ``new`` at mid-step; ``part`` of the accelerations goes into ``applied``."""
    for n in range(rows.size):
        e = rows[n]
        u, v, w = twist[n, 0], twist[n, 1], twist[n, 2]
        ax, ay, _, _, _, _ = _acceleration(forcing, e, u, v, part, applied)
        torque, _ = spin_torque(forcing, e, w)
        z, zs = half_dt * forcing.floor_rate[e], half_dt * forcing.floor_spin_rate[e]
        decay, kick = 1.0 + z + 0.5 * z * z, half_dt * (1.0 + 0.5 * z)
        new[n, 0], new[n, 1] = (u + kick * ax) / decay, (v + kick * ay) / decay
        new[n, 2] = (w + half_dt * (1.0 + 0.5 * zs) * torque / forcing.inertia[e]) / (1.0 + zs + 0.5 * zs * zs)
        _apply_floor(forcing, e, new[n, 0], new[n, 1], ax, ay, half_dt, part, applied)


@kernel
def _solve(
    rows: Ints, middle: Floats, twist: Floats, forcing: ElementForcing, half_dt: float, part: float, spin_rate: Floats,
    applied: Floats,
) -> int:  # fmt: skip
    """Second half kick: velocities at the end, in ``twist``, by Newton's method from those at mid-step and a first guess.

    Returns the most iterations, -1 where they do not converge.
    """
    most = 0
    for n in range(rows.size):
        e = rows[n]
        mass, inertia = forcing.mass[e], forcing.inertia[e]
        arm = math.sqrt(inertia / mass)
        z, zs = half_dt * forcing.floor_rate[e], half_dt * forcing.floor_spin_rate[e]
        decay, kick = 1.0 + z + 0.5 * z * z, half_dt * (1.0 + 0.5 * z)
        decay_spin, kick_spin = 1.0 + zs + 0.5 * zs * zs, half_dt * (1.0 + 0.5 * zs) / inertia
        u, v, w, before, iterations = twist[n, 0], twist[n, 1], twist[n, 2], 0.0, 0
        while True:
            if iterations == MAX_ITERATIONS:
                return -1
            ax, ay, jxx, jxy, jyy, f = _acceleration(forcing, e, u, v, 0.0, applied)
            torque, turning = spin_torque(forcing, e, w)
            rx, ry = middle[n, 0] + kick * ax - decay * u, middle[n, 1] + kick * ay - decay * v
            xx, xy, yx, yy = decay + kick * jxx, kick * (jxy - f), kick * (jxy + f), decay + kick * jyy
            determinant = xx * yy - xy * yx
            du, dv = (yy * rx - xy * ry) / determinant, (xx * ry - yx * rx) / determinant
            dw = (middle[n, 2] + kick_spin * torque - decay_spin * w) / (decay_spin + kick_spin * turning)
            u, v, w = u + du, v + dv, w + dw
            iterations += 1
            change = relative_change(du, dv, dw, u, v, w, arm)
            # Velocities that are not numbers end the iteration; the checks of places then say where they came from.
            if has_converged(change, before) or not np.isfinite(u + v + w):
                break
            before = change
        most = max(most, iterations)
        twist[n, 0], twist[n, 1], twist[n, 2] = u, v, w
        ax, ay, _, _, _, _ = _acceleration(forcing, e, u, v, part, applied)
        _apply_floor(forcing, e, u, v, ax, ay, half_dt, part, applied)
        spin_rate[n] = spin_torque(forcing, e, w)[0] / inertia - forcing.floor_spin_rate[e] * w
    return most
