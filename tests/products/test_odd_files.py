"""Odd files of all kinds: every field that is found reaches the berg with its value, or the file is refused in a true sentence.

Each file holds all fields of a run, linear in longitude and latitude, so that what an element must feel is known. The
same file goes through a run (`forcing_from_files`), the doctor and Python (`DatasetForcing.from_xarray`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from riftberg import DatasetForcing, Forcing, Iceberg, Model, open_product
from riftberg.errors import ForcingError
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import open_all
from riftberg.state import Elements, new_elements

START = datetime(2020, 12, 16, 6)
FIELDS: dict[str, tuple[str, str, tuple[float, float, float]]] = {
    "uo": ("eastward_sea_water_velocity", "m s-1", (0.3, 0.05, 0.02)),
    "vo": ("northward_sea_water_velocity", "m s-1", (-0.2, 0.03, -0.04)),
    "ua": ("eastward_wind", "m s-1", (3.0, 0.5, 0.2)),
    "va": ("northward_wind", "m s-1", (-2.0, 0.3, -0.4)),
    "ssh": ("sea_surface_height_above_geoid", "m", (0.1, 0.02, 0.03)),
    "sst": ("sea_surface_temperature", "degC", (1.0, 0.1, 0.2)),
    "sss": ("sea_surface_salinity", "1e-3", (34.0, 0.1, 0.05)),
    "ice_fraction": ("sea_ice_area_fraction", "1", (0.4, 0.05, 0.03)),
    "ice_thickness": ("sea_ice_thickness", "m", (0.8, 0.1, 0.05)),
    "ui": ("eastward_sea_ice_velocity", "m s-1", (0.1, 0.02, 0.01)),
    "vi": ("northward_sea_ice_velocity", "m s-1", (-0.1, 0.01, 0.02)),
    "deptho": ("sea_floor_depth_below_geoid", "m", (2000.0, 100.0, 50.0)),
}
VELOCITIES = ("uo", "vo", "ua", "va", "ui", "vi")
WATER, AIR, ICE = ("uo", "vo", "ssh", "sst", "sss"), ("ua", "va"), ("ice_fraction", "ice_thickness", "ui", "vi")
CENTRE = -39.0


def truth(name: str, lon: Any, lat: Any, centre: float = CENTRE) -> Any:
    mean, east, north = FIELDS[name][2]
    return mean + east * ((np.asarray(lon) - centre + 180.0) % 360.0 - 180.0) + north * (np.asarray(lat) + 55.5)


def plain(centre: float = CENTRE, names: tuple[str, ...] = tuple(FIELDS)) -> xr.Dataset:
    """A file as it should be: axes with units, dates, standard names."""
    lon, lat = centre + np.linspace(-4.0, 4.0, 17), -55.5 + np.linspace(-3.0, 3.0, 13)
    x, y = np.meshgrid(lon, lat)
    dates = np.datetime64("2020-12-16", "ns") + np.arange(4) * np.timedelta64(12, "h")
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", lon, {"units": "degrees_east"})}
    ds = xr.Dataset(coords={"time": dates, **axes})
    for name in names:
        told = {"standard_name": FIELDS[name][0], "units": FIELDS[name][1]}
        values = truth(name, x, y, centre)
        still = name == "deptho"
        ds[name] = (("lat", "lon"), values, told) if still else (("time", "lat", "lon"), np.stack([values] * 4), told)
    return ds


def elements(centre: float = CENTRE) -> Elements:
    x, y = (q.ravel() for q in np.meshgrid(np.linspace(-0.5, 0.5, 3), np.linspace(-0.5, 0.5, 3)))
    found = new_elements(x.size)
    found.lon[:], found.lat[:], found.thickness[:] = centre + x, -55.5 + y, 200.0
    return found


def by_run(path: Path, centre: float = CENTRE) -> Elements:
    box = (centre - 2.0, centre + 2.0)
    asked = FileForcing(kind="files", files=[path.name], longitude=box, latitude=(-57.5, -53.5), hold=24.0)
    e = elements(centre)
    forcing = forcing_from_files(asked, path.parent, Run.of(START, 0.1, e.thickness, 850.0))
    forcing.check(e, 0.0, 8640.0)
    forcing.sample(e, 3600.0)
    return e


def by_python(path: Path, centre: float = CENTRE) -> Elements:
    with warnings.catch_warnings():
        # What xarray says of dates beyond nanoseconds to a user who opens the file is not ours to judge.
        warnings.filterwarnings("ignore", message="Unable to decode time axis")
        with xr.open_dataset(path) as file:
            ds = file.load()
    ds.encoding.pop("source", None)
    e = elements(centre)
    DatasetForcing.from_xarray(ds, START).sample(e, 3600.0)
    return e


WAYS: dict[str, Callable[..., Elements]] = {"run": by_run, "python": by_python}


def arrives(path: Path, names: tuple[str, ...] = tuple(FIELDS), centre: float = CENTRE, near: float = 2e-3) -> None:
    """Check that all fields arrive through a run and through Python, and that the doctor names each."""
    report = doctor([path]).text()
    for way, forced in WAYS.items():
        e = forced(path, centre)
        metres = 111_194.9 * np.cos(np.deg2rad(e.lat))
        for name in names:
            mean = abs(FIELDS[name][2][0])
            if name == "ssh":
                np.testing.assert_allclose(e.slope_x, FIELDS[name][2][1] / metres, rtol=0.05, err_msg=f"{way} slope_x")
                np.testing.assert_allclose(
                    e.slope_y, FIELDS[name][2][2] / 111_194.9, rtol=0.05, err_msg=f"{way} slope_y"
                )
                continue
            expected = truth(name, e.lon, e.lat, centre) + (
                truth("ssh", e.lon, e.lat, centre) if name == "deptho" and "ssh" in names else 0.0
            )
            got = getattr(e, "depth" if name == "deptho" else name)
            np.testing.assert_allclose(got, expected, atol=near * max(1.0, mean), err_msg=f"{way} {name}")
    for name in names:
        shown = "depth_below_surface" if name == "deptho" else name
        assert f"\n  {shown} " in report, report


def refused(path: Path, *words: str, remedy: str = "") -> None:
    """Check that a run and Python refuse a file in one sentence with these words, and that the doctor tells it too."""
    for forced in WAYS.values():
        with pytest.raises(ForcingError) as told:
            forced(path)
        for word in (*words, remedy):
            assert word in str(told.value), str(told.value)
    report = doctor([path], needed=()).text()
    assert all(word in report for word in words), report


def written(folder: Path, ds: xr.Dataset, **options: Any) -> Path:
    path = folder / "odd.nc"
    path.unlink(missing_ok=True)
    ds.to_netcdf(path, **options)
    return path


def on_level(ds: xr.Dataset, names: tuple[str, ...], dim: str, value: float, **attributes: str) -> xr.Dataset:
    for name in names:
        told = ds[name].attrs
        ds[name] = ds[name].expand_dims({dim: 1}, axis=-3).assign_attrs(told)
    return ds.assign_coords({dim: (dim, [value], attributes)})


def test_one_level_of_its_own_for_each_kind_of_field(tmp_path: Path) -> None:
    ds = on_level(plain(), WATER, "depth", 0.494, units="m", positive="down", axis="Z")
    ds = on_level(ds, AIR, "height", 10.0, units="m", positive="up", axis="Z")
    arrives(written(tmp_path, on_level(ds, ICE, "sfc", 0.0, units="m")))


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    ("name", "value", "attributes", "water", "wind"),
    [
        ("lev", 1.0, {}, True, False),
        ("surface", 0.0, {"units": "1"}, True, True),
        ("meanSea", 0.0, {"units": "m"}, True, True),
        ("olevel", 0.5, {"units": "m"}, True, False),
        ("lev", -0.5, {"units": "m", "positive": "up"}, True, False),
        ("z", -100.0, {"units": "m", "positive": "up"}, False, False),
        ("heightAboveGround", 10.0, {"units": "m"}, True, True),
        ("heightAboveGround", 80.0, {"units": "m"}, False, False),
        ("isobaricInhPa", 925.0, {"units": "hPa"}, False, False),
        ("model_level", 60.0, {}, False, False),
        ("elevation_of_level", 100.0, {"units": "m"}, False, False),
        ("flight_level", 7e4, {"units": "Pa"}, False, False),
        ("depth", 5.0, {"units": "level"}, False, False),
        ("height", 10.0, {"units": "1"}, False, False),
        ("number", 0.0, {}, True, True),
        ("band", 1.0, {}, True, True),
    ],
)
def test_a_single_number_that_says_where_a_field_holds(
    tmp_path: Path, name: str, value: float, attributes: dict[str, str], water: bool, wind: bool
) -> None:
    """A number in metres or pascals counts whatever its name is; it was dropped where the name was not known."""
    scalar = {name: ((), value, attributes)}
    currents = written(tmp_path, plain(names=("uo", "vo")).assign_coords(scalar))
    if water:
        arrives(currents, ("uo", "vo"))
    else:
        refused(currents, name)
    winds = xr.merge([plain(names=("uo", "vo")), plain(names=AIR)])
    alone = plain(names=AIR).assign_coords(scalar)
    alone.to_netcdf(tmp_path / "wind.nc")
    winds.drop_vars(AIR).to_netcdf(tmp_path / "odd.nc", mode="w")
    box = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.5, -53.5), "hold": 24.0}
    asked = FileForcing(kind="files", files=["odd.nc", "wind.nc"], **box)
    e = elements()
    run = Run.of(START, 0.1, e.thickness, 850.0)
    if wind:
        forcing_from_files(asked, tmp_path, run).sample(e, 3600.0)
        np.testing.assert_allclose(e.ua, truth("ua", e.lon, e.lat), atol=1e-3)
    else:
        with pytest.raises(ForcingError, match=f"(?s){name}.*not that at 10 m"):
            forcing_from_files(asked, tmp_path, run)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "names",
    [
        ("latitude", "longitude"),
        ("nav_lat", "nav_lon"),
        ("y", "x"),
        ("nj", "ni"),
        ("rlat", "rlon"),
        ("ncells",),
        ("nod2",),
    ],
)
def test_rows_without_coordinates_are_no_positions(tmp_path: Path, names: tuple[str, ...]) -> None:
    bare = plain(names=("uo", "vo")).drop_vars(["lat", "lon"])
    if len(names) == 2:
        bare = bare.rename_dims(lat=names[0], lon=names[1])
    else:
        bare = bare.stack({names[0]: ("lat", "lon")}).drop_vars([names[0], "lat", "lon"], errors="ignore")
    refused(written(tmp_path, bare), "no latitudes and longitudes are given for uo", names[0])


KNOTS = 3600.0 / 1852.0
UNITS: tuple[dict[str, tuple[str, float, float]], ...] = (
    {
        "uo": ("cm.s-1", 100.0, 0.0),
        "vo": ("knots", KNOTS, 0.0),
        "ua": ("kt", KNOTS, 0.0),
        "va": ("km h-1", 3.6, 0.0),
        "ui": ("mm/s", 1000.0, 0.0),
        "vi": ("km/day", 86.4, 0.0),
        "sst": ("degF", 1.8, 32.0),
        "ice_fraction": ("tenths", 10.0, 0.0),
        "sss": ("kg kg-1", 0.001, 0.0),
        "ssh": ("mm", 1000.0, 0.0),
        "ice_thickness": ("feet", 1.0 / 0.3048, 0.0),
        "deptho": ("fathoms", 1.0 / 1.8288, 0.0),
    },
    {
        "uo": ("meters per second", 1.0, 0.0),
        "vo": ("m/day", 86400.0, 0.0),
        "ua": ("mph", 1.0 / 0.44704, 0.0),
        "va": ("ft/s", 1.0 / 0.3048, 0.0),
        "sst": ("kelvins", 1.0, 273.15),
        "ice_fraction": ("1e-2", 100.0, 0.0),
        "sss": ("ppt", 1.0, 0.0),
        "ssh": ("dm", 10.0, 0.0),
        "ice_thickness": ("centimetres", 100.0, 0.0),
        "deptho": ("km", 0.001, 0.0),
    },
)


@pytest.mark.quick(1)
@pytest.mark.parametrize("units", UNITS)
def test_units_that_users_have(tmp_path: Path, units: dict[str, tuple[str, float, float]]) -> None:
    ds = plain()
    for name, (told, factor, offset) in units.items():
        ds[name] = (factor * ds[name] + offset).assign_attrs({**ds[name].attrs, "units": told})
    arrives(written(tmp_path, ds))


@pytest.mark.quick(2)
@pytest.mark.parametrize(("name", "units"), [("uo", "m"), ("ua", "bananas"), ("sst", "m"), ("ssh", "degC"), ("uo", "")])
def test_units_that_cannot_be_are_refused_by_name(tmp_path: Path, name: str, units: str) -> None:
    ds = plain()
    ds[name].attrs["units"] = units
    refused(written(tmp_path, ds), name, f"units {units!r} are not known" if units else "the file gives no units")


def test_fields_without_units_are_not_taken_for_those_of_another_product(tmp_path: Path) -> None:
    """Bare fields beside others were read as the A68a experiment's, and what that does not know was left out unseen."""
    ds = plain()
    for name in ds.data_vars:
        ds[name].attrs = {}
    refused(written(tmp_path, ds), "the file gives no units")


