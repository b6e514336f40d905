"""Dates, means, overlapping files and grid files beside: right, refused for the true reason, or told before the run.

The current grows by 0.1 m/s a day everywhere, so that a wrong date shows in its value.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from products.probe import at_points
from products.test_models import CENTRE, roms
from products.test_odd_files import AIR, plain, refused, truth, written
from products.test_odd_files import elements as around
from riftberg import DatasetForcing, open_product, read_observed
from riftberg.errors import ForcingError, InputError
from riftberg.ocean.doctor import doctor
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing
from riftberg.products import open_all

DAY_0 = datetime(2020, 12, 16)
UO_VO = ("uo", "vo")


def growing(days: Any, names: tuple[str, ...] = UO_VO, offset: float = 0.0) -> xr.Dataset:
    """Fields of days after `DAY_0`, each that of its day; without dates, which every test writes in its own way."""
    ds = plain(names=names).isel(time=0, drop=True)
    grown = xr.DataArray(0.1 * np.asarray(days, float) + offset, dims="time")
    for name in names:
        told = ds[name].attrs
        ds[name] = (ds[name] + grown).transpose("time", ...).assign_attrs(told)
    return ds


def dated(ds: xr.Dataset, values: Any, units: str = "days since 2020-12-16", **attributes: Any) -> xr.Dataset:
    return ds.assign_coords(time=("time", np.asarray(values, float), {"units": units, **attributes}))


def forced(
    files: Path | Sequence[Path], start: datetime, hours: float = 0.0, centre: float = CENTRE, **options: Any
) -> tuple[float, str]:
    """Return by how much a run's current has grown at its start plus some hours, and what the run says beforehand."""
    files = [files] if isinstance(files, Path) else list(files)
    asked = FileForcing(
        kind="files", files=[path.name for path in files], longitude=(centre - 2.0, centre + 2.0),
        latitude=(-57.5, -53.5), **options,
    )  # fmt: skip
    e = around(centre)
    forcing = forcing_from_files(asked, files[0].parent, Run.of(start, hours / 24.0, e.thickness, 850.0))
    forcing.check(e, 0.0, 3600.0 * hours)
    forcing.sample(e, 3600.0 * hours)
    grown = e.uo - truth("uo", e.lon, e.lat, centre)
    assert np.ptp(grown) < 5e-3
    return float(grown.mean()), "\n".join(forcing.notices)


def day(number: float) -> datetime:
    return DAY_0 + timedelta(days=number)


# Years that dates to the nanosecond cannot hold


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("units", "calendar", "first"),
    [
        ("seconds since 0001-01-01", "360_day", 4.2e7),
        ("days since 0001-01-01", "noleap", 99 * 365),
        ("days since 0001-01-01", "noleap", 2599 * 365),
        ("days since 2600-01-01", "standard", 0),
        ("days since 1600-01-01", "proleptic_gregorian", 0),
        ("hours since 0200-01-01", "all_leap", 0),
        ("days since 1582-01-01", "julian", 0),
    ],
)
def test_model_years_do_not_come_back_as_ours(tmp_path: Path, units: str, calendar: str, first: float) -> None:
    ds = dated(growing(np.arange(400)), first + np.arange(400), units, calendar=calendar)
    path = written(tmp_path, ds)
    refused(path, "outside the years 1678 to 2261", "dates, the first ")
    with pytest.raises(ForcingError, match="outside the years 1678 to 2261"):
        forced(path, datetime(2015, 6, 14))


def test_dates_as_text_of_another_age(tmp_path: Path) -> None:
    ds = growing(np.arange(4)).assign_coords(time=("time", [f"2600-01-0{k}T00:00" for k in range(1, 5)]))
    refused(written(tmp_path, ds), "2600-01-01", "outside the years 1678 to 2261")


def test_heading_and_lead_time_of_another_age(tmp_path: Path) -> None:
    still = growing([0.0]).isel(time=0, drop=True)
    heading = still.assign_attrs(time_coverage_start="2600-01-01T00:00Z", time_coverage_end="2600-01-02T00:00Z")
    refused(written(tmp_path, heading), "2600-01-01T12:00", "outside the years")
    issued = {"units": "hours since 2020-12-16", "standard_name": "forecast_reference_time"}
    ahead = still.assign_coords(forecast_reference_time=((), 0.0, issued), step=((), 5.2e6, {"units": "hours"}))
    refused(written(tmp_path, ahead), "outside the years")


@pytest.mark.quick(2)
@pytest.mark.parametrize(("year", "right"), [(1679, True), (2260, True), (1677, False), (2262, False)])
def test_years_at_the_edge(tmp_path: Path, year: int, right: bool) -> None:
    path = written(tmp_path, dated(growing(np.arange(4)), np.arange(4), f"days since {year}-06-01"))
    if right:
        assert forced(path, datetime(year, 6, 2, 12))[0] == pytest.approx(0.15, abs=1e-3)
    else:
        refused(path, f"{year}-06-01")


