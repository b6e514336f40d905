"""What a person may change in an experiment, and what a built experiment says of itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.parameters import Parameters
    from riftberg.runs.model import Model

Numerics = Literal["own", "reference"]


@dataclass(frozen=True)
class Options:
    """What the person who starts a run asked for."""

    # Values by group and name, as `riftberg.parameters.Parameters.changed` takes them, and those of the berg; already checked
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    days: float | None = None  # Length of the run; None leaves it to the experiment
    data: Path | None = None  # Folder of data files
    without: frozenset[str] = frozenset()  # Parts of the experiment to leave out
    # Numerics of Riftberg, or those of the reference with its quirks; None leaves it to the experiment
    numerics: Numerics | None = None
    fetch: bool = False  # Fetch missing data files first
    # Cells (degrees) of a model grid that data files are put on; None leaves it to the experiment
    grid: float | None = None
    # Files or patterns in place of those of the experiment, as ``forcing.files`` takes them
    files: tuple[Any, ...] = ()

    @property
    def own(self) -> bool:
        """Riftberg's own numerics, unless the reference's were asked for: what most experiments do."""
        return self.numerics != "reference"

    @property
    def lattice(self) -> Mapping[str, Any]:
        """Changes of the lattice of the berg, as `riftberg.bergs.keys.LatticeKeys` has them."""
        return self.changes.get("berg", {})

    def apply(self, parameters: Parameters) -> Parameters:
        """Return parameters with the changes made."""
        from riftberg.experiments.changes import changed

        return changed(parameters, self.changes)


@dataclass(frozen=True)
class Story:
    """What a test case tells of itself in place of break-ups and maps, from its run file."""

    tell: Callable[[xr.Dataset], list[str]]  # Takes the run and returns lines for the command line
    facts: Callable[[xr.Dataset], dict[str, Any]]  # Takes the run and returns the figures for ``summary.json``
    draw: Callable[[xr.Dataset, Path, int], Path]  # Takes the run, a path and ``dpi``, and writes the picture
    fits: Callable[[xr.Dataset], bool]  # Takes the run and returns whether it is one of this case


@dataclass(frozen=True)
class Info:
    """What the command line needs to know about a built experiment."""

    name: str  # Short name, used for the output folder
    title: str = ""  # Heading of the map
    days: float = 1.0  # Length of the run that the experiment has by itself
    output_every_hours: float = 1.0  # Interval of the records, in hours of model time
    seed: int | None = None  # Seed of random numbers, if any are drawn
    # Observed outlines for the map: ISO date to rings of longitude and latitude
    observed: Mapping[str, Any] = field(default_factory=dict, repr=False)
    notices: tuple[str, ...] = ()  # What should be known before the run, in a line each
    output_forces: bool = False  # Whether the run file holds the mean force of each medium between records
    output_cells: float | None = None  # Width (degrees) of the cells of the gridded output; None for none
    made: str = ""  # What became of the shape that was asked for, in a line
    loses: bool = False  # A finer lattice would come closer to that shape
    story: Story | None = None  # What a test case tells and draws instead of break-ups and a map


Builder = Callable[[Options], "tuple[Model, Info]"]
"""A function that builds an experiment."""