STYLES = {
    "iso": "%Y-%m-%dT%H:%M:%S",
    "space": "%Y-%m-%d %H:%M:%S",
    "wrf": "%Y-%m-%d_%H:%M:%S",
    "zulu": "%Y-%m-%dT%H:%M:%SZ",
    "plain": "%Y%m%d%H",
    "named": "%d-%b-%Y %H:%M:%S",
}


def texts(ds: xr.Dataset, style: str) -> list[str]:
    return [str(text) for text in ds["time"].dt.strftime(STYLES[style]).values]


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("style", "kind"), [(style, ("text", "characters", "beside")[k % 3]) for k, style in enumerate(STYLES)]
)
def test_dates_written_as_text_are_read(tmp_path: Path, style: str, kind: str) -> None:
    ds = plain()
    found = texts(ds, style)
    if kind == "text":
        ds = ds.assign_coords(time=("time", found))
    else:
        letters = np.array([list(text) for text in found], dtype="S1")
        ds = ds.drop_vars("time").assign({"time" if kind == "characters" else "Times": (("time", "letters"), letters)})
    arrives(written(tmp_path, ds))


def test_text_that_is_no_date_is_refused(tmp_path: Path) -> None:
    ds = plain().assign_coords(time=("time", ["monday", "tuesday", "wednesday", "thursday"]))
    refused(written(tmp_path, ds), "text that is not understood", "monday")


