"""Friction of the sea floor on fragments that others press, in the sub-steps of contact.

The anchors are those of `riftberg.engines.quasi_static.keel_friction`. The friction of one after a sub-step of h s is

    f = grip (a - k h v)

with its friction a before, stiffness k, and the new velocity v of the keel, each with its torque or spin. The grip is the secant
of the law at the previous iterate of the velocities, until two iterates agree. Each turn solves a linear problem with more energy
than the true one, so the turns converge from any start.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.keel_friction import (
    ANCHOR_TORQUE,
    ANCHOR_X,
    ANCHOR_Y,
    ANCHORS,
    BASE_XX,
    BASE_YY,
    LIMIT,
    STIFFNESS,
    fill_keel_levers,
    find_pull,
    floor_force,
    give_way,
    present_friction,
)
from riftberg.physics.geometry import multiply, times
from riftberg.state import Floats, Ints

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
    return np.zeros((elements, ANCHORS))


@kernel
def rim_speed(twist: Floats, arm: float) -> float:
    """Upper bound of the speed (m s-1) of the points of a body; or of their acceleration (m s-2)."""
    return float(math.hypot(twist[0], twist[1]) + arm * abs(twist[2]))


@borrower
def add_floor_force(anchors: Floats, body_of: Ints, levers: Floats, force: Floats) -> None:
    """Add the present force of the floor on the bodies, shape (bodies, 3)."""
    for e in range(body_of.size):
        if anchors[e, STIFFNESS] > 0.0:
            m, (x, y, torque) = levers[e], floor_force(anchors[e])
            for i in range(3):
                force[body_of[e], i] += m[i] * x + m[3 + i] * y + m[6 + i] * torque


@kernel
def _gyration(anchor: Floats) -> float:
    """Radius of gyration (m) of the area that holds an element."""
    return math.sqrt(anchor[BASE_XX] + anchor[BASE_YY])


# Many arguments: both velocities, and what is found of elements and bodies.
@borrower
def find_grip(
    anchors: Floats, body_of: Ints, levers: Floats, h: float, old: Floats, new: Floats, floor: Ints, force: Floats, drag: Floats,
    grip: Floats, patches: Floats, scratch: Floats,
) -> bool:  # fmt: skip
    """Find the grip of all anchors at the velocities ``new`` of the bodies, and ``floor``; returns whether there are any.

    ``force`` (bodies, 3) takes how the force of the floor after the sub-step would differ from that before at the velocities
    ``old``, ``drag`` (bodies, 3, 3) minus its derivative by the velocity, and ``grip`` (elements, 3, 3) that of the anchors.
    """
    any_anchor, lever, product, pull, friction = False, scratch[0], scratch[1], scratch[2, 0], scratch[2, 1]
    force[:, :], drag[:, :, :], floor[:] = 0.0, 0.0, AFLOAT
    for e in range(body_of.size):
        a, b = anchors[e], body_of[e]
        if a[STIFFNESS] == 0.0:
            continue
        any_anchor, k, gyration, base = True, h * a[STIFFNESS], _gyration(a), a[BASE_XX : BASE_YY + 1]
        fill_keel_levers(a, gyration, levers[e], lever)
        find_pull(a, gyration, lever, k, new[b], pull)
        slips = give_way(pull, a[LIMIT], base, 1.0, 0.0, True, friction, grip[e], patches)
        floor[b] = max(floor[b], SLIDING if slips else HELD)
        find_pull(a, gyration, lever, k, old[b], pull)
        (x, y, turn), (px, py, torque) = times(grip[e], pull), present_friction(a, gyration)
        x, y, turn = x - px, y - py, turn - torque
        multiply(grip[e], lever, product)
        for i in range(3):
            force[b, i] += lever[0, i] * x + lever[1, i] * y + lever[2, i] * turn
            for j in range(3):
                for r in range(3):
                    drag[b, i, j] += k * lever[r, i] * product[r, j]
    return any_anchor


@borrower
def agree(old: Floats, new: Floats, arm: Floats) -> bool:
    """Whether a turn has changed the velocities of the bodies by little."""
    for b in range(new.shape[0]):
        change = math.hypot(new[b, 0] - old[b, 0], new[b, 1] - old[b, 1]) + arm[b] * abs(new[b, 2] - old[b, 2])
        if change > AGREEMENT[0] * rim_speed(new[b], arm[b]) + AGREEMENT[1]:
            return False
    return True


@borrower
def find_stop(floor: Ints, h: float, old: Floats, new: Floats, arm: Floats, stop: Floats) -> None:
    """Find the stopping times (s) of sliding bodies, if they go on losing speed as in a sub-step of ``h`` s; else infinite."""
    for b in range(floor.size):
        stop[b], speed = math.inf, rim_speed(new[b], arm[b])
        speed_loss = rim_speed(old[b], arm[b]) - speed
        if floor[b] == SLIDING and speed_loss > 0.0:
            stop[b] = h * speed / speed_loss


@borrower
def guess_stop(
    anchors: Floats, body_of: Ints, mobility: Floats, force: Floats, twist: Floats, arm: Floats, stop: Floats, patches: Floats,
    scratch: Floats,
) -> None:  # fmt: skip
    """Find the same before the first sub-step, by the ``force`` on the bodies without contact."""
    pull, friction, slope = scratch[0, 0], scratch[0, 1], scratch[1]
    for e in range(body_of.size):
        a, b, gyration = anchors[e], body_of[e], _gyration(anchors[e])
        if a[STIFFNESS] == 0.0 or rim_speed(twist[b], arm[b]) == 0.0:
            continue
        pull[0], pull[1], pull[2] = present_friction(a, gyration)
        base = a[BASE_XX : BASE_YY + 1]
        if give_way(pull, GIVES_WAY * a[LIMIT], base, 1.0, 0.0, True, friction, slope, patches):
            u, v, w = twist[b, 0], twist[b, 1], arm[b] * twist[b, 2]
            x, y, turn = times(mobility[b], force[b])
            power = u * x + v * y + w * arm[b] * turn
            stop[b] = -(u * u + v * v + w * w) / power if power < 0.0 else math.inf


@borrower
def longest_sliding_step(
    anchors: Floats, body_of: Ints, twist: Floats, arm: Floats, stop: Floats, last_step: float
) -> float:  # fmt: skip
    """Longest sub-step (s) of the bodies that slide over the floor; ``last_step``: the previous one, s."""
    limit = math.inf
    for e in range(body_of.size):
        a, b = anchors[e], body_of[e]
        if a[STIFFNESS] > 0.0 and stop[b] < math.inf:
            stopping_distance = 0.5 * rim_speed(twist[b], arm[b]) * stop[b]
            if stopping_distance * a[STIFFNESS] > a[LIMIT]:
                limit = min(limit, SLIDING_STEP * stop[b], 2.0 * last_step)
    return limit


@borrower
def drag_anchors(
    anchors: Floats, body_of: Ints, levers: Floats, h: float, grip: Floats, new: Floats, path_twist: Floats, rubbed: Floats,
    scratch: Floats,
) -> None:  # fmt: skip
    """Take the anchors through a sub-step; adds to ``rubbed`` the work of friction on each body, J."""
    lever, pull = scratch[0], scratch[1, 0]
    for e in range(body_of.size):
        a, b = anchors[e], body_of[e]
        if a[STIFFNESS] == 0.0:
            continue
        k, gyration = h * a[STIFFNESS], _gyration(a)
        fill_keel_levers(a, gyration, levers[e], lever)
        find_pull(a, gyration, lever, k, new[b], pull)
        x, y, turn = times(grip[e], pull)
        if grip[e, 0, 0] + grip[e, 1, 1] + grip[e, 2, 2] < 3.0:  # it slips
            find_pull(a, gyration, lever, k, path_twist[b], pull)
            work = x * (pull[0] - x) + y * (pull[1] - y) + turn * (pull[2] - turn)
            rubbed[b] += max(work, 0.0) / a[STIFFNESS]
        a[ANCHOR_X], a[ANCHOR_Y], a[ANCHOR_TORQUE] = x, y, gyration * turn
