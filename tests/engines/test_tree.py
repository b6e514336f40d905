"""The family tree of the fragments: who broke off whom, by which bonds, and whether aground."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg import A68A_2022, Parameters
from riftberg.engines.common.fragments.tree import FragmentTree
from riftberg.state import Bonds, Elements, new_bonds, new_elements

CONSTANTS = A68A_2022.kernel_values()
GROUNDED = Parameters(grounding={"coefficient": 1e3}, stepping={"scheme": "mts"}).kernel_values()


def row_of_ice(count: int) -> tuple[Elements, Bonds]:
    """Return elements in a row, each joined to the next."""
    elements = new_elements(count)
    elements.lon[:], elements.lat[:] = np.arange(count) * 0.05, -56.0
    elements.length[:] = elements.width[:] = 3000.0
    elements.thickness[:], elements.mass[:] = 200.0, 200.0 * 9e6 * 850.0
    return elements, new_bonds(np.arange(count - 1), np.arange(1, count))


def test_a_bond_sets_free_one_fragment_only() -> None:
    """The bond by which an earlier fragment left does not count again for its neighbour that leaves later."""
    elements, bonds = row_of_ice(10)
    tree = FragmentTree()
    assert tree.update(elements, bonds, 0.0, CONSTANTS) == 1
    bonds.status[1] = 1  # 0 and 1 leave
    tree.update(elements, bonds, 1800.0, CONSTANTS)
    bonds.status[4] = 1  # 2, 3 and 4 leave; their other side parted before
    assert tree.update(elements, bonds, 3600.0, CONSTANTS) == 3
    assert [(f.elements, f.parent, f.bonds_broken) for f in tree.breakups] == [(2, 1, 1), (3, 1, 1)]
    assert sum(f.bonds_broken for f in tree.breakups) == np.count_nonzero(bonds.status)


def test_a_fragment_is_not_aground_by_a_bond_that_broke_before() -> None:
    elements, bonds = row_of_ice(10)
    tree = FragmentTree()
    tree.update(elements, bonds, 0.0, CONSTANTS)
    bonds.status[1], bonds.break_grounded[1] = 1, 1
    tree.update(elements, bonds, 1800.0, CONSTANTS)
    bonds.status[4] = 1
    tree.update(elements, bonds, 3600.0, CONSTANTS)
    assert [f.grounded for f in tree.breakups] == [True, False]


def test_a_piece_is_aground_by_the_crack_that_freed_it() -> None:
    """The landing of A68a broke bonds beside the element that touched: its tip counted as afloat in the quasi-static scheme."""
    elements, bonds = row_of_ice(12)
    tree = FragmentTree()
    tree.update(elements, bonds, 0.0, CONSTANTS)
    bonds.status[[0, 3]], bonds.break_time[[0, 3]] = 1, 900.0
    bonds.break_grounded[0] = 1  # element 0 is held; 1 to 3 go with it
    tree.update(elements, bonds, 900.0, CONSTANTS)
    assert [(f.elements, f.grounded) for f in tree.breakups] == [(1, True), (3, True)]
    bonds.status[9], bonds.break_time[9] = 1, 5000.0  # a crack of its own, later
    tree.update(elements, bonds, 5000.0, CONSTANTS)
    assert [(f.elements, f.grounded) for f in tree.breakups][2:] == [(2, False)]


def test_cracks_of_two_bergs_at_one_moment_are_two() -> None:
    elements, bonds = row_of_ice(10)
    bonds.status[4] = 1  # two bergs from the start
    tree = FragmentTree()
    tree.update(elements, bonds, 0.0, CONSTANTS)
    bonds.status[[1, 6]], bonds.break_time[[1, 6]] = 1, 900.0
    bonds.break_grounded[1] = 1
    tree.update(elements, bonds, 900.0, CONSTANTS)
    assert sorted(f.grounded for f in tree.breakups) == [False, True]


def test_the_heaviest_piece_keeps_the_number() -> None:
    elements, bonds = row_of_ice(10)
    tree = FragmentTree()
    tree.update(elements, bonds, 0.0, CONSTANTS)
    bonds.status[6] = 1
    tree.update(elements, bonds, 1800.0, CONSTANTS)
    assert elements.berg.tolist() == [1] * 7 + [2] * 3


def test_a_berg_present_at_the_start_has_no_parent_whatever_numbers_its_elements_carry() -> None:
    """A state made by hand, or read from elsewhere, may hold numbers of bergs that no tree knows."""
    elements, bonds = row_of_ice(6)
    bonds.status[2] = 2
    elements.berg[:] = [7, 7, 7, 9, 9, 9]
    tree = FragmentTree()
    tree.update(elements, bonds, 0.0, CONSTANTS)
    assert [(f.number, f.parent) for f in tree.rows] == [(1, 0), (2, 0)]
    assert tree.breakups == []
    assert elements.berg.tolist() == [1, 1, 1, 2, 2, 2]


def test_thousands_of_pieces_of_one_name_are_numbered_in_one_go() -> None:
    """Each piece looked through the names of all others: 50,000 bergs took minutes before the first step."""
    count = 20_000
    elements, bonds = row_of_ice(count)
    bonds.status[:] = 2
    tree = FragmentTree(bergs=[("field", count)])
    assert tree.update(elements, bonds, 0.0, CONSTANTS) == count
    assert [row.name for row in tree.rows[:3]] == ["field", "field.1", "field.2"]
    assert len({row.name for row in tree.rows}) == count
    assert tree.rows[-1].name == f"field.{count - 1}"
    elements.berg[[2, 5]] = 1  # three parts of one number: the first of equals keeps it
    tree.update(elements, bonds, 1800.0, CONSTANTS)
    assert elements.berg[[0, 2, 5]].tolist() == [1, count + 1, count + 2]
    assert [row.name for row in tree.rows[-2:]] == [f"field.{count}", f"field.{count + 1}"]


def test_bergs_have_the_names_that_were_given_and_pieces_those_of_their_bergs() -> None:
    elements, bonds = row_of_ice(10)
    bonds.status[5] = 2
    tree = FragmentTree(bergs=[("west", 6), ("east", 4)])
    tree.update(elements, bonds, 0.0, CONSTANTS)
    bonds.status[[1, 7]] = 1
    tree.update(elements, bonds, 1800.0, CONSTANTS)
    assert [(f.name, f.parent) for f in tree.rows] == [("west", 0), ("east", 0), ("west.1", 1), ("east.1", 2)]


def test_bergs_of_one_element_are_described_as_all_others() -> None:
    """Found for all at once: position, area and mass are those of their element, names and parents included."""
    r, count = np.random.default_rng(4), 40
    elements = new_elements(count)
    elements.place.lon[:], elements.place.lat[:] = r.uniform(-180.0, 180.0, count), r.uniform(-80.0, -50.0, count)
    elements.body.mass[:], elements.body.thickness[:] = r.uniform(1e6, 1e12, count), 100.0
    elements.body.length[:], elements.body.width[:] = r.uniform(60.0, 3000.0, (2, count))
    elements.environment.depth[:] = np.where(np.arange(count) % 7, 1000.0, 50.0)
    elements.body.id[:] = np.arange(1, count + 1)
    elements.place.lon[[31, 32]] = 179.9, -179.8  # the two that are bonded
    tree = FragmentTree(bergs=[("many", 30), ("G", 10)])
    assert tree.update(elements, new_bonds(np.array([31]), np.array([32])), 0.0, GROUNDED) == count - 1
    names = ["many", *(f"many.{k}" for k in range(1, 30)), "G", *(f"G.{k}" for k in range(1, 9))]
    assert [row.name for row in tree.rows] == names
    for row in tree.rows:
        rows = np.flatnonzero(elements.berg == row.number)
        b, mass = elements.body, elements.body.mass[rows]
        assert (row.elements, row.area, row.mass) == (rows.size, (b.length * b.width)[rows].sum(), mass.sum())
        lon, lat = elements.place.lon[rows], elements.place.lat[rows]
        lon = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0  # on one side of the seam
        mean = (mass @ lon / mass.sum(), mass @ lat / mass.sum())
        assert (row.lon, row.lat) == pytest.approx(mean, rel=1e-14)
        assert row.grounded == bool((elements.environment.depth[rows] < 100.0).any())
