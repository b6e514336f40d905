"""Faces of a crack inside one fragment that close again: pressure as in whole ice, and no tension."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.bergs.iceberg import Iceberg
from riftberg.ocean.analytic import Steady
from riftberg.parameters import Parameters
from riftberg.runs.model import Model
from riftberg.stepping.lattice.equilibrium import elastic_energy
from riftberg.stepping.lattice.triangles import ClosingFaces, find_open_edges, find_triangles
from stepping.test_elastic_cells import dense_matrix
from verification.test_crack_lines import QUICK, RADIUS, SPACING, THICKNESS, Plate

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


def energy(plate: Plate, load) -> tuple[float, np.ndarray]:
    """Stored energy (J), and which faces are closed."""
    moment = plate.under(*load)
    faces = plate.now.cells.faces.closed(plate.now.cells.displacements(moment.displacement))
    return elastic_energy(moment.displacement, moment.load), faces


@pytest.mark.parametrize(("packing", "angle"), QUICK)
def test_a_cracked_bar_pressed_together_is_as_whole(packing, angle) -> None:
    """Half of its width is cracked: within 9 % of the whole bar when it is pressed, 2.4 to 4.3 times softer when pulled.

    What is left is the rim of half a cell along the outline, where faces do not close, and slip along turned facets.
    """
    whole, cracked = bar(packing, angle, depth=0.0), bar(packing, angle)
    pressed, closed = energy(cracked, pulled(cracked, -1.0))
    assert pressed / energy(whole, pulled(whole, -1.0))[0] == pytest.approx(1.045, abs=0.04)
    assert (closed > 0).all()
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
    assert (closed > 0).all()
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
    cracked.now = cracked._factored()
    assert energy(cracked, pulled(cracked, -1.0))[0] / energy(whole, pulled(whole, -1.0))[0] == pytest.approx(
        1.0, abs=0.005
    )
    assert energy(cracked, pulled(cracked, 1.0))[0] / energy(whole, pulled(whole, 1.0))[0] > 1.3


def broken_at_random(seed: int, packing: str) -> Plate:
    plate = bar(packing, 15.0, depth=0.0)
    rng = np.random.default_rng(seed)
    plate.bonds.status[rng.random(plate.bonds.first.size) < 0.15] = 1
    plate.now = plate._factored()
    return plate


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
@pytest.mark.parametrize("seed", range(3))
def test_open_faces_gape_and_closed_ones_press(seed, packing) -> None:
    """The solution of the convex problem: no gap and no pressure below 0, equilibrium, and least energy of all tries."""
    plate, rng = broken_at_random(seed, packing), np.random.default_rng(50 + seed)
    load = plate.el.mass * rng.normal(size=plate.el.size), plate.el.mass * rng.normal(size=plate.el.size)
    moment = plate.under(*load)
    cells, solver = plate.now.cells, plate.now.solver
    faces, moved = cells.faces, cells.displacements(moment.displacement)
    way = faces.closed(moved)
    assert 0 < (way > 0).sum() < way.size
    values = np.einsum("tna,ta->tn", faces.tables.signs[np.arange(way.size), way], moved.reshape(-1)[faces.at])
    size = abs(moved[faces.at // 3, faces.at % 3]).max()
    for n in range(2):
        assert values[faces.tables.number > n, n].min() >= -1e-9 * size
    # Stiffness as it is pressed, on these displacements, gives the loads.
    force = np.zeros((cells.topology.nodes, 3))
    force[: plate.el.size] = moment.load
    matrix = dense_matrix(cells)
    for k, on in enumerate(way):
        w = faces.columns[k, on]
        matrix[np.ix_(faces.at[k], faces.at[k])] += w.T @ w
    left = matrix @ moved.ravel() - force.ravel()
    assert abs(left.reshape(-1, 3)[:, :2]).max() < 1e-6 * abs(force[:, :2]).max()
    # Loads twice as large move all twice as far.
    twice = plate.under(2.0 * load[0], 2.0 * load[1])
    np.testing.assert_allclose(twice.displacement, 2.0 * moment.displacement, rtol=1e-7, atol=1e-9 * size)
    assert solver.update_rank == 0


@pytest.mark.parametrize("packing", ["square", "hexagonal"])
def test_a_break_never_stores_energy(packing) -> None:
    """Bonds broken one by one under a load that presses some faces and opens others; downdates agree with fresh factors."""
    plate, rng = bar(packing, 22.5), np.random.default_rng(3)
    load = plate.el.mass * rng.normal(size=plate.el.size), plate.el.mass * rng.normal(size=plate.el.size)
    before, _ = energy(plate, load)
    assert before > 0.0
    for bond in rng.permutation(plate.now.intact)[:12]:
        plate.now.solver.downdate(int(bond))
        plate.now = plate.now._replace(intact=plate.now.intact[plate.now.intact != bond])
        corrected, _ = energy(plate, load)
        plate.without(int(bond))
        fresh, _ = energy(plate, load)
        assert corrected == pytest.approx(fresh, rel=1e-9)
        assert fresh >= before * (1.0 - 1e-10)
        before = fresh


def test_a_closed_face_is_the_constrained_minimum_of_the_triangle() -> None:
    """Against the energy with its inner unknowns written out: least energy with each set of gaps held at 0."""
    rng = np.random.default_rng(8)
    vertex = np.array([[[0.0, 0.0], [1.0, 0.1], [0.2, 0.9]]])
    freed, at, volume = np.array([[False, True, True]]), np.arange(9)[None, :], np.array([1.7])
    faces = ClosingFaces(np.array([0]), at, vertex, freed, freed, volume, 2.0, 0.3)
    opened, edges = find_open_edges(vertex, freed, 2.0, 0.3)
    move = rng.normal(size=9)
    gap, give = edges.gap[0] @ move, edges.give[0][1:, 1:]
    least = move @ opened.stiffness[0] @ move
    assert gap[0] == pytest.approx(0.0, abs=1e-14)
    for way, shut in ((0, []), (1, [1]), (2, [2]), (3, [1, 2])):
        # Half the energy per volume that closing takes: gap' give^-1 gap over the faces that are shut.
        held = [e - 1 for e in shut]
        extra = gap[shut] @ np.linalg.inv(give[np.ix_(held, held)]) @ gap[shut] if shut else 0.0
        columns = faces.columns[0, way]
        assert move @ columns.T @ columns @ move == pytest.approx(volume[0] * extra, rel=1e-12, abs=1e-15)
        assert extra >= 0.0
        # A face that is whole again, with its squares, is stiffer still.
        assert (
            least + extra <= move @ find_triangles(vertex, np.zeros_like(freed), 2.0, 0.3).stiffness[0] @ move + 1e-12
        )
    # Both shut: the strain is that of the elongations, so the stress is Hooke's law.
    gradient = np.linalg.lstsq(np.column_stack([vertex[0], np.ones(3)]), move[:6].reshape(3, 2), rcond=None)[0][:2].T
    strain = 0.5 * (gradient + gradient.T)
    c = 2.0 / (1 - 0.09) * np.array([[1, 0.3, 0], [0.3, 1, 0], [0, 0, 0.35]])
    stress = c @ [strain[0, 0], strain[1, 1], 2 * strain[0, 1]]
    np.testing.assert_allclose(faces.tables.stress[0, 3] @ move, stress, rtol=1e-11)
    # The pressure is what the energy grows by with the gap.
    for way, n in ((1, 0), (2, 1)):
        pressure = faces.tables.signs[0, way, n] @ move / give[n, n]
        assert pressure == pytest.approx(-gap[n + 1] / give[n, n], rel=1e-12)


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
    run = Model(berg, Steady(current=(0.0, 0.4)), parameters)
    run.advance(steps=3)
    again = Model.resume(run.save(tmp_path / "pressed.nc"), Steady(current=(0.0, 0.4)))
    for model in (run, again):
        model.advance(steps=4)
    for name in ("lon", "lat", "u", "v", "rotation"):
        np.testing.assert_array_equal(getattr(run.elements, name), getattr(again.elements, name))
    for name in ("normal_stress", "shear_stress", "bond_length"):
        np.testing.assert_array_equal(getattr(run.bonds, name), getattr(again.bonds, name))
    # Were the ice linear, the other current would stretch all bonds by as much as this one shortens them.
    gaping = Model(berg, Steady(current=(0.0, -0.4)), parameters)
    gaping.advance(steps=7)
    stretch = [model.bonds.bond_length - 2.0 * RADIUS for model in (run, gaping)]
    assert abs(stretch[0] + stretch[1]).max() > 0.2 * abs(stretch[1]).max()


def uneven(packing: str, angle: float, *, depth: float) -> Plate:
    """The bar with ice of 200 m in its western half and of 300 m in its eastern one."""
    plate = bar(packing, angle, depth=depth)
    plate.el.thickness[plate.x > 0.21 * SPACING] = 300.0
    plate.now = plate._factored()
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
    assert (closed > 0).all()
    apart, opened = energy(cracked, pulled(even, 1.0))
    assert apart / of_whole > 2.0
    assert not opened.any()
