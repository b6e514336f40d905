"""What comes, goes, is moved, pushed, held or cut between two steps, in all schemes that bend bonds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from riftberg import A68A_2022, Forcing, Iceberg, Model, Parameters

SCHEMES = pytest.mark.parametrize("scheme", ["quasi_static", "mts"])


def berg(**options: Any) -> Iceberg:
    return Iceberg.rectangle("60 km", "9 km", thickness="200 m", placement=(-38.0, -56.0), **options)


def model(scheme: str, sea: Forcing | None = None, **change: Any) -> Model:
    """Return a long berg that the wind of an eddy bends."""
    sea = sea or Forcing.eddy((-37.7, -56.2), radius=30e3, speed=0.5)
    change = {"fracture": {"enabled": False}, **change}
    return Model(berg(), sea, A68A_2022.changed(stepping={"scheme": scheme, "time_step": 1800.0}, **change))


def distances(run: Model, count: int) -> Any:
    """Return distances (m) between the first elements, straight through the earth."""
    lon, lat = np.deg2rad(run.elements.lon[:count]), np.deg2rad(run.elements.lat[:count])
    radius = run.parameters.earth.radius
    return pdist(radius * np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]))


@pytest.mark.quick(1)
@SCHEMES
def test_births_and_deaths_elsewhere_leave_a_berg_alone(scheme: str) -> None:
    """Each birth took the displacements by load for the shape: after ten days with 480 of them A68a was deformed by 4 km."""
    alone, crowded = model(scheme), model(scheme)
    count = alone.elements.size

    def come_and_go(run: Model) -> None:
        if run.elements.size > count + 3:
            run.remove(run.elements.id[count : count + 2])
        run.append(Iceberg.field(1, (-20.0, -19.9, -60.0, -59.9), seed=run.step_number).elements)

    crowded.after_step.append(come_and_go)
    for run in (alone, crowded):
        run.advance(days=2)
    assert crowded.elements.size > count
    np.testing.assert_allclose(crowded.elements.lon[:count], alone.elements.lon, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(crowded.elements.lat[:count], alone.elements.lat, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(crowded.bonds.normal_stress, alone.bonds.normal_stress, rtol=0.0, atol=1e-3)


def test_elements_that_go_leave_the_others_in_their_shape() -> None:
    """Within a bent berg too: free of load again, what is left has the shape that it had at the start."""
    run = model("quasi_static", Forcing.uniform(current=(0.0, 0.0)))
    count, shape = run.elements.size, distances(run, run.elements.size)
    x = run.elements.lon - run.elements.lon.mean()
    run.elements.load_y[:] = 1e8 * np.cos(2.0 * np.pi * x / np.ptp(x))
    run.advance(steps=2)
    assert np.abs(distances(run, count) - shape).max() > 20.0
    for _ in range(3):
        run.remove(run.elements.id[-1:])
        run.advance(steps=1)
    run.elements.load_y[:] = 0.0
    run.advance(steps=2)
    kept = np.array([j < count - 3 for i in range(count) for j in range(i + 1, count)])
    np.testing.assert_allclose(distances(run, count - 3), shape[kept], rtol=0.0, atol=1.0)


@SCHEMES
def test_a_berg_that_is_pushed_goes(scheme: str) -> None:
    """The velocity that a user had given to the elements was lost without a word in the quasi-static scheme."""
    run = model(scheme, Forcing.uniform(current=(0.0, 0.0)))
    run.advance(steps=3)
    before = run.elements.lon.mean()
    run.elements.u[:], run.elements.v[:] = 0.5, 0.0
    run.advance(steps=1)
    metres = (run.elements.lon.mean() - before) * 111.2e3 * np.cos(np.deg2rad(56.0))
    # The water slows it, 849 m and 0.44 m/s by the base alone. In equilibrium its side is the end of 9 km, across the way:
    # m du/dt = -k u^2 takes 45 m from that; the mean over directions of the explicit scheme has a wider one and takes 200 m.
    way, speed = {"quasi_static": (804.0, 0.399), "mts": (589.0, 0.327)}[scheme]
    assert metres == pytest.approx(way, rel=0.03)
    assert run.elements.u.mean() == pytest.approx(speed, rel=0.03)


@SCHEMES
def test_a_berg_that_is_moved_stays_there(scheme: str) -> None:
    run = model(scheme, Forcing.uniform(current=(0.0, 0.0)))
    run.advance(steps=3)
    there = run.elements.lon + 0.01
    run.elements.lon[:] = there
    run.advance(steps=2)
    np.testing.assert_allclose(run.elements.lon, there, rtol=0.0, atol=2e-4)


def test_a_berg_that_is_nudged_in_each_step_keeps_its_shape() -> None:
    """As by an assimilation of positions; displacements by load are no part of the shape."""
    alone, nudged = model("quasi_static"), model("quasi_static")

    def nudge(run: Model) -> None:
        run.elements.lon[:] += 1e-7 * (-1.0) ** run.step_number

    nudged.after_step.append(nudge)
    for run in (alone, nudged):
        run.advance(days=2)
    count = alone.elements.size
    # Unloaded, the ends would have come 300 m nearer to each other if each nudge took the bent shape for the free one.
    np.testing.assert_allclose(distances(nudged, count), distances(alone, count), rtol=0.0, atol=1.0)


@SCHEMES
def test_pieces_that_a_user_cuts_apart_go_their_ways(scheme: str) -> None:
    """They went on as one rigid body in the quasi-static scheme."""
    run = model(
        scheme, Forcing.eddy((-38.0, -56.0), radius=30e3, speed=0.5),
        **({} if scheme == "quasi_static" else {"contact": {"on_substeps": False, "spring": 0.0}}),
    )  # fmt: skip
    run.advance(steps=2)
    column = np.round(run.elements.lon, 3)
    middle = np.median(column)
    across = (column[run.bonds.first] < middle) != (column[run.bonds.second] < middle)
    assert 0 < across.sum() < 10
    run.bonds.status[across] = 1
    west, east = run.elements.lon < middle, run.elements.lon >= middle
    run.elements.u[east] += 0.3
    gap = run.elements.lon[east].min() - run.elements.lon[west].max()
    run.advance(steps=2)
    metres = (run.elements.lon[east].min() - run.elements.lon[west].max() - gap) * 111.2e3 * np.cos(np.deg2rad(56.0))
    assert 500.0 < metres < 1200.0


@SCHEMES
def test_a_load_acts_from_the_step_on_in_which_it_is_given(scheme: str) -> None:
    """It acted over half of its first step in the quasi-static scheme."""
    run = model(scheme, Forcing.uniform(current=(0.0, 0.0)))
    run.advance(steps=3)
    run.elements.load_x[:] = 1e-6 * run.elements.mass
    run.advance(steps=1)
    assert 0.95 * 1.8e-3 < run.velocity()[0].mean() < 1.01 * 1.8e-3


@SCHEMES
def test_a_berg_that_is_held_stops(scheme: str) -> None:
    run = model(scheme, Forcing.uniform(current=(0.3, 0.0)))
    run.advance(steps=5)
    run.elements.static[:] = 1.0
    there = run.elements.lon.copy()
    run.advance(steps=2)
    np.testing.assert_array_equal(run.elements.lon, there)


def test_a_restart_knows_what_was_changed_before_it(tmp_path: Path) -> None:
    """Bit for bit as without it: a berg that was pushed between the last step and the restart file included."""
    straight = model("quasi_static")
    straight.advance(steps=5)
    straight.elements.u[:] += 0.1
    straight.save(tmp_path / "berg.nc")
    other = Model.resume(tmp_path / "berg.nc", straight.forcing)
    for run in (straight, other):
        run.append(Iceberg.field(2, (-20.0, -19.9, -60.0, -59.9), seed=1).elements)
        run.advance(steps=3)
    np.testing.assert_array_equal(other.elements.lon, straight.elements.lon)
    np.testing.assert_array_equal(other.bonds.normal_stress, straight.bonds.normal_stress)


def lone(*numbers: int) -> Model:
    """Return a model of some of four bergs far apart: one is held by a seamount, one stands, one drifts, one is swept along."""
    bergs = [Iceberg.rectangle("9 km", "6 km", thickness="250 m", placement=(-38.0 + 4.0 * k, -56.0)) for k in numbers]
    sea = Forcing.seamount((-38.0, -56.0), height="2830 m", width="60 km", depth="3000 m")
    for east, speed in ((-38.0, 0.1), (-30.0, 0.02), (-26.0, 0.9)):
        sea = sea + Forcing.eddy((east + 0.1, -56.2), radius="30 km", speed=speed)
    return Model(Iceberg.join(bergs), sea, Parameters(), start="2020-12-09")


def test_the_path_of_a_berg_is_to_the_last_digit_the_one_that_it_has_alone() -> None:
    """All bergs went through Newton's method until the last had settled, by the speed of the fastest among them."""
    together = lone(0, 1, 2, 3)
    together.advance(days=2)
    for k in range(4):
        alone = lone(k)
        alone.advance(days=2)
        count = alone.elements.size
        rows = slice(k * count, (k + 1) * count)
        for name in ("lon", "lat", "u", "v", "spin"):
            np.testing.assert_array_equal(getattr(together.elements, name)[rows], getattr(alone.elements, name))