@pytest.mark.parametrize("text", ["1950-12-16", "16-Dec-1950", "1950-12-16 06:00:00"])
def test_a_single_date_in_words_keeps_a_run_of_another_year_off(tmp_path: Path, text: str) -> None:
    """A date in a scalar coordinate of text was ignored, so that a run in 2020 went on data of 1950."""
    still = plain(names=("uo", "vo")).isel(time=0, drop=True)
    path = written(tmp_path, still.assign_coords(day=((), text)))
    for forced in (by_run,):
        with pytest.raises(ForcingError, match="1950-12-16"):
            forced(path)
    with pytest.raises(ForcingError, match="1950-12-16"), xr.open_dataset(path) as ds:
        DatasetForcing.from_xarray(ds.load(), START).check(elements(), 0.0, 8640.0)


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", ["forecast_reference_time", "reftime", "validity_date", "valid_time", "date"])
def test_a_single_date_of_any_name_counts(tmp_path: Path, name: str) -> None:
    still = plain(names=("uo", "vo")).isel(time=0, drop=True)
    e = by_run(written(tmp_path, still.assign_coords({name: ((), np.datetime64(START, "ns"))})))
    np.testing.assert_allclose(e.uo, truth("uo", e.lon, e.lat), atol=1e-6)
    old = written(tmp_path, still.assign_coords({name: ((), np.datetime64("1950-01-01", "ns"))}))
    with pytest.raises(ForcingError, match="1950-01-01"):
        by_run(old)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "units", ["Hours Since 2020-12-16", "HOURS since 2020-12-16 00:00", "hours  since 2020-12-16T00:00:00Z"]
)
def test_units_of_time_in_other_letters(tmp_path: Path, units: str) -> None:
    arrives(
        written(tmp_path, plain().drop_vars("time").assign_coords(time=("time", np.arange(4) * 12.0, {"units": units})))
    )


@pytest.mark.parametrize("units", ["months since 2020-11-01", "fortnights since 2020-12-01", "days", "julian days"])
def test_units_of_time_that_say_too_little(tmp_path: Path, units: str) -> None:
    ds = plain(names=("uo", "vo")).drop_vars("time").assign_coords(time=("time", np.arange(4), {"units": units}))
    path = written(tmp_path, ds)
    with pytest.raises(ForcingError, match="no length of time" if "since" in units else "no units that say since when"):
        by_run(path)
    assert units.split()[0] in doctor([path]).text()


@pytest.mark.parametrize(
    "days", [("2020-01-15", "2020-02-15", "2021-02-15", "2021-03-15"), ("2020-02-15", "2021-02-15")]
)
def test_months_with_a_gap_of_a_year(tmp_path: Path, days: tuple[str, ...]) -> None:
    ds = plain(names=("uo", "vo")).isel(time=slice(0, len(days)))
    path = written(tmp_path, ds.assign_coords(time=np.array(days, "datetime64[ns]")))
    with pytest.raises(ForcingError, match="gap of 366 days"):
        by_run(path)


def packed(ds: xr.Dataset) -> dict[str, Any]:
    middle = {name: round(FIELDS[name][2][0]) for name in ds.data_vars}
    return {
        name: {
            "dtype": "int16",
            "scale_factor": 0.1 if name == "deptho" else 0.001,
            "add_offset": float(middle[name]),
            "_FillValue": -32768,
        }
        for name in ds.data_vars
    }


