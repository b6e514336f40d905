"""Fragments on the floor: rigid motion in sub-steps, as long as the floor lets them be.

    M (V1 - V0) = h (G(V) + sum B^T f),    V = (V0 + V1) / 2,    position: by V

with the media G and the forces f of the floor in the middle of the sub-step. Friction is an anchor of each element
(`riftberg.engines.quasi_static.keel_friction`), at V1: backward Euler, so that a held fragment comes to rest in any step.

A sub-step goes so: ask for the depth in its middle, press the keel onto the floor there, find the velocity after it with the
friction of that press; ask for the depth at its end, press again. It is accepted if by the greater of both forces the floor
changes the velocity by little, or if it holds the fragment; else it begins anew with a part of its length, as where touching or
coming free would not be met within a minute. What the floor holds is pressed once, as it stands at the end. `advance` takes all
fragments up to where they need the depth at another place, which Python asks for all of them at once.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.engines.common.bed import Bed
from riftberg.engines.common.forces.media import FORCES, SEA_FLOOR
from riftberg.engines.quasi_static.bodies.dynamics import (
    BodyMatrices,
    ElementForcing,
    add_forces,
    assemble_force_and_jacobian,
    take_elements,
)
from riftberg.engines.quasi_static.bodies.pose import Bodies, fill_levers, move_poses
from riftberg.engines.quasi_static.contact.anchors import GIVES_WAY
from riftberg.engines.quasi_static.contact.islands import SubcycledMotion
from riftberg.engines.quasi_static.ground.pads import Pads, fill_hulls, place_points
from riftberg.engines.quasi_static.ground.plate import Plates
from riftberg.engines.quasi_static.ground.press import (
    HOLD,
    LIFT,
    LOAD,
    LOAD_X,
    LOAD_Y,
    PRESSED,
    PUSH_X,
    PUSH_Y,
    SPREAD_XX,
    SPREAD_YY,
    STRESS,
    YIELD,
    press,
)
from riftberg.engines.quasi_static.keel_friction import (
    ANCHOR_TORQUE,
    ANCHOR_X,
    ANCHOR_Y,
    ANCHORS,
    ARM_X,
    ARM_Y,
    LARGEST,
    LIMIT,
    SLOPE_X,
    SLOPE_Y,
    allocate_patches,
    fill_keel_levers,
    find_pull,
    floor_force,
    give_way,
    present_friction,
    read_anchor,
)
from riftberg.physics.floating import draft_of
from riftberg.physics.geometry import solve, times
from riftberg.state import Floats, Ints
from riftberg.state.variables import Body, Keel

Booleans = NDArray[np.bool_]

VELOCITY_CHANGE: Final = 0.18
"""Largest relative change of a fragment's speed by the floor in a sub-step, unless the floor holds the fragment. With it a berg
stops 1.0 % short on rock, with 0.1 it stops 0.9 % short after twice as many sub-steps."""

CARRIED_CHANGE: Final = 0.03
"""The same in a step of contact, which knows the friction at its start alone, by how that has changed at its end. With 0.1 a
berg that another pushes up a slope slides 5 % too far."""

HOLD_CHANGE: Final = 0.05
"""Part of its hold, or of what others push with, by which the floor may change its hold in a step of contact in any case: a
crumb goes with those that push it."""

SLOW: Final = 1e-3
"""Speed (m s-1) below which changes are measured by this one."""

TOUCH_STEP: Final = 60.0
"""Touching and coming free are met within this time, s."""

SHORTEST_PUSHED_STEP: Final = 10.0
"""Shortest step (s) to which a change of hold under a fragment that others push leads; then it goes as the floor says, pushed by
the mean force. That leads them some metres a minute into each other, so it is to be rare."""

LEAST_STEP: Final = 0.01
"""Shortest sub-step, s."""

HELD_STEP: Final = 1e9
"""Length of the next sub-step (s) of a held fragment: longer than any step, so that it takes the whole step at once."""

PASSES: Final = 50
"""Of Newton's method for the friction, after which the sub-step is halved."""

BEGINS, STAYS, MIDDLE, END, DONE, AFLOAT, BEYOND, TOO_SHORT, UNSETTLED = range(9)
"""Status of a fragment: what it needs the depth for (where it stays, in the middle or at the end of a sub-step), or how it ended:
it touched the floor, or nothing; it went beyond the pads that are watched; no sub-step was short enough; no rise balances it."""


class Step(NamedTuple):
    """The step of all fragments."""

    h: float  # Its length, s
    bed: Bed
    latlon: bool
    earth: float  # Radius, m


class LastPress(NamedTuple):
    """What the last press of each fragment was given, and what came of it: one that stands still is not pressed anew.

    Each fragment has room for all of its polygons and their corners, whichever are asked for.
    """

    number: Ints  # Of polygons that were pressed, -1 before the first press
    polygons: Ints  # Their numbers
    depth: Floats  # At their corners and middles, m
    draft: Floats  # m; shape (elements,)
    level: Floats  # m
    hull: Floats  # shape (fragments, 3, 3)
    largest: Floats  # Overlap, m
    rise: Floats
    loads: Floats
    bent: Floats