def test_centuries_between_records_are_a_gap(tmp_path: Path) -> None:
    """More than 292 years apart, the difference of two dates is beyond nanoseconds and came back negative."""
    path = written(tmp_path, dated(growing(np.arange(2)), [0.0, 146_097.0], "days since 1800-01-01"))
    with pytest.raises(ForcingError, match=r"gap of 1.46e\+05 days"):
        forced(path, datetime(2020, 12, 16))


def test_limits_of_centuries_do_not_turn_round(tmp_path: Path) -> None:
    path = written(tmp_path, dated(growing(np.arange(4)), np.arange(4)))
    assert forced(path, day(1.0), 12.0, max_gap=2.6e6, hold=2.6e6)[0] == pytest.approx(0.15, abs=1e-3)
    assert forced(path, day(40.0), hold=2.6e6)[0] == pytest.approx(0.3, abs=1e-3)


def test_starts_and_observations_of_another_age(tmp_path: Path) -> None:
    path = written(tmp_path, dated(growing(np.arange(4)), np.arange(4)))
    with xr.open_dataset(path) as ds, pytest.raises(ForcingError, match=r"2605-07-07.* outside the years"):
        DatasetForcing.from_xarray(ds.load(), "2605-07-07")
    assert "outside the years" in doctor([path], time=("2605-07-07", "2605-07-08")).text()
    for number, when in enumerate(("2605-07-07", "26050707", "2605188")):
        table = tmp_path / f"track{number}.csv"
        table.write_text(f"date,lat,lon\n{when},-55.0,-39.0\n")
        with pytest.raises(InputError, match=r"2605-07-07.* outside the years 1678 to 2261"):
            read_observed(table)


# Means


def monthly(how: str) -> xr.Dataset:
    """Monthly means of November to January of the growing field, written in one of the usual ways."""
    firsts = np.array(["2020-11-01", "2020-12-01", "2021-01-01", "2021-02-01"], "M8[D]")
    edges = (firsts - np.datetime64("2020-12-16")).astype(float)
    ds = growing(0.5 * (edges[1:] + edges[:-1]))
    stamps = {"first": edges[:-1], "last": edges[1:] - 1.0, "noon of the first": edges[:-1] + 0.5}
    ds = dated(ds, stamps.get(how, edges[:-1]))
    for name in ds.data_vars:
        how_said = {"GRIB_stepType": "avgua"} if how == "grib" else {"cell_methods": "area: time: mean"}
        ds[name].attrs |= how_said if how != "unsaid" else {}
    return ds


@pytest.mark.quick(2)
@pytest.mark.parametrize("how", ["first", "last", "noon of the first", "grib"])
def test_monthly_means_without_bounds_stand_in_mid_month(tmp_path: Path, how: str) -> None:
    path = written(tmp_path, monthly(how))
    for when in (-10.0, 0.0, 10.0):
        assert forced(path, day(when))[0] == pytest.approx(0.1 * when, abs=1e-3)
    # The last is held to the end of its month, not beyond.
    grown, said = forced(path, datetime(2021, 1, 31, 18))
    assert grown == pytest.approx(3.15, abs=1e-3)
    assert "are put in mid-month" in said
    assert "are put in mid-month" in doctor([path], needed=()).text()
    with pytest.raises(ForcingError, match="outside the records"):
        forced(path, datetime(2021, 2, 1, 1))


def test_months_of_wind_from_the_climate_data_store(tmp_path: Path) -> None:
    ds = monthly("grib").rename(uo="u10", vo="v10", time="valid_time", lat="latitude", lon="longitude")
    for name in ("u10", "v10"):
        ds[name].attrs["standard_name"] = "unknown"
    ds["valid_time"].attrs["standard_name"] = "time"
    [wind] = open_all(written(tmp_path, ds.assign_attrs(GRIB_centre="ecmf")))
    assert wind.attrs["product"] == "era5"
    e = around(CENTRE)
    at = at_points(wind, e.lon.reshape(3, 3), e.lat.reshape(3, 3), ["2020-12-26"])["ua"].values[0]
    np.testing.assert_allclose(at.ravel() - truth("uo", e.lon, e.lat, CENTRE), 1.0, atol=1e-3)


def test_months_by_hour_of_the_day_are_refused(tmp_path: Path) -> None:
    ds = growing(np.zeros(8))
    for name in ds.data_vars:
        ds[name].attrs["GRIB_stepType"] = "avgid"
    hours = np.concatenate([month + np.arange(0.0, 24.0, 6.0) for month in (0.0, 744.0)])
    refused(written(tmp_path, dated(ds, hours, "hours since 2020-12-01")), "monthly means by hour of the day")


def test_months_that_say_nothing_are_told(tmp_path: Path) -> None:
    grown, said = forced(written(tmp_path, monthly("unsaid")), datetime(2020, 12, 1))
    assert grown == pytest.approx(0.05, abs=1e-3)  # the value that stands at that date, and a doubt
    assert "are they means?" in said


