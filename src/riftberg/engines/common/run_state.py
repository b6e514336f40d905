"""What a long step reads and changes: all that the schemes need to know of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any, NamedTuple, Self

import numpy as np

from riftberg.engines.common.fragments.contact_log import ContactLog
from riftberg.engines.common.fragments.grounding_log import GroundingLog
from riftberg.engines.common.fragments.tree import Fragment, FragmentTree
from riftberg.engines.common.laws import Laws
from riftberg.ocean.forcing import Forcing
from riftberg.parameters import KernelParameters, Parameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import Population, Saved


@dataclass(eq=False)
class RunState:
    """State, forcing and parameters of a run at one moment."""

    population: Population  # Elements and bonds
    forcing: Forcing
    parameters: Parameters
    constants: KernelParameters  # The parameters as compiled code reads them
    fragments: FragmentTree  # Family tree of the fragments
    start: datetime  # Date of time zero (UTC)
    time: float = 0.0  # Seconds since the start
    step_number: int = 0  # Long steps taken
    contacts: ContactLog = field(default_factory=ContactLog)  # Contacts between bergs
    outlines: tuple[
        Any, ...
    ] = ()  # Polygons (shapely) that the ice fills at the start, in the coordinates of positions
    laws: Laws = field(default_factory=Laws)  # Of the user
    groundings: GroundingLog = field(default_factory=GroundingLog)  # Bergs on the sea floor
    remembered: dict[str, Floats] = field(default_factory=dict)  # Saved with the state, so that recorders go on exactly

    @property
    def elements(self) -> Elements:
        """The elements now; take them anew after elements have come or gone."""
        return self.population.elements

    @property
    def bonds(self) -> Bonds:
        """The bonds now."""
        return self.population.bonds

    @property
    def date(self) -> datetime:
        """Date of the present state."""
        return self.start + timedelta(seconds=self.time)

    @property
    def substeps(self) -> int:
        """Sub-steps in a long step; of the berg that has most of them."""
        return max(1, int(self.elements.body.substeps.max(initial=1)))

    @property
    def bonds_broken(self) -> int:
        """Number of bonds that have broken so far."""
        return int(np.isfinite(self.bonds.break_time).sum())

    @property
    def fragment_count(self) -> int:
        """Number of fragments now."""
        return int(np.unique(self.elements.berg).size)

    def append(
        self, elements: Elements, bonds: Bonds | None = None, *, parent: int = 0, ids: Ints | None = None
    ) -> Ints:
        """Add elements, with bonds between them; for use between two steps, or by a process after a step.

        Parameters
        ----------
        elements : Elements
            The newly born, as `riftberg.state.new_elements` or an `Iceberg` gives them: position, velocity ``u`` and
            ``v``, mass and sizes are read.
        bonds : Bonds, optional
            Bonds between them; their ends are rows of ``elements``.
        parent : int, optional
            Number of the fragment that they come from.
        ids : array of int, optional
            Their identifiers, which must never have been used; the next free ones if left out.

        Returns
        -------
        array of int
            Their identifiers; identifiers are never used again.
        """
        rows = self.elements.size
        ids = self.population.append(elements, bonds, ids=ids)
        new = slice(rows, None)
        current = self.elements
        current.body.berg[new] = parent
        current.place.entered[new] = current.place.entered[:rows].max(initial=-1) + 1
        for copy, name in (("lon_pair", "lon"), ("lat_pair", "lat"), ("u_pair", "u"), ("v_pair", "v")):
            getattr(current, copy)[new] = getattr(current, name)[new]
        current.motion.u_sync[new], current.motion.v_sync[new] = current.motion.u[new], current.motion.v[new]
        return ids

    def remove(self, ids: Sequence[int] | Ints) -> None:
        """Take elements out, with their bonds; for use between two steps, or by a process after a step."""
        self.population.remove(ids)


class Checkpoint(NamedTuple):
    """A run as it stood before a step."""

    time: float
    step_number: int
    fragments: list[Fragment]
    population: Saved
    remembered: dict[str, Floats]
    contacts: ContactLog
    groundings: GroundingLog

    @classmethod
    def of(cls, run: RunState, population: Saved) -> Self:
        """Return the present state of a run, whose population has been saved."""
        return cls(
            run.time, run.step_number, list(run.fragments.rows), population, dict(run.remembered), run.contacts.saved(),
            run.groundings.saved(),
        )  # fmt: skip

    def restore(self, run: RunState) -> None:
        """Return to this state."""
        run.remembered, run.contacts, run.groundings = self.remembered, self.contacts, self.groundings
        run.time, run.step_number, run.fragments.rows = self.time, self.step_number, self.fragments
        run.fragments.calved_from.clear()
        run.population.restore(self.population)
