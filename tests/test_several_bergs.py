"""Several bergs of any size in one run: distances that follow from their elements, meetings, names, one sea floor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from riftberg import A68A_2022_MTS, Forcing, Iceberg, Model, Parameters, explain
from riftberg.cli.run import short_summary
from riftberg.diagnostics.summary import summarize
from riftberg.diagnostics.why import reason_lines
from riftberg.errors import BergError
from riftberg.runs.scene import Scene

PLANE = {"latlon": False, "period": 0.0}
STILL = {"fracture": {"enabled": False}, "earth": PLANE}


def square(side: float, radius: float, x: float = 0.0, **options: Any) -> Iceberg:
    """Return a square berg on a plane."""
    return Iceberg.rectangle(
        side, side, placement=(x, 0.0), radius=radius, latlon=False, **{"thickness": 200.0, **options}
    )


def gap(model: Model, half: int, radius: float) -> float:
    """Return the distance of the facing rims of two bergs along x, m."""
    x = model.elements.lon
    return float(x[half:].min() - x[:half].max() - 2.0 * radius)


@pytest.mark.parametrize(("side", "radius"), [(800.0, 200.0), (2000.0, 500.0), (12e3, 3000.0)])
@pytest.mark.parametrize("scheme", ["mts", "quasi_static"])
def test_bergs_that_do_not_touch_do_not_push(side: float, radius: float, scheme: str) -> None:
    """The default preset pushed small bergs apart at 4 km, as A68a's pieces."""
    both = Iceberg.join([square(side, radius), square(side, radius, side + 30.0)])
    model = Model(both, Forcing.uniform(), Parameters(**STILL, stepping={"scheme": scheme}))
    model.advance(steps=4)
    np.testing.assert_array_equal(model.elements.u, 0.0)
    assert model.contacts.rows == []


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("scheme", "law"), [("mts", "dem"), ("mts", "spring"), ("mts", "none"), ("quasi_static", "dem"), ("verlet", "none")]
)
@pytest.mark.parametrize(("side", "radius"), [(800.0, 200.0), (6e3, 1500.0)])
def test_bergs_do_not_pass_through_each_other(side: float, radius: float, scheme: str, law: str) -> None:
    """Contact of 1e-7 s-2 in the long step let small bergs pass: 540 m in a step, in ice of 400 m."""
    if (scheme, radius) == ("verlet", 200.0):
        pytest.skip("a scheme without sub-steps needs a long step that resolves the contact")
    count = 1 if law == "none" else round(side / 2.0 / radius)
    left = square(2.0 * radius * count, radius, velocity=(0.3, 0.0))
    right = square(2.0 * radius * count, radius, 2.0 * radius * count + 200.0)
    dt = 600.0 if scheme == "verlet" else 1800.0
    p = Parameters(**STILL, bonds={"law": law}, stepping={"scheme": scheme, "time_step": dt}, drag={"ocean_scale": 0.0})
    model = Model(Iceberg.join([left, right], names=["left", "right"]), Forcing.uniform(), p)
    half = left.elements.size
    mass, momentum = model.elements.mass, float(model.elements.mass @ model.elements.u)
    nearest = np.inf
    for _ in range(round(14400.0 / dt)):
        model.step()
        nearest = min(nearest, gap(model, half, radius))
    assert nearest > -0.1 * radius
    u = model.velocity()[0]
    assert u[:half].mean() < u[half:].mean()
    # Only the drag of air and of the rims, small in still air, may take momentum.
    assert float(mass @ u) == pytest.approx(momentum, rel=0.1)
    (met,) = model.contacts.rows
    assert (met.first, met.second) == (1, 2)
    assert met.speed == pytest.approx(0.3, rel=0.1)


def test_a_collision_depends_on_the_bergs_that_meet_alone() -> None:
    """A berg far away takes the same steps whether others meet or not."""

    def run(others: bool) -> np.ndarray:
        bergs = [square(1200.0, 200.0, 60e3, velocity=(0.1, 0.0))]
        if others:
            bergs += [square(6e3, 1500.0, velocity=(0.3, 0.0)), square(6e3, 1500.0, 6200.0)]
        model = Model(Iceberg.join(bergs), Forcing.uniform(current=(0.1, 0.05), slope=(0.0, 0.0)), Parameters(**STILL))
        model.advance(steps=4)
        return np.array([model.elements.lon[:9], model.elements.u[:9]])

    np.testing.assert_array_equal(run(True), run(False))