@pytest.mark.parametrize(("hour", "middle"), [(0.0, 0.5), (12.0, 0.5)])
def test_daily_means_hold_at_noon(tmp_path: Path, hour: float, middle: float) -> None:
    ds = growing(np.arange(4) + middle)
    for name in ds.data_vars:
        ds[name].attrs["cell_methods"] = "time: mean (interval: 1 day)"
    path = written(tmp_path, dated(ds, np.arange(4) + hour / 24.0))
    grown, said = forced(path, day(1.25))
    assert grown == pytest.approx(0.125, abs=1e-3)
    assert ("put at noon" in said) == (hour == 0.0)
    assert "means over the time of another" not in said
    assert forced(path, day(0.1))[0] == pytest.approx(0.05, abs=1e-3)  # held from the beginning of its day
    assert forced(path, day(3.9))[0] == pytest.approx(0.35, abs=1e-3)


def two_files(folder: Path, *parts: xr.Dataset) -> list[Path]:
    """Write means of the same fields to two files."""
    paths = [folder / f"{number}.nc" for number in range(len(parts))]
    for path, ds in zip(paths, parts, strict=True):
        for name in UO_VO:
            ds[name].attrs["cell_methods"] = "time: mean"
        ds.to_netcdf(path)
    return paths


@pytest.mark.parametrize("turned", [False, True])
def test_of_the_lengths_that_joined_files_state_the_shortest_is_that_of_their_means(
    tmp_path: Path, turned: bool
) -> None:
    """Days with gaps are days, also where another file says less."""
    first = dated(growing([0.5, 2.5]), [0.0, 2.0]).assign_attrs(frequency="day")
    second = dated(growing([4.5, 6.5]), [4.0, 6.0]).assign_attrs(time_coverage_resolution="P5D")
    paths = two_files(tmp_path, first, second)
    grown, said = forced(paths[::-1] if turned else paths, day(3.0))
    assert grown == pytest.approx(0.3, abs=1e-3)
    assert "put at noon" in said


def test_two_means_over_the_same_month_are_told_and_the_first_is_taken(tmp_path: Path) -> None:
    """Months stamped at the beginning and at noon of their first day, of which one is in both files."""
    first = dated(growing([0.0, 3.0]), [-15.0, 16.0])
    second = dated(growing([20.0, 30.0]), [16.5, 47.5])
    grown, said = forced(two_files(tmp_path, first, second), day(31.5))
    assert "1 record(s) are means over the time of another: the first is taken" in said
    assert grown == pytest.approx(0.3, abs=1e-3)


@pytest.mark.parametrize(("hours", "told"), [(6.0, True), (24.0 * 5, True)])
def test_other_means_without_bounds_are_told(tmp_path: Path, hours: float, told: bool) -> None:
    ds = growing(np.arange(4) * hours / 24.0)
    for name in ds.data_vars:
        ds[name].attrs["cell_methods"] = "time: mean"
    grown, said = forced(written(tmp_path, dated(ds, hours * np.arange(4) / 24.0)), day(0.1))
    assert grown == pytest.approx(0.01, abs=1e-3)
    assert ("without bounds are taken as values of their stamps" in said) is told


def bounded(edges: Any, at: str, units: str = "days since 2020-12-16", **attributes: Any) -> xr.Dataset:
    edges = np.asarray(edges, float)
    stamps = {"begin": edges[:, 0], "end": edges[:, 1], "near": edges.mean(1) + 0.4, "middle": edges.mean(1)}[at]
    ds = dated(growing(edges.mean(1)), stamps, units, bounds="time_bnds", **attributes)
    for name in UO_VO:
        ds[name].attrs["cell_methods"] = "time: mean"
    ds["time_bnds"] = (("time", "nv"), edges)
    return ds


@pytest.mark.quick(2)
@pytest.mark.parametrize("at", ["begin", "end", "near", "middle"])
def test_one_mean_with_bounds_is_held_over_them(tmp_path: Path, at: str) -> None:
    path = written(tmp_path, bounded([[-15.0, 16.0]], at))
    for when in (-14.9, 0.0, 15.9):
        assert forced(path, day(when))[0] == pytest.approx(0.05, abs=1e-3)
    for when in (-15.2, 16.2):
        with pytest.raises(ForcingError, match="outside the records"):
            forced(path, day(when))
    assert "ends" not in doctor([path], needed=(), time=("2020-12-02", "2020-12-31")).text()


def test_each_end_is_held_for_its_own_length(tmp_path: Path) -> None:
    """A month of 31 days, one of 28: the usual length is right for neither. In a file each."""
    for number, edges in enumerate(([-15.0, 16.0], [16.0, 44.0])):
        written(tmp_path, bounded([edges], "middle")).rename(tmp_path / f"month{number}.nc")
    files = sorted(tmp_path.glob("month*.nc"))
    assert forced(files, day(-14.9))[0] == pytest.approx(0.05, abs=1e-3)
    assert forced(files, day(43.9))[0] == pytest.approx(3.0, abs=1e-3)
    with pytest.raises(ForcingError, match="outside the records"):
        forced(files, day(44.5))


