"""Elementary functions by plain arithmetic: the same digits on every processor and with every C library.

Those of a C library, and the vector functions of NumPy, choose their code by the processor, and round the last bit otherwise.
Sums, products, quotients and square roots of two numbers are rounded alike everywhere. Here arguments are led back to a short
range, with a table at most, and a Taylor polynomial is written out: a loop over coefficients would not be unrolled before the
loop over elements vectorises.

KID's engine calls the C library in its own kernels, as the reference does.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats

_TWO_OVER_PI: Final = 2.0 / math.pi
# pi / 2 in three parts; the first two have 33 bits, so that their products with up to a million quarter turns are exact.
_QUARTER_HIGH: Final = 1.5707963267341256
_QUARTER_MIDDLE: Final = 6.077100506303966e-11
_QUARTER_LOW: Final = 2.0222662487959506e-21

_INVERSE_LN_2: Final = 1.4426950408889634
# ln 2 in two parts; the first has 32 bits, so that its products with the exponents of all numbers are exact.
_LN_2_HIGH: Final = 0.6931471803691238
_LN_2_LOW: Final = 1.9082149292705877e-10

_LOWEST: Final = -708.0
"""Argument below which an exponential counts as 0: it is below 1e-307."""

_HIGHEST: Final = 709.0
"""Argument beyond which an exponential counts as infinite: it is above 8e307."""

_EXPONENT_BIAS: Final = 1023
_FRACTION_BITS: Final = 52


@kernel
def _reduce_angle(angle: float) -> tuple[float, float, float]:
    """Return an angle (rad) less whole quarter turns, what rounding has left of that, and the turns modulo 4."""
    turns = np.floor(angle * _TWO_OVER_PI + 0.5)
    exact, product = angle - turns * _QUARTER_HIGH, turns * _QUARTER_MIDDLE
    near = exact - product
    error = ((exact - near) - product) - turns * _QUARTER_LOW
    x = near + error
    return x, (near - x) + error, turns - 4.0 * np.floor(0.25 * turns)


@kernel
def _sine_and_cosine_within_eighth(x: float, error: float) -> tuple[float, float]:
    """Sine and cosine for abs(x) <= pi / 4, of ``x + error``."""
    q = x * x
    s = 1.0 / 355687428096000.0
    s = -1.0 / 1307674368000.0 + q * s
    s = 1.0 / 6227020800.0 + q * s
    s = -1.0 / 39916800.0 + q * s
    s = 1.0 / 362880.0 + q * s
    s = -1.0 / 5040.0 + q * s
    s = 1.0 / 120.0 + q * s
    s = -1.0 / 6.0 + q * s
    c = 1.0 / 20922789888000.0
    c = -1.0 / 87178291200.0 + q * c
    c = 1.0 / 479001600.0 + q * c
    c = -1.0 / 3628800.0 + q * c
    c = 1.0 / 40320.0 + q * c
    c = -1.0 / 720.0 + q * c
    c = 1.0 / 24.0 + q * c
    half = 0.5 * q
    coarse = 1.0 - half  # What it loses to rounding is added again.
    return x + (x * (q * s) + error), coarse + (((1.0 - coarse) - half) + (q * (q * c) - x * error))


@kernel
def sine_and_cosine(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle (rad), to the last digit up to a million turns."""
    x, error, quarter = _reduce_angle(angle)
    s, c = _sine_and_cosine_within_eighth(x, error)
    crosses = quarter == 1.0 or quarter == 3.0
    size_s, size_c = c if crosses else s, s if crosses else c
    return -size_s if quarter >= 2.0 else size_s, -size_c if quarter == 1.0 or quarter == 2.0 else size_c


@kernel
def sine(angle: float) -> float:
    """Sine of an angle (rad), to the last digit up to a million turns."""
    return sine_and_cosine(angle)[0]


@kernel
def cosine(angle: float) -> float:
    """Cosine of an angle (rad), to the last digit up to a million turns."""
    return sine_and_cosine(angle)[1]


_STEPS: Final = 8
"""The quotient of an arctangent is led back to the nearest of so many parts of 1."""


