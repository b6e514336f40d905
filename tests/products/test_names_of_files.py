"""Names of files: what is there is never a pattern, and ``~`` is the home folder, wherever a name enters."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from products.test_odd_files import CENTRE, START, elements, plain, written
from riftberg import open_product
from riftberg.cli.main import app
from riftberg.errors import ForcingError, RiftbergError
from riftberg.experiments.yaml_file import build_berg, read_file
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import open_all
from riftberg.system.input_files import files_matching


def sea(folder: Path, name: str = "sea.nc") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return written(folder, plain(names=("uo", "vo"))).rename(folder / name)


def runs(file: str, folder: Path) -> bool:
    asked = FileForcing(
        kind="files", files=[file], longitude=(CENTRE - 2.0, CENTRE + 2.0), latitude=(-57.5, -53.5), hold=24.0
    )
    forcing_from_files(asked, folder, Run.of(START, 0.1, elements().thickness, 850.0))
    return True


@pytest.mark.parametrize("folder", ["run [1]", "[a-c]", "what?", "a*b", "deep [x]/and *"])
@pytest.mark.parametrize("name", ["sea.nc", "sea[2].nc", "s?a*.nc"])
def test_an_existing_name_is_no_pattern(tmp_path: Path, folder: str, name: str) -> None:
    path = sea(tmp_path / folder, name)
    assert files_matching(str(path)) == files_matching(f"{folder}/{name}", tmp_path) == [str(path)]
    assert files_matching("*.nc", path.parent) == files_matching(f"{folder}/*.nc", tmp_path) == [str(path)]


def test_a_folder_with_brackets_is_read_by_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = sea(tmp_path / "run [1]")
    pattern = str(path.parent / "*.nc")
    assert runs("*.nc", path.parent)
    assert runs("sea.nc", path.parent)
    assert runs("run [1]/*.nc", tmp_path)
    assert open_product(pattern).attrs["source"] == str(path)
    assert "uo" in doctor([pattern], needed=("uo",)).text()
    monkeypatch.chdir(tmp_path)
    assert open_all("run [1]/*.nc")


def test_patterns_are_patterns_still(tmp_path: Path) -> None:
    one, two = sea(tmp_path, "sea1.nc"), sea(tmp_path, "sea2.nc")
    sea(tmp_path, "sea3.nc")
    assert files_matching("sea[12].nc", tmp_path) == [str(one), str(two)]
    assert files_matching("s*[!3].nc", tmp_path) == [str(one), str(two)]
    literal = sea(tmp_path, "sea[12].nc")
    assert files_matching("sea[12].nc", tmp_path) == [str(literal)]
    assert files_matching("sea[12]*", tmp_path) == [str(one), str(two)]
    assert files_matching("https://host/sea[12]?.nc", tmp_path) == ["https://host/sea[12]?.nc"]
    with pytest.raises(ForcingError, match=r"no file matches 'cur\*.nc'"):
        runs("cur*.nc", tmp_path)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "home"


def test_the_home_folder_is_written_out(home: Path) -> None:
    path = sea(home)
    assert runs("~/sea.nc", Path("elsewhere"))
    assert runs("~/s*.nc", Path("elsewhere"))
    assert open_product("~/sea.nc").attrs["source"] == str(path)
    assert "\n  uo " in doctor(["~/*.nc"], needed=()).text()
    with pytest.raises(ForcingError, match=str(home / "no.nc")):
        open_product("~/no.nc")


def test_a_file_that_is_called_so_stays(home: Path, tmp_path: Path) -> None:
    sea(tmp_path, "~")
    assert files_matching("~", tmp_path) == [str(tmp_path / "~")]


def test_outlines_and_maps_of_an_experiment_in_the_home_folder(home: Path, tmp_path: Path) -> None:
    home.mkdir()
    square = [[-39.0, -55.0], [-38.9, -55.0], [-38.9, -55.05], [-39.0, -55.05], [-39.0, -55.0]]
    (home / "berg [1].geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [square]}))
    said = {
        "name": "home", "start": "2020-12-16", "days": 0.1, "forcing": {"kind": "formula", "uniform": {"current": [0.1, 0.0]}},
        "berg": {"outline": {"file": "~/berg [1].geojson"}, "thickness": "200 m", "radius": "1 km"},
    }  # fmt: skip
    (tmp_path / "e.yaml").write_text(yaml.safe_dump(said))
    experiment, parameters, _ = read_file(tmp_path / "e.yaml")
    assert build_berg(experiment, parameters, tmp_path).elements.lon.size > 5


def test_the_command_line_writes_it_out_where_no_shell_did(home: Path) -> None:
    sea(home)
    result = CliRunner().invoke(app, ["doctor", "~/sea.nc", "--along=~/run.nc"])
    assert str(home / "run.nc") in result.output


def test_where_a_shell_is_needed_the_error_says_so(home: Path) -> None:
    from riftberg import read_observed

    with pytest.raises(RiftbergError, match="home folder"):
        read_observed("~/seen.csv")
