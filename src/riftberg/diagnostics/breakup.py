"""What is known of a break-up: loads, budgets, bonds and reasons, as plain records."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from riftberg.system.atomic_files import write_text


@dataclass(frozen=True)
class Load:
    """Load across the cut at one record."""

    time: str
    cut_km: float  # Length of the cut (km), and thickness of the ice there (m)
    thickness: float  # Length of the cut (km), and thickness of the ice there (m)
    bonds: int  # Bonds of the cut that still hold
    tension: dict[str, float]  # By force: pull across the cut and push along it, N
    shear: dict[str, float]  # By force: pull across the cut and push along it, N
    couple: dict[str, float]  # By force, about the centre of the cut, counter-clockwise on the fragment, N m
    stress: dict[str, float]  # By force: share of the nominal stress at the outer fibre that is pulled most, Pa
    tension_recorded: float | None  # The same from the recorded acceleration of the fragment
    couple_recorded: float | None  # The same from the recorded acceleration of the fragment
    aground: int  # Elements of fragment and rest that are aground

    @property
    def nominal(self) -> float:
        """Nominal stress, Pa."""
        return sum(self.stress.values())


@dataclass(frozen=True)
class Budget:
    """Forces on one body at one record, N, east and north."""

    mass: float  # kg
    forces: dict[str, list[float]]  # By name
    inertia: list[float] | None  # Mass times recorded acceleration
    # Inertia minus forces: what the rest of the berg and other bergs do to it, and errors of differences
    residual: list[float] | None


@dataclass(frozen=True)
class FirstBond:
    """History of a bond of the cut, from `HOURS_BEFORE` to its breaking."""

    bond: int  # Row in the run file
    time: str  # When it broke
    lon: float  # Where, at the record before
    lat: float  # Where, at the record before
    grounded: bool  # An end was aground when it broke
    strength: float  # Pa
    hours: list[float]  # Times of the history, h before its breaking (negative)
    tension: list[float]  # Pa, at these times
    shear: list[float]  # Pa, at these times
    # Largest tension in any sub-step since the record before, Pa; empty for files that do not hold it
    peak: list[float]


@dataclass(frozen=True)
class Collision:
    """Contact with another berg while the first bond failed."""

    berg: str  # Name of the other
    time: str  # When they first touched
    speed: float  # Relative speed before they touched, m s-1


@dataclass
class Breakup:
    """One break-up and its reasons; see the attributes of the parts.

    ``closure`` is the residual of the whole parent over the sum of the sizes of the forces on it, at the last record at
    which it was afloat: how well the recomputed forces explain the recorded acceleration. ``highest`` is the largest
    tensile stress (Pa) of any bond of the parent at the last record before the first bond failed; ``sudden`` that it was
    below `SUDDEN` of the strength; ``peak`` the largest in the sub-steps up to that record, None for files without it.
    ``hours_since_start`` tells when the first bond failed; ``floor_recorded`` that the force of the sea floor is the one
    that was applied, not the one that balances. ``name`` and ``parent_name`` are what both are called; ``collision`` tells of
    a berg that touched the parent while the first bond failed; ``scheme`` is that of the run.
    """

    fragment: int
    parent: int
    time: str
    lon: float
    lat: float
    area_km2: float
    elements: int
    grounded: bool
    bonds: int
    first_break: str
    decisive: Load
    budgets: dict[str, Budget]
    closure: float | None
    first_bonds: list[FirstBond]
    highest: float
    sudden: bool
    hours_since_start: float
    peak: float | None
    history: list[Load]
    floor_recorded: bool = False
    name: str = ""
    parent_name: str = ""
    collision: Collision | None = None
    latlon: bool = True
    scheme: str = "mts"
    members: list[int] = field(default_factory=list)
    controls: dict[str, str] = field(default_factory=dict)

    @property
    def on_impact(self) -> bool:
        """Whether the first bond failed as the berg met the sea floor, of which the record before tells nothing."""
        return self.sudden and self.first_bonds[0].grounded and not self.decisive.aground

    @property
    def causes(self) -> list[tuple[str, float]]:
        """Forces with their shares of the nominal stress, largest first."""
        return sorted(self.decisive.stress.items(), key=lambda item: -item[1])


@dataclass
class Reasons:
    """All break-ups of a run that are large enough to be shown, and what it lost by melting, in words."""

    experiment: str
    forcing: str
    breakups: list[Breakup]
    small: int
    strength: float | None
    melt: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, texts, lists and dicts."""
        return asdict(self)

    def write(self, path: str | Path) -> Path:
        """Write as JSON."""
        path = Path(path)
        write_text(path, json.dumps(self.as_dict(), indent=1, allow_nan=False) + "\n")
        return path
