"""Stays on the sea floor: one notion of aground, as events, in words, in run files and restarts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from contract import FORCES
from fakes import FakeForcing, FakeModel
from riftberg import Forcing, Iceberg, Model, Parameters, explain, open_run
from riftberg.cli.main import app
from riftberg.cli.run import short_summary
from riftberg.constants import GRAVITY
from riftberg.diagnostics.summary import summarize
from riftberg.diagnostics.why import reason_lines
from riftberg.engines.common.forces.media import on_the_floor
from riftberg.engines.common.fragments.grounding_log import GroundingEvent, GroundingLog, mass_on_floor
from riftberg.runs.groundings import list_stays, title_lines
from riftberg.runs.progress import ProgressRecorder
from riftberg.runs.restart import load_state
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene

HOUR = 3600.0


def model_of(depth: float = 500.0, scheme: str = "quasi_static", law: str | None = None, **grounding: Any) -> Model:
    """Two by four elements of 200 m: a draft of 165.9 m."""
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, radius=1500.0, placement=(-37.0, -55.0), velocity=(0.1, 0.0))
    parameters = Parameters(
        grounding={"law": law, **grounding} if law else grounding, stepping={"scheme": scheme, "time_step": HOUR}
    )
    model = Model(berg, Forcing.uniform((0.1, 0.0), depth=depth), parameters, "2025-02-28 06:00")
    model._long_step.begin(model)
    return model


def after(
    model: Model,
    hours: float,
    *,
    loads: dict[int, float],
    east: float = 0.0,
    speed: float = 0.0,
    clearance: float = math.nan,
    shatters: bool = False,
) -> None:
    """Let the log see a step at whose end the floor carries ``loads`` (N, by row); the berg has gone ``east`` (m)."""
    before, began = model.elements.copy(), model.time
    el = model.elements
    el.lon[:] += east / (math.radians(1.0) * 6_371_229.0 * math.cos(math.radians(55.0)))
    el.u_sync[:], el.v_sync[:] = speed, 0.0
    for array in el.keel:
        array[:] = 0.0
    for row, load in loads.items():
        el.keel.floor_load[row], el.keel.floor_hold[row] = load, 0.5 * load
        el.keel.floor_lift[row], el.keel.floor_stress[row], el.keel.floor_yield[row] = (
            1e-10 * load,
            1e-4 * load,
            2e-11 * load,
        )
    model.time += hours * HOUR
    if shatters:
        model.bonds.status[:] = 1
        model.fragments.update(el, model.bonds, model.time, model.constants)
    forces = np.zeros((el.size, len(FORCES), 2))
    forces[:, FORCES.index("water"), 0], forces[:, FORCES.index("sea_floor"), 0] = 2e6, -1e9
    model.groundings.update(
        before, el, (began, model.time), model.fragments, model.constants, lambda: forces, clearance,
        model.forcing.sea_level,
    )  # fmt: skip


def ground_of(model: Model) -> dict[str, Any]:
    """Return what the summary says of the sea floor."""
    ground: dict[str, Any] = summarize(model)["ground"]
    return ground


def berg_line(model: Model) -> str:
    """Return the line of the berg in the short summary, from where it stands on."""
    return short_summary(summarize(model))[1].partition("(72 km2), ")[2]


def ground_lines(model: Model) -> list[str]:
    """Return the lines of the short summary on the sea floor, below that of the berg."""
    return short_summary(summarize(model))[2:]


class Said:
    """What a run prints on its way of the sea floor, from a state on."""

    def __init__(self, model: Model, capsys: pytest.CaptureFixture[str]) -> None:
        self._bar, self._model, self._said = ProgressRecorder(1e3), model, capsys
        capsys.readouterr()
        self._bar.start(model)

    def lines(self) -> list[str]:
        """Return what is printed after a step."""
        self._bar.record(self._model)
        return self._said.readouterr().err.splitlines()


def test_a_stay_begins_at_the_touch_and_lasts_until_the_floor_carries_nothing() -> None:
    model = model_of()
    after(model, 1, loads={}, east=360.0, speed=0.1)
    assert model.groundings.rows == []
    assert model.groundings.clearance == pytest.approx(500.0 - 200.0 * 850.0 / 1025.0, abs=0.1)
    after(model, 1, loads={7: 4e9}, east=200.0, speed=0.05)
    after(model, 1, loads={6: 1e9, 7: 6e9}, east=30.0, speed=1e-6)
    after(model, 1, loads={7: 5e9}, east=1.0, speed=1e-6)
    after(model, 1, loads={})
    (row,) = model.groundings.rows
    assert (row.number, row.time, row.end, row.seconds) == (1, 1 * HOUR, 4 * HOUR, 3 * HOUR)
    assert (row.elements, row.carried, row.times) == (1, 1, 1)
    assert (row.load, row.capacity) == (5e9, 2.5e9)
    assert (row.lift, row.stress, row.gouge) == pytest.approx((0.6, 6e5, 0.12))  # the largest, when it bore most
    assert row.pressing == pytest.approx(8 * 2e6)  # all forces but that of the floor
    assert row.way == pytest.approx(231.0, rel=3e-3)
    assert row.stopped == pytest.approx(230.0, rel=3e-3)
    # Element 7 is the north-eastern one: three quarters of the length east of the centre, half of the width north.
    assert row.towards == pytest.approx(math.degrees(math.atan2(4500.0, 1500.0)), abs=0.5)


def test_a_tide_that_lifts_the_berg_for_a_while_belongs_to_the_stay() -> None:
    """Sisters: off for five hours, and for seven."""
    for off, stays, times in ((5, 1, 2), (7, 2, 1)):
        model = model_of()
        after(model, 1, loads={0: 1e9})
        after(model, off, loads={})
        after(model, 1, loads={0: 1e9})
        rows = model.groundings.rows
        assert [row.times for row in rows] == [times] * stays
        assert sum(row.seconds for row in rows) == 2 * HOUR


def test_small_fragments_have_no_events() -> None:
    """A piece of an eighth has, a piece of a berg whose first area was thirty times as large has not."""
    for first_area, told in ((8.0, 1), (30.0, 0)):
        model = model_of()
        berg = model.fragments.rows[0]
        model.fragments.rows[0] = type(berg)(**{**vars(berg), "area": first_area * 9e6})
        model.fragments.rows.append(type(berg)(**{**vars(berg), "number": 2, "parent": 1, "area": 9e6}))
        model.elements.berg[3] = 2
        after(model, 1, loads={3: 1e9})
        assert len(model.groundings.rows) == told


def test_a_berg_that_shatters_in_the_step_in_which_it_touches_has_a_stay(capsys: pytest.CaptureFixture[str]) -> None:
    """Bug: all its pieces were too small for a stay at the end of that step, and the touch stood nowhere."""
    berg = Iceberg.rectangle(24e3, 18e3, thickness=200.0, radius=1500.0, placement=(-37.0, -55.0))
    model = Model(berg, Forcing.uniform(depth=500.0), Parameters(stepping={"time_step": HOUR}), "2025-02-28 06:00")
    model._long_step.begin(model)
    el, said = model.elements, Said(model, capsys)
    after(model, 1.0, loads={20: 3e8, 21: 1e8}, shatters=True)
    assert np.unique(el.berg).size == el.size == 48
    (row,) = model.groundings.rows
    assert (row.number, row.elements, row.load) == (1, 2, pytest.approx(4e8))
    assert 0.0 == row.time < row.end == HOUR
    (told,) = (line for line in said.lines() if "aground" in line)
    assert told.startswith("2025-02-28 06:00  aground at ")
    assert "2 of 48 elements" in told
    after(model, 1.0, loads={20: 3e8})
    assert model.groundings.rows == [row]  # pieces that have been small have no stays


def test_what_a_bed_carries_is_the_one_notion_of_aground() -> None:
    """Deep water at the centre and a load at its edge: aground by the bed; shallow water at the centre and none: afloat."""
    for depth, loads in ((500.0, {2: 3e9}), (100.0, {})):
        model = model_of(depth)
        after(model, 1, loads=loads)
        el, p = model.elements, model.constants
        touching = on_the_floor(el.thickness, el.environment.depth, el.keel.floor_load, p)
        assert np.flatnonzero(touching).tolist() == list(loads)
        assert mass_on_floor(el, p).sum() == pytest.approx(sum(loads.values()) / GRAVITY)


def test_with_a_drag_the_floor_carries_what_the_water_does_not() -> None:
    draft = 200.0 * 850.0 / 1025.0
    for coefficient, share in ((1e4, 1.0 - 100.0 / draft), (0.0, 0.0)):
        model = model_of(100.0, "mts", coefficient=coefficient)
        mass = mass_on_floor(model.elements, model.constants)
        np.testing.assert_allclose(mass, share * model.elements.mass, rtol=1e-3)
    assert not mass_on_floor(model_of(100.0, law="none").elements, model_of(100.0, law="none").constants).any()


def test_touches_and_coming_free_are_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    model = model_of()
    teller = Said(model, capsys)
    after(model, 1, loads={6: 1e9, 7: 4e9})
    assert teller.lines() == [
        "2025-02-28 06:00  aground at 54.99 S, 36.93 W: 2 of 8 elements, keel lifted by up to 0.4 m"
    ]
    after(model, 24, loads={7: 4e9})
    assert teller.lines() == []
    after(model, 1, loads={})
    assert teller.lines() == []  # a tide may set it down again
    after(model, 6, loads={})
    assert teller.lines() == ["2025-03-01 07:00  afloat again after 1 day"]
    after(model, 6, loads={})
    assert teller.lines() == []
    assert Said(model, capsys).lines() == []  # as after a restart


def test_what_the_sea_level_of_files_adds_to_a_chart_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A level above the geoid, and a depth that may count from another zero; below 5 cm nothing is said."""
    for level, said in ((-0.63, True), (0.02, False)):
        model = model_of()
        model.forcing = LeveledForcing(level)
        teller = Said(model, capsys)
        after(model, 1, loads={6: 1e9})
        lines = teller.lines()
        assert len(lines) == 1 + said
        if said:
            assert "the sea level of the files stands at -0.63 m there and counts in the depth" in lines[1]
        after(model, 30, loads={})
        after(model, 1, loads={6: 1e9})
        assert all("sea level" not in line for line in teller.lines())
        assert [stay["sea_level"] for stay in ground_of(model)["stays"]] == [level, level]
        assert any("the sea stood -0.63 m from the zero of the depth" in line for line in ground_lines(model)) == said


