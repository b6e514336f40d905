"""Rows of bonds in blocks: what is loaded, what fills up the last block, and that the loops over blocks are vector code."""

from __future__ import annotations

import platform
import re
from typing import Any

import numba
import numpy as np
import pytest

from riftberg.stepping import bond_blocks as row
from riftberg.stepping import bond_law
from riftberg.stepping.bond_rows import BondRows, allocate_rows, load_rows, store_rows
from riftberg.stepping.sizes import interaction_sizes
from stepping.lattices import lattice, parameters

P = parameters()


def loaded(columns: int, rows: int, broken: tuple[int, ...] = ()) -> tuple[Any, Any, BondRows, int]:
    el, bonds = lattice(3, P, columns=columns, rows=rows)
    bonds.status[list(broken)] = 1
    made = allocate_rows(bonds, el.mass.size)
    made.block[: -row.BLOCK] = np.nan  # what an earlier long step left must not matter
    count = load_rows(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
    return el, bonds, made, count


def quantity(rows: BondRows, name: int, count: int) -> np.ndarray:
    return np.array([rows.block[row.place_of(r) + name] for r in range(count)])


@pytest.mark.parametrize(("columns", "rows"), [(3, 2), (5, 4), (9, 8)])
def test_rows_hold_the_unbroken_bonds_in_order(columns: int, rows: int) -> None:
    _, bonds, made, count = loaded(columns, rows, broken=(0, 4))
    kept = np.flatnonzero(bonds.status == 0)
    assert count == kept.size
    assert np.array_equal(made.bond[:count], kept)
    assert np.array_equal(quantity(made, row.SX, count), bonds.shear_x[kept])
    assert np.array_equal(quantity(made, row.ALIVE, count), np.ones(count))


def test_what_fills_up_the_last_block_is_not_alive_and_a_number() -> None:
    """A row without length would divide by zero, and its forces spread NaN over the berg."""
    el, _, made, count = loaded(5, 5)
    assert count % row.LANES != 0
    bond_law.apply_bond_law(made, count, el, 10.0, P)
    filled = row.blocks_of(count) * row.LANES
    for name in (row.FX, row.FY, row.TORQUE1, row.TORQUE2):
        values = quantity(made, name, filled)
        assert np.isfinite(values).all()
        assert not values[count:].any()
    assert not made.block[-row.BLOCK :].any()


def test_a_berg_of_exactly_full_blocks() -> None:
    """The block of zeros, which stands for bonds that an element does not have, is never one that is in use."""
    el, bonds, made, count = loaded(9, 8)
    bonds.status[np.flatnonzero(bonds.status == 0)[(count // row.LANES) * row.LANES :]] = 1
    count = load_rows(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
    assert count % row.LANES == 0
    bond_law.apply_bond_law(made, count, el, 10.0, P)
    assert not made.block[-row.BLOCK :].any()
    none = made.sign == 0.0
    assert none.any()
    assert (made.slot[none] == made.block.size - row.BLOCK).all()


def test_sums_over_bonds_are_those_of_a_plain_loop() -> None:
    el, _, made, count = loaded(9, 8, broken=(7,))
    bond_law.apply_bond_law(made, count, el, 10.0, P)
    sums = np.zeros((3, el.mass.size))
    bond_law.sum_over_bonds(made, *sums)
    plain = np.zeros_like(sums)
    for r in range(count):
        at, i, j = row.place_of(r), made.first[r], made.second[r]
        force = made.block[[at + row.FX, at + row.FY]]
        plain[:2, i] += force
        plain[:2, j] -= force
        plain[2, i] += made.block[at + row.TORQUE1]
        plain[2, j] += made.block[at + row.TORQUE2]
    assert np.array_equal(sums, plain)


def test_rows_go_back_to_the_bonds_that_did_not_break() -> None:
    _, bonds, made, count = loaded(5, 4)
    bonds.status[2] = 1  # breaks within the long step
    before = bonds.shear_x[2]
    for r in range(count):
        made.block[row.place_of(r) + row.SX] = float(r)
    store_rows(made, count, bonds)
    assert bonds.shear_x[2] == before
    assert bonds.shear_x[made.bond[5]] == 5.0


LOOPS: dict[str, tuple[int, tuple[Any, ...]]] = {
    "bonds_in_metres": (150, (True, 6.37e6, 360.0)),
    "sines": (150, (False,)),
    "sections": (100, ()),
    "slips": (40, (10.0, True)),
    "forces": (40, (1e7, 0.3, True, False)),
    "stresses": (60, (1e7, 0.3, False)),
}
"""Loops that must be vector code: the least number of packed instructions (there are 1.4 to 2 times as many), arguments."""


@pytest.mark.compiled
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads the machine code of x86-64")
@pytest.mark.parametrize("name", LOOPS)
def test_the_loops_of_the_bond_law_are_vector_code(name: str) -> None:
    """A branch, a call or an index that may be negative turns them into scalar code, several times as slow, without a word."""
    least, arguments = LOOPS[name]
    _, _, made, _ = loaded(5, 4)
    again = numba.njit(error_model="numpy")(getattr(bond_law, name).py_func)  # machine code from a cache cannot be read
    again(made.block[: row.BLOCK], *arguments)
    (code,) = again.inspect_asm().values()
    packed, scalar = (len(re.findall(rf"\sv?(?:mul|add|sub|div|sqrt){kind}\s", code)) for kind in ("pd", "sd"))
    assert packed >= least
    assert scalar <= 4
