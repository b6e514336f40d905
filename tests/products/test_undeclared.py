"""What files do not declare as CF wants it: fill values of dates, grid mappings, units with a number, flags, wave periods."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pyproj
import pytest
import xarray as xr

from products.test_dates_and_neighbours import dated, day, forced, growing
from products.test_given_waves import forced as forced_by_waves
from products.test_given_waves import with_waves
from products.test_odd_files import CENTRE, START, elements, plain, truth, written
from riftberg import DatasetForcing, open_product
from riftberg.config.units import to_unit
from riftberg.errors import ForcingError
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products.quantities import unit_change
from riftberg.system.input_files import reading

HOURS = 6.0 * np.arange(9)

# Dates that were never written


@pytest.mark.parametrize(
    ("kind", "fill", "lost"),
    [
        ("f8", 9.969209968386869e36, 1), ("i8", -9223372036854775806, 1), ("i4", -2147483647, 9), ("f4", 1e20, 9),
        ("f8", -9999.0, 1), ("i4", -99999, 1),
    ],
)  # fmt: skip
def test_dates_that_were_never_written_are_missing(tmp_path: Path, kind: str, fill: float, lost: int) -> None:
    hours = HOURS.astype(kind)
    hours[-lost:] = fill
    ds = growing(HOURS / 24.0).assign_coords(time=("time", hours, {"units": "hours since 2020-12-16"}))
    ds["time"].encoding["_FillValue"] = None
    with pytest.raises(ForcingError, match=f": {lost} of 9 dates are missing"):
        forced(written(tmp_path, ds), day(1.0))


def test_bounds_that_were_never_written(tmp_path: Path) -> None:
    ds = dated(growing(HOURS / 24.0), HOURS, "hours since 2020-12-16", bounds="time_bnds")
    ds["time_bnds"] = ("time", "nv"), np.full((9, 2), 9.969209968386869e36)
    ds["time_bnds"].encoding["_FillValue"] = None
    assert forced(written(tmp_path, ds), day(1.0))[0] == pytest.approx(0.1, abs=1e-3)


def test_nines_in_their_order_are_dates(tmp_path: Path) -> None:
    ds = growing(np.arange(996, 1003) / 24.0)
    ds = dated(ds, np.arange(996, 1003), "hours since 2020-12-16")
    assert forced(written(tmp_path, ds), day(999.0 / 24.0))[0] == pytest.approx(99.9 / 24.0, abs=1e-3)


# Grid mappings and map axes


POLAR = {
    "grid_mapping_name": "polar_stereographic", "latitude_of_projection_origin": -90.0, "standard_parallel": -70.0,
    "straight_vertical_longitude_from_pole": 0.0, "semi_major_axis": 6378137.0, "inverse_flattening": 298.257223563,
    "false_easting": 0.0, "false_northing": 0.0,
}  # fmt: skip


def on_map(path: Path, units: str = "m", metres: float = 1.0, mapping: tuple[str, Any] = ("i4", ())) -> Path:
    """Currents along the axes of a polar map, whose directions are those of east and north turned by the longitude."""
    from pyproj import CRS, Transformer

    map_of = Transformer.from_crs(4326, CRS.from_cf(POLAR), always_xy=True)
    x0, y0 = map_of.transform(CENTRE, -55.5)
    x, y = x0 + np.arange(-20, 21) * 2e4, y0 + np.arange(-20, 21) * 2e4
    lon, lat = map_of.transform(*np.meshgrid(x, y), direction="INVERSE")
    kind, values = mapping
    with netCDF4.Dataset(path, "w") as ds:
        for name, size in (("x", x.size), ("y", y.size), ("n", 9), ("one", 1)):
            ds.createDimension(name, size)
        for name, axis in (("x", x), ("y", y)):
            told = {"standard_name": f"projection_{name}_coordinate", "units": units}
            ds.createVariable(name, "f8", (name,)).setncatts(told)
            ds[name][:] = axis / metres
        crs = ds.createVariable("crs", str if kind == "string" else kind, values)
        crs.setncatts(POLAR)
        if kind == "S1" and values:
            crs[:] = np.frombuffer(b"polar map", "S1")
        for name in ("uo", "vo"):
            told = {"units": "m s-1", "standard_name": f"{'east' if name == 'uo' else 'north'}ward_sea_water_velocity"}
            ds.createVariable(name, "f8", ("y", "x")).setncatts({**told, "grid_mapping": "crs"})
            ds[name][:] = truth(name, lon, lat)
    return path


def felt_on_map(path: Path) -> float:
    e = elements()
    box = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.0, -54.0)}
    asked = FileForcing(kind="files", files=[path.name], **box)
    forcing = forcing_from_files(asked, path.parent, Run.of(START, 0.1, e.thickness, 850.0))
    forcing.sample(e, 0.0)
    return float(max(np.abs(getattr(e, name) - truth(name, e.lon, e.lat)).max() for name in ("uo", "vo")))


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "mapping", [("S1", ("n",)), ("i4", ("one",)), ("string", ("one",)), ("f8", ("one",)), ("S1", ()), ("string", ())]
)
def test_grid_mappings_of_any_shape(tmp_path: Path, mapping: tuple[str, Any]) -> None:
    assert felt_on_map(on_map(tmp_path / "map.nc", mapping=mapping)) < 5e-3


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("units", "metres"),
    [
        ("100 km", 1e5),
        ("100  km", 1e5),
        ("1000 m", 1e3),
        ("10*km", 1e4),
        ("1e3 m", 1e3),
        ("ft", 0.3048),
        ("Kilometers", 1e3),
    ],
)
def test_map_axes_in_units_with_a_number(tmp_path: Path, units: str, metres: float) -> None:
    assert felt_on_map(on_map(tmp_path / "map.nc", units, metres)) < 5e-3


@pytest.mark.quick(1)
@pytest.mark.parametrize("units", ["pixel", "furlong", "rad"])
def test_map_axes_in_no_length_are_refused_for_that(tmp_path: Path, units: str) -> None:
    with pytest.raises(ForcingError, match=f"the axes of the map of uo count '{units}', which is no length"):
        felt_on_map(on_map(tmp_path / "map.nc", units))


@pytest.mark.parametrize(
    ("units", "wanted", "factor"),
    [("0.01 m/s", "m s-1", 0.01), ("1e-2 m s-1", "m s-1", 0.01), ("10^-3 m", "m", 1e-3), ("100 m", "m", 100.0),
     ("10 cm", "m", 0.1), ("6 hours", "s", 21600.0), ("W/m2", "W m-2", 1.0), ("J m-2 s-1", "W m-2", 1.0)],
)  # fmt: skip
def test_numbers_before_a_unit_count(units: str, wanted: str, factor: float) -> None:
    change = unit_change(units, wanted)
    assert change is not None
    assert change[0] == pytest.approx(factor)


# Reasons


def test_bounds_that_are_no_dates_are_left_alone(tmp_path: Path) -> None:
    ds = dated(growing(HOURS / 24.0), HOURS, "hours since 2020-12-16", bounds="time_bnds")
    ds["time_bnds"] = ("time", "nv"), np.full((9, 2), 1e15)
    assert forced(written(tmp_path, ds), day(1.0))[0] == pytest.approx(0.1, abs=1e-3)


def _fails(how: str, folder: Path) -> None:
    (folder / "rubbish.nc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(2000))
    if how == "netcdf":
        netCDF4.Dataset(folder / "rubbish.nc")
    if how == "xarray":
        xr.decode_cf(xr.Dataset(coords={"time": ("time", [1e30], {"units": "hours since 2020-12-16"})}))
    if how == "json":
        json.loads("{\n\n,")
    if how == "numpy":
        np.datetime64("soon")
    if how == "pyproj":
        pyproj.CRS.from_user_input("none such")
    if how == "division":
        float(len(how) - 8) ** -1


@pytest.mark.parametrize("how", ["netcdf", "xarray", "json", "numpy", "pyproj", "division"])
def test_no_text_of_another_library_reaches_a_user(tmp_path: Path, how: str) -> None:
    with pytest.raises(ForcingError) as told, reading("a.nc", "cannot be read", "Fetch it again", ForcingError):
        _fails(how, tmp_path)
    assert str(told.value) == f"a.nc: cannot be read{' (line 3)' if how == 'json' else ''}. Fetch it again"


def test_reasons_of_the_machine_and_of_our_own_are_kept(tmp_path: Path) -> None:
    with (
        pytest.raises(ForcingError, match=r"cannot be read \(no such file or directory\)"),
        reading("a.nc", "cannot be read", "", ForcingError),
    ):
        (tmp_path / "none").open()
    with (
        pytest.raises(ForcingError, match=r"cannot be read \('foo' is not a unit"),
        reading("a.nc", "cannot be read", "", ForcingError),
    ):
        to_unit("10 foo", "m")


# Flags


@pytest.mark.quick(2)
@pytest.mark.parametrize("how", ["bytes", "signed bytes", "text", "decoded", "shorts", "per cent"])
def test_flags_without_a_valid_range_are_missing(tmp_path: Path, how: str) -> None:
    """Flags along the western edge, as NASA Team, AMSR2 and others write them, are no ice and no fault."""
    ds, path = plain(names=("uo", "vo", "ice_fraction")), tmp_path / "odd.nc"
    share = ds["ice_fraction"].values.copy()
    flags = {"decoded": [-1.0, -2.0, 3.5], "shorts": [1100, 1200, 3000]}.get(how, [251, 253, 254])
    step = {"decoded": 1.0, "shorts": 0.001, "per cent": 0.01}.get(how, 0.004)
    raw = share if how == "decoded" else np.round(share / step)
    raw[..., :3] = flags
    kind = {"decoded": "f4", "shorts": "i2", "signed bytes": "i1"}.get(how, "u1")
    ds.drop_vars("ice_fraction").to_netcdf(path)
    with netCDF4.Dataset(path, "a") as file:
        ice = file.createVariable("ice_fraction", kind, ("time", "lat", "lon"))
        ice.set_auto_maskandscale(False)
        told = {
            "standard_name": "sea_ice_area_fraction",
            "units": "%" if how == "per cent" else "1",
            "flag_meanings": "pole_hole coast land",
        }
        stored = np.array(flags).astype("u1").astype("i1") if how == "signed bytes" else np.array(flags, kind)
        told["flag_values"] = "251b, 253b, 254b" if how == "text" else stored
        ice.setncatts({**told, **({} if how in ("decoded", "per cent") else {"scale_factor": step})})
        if how == "signed bytes":
            ice.setncattr("_Unsigned", "true")
        ice[:] = raw.astype("u1").astype("i1") if how == "signed bytes" else raw.astype(kind)
    e = elements()
    box = {"longitude": (CENTRE - 3.9, CENTRE + 2.0), "latitude": (-57.5, -53.5), "hold": 24.0}
    asked = FileForcing(kind="files", files=[path.name], **box)
    forcing = forcing_from_files(asked, tmp_path, Run.of(START, 0.1, e.thickness, 850.0, melts=True))
    forcing.sample(e, 3600.0)
    np.testing.assert_allclose(e.ice_fraction, truth("ice_fraction", e.lon, e.lat), atol=6e-3)
    e.lon[:] = CENTRE - 3.8
    forcing.sample(e, 3600.0)
    assert (e.ice_fraction <= 0.4).all()


def test_masks_keep_the_values_that_they_call_flags(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    land = np.zeros((ds.sizes["lat"], ds.sizes["lon"]))
    land[:, -1] = 1.0
    told = {"standard_name": "land_binary_mask", "flag_values": np.array([0.0, 1.0]), "flag_meanings": "water land"}
    ds["mask"] = ("lat", "lon"), land, told
    field = open_product(written(tmp_path, ds))["uo"]
    assert np.isnan(field.values[..., -1]).all()
    assert np.isfinite(field.values[..., :-1]).all()


def test_a_flag_of_open_water_is_a_value(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo", "ice_fraction"))
    ds["ice_fraction"] = (ds["ice_fraction"] * 0.0).assign_attrs(
        **ds["ice_fraction"].attrs, flag_values=np.array([0.0, 2.0]), flag_meanings="open_water land"
    )
    e = elements()
    with xr.open_dataset(written(tmp_path, ds)) as file:
        DatasetForcing.from_xarray(file.load(), START).sample(e, 0.0)
    assert (e.ice_fraction == 0.0).all()


# Wave periods by the names of models


def with_period(name: str, **said: str) -> xr.Dataset:
    ds = with_waves()
    period = ds["VTM10"]
    return (
        ds.drop_vars("VTM10")
        .assign({name: period.assign_attrs({"units": "s"})})
        .assign({name: xr.DataArray(period.values, dims=period.dims, attrs={"units": "s", **said})})
    )


_MOMENT = "mean_period_from_variance_spectral_density_{}_frequency_moment"


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("VTM02", {}), ("mwp", {}), ("mp2", {}), ("t02", {}), ("Tm01", {}), ("tmm10", {}), ("mwsper", {}),
        ("t0m1", {"standard_name": f"sea_surface_wind_wave_{_MOMENT.format('inverse')}"}),
        ("t01", {"standard_name": f"sea_surface_wave_{_MOMENT.format('first')}"}),
        ("a_period", {"standard_name": f"sea_surface_wave_{_MOMENT.format('second')}"}),
        ("tz", {"standard_name": "sea_surface_wave_zero_upcrossing_period"}),
    ],
)  # fmt: skip
def test_mean_periods_by_the_names_of_models(tmp_path: Path, name: str, said: dict[str, str]) -> None:
    forcing, e = forced_by_waves(tmp_path, with_period(name, **said)), elements()
    forcing.sample(e, 3600.0)
    np.testing.assert_allclose(e.wave_period, 11.0 + 0.5 * (e.lon - CENTRE) + 0.2 * (e.lat + 55.5), atol=1e-5)


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("fp", {"units": "s-1", "standard_name": "dominant_wave_frequency"}), ("tp", {"long_name": "peak period"}),
        ("VTPK", {"standard_name": "sea_surface_wave_period_at_variance_spectral_density_maximum"}), ("pp1d", {}),
        ("perpw", {"long_name": "Primary wave mean period"}), ("RTpeak", {}),
        ("VTM01_SW1", {"standard_name": "sea_surface_primary_swell_wave_mean_period"}),
    ],
)  # fmt: skip
def test_other_periods_are_told_and_not_taken(tmp_path: Path, name: str, said: dict[str, str]) -> None:
    forcing, e = forced_by_waves(tmp_path, with_period(name, **said)), elements()
    forcing.sample(e, 3600.0)
    assert (e.wave_period == 0.0).all()
    assert (e.wave_height > 0.0).all()
    told = "\n".join(forcing.notices)
    assert f"no wave period is taken from this file; not read: {name}" in told
    assert "it follows from the height" in told


def test_a_temperature_called_like_a_period_is_none(tmp_path: Path) -> None:
    forcing, e = forced_by_waves(tmp_path, with_period("t02", units="K", long_name="temperature at 2 m")), elements()
    forcing.sample(e, 3600.0)
    assert (e.wave_period == 0.0).all()
