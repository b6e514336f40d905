"""A population in which elements come and go, without a model."""

from __future__ import annotations

import copy
import itertools
import weakref

import numpy as np
import pytest

from riftberg.errors import InputError
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, GROUPS, new_bonds, new_elements
from riftberg.state.population import Population, cut_out, put_back
from scripts import loaded

square_berg = loaded("benchmarks/bench.py").square_berg


def line(count):
    """Elements in a row, each bonded to the next; every variable different in every element."""
    elements = new_elements(count)
    for k, (name, array) in enumerate(elements.arrays().items()):
        if name != "id":
            array[:] = 100 * k + np.arange(count)
    return elements, new_bonds(np.arange(count - 1), np.arange(1, count))


def values(population, ids):
    """All variables of some elements but their identifiers."""
    rows = population.rows(ids)
    return {name: array[rows].copy() for name, array in population.elements.arrays().items() if name != "id"}


def test_every_variable_is_declared_once():
    names = [v.name for v in (*ELEMENT_VARIABLES, *BOND_VARIABLES)]
    assert len(set(v.name for v in ELEMENT_VARIABLES)) == len(ELEMENT_VARIABLES)
    assert all(v.units and v.long_name for v in (*ELEMENT_VARIABLES, *BOND_VARIABLES)), names
    assert {v.group for v in ELEMENT_VARIABLES} == set(GROUPS)


def test_a_variable_is_found_with_and_without_its_group():
    elements = new_elements(2)
    assert elements.lon is elements.place.lon
    with pytest.raises(AttributeError, match="no variable 'longitude'"):
        elements.longitude  # noqa: B018


def test_new_elements_come_last_and_their_bonds_with_them():
    population = Population(*line(4))
    ids = population.append(*line(3))
    assert ids.tolist() == [5, 6, 7]
    assert population.elements.id.tolist() == [1, 2, 3, 4, 5, 6, 7]
    bonds = population.bonds
    assert list(zip(bonds.first.tolist(), bonds.second.tolist(), strict=True)) == [
        (0, 1),
        (1, 2),
        (2, 3),
        (4, 5),
        (5, 6),
    ]
    assert bonds.id.tolist() == [1, 2, 3, 4, 5]


def test_removed_elements_take_their_bonds_along_and_the_rest_keeps_its_values():
    population = Population(*line(6))
    stays = [1, 2, 4, 5, 6]
    before = values(population, stays)
    population.remove([3])
    assert population.elements.id.tolist() == stays
    ends = population.elements.id[population.bonds.first], population.elements.id[population.bonds.second]
    assert list(zip(*(e.tolist() for e in ends), strict=True)) == [(1, 2), (4, 5), (5, 6)]
    after = values(population, stays)
    assert all(np.array_equal(before[name], after[name]) for name in before)


def test_identifiers_are_never_used_again():
    population = Population(*line(3))
    population.remove([3])
    assert population.append(new_elements(1)).tolist() == [4]
    population.remove([1, 2, 4])
    assert population.elements.size == 0
    assert population.append(new_elements(2)).tolist() == [5, 6]
    assert population.join([5], [6]).tolist() == [3]


def test_elements_that_are_not_there_are_refused():
    population = Population(*line(3))
    population.remove([2])
    with pytest.raises(InputError, match="no element has the identifier 2"):
        population.remove([2])
    with pytest.raises(InputError, match="no element has the identifier 9"):
        population.join([1], [9])


def test_rows_are_found_whatever_their_order():
    elements, bonds = line(4)
    elements.id[:] = [40, 7, 99, 12]
    population = Population(elements, bonds)
    assert population.rows([12, 40, 99]).tolist() == [3, 0, 2]
    assert population.append(new_elements(1)).tolist() == [100]


@pytest.mark.parametrize("seed", range(5))
def test_random_births_and_deaths_leave_every_other_element_as_it_was(seed):
    rng = np.random.default_rng(seed)
    population = Population(*line(20))
    known = {int(i): float(x) for i, x in zip(population.elements.id, population.elements.lon, strict=True)}
    joined = {tuple(p) for p in np.stack([population.bonds.first, population.bonds.second], axis=1) + 1}
    for _ in range(40):
        if rng.random() < 0.5 and known:
            gone = rng.choice(list(known), min(len(known), int(rng.integers(1, 5))), replace=False)
            population.remove(gone)
            known = {i: x for i, x in known.items() if i not in gone}
            joined = {pair for pair in joined if not set(pair) & set(gone.tolist())}
        else:
            new, bonds = line(int(rng.integers(1, 6)))
            new.lon[:] = rng.random(new.size)
            ids = population.append(new, bonds)
            known |= {int(i): float(x) for i, x in zip(ids, new.lon, strict=True)}
            joined |= {(int(a), int(b)) for a, b in itertools.pairwise(ids)}
        now = population.elements
        assert {int(i): float(x) for i, x in zip(now.id, now.lon, strict=True)} == known
        ends = now.id[population.bonds.first].tolist(), now.id[population.bonds.second].tolist()
        assert set(zip(*ends, strict=True)) == joined


def test_growth_copies_seldom():
    """Capacity doubles: fifty thousand births in fifties move the arrays a dozen times, not a thousand."""
    population = Population(*line(500))
    moves, room = 0, population.elements.lon.base
    while population.elements.size < 50_000:
        population.append(*line(50))
        moves += population.elements.lon.base is not room
        room = population.elements.lon.base
    assert population.elements.size == 50_000
    assert len(set(population.elements.id.tolist())) == 50_000
    assert moves <= 8
    population.compact()
    assert population.elements.lon.base is None or population.elements.lon.base.size == 50_000


