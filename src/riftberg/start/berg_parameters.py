"""Parameters that follow from the berg of a run: packing, and the constant size of bonded elements."""

from __future__ import annotations

import numpy as np

from riftberg.bergs.iceberg import Iceberg
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.errors import InputError
from riftberg.parameters import ExplicitParameters, Parameters
from riftberg.state import Bonds, Elements


def adopt_packing(p: Parameters, berg: Iceberg) -> Parameters:
    """Return the parameters with the packing of the berg: those of another would give its elements wrong radii."""
    if p.bonds.packing == "hexagonal" and berg.packing == "square" and berg.elements.size:
        raise InputError(
            "bonds.packing = 'hexagonal', but the berg has square elements", where="Model",
            remedy="Make the berg with packing='hexagonal', or leave bonds.packing out: it follows the berg",
        )  # fmt: skip
    return p.changed(bonds={"packing": berg.packing}) if berg.packing != p.bonds.packing else p


def fill_constant_size(p: Parameters, elements: Elements, bonds: Bonds) -> Parameters:
    """Fill in the constant interaction size: if one side is 0, both become the means of all elements (Q37).

    Several bergs have their own means (`riftberg.engines.common.stepper`), unless they are coupled as in the reference.
    """
    if not isinstance(p, ExplicitParameters):
        return p
    b = p.bonds
    if not b.constant_size or (b.constant_length > 0.0 and b.constant_width > 0.0):
        return p
    component = connected_parts(elements.size, bonds.first, bonds.second, bonds.status)
    if component.any() and not p.quirks.bergs_coupled:
        return p
    length, width = float(np.mean(elements.length)), float(np.mean(elements.width))
    return p.changed(bonds={"constant_length": length, "constant_width": width})
