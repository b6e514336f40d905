"""What a long step reads and changes: all that the schemes need to know of a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timedelta

from riftberg.ocean.forcing import Forcing
from riftberg.parameters import KernelParameters, Parameters
from riftberg.state import Bonds, Elements
from riftberg.state.population import Population
from riftberg.stepping.contacts import ContactLog
from riftberg.stepping.fragments import FragmentTree


@dataclass(eq=False)
class RunState:
    """State, forcing and parameters of a run at one moment.

    Attributes
    ----------
    population : Population
        Elements and bonds.
    forcing : Forcing
    parameters : Parameters
    constants : KernelParameters
        The parameters as compiled code reads them.
    fragments : FragmentTree
        Family tree of the fragments.
    contacts : ContactLog
        Meetings of bergs.
    start : datetime.datetime
        Date of time zero (UTC).
    time : float
        Seconds since the start.
    step_number : int
        Long steps taken.
    """

    population: Population
    forcing: Forcing
    parameters: Parameters
    constants: KernelParameters
    fragments: FragmentTree
    start: datetime
    time: float = 0.0
    step_number: int = 0
    contacts: ContactLog = field(default_factory=ContactLog)

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
