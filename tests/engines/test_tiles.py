"""Rows of bonds in blocks: what is loaded, what stands where there is no bond, and that the loops over blocks are vector code."""

from __future__ import annotations

import platform
import re
from typing import Any

import numba
import numpy as np
import pytest

from engines.lattices import lattice, long_step, parameters
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.explicit import tile_kernels
from riftberg.engines.explicit import tiles as tile
from riftberg.engines.explicit.beams import pack_elements
from riftberg.engines.explicit.fracture import store_bonds
from riftberg.engines.explicit.substeps import allocate_fields
from riftberg.engines.explicit.tile_kernels import drift_tile, sum_over_bonds
from riftberg.engines.explicit.tiles import BondTiles, allocate_tiles, may_cross_seam, pack_bonds

P = parameters()


def show(made: BondTiles, el: Any, dt: float = 0.0) -> None:
    """Lay out elements that do not move, but turn over ``dt`` seconds."""
    pack_elements(made, el, allocate_fields(el.mass.size))
    for b in range(tile.tile_count(el.mass.size)):
        own, ends = (
            made.elem[b * tile.ELEMENT_TILE : (b + 1) * tile.ELEMENT_TILE],
            made.ends[b * tile.END_TILE : (b + 1) * tile.END_TILE],
        )
        drift_tile(own, ends, made.rotation[b * tile.LANES : (b + 1) * tile.LANES], dt, P.latlon, P.earth_radius, False)


def summed(made: BondTiles, elements: int) -> np.ndarray:
    """Forces and torques of all elements; ``made.sums`` is cleared."""
    sheets = np.zeros((tile.tile_count(elements), tile.SCRATCH_TILE))
    for b, scratch in enumerate(sheets):
        sums, slots = (
            made.sums[b * tile.SUM_TILE : (b + 1) * tile.SUM_TILE],
            made.slots[b * tile.LANES : (b + 1) * tile.LANES],
        )
        sum_over_bonds(scratch, sums, slots, made.bond)
    return sheets[:, : tile.SUM_TILE].reshape(-1, 3, tile.LANES).transpose(1, 0, 2).reshape(3, -1)[:, :elements]