class Landing(NamedTuple):
    """Fragments on their way through a step: arrays by fragment, unless said otherwise, of vectors east, north and turning."""

    pads: Pads
    plates: Plates
    bodies: Ints  # Their numbers among all fragments, in rising order
    polygons: Ints  # Those that may touch the floor, one fragment after the other
    polygon_start: Ints  # Where those of each fragment begin; shape (fragments + 1,)
    asked: Ints  # Their corners, each once; the depth is asked there, and in the middles of the polygons
    asked_start: Ints  # Where those of each fragment begin; shape (fragments + 1,)
    sounding: Ints  # Number of that at each corner that is asked, in its fragment; shape (corners,)

    # The fragments at the start
    pose: Floats  # shape (fragments, 3, 3)
    reference: Floats  # Of the elements ``pads.rows``; shape (elements, 3)
    draft: Floats  # Of the elements, m
    deepest: Floats  # Draft, m
    thickness: Floats  # Mean, m
    length: Floats  # Of bending, m
    hull: Floats  # Stiffness against heave and tilts; shape (fragments, 3, 3)
    mobility: Floats  # shape (fragments, 3, 3)
    arm: Floats  # Radius of gyration, m
    radius: Floats  # m
    reach: Floats  # Way for which the pads are watched, m
    level: Floats  # Of the sea at the start, in the middle and at the end of the step, m; shape (fragments, 3)
    lowest: Floats  # Of these, m
    first_speed: Floats  # At the rim, m s-1

    # Where they are now
    status: Ints
    time: Floats  # Since the start, s
    substep: Floats  # Longest sub-step that comes next, s
    path: Floats  # Way since the start, m
    velocity: Floats  # m s-1
    acceleration: Floats  # In the last sub-step
    touches: Booleans  # Whether it touches the floor
    anchors: Floats  # See `riftberg.engines.quasi_static.keel_friction`; shape (elements, columns)

    # The sub-step that is tried
    way: Floats  # To where the depth is asked, m
    sounded_pose: Floats  # There; shape (fragments, 3, 3)
    levers: Floats  # Of the elements in its middle; shape (elements, 11)
    rise: Floats  # Heave (m) and tilts (rad)
    loads: Floats  # Columns of `press` for the elements, in its middle or at its end; shape (elements, columns)
    bent: Floats  # Results of `press` for the polygons; shape (polygons, 5)
    last: LastPress
    touches_in_middle: Booleans
    hold: Floats  # Friction that can hold it in the middle, N
    slides: Booleans  # Whether an anchor does
    net: Floats  # Force of the floor, N
    rubs: Floats  # Work of friction, J
    next_velocity: Floats  # At its end, m s-1
    next_anchors: Floats  # shape (elements, columns)

    # What others do
    push: Floats  # Their force, N
    carried: Booleans  # Whether contact takes a fragment through the step
    hold_change: Floats  # Of the floor on such a one, as a multiple of what it may be

    # What comes of the step
    accepted: Booleans  # Whether the last call ended a sub-step
    shortest: Floats  # Sub-step, s
    clearance: Floats  # Least, m
    rubbed: Floats  # Work of friction so far, J
    yielded: Floats  # Deepest yield of the bed under each element, m
    applied: Floats  # Changes of velocity by all forces, m s-1; shape (elements, forces, 2)
    peak: Floats  # Largest force of the floor, N
    peak_time: Floats  # When that was, s
    peak_spin: Floats  # Then, rad s-1
    peak_force: Floats  # On the elements then, N, N, N m; shape (elements, 3)
    peak_axes: Floats  # Theirs then, cosine and sine; shape (elements, 2)


def allocate_landing(bodies: Ints, pads: Pads, plates: Plates) -> Landing:
    """Return arrays for the steps of some fragments, which `begin_step` fills."""
    count, elements, polygons, corners = bodies.size, pads.rows.size, pads.owner.size, len(pads.corner)

    def each(*shape: int) -> Floats:
        return np.empty((count, *shape))

    def whole() -> Ints:
        return np.empty(count, np.int64)

    def flags() -> Booleans:
        return np.empty(count, np.bool_)

    last = LastPress(
        np.full(count, -1), np.empty(polygons, np.int64), np.empty(corners + polygons), np.empty(elements), each(), each(3, 3),
        each(), each(3), np.empty((elements, PRESSED)), np.empty((polygons, 5)),
    )  # fmt: skip
    return Landing(
        pads, plates, bodies, polygons=np.empty(polygons, np.int64), polygon_start=np.zeros(count + 1, np.int64),
        asked=np.empty(corners, np.int64), asked_start=np.zeros(count + 1, np.int64), sounding=np.zeros(corners, np.int64),
        pose=each(3, 3), reference=np.empty((elements, 3)), draft=np.empty(elements), deepest=each(), thickness=each(),
        length=each(), hull=each(3, 3), mobility=each(3, 3), arm=each(), radius=each(), reach=each(), level=each(3),
        lowest=each(), first_speed=each(), status=whole(), time=each(), substep=each(), path=each(3), velocity=each(3),
        acceleration=each(3), touches=flags(), anchors=np.empty((elements, ANCHORS)), way=each(3), sounded_pose=each(3, 3),
        levers=np.empty((elements, 11)), rise=each(3), loads=np.empty((elements, PRESSED)), bent=np.empty((polygons, 5)),
        last=last, touches_in_middle=flags(), hold=each(), slides=flags(), net=each(3), rubs=each(), next_velocity=each(3),
        next_anchors=np.empty((elements, ANCHORS)), push=each(3), carried=flags(), hold_change=each(), accepted=flags(),
        shortest=each(), clearance=each(), rubbed=each(), yielded=np.empty(elements),
        applied=np.empty((elements, len(FORCES), 2)), peak=each(), peak_time=each(), peak_spin=each(),
        peak_force=np.empty((elements, 3)), peak_axes=np.empty((elements, 2)),
    )  # fmt: skip


# Many arguments: the state, and what has been found of the fragments.
@kernel
def begin_step(
    f: Landing, bodies: Bodies, body: Body, depth: Floats, keel: Keel, rho_ice: float, step: Step, radius: Floats, reach: Floats,
    near_floor: Booleans, lon: Floats, lat: Floats,
) -> None:  # fmt: skip
    """Let fragments begin a step where they are; all but level, polygons and masses.

    ``depth``: in the middles of the elements, m; ``radius``, ``reach``, ``near_floor``: of all fragments; ``lon`` and ``lat``
    take the middles of those that begin.
    """
    _clear(f)
    pads = f.pads
    for a in range(f.bodies.size):
        b = f.bodies[a]
        f.pose[a], f.velocity[a], f.radius[a] = bodies.pose[b], bodies.twist[b], radius[b]
        # Where the floor is not asked for under its pads, the middles of the elements tell the water under a berg.
        f.reach[a], f.clearance[a], f.deepest[a] = -1.0, math.inf, -math.inf
        stands, near = False, near_floor[b]
        if near:
            f.reach[a] = reach[b]
        for e in range(pads.row_start[a], pads.row_start[a + 1]):
            row = pads.rows[e]
            f.reference[e], f.draft[e] = bodies.reference[row], draft_of(body.thickness[row], rho_ice)
            f.deepest[a] = max(f.deepest[a], f.draft[e])
            if near:
                f.clearance[a] = min(f.clearance[a], depth[row] - f.draft[e])
            read_anchor(keel, row, step.bed.anchor_way, f.anchors[e])
            f.yielded[e] = keel.floor_yield[row]
            f.hold[a] += keel.floor_hold[row]
            stands = stands or keel.floor_load[row] > 0.0 or keel.anchor_x[row] != 0.0 or keel.anchor_y[row] != 0.0
        substep = keel.floor_substep[pads.rows[pads.row_start[a]]]
        f.touches[a], f.substep[a] = stands, substep if stands and substep > 0.0 else HELD_STEP
        lon[a], lat[a] = place_points(pads.origin[a, 0], pads.origin[a, 1], f.pose[a], step.latlon, step.earth)
    fill_hulls(pads, body.thickness, f.draft, step.bed, f.hull, f.thickness, f.length)


