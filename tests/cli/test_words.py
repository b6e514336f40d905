"""Words on the screen: places, results of each berg, speeds without compilation, names that are nearly right."""

from __future__ import annotations

import re
import time as clock
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numba.core import event

from riftberg import Forcing, Grid, Iceberg, Model, Parameters
from riftberg.cli.run import ledger_lines, short_summary
from riftberg.diagnostics.summary import summarize
from riftberg.errors import ForcingError
from riftberg.products import window
from riftberg.runs.progress import ProgressRecorder, Stopwatch


def adrift(**melt: Any) -> Model:
    bergs = [
        Iceberg.rectangle(6e3, 3e3, thickness=thickness, placement=(lon, -55.0), velocity=(0.2, 0.0)).named(name)
        for name, lon, thickness in (("X1", -39.0, 200.0), ("X2", -38.0, 0.02))
    ]
    p = Parameters().changed(melt={"enabled": True, "temperature": 5.0, "salinity": 34.0})
    return Model(Iceberg.join(bergs), Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0)), p)


def test_each_berg_has_a_line_of_result_and_the_ledgers_are_for_the_verbose() -> None:
    model = adrift()
    model.advance(days=0.5)
    summary = summarize(model)
    _, first, second = short_summary(summary)
    drift, _, place = first.partition(" to ")
    assert drift.startswith("  X1 drifted ")
    assert drift.endswith(" km north")
    assert place.startswith("54.9")
    assert " W, in one piece (18 km2); " in place
    assert place.endswith(" Gt melted")
    assert second == "  X2 melted away"
    one, two = summary["bergs"]
    total = sum(summary["ledger"]["water"].values())
    assert one["melted_kg"] + two["melted_kg"] == pytest.approx(total, rel=1e-9)
    assert one["drift_north_km"] > abs(one["drift_east_km"])
    assert two["lon"] is None
    told = "\n".join(ledger_lines(summary))
    for words in ("ice at the start", "melted, base", "momentum (east, north; N s)", "momentum closes to"):
        assert words in told


@pytest.mark.parametrize(
    ("west", "east", "south", "north", "words"),
    [
        (321.875, 323.375, -56.5, -54.0, "56.5 S to 54 S, 38.125 W to 36.625 W"),
        (-180.0, 180.0, -90.0, 90.0, "90 S to 90 N, all longitudes"),
        (170.0, 190.0, -1.0, 0.0, "1 S to 0, 170 E to 170 W"),
    ],
)
def test_the_box_of_a_current_is_told_with_letters(
    west: float, east: float, south: float, north: float, words: str
) -> None:
    axes = {"lat": np.linspace(south, north, 5), "lon": np.linspace(west, east, 5)}
    sea = xr.Dataset({name: (("lat", "lon"), np.zeros((5, 5))) for name in ("uo", "vo")}, axes)
    with pytest.raises(ForcingError, match=f"nothing lies in .*: the data cover {words}"):
        window(sea, (0.0, 1.0), (91.0, 92.0))


def test_the_box_of_a_grid_in_metres_is_told_by_x_and_y() -> None:
    assert "x 0 to 80 m, y 0 to 40 m" in Grid.cartesian(8, 4, 10.0).describe()


@pytest.mark.parametrize(
    ("east", "north", "words"),
    [(-3e3, -3.1e3, "4.31 km south-west"), (0.0, 12.0, "12 m north"), (0.0, -0.474, "0.47 m south")],
)
def test_ways_are_told_by_the_points_of_the_compass(east: float, north: float, words: str) -> None:
    """The last is the middle of a beam, of which "0 m south" was said."""
    model = adrift()
    model.advance(steps=1)
    summary = summarize(model) | {"numerics": {"earth": {"latlon": True}, "stepping": {"only_interactions": True}}}
    summary["bergs"][0] |= {"drift_east_km": east / 1e3, "drift_north_km": north / 1e3}
    assert short_summary(summary)[1].startswith(f"  X1 bent: its centre moved {words} to ")


def test_seconds_per_day_leave_out_what_is_compiled_on_the_way() -> None:
    """A crack may need code that no step before it needed."""
    watch, model = Stopwatch(), adrift()
    watch.start(model)
    for k in range(3):
        model.time = 86400.0 * (k + 1)
        if k:
            clock.sleep(0.02)
            with event.trigger_event("numba:compile"):
                clock.sleep(0.2)
        watch.record(model)
    watch.finish(model)
    assert watch.wall_seconds > 0.4
    assert 0.02 <= watch.seconds_per_day < 0.1


def test_the_progress_of_a_run_leaves_it_out_too() -> None:
    """Bug: on a fresh machine lines on the way said 38 s per day, and the result 0.9."""
    bar, model = ProgressRecorder(3.0, quiet=True), adrift()
    bar.start(model)
    for k in range(3):
        model.time = 86400.0 * (k + 1)
        if k:
            clock.sleep(0.02)
            with event.trigger_event("numba:compile"):
                clock.sleep(0.2)
        bar.record(model)
    told = re.search(r"  ([\d.e-]+) s per day  2 fragments", bar.line(model))
    assert told is not None
    assert 0.02 <= float(told[1]) < 0.1
    bar.finish(model)


@pytest.mark.parametrize("asked", [None, True, False])
def test_a_script_has_a_line_a_minute_unless_it_says_otherwise(
    asked: bool | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Named for a season of bergs without a word. A run of seconds says nothing; one of minutes says where it stands."""
    now, seen = [0.0], []
    monkeypatch.setattr("riftberg.runs.progress.clock.monotonic", lambda: now[0])
    (bar,) = Model._progress(adrift(), 3.0, asked) or [ProgressRecorder(3.0, quiet=True)]
    model = adrift()
    model.step_number = 0
    bar.start(model)
    for until in (5, 121, 180):
        while now[0] < until:
            model.time += 1.0
            now[0] += 1.0
            bar.record(model)
        seen.append(capsys.readouterr().err.count("broken"))
    bar.finish(model)
    seen.append(capsys.readouterr().err.count("broken"))
    told = [sum(seen[: k + 1]) for k in range(4)]
    assert told[0] == 0
    assert told[1:3] == [{None: 2, True: 12, False: 0}[asked], {None: 3, True: 18, False: 0}[asked]]
    assert told[3] == told[2] + (asked is not False)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Iceberg.rectangle(6e3, 3e3, thickness=200.0, center=(0, 0)), r"'center'. It may be thickness, placement"),
    ],
)  # fmt: skip
def test_an_unknown_option_gets_the_nearest_name(call: Any, words: str) -> None:
    with pytest.raises(TypeError, match=words):
        call()


def test_other_type_errors_stay_as_they_are() -> None:
    with pytest.raises(TypeError, match=r"missing 1 required keyword-only argument: 'thickness'$"):
        Iceberg.rectangle(6e3, 3e3, placement=(0.0, 0.0))  # type: ignore[call-arg]