def test_going_back_undoes_births_and_deaths():
    population = Population(*line(5))
    saved = population.saved()
    population.append(*line(3))
    population.remove([1, 2])
    population.elements.lon[:] = -1.0
    population.restore(saved)
    fresh = Population(*line(5))
    for name, array in fresh.elements.arrays().items():
        np.testing.assert_array_equal(getattr(population.elements, name), array, err_msg=name)
    assert population.append(new_elements(1)).tolist() == [6]


def test_a_part_that_is_cut_out_and_put_back_changes_only_its_rows():
    elements, bonds = line(6)
    rows = np.array([1, 2, 4, 5])
    part, between, bond_rows = cut_out(elements, bonds, rows)
    assert list(zip(between.first.tolist(), between.second.tolist(), strict=True)) == [(0, 1), (2, 3)]
    part.lon[:], between.damage[:] = -5.0, 0.5
    put_back(elements, bonds, rows, bond_rows, part, between)
    assert (elements.lon[rows] == -5.0).all()
    assert (elements.lon[[0, 3]] != -5.0).all()
    assert bonds.damage.tolist() == [0.0, 0.5, 0.0, 0.0, 0.5]
    assert bonds.first.tolist() == [0, 1, 2, 3, 4]


def test_the_newly_born_may_bring_identifiers_of_their_own() -> None:
    population = Population(new_elements(2), new_bonds(np.zeros(0, np.int64), np.zeros(0, np.int64)))
    assert population.append(new_elements(1), ids=np.array([70])).tolist() == [70]
    assert population.append(new_elements(1), ids=np.array([9])).tolist() == [9]
    assert population.append(new_elements(1)).tolist() == [71]
    for wrong in (np.array([70]), np.array([2])):
        with pytest.raises(InputError, match="is in use"):
            population.append(new_elements(1), ids=wrong)
    with pytest.raises(InputError, match="stands twice"):
        population.append(new_elements(2), ids=np.array([80, 80]))


@pytest.mark.parametrize("scheme", ["mts", "quasi_static", "verlet", "runge_kutta"])
def test_a_long_step_changes_only_what_is_said_to_change(scheme: str) -> None:
    """Going back after a failed step relies on it: what is not marked is not copied."""
    law = (
        {}
        if scheme in ("mts", "quasi_static")
        else {"bonds": {"law": "spring", "spring": 1e-8}, "fracture": {"enabled": False}}
    )
    weak = {"fracture": {"enabled": True, "normal_strength": 5.0}}
    model = square_berg(12, lambda p: p.adapted(stepping={"scheme": scheme}, **{**weak, **law})[0])
    model.advance(steps=1)
    before = model.population.saved()
    for _ in range(4):
        model.step()
    assert model.bonds_broken > 0 or law
    for variables, now, then in (
        (ELEMENT_VARIABLES, model.elements, before.elements),
        (BOND_VARIABLES, model.bonds, before.bonds),
    ):
        kept = [v.name for v in variables if not v.stepped]
        assert len(kept) > 4
        for name in kept:
            np.testing.assert_array_equal(getattr(now, name), getattr(then, name), err_msg=name)


def test_what_a_step_may_change_is_copied_and_the_rest_shared() -> None:
    population = Population(*line(3))
    saved = population.saved(stepped_only=True)
    for variables, now, then in (
        (ELEMENT_VARIABLES, population.elements, saved.elements),
        (BOND_VARIABLES, population.bonds, saved.bonds),
    ):
        for v in variables:
            assert np.shares_memory(getattr(now, v.name), getattr(then, v.name)) != v.stepped, v.name
    population.elements.lon[:] = -1.0
    population.restore(saved)
    np.testing.assert_array_equal(population.elements.lon, line(3)[0].lon)


@pytest.mark.parametrize("stepped_only", [True, False])
def test_a_copy_is_made_in_memory_that_is_there_while_the_rows_are_the_same(stepped_only) -> None:
    population = Population(*line(3))
    first = population.saved(stepped_only=stepped_only)
    population.elements.lon[:], population.bonds.damage[:] = 7.0, 0.5
    again = population.saved(stepped_only=stepped_only, into=first)
    assert again is first
    assert (again.elements.lon == 7.0).all()
    assert (again.bonds.damage == 0.5).all()
    population.elements.lon[:] = -1.0
    assert (again.elements.lon == 7.0).all()
    assert population.saved(stepped_only=not stepped_only, into=first) is not first
    population.remove(population.elements.body.id[:1])
    other = population.saved(stepped_only=stepped_only, into=first)
    assert other is not first
    assert other.elements.size == 2
    population.restore(first)
    assert population.elements.lon.tolist() == [7.0, 7.0, 7.0]


def test_a_checkpoint_keeps_no_rows_that_are_gone_and_a_copy_none_of_another_population() -> None:
    """Bug: the arrays that were copied last stayed with the checkpoint, 100 MiB of a population of 50,000."""
    population = Population(*line(3))
    saved, gone = population.saved(stepped_only=True), weakref.ref(population.elements.place.lon)
    twin = copy.deepcopy(population)
    twin.elements.lon[:] = 5.0
    assert (twin.saved(stepped_only=True).elements.lon == 5.0).all()
    population.remove(population.elements.body.id[:1])
    assert gone() is None
    assert saved.elements.size == 3
