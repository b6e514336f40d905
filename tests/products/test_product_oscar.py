"""OSCAR v1 and v2.0, on files with the published headers (no real file was to be had)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from products import product_files as files
from products.probe import at_points
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.products import window


def test_v2_order_longitude_latitude_is_told_by_name(tmp_path: Path) -> None:
    ds = open_product(files.oscar_v2(tmp_path))
    assert ds.attrs["product"] == "oscar-v2"
    assert ds["uo"].dims == ("time", "lat", "lon")
    np.testing.assert_allclose(ds["lat"], [-56.5, -56.25, -56.0])
    np.testing.assert_allclose(ds["lon"], [-38.0, -37.75, -37.5, -37.25])
    np.testing.assert_allclose(ds["uo"].values[0, :, 0], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(ds["uo"].values[0, 1], [0.2, 0.21, 0.22, 0.23])
    assert np.isnan(ds["uo"].values[0, 0, 3])
    assert ds["uo"].attrs["units"] == "m s-1"


def test_v2_julian_label_is_the_ordinary_date_at_noon(tmp_path: Path) -> None:
    ds = open_product(files.oscar_v2(tmp_path))
    assert ds["time"].dtype == np.dtype("datetime64[ns]")
    assert ds["time"].values[0] == np.datetime64("2020-12-16T12:00")


def test_v2_days_follow_one_another_and_repeats_are_dropped(tmp_path: Path) -> None:
    paths = [
        files.oscar_v2(tmp_path, 11308, name="oscar_currents_final_20201217.nc", shift=0.1),
        files.oscar_v2(tmp_path, 11307),
        files.oscar_v2(tmp_path, 11307, name="oscar_currents_interim_20201216.nc", shift=0.5),
    ]
    ds = open_product(paths)
    assert list(ds["time"].values.astype("M8[h]").astype(str)) == ["2020-12-16T12", "2020-12-17T12"]
    np.testing.assert_allclose(ds["uo"].values[:, 0, 0], [0.1, 0.2])
    assert "of each the more final counts" in ds.attrs["told"]
    assert open_product(str(tmp_path / "*final*.nc")).sizes["time"] == 2


def test_v1_overlap_is_dropped_and_latitudes_ascend(tmp_path: Path) -> None:
    lon = np.linspace(20.0, 420.0, 1201)
    ds = open_product(files.oscar_v1(tmp_path, lon))
    assert ds.attrs["product"] == "oscar-v1"
    assert ds.sizes["lon"] == 1080
    assert np.all(np.diff(ds["lon"].values) > 0)
    assert ds["lon"].values[0] == pytest.approx(-180.0, abs=0.34)
    np.testing.assert_allclose(ds["lat"], [-56.3333, -56.0, -55.6667])
    assert "depth" not in ds.dims
    # The file's column 0 is 20 E; its row 0 is the northernmost.
    column = int(np.argmin(np.abs(ds["lon"].values - 20.0)))
    assert np.isnan(ds["uo"].values[0, -1, column])
    assert ds["uo"].values[0, -1, column + 1] == pytest.approx(0.01)
    assert ds["vo"].values[0, -1, column + 1] == pytest.approx(-0.01)


def test_v1_dates_count_from_october_1992(tmp_path: Path) -> None:
    ds = open_product(files.oscar_v1(tmp_path))
    expected = np.datetime64("1992-10-05") + np.array([10288, 10293])
    np.testing.assert_array_equal(ds["time"].values, expected.astype("datetime64[ns]"))
    np.testing.assert_allclose(ds["lon"], [-37.6667, -37.3333, -37.0, -36.6667], atol=1e-4)


def test_daily_means_serve_their_own_day_but_no_more(tmp_path: Path) -> None:
    ds = open_product(files.oscar_v2(tmp_path))
    grid = at_points(ds, np.array([-37.8]), np.array([-56.1]), ["2020-12-16T00:00", "2020-12-17T00:00"])
    assert grid["uo"].values[0, 0, 0] == pytest.approx(grid["uo"].values[1, 0, 0])
    with pytest.raises(ForcingError, match="outside the records"):
        at_points(ds, np.array([-37.8]), np.array([-56.1]), ["2020-12-17T00:30"])


def test_window_that_misses_the_data_says_what_they_cover(tmp_path: Path) -> None:
    ds = open_product(files.oscar_v2(tmp_path))
    with pytest.raises(ForcingError, match=r"cover 56\.5 S to 56 S, 38 W to 37\.25 W"):
        window(ds, (10.0, 20.0), (-60.0, -50.0))
