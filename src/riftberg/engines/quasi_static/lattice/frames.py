"""How fragments have turned from the plane in which their ice was laid out."""

from __future__ import annotations

import math

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats, Ints


@kernel
def fit_rotations(body: Ints, count: int, old: Floats, new: Floats) -> Floats:
    """Find cosine and sine of the angle by which the elements of each fragment have turned best from ``old`` to ``new``.

    ``body``: fragment of each element; positions in m, shape (elements, 2). Both are 0 where a fragment is in one place.
    """
    size, middle, turn = np.zeros(count), np.zeros((count, 4)), np.zeros((count, 2))
    for e in range(body.size):
        b = body[e]
        size[b] += 1.0
        for k in range(2):
            middle[b, k] += old[e, k]
            middle[b, 2 + k] += new[e, k]
    for e in range(body.size):
        b = body[e]
        x, y = old[e, 0] - middle[b, 0] / size[b], old[e, 1] - middle[b, 1] / size[b]
        u, v = new[e, 0] - middle[b, 2] / size[b], new[e, 1] - middle[b, 3] / size[b]
        turn[b, 0] += x * u + y * v
        turn[b, 1] += x * v - y * u
    for b in range(count):
        length = math.sqrt(turn[b, 0] ** 2 + turn[b, 1] ** 2)
        if length > 0.0:
            turn[b, 0], turn[b, 1] = turn[b, 0] / length, turn[b, 1] / length
    return turn
