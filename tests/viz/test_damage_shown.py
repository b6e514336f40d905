"""Damage in figures and replay: what is left of the strength, and the colour of the bonds."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread
from typer.testing import CliRunner

from fakes import FakeModel
from riftberg import A68A_2022, draw_damage, draw_fragments, open_run
from riftberg.cli.main import app
from riftberg.errors import InputError
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene
from riftberg.viz.replay import ReplayContent, write_replay
from viz.browser import drawn, opened, unpack

WORN, RIFT = 20, 11
"""A bond that loses strength, and one of a rift without any; neither is among those that break."""


def made(folder: Path, *, damage: bool) -> Path:
    """Run the fake berg for two days; three bonds break after one."""
    model = FakeModel(parameters=A68A_2022.changed(damage={"enabled": damage}, fracture={"normal_strength": 18e3}))
    model.bonds.damage[:] = 0.01 * damage
    model.bonds.damage[WORN] = 0.4 * damage
    model.bonds.strength[RIFT] = 0.0
    model.advance(2, recorders=[RunWriter(folder / "run.nc", every_hours=6, experiment="fake")])
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run with damage."""
    return made(tmp_path_factory.mktemp("damage"), damage=True)


@pytest.fixture(scope="module")
def run(folder: Path) -> xr.Dataset:
    """Return that run, with damage that grows: at a quarter, a half ... of what it comes to."""
    run = open_run(folder)
    grown = run["damage"] * xr.DataArray(np.linspace(0.0, 1.0, run.sizes["time"]), dims="time")
    return run.assign(damage=grown)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run without damage."""
    return made(tmp_path_factory.mktemp("plain"), damage=False)


def test_the_lowest_strength_is_that_of_the_most_worn_bond_that_holds(run: xr.Dataset, plain: Path) -> None:
    part = np.linspace(0.0, 1.0, 9)
    np.testing.assert_allclose(Scene(run).bonds.lowest_strength(), 18e3 * (1.0 - 0.4 * part), rtol=1e-6)
    with open_run(plain) as without:
        assert Scene(without).bonds.lowest_strength() is None
        assert Scene(without).bonds.damage() is None


def test_bonds_that_are_broken_count_no_more(run: xr.Dataset) -> None:
    broken = int(np.flatnonzero(~np.isnat(run["break_time"].values))[0])
    damage = run["damage"].copy()
    damage[broken] = 0.9
    lowest = Scene(run.assign(damage=damage)).bonds.lowest_strength()
    assert lowest is not None
    late = run["time"].values >= run["break_time"].values[broken]
    assert late.sum() == 5
    np.testing.assert_allclose(lowest[~late], 1.8e3)
    np.testing.assert_allclose(lowest[late], 18e3 * (1.0 - 0.4 * np.linspace(0.5, 1.0, 5)), rtol=1e-6)
    nothing = run.assign(break_time=("bond", np.full(run.sizes["bond"], run["time"].values[2])))
    lowest = Scene(nothing).bonds.lowest_strength()
    assert lowest is not None
    assert list(np.isnan(lowest)) == [False] * 2 + [True] * 7


def stress_axes(run: xr.Dataset) -> Any:
    """Return the axes of the timeline that show the largest stress."""
    (ax,) = [ax for ax in draw_fragments(run).axes if "stress" in ax.get_ylabel()]
    return ax


def test_the_timeline_draws_what_is_left_beside_the_strength(run: xr.Dataset, plain: Path) -> None:
    ax = stress_axes(run)
    heights = [np.asarray(line.get_ydata(), float) for line in ax.lines]
    np.testing.assert_allclose(heights[0], Scene(run).bonds.tension().max(axis=1) / 1e3)
    assert (heights[1][1:] < heights[0][1:] - 0.4).all()  # at the records: without the ringing
    np.testing.assert_allclose(heights[2], 18.0)
    np.testing.assert_allclose(heights[3], 18.0 * (1.0 - 0.4 * np.linspace(0.0, 1.0, 9)), rtol=1e-6)
    with open_run(plain) as without:
        ax = stress_axes(without)
    assert len(ax.lines) == 3


def violet(picture: Path) -> int:
    """Return the pixels of a picture that are clearly violet."""
    red, green, blue = np.moveaxis(imread(picture)[..., :3], -1, 0)
    return int(((blue > green + 0.2) & (red > green + 0.05)).sum())


def test_the_map_of_damage_shows_the_worn_bonds(run: xr.Dataset, plain: Path, tmp_path: Path) -> None:
    first, last = run["time"].values[[0, -1]]
    below = violet(draw_damage(run, tmp_path / "whole.png", dates=[first], dpi=60))  # of the scale below the map
    assert violet(draw_damage(run, tmp_path / "worn.png", dates=[last], dpi=60)) > below + 10
    with open_run(plain) as without, pytest.raises(InputError, match=r"no damage.*damage.enabled=true"):
        draw_damage(without, tmp_path / "no.png")


@pytest.mark.slow
def test_plot_draws_damage_where_it_is_on(folder: Path, plain: Path, tmp_path: Path) -> None:
    for place, drawn_too in ((folder, True), (plain, False)):
        out = tmp_path / place.name
        result = CliRunner().invoke(app, ["plot", str(place), "-o", str(out), "--dpi", "40"])
        assert result.exit_code == 0, result.output
        assert (out / "damage.png").exists() is drawn_too
    result = CliRunner().invoke(app, ["plot", str(plain), "-k", "damage", "-o", str(tmp_path)])
    assert (result.exit_code, "no damage" in result.output) == (2, True)


@pytest.mark.slow
def test_the_replay_has_the_largest_damage_of_each_element_and_what_is_left(run: xr.Dataset, plain: Path) -> None:
    data = ReplayContent(run, title="", observed={}).data()
    shown = unpack(data["elements"]["damage"])
    ends = {int(run["bond_first"].values[WORN]), int(run["bond_second"].values[WORN])}
    assert set(np.flatnonzero(shown[-1] > 0.1).tolist()) == ends
    np.testing.assert_allclose(shown[:, next(iter(ends))], 0.4 * np.linspace(0.0, 1.0, 9), atol=0.4 / 255)
    np.testing.assert_allclose(unpack(data["lowest"]), 18e3 * (1.0 - 0.4 * np.linspace(0.0, 1.0, 9)), atol=1.0)
    with open_run(plain) as without:
        data = ReplayContent(without, title="", observed={}).data()
    assert (data["lowest"], data["elements"]["damage"]) == (None, None)
    assert json.dumps(data)


@pytest.mark.slow
def test_the_page_offers_damage_only_where_there_is_some(run: xr.Dataset, plain: Path, tmp_path: Path) -> None:
    pages = [write_replay(run, tmp_path / "worn.html")]
    with open_run(plain) as without:
        pages.append(write_replay(without, tmp_path / "plain.html"))
    for page, choices in zip(pages, (5, 4), strict=True):
        with opened(page) as browser:
            for choice in range(choices):
                browser.execute_script(
                    "const s = document.getElementById('ice'); s.selectedIndex = arguments[0]; s.onchange()", choice
                )
                browser.execute_script("replay.go(replay.span)")
                drawn(browser)
            values = browser.execute_script("return [...document.getElementById('ice').options].map(o => o.value)")
            assert len(values) == choices
            assert ("damage" in values) is (choices == 5)
            assert not [e for e in browser.get_log("browser") if e["level"] in ("SEVERE", "WARNING")]
    assert re.search(r'"lowest":\{', pages[0].read_text())