@borrower
def list_corners(f: Landing) -> None:
    """List the corners of the polygons that may touch the floor, each once."""
    pads, count = f.pads, 0
    for a in range(f.bodies.size):
        first = f.asked_start[a] = count
        for p in range(f.polygon_start[a], f.polygon_start[a + 1]):
            k = f.polygons[p]
            f.sounding[pads.start[k] : pads.start[k + 1]] = -1
            _share_corners(f, p, f.polygon_start[a])
            for n in range(pads.start[k], pads.start[k + 1]):
                if f.sounding[n] < 0:
                    f.sounding[n], f.asked[count] = count - first, n
                    count += 1
    f.asked_start[f.bodies.size] = count


@borrower
def _share_corners(f: Landing, p: int, first: int) -> None:
    """Take the soundings of corners that a polygon shares with those of its element beside and below, from ``first`` on."""
    pads, k = f.pads, f.polygons[p]
    for q in range(p - 1, first - 1, -1):  # those of an element follow row by row
        m = f.polygons[q]
        rows, columns = pads.square[k, 0] - pads.square[m, 0], abs(pads.square[k, 1] - pads.square[m, 1])
        if pads.owner[m] != pads.owner[k] or rows > 1:
            return
        if rows + columns != 1:
            continue
        for n in range(pads.start[k], pads.start[k + 1]):
            for i in range(pads.start[m], pads.start[m + 1]):
                if pads.corner[n, 0] == pads.corner[i, 0] and pads.corner[n, 1] == pads.corner[i, 1]:
                    f.sounding[n] = f.sounding[i]


@borrower
def _clear(f: Landing) -> None:
    """Clear what the last step has left."""
    f.status[:], f.shortest[:], f.peak[:] = BEGINS, math.inf, -1.0
    f.accepted[:] = f.carried[:] = f.slides[:] = f.touches_in_middle[:] = False
    f.time[:] = f.rubs[:] = f.rubbed[:] = f.hold[:] = f.hold_change[:] = f.peak_time[:] = f.peak_spin[:] = 0.0
    f.path[:] = f.acceleration[:] = f.rise[:] = f.net[:] = f.push[:] = 0.0
    f.anchors[:] = f.next_anchors[:] = f.loads[:] = f.applied[:] = f.peak_force[:] = f.peak_axes[:] = 0.0


@kernel
def set_masses(f: Landing, matrices: BodyMatrices) -> None:
    """Take the masses of the fragments, and how fast their rims are."""
    for a in range(f.bodies.size):
        b, v = f.bodies[a], f.velocity[a]
        f.mobility[a], f.arm[a] = matrices.mobility[b], math.sqrt(matrices.inertia[b, 2, 2] / matrices.inertia[b, 0, 0])
        f.first_speed[a] = math.hypot(v[0], v[1]) + f.arm[a] * abs(v[2])


@borrower
def _is_watched(f: Landing, a: int, way: Floats) -> bool:
    """Whether a fragment stays where its pads are watched, on a way from where it was at the start."""
    return bool(math.hypot(way[0], way[1]) + f.radius[a] * abs(way[2]) <= f.reach[a])


@kernel
def carry(f: Landing, contact: SubcycledMotion, by_the_floor: Ints, body: Ints, h: float) -> bool:
    """Let contact take fragments through the step, and push those ``by_the_floor``; returns whether one leaves its watched pads.

    ``body``: of the elements.
    """
    leaves = False
    for c in range(contact.bodies.size):
        b = contact.bodies[c]
        a = np.searchsorted(f.bodies, b)
        if a == f.bodies.size or f.bodies[a] != b:
            continue
        for k in range(3):
            f.push[a, k] = contact.impulse[c, k] / h
        if (by_the_floor == b).any():
            continue
        f.carried[a], f.rubbed[a], f.shortest[a] = True, contact.rubbed[c], TOUCH_STEP
        for k in range(3):
            f.path[a, k], f.velocity[a, k] = h * contact.mean[c, k], contact.twist[c, k]
        e = f.pads.row_start[a]
        for n in range(contact.rows.size):  # the elements of a fragment stand in the order of the state in both
            if body[contact.rows[n]] == b:
                for k in range(ANCHOR_TORQUE + 1):
                    f.anchors[e, k] = contact.anchors[n, k]
                f.applied[e] = contact.applied[n]
                e += 1
        if not _is_watched(f, a, f.path[a]):
            f.status[a], leaves = BEYOND, True
    return leaves


@borrower
def _interpolate_level(level: Floats, fraction: float) -> float:
    """Sea level (m) at a part of the step, by a parabola."""
    first, middle, last = level[0], level[1], level[2]
    return float(
        first + fraction * (4.0 * middle - 3.0 * first - last + 2.0 * fraction * (first - 2.0 * middle + last))
    )


@borrower
def _recall_press(f: Landing, a: int, level: float, depth: Floats) -> bool:
    """Take the last press of a fragment, if it was given the same; returns whether it was."""
    last, (first, end), (row, end_row) = f.last, f.polygon_start[a : a + 2], f.pads.row_start[a : a + 2]
    slot, at = _own_room(f.pads, a)
    if last.number[a] != end - first or last.level[a] != level:
        return False
    for p in range(end - first):
        if last.polygons[slot + p] != f.polygons[first + p]:
            return False
    for n in range(depth.size):
        if last.depth[at + n] != depth[n]:
            return False
    for e in range(row, end_row):
        if last.draft[e] != f.draft[e]:
            return False
    for i in range(3):
        for j in range(3):
            if last.hull[a, i, j] != f.hull[a, i, j]:  # its sides have melted
                return False
    for k in range(3):
        f.rise[a, k] = last.rise[a, k]
    for e in range(row, end_row):
        for k in range(PRESSED):
            f.loads[e, k] = last.loads[e, k]
    for p in range(end - first):
        for k in range(5):
            f.bent[first + p, k] = last.bent[slot + p, k]
    return True


