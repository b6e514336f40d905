"""Parameters that only one law reads: what is said where they are set and another law acts.

A user who sets the friction of crushing faces while springs act gets a run without it; that is told before the run. One table
for all; that what is said to have no effect has none is a test.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple


class Law(NamedTuple):
    """When parameters are read: in words, and of a set of parameters; and their names."""

    needs: str
    acts: Callable[[Any], bool]
    group: str
    names: tuple[str, ...]


LAWS: Final = (
    Law("grounding.law = 'seabed'", lambda p: p.grounding.law == "seabed", "grounding", (
        "sediment", "stiffness", "bearing_strength", "friction", "shear_strength", "adhesion", "anchor_way", "bending",
        "ice_modulus", "cell", "start")),
    Law("grounding.law = 'quadratic'", lambda p: p.grounding.law == "quadratic", "grounding", ("quadratic_coefficient",)),
    Law("grounding.law = 'linear'", lambda p: p.grounding.law == "linear", "grounding", ("coefficient",)),
    Law("contact.law = 'crushing'", lambda p: p.crushing, "contact", (
        "crushing_strength", "crushing_depth", "unloading_ratio", "friction")),
    Law("bonds.law = 'dem'", lambda p: p.bonds.law == "dem", "bonds", ("poisson", "damping")),
    Law("fracture.criterion = 'averaged'", lambda p: p.fracture.criterion == "averaged", "fracture", ("distance",)),
    Law("fracture.criterion = 'toughness'", lambda p: p.fracture.criterion == "toughness", "fracture", ("toughness",)),
    Law("damage.enabled", lambda p: p.damage.enabled, "damage", ("threshold", "time_scale", "exponent")),
    Law("rolling.enabled", lambda p: p.rolling.enabled, "rolling", ("scheme", "tip")),
    Law("footloose.enabled", lambda p: p.footloose.enabled, "footloose", (
        "youngs", "strength", "style", "displace", "berg_mass", "seed")),
    Law("melt.enabled", lambda p: p.melt.enabled or p.footloose.enabled or p.rolling.enabled, "melt", (
        "mode", "base", "split", "bits_fraction", "const_gamma", "gamma_t", "friction_drag", "least_friction", "tide",
        "least_gap")),
)  # fmt: skip
"""Parameters that other laws leave unread."""


def without_effect(parameters: Any) -> dict[str, str]:
    """Return what is set otherwise than by default although nothing reads it, a sentence for each name.

    Runs with the numerics of the reference are left out: a namelist gives values for laws that it switches off.
    """
    default = type(parameters)()
    if parameters.compatibility != default.compatibility:
        return {}
    said = {}
    for law in LAWS:
        if not law.acts(parameters):
            group, usual = getattr(parameters, law.group), getattr(default, law.group)
            for name in law.names:
                value = getattr(group, name)
                if value != getattr(usual, name):
                    shown = f"{value:g}" if isinstance(value, float) else str(value).lower()
                    said[f"{law.group}.{name}"] = f"{law.group}.{name} = {shown} has no effect: it needs {law.needs}"
    return said
