"""Pack ice that holds: how the solvers of rigid fragments take a force that is limited, and stiff below its limit.

A pack bears up to ``limit``, whatever the speed through it, and less only where a berg all but moves with it:

    F = -limit min(|du| / s, 1) du / |du|,   s = `YIELD_SPEED`

Newton's method with the derivative of that force runs to and fro between both sides of the corner. So it is taken as two
equations (Hintermueller & Stadler 2006, SIAM J. Sci. Comput. 28, 1-23): ``max(|du|, s) p = du``, with the direction p of the
force as an unknown of its own. To first order in a change d of the velocity

    p' = (du + d - p (du . d) / |du|) / |du|   beyond the corner,   (du + d) / s   below it,

and p' is then cut to length 1. The matrix is that of the rate ``limit / max(|du|, s)`` less ``limit / |du| p du^T / |du|``.

Sub-steps of contact and of the bed have linear media (`riftberg.engines.quasi_static.bodies.linear_pack`): there
the rate alone acts.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.forces.media import LIMIT, SEA_ICE, YIELD, YIELD_SPEED, U, V
from riftberg.errors import ForcingError
from riftberg.state import Elements, Environment, Floats, Ints

ROUND_OFF: Final = 0.0101
"""By how much a concentration may lie outside of 0 to 1, as packed numbers of products do; it then counts as 0 or 1."""


@kernel
def find_fragments_in_pack(body: Ints, media: Floats, in_pack: NDArray[np.bool_]) -> None:
    """Find which fragments a pack holds."""
    in_pack[:] = False
    for e in range(body.size):
        if media[e, SEA_ICE, LIMIT] > 0.0:
            in_pack[body[e]] = True


@kernel
def is_any(chosen: NDArray[np.bool_]) -> bool:
    """Whether any is chosen."""
    count = 0
    for mark in chosen:
        count += int(mark)
    return count > 0


@kernel
def corner_slope(row: Floats, u: float, v: float) -> tuple[float, float, float]:
    """Factor (s-1) and direction of ``limit / |du| p du^T / |du|`` without p, at the velocity (u, v); 0 below the corner."""
    du, dv = u - row[U], v - row[V]
    speed = math.sqrt(du * du + dv * dv)
    if speed <= row[YIELD]:
        return 0.0, 0.0, 0.0
    return row[LIMIT] / speed, du / speed, dv / speed


@kernel
def next_direction(
    row: Floats, p: tuple[float, float], velocity: tuple[float, float], change: tuple[float, float]
) -> tuple[float, float]:
    """Direction of the force after a ``change`` of the velocity, from ``p`` before it (m s-1)."""
    du, dv = velocity[0] - row[U], velocity[1] - row[V]
    speed = math.sqrt(du * du + dv * dv)
    along, size = 0.0, row[YIELD]
    if speed > size:
        along, size = (du * change[0] + dv * change[1]) / speed, speed
    x, y = (du + change[0] - p[0] * along) / size, (dv + change[1] - p[1] * along) / size
    length = max(math.sqrt(x * x + y * y), 1.0)
    return x / length, y / length


def hold_by_pack(rows: Floats, u: Floats, v: Floats) -> Floats:
    """Return the acceleration (m s-2, east and north) of elements by the load of a pack; ``rows``: theirs of sea ice."""
    through = np.column_stack([u - rows[:, U], v - rows[:, V]])
    rate = rows[:, LIMIT] / np.maximum(np.hypot(through[:, 0], through[:, 1]), YIELD_SPEED)
    return np.asarray(-rate[:, None] * through)


def check_concentration(elements: Elements) -> None:
    """Refuse a concentration of sea ice that is no part of 1, such as one in per cent by a forcing of the user's own."""
    fraction = elements.environment.ice_fraction
    if (e := _first_beyond(fraction, -ROUND_OFF, 1.0 + ROUND_OFF)) >= 0:
        raise ForcingError(
            f"ice_fraction = {fraction[e]:g} at element {elements.body.id[e]} is no part of the sea", where="forcing",
            remedy="Give the concentration of sea ice from 0 to 1",
        )  # fmt: skip


@kernel
def _first_beyond(values: Floats, least: float, largest: float) -> int:
    """Row of the first value outside of some bounds; -1 where there is none."""
    for e in range(values.size):
        if values[e] < least or values[e] > largest:
            return e
    return -1


def mean_pack(environment: Environment, mass: Floats, body: Ints) -> Environment:
    """Return an environment in which all elements of a fragment see the same pack, the mean of theirs by mass."""
    total = np.bincount(body, mass)
    means = {
        name: (np.bincount(body, mass * getattr(environment, name)) / total)[body]
        for name in ("ui", "vi", "ice_fraction", "ice_thickness")
    }
    return environment._replace(**means)
