"""The forces that were applied to the elements, in the run file: mean of each medium since the record before."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from riftberg.state import Floats, Variable
from riftberg.state.numbering import by_identifier
from riftberg.stepping.forces.media import FORCES

if TYPE_CHECKING:
    from riftberg.model import BareModel


def force_variables() -> list[Variable]:
    """Return the variables of a run file with forces: east and north for every row of the table of media."""
    return [
        Variable(f"force_{name}_{axis}", "N", f"mean {word} force of {name.replace('_', ' ')} since the record before")
        for name in FORCES
        for axis, word in (("x", "eastward"), ("y", "northward"))
    ]


class AppliedForces:
    """Means of the applied forces between records.

    A long step of the multiple-time-step scheme applies its slow forces about its start and the sea floor in its sub-steps;
    both count for the step in which they change the velocities.
    """

    def __init__(self, model: BareModel) -> None:
        self._ids = model.elements.body.id.copy()
        self._impulse: Floats = np.zeros((model.elements.size, len(FORCES), 2))
        self._seconds = 0.0

    def add(self, model: BareModel) -> None:
        """Add the long step that was just taken."""
        dt = model.parameters.stepping.time_step
        self._follow(model)
        self._impulse = self._impulse + dt * model.applied_forces()
        self._seconds += dt

    def _follow(self, model: BareModel) -> None:
        """Begin at zero for the newly born, and forget those that are no more."""
        ids = model.elements.body.id
        if not np.array_equal(self._ids, ids):
            self._impulse = by_identifier(self._ids, self._impulse, ids)
            self._ids = ids.copy()

    @property
    def kept(self) -> dict[str, Floats]:
        """What must be known again to go on: impulse (N s) and length (s) since the record before."""
        return {"impulse": self._impulse.copy(), "seconds": np.array(self._seconds)}

    def go_on(self, impulse: Floats, seconds: Floats) -> None:
        """Take up what was kept."""
        self._impulse, self._seconds = np.array(impulse), float(seconds)

    def begin(self) -> None:
        """Begin a new interval."""
        self._impulse, self._seconds = np.zeros_like(self._impulse), 0.0

    def means(self, model: BareModel) -> dict[str, Floats]:
        """Return the means (N) since the interval began, NaN where no step was taken."""
        self._follow(model)
        mean = self._impulse / self._seconds if self._seconds > 0.0 else np.full_like(self._impulse, np.nan)
        flat = mean.reshape(len(mean), -1)
        return {v.name: flat[:, k] for k, v in enumerate(force_variables())}
