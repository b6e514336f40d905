"""Variables as their user names them: in an experiment file, for the doctor and in Python; and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg import DatasetForcing, Forcing, build
from riftberg.cli.main import app
from riftberg.errors import ForcingError, InputError
from riftberg.products import recognise
from riftberg.products.registry import open_named
from riftberg.state import new_elements

YAML = """\
start: 2020-12-09 13:00
days: 0.5
berg:
  rectangle: {{length: 12 km, width: 6 km}}
  placement: [-39.0, -55.5]
forcing:
  kind: files
  files: [{entry}]
  longitude: [-41, -37]
  latitude: [-57, -54]
  sea_level: none
  wind: none
"""
NAMED = "{file: mine.nc, names: {uo: speed_a, vo: speed_b, lon: across, lat: up, time: when}}"


def mine() -> xr.Dataset:
    """Currents under names that say nothing, on axes that say nothing; another pair stands beside them."""
    dims = ("when", "up", "across")
    sizes = (4, 17, 19)
    fields = {
        name: (dims, np.full(sizes, value), {"units": "cm/s"})
        for name, value in (("speed_a", 20.0), ("speed_b", -5.0), ("other", 90.0))
    }
    axes = {
        "when": np.datetime64("2020-12-09T00", "ns") + 12 * np.arange(4) * np.timedelta64(1, "h"),
        "up": np.linspace(-60.0, -52.0, 17),
        "across": np.linspace(-43.0, -34.0, 19),
    }
    return xr.Dataset(fields, axes)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    mine().to_netcdf(tmp_path / "mine.nc")
    return tmp_path


def currents_of(forcing: DatasetForcing) -> tuple[float, float]:
    e = new_elements(1)
    e.place.lon[:], e.place.lat[:], e.body.thickness[:] = -39.0, -55.5, 200.0
    forcing.sample(e, 0.0)
    return float(e.uo[0]), float(e.vo[0])


def test_an_experiment_file_names_the_variables(folder: Path) -> None:
    path = folder / "own.yaml"
    path.write_text(YAML.format(entry=NAMED))
    model, _ = build(str(path))
    assert currents_of(model.forcing) == pytest.approx((0.2, -0.05))


def test_the_sea_floor_is_no_level() -> None:
    """Bug: a map named as ``depth`` was made a coordinate, and the file held nothing then."""
    floor = xr.Dataset(
        {"topo": (("Y", "X"), np.full((3, 3), 500.0), {"units": "m"})},
        coords={"X": [1.0, 2.0, 3.0], "Y": [-60.0, -59.0, -58.0]},
    )
    with pytest.raises(ForcingError, match=r"topo is a map, but depth names the levels.*depth_below_surface: topo"):
        DatasetForcing.from_xarray(floor, names={"depth": "topo", "lon": "X", "lat": "Y"})


def test_python_names_the_variables() -> None:
    axes = {"lon": "across", "lat": "up", "time": "when"}
    forcing = Forcing.from_dataset(mine(), uo="speed_a", vo="speed_b", **axes)
    assert currents_of(forcing) == pytest.approx((0.2, -0.05))
    other = Forcing.from_dataset(mine(), uo="other", vo="speed_b", **axes, sea_level="geostrophic")
    assert currents_of(other) == pytest.approx((0.9, -0.05))
    # Of several datasets each takes the names that it holds.
    sea = mine()
    parts = [sea[["speed_a", "speed_b"]], sea[["other"]].rename(other="eta").assign_coords(up=sea.up + 0.25)]
    parts[1]["eta"].attrs["units"] = "m"
    both = DatasetForcing.from_xarray(parts, names={"uo": "speed_a", "vo": "speed_b", "ssh": "eta", **axes})
    assert sorted(name for part in both.parts for name in part.gives) == ["ssh", "uo"]


def test_a_name_goes_before_a_standard_name_and_the_choice_of_a_product(tmp_path: Path) -> None:
    ds = mine().rename(across="lon", up="lat", when="time").rename(speed_a="uo", speed_b="vo", other="u_tide")
    path = tmp_path / "sea.nc"
    ds.to_netcdf(path)
    first, second = open_named([(str(path), {"uo": "u_tide"})]), open_named([(str(path), None)])
    assert float(first[0]["uo"].mean()) == pytest.approx(0.9)
    assert float(second[0]["uo"].mean()) == pytest.approx(0.2)
    two = ds.assign(u_sea=ds["uo"]).drop_vars("uo")
    for name in ("u_sea", "u_tide"):
        two[name].attrs["standard_name"] = "eastward_sea_water_velocity"
    two.to_netcdf(tmp_path / "two.nc")
    with pytest.raises(ForcingError, match="2 variables could be uo") as error:
        open_named([(str(tmp_path / "two.nc"), None)])
    assert "--names uo=u_" in error.value.remedy
    named = open_named([(str(tmp_path / "two.nc"), {"uo": "u_sea"})])
    assert float(named[0]["uo"].mean()) == pytest.approx(0.2)


def test_the_doctor_takes_names(folder: Path) -> None:
    wind = (
        mine().rename(across="lon", up="lat", when="time")[["speed_a", "speed_b"]].rename(speed_a="u10", speed_b="v10")
    )
    wind.to_netcdf(folder / "wind.nc")
    options = ["--lon", "-41,-37", "--lat", "-57,-54", "--time", "2020-12-09,2020-12-10"]
    names = "uo=speed_a,vo=speed_b,lon=across,lat=up,time=when"
    refused = CliRunner().invoke(app, ["doctor", str(folder / "mine.nc"), *options])
    assert refused.exit_code != 0
    said = CliRunner().invoke(app, ["doctor", str(folder / "*.nc"), *options, "--names", names])
    assert said.exit_code == 0, said.output
    assert "uo" in said.stdout
    assert "ua" in said.stdout
    wrong = CliRunner().invoke(app, ["doctor", str(folder / "*.nc"), *options, "--names", "uo=sped_a"])
    assert "no file has a variable 'sped_a'. Did you mean 'speed_a'?" in " ".join(wrong.stderr.split())


def test_what_is_not_recognised_is_told_of_products_and_names(folder: Path) -> None:
    with pytest.raises(ForcingError, match="the product was not recognised") as error:
        recognise(folder / "mine.nc")
    for part in ("names: {uo: u, vo: v}", "--names uo=u,vo=v", "Forcing.from_dataset(ds", "glorys", "oscar-v2"):
        assert part in error.value.remedy


def test_mistakes_are_named(folder: Path) -> None:
    path = folder / "own.yaml"
    path.write_text(YAML.format(entry=NAMED.replace("speed_b", "speedb")))
    with pytest.raises(ForcingError, match=r"no variable .speedb.\. Did you mean .speed_b.\?"):
        build(str(path))
    path.write_text(YAML.format(entry=NAMED.replace("vo: ", "voo: ")))
    with pytest.raises(InputError, match="names: 'voo' is no quantity or coordinate") as error:
        build(str(path))
    assert "Did you mean 'vo'?" in str(error.value)
    with pytest.raises(ForcingError, match="there is no variable 'u'"):
        Forcing.from_dataset(mine(), uo="u")
    with pytest.raises(TypeError, match=r"argument .sealevel.\. Did you mean .sea_level."):
        Forcing.from_dataset(mine(), sealevel="none")
    with pytest.raises(ForcingError, match="3 is no name of a variable"):
        DatasetForcing.from_xarray(mine(), names={"uo": 3})
