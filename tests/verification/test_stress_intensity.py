"""Stress intensity at the tips of rifts, over the handbook's, in the elastic cells of bergs, whatever the lattice.

Tada, Paris and Irwin, The Stress Analysis of Cracks Handbook: cracks inside a plate, inclined to the tension, and cracks from the
edge of a strip. A rift ends in the middle between the last bond that it crosses and the next one on its way. Lattices and angles
are others than those of the specification by whose prototype the method was chosen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.physics.crack_tip import hoop_intensity
from riftberg.state import Floats
from riftberg.stepping.fracture.crack_tips import TipIntensity, tips_of_rifts
from verification.test_crack_lines import RADIUS, SPACING, THICKNESS, Equilibrium, Plate
from verification.test_cracks_in_cells import edge_factor

LATTICES = [(packing, angle) for packing in ("square", "hexagonal") for angle in (7.0, 19.0, 37.0, 52.0)]
SOME = [("square", 37.0), ("hexagonal", 19.0)]


class Compared(NamedTuple):
    """Intensities of both tips over those of the handbook, and the kinks beyond those of theory."""

    opening: Floats
    shearing: Floats  # Over K_I of the handbook without inclination
    hoop: Floats
    kink: Floats  # degrees


def plate_with(rift: Floats, packing: str, angle: float, length: float, width: float, **berg: float) -> Plate:
    """A plate with a rift along a line (m from its middle)."""
    made = Iceberg.rectangle(
        length, width, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle, **berg
    )
    # Beside the middle, where a row of elements may lie.
    plate = Plate(packing, angle, length, width, made.with_rifts([rift + np.array([0.21, 0.13]) * SPACING], broken=True))
    plate.tips = tips_of_rifts(plate.el, plate.bonds, plate.p)
    return plate


def pulled(plate: Plate, length: float, width: float, stress: float = 1e3) -> Floats:
    """Forces (N) along x on the last two cells at both ends, for a mean stress (Pa) without a moment."""
    force = np.zeros(plate.el.size)
    for sign in (-1.0, 1.0):
        mass = plate.el.mass * (sign * plate.x > 0.5 * length - 2.0 * SPACING)
        mass *= 1.0 - (mass * plate.y).sum() / (mass * plate.y**2).sum() * plate.y
        force += sign * mass * (stress * width * THICKNESS / mass.sum())
    return force


def ends_of(moment: Equilibrium) -> list[TipIntensity]:
    return list(moment.intensities.values())


def middle_crack(packing: str, angle: float, cells: int, inclined: float) -> Compared:
    """A crack of some cells in the middle of a plate that is eight times as wide, ``inclined`` (degrees) to the normal of the pull."""
    side = max(8.0 * cells, 36.0) * SPACING
    t = np.radians(inclined)
    half = 0.5 * cells * SPACING * np.array([np.sin(t), np.cos(t)])
    plate = plate_with(np.array([half, -half]), packing, angle, side, side)
    tips = ends_of(plate.under(pulled(plate, side, side)))
    assert len(tips) == 2
    length = float(np.hypot(*(tips[0].ring.end - tips[1].ring.end)))
    whole = 1e3 * np.sqrt(0.5 * np.pi * length / np.cos(0.5 * np.pi * length * np.cos(t) / side))
    opening, shearing = whole * np.cos(t) ** 2, -whole * np.sin(t) * np.cos(t)
    kink, hoop = hoop_intensity(opening, shearing)
    return Compared(
        np.array([k.opening for k in tips]) / opening, np.array([k.shearing for k in tips]) / (shearing or whole),
        np.array([k.hoop for k in tips]) / hoop, np.degrees(np.array([k.kink for k in tips]) - kink),
    )  # fmt: skip


def edge_crack(packing: str, angle: float, cells: float, ligament: float) -> tuple[float, float]:
    """K_I and K_II over K_I of the handbook, of a crack from the edge of a strip."""
    width = (cells + ligament) * SPACING
    length = max(3.0 * width, 24.0 * SPACING)
    rift = np.array([[0.0, -0.6 * width], [0.0, cells * SPACING - 0.5 * width - 0.13 * SPACING]])
    plate = plate_with(rift, packing, angle, length, width)
    (tip,) = ends_of(plate.under(pulled(plate, length, width)))
    depth = float(tip.ring.end[1] - (plate.now.xy[:, 1] - plate.y).mean()) + 0.5 * width
    theory = 1e3 * np.sqrt(np.pi * depth) * edge_factor(depth / width)
    assert tip.ring.reliable
    return tip.opening / theory, tip.shearing / theory


INCLINED = (0.0, 20.0, 35.0, -55.0)
WITHIN = {3.6: (0.11, 0.16), 4: (0.08, 0.11), 5: (0.06, 0.10), 7: (0.04, 0.06), 14: (0.04, 0.06)}
"""Errors of the hoop intensity by the length of a crack in cells: mean of its two tips, and each of them."""

TABLE = [
    pytest.param(
        packing, angle, cells, inclined,
        marks=() if (packing, angle) in SOME and (cells, inclined) in ((4, 20.0), (5, -55.0), (7, 35.0)) else pytest.mark.slow,
    )
    for packing, angle in LATTICES
    for cells in WITHIN
    for inclined in INCLINED
]  # fmt: skip


@pytest.mark.parametrize(("packing", "angle", "cells", "inclined"), TABLE)
def test_a_rift_inside_the_ice_has_the_intensity_of_the_handbook(packing, angle, cells, inclined) -> None:
    """Of both modes, and the way on which it goes on."""
    found = middle_crack(packing, angle, cells, inclined)
    mean, each = WITHIN[cells]
    assert found.hoop.mean() == pytest.approx(1.0, abs=mean)
    assert found.hoop == pytest.approx(1.0, abs=each)
    if cells < 7:
        return
    assert found.opening.mean() == pytest.approx(1.0, abs=0.05)
    if inclined:
        assert found.shearing.mean() == pytest.approx(1.0, abs=0.06)
    else:
        assert abs(found.shearing) == pytest.approx(0.0, abs=0.03)
    assert found.kink == pytest.approx(0.0, abs=3.0)


EDGES = [
    pytest.param(
        packing, angle, cells, ligament,
        marks=() if (packing, angle) in SOME and (cells, ligament) == (4, 6) else pytest.mark.slow,
    )
    for packing, angle in LATTICES
    for cells in (3.3, 4, 5, 8)
    for ligament in (6, 3 * cells)
]  # fmt: skip


@pytest.mark.parametrize(("packing", "angle", "cells", "ligament"), EDGES)
def test_a_rift_from_the_edge_has_the_intensity_of_the_handbook(packing, angle, cells, ligament) -> None:
    """Such as that of A68a: 3 to 8 cells long, with as little as six cells of ice ahead."""
    opening, shearing = edge_crack(packing, angle, cells, ligament)
    assert opening == pytest.approx(1.0, abs=0.1 if cells < 5 or ligament == 6 else 0.05)
    assert shearing == pytest.approx(0.0, abs=0.05)
