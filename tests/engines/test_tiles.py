"""Long steps of bergs that fill several tiles: as the twin has them, whatever bonds are there, and by vector code."""

from __future__ import annotations

import platform
import re
from typing import Any

import numba
import numpy as np
import pytest

from engines.lattices import lattice, long_step, settings
from engines.test_twins import BOND, DEM_FLOOR, FAST, compare
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.explicit import tile_kernels
from riftberg.engines.explicit.tiles import LANES, allocate_tiles, pack_bonds
from twins import stepping as twin
from twins.elements import unpack

SETTINGS = settings()
P = SETTINGS.kernel_values()


def broken(el: Any, bonds: Any, rows: Any) -> None:
    """Break some bonds before the step."""
    bonds.status[rows] = 2
    for end in (bonds.first, bonds.second):
        np.subtract.at(el.bond_count, end[rows], 1)


def assert_twin(el: Any, bonds: Any, p: Any = SETTINGS) -> None:
    """Take a long step of two sub-steps beside the twin."""
    want, want_bonds, _, _ = twin.multiple_step(unpack(el), unpack(bonds), p.kernel_values(), 40.0, 2)
    before, gone = bonds.copy(), bonds.status != 0
    long_step(el, bonds, p, 40.0, 2)
    compare(el, want, FAST, rtol=1e-11, floor=DEM_FLOOR)
    if bonds.first.size:
        intact = [twin_bond for twin_bond, away in zip(want_bonds, gone, strict=True) if not away]
        compare(bonds.taken(np.flatnonzero(~gone)), intact, (*BOND, "relative_rotation"), rtol=1e-10)
    for name in (*BOND, "relative_rotation"):  # what they bore when they broke
        np.testing.assert_array_equal(getattr(bonds, name)[gone], getattr(before, name)[gone])


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("columns", "rows", "gone"), [(3, 2, (0, 4)), (5, 4, (3, 11)), (9, 8, (7,)), (40, 3, (7, 100)), (40, 3, ())]
)
def test_bergs_of_several_tiles_equal_the_twin(columns: int, rows: int, gone: tuple[int, ...]) -> None:
    """Each unbroken bond acts once on both of its ends, those that are gone on none."""
    el, bonds = lattice(3, P, columns=columns, rows=rows)
    broken(el, bonds, list(gone))
    assert_twin(el, bonds)


def test_a_berg_whose_elements_in_a_row_are_parted_equals_the_twin() -> None:
    """No element has a bond to the next one: the first layer of bonds is empty."""
    el, bonds = lattice(3, P, columns=5, rows=5)
    broken(el, bonds, np.flatnonzero(abs(bonds.second - bonds.first) == 1))
    assert_twin(el, bonds)


def test_ice_of_one_thickness_but_for_one_element_equals_the_twin() -> None:
    """Bonds alike share their shapes; one thin element gives those of its bonds to its tiles alone."""
    el, bonds = lattice(3, P, columns=40, rows=3)
    for same in (el.length, el.width, el.thickness, el.mass, bonds.rest_length):
        same[:] = same[0]
    shapes = []
    for thickness in (el.thickness[0], 120.0):
        el.thickness[70] = thickness
        assert_twin(el.copy(), bonds.copy())
        tiles = allocate_tiles(el, bonds)
        count = pack_bonds(tiles, el, bonds, interaction_sizes(el, P), np.arange(el.size), P)
        shapes.append(np.unique(tiles.shape_of[tiles.in_use[:count]]).size)
    assert shapes[0] == tiles.layers < shapes[1] < tiles.shape_of.size


def test_an_element_that_turned_far_equals_the_twin() -> None:
    """Large angles have the sine of all angles, in one tile with others that are small."""
    p = settings(bonds={"linear_bending": False})
    el, bonds = lattice(3, p.kernel_values(), columns=5, rows=4)
    el.rotation[bonds.second[0]] += 2.5
    assert_twin(el, bonds, p)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_of_the_bonds_does_not_matter(seed: int) -> None:
    """Each element sums over its bonds in the order of the elements, not of the list."""
    el, bonds = lattice(3, P, columns=7, rows=6)
    shuffled = bonds.taken(np.random.default_rng(seed).permutation(bonds.first.size))
    ends = []
    for each in (bonds, shuffled):
        moved = el.copy()
        long_step(moved, each, SETTINGS, 40.0, 2)
        ends.append(moved)
    for name in FAST:
        one, other = getattr(ends[0], name), getattr(ends[1], name)
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-12 * np.abs(one).max(), err_msg=name)


