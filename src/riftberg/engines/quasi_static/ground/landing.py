"""Fragments on the floor: rigid motion in sub-steps, as long as the floor lets them be.

    M (V1 - V0) = h (G(V) + sum B^T f),    V = (V0 + V1) / 2,    position: by V

with the media G and the forces f of the floor in the middle of the sub-step. Friction is an elastic-plastic anchor at the centre
of the load of each element: what the keel moves on (at V1: backward Euler, so that a held fragment comes to rest in any step)
loads it with the stiffness C / anchor way, up to the capacity C. The force is stored, not the way: where a load rises, a stored
way would push the berg back, and make energy.

A sub-step is cut until the floor changes the velocity by little, or holds the fragment, and until touching and coming free are
met within a minute. `advance` takes all fragments up to where they need the depth at another place, which Python asks for all of
them at once.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.bed import Bed
from riftberg.engines.common.forces.media import FORCES, SEA_FLOOR
from riftberg.engines.quasi_static.bodies.dynamics import (
    BodyMatrices,
    ElementForcing,
    add_forces,
    assemble_force_and_jacobian,
)
from riftberg.engines.quasi_static.bodies.pose import Bodies, fill_levers, move_poses
from riftberg.engines.quasi_static.ground.pads import ORIGIN_X, ORIGIN_Y, Pads, fill_hulls, place_points
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
    STRESS,
    YIELD,
    press,
)
from riftberg.physics.geometry import solve, times
from riftberg.state import Floats, Ints
from riftberg.state.variables import Keel

VELOCITY_CHANGE: Final = 0.1
"""Largest part of its speed by which the floor changes that of a fragment in a sub-step, unless it holds it."""

CARRIED_CHANGE: Final = 0.1
"""Part by which the floor may change its hold on a fragment that others push over it, in a step longer than `TOUCH_STEP`."""

SLOW: Final = 1e-3
"""Speed (m s-1) below which changes are measured by this one."""

TOUCH_STEP: Final = 60.0
"""Touching and coming free are met within this time, s."""

LEAST_STEP: Final = 0.01
"""Shortest sub-step, s."""

HELD_STEP: Final = 1e9
"""Length of the next sub-step (s) of a fragment that is held: that of the whole step, whatever it is."""

PASSES: Final = 50
"""Of Newton's method for the friction, after which the sub-step is halved."""

ANCHOR_X, ANCHOR_Y, LARGEST, FORCE_X, FORCE_Y, ARM_X, ARM_Y = range(7)
"""Columns of `Landing.anchors`: friction that anchors an element (N), the largest that could since it touched, force of the floor
with that of its slope (N), and where it acts, from the centre of the element (m, east and north)."""

PATH, VELOCITY, ACCELERATION, NEXT, PUSH, NET, WAY = range(7)
"""Rows of `Landing.motion`, each east, north and turning: way since the start (m), velocity now and acceleration of the last
sub-step, velocity at the end of this one (m s-1), force of others and of the floor (N), way to where the depth is asked (m)."""

(
    TIME, SUBSTEP, RADIUS, ARM, SPEED, SHORTEST, PEAK, PEAK_SPIN, RUBBED, RUBS, CLEARANCE, HELD, REACH, LENGTH, THICKNESS, LEVEL,
) = range(16)  # fmt: skip
"""Columns of `Landing.number`: time since the start and length of the sub-step (s), radii of fragment and gyration (m), speed at
the start (m s-1), shortest sub-step (s), largest force of the floor (N) and the spin then, work of friction so far and in the
sub-step (J), clearance at least (m), friction that can hold in its middle (N), way for which pads are watched (m), bending length
and thickness of the ice (m), and the level at the start, in the middle and at the end of the step (m)."""

NUMBERS: Final = LEVEL + 3

STATUS, TOUCHES, MIDDLE_TOUCHES, SLIDES, ACCEPTED, CARRIED, CHANGED = range(7)
"""Columns of `Landing.flag`; the third and fourth are of the middle of the sub-step, the fifth is of the last call. The last two:
whether contact has taken a fragment that stood on the floor through the step, and whether the floor then holds it otherwise."""

BEGINS, MIDDLE, END, DONE, AFLOAT, BEYOND, TOO_SHORT, UNSETTLED = range(8)
"""Status of a fragment: what it needs the depth for, or how it ended: it touched the floor, or nothing; it went beyond the pads
that are watched; no sub-step was short enough; no rise balances it."""


