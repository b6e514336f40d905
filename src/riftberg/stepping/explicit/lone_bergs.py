"""Bergs of one element each that meet: sub-steps of their contacts alone (equations 6.4, part 3).

Such bergs need no bond law. Those that may meet each other in a long step, directly or by way of others, make an island,
and each island takes as many sub-steps as the stiffest of its contacts asks. While nothing touches and no force acts in the
sub-steps, its bergs go straight, and many sub-steps are taken at once.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.constants import DEGREE
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import fast_cos_latitude, separation
from riftberg.physics.grounding import grounding_spin_rate
from riftberg.state import Elements, Floats, Ints
from riftberg.state.numbering import numbered
from riftberg.state.variables import Kicks, Motion, Place, Shown
from riftberg.stepping.contact.groups import contact_substeps
from riftberg.stepping.explicit.breaking import contact_acceleration
from riftberg.stepping.forces.interactions import COLLISION, PairLaw, pair_law
from riftberg.stepping.forces.media import LINEAR, QUADRATIC, SEA_FLOOR, Surroundings, grounded_part
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.run_state import RunState

EARLY: Final = 0.02
"""Part of the distance between two bergs that is left to sub-steps: their paths are not quite straight in degrees."""

(
    X, Y, EAST, NORTH, SEEN_EAST, SEEN_NORTH, AX, AY, BX, BY, MOVES, RADIUS, MASS, LINEAR_RATE, QUADRATIC_RATE, TURNING,
    PUSH_EAST, PUSH_NORTH, SPIN, TURNED, STOPPED_EAST, STOPPED_NORTH, NEW_AX, NEW_AY,
) = range(24)  # fmt: skip
"""Rows of the table of an island, one column for each berg: place, velocity, what others see, fast accelerations (explicit
and implicit), 1 where it moves, radius, mass, drag of the sea floor (linear, quadratic, rotational), loads, spin and angle
turned, sums of the decelerations by the sea floor, and the accelerations of this sub-step."""


class Islands(NamedTuple):
    """Bergs of one element that may meet, island by island.

    ``rows`` are their elements, those of island k from ``start[k]`` to ``start[k + 1]``; ``first`` and ``second`` are
    places in ``rows`` of the pairs that may meet, those of island k from ``pair_start[k]``. ``substeps`` are those of
    each island.
    """

    rows: Ints
    start: Ints
    first: Ints
    second: Ints
    pair_start: Ints
    substeps: Ints


def find_islands(
    run: RunState, sizes: Sizes, first: Ints, second: Ints, polar_latitude: float
) -> tuple[Islands | None, NDArray[np.bool_]]:
    """Find the islands among the pairs that may come into contact, and which of the pairs are in none.

    ``polar_latitude``: bergs north of it (degrees) are left to the general sub-steps.
    """
    el = run.elements
    others = np.ones(first.size, np.bool_)
    if first.size == 0 or run.parameters.compatibility.bergs_coupled:
        return None, others
    _, berg = numbered(el.body.berg)
    polar = polar_latitude if run.constants.latlon else np.inf
    others, some, *found = _find_islands(berg, int(berg.max()) + 1, el.place.lat, polar, first, second)
    if some.size == 0:
        return None, others
    islands = Islands(*found, np.zeros(0, np.int64))
    most = np.maximum.reduceat(contact_substeps(run, sizes, first[some], second[some]), islands.pair_start[:-1])
    return islands._replace(substeps=np.maximum(most, el.body.substeps[islands.rows[islands.start[:-1]]])), others


@kernel
def _find_islands(
    berg: Ints, count: int, lat: Floats, polar: float, first: Ints, second: Ints
) -> tuple[NDArray[np.bool_], Ints, Ints, Ints, Ints, Ints, Ints]:
    """Return which pairs are in no island, those that are, island by island, and the first five fields of `Islands`.

    ``berg`` are numbers below ``count``, of each element. By island, and within one in the order of the rows: what
    happens elsewhere has no say.
    """
    group = connected_parts(count, berg[first], berg[second], np.zeros(first.size, np.int64))
    size, general = np.zeros(count, np.int64), np.zeros(count, np.bool_)
    for e in range(berg.size):
        size[berg[e]] += 1
        if size[berg[e]] > 1 or lat[e] > polar:
            general[group[berg[e]]] = True
    others, meets = np.zeros(first.size, np.bool_), np.zeros(berg.size, np.bool_)
    pairs, rows = np.zeros(count + 1, np.int64), np.zeros(count + 1, np.int64)
    for k in range(first.size):
        g = group[berg[first[k]]]
        others[k] = general[g]
        if not others[k]:
            pairs[g + 1] += 1
            meets[first[k]] = meets[second[k]] = True
    for e in range(berg.size):
        if meets[e]:
            rows[group[berg[e]] + 1] += 1
    islands = 0
    for g in range(count):
        if rows[g + 1] > 0:
            islands += 1
    start, pair_start = np.zeros(islands + 1, np.int64), np.zeros(islands + 1, np.int64)
    islands = 0
    for g in range(count):
        islands += 1 if rows[g + 1] > 0 else 0
        rows[g + 1] += rows[g]
        pairs[g + 1] += pairs[g]
        start[islands], pair_start[islands] = rows[g + 1], pairs[g + 1]
    # From here on `rows` and `pairs` tell where the next one of each group goes.
    row, place = np.empty(rows[count], np.int64), np.empty(berg.size, np.int64)
    for e in range(berg.size):
        if meets[e]:
            g = group[berg[e]]
            row[rows[g]], place[e] = e, rows[g]
            rows[g] += 1
    some = np.empty(pairs[count], np.int64)
    one, other = np.empty(pairs[count], np.int64), np.empty(pairs[count], np.int64)
    for k in range(first.size):
        if not others[k]:
            g = group[berg[first[k]]]
            some[pairs[g]], one[pairs[g]], other[pairs[g]] = k, place[first[k]], place[second[k]]
            pairs[g] += 1
    return others, some, row, start, one, other, pair_start


def collide(
    el: Elements, islands: Islands, sizes: Sizes, around: Surroundings, dt: float, starting: bool, p: KernelParameters
) -> tuple[Ints, Ints]:
    """Take the sub-steps of the islands; returns the rows of the pairs that have touched.

    ``dt``: long step, s.
    """
    body = el.body
    touched = _collide(
        *islands, el.place, el.shown, el.motion, el.kicks, body.static, body.thickness, el.environment.depth, body.load_x,
        body.load_y, sizes.radius, sizes.mass, sizes.bond_radius, sizes.bond_mass, around.media, around.applied, dt,
        starting and p.bonds_on, p,
    )  # fmt: skip
    return islands.rows[islands.first[touched]], islands.rows[islands.second[touched]]


@kernel
def _collide(
    rows: Ints, start: Ints, first: Ints, second: Ints, pair_start: Ints, substeps: Ints, place: Place, shown: Shown,
    motion: Motion, kicks: Kicks, static: Floats, thickness: Floats, depth: Floats, load_x: Floats, load_y: Floats,
    radius: Floats, mass: Floats, bond_radius: Floats, bond_mass: Floats, media: Floats, applied: Floats, dt: float,
    starting: bool, p: KernelParameters,
) -> NDArray[np.bool_]:  # fmt: skip
    """Return which pairs have touched; see `collide`."""
    touched = np.zeros(first.size, np.bool_)
    law = pair_law(p)
    for k in range(start.size - 1):
        begin = start[k]
        b = np.zeros((NEW_AY + 1, start[k + 1] - begin))
        for e in range(b.shape[1]):
            q = rows[begin + e]
            _take(b, e, q, place, shown, motion, kicks)
            b[MOVES, e], b[RADIUS, e], b[MASS, e] = 1.0 if static[q] < 0.5 else 0.0, radius[q], mass[q]
            if p.ground_on_substeps:
                b[LINEAR_RATE, e], b[QUADRATIC_RATE, e] = media[q, SEA_FLOOR, LINEAR], media[q, SEA_FLOOR, QUADRATIC]
            if p.dem:
                per_mass = 1.0 / bond_mass[q]
                b[PUSH_EAST, e], b[PUSH_NORTH, e] = load_x[q] * per_mass, load_y[q] * per_mass
            if p.dem and p.ground_torque:
                fraction = grounded_part(thickness[q], depth[q], p)
                b[TURNING, e] = grounding_spin_rate(p.ground_coefficient, bond_radius[q], bond_mass[q], fraction)
        some = slice(pair_start[k], pair_start[k + 1])
        _take_substeps(b, first[some] - begin, second[some] - begin, touched[some], dt, substeps[k], starting, law, p)
        for e in range(b.shape[1]):
            q = rows[begin + e]
            _give(b, e, q, place, shown, motion, kicks, p.iterate)
            if p.ground_on_substeps:
                applied[q, SEA_FLOOR, 0] = b[STOPPED_EAST, e] / substeps[k]
                applied[q, SEA_FLOOR, 1] = b[STOPPED_NORTH, e] / substeps[k]
    return touched


@stage
def _take(b, e, q, place, shown, motion, kicks):
    """Take place and motion of the element in row ``q`` into the table."""
    b[X, e], b[Y, e], b[EAST, e], b[NORTH, e] = place.lon[q], place.lat[q], motion.u[q], motion.v[q]
    b[SEEN_EAST, e], b[SEEN_NORTH, e] = shown.u_pair[q], shown.v_pair[q]
    b[AX, e], b[AY, e], b[BX, e], b[BY, e] = kicks.ax_fast[q], kicks.ay_fast[q], kicks.bx_fast[q], kicks.by_fast[q]
    b[SPIN, e], b[TURNED, e] = motion.spin[q], motion.rotation[q]


@stage
def _give(b, e, q, place, shown, motion, kicks, remember):
    """Write place and motion from the table into row ``q``."""
    place.lon[q], place.lat[q], motion.u[q], motion.v[q] = b[X, e], b[Y, e], b[EAST, e], b[NORTH, e]
    shown.lon_pair[q], shown.lat_pair[q] = b[X, e], b[Y, e]
    shown.u_pair[q], shown.v_pair[q] = b[SEEN_EAST, e], b[SEEN_NORTH, e]
    kicks.ax_fast[q], kicks.ay_fast[q] = b[AX, e], b[AY, e]
    if remember:
        kicks.ax[q], kicks.ay[q] = b[AX, e], b[AY, e]
    motion.spin[q], motion.rotation[q] = b[SPIN, e], b[TURNED, e]


@kernel
def _take_substeps(
    b: Floats, first: Ints, second: Ints, touched: NDArray[np.bool_], dt: float, substeps: int, starting: bool,
    law: PairLaw, p: KernelParameters,
) -> None:  # fmt: skip
    """Take the sub-steps of one island, many at once while its bergs go free."""
    h = dt / substeps
    forced = False
    for k in (BX, BY, LINEAR_RATE, QUADRATIC_RATE, TURNING, PUSH_EAST, PUSH_NORTH):
        forced = forced or b[k].any()
    if starting:
        _accelerate(b, first, second, touched, 0.0, law, p.max_bonds)
        for e in range(b.shape[1]):
            rate = 0.0 if p.ground_implicit else b[LINEAR_RATE, e]
            b[AX, e] = b[MOVES, e] * (b[NEW_AX, e] - rate * b[EAST, e])
            b[AY, e] = b[MOVES, e] * (b[NEW_AY, e] - rate * b[NORTH, e])
            b[STOPPED_EAST, e] -= 0.5 * b[MOVES, e] * rate * b[EAST, e]
            b[STOPPED_NORTH, e] -= 0.5 * b[MOVES, e] * rate * b[NORTH, e]
            b[TURNED, e] += b[MOVES, e] * h * b[SPIN, e] if p.dem else 0.0
    left = substeps
    while left > 0:
        taken = 1
        if not (forced or b[AX].any() or b[AY].any()):
            taken = _free_substeps(b, first, second, h, left, p)
        _drift(b, h * taken, p)
        _accelerate(b, first, second, touched, 0.0 if p.explicit_contact_damping and p.dem else h, law, p.max_bonds)
        _kick(b, h, h * taken, p)
        left -= taken


@stage
def _free_substeps(b, first, second, h, left, p):
    """Number of sub-steps, at least one, until two bergs nearly touch; they all go straight."""
    soonest = h * left
    for k in range(first.size):
        i, j = first[k], second[k]
        rx, ry = separation(b[X, i], b[Y, i], b[X, j], b[Y, j], p.latlon, p.earth_radius, p.period)
        du = b[MOVES, i] * b[EAST, i] - b[MOVES, j] * b[EAST, j]
        dv = b[MOVES, i] * b[NORTH, i] - b[MOVES, j] * b[NORTH, j]
        reach = max(b[RADIUS, i] + b[RADIUS, j], p.contact_distance)
        distance, closing, squared = math.sqrt(rx * rx + ry * ry), rx * du + ry * dv, du * du + dv * dv
        if distance <= reach:
            return 1
        near = reach + EARLY * (distance - reach)
        inside = closing * closing - squared * (distance * distance - near * near)
        if closing < 0.0 and inside > 0.0:
            soonest = min(soonest, (-closing - math.sqrt(inside)) / squared)
    return max(1, min(left, int(soonest / h)))


@stage
def _drift(b, step, p):
    """Move the bergs by their mid-step velocity, as `riftberg.stepping.explicit.springs.drift`."""
    along = step * (1.0 / (DEGREE * p.earth_radius if p.latlon else 1.0))
    to_degrees = 1.0 if p.latlon else 0.0
    for e in range(b.shape[1]):
        if b[MOVES, e] > 0.0:
            b[SEEN_EAST, e] = b[EAST, e] + 0.5 * step * (b[AX, e] + b[BX, e])
            b[SEEN_NORTH, e] = b[NORTH, e] + 0.5 * step * (b[AY, e] + b[BY, e])
            b[X, e] += along * (b[SEEN_EAST, e] / fast_cos_latitude(to_degrees * b[Y, e]))
            b[Y, e] += along * b[SEEN_NORTH, e]


@stage
def _accelerate(b, first, second, touched, soft_step, law, max_bonds):
    """Find the accelerations of this sub-step: loads, and contact where bergs touch."""
    b[NEW_AX] = 0.0
    b[NEW_AY] = 0.0
    u, v, u_seen, v_seen = b[EAST], b[NORTH], b[SEEN_EAST], b[SEEN_NORTH]
    for k in range(first.size):
        i, j = first[k], second[k]
        rx, ry = separation(b[X, i], b[Y, i], b[X, j], b[Y, j], law.latlon, law.earth_radius, law.period)
        radii = b[RADIUS, i] + b[RADIUS, j]
        reach = max(radii, law.contact_distance)
        if rx * rx + ry * ry >= reach * reach:
            continue
        touched[k] = True
        for end in range(2):
            e, c, s = (i, j, 1.0) if end == 0 else (j, i, -1.0)
            ix, iy = contact_acceleration(
                COLLISION, e, c, s * rx, s * ry, radii, u, v, u_seen, v_seen, b[MASS, e], b[MASS, c], law,
                soft_step * max_bonds,
            )  # fmt: skip
            b[NEW_AX, e] += ix
            b[NEW_AY, e] += iy
    for e in range(b.shape[1]):
        b[NEW_AX, e] += b[PUSH_EAST, e]
        b[NEW_AY, e] += b[PUSH_NORTH, e]


@stage
def _kick(b, h, step, p):
    """Update velocities, spins and angles, as `kick_block` of `riftberg.stepping.explicit.element_blocks` does."""
    for e in range(b.shape[1]):
        if b[MOVES, e] == 0.0:
            continue
        u, v = b[EAST, e], b[NORTH, e]
        rate = b[LINEAR_RATE, e] + b[QUADRATIC_RATE, e] * math.sqrt(u * u + v * v)
        explicit, slow = (0.0, 1.0 / (1.0 + rate * h)) if p.ground_implicit else (rate, 1.0)
        ax, ay = b[NEW_AX, e] - explicit * u, b[NEW_AY, e] - explicit * v
        b[EAST, e] = (u + 0.5 * h * b[AX, e] + 0.5 * h * ax) * slow
        b[NORTH, e] = (v + 0.5 * h * b[AY, e] + 0.5 * h * ay) * slow
        b[AX, e], b[AY, e] = ax, ay
        b[SEEN_EAST, e], b[SEEN_NORTH, e] = b[EAST, e], b[NORTH, e]
        b[STOPPED_EAST, e] -= rate * (b[EAST, e] if p.ground_implicit else u)
        b[STOPPED_NORTH, e] -= rate * (b[NORTH, e] if p.ground_implicit else v)
        if p.dem:
            b[SPIN, e] *= 1.0 / (1.0 + b[TURNING, e] * h)
            b[TURNED, e] += step * b[SPIN, e]
