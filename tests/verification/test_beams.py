"""Bending beams against the theory of elastic beams (equations 10.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cases import CANTILEVER, CASES, SUPPORTED, Beam, cantilever, supported_beam
from riftberg import Forcing, Model

POISSON = 0.3


def bending_stiffness(beam: Beam) -> float:
    """Return E J, N m2."""
    return beam.youngs_modulus * beam.thickness * (2.0 * beam.radius * beam.rows) ** 3 / 12.0


def supported_deflection(beam: Beam, x: np.ndarray) -> np.ndarray:
    """Deflection (m) of a slender supported beam under a load in its middle, for small slopes."""
    x = np.minimum(x, beam.length - x)
    return -beam.load * x * (3 * beam.length**2 - 4 * x**2) / (48 * bending_stiffness(beam))


def elastica(beam: Beam, *, axial: float = np.inf, shear: float = np.inf) -> tuple[float, float]:
    """Tip (x, deflection; m) of a cantilever under a dead load at its end, for any size of the deflection.

    ``E J theta' = P (x_tip - x)`` along the beam, solved by shooting on the moment at the clamp; with finite axial (E A)
    and shear stiffness (G A) in N the centre line also stretches and shears.
    """
    load = beam.load

    def along(_, state):
        angle, moment = state[:2]
        stretch, slip = 1.0 + load * np.sin(angle) / axial, load * np.cos(angle) / shear
        dx = stretch * np.cos(angle) - slip * np.sin(angle)
        dy = stretch * np.sin(angle) + slip * np.cos(angle)
        return [moment / bending_stiffness(beam), -load * dx, dx, dy]

    def shoot(moment):
        return solve_ivp(along, (0.0, beam.length), [0.0, moment, 0.0, 0.0], rtol=1e-10, atol=1e-9).y[:, -1]

    straight = load * beam.length
    tip = shoot(brentq(lambda m: shoot(m)[1] / straight, 0.3 * straight, 1.2 * straight, rtol=1e-12))
    return float(tip[2]), float(tip[3])


def rest(berg, beam: Beam, **changes) -> Model:
    """Return the model after the beam has come to rest."""
    parameters = beam.parameters("own").changed(stepping={"time_step": beam.duration / 10}, **changes)
    model = Model(berg, Forcing.uniform(depth=0.0), parameters)
    model.advance(steps=20)
    assert np.abs(model.elements.v).max() < 1e-5 * beam.length / beam.duration
    return model


def test_supported_beam(agrees) -> None:
    beam = SUPPORTED
    model = rest(supported_beam(), beam)
    deflection = model.elements.lat - 151_000.5
    asked = supported_deflection(beam, np.linspace(0.0, beam.length, beam.columns))
    agrees("supported beam: middle (m)", asked.min(), deflection[beam.columns // 2], rel=0.02)
    assert np.abs(deflection - asked).max() < 0.02 * np.abs(asked).max()
    assert np.allclose(deflection, deflection[::-1], atol=1e-6)


def test_supported_beam_under_a_small_load(agrees) -> None:
    """Without the effect of size what is left is the shear of the bonds: P l / (4 G A)."""
    beam = replace(SUPPORTED, load=1.5e3)
    model = rest(supported_beam(beam), beam)
    sheared = beam.load * beam.length / (4 * beam.youngs_modulus / (2 * (1 + POISSON)) * beam.section)
    asked = beam.load * beam.length**3 / (48 * bending_stiffness(beam)) + sheared
    got = 151_000.5 - model.elements.lat[beam.columns // 2]
    agrees("supported beam, 1 % of the load: middle with shear (m)", asked, got, rel=0.002)


def test_cantilever(agrees) -> None:
    """The centre line at the end of the beam; the lattice also stretches (E A) and shears (G A)."""
    beam = CANTILEVER
    model = rest(cantilever(), beam)
    x, y = model.elements.lon.reshape(-1, 3)[-1, 1] - 101_000.0, 156_000.0 - model.elements.lat.reshape(-1, 3)[-1, 1]
    tip_x, tip_y = elastica(beam)
    agrees("cantilever: tip deflection (m), elastica", tip_y, y, rel=0.02)
    agrees("cantilever: tip x (m), elastica", tip_x, x, rel=0.02)
    axial = beam.youngs_modulus * beam.section
    tip_x, tip_y = elastica(beam, axial=axial, shear=axial / (2 * (1 + POISSON)))
    agrees("cantilever: tip deflection (m), elastica with E A, G A", tip_y, y, rel=0.01)
    agrees("cantilever: tip x (m), elastica with E A, G A", tip_x, x, rel=0.01)


def test_cantilever_under_a_small_load(agrees) -> None:
    beam = replace(CANTILEVER, load=1.5e7)
    model = rest(cantilever(beam), beam)
    asked = beam.load * beam.length**3 / (3 * bending_stiffness(beam))
    got = 156_000.0 - model.elements.lat.reshape(-1, 3)[-1, 1]
    agrees("cantilever, 0.1 % of the load: tip (m)", asked, got, rel=0.02)


def test_elastica_of_a_small_load_is_the_straight_beam() -> None:
    beam = replace(CANTILEVER, load=1.5e7)
    assert elastica(beam)[1] == pytest.approx(beam.load * beam.length**3 / (3 * bending_stiffness(beam)), rel=1e-5)


def test_rest_does_not_depend_on_damping_and_drag(agrees) -> None:
    """Another damper and another drag lead to the same equilibrium."""
    beam = CANTILEVER
    other = rest(cantilever(), beam, bonds={"objective_damping": False}, grounding={"coefficient": 0.7})
    same = rest(cantilever(), beam)
    agrees("cantilever, other damping: tip y (m)", same.elements.lat[-2], other.elements.lat[-2], rel=1e-6)


@pytest.mark.parametrize(("name", "beam"), [("supported-beam", SUPPORTED), ("cantilever", CANTILEVER)])
def test_beams_come_to_rest(name, beam) -> None:
    model = CASES[name]()
    before = model.elements.lat.copy()
    model.advance(steps=round(beam.duration / beam.time_step))
    assert np.abs(model.elements.v).max() < 1e-6 * np.abs(model.elements.lat - before).max()


def test_beams_know_the_numerics_of_the_reference() -> None:
    supported = CASES["supported-beam"]("reference")
    clamped = CASES["cantilever"]("reference")
    assert (supported.substeps, clamped.substeps) == (100_000, 2000)
    assert supported.bonds.first.size == 28
    assert clamped.bonds.first.size == 147
    assert clamped.elements.static.sum() == 3
    assert supported.elements.mass == pytest.approx(200.0)
    assert clamped.elements.mass == pytest.approx(2.25e10)