class Landing(NamedTuple):
    """Fragments on their way through a step; arrays by fragment unless said otherwise."""

    pads: Pads
    plates: Plates
    polygons: Ints  # Those that may touch the floor, by fragment
    polygon_start: Ints  # Where those of each fragment begin; shape (fragments + 1,)
    pose: Floats  # At the start; shape (fragments, 3, 3)
    asked: Floats  # For which the depth is asked
    hull: Floats  # Stiffness against heave and tilts
    mobility: Floats
    motion: Floats  # shape (fragments, rows as above, 3)
    number: Floats  # shape (fragments, columns as above)
    flag: Ints  # shape (fragments, columns as above)
    rise: Floats  # Heave (m) and tilts (rad); shape (fragments, 3)
    draft: Floats  # Of the elements ``pads.rows``, m
    reference: Floats  # Theirs; shape (elements, 3)
    levers: Floats  # Theirs in the middle of the sub-step; shape (elements, 11)
    anchors: Floats  # shape (elements, columns as above)
    tried: Floats  # The same of a sub-step that is not accepted yet
    found: Floats  # What `press` finds for the elements, in the middle or at the end; shape (elements, columns)
    yielded: Floats  # Deepest yield of the bed under each element, m
    bent: Floats  # What `press` finds for the polygons; shape (polygons, 3)
    applied: Floats  # Changes of velocity by all forces, m s-1; shape (elements, forces, 2)
    peak: Floats  # Forces when the floor pressed hardest, and the axes then; shape (elements, 5)


def prepared(pads: Pads, plates: Plates, polygons: Ints, start: Ints, pose: Floats, draft: Floats) -> Landing:
    """Make room for the step of some fragments."""
    count, n = len(pose), draft.size
    return Landing(
        pads, plates, polygons, start, pose, np.empty_like(pose), np.empty_like(pose), np.empty_like(pose),
        np.zeros((count, 7, 3)), np.zeros((count, NUMBERS)), np.zeros((count, 7), np.int64), np.zeros((count, 3)), draft,
        np.empty((n, 3)), np.empty((n, 11)), np.zeros((n, 7)), np.zeros((n, 7)), np.zeros((n, PRESSED)), np.empty(n),
        np.zeros((polygons.size, 5)), np.zeros((n, len(FORCES), 2)), np.zeros((n, 5)),
    )  # fmt: skip


@kernel
def _forcing_of(f: ElementForcing, a: int, z: int) -> ElementForcing:
    """Forcing of the elements ``a`` to ``z``."""
    return ElementForcing(
        f.media[a:z], f.coriolis[a:z], f.mass[a:z], f.inertia[a:z], f.aground[a:z], f.spin_drag[a:z], f.water_spin[a:z],
        f.sides[a:z], f.side_drag[a:z], f.push_x[a:z], f.push_y[a:z], f.media_act,
    )  # fmt: skip


@kernel
def write_points(
    pads: Pads, b: int, polygons: Ints, pose: Floats, latlon: bool, radius: float, at: int, lon: Floats, lat: Floats
) -> int:  # fmt: skip
    """Write the positions of the corners of polygons, then of their centroids, from ``at`` on; returns where they end."""
    ox, oy = pads.frame[b, ORIGIN_X], pads.frame[b, ORIGIN_Y]
    for k in polygons:
        for n in range(pads.start[k], pads.start[k + 1]):
            lon[at], lat[at] = place_points(pads.corner[n, 0] + ox, pads.corner[n, 1] + oy, pose, latlon, radius)
            at += 1
    for k in polygons:
        lon[at], lat[at] = place_points(pads.centre[k, 0] + ox, pads.centre[k, 1] + oy, pose, latlon, radius)
        at += 1
    return at


@kernel
def _level_at(number: Floats, part: float) -> float:
    """Sea level (m) at a part of the step, by a parabola."""
    first, middle, last = number[LEVEL], number[LEVEL + 1], number[LEVEL + 2]
    return float(first + part * (4.0 * middle - 3.0 * first - last + 2.0 * part * (first - 2.0 * middle + last)))


@kernel
def _total(levers: Floats, dx: float, dy: float, x: float, y: float, net: Floats) -> None:
    """Add a force (N, east and north) at (dx, dy) from the centre of an element to that on its fragment."""
    ox, oy = levers[9] * dx - levers[10] * dy, levers[10] * dx + levers[9] * dy
    torque = ox * y - oy * x
    for k in range(3):
        net[k] += levers[k] * x + levers[3 + k] * y + levers[6 + k] * torque