@borrower
def _own_room(pads: Pads, a: int) -> tuple[int, int]:
    """Where the room of a fragment in `LastPress` begins: for polygons, and for depths."""
    slot = pads.polygon_start[a]
    return slot, pads.start[slot] + slot


@borrower
def _remember_press(f: Landing, a: int, level: float, depth: Floats, largest: float) -> None:
    """Keep what a press was given and what came of it."""
    last, (first, end), (row, end_row) = f.last, f.polygon_start[a : a + 2], f.pads.row_start[a : a + 2]
    slot, at = _own_room(f.pads, a)
    last.number[a], last.level[a], last.largest[a] = end - first, level, largest
    for n in range(depth.size):
        last.depth[at + n] = depth[n]
    for k in range(3):
        last.rise[a, k] = f.rise[a, k]
        for j in range(3):
            last.hull[a, k, j] = f.hull[a, k, j]
    for e in range(row, end_row):
        last.draft[e] = f.draft[e]
        for k in range(PRESSED):
            last.loads[e, k] = f.loads[e, k]
    for p in range(end - first):
        last.polygons[slot + p] = f.polygons[first + p]
        for k in range(5):
            last.bent[slot + p, k] = f.bent[first + p, k]


@kernel
def _press(f: Landing, a: int, bed: Bed, fraction: float, depth: Floats) -> bool:
    """Press a fragment onto the floor after a part of the step; returns whether it touches it."""
    level, largest = _interpolate_level(f.level[a], fraction), f.last.largest[a]
    if not _recall_press(f, a, level, depth):
        own_polygons = slice(f.polygon_start[a], f.polygon_start[a + 1])
        iterations, largest = press(
            f.pads, f.plates, a, f.polygons[own_polygons], depth, f.sounding, f.draft, level, bed, f.hull[a], f.length[a],
            f.thickness[a], f.rise[a], f.loads, f.bent[own_polygons],
        )  # fmt: skip
        if iterations < 0:
            f.status[a] = UNSETTLED
        else:
            _remember_press(f, a, level, depth, largest)
    f.clearance[a] = min(f.clearance[a], -largest)
    return bool(largest > 0.0)


@kernel
def _set_levers(f: Landing, a: int, step: Step) -> None:
    """Find the levers of the elements of a fragment where it was sounded."""
    first, last, none = f.pads.row_start[a], f.pads.row_start[a + 1], np.empty((0, 3))
    bodies = Bodies(np.zeros(last - first, np.int64), f.reference[first:last], f.sounded_pose[a : a + 1], none, none)
    fill_levers(bodies, step.latlon, step.earth, f.levers[first:last])


@borrower
def _turned(m: Floats, x: float, y: float) -> tuple[float, float]:
    """Return a vector along the axes of the fragment east and north at an element; ``m``: its levers."""
    return m[9] * x - m[10] * y, m[10] * x + m[9] * y


@borrower
def _set_slope_force(f: Landing, a: int, e: int, anchor: Floats) -> None:
    """Find where the floor acts on an element, how much it can hold, and how its slope pushes it."""
    m, load = f.levers[e], f.loads[e]
    x = load[LOAD_X] - f.pads.element[e, 0] - f.pads.origin[a, 0]
    y = load[LOAD_Y] - f.pads.element[e, 1] - f.pads.origin[a, 1]
    anchor[ARM_X], anchor[ARM_Y] = _turned(m, x, y)
    anchor[SLOPE_X], anchor[SLOPE_Y] = _turned(m, load[PUSH_X], load[PUSH_Y])
    anchor[LIMIT], anchor[LARGEST] = load[HOLD], max(anchor[LARGEST], load[HOLD])


@borrower
def _add_force(m: Floats, anchor: Floats, x: float, y: float, torque: float, net: Floats) -> None:
    """Add a force of the floor on an element (N), and a torque where it acts, to that on its fragment; ``m``: its levers."""
    by_arm = anchor[ARM_X] * y - anchor[ARM_Y] * x
    for k in range(3):
        net[k] += m[k] * x + m[3 + k] * y + m[6 + k] * by_arm
        net[k] += m[6 + k] * torque


# Many arguments: the sums of Newton's method.
@borrower
def _add_friction(
    f: Landing, loaded: Ints, lever: Floats, gyration: Floats, spring: Floats, v: Floats, may_slide: bool, friction: Floats,
    slides: Booleans, total: Floats, tangent: Floats, room: Floats, patches: Floats,
) -> None:  # fmt: skip
    """Find the friction of all anchors at a velocity, and whether they slide; add it up, and minus its slope by the velocity."""
    pull, slope = room[0], room[1:]
    for i in range(loaded.size):
        e, w = loaded[i], lever[i]
        m, base = f.levers[e], f.loads[e, SPREAD_XX : SPREAD_YY + 1]
        find_pull(f.anchors[e], gyration[i], w, spring[i], v, pull)
        for r in range(3):
            friction[i, r] = pull[r]
        slides[i] = may_slide and give_way(
            pull, f.loads[e, HOLD], base, m[9], m[10], False, friction[i], slope, patches
        )  # fmt: skip
        for k in range(3):
            for r in range(3):
                total[k] += w[r, k] * friction[i, r]
                for j in range(3):
                    if not slides[i]:
                        tangent[k, j] += spring[i] * w[r, k] * w[r, j]
                        continue
                    for s in range(3):
                        tangent[k, j] += spring[i] * w[r, k] * slope[r, s] * w[s, j]