class LeveledForcing(FakeForcing):
    """A chart with a sea level from files."""

    has_own_level_datum = True

    def __init__(self, level: float) -> None:
        self.level = level

    def sea_level(self, lon: Any, lat: Any, time: float) -> Any:
        return np.full(np.shape(lon), self.level)


@pytest.mark.parametrize("scheme", ["mts", "runge_kutta"])
def test_a_keel_deep_inside_the_floor_is_told_once_where_a_drag_holds_nothing(
    scheme: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bonds = {"law": "spring", "spring": 1e-7} if scheme == "runge_kutta" else {}
    berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, radius=1500.0, placement=(-37.0, -55.0))
    fracture = {"enabled": False}
    for depth, said in ((140.0, True), (163.0, False)):
        parameters = Parameters(bonds=bonds, fracture=fracture, stepping={"scheme": scheme, "time_step": 600.0})
        model = Model(berg, Forcing.uniform((0.1, 0.0), depth=depth), parameters)
        model._long_step.begin(model)
        teller = Said(model, capsys)
        words = "the keel is up to 26 m below the floor: the law linear does not hold it (grounding.law)"
        assert teller.lines() == ([words] if said else [])
        assert teller.lines() == []


def test_the_summary_says_what_holds_and_what_other_beds_would() -> None:
    model = model_of()
    after(model, 1, loads={7: 4e11}, east=300.0, speed=0.0)
    ground = ground_of(model)
    assert (ground["law"], ground["sediment"], ground["first"]) == ("seabed", "sand", "2025-02-28T06:00:00")
    assert (ground["load"], ground["capacity"], ground["hours"], ground["times"]) == (4e11, 2e11, 1.0, 1)
    assert ground["way_aground"] == pytest.approx(300.0, rel=3e-3)
    # On clay a keel is as wide as 6 s_u asks for: a sixth of the load, where sand and rock hold half of it.
    assert ground["capacity_on"] == {"clay": pytest.approx(4e11 / 6.0), "rock": pytest.approx(2e11)}
    weight = float(model.elements.mass.sum()) * GRAVITY
    assert berg_line(model) == (
        f"aground since 28 Feb 06:00 (1 element, load 4e+11 N, {100 * 4e11 / weight:.2g} % of its weight; "
        "the bed can hold 2e+11 N, the sea presses with 1.6e+07 N; it has stood still since 28 Feb 07:00)"
    )
    assert ground_lines(model) == [
        "  the bed is taken to be sand; the same load could hold 6.7e+10 N on clay, 2e+11 N on rock (grounding.sediment)",
        "  the ice would bend by 40 MPa, more than it bears: a berg that has lain there for weeks bears less "
        "(grounding.ice_modulus, fracture.flexural_strength)",
    ]
    after(model, 8, loads={})
    assert berg_line(model) == "aground for 60 min from 28 Feb 06:00 on, afloat since 28 Feb 07:00"