def test_bergs_without_bonds_equal_the_twin_and_have_no_tiles() -> None:
    """Fifty thousand of them would take 9 MB, and be gone through in each long step."""
    el, bonds = lattice(3, P, columns=5, rows=4)
    none = bonds.taken(np.zeros(0, np.int64))
    el.bond_count[:] = 0
    assert allocate_tiles(el, none).bond_ids.size == 0
    assert_twin(el, none)


@pytest.mark.parametrize("west", [-0.05, 0.02, 179.95])
def test_a_berg_across_a_seam_is_stepped_as_elsewhere(west: float) -> None:
    """A seam is looked for only where one may be: longitudes of a berg across it differ by 360 degrees."""
    el, bonds = lattice(3, P, columns=5, rows=4)
    there, bonds_there = el.copy(), bonds.copy()
    for lon in (there.lon, there.lon_pair):
        lon[:] = (lon - el.lon.min() + west + 180.0) % 360.0 - 180.0
    long_step(el, bonds, SETTINGS, 40.0, 2)
    long_step(there, bonds_there, SETTINGS, 40.0, 2)
    for name in ("u", "v", "spin", "ax_fast", "ay_fast"):
        size = np.abs(getattr(el, name)).max()
        np.testing.assert_allclose(getattr(there, name), getattr(el, name), rtol=0, atol=1e-7 * size, err_msg=name)


@pytest.mark.compiled
def test_sub_steps_at_once_are_those_one_after_the_other() -> None:
    """To the last bit, with bonds that break in several of them, and contact from then on."""
    weak = {"enabled": True, "broken_as_contact": True, "normal_strength": 120e3, "shear_strength": 60e3}
    p = settings(fracture=weak)
    begin, whole = lattice(3, p.kernel_values(), columns=40, rows=5, touching=False, speed=0.02, strain=1e-4)
    early, late = whole.first < 2 * LANES, whole.first >= 4 * LANES

    def stepped(strength: np.ndarray, at_once: int, starting: bool = False) -> tuple[Any, Any]:
        el, bonds = begin.copy(), whole.copy()
        bonds.strength[:] = strength
        broken = long_step(el, bonds, p, 300.0, 15, starting=starting, may_break=True, at_once=at_once)
        assert broken == np.isfinite(bonds.break_time).sum() == (bonds.status != 0).sum()
        return el, bonds

    # Bonds that alone, and this strong, break from the second sub-step to the sixth: at the end of a tile, next to which
    # others begin that the sub-steps have still to come to.
    soon = []
    for b in np.flatnonzero(early & (whole.first % LANES == LANES - 1)):
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
        for at_once in (3, None):
            for one_by_one, together in zip((el, bonds), stepped(strength, at_once, draw % 2 == 0), strict=True):
                for name, values in one_by_one.arrays().items():
                    np.testing.assert_array_equal(together.arrays()[name], values, err_msg=name)
        times = bonds.break_time
        many += np.unique(times[np.isfinite(times)]).size > 2
        turned += np.nanmin(times[late], initial=np.inf) < np.nanmin(times[early], initial=np.inf) < 150.0
    assert many > 5
    assert turned > 5


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
    made = allocate_tiles(*lattice(3, P, columns=5, rows=4))
    given = {
        "bond": made.bond, "shape": made.shape, "scratch": made.scratch, "ends": made.ends, "sums": made.sums,
        "elem": made.elem, "rotation": made.rotation,
    }  # fmt: skip
    loop = getattr(tile_kernels, name)
    again = numba.njit(error_model="numpy")(loop.py_func)  # machine code from a cache cannot be read
    again(*(given[array] for array in arrays), *arguments)
    (code,) = again.inspect_asm().values()
    packed, scalar = (len(re.findall(rf"\sv?(?:mul|add|sub|div|sqrt){kind}\s", code)) for kind in ("pd", "sd"))
    # The scalar loop for arrays that overlap, which these do not, may stand beside it.
    assert packed >= least
    assert packed > 0.8 * scalar
