"""What must be known of an element or a bond before it is stepped: filled in when it is new, and kept from then on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from riftberg.physics.geometry import separation
from riftberg.state import Floats, Ints
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.run_state import RunState


def complete_state(run: RunState) -> None:
    """Set sides of an element, area by which bonds know it, length and rest length of a bond, where they are not known."""
    sides = run.elements.body.sides
    sides[sides == 0] = run.constants.max_sides
    _set_bond_areas(run)
    _set_lengths(run)
    unknown = np.isnan(run.bonds.rest_length)
    if unknown.any():
        sizes = interaction_sizes(run.elements, run.constants)
        # Single-step schemes know springs by the elements' own sizes (equations 1.4, v).
        radius = sizes.bond_radius if run.parameters.stepping.scheme == "mts" else sizes.radius
        first, second = run.bonds.first[unknown], run.bonds.second[unknown]
        run.bonds.rest_length[unknown] = radius[first] + radius[second]


def _set_lengths(run: RunState) -> None:
    """Measure the bonds that were formed since the last step: not every scheme measures them, and no length is 0."""
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
        # What joins a berg takes its size.
        area[part[~unknown]] = body.bond_area[~unknown]
        body.bond_area[unknown] = area[part[unknown]]


def surround_newborn(run: RunState, newborn: NDArray[np.bool_], sampled: bool) -> None:
    """Place the newly born on the grid and, where the others have been ``sampled``, give them their environment."""
    if not newborn.any():
        return
    rows = np.flatnonzero(newborn)
    some = run.elements.taken(rows)
    if run.forcing.grid is not None:
        run.forcing.grid.locate(some)
    if sampled:
        p = run.parameters
        lag = p.stepping.time_step if p.compatibility.forcing_lag else 0.0
        run.forcing.sample(some, run.time - lag)
    for group in (some.place, some.environment):
        for name in group._fields:
            getattr(run.elements, name)[rows] = getattr(group, name)


def changed_rows(
    ids: Ints, values: tuple[Floats, ...], ids_before: Ints, before: tuple[Floats, ...]
) -> NDArray[np.bool_]:
    """Return which elements have other values than before; the newly born count as changed."""
    if ids_before.size == 0:
        return np.ones(ids.size, bool)
    changed: NDArray[np.bool_]
    if np.array_equal(ids, ids_before):  # as in most steps: then there is nothing to sort
        changed = np.zeros(ids.size, bool)
        for now, then in zip(values, before, strict=True):
            changed |= now != then
        return changed
    row, known = rows_of(ids_before, ids)
    changed = ~known
    for now, then in zip(values, before, strict=True):
        changed |= now != then[row]
    return changed


def by_identifier(ids: Ints, values: Floats, wanted: Ints) -> Floats:
    """Return rows of values in the order of other identifiers; zeros for those that have none."""
    taken = np.zeros((wanted.size, *values.shape[1:]))
    row, known = rows_of(ids, wanted)
    taken[known] = values[row[known]]
    return taken


def rows_of(ids: Ints, wanted: Ints) -> tuple[Ints, NDArray[np.bool_]]:
    """Return the row of each wanted identifier, any one where it is not there, and whether it is there."""
    if ids.size == 0:
        return np.zeros(wanted.size, np.int64), np.zeros(wanted.size, np.bool_)
    order = np.argsort(ids, kind="stable")
    row = order[np.minimum(np.searchsorted(ids[order], wanted), ids.size - 1)]
    return row, ids[row] == wanted
