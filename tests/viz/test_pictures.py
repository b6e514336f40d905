"""Each kind of picture beside one that was looked at and found good.

The pictures in ``pictures/`` are small: they are drawn without text, whose shape depends on fonts and versions, and shrunk to
`WIDTH` pixels, which smooths what drawing libraries change from version to version. After a change that is meant, look at
the new picture, then write it by ``RIFTBERG_NEW_PICTURES=1 python -m pytest tests/viz/test_pictures.py``.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from fakes import FakeModel
from riftberg import (
    draw_damage,
    draw_dates,
    draw_fragments,
    draw_map,
    draw_reasons,
    draw_score,
    draw_stress,
    explain,
    open_run,
)
from riftberg.diagnostics.score import Match, Score, ScoredDay
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene
from riftberg.viz import animate, colours, style

GOOD = Path(__file__).parent / "pictures"
WIDTH = 160
MEAN, MOST = 1.0, 30.0
"""Allowed difference in the mean and at a hundredth of the pixels, of 255."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Four days, a break after one, with damage that grows along the berg."""
    folder = tmp_path_factory.mktemp("pictures")
    FakeModel(14, 5).advance(4, recorders=[RunWriter(folder / "run.nc", every_hours=6, experiment="fake")])
    run = open_run(folder)
    damage = np.linspace(0.0, 0.4, run.sizes["bond"])[:, None] * np.linspace(0.0, 1.0, run.sizes["time"])
    return run.assign(damage=(("bond", "time"), damage))


def scored() -> Score:
    days = []
    for k in range(8):
        x, y = -39.0 + 0.3 * k, -55.0 - 0.1 * k**1.3
        match = Match("a", [1], 3.0 + k % 3, 40.0 + 4 * k, 45.0 + 3 * k, k - 5.0, 900.0, 950.0 - 20 * k, 0.9 - 0.05 * k,
                      x + 0.05, y + 0.02 * k, x, y)  # fmt: skip
        days.append(ScoredDay(f"2020-12-{10 + k}T12:00:00", [match], 1, []))
    return Score("track.csv", days)


def film_frame(run: xr.Dataset, path: Path) -> None:
    from riftberg.runs.background import stored_water

    film = animate._Film(Scene(run), stored_water(run), {}, 80)
    film.draw(10)
    style.save_figure(film.figure, path)


DRAWN: dict[str, Callable[[xr.Dataset, Path], object]] = {
    "map": lambda run, path: draw_map(run, path, dpi=60),
    "dates": lambda run, path: draw_dates(run, path, dpi=60),
    "stress": lambda run, path: draw_stress(run, path, dpi=60),
    "damage": lambda run, path: draw_damage(run, path, dpi=60),
    "timeline": lambda run, path: draw_fragments(run, path, dpi=60),
    "why": lambda run, path: draw_reasons(explain(run), path, dpi=60),
    "score": lambda run, path: draw_score(scored(), path, dpi=60),
    "film": lambda run, path: film_frame(run, path),
}


@pytest.fixture
def without_text(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write pictures without any text."""
    save = Figure.savefig

    def bare(self: Figure, *arguments: object, **options: object) -> None:
        for text in self.findobj(Text):
            text.set_visible(False)
        save(self, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", bare)


def small(path: Path) -> np.ndarray:
    picture = Image.open(path).convert("RGB")
    size = WIDTH, round(WIDTH * picture.height / picture.width)
    return np.asarray(picture.resize(size, Image.Resampling.BOX), np.float64)


def difference(picture: np.ndarray, good: np.ndarray) -> tuple[float, float]:
    """Return mean difference and that of the worst hundredth of the pixels."""
    high = min(len(picture), len(good))
    assert abs(len(picture) - len(good)) <= 2
    apart = np.abs(picture[:high] - good[:high]).max(axis=2)
    return float(apart.mean()), float(np.quantile(apart, 0.99))


@pytest.mark.quick(3)
@pytest.mark.usefixtures("without_text")
@pytest.mark.parametrize("kind", list(DRAWN))
def test_a_picture_is_as_it_was_found_good(kind: str, run: xr.Dataset, tmp_path: Path) -> None:
    DRAWN[kind](run, tmp_path / "picture.png")
    picture = small(tmp_path / "picture.png")
    if os.environ.get("RIFTBERG_NEW_PICTURES") == "1":
        GOOD.mkdir(exist_ok=True)
        Image.fromarray(picture.astype(np.uint8)).save(GOOD / f"{kind}.png", optimize=True)
    mean, most = difference(picture, small(GOOD / f"{kind}.png"))
    assert mean < MEAN, f"{kind}: mean difference {mean:.1f} of 255"
    assert most < MOST, f"{kind}: largest difference {most:.0f} of 255"


@pytest.mark.quick(1)
@pytest.mark.usefixtures("without_text")
@pytest.mark.parametrize("kind", ["map", "timeline"])
def test_a_wrong_picture_is_noticed(
    kind: str, run: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other colours of the fragments, or a berg that drifts the other way, are more than the pictures may differ by."""
    good = small(GOOD / f"{kind}.png")
    monkeypatch.setattr(colours, "FRAGMENTS", tuple(reversed(colours.FRAGMENTS)))
    DRAWN[kind](run, tmp_path / "picture.png")
    mean, most = difference(small(tmp_path / "picture.png"), good)
    assert mean > MEAN or most > MOST
    mean, most = difference(good[:, ::-1], good)
    assert mean > MEAN or most > MOST