def test_since_when_it_is_held_or_slides_is_told() -> None:
    """Sliding, held, held on, sliding again; and a piece without a stay of its own is not passed over."""
    model = model_of()
    for speed, hours, since, said in (
        (0.1, 1, None, "it slides, 300 m so far)"),
        (0.0, 1, "2025-02-28T08:00:00", "it has stood still since 28 Feb 08:00)"),
        (0.0, 5, "2025-02-28T08:00:00", "it has stood still since 28 Feb 08:00)"),
        (0.1, 1, None, "it slides, 599 m so far)"),
    ):
        after(model, hours, loads={7: 4e11}, east=300.0 if speed else 0.0, speed=speed)
        ground = ground_of(model)
        (stay,), (read,) = ground["stays"], list_stays(model)
        assert stay["held_since"] == since
        assert berg_line(model).endswith(said)
        assert ground["elements_of_small_pieces"] == 0
        still = f"held since {since and '28 Feb 08:00'}" if since else f"slid {stay['way_aground']:.0f} m"
        assert title_lines([read]) == [f"Aground 28 Feb 06:00 to the end: 1 element, {still}"]
    model.elements.berg[7] = 2  # a piece of an eighth that broke off and stands, while the rest has gone
    model.groundings.rows = []
    assert ground_of(model)["elements_of_small_pieces"] == 1
    assert ground_lines(model)[0] == "  1 element of small pieces stands aground"


