"""Exponential and hyperbolic tangent by plain arithmetic.

Unlike calls of the C library they let loops become vector instructions, as the sine of `riftberg.physics.geometry` does, and give
the same digits whichever library there is.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from riftberg.compiled.kernels import kernel

_INVERSE_LN_2: Final = 1.4426950408889634
# ln 2 in two parts; the first has 32 bits, so that its products with the exponents of all numbers are exact.
_LN_2_HIGH: Final = 0.6931471803691238
_LN_2_LOW: Final = 1.9082149292705877e-10

_LOWEST: Final = -700.0
"""Argument below which a falling exponential counts as 0: it is below 1e-304."""

_LEAST_POWER: Final = -1010

_POWERS: Final = 2.0 ** np.arange(_LEAST_POWER, 1.0)


@kernel
def fast_falling_exp(x: float) -> float:
    """Exponential of a number that is not above 0, to 3e-16 of it, by powers of 2 and a Taylor polynomial of degree 13."""
    bounded = x if x > _LOWEST else _LOWEST  # this way round also for what is no number
    power = np.floor(bounded * _INVERSE_LN_2 + 0.5)
    y = (bounded - power * _LN_2_HIGH) - power * _LN_2_LOW
    # Horner's scheme, from 1/13! down, written out as in `riftberg.physics.geometry.sin_small`.
    s = 1.0 / 6227020800.0
    s = 1.0 / 479001600.0 + y * s
    s = 1.0 / 39916800.0 + y * s
    s = 1.0 / 3628800.0 + y * s
    s = 1.0 / 362880.0 + y * s
    s = 1.0 / 40320.0 + y * s
    s = 1.0 / 5040.0 + y * s
    s = 1.0 / 720.0 + y * s
    s = 1.0 / 120.0 + y * s
    s = 1.0 / 24.0 + y * s
    s = 1.0 / 6.0 + y * s
    s = 0.5 + y * s
    s = 1.0 + y * s
    return (1.0 + y * s) * _POWERS[int(power) - _LEAST_POWER] if x > _LOWEST else (0.0 if x <= _LOWEST else x)


@kernel
def fast_tanh(x: float) -> float:
    """Hyperbolic tangent, to 3e-16."""
    falling = fast_falling_exp(-2.0 * abs(x))
    size = (1.0 - falling) / (1.0 + falling)
    return size if x >= 0.0 else -size
