"""Errors of a current: as a product states them by place, and from the differences of two products."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from ocean.test_errors import probes
from riftberg import Forcing, build
from riftberg.cli.main import app
from riftberg.constants import DEGREE, EARTH_RADIUS_A68
from riftberg.ensembles.uncertain import estimate_errors, with_errors
from riftberg.errors import ForcingError, InputError
from riftberg.ocean.errors import Errors, FieldError, UncertainForcing
from riftberg.state import Floats

DAY = 86400.0


def product(path: Path, seed: int, speed: float = 0.1, days: int = 24, step: float = 0.25) -> Path:
    """Write a current with random errors of 40 km and 2 days on top of a flow that all products share."""
    lon, lat = np.arange(-42.0, -36.0 + step / 2, step), np.arange(-58.0, -54.0 + step / 2, step)
    x, y = np.meshgrid(lon, lat)
    berg = probes()
    forcing = UncertainForcing(
        Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0)), Errors(FieldError(speed, 40e3, 2 * DAY), seed=seed), berg
    )
    flow = [forcing.currents(x, y, k * DAY) for k in range(days)]
    data = {
        name: (("time", "lat", "lon"), np.array([f[k] for f in flow]),
               {"units": "m s-1", "standard_name": f"{way}ward_sea_water_velocity"})
        for k, (name, way) in enumerate((("uo", "east"), ("vo", "north")))
    }  # fmt: skip
    time = np.datetime64("2020-12-01", "ns") + np.arange(days) * np.timedelta64(1, "D")
    xr.Dataset(data, {"time": time, "lat": ("lat", lat, {"units": "degrees_north"}),
                      "lon": ("lon", lon, {"units": "degrees_east"})}).to_netcdf(path)  # fmt: skip
    return path


def test_size_length_and_time_come_back_from_the_differences(tmp_path: Path) -> None:
    one, other = product(tmp_path / "one.nc", 1), product(tmp_path / "other.nc", 2)
    found = estimate_errors(one, other)
    assert found.speed == pytest.approx(0.1, rel=0.1)
    assert found.length == pytest.approx(40e3, rel=0.1)
    assert found.time == pytest.approx(2 * DAY, rel=0.2)
    # A product of another grid and fewer days gives about the same.
    coarse = product(tmp_path / "coarse.nc", 3, days=20, step=1 / 3)
    again = estimate_errors(one, coarse)
    assert again.records == 20
    assert again.speed == pytest.approx(0.1, rel=0.15)
    assert again.length == pytest.approx(40e3, rel=0.2)
    done = CliRunner().invoke(app, ["product-errors", str(one), str(other), "--lat", "-57,-55"])
    assert done.exit_code == 0, done.output
    assert "--vary 'current_error.speed=0.1 m/s'" in done.output or "--vary 'current_error.speed=0.09" in done.output
    assert "A lower bound" in done.output


def test_products_that_do_not_differ_or_overlap_are_refused(tmp_path: Path) -> None:
    one = product(tmp_path / "one.nc", 1, days=3)
    with pytest.raises(InputError, match="the products do not differ"):
        estimate_errors(one, one)
    with pytest.raises(InputError, match="do not share four by four points"):
        estimate_errors(one, product(tmp_path / "other.nc", 2, days=3), longitude=(0.0, 10.0))


def constant(path: Path, lon: Floats, current: Floats) -> Path:
    """Write a current that depends on longitude alone, the same eastward and northward."""
    lat = np.arange(-60.0, -55.0, 0.25)
    data = {
        name: (("time", "lat", "lon"), np.broadcast_to(current, (3, lat.size, lon.size)),
               {"units": "m s-1", "standard_name": f"{way}ward_sea_water_velocity"})
        for name, way in (("uo", "east"), ("vo", "north"))
    }  # fmt: skip
    time = np.datetime64("2020-12-01", "ns") + np.arange(3) * np.timedelta64(1, "D")
    xr.Dataset(data, {"time": time, "lat": ("lat", lat, {"units": "degrees_north"}),
                      "lon": ("lon", lon, {"units": "degrees_east"})}).to_netcdf(path)  # fmt: skip
    return path


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    "wider", [np.arange(-180.0, 180.0, 0.25), np.arange(0.0, 360.0, 0.25), np.arange(-185.0, -175.0, 0.2)]
)
@pytest.mark.parametrize("box", [None, (176.0, 184.0), (-184.0, -176.0), (176.0, -176.0)])
def test_products_across_180_are_compared_on_both_sides(
    wider: Floats, box: tuple[float, float] | None, tmp_path: Path
) -> None:
    """Of a box from 175 to 185 E and a globe, the half beyond 180 was left out."""
    lon = np.arange(175.0, 185.0, 0.25)
    one = constant(tmp_path / "one.nc", lon, np.where(lon >= 180.0, 0.2, 0.0))
    other = constant(tmp_path / "other.nc", wider, 0.0 * wider)
    for pair in ((one, other), (other, one)):
        assert estimate_errors(*pair, longitude=box).speed == pytest.approx(0.1, rel=0.05)


def stated(path: Path, west: float, east: float, units: str = "m s-1") -> Path:
    """Write a product whose errors are these west and east of 37 W."""
    lon, lat = np.arange(-45.0, -29.0, 0.5), np.arange(-60.0, -52.0, 0.5)
    size = np.where(lon < -37.0, west, east) * np.ones((1, lat.size, 1))
    about = {"units": units}
    data = {name: (("time", "lat", "lon"), size, about) for name in ("uo_err", "vo_err")}
    data |= {name: (("time", "lat", "lon"), 0.0 * size, about) for name in ("uo", "vo")}
    coords = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    xr.Dataset(data, coords).to_netcdf(path)
    return path


def size_by_place(path: Path) -> Any:
    """Return the field of sizes that a run has whose current errs as a product states."""
    return with_errors(build("a68a")[0], {"current_error.field": str(path)}).forcing.errors.current_size


@pytest.mark.slow
def test_the_size_by_place_is_that_of_the_product(tmp_path: Path) -> None:
    field = size_by_place(stated(tmp_path / "it.nc", 5.0, 20.0, "cm s-1"))
    assert field.at(np.array([-42.0, -32.0]), np.array([-56.0, -56.0])) == pytest.approx([0.05, 0.2])
    metres = DEGREE * EARTH_RADIUS_A68 * np.cos(np.radians(56.0))
    elements = probes()
    got = []
    for seed in range(300):
        errors = Errors(FieldError(1.0, 30e3, 2 * DAY), seed=seed, current_size=field)
        forcing = UncertainForcing(Forcing.uniform(), errors, elements)
        places = -37.0 + np.array([-200e3, 200e3]) / metres, np.array([-56.0, -56.0])
        got.append(forcing.currents(*places, 0.0))
    spread = np.std(got, axis=(0, 1))
    assert spread == pytest.approx([0.05, 0.2], rel=0.15)
    assert "x it.nc" in forcing.describe()


def test_a_gap_has_the_size_of_the_nearest_places_that_are_known(tmp_path: Path) -> None:
    """It had the mean of the whole file, which may be of the globe: between errors of 0.05 m/s an error of 0.12."""
    ds = xr.open_dataset(stated(tmp_path / "it.nc", 0.05, 0.2)).load()
    gap = (abs(ds["lon"] + 42.0) < 0.8) & (abs(ds["lat"] + 56.0) < 0.8) | ((ds["lon"] > -31.0) & (ds["lat"] > -53.0))
    ds.assign({name: ds[name].where(~gap) for name in ("uo_err", "vo_err")}).to_netcdf(tmp_path / "gap.nc")
    field = size_by_place(tmp_path / "gap.nc")
    assert field.at(np.array([-42.0, -30.0]), np.array([-56.0, -52.5])) == pytest.approx([0.05, 0.2])


def test_a_gap_at_the_seam_of_a_globe_has_the_size_beyond_the_seam(tmp_path: Path) -> None:
    lon, lat = np.arange(0.0, 360.0, 2.0), np.arange(-70.0, -40.0, 2.0)
    size = np.where((lon < 180.0) & (lon > 20.0), 0.05, 0.2) * np.ones((lat.size, 1))
    size[:, :8] = np.nan
    data = {name: (("lat", "lon"), size, {"units": "m s-1"}) for name in ("uo_err", "vo_err")}
    coords = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    xr.Dataset(data, coords).to_netcdf(tmp_path / "globe.nc")
    field = size_by_place(tmp_path / "globe.nc")
    assert field.at(np.array([2.0, 100.0]), np.array([-56.0, -56.0])) == pytest.approx([0.2, 0.05])


@pytest.mark.parametrize(
    ("east", "north", "about"),
    [("err_ugosa", "err_vgosa", {}),
     ("eastward_eulerian_current_velocity_error", "northward_eulerian_current_velocity_error", {}),
     ("eu", "ev", {"standard_name": "ward_sea_water_velocity standard_error"})],
)  # fmt: skip
def test_names_of_errors_are_known(east: str, north: str, about: dict[str, str], tmp_path: Path) -> None:
    ds = xr.open_dataset(stated(tmp_path / "it.nc", 0.1, 0.1)).load().rename(uo_err=east, vo_err=north)
    for name, way in ((east, "east"), (north, "north")):
        ds[name].attrs |= {key: way + value for key, value in about.items()}
    ds.to_netcdf(tmp_path / "other.nc")
    assert size_by_place(tmp_path / "other.nc").size == pytest.approx(0.1)


def test_a_product_without_errors_is_refused_before_the_first_member(tmp_path: Path) -> None:
    path = product(tmp_path / "one.nc", 1, days=2)
    with pytest.raises(ForcingError, match=r"one\.nc: states no error of its current"):
        with_errors(build("a68a")[0], {"current_error.field": str(path)})
    model = with_errors(build("a68a")[0], {"current_error.field": str(stated(tmp_path / "it.nc", 0.1, 0.1))})
    assert model.forcing.errors.current_size.size == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("sample", "current", "errors"),
    [("nrt_global_allsat_phy_l4_20190223_20190226.nc", "ugos", ("err_ugosa", "err_vgosa")),
     ("20030101000000-GLOBCURRENT-L4-CUReul_hs-ALT_SUM-v02.0-fv01.0.nc", "eastward_eulerian_current_velocity",
      ("eastward_eulerian_current_velocity_error", "northward_eulerian_current_velocity_error"))],
    ids=["DUACS", "GlobCurrent"],
)  # fmt: skip
def test_errors_in_the_files_of_real_products(
    sample: str, current: str, errors: tuple[str, str], shared: Path, tmp_path: Path
) -> None:
    """Real files with the error variables that their full versions have, packed and masked as their currents are.

    Cut to a box whose western half errs by 0.05 m/s and whose eastern half by 0.2 m/s; DUACS counts longitudes to 360.
    """
    file = tmp_path / sample
    with xr.open_dataset(shared / "data" / "samples" / sample, mask_and_scale=False, decode_times=False) as ds:
        lon, lat = (next(name for name in ds[current].dims if str(name).startswith(axis)) for axis in ("lon", "lat"))
        # 320 E is 40 W; the other file has a box of its own.
        box = {lon: slice(318.0, 324.0), lat: slice(-59.0, -53.0)} if sample.startswith("nrt") else {}
        ds = ds.sel(box).load()
    middle = float(ds[lon].mean())
    scale = ds[current].attrs.get("scale_factor", 1.0)
    size = (np.where(ds[lon] < middle, 0.05, 0.2) / scale * xr.ones_like(ds[current], float)).round(6)
    missing = ds[current] == ds[current].attrs["_FillValue"] if scale != 1.0 else ds[current].isnull()
    for name in errors:
        packed = size.where(~missing, ds[current].attrs["_FillValue"]).astype(ds[current].dtype)
        ds[name] = packed.assign_attrs(ds[current].attrs)
        ds[name].attrs.pop("standard_name", None)
    ds.to_netcdf(file)
    field = size_by_place(file)
    west, east = (0.75 * middle + 0.25 * float(ds[lon][k]) for k in (0, -1))
    at = np.array([west, east]), np.full(2, float(ds[lat].mean()))
    assert field.at(*at) == pytest.approx([0.05, 0.2], rel=1e-3)
    assert field.at(at[0] - 360.0, at[1]) == pytest.approx([0.05, 0.2], rel=1e-3)
    model = with_errors(build("a68a")[0], {"current_error.field": str(file)})
    assert sample in model.forcing.describe()
