"""``riftberg doctor --for``: files against an experiment."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any, ClassVar

import pytest
from typer.testing import CliRunner

from riftberg.cli.main import app

EXPERIMENT = """\
start: 2020-12-09 13:00
days: 6
berg:
  rectangle: {length: 12 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing:
  kind: files
  files: ["*oras5*.nc", "*jra55*.nc"]
  longitude: [-43, -33]
  latitude: [-59, -53]
"""


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the doctor was asked."""
    found: dict[str, Any] = {}

    class Report:
        ready = True
        notes: ClassVar[list[str]] = []

        def text(self) -> str:
            return ""

    def examine(files: Any, **how: Any) -> Report:
        found.update(how, files=list(files))
        return Report()

    monkeypatch.setattr("riftberg.ocean.doctor.doctor", examine)
    return found


def call(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["doctor", *(str(a) for a in arguments)])


def test_a_yaml_file_gives_place_dates_and_files(asked: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(EXPERIMENT)
    assert call("--for", path).exit_code == 0
    assert (asked["lon"], asked["lat"]) == ((-43.0, -33.0), (-59.0, -53.0))
    assert asked["time"] == (datetime(2020, 12, 9, 13), datetime(2020, 12, 15, 13))
    assert asked["files"] == [str(tmp_path / "*oras5*.nc"), str(tmp_path / "*jra55*.nc")]
    call("other.nc", "--for", path, "--lon", "-40,-39")
    assert (asked["files"], asked["lon"]) == (["other.nc"], (-40.0, -39.0))


def test_a68a_gives_its_place_and_dates(asked: dict[str, Any]) -> None:
    call("a.nc", "--for", "a68a-paper")
    assert asked["time"] == (datetime(2020, 12, 9, 13), datetime(2020, 12, 27, 13))
    assert asked["lon"][0] < -40.3 < -35.5 < asked["lon"][1]


def test_a68a_gives_the_observed_path_unless_a_run_is_named(asked: dict[str, Any]) -> None:
    call("a.nc", "--for", "a68a")
    assert len(asked["path"]) == 16  # the days on which the whole berg was seen
    assert asked["path"][0] == (-39.2454, -55.0194)


def test_the_files_of_a68a_are_looked_for_where_the_fetch_puts_them(
    asked: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIFTBERG_DATA", raising=False)
    result = call("--for", "a68a-paper")
    assert result.exit_code == 2
    assert "None are in riftberg-data/a68a: 'riftberg fetch a68a' gets them" in result.output
    (tmp_path / "riftberg-data" / "a68a").mkdir(parents=True)
    (tmp_path / "riftberg-data" / "a68a" / "some.nc").touch()
    assert call("--for", "a68a-paper").exit_code == 0
    assert asked["files"] == ["riftberg-data/a68a/*.nc"]


def test_a_yaml_file_gives_products_limits_and_what_it_leaves_out(asked: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    named = '["*oras5*.nc", {file: b.nc, product: duacs-geostrophic}]\n  max_gap: 4 days\n  hold: 12\n  wind: none'
    path.write_text(EXPERIMENT.replace('["*oras5*.nc", "*jra55*.nc"]', named))
    call("--for", path, "--need", "uo", "--need", "depth_below_surface")
    assert asked["product"] == {str(tmp_path / "*oras5*.nc"): None, str(tmp_path / "b.nc"): "duacs-geostrophic"}
    assert (asked["max_gap"], asked["hold"]) == (4 * 86400.0, 12 * 3600.0)
    assert not {"ua", "va"} & {*asked["needed"], *asked["wished"]}
    assert "depth_below_surface" in asked["needed"]


def test_what_cannot_be_asked_for_is_told(asked: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "steady.yaml"
    path.write_text(EXPERIMENT[: EXPERIMENT.index("forcing:")] + "forcing: {uniform: {}}\n")
    for arguments, words in [
        (["--for", path, "a.nc"], "It needs no files"),
        ([], "no files were named"),
    ]:
        result = call(*arguments)
        assert result.exit_code == 2
        assert words in result.output
    assert not asked


def test_the_real_files_serve_their_experiment(shared: Path, tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(EXPERIMENT.replace('"*', f'"{shared}/data/a68a/*'))
    result = call("--for", path)
    assert result.exit_code == 0, result.output
    assert "held constant for the whole run\n" in result.output
    assert "(taux, tauy) is not used beside a wind\nReady: the run starts." in result.output
