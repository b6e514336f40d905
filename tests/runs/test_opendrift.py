"""Files of OpenDrift's OpenBerg as start, size, forcing and observation, with what is easily misread in them."""

from __future__ import annotations

import json
import logging
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg import Model, Options, build, open_run, read_observed, read_opendrift, score_run, write_opendrift
from riftberg.cli.main import app
from riftberg.errors import ForcingError, InputError

HOURS = 13
TIMES = np.datetime64("2025-09-24T00:00:31", "ns") + np.arange(HOURS) * np.timedelta64(1, "h")


def trajectory(file: Path, number: int) -> Any:
    """Return one trajectory of a file."""
    (one,) = read_opendrift(f"{file}#{number}")
    return one


def openberg(**changes: Any) -> xr.Dataset:
    """Two bergs as OpenDrift 1.14 writes them: the first ends after 9 records, stranded; the second is seeded 3 hours later."""
    there = np.array([np.arange(HOURS) < 9, np.arange(HOURS) >= 3])

    def field(value: Any) -> Any:
        return ("trajectory", "time"), np.where(there, value, np.nan).astype("f4")

    hours = np.arange(HOURS)
    values = {
        "lon": -58.0 + 0.02 * hours, "lat": 75.0 + 0.001 * hours, "x_sea_water_velocity": 0.2, "y_sea_water_velocity": 0.05,
        "x_wind": 5.0, "y_wind": -1.0, "sea_floor_depth_below_sea_level": [[500.0], [10000.0]], "sea_surface_height": 0.3,
        "sea_surface_x_slope": 0.0, "sea_ice_area_fraction": 0.0, "sea_ice_thickness": 0.0, "sea_ice_x_velocity": 0.0,
        "sea_ice_y_velocity": 0.0, "sea_surface_wave_significant_height": 0.64, "length": [500.0 - hours, 203.0 - hours],
        "width": [[300.0], [150.0]], "sail": [[20.0], [10.0]], "draft": [140.0 + hours, 70.0 + 0.0 * hours],
        "moving": np.where(hours == 8, 0, 1), "status": np.where(hours == 8, 2, 0),
    }  # fmt: skip
    values |= {name: value for name, value in changes.items() if name in values}
    ds = xr.Dataset({name: field(value) for name, value in values.items()}, {"trajectory": [4, 7], "time": TIMES})
    ds["status"].attrs = {"flag_values": np.array([0, 1, 2], "i4"), "flag_meanings": "active missing_data stranded"}
    ds.attrs = {
        "featureType": "trajectory", "opendrift_class": "OpenBerg", "opendrift_version": "1.14.9",
        "reader_x_sea_water_velocity": "['cmems_mod_arc_phy_my_topaz4_P1D-m']", "reader_y_sea_water_velocity": "0.05",
        "reader_sea_ice_area_fraction": "0", "reader_sea_ice_thickness": "0", "reader_sea_ice_x_velocity": "0",
        "reader_sea_ice_y_velocity": "0", "reader_sea_surface_wave_significant_height": "0", "reader_x_wind": "5",
        "reader_y_wind": "0", "config_drift:sea_surface_slope": "False", "config_drift:vertical_profile": "False",
    }  # fmt: skip
    ds.attrs.update({name: value for name, value in changes.items() if name not in values})
    return ds


@pytest.fixture
def file(tmp_path: Path) -> Path:
    openberg().to_netcdf(tmp_path / "ob.nc")
    return tmp_path / "ob.nc"


def test_a_trajectory_is_its_valid_records_alone(file: Path) -> None:
    first, second = read_opendrift(file)
    assert (first.number, second.number) == (4, 7)
    assert (first.times.size, second.times.size) == (9, 10)
    assert first.start == datetime(2025, 9, 24, 0, 0, 31)
    assert second.start == datetime(2025, 9, 24, 3, 0, 31)
    assert second.lon[0] == pytest.approx(-57.94)
    assert (first.end, second.end) == ("stranded", "active")
    assert first.moving[-1] == 0.0
    assert first.program == "OpenBerg 1.14.9"
    assert "topaz4" in first.ocean
    assert first.options["sea_surface_slope"] == "False"
    assert first.observed()[datetime(2025, 9, 24, 1, 0, 31)] == pytest.approx((-57.98, 75.001))


