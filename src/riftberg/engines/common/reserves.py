"""What floating ice bears by itself, and what the strength of a run means beside it: said of every berg."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from riftberg.config.quasi_static_groups import IceFracture
from riftberg.parameters import KernelParameters, Parameters
from riftberg.physics.crevasses import implied_crevasse_strength, prestress, reserve, reserves
from riftberg.state import Floats, Ints

CAVEAT: Final = (
    "Strengths at the tips of crevasses are good to a factor of 2; firn takes 15 to 35 % off the pre-stress and adds 15 to "
    "40 % to the reserve, and a crevasse filled with water from the surface has none."
)
"""How far `Reserve` can be trusted."""


class Reserve(NamedTuple):
    """Pre-stress of a berg, and its strength as a reserve of crevassed ice; Pa."""

    prestress: float  # Mean by area
    largest_prestress: float
    reserve: float | None  # Tension that it bears beside the mean pre-stress; None where it has no strength of the ice
    crevasse_strength: float | None  # At the tips of crevasses: as given, or what a normal strength means

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain numbers, as a summary holds it."""
        return self._asdict()

    def words(self) -> str:
        """Return it in a sentence or two."""
        largest = self.largest_prestress > 1.01 * self.prestress
        more = f" on average, {self.largest_prestress / 1e3:.0f} where it is thickest" if largest else ""
        stress = f"The pre-stress of the ice is {self.prestress / 1e3:.0f} kPa{more}"
        if self.reserve is None or self.crevasse_strength is None:
            return f"{stress}."
        return (
            f"{stress}; a strength of {self.reserve / 1e3:.3g} kPa is that of crevassed ice with "
            f"{self.crevasse_strength / 1e3:.0f} kPa at the tips of its crevasses."
        )


def berg_reserve(thickness: Floats, area: Floats, parameters: Parameters) -> Reserve:
    """Return the reserve of a berg from thickness (m) and area (m2) of its elements.

    Explicit schemes have strengths of bonds, which mean nothing for the ice.
    """
    fracture, density = parameters.fracture, parameters.ice.density
    mean = prestress(float(np.average(thickness, weights=area)), density)
    bears, tip = fracture.normal_strength, None
    if isinstance(fracture, IceFracture) and fracture.enabled:
        tip = fracture.crevasse_strength
        if tip is not None:
            bears = reserve(tip, mean)
        elif bears is not None and bears > 0.0:
            tip = implied_crevasse_strength(bears, mean)
    bears = None if tip is None else bears
    return Reserve(mean, prestress(float(thickness.max()), density), bears, tip)


MOST_TOLD: Final = 6
"""Bergs that are told one by one; more of them as one."""


def reserve_lines(
    berg: Ints, thickness: Floats, area: Floats, names: Mapping[int, str], parameters: Parameters
) -> list[str]:
    """Return pre-stress and reserve of bergs in sentences, and how far to trust them.

    ``berg``: number of the berg of each element; ``names``: of bergs by their number.
    """
    if not thickness.size:
        return []
    numbers = np.unique(berg)
    if numbers.size == 1 or numbers.size > MOST_TOLD:
        return [berg_reserve(thickness, area, parameters).words(), CAVEAT]
    sentences = [
        f"{names.get(number) or f'berg {number}'}: "
        + berg_reserve(thickness[berg == number], area[berg == number], parameters).words()
        for number in numbers.tolist()
    ]
    return [*sentences, CAVEAT]


def bond_strengths(thickness: Floats, first: Ints, second: Ints, p: KernelParameters) -> Floats:
    """Tensile strength (Pa) of the ice of bonds: where they are, without the factors of their rifts, scatter and damage.

    Every use of a strength goes through here, in a run and after it. ``thickness``: of the elements, m, shape (..., elements);
    returns shape (..., bonds).
    """
    if not p.crevasse_strength > 0.0:
        return np.full((*thickness.shape[:-1], first.size), p.normal_strength)
    mean = 0.5 * (thickness[..., first] + thickness[..., second])
    return reserves(mean.ravel(), p.rho_ice, p.crevasse_strength).reshape(mean.shape)