@kernel
def _load_from_centre(now: Landing, a: int, e: int) -> tuple[float, float]:
    """Return where the load of an element lies from its centre, along the axes of the fragment (m)."""
    x = now.found[e, LOAD_X] - now.pads.element[e, 0] - now.pads.frame[a, ORIGIN_X]
    return x, now.found[e, LOAD_Y] - now.pads.element[e, 1] - now.pads.frame[a, ORIGIN_Y]


@kernel
def _turned(m: Floats, x: float, y: float) -> tuple[float, float]:
    """Return a vector along the axes of the fragment east and north at an element; ``m``: its levers."""
    return m[9] * x - m[10] * y, m[10] * x + m[9] * y


@kernel
def _rub(now: Landing, a: int, forcing: ElementForcing, bed: Bed, dt: float) -> bool:
    """Solve for the velocity at the end of a sub-step with the anchors, by Newton's method; False where it does not settle.

    Leaves velocity, net force, anchors, forces and work of friction of the sub-step.
    """
    first, number, motion = now.pads.row_start[a], now.number[a], now.motion[a]
    count = now.pads.row_start[a + 1] - first
    mass = _forcing_of(forcing, first, first + count)
    levers, always, body = now.levers[first : first + count], np.ones(1, np.bool_), np.zeros(count, np.int64)
    loaded, n = np.empty(count, np.int64), 0
    for e in range(count):
        for column in range(ARM_Y + 1):
            now.tried[first + e, column] = 0.0
        if now.found[first + e, LOAD] > 0.0:
            loaded[n] = e
            n += 1
    lever, spring, constant = np.empty((n, 6)), np.empty(n), motion[PUSH].copy()
    away, slope = np.empty((n, 2)), np.empty((n, 2))
    for i in range(n):
        e = first + loaded[i]
        m = now.levers[e]
        away[i, 0], away[i, 1] = _load_from_centre(now, a, e)
        ox, oy = _turned(m, away[i, 0], away[i, 1])
        for k in range(3):
            lever[i, k], lever[i, 3 + k] = m[k] - oy * m[6 + k], m[3 + k] + ox * m[6 + k]
        slope[i, 0], slope[i, 1] = _turned(m, now.found[e, PUSH_X], now.found[e, PUSH_Y])
        _total(m, away[i, 0], away[i, 1], slope[i, 0], slope[i, 1], constant)
        now.tried[e, LARGEST] = max(now.anchors[e, LARGEST], now.found[e, HOLD])
        spring[i] = dt * now.tried[e, LARGEST] / bed.anchor_way
    v0, v, new, step, force = motion[VELOCITY], motion[NEXT], motion[VELOCITY].copy(), np.zeros(3), np.empty((n, 2))
    net, jacobian, twist, total, tangent, r = (
        np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros((1, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3),
    )  # fmt: skip
    mobility, arm, before, scale, passes, slides = now.mobility[a], number[ARM], math.inf, 1.0, 0, np.zeros(n, np.bool_)
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
        for i in range(n):
            e, w = first + loaded[i], lever[i]
            x = now.anchors[e, ANCHOR_X] - spring[i] * (w[0] * new[0] + w[1] * new[1] + w[2] * new[2])
            y = now.anchors[e, ANCHOR_Y] - spring[i] * (w[3] * new[0] + w[4] * new[1] + w[5] * new[2])
            size, limit, part, cx, cy = math.hypot(x, y), now.found[e, HOLD], 1.0, 0.0, 0.0
            slides[i] = size > limit
            if slides[i]:
                part, cx, cy = limit / size, x / size, y / size
            force[i, 0], force[i, 1] = part * x, part * y
            # Slope of the force by the velocity: of a sliding anchor that of its direction alone.
            xx, xy, yy = (
                spring[i] * part * (1.0 - cx * cx),
                -spring[i] * part * cx * cy,
                spring[i] * part * (1.0 - cy * cy),
            )
            for k in range(3):
                total[k] += w[k] * force[i, 0] + w[3 + k] * force[i, 1]
                p, q = xx * w[k] + xy * w[3 + k], xy * w[k] + yy * w[3 + k]
                for j in range(3):
                    tangent[k, j] += p * w[j] + q * w[3 + j]
        gained = times(mobility, total)
        for k in range(3):
            r[k] = new[k] - v0[k] - dt * gained[k]
        size = math.hypot(r[0], r[1]) + arm * abs(r[2])
        if passes > 0 and size >= before and scale >= 1e-3:
            scale *= 0.5
            for k in range(3):
                new[k] = v[k] + scale * step[k]
            continue
        for k in range(3):
            v[k] = new[k]
        before = size
        gone = scale * (math.hypot(step[0], step[1]) + arm * abs(step[2]))
        if passes > 0 and gone <= 1e-12 * max(math.hypot(v[0], v[1]) + arm * abs(v[2]), 1e-6):
            break
        if passes == PASSES:
            return False
        matrix = np.empty((3, 3))
        for k in range(3):
            r[k] = -r[k]
            for j in range(3):
                matrix[k, j] = 1.0 if k == j else 0.0
                for i in range(3):
                    matrix[k, j] += dt * mobility[k, i] * tangent[i, j]
        step[0], step[1], step[2] = solve(matrix, r)
        for k in range(3):
            new[k] = v[k] + step[k]
        scale, passes = 1.0, passes + 1
    for k in range(3):
        motion[NET, k] = 0.0
    now.flag[a, SLIDES], number[HELD], rubbed = 0, 0.0, 0.0
    for i in range(n):
        e, w, limit = first + loaded[i], lever[i], now.found[first + loaded[i], HOLD]
        tried = now.tried[e]
        tried[ANCHOR_X], tried[ANCHOR_Y] = force[i, 0], force[i, 1]
        tried[FORCE_X], tried[FORCE_Y] = force[i, 0] + slope[i, 0], force[i, 1] + slope[i, 1]
        m = now.levers[e]
        tried[ARM_X], tried[ARM_Y] = m[9] * away[i, 0] - m[10] * away[i, 1], m[10] * away[i, 0] + m[9] * away[i, 1]
        _total(m, away[i, 0], away[i, 1], tried[FORCE_X], tried[FORCE_Y], motion[NET])
        number[HELD] += limit
        # Where it slides, the anchor yields over the part of the way, by the mean velocity, that its spring does not take up.
        x = now.anchors[e, ANCHOR_X] - 0.5 * spring[i] * (
            w[0] * (v0[0] + v[0]) + w[1] * (v0[1] + v[1]) + w[2] * (v0[2] + v[2])
        )
        y = now.anchors[e, ANCHOR_Y] - 0.5 * spring[i] * (
            w[3] * (v0[0] + v[0]) + w[4] * (v0[1] + v[1]) + w[5] * (v0[2] + v[2])
        )
        if slides[i]:
            now.flag[a, SLIDES] = 1
            rubbed += limit * max(math.hypot(x, y) - limit, 0.0) * bed.anchor_way / max(tried[LARGEST], 1e-30)
    number[RUBS] = rubbed
    return True


@kernel
def _ask(now: Landing, a: int, t: float, status: int, latlon: bool, radius: float) -> None:
    """Ask for the depth after the way in ``motion[WAY]`` and ``t`` s, as far as the pads are watched."""
    way, twist = now.motion[a, WAY], np.empty((1, 3))
    for k in range(3):
        twist[0, k] = way[k] / t
    move_poses(now.pose[a : a + 1], twist, t, latlon, radius, now.asked[a : a + 1], np.empty((3, 3)))
    gone = math.hypot(way[0], way[1]) + now.number[a, RADIUS] * abs(way[2])
    now.flag[a, STATUS] = status if gone <= now.number[a, REACH] else BEYOND


@kernel
def _length_of_substep(number: Floats, h: float) -> float:
    """Length (s) of the sub-step that is tried, in a step of ``h`` s."""
    left = h - number[TIME]
    return float(left if left < 1.001 * number[SUBSTEP] else number[SUBSTEP])


@kernel
def _begin_substep(now: Landing, a: int, h: float, latlon: bool, radius: float) -> None:
    """Ask for the depth in the middle of a sub-step, where the acceleration of the last one would take the fragment."""
    motion, dt = now.motion[a], _length_of_substep(now.number[a], h)
    for k in range(3):
        motion[WAY, k] = motion[PATH, k] + 0.5 * dt * motion[VELOCITY, k] + 0.125 * dt * dt * motion[ACCELERATION, k]
    _ask(now, a, now.number[a, TIME] + 0.5 * dt, MIDDLE, latlon, radius)


@kernel
def _refuse(now: Landing, a: int, dt: float, part: float, h: float, latlon: bool, radius: float) -> None:
    """Begin anew with a part of a sub-step of ``dt`` s."""
    now.number[a, SUBSTEP] = part * dt
    if part * dt < LEAST_STEP:
        now.flag[a, STATUS] = TOO_SHORT
    else:
        _begin_substep(now, a, h, latlon, radius)


@kernel
def _press(now: Landing, a: int, bed: Bed, h: float, t: float, depth: Floats) -> bool:
    """Press a fragment onto the floor ``t`` s from the start; returns whether it touches it."""
    some, number = slice(now.polygon_start[a], now.polygon_start[a + 1]), now.number[a]
    iterations, largest = press(
        now.pads, now.plates, a, now.polygons[some], depth, now.draft, _level_at(number, t / h), bed, now.hull[a],
        number[LENGTH], number[THICKNESS], now.rise[a], now.found, now.bent[some],
    )  # fmt: skip
    number[CLEARANCE] = min(number[CLEARANCE], -largest)
    if iterations < 0:
        now.flag[a, STATUS] = UNSETTLED
    return largest > 0.0


@kernel
def _go_through_middle(
    now: Landing, a: int, forcing: ElementForcing, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float
) -> None:  # fmt: skip
    """Find the forces in the middle of a sub-step and the velocity after it; ask for the depth at its end."""
    number, flag, motion, dt = now.number[a], now.flag[a], now.motion[a], _length_of_substep(now.number[a], h)
    flag[MIDDLE_TOUCHES] = int(_press(now, a, bed, h, number[TIME] + 0.5 * dt, depth))
    if flag[STATUS] == UNSETTLED:
        return
    if dt == h and dt > TOUCH_STEP and flag[TOUCHES] == flag[MIDDLE_TOUCHES] == 0:
        for k in range(3):  # nothing touches so far: where it goes afloat is where to look
            motion[NEXT, k], motion[NET, k] = motion[VELOCITY, k], 0.0
        flag[SLIDES] = 0
    else:
        first, last = now.pads.row_start[a], now.pads.row_start[a + 1]
        count = last - first
        none = np.empty((0, 3))
        bodies = Bodies(np.zeros(count, np.int64), now.reference[first:last], now.asked[a : a + 1], none, none)
        fill_levers(bodies, latlon, radius, now.levers[first:last])
        if not _rub(now, a, forcing, bed, dt):
            _refuse(now, a, dt, 0.5, h, latlon, radius)
            return
    for k in range(3):
        motion[WAY, k] = motion[PATH, k] + 0.5 * dt * (motion[VELOCITY, k] + motion[NEXT, k])
    _ask(now, a, number[TIME] + dt, END, latlon, radius)


@kernel
def _change(now: Landing, a: int, dt: float, touches: bool) -> float:
    """Change of velocity (m s-1) by a sub-step at the rim, with the greater of the forces in its middle and at its end."""
    motion, number, held, more = now.motion[a], now.number[a], 0.0, np.zeros(3)
    if not (touches or now.flag[a, MIDDLE_TOUCHES]):
        return 0.0
    for e in range(now.pads.row_start[a], now.pads.row_start[a + 1]):
        held += now.found[e, HOLD]
    if now.flag[a, MIDDLE_TOUCHES]:
        for k in range(3):
            more[k] = max(0.0, held / max(number[HELD], 1e-30) - 1.0) * motion[NET, k]
    else:
        speed = max(math.hypot(motion[VELOCITY, 0], motion[VELOCITY, 1]), 1e-12)
        more[0], more[1] = -held * motion[VELOCITY, 0] / speed, -held * motion[VELOCITY, 1] / speed
    gained = times(now.mobility[a], more)
    for k in range(3):
        more[k] = motion[NEXT, k] - motion[VELOCITY, k] + dt * gained[k]
    return float(math.hypot(more[0], more[1]) + number[ARM] * abs(more[2]))


@kernel
def _go_through_end(
    now: Landing, a: int, forcing: ElementForcing, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float
) -> None:  # fmt: skip
    """Accept a sub-step by the forces at its end, or refuse it; begin the next one."""
    number, flag, motion, dt = now.number[a], now.flag[a], now.motion[a], _length_of_substep(now.number[a], h)
    touches = _press(now, a, bed, h, number[TIME] + dt, depth)
    if flag[STATUS] == UNSETTLED:
        return
    same = flag[TOUCHES] == flag[MIDDLE_TOUCHES] == int(touches)
    if same and not touches and dt == h:
        flag[STATUS] = AFLOAT
        return
    if not same and dt > TOUCH_STEP:
        _refuse(now, a, dt, 0.5, h, latlon, radius)
        return
    v0, v1 = motion[VELOCITY], motion[NEXT]
    way = 0.5 * dt * (math.hypot(v0[0] + v1[0], v0[1] + v1[1]) + number[ARM] * abs(v0[2] + v1[2]))
    held = flag[SLIDES] == 0 and way <= bed.anchor_way
    speed = math.hypot(v0[0], v0[1]) + number[ARM] * abs(v0[2])
    ratio = 0.0 if held else _change(now, a, dt, touches) / (VELOCITY_CHANGE * max(speed, 0.5 * number[SPEED], SLOW))
    if ratio > 1.0:
        _refuse(now, a, dt, min(max(0.85 / ratio, 0.05), 0.7), h, latlon, radius)
        return
    _accept(now, a, forcing, dt)
    flag[TOUCHES], flag[ACCEPTED] = int(touches), 1
    longer = dt * (2.0 if ratio == 0.0 else min(max(0.85 / ratio, 1.0), 3.0))
    slowing = -(motion[ACCELERATION, 0] * v0[0] + motion[ACCELERATION, 1] * v0[1])
    if flag[SLIDES] == 0 and touches:
        longer = HELD_STEP
    elif slowing > 0.0 and flag[SLIDES]:
        # Just before it stops: over a way shorter than that of the anchor the floor stops the fragment at once.
        speed = math.hypot(v0[0], v0[1])
        stop = speed * speed / slowing
        if 0.5 * speed * stop < 0.9 * bed.anchor_way:
            longer = max(longer, 1.2 * stop)
    number[SUBSTEP] = max(longer, number[SUBSTEP]) if dt < number[SUBSTEP] else longer
    if h - number[TIME] > 1e-12 * h:
        _begin_substep(now, a, h, latlon, radius)
    else:
        flag[STATUS] = DONE


@kernel
def _accept(now: Landing, a: int, forcing: ElementForcing, dt: float) -> None:
    """Make a sub-step the state of a fragment."""
    first, last, number, motion = now.pads.row_start[a], now.pads.row_start[a + 1], now.number[a], now.motion[a]
    count, mean = last - first, np.empty((1, 3))
    for k in range(3):
        mean[0, k] = 0.5 * (motion[VELOCITY, k] + motion[NEXT, k])
        motion[ACCELERATION, k] = (motion[NEXT, k] - motion[VELOCITY, k]) / dt
        motion[VELOCITY, k] = motion[NEXT, k]
        motion[PATH, k] += dt * mean[0, k]
    accelerations, rate, force, net = (
        np.zeros((count, len(FORCES), 2)),
        np.empty((count, 3)),
        np.empty((count, 3)),
        np.zeros((1, 3)),
    )
    mass, levers = _forcing_of(forcing, first, last), now.levers[first:last]
    add_forces(np.zeros(count, np.int64), levers, mean, mass, accelerations, rate, force, net)
    size = 0.0
    for e in range(count):
        of_floor, applied = now.tried[first + e], now.applied[first + e]
        accelerations[e, SEA_FLOOR, 0] += of_floor[FORCE_X] / mass.mass[e]
        accelerations[e, SEA_FLOOR, 1] += of_floor[FORCE_Y] / mass.mass[e]
        for k in range(len(FORCES)):
            applied[k, 0] += dt * accelerations[e, k, 0]
            applied[k, 1] += dt * accelerations[e, k, 1]
        for column in range(ARM_Y + 1):
            now.anchors[first + e, column] = of_floor[column]
        now.yielded[first + e] = max(now.yielded[first + e], now.found[first + e, YIELD])
        size += math.hypot(of_floor[FORCE_X], of_floor[FORCE_Y])
    if size > number[PEAK]:
        number[PEAK], number[PEAK_SPIN] = size, motion[VELOCITY, 2]
        for e in range(count):
            of_floor, peak = now.tried[first + e], now.peak[first + e]
            peak[0], peak[1] = force[e, 0] + of_floor[FORCE_X], force[e, 1] + of_floor[FORCE_Y]
            torque = of_floor[ARM_X] * of_floor[FORCE_Y] - of_floor[ARM_Y] * of_floor[FORCE_X]
            peak[2], peak[3], peak[4] = force[e, 2] + torque, levers[e, 9], levers[e, 10]
    number[TIME] += dt
    number[SHORTEST] = min(number[SHORTEST], dt)
    number[RUBBED] += number[RUBS]


@kernel
def carry(now: Landing, a: int, path: Floats, twist: Floats, anchors: Floats, applied: Floats, rubbed: float) -> None:
    """Let contact take a fragment on the floor through the step: its way and velocity, and friction and impulses on its elements.

    ``anchors``: friction at the end, N; shape (elements, 2). ``rubbed``: its work, J.
    """
    first, number = now.pads.row_start[a], now.number[a]
    now.flag[a, CARRIED], number[RUBBED], number[SHORTEST] = 1, rubbed, TOUCH_STEP
    for k in range(3):
        now.motion[a, PATH, k], now.motion[a, VELOCITY, k] = path[k], twist[k]
    for e in range(anchors.shape[0]):
        now.anchors[first + e, ANCHOR_X], now.anchors[first + e, ANCHOR_Y] = anchors[e, 0], anchors[e, 1]
        for k in range(applied.shape[1]):
            now.applied[first + e, k, 0], now.applied[first + e, k, 1] = applied[e, k, 0], applied[e, k, 1]


@kernel
def _set_down(now: Landing, a: int, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float) -> None:
    """Find what the floor does to a fragment where contact has taken it."""
    number, flag, first, last, held = now.number[a], now.flag[a], now.pads.row_start[a], now.pads.row_start[a + 1], 0.0
    _press(now, a, bed, h, h, depth)
    if flag[STATUS] == UNSETTLED:
        return
    none = np.empty((0, 3))
    bodies = Bodies(np.zeros(last - first, np.int64), now.reference[first:last], now.asked[a : a + 1], none, none)
    fill_levers(bodies, latlon, radius, now.levers[first:last])
    for e in range(first, last):
        m, anchor, found = now.levers[e], now.anchors[e], now.found[e]
        held += found[HOLD]
        now.yielded[e] = max(now.yielded[e], found[YIELD])
        anchor[LARGEST] = max(anchor[LARGEST], found[HOLD])
        x, y = _turned(m, found[PUSH_X], found[PUSH_Y])
        anchor[FORCE_X], anchor[FORCE_Y] = anchor[ANCHOR_X] + x, anchor[ANCHOR_Y] + y
        away = _load_from_centre(now, a, e)
        anchor[ARM_X], anchor[ARM_Y] = _turned(m, away[0], away[1])
    way = math.hypot(now.motion[a, PATH, 0], now.motion[a, PATH, 1]) + number[ARM] * abs(now.motion[a, PATH, 2])
    changed = abs(held - number[HELD]) > CARRIED_CHANGE * number[HELD]
    flag[CHANGED], flag[ACCEPTED], flag[STATUS] = int(changed and way > bed.anchor_way), 1, DONE


@kernel
def board(now: Landing, numbers: Ints, bodies: Bodies, keel: Keel, thickness: Floats, bed: Bed) -> None:
    """Let fragments begin a step where they are; ``thickness``: of the elements ``pads.rows``, m."""
    fill_hulls(
        now.pads,
        thickness,
        now.draft,
        bed.modulus,
        bed.poisson,
        now.hull,
        now.number[:, THICKNESS],
        now.number[:, LENGTH],
    )
    for a in range(numbers.size):
        number, flag = now.number[a], now.flag[a]
        flag[STATUS] = AFLOAT if now.polygon_start[a] == now.polygon_start[a + 1] else BEGINS
        for k in range(3):
            now.motion[a, VELOCITY, k] = bodies.twist[numbers[a], k]
        for n in range(now.pads.row_start[a], now.pads.row_start[a + 1]):
            e = now.pads.rows[n]
            for k in range(3):
                now.reference[n, k] = bodies.reference[e, k]
            now.anchors[n, ANCHOR_X], now.anchors[n, ANCHOR_Y] = keel.anchor_x[e], keel.anchor_y[e]
            now.anchors[n, LARGEST], now.yielded[n] = keel.anchor_capacity[e], keel.floor_yield[e]
            number[HELD] += keel.floor_hold[e]
            if keel.floor_load[e] > 0.0 or keel.anchor_x[e] != 0.0 or keel.anchor_y[e] != 0.0:
                flag[TOUCHES] = 1
        substep = keel.floor_substep[now.pads.rows[now.pads.row_start[a]]]
        number[SUBSTEP] = substep if flag[TOUCHES] and substep > 0.0 else HELD_STEP
        number[SHORTEST], number[PEAK] = math.inf, -1.0


@kernel
def set_going(now: Landing, numbers: Ints, matrices: BodyMatrices) -> None:
    """Give fragments their inertia."""
    for a in range(numbers.size):
        inertia, number = matrices.inertia[numbers[a]], now.number[a]
        for i in range(3):
            for j in range(3):
                now.mobility[a, i, j] = matrices.mobility[numbers[a], i, j]
        twist, number[ARM] = now.motion[a, VELOCITY], math.sqrt(inertia[2, 2] / inertia[0, 0])
        number[SPEED] = math.hypot(twist[0], twist[1]) + number[ARM] * abs(twist[2])


@kernel
def lift_off(keel: Keel) -> None:
    """Nothing is on the floor; what it has yielded stays."""
    for e in range(keel.floor_load.size):
        keel.floor_load[e] = keel.floor_x[e] = keel.floor_y[e] = keel.floor_arm_x[e] = keel.floor_arm_y[e] = 0.0
        keel.anchor_x[e] = keel.anchor_y[e] = keel.anchor_capacity[e] = keel.floor_hold[e] = 0.0
        keel.floor_lift[e] = keel.floor_stress[e] = keel.floor_substep[e] = 0.0


@kernel
def write_loads(now: Landing, keel: Keel) -> None:
    """Write what the press has found to the keels of the fragments that touched the floor."""
    for a in range(len(now.flag)):
        if now.flag[a, STATUS] == DONE:
            for n in range(now.pads.row_start[a], now.pads.row_start[a + 1]):
                e, found = now.pads.rows[n], now.found[n]
                keel.floor_load[e], keel.floor_hold[e] = found[LOAD], found[HOLD]
                keel.floor_lift[e], keel.floor_stress[e] = found[LIFT], found[STRESS]
                keel.floor_yield[e] = max(now.yielded[n], found[YIELD])


@kernel
def write_friction(now: Landing, keel: Keel) -> None:
    """Write friction and length of the next sub-step to the same keels."""
    for a in range(len(now.flag)):
        if now.flag[a, STATUS] == DONE:
            for n in range(now.pads.row_start[a], now.pads.row_start[a + 1]):
                e, anchor = now.pads.rows[n], now.anchors[n]
                if now.found[n, LOAD] > 0.0:
                    keel.anchor_x[e], keel.anchor_y[e], keel.anchor_capacity[e] = anchor[0], anchor[1], anchor[LARGEST]
                    keel.floor_x[e], keel.floor_y[e] = anchor[FORCE_X], anchor[FORCE_Y]
                    keel.floor_arm_x[e], keel.floor_arm_y[e] = anchor[ARM_X], anchor[ARM_Y]
                keel.floor_substep[e] = now.number[a, SUBSTEP]


@kernel
def press_all(now: Landing, bed: Bed, latlon: bool, radius: float, depth: Floats, lon: Floats, lat: Floats) -> int:
    """Write the points where all fragments need the depth as they stand, or press them by it; returns the number of points."""
    at = 0
    for a in range(len(now.flag)):
        polygons, before = now.polygons[now.polygon_start[a] : now.polygon_start[a + 1]], at
        at = write_points(now.pads, a, polygons, now.pose[a], latlon, radius, at, lon, lat)
        if depth.size and now.flag[a, STATUS] == BEGINS:
            now.flag[a, STATUS] = DONE
            _press(now, a, bed, 1.0, 0.0, depth[before:at])
    return at


@kernel
def advance(
    now: Landing, forcing: ElementForcing, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float, lon: Floats,
    lat: Floats,
) -> int:  # fmt: skip
    """Take all fragments up to where they need the depth at another place; returns the number of points that they ask for.

    ``forcing``: of the elements ``pads.rows``; ``h``: the step, s; ``depth`` (m) at the points of the last call; ``lon`` and
    ``lat`` take those that are asked for.
    """
    at = asked = 0
    for a in range(len(now.flag)):
        polygons, flag = now.polygons[now.polygon_start[a] : now.polygon_start[a + 1]], now.flag[a]
        flag[ACCEPTED] = 0
        if flag[STATUS] == BEGINS and flag[CARRIED] == 1:
            for k in range(3):
                now.motion[a, WAY, k] = now.motion[a, PATH, k]
            _ask(now, a, h, END, latlon, radius)
        elif flag[STATUS] == BEGINS:
            _begin_substep(now, a, h, latlon, radius)
        elif flag[STATUS] == MIDDLE or flag[STATUS] == END:
            size = polygons.size
            for k in polygons:
                size += now.pads.start[k + 1] - now.pads.start[k]
            if flag[CARRIED] == 1:
                _set_down(now, a, bed, h, depth[at : at + size], latlon, radius)
            elif flag[STATUS] == MIDDLE:
                _go_through_middle(now, a, forcing, bed, h, depth[at : at + size], latlon, radius)
            else:
                _go_through_end(now, a, forcing, bed, h, depth[at : at + size], latlon, radius)
            at += size
        if flag[STATUS] == MIDDLE or flag[STATUS] == END:
            asked = write_points(now.pads, a, polygons, now.asked[a], latlon, radius, asked, lon, lat)
    return asked
