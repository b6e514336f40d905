"""The built-in experiments by name: an experiment is imported when it is built, so that asking for the list costs nothing."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from riftberg.errors import InputError, nearest

if TYPE_CHECKING:
    from riftberg.experiments.options import Builder


@dataclass(frozen=True)
class BuiltIn:
    """A built-in experiment.

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


EXPERIMENTS: Final[tuple[BuiltIn, ...]] = (
    BuiltIn("a68a", "a68a:build", "A68a in December 2020 in an analytic ocean: drift, grounding, two break-ups",
          ("shoal", "shear")),
    BuiltIn("a68a-paper", "a68a_paper:build", "the published run of A68a, from its own files (riftberg fetch a68a, 1.3 GB)",
          ("shoal",), fetches=True),
    BuiltIn("a68a-oras5", "a68a_oras5:build", "A68a in the monthly mean currents of ORAS5", fetches=True),
    BuiltIn("a68a-melt", "a68a_melt:build", "A68a melts along its observed track for three months, in a sea made by formula"),
    BuiltIn("supported-beam", "beams:build_supported", "a simply supported beam bends under a load"),
    BuiltIn("cantilever", "beams:build_cantilever", "a clamped beam bends under a load at its end"),
    BuiltIn("collision", "collision:build", "two small bergs collide"),
    BuiltIn("grounding-fracture", "grounding_fracture:build", "a berg runs aground and breaks"),
)  # fmt: skip
"""Built-in experiments."""


def names() -> list[str]:
    """Return the names of the built-in experiments."""
    return [entry.name for entry in EXPERIMENTS]


def find(name: str) -> BuiltIn:
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
