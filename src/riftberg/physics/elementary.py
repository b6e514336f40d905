"""Elementary functions by plain arithmetic: the same digits on every processor and with every C library.

Those of a C library, and the vector functions of NumPy, choose their code by the processor, and round the last bit otherwise.
Sums, products, quotients and square roots of two numbers are rounded alike everywhere. Here arguments are led back to a short
range, with a table at most, and a Taylor polynomial is written out: a loop over coefficients would not be unrolled before the
loop over elements vectorises.

KID's engine calls the C library in its own kernels, as the reference does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from riftberg.compiled.kernels import kernel

Floats = NDArray[np.float64]

_TWO_OVER_PI: Final = 2.0 / math.pi
# pi / 2 in three parts; the first two have 33 bits, so that their products with up to a million quarter turns are exact.
_QUARTER_HIGH: Final = 1.5707963267341256
_QUARTER_MIDDLE: Final = 6.077100506303966e-11
_QUARTER_LOW: Final = 2.0222662487959506e-21

_INVERSE_LN_2: Final = 1.4426950408889634
_LN_2: Final = 0.6931471805599453
# The same in two parts; the first has 32 bits, so that its products with the exponents of all numbers are exact.
_LN_2_HIGH: Final = 0.6931471803691238
_LN_2_LOW: Final = 1.9082149292705877e-10

_LOWEST: Final = -708.0
"""Argument below which an exponential counts as 0: it is below 1e-307."""

_HIGHEST: Final = 709.0
"""Argument beyond which an exponential counts as infinite: it is above 8e307."""

_ROOT_OF_2: Final = math.sqrt(2.0)

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
def _sin_cos_within_eighth(x: float, error: float) -> tuple[float, float]:
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
def _sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle (rad), to the last digit up to a million turns."""
    x, error, quarter = _reduce_angle(angle)
    s, c = _sin_cos_within_eighth(x, error)
    crosses = quarter == 1.0 or quarter == 3.0
    size_s, size_c = c if crosses else s, s if crosses else c
    return -size_s if quarter >= 2.0 else size_s, -size_c if quarter == 1.0 or quarter == 2.0 else size_c


@kernel
def sin(angle: float) -> float:
    """Sine of an angle (rad), to the last digit up to a million turns."""
    return _sin_cos(angle)[0]


@kernel
def cos(angle: float) -> float:
    """Cosine of an angle (rad), to the last digit up to a million turns."""
    return _sin_cos(angle)[1]


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
def atan2(y: float, x: float) -> float:
    """Angle (rad) of the vector (x, y) from the x axis, in -pi to pi: the arctangent of ``y / x``, to the last digit or two."""
    across, along = abs(y), abs(x)
    small, large = min(across, along), max(across, along)
    if not 0.0 < across + along < np.inf:
        return 0.0 if across + along == 0.0 else np.nan
    k = int(small / large * _STEPS + 0.5)
    tangent = k * (1.0 / _STEPS)
    u = (small - tangent * large) / (large + tangent * small)
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
def asin(x: float) -> float:
    """Arcsine (rad)."""
    return atan2(x, math.sqrt((1.0 - x) * (1.0 + x)))


@kernel
def _binary_power(exponent: float) -> float:
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
def exp(x: float) -> float:
    """Exponential, to the last digit; 0 below -708, infinite beyond 709."""
    power, less_1 = _reduce_exponent(min(max(x, _LOWEST), _HIGHEST))
    if _LOWEST <= x <= _HIGHEST:
        return (1.0 + less_1) * _binary_power(power)
    return 0.0 if x < _LOWEST else (np.inf if x > _HIGHEST else x)


@kernel
def tanh(x: float) -> float:
    """Hyperbolic tangent, to the last digit or two."""
    power, less_1 = _reduce_exponent(max(-2.0 * abs(x), -80.0))
    less_1 = less_1 if power == 0.0 else (1.0 + less_1) * _binary_power(power) - 1.0
    size = -less_1 / (2.0 + less_1)
    return size if x >= 0.0 else -size


@kernel
def cosh(x: float) -> float:
    """Hyperbolic cosine, to the last digit or two."""
    rising = exp(abs(x))
    return 0.5 * (rising + 1.0 / rising)


