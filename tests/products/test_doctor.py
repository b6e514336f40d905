"""The doctor: what files are, what they give, what is missing, in words to act on."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

sys.path.insert(0, str(Path(__file__).parent / "products"))
from products import product_files as files
from riftberg.errors import ForcingError
from riftberg.ocean.doctor import doctor
from riftberg.products import product_named

BOX = {"lon": (-40.0, -36.0), "lat": (-57.0, -54.5)}


def a68a(shared: Path) -> list[Path]:
    return sorted((shared / "data" / "a68a").glob("*oras5*.nc")) + sorted((shared / "data" / "a68a").glob("*jra55*.nc"))


def test_complete_set_is_ready(shared: Path) -> None:
    report = doctor(a68a(shared), **BOX)
    assert report.ready, report.text()
    assert report.missing == []
    assert "Ready: these files give all that was asked for." in report.text()


def test_missing_wind_is_named_with_a_place_to_get_it(shared: Path) -> None:
    files_without_wind = [path for path in a68a(shared) if "wind_vel" not in path.name]
    report = doctor(files_without_wind, **BOX)
    assert report.ready  # a run starts without wind, in calm air
    words = "no file gives ua (eastward wind at 10 m). Get wind: NCEP/NCAR R1 uwnd.10m.gauss.YEAR.nc"
    assert f"Assumed: calm air, for {words}" in report.text()
    asked = doctor(files_without_wind, **BOX, needed=("uo", "vo", "ua"))
    assert (asked.ready, asked.missing) == (False, ["ua"])
    assert f"N{words[1:]}" in asked.text()


def test_stray_file_is_told_about_but_does_not_stop(shared: Path) -> None:
    berg = shared / "data" / "a68a" / "a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc"
    report = doctor([*a68a(shared), berg], **BOX)
    assert report.ready
    assert "cannot be used: a mask of icebergs, no forcing" in report.text()


def test_ranges_units_and_signs_are_stated(shared: Path) -> None:
    report = doctor(a68a(shared), **BOX)
    fields = {item.name: item for data in report.data for item in data.fields}
    assert 0.2 < fields["uo"].high < 0.6
    assert fields["ua"].units == "m s-1"
    assert fields["ua"].positive == "blowing towards the east"
    assert "+ is towards the east" in report.text()


def test_cover_in_time_and_gaps(tmp_path: Path) -> None:
    paths = [files.oscar_v2(tmp_path, 11304 + day, name=f"oscar_currents_final_{day}.nc") for day in (0, 1, 2, 4, 5)]
    report = doctor(
        paths, lon=(-38.0, -37.3), lat=(-56.4, -56.1), time=("2020-12-12", "2020-12-20"), needed=("uo", "vo")
    )
    text = report.text()
    assert "gap: about 1 record(s) missing between 2020-12-15T12:00 and 2020-12-17T12:00" in text
    assert "begins at 2020-12-13T12:00, after the experiment (2020-12-12T00:00). Add earlier files" in text
    assert "ends at 2020-12-18T12:00, before the experiment (2020-12-20T00:00). Add later files" in text
    assert not report.ready


def test_cover_in_space(tmp_path: Path) -> None:
    path = files.oscar_v2(tmp_path)
    report = doctor(path, lon=(-45.0, -30.0), lat=(-60.0, -50.0), needed=("uo", "vo"))
    assert "covers only part of the experiment: 100% of its box lies outside. Fetch a larger area" in report.text()
    elsewhere = doctor(path, lon=(10.0, 20.0), lat=(-60.0, -50.0), needed=("uo", "vo"))
    assert "10 E to 20 E" in elsewhere.text()
    assert elsewhere.missing == ["uo", "vo"]


def test_land_on_the_path_of_the_berg(tmp_path: Path) -> None:
    path = [(-38.0, -56.25), (-37.25, -56.5)]
    file = files.oscar_v2(tmp_path)
    report = doctor(file, lon=(-38.0, -37.25), lat=(-56.5, -56.0), needed=("uo", "vo"), path=path)
    assert "missing (land, ice or gap) at 1 of 2 positions of the berg" in report.text()
    other_branch = [(lon + 360.0, lat) for lon, lat in path]
    again = doctor(file, lon=(-38.0, -37.25), lat=(-56.5, -56.0), needed=("uo",), path=other_branch)
    assert again.data[0].fields[0].missing_on_path == 1


def test_values_that_are_not_believable(tmp_path: Path) -> None:
    report = doctor(files.oscar_v2(tmp_path, shift=30.0), needed=("uo",))
    assert "the file calls only -3 to 3 valid: check its valid_range and its units" in report.text()
    with xr.open_dataset(files.oscar_v2(tmp_path, shift=30.0)) as ds:
        other = ds.load()
    for name in other.data_vars:
        for key in ("valid_min", "valid_max"):
            other[name].attrs.pop(key, None)
    other.to_netcdf(path := tmp_path / "other.nc")
    report = doctor(path, needed=("uo",))
    assert "values beyond 5 m s-1 are not believable: check the units in the file" in report.text()


def test_bad_files_are_reported_not_raised(tmp_path: Path) -> None:
    page = tmp_path / "oscar.nc"
    page.write_text("<html>Earthdata Login</html>")
    report = doctor([page, tmp_path / "absent.nc"])
    assert "log in to the data centre" in report.unreadable[str(page)]
    assert "does not exist" in report.unreadable[str(tmp_path / "absent.nc")]
    assert not report.ready
    assert "no file matches" in doctor(str(tmp_path / "*.grib")).text()


def test_of_two_files_with_the_same_field_the_later_counts_and_is_told(shared: Path) -> None:
    """Two files with the sea floor, both of which ``fetch a68a`` gets, were 'not ready'."""
    both = [shared / "data" / "a68a" / f"a68_experiment_{name}.nc" for name in ("gebco_ll_p125", "ll_p125_grid")]
    report = doctor([*a68a(shared), *both], **BOX)
    told = {path for found in report.data for path in found.files}
    assert {str(path) for path in both} <= told
    assert report.ready, report.text()
    assert len(report.notes) == 1
    assert report.notes[0].startswith("depth_below_surface is in 2 sets of files")
    assert report.notes[0].endswith("a68_experiment_ll_p125_grid.nc); of these a run takes the file named last")


def test_files_of_a_run_that_are_no_forcing_are_named(shared: Path) -> None:
    folder = shared / "data" / "a68a"
    mask = folder / "a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc"
    report = doctor([folder / "icebergs.res.nc", mask])
    assert "an initial state of icebergs" in report.unreadable[str(folder / "icebergs.res.nc")]
    assert "from_mask" in report.unreadable[str(mask)]


def daily(path: Path, days: range | list[int], empty: tuple[int, ...] = (), land: float | None = None) -> Path:
    """Write daily currents of December 2020; nothing on some days, and no value west of ``land`` (degrees east)."""
    lon, lat = np.arange(-42.0, -33.9, 0.25), np.arange(-58.0, -53.9, 0.25)
    values = np.full((len(days), lat.size, lon.size), 0.1)
    values[[k for k, day in enumerate(days) if day in empty]] = np.nan
    if land is not None:
        values[:, :, lon < land] = np.nan
    time = np.datetime64("2020-11-30", "ns") + np.array(days) * np.timedelta64(1, "D")
    coords = {
        "time": time,
        "lat": ("lat", lat, {"units": "degrees_north"}),
        "lon": ("lon", lon, {"units": "degrees_east"}),
    }
    names = {"uo": "eastward_sea_water_velocity", "vo": "northward_sea_water_velocity"}
    fields = {
        name: (("time", "lat", "lon"), values, {"units": "m s-1", "standard_name": standard})
        for name, standard in names.items()
    }
    xr.Dataset(fields, coords).to_netcdf(path)
    return path


DAYS = {"time": ("2020-12-09T12:00", "2020-12-13T12:00"), "needed": ("uo", "vo"), **BOX}


def test_every_record_is_looked_at_for_values(tmp_path: Path) -> None:
    """First, middle and last record were good, and those between were empty."""
    path = daily(tmp_path / "currents.nc", range(7, 21), empty=(11, 12, 13))
    report = doctor(path, **DAYS)
    assert not report.ready
    text = report.text()
    assert "3 record(s) without any value of uo, vo count as missing: 2020-12-11T00:00, 2020-12-12T00:00" in text
    assert "between 2020-12-10T00:00 and 2020-12-14T00:00, longer than the 2.5 days" in text
    assert "; ranges of 3 of 10 records" in text
    assert "3 of 10 records (2020-12-07T00:00" in report.data[0].sampled
    assert doctor(path, **DAYS, max_gap=4 * 86400.0).ready
    assert "no value" not in text


def test_one_record_without_values_is_told_and_bridged(tmp_path: Path) -> None:
    report = doctor(daily(tmp_path / "currents.nc", range(7, 21), empty=(11,)), **DAYS)
    assert report.ready, report.text()
    assert (
        "gap: about 1 record(s) of uo, vo missing between 2020-12-10T00:00 and 2020-12-12T00:00; runs interp"
        in report.text()
    )


def test_gaps_count_at_the_dates_asked_for(tmp_path: Path) -> None:
    """A gap before the experiment made the files 'not ready'."""
    path = daily(tmp_path / "currents.nc", [7, 8, 9, 10, 14, 15, 16])
    within = doctor(path, **DAYS)
    assert within.advice == [
        "currents.nc: gap: about 3 record(s) missing between 2020-12-10T00:00 and 2020-12-14T00:00, longer than the 2.5 "
        "days that a run interpolates across. Add these files, or set forcing.max_gap"
    ]
    later = doctor(path, **{**DAYS, "time": ("2020-12-14", "2020-12-16")})
    assert later.ready
    assert "missing between" not in later.text()


def test_land_beyond_the_reach_of_the_nearest_water_is_advised_against(tmp_path: Path) -> None:
    """'Values from the nearest water' was said of places where the field is 0."""
    path = daily(tmp_path / "currents.nc", range(7, 21), land=-38.0)
    for west, words, ready in (
        (-38.3, "values from the nearest water will be used there", True),
        (-39.5, "at 1 of them water is farther away than 2 cells of the product, and the field is 0 there", False),
    ):
        report = doctor(path, **DAYS, path=[(-37.0, -56.0), (west, -56.0)])
        assert "at 1 of 2 positions of the berg" in report.text()
        assert words in report.text()
        assert report.ready is ready
    off = doctor(path, **DAYS, path=[(-37.0, -56.0), (-20.0, -56.0)])
    assert "1 of 2 positions of the berg lie outside" in "".join(off.advice)


def test_missing_share_is_told(tmp_path: Path) -> None:
    text = doctor(daily(tmp_path / "currents.nc", range(7, 21), land=-38.0), **DAYS).text()
    assert "0.1 to 0.1 m s-1, + is towards the east (from uo, m s-1), 4" in text  # 8 or 9 of 18 columns
    assert "% missing" in text


def test_advice_is_given_once(tmp_path: Path) -> None:
    report = doctor(daily(tmp_path / "currents.nc", range(7, 21), land=-30.0), **{**DAYS, "needed": ("uo", "vo", "uo")})
    assert len(report.advice) == len(set(report.advice))
    assert report.missing == ["uo", "vo"]


def test_files_that_cannot_be_placed_are_reported_not_raised(tmp_path: Path) -> None:
    """A single latitude, and 30 February, were tracebacks."""
    path = daily(tmp_path / "currents.nc", range(7, 21))
    with xr.open_dataset(path) as ds:
        ds.isel(lat=[8]).to_netcdf(tmp_path / "row.nc")
        february = ds.isel(time=[0, 1]).drop_vars("time").load()
    units = {"units": "days since 2020-02-29", "calendar": "360_day", "standard_name": "time"}
    february.assign_coords(time=("time", [0, 1], units)).to_netcdf(tmp_path / "february.nc")
    assert "only one point along lat" in "".join(doctor(tmp_path / "row.nc", **DAYS).advice)
    assert "2020-02-30 00:00:00" in doctor(tmp_path / "february.nc", **DAYS).text().replace("T", " ")


def test_evidence_is_told_by_quantity_and_layout(shared: Path, tmp_path: Path) -> None:
    """One real file of a product was evidence for all that the product may hold."""
    era5 = product_named("era5")
    assert era5.checked(["ua"]).startswith("a real file; new Climate Data Store: a published header")
    assert era5.checked(["wave_height"]).startswith("documentation only")
    assert "a real file (ua, va, sst)" in era5.checked()
    assert product_named("ncep-r1").checked() == "a published header"
    assert product_named("duacs").checked() == "a real file; 1/8 degree: documentation only"
    assert "reader checked against a published header)" in doctor(files.ncep_r1(tmp_path), needed=("ua",)).text()


def test_unrecognised_files_tell_what_they_hold(tmp_path: Path) -> None:
    path = tmp_path / "other.nc"
    xr.Dataset({"chlorophyll": ("x", np.ones(3))}).to_netcdf(path)
    assert "was not recognised; the file holds chlorophyll" in doctor([path]).unreadable[str(path)]


def test_notes_are_told_once(shared: Path) -> None:
    text = doctor(a68a(shared), **BOX).text()
    assert text.count("units are not in the files") == 1


def test_three_files_take_at_most_25_lines_and_say_nothing_that_did_not_occur(tmp_path: Path) -> None:
    """Named for 40 lines, half of which told what files of these products may have: monthly means, waves in other files."""
    paths = [files.oscar_v2(tmp_path), files.era5_new(tmp_path), files.osisaf(tmp_path)]
    report = doctor(paths, needed=("uo", "vo"))
    assert not report.unreadable
    text = report.text()
    assert len(text.splitlines()) <= 25, text
    for finding in report.data:
        assert finding.notes  # JSON has them
        assert not [note for note in product_named(finding.product).notes if note in text]
    # What is taken on trust is told all the same.
    assert "taken at its word" in doctor(daily(tmp_path / "mine.nc", range(7, 21)), **DAYS).text()


def test_unknown_field_is_an_error_of_the_caller(tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match="no such fields"):
        doctor(files.oscar_v2(tmp_path), needed=("current",))


def test_names_and_units_of_the_file_are_told(tmp_path: Path) -> None:
    report = doctor(files.oscar_v1(tmp_path), needed=("uo", "vo"))
    assert "0.01 to 0.23 m s-1, + is towards the east (from u, meter/sec)" in report.text()


def test_projected_ice_is_diagnosed_too(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    file = files.osisaf(tmp_path)
    report = doctor(file, lon=(-37.2, -37.0), lat=(-57.4, -57.3), needed=("ice_fraction",))
    assert report.ready, report.text()
    elsewhere = doctor(file, lon=(100.0, 101.0), lat=(-56.9, -56.8), needed=("ice_fraction",))
    assert "100 E to 101 E" in elsewhere.text()


def test_cover_and_path_of_projected_ice(tmp_path: Path) -> None:
    """Nothing was said of projected data."""
    pyproj = pytest.importorskip("pyproj")
    file, ice = files.osisaf(tmp_path), ("ice_fraction",)
    wide = doctor(file, lon=(-38.0, -36.0), lat=(-58.0, -57.0), needed=ice)
    assert "covers only part of the experiment" in wide.text()
    assert not wide.ready
    crs = pyproj.CRS.from_user_input("+proj=stere +a=6378273 +b=6356889.44891 +lat_0=-90 +lat_ts=-70 +lon_0=0")
    inverse = pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
    path = [inverse.transform(1000.0 * x, 1000.0 * y) for x, y in ((-2205.0, 2905.0), (-2185.0, 2890.0), (0.0, 2890.0))]
    report = doctor(file, needed=ice, path=path)
    assert report.data[0].fields[0].missing_on_path == 1
    assert "1 of 3 positions of the berg lie outside" in report.text()


def test_report_as_plain_data(shared: Path) -> None:
    report = doctor(a68a(shared), **BOX)
    plain = json.loads(json.dumps(report.as_dict()))
    assert plain["ready"] is True
    assert {item["product"] for item in plain["data"]} == {"a68a"}
    assert all(np.isfinite(item["low"]) for data in plain["data"] for item in data["fields"])
