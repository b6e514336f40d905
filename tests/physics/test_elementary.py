"""Elementary functions against numbers of forty digits, over their range."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest

from riftberg.physics import elementary

RANDOM = np.random.default_rng(0)


def spread(low: float, high: float, count: int = 2000) -> list[float]:
    """Return numbers of any size between two, of one sign."""
    return [float(x) for x in low * (high / low) ** RANDOM.uniform(0.0, 1.0, count)]


ANGLES = [
    *RANDOM.uniform(-7.0, 7.0, 3000),
    *RANDOM.uniform(-1e5, 1e5, 1000),
    *(k * math.pi / 4.0 for k in range(-40, 41)),
    *spread(1e-12, 1e-2, 500),
]
EXPONENTS = [*RANDOM.uniform(-40.0, 5.0, 3000), *RANDOM.uniform(-707.0, 708.0, 1000), *spread(1e-12, 1e-2, 300)]
SHARES = [*RANDOM.uniform(-1.0, 1.0, 1500), *spread(1e-12, 1e-2, 300), -1.0, 0.0, 1.0]
POSITIVE = [*spread(1e-9, 1e9), *RANDOM.uniform(0.5, 2.0, 1500), 1.0, 2.0]


def units_in_the_last_place(value: float, exact: mpmath.mpf) -> float:
    """Return the error of a number, by the distance of the exact one from the next number."""
    return float(abs(mpmath.mpf(value) - exact) / mpmath.mpf(float(np.spacing(abs(float(exact))))))


@pytest.mark.parametrize(
    ("function", "exact", "arguments", "most"),
    [
        (elementary.sin, mpmath.sin, ANGLES, 1.0),
        (elementary.cos, mpmath.cos, ANGLES, 1.0),
        (elementary.exp, mpmath.exp, EXPONENTS, 1.0),
        (elementary.fifth_root, lambda x: mpmath.root(x, 5), POSITIVE, 1.0),
        (elementary.cosh, mpmath.cosh, [*RANDOM.uniform(-20.0, 20.0, 1500)], 1.5),
        (elementary.asin, mpmath.asin, SHARES, 2.0),
        (elementary.log, mpmath.log, POSITIVE, 2.0),
        (elementary.log2, lambda x: mpmath.log(x, 2), POSITIVE, 2.5),
        (elementary.exp2, lambda x: mpmath.mpf(2) ** x, [*RANDOM.uniform(-20.0, 20.0, 1500), -3.0, 0.0, 8.0], 2.0),
        (elementary.tanh, mpmath.tanh, [*RANDOM.uniform(-5.0, 5.0, 2000), *spread(1e-9, 1e-2, 300)], 3.0),
    ],
)  # fmt: skip
def test_elementary_functions_are_right_to_the_last_digit_or_two(
    function: Callable[[float], float],
    exact: Callable[[mpmath.mpf], mpmath.mpf],
    arguments: list[float],
    most: float,
) -> None:
    with mpmath.workdps(40):
        errors = [units_in_the_last_place(function(float(x)), exact(mpmath.mpf(float(x)))) for x in arguments]
    assert max(errors) <= most


def test_arctangents_of_vectors_in_all_directions_are_right_to_the_last_digit_or_two() -> None:
    vectors = RANDOM.normal(size=(4000, 2)) * 10.0 ** RANDOM.uniform(-3.0, 3.0, (4000, 1))
    vectors = np.vstack([vectors, RANDOM.normal(size=(1000, 2)) * 10.0 ** RANDOM.uniform(-6.0, 6.0, (1000, 2))])
    with mpmath.workdps(40):
        errors = [
            units_in_the_last_place(elementary.atan2(y, x), mpmath.atan2(mpmath.mpf(y), mpmath.mpf(x)))
            for x, y in vectors.tolist()
        ]
    assert max(errors) <= 1.5


AXES = [(0.0, 1.0, 0.0), (1.0, 0.0, math.pi / 2), (0.0, -1.0, math.pi), (-1.0, 0.0, -math.pi / 2), (0.0, 0.0, 0.0)]


@pytest.mark.parametrize(("y", "x", "angle"), AXES)
def test_arctangents_along_the_axes_are_those_of_the_c_library(y: float, x: float, angle: float) -> None:
    assert elementary.atan2(y, x) == angle == math.atan2(y, x)


def test_far_out_functions_end_where_numbers_do() -> None:
    assert (elementary.exp(-708.1), elementary.exp(-math.inf), elementary.exp(0.0)) == (0.0, 0.0, 1.0)
    assert (elementary.exp(709.1), elementary.exp(math.inf)) == (math.inf, math.inf)
    assert [elementary.tanh(x) for x in (0.0, 50.0, -50.0, math.inf, -math.inf)] == [0.0, 1.0, -1.0, 1.0, -1.0]
    assert elementary.fifth_root(0.0) == 0.0


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "tanh", "asin", "cosh"])
def test_what_is_no_number_stays_none(name: str) -> None:
    assert math.isnan(getattr(elementary, name)(math.nan))
    assert math.isnan(elementary.atan2(math.nan, 1.0))
    assert math.isnan(elementary.atan2(1.0, math.nan))


def test_arrays_of_any_shape_have_the_digits_of_single_numbers() -> None:
    x = RANDOM.uniform(-3.0, 3.0, (4, 5))
    for name in ("sin", "cos", "exp", "tanh"):
        array = getattr(elementary, f"{name}_array")(x)
        assert array.shape == x.shape
        assert array.ravel().tolist() == [getattr(elementary, name)(value) for value in x.ravel().tolist()]
        assert getattr(elementary, f"{name}_array")(0.5) == getattr(elementary, name)(0.5)
