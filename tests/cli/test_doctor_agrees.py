"""The doctor calls ready what a run accepts, and nothing else; both say what is assumed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg.cli.main import app
from riftberg.model import BareModel

HEAD = """\
start: {start}
days: {days}
berg:
  rectangle: {{length: 12 km, width: 6 km}}
  placement: [-39.0, -55.5]
forcing:
  kind: files
  files: {files}
  longitude: [-41, -37]
  latitude: [-57, -54]
"""


class StartedError(Exception):
    """The first step would come now."""


def product(path: Path, names: dict[str, float], days: int = 6, first: str = "2020-12-08", east: float = -36.0) -> None:
    """Write daily fields of constants with CF names."""
    standard = {
        "uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity", "ssh": "sea_surface_height_above_geoid",
        "ua": "eastward_wind", "va": "northward_wind",
    }  # fmt: skip
    lat, lon = np.arange(-58.0, -52.9, 0.5), np.arange(-42.0, east + 0.1, 0.5)
    time = np.datetime64(first, "ns") + np.arange(days) * np.timedelta64(1, "D")
    ds = xr.Dataset(coords={
        "time": ("time", time, {"standard_name": "time"}),
        "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
        "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
    })  # fmt: skip
    for name, value in names.items():
        attributes = {"standard_name": standard[name], "units": "m" if name == "ssh" else "m s-1"}
        field = value * (1.0 + 0.1 * np.cos(np.arange(lon.size)))
        ds[name] = ("time", "lat", "lon"), np.broadcast_to(field, (days, lat.size, lon.size)).copy(), attributes
    ds.to_netcdf(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of forcing, good and bad."""
    here = tmp_path_factory.mktemp("forcing")
    product(here / "currents.nc", {"uo": 0.2, "vo": 0.1})
    product(here / "all.nc", {"uo": 0.2, "vo": 0.1, "ssh": 0.3, "ua": 5.0, "va": 1.0})
    product(here / "wind.nc", {"ua": 5.0, "va": 1.0})
    product(here / "half.nc", {"uo": 0.2})
    product(here / "still.nc", {"uo": 0.0, "vo": 0.0})
    product(here / "fast.nc", {"uo": 50.0, "vo": 0.0})
    product(here / "late.nc", {"uo": 0.2, "vo": 0.1}, first="2021-02-01")
    product(here / "short.nc", {"uo": 0.2, "vo": 0.1}, days=2)
    product(here / "west.nc", {"uo": 0.2, "vo": 0.1}, east=-40.0)
    (here / "text.nc").write_text("no NetCDF")
    (here / "empty.nc").write_bytes(b"")
    return here


def call(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def starts(path: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether ``riftberg run`` comes to its first step."""

    def step(self: BareModel) -> None:
        raise StartedError

    with monkeypatch.context() as patch:
        patch.setattr(BareModel, "step", step)
        result = call("run", path, "-q", "--no-map", "-o", out)
    if isinstance(result.exception, StartedError):
        return True
    assert result.exit_code == 2, result.output
    return False


FILES = [
    "currents.nc", "all.nc", "[currents.nc, wind.nc]", "[all.nc, wind.nc]", "still.nc", "[all.nc, text.nc]", "wind.nc", "half.nc",
    "fast.nc", "late.nc", "short.nc", "west.nc", "text.nc", "empty.nc", "none.nc", "'*.nc'", "[currents.nc, late.nc]",
]  # fmt: skip
SPANS = [("2020-12-09 13:00", 1), ("2020-12-12 00:00", 4), ("2020-12-09", 0.001)]
EXTRAS = ["", "  sea_level: none\n  wind: none\n", "  spacing: 0.5\n", "  currents: surface\n  hold: 30\n"]
KINDS = [(files, *SPANS[k % 3], EXTRAS[k % 4]) for k, files in enumerate(FILES)]
KINDS += [(files, *SPANS[0], EXTRAS[3]) for files in FILES[:7]]


@pytest.mark.quick(8)
@pytest.mark.parametrize(("files", "start", "days", "extra"), KINDS)
def test_ready_means_that_the_run_starts(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, files: str, start: str, days: float, extra: str
) -> None:
    path = folder / "asked.yaml"
    path.write_text(HEAD.format(start=start, days=days, files=files) + extra)
    result = call("doctor", "--for", path)
    assert result.exit_code in (0, 1), result.output
    assert (result.exit_code == 0) == starts(path, tmp_path / "out", monkeypatch), result.output


def test_currents_alone_are_ready_and_what_is_assumed_is_said(folder: Path) -> None:
    """The doctor said "Not ready" with exit 1; the run ran."""
    path = folder / "asked.yaml"
    path.write_text(HEAD.format(start="2020-12-09 13:00", days=1, files="currents.nc"))
    result = call("doctor", "--for", path)
    assert result.exit_code == 0, result.output
    assert "Assumed: no sea level is given: its slope balances the current" in result.output
    assert "the air is calm" in result.output


def test_files_without_an_experiment_are_judged_by_what_a_run_needs(folder: Path) -> None:
    alone = call("doctor", folder / "currents.nc")
    assert alone.exit_code == 0, alone.output
    assert "Assumed: calm air, for no file gives ua" in alone.output
    box = ("--lon", "-41,-37", "--lat", "-57,-54", "--time", "2020-12-09,2020-12-11")
    for name, code in (("still.nc", 0), ("all.nc", 0), ("fast.nc", 1), ("late.nc", 1), ("half.nc", 1)):
        assert call("doctor", folder / name, *box).exit_code == code, name
    assert call("doctor", folder / "currents.nc", *box, "--need", "ssh").exit_code == 1


def test_a_run_that_needs_no_files_is_ready_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "steady.yaml"
    steady = HEAD[: HEAD.index("  kind")].format(start="2020-12-09", days=1) + "  uniform: {}\n"
    for text, code in (
        (steady, 0),
        (steady + "output_every_hours: 0.1\n", 0),
        (steady + "output_every_hours: 0.1\nparameters: {stepping: {time_step: 1800 s}}\n", 1),
        (steady + "parameters: {stepping: {scheme: mts, substeps: 3}}\n", 1),
    ):
        path.write_text(text)
        assert call("doctor", "--for", path).exit_code == code
        assert starts(path, tmp_path / "out", monkeypatch) == (code == 0)


def test_a_pattern_without_a_file_names_the_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The message was ``.: no file matches``."""
    (folder / "asked.yaml").write_text(HEAD.format(start="2020-12-09", days=1, files="none*.nc"))
    monkeypatch.chdir(folder)
    result = call("run", "asked.yaml", "-q")
    assert f"the folder {folder}: no file matches 'none*.nc'" in result.stderr
