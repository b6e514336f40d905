"""The footloose mechanism against its twin, the figures of the specification, and what it conserves."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from physics.agreement import SEEDS, assert_same
from riftberg.physics import calving
from twins import footloose as twin

YOUNGS, STRENGTH = 1e8, 250e3


def test_lengths_of_the_specification():
    """Section 8.6: 300 m thick, 1e8 Pa: 396.1 m, 439.9 m, foot 48.67 m, 6.42e4 m2."""
    assert calving.buoyancy_length(300.0, YOUNGS) == pytest.approx(396.1, abs=0.05)
    wide, foot = calving.piece_width(300.0, YOUNGS), calving.foot_length(300.0, YOUNGS, STRENGTH, 850.0)
    assert wide == pytest.approx(439.9, abs=0.05)
    assert foot == pytest.approx(48.67, abs=0.005)
    assert foot * 3 * wide == pytest.approx(6.42e4, rel=1e-3)


def random_berg(seed):
    r = np.random.default_rng(seed)
    wide = calving.piece_width(t := r.uniform(50, 400), YOUNGS)
    short, long = sorted(wide * r.uniform(0.5, 20.0, 2))
    return t, short, long, 10 ** r.uniform(3, 6.5)


def test_pieces_and_sides_equal_twin():
    seen = set()
    for seed in range(400):
        t, w, length, foot = random_berg(seed)
        got = calving.pieces_ready(foot, t, w, length, YOUNGS, STRENGTH, 850.0)
        assert got == twin.pieces(foot, t, w, length, YOUNGS, STRENGTH, 850.0)
        seen.add(got)
        if got > 0:
            assert_same(calving.sides_without(got, t, w, length, YOUNGS), twin.sides(got, t, w, length, YOUNGS))
    assert len(seen) > 5


def test_pieces_take_their_own_area():
    """Whatever side they come from: 3 b2 each; no side becomes negative."""
    for seed in range(400):
        t, w, length, foot = random_berg(seed)
        count = calving.pieces_ready(foot, t, w, length, YOUNGS, STRENGTH, 850.0)
        if count > 0:
            wide = calving.piece_width(t, YOUNGS)
            narrow, short = calving.sides_without(count, t, w, length, YOUNGS)
            assert w * length - narrow * short == pytest.approx(3 * count * wide * wide, rel=1e-9)
            assert min(narrow, short) >= 0.0


def test_no_piece_before_the_foot_is_long_enough():
    each = calving.foot_length(300.0, YOUNGS, STRENGTH, 850.0) * 3 * calving.piece_width(300.0, YOUNGS)
    for count in (0, 1, 2):
        foot = each * (count + 0.999)
        assert calving.pieces_ready(foot, 300.0, 3600.0, 3600.0, YOUNGS, STRENGTH, 850.0) == count


def test_waves_make_the_foot_and_convection_takes_it():
    """Above water per freeboard, below per keel; never below nothing."""
    free, keel = 300.0 * (1 - 850 / 1025), 300.0 * 850 / 1025
    grown = calving.grow_foot(10.0, 300.0, 3000.0, 1e6, 0.0, YOUNGS, 850.0)
    assert grown == pytest.approx(10.0 + 1e6 / free / 850.0, rel=1e-12)
    assert calving.grow_foot(grown, 300.0, 3000.0, 0.0, 1e6, YOUNGS, 850.0) == pytest.approx(
        grown - 1e6 / keel / 850.0, rel=1e-9
    )
    assert calving.grow_foot(10.0, 300.0, 3000.0, 0.0, 1e12, YOUNGS, 850.0) == 0.0
    assert calving.grow_foot(10.0, 300.0, 500.0, 1e6, 0.0, YOUNGS, 850.0) == 10.0
    assert calving.grow_foot(10.0, 0.0, 3000.0, 1e6, 0.0, YOUNGS, 850.0) == 10.0


@pytest.mark.parametrize("half_west", [True, False])
def test_places_lie_on_the_rim(half_west):
    for seed in SEEDS:
        draw = np.random.default_rng(seed).uniform()
        x, y = calving.rim_place(draw, 300.0, 800.0, half_west)
        on_side = abs(abs(x) - 400.0) < 1e-9 or abs(abs(y) - 150.0) < 1e-9
        assert on_side
        assert abs(x) <= 400.0 + 1e-9
        assert abs(y) <= (75.0 if half_west and draw > 0.75 else 150.0) + 1e-9


def test_corners_of_the_rim():
    places = [calving.rim_place(d, 2.0, 4.0, False) for d in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert places == [(-2.0, 1.0), (2.0, -1.0), (-2.0, -1.0), (-2.0, -1.0), (-2.0, 1.0)]


@pytest.mark.parametrize(
    ("a_day", "viscosity", "strength", "foot", "width"),
    [
        (0.1, 1e14, 250e3, 78, 83), (0.3, 1e14, 250e3, 67, 126), (1.0, 1e14, 250e3, 54, 196), (1.0, 1e14, 150e3, 31, 239),
        (0.1, 3e13, 250e3, None, 51), (0.1, 4e14, 250e3, None, 140), (1.0, 3e13, 250e3, None, 126), (1.0, 4e14, 250e3, None, 320),
    ],
)  # fmt: skip
def test_an_edge_that_relaxes_breaks_as_the_twin_does(a_day, viscosity, strength, foot, width):
    """The twin with the couple of the foot has the figures of the specification; the law, as KID's, leaves the couple out."""
    growth = a_day / 86400.0
    _, longest, wide = twin.relaxed(200.0, growth, strength, 850.0, viscosity, couple=True)
    assert wide == pytest.approx(width, rel=0.02)
    assert foot is None or longest == pytest.approx(foot, abs=0.6)
    youngs, longest, wide = twin.relaxed(200.0, growth, strength, 850.0, viscosity, couple=False)
    reached = calving.relaxed_modulus(200.0, growth, strength, 850.0, viscosity)
    assert reached == pytest.approx(youngs, rel=3e-3)
    assert calving.foot_length(200.0, reached, strength, 850.0) == pytest.approx(longest, rel=3e-3)
    assert calving.piece_width(200.0, reached) == pytest.approx(wide, rel=3e-3)


def test_an_edge_is_the_softer_the_slower_its_foot_grows():
    """A foot that hardly grows is ten years old; one that grows at once breaks ice of 9 GPa."""
    rates = [-1e-6, 0.0, 1e-6, 1e-5, 1e-4, 1.0]
    moduli = [calving.relaxed_modulus(200.0, rate, 250e3, 850.0, 1e14) for rate in rates]
    assert moduli[0] == moduli[1] == pytest.approx(1e14 / calving.LONGEST_LOAD, rel=1e-3)
    assert all(a < b for a, b in itertools.pairwise(moduli[1:]))
    assert moduli[-1] == pytest.approx(9e9, rel=1e-2)
