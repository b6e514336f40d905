"""A fixed piece of work, timed beside the model, so that speeds measured on different machines can be compared.

The yardstick is a plain fused scalar loop, as one would write it first: for every bond of the berg the distance, a
linear spring with damping, a shear spring and a bending moment are computed with one square root, one sine and one
cosine and added at once to both ends; then every element is moved. It runs over the same elements and bonds as the
model does, with the sub-steps of the published run whatever the scheme of the model, so that a scheme with fewer
sub-steps, or with none, shows what it saves. It has none of the model's ocean, contact, fracture or output.

    seconds_per_day = (best time of one sub-step) x 4320

It must never be made faster: figures would no longer compare with earlier ones. `VERSION` is raised if it is changed.
"""

from __future__ import annotations

import time as clock
from typing import TYPE_CHECKING, Final

import numpy as np
from numba import njit

from riftberg.constants import SECONDS_PER_DAY
from riftberg.state import Floats, Ints

if TYPE_CHECKING:
    from riftberg.runs.model import Model

VERSION: Final = 1

PUBLISHED_SUBSTEPS: Final = 4320
"""Sub-steps a day of the published A68a run: the measure of all schemes."""

STIFFNESS: Final = 1e-4
"""Spring per mass, s-2; soft enough to stay stable."""

DAMPING: Final = 1e-3
"""Damping per mass, s-1."""


@njit(cache=False)
def _loop(first: Ints, second: Ints, state: Floats, force: Floats, rest: Floats, dt: float, count: int) -> None:
    """Advance ``state`` (6, n: x, y, angle and their rates) by ``count`` sub-steps."""
    for _ in range(count):
        force[:, :] = 0.0
        for b in range(first.size):
            i, j = first[b], second[b]
            dx, dy = state[0, i] - state[0, j], state[1, i] - state[1, j]
            length = np.sqrt(dx * dx + dy * dy)
            nx, ny = dx / length, dy / length
            turn = state[2, i] - state[2, j]
            s, c = np.sin(turn), np.cos(turn)
            du, dv = state[3, i] - state[3, j], state[4, i] - state[4, j]
            slip = -du * ny + dv * nx - 0.5 * length * (state[5, i] + state[5, j])
            pull = -STIFFNESS * (length - rest[b]) * c - DAMPING * (du * nx + dv * ny)
            shear = -DAMPING * slip
            fx, fy = pull * nx - shear * ny, pull * ny + shear * nx
            moment = -STIFFNESS * s
            force[0, i] += fx
            force[1, i] += fy
            force[2, i] += moment - shear / length
            force[0, j] -= fx
            force[1, j] -= fy
            force[2, j] -= moment + shear / length
        for e in range(state.shape[1]):
            for k in range(3):
                state[3 + k, e] += dt * force[k, e]
                state[k, e] += dt * state[3 + k, e]


def substeps_per_day(model: Model) -> float:
    """Return how many sub-steps the model takes in a day; the quasi-static scheme has none."""
    if model.parameters.stepping.scheme == "quasi_static":
        return 0.0
    return model.substeps * SECONDS_PER_DAY / model.parameters.stepping.time_step


def yardstick_seconds_per_day(model: Model, *, seconds: float = 0.3, repeats: int = 3) -> float:
    """Time the yardstick for the berg of a model.

    ``seconds``: about how long one measurement may take, s.
    """
    first, second = model.bonds.first, model.bonds.second
    if not first.size:
        return 0.0
    state, rest = _start(model)
    force = np.zeros((3, state.shape[1]))

    def measured(count: int) -> float:
        before = clock.perf_counter()
        _loop(first, second, state, force, rest, 1.0, count)
        return (clock.perf_counter() - before) / count

    measured(1)  # compiles
    count = max(1, int(seconds / max(measured(3), 1e-7)))
    return min(measured(count) for _ in range(repeats)) * PUBLISHED_SUBSTEPS


def _start(model: Model) -> tuple[Floats, Floats]:
    """Return positions in metres at rest, and the lengths of the bonds."""
    e, earth = model.elements, model.parameters.earth
    metres = earth.radius * np.pi / 180.0 if earth.latlon else 1.0
    shrink = np.cos(np.radians(e.lat.mean())) if earth.latlon else 1.0
    state = np.zeros((6, e.lon.size))
    state[0], state[1] = (e.lon - e.lon[0]) * metres * shrink, (e.lat - e.lat[0]) * metres
    first, second = model.bonds.first, model.bonds.second
    return state, np.hypot(state[0, first] - state[0, second], state[1, first] - state[1, second])
