"""Names, numbers and files that a user relies on, written out: what files, summaries and messages hold must not change unseen."""

from __future__ import annotations

FORCES = ("water", "slope", "air", "sea_ice", "waves", "sea_floor", "own", "coriolis")
"""Forces on an element, as run files and budgets name them."""

FORCES_IN_TABLES = (
    "ocean drag", "surface slope", "Coriolis", "wind drag", "waves", "sea floor", "sea ice", "own force",
)  # fmt: skip
"""The same in tables and pictures, in their order."""

SEA_FLOOR, CORIOLIS = FORCES.index("sea_floor"), FORCES.index("coriolis")

MASS_CLOSES, HEAT_CLOSES = 1e-12, 1e-10
"""Largest errors of the ledgers of ice and of its heat, as parts of what they turn over."""

FRAGMENT = (
    "number", "parent", "birth_time", "lon", "lat", "elements", "area", "mass", "bonds_broken", "grounded",
)  # fmt: skip
"""What an ensemble keeps of each fragment."""