def test_means_of_a_model_calendar_stamped_at_their_ends(tmp_path: Path) -> None:
    """CESM: noleap, stamped at the end, and the first record has bounds without width."""
    begin = 2019 * 365 + 334 + 15.0  # 16 December 2020 without leap days
    edges = begin + np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 2.0], [2.0, 3.0]])
    ds = bounded(edges, "end", "days since 0001-01-01", calendar="noleap")
    for name in UO_VO:
        ds[name] = ds[name] - 0.1 * begin + 0.0 * ds[name]
        ds[name].attrs = growing([0.0])[name].attrs | {"cell_methods": "time: mean"}
    path = written(tmp_path, ds)
    assert forced(path, day(1.75))[0] == pytest.approx(0.175, abs=1e-3)
    assert forced(path, day(2.9))[0] == pytest.approx(0.25, abs=1e-3)


def test_instants_with_bounds_stay_at_their_stamps(tmp_path: Path) -> None:
    ds = bounded([[k, k + 1.0] for k in range(4)], "begin")
    for name in UO_VO:
        ds[name].attrs["cell_methods"] = "time: point"
    assert forced(written(tmp_path, ds), day(1.0))[0] == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize(("factor", "shift"), [(0.0, 0.0), (1.0, 700.0), (-1.0, 0.0)])
def test_bounds_that_do_not_hold_their_dates_are_not_believed(tmp_path: Path, factor: float, shift: float) -> None:
    ds = bounded([[k, k + 1.0] for k in range(4)], "middle")
    ds["time_bnds"] = factor * ds["time_bnds"] + shift
    path = written(tmp_path, ds)
    assert forced(path, day(1.0))[0] == pytest.approx(0.1, abs=1e-3)


# Files that overlap


def forecasts(folder: Path, step: float = 0.25, names: tuple[str, ...] = UO_VO) -> list[Path]:
    """Two forecasts of four days, the second a day later and another by 2 m/s."""
    files = [folder / name for name in ("issued_16.nc", "issued_17.nc")]
    for first, (path, by) in enumerate(zip(files, (0.25, step), strict=True)):
        days = first + np.arange(0.0, 4.0, by)
        dated(growing(days, names, 2.0 * first), days).to_netcdf(path)
    return files


@pytest.mark.quick(1)
@pytest.mark.parametrize("step", [0.25, 0.5])
def test_of_two_forecasts_the_one_named_later_counts(tmp_path: Path, step: float) -> None:
    first, second = forecasts(tmp_path, step)
    grown, said = forced([first, second], day(2.25))
    assert grown == pytest.approx(2.225, abs=1e-3)  # also between records that only the first has
    assert "share dates" in said
    assert "issued_17.nc over issued_16.nc" in said
    grown, said = forced([second, first], day(2.25))
    assert grown == pytest.approx(0.225, abs=1e-3)
    assert "issued_16.nc over issued_17.nc" in said
    assert forced([second, first], day(4.25))[0] == pytest.approx(2.425, abs=1e-3)  # beyond the first
    assert "issued_17.nc over issued_16.nc" in doctor([first, second], needed=()).text()


def test_a_file_with_a_field_beside_those_that_overlap(tmp_path: Path) -> None:
    """The sea level is named last and lies on the grid of the first currents: these count no later for it."""
    files = forecasts(tmp_path)
    days = np.arange(0.0, 4.0, 0.25)
    with xr.open_dataset(files[0], decode_times=False) as ds:
        level = ds.load()[["uo"]].rename(uo="ssh")
    level["ssh"] = (0.0 * level["ssh"]).assign_attrs(standard_name="sea_surface_height_above_geoid", units="m")
    level.to_netcdf(tmp_path / "level.nc")
    other = dated(growing(days, offset=2.0), days).isel(lon=slice(1, None))
    other.to_netcdf(tmp_path / "other_grid.nc")
    assert forced([files[0], tmp_path / "other_grid.nc", tmp_path / "level.nc"], day(1.0))[0] == pytest.approx(
        2.1, abs=1e-3
    )
    assert forced([tmp_path / "other_grid.nc", files[0], tmp_path / "level.nc"], day(1.0))[0] == pytest.approx(
        0.1, abs=1e-3
    )


def test_three_forecasts_of_wind(tmp_path: Path) -> None:
    for issued in range(3):
        days = issued + np.arange(0.0, 4.0, 0.25)
        dated(growing(days, AIR, float(issued)), days).to_netcdf(tmp_path / f"wind_{issued}.nc")
    wind = open_product(str(tmp_path / "wind_*.nc"))
    level = wind["ua"].isel(lat=0, lon=0).values - wind["ua"].isel(lat=0, lon=0, time=0).values
    days = (wind["time"].values - np.datetime64(DAY_0)) / np.timedelta64(1, "D")
    np.testing.assert_allclose(level, 0.1 * days + np.minimum(np.floor(days), 2.0), atol=1e-6)


