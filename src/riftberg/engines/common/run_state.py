"""What a long step reads and changes: all that the schemes need to know of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

from riftberg.engines.common.fragments.contact_log import ContactLog
from riftberg.engines.common.fragments.grounding_log import GroundingLog
from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.engines.common.laws import Laws
from riftberg.ocean.forcing import Forcing
from riftberg.parameters import KernelParameters, Parameters
from riftberg.state import Bonds, Elements
from riftberg.state.population import Population


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
