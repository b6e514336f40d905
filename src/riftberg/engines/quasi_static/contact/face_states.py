"""What is known of a face from sub-step to sub-step, and from step to step."""

from __future__ import annotations

from typing import Final

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats

(
    TOUCHED,
    CRUSHED,
    CHORD,
    SINCE,
    SPEED,
    FORCE,
    FRICTION,
    PHASE,
    PUSH_X,
    PUSH_Y,
    TORQUE_1,
    TORQUE_2,
    AREA_AT_END,
    SKIN_X,
    SKIN_Y,
    CLOSING_SPEED,
) = range(16)
"""Columns of a face: overlaps at which they touched and to which they are crushed (m2), chord (m), time since touching
(s), closing speed then (m s-1), forces across and along (N), phase; force on the second element (N), torques (N m); overlap at
the end of the last step (m2); way (m) of each towards the other with which faces that stood on each other overlap; closing speed
now (m s-1). At rest, and of faces that overlap and part, the closing speed on touching is that of now, too."""

COLUMNS: Final = 16

APART, IMPACT, REST = 0.0, 1.0, 2.0
"""Phases of contact of two faces."""

ADDED: Final = (TOUCHED, CRUSHED, CHORD, FORCE, FRICTION, PUSH_X, PUSH_Y, TORQUE_1, TORQUE_2, AREA_AT_END)
"""Columns of which faces that join have the sum, and faces that part their shares; of all others they have the largest."""


@kernel
def set_apart(state: Floats) -> None:
    """End the contact of a face."""
    state[PHASE], state[FORCE], state[FRICTION], state[SPEED] = APART, 0.0, 0.0, 0.0


@kernel
def add_share(state: Floats, other: Floats, share: float) -> None:
    """Add a share of the state of a face to that of another, which may be new."""
    is_new = state[PHASE] == APART
    for c in (SINCE, SPEED, PHASE, CLOSING_SPEED):
        state[c] = other[c] if is_new else max(state[c], other[c])
    for c in ADDED:
        state[c] += share * other[c]