def test_files_that_follow_or_complete_one_another_are_not_told(tmp_path: Path) -> None:
    for name, days in (("even", np.arange(0.0, 4.0)), ("odd", np.arange(0.5, 4.0)), ("next", np.arange(4.0, 6.0))):
        dated(growing(days), days).to_netcdf(tmp_path / f"{name}.nc")
    grown, said = forced([tmp_path / f"{name}.nc" for name in ("odd", "next", "even")], day(2.25))
    assert grown == pytest.approx(0.225, abs=1e-3)
    assert "share dates" not in said


@pytest.mark.parametrize("later", ["coarse", "fine"])
def test_of_files_on_two_grids_the_one_named_later_counts(tmp_path: Path, later: str) -> None:
    """The first of three files shares its grid with the last: the group counted as early as its first file."""
    days = np.arange(4.0)
    dated(growing(days), days).to_netcdf(tmp_path / "coarse_a.nc")
    dated(growing(days + 4.0), days + 4.0).to_netcdf(tmp_path / "coarse_b.nc")
    dated(growing(np.arange(8.0), offset=2.0), np.arange(8.0)).isel(lon=slice(1, None)).to_netcdf(tmp_path / "fine.nc")
    names = {"coarse": ("coarse_a", "fine", "coarse_b"), "fine": ("coarse_a", "coarse_b", "fine")}[later]
    grown, said = forced([tmp_path / f"{name}.nc" for name in names], day(1.0))
    assert grown == pytest.approx(0.1 if later == "coarse" else 2.1, abs=1e-3)
    assert "uo, vo are taken from here and not from" in said
    assert "which is named earlier" in said


# Grid files beside


def current_of(path: Path) -> tuple[float, str]:
    """Return the eastward current 5 m below the surface, at the centre, of a ROMS file, and what is told of it."""
    [ds] = [part for part in open_all(path) if "uo" in part]
    found = at_points(ds[["uo", "vo"]].assign_attrs(ds.attrs), np.array([[CENTRE]]), np.array([[-55.5]]))
    return float(found["uo"].sel(depth=5.0).squeeze()), str(ds.attrs.get("told", ""))


def moved(folder: Path, name: str, **changes: Any) -> None:
    """Put the grid of another domain, 3 degrees to the east, into a folder."""
    with xr.open_dataset(folder / "model_grd.nc") as grid:
        other = grid.load()
    for axis in ("lon_rho",):
        other[axis] = other[axis] + 3.0
    other.assign({n: other[n] + by for n, by in changes.items()}).to_netcdf(folder / name)


def test_the_grid_beside_is_named(tmp_path: Path) -> None:
    [path] = roms(tmp_path, grid_apart=True)
    value, told = current_of(path)
    assert "grid file model_grd.nc, of the same size" in told
    assert "model_grd.nc" in doctor([path], needed=()).text()
    moved(tmp_path, "background.nc")
    # Its times are none, and no more are those of neighbours; others cannot be read, or have names that only sound like grids.
    for name in ("model_grd.nc", "a_grid.nc"):
        with netCDF4.Dataset(tmp_path / name, "a" if name == "model_grd.nc" else "w") as file:
            file.createDimension("time", 1)
            units = {"units": "seconds since 2016-01-01", "calendar": "none such"}
            file.createVariable("time", "f8", ("time",)).setncatts(units)
    (tmp_path / "b_grid.nc").write_bytes(b"CDF\x01 no more")
    assert current_of(path) == (value, told)


def test_two_grids_that_fit_are_refused(tmp_path: Path) -> None:
    [path] = roms(tmp_path, grid_apart=True)
    moved(tmp_path, "aaa_grd.nc")
    with pytest.raises(ForcingError, match=r"2 different grids beside it fit: aaa_grd.nc, model_grd.nc"):
        open_all(path)
    shutil.copy(tmp_path / "model_grd.nc", tmp_path / "aaa_grd.nc")  # a copy is no other grid
    assert "aaa_grd.nc" in current_of(path)[1]


@pytest.mark.quick(1)
@pytest.mark.parametrize("by", ["h", "mask_rho", "grd_file"])
def test_the_grid_is_known_by_what_the_file_repeats(tmp_path: Path, by: str) -> None:
    [path] = roms(tmp_path, grid_apart=True)
    value, _ = current_of(path)
    with xr.open_dataset(tmp_path / "model_grd.nc") as grid, xr.open_dataset(path) as ds:
        grid, ds = grid.load(), ds.load()
    mask = xr.DataArray(np.ones((50, 50)), dims=("eta_rho", "xi_rho"))
    mask[0, :3] = 0.0
    path.unlink(), (tmp_path / "model_grd.nc").unlink()
    grid.assign(mask_rho=mask).to_netcdf(tmp_path / "model_grd.nc")
    if by == "grd_file":
        ds = ds.assign_attrs(grd_file="/somewhere/else/model_grd.nc")
    else:
        ds[by] = mask if by == "mask_rho" else grid["h"]
    ds.to_netcdf(path)
    moved(tmp_path, "aaa_grd.nc", h=50.0, mask_rho=1.0 - 2.0 * mask)
    assert current_of(path)[0] == pytest.approx(value, abs=1e-9)
    (tmp_path / "model_grd.nc").unlink()
    reason = "which is not beside it" if by == "grd_file" else "those of another grid, or cannot be read: aaa_grd.nc"
    with pytest.raises(ForcingError, match=reason):
        open_all(path)


