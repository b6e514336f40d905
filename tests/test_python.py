"""Riftberg at a prompt and in a notebook: names, looks, progress, log."""

from __future__ import annotations

import logging
import subprocess
import sys
import types
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import riftberg
from riftberg import A68A_2022, A68A_2022_KID, Forcing, Grid, GriddedForcing, Iceberg, Model, Parameters, build
from riftberg.ocean.story import StoryOcean

LINES, COLUMNS = 45, 300
"""A screen."""


def small(**options: Any) -> Model:
    berg = Iceberg.rectangle(9e3, 6e3, thickness=200.0, placement=(-37.0, -56.0), **options)
    return Model(berg, Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0)))


def test_all_public_names_are_listed_before_they_are_loaded() -> None:
    code = "import riftberg, sys; print(*dir(riftberg)); print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    names, loaded = done.stdout.splitlines()
    assert set(riftberg.__all__) <= set(names.split())
    assert loaded == "False"


def test_tab_completion_knows_the_public_names() -> None:
    import rlcompleter

    found = rlcompleter.Completer({"riftberg": riftberg}).global_matches("rift")
    assert found
    matches = rlcompleter.Completer({"riftberg": riftberg}).attr_matches("riftberg.")
    for name in (name for name in riftberg.__all__ if not name.startswith("_")):
        assert any(match.rstrip("()") == f"riftberg.{name}" for match in matches), name


@pytest.fixture(scope="module")
def thing() -> dict[str, Any]:
    """One of each kind of public object, as large as they come."""
    large = Iceberg.rectangle(300e3, 150e3, thickness=200.0, placement=(-37.0, -56.0))
    model, info = build("a68a")
    grid = Grid.cartesian(6, 6, 1e4)
    return {
        "large berg": large,
        "model": model,
        "info": info,
        "parameters": Parameters(),
        "a68a": A68A_2022,
        "kid": A68A_2022_KID,
        "compatibility": A68A_2022_KID.compatibility,
        "steady": Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)),
        "story": StoryOcean(),
        "gridded": GriddedForcing(grid, grid.fields()),
        "grid": grid,
        "elements": large.elements,
        "bonds": large.bonds,
        "place": large.elements.place,
        "environment": large.elements.environment,
        "fragments": model.fragments,
    }


THINGS = ["large berg", "model", "info", "parameters", "a68a", "kid", "compatibility", "steady", "story", "gridded",
          "grid", "elements", "bonds", "place", "environment", "fragments"]  # fmt: skip


