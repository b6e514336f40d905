"""How closely a kernel must agree with its twin, and the random numbers that both are fed."""

from __future__ import annotations

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

TOLERANCE = 1e-12
SEEDS = range(200)

quick = settings(max_examples=60, deadline=None)


def assert_same(actual, expected, *, scale=0.0):
    """Every component agrees to 1e-12 of the largest component of ``expected`` (or of ``scale`` if that is larger)."""
    actual, expected = np.asarray(actual, dtype=float), np.asarray(expected, dtype=float)
    size = max(float(np.max(np.abs(expected))), scale)
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=TOLERANCE * size)


def between(low, high):
    """Numbers from ``low`` to ``high``, as hypothesis draws them; none so small that products underflow."""
    tiny = 1e-30
    return st.floats(low, high, allow_nan=False, allow_subnormal=False).map(lambda x: 0.0 if abs(x) < tiny else x)


speed = between(-3.0, 3.0)
angle = between(-np.pi, np.pi)
latitude = between(-88.9, 88.9)


def unit(direction):
    """Unit vector at an angle."""
    return np.array([np.cos(direction), np.sin(direction)])


def turn(direction):
    """Matrix that turns a vector counter-clockwise."""
    c, s = np.cos(direction), np.sin(direction)
    return np.array([[c, -s], [s, c]])


MIRROR = np.array([[-1.0, 0.0], [0.0, 1.0]])
"""Reflection at the y axis."""
