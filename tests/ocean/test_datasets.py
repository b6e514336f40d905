"""Datasets as forcing: each on its own points, against interpolations by xarray and scipy; seams, land, time, threads."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime

import numpy as np
import pytest
import xarray as xr

from riftberg import DatasetForcing, Iceberg, Model
from riftberg.errors import ForcingError
from riftberg.ocean.product_part import product_part
from riftberg.state import Elements, Floats, new_elements

START = datetime(2020, 12, 9, 13)
HOURS = np.datetime64("2020-12-09T00", "ns") + 6 * np.arange(12) * np.timedelta64(1, "h")


def at(lon: Sequence[float] | Floats, lat: Sequence[float] | Floats, thickness: float = 200.0) -> Elements:
    """Return elements at positions."""
    e = new_elements(len(lon))
    e.place.lon[:], e.place.lat[:], e.body.thickness[:] = lon, lat, thickness
    return e


def forcing_of(*datasets: xr.Dataset) -> DatasetForcing:
    return DatasetForcing([product_part(ds, START) for ds in datasets])


def waves(x: Floats, y: Floats, hours: Floats) -> Floats:
    """A smooth field (time, y, x) of positions in degrees."""
    moving = np.cos(hours / 9.0)[:, None, None]
    return moving * np.sin(np.deg2rad(7.0 * x + 5.0 * y)) + 0.2 * np.cos(np.deg2rad(9.0 * y)) + 0.0 * x


def on_axes(lon: Floats, lat: Floats, times: np.ndarray = HOURS) -> xr.Dataset:
    """A canonical dataset of currents, sea level and wind on axes."""
    hours = (times - HOURS[0]) / np.timedelta64(1, "h")
    x, y = np.meshgrid(lon, lat)
    coords = {"time": times, "lat": lat, "lon": lon}
    names = ("uo", "vo", "ssh", "ua", "va")
    fields = {n: (("time", "lat", "lon"), (k + 1.0) * waves(x + 3.0 * k, y, hours)) for k, n in enumerate(names)}
    return xr.Dataset(fields, coords=coords, attrs={"product": "waves", "interval_seconds": 21600.0})


def scattered(west: float, east: float, south: float, north: float, count: int = 60) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(7)
    return rng.uniform(west, east, count), rng.uniform(south, north, count)


def test_one_bilinear_in_space_and_one_linear_in_time_as_xarray_does() -> None:
    ds = on_axes(np.arange(-44.0, -30.0, 0.25), np.arange(-60.0, -50.0, 0.25))
    lon, lat = scattered(-43.0, -32.0, -59.0, -51.0)
    e, forcing = at(lon, lat), forcing_of(ds)
    points = {"lon": ("n", lon), "lat": ("n", lat)}
    for hours in (0.0, 2.25, 5.0, 30.7):
        forcing.sample(e, 3600.0 * hours)
        moment = np.datetime64(START, "ns") + np.timedelta64(round(3600 * hours), "s")
        expected = ds.interp(**points).interp(time=moment)
        for name in ("uo", "vo", "ua", "va"):
            np.testing.assert_allclose(getattr(e, name), expected[name], rtol=1e-12, atol=1e-14, err_msg=name)
    u, v = forcing.currents(lon, lat, 3600.0 * 30.7)  # and so do maps
    np.testing.assert_allclose(u, e.uo, rtol=1e-12)
    np.testing.assert_allclose(v, e.vo, rtol=1e-12)


@pytest.mark.parametrize(
    "lon",
    [
        np.arange(170.0, 190.1, 0.5),  # a region across the date line
        np.arange(-180.0, 180.0, 0.5),  # round the globe, first meridian not repeated
        np.arange(0.0, 360.0, 0.5),
        np.arange(-180.0, 180.1, 0.5),  # first meridian repeated at the end
    ],
)
def test_the_seam_is_a_place_like_any_other(lon: Floats) -> None:
    """Values, slopes and curls on both sides of 180 E are those of a field that knows no seam."""
    lat = np.arange(-70.0, -60.0, 0.5)
    x, y = np.meshgrid(lon, lat)
    fields = {
        name: (("lat", "lon"), np.cos(np.deg2rad(3.0 * x + 20.0 * k + y))) for k, name in enumerate(("uo", "vo", "ssh"))
    }
    ds = xr.Dataset(fields, coords={"lat": lat, "lon": lon})
    # The same field on an axis that holds the whole neighbourhood on one branch.
    wide = np.arange(165.0, 195.0, 0.5)
    x, y = np.meshgrid(wide, lat)
    fields = {
        name: (("lat", "lon"), np.cos(np.deg2rad(3.0 * x + 20.0 * k + y))) for k, name in enumerate(("uo", "vo", "ssh"))
    }
    plain = forcing_of(xr.Dataset(fields, coords={"lat": lat, "lon": wide}))
    places = 180.0 + np.array([-3.1, -0.5, -0.3, -0.1, -1e-9, 0.0, 1e-9, 0.2, 0.4, 0.5, 0.7, 4.2])
    names = ("uo", "vo", "slope_x", "slope_y", "vorticity")
    told = at(places, np.full(places.size, -64.8))
    plain.sample(told, 0.0)
    for branch in (-360.0, 0.0, 360.0):
        e = at(places + branch, np.full(places.size, -64.8))
        forcing_of(ds).sample(e, 0.0)
        for name in names:
            np.testing.assert_allclose(getattr(e, name), getattr(told, name), rtol=1e-6, atol=1e-16, err_msg=name)


def rotated(lon: Floats, lat: Floats, pole: tuple[float, float], *, back: bool = False) -> tuple[Floats, Floats]:
    """Turn positions (degrees) to those seen from a rotated pole, or back."""
    a, b = np.deg2rad(pole[0]), np.deg2rad(90.0 - pole[1])
    turn = np.array([[np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), -np.sin(b)], [-np.sin(a), np.cos(a), 0.0],
                     [np.sin(b) * np.cos(a), np.sin(b) * np.sin(a), np.cos(b)]])  # fmt: skip
    x, y = np.deg2rad(lon), np.deg2rad(lat)
    vector = np.stack([np.cos(y) * np.cos(x), np.cos(y) * np.sin(x), np.sin(y)])
    vector = np.tensordot(turn.T if back else turn, vector, axes=1)
    return np.rad2deg(np.arctan2(vector[1], vector[0])), np.rad2deg(np.arcsin(vector[2]))


@pytest.mark.parametrize("pole", [(160.0, 40.0), (-37.0, 30.0), (80.0, -20.0)])
def test_a_rotated_grid_is_interpolated_in_its_own_cells(pole: tuple[float, float]) -> None:
    """Against xarray's interpolation along the axes of the rotated grid, where it is a plain one."""
    middle = rotated(np.array([-38.0]), np.array([-56.0]), pole)
    rlon, rlat = middle[0] + np.arange(-6.0, 6.0, 0.2), middle[1] + np.arange(-5.0, 5.0, 0.2)
    lon, lat = rotated(*np.meshgrid(rlon, rlat), pole, back=True)
    fields = {
        name: (("y", "x"), waves(lon + 9.0 * k, lat, np.zeros(1))[0]) for k, name in enumerate(("uo", "vo", "ssh"))
    }
    ds = xr.Dataset(fields, coords={"lat": (("y", "x"), lat), "lon": (("y", "x"), lon), "x": rlon, "y": rlat})
    x, y = scattered(-40.0, -36.0, -57.2, -54.8)
    e = at(x, y)
    forcing_of(ds).sample(e, 0.0)
    own = rotated(x, y, pole)
    told = ds.interp(x=("n", (own[0] - middle[0] + 180.0) % 360.0 - 180.0 + middle[0]), y=("n", own[1]))
    for k, name in enumerate(("uo", "vo")):
        # Seen from the true poles its rectangles are nearly, not quite, rectangles.
        np.testing.assert_allclose(getattr(e, name), told[name], atol=5e-5)
        np.testing.assert_allclose(getattr(e, name), waves(x[None] + 9.0 * k, y[None], np.zeros(1))[0, 0], atol=5e-4)
    # Slopes are to the true east and north.
    metre, phase = np.deg2rad(1.0) * 6_363_827.0, np.deg2rad(7.0 * (x + 18.0) + 5.0 * y)
    east = 7.0 * np.deg2rad(1.0) * np.cos(phase) / (metre * np.cos(np.deg2rad(y)))
    north = (5.0 * np.cos(phase) - 1.8 * np.sin(np.deg2rad(9.0 * y))) * np.deg2rad(1.0) / metre
    np.testing.assert_allclose(e.slope_x, east, atol=3e-3 * np.abs(east).max())
    np.testing.assert_allclose(e.slope_y, north, atol=3e-3 * np.abs(north).max())


