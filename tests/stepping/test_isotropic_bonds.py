"""Bonds of explicit schemes that make an isotropic solid: its moduli by the stress inside of a lattice, and its diagonals."""

from __future__ import annotations

import math
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.errors import InputError
from riftberg.ocean.analytic import Steady
from riftberg.parameters import A68A_2022_KID, Parameters
from riftberg.physics.bonds import beam_parts, isotropic_parts
from riftberg.runs.model import Model
from riftberg.state import Bonds
from riftberg.stepping.contact.broad_phase import NeighbourSearch
from riftberg.stepping.explicit import tile_kernels
from riftberg.stepping.explicit import tiles as tile
from riftberg.stepping.explicit.beams import pack_elements
from riftberg.stepping.explicit.breaking import record_breaks
from riftberg.stepping.explicit.stability import SubstepMatrix
from riftberg.stepping.explicit.substeps import allocate_workspace
from riftberg.stepping.forces.pair_law import BONDED, pair_law, pair_terms
from riftberg.stepping.forces.sizes import interaction_sizes
from riftberg.stepping.lattice.diagonals import find_diagonals, holds

RADIUS, THICKNESS, E, SMALL = 500.0, 200.0, 5e6, 1e-7
PACKINGS = ("square", "hexagonal")
ANGLES = (0.0, 15.0, 22.5, 30.0, 45.0)


def isotropic(packing: str, poisson: float = 0.3, **bonds) -> Parameters:
    groups = {"elasticity": "isotropic", "packing": packing, "poisson": poisson, "youngs_modulus": E, **bonds}
    return Parameters(
        bonds=groups,
        stepping={"scheme": "mts", "only_interactions": True},
        fracture={"enabled": False},
        earth={"latlon": False, "period": 0.0},
    )


def berg_of(packing: str, side: int = 7) -> Iceberg:
    length = 2 * RADIUS * side
    return Iceberg.rectangle(length, length, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False)


def strain_of(along: float, across: float, angle: float) -> np.ndarray:
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag([along, across]) @ turn.T


def strained(berg: Iceberg, strain: np.ndarray, p: Parameters) -> SimpleNamespace:
    """Forces of bonds and diagonals on the first of both ends under a uniform strain, elements turning with the ice."""
    el, bonds, k = berg.elements.copy(), berg.bonds.copy(), p.kernel_values()
    sizes = interaction_sizes(el, k)
    x = np.column_stack([el.lon, el.lat])
    bonds.rest_length[:] = np.hypot(*(x[bonds.first] - x[bonds.second]).T)
    work = allocate_workspace(el, bonds, k)
    n = (x[bonds.first] - x[bonds.second]) / bonds.rest_length[:, None]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    slip = np.einsum("bi,ij,bj->b", t, strain, n) * bonds.rest_length
    bonds.shear_x[:], bonds.shear_y[:] = slip * t[:, 0], slip * t[:, 1]
    moved = x + x @ strain.T
    el.lon[:], el.lat[:] = moved.T
    el.lon_pair[:], el.lat_pair[:] = moved.T
    tiles = work.tiles
    count = tile_kernels_applied(tiles, el, bonds, sizes, k, work.fields)
    at = [r for r in range(tiles.bond_ids.size) if tiles.bond_ids[r] != tile.EMPTY]
    first = np.array([element_of(r, tiles) for r in at])
    second = np.array([int(np.flatnonzero(tile_ends(el.size) == tiles.second_end[r])[0]) for r in at])
    force = np.array([[tiles.bond[tile.bond_offset(r) + of] for of in (tile.FX, tile.FY)] for r in at])
    return SimpleNamespace(x=x, first=first, second=second, force=force, el=el, bonds=bonds, count=count, tiles=tiles)


def element_of(lane: int, tiles: tile.BondTiles) -> int:
    """Element at which the bond of a lane begins."""
    return lane // tile.LANES // len(tiles.kinds) * tile.LANES + lane % tile.LANES


def tile_ends(count: int) -> np.ndarray:
    return np.array([tile.end_offset(e) for e in range(count)])


