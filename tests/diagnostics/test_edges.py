"""Bending of fronts and feet in the summary, and in the reasons of a run, with corners and strips."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import Forcing, Iceberg, Model, Parameters, explain, open_run
from riftberg.diagnostics.summary import summarize
from riftberg.diagnostics.why import reason_lines
from riftberg.life.edges import EdgeIce, edge_bending
from riftberg.physics.edge_bending import flexural_length, foot_moment, front_moment, surface_stress
from riftberg.plane import ConformalPlane

FEET: dict[str, Any] = {  # which break nothing in the step
    "footloose": {"enabled": True, "youngs": 9e9, "strength": 1e10},
    "melt": {"enabled": True, "temperature": -1.0, "salinity": 34.0},
}


def ran(berg: Iceberg, foot: float = 0.0, edge: float = 0.0, **groups: Any) -> dict[str, Any]:
    """Summary of a berg after a step; each metre of ``edge`` begins with a foot (m)."""
    plane = {} if berg.latlon else {"latlon": False}
    model = Model(
        berg, Forcing.uniform(wind=(0.1, 0.0)), Parameters(earth=plane, stepping={"time_step": 60.0}, **groups)
    )
    model.elements.life.fl_k[:] = foot * edge / model.elements.size
    model.advance(steps=1)
    (entry,) = json.loads(json.dumps(summarize(model)))["bergs"]
    return entry


@pytest.mark.parametrize(("packing", "angle"), [("square", 0.0), ("square", 23.0), ("hexagonal", 10.0)])
def test_a_rectangle_bends_most_at_a_corner(packing: Any, angle: float) -> None:
    """By 5 % more than along its sides, in the top, whichever way its lattice lies."""
    berg = Iceberg.rectangle(
        30e3, 18e3, thickness=200.0, radius=1000.0, placement=(-38.0, -56.0), packing=packing, lattice_angle=angle
    )
    front = ran(berg)["front"]
    assert front["stress"] == pytest.approx(1.05 * surface_stress(front_moment(200.0, 850.0), 200.0), rel=0.01)
    assert front["corner"] == pytest.approx(90.0, abs=4.0)
    assert abs(front["lat"] + 56.0) * 111.2 == pytest.approx(9.0, abs=1.0)
    assert abs(front["lon"] + 38.0) * 111.2 * np.cos(np.radians(56.0)) == pytest.approx(15.0, abs=1.0)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_narrow_lattice_has_no_sharp_corners(rows: int) -> None:
    """Sides of one element are too short for a corner; straightening them must not make a wedge."""
    berg = Iceberg.rectangle(20e3, 2e3 * rows, thickness=200.0, radius=1000.0, placement=(0.0, 0.0), latlon=False)
    corner = ran(berg)["front"]["corner"]
    assert corner is None or corner == pytest.approx(90.0, abs=8.0)
    assert rows < 3 or corner is not None


def test_a_wedge_bends_most_at_its_sharpest_corner() -> None:
    """A triangle of 90, 60 and 30 degrees, with feet: 30 degrees bend them 2.2 times as much, and fronts most at 60."""
    corners = 1e3 * np.array([[0.0, 0.0], [36.0, 0.0], [0.0, 36.0 / np.sqrt(3.0)]])
    outline = np.column_stack(ConformalPlane(-38.0, -56.0, 6.371e6).inverse(*corners.T))
    berg = Iceberg.from_outline(outline, thickness=200.0, radius=500.0)
    edge = float(np.hypot(*np.diff(corners, axis=0, append=corners[:1]).T).sum())
    entry = ran(berg, 5.0, edge, **FEET)
    assert entry["front"]["corner"] == pytest.approx(60.0, abs=5.0)
    assert entry["foot"]["corner"] == pytest.approx(30.0, abs=3.0)
    straight = surface_stress(foot_moment(5.0, 200.0, 850.0, flexural_length(9e9, 200.0))[0], 200.0)
    assert 2.0 < entry["foot"]["stress"] / straight < 2.4


def test_the_front_of_thick_ice_bends_most() -> None:
    berg = Iceberg.rectangle(30e3, 18e3, thickness=200.0, radius=1000.0, placement=(0.0, 0.0), latlon=False)
    berg.elements.thickness[(np.abs(berg.elements.lon) < 2e3) & (berg.elements.lat > 5e3)] = 300.0
    front = ran(berg)["front"]
    assert front["stress"] == pytest.approx(surface_stress(front_moment(300.0, 850.0), 300.0))
    assert front["corner"] is None
    assert abs(front["lon"]) < 2e3
    assert front["lat"] > 8e3


def test_elements_that_have_melted_at_their_sides_are_still_one_berg() -> None:
    """They lie as they did, and are half as wide."""
    e = Iceberg.rectangle(24e3, 12e3, thickness=200.0, radius=1000.0, placement=(0.0, 0.0), latlon=False).elements
    ice = EdgeIce(e.lon, e.lat, 0.5 * e.length, 0.5 * e.width, e.thickness)
    front = edge_bending(ice, Parameters(earth={"latlon": False})).front
    assert front.corner == pytest.approx(90.0, abs=4.0)
    assert (abs(front.lon), abs(front.lat)) == pytest.approx((12e3, 6e3), abs=1.5e3)


def test_a_lone_berg_bends_as_the_strip_that_it_is() -> None:
    """2.5 lambda wide, with feet of 10 m: 1.42 of a half plane, in its middle."""
    length = flexural_length(9e9, 200.0)
    berg = Iceberg.from_points([0.0], [0.0], length=20e3, width=2.5 * length, thickness=200.0, latlon=False)
    foot = ran(berg, 10.0, 2.0 * (20e3 + 2.5 * length), **FEET)["foot"]
    strip, inland = foot_moment(10.0, 200.0, 850.0, length, 2.5 * length)
    assert foot["stress"] == pytest.approx(surface_stress(strip, 200.0), rel=0.01)
    assert foot["inland"] == pytest.approx(inland, rel=0.01)


def test_without_footloose_calving_nothing_is_known_of_feet_and_nothing_of_what_is_gone() -> None:
    entry = ran(Iceberg.rectangle(6e3, 6e3, thickness=150.0, placement=(-38.0, -56.0)))
    assert entry["front"]["stress"] > 0.0
    assert entry["foot"] is None


def test_the_reasons_of_a_run_say_how_much_its_fronts_bend(tmp_path: Path) -> None:
    """Of its largest berg, which need not be the first; a model says it before it runs."""
    small = Iceberg.rectangle(6e3, 3e3, thickness=300.0, placement=(-39.0, -56.0))
    berg = Iceberg.rectangle(18e3, 9e3, thickness=200.0, placement=(-38.0, -56.0))
    model = Model(Iceberg.join([small, berg]), Forcing.uniform(), Parameters())
    described = model.describe()
    model.run(steps=1, output=tmp_path / "run.nc")
    with open_run(tmp_path / "run.nc") as run:
        text = " ".join(reason_lines(explain(run)))
    for said in (described, text, model.describe()):
        assert "fronts by up to 98 kPa of tension at the top" in said
        assert "pre-stress of 142 kPa" in said
