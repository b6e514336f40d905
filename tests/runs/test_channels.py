"""A berg that goes round a channel has gone all of its way: in summaries, tracks, run files, maps and comparisons."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fakes import EXPLICIT, FakeModel
from riftberg import FieldRules, Forcing, Grid, GriddedForcing, Iceberg, Model, Parameters
from riftberg.diagnostics.summary import summarize
from riftberg.runs.accessor import find_course
from riftberg.runs.run_file import memory_run
from riftberg.runs.scene import Scene
from riftberg.runs.tracks import DailyTrack

LENGTH = 20e3
PLANE = {"latlon": False, "f_plane": True, "reference_latitude": 0.0, "period": LENGTH}
STEP = 1800.0


def current_on(grid: Grid, speed: float) -> GriddedForcing:
    """A uniform current on a grid that takes bergs back by a period."""
    fields = grid.fields(uo=np.full((grid.arrays.nj, grid.arrays.ni), speed))
    return GriddedForcing(grid, [fields, fields], np.array([0.0, 10.0 * 86400.0]), FieldRules())


def bergs(speed: float, **where: Any) -> Iceberg:
    """Two bergs of one element each, one of which begins across the seam."""
    return Iceberg.join([
        Iceberg.rectangle(2e3, 2e3, thickness=200.0, radius=1e3, latlon=False, placement=(x, y), velocity=(speed, 0.0), **where)
        for x, y in ((19.9e3, 5e3), (4e3, 15e3))
    ])  # fmt: skip


def channel(speed: float, kind: str) -> Model:
    """``kind``: grid, on which positions are taken back, or formula, in which they go on."""
    sea = (
        Forcing.uniform(current=(speed, 0.0), slope=(0.0, 0.0))
        if kind == "formula"
        else current_on(Grid.cartesian(8, 8, 2500.0, period=LENGTH), speed)
    )
    return Model(bergs(speed), sea, Parameters(earth=PLANE, stepping={"time_step": STEP}))


@pytest.mark.quick(2)
@pytest.mark.parametrize("kind", ["grid", "formula"])
@pytest.mark.parametrize("speed", [0.35, -0.35])
def test_a_berg_has_gone_all_the_way_round_a_channel(speed: float, kind: str) -> None:
    """Bug: of 31.6 km east in a channel of 20 km, `riftberg run collision` told 8.7 km west."""
    model, track = channel(speed, kind), DailyTrack()
    with memory_run(None, 48.0) as writer:
        model.advance(days=2, recorders=[writer, track])
        run = writer.dataset()
    way = speed * 2 * 86400.0
    summary = summarize(model, track=track.rows)
    for entry in summary["bergs"]:
        assert entry["drift_east_km"] == pytest.approx(way / 1e3, rel=0.02)
    assert (entry["lon"] - entry["drift_east_km"] * 1e3 - 4e3) % LENGTH == pytest.approx(0.0, abs=1.0)
    rows = [row["lon"] for row in summary["track"]]
    assert rows[-1] - rows[0] == pytest.approx(way, rel=0.02)
    assert np.diff(Scene(run).x[[0, -1]], axis=0) == pytest.approx(way, rel=0.02)
    course = find_course(run)
    assert course.x[-1] - course.x[0] == pytest.approx(way, rel=0.02)
    assert run.riftberg.compare(run)["distance"].values == pytest.approx(0.0, abs=1e-3)
    if kind == "grid":
        assert 0.0 <= model.elements.lon.min() <= model.elements.lon.max() <= LENGTH


@pytest.mark.slow
def test_runs_that_differ_by_a_turn_of_the_channel_are_that_far_apart() -> None:
    """A berg at rest and one that comes back to the same place."""
    runs = []
    for speed in (0.0, LENGTH / (2 * 86400.0)):
        model = channel(speed, "grid")
        with memory_run(None, 12.0) as writer:
            model.advance(days=2, recorders=[writer])
            runs.append(writer.dataset())
    distance = runs[0].riftberg.compare(runs[1])["distance"].values
    assert distance == pytest.approx(np.linspace(0.0, LENGTH, distance.size), rel=0.02)


def test_turns_are_known_after_a_restart(tmp_path: Any) -> None:
    whole, model = channel(0.35, "grid"), channel(0.35, "grid")
    whole.advance(days=1.5)
    model.advance(days=1)
    again = Model.resume(model.save(tmp_path / "r.nc"), model.forcing)
    again.advance(days=0.5)
    assert again.turns.tolist() == whole.turns.tolist()
    assert again.turns.tolist() == [3.0, 2.0]
    assert summarize(again)["bergs"] == summarize(whole)["bergs"]


@pytest.mark.quick(1)
@pytest.mark.parametrize("width", [8.0, 360.0])
def test_drift_round_a_sector_and_across_the_end_of_a_globe(width: float) -> None:
    """Longitudes of a sector repeat after its width: 2 days at 1 m/s are 2.7 degrees at 55 S, in a sector of 8 over its end."""
    lon, lat = np.meshgrid(-width / 2 + width / 16 * np.arange(17), -56.0 + 0.25 * np.arange(9))
    grid = Grid.from_corners(lon, lat, period=width, includes_southwest=True, cyclic=True)
    p = Parameters(earth={"period": width}, stepping={"time_step": STEP})
    berg = Iceberg.rectangle(
        2e3, 2e3, thickness=200.0, radius=1e3, placement=(width / 2 - 0.1, -55.0), velocity=(1.0, 0.0)
    )
    model = Model(berg, current_on(grid, 1.0), p)
    with memory_run(None, 48.0) as writer:
        model.advance(days=2, recorders=[writer])
        run = writer.dataset()
    (entry,) = summarize(model)["bergs"]
    assert entry["drift_east_km"] > 60.0
    way = np.degrees(entry["drift_east_km"] * 1e3 / (p.earth.radius * np.cos(np.radians(-55.0))))
    assert float(np.diff(Scene(run).x[:, 0])[-1]) == pytest.approx(way, rel=0.01)
    assert np.ptp(find_course(run).x) == pytest.approx(way, rel=0.01)


def test_pieces_that_break_off_are_marked_beside_the_track() -> None:
    """Births stand in the domain where a grid takes bergs back; the track goes on."""
    model = FakeModel(latlon=False, break_time=43_200.0, parameters=EXPLICIT.changed(earth=PLANE))
    with memory_run(None, 3.0) as writer:
        model.advance(1, recorders=[writer])
        run = writer.dataset()
    (born,) = find_course(run).births
    for turns in (-3.0, 2.0):
        moved = run.assign(fragment_x=run["fragment_x"] + turns * LENGTH)
        assert find_course(moved).births[0]["lon"] == pytest.approx(born["lon"])