def test_a_projected_grid_is_interpolated_in_its_projection() -> None:
    pyproj = pytest.importorskip("pyproj")
    crs = pyproj.CRS.from_epsg(3031)
    x, y = np.arange(-2.9e6, -1.0e6, 25e3), np.arange(1.0e6, 2.9e6, 25e3)
    to = pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
    grid_lon, grid_lat = to.transform(*np.meshgrid(x, y), direction="INVERSE")
    fields = {
        name: (("y", "x"), waves(grid_lon + k, grid_lat, np.zeros(1))[0]) for k, name in enumerate(("uo", "vo", "ssh"))
    }
    ds = xr.Dataset(fields, coords={"x": x, "y": y}, attrs={"crs_wkt": crs.to_wkt()})
    lon, lat = scattered(-50.0, -40.0, -66.0, -62.0)
    e = at(lon, lat)
    forcing_of(ds).sample(e, 0.0)
    there = to.transform(lon, lat)
    told = ds.interp(x=("n", there[0]), y=("n", there[1]))
    np.testing.assert_allclose(e.uo, told["uo"], rtol=1e-10)
    np.testing.assert_allclose(e.vo, told["vo"], rtol=1e-10)
    phase = np.deg2rad(7.0 * (lon + 2.0) + 5.0 * lat)
    east = 7.0 * np.cos(phase) / (6_363_827.0 * np.cos(np.deg2rad(lat)))
    np.testing.assert_allclose(e.slope_x, east, atol=1e-2 * np.abs(east).max())


