"""Pack ice in the sub-steps of contact and of the bed, which take media as linear in the velocities: its rate alone acts."""

from __future__ import annotations

from typing import Final

import numpy as np

from riftberg.engines.common.forces.media import LIMIT, LINEAR, SEA_ICE, YIELD, U, V
from riftberg.engines.quasi_static.bodies.dynamics import BodyOperators
from riftberg.state import Floats

SUBSTEP_YIELD: Final = 2e-3
"""Speed (m s-1) through the pack at which it yields in sub-steps: their accuracy of velocities."""


def soft_pack(op: BodyOperators) -> BodyOperators:
    """Return operators whose pack yields at `SUBSTEP_YIELD`, for sub-steps that evaluate the media again and again."""
    if not (op.forcing.media[:, SEA_ICE, LIMIT] > 0.0).any():
        return op
    media = op.forcing.media.copy()
    media[:, SEA_ICE, YIELD] = SUBSTEP_YIELD
    return op._replace(forcing=op.forcing._replace(media=media))


def linear_pack(op: BodyOperators, twist: Floats) -> BodyOperators:
    """Return operators whose pack drags by its rate at the velocities of the fragments, for sub-steps over the bed.

    A pack that carries bergs along does not carry those on the sea floor.
    """
    row = op.forcing.media[:, SEA_ICE]
    if not ((row[:, LIMIT] > 0.0) | (row[:, LINEAR] > 0.0)).any():
        return op
    media = op.forcing.media.copy()
    q, m = twist[op.body], op.levers
    du, dv = np.sum(m[:, 0:3] * q, axis=1) - row[:, U], np.sum(m[:, 3:6] * q, axis=1) - row[:, V]
    media[:, SEA_ICE, LINEAR] = row[:, LIMIT] / np.maximum(np.hypot(du, dv), SUBSTEP_YIELD)
    media[:, SEA_ICE, LIMIT] = 0.0
    return op._replace(forcing=op.forcing._replace(media=media))