def shaken(ds: xr.Dataset, how: str) -> xr.Dataset:
    """The same file, written in another way."""
    north, east = ds["lat"].attrs, ds["lon"].attrs
    if how == "descending":
        return ds.isel(lat=slice(None, None, -1), lon=slice(None, None, -1))
    if how == "lon time lat":
        return ds.transpose("lon", "time", "lat")
    if how == "0 to 360":
        return ds.assign_coords(lon=("lon", ds["lon"].values % 360.0, east))
    if how == "radians":
        told = [{"standard_name": name, "units": "radian"} for name in ("latitude", "longitude")]
        return ds.assign_coords(
            lat=("lat", np.deg2rad(ds["lat"].values), told[0]), lon=("lon", np.deg2rad(ds["lon"].values), told[1])
        )
    if how == "without units on the axes":
        return ds.assign_coords(lat=("lat", ds["lat"].values), lon=("lon", ds["lon"].values))
    if how == "scattered":
        flat = ds.stack(cell=("lat", "lon"))
        lat, lon = flat["lat"].values, flat["lon"].values
        return flat.drop_vars(["cell", "lat", "lon"]).assign_coords(clat=("cell", lat, north), clon=("cell", lon, east))
    if how == "capital letters":
        return ds.rename({name: name.upper() for name in ds.data_vars}).rename(
            lat="Latitude", lon="Longitude", time="Time"
        )
    if how == "one member":
        return ds.expand_dims(number=[7])
    if how == "records in disorder":
        return ds.isel(time=[2, 0, 3, 1])
    return ds


HOW = (
    "descending",
    "lon time lat",
    "0 to 360",
    "radians",
    "without units on the axes",
    "capital letters",
    "one member",
    "records in disorder",
    "packed",
    "fill values on the axes",
)


@pytest.mark.quick(3)
@pytest.mark.parametrize("how", HOW)
def test_the_same_file_in_other_ways(tmp_path: Path, how: str) -> None:
    ds = shaken(plain(), how)
    encoding = packed(ds) if how == "packed" else {}
    if how == "fill values on the axes":
        encoding = {"lat": {"_FillValue": -999.0}, "lon": {"_FillValue": 1e20}}
    arrives(written(tmp_path, ds, encoding=encoding))


def test_scattered_points_reach_the_berg_of_a_run(tmp_path: Path) -> None:
    """Records on scattered points ended in a traceback in a run, while Python read them."""
    path = written(tmp_path, shaken(plain(), "scattered"))
    arrives(path, tuple(name for name in FIELDS if name not in ("ssh", "deptho")), near=0.02)


def test_longitudes_that_jump_at_the_date_line(tmp_path: Path) -> None:
    ds = plain(179.75)
    jumping = ds.assign_coords(lon=("lon", (ds["lon"].values + 180.0) % 360.0 - 180.0, ds["lon"].attrs))
    arrives(written(tmp_path, jumping), centre=179.75)


def test_an_axis_with_a_hole_is_refused(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    lat = ds["lat"].values.copy()
    lat[3] = np.nan
    refused(written(tmp_path, ds.assign_coords(lat=("lat", lat, ds["lat"].attrs))), "lat is not a number everywhere")


@pytest.mark.parametrize(("dim", "count"), [("number", 3), ("expver", 2), ("quantile", 5)])
def test_a_dimension_too_many_is_refused_with_a_command(tmp_path: Path, dim: str, count: int) -> None:
    ds = plain(names=("uo", "vo")).expand_dims({dim: np.arange(count)})
    refused(written(tmp_path, ds), dim, remedy=f"ds.isel({dim}=0)")


def test_a_field_that_a_product_does_not_offer_is_read_all_the_same(tmp_path: Path) -> None:
    """An ERA5 file with currents beside its winds: they were left out unseen."""
    ds = plain().rename(ua="u10", va="v10")
    arrives(written(tmp_path, ds.assign_attrs(title="ERA5 with others", history="grib_to_netcdf")))


def test_fields_in_a_group_are_told_as_such(tmp_path: Path) -> None:
    """The doctor said that such a file holds nothing."""
    path = tmp_path / "grouped.nc"
    plain(names=("uo", "vo")).to_netcdf(path, group="ocean")
    with pytest.raises(ForcingError, match="in the group ocean"):
        by_run(path)
    assert "ncks -G : -g ocean" in doctor([path]).text()


def unstructured(names: tuple[str, str], told: bool) -> xr.Dataset:
    """Output of FESOM with the positions of its nodes in the file."""
    rng = np.random.default_rng(3)
    lon, lat = CENTRE + rng.uniform(-4.0, 4.0, 4000), -55.5 + rng.uniform(-3.0, 3.0, 4000)
    dates = np.datetime64("2020-12-16", "ns") + np.arange(4) * np.timedelta64(12, "h")
    where = {"lat": ("nod2", lat, {"units": "degrees_north"}), "lon": ("nod2", lon, {"units": "degrees_east"})}
    ds = xr.Dataset(coords={"time": dates, **where}, attrs={"source": "FESOM2"})
    for name, field in (*zip(names, ("uo", "vo")), ("ssh", "ssh"), ("a_ice", "ice_fraction")):
        attributes = {"units": FIELDS[field][1], "description": "velocity"}
        if told:
            attributes["standard_name"] = FIELDS[field][0]
        ds[name] = (("time", "nod2"), np.stack([truth(field, lon, lat)] * 4), attributes)
    return ds


@pytest.mark.quick(1)
@pytest.mark.parametrize("names", [("unod", "vnod"), ("u", "v")])
def test_fesom_reaches_the_berg_of_a_run(tmp_path: Path, names: tuple[str, str]) -> None:
    path = written(tmp_path, unstructured(names, told=True))
    assert "FESOM" in doctor([path]).text()
    arrives(path, ("uo", "vo", "ssh", "ice_fraction"), near=0.02)


def test_fesom_that_does_not_say_where_its_velocities_point_is_refused(tmp_path: Path) -> None:
    refused(written(tmp_path, unstructured(("unod", "vnod"), told=False)), "does not say that it points east or north")


def test_fesom_without_positions_is_refused(tmp_path: Path) -> None:
    bare = unstructured(("unod", "vnod"), told=True).drop_vars(["lat", "lon"])
    refused(written(tmp_path, bare), "no latitudes and longitudes are given for unod")


def test_nodes_beyond_the_poles_are_refused(tmp_path: Path) -> None:
    """Bug: latitudes were checked on axes and curved grids, not at nodes."""
    ds = unstructured(("unod", "vnod"), told=True)
    there = ds["lat"].copy(data=2.0 * ds["lat"].values)
    refused(written(tmp_path, ds.assign_coords(lat=there)), "that is no latitude")


MAPS = {
    "polar stereographic": "EPSG:3031",
    "Lambert": "+proj=lcc +lat_1=-50 +lat_2=-60 +lat_0=-55 +lon_0=-60 +R=6371229",
    "equal area": "EPSG:6932",
    "Mercator": "+proj=merc +lon_0=-20",
    "transverse Mercator": "+proj=tmerc +lon_0=-30 +lat_0=-50",
}


def on_map(name: str, *, mapping: bool, positions: bool, flipped: bool) -> xr.Dataset:
    """Currents along the axes of a map."""
    import pyproj

    crs = pyproj.CRS(MAPS[name])
    there = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    back = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    middle, far = there.transform(CENTRE, -55.5), (np.arange(41) - 20) * 10e3
    x, y = middle[0] + far, (middle[1] + far)[:: -1 if flipped else 1]
    lon, lat = back.transform(*np.meshgrid(x, y))
    lon2, lat2 = back.transform(*np.meshgrid(x + 10.0, y))
    angle = np.arctan2(lat2 - lat, ((lon2 - lon + 180.0) % 360.0 - 180.0) * np.cos(np.deg2rad(lat)))
    east, north = truth("uo", lon, lat), truth("vo", lon, lat)
    dates = np.datetime64("2020-12-16", "ns") + np.arange(4) * np.timedelta64(12, "h")
    told = [{"units": "m", "standard_name": f"projection_{axis}_coordinate"} for axis in "xy"]
    ds = xr.Dataset(coords={"time": dates, "x": ("x", x, told[0]), "y": ("y", y, told[1])})
    along = (east * np.cos(angle) + north * np.sin(angle), north * np.cos(angle) - east * np.sin(angle))
    for axis, values in zip("xy", along):
        attributes = {
            "units": "m s-1",
            "standard_name": f"sea_water_{axis}_velocity",
            **({"grid_mapping": "crs"} if mapping else {}),
        }
        ds[f"along_{axis}"] = (("time", "y", "x"), np.stack([values] * 4), attributes)
    if mapping:
        ds["crs"] = ((), 0, crs.to_cf())
    if positions:
        ds = ds.assign_coords(
            lat=(("y", "x"), lat, {"units": "degrees_north"}), lon=(("y", "x"), lon, {"units": "degrees_east"})
        )
    return ds


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("name", "mapping", "positions"),
    [(name, True, False) for name in MAPS]
    + [(name, k == 0, True) for k in (0, 1) for name in ("Lambert", "polar stereographic")],
)
def test_currents_along_the_axes_of_a_map_are_turned(tmp_path: Path, name: str, mapping: bool, positions: bool) -> None:
    for flipped in (False, True) if mapping else (False,):
        arrives(written(tmp_path, on_map(name, mapping=mapping, positions=positions, flipped=flipped)), ("uo", "vo"))


