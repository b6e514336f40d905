"""What the schemes have in common: what a model calls once per long step, and what each does at its ends.

What a step must know of an element or a bond is filled in when it is new, and kept from then on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.crack_tips import NO_TIPS, CrackTips
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts, drop_broken_bonds, drop_parted_bonds
from riftberg.engines.common.land import apply_land_constraint
from riftberg.engines.common.run_state import RunState
from riftberg.ocean.cells import round_trip, settle_elements
from riftberg.parameters import ExplicitParameters
from riftberg.physics.geometry import separation
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import enter_cells
from riftberg.state.variables import GONE


class Stepper(Protocol):
    """Advances the state of a model by one long step, including cells, environment and fragments."""

    def step(self, run: RunState) -> None:
        """Advance by one long step; ``run.time`` moves on, ``run.step_number`` does not."""

    def take_back(self, run: RunState) -> None:
        """Return to the start of the last step, if it began at ``run.time``: the model has taken it back."""

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
    def plastic(self) -> Floats:
        """Plastic work since the start, J: of faces that crush each other, and of friction on a bed of sediment."""

    @property
    def clearance(self) -> float:
        """Least water under a keel since the start, m, as a bed of sediment has it; NaN where there is none."""

    @property
    def tips(self) -> CrackTips:
        """Tips of cracks, as the last step has left them."""

    def state_dict(self) -> dict[str, Any]:
        """Return the arrays that a restart needs beside the state, for the run to go on bit for bit."""

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore the arrays of `state_dict`; other arrays in ``saved`` are left alone."""


class Stateless:
    """Schemes that need nothing beside the state."""

    def take_back(self, run: RunState) -> None:
        """Nothing is kept from one step to the next."""

    @property
    def plastic(self) -> Floats:
        """See `Stepper.plastic`: none."""
        return np.zeros(2)

    @property
    def clearance(self) -> float:
        """See `Stepper.clearance`: none."""
        return math.nan

    @property
    def tips(self) -> CrackTips:
        """See `Stepper.tips`: none."""
        return NO_TIPS

    def state_dict(self) -> dict[str, Any]:
        """Return nothing."""
        return {}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore nothing."""


def sample_between_steps(run: RunState, elements: Elements) -> None:
    """Sample the forcing at the positions and the time between two steps, or with the lag of Q5 that of the step just taken."""
    p = run.parameters
    lag = p.time_step if p.quirks.forcing_lag else 0.0
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
        if run.parameters.quirks.elements_stopped_alone:
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
    el, bonds, c, p = run.elements, run.bonds, run.constants, run.parameters
    if c.broken_as_contact and c.fracture_on_substeps:
        drop_parted_bonds(bonds, connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status))
    elif not p.quirks.inline_break_in_first_step:
        drop_broken_bonds(bonds)
    elif run.step_number > 0 or not (isinstance(p, ExplicitParameters) and p.fracture.not_in_first_step):
        # The reference drops by the test of its long step, for which a threshold <= 0 is none (equations 7.1, quirk Q9).
        normal, shear = (s if s > 0.0 else np.inf for s in (c.normal_strength, c.shear_strength))
        over = (bonds.normal_stress > normal) | (bonds.shear_stress > shear)
        bonds.status[(bonds.status == 1) & over] = GONE
    run.fragments.update(el, bonds, run.time, c)


def complete_state(run: RunState) -> None:
    """Set sides and bond area of elements, length and rest length of bonds, where they are not known."""
    sides = run.elements.body.sides
    sides[sides == 0] = run.constants.max_sides
    _set_bond_areas(run)
    _set_lengths(run)
    unknown = np.isnan(run.bonds.rest_length)
    if unknown.any():
        sizes = interaction_sizes(run.elements, run.constants)
        # Single-step schemes take springs by the elements' own sizes (equations 1.4, v).
        radius = sizes.bond_radius if run.parameters.stepping.scheme == "mts" else sizes.radius
        first, second = run.bonds.first[unknown], run.bonds.second[unknown]
        run.bonds.rest_length[unknown] = radius[first] + radius[second]


def _set_lengths(run: RunState) -> None:
    """Measure the bonds formed since the last step: not every scheme measures them, and no bond has length 0."""
    el, bonds, c = run.elements, run.bonds, run.constants
    for b in np.flatnonzero(bonds.bond_length == 0.0):
        i, j = bonds.first[b], bonds.second[b]
        rx, ry = separation(el.lon[i], el.lat[i], el.lon[j], el.lat[j], c.latlon, c.earth_radius, c.period)
        bonds.bond_length[b] = math.hypot(rx, ry)


def _set_bond_areas(run: RunState) -> None:
    """Constant area of all bonds of a berg: as the parameters say, or from the mean sides of the berg (equations 1.4, v)."""
    body, c = run.elements.body, run.constants
    unknown = body.bond_area == 0.0
    if not unknown.any():
        return
    if not c.constant_size:
        body.bond_area[unknown] = body.length[unknown] * body.width[unknown]
    elif c.constant_length > 0.0 and c.constant_width > 0.0:
        body.bond_area[unknown] = c.constant_length * c.constant_width
    else:
        bonds = run.bonds
        component = connected_parts(run.elements.size, bonds.first, bonds.second, bonds.status)
        count = np.bincount(component)
        sides = (body.length, body.width)
        length, width = (
            np.bincount(component, side) / count if component.any() else side.mean(keepdims=True) for side in sides
        )
        area = length * width
        # What joins a berg takes the area that its elements have.
        area[component[~unknown]] = body.bond_area[~unknown]
        body.bond_area[unknown] = area[component[unknown]]


def sample_new_elements(run: RunState, new: NDArray[np.bool_], sampled: bool) -> None:
    """Locate ``new`` elements on the grid and, where the others have been ``sampled``, give them their environment."""
    if not new.any():
        return
    rows = np.flatnonzero(new)
    newcomers = run.elements.taken(rows)
    if run.forcing.grid is not None:
        run.forcing.grid.locate(newcomers)
    if sampled:
        sample_between_steps(run, newcomers)
    for group in (newcomers.place, newcomers.environment):
        for name in group._fields:
            getattr(run.elements, name)[rows] = getattr(group, name)