@pytest.mark.parametrize(("off", "towards"), [(0.0, None), (4.5e3, 90.0)])
def test_a_side_that_touched_is_told_and_none_of_a_berg_on_its_middle(off: float, towards: float | None) -> None:
    x = -37.0 + off / (111e3 * math.cos(math.radians(55.0)))
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, radius=1500.0, placement=(-37.0, -55.0))
    model = Model(berg, Forcing.seamount((x, -55.0), height=100.0, width=700.0, depth=262.0))
    model.run(steps=1)
    stay = ground_of(model)["stays"][0]
    assert stay["towards"] == (None if towards is None else pytest.approx(towards, abs=5.0))


def test_pieces_aground_are_told_beside_the_largest() -> None:
    """A berg that lies half on a bank breaks in bending: what the bed carries is not the load of the largest piece alone."""
    berg = Iceberg.rectangle(18e3, 9e3, thickness=200.0, radius=1500.0, placement=(-37.0, -55.0))
    bank = Forcing.slope((-37.0, -55.0), 0.0, 0.001, 164.0)
    model = Model(berg, bank, Parameters(fracture={"flexural_strength": 2e5}))
    model.run(steps=1)
    text = short_summary(summarize(model))
    k = next(k for k, line in enumerate(text) if " pieces (" in line)
    assert "aground since" in text[k]
    assert text[k + 1].startswith("  3 of them stand aground: load 3.7e+12 N; the bed can hold 1.8e+12 N"), text


