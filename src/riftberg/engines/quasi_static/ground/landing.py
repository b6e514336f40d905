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
    take_elements,
)
from riftberg.engines.quasi_static.bodies.pose import Bodies, fill_levers, move_poses
from riftberg.engines.quasi_static.contact.anchors import GIVES_WAY
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
"""Largest relative change of a fragment's speed by the floor in a sub-step, unless the floor holds the fragment."""

CARRIED_CHANGE: Final = 0.03
"""The same in a step of contact, which knows the friction at its start alone, by how that has changed at its end."""

HOLD_CHANGE: Final = 0.05
"""Part of its hold, or of what others push with, by which the floor may change its hold in a step of contact in any case: a
crumb goes with those that push it."""

SLOW: Final = 1e-3
"""Speed (m s-1) below which changes are measured by this one."""

TOUCH_STEP: Final = 60.0
"""Touching and coming free are met within this time, s."""

SHORTEST_PUSHED_STEP: Final = 10.0
"""Shortest step (s) to which a change of hold under a fragment that others push leads; then it goes as the floor says."""

LEAST_STEP: Final = 0.01
"""Shortest sub-step, s."""

HELD_STEP: Final = 1e9
"""Length of the next sub-step (s) of a held fragment: longer than any step, so that it takes the whole step at once."""

PASSES: Final = 50
"""Of Newton's method for the friction, after which the sub-step is halved."""

ANCHOR_X, ANCHOR_Y, LARGEST, FORCE_X, FORCE_Y, ARM_X, ARM_Y = range(7)
"""Columns of `Landing.anchors`: friction that anchors an element (N), the largest that could since it touched, force of the floor
with that of its slope (N), and where it acts, from the centre of the element (m, east and north)."""

PATH, VELOCITY, ACCELERATION, NEXT, PUSH, NET, WAY = range(7)
"""Rows of `Landing.motion`, each east, north and turning: way since the start (m), velocity now and acceleration of the last
sub-step, velocity at the end of this one (m s-1), force of others and of the floor (N), way to where the depth is asked (m)."""

(
    TIME, SUBSTEP, RADIUS, ARM, SPEED, SHORTEST, PEAK, PEAK_SPIN, PEAK_TIME, RUBBED, RUBS, CLEARANCE, HELD, CHANGE, REACH, LENGTH,
    THICKNESS, LEVEL,
) = range(18)  # fmt: skip
"""Columns of `Landing.number`: time since the start and length of the sub-step (s), radii of fragment and gyration (m), speed at
the start (m s-1), shortest sub-step (s), largest force of the floor (N), spin and time then, work of friction so far and in the
sub-step (J), clearance at least (m), friction that can hold in its middle (N), by how many times what it may the floor
has changed its hold in a step of contact, way for which pads are watched (m), bending length and thickness of the
ice (m), and the level at the start, in the middle and at the end of the step (m)."""

NUMBERS: Final = LEVEL + 3

STATUS, TOUCHES, MIDDLE_TOUCHES, SLIDES, ACCEPTED, CARRIED = range(6)
"""Columns of `Landing.flag`; the third and fourth are of the middle of the sub-step, the fifth is of the last call. The last:
whether contact has taken a fragment that stood on the floor through the step."""

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
    sounded_pose: Floats  # For which the depth is asked
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
    trial_anchors: Floats  # The same of a sub-step that is not accepted yet
    loads: Floats  # Columns of `press` for the elements, in the middle or at the end; shape (elements, columns)
    yielded: Floats  # Deepest yield of the bed under each element, m
    bent: Floats  # Results of `press` for the polygons; shape (polygons, 5)
    applied: Floats  # Changes of velocity by all forces, m s-1; shape (elements, forces, 2)
    peak: Floats  # Forces when the floor pressed hardest, and the axes then; shape (elements, 5)