@pytest.mark.slow
def test_bergs_of_different_packing_thickness_and_size_go_through_one_run(tmp_path: Path) -> None:
    large = Iceberg.rectangle(18e3, 9e3, thickness=250.0, placement=(-37.0, -56.0)).named("A")
    small = Iceberg.rectangle(
        1500.0, 900.0, thickness=80.0, placement=(-36.5, -56.0), radius=150.0, packing="hexagonal"
    )
    middle = Iceberg.rectangle(2e3, 2e3, thickness=120.0, placement=(-36.6, -56.05), radius=500.0)
    both = Iceberg.join([large, small, middle], names=["A", "B", "C"])
    assert both.names == ("A", "B", "C")
    np.testing.assert_allclose([float(both.elements.mass[both.elements.berg == k].sum()) for k in (1, 2, 3)],
                               [large.mass, small.mass, middle.mass], rtol=1e-14)  # fmt: skip
    ocean = Forcing.uniform((0.2, 0.0))
    half_hour = Parameters(stepping={"time_step": 1800.0})  # the large one alone would take an hour
    run = Model(both, ocean, half_hour).run(days=0.25)
    assert run["fragment_name"].values.tolist() == ["A", "B", "C"]
    assert sorted(set(run["corners"].values.tolist())) == [4, 6]
    # Each goes as it goes alone.
    for k, berg in enumerate((large, small, middle), 1):
        alone = Model(berg, ocean, half_hour).run(days=0.25)
        rows = run["berg"].values[:, 0] == k
        np.testing.assert_allclose(run["lon"].values[rows], alone["lon"].values, rtol=0, atol=1e-9)
    shapes = Scene(run).polygons(0)
    area = np.abs(
        np.sum(shapes[:, :, 0] * np.roll(shapes[:, :, 1], -1, 1) - shapes[:, :, 1] * np.roll(shapes[:, :, 0], -1, 1), 1)
    )
    metres = (np.pi / 180.0 * 6363827.0) ** 2 * np.cos(np.radians(run["lat"].values[:, 0]))
    np.testing.assert_allclose(0.5 * area * metres, run["length"] * run["width"], rtol=1e-3)


def cracked(tmp_path: Path | None = None) -> Model:
    """Return a run of two bergs of which one breaks: its eastern half has no bonds to speak of and another current."""
    west = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
    west = west.with_rifts([np.array([[-37.0, -56.1], [-37.0, -55.9]])], strength=1e-6)
    east = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-36.0, -56.0))
    model = Model(
        Iceberg.join([west, east], names=["W", "E"]),
        Forcing.uniform(current=(0.3, 0.0), wind=(5.0, 5.0), slope=(0.0, 0.0)),
    )
    model.advance(0.25)
    return model


def test_fragments_bear_the_name_of_their_berg_and_bergs_have_not_broken_off(tmp_path: Path) -> None:
    model = cracked()
    names = [(row.name, row.parent) for row in model.fragments.rows]
    assert names[:2] == [("W", 0), ("E", 0)]
    assert names[2][0] == "W.1"
    assert names[2][1] == 1
    summary = summarize(model)
    assert [b["name"] for b in summary["breakups"]] == ["W.1"]
    assert summary["breakups"][0]["parent_name"] == "W"
    assert [(b["name"], b["fragments"]) for b in summary["bergs"]] == [("W", 2), ("E", 1)]
    assert summary["collisions"] == []  # a piece that has just broken off has met nobody
    json.dumps(summary)
    model.save(tmp_path / "here.restart.nc")
    again = Model.resume(tmp_path / "here.restart.nc", model.forcing)
    assert again.fragments.rows == model.fragments.rows
    assert again.fragments.bergs == (("W", 8), ("E", 4))
    run = again.run(days=0.1)
    scene = Scene(run)
    assert [scene.name(n) for n in (1, 2, 3)] == ["W", "E", "W.1"]
    assert [scene.birth(n) is None for n in (1, 2, 3)] == [True, True, False]


def test_meetings_are_kept_by_a_restart(tmp_path: Path) -> None:
    left, right = square(1200.0, 200.0, velocity=(0.3, 0.0)), square(1200.0, 200.0, 1300.0)
    p = Parameters(**STILL)
    whole = Model(Iceberg.join([left, right]), Forcing.uniform(), p)
    whole.advance(steps=4)
    part = Model(Iceberg.join([left, right]), Forcing.uniform(), p)
    part.advance(steps=2)
    part.save(tmp_path / "half.restart.nc")
    rest = Model.resume(tmp_path / "half.restart.nc", Forcing.uniform())
    rest.advance(steps=2)
    assert len(whole.contacts.rows) == 1
    assert rest.contacts.rows == whole.contacts.rows
    np.testing.assert_array_equal(rest.elements.lon, whole.elements.lon)


def test_what_cannot_be_joined_is_refused() -> None:
    berg = square(1200.0, 200.0)
    cases: list[tuple[list[Iceberg], Any, str]] = [
        ([berg, square(1200.0, 200.0, 600.0)], None, "overlap"),
        ([berg, square(1200.0, 200.0, 5e3)], ["A", "A"], "two bergs are called 'A'"),
        ([berg, square(1200.0, 200.0, 5e3)], ["A"], "1 names for 2 bergs"),
        ([berg, square(1200.0, 200.0, 5e3, density=900.0)], None, "density"),
        ([berg, Iceberg.rectangle(6e3, 6e3, thickness=100.0)], None, "latlon"),
        ([], None, "no list of bergs"),
    ]
    for bergs, names, said in cases:
        with pytest.raises(BergError, match=said):
            Iceberg.join(bergs, names)
    for name in ("", " ", "x" * 61, 3, "a\nb"):
        with pytest.raises(BergError, match="is no name"):
            berg.named(name)  # type: ignore[arg-type]


