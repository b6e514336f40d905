"""Beams against theory: the theory itself, and what is told of a run."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.diagnostics.cases import BeamCase, BentBeam, clamped_line, supported_line


def test_a_supported_beam_has_its_largest_deflection_in_the_middle() -> None:
    x = np.linspace(0.0, 14.0, 15)
    line = supported_line(14.0, 1.5e5, 1e9 * 0.5**3 / 12.0, x)
    assert line.max() == line[7] == pytest.approx(1.5e5 * 14.0**3 / (48.0 * 1e9 * 0.5**3 / 12.0))
    np.testing.assert_allclose(line, line[::-1])
    assert line[0] == line[-1] == 0.0


def test_a_clamped_beam_of_a_small_load_is_the_straight_beam() -> None:
    x, down = clamped_line(100.0, 1.0, 1e6)
    assert down[-1] == pytest.approx(100.0**3 / 3e6, rel=1e-4)
    assert x[-1] == pytest.approx(100.0, rel=1e-5)
    np.testing.assert_allclose(down, x**2 * (300.0 - x) / 6e6, rtol=1e-3, atol=1e-9)


def test_a_clamped_beam_keeps_its_length_however_far_it_bends() -> None:
    """Twin: the end of an elastica from a table (Bisshopp and Drucker 1945): P L^2 / E J = 10 gives 0.811 L and 0.445 L."""
    x, down = clamped_line(1.0, 10.0, 1.0, 2001)
    assert np.hypot(np.diff(x), np.diff(down)).sum() == pytest.approx(1.0, rel=1e-5)
    assert down[-1] == pytest.approx(0.811, abs=2e-3)
    assert x[-1] == pytest.approx(0.445, abs=2e-3)


def test_a_beam_tells_its_deflection_and_when_it_came_to_rest() -> None:
    case = BeamCase("clamped", 30, 3, 145e3, 15e3, 1.0, 1.5e10)
    seconds = np.arange(0.0, 31_000.0, 1000.0)
    history = 48_700.0 * (1.0 - np.exp(-seconds / 2000.0))
    theory = clamped_line(145e3, 1.5e10, 1e9 * case.second_moment)
    beam = BentBeam(case, 1e9, theory[0], 1.015 * theory[1], *theory, seconds, history)
    assert beam.settled == 10_000.0
    assert beam.error == pytest.approx(48_700.0 / 47_995.0 - 1.0, abs=2e-4)
    text = " ".join(beam.lines())
    assert "deflection of its end: 48.7 km; theory (elastica): 47.99 km, difference +1.5 %" in text
    assert "145 km long, 15 km wide, 1 m thick" in text
    assert beam.facts()["relative_difference"] == beam.error
    moving = BentBeam(case, 1e9, *theory, *theory, seconds, seconds)
    assert "still moving" in moving.lines()[1]