@stage
def _solve_friction(f: Landing, a: int, forcing: ElementForcing, bed: Bed, dt: float) -> bool:
    """Solve for the velocity at the end of a sub-step with the anchors, by Newton's method; False where it does not settle.

    Leaves velocity, net force, anchors, forces and work of friction of the sub-step.
    """
    first, last = f.pads.row_start[a], f.pads.row_start[a + 1]
    mass, levers = take_elements(forcing, f.pads.rows[first:last]), f.levers[first:last]
    always, body = np.ones(1, np.bool_), np.zeros(last - first, np.int64)
    loaded = first + np.flatnonzero(f.loads[first:last, LOAD] > 0.0)
    lever, gyration, spring = np.empty((loaded.size, 3, 3)), np.empty(loaded.size), np.empty(loaded.size)
    friction, slides, constant = np.zeros((loaded.size, 3)), np.zeros(loaded.size, np.bool_), f.push[a].copy()
    room, patches = np.empty((4, 3)), allocate_patches()
    f.next_anchors[first:last] = 0.0
    for i in range(loaded.size):
        e = loaded[i]
        m, anchor = f.levers[e], f.next_anchors[e]
        anchor[LARGEST] = f.anchors[e, LARGEST]
        _set_slope_force(f, a, e, anchor)
        _add_force(m, anchor, anchor[SLOPE_X], anchor[SLOPE_Y], 0.0, constant)
        gyration[i] = math.sqrt(f.loads[e, SPREAD_XX] + f.loads[e, SPREAD_YY])
        fill_keel_levers(anchor, gyration[i], m, lever[i])
        spring[i] = dt * anchor[LARGEST] / bed.anchor_way

    v0, v, new, step = f.velocity[a], f.next_velocity[a], f.velocity[a].copy(), np.zeros(3)
    net, jacobian, twist = np.empty((1, 3)), np.empty((1, 3, 3)), np.empty((1, 3))
    total, tangent, r, matrix = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    mobility, arm, previous_size, scale, passes = f.mobility[a], f.arm[a], math.inf, 1.0, 0
    while True:
        # Media at the mean velocity, as the ledger has them: momentum closes to round-off.
        for k in range(3):
            twist[0, k], net[0, k] = 0.5 * (v0[k] + new[k]), 0.0
            for j in range(3):
                jacobian[0, k, j] = 0.0
        assemble_force_and_jacobian(body, levers, twist, mass, always, net, jacobian)
        for k in range(3):
            total[k] = net[0, k] + constant[k]
            for j in range(3):
                tangent[k, j] = 0.5 * jacobian[0, k, j]
        # As if all anchors held at first: a fragment that turns about one of them seems to slide by its last velocity.
        _add_friction(
            f, loaded, lever, gyration, spring, new, passes > 0, friction, slides, total, tangent, room, patches
        )  # fmt: skip
        acceleration = times(mobility, total)
        for k in range(3):
            r[k] = new[k] - v0[k] - dt * acceleration[k]
        size = math.hypot(r[0], r[1]) + arm * abs(r[2])
        if passes > 1 and size >= previous_size and scale >= 1e-3:
            scale *= 0.5
            for k in range(3):
                new[k] = v[k] + scale * step[k]
            continue
        previous_size = size
        for k in range(3):
            v[k], r[k] = new[k], -r[k]
            for j in range(3):
                matrix[k, j] = 1.0 if k == j else 0.0
                for i in range(3):
                    matrix[k, j] += dt * mobility[k, i] * tangent[i, j]
        if passes == PASSES:
            return False
        step[0], step[1], step[2] = solve(matrix, r)
        change, speed = math.hypot(step[0], step[1]) + arm * abs(step[2]), math.hypot(v[0], v[1]) + arm * abs(v[2])
        if passes > 0 and change <= 1e-12 * max(speed, 1e-6):
            break
        for k in range(3):
            new[k] = v[k] + step[k]
        scale, passes = 1.0, passes + 1

    for k in range(3):
        f.net[a, k], twist[0, k] = 0.0, v0[k] + v[k]
    f.slides[a], f.hold[a], f.rubs[a] = False, 0.0, 0.0
    for i in range(loaded.size):
        anchor, (x, y, turn), pull = f.next_anchors[loaded[i]], friction[i], room[0]
        anchor[ANCHOR_X], anchor[ANCHOR_Y], anchor[ANCHOR_TORQUE] = x, y, gyration[i] * turn
        push_x, push_y, _ = floor_force(anchor)
        _add_force(f.levers[loaded[i]], anchor, push_x, push_y, anchor[ANCHOR_TORQUE], f.net[a])
        f.hold[a] += anchor[LIMIT]
        if slides[i]:
            # The anchor yields over the part of the way, by the mean velocity, that its spring does not take up.
            f.slides[a] = True
            find_pull(f.anchors[loaded[i]], gyration[i], lever[i], 0.5 * spring[i], twist[0], pull)
            work = x * (pull[0] - x) + y * (pull[1] - y) + turn * (pull[2] - turn)
            f.rubs[a] += max(work, 0.0) * bed.anchor_way / max(anchor[LARGEST], 1e-30)
    return True


@kernel
def _request_depth(f: Landing, a: int, step: Step, t: float, status: int) -> None:
    """Ask for the depth after the way in ``way`` and ``t`` s, as far as the pads are watched."""
    twist = np.empty((1, 3))
    for k in range(3):
        twist[0, k] = f.way[a, k] / t
    move_poses(f.pose[a : a + 1], twist, t, step.latlon, step.earth, f.sounded_pose[a : a + 1], np.empty((3, 3)))
    f.status[a] = status if _is_watched(f, a, f.way[a]) else BEYOND


@borrower
def _substep_length(f: Landing, a: int, h: float) -> float:
    """Length (s) of the sub-step that is tried, in a step of ``h`` s."""
    left = h - f.time[a]
    return float(left / max(math.ceil(left / f.substep[a] - 1e-3), 1))  # in equal parts: the last one is no sliver


@kernel
def _begin_substep(f: Landing, a: int, step: Step) -> None:
    """Ask for the depth in the middle of a sub-step, where the acceleration of the last one would take the fragment.

    The floor goes on holding what it held: there the depth is asked for where it stands.
    """
    dt = _substep_length(f, a, step.h)
    if f.touches[a] and f.substep[a] >= HELD_STEP:
        for k in range(3):
            f.way[a, k] = f.path[a, k]
        _request_depth(f, a, step, f.time[a] + dt, STAYS)
        return
    for k in range(3):
        f.way[a, k] = f.path[a, k] + 0.5 * dt * f.velocity[a, k] + 0.125 * dt * dt * f.acceleration[a, k]
    if not _is_watched(f, a, f.way[a]):  # what has just stopped a fragment would throw it back in a longer sub-step
        for k in range(3):
            f.way[a, k] = f.path[a, k] + 0.5 * dt * f.velocity[a, k]
    _request_depth(f, a, step, f.time[a] + 0.5 * dt, MIDDLE)


