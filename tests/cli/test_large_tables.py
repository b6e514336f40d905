"""Tables of observations as large as they come: read once, compared where they fall into the run, or refused with the reason."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fakes import FakeModel
from riftberg import open_run, read_observed, score_run
from riftberg.diagnostics.score import MOST_COMPARED
from riftberg.errors import InputError
from riftberg.runs.run_file import RunWriter

FEW = ["2020-12-09T16:00,-55.01,-37.2,B7", "2020-12-10T01:00,-55.02,-37.1,B7"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A run of a day."""
    folder = tmp_path_factory.mktemp("run")
    FakeModel().advance(1, recorders=[RunWriter(folder / "run.nc", every_hours=3)])
    with open_run(folder) as dataset:
        yield dataset


def table(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join(["date,lat,lon,name", *rows]) + "\n")
    return path


@pytest.mark.slow
def test_a_table_of_decades_gives_the_score_of_the_days_of_the_run(run: Any, tmp_path: Path) -> None:
    """Each of a million rows looked for its record, and for its place."""
    dates = np.datetime64("1990-01-01") + np.arange(100_000) * np.timedelta64(2, "h")
    far = [f"{day},-70,{k % 300 - 150},B{k % 50}" for k, day in enumerate(dates) if not str(day).startswith("2020-12")]
    begin = time.perf_counter()
    many = score_run(run, read_observed(table(tmp_path / "many.csv", [*far, *FEW])))
    assert time.perf_counter() - begin < 60.0
    few = score_run(run, read_observed(table(tmp_path / "few.csv", FEW)))
    assert many.days == few.days
    assert len(few.days) == 2


@pytest.mark.slow
def test_positions_by_the_second_are_compared_each_place_once(run: Any, tmp_path: Path) -> None:
    dates = np.datetime64("2020-12-09T13:00") + np.arange(20_000) * np.timedelta64(4, "s")
    rows = [f"{day},-55.01,-37.2,B7" for day in dates]
    begin = time.perf_counter()
    dense = score_run(run, read_observed(table(tmp_path / "dense.csv", rows)))
    assert time.perf_counter() - begin < 60.0
    assert len(dense.days) == 20_000
    assert dense.days[0].matches[0].distance_km == dense.days[1].matches[0].distance_km


def test_more_positions_than_anybody_sees_are_refused_with_the_reason(
    run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert MOST_COMPARED["positions"] == 100_000
    monkeypatch.setitem(MOST_COMPARED, "positions", 1000)
    dates = np.datetime64("2020-12-09T13:00") + np.arange(1001) * np.timedelta64(80, "s")
    observed = read_observed(table(tmp_path / "dense.csv", [f"{day},-55.01,-37.2,B7" for day in dates]))
    with pytest.raises(
        InputError, match=r"dense.csv: 1001 positions during the run; the most that are compared is 1000"
    ):
        score_run(run, observed)


@pytest.mark.slow
def test_thousands_of_outlines_are_read_once_each(tmp_path: Path) -> None:
    """Each was compared with all that came before."""
    rows = [
        f"{np.datetime64('1990-01-01') + k},{lat},{lon},{n}" for k in range(5000)
        for n, (lat, lon) in enumerate(((-55, -37), (-55, -36.9), (-54.9, -37)))
    ]  # fmt: skip
    path = tmp_path / "outlines.csv"
    path.write_text("\n".join(["date,lat,lon,vertex", *rows]) + "\n")
    begin = time.perf_counter()
    assert len(read_observed(path).outlines) == 5000
    assert time.perf_counter() - begin < 30.0


@pytest.mark.parametrize("date", ["9999-12-31", "0001-01-01T00:00+05:00", "9999-12-31T23:59-05:00"])
def test_dates_at_the_end_of_all_years_are_no_traceback(run: Any, date: str, tmp_path: Path) -> None:
    """The hour of the run carried the last day beyond the year 9999."""
    with pytest.raises(
        InputError,
        match=r"(nothing was observed during the run|is not a date|outside the years (1678 to 2261|1 to 9999 in UTC))",
    ):
        score_run(run, read_observed(table(tmp_path / "late.csv", [f"{date},-55,-37,B7"])), hour=24.0)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "sum_", ["np.float64(1) / np.float64(0)", "np.array([1e308]) * 10", "np.nanmean(np.array([np.nan]))"]
)
def test_no_warning_of_numpy_reaches_the_screen(sum_: str) -> None:
    program = (
        "import numpy as np, riftberg.cli.run as run; from riftberg.cli.main import app\n"
        f"def experiments():\n    'List.'\n    print({sum_})\n"
        "run.experiments = experiments; app(['experiments'])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
