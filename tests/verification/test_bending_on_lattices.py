"""Bending stress of ice that the sea floor lifts: the same on any lattice, and under a line that of a beam on water."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.physics.seabed import bending_length

pytestmark = pytest.mark.compiled

DRAFT = 250.0 * 850.0 / 1025.0
LATTICES: list[dict[str, Any]] = [
    {"radius": 1500.0},
    {"radius": 1500.0, "lattice_angle": 17.0},
    {"radius": 750.0, "lattice_angle": 33.0},
    {"radius": 1000.0, "lattice_angle": 10.0, "packing": "hexagonal"},
]
FLOORS: dict[str, Callable[[Any, Any], Any]] = {
    "a ridge from side to side": lambda x, y: DRAFT - 0.5 + 2e-3 * np.abs(x),
    "a round ridge": lambda x, y: DRAFT - 0.5 + 0.5 * (x / 1.5e3) ** 2,
    "a knoll under the middle": lambda x, y: DRAFT - 1.5 + 0.5 * (x * x + y * y) / 1.5e3**2,
    "a knoll at a side": lambda x, y: DRAFT - 0.5 + 0.5 * (x * x + (y - 4.5e3) ** 2) / 1.5e3**2,
    "a point at a side": lambda x, y: DRAFT - 0.5 + 2e-3 * np.hypot(x, y - 4.5e3),
    "a point at a corner": lambda x, y: DRAFT - 0.5 + 2e-3 * np.hypot(x - 9e3, y - 4.5e3),
}


class Floor(Forcing.uniform):
    """Still water over a floor of a given depth (m)."""

    def __init__(self, depth: Callable[[Any, Any], Any]) -> None:
        super().__init__(depth=1000.0)
        self._depth = depth

    def depth(self, lon: Any, lat: Any) -> Any:
        """Return the depth, m."""
        return self._depth(np.asarray(lon, float), np.asarray(lat, float))

    def sample(self, elements: Any, time: float) -> None:
        """Fill the environment."""
        super().sample(elements, time)
        elements.environment.depth[:] = self.depth(elements.lon, elements.lat)


class Bent(NamedTuple):
    """Largest bending stress of the bonds (Pa), that of the summary, bonds that it acts on, and weight on the floor (N)."""

    stress: float
    told: float
    bonds: int
    load: float


def bent(floor: Callable[[Any, Any], Any], modulus: float, **lattice: Any) -> Bent:
    """A berg of 18 x 9 km that starts on the floor."""
    berg = Iceberg.rectangle(18e3, 9e3, thickness=250.0, placement=(0.0, 0.0), density=850.0, latlon=False, **lattice)
    parameters = Parameters(
        ice={"density": 850.0}, earth={"latlon": False, "f_plane": True, "reference_latitude": 0.0},
        grounding={"sediment": "rock", "ice_modulus": modulus}, stepping={"time_step": 60.0},
        fracture={"normal_strength": 1e9, "shear_strength": 1e9, "flexural_strength": 1e9},
    )  # fmt: skip
    model = Model(berg, Floor(floor), parameters)
    model.step()
    stress, keel = model.bonds.flexural_stress, model.elements.keel
    return Bent(stress.max(), keel.floor_stress.max(), int((stress > 0.0).sum()), keel.floor_load.sum())


@pytest.mark.parametrize("modulus", [9e9, 1e9])
@pytest.mark.parametrize("name", FLOORS)
def test_bending_is_the_same_on_any_lattice(name: str, modulus: float) -> None:
    """Bugs: a ridge under all of the ice bent bonds like an edge or like a beam, by the lattice, with a factor of 3 between.

    Under a knoll in the middle of elements longer than the ice bends, no bond bore anything.
    """
    found = [bent(FLOORS[name], modulus, **lattice) for lattice in LATTICES]
    assert all(one.bonds > 0 for one in found)
    mean = np.mean([one.stress for one in found])
    for one in found:
        assert one.stress == pytest.approx(mean, rel=0.1)
        assert one.stress == pytest.approx(one.told, rel=1e-9)  # what the summary says the ice would bend by


@pytest.mark.parametrize("modulus", [9e9, 1e9])
def test_a_ridge_bends_the_ice_as_a_beam_on_water(modulus: float) -> None:
    """Moment P lambda / 4 under a load P by width, of an endless beam; 18 km are 1.8 lambda to each side, or 10."""
    one = bent(FLOORS["a ridge from side to side"], modulus, **LATTICES[0])
    lam = math.sqrt(2.0) * bending_length(modulus, 0.3, 250.0)
    assert one.stress == pytest.approx(6.0 * one.load / 9e3 * lam / 4.0 / 250.0**2, rel=0.17)