def tile_kernels_applied(tiles, el, bonds, sizes, k, fields) -> int:
    count = tile.pack_bonds(tiles, el, bonds, sizes, np.arange(el.size), k)
    pack_elements(tiles, el, fields)
    layers = len(tiles.kinds)
    for b in tiles.in_use[:count]:
        bond = tiles.bond[b * tile.BOND_TILE : (b + 1) * tile.BOND_TILE]
        shape = tiles.shape[tiles.shape_of[b] : tiles.shape_of[b] + tile.SHAPE_TILE]
        ends = tiles.ends[b // layers * tile.END_TILE : (b // layers + 1) * tile.END_TILE]
        tile_kernels.gather_second_ends(
            tiles.scratch, tiles.second_end[b * tile.LANES : (b + 1) * tile.LANES], tiles.ends
        )
        tile_kernels.apply_bond_law(bond, shape, tiles.scratch, ends, tiles.kinds[b % layers], 0.0, k, 0.0)
    return count


def inner_stress(x, first, second, force, volume: float) -> np.ndarray:
    """Stress (Pa) of the element in the middle: ``sum r F / 2 V`` over its bonds and diagonals."""
    e = int(np.argmin(np.hypot(*(x - x.mean(axis=0)).T)))
    stress = np.zeros((2, 2))
    for i, j, pull in zip(first, second, force, strict=True):
        if e in (i, j):
            stress += 0.5 * np.outer(x[j] - x[i], pull) / volume
    return stress


def check_solid(stress_under, poisson: float) -> None:
    """Hooke's law in plane stress under tension along and across, turned by five angles: E, nu and G within 1 %."""
    plane = E / (1.0 - poisson**2)
    for angle in ANGLES:
        for along, across in ((SMALL, 0.0), (SMALL, -SMALL), (SMALL, -poisson * SMALL)):
            expected = strain_of(plane * (along + poisson * across), plane * (across + poisson * along), angle)
            stress = stress_under(strain_of(along, across, angle))
            assert abs(stress - expected).max() < 1e-4 * abs(expected).max(), (angle, along, across)


@pytest.mark.parametrize("poisson", [0.0, 0.2, 0.3, 0.333])
@pytest.mark.parametrize("packing", PACKINGS)
def test_lattice_is_the_solid_that_is_asked_for(packing: str, poisson: float) -> None:
    berg, p = berg_of(packing), isotropic(packing, poisson)
    volume = float(berg.elements.length[0] * berg.elements.width[0]) * THICKNESS

    def stress(strain: np.ndarray) -> np.ndarray:
        found = strained(berg, strain, p)
        return inner_stress(found.x, found.first, found.second, found.force, volume)

    check_solid(stress, poisson)


@pytest.mark.parametrize("packing", PACKINGS)
def test_springs_between_centres_are_a_solid_too(packing: str) -> None:
    berg, p = berg_of(packing), isotropic(packing, 0.3333, law="spring")
    el, bonds, k = berg.elements, berg.bonds, p.kernel_values()
    x = np.column_stack([el.lon, el.lat])
    bonds.rest_length[:] = np.hypot(*(x[bonds.first] - x[bonds.second]).T)
    partners, rest = NeighbourSearch().springs(el, bonds, k)
    owner = np.repeat(np.arange(el.size), np.diff(partners.start))
    volume, law = float(el.length[0] * el.width[0]) * THICKNESS, pair_law(k)

    def stress(strain: np.ndarray) -> np.ndarray:
        moved = x + x @ strain.T
        force = []
        for i, j, length in zip(owner, partners.partner, rest, strict=True):
            away = moved[i] - moved[j]
            force.append(np.array(pair_terms(BONDED, *away, length, 1.0, 0.0, 0.0, 0.0, 0.0, law)[:2]) * el.mass[i])
        of_first = owner < partners.partner
        return inner_stress(x, owner[of_first], partners.partner[of_first], np.array(force)[of_first], volume)

    check_solid(stress, 1.0 / 3.0)


@pytest.mark.parametrize("packing", PACKINGS)
def test_published_bonds_are_no_such_solid(packing: str) -> None:
    """As a check of the check; they keep the stiffness that they have."""
    berg, p = berg_of(packing), isotropic(packing).changed(bonds={"elasticity": "bonds"})
    volume = float(berg.elements.length[0] * berg.elements.width[0]) * THICKNESS

    def stress(strain: np.ndarray) -> np.ndarray:
        found = strained(berg, strain, p)
        return inner_stress(found.x, found.first, found.second, found.force, volume)

    shear = stress(strain_of(SMALL, -SMALL, 45.0))[0, 1] / (2.0 * SMALL)
    assert shear == pytest.approx((0.5 if packing == "square" else 0.25 * math.sqrt(3.0) * 3.6) * E / 2.6, rel=1e-4)
    with pytest.raises(AssertionError):
        check_solid(stress, 0.3)


@pytest.mark.parametrize("packing", PACKINGS)
def test_ends_of_bonds_may_be_swapped(packing: str) -> None:
    berg, p, strain = berg_of(packing), isotropic(packing), strain_of(SMALL, -0.4 * SMALL, 20.0)
    swapped = berg_of(packing)
    random = np.random.default_rng(7).random(berg.bonds.first.size) < 0.5
    ends = swapped.bonds.first[random].copy()
    swapped.bonds.first[random], swapped.bonds.second[random] = swapped.bonds.second[random], ends
    loads = []
    for one in (berg, swapped):
        found, load = strained(one, strain, p), np.zeros((berg.elements.size, 2))
        np.add.at(load, found.first, found.force)
        np.add.at(load, found.second, -found.force)
        loads.append(load)
    assert abs(loads[0] - loads[1]).max() < 1e-9 * abs(loads[0]).max()


def test_parts_are_those_of_plane_stress() -> None:
    """Written anew with C11, C12 and C66 of both lattices, and no part is negative where Poisson's ratio is allowed."""
    for nu in (0.0, 0.1, 0.25, 1.0 / 3.0):
        row, shear, facet = isotropic_parts(4, False, nu)
        diagonal, none, nothing = isotropic_parts(4, True, nu)
        assert row + diagonal == pytest.approx(1.0 / (1.0 - nu**2), rel=1e-13)
        assert diagonal == pytest.approx(nu / (1.0 - nu**2), rel=1e-13)
        assert 0.5 * shear + diagonal == pytest.approx(0.5 / (1.0 + nu), rel=1e-13)
        assert (none, nothing, facet) == (0.0, 0.0, 1.0)
        normal, slide, side = isotropic_parts(6, False, nu)
        ratio = slide / normal
        assert 2.0 * math.sqrt(3.0) * normal * (1.0 + ratio) / (3.0 + ratio) == pytest.approx(1.0, rel=1e-13)
        assert (1.0 - ratio) / (3.0 + ratio) == pytest.approx(nu, abs=1e-13)
        assert side == pytest.approx(1.0 / math.sqrt(3.0), rel=1e-13)
        assert min(row, shear, diagonal, normal, slide) >= -1e-15
    assert beam_parts(0.25) == (1.0, 0.4, 1.0)


def test_stress_is_that_of_the_ice() -> None:
    """Tension along the rows, and shear, which a facet that slips by half of it feels whole."""
    # Rows of squares lie along x, those of hexagons along y.
    for packing, rows in zip(PACKINGS, (0.0, 90.0), strict=True):
        berg, p = berg_of(packing), isotropic(packing)
        for strain, name, expected in (
            (strain_of(SMALL, -0.3 * SMALL, rows), tile.NORMAL_STRESS, E * SMALL),
            (strain_of(SMALL, -SMALL, 45.0), tile.SHEAR_STRESS, 2.0 * SMALL * E / 2.6),
        ):
            found = strained(berg, strain, p)
            tiles, k, largest = found.tiles, p.kernel_values(), 0.0
            layers = len(tiles.kinds)
            for b in tiles.in_use[: found.count]:
                bond = tiles.bond[b * tile.BOND_TILE : (b + 1) * tile.BOND_TILE]
                shape = tiles.shape[tiles.shape_of[b] : tiles.shape_of[b] + tile.SHAPE_TILE]
                ends = tiles.ends[b // layers * tile.END_TILE : (b // layers + 1) * tile.END_TILE]
                tile_kernels.gather_second_ends(
                    tiles.scratch, tiles.second_end[b * tile.LANES : (b + 1) * tile.LANES], tiles.ends
                )
                tile_kernels.apply_bond_law(bond, shape, tiles.scratch, ends, tiles.kinds[b % layers], 0.0, k, 0.0)
                bonded = tiles.bond_ids[b * tile.LANES : (b + 1) * tile.LANES] >= 0
                largest = max(largest, float(tiles.scratch[name : name + tile.LANES][bonded].max(initial=0.0)))
            assert largest == pytest.approx(expected, rel=1e-4)


def plate(columns: int, rows: int) -> Iceberg:
    size = 2 * RADIUS * columns, 2 * RADIUS * rows
    return Iceberg.rectangle(*size, thickness=THICKNESS, radius=RADIUS, latlon=False)


def crossing(bonds: Bonds, el, at: float) -> np.ndarray:
    """Bonds that cross the line x = ``at``."""
    return np.flatnonzero((el.lon[bonds.first] < at) != (el.lon[bonds.second] < at))


def test_diagonals_hold_as_long_as_a_way_around_the_corner_is_left() -> None:
    berg, k = plate(2, 2), isotropic("square").kernel_values()
    el, bonds = berg.elements, berg.bonds
    whole = find_diagonals(el, bonds, k)
    assert sorted(zip(whole.first.tolist(), whole.second.tolist(), strict=True)) == [(0, 3), (1, 2)]
    for broken, left in (((0,), 2), ((0, 1), 1), ((0, 3), None)):
        status = bonds.status.copy()
        status[list(broken)] = 1
        held = sum(holds(whole.way, d, status) for d in range(2))
        apart = set(bonds.first[list(broken)]) & set(bonds.second[list(broken)]) or {
            *bonds.first[list(broken)].tolist(), *bonds.second[list(broken)].tolist()
        }  # fmt: skip
        expected = left if left is not None else (0 if len(apart) == 4 else 1)
        assert held == expected
    cut = bonds.status.copy()
    cut[crossing(bonds, el, float(el.lon.mean()))] = 1
    assert not any(holds(whole.way, d, cut) for d in range(2))


def test_a_cut_frees_the_diagonals_across_it_at_once_and_for_good() -> None:
    berg, k = plate(6, 4), isotropic("square").kernel_values()
    el, bonds = berg.elements, berg.bonds
    work = allocate_workspace(el, bonds, k)
    tile_kernels_applied(work.tiles, el, bonds, interaction_sizes(el, k), k, work.fields)
    middle = float(el.lon.mean())
    cut = crossing(bonds, el, middle)
    bonds.status[cut], bonds.break_time[cut] = 1, 5.0
    record_breaks(work.tiles, bonds, el.body.bond_count, work.pairs, 5.0, False)
    for now in ("at once", "in the next step"):
        left = [
            r for r in range(work.tiles.bond_ids.size)
            if work.tiles.bond_ids[r] < tile.EMPTY and work.tiles.bond[tile.bond_offset(r) + tile.INTACT] > 0.0
        ]  # fmt: skip
        assert len(left) == 2 * (2 * 2 * 3), now
        for r in left:
            d = tile.diagonal_of(work.tiles.bond_ids[r])
            assert (el.lon[element_of(r, work.tiles)] < middle) == (el.lon[work.tiles.diagonals.second[d]] < middle)
        tile_kernels_applied(work.tiles, el, bonds, interaction_sizes(el, k), k, work.fields)
    again = find_diagonals(el, bonds, k)
    assert again.first.size == len(left)


@pytest.mark.parametrize("part", [0.0, 0.2, 0.6, 1.0])
def test_diagonals_are_those_that_a_walk_around_each_element_finds(part: float) -> None:
    """The plain twin goes from one unbroken bond of an element to the next; a corner that is left on one side has one way."""
    berg, k, random = plate(9, 7), isotropic("square").kernel_values(), np.random.default_rng(3)
    el, bonds = berg.elements, berg.bonds
    bonds.status[random.random(bonds.status.size) < part] = 1
    ways: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for e in range(el.size):
        own = [b for b in range(bonds.status.size) if bonds.status[b] == 0 and e in (bonds.first[b], bonds.second[b])]
        ends = [(int(bonds.first[b] + bonds.second[b]) - e, b) for b in own]
        for (a, along), (c, on) in combinations(sorted(ends), 2):
            one, two = (np.array([el.lon[n] - el.lon[e], el.lat[n] - el.lat[e]]) for n in (a, c))
            if abs(one @ two) < 0.5 * np.hypot(*one) * np.hypot(*two):
                ways.setdefault((a, c), []).append((along, on))
    found = find_diagonals(el, bonds, k)
    assert list(zip(found.first.tolist(), found.second.tolist(), strict=True)) == sorted(ways)
    assert found.way.tolist() == [[*map(list, ways[pair]), [-1, -1]][:2] for pair in sorted(ways)]


def test_no_diagonals_for_hexagons_and_published_bonds() -> None:
    el, bonds = berg_of("hexagonal").elements, berg_of("hexagonal").bonds
    assert find_diagonals(el, bonds, isotropic("hexagonal").kernel_values()).first.size == 0
    square = plate(3, 3)
    as_published = isotropic("square").changed(bonds={"elasticity": "bonds"}).kernel_values()
    assert find_diagonals(square.elements, square.bonds, as_published).first.size == 0


@pytest.mark.parametrize("packing", PACKINGS)
def test_substep_knows_the_stiffness(packing: str) -> None:
    """The matrix of the sub-step has three zero modes, and its stiffness gives the energy of a uniform strain."""
    p, berg = isotropic(packing, damping=0.0), berg_of(packing)
    el, bonds, count = berg.elements, berg.bonds, berg.elements.size
    sizes = interaction_sizes(el, p.kernel_values())
    x = np.column_stack([el.lon, el.lat])
    bonds.rest_length[:] = np.hypot(*(x[bonds.first] - x[bonds.second]).T)
    matrix = SubstepMatrix(p, el, bonds, sizes)
    springs = 2.0 * np.array([matrix @ one for one in np.eye(matrix.size)])[: -3 * count, -3 * count :]
    weight = np.sqrt(sizes.bond_mass)
    strain = strain_of(SMALL, -0.4 * SMALL, 25.0)
    u = x @ strain.T
    motion = np.concatenate([weight * u[:, 0], weight * u[:, 1], np.zeros(count)])
    energy = 0.5 * float(((springs @ motion) ** 2).sum())
    found = strained(berg, strain, p)
    away = (
        found.el.lon[found.first] - found.el.lon[found.second],
        found.el.lat[found.first] - found.el.lat[found.second],
    )
    moved = np.column_stack(away) - (x[found.first] - x[found.second])
    assert energy == pytest.approx(-0.5 * float((found.force * moved).sum()), rel=1e-5)


@pytest.mark.parametrize("packing", PACKINGS)
def test_the_ledger_knows_their_energy(packing: str) -> None:
    """Without dampers, motion and bonds hold as much as at the start, whatever swings between them."""
    p = isotropic(packing, 0.2, damping=0.0, linear_bending=True).changed(stepping={"safety": 0.2, "time_step": 60.0})
    model, rng = Model(berg_of(packing, 4), Steady(), p), np.random.default_rng(5)
    model.elements.u[:] = 0.1 * rng.standard_normal(model.elements.size)
    model.elements.spin[:] = 5e-5 * rng.standard_normal(model.elements.size)
    held, elastic = [], []
    for _ in range(25):
        model.step()
        b = model.motion.balance(model, model.remembered)
        held.append(b.kinetic_now + b.elastic_now)
        elastic.append(b.elastic_now / held[-1])
    assert min(elastic) > 0.2
    assert np.ptp(held) < 0.04 * np.mean(held)


@pytest.mark.parametrize(("scheme", "law"), [("mts", "dem"), ("verlet", "spring")])
def test_a_cracked_lattice_goes_on_from_a_restart_bit_for_bit(scheme: str, law: str, tmp_path) -> None:
    """Bug: a diagonal around a corner with a broken side was as long as the way that was left only after a restart."""
    p = Parameters(
        bonds={"law": law, "youngs_modulus": E}, fracture={"enabled": False},
        stepping={"scheme": scheme, "time_step": 5.0},
    )  # fmt: skip
    berg, around = (
        Iceberg.rectangle(4e3, 3e3, thickness=THICKNESS, radius=RADIUS, placement=(-37.0, -56.0)),
        Steady(current=(0.3, 0.1)),
    )
    run = Model(berg, around, p)
    # Both ways around a corner are not equally long, and one of them breaks under way.
    run.bonds.rest_length[:] *= 1.0 + 1e-3 * np.random.default_rng(2).random(run.bonds.first.size)
    run.advance(steps=1)
    run.bonds.status[crossing(run.bonds, run.elements, float(run.elements.lon.mean()))[:2]] = 1
    run.advance(steps=1)
    again = Model.resume(run.save(tmp_path / "cracked.nc"), around)
    for model in (run, again):
        model.advance(steps=3)
    for mine, theirs in ((run.elements, again.elements), (run.bonds, again.bonds)):
        for name, values in mine.arrays().items():
            np.testing.assert_array_equal(values, getattr(theirs, name), err_msg=name)


@pytest.mark.parametrize(
    ("groups", "says"),
    [
        ({"bonds": {"poisson": 0.34}}, r"bonds.poisson = 0.34 .*from 0 to 0.3333"),
        ({"bonds": {"poisson": -0.1}}, r"bonds.poisson = -0.1 .*from 0 to 0.3333"),
        ({"bonds": {"poisson": 0.4, "packing": "hexagonal"}}, r"bonds.poisson = 0.4 .*above -1 and up to 0.3333"),
        ({"bonds": {"law": "spring", "spring": 1e-4}}, "leave out bonds.spring"),
        ({"bonds": {"no_shear": True}}, "needs bonds with shear"),
        ({"stepping": {"scheme": "quasi_static"}}, "bonds.elasticity = 'cells'"),
        ({"compatibility": A68A_2022_KID.compatibility.model_dump()}, "the bonds that the reference has"),
    ],
)
def test_what_the_lattice_cannot_be_is_refused_by_name(groups, says: str) -> None:
    with pytest.raises(InputError, match=says):
        isotropic("square").changed(**groups)


@pytest.mark.parametrize(
    ("scheme", "law"), [("mts", "dem"), ("mts", "spring"), ("verlet", "spring"), ("runge_kutta", "spring")]
)
def test_every_explicit_scheme_drifts_with_them(scheme: str, law: str) -> None:
    """A berg that moves and turns as one body is not strained by its diagonals."""
    p = isotropic("square", 0.3333, law=law).changed(
        stepping={"scheme": scheme, "only_interactions": False, "time_step": 4.0}, drag={"rotational": False}
    )
    berg = plate(4, 3)
    model = Model(berg, Steady(current=(0.3, 0.1)), p)
    before = np.hypot(*(np.subtract.outer(v, v) for v in (model.elements.lon, model.elements.lat)))
    model.advance(steps=20)
    el = model.elements
    after = np.hypot(*(np.subtract.outer(v, v) for v in (el.lon, el.lat)))
    assert np.hypot(el.u, el.v).min() > 0.0
    assert abs(after - before).max() < 0.01


def test_diagonals_pull_as_the_law_of_all_bonds_says() -> None:
    """Bit for bit: their tiles leave out what is 0 for them, slip, bending and dampers; a lane without a bond bears nothing."""
    rng = np.random.default_rng(4)
    sizes = (tile.BOND_TILE, tile.SHAPE_TILE, tile.SCRATCH_TILE, tile.END_TILE)
    bond, shape, scratch, ends = (rng.uniform(0.5, 1.5, size) for size in sizes)
    lanes = slice(0, tile.LANES)
    shape[tile.DAMPING :][lanes], bond[tile.SLIP :][lanes] = 0.0, 0.0
    bond[tile.INTACT :][lanes] = np.arange(tile.LANES) != 7
    scratch[tile.HALF :][lanes] *= rng.choice([-1.0, 1.0], tile.LANES)
    shape[tile.MODULUS + 7] = np.nan
    kind = np.array(tile.bond_kind(4, True, isotropic("square").kernel_values()))
    assert kind[1:].tolist() == [0.0, 0.0, 0.0]
    every, few = (bond.copy(), shape, scratch.copy()), (bond.copy(), shape, scratch.copy())
    tile_kernels.forces(*every, ends, kind, 10.0, 0.3, True, False, True)
    tile_kernels.pull_diagonals(*few)
    for table, quantity in ((0, tile.FX), (0, tile.FY), (0, tile.TORQUE2), (2, tile.TORQUE1)):
        np.testing.assert_array_equal(every[table][quantity:][lanes], few[table][quantity:][lanes])
    assert abs(few[0][tile.FX :][lanes]).max() > 0.1
    assert few[0][tile.FX + 7] == 0.0
