"""Exponential and hyperbolic tangent against numbers of forty digits."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest

from riftberg.physics.exponentials import fast_falling_exp, fast_tanh


def exact_exp(x: float) -> Decimal:
    """Return the exponential of exactly this number."""
    with localcontext() as context:
        context.prec = 40
        return Decimal(x).exp()


def exact_tanh(x: float) -> Decimal:
    """Return the hyperbolic tangent of exactly this number."""
    with localcontext() as context:
        context.prec = 40
        falling = (-2 * abs(Decimal(x))).exp()
        return ((1 - falling) / (1 + falling)).copy_sign(Decimal(x))


ARGUMENTS = [*np.random.default_rng(0).uniform(-40.0, 0.0, 2000), *-np.logspace(-12.0, math.log10(690.0), 400), 0.0]


def test_falling_exponential_is_right_to_3e_16_of_it():
    error = [abs(float(Decimal(fast_falling_exp(x)) / exact_exp(x) - 1)) for x in ARGUMENTS]
    assert max(error) < 3e-16
    assert fast_falling_exp(0.0) == 1.0


def test_hyperbolic_tangent_is_right_to_3e_16_of_1():
    signed = [*ARGUMENTS, *(-x for x in ARGUMENTS)]
    assert max(abs(float(Decimal(fast_tanh(x)) - exact_tanh(x))) for x in signed) < 3e-16
    assert (fast_tanh(0.0), fast_tanh(50.0), fast_tanh(-50.0)) == (0.0, 1.0, -1.0)
    assert (fast_tanh(math.inf), fast_tanh(-math.inf)) == (1.0, -1.0)


@pytest.mark.parametrize("x", [-700.1, -1e6, -1e300, -math.inf])
def test_far_out_the_exponential_is_0(x):
    assert fast_falling_exp(x) == 0.0


def test_what_is_no_number_stays_none():
    assert math.isnan(fast_falling_exp(math.nan))
    assert math.isnan(fast_tanh(math.nan))
