"""Forcing from data files, as a YAML experiment asks for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from riftberg.errors import ForcingError
from riftberg.experiments import build

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