def test_a_map_whose_axes_only_count_is_read_by_its_positions(tmp_path: Path) -> None:
    ds = on_map("Lambert", mapping=True, positions=True, flipped=False)
    for axis in "xy":
        ds[axis] = (axis, np.arange(ds.sizes[axis]), {"standard_name": f"projection_{axis}_coordinate"})
    arrives(written(tmp_path, ds), ("uo", "vo"))


@pytest.mark.parametrize("leaning", ["lat", "lon"])
def test_a_grid_of_which_one_axis_leans_is_not_straight(tmp_path: Path, leaning: str) -> None:
    """Rows that leave their parallel, or columns their meridian, and the other of the two does not."""
    ds = plain(names=("uo", "vo"))
    x, y = np.meshgrid(ds["lon"].values, ds["lat"].values)
    lon, lat = (x, y + 0.2 * (x - CENTRE)) if leaning == "lat" else (x + 0.2 * (y + 55.5), y)
    bent = ds.drop_vars(["lon", "lat"]).rename(lat="row", lon="column")
    places = {"lon": (lon, "degrees_east"), "lat": (lat, "degrees_north")}
    bent = bent.assign_coords({name: (("row", "column"), q, {"units": unit}) for name, (q, unit) in places.items()})
    for name in ("uo", "vo"):
        bent[name] = bent[name].copy(data=np.broadcast_to(truth(name, lon, lat), bent[name].shape))
    arrives(written(tmp_path, bent), ("uo", "vo"))


def test_currents_along_a_map_that_is_not_described_are_refused(tmp_path: Path) -> None:
    bare = on_map("Lambert", mapping=False, positions=False, flipped=False)
    refused(written(tmp_path, bare), "no latitudes and longitudes are given for along_x")
    mirrored = on_map("Lambert", mapping=False, positions=True, flipped=True)
    refused(written(tmp_path, mirrored), "its direction cannot be known")


# --- values and words of a file that a stranger may write ---------------------------------------------------------------


@pytest.mark.quick(2)
@pytest.mark.parametrize("units", ["1", "g kg-1", "1e-3", "PSU", "0.001", None])
def test_salinity_is_judged_by_its_values(tmp_path: Path, units: str | None) -> None:
    """A salinity of 0.034, kilograms of salt per kilogram under another unit, was taken as nearly fresh water."""
    right, wrong = plain(names=("uo", "vo", "sss")), plain(names=("uo", "vo", "sss"))
    wrong["sss"] = (wrong["sss"] * 0.001).assign_attrs(wrong["sss"].attrs)
    for ds in (right, wrong):
        ds["sss"].attrs = {"standard_name": "sea_surface_salinity"} | ({"units": units} if units else {})
    arrives(written(tmp_path, right), ("uo", "vo", "sss"))
    refused(written(tmp_path, wrong), "no sea is so fresh")


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "factor", "offset", "words"),
    [
        ("sst", 1.0, -18.0, "below -5 it is not believable"),
        ("ice_fraction", -1.0, 0.0, "below -0.01 it is not believable"),
        ("ice_thickness", -1.0, 0.0, "below -0.01 it is not believable"),
        ("sss", -1.0, 0.0, "below -0.5 it is not believable"),
        ("deptho", -1.0, 0.0, "it looks like a height, positive up"),
    ],
)
def test_values_that_cannot_be_are_refused_on_either_side(
    tmp_path: Path, name: str, factor: float, offset: float, words: str
) -> None:
    ds = plain()
    ds[name] = (factor * ds[name] + offset).assign_attrs(ds[name].attrs)
    refused(written(tmp_path, ds), words)


def test_the_doctor_doubts_percent_that_are_shares(tmp_path: Path) -> None:
    ds = plain()
    ds["ice_fraction"].attrs["units"] = "%"
    assert "are these shares of 1?" in doctor([written(tmp_path, ds)]).text()


