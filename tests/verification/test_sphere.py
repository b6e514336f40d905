"""A berg that turns on the sphere stays free of stress (velocities are compared in common axes)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from riftberg import A68A_2022, A68A_2022_MTS, Forcing, Iceberg, Model

RADIUS = A68A_2022.earth.radius
TURN = -math.radians(12.0) / 86400.0


def turning(packing: str, flat: bool) -> Model:
    """Return a berg of 120 x 30 km at 56 S in rigid rotation at 12 degrees a day, without any forces."""
    berg = Iceberg.rectangle(120e3, 30e3, thickness=200.0, placement=(-37.0, -56.0), packing=packing)
    e = berg.elements
    lat0, lon0 = float(e.lat.mean()), float(e.lon.mean())
    x = RADIUS * np.cos(np.radians(0.5 * (e.lat + lat0))) * np.radians(e.lon - lon0)
    y = RADIUS * np.radians(e.lat - lat0)
    angle = math.tan(math.radians(lat0)) / RADIUS * x  # by which the meridians converge
    u, v = -TURN * y, TURN * x
    for name in ("u", "u_pair", "u_sync"):
        getattr(e, name)[:] = u * np.cos(angle) + v * np.sin(angle)
    for name in ("v", "v_pair", "v_sync"):
        getattr(e, name)[:] = v * np.cos(angle) - u * np.sin(angle)
    e.spin[:] = TURN
    stepping = {"only_interactions": True, "substeps": None}
    changes = {"stepping": stepping, "fracture": {"enabled": False}}
    return Model(
        berg, Forcing.uniform(), A68A_2022_MTS.changed(**changes, compatibility={"flat_relative_velocity": flat})
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize(("packing", "spurious"), [("square", 300.0), ("hexagonal", 1000.0)])
def test_a_turning_berg_does_not_load_itself(packing: str, spurious: float) -> None:
    """With velocities compared across different meridians a hexagonal berg gained 2.8 kPa a day by turning."""
    stress = {}
    for flat in (True, False):
        model = turning(packing, flat)
        for _ in range(48):
            model.step()
        stress[flat] = float(model.bonds.normal_stress.max())
    assert stress[False] < 30.0  # Pa, of a strength of 18,000
    assert stress[True] > spurious