@pytest.mark.parametrize("nowhere", [(0.0, 0.0), (-999.0, -999.0), (1e20, 75.0)])
def test_records_at_no_position_are_none(tmp_path: Path, nowhere: tuple[float, float]) -> None:
    """As in tables of positions: a buoy that was not heard is not in the Gulf of Guinea."""
    ds = openberg()
    for name, value in zip(("lon", "lat"), nowhere, strict=True):
        ds[name][:, 5] = value
    ds.to_netcdf(tmp_path / "ob.nc")
    found = [fix for fix in read_observed(tmp_path / "ob.nc").fixes if fix.name.endswith("7")]
    assert len(found) == HOURS - 4
    assert all(fix.lon < -50.0 and 74.0 < fix.lat < 76.0 for fix in found)


def test_the_size_is_that_of_the_start_and_the_thickness_sail_and_draft(file: Path) -> None:
    first, second = read_opendrift(file)
    assert first.size == (500.0, 300.0, 20.0, 140.0)
    assert second.size == (200.0, 150.0, 10.0, 70.0)
    berg = second.berg()
    assert (berg.elements.length[0], berg.elements.width[0], berg.elements.thickness[0]) == (200.0, 150.0, 80.0)
    assert berg.elements.lat[0] == pytest.approx(75.003)


def test_a_fallback_is_no_value(file: Path) -> None:
    first, second = read_opendrift(file)
    assert (first.depth, second.depth) == (500.0, None)  # 10,000 m: not known
    assert sorted(first.series) == [
        "ua",
        "uo",
        "va",
        "vo",
    ]  # one component of a wind may be 0; ice and waves are from nowhere
    forcing = first.forcing()
    assert forcing.assumes_slope  # a level at one place has no slope
    assert forcing.cover == (0.0, 8 * 3600.0)
    ice = openberg(reader_sea_ice_area_fraction="['topaz']", reader_sea_ice_x_velocity="['topaz']")
    ice.to_netcdf(file.with_name("ice.nc"))
    assert {"ice_fraction", "ui", "vi"} <= set(trajectory(file.with_name("ice.nc"), 4).series)


def test_an_ocean_that_covers_nothing_is_refused(tmp_path: Path) -> None:
    still = openberg(x_sea_water_velocity=0.0, y_sea_water_velocity=0.0, reader_x_sea_water_velocity="0")
    still.to_netcdf(tmp_path / "still.nc")
    with pytest.raises(ForcingError, match="the current is 0 at all 9 times of trajectory 4: no ocean covered it"):
        trajectory(tmp_path / "still.nc", 4).forcing()


@pytest.mark.parametrize("layout", ["ragged", "index", "one"])
def test_trajans_layout_of_one_dimension_is_read_too(layout: str, tmp_path: Path) -> None:
    first, second = read_opendrift_of(openberg(), tmp_path / "a.nc")
    both = [first] if layout == "one" else [first, second]
    columns = {name: np.concatenate([getattr(t, name) for t in both]) for name in ("lon", "lat", "times")}
    ds = xr.Dataset(
        {"lon": ("obs", columns["lon"]), "lat": ("obs", columns["lat"])}, {"time": ("obs", columns["times"])}
    )
    ds.attrs["featureType"] = "trajectory"
    if layout == "ragged":
        ds["rowsize"] = ("trajectory", [9, 10], {"sample_dimension": "obs"})
        ds["trajectory"] = ("trajectory", [4, 7], {"cf_role": "trajectory_id"})
    if layout == "index":
        ds["drifter"] = ("obs", np.repeat([4, 7], [9, 10]), {"cf_role": "trajectory_id"})
    again = read_opendrift_of(ds, tmp_path / "b.nc")
    for one, other in zip(again, both, strict=True):
        assert np.array_equal(one.times, other.times)
        assert np.array_equal(one.lon, other.lon)
    assert again[0].size is None
    with pytest.raises(InputError, match="no length, width, sail and draft"):
        again[0].berg()
    with pytest.raises(ForcingError, match="no current"):
        again[0].forcing()