@pytest.mark.quick(2)
@pytest.mark.parametrize("packed_limits", [False, True])
@pytest.mark.parametrize("key", ["valid_range", "valid_max"])
def test_values_outside_of_the_valid_range_are_missing(tmp_path: Path, key: str, packed_limits: bool) -> None:
    """Land written as 3 m/s beside ``valid_max`` = 2 m/s was taken as a current."""
    names, scale = ("uo", "vo"), 0.001 if packed_limits else 1.0
    ds = plain(names=names)
    for name in names:
        ds[name][:, :, 9] = 3.0
        limits = np.array([-2.0, 2.0]) / scale
        limits = limits.astype("i2") if packed_limits else limits
        ds[name].attrs[key] = limits if key == "valid_range" else limits[1]
    encoding = {name: {"dtype": "int16", "scale_factor": scale, "_FillValue": -32768} for name in names}
    path = written(tmp_path, ds, encoding=encoding if packed_limits else {})
    for forced in WAYS.values():
        e = forced(path)
        np.testing.assert_allclose(e.uo, truth("uo", e.lon, e.lat), atol=0.03)


@pytest.mark.parametrize("what", ["time: standard_deviation", "time: mean realization: variance", "time: maximum"])
def test_a_statistic_of_a_field_is_not_the_field(tmp_path: Path, what: str) -> None:
    ds = plain(names=("uo", "vo"))
    for name in ds.data_vars:
        ds[name].attrs["cell_methods"] = what
    refused(written(tmp_path, ds), "uo is no eastward current", "(cell_methods)")


@pytest.mark.parametrize("words", ["standard error of the current", "current anomaly from 1993-2012", "uncertainty"])
def test_a_field_described_as_an_error_or_anomaly_is_refused(tmp_path: Path, words: str) -> None:
    ds = plain(names=("uo", "vo"))
    for name in ds.data_vars:
        ds[name].attrs["long_name"] = words
    refused(written(tmp_path, ds), words)


def test_of_a_mean_and_its_spread_the_mean_is_taken(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    for name in ("uo", "vo"):
        told = {**ds[name].attrs, "cell_methods": "time: standard_deviation"}
        ds[f"a_{name}"] = (0.1 * ds[name]).assign_attrs(told)
        ds = ds.rename({name: f"b_{name}"})
    arrives(written(tmp_path, ds), ("uo", "vo"))


@pytest.mark.parametrize(
    ("east", "north"),
    [
        ("westward_sea_water_velocity", "southward_sea_water_velocity"),
        ("barotropic_eastward_sea_water_velocity", "barotropic_northward_sea_water_velocity"),
        ("eastward_sea_water_velocity_at_sea_floor", "northward_sea_water_velocity_at_sea_floor"),
    ],
)
def test_a_usual_name_with_the_standard_name_of_something_else(tmp_path: Path, east: str, north: str) -> None:
    """A westward velocity called ``uo`` was taken as eastward, the current at the sea floor as that of the surface."""
    ds = plain(names=("uo", "vo"))
    ds["uo"].attrs["standard_name"], ds["vo"].attrs["standard_name"] = east, north
    refused(written(tmp_path, ds), f"uo is {east}, which is none of these")


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "names", [("u2m", "v2m"), ("ua80m", "va80m"), ("uas_2m", "vas_2m"), ("u_wind_50m", "v_wind_50m")]
)
def test_winds_named_after_another_height_are_refused(tmp_path: Path, names: tuple[str, str]) -> None:
    ds = plain(names=("uo", "vo", *AIR)).rename(dict(zip(AIR, names, strict=True)))
    refused(written(tmp_path, ds), f"{names[0]} is the wind at")


@pytest.mark.parametrize("at", ["beginning", "end", "middle"])
def test_means_stamped_at_an_end_of_their_bounds_hold_in_the_middle(tmp_path: Path, at: str) -> None:
    """Daily or monthly means stamped at their beginning came half an interval too early."""
    ds = plain(names=("uo", "vo")).drop_vars("time")
    for name in ds.data_vars:
        ds[name] = (ds[name] + 0.1 * xr.DataArray(np.arange(4.0), dims="time")).transpose("time", ...).assign_attrs(
            {**ds[name].attrs, "cell_methods": "time: mean"}
        )  # fmt: skip
    hours = 12.0 * np.arange(-1, 3)
    stamps = {"beginning": hours, "end": hours + 12.0, "middle": hours + 6.0}[at]
    ds["time_bnds"] = (("time", "nv"), np.stack([hours, hours + 12.0], 1))
    ds = ds.assign_coords(time=("time", stamps, {"units": "hours since 2020-12-16", "bounds": "time_bnds"}))
    for forced in WAYS.values():
        e = forced(written(tmp_path, ds))  # at 07:00, of means at -6, 6, 18 and 30 h
        np.testing.assert_allclose(e.uo - truth("uo", e.lon, e.lat), 0.1 * (1.0 + 1.0 / 12.0), atol=1e-6)


@pytest.mark.parametrize("calendar", ["noleap", "360_day", "all_leap"])
def test_dates_of_model_calendars(tmp_path: Path, calendar: str) -> None:
    day = {"noleap": 349, "360_day": 345, "all_leap": 350}[calendar]
    told = {"units": "days since 2020-01-01", "calendar": calendar}
    ds = plain(names=("uo", "vo")).drop_vars("time")
    arrives(written(tmp_path, ds.assign_coords(time=("time", day + 0.5 * np.arange(4), told))), ("uo", "vo"))


@pytest.mark.parametrize(("calendar", "said"), [("julian", True), ("noleap", True), ("standard", False)])
def test_dates_of_another_calendar_are_said_to_be_taken_as_written(tmp_path: Path, calendar: str, said: bool) -> None:
    ds = plain(names=("uo", "vo")).drop_vars("time")
    told = {"units": "days since 2020-01-01", "calendar": calendar}
    opened = open_product(written(tmp_path, ds.assign_coords(time=("time", 349 + 0.5 * np.arange(4), told))))
    assert (f"the calendar {calendar}, and are taken as they are written" in opened.attrs.get("doubt", "")) == said


@pytest.mark.parametrize("units", ["days since 0000-01-01 00:00:00", "days since -4713-01-01 12:00:00"])
def test_dates_that_count_from_before_the_year_1_are_refused_in_true_words(tmp_path: Path, units: str) -> None:
    ds = plain(names=("uo", "vo")).drop_vars("time").assign_coords(time=("time", 7e5 + np.arange(4), {"units": units}))
    with pytest.raises(ForcingError, match="which begins before the year 1"):
        by_run(written(tmp_path, ds))


