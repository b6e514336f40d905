"""States of the faces of a step, and how they are passed on where faces part and join."""

from __future__ import annotations

from typing import Final

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.quasi_static.contact.face_pairs import CrushingWorkspace
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


@borrower
def pass_states_on(face_state: Floats, begin: int, end: int, work: CrushingWorkspace) -> None:
    """Pass the states of the faces of a pair, from ``begin`` to ``end``, on to the overlaps that hold their polygons now.

    A face that goes over to other polygons within a sub-step goes on as the first overlap that comes from none.
    """
    if not _have_changed(face_state, begin, end, work):
        return
    for n in range(begin, end):
        for c in range(COLUMNS):
            work.last_state[n, c], face_state[n, c] = face_state[n, c], 0.0
    for n in range(begin, end):
        if work.last_state[n, PHASE] != APART:
            _share_out(face_state, n, begin, end, work)
    for n in range(begin, end):
        if work.last_state[n, PHASE] != APART and not _is_held(n, begin, end, work):
            for m in range(begin, end):
                if work.holder[m] == m and face_state[m, PHASE] == APART:
                    _add_share(face_state[m], work.last_state[n], 1.0)
                    break


@kernel
def _have_changed(face_state: Floats, begin: int, end: int, work: CrushingWorkspace) -> bool:
    """Whether faces in contact have parted, joined, or left the polygons after which they have their numbers."""
    for n in range(begin, end):
        last = work.last_holder[n]
        if face_state[n, PHASE] != APART and work.holder[n] != n:
            return True
        if last >= 0 and face_state[last, PHASE] != APART and work.holder[n] >= 0 and work.holder[n] != last:
            return True
    return False


@kernel
def _is_held(face: int, begin: int, end: int, work: CrushingWorkspace) -> bool:
    """Whether polygons of a face overlap still."""
    for n in range(begin, end):
        if work.last_holder[n] == face and work.polygon_area[n] > 0.0:
            return True
    return False


@kernel
def _share_out(face_state: Floats, face: int, begin: int, end: int, work: CrushingWorkspace) -> None:
    """Share the state of a face out among the overlaps that hold its polygons, by the areas of these."""
    total = 0.0
    for n in range(begin, end):
        work.share[n] = 0.0
    for n in range(begin, end):
        if work.last_holder[n] == face and work.polygon_area[n] > 0.0:
            work.share[work.holder[n]] += work.polygon_area[n]
            total += work.polygon_area[n]
    for n in range(begin, end):
        if work.share[n] > 0.0:
            _add_share(face_state[n], work.last_state[face], work.share[n] / total)


@kernel
def _add_share(state: Floats, other: Floats, share: float) -> None:
    """Add a share of the state of a face to that of another, which may be new."""
    is_new = state[PHASE] == APART
    for c in (SINCE, SPEED, PHASE, CLOSING_SPEED):
        state[c] = other[c] if is_new else max(state[c], other[c])
    for c in ADDED:
        state[c] += share * other[c]