def test_hourly_files_of_the_experiment_beside_two_grids(tmp_path: Path) -> None:
    lat, lon = np.meshgrid(-58.0 + np.arange(5.0), -40.0 + np.arange(6.0), indexing="ij")
    grid = xr.Dataset({"longitude": (("j", "i"), lon), "latitude": (("j", "i"), lat)})
    grid.to_netcdf(tmp_path / "a68_grid.nc")
    grid.isel(i=slice(1, None)).to_netcdf(tmp_path / "a_grid.nc")  # another size
    fields = {name: (("time", "lat", "lon"), np.full((3, 5, 6), 0.25)) for name in UO_VO}
    path = tmp_path / "dec2020_HOURLY_a68.nc"
    xr.Dataset(fields).to_netcdf(path)
    [ds] = open_all(path)
    np.testing.assert_allclose(ds["lon"], -40.0 + np.arange(6.0))
    assert "a68_grid.nc" in ds.attrs["told"]
    grid.assign(longitude=grid["longitude"] + 3.0).to_netcdf(tmp_path / "b_grid.nc")
    with pytest.raises(ForcingError, match="2 different grids beside it fit"):
        open_all(path)


# ROMS on straight axes


def straight(path: Path, *, axes: bool, levels: bool = True) -> Path:
    """A ROMS C grid along the meridians, its positions on axes or point by point; speed falls to a half at 200 m."""
    s = np.array([-0.875, -0.625, -0.375, -0.125, -0.005])
    up, shape = (("s_rho",), (1.0 + s)[:, None, None]) if levels else ((), 1.0)
    ds = xr.Dataset(
        {"h": (("eta_rho", "xi_rho"), 400.0 + 2.0 * np.mgrid[0:50, 0:49][1]), "hc": ((), 20.0), "Vtransform": ((), 2)}
    )
    ds["Cs_r"] = ("s_rho", s)
    for point, rows, columns in (("rho", 50, 49), ("u", 50, 48), ("v", 49, 49)):
        lat = -58.0 + 0.1 * (np.arange(rows) + (0.5 if point == "v" else 0.0))
        lon = -41.4 + 0.1 * (np.arange(columns) + (0.5 if point == "u" else 0.0))
        dims = f"eta_{point}", f"xi_{point}"
        x, y = np.meshgrid(lon, lat)
        for name, own, grid in (("lat", lat, y), ("lon", lon, x)):
            told = {"units": f"degrees_{'north' if name == 'lat' else 'east'}"}
            ds[f"{name}_{point}"] = (
                ((dims[0] if name == "lat" else dims[1],), own, told) if axes else (dims, grid, told)
            )
        if point != "rho":
            name = "uo" if point == "u" else "vo"
            values = shape * truth(name, x, y, CENTRE)
            ds[point] = (("ocean_time", *up, *dims), values[None], {"units": "meter second-1"})
    words = {
        "standard_name": "ocean_s_coordinate_g2",
        "positive": "up",
        "formula_terms": "s: s_rho C: Cs_r depth: h depth_c: hc",
    }
    ds = ds.assign_coords(
        ocean_time=np.array(["2020-12-16T07:00"], "M8[ns]"), **({"s_rho": ("s_rho", s, words)} if levels else {})
    )
    ds.set_coords([name for name in ds.data_vars if str(name)[:3] in ("lat", "lon")]).to_netcdf(path)
    return path


@pytest.mark.parametrize("levels", [True, False])
def test_roms_on_straight_axes_reads_as_point_by_point(tmp_path: Path, levels: bool) -> None:
    e = around(CENTRE)
    found = []
    for axes in (True, False):
        [ds] = [part for part in open_all(straight(tmp_path / f"{axes}.nc", axes=axes, levels=levels)) if "uo" in part]
        at = at_points(ds[["uo", "vo"]].assign_attrs(ds.attrs), e.lon.reshape(3, 3), e.lat.reshape(3, 3))
        for depth in (5.0, 200.0) if levels else (None,):
            part = at if depth is None else at.sel(depth=depth)
            share = 1.0 if depth is None else 1.0 - depth / (400.0 + 2.0 * (e.lon.reshape(3, 3) + 41.4) / 0.1)
            for name in UO_VO:
                np.testing.assert_allclose(
                    part[name][0], share * truth(name, e.lon, e.lat, CENTRE).reshape(3, 3), atol=3e-3
                )
        found.append(at["uo"].values)
    np.testing.assert_allclose(*found, atol=1e-3)


