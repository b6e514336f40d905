"""The plate by finite elements that the law of the ground is held against (``benchmarks/plate_on_water.py``)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from scripts import ROOT, loaded, table_rows

PLATE = loaded("benchmarks/plate_on_water.py")
PAGE = ROOT / "docs" / "evidence" / "plate-on-water.md"
AREA = 40e3 * 30e3


@pytest.mark.parametrize("modulus", [9e9, 1e9])
def test_a_point_inside_is_borne_as_westergaard_says(modulus: float) -> None:
    length = PLATE.bending_length(modulus)
    lines = PLATE.mirrored(PLATE.graded(10.0 * length, 0.25 * length, length, coarse=length))
    stiffness = PLATE.point_stiffness(PLATE.floating_plate(lines, lines, modulus), 10.0 * length, 10.0 * length)
    rigidity = modulus * 250.0**3 / (12.0 * (1.0 - 0.3**2))
    assert stiffness == pytest.approx(8.0 * math.sqrt(1025.0 * 9.81 * rigidity), rel=2e-3)


def test_a_point_of_an_edge_is_borne_as_a_fourier_integral_says() -> None:
    length = PLATE.bending_length(9e9)
    half = PLATE.graded(10.0 * length, 0.125 * length, length, coarse=length)
    plate = PLATE.floating_plate(half, PLATE.mirrored(half), 9e9)
    stiffness = PLATE.point_stiffness(plate, 0.0, half[-1]) / (PLATE.WATER * length**2)
    assert stiffness == pytest.approx(PLATE.edge_point_stiffness(), rel=1e-3)


def test_a_corner_does_not_depend_on_mesh_and_modulus() -> None:
    def corner(modulus: float, fine: float) -> float:
        length = PLATE.bending_length(modulus)
        lines = PLATE.graded(10.0 * length, fine * length, length, coarse=length)
        return PLATE.point_stiffness(PLATE.floating_plate(lines, lines, modulus), 0.0, 0.0) / (PLATE.WATER * length**2)

    assert corner(9e9, 0.25) == pytest.approx(0.786, rel=1e-3)
    assert corner(1e9, 0.1) == pytest.approx(corner(9e9, 0.25), rel=1e-4)


@pytest.mark.parametrize("distance", [0.0, 0.15, 0.6, 2.5])
def test_a_line_of_load_is_borne_as_by_hetenyis_beam(distance: float) -> None:
    length = PLATE.bending_length(1e9, poisson=0.0)
    plate = PLATE.floating_plate(
        PLATE.graded(20.0 * length, 0.1 * length, 8.0 * length), np.array([0.0, 700.0]), 1e9, 0.0
    )
    reach = math.sqrt(2.0) * length
    stiffness = PLATE.line_stiffness(plate, distance * reach)
    assert stiffness == pytest.approx(PLATE.WATER * reach * PLATE.hetenyi(distance), rel=1e-4)


def test_water_and_a_flat_bed_share_the_lift() -> None:
    bed = PLATE.Bed(4e4, 1e9)
    shared = PLATE.WATER * bed.stiffness / (PLATE.WATER + bed.stiffness) * AREA
    assert PLATE.flat(bed, 9e9, 500.0) == pytest.approx(shared, rel=1e-9)


def test_a_flat_bed_that_yields_bears_and_holds_its_strength() -> None:
    x = np.linspace(0.0, 4e3, 5)
    zone = PLATE.Zone(PLATE.floating_plate(x, x, 9e9), (0.0, 4e3), (0.0, 4e3))
    contact = zone.press(np.ones(zone.x.size), PLATE.Bed(1e6, 5e3, 2e3, 0.7))
    assert contact.load == pytest.approx(5e3 * 16e6, rel=1e-9)
    assert contact.friction == pytest.approx(2e3 * 16e6, rel=1e-9)


def test_nearly_rigid_ice_heaves_and_tilts() -> None:
    x, y = np.concatenate([[0.0, 50.0], np.linspace(500.0, 18e3, 12)]), np.linspace(0.0, 9e3, 4)
    zone = PLATE.Zone(PLATE.floating_plate(x, y, 9e16), (0.0, 40.0), (0.0, 9e3))
    load = zone.press(np.full(zone.x.size, 0.05), PLATE.Bed(1e6, 1e12)).load
    # A load on the front lifts it by 4 N / (k_w A): once by heave and three times by tilt.
    compliance = 4.0 / (PLATE.WATER * 18e3 * 9e3) + 1.0 / (1e6 * 50.0 * 9e3)
    assert load == pytest.approx(0.05 / compliance, rel=0.01)


@pytest.mark.quick(1)
@pytest.mark.parametrize("modulus", [9e9, 1e9])
def test_ice_on_a_bank_takes_its_shape(modulus: float) -> None:
    volume = 0.5 * 10.0 * 10e3 * 30e3
    assert PLATE.bank(PLATE.SAND, modulus, 1000.0) == pytest.approx(PLATE.WATER * volume, rel=5e-3)


def test_the_corner_of_stiff_ice_comes_to_rest_where_a_load_at_the_tip_stops_it() -> None:
    still = PLATE.landing(PLATE.ROCK, 9e9, 30.0, 0.2, 200.0)
    tip = 0.786 * PLATE.WATER * PLATE.bending_length(9e9) ** 2
    energy = 0.5 * PLATE.MASS * 0.2**2
    assert still.way == pytest.approx(math.sqrt(2.0 * energy / (0.501 * tip * 1e-3)), rel=0.03)
    assert still.way_in_water == pytest.approx(554.0, rel=0.02)  # another prototype: 554 m, 5.0e9 N
    assert still.load == pytest.approx(5.0e9, rel=0.03)


@pytest.mark.parametrize("speed", [0.1, 0.25])
def test_rest_comes_where_friction_slope_and_drag_have_used_up_the_motion(speed: float) -> None:
    ways, stiffness, gradient = np.linspace(0.0, 900.0, 13), 1e8, 2e-3
    contacts = [PLATE.Contact(stiffness * way, 0.4 * stiffness * way) for way in ways]
    still = PLATE.come_to_rest(ways, contacts, speed, gradient)
    energy = 0.5 * PLATE.MASS * speed**2
    assert still.way == pytest.approx(math.sqrt(2.0 * energy / (stiffness * (0.4 + gradient))), rel=1e-4)

    def stands(_: float, state: np.ndarray) -> float:
        return state[1] - 1e-4

    stands.terminal = True  # type: ignore[attr-defined]

    def motion(_: float, state: np.ndarray) -> list[float]:
        force = stiffness * state[0] * (0.4 + gradient) + PLATE.DRAG * state[1] ** 2
        return [state[1], -force / PLATE.MASS]

    run = solve_ivp(motion, (0.0, 1e5), [0.0, speed], events=stands, rtol=1e-8)
    assert still.way_in_water == pytest.approx(run.y[0, -1], rel=1e-3)
    assert still.load == pytest.approx(stiffness * run.y[0, -1], rel=1e-3)


@pytest.mark.slow
def test_the_page_holds_what_the_script_gives() -> None:
    assert table_rows(PAGE, "plate theory") == list(PLATE.theory())
    rows = table_rows(PAGE, "plate on a bed")
    assert [row[0] for row in rows] == [case[0] for case in PLATE.cases()]
    for row, case in zip(rows, PLATE.cases()):
        if case[0] in ("flat floor, clay", "knoll 0.9 m above the keel, clay"):
            assert row == PLATE.row(*case)