def test_scattered_points_serve_what_is_nearest_to_them() -> None:
    rng = np.random.default_rng(2)
    lon, lat = rng.uniform(-42.0, -34.0, 4000), rng.uniform(-60.0, -54.0, 4000)
    level = 0.2 + 0.01 * (lon + 38.0) - 0.03 * (lat + 57.0)
    coords = {"lon": ("node", lon), "lat": ("node", lat)}
    ds = xr.Dataset({n: ("node", k + level) for k, n in enumerate(("uo", "vo", "ssh"))}, coords=coords)
    x, y = scattered(-41.0, -35.0, -59.0, -55.0)
    e = at(x, y)
    forcing_of(ds).sample(e, 0.0)
    apart = ((lon - x[:, None]) * np.cos(np.deg2rad(y))[:, None]) ** 2 + (lat - y[:, None]) ** 2
    np.testing.assert_array_equal(e.uo, level[apart.argmin(axis=1)])
    metre = np.deg2rad(1.0) * 6_363_827.0
    np.testing.assert_allclose(e.slope_x, 0.01 / (metre * np.cos(np.deg2rad(y))), rtol=1e-9)
    np.testing.assert_allclose(e.slope_y, -0.03 / metre, rtol=1e-9)
    np.testing.assert_allclose(e.vorticity, 0.01 / (metre * np.cos(np.deg2rad(y))) + 0.03 / metre, rtol=1e-9)
    with pytest.raises(ForcingError, match="outside of the data"):
        forcing_of(ds).check(at([-30.0], [-57.0]), 0.0, 1.0)


