"""More files that mean something else than they seem to: masks, anomalies, means by the heading, lost components and scales."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from products.test_meaning import BOX, forcing_of, not_told, told, with_floor
from products.test_odd_files import CENTRE, START, arrives, elements, plain, truth, written
from riftberg import Forcing, open_product
from riftberg.errors import ForcingError
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import recognise
from riftberg.products.registry import open_named

# --- land -----------------------------------------------------------------------------------------------------------------


def with_land(ds: xr.Dataset, rows: slice, said: str, land: float, sea: float) -> xr.Dataset:
    """Return a file with zeros on land and a mask that says where land is."""
    mask = np.full((ds.sizes["lat"], ds.sizes["lon"]), sea)
    mask[rows] = land
    for name in ds.data_vars:
        ds[name] = ds[name].where(xr.DataArray(mask == sea, dims=("lat", "lon")), 0.0).assign_attrs(ds[name].attrs)
    return ds.assign(wherever=(("lat", "lon"), mask, {"standard_name": said, "units": "1"}))


MASKS = [
    ("sea_binary_mask", 0.0, 1.0),
    ("land_binary_mask", 1.0, 0.0),
    ("sea_area_fraction", 0.0, 0.4),
    ("land_area_fraction", 1.0, 0.6),
    ("sea_binary_mask", np.nan, 1.0),
]


@pytest.mark.quick(2)
@pytest.mark.parametrize(("said", "land", "sea"), MASKS)
def test_zeros_where_a_mask_says_land_are_no_still_water(tmp_path: Path, said: str, land: float, sea: float) -> None:
    """Beside a coast the berg met a mean of the current and of nothing, over land a calm."""
    beside = with_land(plain(names=("uo", "vo", "ssh")), slice(0, 6), said, land, sea)
    e, forcing = elements(), forcing_of(tmp_path, written(tmp_path, beside).name)
    forcing.sample(e, 0.0)
    north = e.lat >= -55.5
    np.testing.assert_allclose(e.uo[north], truth("uo", e.lon, e.lat)[north], atol=2e-3)
    over = with_land(plain(names=("uo", "vo", "ssh")), slice(0, 10), said, land, sea)
    with pytest.raises(ForcingError, match="is on land: no uo is known there"):
        forcing_of(tmp_path, written(tmp_path, over).name).check(elements(), 0.0, 8640.0)


CROCO = {"option_0": "land", "option_1": "water"}


@pytest.mark.parametrize(
    ("said", "attributes", "land"),
    [
        ("land_binary_mask", CROCO, 0.0),
        ("land_binary_mask", {"flag_values": np.array([0.0, 1.0]), "flag_meanings": "land water"}, 0.0),
        ("sea_binary_mask", {"flag_values": np.array([1, 0], "i1"), "flag_meanings": "land sea"}, 1.0),
        ("land_binary_mask", {"flag_meanings": "land water"}, 1.0),
        ("land_binary_mask", {"flag_values": "0, 1", "flag_meanings": "land water"}, 1.0),
    ],
)
def test_a_mask_that_says_what_its_values_mean_is_believed_over_its_standard_name(
    tmp_path: Path, said: str, attributes: dict[str, Any], land: float
) -> None:
    """CROCO calls its mask land_binary_mask, with 1 for water: the sea was dropped, and zeros on land kept."""
    ds = with_land(plain(names=("sst",)), slice(0, 6), said, land, 1.0 - land)
    ds["wherever"].attrs |= attributes
    sst = open_product(written(tmp_path, ds))["sst"].isel(time=0)
    assert np.isnan(sst[:6]).all()
    assert np.isfinite(sst[6:]).all()


def test_wind_is_known_over_land_too(tmp_path: Path) -> None:
    ds = plain(names=("ua", "va"))
    mask = np.zeros((ds.sizes["lat"], ds.sizes["lon"]))
    ds = ds.assign(mask=(("lat", "lon"), mask, {"standard_name": "sea_binary_mask"}))
    np.testing.assert_allclose(open_product(written(tmp_path, ds))["ua"], plain(names=("ua",))["ua"])


@pytest.mark.parametrize("name", ["uo", "vo", "ua", "va"])
def test_a_berg_where_one_component_is_unknown_does_not_start(tmp_path: Path, name: str) -> None:
    """Without the northward component it counted as 0."""
    ds = plain(names=("uo", "vo", "ua", "va"))
    ds[name] = ds[name].where(ds["lat"] > -53.0).assign_attrs(ds[name].attrs)
    with pytest.raises(ForcingError, match=f"is on land: no {name} is known there"):
        forcing_of(tmp_path, written(tmp_path, ds).name).check(elements(), 0.0, 8640.0)


# --- what is no sea level, and what is no metre ---------------------------------------------------------------------------


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    "said",
    [
        "sea_surface_height_above_sea_level",
        "steric_change_in_sea_surface_height",
        "thermosteric_change_in_sea_surface_height",
        "tendency_of_change_in_sea_surface_height",
    ],
)
@pytest.mark.parametrize("name", ["ssh", "zos", "zeta"])
def test_a_part_of_the_sea_level_is_not_taken_for_the_whole(tmp_path: Path, said: str, name: str) -> None:
    ds = plain(names=("uo", "vo", "ssh")).rename(ssh=name)
    ds[name].attrs = {"units": "m", "standard_name": said}
    slopes = []
    for sea in (ds, ds.drop_vars(name)):  # without a level the slope is that which balances the current
        forcing, e = forcing_of(tmp_path, written(tmp_path, sea).name), elements()
        forcing.sample(e, 0.0)
        slopes.append(e.slope_x.copy())
        assert any(f"{name} is {said}, which is none of these" in line for line in forcing.notices) == (sea is ds)
    assert (slopes[0] == slopes[1]).all()


@pytest.mark.parametrize(("factor", "units"), [(1e-3, "m"), (1e-3 / 0.3048, "feet"), (1e-3 / 1.8288, "fathoms")])
def test_a_sea_floor_of_a_few_metres_everywhere_may_be_of_kilometres(tmp_path: Path, factor: float, units: str) -> None:
    ds = with_floor("deptho", "sea_floor_depth_below_geoid", lambda x, y: factor * truth("deptho", x, y), units=units)
    ds["deptho"].attrs["units"] = units
    told(tmp_path, ds, f"although the file says {units}: are these km?")
    ds["deptho"] = (ds["deptho"] / factor).assign_attrs({**ds["deptho"].attrs, "units": "m"})
    not_told(tmp_path, ds, "are these km?")


@pytest.mark.parametrize(
    ("key", "value", "shown"),
    [
        ("scale_factor", 0.0, "0"),
        ("scale_factor", "0.0", "0"),
        ("scale_factor", np.inf, "inf"),
        ("add_offset", np.nan, "nan"),
    ],
)
def test_a_scale_that_leaves_nothing_of_the_values_is_refused(
    tmp_path: Path, key: str, value: float | str, shown: str
) -> None:
    path = written(tmp_path, plain(names=("uo", "vo")))
    with xr.open_dataset(path, decode_cf=False) as ds:
        ds = ds.load()
    ds["uo"].attrs[key] = value
    path.unlink()
    ds.to_netcdf(path)
    with pytest.raises(ForcingError, match=rf"{key} of uo is {shown}, which leaves nothing of its values"):
        open_product(path)


# --- means by the heading, months -----------------------------------------------------------------------------------------


def rising(dates: Any, stamps: Any) -> xr.Dataset:
    """Return currents whose eastward component is the day of December, with the values of some dates under others."""
    ds = plain(names=("uo", "vo")).isel(time=np.zeros(len(dates), int))
    day = (dates - np.datetime64("2020-12-01", "ns")) / np.timedelta64(1, "D")
    values = 0.01 * day[:, None, None] + 0.0 * ds["uo"].values
    ds["uo"] = (ds["uo"].dims, values, ds["uo"].attrs)
    return ds.assign_coords(time=stamps)


def of_start(folder: Path, ds: xr.Dataset) -> Any:
    asked = FileForcing(kind="files", files=[written(folder, ds).name], **{**BOX, "hold": None})
    forcing, e = forcing_from_files(asked, folder, Run.of(START, 0.1, np.full(9, 200.0), 850.0)), elements()
    forcing.sample(e, 0.0)
    return forcing, e.uo


@pytest.mark.parametrize(
    "heading",
    [
        {"title": "Daily mean fields of the ocean"},
        {"summary": "day-average of the surface"},
        {"comment": "daily averages"},
        {"id": "cmems_mod_glo_phy_my_0.25_P1D-m"},
    ],
)
def test_a_heading_that_says_daily_means_counts_as_if_each_field_said_so(
    tmp_path: Path, heading: dict[str, str]
) -> None:
    """Stamped at midnight and taken as instants, the means came half a day early."""
    stamps = np.datetime64("2020-12-12", "ns") + np.arange(9) * np.timedelta64(1, "D")
    forcing, uo = of_start(tmp_path, rising(stamps + np.timedelta64(12, "h"), stamps).assign_attrs(heading))
    np.testing.assert_allclose(uo, 0.01 * 15.25, atol=1e-6)
    assert any("are put at noon of the day that begins there" in line for line in forcing.notices)


def test_instants_under_such_a_heading_stay_where_they_are(tmp_path: Path) -> None:
    stamps = np.datetime64("2020-12-12", "ns") + np.arange(9) * np.timedelta64(1, "D")
    ds = rising(stamps, stamps).assign_attrs(title="made from daily mean winds")
    for name in ds.data_vars:
        ds[name].attrs["cell_methods"] = "time: point"
    np.testing.assert_allclose(of_start(tmp_path, ds)[1], 0.01 * 15.25, atol=1e-6)


@pytest.mark.parametrize("day", [14, 15, 16])
@pytest.mark.parametrize("by", ["heading", "cell_methods"])
def test_monthly_means_dated_near_the_middle_hold_in_the_middle(tmp_path: Path, day: int, by: str) -> None:
    months = np.array(["2020-10", "2020-11", "2020-12", "2021-01", "2021-02"], "M8[M]")
    start, end = months[:-1].astype("M8[ns]"), months[1:].astype("M8[ns]")
    ds = rising(start + (end - start) // 2, start + (day - 1) * np.timedelta64(1, "D"))
    if by == "heading":
        ds = ds.assign_attrs(title="Monthly averages")
    else:
        for name in ds.data_vars:
            ds[name].attrs["cell_methods"] = "time: mean"
    np.testing.assert_allclose(of_start(tmp_path, ds)[1], 0.01 * 15.25, atol=1e-6)


@pytest.mark.parametrize("zone", [" EST", "CET", " America/New_York", " local time", " UTC+3", " GMT-9:30"])
def test_dates_counted_from_a_zone_of_letters_are_refused(tmp_path: Path, zone: str) -> None:
    """The library leaves letters out, and takes UTC+3 as three hours west."""
    path = of_zone(tmp_path, zone)
    with pytest.raises(
        ForcingError, match=rf"time counts 'hours since 2020-12-16 00:00:00{re.escape(zone)}', in a zone"
    ):
        open_product(path)


@pytest.mark.parametrize(
    ("zone", "hours"),
    [
        ("", 0),
        ("Z", 0),
        (" UTC", 0),
        (" (UTC)", 0),
        (".0 gmt", 0),
        (" +03:00", 3),
        (" -0930", -9.5),
        (" +0300 (MSK)", 3),
    ],
)
def test_zones_in_numbers_count(tmp_path: Path, zone: str, hours: float) -> None:
    found = open_product(of_zone(tmp_path, zone))["time"].values[0]
    assert found == np.datetime64("2020-12-16T12:00") - np.timedelta64(round(3600 * hours), "s")


def of_zone(folder: Path, zone: str) -> Path:
    ds = plain(names=("uo", "vo")).drop_vars("time")
    units = {"units": f"hours since 2020-12-16 00:00:00{zone}"}
    return written(folder, ds.assign_coords(time=("time", 12.0 * np.arange(1.0, 5.0), units)))


# --- products that a file is not ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("product", ["roms", "fvcom", "wrf", "gebco"])
def test_a_product_named_for_a_file_of_another_is_named_in_the_refusal(tmp_path: Path, product: str) -> None:
    ds = plain(names=("uo", "vo"))
    for name in ds.data_vars:
        ds[name].attrs.pop("standard_name")
    path = str(written(tmp_path, ds))
    with pytest.raises(
        ForcingError, match=rf"it is named {product} and does not look like it\. Name the right product, or none"
    ):
        open_named([(path, product)])


@pytest.mark.parametrize("beside", [("uo", "vo"), ("ssh",), ("deptho",)])
def test_winds_of_era5_names_beside_fields_of_the_sea_are_not_era5(tmp_path: Path, beside: tuple[str, ...]) -> None:
    """ERA5 does not have the others, and they were left out."""
    ds = plain(names=("ua", "va", *beside)).rename(ua="u10", va="v10")
    for name in ds.data_vars:
        ds[name].attrs.pop("standard_name")
    assert recognise(written(tmp_path, ds)).name == "cf"
    assert recognise(written(tmp_path, ds[["u10", "v10"]])).name == "era5"


def test_all_fields_arrive_beside_winds_of_era5_names(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo", "ua", "va")).rename(ua="u10", va="v10")
    for name in ("u10", "v10"):
        ds[name].attrs.pop("standard_name")
    arrives(written(tmp_path, ds), ("uo", "vo", "ua", "va"))


# --- where points lie -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("branch", [lambda q: q % 360.0, lambda q: q % 360.0 - 360.0, lambda q: (q + 180) % 360 - 180])
@pytest.mark.parametrize("middle", [0.1, 179.9])
def test_an_axis_that_jumps_by_a_turn_is_one_axis(branch: Any, middle: float) -> None:
    """Depths of ROMS west of Greenwich were 'apart' from its currents."""
    lon, lat = middle + np.arange(-2.0, 2.1, 0.2), np.arange(-60.0, -55.0, 0.5)
    axes = {"lat": ("lat", lat, {"units": "degrees_north"}), "lon": ("lon", branch(lon), {"units": "degrees_east"})}
    values = np.broadcast_to(1e-3 * lon, (lat.size, lon.size))
    ds = xr.Dataset({name: (("lat", "lon"), values, {"units": "m s-1"}) for name in ("uo", "vo")}, axes)
    x, y = np.meshgrid(lon[:-1] + 0.05, lat)
    current, _ = Forcing.from_dataset(ds, "2020-12-09", uo="uo", vo="vo", sea_level="none").currents(x, y, 0.0)
    np.testing.assert_allclose(current, 1e-3 * x)


def test_components_without_a_standard_name_on_a_turned_grid_are_told_to_follow_it(tmp_path: Path) -> None:
    ds = plain(names=("uo", "vo"))
    x, y = np.meshgrid(ds["lon"] - CENTRE, ds["lat"] + 55.5)
    a = np.deg2rad(20.0)
    positions = {
        "lon": (("j", "i"), CENTRE + x * np.cos(a) - y * np.sin(a), {"units": "degrees_east"}),
        "lat": (("j", "i"), -55.5 + x * np.sin(a) + y * np.cos(a), {"units": "degrees_north"}),
    }
    turned = ds.drop_vars(["lat", "lon"]).rename(lat="j", lon="i").assign_coords(positions)
    not_told(tmp_path, turned.copy(deep=True), "is taken along its grid")
    for name in ("uo", "vo"):
        turned[name].attrs.pop("standard_name")
    told(tmp_path, turned, "uo has no standard name: it is taken along its grid", "vo has no standard name")


def test_values_that_cannot_be_read_name_their_file(tmp_path: Path) -> None:
    plain(names=("uo", "vo")).to_zarr(tmp_path / "ocean.zarr", zarr_format=2)
    for file in (tmp_path / "ocean.zarr" / "vo").iterdir():
        if not file.name.startswith(".z"):
            file.write_bytes(file.read_bytes()[:20])
    with pytest.raises(ForcingError, match=r"cf \(ocean\.zarr\): values of vo cannot be read\. .*fetch it again"):
        forcing_of(tmp_path, "ocean.zarr").check(elements(), 0.0, 8640.0)
