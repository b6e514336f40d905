"""Experiments by name, and what a run may change in them.

The registry holds names and places only; an experiment is imported when it is built, so that asking for the list costs
nothing. A builder is a function ``build(options: Options) -> tuple[Model, Info]``.
"""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from riftberg.errors import InputError

if TYPE_CHECKING:
    from riftberg.model import Model
    from riftberg.parameters import Parameters

Numerics = Literal["own", "reference"]


@dataclass(frozen=True)
class Options:
    """What the person who starts a run asked for.

    Attributes
    ----------
    changes : dict
        Values by group and parameter name, as `riftberg.parameters.Parameters.changed` takes them; already checked.
    days : float or None
        Length of the run; None leaves it to the experiment.
    data : pathlib.Path or None
        Folder of data files.
    without : frozenset of str
        Parts of the experiment to leave out.
    numerics : {"own", "reference"} or None
        Numerics of Riftberg, or those of the reference with its quirks; None leaves it to the experiment.
    fetch : bool
        Fetch missing data files first.
    grid : float or None
        Cells (degrees) of a model grid that data files are put on; None leaves it to the experiment.
    """

    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    days: float | None = None
    data: Path | None = None
    without: frozenset[str] = frozenset()
    numerics: Numerics | None = None
    fetch: bool = False
    grid: float | None = None

    @property
    def own(self) -> bool:
        """Riftberg's own numerics, unless the reference's were asked for: what most experiments do."""
        return self.numerics != "reference"

    def apply(self, parameters: Parameters) -> Parameters:
        """Return parameters with the changes made."""
        from riftberg.experiments.changes import changed

        return changed(parameters, self.changes)


@dataclass(frozen=True)
class Info:
    """What the command line needs to know about a built experiment.

    Attributes
    ----------
    name : str
        Short name, used for the output folder.
    title : str
        Heading of the map.
    days : float
        Length of the run that the experiment has by itself.
    output_every_hours : float
        Interval of the records, in hours of model time.
    seed : int or None
        Seed of random numbers, if any are drawn.
    observed : mapping
        Observed outlines for the map: ISO date to rings of longitude and latitude.
    notices : tuple of str
        What should be known before the run, in a line each.
    """

    name: str
    title: str = ""
    days: float = 1.0
    output_every_hours: float = 1.0
    seed: int | None = None
    observed: Mapping[str, Any] = field(default_factory=dict)
    notices: tuple[str, ...] = ()


Builder = Callable[[Options], "tuple[Model, Info]"]


@dataclass(frozen=True)
class Entry:
    """An experiment of the registry.

    Attributes
    ----------
    name : str
        Name on the command line.
    place : str
        ``module:function`` of its builder.
    summary : str
        What it shows, in one line.
    parts : tuple of str
        Parts that ``--without`` can leave out.
    fetches : bool
        It runs from files that ``--fetch`` can get.
    """

    name: str
    place: str
    summary: str
    parts: tuple[str, ...] = ()
    fetches: bool = False

    def load(self) -> Builder:
        """Import the builder."""
        module, function = self.place.split(":")
        builder: Builder = getattr(importlib.import_module(f"riftberg.experiments.{module}"), function)
        return builder


EXPERIMENTS: Final[tuple[Entry, ...]] = (
    Entry("a68a", "a68a:build", "A68a in December 2020 in an analytic ocean: drift, grounding, two break-ups",
          ("shoal", "shear")),
    Entry("a68a-paper", "a68a_paper:build", "the published run of A68a, from its own files (riftberg fetch a68a, 1.3 GB)",
          ("shoal",), fetches=True),
    Entry("a68a-oras5", "a68a_oras5:build", "A68a in the monthly mean currents of ORAS5", fetches=True),
    Entry("supported-beam", "beams:build_supported", "a simply supported beam bends under a load"),
    Entry("cantilever", "beams:build_cantilever", "a clamped beam bends under a load at its end"),
    Entry("collision", "collision:build", "two small bergs collide"),
    Entry("grounding-fracture", "grounding_fracture:build", "a berg runs aground and breaks"),
)  # fmt: skip
"""Built-in experiments."""


def names() -> list[str]:
    """Return the names of the built-in experiments."""
    return [entry.name for entry in EXPERIMENTS]


def nearest(name: str, choices: Iterable[str]) -> str:
    """Return a question that names the most similar choice, or nothing where none is similar."""
    found = difflib.get_close_matches(name, list(choices), n=1, cutoff=0.6)
    return f"Did you mean {found[0]!r}? " if found else ""


def find(name: str) -> Entry:
    """Return the entry of a name.

    Raises
    ------
    InputError
        If there is none; with the nearest name.
    """
    for entry in EXPERIMENTS:
        if entry.name == name:
            return entry
    raise InputError(
        f"no experiment of this name and no such file: {name!r}",
        remedy=f"{nearest(name, names())}Built in are {', '.join(names())}; or name a YAML file",
    )


def build(name: str, options: Options | None = None) -> tuple[Model, Info]:
    """Build an experiment by name or from a YAML file.

    Parameters
    ----------
    name : str
        Name of a built-in experiment, or path of a YAML file.
    options : Options, optional
        What to change.

    Returns
    -------
    model : Model
        At its start.
    info : Info
        Name, title, length and output interval.
    """
    options = options or Options()
    if name.endswith((".yaml", ".yml")):
        from riftberg.experiments.yaml_file import build_file

        if options.fetch:
            raise InputError("a YAML experiment names its own files", where="--fetch", remedy="Use riftberg fetch")
        return build_file(Path(name), options)
    entry = find(name)
    if options.grid is not None:
        raise InputError(f"{name} has its own ocean", where="--grid", remedy="It is for experiments of YAML files")
    unknown = sorted(options.without - set(entry.parts))
    if unknown:
        parts = ", ".join(entry.parts) or "nothing"
        raise InputError(
            f"cannot leave out {unknown[0]!r} of {name}",
            where="--without",
            remedy=f"{nearest(unknown[0], entry.parts)}{name} can go without {parts}",
        )
    if options.fetch and not entry.fetches:
        with_files = ", ".join(other.name for other in EXPERIMENTS if other.fetches)
        raise InputError(f"{name} needs no files", where="--fetch", remedy=f"Leave it out; {with_files} need files")
    return entry.load()(options)