@kernel
def _refuse(f: Landing, a: int, step: Step, dt: float, fraction: float) -> None:
    """Begin anew with a part of a sub-step of ``dt`` s."""
    f.substep[a] = fraction * dt
    if fraction * dt < LEAST_STEP:
        f.status[a] = TOO_SHORT
    else:
        _begin_substep(f, a, step)


@stage
def _stay(f: Landing, a: int, step: Step, forcing: ElementForcing, depth: Floats) -> None:
    """End a sub-step with a fragment where the floor holds it as at the end of it; begin it anew where the floor does not."""
    dt = _substep_length(f, a, step.h)
    touches = f.touches_in_middle[a] = _press(f, a, step.bed, (f.time[a] + dt) / step.h, depth)
    if f.status[a] == UNSETTLED:
        return
    if touches:
        _set_levers(f, a, step)
        if _solve_friction(f, a, forcing, step.bed, dt) and _is_held(f, a, step.bed, dt):
            _end_substep(f, a, step, forcing, touches)
            return
    f.substep[a] = dt
    _begin_substep(f, a, step)


@stage
def _go_through_middle(f: Landing, a: int, step: Step, forcing: ElementForcing, depth: Floats) -> None:
    """Find the forces in the middle of a sub-step and the velocity after it; ask for the depth at its end."""
    dt = _substep_length(f, a, step.h)
    f.touches_in_middle[a] = _press(f, a, step.bed, (f.time[a] + 0.5 * dt) / step.h, depth)
    if f.status[a] == UNSETTLED:
        return
    if dt == step.h and dt > TOUCH_STEP and not (f.touches[a] or f.touches_in_middle[a]):
        # Nothing touches so far: where it goes afloat is where to look.
        f.slides[a] = False
        for k in range(3):
            f.next_velocity[a, k], f.net[a, k] = f.velocity[a, k], 0.0
    else:
        _set_levers(f, a, step)
        if not _solve_friction(f, a, forcing, step.bed, dt):
            _refuse(f, a, step, dt, 0.5)
            return
    for k in range(3):
        f.way[a, k] = f.path[a, k] + 0.5 * dt * (f.velocity[a, k] + f.next_velocity[a, k])
    _request_depth(f, a, step, f.time[a] + dt, END)


@stage
def _go_through_end(f: Landing, a: int, step: Step, forcing: ElementForcing, depth: Floats) -> None:
    """Find the forces at the end of a sub-step, and end it."""
    dt = _substep_length(f, a, step.h)
    touches = _press(f, a, step.bed, (f.time[a] + dt) / step.h, depth)
    if f.status[a] == UNSETTLED:
        return
    if dt == step.h and not (f.touches[a] or f.touches_in_middle[a] or touches):
        f.status[a] = AFLOAT
    else:
        _end_substep(f, a, step, forcing, touches)
        if f.status[a] == DONE:
            _set_levers(f, a, step)  # keels take the axes of elements at the end, not in the middle


@borrower
def _is_held(f: Landing, a: int, bed: Bed, dt: float) -> bool:
    """Whether no anchor slides in the middle of a sub-step, and the fragment goes no farther in it than an anchor gives way."""
    v, w = f.velocity[a], f.next_velocity[a]
    speed = math.hypot(v[0] + w[0], v[1] + w[1]) + f.arm[a] * abs(v[2] + w[2])
    return bool(not f.slides[a] and 0.5 * dt * speed <= bed.anchor_way)


@borrower
def relative_change(f: Landing, a: int, change: Floats) -> float:
    """Return a change of the velocity of a fragment at its rim as a part of its speed there."""
    v = f.velocity[a]
    speed = max(math.hypot(v[0], v[1]) + f.arm[a] * abs(v[2]), 0.5 * f.first_speed[a], SLOW)
    return float((math.hypot(change[0], change[1]) + f.arm[a] * abs(change[2])) / speed)


@stage
def _measure_change(f: Landing, a: int, dt: float, touches: bool) -> float:
    """Relative change of velocity by a sub-step, with the greater of the forces in its middle and at its end."""
    if not (touches or f.touches_in_middle[a]):
        return 0.0
    friction, v, more = 0.0, f.velocity[a], np.zeros(3)
    for e in range(f.pads.row_start[a], f.pads.row_start[a + 1]):
        friction += f.loads[e, HOLD]
    if f.touches_in_middle[a]:
        for k in range(3):
            more[k] = max(0.0, friction / max(f.hold[a], 1e-30) - 1.0) * f.net[a, k]
    else:
        speed = max(math.hypot(v[0], v[1]), 1e-12)
        more[0], more[1] = -friction * v[0] / speed, -friction * v[1] / speed
    acceleration = times(f.mobility[a], more)
    for k in range(3):
        more[k] = f.next_velocity[a, k] - v[k] + dt * acceleration[k]
    return relative_change(f, a, more)


@kernel
def _end_substep(f: Landing, a: int, step: Step, forcing: ElementForcing, touches: bool) -> None:
    """Accept a sub-step by the forces at its end, or refuse it; begin the next one."""
    dt, v0 = _substep_length(f, a, step.h), f.velocity[a]
    if not f.touches[a] == f.touches_in_middle[a] == touches and dt > TOUCH_STEP:
        _refuse(f, a, step, dt, 0.5)
        return
    is_held = _is_held(f, a, step.bed, dt)
    ratio = 0.0 if is_held else _measure_change(f, a, dt, touches) / VELOCITY_CHANGE
    if ratio > 1.0:
        _refuse(f, a, step, dt, min(max(0.85 / ratio, 0.05), 0.7))
        return
    _accept(f, a, forcing, dt)
    f.touches[a], f.accepted[a] = touches, True
    longer = dt * (2.0 if ratio == 0.0 else min(max(0.85 / ratio, 1.0), 3.0))
    slowing = -(f.acceleration[a, 0] * v0[0] + f.acceleration[a, 1] * v0[1])
    if is_held and touches:
        longer = HELD_STEP
    elif slowing > 0.0 and f.slides[a]:
        # Just before it stops: over a way shorter than that of the anchor the floor stops the fragment at once.
        speed = math.hypot(v0[0], v0[1])
        stop = speed * speed / slowing
        if 0.5 * speed * stop < 0.9 * step.bed.anchor_way:
            longer = max(longer, 1.2 * stop)
    f.substep[a] = max(longer, f.substep[a]) if dt < f.substep[a] else longer
    if step.h - f.time[a] > 1e-12 * step.h:
        _begin_substep(f, a, step)
    else:
        f.status[a] = DONE