@pytest.mark.parametrize(("text", "right"), [("0.001", True), ("thousandths", False)])
def test_packing_written_as_text(tmp_path: Path, text: str, right: bool) -> None:
    """A scale factor that is text ended in a traceback when the first values were read."""
    ds = plain(names=("uo", "vo"))
    for name in ("uo", "vo"):
        ds[name] = (1000.0 * ds[name]).round().astype("i2").assign_attrs(ds[name].attrs)
    path = written(tmp_path, ds)
    with netCDF4.Dataset(path, "a") as file:
        for name in ("uo", "vo"):
            file[name].setncattr("scale_factor", text)
    if right:
        e = by_run(path)
        np.testing.assert_allclose(e.uo, truth("uo", e.lon, e.lat), atol=1e-3)
    else:
        with pytest.raises(ForcingError, match="scale_factor of uo is 'thousandths', which is no number"):
            by_run(path)


# --- Python: what a run from files is told, Python is told too -----------------------------------------------------------


def test_refusals_in_python_name_no_key_of_an_experiment_file() -> None:
    """`from_xarray` was told to set ``forcing.hold`` and to take a larger ``forcing.longitude``."""
    e = elements()
    for change, words in (
        (lambda ds: ds.isel(time=slice(0, 1)), "hold of from_xarray"),
        (
            lambda ds: ds.assign_coords(time=ds["time"] + np.array([0, 0, 9, 9]) * np.timedelta64(1, "D")),
            "max_gap of from_xarray",
        ),
        (lambda ds: ds.isel(lat=slice(0, 5)), "Give data that cover it"),
    ):
        with pytest.raises(ForcingError, match=words) as told:
            DatasetForcing.from_xarray(change(plain(names=("uo", "vo"))), START).check(e, 0.0, 86400.0)
        assert "forcing." not in str(told.value)
        assert "--" not in str(told.value)


def test_python_holds_the_ends_and_bridges_gaps_where_it_is_told() -> None:
    one = plain(names=("uo", "vo")).isel(time=slice(0, 1))
    DatasetForcing.from_xarray(one, START, hold="2 d").check(elements(), 0.0, 86400.0)
    far = plain(names=("uo", "vo"))
    far = far.assign_coords(time=far["time"] + np.array([0, 0, 9, 9]) * np.timedelta64(1, "D"))
    DatasetForcing.from_xarray(far, START, max_gap="10 d").check(elements(), 0.0, 86400.0)
    with pytest.raises(ForcingError, match="hold"):
        DatasetForcing.from_xarray(one, START, hold="soon")
    DatasetForcing.from_xarray(far, START, max_gap=1e60, hold=1e60).check(elements(), 0.0, 86400.0)


def test_one_component_alone_is_refused_in_python_too() -> None:
    with pytest.raises(ForcingError, match="gives uo and nothing gives vo"):
        DatasetForcing.from_xarray(plain(names=("uo",)), START)


def test_a_record_without_any_value_is_no_calm_sea_in_python() -> None:
    """A record that is missing throughout counted as a current of 0; a run from files has long told it as a gap."""
    ds = plain(names=("uo", "vo"))
    ds["uo"][1] = np.nan
    with pytest.raises(ForcingError, match="uo has no value at 2020-12-16T12:00"):
        DatasetForcing.from_xarray(ds, START).check(elements(), 0.0, 86400.0)


def _counted(ds: xr.Dataset, kind: str) -> xr.Dataset:
    """Dates as numbers like 20201216.75."""
    days = ds["time"].values.astype("datetime64[D]")
    part = (ds["time"].values - days) / np.timedelta64(1, "D")
    numbers = np.array([float(str(day).replace("-", "")) for day in days]) + part
    return ds.drop_vars("time").assign_coords(time=("time", numbers.astype(kind), {"units": "day as %Y%m%d.%f"}))


def test_parts_of_days_in_numbers_that_read_as_dates(tmp_path: Path) -> None:
    """The day of 20201216.75 was rounded to the 17th before its three quarters were added: wrong by a day, and no word."""
    ds = plain()
    ds = ds.assign_coords(time=ds["time"].values + np.timedelta64(6, "h"))
    with xr.open_dataset(written(tmp_path, _counted(ds, "f8"))) as file:
        forcing = Forcing.from_xarray(file.load())
    np.testing.assert_array_equal(forcing.parts[0].records.ds["time"].values, ds["time"].values)
    arrives(written(tmp_path, _counted(ds, "f8")))


def test_dates_counted_in_single_precision_are_refused(tmp_path: Path) -> None:
    """In 32 bits 20201216 and 20201217 are one number: such dates were taken, wrong by a day."""
    refused(written(tmp_path, _counted(plain(), "f4")), "time")


@pytest.mark.parametrize(("axis", "units"), [("lat", "degrees_north"), ("lon", "degrees_east")])
def test_a_place_that_stands_twice_is_told_as_such(tmp_path: Path, axis: str, units: str) -> None:
    """The remedy was to sort, which does not help; of two columns of one longitude the first was taken."""
    ds = plain()
    values = ds[axis].values.copy()
    values[4] = values[3]
    refused(
        written(tmp_path, ds.assign_coords({axis: (axis, values, {"units": units})})),
        f"{axis} has {values[3]:g} twice", remedy=f"ds.drop_duplicates('{axis}')",
    )  # fmt: skip


@pytest.mark.quick(1)
@pytest.mark.parametrize(("axis", "units"), [("lat", "degrees_south"), ("lon", "degrees_west"), ("lon", "deg W")])
def test_degrees_south_and_west_are_turned(tmp_path: Path, axis: str, units: str) -> None:
    """They were taken for degrees north and east: the data lay on the other side of the earth."""
    ds = plain()
    arrives(written(tmp_path, ds.assign_coords({axis: (axis, -ds[axis].values, {"units": units})})))


