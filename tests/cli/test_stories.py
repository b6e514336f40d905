"""What a run prints, writes and draws of itself: beams, collisions, runs in metres and runs of seconds."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fakes import SIDE, BendingModel, FakeModel
from riftberg.cli.main import app
from riftberg.cli.run import short_summary
from riftberg.compiled import kernels
from riftberg.config.units import area_text, duration_text, place_text
from riftberg.diagnostics.cases import Approach, BeamCase, approach
from riftberg.experiments import EXPERIMENTS, Info
from riftberg.experiments.cases import CANTILEVER, CANTILEVER_STORY
from riftberg.parameters import A68A_2022
from riftberg.runs.run_file import RunWriter, open_run
from riftberg.viz.cases import contact_records, draw_approach


def invoked(model: FakeModel, info: Info, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> Any:
    """Run the command line with an experiment that is this model."""
    monkeypatch.setattr("riftberg.experiments.build", lambda name, options=None: (model, info))
    monkeypatch.setattr(kernels, "is_warm", lambda: True)
    return CliRunner().invoke(app, ["run", info.name, "-o", "out", *arguments])


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_beam_tells_its_deflection_not_its_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bug: it told '1.55e+04 s per day', and '0 km2' at the end."""
    case = BeamCase(
        "clamped", CANTILEVER.columns, CANTILEVER.rows, (CANTILEVER.columns - 1) * SIDE, 3 * SIDE, 200.0, 5e7
    )
    info = Info("cantilever", title="Cantilever", days=2.0, output_every_hours=6.0, story=CANTILEVER_STORY)
    result = invoked(BendingModel(case), info, monkeypatch)
    assert result.exit_code == 0, result.output
    assert re.search(r"beam clamped at one end, loaded at the other with 1\.5e\+10 N: 145 km long", result.stdout)
    assert re.search(r"deflection of its end: [\d.]+ k?m; theory \(elastica\): [\d.]+ k?m, difference", result.stdout)
    assert "at the end:" not in result.stdout
    story = json.loads(Path("out/summary.json").read_text())["story"]
    assert story["held"] == "clamped"
    assert story["relative_difference"] == story["deflection_m"] / story["deflection_theory_m"] - 1.0
    assert Path("out/map.png").stat().st_size > 5000
    drawn = CliRunner().invoke(app, ["plot", "out", "--dpi", "40", "--format", "svg"])
    assert drawn.exit_code == 0, drawn.output
    assert [Path(line).name for line in drawn.stdout.split()] == ["story.svg", "stress.svg"]
    assert "theory, centre line" in Path("out/story.svg").read_text()


def test_a_run_of_another_berg_under_the_name_of_a_beam_has_the_usual_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    result = invoked(
        FakeModel(),
        Info("cantilever", days=2.0, output_every_hours=6.0, story=CANTILEVER_STORY),
        monkeypatch,
        "--no-map",
    )
    assert result.exit_code == 0, result.output
    assert "in 2 pieces (162, 54 km2)" in result.stdout
    assert CliRunner().invoke(app, ["plot", "out", "-k", "story"]).exit_code == 2
    assert CliRunner().invoke(app, ["plot", "out", "-k", "timeline", "--format", "docx"]).exit_code == 2


