"""Faces of a crack inside one fragment that close again: pressure as in whole ice, and no tension."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engines.test_elastic_cells import dense_matrix
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.engines.quasi_static.lattice.triangles import (
    ClosingFaces,
    find_gap_shares,
    find_open_edges,
    find_triangles,
)
from verification.plates import RADIUS, SPACING, THICKNESS, Plate
from verification.test_crack_lines import QUICK

LENGTH, WIDTH = 36e3, 12e3


def bar(packing: str, angle: float, *, depth: float = 0.5) -> Plate:
    """A bar of 24 x 8 cells with a crack from one side to a part of its width."""
    berg = Iceberg.rectangle(
        LENGTH, WIDTH, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle
    )
    if depth > 0.0:
        line = [(0.21 * SPACING, -0.6 * WIDTH), (0.21 * SPACING, (depth - 0.5) * WIDTH)]
        berg = berg.with_rifts([line], broken=True)
    return Plate(packing, angle, LENGTH, WIDTH, berg)


def pulled(plate: Plate, sign: float) -> tuple[np.ndarray, np.ndarray]:
    return sign * plate.el.mass * np.sin(np.pi * plate.x / LENGTH), np.zeros(plate.el.size)


def bent(plate: Plate, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Pushed northward (``sign`` 1) in the middle against the ends: then the side with the crack is in compression."""
    return np.zeros(plate.el.size), sign * plate.el.mass * np.cos(2.0 * np.pi * plate.x / LENGTH)


def stored_energy(plate: Plate) -> float:
    """Energy (J) under the same loads by the factors as they are corrected."""
    load = plate.memory.state.load
    return 0.5 * float((plate.now.displacements(load) * load).sum())


def energy(plate: Plate, load) -> tuple[float, np.ndarray]:
    """Stored energy (J), and which faces are closed."""
    moment = plate.under(*load)
    faces = plate.now.cells.faces.closed(plate.now.cells.displacements(moment.displacement))
    return 0.5 * float((moment.displacement * moment.load).sum()), faces


@pytest.mark.parametrize(("packing", "angle"), QUICK)
def test_a_cracked_bar_pressed_together_is_as_whole(packing, angle) -> None:
    """Half of its width is cracked: within 9 % of the whole bar when it is pressed, 2.4 to 4.3 times softer when pulled.

    What is left is the rim of half a cell along the outline, where faces do not close, and slip along turned facets.
    """
    whole, cracked = bar(packing, angle, depth=0.0), bar(packing, angle)
    pressed, closed = energy(cracked, pulled(cracked, -1.0))
    assert pressed / energy(whole, pulled(whole, -1.0))[0] == pytest.approx(1.045, abs=0.04)
    assert closed.all()
    apart, opened = energy(cracked, pulled(cracked, 1.0))
    assert 2.4 < apart / energy(whole, pulled(whole, 1.0))[0] < 4.4
    assert not opened.any()


@pytest.mark.parametrize(("packing", "angle"), QUICK)
def test_a_cracked_beam_bends_to_one_side_as_if_it_were_whole(packing, angle) -> None:
    whole, cracked = bar(packing, angle, depth=0.0), bar(packing, angle)
    of_whole = energy(whole, bent(whole, 1.0))[0]
    shut, closed = energy(cracked, bent(cracked, 1.0))
    gaping, opened = energy(cracked, bent(cracked, -1.0))
    assert shut / of_whole == pytest.approx(1.1, abs=0.08)
    assert gaping / of_whole > 2.7
    # All but those within half an element of the neutral axis, where the crack ends.
    assert closed[cracked.now.cells._middle[cracked.now.cells.faces.tables.row, 1] < -0.5 * SPACING].all()
    assert closed.sum() >= closed.size - 1
    assert not opened.any()
    # Faces that have closed bear pressure: as much as the same ice without a crack, less where the rim is open.
    stress = cracked.under(*pulled(cracked, -1.0)).triangle_stress
    row = cracked.now.cells.faces.tables.row
    assert (stress[row, 0] < 0.0).all()