@pytest.mark.parametrize("name", THINGS)
def test_every_public_object_fits_on_a_screen(name: str, thing: dict[str, Any]) -> None:
    text = repr(thing[name])
    assert " object at 0x" not in text
    assert len(text.splitlines()) <= LINES
    assert sum(-(-len(line) // COLUMNS) for line in text.splitlines()) <= LINES
    assert len(text) < 3000


@pytest.mark.parametrize("name", ["large berg", "model"])
def test_bergs_and_models_show_a_picture_in_a_notebook(name: str, thing: dict[str, Any]) -> None:
    page = thing[name]._repr_html_()
    begin, end = page.index("<svg"), page.index("</svg>") + len("</svg>")
    picture = ElementTree.fromstring(page[begin:end])
    marks = [mark for mark in picture.iter() if mark.tag.endswith("polygon")]
    assert 100 < len(marks) <= 1500
    assert len(page) < 400_000
    wide, high = float(picture.get("width", 0)), float(picture.get("height", 0))
    assert max(wide, high) == pytest.approx(220.0, abs=1.0)
    if name == "large berg":
        assert wide / high == pytest.approx(2.0, rel=0.02)  # 300 km by 150 km: the picture is in true proportions


def test_the_picture_shows_north_up_and_pieces_in_colours() -> None:
    berg = Iceberg.from_points([0.0, 0.0, 9e3], [0.0, 6e3, 0.0], thickness=200.0, latlon=False)
    page = berg._repr_html_()
    picture = ElementTree.fromstring(page[page.index("<svg") : page.index("</svg>") + 6])
    tops = [float(mark.get("points", "").split()[0].split(",")[1]) for mark in picture]
    assert tops[1] < tops[0]  # the northern one stands higher
    assert len({mark.get("fill") for mark in picture}) == 3


@pytest.mark.parametrize("name", ["steady", "story", "gridded", "a68a"])
def test_forcing_and_parameters_have_a_look_in_a_notebook(name: str, thing: dict[str, Any]) -> None:
    page = thing[name]._repr_html_()
    ElementTree.fromstring(page)
    assert len(page) < 20_000


def test_progress_tells_how_far_a_run_is(capsys: pytest.CaptureFixture[str]) -> None:
    small().run(steps=2, progress=True)
    out, err = capsys.readouterr()
    assert out == ""
    assert "100.0 %" in err
    assert "2020-12-09 14:00" in err
    small().run(steps=2)
    assert capsys.readouterr().err == ""


class Shell:
    """Stands for the shell of a notebook."""


def test_progress_in_a_notebook_is_one_bar(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pages: list[str] = []

    class Handle:
        def update(self, page: str) -> None:
            pages.append(page)

    def display(page: str, *, display_id: bool) -> Handle:
        assert display_id
        pages.append(page)
        return Handle()

    ipython, shown = types.ModuleType("IPython"), types.ModuleType("IPython.display")
    ipython.get_ipython = Shell  # type: ignore[attr-defined]
    shown.HTML, shown.display = str, display  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", shown)
    small().run(steps=2, progress=True)
    assert '<progress value="0"' in pages[0]
    assert "100 %" in pages[-1]
    assert capsys.readouterr().err == ""


def test_a_terminal_of_ipython_is_no_notebook(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ipython = types.ModuleType("IPython")
    ipython.get_ipython = type("TerminalInteractiveShell", (), {})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    small().run(steps=2, progress=True)
    assert "100.0 %" in capsys.readouterr().err


def test_the_log_has_the_name_of_the_package(caplog: pytest.LogCaptureFixture, tmp_path: Any) -> None:
    with caplog.at_level(logging.INFO, logger="riftberg"):
        model = small()
        model.run(steps=1)
        model.save(tmp_path / "a.restart.nc")
    assert {record.name.partition(".")[0] for record in caplog.records} == {"riftberg"}
    assert "1 steps from 2020-12-09 13:00" in caplog.text
    assert "saved in" in caplog.text


def test_the_package_is_silent_unless_asked() -> None:
    code = "import riftberg, logging; logging.getLogger('riftberg.model').warning('hello')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_every_command_takes_verbose() -> None:
    from typer.testing import CliRunner

    from riftberg.cli.main import app

    for command in app.registered_commands:
        result = CliRunner().invoke(app, [str(command.name), "--help"], env={"COLUMNS": "200"})
        assert "--verbose" in result.output, command.name


def test_verbose_logs_to_the_error_stream_and_leaves_nothing_behind(tmp_path: Path) -> None:
    """Once: what a run does. Twice: each file too."""
    from typer.testing import CliRunner

    from riftberg.cli.main import app

    (tmp_path / "berg.yaml").write_text(
        "start: 2020-12-09\ndays: 0.0625\nberg: {rectangle: {length: 9 km, width: 6 km}, placement: [-39.0, -55.5]}\n"
        "forcing: {uniform: {current: [0.2, 0.0], slope: [0, 0]}}\n"
    )
    logger = logging.getLogger("riftberg")
    before = list(logger.handlers), logger.level
    for words, steps, files in (([], False, False), (["-v"], True, False), (["-vv"], True, True)):
        out = tmp_path / f"out{len(words)}{files}"
        done = CliRunner().invoke(app, ["run", str(tmp_path / "berg.yaml"), "-o", str(out), "-q", "--no-map", *words])
        assert ("3 steps from 2020-12-09" in done.stderr, f"wrote {out}" in done.stderr) == (steps, files)
        assert "steps from" not in done.stdout
        assert (list(logger.handlers), logger.level) == before


def test_the_tab_key_lists_parameters_and_not_what_they_are_made_with() -> None:
    """Forty names of pydantic stood between the six groups of a letter."""

    def public(thing: object) -> set[str]:
        return {name for name in dir(thing) if not name.startswith("_")}

    p = Parameters()
    assert public(p.fracture) == {*type(p.fracture).model_fields, "describe"}
    assert set(type(p).model_fields) < public(p)
    assert len(public(p)) <= len(type(p).model_fields) + 8
    assert p.model_copy() == p  # what is not listed is there


def test_a_parameter_that_is_misspelt_is_named_with_the_nearest() -> None:
    with pytest.raises(
        AttributeError, match=r"Fracture has no parameter 'normal_strenght'. Did you mean 'normal_strength'\?"
    ):
        Parameters().fracture.normal_strenght  # noqa: B018
    with pytest.raises(AttributeError, match=r"Parameters has no group 'fractur'. Did you mean 'fracture'\?"):
        Parameters().fractur  # noqa: B018
    assert not hasattr(Parameters(), "_nothing")


@pytest.mark.parametrize("stage", ["fresh", "run"])
def test_models_bergs_and_forcing_can_be_copied_and_pickled_and_go_on_alike(stage: str) -> None:
    import copy
    import pickle

    import numpy as np

    from riftberg import Forcing

    ocean = Forcing.uniform(current=(0.2, 0.1)) + Forcing.tide(0.1)
    berg = Iceberg.rectangle(9e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
    model = Model(berg, ocean)
    if stage == "run":
        model.advance(steps=2)
    twins = [copy.deepcopy(model), pickle.loads(pickle.dumps(model))]
    for one in (model, *twins):
        one.advance(steps=2)
    for twin in twins:
        np.testing.assert_array_equal(twin.elements.lon, model.elements.lon)
        assert twin.elements.lon is not model.elements.lon
    assert pickle.loads(pickle.dumps(berg)).report == berg.report
    assert pickle.loads(pickle.dumps(ocean)).describe() == ocean.describe()
