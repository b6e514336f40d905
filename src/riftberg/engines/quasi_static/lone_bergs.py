"""Bergs of one element that meet nobody in a time step: a path of their own, so that a population costs what it must.

Events cut the time step of the bergs that they happen to: a contact anywhere would otherwise divide the step of all bergs.
A lone berg has no lattice, and its matrices are numbers: the two half kicks of
`riftberg.engines.quasi_static.bodies.dynamics`, with the drag that a first half kick takes implicitly. Its results are those
of `TimeStep` to round-off. Where land stops it, it is put back to the start and goes with the others.
"""

from __future__ import annotations

import math
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numba import config

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.common.broad_phase import candidate_pairs
from riftberg.engines.common.forces.media import CORIOLIS, LIMIT, MEDIA, QUADRATIC, SEA_ICE, ForcedElements
from riftberg.engines.common.forces.pack import corner_slope, next_direction
from riftberg.engines.common.forces.sizes import Sizes, slice_sizes
from riftberg.engines.common.land import land_corrections
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.dynamics import (
    MAX_ITERATIONS,
    Booleans,
    ElementForcing,
    accumulate_excess,
    allocate_forcing,
    check_converged,
    drag_and_jacobian,
    drag_rates,
    evaluate_forcing,
    excess_rate,
    excess_spin_rate,
    has_converged,
    is_resolved,
    longest_trial_step,
    relative_change,
    spin_torque,
)
from riftberg.engines.quasi_static.bodies.pose import Bodies, move_poses, place_elements
from riftberg.engines.quasi_static.contact.faces import FaceContact
from riftberg.engines.quasi_static.ground.seabed import Seabed
from riftberg.ocean.cells import settle_elements
from riftberg.ocean.forcing import Forcing, WrappedForcing
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import Population, cut_out

MIN_LONE_BERGS = 2000
"""Lone bergs from which on they go by themselves: with fewer it costs as much to copy the others out and back."""

BLOCK = 8192
"""Elements of a block: so few that threads end together, so many that what Python does for each of them does not show."""


