"""Fetching by plain HTTPS: NCEP/NCAR wind that grows at its source, boxes of GEBCO. A server on this machine stands in."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from urllib.parse import unquote

import netCDF4
import numpy as np
import pytest

pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")
pytest.importorskip("requests", reason="needs the extra riftberg[fetch]")

sys.path.insert(0, str(Path(__file__).parent / "products"))
from fetching.serving import Shelf
from products import product_files as files
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.fetching import download
from riftberg.fetching.services import fetch_product, gebco_query
from riftberg.ocean.doctor import doctor

BOX = ((-38.1, -37.9), (-55.1, -55.0))

# ---- NCEP/NCAR R1 ----------------------------------------------------------------------------------------------------

OLD, NEW = "Wed, 16 Dec 2020 12:00:00 GMT", "Thu, 17 Dec 2020 12:00:00 GMT"


def stock(
    shelf: Shelf, folder: Path, date: str = OLD, years: tuple[int, ...] = (2020,), start: float = 1936512.0
) -> None:
    """Put the wind of some years on the shelf."""
    folder.mkdir(exist_ok=True)
    for part in ("uwnd", "vwnd"):
        content = files.ncep_r1(folder, part, start).read_bytes()
        for year in years:
            shelf.files[f"/{part}.10m.gauss.{year}.nc"] = content
            shelf.modified[f"/{part}.10m.gauss.{year}.nc"] = date


def fetch_wind(folder: Path, base: str, told: list[str], last: str = "2020-12-25") -> list[Path]:
    days = ("2020-12-09", last)
    return fetch_product("ncep-r1", folder, *BOX, days, progress=False, tell=told.append, ncep_url=base)


def test_ncep_needs_no_login_and_takes_whole_years(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path / "source", years=(2020, 2021))
    told: list[str] = []
    paths = fetch_wind(tmp_path, base, told, last="2021-01-05")
    names = [f"{part}.10m.gauss.{year}.nc" for year in (2020, 2021) for part in ("uwnd", "vwnd")]
    assert [path.name for path in paths] == names
    assert {field.name for data in doctor(paths[:2]).data for field in data.fields} == {"ua", "va"}
    assert told == []


def test_ncep_that_has_not_changed_is_not_fetched_again(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path / "source")
    told: list[str] = []
    fetch_wind(tmp_path, base, told)
    fetch_wind(tmp_path, base, told)
    assert len(shelf.requests) == 2
    assert shelf.heads == ["/uwnd.10m.gauss.2020.nc", "/vwnd.10m.gauss.2020.nc"]
    assert told == []


@pytest.mark.parametrize("grows", [True, False])
def test_ncep_that_has_changed_is_fetched_again(grows: bool, shelf: Shelf, base: str, tmp_path: Path) -> None:
    """The file of the current year grows, and its last days are written anew; either is found and told."""
    stock(shelf, tmp_path / "source")
    told: list[str] = []
    path = fetch_wind(tmp_path, base, told)[0]
    if grows:
        shelf.files["/uwnd.10m.gauss.2020.nc"] += b"more"
    else:
        stock(shelf, tmp_path / "source", start=1936518.0, date=NEW)
        shelf.modified["/vwnd.10m.gauss.2020.nc"] = OLD
    fetch_wind(tmp_path, base, told)
    assert path.read_bytes() == shelf.files["/uwnd.10m.gauss.2020.nc"]
    (word,) = told
    assert word.startswith("uwnd.10m.gauss.2020.nc has changed at its source")
    assert ("bytes there" if grows else NEW) in word
    assert word.endswith("it is fetched again")


def test_ncep_file_of_an_earlier_day_is_found_old_by_its_date(shelf: Shelf, base: str, tmp_path: Path) -> None:
    """Files that were put there by other means bear the time at which they came, not that of the source."""
    stock(shelf, tmp_path / "source", date=NEW)
    path = tmp_path / "uwnd.10m.gauss.2020.nc"
    path.write_bytes(bytes(len(shelf.files[f"/{path.name}"])))
    os.utime(path, (1608120000, 1608120000))
    fetch_wind(tmp_path, base, told := [])
    assert path.read_bytes() == shelf.files[f"/{path.name}"]
    assert len(told) == 1


@pytest.mark.parametrize("trouble", ["gone", "offline", "silent"])
def test_ncep_is_used_as_it_is_where_the_source_cannot_be_asked(
    trouble: str, shelf: Shelf, base: str, tmp_path: Path
) -> None:
    stock(shelf, tmp_path / "source")
    told: list[str] = []
    paths = fetch_wind(tmp_path, base, told)
    if trouble == "gone":
        shelf.status = dict.fromkeys(shelf.files, 503)
    if trouble == "silent":
        shelf.lengths, shelf.modified = False, {}
    again = fetch_wind(tmp_path, "http://127.0.0.1:1/" if trouble == "offline" else base, told)
    assert again == paths
    assert [word.partition(":")[0] for word in told] == [path.name for path in paths]
    assert all("cannot be asked whether it has changed; the file that is there is used" in word for word in told)


def test_ncep_keeps_the_old_file_until_the_new_one_is_whole(shelf: Shelf, base: str, tmp_path: Path) -> None:
    stock(shelf, tmp_path / "source")
    path = fetch_wind(tmp_path, base, [])[0]
    old = path.read_bytes()
    shelf.files[f"/{path.name}"] += b"more"
    shelf.cut_after, shelf.cuts = 0, 99
    with pytest.raises(ForcingError, match="attempts in a row brought nothing"):
        fetch_wind(tmp_path, base, [])
    assert path.read_bytes() == old


# ---- GEBCO -----------------------------------------------------------------------------------------------------------


def gebco(path: Path, lon: np.ndarray, lat: np.ndarray, name: str = "elevation") -> Path:
    """Write a box of GEBCO_2020 as the ERDDAP does: classic NetCDF, (latitude, longitude), int16. Documentation only."""
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as ds:
        ds.title = "The GEBCO_2020 Grid, a continuous terrain model for oceans and land at 15 arc-second intervals"
        for axis, values in (("latitude", lat), ("longitude", lon)):
            ds.createDimension(axis, values.size)
            variable = ds.createVariable(axis, "f8", (axis,))
            variable.setncatts({"units": f"degrees_{'north' if axis == 'latitude' else 'east'}", "standard_name": axis})
            variable[:] = values
        elevation = ds.createVariable(name, "i2", ("latitude", "longitude"))
        elevation.setncatts({"units": "m", "standard_name": "height_above_mean_sea_level"})
        elevation[:] = np.where(lon[None, :] > -37.95, 40.0, 1000.0 * lat[:, None] / 55.0 - 2000.0)
    return path


def centres(low: float, high: float) -> np.ndarray:
    """Return the pixel centres of the grid that an ERDDAP hands out for two ends: those nearest to them."""
    return (np.arange(np.rint(low * 240 - 0.5), np.rint(high * 240 - 0.5) + 1) + 0.5) / 240


@pytest.fixture
def erddap(shelf: Shelf, tmp_path: Path) -> Shelf:
    """An ERDDAP that has `BOX`, makes files on the fly and so tells no length and no ranges."""
    (tmp_path / "source").mkdir()
    cell = 1 / 240
    lon, lat = (centres(ends[0] - cell, ends[1] + cell) for ends in BOX)
    shelf.files[f"/{gebco_query(*BOX)}"] = gebco(tmp_path / "source" / "box.nc", lon, lat).read_bytes()
    shelf.chunked, shelf.ranges = True, False
    return shelf


def fetch_floor(folder: Path, base: str, told: list[str], box: tuple = BOX) -> Path:
    (path,) = fetch_product("gebco", folder, *box, progress=False, tell=told.append, gebco_url=base)
    return path


def test_gebco_is_asked_for_a_box_and_one_cell_around_it() -> None:
    assert unquote(gebco_query((-43.0, -33.0), (-59.0, -53.0))) == (
        "GEBCO_2020.nc?elevation[(-59.004167):1:(-52.995833)][(-43.004167):1:(-32.995833)]"
    )
    whole = unquote(gebco_query((-180.0, 180.0), (-90.0, 90.0)))  # no further than the outermost pixel centres
    assert whole.endswith("[(-89.997917):1:(89.997917)][(-179.997917):1:(179.997917)]")


def test_gebco_comes_with_its_size_told_and_serves_the_doctor(erddap: Shelf, base: str, tmp_path: Path) -> None:
    told: list[str] = []
    path = fetch_floor(tmp_path, base, told)
    assert path.name == "gebco_2020_-38.1_-37.9_-55.1_-55.nc"
    assert told == [f"{path.name}: 50 x 26 cells, 0.0 MB"]
    ds = open_product(path)
    assert ds.attrs["product"] == "gebco"
    assert {field.name for data in doctor([path], lon=BOX[0], lat=BOX[1]).data for field in data.fields} == {
        "depth_below_surface"
    }
    depth = ds["depth_below_surface"]
    assert np.isnan(depth.sel(lon=-37.9, lat=-55.05, method="nearest"))
    assert float(depth.sel(lon=-38.1, lat=-55.0, method="nearest")) == pytest.approx(3000.0, abs=1.0)
    assert not [left.name for left in tmp_path.iterdir() if ".part" in left.name]


def test_gebco_that_is_there_is_not_asked_for_again_and_damaged_is(erddap: Shelf, base: str, tmp_path: Path) -> None:
    path = fetch_floor(tmp_path, base, [])
    assert fetch_floor(tmp_path, base, []) == path
    assert len(erddap.requests) == 1
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert fetch_floor(tmp_path, base, []).read_bytes() == whole
    assert len(erddap.requests) == 2


def test_gebco_that_was_cut_is_asked_for_again(erddap: Shelf, base: str, tmp_path: Path) -> None:
    erddap.cut_after, erddap.cuts = 2000, 1
    assert fetch_floor(tmp_path, base, []).read_bytes() == next(iter(erddap.files.values()))
    assert [asked for _, asked in erddap.requests] == ["", ""]  # it is made anew each time: nothing is continued


def test_gebco_that_was_cut_unseen_is_not_kept(erddap: Shelf, base: str, tmp_path: Path) -> None:
    """Without chunks or a length the cut of the connection looks like the end."""
    erddap.chunked = erddap.lengths = False
    erddap.cut_after, erddap.cuts = 2000, 1
    with pytest.raises(ForcingError, match=r"the answer was cut: 2,000 of at least .*Nothing was kept: run again"):
        fetch_floor(tmp_path, base, [])
    assert [left.name for left in tmp_path.iterdir()] == ["source"]
    assert fetch_floor(tmp_path, base, []).exists()


def test_gebco_answers_that_are_not_the_box_are_refused(erddap: Shelf, base: str, tmp_path: Path) -> None:
    key = f"/{gebco_query(*BOX)}"
    right = erddap.files[key]
    made = tmp_path / "source" / "other.nc"
    for content, words in (
        (gebco(made, centres(-38.05, -37.9), centres(-55.1, -55.0)).read_bytes(), "its longitudes run from -38"),
        (gebco(made, centres(-38.1, -37.9), centres(-55.1, -55.0), "tid").read_bytes(), "holds no elevations"),
        (b"<html>Please wait</html>", "sent a web page in place of the file"),
    ):
        erddap.files[key] = content
        with pytest.raises(ForcingError, match=words):
            fetch_floor(tmp_path, base, [])
        assert not list(tmp_path.glob("*.nc"))
    erddap.files[key] = right
    assert fetch_floor(tmp_path, base, []).exists()


@pytest.mark.parametrize(
    ("lon", "lat", "words"),
    [
        ((170.0, -170.0), (-60.0, -50.0), "two boxes where the date line is crossed"),
        ((317.0, 327.0), (-60.0, -50.0), "no box of the grid"),
        ((-43.0, -33.0), (-53.0, -59.0), "south before north"),
        ((-180.0, 180.0), (-90.0, 90.0), "this box of GEBCO has 7,46[0-9] MB.*the whole grid from"),
    ],
)
def test_gebco_boxes_that_cannot_be_had(lon: tuple, lat: tuple, words: str, shelf: Shelf, tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match=words):
        fetch_product("gebco", tmp_path, lon, lat)
    assert shelf.requests == []


def test_gebco_refusal_is_explained(shelf: Shelf, base: str, tmp_path: Path) -> None:
    with pytest.raises(ForcingError, match=r"the file is not there \(HTTP 404\)"):
        fetch_floor(tmp_path, base, [])


def test_gebco_without_the_extra_names_it(base: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(download, "find_spec", lambda package: None)
    with pytest.raises(ForcingError, match=r"is not installed.*pip install 'riftberg\[fetch\]'"):
        fetch_floor(tmp_path, base, [])


def test_gebco_promises_no_continuation(tmp_path: Path, base: str) -> None:
    with pytest.raises(ForcingError, match=r"Check the network and run again$"):
        fetch_floor(tmp_path, "http://127.0.0.1:1/", [])