def prepare(pads: Pads, plates: Plates, polygons: Ints, start: Ints, pose: Floats, draft: Floats) -> Landing:
    """Make room for the step of some fragments."""
    count, n = len(pose), draft.size
    return Landing(
        pads, plates, polygons, start, pose, np.empty_like(pose), np.empty_like(pose), np.empty_like(pose),
        np.zeros((count, 7, 3)), np.zeros((count, NUMBERS)), np.zeros((count, 6), np.int64), np.zeros((count, 3)), draft,
        np.empty((n, 3)), np.empty((n, 11)), np.zeros((n, 7)), np.zeros((n, 7)), np.zeros((n, PRESSED)), np.empty(n),
        np.zeros((polygons.size, 5)), np.zeros((n, len(FORCES), 2)), np.zeros((n, 5)),
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
def _interpolate_level(number: Floats, fraction: float) -> float:
    """Sea level (m) at a part of the step, by a parabola."""
    first, middle, last = number[LEVEL], number[LEVEL + 1], number[LEVEL + 2]
    return float(
        first + fraction * (4.0 * middle - 3.0 * first - last + 2.0 * fraction * (first - 2.0 * middle + last))
    )


@kernel
def _add_force(levers: Floats, dx: float, dy: float, x: float, y: float, net: Floats) -> None:
    """Add a force (N, east and north) at (dx, dy) from the centre of an element to that on its fragment."""
    ox, oy = levers[9] * dx - levers[10] * dy, levers[10] * dx + levers[9] * dy
    torque = ox * y - oy * x
    for k in range(3):
        net[k] += levers[k] * x + levers[3 + k] * y + levers[6 + k] * torque


@kernel
def _load_from_centre(fragments: Landing, a: int, e: int) -> tuple[float, float]:
    """Return where the load of an element lies from its centre, along the axes of the fragment (m)."""
    x = fragments.loads[e, LOAD_X] - fragments.pads.element[e, 0] - fragments.pads.frame[a, ORIGIN_X]
    return x, fragments.loads[e, LOAD_Y] - fragments.pads.element[e, 1] - fragments.pads.frame[a, ORIGIN_Y]


@kernel
def _turned(m: Floats, x: float, y: float) -> tuple[float, float]:
    """Return a vector along the axes of the fragment east and north at an element; ``m``: its levers."""
    return m[9] * x - m[10] * y, m[10] * x + m[9] * y


@kernel
def _solve_friction(fragments: Landing, a: int, forcing: ElementForcing, bed: Bed, dt: float) -> bool:
    """Solve for the velocity at the end of a sub-step with the anchors, by Newton's method; False where it does not settle.

    Leaves velocity, net force, anchors, forces and work of friction of the sub-step.
    """
    first, number, motion = fragments.pads.row_start[a], fragments.number[a], fragments.motion[a]
    count = fragments.pads.row_start[a + 1] - first
    mass = take_elements(forcing, slice(first, first + count))
    levers, always, body = fragments.levers[first : first + count], np.ones(1, np.bool_), np.zeros(count, np.int64)
    loaded, n = np.empty(count, np.int64), 0
    for e in range(count):
        for column in range(ARM_Y + 1):
            fragments.trial_anchors[first + e, column] = 0.0
        if fragments.loads[first + e, LOAD] > 0.0:
            loaded[n] = e
            n += 1
    lever, spring, constant = np.empty((n, 6)), np.empty(n), motion[PUSH].copy()
    offset, slope = np.empty((n, 2)), np.empty((n, 2))
    for i in range(n):
        e = first + loaded[i]
        m = fragments.levers[e]
        offset[i, 0], offset[i, 1] = _load_from_centre(fragments, a, e)
        ox, oy = _turned(m, offset[i, 0], offset[i, 1])
        for k in range(3):
            lever[i, k], lever[i, 3 + k] = m[k] - oy * m[6 + k], m[3 + k] + ox * m[6 + k]
        slope[i, 0], slope[i, 1] = _turned(m, fragments.loads[e, PUSH_X], fragments.loads[e, PUSH_Y])
        _add_force(m, offset[i, 0], offset[i, 1], slope[i, 0], slope[i, 1], constant)
        fragments.trial_anchors[e, LARGEST] = max(fragments.anchors[e, LARGEST], fragments.loads[e, HOLD])
        spring[i] = dt * fragments.trial_anchors[e, LARGEST] / bed.anchor_way
    v0, v, new, step, force = motion[VELOCITY], motion[NEXT], motion[VELOCITY].copy(), np.zeros(3), np.empty((n, 2))
    net, jacobian, twist, total, tangent, r = (
        np.zeros((1, 3)), np.zeros((1, 3, 3)), np.zeros((1, 3)), np.zeros(3), np.zeros((3, 3)), np.zeros(3),
    )  # fmt: skip
    mobility, arm, slides = fragments.mobility[a], number[ARM], np.zeros(n, np.bool_)
    previous_size, scale, passes = math.inf, 1.0, 0
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
            x = fragments.anchors[e, ANCHOR_X] - spring[i] * (w[0] * new[0] + w[1] * new[1] + w[2] * new[2])
            y = fragments.anchors[e, ANCHOR_Y] - spring[i] * (w[3] * new[0] + w[4] * new[1] + w[5] * new[2])
            size, limit, fraction, cx, cy = math.hypot(x, y), fragments.loads[e, HOLD], 1.0, 0.0, 0.0
            # As if all anchors held at first: a fragment that turns about one of them seems to slide by its last velocity.
            slides[i] = size > limit and passes > 0
            if slides[i]:
                fraction, cx, cy = limit / size, x / size, y / size
            force[i, 0], force[i, 1] = fraction * x, fraction * y
            # Slope of the force by the velocity: of a sliding anchor that of its direction alone.
            xx, xy, yy = (
                spring[i] * fraction * (1.0 - cx * cx),
                -spring[i] * fraction * cx * cy,
                spring[i] * fraction * (1.0 - cy * cy),
            )
            for k in range(3):
                total[k] += w[k] * force[i, 0] + w[3 + k] * force[i, 1]
                p, q = xx * w[k] + xy * w[3 + k], xy * w[k] + yy * w[3 + k]
                for j in range(3):
                    tangent[k, j] += p * w[j] + q * w[3 + j]
        acceleration = times(mobility, total)
        for k in range(3):
            r[k] = new[k] - v0[k] - dt * acceleration[k]
        size = math.hypot(r[0], r[1]) + arm * abs(r[2])
        if passes > 1 and size >= previous_size and scale >= 1e-3:
            scale *= 0.5
            for k in range(3):
                new[k] = v[k] + scale * step[k]
            continue
        for k in range(3):
            v[k] = new[k]
        previous_size = size
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
        change, speed = math.hypot(step[0], step[1]) + arm * abs(step[2]), math.hypot(v[0], v[1]) + arm * abs(v[2])
        if passes > 0 and change <= 1e-12 * max(speed, 1e-6):
            break
        for k in range(3):
            new[k] = v[k] + step[k]
        scale, passes = 1.0, passes + 1
    for k in range(3):
        motion[NET, k] = 0.0
    fragments.flag[a, SLIDES], number[HELD], rubbed = 0, 0.0, 0.0
    for i in range(n):
        e, w, limit = first + loaded[i], lever[i], fragments.loads[first + loaded[i], HOLD]
        trial_anchor = fragments.trial_anchors[e]
        trial_anchor[ANCHOR_X], trial_anchor[ANCHOR_Y] = force[i, 0], force[i, 1]
        trial_anchor[FORCE_X], trial_anchor[FORCE_Y] = force[i, 0] + slope[i, 0], force[i, 1] + slope[i, 1]
        m = fragments.levers[e]
        trial_anchor[ARM_X], trial_anchor[ARM_Y] = (
            m[9] * offset[i, 0] - m[10] * offset[i, 1],
            m[10] * offset[i, 0] + m[9] * offset[i, 1],
        )
        _add_force(m, offset[i, 0], offset[i, 1], trial_anchor[FORCE_X], trial_anchor[FORCE_Y], motion[NET])
        number[HELD] += limit
        # Where it slides, the anchor yields over the part of the way, by the mean velocity, that its spring does not take up.
        x = fragments.anchors[e, ANCHOR_X] - 0.5 * spring[i] * (
            w[0] * (v0[0] + v[0]) + w[1] * (v0[1] + v[1]) + w[2] * (v0[2] + v[2])
        )
        y = fragments.anchors[e, ANCHOR_Y] - 0.5 * spring[i] * (
            w[3] * (v0[0] + v[0]) + w[4] * (v0[1] + v[1]) + w[5] * (v0[2] + v[2])
        )
        if slides[i]:
            fragments.flag[a, SLIDES] = 1
            rubbed += limit * max(math.hypot(x, y) - limit, 0.0) * bed.anchor_way / max(trial_anchor[LARGEST], 1e-30)
    number[RUBS] = rubbed
    return True


@kernel
def _request_depth(fragments: Landing, a: int, t: float, status: int, latlon: bool, radius: float) -> None:
    """Ask for the depth after the way in ``motion[WAY]`` and ``t`` s, as far as the pads are watched."""
    displacement, twist = fragments.motion[a, WAY], np.empty((1, 3))
    for k in range(3):
        twist[0, k] = displacement[k] / t
    move_poses(fragments.pose[a : a + 1], twist, t, latlon, radius, fragments.sounded_pose[a : a + 1], np.empty((3, 3)))
    gone = math.hypot(displacement[0], displacement[1]) + fragments.number[a, RADIUS] * abs(displacement[2])
    fragments.flag[a, STATUS] = status if gone <= fragments.number[a, REACH] else BEYOND


@kernel
def _substep_length(number: Floats, h: float) -> float:
    """Length (s) of the sub-step that is tried, in a step of ``h`` s."""
    left = h - number[TIME]
    return float(left / max(math.ceil(left / number[SUBSTEP] - 1e-3), 1))  # in equal parts: the last one is no sliver


@kernel
def _begin_substep(fragments: Landing, a: int, h: float, latlon: bool, radius: float) -> None:
    """Ask for the depth in the middle of a sub-step, where the acceleration of the last one would take the fragment."""
    motion, dt = fragments.motion[a], _substep_length(fragments.number[a], h)
    for k in range(3):
        motion[WAY, k] = motion[PATH, k] + 0.5 * dt * motion[VELOCITY, k] + 0.125 * dt * dt * motion[ACCELERATION, k]
    _request_depth(fragments, a, fragments.number[a, TIME] + 0.5 * dt, MIDDLE, latlon, radius)


@kernel
def _refuse(fragments: Landing, a: int, dt: float, fraction: float, h: float, latlon: bool, radius: float) -> None:
    """Begin anew with a part of a sub-step of ``dt`` s."""
    fragments.number[a, SUBSTEP] = fraction * dt
    if fraction * dt < LEAST_STEP:
        fragments.flag[a, STATUS] = TOO_SHORT
    else:
        _begin_substep(fragments, a, h, latlon, radius)


@kernel
def _press(fragments: Landing, a: int, bed: Bed, h: float, t: float, depth: Floats) -> bool:
    """Press a fragment onto the floor ``t`` s from the start; returns whether it touches it."""
    own_polygons, number = slice(fragments.polygon_start[a], fragments.polygon_start[a + 1]), fragments.number[a]
    iterations, largest = press(
        fragments.pads, fragments.plates, a, fragments.polygons[own_polygons], depth, fragments.draft,
        _interpolate_level(number, t / h), bed, fragments.hull[a],
        number[LENGTH], number[THICKNESS], fragments.rise[a], fragments.loads, fragments.bent[own_polygons],
    )  # fmt: skip
    number[CLEARANCE] = min(number[CLEARANCE], -largest)
    if iterations < 0:
        fragments.flag[a, STATUS] = UNSETTLED
    return largest > 0.0


@kernel
def _go_through_middle(
    fragments: Landing, a: int, forcing: ElementForcing, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float
) -> None:  # fmt: skip
    """Find the forces in the middle of a sub-step and the velocity after it; ask for the depth at its end."""
    number, flag, motion, dt = (
        fragments.number[a],
        fragments.flag[a],
        fragments.motion[a],
        _substep_length(fragments.number[a], h),
    )
    flag[MIDDLE_TOUCHES] = int(_press(fragments, a, bed, h, number[TIME] + 0.5 * dt, depth))
    if flag[STATUS] == UNSETTLED:
        return
    if dt == h and dt > TOUCH_STEP and flag[TOUCHES] == flag[MIDDLE_TOUCHES] == 0:
        for k in range(3):  # nothing touches so far: where it goes afloat is where to look
            motion[NEXT, k], motion[NET, k] = motion[VELOCITY, k], 0.0
        flag[SLIDES] = 0
    else:
        first, last = fragments.pads.row_start[a], fragments.pads.row_start[a + 1]
        count = last - first
        none = np.empty((0, 3))
        bodies = Bodies(
            np.zeros(count, np.int64), fragments.reference[first:last], fragments.sounded_pose[a : a + 1], none, none
        )
        fill_levers(bodies, latlon, radius, fragments.levers[first:last])
        if not _solve_friction(fragments, a, forcing, bed, dt):
            _refuse(fragments, a, dt, 0.5, h, latlon, radius)
            return
    middle, end = number[TIME] + 0.5 * dt, number[TIME] + dt
    is_level = _interpolate_level(number, middle / h) == _interpolate_level(number, end / h)
    if is_level and flag[MIDDLE_TOUCHES] == 1 and _is_held(fragments, a, bed, dt):
        # A berg that stands still in water that does not rise or fall is pressed at the end as it is in the middle.
        _end_substep(fragments, a, forcing, bed, h, True, latlon, radius)
        return
    for k in range(3):
        motion[WAY, k] = motion[PATH, k] + 0.5 * dt * (motion[VELOCITY, k] + motion[NEXT, k])
    _request_depth(fragments, a, end, END, latlon, radius)


@kernel
def _is_held(fragments: Landing, a: int, bed: Bed, dt: float) -> bool:
    """Whether no anchor slides in the middle of a sub-step, and the fragment goes no farther in it than an anchor gives way."""
    first, last = fragments.motion[a, VELOCITY], fragments.motion[a, NEXT]
    speed = math.hypot(first[0] + last[0], first[1] + last[1]) + fragments.number[a, ARM] * abs(first[2] + last[2])
    return bool(fragments.flag[a, SLIDES] == 0 and 0.5 * dt * speed <= bed.anchor_way)


@kernel
def _change(fragments: Landing, a: int, dt: float, touches: bool) -> Floats:
    """Change of velocity by a sub-step, with the greater of the forces in its middle and at its end."""
    motion, number, friction, more = fragments.motion[a], fragments.number[a], 0.0, np.zeros(3)
    if not (touches or fragments.flag[a, MIDDLE_TOUCHES]):
        return more
    for e in range(fragments.pads.row_start[a], fragments.pads.row_start[a + 1]):
        friction += fragments.loads[e, HOLD]
    if fragments.flag[a, MIDDLE_TOUCHES]:
        for k in range(3):
            more[k] = max(0.0, friction / max(number[HELD], 1e-30) - 1.0) * motion[NET, k]
    else:
        speed = max(math.hypot(motion[VELOCITY, 0], motion[VELOCITY, 1]), 1e-12)
        more[0], more[1] = -friction * motion[VELOCITY, 0] / speed, -friction * motion[VELOCITY, 1] / speed
    acceleration = times(fragments.mobility[a], more)
    for k in range(3):
        more[k] = motion[NEXT, k] - motion[VELOCITY, k] + dt * acceleration[k]
    return more


@kernel
def _go_through_end(
    fragments: Landing, a: int, forcing: ElementForcing, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float
) -> None:  # fmt: skip
    """Find the forces at the end of a sub-step, and end it."""
    number, flag = fragments.number[a], fragments.flag[a]
    dt = _substep_length(number, h)
    touches = _press(fragments, a, bed, h, number[TIME] + dt, depth)
    if flag[STATUS] == UNSETTLED:
        return
    if flag[TOUCHES] == flag[MIDDLE_TOUCHES] == int(touches) == 0 and dt == h:
        flag[STATUS] = AFLOAT
    else:
        _end_substep(fragments, a, forcing, bed, h, touches, latlon, radius)


@kernel
def relative_change(fragments: Landing, a: int, change: Floats) -> float:
    """Return a change of the velocity of a fragment as a part of its speed."""
    number, v = fragments.number[a], fragments.motion[a, VELOCITY]
    speed = math.hypot(v[0], v[1]) + number[ARM] * abs(v[2])
    size = math.hypot(change[0], change[1]) + number[ARM] * abs(change[2])
    return float(size / max(speed, 0.5 * number[SPEED], SLOW))


@kernel
def _end_substep(
    fragments: Landing, a: int, forcing: ElementForcing, bed: Bed, h: float, touches: bool, latlon: bool, radius: float
) -> None:  # fmt: skip
    """Accept a sub-step by the forces at its end, or refuse it; begin the next one."""
    number, flag, motion = fragments.number[a], fragments.flag[a], fragments.motion[a]
    dt = _substep_length(number, h)
    same = flag[TOUCHES] == flag[MIDDLE_TOUCHES] == int(touches)
    if not same and dt > TOUCH_STEP:
        _refuse(fragments, a, dt, 0.5, h, latlon, radius)
        return
    v0, is_held = motion[VELOCITY], _is_held(fragments, a, bed, dt)
    ratio = 0.0 if is_held else relative_change(fragments, a, _change(fragments, a, dt, touches)) / VELOCITY_CHANGE
    if ratio > 1.0:
        _refuse(fragments, a, dt, min(max(0.85 / ratio, 0.05), 0.7), h, latlon, radius)
        return
    _accept(fragments, a, forcing, dt)
    flag[TOUCHES], flag[ACCEPTED] = int(touches), 1
    longer = dt * (2.0 if ratio == 0.0 else min(max(0.85 / ratio, 1.0), 3.0))
    slowing = -(motion[ACCELERATION, 0] * v0[0] + motion[ACCELERATION, 1] * v0[1])
    if is_held and touches:
        longer = HELD_STEP
    elif slowing > 0.0 and flag[SLIDES]:
        # Just before it stops: over a way shorter than that of the anchor the floor stops the fragment at once.
        speed = math.hypot(v0[0], v0[1])
        stop = speed * speed / slowing
        if 0.5 * speed * stop < 0.9 * bed.anchor_way:
            longer = max(longer, 1.2 * stop)
    number[SUBSTEP] = max(longer, number[SUBSTEP]) if dt < number[SUBSTEP] else longer
    if h - number[TIME] > 1e-12 * h:
        _begin_substep(fragments, a, h, latlon, radius)
    else:
        flag[STATUS] = DONE


@kernel
def _accept(fragments: Landing, a: int, forcing: ElementForcing, dt: float) -> None:
    """Make a sub-step the state of a fragment."""
    first, last, number, motion = (
        fragments.pads.row_start[a],
        fragments.pads.row_start[a + 1],
        fragments.number[a],
        fragments.motion[a],
    )
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
    mass, levers = take_elements(forcing, slice(first, last)), fragments.levers[first:last]
    add_forces(np.zeros(count, np.int64), levers, mean, mass, accelerations, rate, force, net)
    size = 0.0
    for e in range(count):
        of_floor, applied = fragments.trial_anchors[first + e], fragments.applied[first + e]
        accelerations[e, SEA_FLOOR, 0] += of_floor[FORCE_X] / mass.mass[e]
        accelerations[e, SEA_FLOOR, 1] += of_floor[FORCE_Y] / mass.mass[e]
        for k in range(len(FORCES)):
            applied[k, 0] += dt * accelerations[e, k, 0]
            applied[k, 1] += dt * accelerations[e, k, 1]
        for column in range(ARM_Y + 1):
            fragments.anchors[first + e, column] = of_floor[column]
        fragments.yielded[first + e] = max(fragments.yielded[first + e], fragments.loads[first + e, YIELD])
        size += math.hypot(of_floor[FORCE_X], of_floor[FORCE_Y])
    if size > number[PEAK]:
        number[PEAK], number[PEAK_SPIN], number[PEAK_TIME] = size, motion[VELOCITY, 2], number[TIME] + dt
        for e in range(count):
            of_floor, peak = fragments.trial_anchors[first + e], fragments.peak[first + e]
            peak[0], peak[1] = force[e, 0] + of_floor[FORCE_X], force[e, 1] + of_floor[FORCE_Y]
            torque = of_floor[ARM_X] * of_floor[FORCE_Y] - of_floor[ARM_Y] * of_floor[FORCE_X]
            peak[2], peak[3], peak[4] = force[e, 2] + torque, levers[e, 9], levers[e, 10]
    number[TIME] += dt
    number[SHORTEST] = min(number[SHORTEST], dt)
    number[RUBBED] += number[RUBS]


@kernel
def carry(
    fragments: Landing, a: int, path: Floats, twist: Floats, anchors: Floats, applied: Floats, rubbed: float
) -> None:
    """Let contact take a fragment on the floor through the step: its way and velocity, and friction and impulses on its elements.

    ``anchors``: friction at the end, N; shape (elements, 2). ``rubbed``: its work, J.
    """
    first, number = fragments.pads.row_start[a], fragments.number[a]
    fragments.flag[a, CARRIED], number[RUBBED], number[SHORTEST] = 1, rubbed, TOUCH_STEP
    for k in range(3):
        fragments.motion[a, PATH, k], fragments.motion[a, VELOCITY, k] = path[k], twist[k]
    for e in range(anchors.shape[0]):
        fragments.anchors[first + e, ANCHOR_X], fragments.anchors[first + e, ANCHOR_Y] = anchors[e, 0], anchors[e, 1]
        for k in range(applied.shape[1]):
            fragments.applied[first + e, k, 0], fragments.applied[first + e, k, 1] = applied[e, k, 0], applied[e, k, 1]


@kernel
def _set_down(fragments: Landing, a: int, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float) -> None:
    """Find the forces of the floor on a fragment where contact has taken it."""
    number, flag, push = fragments.number[a], fragments.flag[a], fragments.motion[a, PUSH]
    held = fragments.loads[fragments.pads.row_start[a] : fragments.pads.row_start[a + 1], HOLD].copy()
    touches = _press(fragments, a, bed, h, h, depth)
    if flag[STATUS] == UNSETTLED:
        return
    if not touches and not flag[TOUCHES]:
        flag[STATUS] = AFLOAT
        return
    hold, change = _find_friction(fragments, a, held, fragments.sounded_pose[a], latlon, radius)
    acceleration = times(fragments.mobility[a], change)
    for k in range(3):
        change[k] = h * acceleration[k]
    by_hold = abs(hold - number[HELD]) / (HOLD_CHANGE * max(number[HELD], math.hypot(push[0], push[1]), 1e-30))
    number[CHANGE] = min(relative_change(fragments, a, change) / CARRIED_CHANGE, by_hold)
    flag[ACCEPTED], flag[STATUS] = 1, DONE


@kernel
def _find_friction(
    fragments: Landing, a: int, held: Floats, pose: Floats, latlon: bool, radius: float
) -> tuple[float, Floats]:
    """Find the friction of a fragment by its loads, where that of its elements hung on what they have ``held`` (N) so far.

    Returns what it can hold, N, and by how much its friction has changed, N, N, N m.
    """
    first, last, hold, change = fragments.pads.row_start[a], fragments.pads.row_start[a + 1], 0.0, np.zeros(3)
    none, poses = np.empty((0, 3)), np.empty((1, 3, 3))
    for i in range(3):
        for j in range(3):
            poses[0, i, j] = pose[i, j]
    bodies = Bodies(np.zeros(last - first, np.int64), fragments.reference[first:last], poses, none, none)
    fill_levers(bodies, latlon, radius, fragments.levers[first:last])
    for e in range(first, last):
        m, anchor, load = fragments.levers[e], fragments.anchors[e], fragments.loads[e]
        hold += load[HOLD]
        fragments.yielded[e] = max(fragments.yielded[e], load[YIELD])
        anchor[LARGEST] = max(anchor[LARGEST], load[HOLD])
        # Friction that slides is the hold now, as the next step finds it.
        size, offset, x, y = (
            math.hypot(anchor[ANCHOR_X], anchor[ANCHOR_Y]),
            _load_from_centre(fragments, a, e),
            0.0,
            0.0,
        )
        if size > min(GIVES_WAY * held[e - first], load[HOLD]):
            excess = load[HOLD] / size - 1.0
            x, y = excess * anchor[ANCHOR_X], excess * anchor[ANCHOR_Y]
            _add_force(m, offset[0], offset[1], x, y, change)
        anchor[ANCHOR_X], anchor[ANCHOR_Y] = anchor[ANCHOR_X] + x, anchor[ANCHOR_Y] + y
        x, y = _turned(m, load[PUSH_X], load[PUSH_Y])
        anchor[FORCE_X], anchor[FORCE_Y] = anchor[ANCHOR_X] + x, anchor[ANCHOR_Y] + y
        anchor[ARM_X], anchor[ARM_Y] = _turned(m, offset[0], offset[1])
    return hold, change


@kernel
def board(fragments: Landing, numbers: Ints, bodies: Bodies, keel: Keel, thickness: Floats, bed: Bed) -> None:
    """Let fragments begin a step where they are; ``thickness``: of the elements ``pads.rows``, m."""
    fill_hulls(
        fragments.pads,
        thickness,
        fragments.draft,
        bed.modulus,
        bed.poisson,
        fragments.hull,
        fragments.number[:, THICKNESS],
        fragments.number[:, LENGTH],
    )
    for a in range(numbers.size):
        number, flag = fragments.number[a], fragments.flag[a]
        flag[STATUS] = AFLOAT if fragments.polygon_start[a] == fragments.polygon_start[a + 1] else BEGINS
        for k in range(3):
            fragments.motion[a, VELOCITY, k] = bodies.twist[numbers[a], k]
        for n in range(fragments.pads.row_start[a], fragments.pads.row_start[a + 1]):
            e = fragments.pads.rows[n]
            for k in range(3):
                fragments.reference[n, k] = bodies.reference[e, k]
            fragments.anchors[n, ANCHOR_X], fragments.anchors[n, ANCHOR_Y] = keel.anchor_x[e], keel.anchor_y[e]
            fragments.anchors[n, LARGEST], fragments.yielded[n] = keel.anchor_capacity[e], keel.floor_yield[e]
            fragments.loads[n, HOLD] = keel.floor_hold[e]
            number[HELD] += keel.floor_hold[e]
            if keel.floor_load[e] > 0.0 or keel.anchor_x[e] != 0.0 or keel.anchor_y[e] != 0.0:
                flag[TOUCHES] = 1
        substep = keel.floor_substep[fragments.pads.rows[fragments.pads.row_start[a]]]
        number[SUBSTEP] = substep if flag[TOUCHES] and substep > 0.0 else HELD_STEP
        number[SHORTEST], number[PEAK] = math.inf, -1.0


@kernel
def set_inertia(fragments: Landing, numbers: Ints, matrices: BodyMatrices) -> None:
    """Give fragments their inertia."""
    for a in range(numbers.size):
        inertia, number = matrices.inertia[numbers[a]], fragments.number[a]
        for i in range(3):
            for j in range(3):
                fragments.mobility[a, i, j] = matrices.mobility[numbers[a], i, j]
        twist, number[ARM] = fragments.motion[a, VELOCITY], math.sqrt(inertia[2, 2] / inertia[0, 0])
        number[SPEED] = math.hypot(twist[0], twist[1]) + number[ARM] * abs(twist[2])


@kernel
def lift_off(keel: Keel) -> None:
    """Clear the loads of the floor on all keels; the yield of the bed stays."""
    for e in range(keel.floor_load.size):
        keel.floor_load[e] = keel.floor_x[e] = keel.floor_y[e] = keel.floor_arm_x[e] = keel.floor_arm_y[e] = 0.0
        keel.anchor_x[e] = keel.anchor_y[e] = keel.anchor_capacity[e] = keel.floor_hold[e] = 0.0
        keel.floor_lift[e] = keel.floor_stress[e] = keel.floor_substep[e] = 0.0


@kernel
def write_loads(fragments: Landing, keel: Keel) -> None:
    """Write the loads of the press to the keels of the fragments that touched the floor."""
    for a in range(len(fragments.flag)):
        if fragments.flag[a, STATUS] == DONE:
            for n in range(fragments.pads.row_start[a], fragments.pads.row_start[a + 1]):
                e, load = fragments.pads.rows[n], fragments.loads[n]
                keel.floor_load[e], keel.floor_hold[e] = load[LOAD], load[HOLD]
                keel.floor_lift[e], keel.floor_stress[e] = load[LIFT], load[STRESS]
                keel.floor_yield[e] = max(fragments.yielded[n], load[YIELD])


@kernel
def write_friction(fragments: Landing, keel: Keel) -> None:
    """Write friction and length of the next sub-step to the same keels."""
    for a in range(len(fragments.flag)):
        if fragments.flag[a, STATUS] == DONE:
            for n in range(fragments.pads.row_start[a], fragments.pads.row_start[a + 1]):
                e, anchor = fragments.pads.rows[n], fragments.anchors[n]
                if fragments.loads[n, LOAD] > 0.0:
                    keel.anchor_x[e], keel.anchor_y[e], keel.anchor_capacity[e] = anchor[0], anchor[1], anchor[LARGEST]
                    keel.floor_x[e], keel.floor_y[e] = anchor[FORCE_X], anchor[FORCE_Y]
                    keel.floor_arm_x[e], keel.floor_arm_y[e] = anchor[ARM_X], anchor[ARM_Y]
                keel.floor_substep[e] = fragments.number[a, SUBSTEP]


@kernel
def press_all(
    fragments: Landing, bed: Bed, latlon: bool, radius: float, depth: Floats, lon: Floats, lat: Floats
) -> int:
    """Write the points where all fragments need the depth as they stand, or press them by it; returns the number of points."""
    at = 0
    for a in range(len(fragments.flag)):
        polygons, begin = fragments.polygons[fragments.polygon_start[a] : fragments.polygon_start[a + 1]], at
        at = write_points(fragments.pads, a, polygons, fragments.pose[a], latlon, radius, at, lon, lat)
        if depth.size and fragments.flag[a, STATUS] == BEGINS:
            first, last = fragments.pads.row_start[a], fragments.pads.row_start[a + 1]
            fragments.flag[a, STATUS], held = DONE, fragments.loads[first:last, HOLD].copy()
            _press(fragments, a, bed, 1.0, 0.0, depth[begin:at])
            _find_friction(fragments, a, held, fragments.pose[a], latlon, radius)
    return at


@kernel
def advance(
    fragments: Landing, forcing: ElementForcing, bed: Bed, h: float, depth: Floats, latlon: bool, radius: float, lon: Floats,
    lat: Floats,
) -> int:  # fmt: skip
    """Take all fragments up to where they need the depth at another place; returns the number of points that they ask for.

    ``forcing``: of the elements ``pads.rows``; ``h``: the step, s; ``depth`` (m) at the points of the last call; ``lon`` and
    ``lat`` take those that are asked for.
    """
    at = requested = 0
    for a in range(len(fragments.flag)):
        polygons, flag = (
            fragments.polygons[fragments.polygon_start[a] : fragments.polygon_start[a + 1]],
            fragments.flag[a],
        )
        flag[ACCEPTED] = 0
        if flag[STATUS] == BEGINS and flag[CARRIED] == 1:
            for k in range(3):
                fragments.motion[a, WAY, k] = fragments.motion[a, PATH, k]
            _request_depth(fragments, a, h, END, latlon, radius)
        elif flag[STATUS] == BEGINS:
            _begin_substep(fragments, a, h, latlon, radius)
        elif flag[STATUS] == MIDDLE or flag[STATUS] == END:
            size = polygons.size
            for k in polygons:
                size += fragments.pads.start[k + 1] - fragments.pads.start[k]
            if flag[CARRIED] == 1:
                _set_down(fragments, a, bed, h, depth[at : at + size], latlon, radius)
            elif flag[STATUS] == MIDDLE:
                _go_through_middle(fragments, a, forcing, bed, h, depth[at : at + size], latlon, radius)
            else:
                _go_through_end(fragments, a, forcing, bed, h, depth[at : at + size], latlon, radius)
            at += size
        if flag[STATUS] == MIDDLE or flag[STATUS] == END:
            requested = write_points(
                fragments.pads, a, polygons, fragments.sounded_pose[a], latlon, radius, requested, lon, lat
            )
    return requested