def test_positions_that_are_missing_on_land_are_no_places() -> None:
    """Models leave out positions where they do not compute; the points around are found all the same."""
    x, y = np.meshgrid(np.arange(-42.0, -34.0, 0.5), np.arange(-60.0, -54.0, 0.5))
    field = 0.1 * (x + 38.0)
    lon, lat = x.copy(), y.copy()
    lon[4:8, 4:8], lat[4:8, 4:8] = np.nan, np.nan
    coords = {"lat": (("y", "x"), lat), "lon": (("y", "x"), lon)}
    forcing = forcing_of(xr.Dataset({n: (("y", "x"), field) for n in ("uo", "vo")}, coords=coords))
    e = at([-41.8, -36.2], [-59.2, -55.3])
    forcing.sample(e, 0.0)
    np.testing.assert_allclose(e.uo, 0.1 * (e.lon + 38.0), atol=1e-12)
    with pytest.raises(ForcingError, match=r"element 1 at \(-39.1, -57.1\) is outside of the data of uo"):
        forcing.check(at([-39.1], [-57.1]), 0.0, 1.0)


def test_a_berg_on_land_is_refused_before_the_first_step() -> None:
    ds = on_axes(np.arange(-44.0, -30.0, 0.25), np.arange(-60.0, -50.0, 0.25))
    land = ds.where((ds["lon"] < -40.0) | (ds["lat"] < -56.0))
    with pytest.raises(ForcingError, match=r"element 2 at \(-35, -53\) is on land: no uo is known there"):
        forcing_of(land).check(at([-42.0, -35.0], [-53.0, -53.0]), 0.0, 3600.0)
    floor = ds[["ssh"]].isel(time=0, drop=True).rename(ssh="depth_below_surface") * 0.0 - 5.0
    with pytest.raises(ForcingError, match="is on land: no depth_below_surface"):
        forcing_of(ds, floor).check(at([-42.0], [-53.0]), 0.0, 3600.0)


def test_the_sea_level_counts_for_the_depth_and_land_has_none() -> None:
    ds = on_axes(np.arange(-44.0, -30.0, 0.25), np.arange(-60.0, -50.0, 0.25))
    lon, lat = np.arange(-45.0, -29.0, 0.4), np.arange(-61.0, -49.0, 0.4)
    floor = xr.DataArray(np.full((lat.size, lon.size), 300.0), {"lat": lat, "lon": lon}, ("lat", "lon"))
    floor = floor.where(floor["lon"] < -36.0).to_dataset(name="depth_below_surface")
    x, y = scattered(-43.0, -37.0, -59.0, -51.0)
    e = at(x, y)
    forcing_of(ds, floor).sample(e, 0.0)
    level = ds["ssh"].interp(lon=("n", x), lat=("n", y)).interp(time=np.datetime64(START, "ns"))
    np.testing.assert_allclose(e.depth, 300.0 + level, rtol=1e-12)
    forcing_of(floor).sample(on_land := at([-34.0], [-55.0]), 0.0)
    assert on_land.depth[0] == 0.0
    assert np.isnan(forcing_of(floor).depth(np.array([-34.0]), np.array([-55.0]))[0])


def test_ends_are_held_and_gaps_are_refused_wherever_they_are_met() -> None:
    daily = HOURS[0] + np.array([0, 1, 2, 6]) * np.timedelta64(1, "D")
    ds = on_axes(np.arange(-44.0, -30.0, 0.5), np.arange(-60.0, -50.0, 0.5), daily)
    ds = ds.assign_attrs(interval_seconds=86400.0, averaging_seconds=86400.0)
    forcing, e = forcing_of(ds), at([-40.0], [-55.0])
    forcing.sample(e, -20 * 3600.0)  # 17:00 of the day before: less than half a day before the first mean
    assert e.uo[0] == ds["uo"].interp(lon=-40.0, lat=-55.0)[0]
    with pytest.raises(ForcingError, match=r"2020-12-08T10:00 lies outside the records 2020-12-09T00:00"):
        forcing.sample(e, -27 * 3600.0)
    with pytest.raises(ForcingError, match=r"lies in a gap of 4 days between 2020-12-11T00:00 and 2020-12-15T00:00"):
        forcing.sample(e, 3 * 86400.0)
    with pytest.raises(ForcingError, match=r"gap of 4 days"):
        forcing.check(e, 0.0, 5 * 86400.0)
    forcing.sample(e, 5.458333333333333 * 86400.0)  # at the last record


