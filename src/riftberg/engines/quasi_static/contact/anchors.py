"""Friction of the sea floor on fragments that others press, in the sub-steps of contact.

The anchors are the ones of `riftberg.engines.quasi_static.ground.landing`. The force of an anchor after a sub-step of h s is

    f = grip (a - k h v),    grip = min(1, H / |a - k h v|)

with its force a before, stiffness k, largest friction H, and the new velocity v of the keel. The grip follows from the
previous iterate of the velocities, until two iterates agree. Each turn solves a linear problem with more energy than the true
one (Huber's potential), so the turns converge from any start.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.state import Floats, Ints

ANCHOR_X, ANCHOR_Y, STIFFNESS, HOLD, SLOPE_X, SLOPE_Y, ARM_X, ARM_Y, GRIP = range(9)
"""Columns of anchors, one for each element: friction now (N), its stiffness (N m-1), the largest (N), push by the slope of the
floor (N), where they act, from the centre of the element (m), and the grip of the sub-step."""

COLUMNS: Final = 9

AFLOAT, HELD, SLIDING = range(3)
"""Effect of the floor on a body in a sub-step: none, all its anchors hold, or one of them gives way."""

GIVES_WAY: Final = 0.99
"""Part of its largest friction from which on an anchor is taken to slide at the start of a step."""

SLIDING_STEP: Final = 0.2
"""Longest sub-step of a sliding body as a part of its stopping time, while it would slide farther than its anchors stretch."""

AGREEMENT = 1e-4, 1e-7
"""Change of the velocities in a turn at which the grip is found: as a part of them, and in m s-1."""

MOST_TURNS: Final = 30
"""Turns after which the grip of the last one is taken: friction then lags behind its direction by a sub-step."""


def allocate_anchors(elements: int) -> Floats:
    """Return the anchors of elements afloat."""
    return np.zeros((elements, COLUMNS))


@kernel
def _keel_velocity(anchor: Floats, m: Floats, q: Floats) -> tuple[float, float]:
    """Velocity (m s-1) of the keel where the floor carries it."""
    w = m[6] * q[0] + m[7] * q[1] + m[8] * q[2]
    u, v = m[0] * q[0] + m[1] * q[1] + m[2] * q[2], m[3] * q[0] + m[4] * q[1] + m[5] * q[2]
    return u - anchor[ARM_Y] * w, v + anchor[ARM_X] * w


@kernel
def _add_force(anchor: Floats, m: Floats, x: float, y: float, force: Floats) -> None:
    """Add a force (N) on the keel to that on its body."""
    torque = anchor[ARM_X] * y - anchor[ARM_Y] * x
    for i in range(3):
        force[i] += m[i] * x + m[3 + i] * y + m[6 + i] * torque


@borrower
def add_floor_force(anchors: Floats, body_of: Ints, levers: Floats, force: Floats) -> None:
    """Add the present force of the floor on the bodies, shape (bodies, 3)."""
    for e in range(body_of.size):
        a = anchors[e]
        if a[STIFFNESS] > 0.0:
            _add_force(a, levers[e], a[ANCHOR_X] + a[SLOPE_X], a[ANCHOR_Y] + a[SLOPE_Y], force[body_of[e]])


@borrower
def find_grip(
    anchors: Floats, body_of: Ints, levers: Floats, h: float, old: Floats, new: Floats, floor: Ints, force: Floats, drag: Floats
) -> bool:  # fmt: skip
    """Find the grip of all anchors at the velocities ``new`` of the bodies, and ``floor``; returns whether there are any.

    ``force`` (bodies, 3) takes how the force of the floor after the sub-step would differ from that before at the velocities
    ``old``, and ``drag`` (bodies, 3, 3) minus its derivative by the velocity.
    """
    any_anchor = False
    force[:, :], drag[:, :, :], floor[:] = 0.0, 0.0, AFLOAT
    for e in range(body_of.size):
        a, m, b = anchors[e], levers[e], body_of[e]
        if a[STIFFNESS] == 0.0:
            continue
        any_anchor, k = True, h * a[STIFFNESS]
        u, v = _keel_velocity(a, m, new[b])
        pull = math.hypot(a[ANCHOR_X] - k * u, a[ANCHOR_Y] - k * v)
        a[GRIP] = a[HOLD] / pull if pull > a[HOLD] else 1.0
        floor[b] = max(floor[b], HELD if a[GRIP] == 1.0 else SLIDING)
        k *= a[GRIP]
        u, v = _keel_velocity(a, m, old[b])
        grip_change = a[GRIP] - 1.0
        _add_force(a, m, grip_change * a[ANCHOR_X] - k * u, grip_change * a[ANCHOR_Y] - k * v, force[b])
        for i in range(3):
            x, y = m[i] - a[ARM_Y] * m[6 + i], m[3 + i] + a[ARM_X] * m[6 + i]
            for j in range(3):
                drag[b, i, j] += k * (x * (m[j] - a[ARM_Y] * m[6 + j]) + y * (m[3 + j] + a[ARM_X] * m[6 + j]))
    return any_anchor


@borrower
def agree(old: Floats, new: Floats, arm: Floats) -> bool:
    """Whether a turn has changed the velocities of the bodies by little."""
    for b in range(new.shape[0]):
        change = math.hypot(new[b, 0] - old[b, 0], new[b, 1] - old[b, 1]) + arm[b] * abs(new[b, 2] - old[b, 2])
        if change > AGREEMENT[0] * (math.hypot(new[b, 0], new[b, 1]) + arm[b] * abs(new[b, 2])) + AGREEMENT[1]:
            return False
    return True


@borrower
def find_stop(floor: Ints, h: float, old: Floats, new: Floats, stop: Floats) -> None:
    """Find the stopping times (s) of sliding bodies, if they go on losing speed as in a sub-step of ``h`` s; else infinite."""
    for b in range(floor.size):
        stop[b] = math.inf
        speed = math.hypot(new[b, 0], new[b, 1])
        speed_loss = math.hypot(old[b, 0], old[b, 1]) - speed
        if floor[b] == SLIDING and speed_loss > 0.0:
            stop[b] = h * speed / speed_loss


@borrower
def guess_stop(anchors: Floats, body_of: Ints, mobility: Floats, force: Floats, twist: Floats, stop: Floats) -> None:
    """Find the same before the first sub-step, by the ``force`` on the bodies without contact."""
    for e in range(body_of.size):
        a, b, power = anchors[e], body_of[e], 0.0
        speed = math.hypot(twist[b, 0], twist[b, 1])
        if a[STIFFNESS] > 0.0 and speed > 0.0 and math.hypot(a[ANCHOR_X], a[ANCHOR_Y]) > GIVES_WAY * a[HOLD]:
            for i in range(2):
                for j in range(3):
                    power += twist[b, i] * mobility[b, i, j] * force[b, j]
            stop[b] = -speed * speed / power if power < 0.0 else math.inf


@borrower
def longest_sliding_step(anchors: Floats, body_of: Ints, twist: Floats, stop: Floats, last_step: float) -> float:
    """Longest sub-step (s) of the bodies that slide over the floor; ``last_step``: the previous one, s."""
    limit = math.inf
    for e in range(body_of.size):
        a, b = anchors[e], body_of[e]
        if a[STIFFNESS] > 0.0 and stop[b] < math.inf:
            stopping_distance = 0.5 * math.hypot(twist[b, 0], twist[b, 1]) * stop[b]
            if stopping_distance * a[STIFFNESS] > a[HOLD]:
                limit = min(limit, SLIDING_STEP * stop[b], 2.0 * last_step)
    return limit


# Many arguments: the twists at both ends and on the way, which differ in contact.
@borrower
def drag_anchors(
    anchors: Floats, body_of: Ints, levers: Floats, h: float, new: Floats, path_twist: Floats, rubbed: Floats
) -> None:  # fmt: skip
    """Take the anchors through a sub-step; adds to ``rubbed`` the work of friction on each body, J."""
    for e in range(body_of.size):
        a, m, b = anchors[e], levers[e], body_of[e]
        if a[STIFFNESS] == 0.0:
            continue
        k = h * a[STIFFNESS]
        u, v = _keel_velocity(a, m, path_twist[b])
        excess = math.hypot(a[ANCHOR_X] - k * u, a[ANCHOR_Y] - k * v) - a[HOLD]
        if a[GRIP] < 1.0 and excess > 0.0:
            rubbed[b] += a[HOLD] * excess / a[STIFFNESS]
        u, v = _keel_velocity(a, m, new[b])
        a[ANCHOR_X], a[ANCHOR_Y] = a[GRIP] * (a[ANCHOR_X] - k * u), a[GRIP] * (a[ANCHOR_Y] - k * v)