@kernel
def _reduce_logarithm(x: float) -> tuple[float, float]:
    """Return the power of 2 nearest to a number above 1e-307, and the natural logarithm of their quotient."""
    bits = np.float64(x).view(np.int64)
    power = (bits >> _FRACTION_BITS) - _EXPONENT_BIAS
    fraction = x * _binary_power(-float(power))
    if fraction > _ROOT_OF_2:
        fraction, power = 0.5 * fraction, power + 1
    t = (fraction - 1.0) / (fraction + 1.0)
    q = t * t
    # Horner's scheme of the inverse hyperbolic tangent, from 1/21 down.
    s = 1.0 / 21.0
    s = 1.0 / 19.0 + q * s
    s = 1.0 / 17.0 + q * s
    s = 1.0 / 15.0 + q * s
    s = 1.0 / 13.0 + q * s
    s = 1.0 / 11.0 + q * s
    s = 1.0 / 9.0 + q * s
    s = 1.0 / 7.0 + q * s
    s = 1.0 / 5.0 + q * s
    s = 1.0 / 3.0 + q * s
    return float(power), 2.0 * t + 2.0 * t * (q * s)


@kernel
def log(x: float) -> float:
    """Natural logarithm of a number above 1e-307, to the last digit or two."""
    power, rest = _reduce_logarithm(x)
    return power * _LN_2_HIGH + (power * _LN_2_LOW + rest)


@kernel
def log2(x: float) -> float:
    """Logarithm to base 2 of a number above 1e-307, to the last digit or two; exact for powers of 2."""
    power, rest = _reduce_logarithm(x)
    return power + rest * _INVERSE_LN_2


@kernel
def exp2(x: float) -> float:
    """2 to a power from -1000 to 1000, to the last digit or two; exact for whole ones."""
    whole = np.floor(x)
    return exp((x - whole) * _LN_2) * _binary_power(whole)


@kernel
def fifth_root(x: float) -> float:
    """Fifth root of a number that is not negative, to the last digit."""
    if not x > 1e-300:
        return 0.0
    y = exp(0.2 * log(x))
    return y - 0.2 * (y - x / (y * y * y * y))  # Newton's method doubles the digits


@kernel
def _fill_sin(x: Floats, out: Floats) -> None:
    for n in range(x.size):
        out[n] = sin(x[n])


@kernel
def _fill_cos(x: Floats, out: Floats) -> None:
    for n in range(x.size):
        out[n] = cos(x[n])


@kernel
def _fill_exp(x: Floats, out: Floats) -> None:
    for n in range(x.size):
        out[n] = exp(x[n])


@kernel
def _fill_tanh(x: Floats, out: Floats) -> None:
    for n in range(x.size):
        out[n] = tanh(x[n])


@kernel
def _fill_asin(x: Floats, out: Floats) -> None:
    for n in range(x.size):
        out[n] = asin(x[n])


@kernel
def _fill_atan2(y: Floats, x: Floats, out: Floats) -> None:
    for n in range(x.size):
        out[n] = atan2(y[n], x[n])


def _take_arrays(fill: Callable[[Floats, Floats], None], x: ArrayLike) -> Floats:
    """Return the values of a function for an array of any shape."""
    numbers = np.asarray(x, np.float64)
    out = np.empty(numbers.size)
    fill(numbers.ravel(), out)
    return out.reshape(numbers.shape)


def sin_array(x: ArrayLike) -> Floats:
    """Sines of an array of angles (rad)."""
    return _take_arrays(_fill_sin, x)


def cos_array(x: ArrayLike) -> Floats:
    """Cosines of an array of angles (rad)."""
    return _take_arrays(_fill_cos, x)


def exp_array(x: ArrayLike) -> Floats:
    """Exponentials of an array."""
    return _take_arrays(_fill_exp, x)


def tanh_array(x: ArrayLike) -> Floats:
    """Hyperbolic tangents of an array."""
    return _take_arrays(_fill_tanh, x)


def asin_array(x: ArrayLike) -> Floats:
    """Arcsines (rad) of an array."""
    return _take_arrays(_fill_asin, x)


def atan2_array(y: ArrayLike, x: ArrayLike) -> Floats:
    """Angles (rad) of an array of vectors (x, y) from the x axis."""
    north, east = np.broadcast_arrays(np.asarray(y, np.float64), np.asarray(x, np.float64))
    out = np.empty(north.size)
    _fill_atan2(north.ravel(), east.ravel(), out)
    return out.reshape(north.shape)