def test_straight_axes_with_as_many_rows_as_columns(tmp_path: Path) -> None:
    """Points of u and of the cells then differ in nothing but a single column."""
    with xr.open_dataset(straight(tmp_path / "a.nc", axes=True)) as ds:
        ds.isel(eta_rho=slice(0, 49), eta_u=slice(0, 49), eta_v=slice(0, 48)).to_netcdf(tmp_path / "b.nc")
    value, _ = current_of(tmp_path / "b.nc")
    assert value == pytest.approx((1.0 - 5.0 / 448.0) * float(truth("uo", CENTRE, -55.5)), abs=2e-3)


# False reasons


@pytest.mark.parametrize("calendar", ["gregorian_proleptic", "no_leap", "360-day", "Proleptic Gregorian"])
def test_calendars_in_other_letters(tmp_path: Path, calendar: str) -> None:
    first = {"no_leap": 349, "360-day": 345}.get(calendar, 350)
    ds = dated(growing(np.arange(4)), first + np.arange(4), "days since 2020-01-01", calendar=calendar)
    assert forced(written(tmp_path, ds), day(1.5))[0] == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize("calendar", ["mayan", "gregorain"])
def test_a_calendar_that_nobody_knows_is_named(tmp_path: Path, calendar: str) -> None:
    path = written(tmp_path, dated(growing(np.arange(4)), np.arange(4), calendar=calendar))
    with pytest.raises(ForcingError, match=f"in a calendar '{calendar}'"):
        forced(path, day(1.0))
    assert f"in a calendar '{calendar}'" in doctor([path], needed=()).text()


def test_dates_beside_that_cannot_be_decoded_spoil_no_others(tmp_path: Path) -> None:
    ds = dated(growing(np.arange(4)), np.arange(4))
    ds["began"] = ("time", np.zeros(4), {"units": "days since 2020-01-01", "calendar": "mayan"})
    ds["ended"] = ("other", np.zeros(2), {"units": "fortnights since 2020-01-01"})
    assert forced(written(tmp_path, ds), day(1.5))[0] == pytest.approx(0.15, abs=1e-3)


def test_times_of_scan_lines_date_no_records(tmp_path: Path) -> None:
    ds = dated(growing(np.arange(4)), np.arange(4))
    ds = ds.assign_coords(scan_time=("lat", np.arange(float(ds.sizes["lat"])), {"units": "s", "standard_name": "time"}))
    assert forced(written(tmp_path, ds), day(1.5))[0] == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize("how", ["no variable", "missing", "start and length"])
def test_the_heading_dates_a_single_record(tmp_path: Path, how: str) -> None:
    """DUACS: a dimension of time of length 1 without a date, which the heading tells."""
    ds = growing([0.5])
    if how == "missing":
        ds = ds.assign_coords(time=("time", [np.nan], {"units": "days since 1950-01-01"}))
    ds = ds.assign_attrs(time_coverage_start="2020-12-16T00:00:00Z", time_coverage_duration="P1D")
    if how != "start and length":
        ds = ds.assign_attrs(time_coverage_end="2020-12-17T00:00:00Z")
    path = written(tmp_path, ds)
    assert forced(path, day(0.5), hold=1.0)[0] == pytest.approx(0.05, abs=1e-3)
    with pytest.raises(ForcingError, match=r"records 2020-12-16T12:00\.\.2020-12-16T12:00"):
        forced(path, day(2.0))


@pytest.mark.parametrize("name", ["time_centered", "time_instant", "valid"])
def test_records_numbered_by_one_variable_and_dated_by_another(tmp_path: Path, name: str) -> None:
    ds = growing(np.arange(4)).rename(time="time_counter").assign_coords(time_counter=np.arange(4.0))
    told = {"units": "days since 2020-12-16", "standard_name": "time"}
    ds = ds.assign_coords({name: ("time_counter", np.arange(4.0), told)})
    assert forced(written(tmp_path, ds), day(1.5))[0] == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize("inside", ["", "store.zarr"])
def test_a_zarr_store_in_a_zip(tmp_path: Path, inside: str) -> None:
    pytest.importorskip("zarr")
    folder = tmp_path / "work"
    dated(growing(np.arange(4)), np.arange(4)).to_zarr(folder / inside, consolidated=False)
    shutil.make_archive(str(tmp_path / "store.zarr"), "zip", folder)
    assert forced(tmp_path / "store.zarr.zip", day(1.5))[0] == pytest.approx(0.15, abs=1e-3)