def test_the_a68a_preset_keeps_the_published_distance_and_stiffness() -> None:
    contact = A68A_2022_MTS.contact
    assert (contact.spring, contact.distance, contact.on_substeps) == (1e-7, 4000.0, False)
    assert A68A_2022_MTS.bonds.spring == 0.00065359477124183
    default = Parameters(stepping={"scheme": "mts"})
    assert (default.contact.distance, default.contact.spring, default.bonds.spring) == (0.0, None, None)


@pytest.mark.quick(1)
@pytest.mark.parametrize("coefficient", [0.0, 1e4])
def test_the_sea_floor_is_one_for_berg_and_pieces(coefficient: float) -> None:
    """With grounding off the berg was told afloat and its pieces aground. On a bed: `tests/verification/test_landing.py`."""
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
    berg = berg.with_rifts([np.array([[-37.0, -56.1], [-37.0, -55.9]])], strength=1e-6)
    model = Model(
        berg,
        Forcing.uniform(current=(0.3, 0.0), wind=(5.0, 8.0), depth=100.0, slope=(0.0, 0.0)),
        Parameters(grounding={"coefficient": coefficient}, stepping={"scheme": "mts"}),
    )
    run = model.run(days=0.25)
    assert len(model.fragments.rows) > 1 or coefficient > 0.0
    aground = coefficient > 0.0
    assert {row.grounded for row in model.fragments.rows} == {aground}
    assert set(model.bonds.break_grounded[model.bonds.status != 0].tolist()) <= {int(aground)}
    assert bool(Scene(run).aground().any()) == aground


@pytest.mark.parametrize("law", ["spring", "dem", "none"])
@pytest.mark.parametrize("explicit", [True, False])
def test_the_sea_floor_stops_a_berg_whatever_the_bonds_and_sub_steps(law: str, explicit: bool) -> None:
    """Spring bonds with implicit sub-steps lost the drag of the sea floor without a word."""
    if law == "dem" and not explicit:
        pytest.skip("DEM bonds are explicit")
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.3, 0.0))
    p = Parameters(
        bonds={"law": law}, stepping={"scheme": "mts", "explicit_substeps": explicit}, fracture={"enabled": False}
    )
    model = Model(berg, Forcing.uniform(current=(0.3, 0.0), depth=100.0, slope=(0.0, 0.0)), p)
    model.advance(steps=4)
    assert np.abs(model.velocity()).max() < 0.02
    floor = model.applied_forces()[:, 5]
    assert np.abs(floor).max() > 1e3


@pytest.mark.slow
def test_why_tells_of_a_collision(tmp_path: Path) -> None:
    """Thirty explanations of bergs that were hit told of ringing."""
    beam = Iceberg.rectangle(18e3, 3e3, thickness=200.0, latlon=False).with_rifts(
        [np.array([[0.0, -5e3], [0.0, 5e3]])], strength=0.02
    )
    hammer = Iceberg.rectangle(3e3, 3e3, thickness=200.0, latlon=False, placement=(7.5e3, 3.4e3), velocity=(0.0, -0.4))
    model = Model(Iceberg.join([beam, hammer], names=["beam", "hammer"]), Forcing.uniform(), Parameters(earth=PLANE))
    run = model.run(days=0.25, every_hours=0.5, output=tmp_path / "run.nc")
    breakups = explain(run, smallest=0.0).breakups
    assert breakups[0].name == "beam.1"
    for breakup in breakups:
        assert breakup.collision is not None
        assert breakup.collision.berg == "hammer"
    text = " ".join(reason_lines(explain(run, smallest=0.0)))
    assert "beam.1" in text
    assert "broke in a collision: hammer met beam at 0.4 m/s" in text
    assert "ringing" not in text
    met, *_ = summarize(model)["collisions"]
    assert met["bergs"] == ["beam", "hammer"]
    assert met["lat"] == pytest.approx(1.7e3, abs=500.0)
    lines = short_summary(summarize(model))
    # The hammer's face reaches from the corner of two elements, at 6 km, to 9 km: which pair touched first is round-off.
    met_at = ("beam and hammer met at 0.4 m/s, at x 7500 m, y", "beam and hammer met at 0.4 m/s, at x 6000 m, y")
    assert any(words in line for line in lines for words in met_at)
    assert any("broke off beam afloat" in line and "at x " in line for line in lines)


def test_a_mixed_join_says_what_it_is_made_of() -> None:
    """Bug: 24 squares of 250 m and 6 hexagons of 1.5 km were "30 hexagonal elements of radius 500 m"."""
    small = Iceberg.rectangle("3 km", "2 km", thickness="150 m", placement=(-36.6, -56.0), radius="250 m")
    large = Iceberg.rectangle("9 km", "6 km", thickness="250 m", placement=(-37.0, -56.0), packing="hexagonal")
    whole = Iceberg.join([large, small])
    assert "30 square and hexagonal elements of radius 250 to 1612 m" in repr(whole)
    assert "square and hexagonal, radius 250 to 1612 m" in whole.describe()
    with pytest.raises(BergError, match="no list of bergs"):
        Iceberg.join(small)  # type: ignore[arg-type]
