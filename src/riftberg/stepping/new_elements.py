"""What a step must know of an element or a bond: filled in when it is new, and kept from then on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from riftberg.physics.geometry import separation
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.run_state import RunState
from riftberg.stepping.stepper import sample_between_steps


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
    body, b = run.elements.body, run.parameters.bonds
    unknown = body.bond_area == 0.0
    if not unknown.any():
        return
    if not b.constant_size:
        body.bond_area[unknown] = body.length[unknown] * body.width[unknown]
    elif b.constant_length > 0.0 and b.constant_width > 0.0:
        body.bond_area[unknown] = b.constant_length * b.constant_width
    else:
        bonds = run.bonds
        part = connected_parts(run.elements.size, bonds.first, bonds.second, bonds.status)
        count = np.bincount(part)
        length, width = (np.bincount(part, side) / count for side in (body.length, body.width))
        area = length * width
        # What joins a berg takes the area that its elements have.
        area[part[~unknown]] = body.bond_area[~unknown]
        body.bond_area[unknown] = area[part[unknown]]


def sample_new_elements(run: RunState, new: NDArray[np.bool_], sampled: bool) -> None:
    """Locate ``new`` elements on the grid and, where the others have been ``sampled``, give them their environment."""
    if not new.any():
        return
    rows = np.flatnonzero(new)
    some = run.elements.taken(rows)
    if run.forcing.grid is not None:
        run.forcing.grid.locate(some)
    if sampled:
        sample_between_steps(run, some)
    for group in (some.place, some.environment):
        for name in group._fields:
            getattr(run.elements, name)[rows] = getattr(group, name)
