"""Tips of cracks as they live from one step to the next, and as restart files hold them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from riftberg.state import Floats, Ints


class CrackTips(NamedTuple):
    """The tips of all cracks; a row for each."""

    beside: Ints  # Identifiers of the two elements beside which a tip keeps its place; shape (tips, 2)
    place: Floats  # Along and to the left of the line from the first of them to the second, m; shape (tips, 2)
    direction: Floats  # In which it grows, in the same axes; shape (tips, 2)
    crack: Ints  # Number of the crack
    order: Ints  # Of the bond to be crossed next, counted from the start of the crack; below 0 on the other arm
    length: Floats  # Of the whole crack, m
    # K_I and K_II after the last step, and the largest hoop intensity since the tip came here, Pa m^(1/2): the last is below 0
    # where the crack is too short, or too near to the outline or another crack, to say; shape (tips, 3)
    intensity: Floats


TIP_NAMES = tuple(f"crack_tip_{name}" for name in CrackTips._fields)
"""Names in a restart file."""

NO_TIPS = CrackTips(
    np.zeros((0, 2), np.int64),
    np.zeros((0, 2)),
    np.zeros((0, 2)),
    np.zeros(0, np.int64),
    np.zeros(0, np.int64),
    np.zeros(0),
    np.zeros((0, 3)),
)

UNTOLD, RUN_OUT = -1.0, -2.0
"""Third value of ``intensity`` of a tip of which nothing can be said, and of one that has no ice ahead of it."""


def tips_from_arrays(saved: Mapping[str, Any]) -> CrackTips:
    """Return the tips of a restart file; none where it holds none."""
    if not all(name in saved for name in TIP_NAMES):
        return NO_TIPS
    return CrackTips._make(
        [np.asarray(saved[name], default.dtype) for name, default in zip(TIP_NAMES, NO_TIPS, strict=True)]
    )
