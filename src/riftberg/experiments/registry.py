"""The built-in experiments by name: an experiment is imported when it is built, so that asking for the list costs nothing."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from riftberg.errors import InputError, nearest

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.experiments.options import Builder, Story


@dataclass(frozen=True)
class BuiltIn:
    """A built-in experiment."""

    name: str  # Name on the command line
    place: str  # ``module:function`` of its builder
    summary: str  # What it shows, in one line
    parts: tuple[str, ...] = ()  # Parts that ``--without`` can leave out
    lattice: bool = False  # Its berg may be filled with another lattice
    fetches: bool = False  # It runs from files that ``--fetch`` can get
    story: str = ""  # ``module:name`` of its `Story`, where it has one of its own

    def load(self) -> Builder:
        """Import the builder."""
        module, function = self.place.split(":")
        builder: Builder = getattr(importlib.import_module(f"riftberg.experiments.{module}"), function)
        return builder

    def load_story(self) -> Story | None:
        """Import what it tells of itself; None where that is its break-ups."""
        if not self.story:
            return None
        module, name = self.story.split(":")
        story: Story = getattr(importlib.import_module(f"riftberg.experiments.{module}"), name)
        return story


EXPERIMENTS: Final[tuple[BuiltIn, ...]] = (
    BuiltIn("a68a", "a68a:build", "A68a in December 2020 in an analytic ocean: drift, grounding, two break-ups",
          ("shoal", "shear"), lattice=True),
    BuiltIn("a68a-paper", "a68a_paper:build", "the published run of A68a, from its own files (riftberg fetch a68a, 1.3 GB)",
          ("shoal",), fetches=True),
    BuiltIn("a68a-oras5", "a68a_oras5:build", "A68a in the monthly mean currents of ORAS5", fetches=True),
    BuiltIn("a68a-melt", "a68a_melt:build", "A68a melts along its observed track for three months, in a sea made by formula",
          lattice=True),
    BuiltIn("supported-beam", "beams:build_supported", "a simply supported beam bends under a load",
          story="beams:SUPPORTED_STORY"),
    BuiltIn("cantilever", "beams:build_cantilever", "a clamped beam bends under a load at its end",
          story="beams:CANTILEVER_STORY"),
    BuiltIn("collision", "collision:build", "two small bergs collide", story="collision:STORY"),
    BuiltIn("grounding-fracture", "grounding_fracture:build", "a berg runs aground and breaks"),
)  # fmt: skip
"""Built-in experiments."""


def names() -> list[str]:
    """Return the names of the built-in experiments."""
    return [entry.name for entry in EXPERIMENTS]


def find(name: str) -> BuiltIn:
    """Return the entry of a name."""
    for entry in EXPERIMENTS:
        if entry.name == name:
            return entry
    raise InputError(
        f"no experiment of this name and no such file: {name!r}",
        remedy=f"{nearest(name, names())}Built in are {', '.join(names())}; or name a YAML file",
    )


def story_of(run: xr.Dataset) -> Story | None:
    """Return what the experiment that a run names tells of itself; None where the run is of no such experiment."""
    name = str(run.attrs.get("experiment", ""))
    entry = next((entry for entry in EXPERIMENTS if entry.name == name), None)
    story = None if entry is None else entry.load_story()
    return story if story is not None and story.fits(run) else None
