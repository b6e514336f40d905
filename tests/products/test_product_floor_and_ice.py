"""Bathymetry (GEBCO, SRTM15+, IBCSO) and OSI SAF sea ice."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pyproj
import pytest

from products import product_files as files
from products.probe import at_points
from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.products import recognise, window


def test_srtm15_depth_is_positive_down_and_land_missing(shared: Path) -> None:
    ds = open_product(shared / "data" / "samples" / "srtm15_coarsened.nc")
    depth = ds["depth_below_surface"]
    assert ds.attrs["product"] == "srtm15"
    assert float(depth.min()) > 0.0
    assert np.isnan(depth.sel(lon=86.0, lat=28.0, method="nearest"))
    assert 2500.0 < float(depth.sel(lon=-40.0, lat=-56.0, method="nearest")) < 5000.0


def test_gebco_subset_is_deep_water(shared: Path) -> None:
    path = shared / "data" / "observed" / "gebco_for_plots.nc"
    ds = open_product(path)
    assert recognise(path).name == "gebco"
    assert np.all(np.diff(ds["lat"].values) > 0)
    with netCDF4.Dataset(path) as raw:
        np.testing.assert_allclose(ds["depth_below_surface"].values, -raw["elevation"][:].data)
    assert float(ds["depth_below_surface"].min()) > 1000.0


def test_a68a_bathymetry_lies_at_cell_centres(shared: Path) -> None:
    ds = open_product(shared / "data" / "a68a" / "a68_experiment_gebco_ll_p125.nc")
    assert ds["lon"].values[0] == -49.5625
    assert int(np.isnan(ds["depth_below_surface"].values).sum()) == 52


def test_ibcso_projected_grid_is_interpolated(tmp_path: Path) -> None:
    """IBCSO v2 in EPSG:9354 (here 50 km steps around South Georgia's south). Documentation only."""
    x = np.arange(-2600e3, -2000e3, 50e3)
    y = np.arange(3200e3, 2500e3, -50e3)
    to_degrees = pyproj.Transformer.from_crs("EPSG:9354", "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(*np.meshgrid(x, y))
    elevation = 100.0 * lat + 10.0 * lon
    path = files.write(
        tmp_path / "IBCSO_v2_bed.nc",
        {"x": x.size, "y": y.size},
        {
            "x": ("f8", ("x",), x, {"units": "m", "standard_name": "projection_x_coordinate"}),
            "y": ("f8", ("y",), y, {"units": "m", "standard_name": "projection_y_coordinate"}),
            "z": ("f4", ("y", "x"), elevation, {"units": "m"}),
        },
        title="IBCSO v2",
    )
    ds = window(open_product(path), (-38.5, -37.5), (-56.5, -55.5))
    assert ds.sizes["x"] < x.size
    lon, lat = np.array([-38.0, -37.8]), np.array([-56.0, -55.9])
    depth = at_points(ds, lon, lat)["depth_below_surface"].values.reshape(2, 2)
    np.testing.assert_allclose(depth, -(100.0 * lat[:, None] + 10.0 * lon), atol=2.0)


def test_osisaf_percent_becomes_fraction_and_projection_agrees(tmp_path: Path) -> None:
    ds = open_product(files.osisaf(tmp_path))
    assert ds.attrs["product"] == "osisaf-ice"
    assert ds["ice_fraction"].dims == ("time", "y", "x")
    assert np.all(np.diff(ds["y"].values) == pytest.approx(10000.0))
    assert ds["time"].values[0] == np.datetime64("2020-12-16T12:00")
    # raw 1000 at the file's last row, first column: 10 %
    assert ds["ice_fraction"].values[0, 0, 0] == pytest.approx(0.10)
    assert np.isnan(ds["ice_fraction"].values[0, -1, 0])


def test_osisaf_gives_back_values_at_grid_points(tmp_path: Path) -> None:
    ds = open_product(files.osisaf(tmp_path))
    lon, lat = float(ds["lon"][1, 2]), float(ds["lat"][1, 2])
    there = at_points(ds, np.array([lon]), np.array([lat]))["ice_fraction"].values[0, 0, 0]
    assert there == pytest.approx(float(ds["ice_fraction"][0, 1, 2]), abs=1e-4)


def test_osisaf_wrong_projection_is_found_out(tmp_path: Path) -> None:
    path = files.osisaf(tmp_path)
    with netCDF4.Dataset(path, "a") as raw:
        raw["xc"][:] = raw["xc"][:] + 25.0
    with pytest.raises(ForcingError, match=r"differ by 2[345]\.\d km"):
        open_product(path)