def read_opendrift_of(ds: xr.Dataset, path: Path) -> Any:
    ds.to_netcdf(path)
    return read_opendrift(path)


def test_what_is_no_file_of_openberg_is_refused(file: Path, tmp_path: Path) -> None:
    openberg(opendrift_class="Leeway").to_netcdf(tmp_path / "leeway.nc")
    with pytest.raises(InputError, match=r"leeway.nc.*written by OpenDrift's Leeway, which knows no icebergs"):
        read_opendrift(tmp_path / "leeway.nc")
    xr.Dataset({"uo": ("x", [1.0])}).to_netcdf(tmp_path / "ocean.nc")
    with pytest.raises(InputError, match="no latitude by time"):
        read_opendrift(tmp_path / "ocean.nc")
    with pytest.raises(InputError, match=r"no trajectory 5\. It has 4, 7"):
        read_opendrift(f"{file}#5")
    file.with_name("e.yaml").write_text("forcing: {opendrift: ob.nc}\n")
    with pytest.raises(InputError, match=r"2 trajectories.*Name one of 4, 7"):
        build(str(file.with_name("e.yaml")))
    lost = openberg(lon=np.nan)
    lost.to_netcdf(tmp_path / "lost.nc")
    with pytest.raises(InputError, match="no trajectory with a position"):
        read_opendrift(tmp_path / "lost.nc")


@pytest.mark.parametrize(("changes", "said"), [
    ({"sail": -5.0}, r"trajectory 7: length 200, width 150, sail -5, draft 70 m are no size of a berg"),
    ({"width": 0.0}, "trajectory 7: .*width 0, .* are no size of a berg"),
    ({"x_sea_water_velocity": np.where(np.arange(HOURS) == 6, np.nan, 0.2)}, "trajectory 7, .*uo is missing at 2025-09-24 06:00"),
    ({"y_wind": 1e20}, "trajectory 7, va: va = 1e.20 is not possible"),
])  # fmt: skip
def test_values_that_cannot_be_are_refused_by_file_and_trajectory(
    changes: dict[str, Any], said: str, tmp_path: Path
) -> None:
    openberg(**changes).to_netcdf(tmp_path / "ob.nc")
    one = trajectory(tmp_path / "ob.nc", 7)
    with pytest.raises(InputError, match=f"ob.nc, {said}"):
        Model(one.berg(), one.forcing())


def test_a_file_without_a_component_of_the_current_is_refused(tmp_path: Path) -> None:
    openberg().drop_vars("y_sea_water_velocity").to_netcdf(tmp_path / "ob.nc")
    with pytest.raises(ForcingError, match="no current along the trajectory"):
        trajectory(tmp_path / "ob.nc", 7).forcing()


def test_an_experiment_takes_start_size_length_and_forcing_of_a_trajectory(file: Path) -> None:
    path = file.with_name("e.yaml")
    path.write_text("forcing: {opendrift: ob.nc, trajectory: 7}\n")
    model, info = build(str(path), Options())
    assert model.start == datetime(2025, 9, 24, 3, 0, 31)
    assert info.days == pytest.approx(9 / 24)
    assert model.elements.length.tolist() == [200.0]
    changes = {
        "berg": {"thickness": 60.0},
        "forcing": {"trajectory": 4},
    }  # as --set and members of a forecast make them
    model, _ = build(str(path), Options(changes=changes))
    assert (model.elements.length[0], model.elements.thickness[0], model.start.hour) == (500.0, 60.0, 0)
    path.write_text(
        "start: 2025-09-24 06:00\ndays: 0.2\nforcing: {opendrift: ob.nc, trajectory: 7, sea_level: none, wind: none}\n"
    )
    model, _ = build(str(path), Options())
    assert (model.start.hour, model.forcing.assumes_slope) == (6, False)
    assert "ua" not in model.forcing.provides
    model.check("0.2 d")