@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("hexagonal", 0.0)])
def test_closing_is_nearer_to_whole_with_smaller_rims(packing, angle) -> None:
    """A crack that ends before the outline has no open rim: a pressed bar is whole within 0.5 % along the rows."""
    whole, cracked = bar(packing, angle, depth=0.0), bar(packing, angle, depth=0.0)
    b = cracked.bonds
    across = (cracked.x[b.first] - 0.21 * SPACING) * (cracked.x[b.second] - 0.21 * SPACING) < 0.0
    inside = abs(0.5 * (cracked.y[b.first] + cracked.y[b.second])) < 3.0 * SPACING
    b.status[across & inside] = 1
    cracked.refresh()
    assert energy(cracked, pulled(cracked, -1.0))[0] / energy(whole, pulled(whole, -1.0))[0] == pytest.approx(
        1.0, abs=0.005
    )
    assert energy(cracked, pulled(cracked, 1.0))[0] / energy(whole, pulled(whole, 1.0))[0] > 1.3


def broken_at_random(seed: int, packing: str) -> Plate:
    plate = bar(packing, 15.0, depth=0.0)
    rng = np.random.default_rng(seed)
    plate.bonds.status[rng.random(plate.bonds.first.size) < 0.15] = 1
    plate.refresh()
    return plate


