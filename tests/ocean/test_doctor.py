"""The doctor: what files are, what they give, what is missing, in words to act on."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

pytest.importorskip("cf_xarray", reason="needs the extra riftberg[products]")

sys.path.insert(0, str(Path(__file__).parent / "products"))
import product_files as files

from riftberg.errors import ForcingError
from riftberg.ocean.doctor import diagnose, doctor

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
    assert report.missing == ["ua", "va"]
    assert "No file gives ua (eastward wind at 10 m). Get wind: NCEP/NCAR R1 uwnd.10m.gauss.YEAR.nc" in report.text()


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
    report = diagnose(paths, (-38.0, -37.3), (-56.4, -56.1), ("2020-12-12", "2020-12-20"), ("uo", "vo"))
    text = report.text()
    assert "gap: about 1 record(s) missing between 2020-12-15T12:00 and 2020-12-17T12:00" in text
    assert "begins at 2020-12-13T12:00, after the experiment (2020-12-12T00:00). Add earlier files" in text
    assert "ends at 2020-12-18T12:00, before the experiment (2020-12-20T00:00). Add later files" in text
    assert not report.ready


def test_cover_in_space(tmp_path: Path) -> None:
    path = files.oscar_v2(tmp_path)
    report = doctor(path, lon=(-45.0, -30.0), lat=(-60.0, -50.0), needed=("uo", "vo"))
    assert "covers only part of the experiment: latitudes -56.5..-56 of -60..-50" in report.text()
    elsewhere = doctor(path, lon=(10.0, 20.0), lat=(-60.0, -50.0), needed=("uo", "vo"))
    assert "nothing lies in 10..20 E" in elsewhere.text()
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
    assert "values beyond 5 m s-1 are not believable: check the units in the file" in report.text()


def test_bad_files_are_reported_not_raised(tmp_path: Path) -> None:
    page = tmp_path / "oscar.nc"
    page.write_text("<html>Earthdata Login</html>")
    report = doctor([page, tmp_path / "absent.nc"])
    assert "log in to the data centre" in report.unreadable[str(page)]
    assert "does not exist" in report.unreadable[str(tmp_path / "absent.nc")]
    assert not report.ready
    assert "no file matches" in doctor(str(tmp_path / "*.grib")).text()


def test_files_that_clash_are_told_of_one_by_one(shared: Path) -> None:
    """Two files with the sea floor made the whole report an error."""
    both = [shared / "data" / "a68a" / f"a68_experiment_{name}.nc" for name in ("gebco_ll_p125", "ll_p125_grid")]
    report = doctor([*a68a(shared), *both], **BOX)
    told = {path for found in report.data for path in found.files}
    assert {str(path) for path in both} <= told
    assert not report.ready
    assert any("two files hold the same field" in text and "grid.nc" in text for text in report.advice)


def test_files_of_a_run_that_are_no_forcing_are_named(shared: Path) -> None:
    folder = shared / "data" / "a68a"
    mask = folder / "a68_experiment_berg_2020_12_09_gridded_ll_p0625_cropped.nc"
    report = doctor([folder / "icebergs.res.nc", mask])
    assert "an initial state of icebergs" in report.unreadable[str(folder / "icebergs.res.nc")]
    assert "from_mask" in report.unreadable[str(mask)]


def test_unrecognised_files_tell_what_they_hold(tmp_path: Path) -> None:
    path = tmp_path / "other.nc"
    xr.Dataset({"chlorophyll": ("x", np.ones(3))}).to_netcdf(path)
    assert "was not recognised; the file holds chlorophyll" in doctor([path]).unreadable[str(path)]


def test_notes_are_told_once(shared: Path) -> None:
    text = doctor(a68a(shared), **BOX).text()
    assert text.count("units are not in the files") == 1


def test_unknown_field_is_an_error_of_the_caller(tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match="no such fields"):
        doctor(files.oscar_v2(tmp_path), needed=("current",))


def test_names_and_units_of_the_file_are_told(tmp_path: Path) -> None:
    report = doctor(files.oscar_v1(tmp_path), needed=("uo", "vo"))
    assert "from u (meter/sec in the file); here 0.01 to 0.23 m s-1" in report.text()


def test_projected_ice_is_diagnosed_too(tmp_path: Path) -> None:
    pytest.importorskip("pyproj")
    file = files.osisaf(tmp_path)
    report = doctor(file, lon=(-37.2, -37.0), lat=(-57.4, -57.3), needed=("ice_fraction",))
    assert report.ready, report.text()
    elsewhere = doctor(file, lon=(100.0, 101.0), lat=(-56.9, -56.8), needed=("ice_fraction",))
    assert "nothing lies in 100..101 E" in elsewhere.text()


def test_report_as_plain_data(shared: Path) -> None:
    report = doctor(a68a(shared), **BOX)
    plain = json.loads(json.dumps(report.as_dict()))
    assert plain["ready"] is True
    assert {item["product"] for item in plain["data"]} == {"a68a"}
    assert all(np.isfinite(item["low"]) for data in plain["data"] for item in data["fields"])