def loaded(columns: int, rows: int, broken: tuple[int, ...] = ()) -> tuple[Any, Any, BondTiles, int]:
    el, bonds = lattice(3, P, columns=columns, rows=rows)
    bonds.status[list(broken)] = 1
    made = allocate_tiles(el, bonds)
    made.bond[: -tile.BOND_TILE] = np.nan  # what an earlier long step left must not matter
    made.shape[:] = np.nan
    made.scratch[:] = np.nan
    count = pack_bonds(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
    show(made, el)
    return el, bonds, made, count


def parts(made: BondTiles, b: int, elements: int) -> tuple[Any, Any, Any]:
    """Rows, first ends and sums of block ``b``."""
    e = b // made.layers
    return (
        made.bond[b * tile.BOND_TILE : (b + 1) * tile.BOND_TILE],
        made.ends[e * tile.END_TILE : (e + 1) * tile.END_TILE],
        made.sums[e * tile.SUM_TILE : (e + 1) * tile.SUM_TILE],
    )


def shapes(made: BondTiles, b: int) -> Any:
    """Shapes of the bonds of block ``b``."""
    return made.shape[made.shape_of[b] : made.shape_of[b] + tile.SHAPE_TILE]


def applied(made: BondTiles, count: int, elements: int) -> None:
    """Apply the law to all blocks, and sum over first ends."""
    made.sums[:] = 0.0
    for b in made.in_use[:count]:
        block, ends, sums = parts(made, b, elements)
        tile_kernels.gather_second_ends(made.scratch, made.second_end[b * tile.LANES : (b + 1) * tile.LANES], made.ends)
        tile_kernels.apply_bond_law(block, shapes(made, b), made.scratch, ends, 10.0, P, P.period)
        tile_kernels.accumulate_first_ends(block, made.scratch, sums)


def element_of(lane: Any, made: BondTiles) -> Any:
    """Element at which the bond of a lane begins."""
    return lane // tile.LANES // made.layers * tile.LANES + lane % tile.LANES


def quantity(made: BondTiles, name: int) -> np.ndarray:
    return np.array([made.bond[tile.bond_offset(r) + name] for r in range(made.bond_ids.size)])


@pytest.mark.parametrize(("columns", "rows"), [(3, 2), (5, 4), (9, 8), (40, 3)])
def test_rows_hold_each_unbroken_bond_once_at_its_first_end(columns: int, rows: int) -> None:
    _, bonds, made, count = loaded(columns, rows, broken=(0, 4))
    there = np.flatnonzero(made.bond_ids >= 0)
    held = made.bond_ids[there]
    assert sorted(held) == list(np.flatnonzero(bonds.status == 0))
    assert np.array_equal(element_of(there, made), bonds.first[held])
    assert np.array_equal(made.second_end[there], [tile.end_offset(j) for j in bonds.second[held]])
    assert set(there // tile.LANES) == set(made.in_use[:count])
    slip = np.hypot(bonds.shear_x, bonds.shear_y)[held]
    np.testing.assert_allclose(np.abs(quantity(made, tile.SLIP)[there]), slip, rtol=1e-14)
    assert np.array_equal(quantity(made, tile.INTACT) > 0.0, made.bond_ids >= 0)


def test_the_first_layer_holds_the_bonds_to_the_next_element() -> None:
    """Its second ends are copied as neighbours, not one by one."""
    _, bonds, made, _ = loaded(40, 3, broken=(7,))
    layer = made.bond_ids.reshape(-1, made.layers, tile.LANES)[:, 0]
    held = layer[layer >= 0]
    assert np.array_equal(bonds.second[held], bonds.first[held] + 1)
    assert ((bonds.second == bonds.first + 1) & (bonds.status == 0)).sum() == held.size


@pytest.mark.parametrize("columns", [5, 40])
def test_neighbours_are_copied_as_they_are_gathered(columns: int) -> None:
    el, _, made, _ = loaded(columns, 3)
    first_layer = made.second_end.reshape(-1, made.layers, tile.LANES)[:, 0]
    for b in range(tile.tile_count(el.mass.size)):
        tile_kernels.gather_second_ends(made.scratch, first_layer[b].copy(), made.ends)
        one_by_one = made.scratch[: tile.END_TILE].copy()
        made.scratch[:] = np.nan
        tile_kernels.shift_second_ends(made.scratch, made.ends[b * tile.END_TILE : (b + 2) * tile.END_TILE])
        assert np.array_equal(made.scratch[: tile.END_TILE], one_by_one)


def test_bonds_alike_share_their_shapes_and_others_do_not() -> None:
    """In ice of one thickness each layer has one tile of shapes; one thin element gives those of its bonds to its tiles alone."""
    el, bonds, made, _ = loaded(40, 6)
    for same in (el.length, el.width, el.thickness, el.mass, bonds.rest_length):
        same[:] = same[0]
    count = pack_bonds(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
    assert np.unique(made.shape_of[made.in_use[:count]]).size == made.layers
    el.thickness[100] = 120.0
    pack_bonds(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
    there = np.flatnonzero(made.bond_ids >= 0)
    small = [shapes(made, r // tile.LANES)[tile.THICKNESS_SMALL + r % tile.LANES] for r in there]
    later = np.maximum(bonds.first, bonds.second)[made.bond_ids[there]]  # of two of one size it counts as the small one
    assert np.array_equal(small, el.thickness[later])
    assert made.layers < np.unique(made.shape_of).size < made.shape_of.size


def test_elements_wait_for_all_bonds_that_see_them() -> None:
    """A kick moves an element: of a bond that begins in a later tile it has to wait for that."""
    el, bonds, made, _ = loaded(40, 6)
    turned = bonds.first[50], bonds.second[50]
    bonds.first[50], bonds.second[50] = turned[::-1]
    pack_bonds(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
    for b in range(made.last_tile.size):
        ends = (bonds.second // tile.LANES == b) & (bonds.status == 0)
        assert made.last_tile[b] == max([b, *(bonds.first[ends] // tile.LANES)])
        begin = (bonds.first // tile.LANES == b) & (bonds.status == 0)
        assert made.farthest[b] == max([b, *(bonds.second[begin] // tile.LANES)])


@pytest.mark.compiled
def test_sub_steps_at_once_are_those_one_after_the_other() -> None:
    """To the last bit, with bonds that break in several of them, and contact from then on."""
    weak = {"enabled": True, "broken_as_contact": True, "normal_strength": 120e3, "shear_strength": 60e3}
    p = parameters(stepping={"scheme": "mts"}, fracture=weak)
    begin, whole = lattice(3, p, columns=40, rows=5, touching=False, speed=0.02, strain=1e-4)
    early, late = whole.first < 2 * tile.LANES, whole.first >= 4 * tile.LANES

    def stepped(strength: np.ndarray, at_once: int, starting: bool = False) -> tuple[Any, Any]:
        el, bonds = begin.copy(), whole.copy()
        bonds.strength[:] = strength
        report = long_step(el, bonds, p, 300.0, 15, starting=starting, may_break=True, at_once=at_once)
        assert report.broken == np.isfinite(bonds.break_time).sum() == (bonds.status != 0).sum()
        return el, bonds

    # Bonds that alone, and this strong, break from the second sub-step to the sixth: at the end of a tile, next to which
    # others begin that the sub-steps have still to come to.
    soon = []
    for b in np.flatnonzero(early & (whole.first % tile.LANES == tile.LANES - 1)):
        for strong in np.geomspace(0.3, 10.0, 16):
            alone = np.full(whole.strength.size, 1000.0)
            alone[b] = strong
            if 30.0 < stepped(alone, 1)[1].break_time[b] < 130.0:
                soon.append((b, strong))
    assert soon
    many = turned = 0
    for draw in range(24):
        r = np.random.default_rng(draw)
        strength = r.uniform(0.05, 1.5, whole.strength.size)
        if draw % 4:
            # A bond in the last tiles fails at once. Sub-steps behind that one have met failing ones in the first tiles by then.
            strength[:] = 1000.0
            b, strength_of_one = soon[r.integers(len(soon))]
            strength[b], strength[r.choice(np.flatnonzero(late), 2)] = strength_of_one, 1e-3
        el, bonds = stepped(strength, 1, draw % 2 == 0)
        for at_once in (3, tile.AT_ONCE):
            for one_by_one, together in zip((el, bonds), stepped(strength, at_once, draw % 2 == 0), strict=True):
                for name, values in one_by_one.arrays().items():
                    np.testing.assert_array_equal(together.arrays()[name], values, err_msg=name)
        times = bonds.break_time
        many += np.unique(times[np.isfinite(times)]).size > 2
        turned += np.nanmin(times[late], initial=np.inf) < np.nanmin(times[early], initial=np.inf) < 150.0
    assert many > 5
    assert turned > 5


def test_where_no_bond_is_nothing_acts() -> None:
    """What stands in such a row may be no number, and must not spread over the berg."""
    el, bonds, made, count = loaded(5, 5, broken=(3, 11))
    applied(made, count, el.mass.size)
    none = made.bond_ids < 0
    assert none.any()
    for name in (tile.FX, tile.FY, tile.TORQUE2):
        values = quantity(made, name)
        assert np.isfinite(values[~none]).all()
        assert not values[none & np.isin(np.arange(none.size) // tile.LANES, made.in_use[:count])].any()
    assert np.isfinite(made.sums).all()
    assert not made.bond[-tile.BOND_TILE :].any()
    assert bonds.status[3] == 1


def test_a_layer_without_bonds_is_left_out() -> None:
    el, bonds, made, _ = loaded(5, 5)
    bonds.status[bonds.second == bonds.first + 1] = 1
    count = pack_bonds(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
    assert el.mass.size <= tile.LANES
    assert count
    assert 0 not in made.in_use[:count]


def test_bergs_without_bonds_have_no_rows() -> None:
    """Fifty thousand of them would take 9 MB, and be gone through in each long step."""
    el, bonds = lattice(3, P, columns=5, rows=4)
    none = bonds.taken(np.zeros(0, np.int64))
    made = allocate_tiles(el, none)
    assert made.bond_ids.size == 0
    assert pack_bonds(made, el, none, interaction_sizes(el, P), np.arange(el.mass.size), P) == 0
    assert not summed(made, el.mass.size).any()


def test_elements_that_are_met_less_often_name_the_block_of_zeros() -> None:
    el, _, made, count = loaded(9, 8)
    applied(made, count, el.mass.size)
    none = made.slots == made.bond.size - tile.BOND_TILE
    assert none.any()
    assert not none.all(axis=0).any()


def test_sums_over_bonds_are_those_of_a_plain_loop() -> None:
    el, bonds, made, count = loaded(9, 8, broken=(7,))
    applied(made, count, el.mass.size)
    plain = np.zeros((3, el.mass.size))
    begun = made.sums.reshape(-1, 3, tile.LANES).transpose(1, 0, 2).reshape(3, -1)[:, : el.mass.size]
    plain[2] += begun[2]
    for r in np.flatnonzero(made.bond_ids >= 0):
        at, i, j = tile.bond_offset(r), bonds.first[made.bond_ids[r]], bonds.second[made.bond_ids[r]]
        force = made.bond[[at + tile.FX, at + tile.FY]]
        plain[:2, i] += force
        plain[:2, j] -= force
        plain[2, j] += made.bond[at + tile.TORQUE2]
    sums = summed(made, el.mass.size)
    assert not made.sums.any()  # ready for the next sub-step
    size = np.abs(plain).max(axis=1, keepdims=True)
    np.testing.assert_allclose(sums / size, plain / size, rtol=0, atol=1e-13)
    assert abs(sums[:2].sum()) <= 1e-12 * np.abs(sums[:2]).sum()


def test_the_order_of_the_bonds_does_not_matter() -> None:
    """Each element sums over its bonds in the order of the elements, not of the list."""
    want: Any = None
    for seed in range(3):
        el, bonds = lattice(3, P, columns=7, rows=6)
        order = np.random.default_rng(seed).permutation(bonds.first.size) if seed else np.arange(bonds.first.size)
        for name in ("first", "second", "status", "shear_x", "shear_y", "strength", "rest_length", "damage"):
            getattr(bonds, name)[:] = getattr(bonds, name)[order]
        made = allocate_tiles(el, bonds)
        count = pack_bonds(made, el, bonds, interaction_sizes(el, P), np.arange(el.mass.size), P)
        show(made, el)
        applied(made, count, el.mass.size)
        sums = summed(made, el.mass.size)
        want = sums if want is None else want
        np.testing.assert_allclose(sums, want, rtol=0, atol=1e-12 * np.abs(want).max())


def test_what_bonds_bear_goes_to_the_state_but_for_those_that_broke() -> None:
    el, bonds, made, count = loaded(5, 4)
    applied(made, count, el.mass.size)
    made.scratch[:] = 3.0
    before = bonds.shear_x.copy()
    block = made.bond[: tile.BOND_TILE]
    held = made.bond_ids[: tile.LANES]
    gone = held[held >= 0][1]
    block[tile.INTACT + np.flatnonzero(held == gone)[0]] = 0.0  # breaks within the long step
    store_bonds(held, bonds, block, made.scratch, made.rotation)
    kept = held[(held >= 0) & (held != gone)]
    assert bonds.shear_x[gone] == before[gone]
    lanes = np.isin(held, kept)
    assert np.array_equal(bonds.shear_x[kept], -3.0 * block[tile.SLIP : tile.SLIP + tile.LANES][lanes])
    assert (bonds.normal_stress[kept] == 3.0).all()


def test_the_turn_of_one_end_against_the_other_is_kept() -> None:
    el, bonds, made, _ = loaded(5, 4)
    show(made, el, 10.0)
    before = bonds.relative_rotation.copy()
    block, _, _ = parts(made, 0, el.mass.size)
    store_bonds(made.bond_ids[: tile.LANES], bonds, block, made.scratch, made.rotation)
    b = made.bond_ids[0]
    turn = 10.0 * (el.spin[bonds.first[b]] - el.spin[bonds.second[b]])
    assert bonds.relative_rotation[b] == pytest.approx(before[b] + turn, rel=1e-12)


@pytest.mark.parametrize(
    ("x", "period", "answer"),
    [
        ([-179.0, 179.0], 360.0, True),
        ([10.0, 12.0], 360.0, False),
        ([10.0, 12.0], 0.0, False),
        ([0.0, 100.0], 360.0, True),
    ],
)
def test_a_seam_is_looked_for_only_where_one_may_be(x: list[float], period: float, answer: bool) -> None:
    assert may_cross_seam(np.array(x), period) == answer


def test_large_angles_have_the_sine_of_all_angles() -> None:
    """A bond of elements that turned far, in one block with others that did not."""
    el, bonds, made, count = loaded(5, 4)
    el.rotation[bonds.second[made.bond_ids[0]]] += 2.5
    show(made, el)
    block, ends, _ = parts(made, 0, el.mass.size)
    tile_kernels.gather_second_ends(made.scratch, made.second_end[: tile.LANES], made.ends)
    tile_kernels.sines(block, made.scratch, ends, False)
    angle = ends[tile.ANGLE : tile.ANGLE + tile.LANES] - made.scratch[tile.ANGLE : tile.ANGLE + tile.LANES]
    there = made.bond_ids[: tile.LANES] >= 0
    assert np.abs(angle[there]).max() > 2.0
    np.testing.assert_allclose(
        made.scratch[tile.SINE : tile.SINE + tile.LANES][there], np.sin(angle[there]), rtol=1e-13
    )
    assert count


LOOPS: dict[str, tuple[int, tuple[str, ...], tuple[Any, ...]]] = {
    "find_sections": (15, ("bond", "shape", "scratch", "ends"), (True, False, 6.37e6)),
    "sines": (60, ("bond", "scratch", "ends"), (False,)),
    "forces": (40, ("bond", "shape", "scratch", "ends"), (10.0, 0.3, True, False)),
    "accumulate_first_ends": (3, ("bond", "scratch", "sums"), ()),
    "kick_tile": (20, ("elem", "ends", "scratch"), (10.0, True)),
    "drift_tile": (30, ("elem", "ends", "rotation"), (10.0, True, 6.37e6, False)),
}
"""Loops that must be vector code: the least number of packed instructions, arrays, and other arguments."""


@pytest.mark.quick(2)
@pytest.mark.compiled
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads the machine code of x86-64")
@pytest.mark.parametrize("name", LOOPS)
def test_the_loops_of_the_sub_steps_are_vector_code(name: str) -> None:
    """A branch, a call or an index that may be negative turns them into scalar code, several times as slow, without a word."""
    least, arrays, arguments = LOOPS[name]
    el, _, made, _ = loaded(5, 4)
    block, _, sums = parts(made, 0, el.mass.size)
    given = {
        "bond": block,
        "shape": shapes(made, 0),
        "scratch": made.scratch,
        "ends": made.ends,
        "sums": sums,
        "elem": made.elem,
        "rotation": made.rotation,
    }
    loop = getattr(tile_kernels, name)
    again = numba.njit(error_model="numpy")(loop.py_func)  # machine code from a cache cannot be read
    again(*(given[array] for array in arrays), *arguments)
    (code,) = again.inspect_asm().values()
    packed, scalar = (len(re.findall(rf"\sv?(?:mul|add|sub|div|sqrt){kind}\s", code)) for kind in ("pd", "sd"))
    # The scalar loop for arrays that overlap, which these do not, may stand beside it.
    assert packed >= least
    assert packed > 0.8 * scalar