@pytest.mark.quick(2)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("seed", range(3))
def test_open_faces_gape_and_closed_ones_press(seed, packing) -> None:
    """The solution of the convex problem: with those faces closed whose gap would be below 0 the ice is in equilibrium."""
    plate, rng = broken_at_random(seed, packing), np.random.default_rng(50 + seed)
    load = plate.el.mass * rng.normal(size=plate.el.size), plate.el.mass * rng.normal(size=plate.el.size)
    moment = plate.under(*load)
    cells = plate.now.cells
    faces, moved = cells.faces, cells.displacements(moment.displacement)
    closed = faces.closed(moved)
    assert 0 < closed.sum() < closed.size
    size = abs(moved[faces.at // 3, faces.at % 3]).max()
    # Stiffness as it is pressed, on these displacements, gives the loads.
    force = np.zeros((cells.topology.nodes, 3))
    force[: plate.el.size] = moment.load
    matrix = dense_matrix(cells)
    for k in np.flatnonzero(closed):
        matrix[np.ix_(faces.at[k], faces.at[k])] += np.outer(faces.columns[k], faces.columns[k])
    left = matrix @ moved.ravel() - force.ravel()
    assert abs(left.reshape(-1, 3)[:, :2]).max() < 1e-6 * abs(force[:, :2]).max()
    # Loads twice as large move all twice as far.
    twice = plate.under(2.0 * load[0], 2.0 * load[1])
    np.testing.assert_allclose(twice.displacement, 2.0 * moment.displacement, rtol=1e-7, atol=1e-9 * size)
    assert plate.now.update_rank == 0


@pytest.mark.quick(1)
@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_a_break_never_stores_energy(packing) -> None:
    """Bonds broken one by one under a load that presses some faces and opens others; downdates agree with fresh factors."""
    plate, rng = bar(packing, 22.5), np.random.default_rng(3)
    load = plate.el.mass * rng.normal(size=plate.el.size), plate.el.mass * rng.normal(size=plate.el.size)
    before, _ = energy(plate, load)
    assert before > 0.0
    for bond in rng.permutation(plate.now.intact)[:12]:
        plate.now.remove(int(bond))
        corrected = stored_energy(plate)
        plate.without(int(bond))
        fresh, _ = energy(plate, load)
        assert corrected == pytest.approx(fresh, rel=1e-9)
        assert fresh >= before * (1.0 - 1e-10)
        before = fresh


TRIANGLE = np.array([[[0.0, 0.0], [1.0, 0.1], [0.2, 0.9]]])


def closing(freed: list[bool], normal=(0.0, 0.0)) -> tuple[ClosingFaces, np.ndarray]:
    """One triangle of E = 2, nu = 0.3 and 1.7 m3, and the shares of its edges in the gap."""
    edges, at = np.array([freed]), np.arange(9)[None, :]
    across = find_gap_shares(TRIANGLE, edges, edges, np.broadcast_to(normal, (1, 3, 2)))
    return ClosingFaces(np.array([0]), at, TRIANGLE, edges, across, np.array([1.7]), 2.0, 0.3), across[0]


@pytest.mark.parametrize("freed", [[False, True, False], [False, True, True], [True, True, False]])
def test_a_closed_face_is_the_constrained_minimum_of_the_triangle(freed) -> None:
    """Against the energy with its inner unknowns written out: least energy with the gap held at 0."""
    faces, across = closing(freed)
    opened, edges = find_open_edges(TRIANGLE, np.array([freed]), 2.0, 0.3)
    whole = find_triangles(TRIANGLE, np.zeros((1, 3), bool), 2.0, 0.3)
    for move in np.random.default_rng(8).normal(size=(5, 9)):
        gap = across @ edges.gap[0] @ move
        # Half the energy per volume that closing takes: gap^2 over what a pull across the crack gives.
        extra = gap**2 / (across @ edges.give[0] @ across)
        assert (faces.columns[0] @ move) ** 2 == pytest.approx(1.7 * extra, rel=1e-12)
        assert faces.closed(move.reshape(3, 3))[0] == (gap < 0.0)
        # A face that is whole again, with its squares, is stiffer still.
        assert move @ opened.stiffness[0] @ move + extra <= move @ whole.stiffness[0] @ move + 1e-12
        # Open and closed are one where the gap is 0, in stress too.
        level = move - gap * faces.tables.gap[0] / (faces.tables.gap[0] @ faces.tables.gap[0])
        np.testing.assert_allclose(faces.tables.stress[0] @ level, opened.stress[0] @ level, atol=1e-12)


def test_faces_of_a_crack_slip_freely_along_it() -> None:
    """The vertex that a crack parts moves by w: the gap is n . w whatever the edges, so slip along the crack closes none."""
    for angle in (0.3, 0.8, 1.2):
        normal = np.array([np.cos(angle), np.sin(angle)])
        for sign in (1.0, -1.0):  # to either side of the crack
            faces, _ = closing([False, True, True], sign * normal)
            for w in (normal, 0.1 * normal + np.array([-normal[1], normal[0]]), np.array([-normal[1], normal[0]])):
                move = np.zeros(9)
                move[:2] = -w  # away from the other two, which lie north-east of it
                assert faces.tables.gap[0] @ move == pytest.approx(normal @ w, abs=1e-14)
    # Crossed at a slant to one edge, it presses there at most: no share is below 0, so no break stores energy.
    assert (closing([False, True, True], (0.2, -1.0))[1] >= 0.0).all()


@pytest.mark.parametrize(("packing", "angle"), [("hexagonal", 45.0), ("square", 15.0)])
def test_a_slanting_crack_that_gapes_locks_nowhere(packing, angle) -> None:
    """Its facets zigzag along the rows, and are no teeth; its normal is that of the line, whatever the bonds that it crosses."""
    whole = Iceberg.rectangle(
        LENGTH, WIDTH, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle
    )
    along = np.array([1.0, 1.0]) / np.sqrt(2.0)
    line = np.array([0.21 * SPACING, 0.13 * SPACING]) + np.array([[-2.5], [2.5]]) * SPACING * along
    plate = Plate(packing, angle, LENGTH, WIDTH, whole.with_rifts([line], broken=True))
    cells = plate.now.cells
    normals = cells.topology.crack_normals(plate.bonds)[cells.topology.bond_number[plate.bonds.status != 0]]
    assert len(normals) > 4
    np.testing.assert_allclose(abs(normals @ along), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.hypot(*normals.T), 1.0)
    through = (
        cells._freed[cells.faces.tables.row].sum(axis=1) == 2
    )  # the others lie around the tips, and have one edge free
    assert through.sum() > 6
    assert not energy(plate, pulled(plate, 1.0))[1][through].any()
    assert energy(plate, pulled(plate, -1.0))[1][through].mean() > 0.5


def test_no_faces_no_work() -> None:
    plate = bar("square", 0.0, depth=0.0)
    faces = plate.now.cells.faces
    assert isinstance(faces, ClosingFaces)
    assert faces.tables.row.size == 0


def test_a_pressed_crack_goes_on_from_a_restart_bit_for_bit(tmp_path) -> None:
    """A berg whose ends are held, with a crack from one side, in a current that bends it shut."""
    berg = Iceberg.rectangle(LENGTH, WIDTH, thickness=THICKNESS, radius=RADIUS, latlon=False)
    berg = berg.with_rifts([[(0.21 * SPACING, -0.6 * WIDTH), (0.21 * SPACING, 0.0)]], broken=True)
    berg.elements.static[abs(berg.elements.lon) > 0.45 * LENGTH] = 1.0
    parameters = Parameters(
        earth={"latlon": False, "period": 0.0}, fracture={"enabled": False}, stepping={"time_step": 600.0}
    )
    run = Model(berg, Forcing.uniform(current=(0.0, 0.4), slope=(0.0, 0.0)), parameters)
    run.advance(steps=3)
    again = Model.resume(run.save(tmp_path / "pressed.nc"), Forcing.uniform(current=(0.0, 0.4), slope=(0.0, 0.0)))
    for model in (run, again):
        model.advance(steps=4)
    for name in ("lon", "lat", "u", "v", "rotation"):
        np.testing.assert_array_equal(getattr(run.elements, name), getattr(again.elements, name))
    for name in ("normal_stress", "shear_stress", "bond_length"):
        np.testing.assert_array_equal(getattr(run.bonds, name), getattr(again.bonds, name))
    # Were the ice linear, the other current would stretch all bonds by as much as this one shortens them.
    gaping = Model(berg, Forcing.uniform(current=(0.0, -0.4), slope=(0.0, 0.0)), parameters)
    gaping.advance(steps=7)
    stretch = [model.bonds.bond_length - 2.0 * RADIUS for model in (run, gaping)]
    assert abs(stretch[0] + stretch[1]).max() > 0.2 * abs(stretch[1]).max()


def uneven(packing: str, angle: float, *, depth: float) -> Plate:
    """The bar with ice of 200 m in its western half and of 300 m in its eastern one."""
    plate = bar(packing, angle, depth=depth)
    plate.el.thickness[plate.x > 0.21 * SPACING] = 300.0
    plate.refresh()
    return plate


@pytest.mark.parametrize(("packing", "angle"), QUICK)
def test_a_bar_of_uneven_thickness_stretches_as_in_theory_and_its_crack_closes(packing, angle) -> None:
    """A bar of section A(x) under the force N(x) stores the integral of N^2 / (2 E A)."""
    even, whole, cracked = (
        bar(packing, angle, depth=0.0), uneven(packing, angle, depth=0.0), uneven(packing, angle, depth=0.5)
    )  # fmt: skip
    of_whole = energy(whole, pulled(even, 1.0))[0]
    x = np.linspace(-0.5, 0.5, 2001) * LENGTH
    square = np.cos(np.pi * x / LENGTH) ** 2
    theory = float((square * np.where(x < 0.21 * SPACING, 1.0, THICKNESS / 300.0)).sum() / square.sum())
    assert of_whole / energy(even, pulled(even, 1.0))[0] == pytest.approx(theory, rel=0.02)
    pressed, closed = energy(cracked, pulled(even, -1.0))
    assert pressed / of_whole == pytest.approx(1.045, abs=0.045)
    assert closed.all()
    apart, opened = energy(cracked, pulled(even, 1.0))
    assert apart / of_whole > 2.0
    assert not opened.any()


def on_a_bed(*, current: float, depth: float = 0.5, bending: bool = False) -> Model:
    """The bar, aground by 200 m of its eastern end on a bed of sand that holds it, in a current along it."""
    whole = Iceberg.rectangle(LENGTH, WIDTH, thickness=THICKNESS, radius=RADIUS, latlon=False)
    line = [(0.21 * SPACING, -0.6 * WIDTH), (0.21 * SPACING, (depth - 0.5) * WIDTH)]
    berg = whole.with_rifts([line], broken=True) if depth > 0.0 else whole
    plane = {"latlon": False, "latitude": 0.0}
    draft = THICKNESS * 850.0 / 1025.0
    floor = Forcing.slope((0.5 * LENGTH - 200.0, 0.0), 90.0, -1e-3, draft, (1.0, 5000.0), latlon=False)
    parameters = Parameters(
        ice={"density": 850.0}, earth={"latlon": False, "f_plane": True, "reference_latitude": 0.0},
        grounding={"law": "seabed", "sediment": "sand", "bending": bending},
        fracture={"enabled": False}, stepping={"time_step": 600.0},
    )  # fmt: skip
    return Model(berg, Forcing.uniform((current, 0.0), **plane) + floor, parameters)


def stored(model: Model) -> tuple[float, np.ndarray]:
    """Elastic energy (J) at the end of the last step, and which faces are closed."""
    state, cells = model._stepper.memory.state, model._stepper.memory.lattice.cells
    moved = state.bodies.displacement
    return 0.5 * float((moved * state.load).sum()), cells.faces.closed(cells.displacements(moved))


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.parametrize("bending", [False, True])
def test_faces_close_in_a_berg_that_a_bed_of_sediment_holds(bending) -> None:
    """A current that pushes it onto the bed closes the crack, and it is as whole; one that pulls it off opens the crack."""
    ratio, faces = {}, {}
    for current in (0.4, -0.4):
        cracked, whole = (on_a_bed(current=current, depth=depth, bending=bending) for depth in (0.5, 0.0))
        for model in (cracked, whole):
            model.advance(steps=6)
            assert model.elements.keel.floor_load.sum() > 0.0
        energy_now, faces[current] = stored(cracked)
        ratio[current] = energy_now / stored(whole)[0]
    assert faces[0.4].all()
    assert not faces[-0.4].any()
    assert ratio[0.4] == pytest.approx(1.04, abs=0.05)
    assert ratio[-0.4] > 1.5


@pytest.mark.compiled
@settings(max_examples=5, deadline=None)
@given(
    packing=st.sampled_from(["square", "hexagonal"]), angle=st.floats(0.0, 45.0), slant=st.floats(-60.0, 60.0),
    towards=st.floats(0.0, 360.0), cut=st.integers(1, 3), toughness=st.sampled_from([None, 2e4, 1e8]),
)  # fmt: skip
def test_faces_and_tips_go_on_from_a_restart_bit_for_bit(packing, angle, slant, towards, cut, toughness) -> None:
    """Whatever the lattice, the rift and the current: a run that is cut after any step ends with the same digits."""
    berg = Iceberg.rectangle(
        18e3, 9e3, thickness=THICKNESS, radius=RADIUS, packing=packing, latlon=False, lattice_angle=angle
    )
    half = 2.7e3 * np.array([np.sin(np.radians(slant)), np.cos(np.radians(slant))])
    berg = berg.with_rifts([[tuple(half), tuple(-half)]], broken=True)
    berg.elements.static[berg.elements.lon < -8e3] = 1.0
    fracture = {"enabled": False} if toughness is None else {"criterion": "toughness", "toughness": toughness}
    parameters = Parameters(
        earth={"latlon": False, "period": 0.0}, bonds={"packing": packing}, fracture=fracture, stepping={"time_step": 600.0}
    )  # fmt: skip
    sea = Forcing.uniform(
        current=(0.5 * np.cos(np.radians(towards)), 0.5 * np.sin(np.radians(towards))), slope=(0.0, 0.0)
    )
    run = Model(berg, sea, parameters)
    run.advance(steps=cut)
    with TemporaryDirectory() as folder:
        again = Model.resume(run.save(Path(folder) / "cut.nc"), sea)
    for model in (run, again):
        model.advance(steps=4 - cut)
    assert_same_state(run, again)


def assert_same_state(run: Model, again: Model) -> None:
    for name in ("lon", "lat", "u", "v", "rotation"):
        np.testing.assert_array_equal(getattr(run.elements, name), getattr(again.elements, name))
    for name in ("normal_stress", "shear_stress", "bond_length", "status", "crack", "crack_order", "crack_part"):
        np.testing.assert_array_equal(getattr(run.bonds, name), getattr(again.bonds, name))
    before, after = run._stepper.state_dict(), again._stepper.state_dict()
    for name in (name for name in {*before, *after} if name.startswith("crack_tip")):
        np.testing.assert_array_equal(before.get(name), after.get(name))