def test_a_store_that_is_none_is_not_looked_for_in_the_network(tmp_path: Path) -> None:
    pytest.importorskip("zarr")
    (tmp_path / "empty.zarr").mkdir()
    with pytest.raises(ForcingError, match="incomplete") as told:
        open_all(tmp_path / "empty.zarr")
    assert "network" not in str(told.value)
    (tmp_path / "old.zarr_files").mkdir()
    path = written(tmp_path / "old.zarr_files", dated(growing(np.arange(4)), np.arange(4)))
    assert forced(path, day(1.5))[0] == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize(
    ("text", "utc"),
    [
        ("2020-12-09 12:00:00+05:30", "2020-12-09T06:30"),
        ("2020-12-09T12:00-03:30", "2020-12-09T15:30"),
        ("2020-12-09T23:30:00-0130", "2020-12-10T01:00"),
        ("2020-12-09T12:00:00Z", "2020-12-09T12:00"),
    ],
)
def test_the_minutes_of_a_zone_count_like_its_hours(text: str, utc: str, tmp_path: Path) -> None:
    """Dates written as text: what is ahead of UTC is taken off, hours and minutes alike."""
    ds = plain(names=UO_VO).isel(time=[0]).assign_coords(time=("time", np.array([text], object)))
    ds.to_netcdf(tmp_path / "text.nc")
    (found,) = open_all(tmp_path / "text.nc")[0]["time"].values
    assert found == np.datetime64(utc)


# Rounding: what two files, or a date and its bounds, write in different precision is the same


def stored(folder: Path, ds: xr.Dataset, name: str) -> Path:
    """Write a file beside others."""
    ds.to_netcdf(folder / name)
    return folder / name


def noise(ds: xr.Dataset, part: float) -> xr.Dataset:
    """Axes that are wrong by a part of themselves."""
    return ds.assign_coords({name: (name, (1.0 + part) * ds[name].values, ds[name].attrs) for name in ("lat", "lon")})


@pytest.mark.parametrize("part", [3e-16, 5e-8])
def test_files_of_one_series_whose_axes_differ_by_rounding_are_joined(tmp_path: Path, part: float) -> None:
    """Bug: the run took one of them, and said that its dates lay outside of the records."""
    first, then = (dated(growing(days), days) for days in ([0, 1, 2], [3, 4, 5]))
    files = [stored(tmp_path, first, "first.nc"), stored(tmp_path, noise(then, part), "then.nc")]
    assert forced(files, day(1.5), 48.0)[0] == pytest.approx(0.35, abs=1e-6)


def test_files_on_grids_that_differ_are_not_joined(tmp_path: Path) -> None:
    """By a thousandth of a cell: these are not the same points."""
    first, then = (dated(growing(days), days) for days in ([0, 1, 2], [3, 4, 5]))
    shifted = then.assign_coords(lon=then["lon"] + 5e-4)
    with pytest.raises(ForcingError, match="outside the records"):
        forced([stored(tmp_path, first, "first.nc"), stored(tmp_path, shifted, "then.nc")], day(1.5), 48.0)


@pytest.mark.parametrize("late", [1e-12, 1e-8, 4e-6])
def test_components_whose_dates_differ_by_rounding_belong_together(tmp_path: Path, late: float) -> None:
    """Bug: "no value of uo, vo in the box: all land or missing"; ``late``: in days."""
    days = np.arange(6.0)
    files = [
        stored(tmp_path, dated(growing(days, (name,)), days + shift), f"{name}.nc")
        for name, shift in (("uo", 0.0), ("vo", late))
    ]
    assert forced(files, day(1.5), 24.0)[0] == pytest.approx(0.25, abs=1e-6)


def test_of_files_that_overlap_by_rounding_the_later_counts(tmp_path: Path) -> None:
    """Bug: records of the same date in both were two records a millisecond apart, and nothing told of it."""
    earlier, later = dated(growing(range(4)), range(4)), dated(growing([3, 4, 5], offset=1.0), [3 + 1e-8, 4, 5])
    files = [stored(tmp_path, earlier, "earlier.nc"), stored(tmp_path, later, "later.nc")]
    grown, told = forced(files, day(3.5))
    assert grown == pytest.approx(1.35, abs=1e-6)
    assert "share dates" in told


@pytest.mark.parametrize("late", [1e-12, 1e-8])
def test_daily_means_stamped_almost_at_midnight_are_put_at_noon(tmp_path: Path, late: float) -> None:
    ds = dated(growing(range(8)), np.arange(8) + late)
    for field in ds.data_vars.values():
        field.attrs["cell_methods"] = "time: mean"
    grown, told = forced(written(tmp_path, ds), day(2.5))
    assert grown == pytest.approx(0.2, abs=1e-6)
    assert "noon" in told


def test_a_date_that_lies_out_of_its_bounds_by_rounding_is_within(tmp_path: Path) -> None:
    """Bug: the bounds were not believed, and daily means were taken for values of midnight."""
    ds = dated(growing(range(8)), range(8), bounds="time_bounds")
    ds["time_bounds"] = (("time", "two"), np.stack([np.arange(8) + 1e-8, np.arange(8) + 1.0], axis=1))
    for name in UO_VO:
        ds[name].attrs["cell_methods"] = "time: mean"
    assert forced(written(tmp_path, ds), day(2.5))[0] == pytest.approx(0.2, abs=1e-6)