@stage
def _accept(f: Landing, a: int, forcing: ElementForcing, dt: float) -> None:
    """Make a sub-step the state of a fragment."""
    first, last = f.pads.row_start[a], f.pads.row_start[a + 1]
    count, mean = last - first, np.empty((1, 3))
    for k in range(3):
        mean[0, k] = 0.5 * (f.velocity[a, k] + f.next_velocity[a, k])
        f.acceleration[a, k] = (f.next_velocity[a, k] - f.velocity[a, k]) / dt
        f.velocity[a, k] = f.next_velocity[a, k]
        f.path[a, k] += dt * mean[0, k]
    f.time[a] += dt
    f.shortest[a] = min(f.shortest[a], dt)
    f.rubbed[a] += f.rubs[a]
    accelerations, rate = np.zeros((count, len(FORCES), 2)), np.empty((count, 3))
    force, net = np.empty((count, 3)), np.zeros((1, 3))
    mass, levers = take_elements(forcing, f.pads.rows[first:last]), f.levers[first:last]
    add_forces(np.zeros(count, np.int64), levers, mean, mass, accelerations, rate, force, net)
    size = 0.0
    for n in range(count):
        anchor, e = f.next_anchors[first + n], first + n
        x, y, _ = floor_force(anchor)
        accelerations[n, SEA_FLOOR, 0] += x / mass.mass[n]
        accelerations[n, SEA_FLOOR, 1] += y / mass.mass[n]
        for k in range(len(FORCES)):
            f.applied[e, k, 0] += dt * accelerations[n, k, 0]
            f.applied[e, k, 1] += dt * accelerations[n, k, 1]
        for k in range(ANCHORS):
            f.anchors[e, k] = anchor[k]
        f.yielded[e] = max(f.yielded[e], f.loads[e, YIELD])
        size += math.hypot(x, y)
    if size > f.peak[a]:
        f.peak[a], f.peak_spin[a], f.peak_time[a] = size, f.velocity[a, 2], f.time[a]
        for n in range(count):
            (x, y, torque), e = floor_force(f.next_anchors[first + n]), first + n
            f.peak_force[e, 0], f.peak_force[e, 1] = force[n, 0] + x, force[n, 1] + y
            f.peak_force[e, 2], f.peak_axes[e, 0], f.peak_axes[e, 1] = force[n, 2] + torque, levers[n, 9], levers[n, 10]


@stage
def _set_down(f: Landing, a: int, step: Step, depth: Floats) -> None:
    """Find the forces of the floor on a fragment where contact has taken it."""
    push, change = f.push[a], np.zeros(3)
    touches = _press(f, a, step.bed, 1.0, depth)
    if f.status[a] == UNSETTLED:
        return
    if not (touches or f.touches[a]):
        f.status[a] = AFLOAT
        return
    # Contact has taken the hold to be that of the start.
    hold = _find_friction(f, a, step, change)
    acceleration = times(f.mobility[a], change)
    for k in range(3):
        change[k] = step.h * acceleration[k]
    by_hold = abs(hold - f.hold[a]) / (HOLD_CHANGE * max(f.hold[a], math.hypot(push[0], push[1]), 1e-30))
    f.hold_change[a] = min(relative_change(f, a, change) / CARRIED_CHANGE, by_hold)
    f.accepted[a], f.status[a] = True, DONE


@stage
def _find_friction(f: Landing, a: int, step: Step, change: Floats) -> float:
    """Find the friction of a fragment by its loads where it was sounded; returns what can hold it (N).

    ``change`` takes by how much the friction has changed, N, N, N m.
    """
    total, pull, friction, slope, patches = 0.0, np.empty(3), np.empty(3), np.empty((3, 3)), allocate_patches()
    _set_levers(f, a, step)
    for e in range(f.pads.row_start[a], f.pads.row_start[a + 1]):
        anchor, m, load, slides_at = f.anchors[e], f.levers[e], f.loads[e], GIVES_WAY * f.anchors[e, LIMIT]
        total += load[HOLD]
        f.yielded[e] = max(f.yielded[e], load[YIELD])
        _set_slope_force(f, a, e, anchor)
        # Friction that slides is the hold now, as the next step finds it.
        base, gyration = load[SPREAD_XX : SPREAD_YY + 1], math.sqrt(load[SPREAD_XX] + load[SPREAD_YY])
        pull[0], pull[1], pull[2] = present_friction(anchor, gyration)
        slides_at = min(slides_at, load[HOLD])
        if give_way(pull, slides_at, base, m[9], m[10], False, friction, slope, patches):
            share = load[HOLD] / slides_at if slides_at > 0.0 else 0.0
            x, y, turn = share * friction[0], share * friction[1], share * friction[2]
            _add_force(m, anchor, x - pull[0], y - pull[1], gyration * (turn - pull[2]), change)
            anchor[ANCHOR_X], anchor[ANCHOR_Y], anchor[ANCHOR_TORQUE] = x, y, gyration * turn
    return total


@borrower
def _write_points(f: Landing, a: int, step: Step, pose: Floats, at: int, lon: Floats, lat: Floats) -> int:
    """Write where a fragment asks for the depth, from ``at`` on: the corners of its polygons, then their centroids."""
    pads, (ox, oy) = f.pads, f.pads.origin[a]
    for n in f.asked[f.asked_start[a] : f.asked_start[a + 1]]:
        x, y = pads.corner[n, 0] + ox, pads.corner[n, 1] + oy
        lon[at], lat[at] = place_points(x, y, pose, step.latlon, step.earth)
        at += 1
    for k in f.polygons[f.polygon_start[a] : f.polygon_start[a + 1]]:
        x, y = pads.centre[k, 0] + ox, pads.centre[k, 1] + oy
        lon[at], lat[at] = place_points(x, y, pose, step.latlon, step.earth)
        at += 1
    return at


