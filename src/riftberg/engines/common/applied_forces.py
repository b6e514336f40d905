"""Forces of the last long step, with the masses that they moved: life changes elements after it."""

from __future__ import annotations

import numpy as np

from riftberg.state import Elements, Floats
from riftberg.state.population import by_identifier


class AppliedForces:
    """Turns the mean accelerations of the last long step into forces (N) on elements of now."""

    def __init__(self, elements: Elements) -> None:
        self.own: Floats | None = None  # Accelerations by each of several forces of one's own, (elements, forces, 2)
        self.take_masses(elements)

    def take_masses(self, elements: Elements) -> None:
        """Keep the masses that a step has just moved."""
        self._ids, self._mass = elements.body.id.copy(), elements.body.mass.copy()

    def on_elements(self, accelerations: Floats, elements: Elements) -> Floats:
        """Return the forces (N) of mean accelerations (m s-2, shape (elements of the step, forces, 2)); 0 for the newly born."""
        if accelerations.shape[0] != self._mass.size:  # no step has been taken
            accelerations = np.zeros((self._mass.size, *accelerations.shape[1:]))
        forces = self._mass[:, None, None] * accelerations
        if np.array_equal(self._ids, elements.body.id):
            return forces
        return by_identifier(self._ids, forces, elements.body.id)

    def own_on_elements(self, elements: Elements, count: int) -> Floats:
        """Return each of ``count`` forces of one's own (N) on elements; 0 before the first step."""
        return np.zeros((elements.size, count, 2)) if self.own is None else self.on_elements(self.own, elements)
