"""The result of a sweep is written in blocks of members: the same file, in memory that does not grow with their number."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Forcing, Iceberg, Model, Options, Parameters, forecast, open_run, open_sweep
from riftberg.ensembles import sweep as module
from riftberg.ensembles.forecast import forecast_plan
from riftberg.ensembles.sweep import Store
from riftberg.ensembles.vary import Draws
from riftberg.runs import progress

from .made import outcome

CONTROL = -1


def drifting() -> Model:
    """Return two elements in a current."""
    berg = Iceberg.rectangle("6 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(
        berg, Forcing.uniform(current=(0.2, 0.0), depth=2000.0, slope=(0.0, 0.0)), Parameters(), start="2020-12-09"
    )


def filled(folder: Path, members: int, days: int = 4) -> Store:
    """Return a forecast whose members are done, without a run; every third breaks up, and the last but one is missing."""
    plan = forecast_plan(drifting, (), Options(days=float(days)), 24.0, Draws(members))
    store = Store(folder, plan, resume=False)
    store.folder.mkdir(parents=True, exist_ok=True)
    store.begin()
    random = np.random.default_rng(1)
    for k in range(CONTROL, members):
        lon, lat = (np.cumsum([first, *random.normal(0.0, 0.05, days)]).tolist() for first in (-37.0, -56.0))
        means = {"current_error_east": 0.1, "floor_error_mean": 0.2} if k % 2 else None
        if k != members - 2:
            store.keep(outcome(k, lon, lat, broken=1.5 if k % 3 == 0 else None, means=means))
    return store


@pytest.mark.slow
def test_blocks_make_the_same_file_as_one_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for size in (2, 100):
        monkeypatch.setattr(module, "BLOCK", size)
        filled(tmp_path / f"{size}", 7).write()
    few, whole = (open_sweep(tmp_path / f"{size}") for size in (2, 100))
    xr.testing.assert_identical(few, whole)
    assert few["member"].values.tolist() == list(range(7))
    assert few["status"].values.tolist() == [0] * 5 + [2, 0]
    assert np.isfinite(few["lon"].values[:, 0, -1]).tolist() == [True] * 5 + [False, True]
    assert str(few["first_breakup"].values[0]) == "2020-12-10T12:00:00.000000000"
    assert np.isnat(few["first_breakup"].values[1])
    assert {"start_thickness", "errors_seed", "weight", "lead", "init"} <= set(few.coords)
    assert few["p_broken"].values[-1] == pytest.approx(3 / 6)
    lazy = open_sweep(tmp_path / "2", tracks=False)
    assert not lazy["lon"].variable._in_memory
    assert lazy["p_broken"].variable._in_memory
    xr.testing.assert_identical(lazy.load(), few)
    lazy.close()


@pytest.mark.slow
def test_a_first_result_is_shown_while_others_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FIRST_LOOK", 2)
    store = Store(tmp_path / "it", forecast_plan(drifting, (), Options(days=0.1), 2.4, Draws(6)), resume=False)
    seen = []

    def look(result: xr.Dataset) -> None:
        seen.append((int((result["status"] == 0).sum()), float(result["p_broken"].values[-1])))
        if len(seen) == 2:
            raise ValueError("a picture that fails stops no member")

    store.look = look
    result = module.run_sweep(store, workers=0)
    assert seen == [(1, 0.0), (3, 0.0)]  # the control is one of the runs that are done
    assert result["status"].values.tolist() == [0] * 6


@pytest.mark.slow
def test_a_forecast_that_is_stopped_in_its_control_has_the_whole_run_afterwards(tmp_path: Path) -> None:
    def halting() -> Model:
        model = drifting()

        def halt(now: Any) -> None:
            if now.step_number == 5 and not (tmp_path / "halted").exists():
                (tmp_path / "halted").touch()
                os.kill(os.getpid(), signal.SIGINT)

        model.after_step.append(halt)
        return model

    given: dict[str, Any] = {"days": "6 h", "every_hours": 1, "members": 2, "workers": 0, "output": tmp_path / "f"}
    with pytest.raises(KeyboardInterrupt):
        forecast(halting, **given)
    assert forecast(halting, **given, resume=True)["status"].values.tolist() == [0, 0]
    with open_run(tmp_path / "f" / "control.nc") as run:
        assert run.sizes["time"] == 7


def test_progress_says_how_long_it_takes(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    times = iter([0.0, 0.0, 60.0, 60.0, 400.0, 400.0])
    monkeypatch.setattr(progress.clock, "monotonic", lambda: next(times, 400.0))
    bar = progress.SweepBar(20)
    for done in (5, 10, 20):
        bar.show({**dict.fromkeys(range(done), "done"), 0: "failed", 1: "unfinished"})
    assert "10 of 20 members, 1 failed, 1 unfinished, 2 min left" in capsys.readouterr().err


@pytest.mark.slow
def test_memory_does_not_grow_with_the_members(tmp_path: Path) -> None:
    peaks = []
    for members in (500, 2000):
        done = subprocess.run([sys.executable, "-m", "ensembles.test_blocks", str(members), str(tmp_path / f"{members}")],
                              check=True, capture_output=True, text=True, cwd=Path(__file__).parents[1])  # fmt: skip
        peaks.append(float(done.stdout.split()[-1]))
    assert peaks[1] - peaks[0] < 40.0, peaks  # MB; the tracks of 1500 members more are 40 times 1.2 MB in memory


if __name__ == "__main__":
    import time

    store = filled(Path(sys.argv[2]), int(sys.argv[1]), days=60)
    began = time.process_time()
    store.write()
    print(time.process_time() - began, "s", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)


def test_every_block_has_room_for_the_pieces_of_all_members(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole bergs come before one that breaks, and after it."""
    monkeypatch.setattr(module, "BLOCK", 1)
    filled(tmp_path / "few", 5).write()
    found = open_sweep(tmp_path / "few")
    assert np.isfinite(found["lon"].values[:, :, -1]).sum(axis=1).tolist() == [2, 1, 1, 0, 1]
