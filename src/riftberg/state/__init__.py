"""The state: elements and bonds as structs of arrays, from one registry of variables."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from riftberg.state.variables import (
    BOND_VARIABLES,
    ELEMENT_VARIABLES,
    GROUPS,
    Body,
    Bonds,
    Elements,
    Environment,
    Floats,
    Ints,
    Keel,
    Kicks,
    Life,
    Motion,
    Place,
    Shown,
    Variable,
    build_elements,
    copied,
    zeros,
)

__all__ = [
    "BOND_VARIABLES",
    "ELEMENT_VARIABLES",
    "GROUPS",
    "Body",
    "Bonds",
    "Elements",
    "Environment",
    "Floats",
    "Ints",
    "Keel",
    "Kicks",
    "Life",
    "Motion",
    "Place",
    "Shown",
    "Variable",
    "build_elements",
    "copy_state",
    "new_bonds",
    "new_elements",
    "zeros",
]


def _arrays(variables: Iterable[Variable], size: int) -> dict[str, NDArray[Any]]:
    # Zeros that are never written take no memory; `np.full` writes them.
    return {v.name: np.full(size, v.default, v.dtype) if v.default else zeros(size, v.dtype) for v in variables}


def new_elements(size: int) -> Elements:
    """Return ``size`` elements at rest with default values and identifiers 1, 2, ..."""
    elements = build_elements(_arrays(ELEMENT_VARIABLES, size))
    elements.body.id[:] = np.arange(1, size + 1)
    return elements


def new_bonds(first: Ints, second: Ints) -> Bonds:
    """Return unbroken, unstressed bonds between the elements in rows ``first`` and ``second``."""
    bonds = Bonds(**_arrays(BOND_VARIABLES, len(first)))
    bonds.first[:] = first
    bonds.second[:] = second
    bonds.id[:] = np.arange(1, len(first) + 1)
    return bonds


def copy_state(elements: Elements, bonds: Bonds) -> tuple[Elements, Bonds]:
    """Return copies that share no memory with the originals; what is 0 takes none until it is written."""
    return build_elements({name: copied(array) for name, array in elements.arrays().items()}), Bonds._make(
        map(copied, bonds)
    )
