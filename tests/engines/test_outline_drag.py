"""Drag of the water on the sides of bonded bergs: against integrals over their outlines, made here of many short panels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely

from contract import FORCES
from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.plane import ConformalPlane

PANELS = 2000
EARTH = Parameters().earth.radius
THICKNESS, DRAFT, COEFFICIENT = 200.0, 200.0 * 850.0 / 1025.0, 0.9
OTHERS_OFF = {"water_base": 1e-12, "air_top": 0.0, "air_side": 0.0, "rotational": False}


def panels(corners: Any, u: float, v: float, spin: float) -> np.ndarray:
    """Force and torque about the centroid (N, N, N m) on a polygon (m, counter-clockwise) that moves through still water.

    Half of C_v on each face: the pressure on the one that looks into the flow and the suction behind the other are both in it.
    """
    corners = np.asarray(corners, float) - np.array(shapely.Polygon(corners).centroid.coords[0])
    total = np.zeros(3)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        x, y = a[:, None] + (b - a)[:, None] * (np.arange(PANELS) + 0.5) / PANELS
        nx, ny = np.array([b[1] - a[1], a[0] - b[0]]) / np.hypot(*(b - a))
        normal = (u - spin * y) * nx + (v + spin * x) * ny
        push = -0.25 * 1025.0 * COEFFICIENT * DRAFT * abs(normal) * normal * np.hypot(*(b - a)) / PANELS
        total += [(push * nx).sum(), (push * ny).sum(), (push * (x * ny - y * nx)).sum()]
    return total


def rectangle(length: float, width: float, turn: float = 0.0) -> np.ndarray:
    """Corners of a rectangle that is turned counter-clockwise by some degrees."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    along, across = 0.5 * length * np.array([c, s]), 0.5 * width * np.array([-s, c])
    return np.array([-along - across, along - across, along + across, across - along])


def adrift(berg: Iceberg, velocity: tuple[float, float], spin: float, **groups: Any) -> Model:
    """A berg in still water that moves with a velocity (m/s) and turns about its centre (s-1)."""
    latlon = bool(abs(berg.elements.lat).max() < 1.0)
    earth = {"f_plane": True, "reference_latitude": 0.0} | ({} if latlon else {"latlon": False, "period": 0.0})
    p = {
        "stepping": {"time_step": 1.0}, "earth": earth, "fracture": {"enabled": False}, "drag": OTHERS_OFF,
        "grounding": {"law": "none"},
    }  # fmt: skip
    model = Model(berg, Forcing.uniform(), Parameters(**{**p, **groups}))
    el = model.elements
    x, y = places(model)
    el.u[:], el.v[:], el.spin[:] = velocity[0] - spin * y, velocity[1] + spin * x, spin
    el.u_sync[:], el.v_sync[:] = el.u, el.v
    return model


def places(model: Model) -> Any:
    """Places of the elements about their centre, m."""
    el, metres = model.elements, math.radians(1.0) * EARTH if model.parameters.earth.latlon else 1.0
    return [metres * (x - np.average(x, weights=el.mass)) for x in (el.lon, el.lat)]


def at_equator(shape: Any, **options: Any) -> Iceberg:
    """Fill a polygon (m) with elements."""
    return Iceberg.from_outline(
        np.column_stack(ConformalPlane(0.0, 0.0, EARTH).inverse(*shape.T)), thickness=THICKNESS, **options
    )


def drag_on(model: Model) -> np.ndarray:
    """Force (N) and torque about the centre (N m) of the water, from what the first second changes."""
    el, (x, y) = model.elements, places(model)
    inertia = (el.mass * (x**2 + y**2 + (el.length**2 + el.width**2) / 12.0)).sum()
    before = el.spin.mean()
    model.step()
    force = model.applied_forces()[:, FORCES.index("water")].sum(axis=0)
    return np.array([*force, inertia * (el.spin.mean() - before)])


MOTIONS = [((0.0, 0.0), 2e-5), ((0.05, 0.02), 2e-5), ((-0.1, 0.2), -1e-5), ((0.3, 0.0), 0.0), ((0.2, 0.2), 0.0)]


@pytest.mark.parametrize(("velocity", "spin"), MOTIONS)
@pytest.mark.parametrize(("length", "width"), [(4e3, 4e3), (8e3, 4e3), (16e3, 4e3)])
def test_sides_are_dragged_by_the_integral_over_the_outline(
    length: float, width: float, velocity: tuple[float, float], spin: float
) -> None:
    """In pure spin, in spin with drift and in drift alone, broadside on and across a corner."""
    want = panels(rectangle(length, width), *velocity, spin)
    got = drag_on(
        adrift(Iceberg.rectangle(length, width, thickness=THICKNESS, radius=500.0, latlon=False), velocity, spin)
    )
    size = np.array([*[1025.0 * DRAFT * length * max(0.01, *np.abs(velocity)) ** 2] * 2, abs(want[2]) + 1e5])
    np.testing.assert_allclose(got / size, want / size, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("packing", "radius", "turn", "lattice"),
    [
        ("square", 1e3, 0.0, 0.0),
        ("square", 300.0, 0.0, 37.0),
        ("hexagonal", 400.0, 0.0, 0.0),
        ("hexagonal", 350.0, 25.0, 60.0),
    ],
)
def test_the_drag_hangs_neither_on_the_lattice_nor_on_how_it_lies(
    packing: str, radius: float, turn: float, lattice: float
) -> None:
    for velocity, spin in MOTIONS:
        berg = at_equator(rectangle(6e3, 3e3, turn), radius=radius, packing=packing, lattice_angle=lattice)
        want = panels(rectangle(6e3, 3e3, turn), *velocity, spin)
        got = drag_on(adrift(berg, velocity, spin, bonds={"packing": packing}))
        force = np.hypot(*want[:2])
        np.testing.assert_allclose(got[:2], want[:2], atol=5e-3 * max(force, 1e5))
        assert got[2] == pytest.approx(want[2], rel=0.01, abs=force * 10.0 + 1e4)


