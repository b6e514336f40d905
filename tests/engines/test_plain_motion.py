"""Motions whose end is known by hand, in the explicit schemes: parabolas under constant forces, swapped axes, a seam."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters
from riftberg.constants import EARTH_ROTATION, GRAVITY

PLANE = {"latlon": False, "period": 0.0, "f_plane": True, "reference_latitude": 0.0}
SPRINGS = {"law": "spring", "spring": 1e-6}
SCHEMES = {
    "verlet": {"stepping": {"scheme": "verlet", "time_step": 10.0}, "bonds": SPRINGS},
    "runge_kutta": {"stepping": {"scheme": "runge_kutta", "time_step": 10.0}, "bonds": SPRINGS},
    "mts with springs": {"stepping": {"scheme": "mts", "time_step": 10.0, "substeps": 2}, "bonds": SPRINGS},
    "mts with beams": {
        "stepping": {"scheme": "mts", "time_step": 10.0, "substeps": 4}, "bonds": {"law": "dem", "youngs_modulus": 1e6}
    },
}  # fmt: skip


def model_of(scheme: str, bergs: list[Iceberg], sea: Forcing, **groups: Any) -> Model:
    """Return a model on a plane that does not turn, without fracture."""
    given = {"earth": PLANE, "fracture": {"enabled": False}}
    for name, values in (*SCHEMES[scheme].items(), *groups.items()):
        given[name] = {**given.get(name, {}), **values}
    return Model(Iceberg.join(bergs), sea, Parameters(**given))


def berg(columns: int, rows: int, x: float = 0.0, y: float = 0.0, **options: Any) -> Iceberg:
    return Iceberg.rectangle(
        3e3 * columns, 3e3 * rows, thickness=200.0, radius=1500.0, placement=(x, y), latlon=False, **options
    )


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_constant_force_leads_along_a_parabola(scheme: str) -> None:
    """The sea surface slopes; at these speeds the water brakes by less than a thousandth of that.

    Of `verlet`, which kicks before it moves, one step counts twice.
    """
    slope, step, steps = np.array([-2e-6, 3e-6]), 10.0, 6
    model = model_of(scheme, [berg(1, 1)], Forcing.uniform(slope=tuple(slope)))
    start = np.array([model.elements.lon[0], model.elements.lat[0]])
    model.advance(steps=steps)
    way = np.array([model.elements.lon[0], model.elements.lat[0]]) - start
    counted = steps * (steps + 1) if scheme == "verlet" else steps**2
    np.testing.assert_allclose(way, -0.5 * GRAVITY * slope * step**2 * counted, rtol=1e-3)


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("on_substeps", [True, False])
def test_what_happens_northwards_happens_eastwards(scheme: str, on_substeps: bool) -> None:
    """Two bergs collide in a current, with wind, on the floor: the same run with the axes swapped, to round-off."""
    ends = []
    for swap in (False, True):
        order = slice(None, None, -1 if swap else 1)

        def at(x: float, y: float, order: slice = order) -> tuple[float, float]:
            first, second = np.array([x, y])[order].tolist()
            return first, second

        bergs = [
            Iceberg.from_points(*np.array(list(zip(*places, strict=True)))[order], thickness=thick, radius=1500.0,
                                velocity=at(*velocity), latlon=False)
            for places, thick, velocity in (
                ([(0.0, 0.0), (3e3, 0.0)], 200.0, (0.5, 0.02)), ([(6050.0, 0.0)], 150.0, (-0.5, 0.0)),
                ([(9200.0, 0.0)], 150.0, (-0.2, 0.0)),
            )
        ]  # fmt: skip
        sea = Forcing.uniform(current=at(0.2, -0.1), wind=at(5.0, 8.0), depth=165.0, slope=(0.0, 0.0))
        contact = {"spring": 1e-5, "on_substeps": on_substeps, "tolerance": 1e-12}
        model = model_of(scheme, bergs, sea, contact=contact, grounding={"coefficient": 1e3})
        loads = np.array([[2e7, -1e7]] * 2 + [[0.0, 0.0]] * 2).T[order]
        model.elements.load_x[:], model.elements.load_y[:] = loads
        model.advance(steps=40)
        el = model.elements
        ends.append(np.array([[el.lon, el.lat], [el.u, el.v], [el.u_sync, el.v_sync]])[:, order])
    for east, north in zip(*ends, strict=True):
        np.testing.assert_allclose(north, east, rtol=0, atol=1e-9 * np.abs(east).max())


@pytest.mark.parametrize("first", [False, True])
def test_loads_give_a_bonded_berg_their_momentum_from_the_first_step_on(first: bool) -> None:
    """Different loads on its elements, both ways: force times time, whether they act from the start of the run or later."""
    model = model_of(
        "mts with beams",
        [berg(3, 2)],
        Forcing.uniform(),
        stepping={"substeps": 1, "time_step": 1.0, "only_interactions": True},
    )
    el, force = model.elements, 1e6 * np.random.default_rng(3).normal(size=(2, 6))
    if not first:
        model.advance(steps=2)
    el.load_x[:], el.load_y[:] = force
    model.advance(steps=3)
    momentum = np.array([el.mass @ el.u, el.mass @ el.v])
    # A load that is there at the start has the first half kick too; one that comes between two steps has it not.
    np.testing.assert_allclose(momentum, force.sum(axis=1) * (3.0 if first else 2.5), rtol=1e-9)


@pytest.mark.parametrize("scheme", ["mts with beams", "mts with springs", "verlet"])
def test_a_bonded_berg_across_the_seam_of_a_periodic_sea_is_strained_as_elsewhere(scheme: str) -> None:
    ends = []
    for x in (30e3, 0.0, 59e3):
        model = model_of(
            scheme,
            [berg(3, 2, x, 5e3)],
            Forcing.uniform(current=(0.1, 0.2), slope=(0.0, 0.0)),
            earth={**PLANE, "period": 60e3},
        )
        el, bonds = model.elements, model.bonds
        el.lon[:] %= 60e3
        el.lon_pair[:] = el.lon
        el.u[:] = el.u_sync[:] = 0.05 * np.sin(np.arange(6))
        el.v[:] = el.v_sync[:] = 0.05 * np.cos(2.0 * np.arange(6))
        start = el.lon.copy()
        model.advance(steps=4)
        way = (el.lon - start + 30e3) % 60e3 - 30e3
        ends.append(np.array([way, el.lat, el.u, el.v]))
        assert (bonds.status == 0).all()
    for other in ends[1:]:
        np.testing.assert_allclose(other, ends[0], rtol=0, atol=1e-9)


def test_a_search_for_contact_inside_a_berg_finds_room_for_more_pairs_than_bonds() -> None:
    """Elements near each other are more than those that are bonded; a soft berg is pressed together, and all bonds hold."""
    fracture = {"enabled": False, "broken_as_contact": False}
    one = model_of(
        "mts with beams", [berg(4, 4)], Forcing.uniform(current=(0.1, 0.0), slope=(0.0, 0.0)), fracture=fracture
    )
    two = model_of("mts with beams", [berg(4, 4)], Forcing.uniform(current=(0.1, 0.0), slope=(0.0, 0.0)))
    for model in (one, two):
        model.elements.u[:] = model.elements.u_sync[:] = 0.3 * np.sign(7e3 - model.elements.lon)
        model.advance(steps=3)
    np.testing.assert_allclose(one.elements.lon, two.elements.lon, rtol=0, atol=1e-6)


SPRINGS = {"law": "spring", "spring": 1e-4}


@pytest.mark.parametrize(
    ("scheme", "bonds", "step"),
    [("mts", SPRINGS, 600.0), ("mts", {}, 600.0), ("verlet", SPRINGS, 60.0), ("runge_kutta", SPRINGS, 60.0),
     ("quasi_static", {}, 600.0)],
)  # fmt: skip
def test_beyond_89_degrees_a_berg_goes_on_along_its_inertial_circle(scheme: str, bonds: dict, step: float) -> None:
    """There the schemes go over to planes that touch the sphere; on a plane about the pole the circle is known."""
    parameters = Parameters(
        stepping={"scheme": scheme, "time_step": step},
        bonds=bonds,
        fracture={"enabled": False},
        drag={"ocean_scale": 0.0},
    )
    lon, lat, east, north, time = 20.0, 88.9999, 0.03, 0.04, 7200.0
    berg = Iceberg.from_points([lon], [lat], thickness=200.0, radius=500.0, velocity=(east, north))
    model = Model(berg, Forcing.uniform(), parameters)
    model.advance(steps=round(time / step))

    def place(lon: float, lat: float) -> complex:
        return parameters.earth.radius * np.radians(90.0 - lat) * np.exp(1j * np.radians(lon))

    f, outwards = 2.0 * EARTH_ROTATION, np.exp(1j * np.radians(lon))
    way = (1j * east - north) * outwards * (1.0 - np.exp(-1j * f * time)) / (1j * f)
    el = model.elements
    assert el.lat[0] > 89.0
    assert abs(place(el.lon[0], el.lat[0]) - place(lon, lat) - way) < 0.01 * abs(way)
