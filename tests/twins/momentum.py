"""Twin of the pieces of the semi-implicit velocity equation of equations 4.2."""

from __future__ import annotations

import numpy as np


def mean_speed(iterate, start, medium):
    """Half the sum of the speeds of the iterate and of the start relative to the medium."""
    medium = np.asarray(medium)
    return 0.5 * (np.linalg.norm(np.asarray(iterate) - medium) + np.linalg.norm(np.asarray(start) - medium))


def solve(matrix, right_hand_side):
    """Linear solve by LAPACK."""
    return np.linalg.solve(np.asarray(matrix, dtype=float), np.asarray(right_hand_side, dtype=float))
