"""The bed of sediment that the parameters describe, and how ice bends on it."""

from __future__ import annotations

from typing import Final, NamedTuple

from riftberg.config.quasi_static_groups import Seabed
from riftberg.physics.seabed import POISSON, friction_depth

SEDIMENTS: Final[dict[str, dict[str, float]]] = {
    "rock": {"stiffness": 1e9, "bearing_strength": 1e7, "friction": 0.5},
    "sand": {"stiffness": 1e7, "bearing_strength": 1e6, "friction": 0.5},
    "clay": {"stiffness": 1e6, "friction": 0.5, "shear_strength": 2e4},
    "other": {},
}
"""Beds by name; on clay the bearing strength follows from the shear strength."""

BEARING_FACTOR: Final = 6.0
"""Bearing strength of clay over its shear strength (a long strip 5.14)."""


class Bed(NamedTuple):
    """The floor, and how the ice bends on it."""

    stiffness: float  # k_v, Pa m-1
    strength: float  # q_u, Pa
    friction: float  # mu
    shear_strength: float  # alpha s_u, Pa; 0 for none
    grip: float  # Overlap up to which friction grows with pressure, m
    anchor_way: float  # m
    modulus: float  # Young's modulus of the ice, Pa; 0 for ice that does not bend
    poisson: float


def make_bed(g: Seabed) -> Bed:
    """Return the bed that the parameters describe."""
    values = {**SEDIMENTS[g.sediment]}
    for name in ("stiffness", "bearing_strength", "friction", "shear_strength"):
        if (value := getattr(g, name)) is not None:
            values[name] = value
    shear = values.get("shear_strength", 0.0)
    stiffness, strength = values["stiffness"], values.get("bearing_strength", BEARING_FACTOR * shear)
    grip = friction_depth(stiffness, strength, values["friction"], g.adhesion * shear)
    modulus = g.ice_modulus if g.bending else 0.0
    return Bed(stiffness, strength, values["friction"], g.adhesion * shear, grip, g.anchor_way, modulus, POISSON)
