"""Bending of floating ice on the floor, against plates and beams on an elastic bed that are solved here by finite elements."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from riftberg.physics.seabed import WATER_STIFFNESS, bending_length, bending_stress, plate_deflection

H, E, NU = 200.0, 9e9, 0.3
D = E * H**3 / (12.0 * (1.0 - NU**2))
LENGTH = (D / WATER_STIFFNESS) ** 0.25
LAMBDA = math.sqrt(2.0) * LENGTH


def hermite(ends: np.ndarray) -> tuple[sp.csr_matrix, ...]:
    """Integrals of products of cubic Hermite functions over a line: of values, slopes, curvatures, and curvature times value."""
    points, weights = np.polynomial.legendre.leggauss(4)
    parts: list[list[tuple[int, int, float]]] = [[], [], [], []]
    for k, (a, b) in enumerate(pairwise(ends)):
        h, t = b - a, 0.5 * (points + 1.0)
        value = np.array([1 - 3 * t**2 + 2 * t**3, h * (t - 2 * t**2 + t**3), 3 * t**2 - 2 * t**3, h * (t**3 - t**2)])
        slope = np.array([6 * t**2 - 6 * t, h * (1 - 4 * t + 3 * t**2), 6 * t - 6 * t**2, h * (3 * t**2 - 2 * t)]) / h
        curve = np.array([12 * t - 6, h * (6 * t - 4), 6 - 12 * t, h * (6 * t - 2)]) / h**2
        for n, (f, g) in enumerate(((value, value), (slope, slope), (curve, curve), (curve, value))):
            matrix = (f * weights * 0.5 * h) @ g.T
            parts[n] += [(2 * k + i, 2 * k + j, matrix[i, j]) for i in range(4) for j in range(4)]
    size = 2 * len(ends)
    return tuple(
        sp.coo_matrix((v, (i, j)), (size, size)).tocsr() for i, j, v in (zip(*part, strict=True) for part in parts)
    )


class Plate:
    """A quarter of a large plate on water, with free edges (or edges of symmetry) along x = 0 and y = 0."""

    def __init__(self, symmetric: tuple[bool, bool] = (False, False)) -> None:
        self.ends = LENGTH * np.concatenate([np.linspace(0.0, 2.0, 25), np.linspace(2.0, 8.0, 16)[1:]])
        values, slopes, curves, mixed = hermite(self.ends)
        stiffness = D * (
            sp.kron(curves, values) + sp.kron(values, curves) + NU * (sp.kron(mixed, mixed.T) + sp.kron(mixed.T, mixed))
            + 2.0 * (1.0 - NU) * sp.kron(slopes, slopes)
        ) + WATER_STIFFNESS * sp.kron(values, values)  # fmt: skip
        size = 2 * len(self.ends)
        x, y = np.divmod(np.arange(size * size), size)
        # At an edge of symmetry the slope across it is zero.
        self.free = ~((symmetric[0] & (x == 1)) | (symmetric[1] & (y == 1)))
        self.stiffness, self.size = stiffness.tocsc(), size

    def bent_by_corner_force(self) -> np.ndarray:
        """Deflections and slopes under 1 N at the corner of the quarter; shape (x, y), each with value and slope in turns."""
        force, bent = np.zeros(self.size**2), np.zeros(self.size**2)
        force[0] = 1.0
        bent[self.free] = spsolve(self.stiffness[np.ix_(self.free, self.free)], force[self.free])
        return bent.reshape(self.size, self.size)


def test_the_plate_bends_around_a_load_as_the_kelvin_function_says() -> None:
    plate = Plate((True, True))
    bent = plate.bent_by_corner_force()[::2, 0]
    for k in (6, 12, 20, 28):
        assert plate_deflection(plate.ends[k] / LENGTH) == pytest.approx(bent[k] / bent[0], abs=5e-3)


def test_stress_at_a_corner_is_at_most_that_of_its_tip() -> None:
    """Across the bisector, the moment per metre of the force at a corner is N / 2 at the tip and falls from there."""
    plate = Plate()
    bent = plate.bent_by_corner_force()
    # Second differences along the bisector and across it, at nodes on the diagonal.
    ends, w = plate.ends, bent[::2, ::2]
    step, moments = ends[1] - ends[0], []
    for k in range(1, 24):
        wxx = (w[k + 1, k] - 2.0 * w[k, k] + w[k - 1, k]) / step**2
        wyy = (w[k, k + 1] - 2.0 * w[k, k] + w[k, k - 1]) / step**2
        wxy = (w[k + 1, k + 1] - w[k + 1, k - 1] - w[k - 1, k + 1] + w[k - 1, k - 1]) / (4.0 * step**2)
        along, across = 0.5 * (wxx + wyy) + wxy, 0.5 * (wxx + wyy) - wxy
        moments.append(abs(D * (along + NU * across)))
    stress = 6.0 * np.array(moments) / H**2
    limit = bending_stress(LENGTH, 0.25, H, w[0, 0])
    assert limit == pytest.approx(3.0 / H**2, rel=0.01)
    assert (stress[1:] < limit).all()
    assert stress[1] > 0.7 * limit
    assert (np.diff(stress[1:]) < 0.0).all()


def beam(inside: bool) -> tuple[float, float, float]:
    """Deflection (m), largest moment (N m per m) and its distance (m) under 1 N per metre, by finite elements."""
    ends = LAMBDA * np.linspace(0.0, 10.0, 1001)
    values, _, curves, _ = hermite(ends)
    stiffness, free = (D * curves + WATER_STIFFNESS * values).tocsc(), np.ones(2 * len(ends), bool)
    free[1] = not inside  # by symmetry
    force, bent = np.zeros(2 * len(ends)), np.zeros(2 * len(ends))
    force[0] = 0.5 if inside else 1.0
    bent[free] = spsolve(stiffness[np.ix_(free, free)], force[free])
    h, slope = ends[1], bent[1::2]
    moment = np.abs(D * np.gradient(slope, h, edge_order=2))
    return float(bent[0]), float(moment.max()), float(ends[moment.argmax()])


@pytest.mark.parametrize(("inside", "share"), [(True, 1.0), (False, 0.5)])
def test_stress_and_stiffness_of_a_line_are_those_of_a_beam_on_water(inside: bool, share: float) -> None:
    deflection, moment, place = beam(inside)
    assert 2.0 * share**2 * WATER_STIFFNESS * LAMBDA == pytest.approx(1.0 / deflection, rel=1e-3)
    assert bending_stress(LENGTH, share, H, deflection) == pytest.approx(6.0 * moment / H**2, rel=2e-3)
    assert place == pytest.approx(0.0 if inside else 0.25 * math.pi * LAMBDA, abs=0.02 * LAMBDA)


def test_figures_of_the_page() -> None:
    """Per metre of bending, 200 m, 9 GPa (1 GPa): edge 0.39 (0.13), inside 1.22 (0.41), corner 0.48 (0.16) MPa."""
    for modulus, figures in ((9e9, (0.48, 0.39, 1.22)), (1e9, (0.16, 0.13, 0.41))):
        length = bending_length(modulus, NU, H)
        found = [bending_stress(length, share, H, 1.0) / 1e6 for share in (0.25, 0.5, 1.0)]
        np.testing.assert_allclose(found, figures, rtol=0.02)