def test_shapes_that_no_rectangle_stands_for() -> None:
    """A triangle and an L, whose front and lee are not alike: both turn while they drift."""
    triangle = np.array([[0.0, 0.0], [9e3, 0.0], [0.0, 6e3]])
    corner = np.array([[0.0, 0.0], [8e3, 0.0], [8e3, 3e3], [3e3, 3e3], [3e3, 8e3], [0.0, 8e3]])
    for shape in (triangle, corner):
        for velocity, spin in (((0.2, 0.1), 0.0), ((0.0, 0.1), 1.5e-5)):
            berg = at_equator(shape, radius=250.0)
            want, got = panels(shape, *velocity, spin), drag_on(adrift(berg, velocity, spin))
            np.testing.assert_allclose(got[:2], want[:2], atol=5e-3 * np.hypot(*want[:2]))
            assert got[2] == pytest.approx(want[2], rel=0.01, abs=20.0 * np.hypot(*want[:2]))


def test_water_that_turns_with_the_berg_drags_on_nothing() -> None:
    class Whirl(Forcing.uniform):
        def sample(self, elements: Any, time: float) -> None:
            super().sample(elements, time)
            elements.vorticity[:] = 4e-5
            elements.uo[:], elements.vo[:] = -2e-5 * elements.lat, 2e-5 * elements.lon

    berg = Iceberg.rectangle(8e3, 4e3, thickness=THICKNESS, radius=500.0, latlon=False, placement=(0.0, 0.0))
    model = adrift(berg, (0.0, 0.0), 2e-5)
    model.forcing = Whirl()
    at_rest = panels(rectangle(8e3, 4e3), 0.0, 0.0, 2e-5)
    assert abs(drag_on(model)[2]) < 1e-3 * abs(at_rest[2])


def test_pieces_have_outlines_of_their_own_and_cracks_within_a_piece_have_none() -> None:
    """A crack half way through a berg is no front to the water; one that parts it makes two more sides."""
    totals = []
    for deep in (0.0, 2.1e3, 5e3):
        berg = Iceberg.rectangle(8e3, 4e3, thickness=THICKNESS, radius=500.0, latlon=False, placement=(0.0, 0.0))
        model = adrift(berg, (0.2, 0.0), 0.0)
        el, bonds = model.elements, model.bonds
        middle = np.average(el.lon)
        across = (el.lon[bonds.first] < middle) != (el.lon[bonds.second] < middle)
        cut = across & (el.lat[bonds.first] - el.lat.min() < deep)
        bonds.status[cut] = 1
        np.subtract.at(el.bond_count, np.concatenate([bonds.first[cut], bonds.second[cut]]), 1)
        totals.append(drag_on(model)[0])
    assert totals[1] == pytest.approx(totals[0], rel=1e-6)
    assert totals[2] == pytest.approx(2.0 * totals[0], rel=1e-3)


def test_a_front_in_steps_is_dragged_as_the_line_that_it_stands_for() -> None:
    """A square whose sides cross the lattice at 45 degrees, without an outline: cell by cell it would have half of the drag."""
    x, y = (a.ravel() for a in np.meshgrid(1e3 * np.arange(-12.0, 13.0), 1e3 * np.arange(-12.0, 13.0)))
    inside = abs(x) + abs(y) < 12.5e3
    berg = Iceberg.from_points(x[inside], y[inside], thickness=THICKNESS, radius=500.0, latlon=False)
    if not berg.bonds.first.size:
        pytest.skip("points are not bonded")
    got = drag_on(adrift(berg, (0.1, 0.1), 0.0))
    side = math.sqrt(2.0 * 12.5e3**2)
    want = panels(rectangle(side, side, 45.0), 0.1, 0.1, 0.0)
    np.testing.assert_allclose(got[:2], want[:2], rtol=0.06)


def test_a_small_bonded_berg_takes_long_steps() -> None:
    """Two cells of 15 m in a current: its sides bring it to the water within minutes, and it is never flung past it."""
    for dt in (60.0, 1800.0):
        berg = Iceberg.rectangle(30.0, 15.0, thickness=10.0, radius=7.5, latlon=False)
        assert berg.bonds.first.size
        model = Model(
            berg, Forcing.uniform(current=(0.5, 0.0), slope=(0.0, 0.0)),
            Parameters(stepping={"time_step": dt}, earth={"latlon": False, "reference_latitude": 0.0, "period": 0.0}),
        )  # fmt: skip
        for _ in range(4):
            model.step()
            assert 0.0 < model.elements.u.mean() <= 0.5 * 1.001
        model.advance("6 h")
        assert model.elements.u.mean() == pytest.approx(0.5, abs=0.02)