def _list_directions() -> tuple[Floats, Floats]:
    """List the angles about which arctangents are taken, and what rounding leaves of them; by octant and part of 1.

    Octants: from the positive x axis up, from the y axis back to it, from the negative x axis back to the y axis, on to it.
    """
    # Arctangents of 0 to 8 eighths, and pi / 2: 16 digits, and the next ones.
    high = (
        0.0, 0.12435499454676144, 0.24497866312686414, 0.35877067027057225, 0.4636476090008061, 0.5585993153435624,
        0.6435011087932844, 0.7188299996216245, 0.7853981633974483,
    )  # fmt: skip
    low = (
        0.0, -3.125324142e-18, 1.069875562e-17, -2.462381558e-17, 2.269877745e-17, -5.455630549e-18, 1.583478505e-17,
        -2.147838844e-17, 3.061616998e-17,
    )  # fmt: skip
    quarter = 1.5707963267948966, 6.123233995736766e-17
    first, rounding = np.zeros((4, _STEPS + 1)), np.zeros((4, _STEPS + 1))
    for octant, (turns, sign) in enumerate(((0.0, 1.0), (1.0, -1.0), (2.0, -1.0), (1.0, 1.0))):
        for k in range(_STEPS + 1):
            large, small = turns * quarter[0], sign * high[k]
            total = large + small
            kept = total - large
            lost = (large - (total - kept)) + (small - kept)
            first[octant, k] = total
            rounding[octant, k] = lost + (turns * quarter[1] + sign * low[k])
    return first, rounding


_DIRECTION, _ROUNDING = _list_directions()


@kernel
def direction(y: float, x: float) -> float:
    """Angle (rad) of the vector (x, y) from the x axis, in -pi to pi: the arctangent of ``y / x``, to the last digit or two."""
    across, along = abs(y), abs(x)
    small, large = min(across, along), max(across, along)
    if not (large > 0.0 and large < np.inf):
        return 0.0 if large == 0.0 else np.nan
    k = int(small / large * _STEPS + 0.5)
    part = k * (1.0 / _STEPS)
    u = (small - part * large) / (large + part * small)
    q = u * u
    # Horner's scheme of the arctangent, from 1/15 down.
    s = -1.0 / 15.0
    s = 1.0 / 13.0 + q * s
    s = -1.0 / 11.0 + q * s
    s = 1.0 / 9.0 + q * s
    s = -1.0 / 7.0 + q * s
    s = 1.0 / 5.0 + q * s
    s = -1.0 / 3.0 + q * s
    rest = u + u * (q * s)
    if along >= across:
        octant, sign = (0, 1.0) if x >= 0.0 else (2, -1.0)
    else:
        octant, sign = (1, -1.0) if x >= 0.0 else (3, 1.0)
    angle = _DIRECTION[octant, k] + (_ROUNDING[octant, k] + sign * rest)
    return angle if y >= 0.0 else -angle


@kernel
def arcsine(x: float) -> float:
    """Arcsine (rad)."""
    return direction(x, math.sqrt((1.0 - x) * (1.0 + x)))


@kernel
def arccosine(x: float) -> float:
    """Arccosine (rad)."""
    return direction(math.sqrt((1.0 - x) * (1.0 + x)), x)


@kernel
def _power_of_2(exponent: float) -> float:
    """2 to a whole power from -1022 to 1023, by its bits."""
    bits = np.int64((int(exponent) + _EXPONENT_BIAS) << _FRACTION_BITS)
    return float(bits.view(np.float64))


@kernel
def _reduce_exponent(x: float) -> tuple[float, float]:
    """Return the power of 2 nearest to an exponential, and what is left of the exponential less 1."""
    power = np.floor(x * _INVERSE_LN_2 + 0.5)
    high, low = x - power * _LN_2_HIGH, power * _LN_2_LOW
    y = high - low
    # Horner's scheme, from 1/13! down.
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
    return power, y + (y * (y * s) + ((high - y) - low))


@kernel
def exponential(x: float) -> float:
    """Exponential, to the last digit; 0 below -708, infinite beyond 709."""
    power, less_1 = _reduce_exponent(min(max(x, _LOWEST), _HIGHEST))
    if _LOWEST <= x <= _HIGHEST:
        return (1.0 + less_1) * _power_of_2(power)
    return 0.0 if x < _LOWEST else (np.inf if x > _HIGHEST else x)


@kernel
def hyperbolic_tangent(x: float) -> float:
    """Hyperbolic tangent, to the last digit or two."""
    power, less_1 = _reduce_exponent(max(-2.0 * abs(x), -80.0))
    less_1 = less_1 if power == 0.0 else (1.0 + less_1) * _power_of_2(power) - 1.0
    size = -less_1 / (2.0 + less_1)
    return size if x >= 0.0 else -size


@kernel
def hyperbolic_cosine(x: float) -> float:
    """Hyperbolic cosine, to the last digit or two."""
    rising = exponential(abs(x))
    return 0.5 * (rising + 1.0 / rising)