def test_events_of_runs_in_metres_name_x_before_y(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bug: y came first, unnamed, in metres that looked like degrees."""
    result = invoked(FakeModel(latlon=False), Info("metres", days=2.0, output_every_hours=6.0), monkeypatch, "--no-map")
    assert re.search(r"54 km2 broke off aground \(3 bonds\) at x -?[\d.]+ km, y -?[\d.]+ km\n", result.stdout)
    assert re.search(r"Berg: 24 elements, 216 km2 in 1 piece at x -?[\de.-]+ m, y -?[\de.-]+ m", result.stderr)
    told = CliRunner().invoke(app, ["why", "out", "--no-figure"])
    assert told.exit_code == 0, told.output
    assert re.search(r"the first at x -?[\d.]+ k?m, y -?[\d.]+ k?m", told.stdout.replace("\n", " "))


def test_a_run_of_seconds_tells_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    model = FakeModel(2, 1, parameters=A68A_2022.changed(stepping={"time_step": 1.0}))
    model.elements.length[:] = model.elements.width[:] = 0.5
    model.parameters = model.parameters.changed(earth={"latlon": False})
    result = invoked(
        model, Info("short", days=10.0 / 86_400.0, output_every_hours=1.0 / 3600.0), monkeypatch, "--no-map"
    )
    assert result.exit_code == 0, result.output
    assert re.search(
        r"^short: 10 s, 2 elements, 0 of 1 bonds broken, [\d.e-]+ s of computing$", result.stdout, re.MULTILINE
    )
    assert "in one piece (0.5 m2)" in result.stdout
    assert "per day" not in result.stderr


def test_lengths_areas_and_places_are_written_in_units_that_suit_them() -> None:
    assert [duration_text(days) for days in (17.0, 1.0, 0.347222, 0.01, 10.0 / 86_400.0)] == [
        "17 days", "1 day", "8.33 h", "14.4 min", "10 s",
    ]  # fmt: skip
    assert [area_text(area) for area in (4.248e9, 4.2e6, 2e4, 7.25, 0.0)] == [
        "4248 km2",
        "4.2 km2",
        "0.02 km2",
        "7.25 m2",
        "0 km2",
    ]
    assert place_text(-37.56, -54.93, latlon=True) == "54.930 S, 37.560 W"
    assert place_text(63e3, 60e3, latlon=False) == "x 63 km, y 60 km"
    assert place_text(350.0, 60.0, latlon=False) == "x 350 m, y 60 m"


def test_a_summary_without_a_clock_is_told_too() -> None:
    summary = {
        "experiment": "", "end": "2020-12-09T13:00:10", "days": 1e-4, "elements": 2, "bonds_broken": 0, "bonds_total": 1,
        "seconds_per_day": None, "wall_seconds": None, "breakups": [], "fragments": 1, "areas_km2": [3.0],
        "largest_km2": 3.0, "numerics": {"earth": {"latlon": True}},
    }  # fmt: skip
    assert short_summary(summary) == ["run: 8.64 s, 2 elements, 0 of 1 bonds broken", "  1 fragment at the end: 3 km2"]


class Meeting(FakeModel):
    """Two bergs that close, touch and part, in a channel of 40 km that they leave at its end."""

    def __init__(self) -> None:
        super().__init__(4, 4, latlon=False, parameters=A68A_2022.changed(bonds={"packing": "hexagonal"}))
        self.parameters = self.parameters.changed(earth={"period": 40e3}, contact={"distance": 4000.0})
        self.elements.berg[:] = np.where(self._column < 2, 1, 2)
        self._place()

    def _place(self) -> None:
        gap = 7500.0 - 0.3 * self.time if self.time < 25_000.0 else 0.05 * (self.time - 25_000.0)
        side = np.where(self._column < 2, -0.5, 0.5)
        self.elements.lon[:] = (35e3 + self._x + side * gap + 0.2 * self.time) % 40e3
        self.elements.lat[:] = self._y

    def _break(self) -> None:
        """Stay whole."""


def test_two_bergs_tell_when_they_meet(tmp_path: Path) -> None:
    Meeting().advance(1.0, recorders=[RunWriter(tmp_path / "run.nc", every_hours=1)])
    with open_run(tmp_path) as run:
        meeting = approach(run)
        facts = meeting.facts()
        assert facts["first_contact_s"] == pytest.approx(21_667.0, abs=3600.0)
        assert facts["closing_before_m_s"] == pytest.approx(0.3, rel=0.05)
        assert facts["fastest_parting_m_s"] == pytest.approx(0.05, rel=0.1)
        assert "the bergs close at 0.29 m/s and are in contact from 7 h on" in meeting.lines()[0]
        records = contact_records(meeting)
        assert records[0] == 0
        assert meeting.touching[records[1]]
        assert draw_approach(run, tmp_path / "story.png", dpi=40).stat().st_size > 5000


def test_bergs_that_miss_each_other_say_so() -> None:
    far = Approach(np.array([0.0, 1.0]), np.array([9e3, 8e3]), np.array([1e3, 1e3]), 780.0)
    assert far.lines() == ["  no contact: the smallest distance between elements is 8000 m"]
    assert contact_records(far) == [0, 1]


def test_stories_are_there_for_the_test_cases() -> None:
    told = {entry.name for entry in EXPERIMENTS if entry.load_story() is not None}
    assert told == {"supported-beam", "cantilever", "collision"}


@pytest.mark.parametrize(("distance", "reach"), [(4000.0, 4000.0), (100.0, 3223.7)])
def test_bergs_touch_at_the_distance_of_contact_or_where_their_elements_do(
    tmp_path: Path, distance: float, reach: float
) -> None:
    """Hexagons of 9 km2 hold circles of 1611.9 m."""
    model = Meeting()
    model.parameters = model.parameters.changed(contact={"distance": distance})
    model.advance(0.1, recorders=[RunWriter(tmp_path / "run.nc", every_hours=1)])
    with open_run(tmp_path) as run:
        assert approach(run).reach == pytest.approx(reach, rel=1e-4)
