"""What the schemes have in common: what a model calls once per long step, and what each does at its ends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from riftberg.ocean.cells import round_trip, settle_elements
from riftberg.state import Elements, Floats, Ints
from riftberg.state.order import enter_cells
from riftberg.stepping.contact.land import apply_land_constraint
from riftberg.stepping.fragments.connectivity import connected_parts, drop_broken_bonds, drop_parted_bonds
from riftberg.stepping.run_state import RunState


class Stepper(Protocol):
    """Advances the state of a model by one long step, including cells, environment and fragments."""

    def step(self, run: RunState) -> None:
        """Advance by one long step; ``run.time`` moves on, ``run.step_number`` does not."""

    def sample_forcing(self, run: RunState) -> None:
        """Sample the forcing for the environment that the elements carry between two steps."""

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Return the velocity (m s-1) at the time of the positions, after a step; the state stays as it is."""

    @property
    def applied(self) -> Floats:
        """Mean accelerations (m s-2) over the last long step, shape (elements, forces, 2)."""

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """Rows of the pairs of elements of different bergs that were in contact in the last long step."""

    @property
    def crushed(self) -> float:
        """Plastic work and friction of faces that crush each other since the start, J; 0 in schemes without that law."""

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart must hold beside the state, as arrays, for the run to go on bit for bit."""

    def load_state_dict(self, kept: Mapping[str, Any]) -> None:
        """Restore what `state_dict` gave; other arrays in ``kept`` are left alone."""


class Stateless:
    """Schemes that need nothing beside the state."""

    @property
    def crushed(self) -> float:
        """See `Stepper.crushed`."""
        return 0.0

    def state_dict(self) -> dict[str, Any]:
        """Return nothing."""
        return {}

    def load_state_dict(self, kept: Mapping[str, Any]) -> None:
        """Restore nothing."""


def sample_between_steps(run: RunState, elements: Elements) -> None:
    """Sample the forcing at the positions and the time between two steps, or with the lag of Q5 that of the step just taken."""
    p = run.parameters
    lag = p.stepping.time_step if p.compatibility.forcing_lag else 0.0
    run.forcing.sample(elements, run.time - lag)


def publish_positions(el: Elements) -> None:
    """Let pair forces see moving elements where they are, also those that a user, or a process after a step, has moved."""
    moving = el.static < 0.5
    np.copyto(el.lon_pair, el.lon, where=moving)
    np.copyto(el.lat_pair, el.lat, where=moving)


def apply_boundaries(run: RunState, cells: tuple[Ints, Ints] | None = None) -> None:
    """Find the cells after a move from ``cells``, stop bergs at land, wrap longitudes (equations 8)."""
    el, grid = run.elements, run.forcing.grid
    if grid is not None:
        if run.parameters.compatibility.elements_stopped_alone:
            columns, rows = (el.cell_i.copy(), el.cell_j.copy()) if cells is None else cells
            settle_elements(el, grid.arrays, run.constants)
            enter_cells(el, columns, rows)
        else:
            apply_land_constraint(el, run.bonds, grid.arrays, run.constants)
        if run.constants.grid_position_round_trip:
            el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
            round_trip(el, grid.arrays)
    publish_positions(el)


def update_fragments(run: RunState) -> None:
    """Number fragments after bonds have broken, and forget broken bonds whose ends have parted (equations 1.5)."""
    el, bonds, c = run.elements, run.bonds, run.constants
    if c.broken_as_contact and c.fracture_on_substeps:
        drop_parted_bonds(bonds, connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status))
    else:
        drop_broken_bonds(bonds)
    run.fragments.update(el, bonds, run.time, c)
