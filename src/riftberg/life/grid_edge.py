"""The edge of a grid: turns around a periodic one, and bergs that leave over an open edge."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.run_state import RunState
from riftberg.state import Elements, Floats
from riftberg.state.population import by_identifier

TURNS: Final = "turns"
"""Name under which a run remembers `element_turns`, by identifier."""


def element_turns(run: RunState) -> Floats:
    """Return how often each element has gone round a periodic grid eastward."""
    ids, turns = run.remembered.get(TURNS, np.zeros((0, 2))).T
    return by_identifier(ids, turns, run.elements.body.id)


def count_turns(run: RunState, previous: Elements) -> None:
    """Count the turns of a step; no element goes half a period in one."""
    grid, el = run.forcing.grid, run.elements
    if grid is not None and grid.arrays.period > 0.0:
        turns = np.round((previous.place.lon - el.place.lon) / grid.arrays.period)
        if turns.any():
            run.remembered[TURNS] = np.column_stack([el.body.id, element_turns(run) + turns])


def find_lost(run: RunState) -> NDArray[np.bool_]:
    """Return which elements have left the grid over an open edge: whole bergs; single elements by the reference's rules."""
    grid = run.forcing.grid
    if grid is None or (inside := grid.has_in_domain(run.elements)).all():
        return np.zeros(run.elements.size, bool)
    if run.parameters.quirks.lost_over_edge:
        return ~inside
    component = connected_parts(inside.size, run.bonds.first, run.bonds.second, run.bonds.status)
    return np.isin(component, component[~inside])
