"""Births, deaths and changes of size since the last look at a population, and what follows from them.

Bonds are counted, fragments numbered and measured, newborn elements get an environment, and sub-steps are chosen anew.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from riftberg.bergs.bonding import count_bonds
from riftberg.engines.common.fragments.tree import measure_outlines
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.state_checks import check_state
from riftberg.engines.common.stepper import complete_state, sample_new_elements
from riftberg.engines.schemes import assign_substeps, size_bins
from riftberg.state import Elements, Floats, Ints
from riftberg.state.population import changed_rows


class Census(NamedTuple):
    """Elements, bonds and sizes of a population at one moment."""

    version: int  # Of the rows
    next_bond: int
    ids: Ints
    bond_ids: Ints
    sizes: list[bytes]  # Mass and sizes, which melt and calving change
    bins: tuple[Floats, ...]  # Of the sizes that the number of sub-steps depends on

    @classmethod
    def of(cls, run: RunState, bins: tuple[Floats, ...] | None = None) -> Self:
        """Take the census of a run; ``bins`` of its sizes where they are known."""
        population, elements = run.population, run.elements
        return cls(
            population.version, population.next_bond, elements.body.id.copy(), run.bonds.id.copy(),
            element_sizes(elements), size_bins(run) if bins is None else bins,
        )  # fmt: skip


def element_sizes(elements: Elements) -> list[bytes]:
    """Return mass and sizes of the elements, which melt and calving change, as bytes."""
    body = elements.body
    return [values.tobytes() for values in (body.mass, body.thickness, body.length, body.width)]


def follow_changes(run: RunState, last: Census, *, started: bool) -> Census:
    """Follow up births, deaths and changes of mass or size since a census.

    ``started``: the bergs have their numbers, and the elements an environment.
    """
    # Most steps change nothing: then the rows are the same, and comparing their bytes is enough, and quick.
    if run.population.version == last.version and element_sizes(run.elements) == last.sizes:
        return last
    # Sizes in bins: melt changes every element in every step, the number of sub-steps only where that matters.
    bins = size_bins(run)
    changed = changed_rows(run.elements.body.id, bins, last.ids, last.bins)
    check_state(run.elements, run.bonds, run.parameters.earth.latlon)
    measured = run.population.version != last.version and _follow_rows(run, last, started)
    if started and not measured:
        measure_outlines(run.elements, run.constants)
    new_bonds = run.bonds.id >= last.next_bond
    changed[run.bonds.first[new_bonds]] = True
    assign_substeps(run, changed)
    return Census.of(run, bins)


def _follow_rows(run: RunState, last: Census, started: bool) -> bool:
    """Follow up elements and bonds that came or went; return whether fragments were numbered and measured."""
    newborn = ~np.isin(run.elements.body.id, last.ids)
    sample_new_elements(run, newborn, started)
    complete_state(run)
    if not started:
        return False
    count_bonds(run.elements, run.bonds)
    # Where lone elements went and nothing else, every fragment that is left is as it was.
    if not newborn.any() and np.array_equal(run.bonds.id, last.bond_ids):
        return False
    run.fragments.update(run.elements, run.bonds, run.time, run.constants)
    return True
