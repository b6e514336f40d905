"""What files say themselves about the time between their records, and which gaps between these are bridged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import DatasetForcing, build, open_product
from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import ForcingError
from riftberg.state import new_elements

MONTH_SECONDS = 30.4 * 86400.0
MONTHLY = {"time_coverage_resolution": "P1M"}


def sea(days: Any, *, means: float = 0.0, time: dict[str, str] | None = None, **attributes: str) -> xr.Dataset:
    """Return an undecoded current with records at some days of December, means over a span (days) where one is given."""
    shape = len(days), 2, 2
    named = {
        name: (
            ("time", "lat", "lon"),
            np.full(shape, 0.1),
            {"standard_name": f"{way}_sea_water_velocity", "units": "m/s"},
        )
        for name, way in (("uo", "eastward"), ("vo", "northward"))
    }
    axes = {
        "time": ("time", np.asarray(days, float), {"units": "days since 2020-12-01", **(time or {})}),
        "lat": ("lat", [-56.0, -54.0], {"units": "degrees_north"}),
        "lon": ("lon", [-40.0, -38.0], {"units": "degrees_east"}),
    }
    ds = xr.Dataset(named, axes, attributes)
    if means:
        ds["time"].attrs["bounds"] = "edges"
        ds["edges"] = ("time", "two"), np.asarray(days, float)[:, None] + [-0.5 * means, 0.5 * means]
    return ds


@pytest.mark.parametrize(
    ("stated", "name", "seconds"),
    [
        ({"time": {"delta_t": "0000-00-00 06:00:00"}}, "a.nc", 6 * 3600.0),
        ({"time": {"delta_t": "0000-01-00 00:00:00"}}, "a.nc", MONTH_SECONDS),
        ({"time_coverage_resolution": "P1D"}, "a.nc", SECONDS_PER_DAY),
        ({"time_coverage_resolution": "PT1H30M"}, "a.nc", 5400.0),
        ({"time_coverage_resolution": "P1W"}, "a.nc", 7 * SECONDS_PER_DAY),
        ({"time_coverage_resolution": "P1M"}, "a.nc", MONTH_SECONDS),
        ({"time_coverage_resolution": "PT1M"}, "a.nc", 60.0),
        ({"time_coverage_resolution": "one day"}, "a.nc", None),
        ({"time_coverage_resolution": ""}, "a.nc", None),
        ({"time_coverage_resolution": "P"}, "a.nc", None),
        ({"frequency": "1hr"}, "a.nc", 3600.0),
        ({"frequency": "3hr"}, "a.nc", 3 * 3600.0),
        ({"frequency": "6hr"}, "a.nc", 6 * 3600.0),
        ({"frequency": "day"}, "a.nc", SECONDS_PER_DAY),
        ({"frequency": "mon"}, "a.nc", MONTH_SECONDS),
        ({"title": "Monthly mean fields for product GLOBAL_MULTIYEAR_PHY_001_030"}, "a.nc", MONTH_SECONDS),
        ({"title": "daily mean fields, updated Daily"}, "a.nc", SECONDS_PER_DAY),
        ({"id": "cmems_mod_glo_phy_my_0.083deg_P1M-m"}, "a.nc", MONTH_SECONDS),
        ({}, "cmems_mod_glo_phy_my_0.083deg_P1D-m_uo.nc", SECONDS_PER_DAY),
        ({}, "mercatorglorys12v1_gl12_mean_202012.nc", MONTH_SECONDS),
        ({}, "mercatorglorys12v1_gl12_mean_20201209_R20201216.nc", SECONDS_PER_DAY),
        ({"title": "ERA5 hourly data on single levels", "time_coverage_resolution": "unknown"}, "monthly/a.nc", None),
    ],
)
def test_the_interval_that_a_file_states(
    stated: dict[str, Any], name: str, seconds: float | None, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    sea([0.5, 1.5], **stated).to_netcdf(path)
    assert open_product(path).attrs.get("stated_seconds") == (seconds and pytest.approx(seconds))


@pytest.mark.parametrize(("hours", "seconds"), [(1.0, SECONDS_PER_DAY), (24.0, 24 * SECONDS_PER_DAY)])
def test_the_interval_of_bounds_is_in_their_units(hours: float, seconds: float, tmp_path: Path) -> None:
    ds = sea([12.0, 36.0], means=24.0)
    ds["time"].attrs["units"] = f"{'hours' if hours == 1.0 else 'days'} since 2020-12-01"
    ds.to_netcdf(tmp_path / "a.nc")
    assert open_product(tmp_path / "a.nc").attrs["stated_seconds"] == seconds


def reaches(day: float, ds: xr.Dataset, **rules: Any) -> bool:
    """Whether the forcing of a dataset tells the current at a day: between records that are not too far apart, or near one."""
    forcing = DatasetForcing.from_xarray(xr.decode_cf(ds), "2020-12-01", sea_level="none", **rules)
    element = new_elements(1)
    element.place.lon[:], element.place.lat[:] = -39.0, -55.0
    try:
        forcing.sample(element, day * SECONDS_PER_DAY)
    except ForcingError as error:
        if "gap of" in str(error) or "outside the records" in str(error):
            return False
        raise
    return True


@pytest.mark.parametrize(
    ("ds", "bridged"),
    [
        (sea([1, 2, 4.5]), True),  # gaps of two and a half intervals
        (sea([1, 2, 4.51]), False),
        (sea([1, 2, 5]), False),  # of two in the middle the shorter is the interval
        (sea([1, 3, 5]), True),
        (sea([1, 5]), True),  # records five days apart
        (sea([1, 5], means=1.0), False),  # but means over a day
        (sea([1, 2, 5], **MONTHLY), False),  # closer than the file states
        (sea([1, 5], frequency="1hr"), False),
        # Two records that are 20 days apart may be snapshots of something faster; many, or what a file states, are not.
        (sea([-16, 5]), False),
        (sea([-16, 5, 26, 47, 68]), True),
        (sea([-16, 5], **MONTHLY), True),
    ],
)
def test_a_gap_is_bridged_up_to_two_and_a_half_of_the_shortest_interval_that_is_known(
    ds: xr.Dataset, bridged: bool
) -> None:
    assert reaches(4.2, ds) == bridged


def test_a_limit_of_ones_own_goes_first() -> None:
    assert not reaches(2.5, sea([1, 2, 3]), max_gap="7 s")
    assert reaches(4.0, sea([1, 2, 6]), max_gap="4 d")


@pytest.mark.parametrize(("day", "held", "without"), [(0.4, False, False), (0.6, True, False), (1.0, True, True),
                                                      (2.0, True, True), (2.4, True, False), (2.6, False, False)])  # fmt: skip
def test_the_ends_are_held_for_half_of_the_time_that_a_mean_stands_for(day: float, held: bool, without: bool) -> None:
    assert reaches(day, sea([1, 2], means=1.0)) == held
    assert reaches(day, sea([1, 2], means=1.0), hold=0.0) == without


@pytest.mark.parametrize(
    ("limit", "first", "last", "gap"),
    [
        ("2.5 d", 1.0, 10.0, "3 days between 2020-12-03T00:00 and 2020-12-06T00:00"),
        ("3 d", 1.0, 10.0, "4 days between 2020-12-07T00:00 and 2020-12-11T00:00"),
        ("2.5 d", 5.0, 6.0, ""),
        ("2.5 d", 4.9, 6.0, "3 days between 2020-12-03T00:00 and 2020-12-06T00:00"),
        ("3 d", 1.0, 6.0, ""),
    ],
)
def test_gaps_that_touch_a_run_are_refused_before_it(limit: str, first: float, last: float, gap: str) -> None:
    """Bug: one within the run, from the record before it to the one behind it, was met on the way."""
    forcing = DatasetForcing.from_xarray(
        xr.decode_cf(sea([1, 2, 5, 6, 10])), "2020-12-01", sea_level="none", max_gap=limit
    )
    element = new_elements(1)
    element.place.lon[:], element.place.lat[:] = -39.0, -55.0
    if gap:
        with pytest.raises(ForcingError, match=gap):
            forcing.check(element, first * SECONDS_PER_DAY, last * SECONDS_PER_DAY)
    else:
        forcing.check(element, first * SECONDS_PER_DAY, last * SECONDS_PER_DAY)


@pytest.mark.parametrize("levels", [False, True])
def test_empty_records_are_found_whatever_row_has_the_values(levels: bool, tmp_path: Path) -> None:
    """Against looking at everything: rows are read one by one only to be fast; of levels the uppermost counts."""
    rng = np.random.default_rng(3)
    values = np.where(rng.random((40, 5, 6)) < 0.04, 1.0, np.nan)
    expected = np.isfinite(values).any(axis=(1, 2))
    assert 0 < expected.sum() < 40
    ds = sea(np.arange(40)).isel(lat=[0] * 5, lon=[0] * 6)
    ds = ds.assign_coords(
        lat=("lat", -56.0 + np.arange(5), ds["lat"].attrs), lon=("lon", np.arange(6.0), ds["lon"].attrs)
    )
    for name in ("uo", "vo"):
        ds[name] = ds[name].copy(data=values)
        if levels:
            deep = xr.concat([ds[name], xr.full_like(ds[name], 1.0)], dim="depth").transpose(
                "time", "depth", "lat", "lon"
            )
            ds = ds.drop_vars(name).assign({name: deep})
    if levels:
        ds["depth"] = "depth", [0.5, 10.0], {"units": "m", "standard_name": "depth", "positive": "down"}
    ds.to_netcdf(tmp_path / "a.nc")
    (tmp_path / "e.yaml").write_text(
        "start: 2020-12-20\ndays: 1\nberg: {rectangle: {length: 12 km, width: 6 km}, placement: [2.5, -54.5]}\n"
        "forcing: {kind: files, files: [a.nc], longitude: [0, 5], latitude: [-56, -52], max_gap: 240, sea_level: none,\n"
        "  wind: none}\n"
    )
    around = 9 + np.flatnonzero(expected[9:31])  # ten days before and behind are looked at, the longest gap
    first, last = (f"2020-12-{1 + day:02}T00:00" for day in around[[0, -1]])
    described = build(str(tmp_path / "e.yaml"))[0].forcing.describe()
    assert f"{around.size} records from {first} to {last}" in described
    assert f"{22 - around.size} record(s) without any value of uo, vo count as missing" in described
