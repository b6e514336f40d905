"""The built-in experiments by name, the options of one, and the description of a built one.

An experiment is imported when it is built, so that asking for the list costs nothing.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from riftberg.errors import InputError, nearest

if TYPE_CHECKING:
    from riftberg.ocean.forcing import Forcing
    from riftberg.parameters import Parameters
    from riftberg.runs.model import Model


Numerics = Literal["own", "reference"]


@dataclass(frozen=True)
class Options:
    """Options of the person who starts a run.

    Parameters
    ----------
    changes : mapping
        Values by group and name, as `riftberg.Parameters.changed` takes them, and of the berg; already checked.
    days : float, optional
        Length of the run; else that of the experiment.
    data : Path, optional
        Folder of data files.
    without : frozenset of str
        Parts of the experiment to leave out.
    numerics : {"own", "reference"}, optional
        Numerics of Riftberg, or of the reference with its quirks; else those of the experiment.
    fetch : bool
        Fetch missing data files first.
    grid : float, optional
        Cells (degrees) of a model grid that data files are put on; else those of the experiment.
    files : tuple
        Files or patterns in place of the ones in the experiment, as ``forcing.files`` takes them.
    ocean : callable, optional
        Makes the forcing of an ocean model out of the one in an experiment file, whose sea floor stays.
    """

    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    days: float | None = None
    data: Path | None = None
    without: frozenset[str] = frozenset()
    numerics: Numerics | None = None
    fetch: bool = False
    grid: float | None = None
    files: tuple[Any, ...] = ()
    ocean: Callable[[Forcing, Parameters], Forcing] | None = field(default=None, compare=False)
    notices: list[str] = field(default_factory=list, compare=False)  # Keys that `apply` left out

    @property
    def own(self) -> bool:
        """Riftberg's own numerics, unless the reference's were asked for, as most experiments have it."""
        return self.numerics != "reference"

    @property
    def lattice(self) -> Mapping[str, Any]:
        """Changes of the lattice of the berg, as `riftberg.bergs.keys.LatticeKeys` has them."""
        from riftberg.bergs.keys import LatticeKeys

        return {key: value for key, value in self.changes.get("berg", {}).items() if key in LatticeKeys.model_fields}

    def apply(self, parameters: Parameters) -> Parameters:
        """Return parameters with the changes made."""
        from riftberg.experiments.changes import changed

        self.notices.clear()
        return changed(parameters, self.changes, notices=self.notices)


@dataclass(frozen=True)
class Info:
    """Facts about a built experiment that the command line needs."""

    name: str  # Short name, used for the output folder
    title: str = ""  # Heading of the map
    days: float = 1.0  # Length of the run that the experiment has by itself
    output_every_hours: float = 1.0  # Interval of the records, in hours of model time
    seed: int | None = None  # Seed of random numbers, if any are drawn
    # Observed outlines for the map: ISO date to rings of longitude and latitude
    observed: Mapping[str, Any] = field(default_factory=dict, repr=False)
    notices: tuple[str, ...] = ()  # Notices before the run, a line each
    output_forces: bool = False  # Whether the run file holds the mean force of each medium between records
    output_cells: float | None = None  # Width (degrees) of the cells of the gridded output; None for none
    made: str = ""  # How the lattice fits the requested shape, in a line
    loses: bool = False  # A finer lattice would come closer to that shape


Builder = Callable[[Options], "tuple[Model, Info]"]
"""A function that builds an experiment."""


@dataclass(frozen=True)
class BuiltIn:
    """A built-in experiment."""

    name: str  # Name on the command line
    place: str  # ``module:function`` of its builder
    summary: str  # Its subject, in one line
    parts: tuple[str, ...] = ()  # Parts that ``--without`` can leave out
    lattice: bool = False  # Its berg may be filled with another lattice
    fetches: bool = False  # It runs from files that ``--fetch`` can get

    def load(self) -> Builder:
        """Import the builder."""
        module, function = self.place.split(":")
        builder: Builder = getattr(importlib.import_module(f"riftberg.experiments.{module}"), function)
        return builder

    def check_parts(self, without: Iterable[str]) -> None:
        """Refuse to leave out a part that it does not have."""
        unknown = sorted(set(without) - set(self.parts))
        if unknown:
            raise InputError(
                f"cannot leave out {unknown[0]!r} of {self.name}", where="--without",
                remedy=f"{nearest(unknown[0], self.parts)}{self.name} can go without {', '.join(self.parts) or 'nothing'}",
            )  # fmt: skip


EXPERIMENTS: Final[tuple[BuiltIn, ...]] = (
    BuiltIn("a68a", "a68a:build_a68a", "A68a in December 2020 in an analytic ocean: drift, grounding, two break-ups",
          ("shoal", "shear"), lattice=True),
    BuiltIn("a68a-paper", "a68a_files:build_paper", "the published run of A68a, from its own files (riftberg fetch a68a, 1.3 GB)",
          ("shoal",), fetches=True),
    BuiltIn("a68a-oras5", "a68a_files:build_oras5", "A68a in the monthly mean currents of ORAS5", fetches=True),
    BuiltIn("a68a-melt", "a68a:build_melt", "A68a melts along its observed track for three months, in a sea made by formula",
          lattice=True),
)  # fmt: skip
"""Built-in experiments."""


def names() -> list[str]:
    """Return the names of the built-in experiments."""
    return [entry.name for entry in EXPERIMENTS]


IN_THE_GALLERY: Final = ("supported-beam", "cantilever", "collision", "grounding-fracture")
"""Experiments of earlier versions that are Python files of the gallery now."""


def find(name: str) -> BuiltIn:
    """Return the entry of a name."""
    if name in IN_THE_GALLERY:
        raise InputError(
            f"{name} is no built-in experiment any more", remedy="It is a Python file of the gallery in the docs"
        )
    for entry in EXPERIMENTS:
        if entry.name == name:
            return entry
    raise InputError(
        f"no experiment of this name and no such file: {name!r}",
        remedy=f"{nearest(name, names())}Built in are {', '.join(names())}; or name a YAML file",
    )