def find_lone_bergs(
    model: RunState, bodies: Bodies, sizes: Sizes, faces: FaceContact, seabed: Seabed | None = None
) -> tuple[Ints, Booleans] | None:
    """Return the rows of lone bergs, and which other elements belong to fragments that nobody may touch in a time step.

    Those that a bed of sediment may touch count among those that may meet. None where lone bergs are too few, or fewer than the
    others.
    """
    el, body, h = model.elements, bodies.body, model.parameters.time_step
    least = max(MIN_LONE_BERGS, el.size // 2 + 1)
    if el.size < least or np.count_nonzero(alone := np.bincount(body)[body] == 1) < least:
        return None
    alone &= (el.body.static < 0.5) & (el.body.free_y >= 0.5)
    if model.constants.interactions:
        sizes = sizes._replace(radius=np.maximum(sizes.radius, faces.reach(model)))
    meets = np.zeros(len(bodies.pose), np.bool_) if seabed is None else seabed.find_near_floor(model, bodies, h)
    for rows in candidate_pairs(el, body, sizes, h, model.constants):
        meets[body[rows]] = True
    unreachable = ~meets[body]
    lone = np.flatnonzero(alone & unreachable)
    return (lone, unreachable & ~alone) if lone.size >= least else None


def cut_out_run(model: RunState, rows: Ints, forcing: Any) -> tuple[RunState, Ints]:
    """Return a run of some of the elements, as copies, and the rows of their bonds."""
    elements, bonds, bond_rows = cut_out(model.elements, model.bonds, rows)
    subset = RunState(
        Population(elements, bonds), forcing, model.parameters, model.constants, model.fragments, model.start, model.time,
        model.step_number, model.contacts, model.outlines, model.laws,
    )  # fmt: skip
    return subset, bond_rows


def select_bodies(bodies: Bodies, rows: Ints) -> tuple[Bodies, Ints]:
    """Return the bodies of some elements, and their numbers among all; all elements of a body must be among them."""
    numbers, body = np.unique(bodies.body[rows], return_inverse=True)
    subset = Bodies(
        body, bodies.reference[rows], bodies.pose[numbers], bodies.twist[numbers], bodies.displacement[rows]
    )
    return subset, numbers


def join_bodies(body: Ints, groups: tuple[tuple[Ints, Bodies], ...]) -> Bodies:
    """Join the bodies of groups of elements, given with their rows; ``body``: fragment of each element."""
    count = int(body.max()) + 1
    reference, displacement = np.empty((2, body.size, 3))
    pose, twist = np.empty((count, 3, 3)), np.empty((count, 3))
    for rows, group in groups:
        reference[rows], displacement[rows] = group.reference, group.displacement
        pose[body[rows]], twist[body[rows]] = group.pose[group.body], group.twist[group.body]
    return Bodies(body, reference, pose, twist, displacement)


class LoneStep(NamedTuple):
    """Result of a time step of lone bergs."""

    rows: Ints  # Those to which nothing happened
    bodies: Bodies
    happened: Ints  # The others, which are as they were at the start


class OneAtATime(WrappedForcing):
    """A forcing that the threads of a step share: it samples for one of them at a time, so that it may keep a cache."""

    def __init__(self, forcing: Forcing) -> None:
        super().__init__(forcing)
        self._lock = threading.Lock()

    def sample(self, elements: Elements, time: float) -> None:
        """Fill the environment of the elements."""
        with self._lock:
            self.forcing.sample(elements, time)


def step_lone_bergs(
    model: RunState, forcing: Any, bodies: Bodies, unknown: Booleans | None, lone: Ints, sizes: Sizes, applied: Floats
) -> list[LoneStep]:
    """Take lone bergs through a time step, in blocks that threads share; all other elements stay as they are.

    ``unknown``: bodies that take the velocities of their elements; None where all are as the last step has left them.
    ``applied`` takes the mean accelerations of lone bergs to which nothing happens, shape (elements, forces, 2).
    """
    el, dt, lone_body = model.elements, model.parameters.time_step, bodies.body[lone]
    twist = bodies.twist[lone_body]
    if unknown is not None:
        twist[unknown[lone_body]] = np.column_stack([el.u, el.v, el.spin])[lone[unknown[lone_body]]]
    blocks = []
    for first in range(0, el.size, BLOCK):
        in_block = slice(*np.searchsorted(lone, (first, first + BLOCK)))
        rows, numbers = lone[in_block], lone_body[in_block]
        of_block = Bodies(
            np.arange(rows.size),
            bodies.reference[rows],
            bodies.pose[numbers],
            twist[in_block],
            bodies.displacement[rows],
        )
        blocks.append(_Block(model, slice(first, first + BLOCK), rows - first, of_block, sizes, applied))
    with ThreadPoolExecutor(config.NUMBA_NUM_THREADS) as pool:  # type: ignore[attr-defined]
        substeps = math.ceil(dt / min(pool.map(_Block.longest_step, blocks)) - 1e-9)
        for n in range(substeps):
            list(pool.map(lambda block: block.predict(substeps), blocks))
            # A forcing may draw numbers for all elements of a cell, in whatever block they are.
            forcing.sample(el, model.time + (n + 1) * dt / substeps)
            list(pool.map(lambda block: block.correct(substeps), blocks))
        return list(pool.map(_Block.finish, blocks))


class _Block:
    """Elements that follow one another, with the lone bergs among them, ``lone``, on their way through a time step."""

    def __init__(
        self, model: RunState, block: slice, lone: Ints, bodies: Bodies, sizes: Sizes, applied: Floats
    ) -> None:  # fmt: skip
        self.el, self.sizes, self.first = model.elements.view_rows(block), slice_sizes(sizes, block), block.start
        self.model, self.c, self.stepping = model, model.constants, model.parameters.stepping
        self.lone, self.bodies, self.applied = lone, bodies, applied[block]
        # Arrays that a step overwrites for all elements of the block, lone or not.
        self.restored = [array for group in (self.el.place, self.el.shown, self.el.environment) for array in group]
        self.start = [array.copy() for array in self.restored]
        self.lon, self.lat = self.el.lon[lone], self.el.lat[lone]
        self.middle, self.turned, self.spin_rate = np.empty_like(bodies.twist), np.zeros(lone.size), np.zeros(lone.size)
        self.happened = np.zeros(self.el.size, np.bool_)

    def longest_step(self) -> float:
        """Evaluate the forces at the start; returns the longest trial step that they allow, s."""
        self.forcing = allocate_forcing(self.el, self.c)
        self._evaluate()
        return longest_trial_step(self.forcing, self.model.parameters.time_step)

    def predict(self, substeps: int) -> None:
        """Take the first half kick of one of some parts of the step, and drift to its end."""
        el, c, lone, (body, reference, pose, twist, displacement) = self.el, self.c, self.lone, self.bodies
        h, new, grid = self.model.parameters.time_step / substeps, np.empty_like(pose), self.model.forcing.grid
        _kick(lone, twist, self.forcing, 0.5 * h, 0.5 / substeps, self.middle, self.applied)
        move_poses(pose, self.middle, h, c.latlon, c.earth_radius, new, np.empty((3, 3)))
        self.bodies = moved = Bodies(body, reference, new, twist, displacement)
        place_elements(moved, self.lon, self.lat, np.zeros(lone.size), c.latlon, c.earth_radius, c.period)
        el.place.lon[lone], el.place.lat[lone] = self.lon, self.lat
        self.turned += h * self.middle[:, 2]
        if grid is not None:
            far_lon, far_lat = el.lon.copy(), el.lat.copy()
            settle_elements(el, grid.arrays, c)
            self.happened |= land_corrections(el, far_lon, far_lat, c).any(axis=1)
            self.lon, self.lat = el.lon[lone], el.lat[lone]

    def correct(self, substeps: int) -> None:
        """Take the second half kick, with the forces at the new place and time."""
        self._evaluate()
        half_dt, twist = 0.5 * self.model.parameters.time_step / substeps, self.bodies.twist
        twist[:] = 2.0 * self.middle - twist  # first guess: the second half changes it as the first has done
        check_converged(
            _solve(self.lone, self.middle, twist, self.forcing, half_dt, 0.5 / substeps, self.spin_rate, self.applied)
        )

    def finish(self) -> LoneStep:
        """Leave the lone bergs at the end of the step, all others as they were at its start."""
        el, lone, (_, reference, pose, twist, displacement) = self.el, self.lone, self.bodies
        quiet = ~self.happened[lone]
        rows, (u, v, spin) = lone[quiet], twist[quiet].T
        stays = np.ones(el.size, np.bool_)
        stays[rows] = False
        others = np.flatnonzero(stays)  # a few: found once, not for each array
        for array, initial in zip(self.restored, self.start, strict=True):
            array[others] = initial[others]
        self.applied[lone[~quiet]] = 0.0
        motion, shown = el.motion, el.shown
        for array, values in (
            (motion.u, u), (motion.v, v), (motion.u_sync, u), (motion.v_sync, v), (motion.spin, spin), (shown.u_pair, u),
            (shown.v_pair, v), (shown.lon_pair, self.lon[quiet]), (shown.lat_pair, self.lat[quiet]),
            (el.kicks.spin_rate, self.spin_rate[quiet]),
        ):  # fmt: skip
            array[rows] = values
        motion.rotation[rows] += self.turned[quiet]
        bodies = Bodies(np.arange(rows.size), reference[quiet], pose[quiet], twist[quiet], displacement[quiet])
        return LoneStep(self.first + rows, bodies, self.first + lone[~quiet])

    def _evaluate(self) -> None:
        """Take the coefficients of all forces from the environment that the elements carry."""
        seen = ForcedElements(self.el.place, self.el.body, self.el.environment)
        evaluate_forcing(seen, self.sizes, self.c, np.ones(len(MEDIA), np.bool_), np.empty((1, 0, 0)), self.forcing)


@kernel
def _acceleration(
    forcing: ElementForcing, e: int, u: float, v: float, weight: float, applied: Floats
) -> tuple[float, float, float, float, float, float, float, float]:
    """Acceleration (m s-2) of an element by all forces, with what follows from it.

    Then come minus its derivatives xx, xy and yy (s-1), the Coriolis parameter, which enters beside xy with both signs, the
    drag per velocity through the media (s-1), and the growth of this drag with the velocity (m-1).
    ``weight`` of each acceleration goes into ``applied``, if it is not 0. Forces are summed in the order of
    `riftberg.engines.quasi_static.bodies.dynamics.add_forces`.
    """
    media, mass = forcing.media, forcing.mass
    ax = ay = jxx = jxy = jyy = f = rate = quadratic = 0.0
    if forcing.media_act:
        f = forcing.coriolis[e]
        ax, ay = f * v, -f * u
        if weight != 0.0:
            applied[e, CORIOLIS, 0] += weight * ax
            applied[e, CORIOLIS, 1] += weight * ay
    for k in range(len(MEDIA)):
        if forcing.media_act:
            dx, dy, dxx, dxy, dyy, of_medium = drag_and_jacobian(media[e, k], u, v)
            ax += dx
            ay += dy
            jxx += dxx
            jxy += dxy
            jyy += dyy
            rate += of_medium
            quadratic += media[e, k, QUADRATIC]
            if weight != 0.0:
                applied[e, k, 0] += weight * dx
                applied[e, k, 1] += weight * dy
    return ax + forcing.push_x[e] / mass[e], ay + forcing.push_y[e] / mass[e], jxx, jxy, jyy, f, rate, quadratic


@borrower
def _kick(
    rows: Ints, twist: Floats, forcing: ElementForcing, half_dt: float, weight: float, new: Floats, applied: Floats
) -> None:
    """First half kick: velocities ``new`` at mid-step; ``weight`` of the accelerations goes into ``applied``."""
    for n in range(rows.size):
        e = rows[n]
        u, v, w = twist[n, 0], twist[n, 1], twist[n, 2]
        ax, ay, _, _, _, _, rate, quadratic = _acceleration(forcing, e, u, v, weight, applied)
        torque, turning = spin_torque(forcing, e, w)
        inertia = forcing.inertia[e]
        rates = rate, 0.0
        if not is_resolved(rate, quadratic, ax, ay, half_dt):
            rates = drag_rates(forcing, e, u, v, math.hypot(ax, ay), quadratic)
        spin_rate = max(0.5 * turning / inertia, math.sqrt(forcing.spin_drag[e] * abs(torque / inertia)))
        excess, excess_spin = excess_rate(rates[0], half_dt), excess_spin_rate(spin_rate, half_dt)
        new[n, 0] = (u + half_dt * (ax + excess * u)) / (1.0 + half_dt * excess)
        new[n, 1] = (v + half_dt * (ay + excess * v)) / (1.0 + half_dt * excess)
        new[n, 2] = (w + half_dt * (torque / inertia + excess_spin * w)) / (1.0 + half_dt * excess_spin)
        du, dv = new[n, 0] - u, new[n, 1] - v
        accumulate_excess(forcing, e, (u, v), (du, dv), rates, half_dt, weight, applied)


@kernel
def _solve(
    rows: Ints, middle: Floats, twist: Floats, forcing: ElementForcing, half_dt: float, weight: float, spin_rate: Floats,
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
        kick_spin = half_dt / inertia
        u, v, w, previous_change, iterations = twist[n, 0], twist[n, 1], twist[n, 2], 0.0, 0
        ice, px, py = forcing.media[e, SEA_ICE], 0.0, 0.0
        while True:
            if iterations == MAX_ITERATIONS:
                return -1
            ax, ay, jxx, jxy, jyy, f, _, _ = _acceleration(forcing, e, u, v, 0.0, applied)
            torque, turning = spin_torque(forcing, e, w)
            rx, ry = middle[n, 0] + half_dt * ax - u, middle[n, 1] + half_dt * ay - v
            xx, xy, yx, yy = 1.0 + half_dt * jxx, half_dt * (jxy - f), half_dt * (jxy + f), 1.0 + half_dt * jyy
            if ice[LIMIT] > 0.0:
                factor, dx, dy = corner_slope(ice, u, v)
                xx, xy = xx - half_dt * factor * px * dx, xy - half_dt * factor * px * dy
                yx, yy = yx - half_dt * factor * py * dx, yy - half_dt * factor * py * dy
            determinant = xx * yy - xy * yx
            du, dv = (yy * rx - xy * ry) / determinant, (xx * ry - yx * rx) / determinant
            dw = (middle[n, 2] + kick_spin * torque - w) / (1.0 + kick_spin * turning)
            if ice[LIMIT] > 0.0:
                px, py = next_direction(ice, (px, py), (u, v), (du, dv))
            u, v, w = u + du, v + dv, w + dw
            iterations += 1
            change = relative_change(du, dv, dw, u, v, w, arm)
            # Velocities that are not numbers end the iteration; the checks of places then say where they came from.
            if has_converged(change, previous_change) or not np.isfinite(u + v + w):
                break
            # Beside a corner one small change tells nothing of the next.
            previous_change = 0.0 if ice[LIMIT] > 0.0 else change
        most = max(most, iterations)
        twist[n, 0], twist[n, 1], twist[n, 2] = u, v, w
        _acceleration(forcing, e, u, v, weight, applied)
        spin_rate[n] = spin_torque(forcing, e, w)[0] / inertia
    return most