@kernel
def press_all(f: Landing, step: Step, depth: Floats, lon: Floats, lat: Floats) -> None:
    """Write the points where all fragments need the depth as they stand, or press them by it."""
    at = 0
    for a in range(f.status.size):
        first, at = at, _write_points(f, a, step, f.pose[a], at, lon, lat)
        if depth.size and f.status[a] == BEGINS:
            f.status[a], f.sounded_pose[a] = DONE, f.pose[a]
            _press(f, a, step.bed, 0.0, depth[first:at])
            _find_friction(f, a, step, np.zeros(3))


@kernel
def advance(f: Landing, step: Step, forcing: ElementForcing, depth: Floats, lon: Floats, lat: Floats) -> int:
    """Take all fragments up to where they need the depth at another place; returns the number of points that they ask for.

    ``forcing``: of all elements; ``depth`` (m) at the points of the last call; ``lon`` and ``lat`` take those that
    are asked for.
    """
    at = requested = 0
    for a in range(f.status.size):
        f.accepted[a] = False
        if f.status[a] == BEGINS and f.carried[a]:
            for k in range(3):
                f.way[a, k] = f.path[a, k]
            _request_depth(f, a, step, step.h, END)
        elif f.status[a] == BEGINS:
            _begin_substep(f, a, step)
        elif f.status[a] in (STAYS, MIDDLE, END):
            first = at
            at += f.asked_start[a + 1] - f.asked_start[a] + f.polygon_start[a + 1] - f.polygon_start[a]
            answer = depth[first:at]
            if f.carried[a]:
                _set_down(f, a, step, answer)
            elif f.status[a] == STAYS:
                _stay(f, a, step, forcing, answer)
            elif f.status[a] == MIDDLE:
                _go_through_middle(f, a, step, forcing, answer)
            else:
                _go_through_end(f, a, step, forcing, answer)
        if f.status[a] in (STAYS, MIDDLE, END):
            requested = _write_points(f, a, step, f.sounded_pose[a], requested, lon, lat)
    return requested


@kernel
def find_largest_change(f: Landing, bodies: Ints, twist: Floats) -> float:
    """Largest change of the hold on fragments in contact; on those that went as the floor said, by their velocity after it.

    ``bodies``, ``twist``: of contact.
    """
    largest = f.hold_change.max()
    for c in range(bodies.size):
        a = np.searchsorted(f.bodies, bodies[c])
        if a < f.bodies.size and f.bodies[a] == bodies[c] and f.status[a] == DONE and not f.carried[a]:
            largest = max(largest, relative_change(f, a, f.velocity[a] - twist[c]) / CARRIED_CHANGE)
    return float(largest)


@kernel
def list_landed(f: Landing, h: float, bends: bool) -> tuple[Ints, Ints, Ints, Ints]:
    """List the fragments that touched the floor in a step of ``h`` s, and their elements; then those that it struck, and theirs.

    It struck those of several elements that went through the step in parts: it may have pressed them harder within it than at its
    end. What contact presses has its loads from there, or from the equilibrium at the end. ``bends``: whether bending breaks the
    ice, which is looked for within the step too.
    """
    elements = np.empty(f.pads.rows.size, np.int64)
    landed, struck, struck_elements = np.empty_like(f.bodies), np.empty_like(f.bodies), np.empty_like(elements)
    n = m = n_elements = m_elements = 0
    for a in range(f.bodies.size):
        if f.status[a] != DONE:
            continue
        first, last = f.pads.row_start[a], f.pads.row_start[a + 1]
        is_struck = last - first > 1 and not f.carried[a] and (bends or f.shortest[a] < h)
        landed[n], struck[m] = a, a
        n, m = n + 1, m + 1 if is_struck else m
        for e in range(first, last):
            elements[n_elements] = e
            n_elements += 1
            if is_struck:
                struck_elements[m_elements] = e
                m_elements += 1
    return landed[:n], elements[:n_elements], struck[:m], struck_elements[:m_elements]


@borrower
def lift_off(keel: Keel) -> None:
    """Clear the effect of the floor on all keels; the yield of the bed stays."""
    keel.floor_load[:] = keel.floor_x[:] = keel.floor_y[:] = keel.floor_arm_x[:] = keel.floor_arm_y[:] = 0.0
    keel.anchor_x[:] = keel.anchor_y[:] = keel.anchor_torque[:] = keel.anchor_capacity[:] = keel.floor_hold[:] = 0.0
    keel.base_xx[:] = keel.base_xy[:] = keel.base_yy[:] = 0.0
    keel.floor_lift[:] = keel.floor_stress[:] = keel.floor_substep[:] = 0.0


@borrower
def write_keels(f: Landing, keel: Keel) -> None:
    """Write what the floor does to the keels of the fragments that touched it."""
    for a in range(f.bodies.size):
        if f.status[a] != DONE:
            continue
        for e in range(f.pads.row_start[a], f.pads.row_start[a + 1]):
            n, load, anchor = f.pads.rows[e], f.loads[e], f.anchors[e]
            keel.floor_load[n], keel.floor_hold[n] = load[LOAD], load[HOLD]
            keel.floor_lift[n], keel.floor_stress[n] = load[LIFT], load[STRESS]
            keel.floor_yield[n], keel.floor_substep[n] = max(f.yielded[e], load[YIELD]), f.substep[a]
            if load[LOAD] > 0.0:
                keel.anchor_x[n], keel.anchor_y[n] = anchor[ANCHOR_X], anchor[ANCHOR_Y]
                keel.anchor_torque[n], keel.anchor_capacity[n] = anchor[ANCHOR_TORQUE], anchor[LARGEST]
                keel.floor_x[n], keel.floor_y[n], _ = floor_force(anchor)
                c, s, (xx, xy, yy) = f.levers[e, 9], f.levers[e, 10], load[SPREAD_XX : SPREAD_YY + 1]
                keel.base_xx[n] = c * c * xx - 2.0 * c * s * xy + s * s * yy
                keel.base_xy[n] = c * s * (xx - yy) + (c * c - s * s) * xy
                keel.base_yy[n] = s * s * xx + 2.0 * c * s * xy + c * c * yy
                keel.floor_arm_x[n], keel.floor_arm_y[n] = anchor[ARM_X], anchor[ARM_Y]
