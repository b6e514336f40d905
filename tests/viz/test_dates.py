"""Maps at chosen dates: which record they show, and that nothing overprints."""

from __future__ import annotations

import warnings
from datetime import datetime
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import Observations, Outline, draw_dates, draw_map, draw_stress, open_run, score_run
from riftberg.cli.main import app
from riftberg.cli.pictures import moments
from riftberg.errors import InputError
from riftberg.runs.run_file import RunWriter
from riftberg.viz import style

RING = np.array([[-39.1, -55.05], [-38.6, -55.05], [-38.6, -54.95], [-39.1, -54.95]])


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five days from 9 December 13:00, a break after one."""
    path = tmp_path_factory.mktemp("dates") / "run.nc"
    FakeModel().advance(5, recorders=[RunWriter(path, every_hours=3, experiment="fake")])
    return path


@pytest.fixture(scope="module")
def run(path: Path) -> xr.Dataset:
    return open_run(path)


@pytest.mark.quick(2)
@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize("observed", [False, True])
def test_nothing_overprints(run: xr.Dataset, tmp_path: Path, count: int, observed: bool, monkeypatch: Any) -> None:
    """Bug: with two dates the legend lay on the label of the colour bar."""
    made: list[Figure] = []
    write = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *how, **more: made.append(self) or write(self, *how, **more))
    days = [np.datetime64(f"2020-12-{10 + k}T13:00") for k in range(count)]
    shown = {"2020-12-10": [RING]} if observed else None
    draw_dates(run, tmp_path / "dates.png", dates=days, observed=shown, dpi=50)
    (figure,) = made
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    assert figure._suptitle is not None  # type: ignore[attr-defined]
    parts = [a.get_tightbbox(renderer) for a in (*figure.axes, *figure.legends, figure._suptitle)]  # type: ignore[attr-defined]
    assert len(parts) == count + observed + 3  # maps, colour bar, legend, title
    for a, b in combinations(parts, 2):
        assert not a.overlaps(b), (a, b)
    whole = figure.bbox
    for part in parts:
        assert part.x0 >= whole.x0 - 1
        assert part.x1 <= whole.x1 + 1
        assert part.y0 >= whole.y0 - 1
        assert part.y1 <= whole.y1 + 1
    if observed:  # Bug: the currents were of the middle of all dates, here one without an outline.
        assert figure.axes[0].get_title() == "Observed; currents of 10 Dec"
    ticks = [t.get_window_extent(renderer) for t in figure.axes[-1].get_xticklabels() if t.get_text()]
    assert not any(a.overlaps(b) for a, b in combinations(ticks, 2))


def test_dates_outside_of_the_run_are_refused(run: xr.Dataset, path: Path) -> None:
    """Bug: they were drawn as its last record, without a word."""
    ax = draw_map(run, ax=Figure().add_subplot(), date="2020-12-14T14:00")
    assert ax.get_title("left") == "14 Dec 2020 13:00"  # that of the last record
    for day in ("2020-12-09T10:00", "2020-12-14T15:00", "2021-03-01"):
        with pytest.raises(
            InputError, match=r"not in the run\. The run goes from 2020-12-09T13:00 to 2020-12-14T13:00"
        ):
            draw_stress(run, dates=[np.datetime64(day)])
    for kind in ("dates", "stress"):
        refused = CliRunner().invoke(app, ["plot", str(path), "-k", kind, "-d", "2020-12-10", "-d", "2021-03-01"])
        assert refused.exit_code == 2
        assert "2021-03-01T13:00 is not in the run" in refused.stderr


def test_a_day_alone_means_the_same_for_plot_and_score(run: xr.Dataset) -> None:
    """Bug: noon for the one, the hour of the start for the other."""
    day = Observations("o", [Outline("", datetime(2020, 12, 12), True, RING)])
    timed = Observations("o", [Outline("", datetime(2020, 12, 12, 8, 30), False, RING)])
    for seen, hour in ((day, "13:00"), (timed, "08:30"), (Observations(""), "13:00")):
        (moment,) = moments(["2020-12-12"], run, seen)
        assert str(moment)[:16] == f"2020-12-12T{hour}"
        if seen.outlines:
            assert score_run(run, seen).days[0].time[:16] == str(moment)[:16]
    assert [str(m)[:16] for m in moments(["2020-12-12T04:00", "20201213"], run, timed)] == [
        "2020-12-12T04:00", "2020-12-13T13:00",
    ]  # fmt: skip


@pytest.mark.quick(5)
@pytest.mark.parametrize("hours", [0.04, 0.5, 2.7, 3.0, 7.0, 64.0, 24.0 * 17, 24.0 * 80, 24.0 * 980])
@pytest.mark.parametrize("which", ["x", "y"])
def test_an_axis_of_any_length_has_a_few_dates_and_no_warning(which: str, hours: float) -> None:
    """Bug: matplotlib warned on the screen of a sweep of three hours that it found no interval of ticks."""
    figure = Figure(figsize=(5.0, 4.0), dpi=80, layout="constrained")
    ax = figure.subplots()
    days = np.datetime64("2020-12-15T00:00", "s") + np.array([0, round(3600 * hours)]).astype("m8[s]")
    ax.plot(*((days, [0.0, 1.0]) if which == "x" else ([0.0, 1.0], days)))
    style.date_axis(ax, which)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.draw_without_rendering()
    axis = ax.xaxis if which == "x" else ax.yaxis
    low, high = axis.get_view_interval()
    assert 2 <= sum(low <= tick <= high for tick in axis.get_ticklocs()) <= 13
