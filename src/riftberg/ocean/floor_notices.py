"""Notices on keels and the sea floor before a run on a bed of sediment."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from riftberg.ocean.forcing import Forcing
from riftberg.parameters import Parameters
from riftberg.physics.floating import draft_of
from riftberg.physics.seabed import POISSON, SIDES_PER_LAMBDA, UNBENT_MODULUS, bending_length
from riftberg.state import Elements, Floats

DEEP: Final = 20.0
"""How far (m) below the floor a keel must start for thickness or depth to be in doubt."""

LARGE_SHARE: Final = 0.1
"""Share of the area of a berg from which on that is told: bergs do stand so deep on a knoll."""

PADS_ACROSS: Final = 2.0
"""Sides of pads that the standard deviation of a bell must have for its top not to lie between them."""


def floor_notices(forcing: Forcing, elements: Elements, parameters: Parameters, *, placed: bool) -> Iterator[str]:
    """Say which keels start far below the sea floor or move although they stand on it, and which seamounts are too narrow.

    ``placed``: whether the bergs are where they start.
    """
    if parameters.grounding.law != "seabed" or elements.size == 0:
        return
    from riftberg.ocean.formulas import Seamount  # runs on another bed do without formulas

    if placed:
        below: Floats = draft_of(elements.thickness, parameters.ice.density) - np.asarray(
            forcing.depth(elements.lon, elements.lat), float
        )
        yield from _deep_keel(below, elements)
        yield from _moving_keel(below, elements)
    modulus = parameters.grounding.ice_modulus if parameters.grounding.bending else UNBENT_MODULUS
    side = math.sqrt(2.0) * bending_length(modulus, POISSON, float(elements.thickness.min())) / SIDES_PER_LAMBDA
    for component in forcing.components():
        if isinstance(component, Seamount) and component.width < PADS_ACROSS * side:
            yield (
                f"a seamount with a width of {component.width:g} m is narrower than two of the pads of {side:.0f} m "
                f"in which a keel looks for the floor, and may pass over its top: "
                f"give it a width of {PADS_ACROSS * side:.0f} m or more"
            )


def _deep_keel(below: Floats, elements: Elements) -> Iterator[str]:
    """Say of the berg with the largest share of its area far below the floor that it starts there.

    ``below``: how deep keels stand below the floor, m.
    """
    numbers, of = np.unique(elements.berg, return_inverse=True)
    area = elements.length * elements.width
    share = np.bincount(of, area * (below > DEEP)) / np.bincount(of, area)
    worst = int(share.argmax())
    if share[worst] > LARGE_SHARE:
        yield (
            f"the keel of berg {numbers[worst]} starts up to {np.nanmax(below[of == worst]):.0f} m below the sea floor, "
            f"more than {DEEP:.0f} m under {100.0 * share[worst]:.0f} % of it: compare its thickness with the depth"
        )


def _moving_keel(below: Floats, elements: Elements) -> Iterator[str]:
    """Say of the fastest berg that is given a velocity and stands on the floor that this holds it."""
    speed = np.where(np.isin(elements.berg, elements.berg[below > 0.0]), np.hypot(elements.u, elements.v), 0.0)
    fastest = int(speed.argmax())
    if speed[fastest] > 0.0:
        yield (
            f"berg {elements.berg[fastest]} is given a velocity of {speed[fastest]:.2g} m/s and stands up to "
            f"{np.nanmax(below[elements.berg == elements.berg[fastest]]):.2g} m deep in the sea floor, which holds it: "
            "compare its thickness with the depth, or leave the velocity out"
        )