def test_of_many_bergs_the_number_that_stands_aground_is_told() -> None:
    """Of twelve bergs four are thicker than the sea is deep."""
    lon, thickness = -37.0 + 0.1 * np.arange(12), np.where(np.arange(12) < 4, 220.0, 100.0)
    bergs = Iceberg.from_points(lon, -55.0 + 0.0 * lon, thickness=thickness, radius=100.0)
    model = Model(bergs, Forcing.uniform((0.1, 0.0), depth=170.0), Parameters(bonds={"law": "none"}))
    model.run(steps=1)
    line = short_summary(summarize(model))[2]
    assert line.startswith("  4 of them stand aground: load "), short_summary(summarize(model))
    assert "the bed can hold" in line


def test_a_run_that_passes_near_the_floor_says_how_near() -> None:
    for depth, said in (
        (166.2, ["  the keel passed 0.3 m above the floor; a chart is good to some tens of metres"]),
        (178.0, ["  the keel passed 12 m above the floor; a chart is good to some tens of metres"]),
        (800.0, []),
    ):
        model = model_of(depth)
        after(model, 1, loads={})
        assert ground_lines(model) == said


@pytest.mark.parametrize(
    ("depth", "scheme", "law", "said"),
    [
        (200.0, "quasi_static", "seabed", "the keel is 166 m deep; the sea floor has at least 200 m under the berg (34 m of "
         "water below the keel); within 20 km of it at least 200 m"),
        (150.0, "quasi_static", "seabed", "the keel stands 16 m deeper: it starts aground"),
        (1e4, "quasi_static", "seabed", ""),
        (150.0, "mts", "none", ""),
    ],
)  # fmt: skip
def test_keel_and_floor_at_the_start_are_named(depth: float, scheme: str, law: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(
        "start: 2025-02-28 06:00\ndays: 0.25\nberg: {rectangle: {length: 12 km, width: 6 km}, placement: [-37, -55]}\n"
        f"forcing: {{uniform: {{current: [0.1, 0.0], depth: {depth}}}}}\n"
        f"parameters: {{grounding: {{law: {law}}}, stepping: {{scheme: {scheme}}}}}\n"
    )
    told = CliRunner().invoke(app, ["doctor", "--for", str(tmp_path / "e.yaml")])
    assert told.exit_code == 0, told.output
    words = " ".join(told.output.split())
    assert said in words if said else "keel" not in words


def test_of_several_bergs_the_keel_that_is_nearest_to_the_floor_is_named(tmp_path: Path) -> None:
    """A thin berg in shallow water and a thick one in deep water are both afloat."""
    (tmp_path / "e.yaml").write_text(
        "start: 2025-02-28 06:00\ndays: 0.25\nbergs:\n"
        "  - {rectangle: {length: 6 km, width: 6 km}, placement: [-37, -55], thickness: 100 m}\n"
        "  - {rectangle: {length: 6 km, width: 6 km}, placement: [-35, -55], thickness: 250 m}\n"
        "forcing: {slope: {point: [-37, -55], towards: 90, gradient: 0.002, depth: 120}}\n"
    )
    told = CliRunner().invoke(app, ["doctor", "--for", str(tmp_path / "e.yaml")])
    words = " ".join(told.output.split())
    assert "the keel of berg 1 is 83 m deep" in words
    assert "34 m of water below the keel" in words


def test_a_keel_that_is_refused_is_not_ready(tmp_path: Path) -> None:
    (tmp_path / "e.yaml").write_text(
        "start: 2025-02-28 06:00\ndays: 0.25\nberg: {rectangle: {length: 12 km, width: 6 km}, placement: [-37, -55]}\n"
        "forcing: {uniform: {depth: 160}}\nparameters: {grounding: {start: refuse}}\n"
    )
    told = CliRunner().invoke(app, ["doctor", "--for", str(tmp_path / "e.yaml")])
    assert told.exit_code == 1
    assert "m below the sea floor" in " ".join(told.output.split())


ROW = GroundingEvent(
    1, HOUR, 5 * HOUR, -38.9, -55.0, 45.0, 3, 2, 4 * HOUR, 5, 4e11, 2e11, 3e9, 0.4, 2.5e5, 0.1, 900.0, 310.0, 3 * HOUR,
    -0.4,
)  # fmt: skip


def run_with(rows: list[GroundingEvent], path: Path, *, latlon: bool = True) -> FakeModel:
    model = FakeModel(4, 2, latlon=latlon, parameters=Parameters(stepping={"time_step": HOUR}))
    writer = RunWriter(path, every_hours=1.0)
    writer.start(model)  # type: ignore[arg-type]
    for _ in range(6):
        model.step()
        model.groundings = GroundingLog(rows)
        writer.record(model)  # type: ignore[arg-type]
    writer.finish(model)  # type: ignore[arg-type]
    return model


@pytest.mark.parametrize("latlon", [True, False])
def test_run_file_and_why_know_the_stays(tmp_path: Path, latlon: bool) -> None:
    model = run_with([ROW], tmp_path / "run.nc", latlon=latlon)
    with open_run(tmp_path / "run.nc") as run:
        (stay,) = Scene(run).stays
        assert stay.event == ROW
        assert stay.as_dict() == {**list_stays(model)[0].as_dict(), "name": stay.name}  # type: ignore[arg-type]
        told = reason_lines(explain(run))[2]
        place = "55.00 S, 38.90 W" if latlon else "x -38.9 m, y -55 m"
        assert told.endswith(
            f"ground 2020-12-09 14:00 to 2020-12-09 18:00: touched with its north-eastern side at {place}; touched 2 times and "
            "stood for 4 h in all; stopped within 310 m; held by up to 2e+11 N against 3e+09 N; bending of the ice 0.25 MPa."
        ), told


def test_restarts_keep_the_stays_bit_for_bit(tmp_path: Path) -> None:
    model = model_of()
    after(model, 1, loads={7: 1.0 / 3.0})
    state = load_state(model.save(tmp_path / "a.restart.nc"), check=False)
    assert state.groundings.rows == model.groundings.rows
    assert state.groundings.clearance == model.groundings.clearance


def test_a_step_that_is_taken_back_takes_back_the_stay() -> None:
    model = model_of()
    go_back = model.checkpoint()
    after(model, 1, loads={7: 1e9})
    go_back()
    assert model.groundings.rows == []


@pytest.mark.compiled
def test_a_landing_is_told_at_once_and_stands_in_all_that_a_run_leaves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    draft = 250.0 * 850.0 / 1025.0
    berg = Iceberg.rectangle(
        6e3, 3e3, thickness=250.0, radius=750.0, placement=(0.0, 0.0), density=850.0, latlon=False, velocity=(0.3, 0.0)
    )
    plane: dict[str, Any] = {"latlon": False, "latitude": 0.0}
    rising = Forcing.slope((3e3 + 20.0, 0.0), 90.0, -1e-3, draft, (1.0, 5000.0), latlon=False)
    model = Model(berg, Forcing.uniform((0.0, 0.0), **plane) + rising, Parameters(
        ice={"density": 850.0}, earth={"latlon": False, "f_plane": True, "reference_latitude": 0.0}, fracture={"enabled": False},
        grounding={"bending": False}, stepping={"time_step": 600.0},
    ))  # fmt: skip
    run = model.run(steps=6, output=tmp_path / "run.nc", every_hours=1.0, progress=True)
    assert "aground at x 2" in capsys.readouterr().err
    summary = summarize(model)
    (stay,) = summary["ground"]["stays"]
    assert stay["lasts"]
    assert 100.0 < stay["stopped_within"] < 200.0
    assert stay["load"] == pytest.approx(float(model.elements.keel.floor_load.sum()))
    assert stay["towards"] == pytest.approx(90.0, abs=1.0)
    with run:
        assert run["grounding_load"].values.tolist() == [stay["load"]]
        assert Scene(run).aground()[-1].sum() == stay["elements"] > 0
        assert "touched with its eastern side" in reason_lines(explain(run))[-2]  # before the strength of the ice