@pytest.mark.quick(1)
@pytest.mark.parametrize("levels", [1, 2])
def test_a_layer_that_begins_at_the_surface_by_its_bounds_is_taken(tmp_path: Path, levels: int) -> None:
    """A mean from 0 to 100 m has its middle at 50 m, and was refused: nothing was known above."""
    ds = plain()
    for name in ("uo", "vo"):
        told = ds[name].attrs
        ds[name] = ds[name].expand_dims({"layer": levels}, axis=1).assign_attrs(told)
    depth = np.array([50.0, 1050.0])[:levels]
    ds = ds.assign_coords(layer=("layer", depth, {"units": "m", "positive": "down", "bounds": "edges"}))
    ds["edges"] = (("layer", "two"), np.array([[0.0, 100.0], [100.0, 2000.0]])[:levels])
    arrives(written(tmp_path, ds))
    ds["edges"] = ds["edges"] + 40.0
    refused(written(tmp_path, ds), "begins at")


def _with_calendar(ds: xr.Dataset, calendar: str) -> xr.Dataset:
    return ds.assign_coords(time=xr.date_range("2020-12-16", periods=4, freq="12h", calendar=calendar, use_cftime=True))


DATES = {
    "text": lambda ds: ds.assign_coords(time=("time", texts(ds, "iso"))),
    "numbers": lambda ds: _counted(ds, "f8"),
    "no leap years": lambda ds: _with_calendar(ds, "noleap"),
    "issued earlier": lambda ds: ds.assign_coords(forecast_reference_time=np.datetime64("2020-12-14", "ns")),
    "bounds": lambda ds: ds.assign(
        edges=(("time", "two"), ds["time"].values[:, None] + np.array([-3, 3]) * np.timedelta64(1, "h"))
    ),
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("kind", DATES)
def test_time_0_is_by_default_the_first_date_however_dates_are_written(tmp_path: Path, kind: str) -> None:
    """It was the least of whichever variable of dates came first: bounds, or the day on which a forecast was issued."""
    with xr.open_dataset(written(tmp_path, DATES[kind](plain()))) as ds:
        for forcing in (Forcing.from_xarray(ds.load()), DatasetForcing.from_xarray(ds)):
            assert forcing.start == datetime(2020, 12, 16)


def test_data_without_currents_are_refused_unless_a_formula_gives_them() -> None:
    """In Python a berg stood still in the wind alone, without a word."""
    wind = DatasetForcing.from_xarray(plain(names=("ua", "va")), START)
    with pytest.raises(ForcingError, match="nothing gives currents, only ua"):
        wind.check(elements(), 0.0, 8640.0)
    both = wind + Forcing.uniform(current=(0.3, 0.0))
    both.check(elements(), 0.0, 8640.0)
    assert both.currents(np.array([CENTRE]), np.array([-55.5]), 0.0)[0].tolist() == [0.3]


@pytest.mark.parametrize("how", ["step", "advance"])
def test_a_single_step_is_checked_as_a_run_is(how: str) -> None:
    """``model.step()`` took currents of 0 on land, and dates beyond the data."""
    ds = plain()
    ds["uo"] = ds["uo"].where(ds["lon"] > CENTRE)
    berg = Iceberg.rectangle(9e3, 9e3, thickness=200.0, placement=(CENTRE - 2.0, -55.5))
    model = Model(berg, DatasetForcing.from_xarray(ds, START))
    with pytest.raises(ForcingError, match="is on land"):
        model.step() if how == "step" else model.advance(steps=1)


HEIGHTS = {
    "elevation": {"units": "m"},
    "topo": {"units": "m", "standard_name": "height_above_mean_sea_level"},
    "ground": {"units": "km", "standard_name": "surface_altitude"},
    "deptho": {"units": "m", "standard_name": "sea_floor_depth_below_geoid", "positive": "up"},
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("name", HEIGHTS)
def test_heights_of_the_sea_floor_become_depths(tmp_path: Path, name: str) -> None:
    """The sea floor was left out without a word, and no berg ever grounded."""
    ds = plain()
    height = -ds["deptho"] / (1000.0 if HEIGHTS[name]["units"] == "km" else 1.0)
    arrives(written(tmp_path, ds.drop_vars("deptho").assign({name: height.drop_attrs().assign_attrs(HEIGHTS[name])})))


UNREAD = {
    "wind": (("ua", "va"), "wspd", "wind_speed"),
    "sea level": (("ssh",), "sla", "sea_surface_height_above_mean_sea_level"),
    "sea floor": (("deptho",), "bed", "sea_floor_depth_below_reference_ellipsoid"),
    "temperature": (("sst",), "thetao", "sea_water_potential_temperature"),
}


@pytest.mark.quick(2)
@pytest.mark.parametrize("family", UNREAD)
def test_what_a_file_holds_and_nothing_reads_is_told(
    tmp_path: Path, family: str, caplog: pytest.LogCaptureFixture
) -> None:
    """A wind as speed and direction, or a sea level anomaly, was passed over, and the doctor said Ready."""
    lost, name, said = UNREAD[family]
    ds = plain()
    ds[name] = ds[lost[0]].assign_attrs(standard_name=said, units=ds[lost[0]].attrs["units"])
    path = written(tmp_path, ds.drop_vars(lost))
    words = f"no {family} is taken from this file; not read: {name} ({said})"
    assert words in " ".join(doctor([path], needed=()).text().split())
    with xr.open_dataset(path) as file:
        forcing = DatasetForcing.from_xarray(file.load(), START)
    assert any(words in notice for notice in forcing.notices)
    assert words in caplog.text


def test_what_is_read_by_another_name_is_not_called_unread(tmp_path: Path) -> None:
    ds = plain()
    ds["wspd"] = ds["ua"].assign_attrs(standard_name="wind_speed")
    ds["sst_error"] = ds["sst"].assign_attrs(standard_name="sea_surface_temperature standard_error")
    assert "not read" not in doctor([written(tmp_path, ds)], needed=()).text()


@pytest.mark.parametrize("file", ["GLORYS_NA_20120101.nc", "srtm15_coarsened.nc", "ERA5_NA_2012.nc"])
def test_a_product_in_memory_gives_what_its_file_gives(shared: Path, file: str) -> None:
    """GLORYS opened by xarray lost its temperature and salinity."""
    path = shared / "data" / "samples" / file
    with xr.open_dataset(path) as ds:
        forcing = DatasetForcing.from_xarray(ds, "2012-01-01", sea_level="files" if "zos" in ds else "none")
        kept = {name for part in forcing.parts for name in part.records.names}
    assert kept == {str(name) for part in open_all(path) for name in part.data_vars}