def test_two_models_share_a_forcing_in_two_threads() -> None:
    """Each goes bit for bit as alone, though both ask for records of different days at the same time."""
    ds = on_axes(np.arange(-44.0, -30.0, 0.25), np.arange(-60.0, -50.0, 0.25))
    ds["uo"], ds["vo"] = 0.3 * ds["uo"], 0.3 * ds["vo"]
    ds["ssh"] = 0.01 * ds["ssh"]

    def ran(case: tuple[DatasetForcing, int]) -> Elements:
        forcing, number = case
        berg = Iceberg.rectangle(24e3, 9e3, thickness=200.0, placement=(-39.0 + number, -55.5))
        model = Model(berg, forcing)
        model.time = number * 86400.0
        for _ in range(20):
            model.step()
        return model.elements

    alone = [ran((forcing_of(ds), number)) for number in (0, 1)]
    shared = forcing_of(ds)
    shared.parts[0].records._length = 1  # records come and go all the time
    with ThreadPoolExecutor(2) as pool:
        together = list(pool.map(ran, [(shared, 0), (shared, 1)]))
    for one, other in zip(alone, together, strict=True):
        for name, values in one.arrays().items():
            np.testing.assert_array_equal(values, other.arrays()[name], err_msg=name)


def test_a_field_with_a_dimension_of_unknown_meaning_is_refused() -> None:
    ds = on_axes(np.arange(-44.0, -30.0, 0.5), np.arange(-60.0, -50.0, 0.5))
    with pytest.raises(ForcingError, match=r"uo has the dimensions \(member, time, lat, lon\)"):
        forcing_of(ds.expand_dims(member=3))


def test_datasets_of_ones_own_serve_as_they_are() -> None:
    """Units and names by CF: cm/s, a descending axis of 0..360 degrees, and a floor without time."""
    ds = on_axes(np.arange(316.0, 330.0, 0.25), np.arange(-60.0, -50.0, 0.25))[["uo", "vo"]]
    own = (100.0 * ds).rename(uo="east", vo="north", lat="Y", lon="X").isel(Y=slice(None, None, -1))
    for name, way in (("east", "eastward"), ("north", "northward")):
        own[name].attrs = {"units": "cm s-1", "standard_name": f"{way}_sea_water_velocity"}
    own["X"].attrs, own["Y"].attrs = {"units": "degrees_east"}, {"units": "degrees_north"}
    floor = xr.full_like(own["east"].isel(time=0, drop=True), 0.3).rename("floor")
    floor.attrs = {"units": "km", "standard_name": "sea_floor_depth_below_geoid"}
    lon, lat = scattered(-43.0, -32.0, -59.0, -51.0)
    e = at(lon, lat)
    forcing = DatasetForcing.from_xarray([own, floor.to_dataset()], START)
    forcing.check(e, 0.0, 86400.0)
    forcing.sample(e, 9000.0)
    told = ds.interp(lon=("n", lon + 360.0), lat=("n", lat)).interp(time=np.datetime64("2020-12-09T15:30", "ns"))
    np.testing.assert_allclose(e.uo, told["uo"], rtol=1e-10)
    np.testing.assert_allclose(e.vo, told["vo"], rtol=1e-10)
    np.testing.assert_allclose(e.depth, 300.0)
    with pytest.raises(ForcingError, match="uo comes from two products"):
        DatasetForcing.from_xarray([own, own.isel(X=slice(1, None))], START)