@pytest.fixture
def run(file: Path, tmp_path: Path) -> Path:
    path = tmp_path / "e.yaml"
    path.write_text("output_every_hours: 1\nforcing: {opendrift: ob.nc, trajectory: 7}\n")
    result = CliRunner().invoke(app, ["run", str(path), "-o", str(tmp_path / "out"), "--no-map", "--quiet"])
    assert result.exit_code == 0, result.output
    return tmp_path / "out"


def opened(caplog: pytest.LogCaptureFixture, path: Path) -> int:
    """Return how often a file was opened."""
    return sum(record.getMessage() == f"opening {path}" for record in caplog.records)


def test_compare_opens_a_file_of_trajectories_once(file: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Three times before: for its name, for what it is, and for its positions."""
    other = file.with_name("other.nc")
    openberg(lon=-57.9).to_netcdf(other)
    with caplog.at_level(logging.DEBUG):
        result = CliRunner().invoke(app, ["compare", f"{file}#7", f"{other}#7", "--json"])
    assert result.exit_code == 0, result.output
    assert (opened(caplog, file), opened(caplog, other)) == (1, 1)
    assert [one["name"] for one in json.loads(result.output)["runs"]] == ["ob.nc#7", "other.nc#7"]


@pytest.mark.slow
def test_compare_and_score_take_a_trajectory_as_the_other_run(
    run: Path, file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.DEBUG):
        result = CliRunner().invoke(app, ["compare", str(run), f"{file}#7", "--json"])
    assert result.exit_code == 0, result.output
    assert (opened(caplog, run / "run.nc"), opened(caplog, file)) == (1, 1)
    table = json.loads(result.output)
    (apart,) = table["apart"]
    assert apart["distance_km"][0] == pytest.approx(0.0, abs=0.01)
    assert 0.5 < apart["distance_km"][-1] < 20.0
    assert apart["area_second_km2"][0] == pytest.approx(0.03)
    assert ["program", "", "OpenBerg 1.14.9"] in table["rows"]
    assert not any(row[0] == "parameters that differ" for row in table["rows"])
    scored = score_run(open_run(run), read_observed(f"{file}#7"))
    assert scored.days[-1].berg is not None
    assert scored.days[-1].berg.distance_km == pytest.approx(apart["distance_km"][-1], abs=0.01)


def test_a_run_along_a_trajectory_goes_with_its_water(file: Path) -> None:
    one = trajectory(file, 7)
    model = Model(one.berg(), one.forcing())
    model.advance("9 h")
    assert model.elements.lon[0] > one.lon[0] + 0.1


def test_a_run_written_for_opendrift_is_read_back(file: Path, tmp_path: Path) -> None:
    one = trajectory(file, 7)
    run = Model(one.berg(), one.forcing()).run("6 h", every_hours=2)
    (again,) = read_opendrift(write_opendrift(run, tmp_path / "ours.nc"))
    tracks = run.riftberg.tracks
    assert again.start == one.start
    assert again.lon == pytest.approx(tracks["lon"].values, abs=1e-9)
    assert again.size is not None
    assert (again.size.length, again.size.width) == pytest.approx((200.0, 150.0), rel=1e-6)
    assert again.size.thickness == pytest.approx(80.0, rel=1e-5)
    assert again.size.draft / again.size.thickness == pytest.approx(0.83, abs=0.01)
    with pytest.raises(ForcingError, match="no current"):
        again.forcing()


@pytest.mark.filterwarnings("ignore")  # of OpenDrift's own
def test_opendrift_reads_a_run(file: Path, tmp_path: Path) -> None:
    opendrift = pytest.importorskip("opendrift")
    one = trajectory(file, 7)
    run = Model(one.berg(), one.forcing()).run("6 h", every_hours=2)
    theirs = opendrift.open(str(write_opendrift(run, tmp_path / "ours.nc")))
    assert type(theirs).__name__ == "OpenBerg"
    assert theirs.result["lon"].shape == (1, 4)
