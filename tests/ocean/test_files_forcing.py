"""Forcing from data files, as a YAML experiment asks for it."""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg import Model, Options, build
from riftberg.cli.main import app
from riftberg.cli.options import named_files
from riftberg.ensembles.uncertain import with_errors
from riftberg.errors import ForcingError, InputError
from riftberg.ocean.files_forcing import ModelGrid, Run
from riftberg.ocean.files_schema import FileForcing

EXPERIMENT = """\
start: 2020-12-09 13:00
days: 0.5
berg:
  rectangle: {length: 12 km, width: 6 km}
  placement: [-39.0, -55.5]
forcing:
  kind: files
  files: [currents.nc, sea_level.nc, wind.nc, floor.nc]
  longitude: [-41, -37]
  latitude: [-57, -54]
  spacing: 0.25
"""


def field(function: object, name: str, units: str, standard_name: str, records: int) -> xr.DataArray:
    """Return a field that is linear in longitude, latitude and time."""
    lon, lat = np.arange(-43.0, -34.9, 0.5), np.arange(-59.0, -51.9, 0.5)
    time = np.datetime64("2020-12-09T00", "ns") + np.arange(records) * np.timedelta64(12, "h")
    values = function(lon[None, None, :], lat[None, :, None], np.arange(records)[:, None, None])  # type: ignore[operator]
    attributes = {"units": units, "standard_name": standard_name}
    coords = {
        "time": ("time", time, {"standard_name": "time"}),
        "lat": ("lat", lat, {"units": "degrees_north", "standard_name": "latitude"}),
        "lon": ("lon", lon, {"units": "degrees_east", "standard_name": "longitude"}),
    }
    shape = (records, len(lat), len(lon))
    return xr.DataArray(np.broadcast_to(values, shape), coords, ("time", "lat", "lon"), name, attributes)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with an experiment and CF files of linear fields."""
    pytest.importorskip("cf_xarray")
    east = field(lambda x, y, t: 0.1 + 0.01 * (x + 39) + 0.05 * t, "u", "m s-1", "eastward_sea_water_velocity", 4)
    north = field(lambda x, y, t: 0.02 * (y + 55), "v", "m s-1", "northward_sea_water_velocity", 4)
    level = field(lambda x, y, t: 0.1 * (y + 55), "zos", "m", "sea_surface_height_above_geoid", 4)
    wind = [field(lambda x, y, t: 5.0, "u10", "m s-1", "eastward_wind", 4),
            field(lambda x, y, t: -2.0, "v10", "m s-1", "northward_wind", 4)]  # fmt: skip
    floor = field(lambda x, y, t: 300.0 + 10 * (x + 39), "depth", "m", "sea_floor_depth_below_geoid", 1)
    xr.merge([east, north]).to_netcdf(tmp_path / "currents.nc")
    level.to_netcdf(tmp_path / "sea_level.nc")
    xr.merge(wind).to_netcdf(tmp_path / "wind.nc")
    floor.isel(time=0, drop=True).to_netcdf(tmp_path / "floor.nc")
    (tmp_path / "files.yaml").write_text(EXPERIMENT)
    return tmp_path


def test_fields_reach_the_elements(folder: Path) -> None:
    model, _ = build(str(folder / "files.yaml"))
    e = model.elements
    model.forcing.grid.locate(e)
    model.forcing.sample(e, 0.0)
    # 13:00 lies 13/12 intervals after the first record; fields are linear, so interpolation is exact.
    np.testing.assert_allclose(e.uo, 0.1 + 0.01 * (e.lon + 39.0) + 0.05 * 13 / 12, atol=2e-6)
    np.testing.assert_allclose(e.vo, 0.02 * (e.lat + 55.0), atol=2e-6)
    np.testing.assert_allclose(e.ua, 5.0, rtol=1e-6)
    np.testing.assert_allclose(e.slope_y, 0.1 / (np.pi / 180.0 * model.parameters.earth.radius), rtol=1e-4)
    assert np.all(np.abs(e.depth - 300.0 - 10 * (e.lon + 39.0)) < 3.0)


def test_files_that_do_not_match_or_have_no_currents_are_named(folder: Path) -> None:
    path = folder / "files.yaml"
    path.write_text(EXPERIMENT.replace("currents.nc, ", "nothing*.nc, "))
    with pytest.raises(ForcingError, match=r"no file matches 'nothing\*.nc'"):
        build(str(path))
    path.write_text(EXPERIMENT.replace("currents.nc, ", ""))
    with pytest.raises(ForcingError, match="no ocean current"):
        build(str(path))


def test_a_run_beyond_the_files_is_refused(folder: Path) -> None:
    path = folder / "files.yaml"
    path.write_text(EXPERIMENT.replace("days: 0.5", "days: 9"))
    with pytest.raises(ForcingError, match="2020-12"):
        _run(path)


def _run(path: Path) -> None:
    model, info = build(str(path))
    model.advance(info.days)


LEVELS = np.array([10.0, 30.0, 70.0, 150.0, 400.0])  # limits 0, 20, 50, 110, 275, 525


def with_levels(folder: Path, floor: float = 600.0) -> None:
    """Replace the currents by such on levels, 0.4 m/s in the uppermost 20 m and 0.1 m/s below, to a floor (m)."""
    east = field(lambda x, y, t: 0.0 * x + 0.0 * y + 0.0 * t, "uo", "m s-1", "eastward_sea_water_velocity", 4)
    depth = xr.DataArray(
        LEVELS, dims="depth", attrs={"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}
    )
    profile = xr.DataArray(np.where(LEVELS < 20.0, 0.4, 0.1), {"depth": depth}, ("depth",))
    layered = (east + profile).where(depth < floor).transpose("time", "depth", "lat", "lon")
    uo, vo = (
        layered.assign_attrs(east.attrs),
        (0.5 * layered).assign_attrs(units="m s-1", standard_name="northward_sea_water_velocity"),
    )
    (folder / "currents.nc").unlink()
    xr.Dataset({"uo": uo, "vo": vo}).to_netcdf(folder / "currents.nc")


def mean_to(draft: float) -> float:
    return (0.4 * 20.0 + 0.1 * (draft - 20.0)) / draft


def test_currents_on_levels_are_averaged_over_the_draft_of_each_element(folder: Path) -> None:
    """Files with depth made the run stop: their fields had one dimension too many."""
    with_levels(folder)
    model, _ = build(str(folder / "files.yaml"))
    e = model.elements
    e.thickness[:3] = 100.0
    e.thickness[3:] = 250.0
    model.forcing.grid.locate(e)
    model.forcing.sample(e, 0.0)
    share = model.parameters.ice.density / 1025.0
    np.testing.assert_allclose(e.uo[:3], mean_to(100.0 * share), rtol=1e-6)
    np.testing.assert_allclose(e.uo[3:], mean_to(250.0 * share), rtol=1e-6)
    np.testing.assert_allclose(e.vo, 0.5 * e.uo, rtol=1e-6)
    assert "from 4 layers to 275 m" in model.forcing.describe()  # nothing deeper than the keel is read
    u, _ = model.forcing.currents(np.array([-39.0]), np.array([-55.5]), 0.0)
    assert u[0] == pytest.approx(mean_to(200.0 * share), rel=1e-6)  # maps: the mean draft of the berg at the start
    _run(folder / "files.yaml")


@pytest.mark.quick(1)
@pytest.mark.parametrize("more", ["", "  spacing: 0.25\n", "  sea_level: geostrophic\n"])
def test_thicker_members_get_the_current_over_their_draft(folder: Path, more: str) -> None:
    """Levels were cut at the keel of the berg as the file has it: members much thicker than that failed."""
    with_levels(folder)
    (folder / "files.yaml").write_text(EXPERIMENT.replace("  spacing: 0.25\n", more))
    model, _ = build(str(folder / "files.yaml"))
    model.forcing.sample(model.elements, 0.0)
    own, slope = model.elements.uo.copy(), model.elements.slope_y.copy()
    thick = with_errors(model, {"start.thickness": 1.75})
    thick.check(0.1)
    thick.forcing.sample(thick.elements, 0.0)
    draft = 200.0 * model.parameters.ice.density / 1025.0
    np.testing.assert_allclose(thick.elements.uo, mean_to(1.75 * draft), rtol=1e-6)
    if "geostrophic" in more:
        np.testing.assert_allclose(thick.elements.slope_y / slope, mean_to(1.75 * draft) / mean_to(draft), rtol=1e-6)
    model.forcing.sample(model.elements, 0.0)  # the same forcing: what others get stays as it was
    np.testing.assert_array_equal(model.elements.uo, own)
    with pytest.raises(ForcingError, match="a draft of 663 m, the levels of the currents end at 525 m"):
        with_errors(model, {"start.thickness": 4.0}).check(0.1)


def test_the_mean_ends_at_the_sea_floor(folder: Path) -> None:
    with_levels(folder, floor=100.0)  # water to 110 m
    model, _ = build(str(folder / "files.yaml"))
    model.forcing.grid.locate(model.elements)
    model.forcing.sample(model.elements, 0.0)
    np.testing.assert_allclose(model.elements.uo, mean_to(110.0), rtol=1e-6)


def test_the_currents_of_the_surface_can_be_taken_instead(folder: Path) -> None:
    with_levels(folder)
    path = folder / "files.yaml"
    path.write_text(EXPERIMENT + "  currents: surface\n")
    model, _ = build(str(path))
    model.forcing.grid.locate(model.elements)
    model.forcing.sample(model.elements, 0.0)
    np.testing.assert_allclose(model.elements.uo, 0.4, rtol=1e-6)


def with_warm_top(folder: Path) -> None:
    """Add temperature and salinity on levels: 3 degrees and 33 in the uppermost 20 m, 1 degree and 34.5 below."""
    flat = field(lambda x, y, t: 0.0 * x + 0.0 * y + 0.0 * t, "uo", "m s-1", "", 4)
    depth = xr.DataArray(LEVELS, dims="depth", attrs={"standard_name": "depth", "units": "m", "positive": "down"})
    said = (("thetao", "potential_temperature", "degC", 3.0, 1.0), ("so", "salinity", "1e-3", 33.0, 34.5))
    layered = {
        name: (flat + xr.DataArray(np.where(LEVELS < 20.0, top, below), {"depth": depth}, ("depth",)))
        .transpose("time", "depth", "lat", "lon").assign_attrs(units=units, standard_name=f"sea_water_{long}")
        for name, long, units, top, below in said
    }  # fmt: skip
    xr.Dataset(layered).to_netcdf(folder / "water.nc")


MELTING = EXPERIMENT.replace("floor.nc]", "floor.nc, water.nc]") + "parameters:\n  melt: {enabled: true}\n"


@pytest.mark.parametrize("spacing", ["  spacing: 0.25\n", ""])
def test_temperature_and_salinity_on_levels_are_averaged_over_the_draft_for_sides_and_base(
    folder: Path, spacing: str
) -> None:
    """Of files with levels the uppermost one counted for all of the melt."""
    with_warm_top(folder)
    (folder / "files.yaml").write_text(MELTING.replace("  spacing: 0.25\n", spacing))
    e = (model := sampled(folder / "files.yaml", 3600.0)).elements
    draft = model.parameters.ice.density / 1025.0 * e.thickness
    np.testing.assert_allclose(e.sst, 3.0, rtol=1e-6)
    np.testing.assert_allclose(e.sss, 33.0, rtol=1e-6)
    np.testing.assert_allclose(e.environment.keel_temperature, 1.0 + 2.0 * 20.0 / draft, rtol=1e-6)
    np.testing.assert_allclose(e.environment.keel_salinity, 34.5 - 1.5 * 20.0 / draft, rtol=1e-6)
    assert "sst: at the surface for waves, mean over the draft" in model.forcing.describe()
    model.step()
    # Without melt nobody reads the levels, and those of the surface alone have no mean over the keel.
    (folder / "files.yaml").write_text(MELTING.replace("enabled: true", "enabled: false"))
    dry = sampled(folder / "files.yaml", 3600.0).elements
    np.testing.assert_allclose(dry.sst, 3.0, rtol=1e-6)
    assert np.isnan(dry.environment.keel_temperature).all()
    with xr.open_dataset(folder / "water.nc") as ds:
        top = ds.isel(depth=0).load()
    (folder / "water.nc").unlink()
    top.to_netcdf(folder / "water.nc")
    (folder / "files.yaml").write_text(MELTING)
    assert np.isnan(sampled(folder / "files.yaml", 3600.0).elements.environment.keel_salinity).all()


def test_levels_that_end_above_the_keel_are_refused(folder: Path) -> None:
    with_levels(folder)
    with xr.open_dataset(folder / "currents.nc") as ds:
        shallow = ds.isel(depth=slice(0, 3)).load()
    (folder / "currents.nc").unlink()
    shallow.to_netcdf(folder / "currents.nc")
    with pytest.raises(ForcingError, match=r"has a draft of 166 m, the levels of the currents end at 90 m"):
        _run(folder / "files.yaml")


def test_a_real_file_of_glorys_drives_a_berg_by_its_draft(shared: Path, tmp_path: Path) -> None:
    sample = shared / "data" / "samples" / "GLORYS_NA_20120101.nc"
    text = EXPERIMENT.replace("2020-12-09 13:00", "2012-01-01 06:00").replace("[-39.0, -55.5]", "[-8.0, 60.0]")
    text = text.replace("[-41, -37]", "[-12, -3]").replace("[-57, -54]", "[57, 63]")
    text = text.replace("[currents.nc, sea_level.nc, wind.nc, floor.nc]", f"[{sample}]")
    (tmp_path / "glorys.yaml").write_text(text)
    model, info = build(str(tmp_path / "glorys.yaml"))
    model.advance(info.days)
    # Between the mean over the uppermost level and that of the levels to 194 m at the nearest point of the file.
    with xr.open_dataset(sample) as ds:
        column = ds.sel(longitude=slice(-9, -7), latitude=slice(59, 61), depth=slice(0, 200))["uo"]
        low, high = float(column.min()), float(column.max())
    assert np.all((model.elements.uo >= low) & (model.elements.uo <= high))
    assert "over the draft of each element, from 3 layers" in model.forcing.describe()


OWN = EXPERIMENT.replace("  spacing: 0.25\n", "")


def sampled(path: Path, time: float, **options: object) -> Model:
    """Build an experiment and sample its forcing at a time (s)."""
    model, _ = build(str(path), Options(**options))  # type: ignore[arg-type]
    if model.forcing.grid is not None:
        model.forcing.grid.locate(model.elements)
    model.forcing.sample(model.elements, time)
    return model


def test_products_keep_their_own_grids_and_times(folder: Path) -> None:
    """Without a spacing nothing lies between the points of a product and the elements."""
    (folder / "files.yaml").write_text(OWN)
    for time in (0.0, 7 * 3600.0):
        model = sampled(folder / "files.yaml", time)
        e, records = model.elements, (13 + time / 3600.0) / 12
        np.testing.assert_allclose(e.uo, 0.1 + 0.01 * (e.lon + 39.0) + 0.05 * records, atol=2e-6)
        np.testing.assert_allclose(e.vo, 0.02 * (e.lat + 55.0), atol=2e-6)
        np.testing.assert_allclose(e.ua, 5.0, rtol=1e-6)
        np.testing.assert_allclose(e.slope_y, 0.1 / (np.pi / 180.0 * model.parameters.earth.radius), rtol=1e-4)
        np.testing.assert_allclose(e.slope_x, 0.0, atol=1e-10)
        # The sea level counts for the depth of water.
        np.testing.assert_allclose(e.depth, 300.0 + 10 * (e.lon + 39.0) + 0.1 * (e.lat + 55.0), atol=1e-3)
        np.testing.assert_allclose(e.vorticity, 0.0, atol=1e-6)
    # Currents and sea level have the same points and records: their cells are found once.
    assert model.forcing.describe().count("gridded fields from") == 3
    _run(folder / "files.yaml")


def test_times_are_those_of_the_product_not_of_an_interval(folder: Path) -> None:
    """A wind that comes and goes between two records of a six-hourly grid was lost."""
    time = np.datetime64("2020-12-09T12", "ns") + np.arange(16) * np.timedelta64(1, "h")
    gust = np.where(np.arange(16) == 4, 20.0, 0.0)  # at 16:00, three hours after the start
    with xr.open_dataset(folder / "wind.nc") as ds:
        wind = ds.isel(time=0, drop=True).load()
    wind = (
        wind.expand_dims(time=("time", time)[1])
        .assign_coords(time=("time", time, {"standard_name": "time"}))
        .copy(deep=True)
    )
    wind["u10"] = (wind["u10"].dims, gust[:, None, None] + 0.0 * wind["u10"].values, wind["u10"].attrs)
    (folder / "wind.nc").unlink()
    wind.to_netcdf(folder / "wind.nc")
    (folder / "files.yaml").write_text(OWN)
    np.testing.assert_allclose(sampled(folder / "files.yaml", 3 * 3600.0).elements.ua, 20.0, rtol=1e-6)
    np.testing.assert_allclose(sampled(folder / "files.yaml", 3 * 3600.0, grid=0.25).elements.ua, 0.0, atol=1e-6)


def test_a_grid_can_be_asked_for_on_the_command_line(folder: Path) -> None:
    (folder / "files.yaml").write_text(OWN)
    own, grid = (sampled(folder / "files.yaml", 0.0, grid=spacing) for spacing in (None, 0.5))
    assert own.forcing.grid is None
    assert grid.forcing.grid is not None
    assert "8 x 6 cells" in grid.forcing.describe()
    np.testing.assert_allclose(own.elements.uo, grid.elements.uo, atol=1e-6)
    with pytest.raises(InputError, match="a68a has its own ocean"):
        build("a68a", Options(grid=0.5))


def test_of_two_products_the_later_one_counts(folder: Path) -> None:
    with xr.open_dataset(folder / "currents.nc") as ds:
        slow = ds.load().isel(lon=slice(1, None))  # another grid
    slow["u"] = slow["u"] * 0.0
    slow.to_netcdf(folder / "slow.nc")
    for order, factor in (("currents.nc, slow.nc", 0.0), ("slow.nc, currents.nc", 1.0)):
        (folder / "files.yaml").write_text(OWN.replace("currents.nc", order))
        e = sampled(folder / "files.yaml", 0.0).elements
        np.testing.assert_allclose(e.uo, factor * (0.1 + 0.01 * (e.lon + 39.0) + 0.05 * 13 / 12), atol=2e-6)


def test_of_two_files_of_the_sea_floor_the_later_one_counts(folder: Path) -> None:
    """They were refused, while two files of anything else were not."""
    with xr.open_dataset(folder / "floor.nc") as ds:
        deeper = ds.load()
    deeper["depth"] = deeper["depth"] + 1000.0
    deeper["depth"].attrs = {"units": "m", "standard_name": "sea_floor_depth_below_geoid"}
    deeper.to_netcdf(folder / "deeper.nc")
    for order, more in (("floor.nc, deeper.nc", 1000.0), ("deeper.nc, floor.nc", 0.0)):
        for text in (OWN, EXPERIMENT):
            (folder / "files.yaml").write_text(text.replace("floor.nc", order))
            e = sampled(folder / "files.yaml", 0.0).elements
            assert np.all(np.abs(e.depth - 300.0 - more - 10 * (e.lon + 39.0)) < 3.0)


@pytest.mark.quick(1)
@pytest.mark.parametrize("own_grid", [True, False])
def test_a_wind_stress_counts_where_there_is_no_wind_to_take(folder: Path, own_grid: bool) -> None:
    """Of both the wind drives the berg, and the run says so; alone the stress does; ``wind: none`` takes neither."""
    stress = [field(lambda x, y, t: 0.1, "taux", "N m-2", "surface_downward_eastward_stress", 4),
              field(lambda x, y, t: -0.05, "tauy", "N m-2", "surface_downward_northward_stress", 4)]  # fmt: skip
    xr.merge(stress).to_netcdf(folder / "stress.nc")
    text, path = OWN if own_grid else EXPERIMENT, folder / "files.yaml"

    def wind(files: str, more: str = "") -> tuple[float, float, list[str]]:
        path.write_text(text.replace("wind.nc", files) + more)
        e = sampled(path, 0.0).elements
        return float(e.ua.mean()), float(e.va.mean()), [n for n in build(str(path))[1].notices if "wind stress" in n]

    for files in ("wind.nc, stress.nc", "stress.nc, wind.nc"):
        east, north, said = wind(files)
        assert (east, north) == pytest.approx((5.0, -2.0), rel=1e-6)
        assert len(said) == 1
    east, north, said = wind("stress.nc")
    assert east > 1.0
    assert north == pytest.approx(-0.5 * east, rel=1e-6)
    assert not said
    assert wind("wind.nc, stress.nc", "  wind: none\n")[:2] == (0.0, 0.0)
    assert wind("stress.nc", "  wind: none\n")[:2] == (0.0, 0.0)


def test_levels_act_over_the_draft_on_the_products_own_grid(folder: Path) -> None:
    with_levels(folder)
    (folder / "files.yaml").write_text(OWN)
    model = sampled(folder / "files.yaml", 0.0)
    np.testing.assert_allclose(model.elements.uo, mean_to(200.0 * model.parameters.ice.density / 1025.0), rtol=1e-6)


def test_an_interval_of_a_model_grid_without_the_grid_is_refused(folder: Path) -> None:
    path = folder / "files.yaml"
    path.write_text(OWN.replace("  latitude:", "  every_hours: 3\n  latitude:"))
    with pytest.raises(ForcingError, match=r"forcing.every_hours: an interval without a model grid. Give spacing too"):
        build(str(path))
    build(str(path), Options(grid=0.25))  # --grid is that grid


def test_a_berg_that_leaves_the_data_is_told_where(folder: Path) -> None:
    (folder / "files.yaml").write_text(OWN.replace("[-39.0, -55.5]", "[-44.5, -55.5]"))
    with pytest.raises(ForcingError, match=r"element \d+ at \(-44\.\d+, -55\.\d+\) is outside of the data of uo"):
        _run(folder / "files.yaml")


def test_values_that_cannot_be_are_refused_before_the_first_step(folder: Path) -> None:
    """Named for 1e20 in a file that declares no missing value: the run died half a day on, "outside of the data"."""
    with xr.open_dataset(folder / "currents.nc") as file:
        wrong = file.load()
    wrong["u"][1, 5, 6] = 1e20
    wrong.to_netcdf(folder / "wrong.nc", encoding={"u": {"_FillValue": None}})
    path = folder / "wrong.yaml"
    path.write_text(EXPERIMENT.replace("currents.nc", "wrong.nc"))
    with pytest.raises(ForcingError, match=r"uo is .*e\+(19|20) m s-1 at .*56.* S, 40.* W.*not believable") as error:
        _run(path)
    assert "wrong.nc" in str(error.value)


def test_fields_without_dates_are_told_to_be_held(folder: Path) -> None:
    with xr.open_dataset(folder / "wind.nc") as file:
        file.isel(time=0, drop=True).to_netcdf(folder / "mean.nc")
    path = folder / "mean.yaml"
    path.write_text(EXPERIMENT.replace("wind.nc", "mean.nc"))
    _, info = build(str(path))
    assert [text for text in info.notices if "ua, va are held constant" in text and "mean.nc" in text]
    assert not build(str(folder / "files.yaml"))[1].notices  # the sea floor may well have no date


@pytest.mark.parametrize(
    ("spacing", "every_hours", "words"),
    [(1e-6, 6.0, "asks for .* cells of a model grid, about"), (0.25, 1e-9, "asks for .* dates on a model grid")],
)
def test_a_model_grid_too_large_is_refused_before_it_is_made(spacing: float, every_hours: float, words: str) -> None:
    """``every_hours: 1e-9`` made a list of a thousand million dates and took 21 GB of memory."""
    asked = FileForcing(
        kind="files",
        files=["none.nc"],
        longitude=(-41, -37),
        latitude=(-57, -54),
        spacing=spacing,
        every_hours=every_hours,
    )
    with pytest.raises(ForcingError, match=words):
        ModelGrid.of(asked, [], Run.of(datetime(2020, 12, 16), 1.0, np.array([200.0]), 850.0))


def test_a_box_that_is_not_given_reaches_as_far_as_the_fastest_current(folder: Path) -> None:
    """Files alone, in one line: the run is that of the box around all, and a notice says which box was taken."""
    head = EXPERIMENT.partition("forcing:")[0]
    files = "[currents.nc, sea_level.nc, wind.nc, floor.nc]"
    given, chosen = folder / "given.yaml", folder / "chosen.yaml"
    given.write_text(f"{head}forcing: {{kind: files, files: {files}, longitude: [-43, -35], latitude: [-59, -52]}}\n")
    chosen.write_text(f"{head}forcing: {files}\n")
    one, other = (build(str(path)) for path in (given, chosen))
    for model, info in (one, other):
        model.advance(info.days)
    np.testing.assert_array_equal(one[0].elements.lon, other[0].elements.lon)
    (notice,) = [text for text in other[1].notices if "files are read from" in text]
    # About 0.3 m/s to the east and 0.06 m/s to the north, half a day, and 50 km, around whole half degrees.
    assert "the fastest current there, 0.3 m/s, carries a berg in 12 h" in notice
    south, north, west, east = map(float, re.findall(r"([\d.]+) [SW]", notice))
    assert 56.4 < south < 56.7
    assert 54.3 < north < 54.6
    assert 40.4 < west < 40.9
    assert 37.1 < east < 37.6
    assert not any("files are read from" in text for text in one[1].notices)


def test_half_a_box_is_refused(folder: Path) -> None:
    path = folder / "files.yaml"
    path.write_text(EXPERIMENT.replace("  latitude: [-57, -54]\n", ""))
    with pytest.raises(InputError, match="give longitude and latitude, or none of them"):
        build(str(path))


def test_variables_of_any_name_are_named_for_a_run(folder: Path) -> None:
    """Each file takes the names that it holds; one with names of its own keeps them."""
    with xr.open_dataset(folder / "currents.nc") as ds:
        bare = ds.rename(u="a", v="b").load()
    for name in ("a", "b"):
        bare[name].attrs = {"units": "m s-1"}
    (folder / "currents.nc").unlink()
    bare.to_netcdf(folder / "currents.nc")
    with xr.open_dataset(folder / "sea_level.nc") as ds:
        level = ds.rename(zos="c").load()
    level["c"].attrs = {"units": "m"}
    (folder / "sea_level.nc").unlink()
    level.to_netcdf(folder / "sea_level.nc")
    path = folder / "files.yaml"
    path.write_text(EXPERIMENT.replace("sea_level.nc", "{file: sea_level.nc, names: {ssh: c}}"))
    with pytest.raises(ForcingError, match="--names uo=u,vo=v"):
        build(str(path))
    model, _ = build(str(path), Options(files=named_files(str(path), "uo=a,vo=b", None)))
    e = model.elements
    model.forcing.grid.locate(e)
    model.forcing.sample(e, 0.0)
    np.testing.assert_allclose(e.uo, 0.1 + 0.01 * (e.lon + 39.0) + 0.05 * 13 / 12, atol=2e-6)
    assert abs(e.slope_y).min() > 0.0
    result = CliRunner().invoke(
        app, ["run", str(path), "--names", "uo=a,vo=b", "-o", str(folder / "out"), "-q", "--no-map"]
    )
    assert result.exit_code == 0, result.output
    for words, names in (("no file has a variable 'aa'", "uo=aa,vo=b"), ("the forcing has no files", "uo=a")):
        experiment = str(path) if "aa" in names else "a68a"
        result = CliRunner().invoke(app, ["run", experiment, "--names", names, "-o", str(folder / "no"), "-q"])
        assert result.exit_code == 2
        assert words in result.output
