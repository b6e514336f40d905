"""Bergs of one element each that meet: sub-steps of their contacts alone (equations 6.4, part 3).

Such bergs need no bond law. Those that may meet each other in a long step, directly or by way of others, make an island,
and each island takes as many sub-steps as the stiffest of its contacts needs: in a field of thousands of bergs most islands
are pairs that never touch. While nothing touches and no force acts in the sub-steps, its bergs go straight, and many sub-steps
are taken at once.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.constants import DEGREE
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import numbered
from riftberg.state.variables import Kicks, Motion, Place, Shown
from riftberg.stepping.contact.broad_phase import contact_substeps
from riftberg.stepping.contact.islands import find_islands
from riftberg.stepping.explicit.breaking import Touch, add_contact
from riftberg.stepping.explicit.substeps import POLAR_LATITUDE, drifted, floor_rate_at, kicked, mid_step_velocity
from riftberg.stepping.forces.media import LINEAR, QUADRATIC, SEA_FLOOR, SPIN_LINEAR, Surroundings
from riftberg.stepping.forces.pair_law import COLLISION, PairLaw, pair_law
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.run_state import RunState

EARLY: Final = 0.02
"""Part of the distance between two bergs that is left to sub-steps: their paths are not quite straight in degrees."""

# Rows of the table of an island, one column for each berg. Place (units of the grid) and velocity (m s-1), the velocity that pair
# forces see, inner accelerations before this sub-step, explicit and implicit, and in it (m s-2)
X, Y, U, V, U_PAIR, V_PAIR, AX, AY, BX, BY, NEW_AX, NEW_AY = range(12)
# 1 where it moves, radius (m), mass (kg); drag of the sea floor: linear (s-1), quadratic (m-1), on the spin (s-1)
MOVES, RADIUS, MASS, FLOOR_LINEAR, FLOOR_QUADRATIC, FLOOR_SPIN = range(12, 18)
# Acceleration by steady loads (m s-2), spin (s-1) and angle (rad), sum of the accelerations by the sea floor (m s-2)
LOAD_X, LOAD_Y, SPIN, ANGLE, FLOOR_IMPULSE_X, FLOOR_IMPULSE_Y = range(18, 24)
ROWS: Final = 24


class LoneIslands(NamedTuple):
    """Bergs of one element that may meet, island by island."""

    rows: Ints  # Their elements: those of island k from ``start[k]`` to before ``start[k + 1]``
    start: Ints
    first: Ints  # Pairs that may meet, as places in the rows of their island: those of island k from ``pair_start[k]``
    second: Ints
    pair_start: Ints
    substeps: Ints  # Of each island


def find_lone_islands(
    run: RunState, sizes: Sizes, first: Ints, second: Ints
) -> tuple[LoneIslands | None, NDArray[np.bool_]]:
    """Find the islands among the pairs that may come into contact, and which of the pairs are in none.

    Left to the general sub-steps is what has a berg of several elements in it, or comes near the pole.
    """
    el = run.elements
    if first.size == 0 or run.parameters.compatibility.bergs_coupled:
        return None, np.ones(first.size, np.bool_)
    numbers, berg = numbered(el.body.berg)
    group = connected_parts(numbers.size, berg[first], berg[second], np.zeros(first.size, np.int64))[berg]
    unfit = np.bincount(berg)[berg] > 1
    if run.constants.latlon:
        unfit |= el.place.lat > POLAR_LATITUDE
    general = np.zeros(numbers.size, np.bool_)
    general[group[unfit]] = True
    others = general[group[first]]
    if others.all():
        return None, others
    first, second = first[~others], second[~others]
    found = find_islands(berg, numbers.size, first, second)
    of_pairs = contact_substeps(run, sizes, first, second)[found.order]
    needed = np.maximum.reduceat(of_pairs, found.pair_start[:-1])
    substeps = np.maximum(needed, el.body.substeps[found.rows[found.row_start[:-1]]])
    return LoneIslands(found.rows, found.row_start, found.first, found.second, found.pair_start, substeps), others


def take_substeps_of_islands(
    el: Elements, islands: LoneIslands, sizes: Sizes, around: Surroundings, dt: float, starting: bool, p: KernelParameters
) -> tuple[Ints, Ints]:  # fmt: skip
    """Take the sub-steps of the islands in a long step of ``dt`` seconds; returns the rows of the pairs that have touched."""
    body = el.body
    touched = _take_all(
        *islands, el.place, el.shown, el.motion, el.kicks, body.static, body.load_x, body.load_y, sizes.radius, sizes.mass,
        sizes.bond_mass, around.media, around.applied, dt, starting and p.bonds_on, p,
    )  # fmt: skip
    begin = np.repeat(islands.start[:-1], np.diff(islands.pair_start))[touched]
    return islands.rows[begin + islands.first[touched]], islands.rows[begin + islands.second[touched]]


# Many arguments: the lists of the islands and the groups of the state that sub-steps read and change; each use of the
# whole state would add some hundred lines to what is compiled.
@kernel
def _take_all(
    rows: Ints, start: Ints, first: Ints, second: Ints, pair_start: Ints, substeps: Ints, place: Place, shown: Shown,
    motion: Motion, kicks: Kicks, static: Floats, load_x: Floats, load_y: Floats, radius: Floats, mass: Floats,
    bond_mass: Floats, media: Floats, applied: Floats, dt: float, starting: bool, p: KernelParameters,
) -> NDArray[np.bool_]:  # fmt: skip
    """Gather each island into a table, take its sub-steps, scatter it; returns which pairs have touched."""
    touched = np.zeros(first.size, np.bool_)
    law = pair_law(p)
    for k in range(start.size - 1):
        begin = start[k]
        b = np.zeros((ROWS, start[k + 1] - begin))
        for e in range(b.shape[1]):
            q = rows[begin + e]
            b[X, e], b[Y, e], b[U, e], b[V, e] = place.lon[q], place.lat[q], motion.u[q], motion.v[q]
            b[U_PAIR, e], b[V_PAIR, e] = shown.u_pair[q], shown.v_pair[q]
            b[AX, e], b[AY, e], b[BX, e], b[BY, e] = (
                kicks.ax_fast[q],
                kicks.ay_fast[q],
                kicks.bx_fast[q],
                kicks.by_fast[q],
            )
            b[SPIN, e], b[ANGLE, e] = motion.spin[q], motion.rotation[q]
            b[MOVES, e], b[RADIUS, e], b[MASS, e] = 1.0 if static[q] < 0.5 else 0.0, radius[q], mass[q]
            if p.ground_on_substeps:
                b[FLOOR_LINEAR, e], b[FLOOR_QUADRATIC, e] = media[q, SEA_FLOOR, LINEAR], media[q, SEA_FLOOR, QUADRATIC]
            if p.dem:
                per_mass = 1.0 / bond_mass[q]
                b[LOAD_X, e], b[LOAD_Y, e] = load_x[q] * per_mass, load_y[q] * per_mass
                b[FLOOR_SPIN, e] = media[q, SEA_FLOOR, SPIN_LINEAR]
        some = slice(pair_start[k], pair_start[k + 1])
        _take_substeps(b, first[some], second[some], touched[some], dt, substeps[k], starting, law, p)
        for e in range(b.shape[1]):
            q = rows[begin + e]
            place.lon[q], place.lat[q], motion.u[q], motion.v[q] = b[X, e], b[Y, e], b[U, e], b[V, e]
            shown.lon_pair[q], shown.lat_pair[q] = b[X, e], b[Y, e]
            shown.u_pair[q], shown.v_pair[q] = b[U_PAIR, e], b[V_PAIR, e]
            kicks.ax_fast[q], kicks.ay_fast[q] = b[AX, e], b[AY, e]
            if p.iterate:
                kicks.ax[q], kicks.ay[q] = b[AX, e], b[AY, e]
            motion.spin[q], motion.rotation[q] = b[SPIN, e], b[ANGLE, e]
            if p.ground_on_substeps:
                applied[q, SEA_FLOOR, 0] = b[FLOOR_IMPULSE_X, e] / substeps[k]
                applied[q, SEA_FLOOR, 1] = b[FLOOR_IMPULSE_Y, e] / substeps[k]
    return touched


@kernel
def _take_substeps(
    b: Floats, first: Ints, second: Ints, touched: NDArray[np.bool_], dt: float, substeps: int, starting: bool,
    law: PairLaw, p: KernelParameters,
) -> None:  # fmt: skip
    """Take the sub-steps of one island, many at once while its bergs go free."""
    h = dt / substeps
    forced = False
    for k in (BX, BY, FLOOR_LINEAR, FLOOR_QUADRATIC, FLOOR_SPIN, LOAD_X, LOAD_Y):
        forced = forced or b[k].any()
    if starting:
        # One evaluation without moving, so that the first sub-step has its first half kick.
        _accelerate(b, first, second, touched, 0.0, law, p.max_bonds)
        for e in range(b.shape[1]):
            moves, rate = b[MOVES, e], 0.0 if p.ground_implicit else b[FLOOR_LINEAR, e]
            b[AX, e] = moves * (b[NEW_AX, e] - rate * b[U, e])
            b[AY, e] = moves * (b[NEW_AY, e] - rate * b[V, e])
            b[FLOOR_IMPULSE_X, e] -= 0.5 * moves * rate * b[U, e]
            b[FLOOR_IMPULSE_Y, e] -= 0.5 * moves * rate * b[V, e]
            b[ANGLE, e] += moves * h * b[SPIN, e] if p.dem else 0.0
    left = substeps
    while left > 0:
        taken = 1
        if not (forced or b[AX].any() or b[AY].any()):
            # Without forces all go straight, so many sub-steps can be one until two nearly touch.
            taken = _free_substeps(b, first, second, h, left, p)
        _drift(b, h * taken, p)
        _accelerate(b, first, second, touched, 0.0 if p.explicit_contact_damping and p.dem else h, law, p.max_bonds)
        _kick(b, h, h * taken, p)
        left -= taken


@stage
def _free_substeps(b: Floats, first: Ints, second: Ints, h: float, left: int, p: KernelParameters) -> int:
    """Number of sub-steps, at least one, until two bergs nearly touch; they all go straight."""
    soonest = h * left
    for k in range(first.size):
        i, j = first[k], second[k]
        rx, ry = separation(b[X, i], b[Y, i], b[X, j], b[Y, j], p.latlon, p.earth_radius, p.period)
        du = b[MOVES, i] * b[U, i] - b[MOVES, j] * b[U, j]
        dv = b[MOVES, i] * b[V, i] - b[MOVES, j] * b[V, j]
        reach = max(b[RADIUS, i] + b[RADIUS, j], p.contact_distance)
        distance, closing, squared = math.sqrt(rx * rx + ry * ry), rx * du + ry * dv, du * du + dv * dv
        if distance <= reach:
            return 1
        # The smaller root of |r + v t| = near, where both are that near at all.
        near = reach + EARLY * (distance - reach)
        inside = closing * closing - squared * (distance * distance - near * near)
        if closing < 0.0 and inside > 0.0:
            soonest = min(soonest, (-closing - math.sqrt(inside)) / squared)
    return max(1, min(left, int(soonest / h)))


@stage
def _drift(b: Floats, step: float, p: KernelParameters) -> None:
    """Move the bergs by their mid-step velocity over ``step`` seconds (equations 6.4, 3a)."""
    along = step * (1.0 / (DEGREE * p.earth_radius if p.latlon else 1.0))
    to_degrees = 1.0 if p.latlon else 0.0
    for e in range(b.shape[1]):
        if b[MOVES, e] > 0.0:
            wu, wv, _ = mid_step_velocity(b[U, e], b[V, e], b[AX, e], b[AY, e], b[BX, e], b[BY, e], 0.5 * step, False)
            b[X, e], b[Y, e] = drifted(b[X, e], b[Y, e], wu, wv, along, to_degrees)
            b[U_PAIR, e], b[V_PAIR, e] = wu, wv


@stage
def _accelerate(
    b: Floats, first: Ints, second: Ints, touched: NDArray[np.bool_], soft_step: float, law: PairLaw, max_bonds: int
) -> None:
    """Find the accelerations of this sub-step: contact where bergs touch, and loads."""
    b[NEW_AX] = 0.0
    b[NEW_AY] = 0.0
    for k in range(first.size):
        i, j = first[k], second[k]
        rx, ry = separation(b[X, i], b[Y, i], b[X, j], b[Y, j], law.latlon, law.earth_radius, law.period)
        radii = b[RADIUS, i] + b[RADIUS, j]
        reach = max(radii, law.contact_distance)
        if rx * rx + ry * ry >= reach * reach:
            continue
        touched[k] = True
        pair = Touch(COLLISION, i, j, rx, ry, radii, b[MASS, i], b[MASS, j], True, True)
        add_contact(pair, b[U], b[V], b[U_PAIR], b[V_PAIR], law, soft_step * max_bonds, b[NEW_AX], b[NEW_AY])
    for e in range(b.shape[1]):
        b[NEW_AX, e] += b[LOAD_X, e]
        b[NEW_AY, e] += b[LOAD_Y, e]


@stage
def _kick(b: Floats, h: float, step: float, p: KernelParameters) -> None:
    """Update velocities, spins and angles after a sub-step of ``h`` seconds, or after many that took ``step`` together."""
    for e in range(b.shape[1]):
        if b[MOVES, e] == 0.0:
            continue
        u, v = b[U, e], b[V, e]
        rate = floor_rate_at(b[FLOOR_LINEAR, e], b[FLOOR_QUADRATIC, e], u, v)
        b[U, e], b[V, e], b[AX, e], b[AY, e] = kicked(
            u,
            v,
            b[AX, e],
            b[AY, e],
            b[NEW_AX, e],
            b[NEW_AY, e],
            rate,
            1.0 / (1.0 + rate * h),
            0.5 * h,
            p.ground_implicit,
        )
        b[U_PAIR, e], b[V_PAIR, e] = b[U, e], b[V, e]
        b[FLOOR_IMPULSE_X, e] -= rate * (b[U, e] if p.ground_implicit else u)
        b[FLOOR_IMPULSE_Y, e] -= rate * (b[V, e] if p.ground_implicit else v)
        if p.dem:
            b[SPIN, e] *= 1.0 / (1.0 + b[FLOOR_SPIN, e] * h)
            b[ANGLE, e] += step * b[SPIN, e]
