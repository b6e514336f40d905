"""Elements that can be stepped and bonds that can break: what is refused at the start of a run and after each change."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from riftberg.config.units import place_text
from riftberg.errors import InputError
from riftberg.parameters import Parameters
from riftberg.state import Bonds, Elements
from riftberg.state.rules import Rule, find_breach, is_positive

STATE_RULES: Final = (
    *(Rule(name, np.isfinite, "a finite number") for name in ("lon", "lat", "u", "v", "spin", "rotation")),
    *(Rule(name, is_positive, "a finite number above zero") for name in ("mass", "thickness", "length", "width")),
)
"""Rules for elements that can be stepped."""

BOND_RULES: Final = (
    Rule("strength", lambda values: np.isfinite(values) & (values >= 0.0), "a finite factor, 0 or more"),
    Rule("damage", lambda values: (values >= 0.0) & (values < 1.0), "from 0 up to, not including, 1"),
)
"""Rules for bonds that can break."""


def check_state(elements: Elements, bonds: Bonds, latlon: bool) -> None:
    """Refuse elements that cannot be stepped, before the first step."""
    if breach := find_breach(STATE_RULES, partial(getattr, elements)):
        e = breach.row
        position = place_text(float(elements.lon[e]), float(elements.lat[e]), latlon=latlon, digits=5)
        raise InputError(
            f"{breach.rule.variable} is {breach.value:g}", where=f"element {int(elements.id[e])} (row {e}) at {position}",
            remedy=f"It must be {breach.rule.allowed}",
        )  # fmt: skip
    count = elements.mass.size
    ends = np.concatenate([bonds.first, bonds.second])
    if ends.size and (ends.min() < 0 or ends.max() >= count):
        raise InputError(f"a bond names element row {int(ends.max())} of {count}", where="bonds")


def check_strengths(bonds: Bonds, p: Parameters) -> None:
    """Refuse strengths that are no strengths; runs with the reference's quirks take the strengths of the parameters unchecked."""
    checked, f = not p.quirks.zero_start, p.fracture
    for name, value in (("normal_strength", f.normal_strength), ("shear_strength", f.shear_strength)):
        if f.enabled and checked and value is not None and value <= 0.0:
            raise InputError(
                f"fracture.{name} = {value:g} Pa is no strength",
                where="parameters",
                remedy="Give a positive one, or set fracture.enabled = false so that no bond breaks",
            )
    if breach := find_breach(BOND_RULES, partial(getattr, bonds)):
        b = breach.row
        raise InputError(
            f"{breach.rule.variable} is {breach.value:g}",
            where=f"bond in row {b}, between the elements in rows {bonds.first[b]} and {bonds.second[b]}",
            remedy=f"It must be {breach.rule.allowed}",
        )
