"""Any layout of a file: what was asked for and found reaches the berg with its right value, or the run is refused.

The forcing is made through the door of `riftberg run FILE.yaml` (`forcing_from_files`) and sampled at elements. Fields
are linear in longitude and latitude, so that what they must be at any point is known without interpolation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from products.probe import at_points
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.state import Elements, new_elements

START = datetime(2020, 12, 16, 6)
EAST = {"uo": "eastward_sea_water_velocity", "ua": "eastward_wind"}
NORTH = {"uo": "northward_sea_water_velocity", "ua": "northward_wind"}
ALONG = {"uo": ("sea_water_x_velocity", "sea_water_y_velocity"), "ua": ("x_wind", "y_wind")}


@dataclass(frozen=True)
class Layout:
    """How a file is written."""

    kind: str = "uo"
    names: tuple[str, str] = ("lat", "lon")
    positions: str = "axes"  # axes, 1d, 2d, named (latitude(lat)), none
    order: tuple[int, ...] = (0, 1, 2)
    descending: bool = False
    branch: str = "west"  # west (-180..180), east (0..360), jump
    centre: float = -39.0
    packed: str = ""  # int16, missing
    level: str = ""  # name:length:value:units
    time: str = "dim"  # dim, scalar NAME, none, bare, year
    member: str = ""  # scalar, one, three
    turned: float = 0.0  # degrees by which a 2-D grid is turned
    along: bool = False

    @property
    def refused(self) -> str:
        """Words of the refusal; empty if the values must arrive."""
        if self.positions == "none":
            return "no positions"
        if self.member == "three":
            return "member"
        if self.time == "bare":
            return "no variable with dates"
        if self.time == "year":
            return "gap of 366 days"
        if self.level:
            _, _, value, units = self.level.split(":")
            if not value:
                return "no coordinate that says where"
            metres = units == "m"
            if self.kind == "ua" and not (metres and float(value) == 10.0):
                return "not that at 10 m"
            if self.kind == "uo" and not (metres and float(value) <= 30.0):
                return "nothing is known|nothing says that this is the surface"
        return ""


def truth(kind: str, lon: Any, lat: Any, centre: float) -> tuple[Any, Any]:
    """Return the components (m s-1) at positions (degrees)."""
    x = (np.asarray(lon) - centre + 180.0) % 360.0 - 180.0
    y = np.asarray(lat) + 55.5
    scale = 10.0 if kind == "ua" else 1.0
    return scale * (0.3 + 0.05 * x + 0.02 * y), scale * (-0.2 + 0.03 * x - 0.04 * y)


def written(folder: Path, layout: Layout) -> Path:
    """Write a file of a layout."""
    ds = _positions(layout)
    east, north = truth(layout.kind, ds["_lon"].values, ds["_lat"].values, layout.centre)
    if layout.along:
        angle = np.deg2rad(layout.turned)
        east, north = east * np.cos(angle) + north * np.sin(angle), -east * np.sin(angle) + north * np.cos(angle)
    names = ALONG[layout.kind] if layout.along else (EAST[layout.kind], NORTH[layout.kind])
    dims = ds["_lon"].dims
    for name, values, told in zip("ab", (east, north), names, strict=True):
        ds[name] = (dims, values.astype(np.float32), {"units": "m s-1", "standard_name": told})
    ds = _levelled(_membered(_timed(ds.drop_vars(["_lat", "_lon"]), layout), layout), layout)
    lead = [dim for dim in ds["a"].dims if dim not in dims]
    order = (*lead, *dims)
    if sorted(layout.order) == list(range(3)) and len(order) >= 3:
        order = (*order[:-3], *(order[-3:][k] for k in layout.order))
    ds = ds.transpose(*order)
    encoding: dict[str, Any] = {}
    if layout.packed:
        values = ds["a"].values.copy()
        values.flat[0] = np.nan  # one value is missing, far from the berg
        ds["a"] = ds["a"].copy(data=values)
        key = "_FillValue" if layout.packed == "int16" else "missing_value"
        encoding = {
            n: {"dtype": "int16", "scale_factor": 0.001, "add_offset": 0.5, key: np.int16(-32767)} for n in "ab"
        }
    path = folder / "field.nc"
    ds.to_netcdf(path, encoding=encoding)
    return path


def _positions(layout: Layout) -> xr.Dataset:
    lat_dim, lon_dim = layout.names
    lon = layout.centre + np.linspace(-4.0, 4.0, 17)
    lat = -55.5 + np.linspace(-3.0, 3.0, 13)
    lat = lat[::-1] if layout.descending else lat
    rows, columns = np.meshgrid(lat, lon, indexing="ij")
    if layout.positions == "2d" and layout.turned:
        turn = np.deg2rad(layout.turned)
        x, y = (columns - layout.centre) * np.cos(np.deg2rad(-55.5)), rows + 55.5
        rows = y * np.cos(turn) + x * np.sin(turn) - 55.5
        columns = layout.centre + (x * np.cos(turn) - y * np.sin(turn)) / np.cos(np.deg2rad(rows))
    branch = {"west": lambda q: (q + 180.0) % 360.0 - 180.0, "east": lambda q: q % 360.0}
    onto = branch.get(layout.branch, branch["west"])
    ds = xr.Dataset({"_lat": ((lat_dim, lon_dim), rows), "_lon": ((lat_dim, lon_dim), onto(columns))})
    north, east = {"units": "degrees_north"}, {"units": "degrees_east"}
    if layout.positions == "axes":
        return ds.assign_coords({lat_dim: (lat_dim, lat, north), lon_dim: (lon_dim, onto(lon), east)})
    if layout.positions == "1d":
        return ds.assign_coords(theta=(lat_dim, lat, north), phi=(lon_dim, onto(lon), east))
    if layout.positions == "named":
        return ds.assign_coords(latitude=(lat_dim, lat), longitude=(lon_dim, onto(lon)))
    if layout.positions == "2d":
        return ds.assign_coords(gphi=((lat_dim, lon_dim), rows, north), glam=((lat_dim, lon_dim), onto(columns), east))
    return ds


def _timed(ds: xr.Dataset, layout: Layout) -> xr.Dataset:
    if layout.time == "none":
        return ds
    day = np.datetime64("2020-12-16", "ns")
    if layout.time.startswith("scalar"):
        ds = ds.expand_dims(t_=1).isel(t_=0)
        return ds.assign_coords({layout.time.split()[1]: day + np.timedelta64(6, "h")})
    stamps = day + np.arange(4) * np.timedelta64(12, "h")
    if layout.time == "year":
        stamps = np.array([day - np.timedelta64(200, "D"), day + np.timedelta64(166, "D")])
    ds = xr.concat([ds] * len(stamps), dim="time")
    return ds if layout.time == "bare" else ds.assign_coords(time=stamps)


def _levelled(ds: xr.Dataset, layout: Layout) -> xr.Dataset:
    if not layout.level:
        return ds
    name, length, value, units = layout.level.split(":")
    attributes = {"units": units, "axis": "Z"} if units else {}
    if length == "scalar":
        return ds.assign_coords({name: ((), float(value), attributes)})
    ds = ds.expand_dims({name: int(length)}, axis=1 if "time" in ds.dims else 0).copy()
    return ds.assign_coords({name: (name, float(value) + np.arange(int(length)), attributes)}) if value else ds


def _membered(ds: xr.Dataset, layout: Layout) -> xr.Dataset:
    if layout.member == "scalar":
        return ds.assign_coords(realization=((), 3, {"standard_name": "realization"}))
    count = {"one": 1, "three": 3}.get(layout.member, 0)
    return ds.expand_dims(member=np.arange(count) + 1, axis=0).copy() if count else ds


def elements(centre: float) -> Elements:
    """Return some elements around the middle of the field."""
    x, y = (q.ravel() for q in np.meshgrid(np.linspace(-0.5, 0.5, 3), np.linspace(-0.5, 0.5, 3)))
    found = new_elements(x.size)
    found.lon[:], found.lat[:], found.thickness[:] = centre + x, -55.5 + y, 200.0
    return found


def sampled(folder: Path, path: Path, layout: Layout) -> Elements:
    """Return elements with the forcing that a run from a file gives them."""
    files = [path.name]
    if layout.kind == "ua":
        calm = written(folder, Layout(centre=layout.centre)).rename(folder / "calm.nc")
        path = written(folder, layout)
        files = [calm.name, path.name]
    box = (layout.centre - 2.0, layout.centre + 2.0)
    asked = FileForcing(kind="files", files=files, longitude=box, latitude=(-57.5, -53.5), hold=24.0)
    e = elements(layout.centre)
    forcing = forcing_from_files(asked, folder, Run.of(START, 0.2, e.thickness, 850.0))
    forcing.check(e, 0.0, 17280.0)
    forcing.sample(e, 3600.0)
    return e


def reaches_or_is_refused(folder: Path, layout: Layout) -> None:
    """Check that a field arrives with the right value, or that the run is refused in the right words."""
    path = written(folder, layout)
    if layout.refused:
        with pytest.raises(ForcingError, match=f"(?s){layout.refused}"):
            sampled(folder, path, layout)
        return
    e = sampled(folder, path, layout)
    east, north = truth(layout.kind, e.lon, e.lat, layout.centre)
    got = (e.uo, e.vo) if layout.kind == "uo" else (e.ua, e.va)
    scale = 10.0 if layout.kind == "ua" else 1.0
    near = 2e-3 if layout.positions == "2d" and layout.turned else 1e-3 if layout.packed else 2e-5
    np.testing.assert_allclose(got[0], east, atol=near * scale)
    np.testing.assert_allclose(got[1], north, atol=near * scale)


PLAIN = Layout()
FAULTS = {
    "currents_on_a_single_depth": replace(PLAIN, level="depth:1:0.494:m"),
    "currents_at_a_scalar_depth": replace(PLAIN, level="depth:scalar:0.5:m"),
    "currents_at_500_m": replace(PLAIN, level="depth:1:500:m"),
    "currents_at_a_scalar_500_m": replace(PLAIN, level="lev:scalar:500:m"),
    "levels_that_begin_at_200_m": replace(PLAIN, level="depth:3:200:m"),
    "levels_without_coordinate": replace(PLAIN, level="depth:3::"),
    "one_level_without_coordinate": replace(PLAIN, level="depth:1::"),
    "rows_are_no_positions": replace(PLAIN, positions="none"),
    "rows_of_other_names_are_no_positions": replace(PLAIN, positions="none", names=("y", "x")),
    "latitude_of_lat": replace(PLAIN, positions="named"),
    "lat_of_y": replace(PLAIN, positions="1d", names=("y", "x")),
    "positions_of_any_name_in_2d": replace(PLAIN, positions="2d", names=("j", "i")),
    "wind_at_850_hpa": replace(PLAIN, kind="ua", level="level:1:850:hPa"),
    "wind_at_scalar_plev": replace(PLAIN, kind="ua", level="plev:scalar:85000:Pa"),
    "wind_at_100_m": replace(PLAIN, kind="ua", level="height:scalar:100:m"),
    "wind_at_10_m": replace(PLAIN, kind="ua", level="height:scalar:10:m"),
    "wind_on_one_height_of_10_m": replace(PLAIN, kind="ua", level="heightAboveGround:1:10:m"),
    "wind_on_a_sigma_level": replace(PLAIN, kind="ua", level="sigma:1:0.995:1"),
    "snapshots_a_year_apart": replace(PLAIN, time="year"),
    "time_dimension_without_variable": replace(PLAIN, time="bare"),
    "one_date_called_valid_time": replace(PLAIN, time="scalar valid_time"),
    "no_dates": replace(PLAIN, time="none"),
    "longitudes_that_jump": replace(PLAIN, centre=179.75),
    "longitudes_that_jump_at_greenwich": replace(PLAIN, centre=0.25, branch="east"),
    "three_members": replace(PLAIN, member="three"),
    "one_member": replace(PLAIN, member="one"),
    "components_along_plain_axes": replace(PLAIN, along=True),
}


@pytest.mark.quick(9)
@pytest.mark.parametrize("fault", FAULTS)
def test_field_reaches_the_berg_or_is_refused(fault: str, tmp_path: Path) -> None:
    reaches_or_is_refused(tmp_path, FAULTS[fault])


TURNED = {
    "positions_of_any_name_in_a_turned_grid": replace(PLAIN, positions="2d", names=("j", "i"), turned=30.0),
    "components_along_a_turned_grid": replace(PLAIN, positions="2d", names=("j", "i"), turned=25.0, along=True),
    "wind_along_a_turned_grid": replace(PLAIN, kind="ua", positions="2d", names=("j", "i"), turned=-40.0, along=True),
}


@pytest.mark.parametrize("layout", TURNED)
def test_vectors_on_turned_grids_point_east_and_north(layout: str, tmp_path: Path) -> None:
    """Components along the rows of a turned grid were taken as eastward."""
    told = TURNED[layout]
    e = elements(told.centre)
    lon, lat = e.lon.reshape(3, 3), e.lat.reshape(3, 3)
    found = at_points(open_product(written(tmp_path, told)).isel(time=[0]), lon, lat)
    for name, values in zip((told.kind, {"uo": "vo", "ua": "va"}[told.kind]), truth(told.kind, lon, lat, told.centre)):
        np.testing.assert_allclose(found[name][0], values, atol=0.02 if told.kind == "ua" else 2e-3)


@pytest.mark.parametrize("layout", TURNED)
def test_fields_on_turned_grids_reach_the_berg_of_a_run(layout: str, tmp_path: Path) -> None:
    reaches_or_is_refused(tmp_path, TURNED[layout])


LAYOUTS = st.builds(
    Layout,
    kind=st.sampled_from(["uo", "uo", "ua"]),
    names=st.sampled_from([("lat", "lon"), ("latitude", "longitude"), ("y", "x"), ("nj", "ni"), ("rows", "time_x")]),
    positions=st.sampled_from(["axes", "axes", "1d", "2d", "none"]),
    order=st.permutations(range(3)).map(tuple),
    descending=st.booleans(),
    branch=st.sampled_from(["west", "east"]),
    centre=st.sampled_from([-39.0, 179.75, 0.25, -179.75]),
    packed=st.sampled_from(["", "int16", "missing"]),
    level=st.sampled_from(
        ["", "", "depth:1:5:m", "depth:scalar:0:m", "height:1:10:m", "lev:1:850:hPa", "depth:1:700:m", "z:2::"]
    ),
    time=st.sampled_from(["dim", "dim", "none", "scalar date", "scalar valid_time", "bare", "year"]),
    member=st.sampled_from(["", "", "scalar", "one", "three"]),
)


@pytest.mark.slow
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(layout=LAYOUTS)
def test_any_combination_reaches_the_berg_or_is_refused(layout: Layout, tmp_path: Path) -> None:
    """The class of all faults at once: whatever is combined, a value is right or the run is refused in words."""
    if layout.refused:
        with pytest.raises(ForcingError, match=r"field\.nc|field|calm"):
            sampled(tmp_path, written(tmp_path, layout), layout)
    else:
        reaches_or_is_refused(tmp_path, layout)


def test_a_run_in_1950_is_refused_on_data_of_2020(tmp_path: Path) -> None:
    layout = replace(PLAIN, time="scalar valid_time")
    path = written(tmp_path, layout)
    asked = FileForcing(kind="files", files=[path.name], longitude=(-41, -37), latitude=(-57.5, -53.5))
    e = elements(-39.0)
    with pytest.raises(ForcingError, match="2020-12-16"):
        forcing_from_files(asked, tmp_path, Run.of(datetime(1950, 1, 1), 0.2, e.thickness, 850.0))


@pytest.mark.parametrize("style", ["gebco", "cf", "srtm15", "bare"])
def test_rows_of_a_bathymetry_are_no_positions(style: str, tmp_path: Path) -> None:
    name = {"gebco": "elevation", "srtm15": "z", "cf": "deptho", "bare": "elevation"}[style]
    told = {"units": "m"} if style != "bare" else {}
    field = xr.Dataset({name: (("lat", "lon"), np.full((6, 7), -100.0), told)})
    field.attrs = {"gebco": {"title": "The GEBCO_2020 Grid"}, "srtm15": {"GMT_version": "6"}}.get(style, {})
    field.to_netcdf(tmp_path / "floor.nc")
    with pytest.raises(ForcingError, match="Numbers of rows are no positions"):
        open_product(tmp_path / "floor.nc")


def test_counts_beside_a_grid_mapping_are_no_positions(tmp_path: Path) -> None:
    """A variable ``crs`` and index axes (axis X, Y) must not make degrees or metres of row numbers."""
    field = (
        ("y", "x"),
        np.zeros((6, 7)),
        {"units": "m", "standard_name": "sea_surface_height_above_geoid", "grid_mapping": "crs"},
    )
    axes = {"y": ("y", np.arange(6), {"axis": "Y"}), "x": ("x", np.arange(7), {"axis": "X"})}
    stereographic = {"grid_mapping_name": "polar_stereographic", "latitude_of_projection_origin": -90.0,
                     "straight_vertical_longitude_from_pole": 0.0, "standard_parallel": -70.0}  # fmt: skip
    for mapping in ({"grid_mapping_name": "latitude_longitude"}, stereographic):
        xr.Dataset({"zos": field, "crs": ((), 0, mapping)}, axes).to_netcdf(tmp_path / "level.nc")
        with pytest.raises(ForcingError, match="Numbers of rows are no positions"):
            open_product(tmp_path / "level.nc")


def test_currents_described_as_deep_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, PLAIN)
    with xr.open_dataset(path) as ds:
        ds = ds.load()
    ds["a"].attrs["long_name"] = "eastward velocity at 500 m"
    ds.to_netcdf(tmp_path / "deep.nc")
    with pytest.raises(ForcingError, match="begins at 500 m"):
        open_product(tmp_path / "deep.nc")


def test_the_doctor_names_the_variable_and_what_it_noticed(tmp_path: Path) -> None:
    path = written(tmp_path, replace(PLAIN, level="depth:1:0.494:m", member="one"))
    text = doctor(path, needed=("uo", "vo")).text()
    assert "(from a, m s-1)" in text
    assert "0.494 m" in text
    assert "member 1" in text


def test_currents_on_one_level_reach_the_berg_of_a_run(tmp_path: Path) -> None:
    """`depth = 1`, the usual surface subset of Copernicus, became 0 and the doctor said Ready."""
    from riftberg import build

    written(tmp_path, replace(PLAIN, level="depth:1:0.494:m", packed="int16"))
    (tmp_path / "one.yaml").write_text(
        "start: 2020-12-16 06:00\ndays: 0.1\nberg:\n  rectangle: {length: 12 km, width: 6 km}\n"
        "  placement: [-39.0, -55.5]\nforcing:\n  kind: files\n  files: [field.nc]\n"
        "  longitude: [-41, -37]\n  latitude: [-57, -54]\n"
    )
    model, _ = build(str(tmp_path / "one.yaml"))
    e = model.elements
    model.forcing.sample(e, 0.0)
    east, north = truth("uo", e.lon, e.lat, -39.0)
    np.testing.assert_allclose(e.uo, east, atol=1e-3)
    np.testing.assert_allclose(e.vo, north, atol=1e-3)
