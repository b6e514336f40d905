"""Mean current from the surface to the keel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from riftberg import open_product
from riftberg.errors import ForcingError
from riftberg.products import keel_mean

DEPTH = np.array([10.0, 30.0, 70.0, 150.0])  # limits 0, 20, 50, 110, 190


def column(values: list[float], dry: int = 0) -> xr.Dataset:
    """Return one column of current, the lowest ``dry`` levels under the sea floor."""
    u = np.array(values, float)
    if dry:
        u[-dry:] = np.nan
    data = np.broadcast_to(u[:, None, None], (u.size, 2, 2)).copy()
    dims = ("depth", "lat", "lon")
    axes = {"depth": DEPTH, "lat": [-56.0, -55.0], "lon": [-38.0, -37.0]}
    return xr.Dataset({"uo": (dims, data), "vo": (dims, -data)}, coords=axes)


def test_uniform_current_is_its_own_mean() -> None:
    mean = keel_mean(column([0.3] * 4), 166.0)
    np.testing.assert_allclose(mean["uo"], 0.3)
    np.testing.assert_allclose(mean["vo"], -0.3)
    assert "depth" not in mean.dims


def test_mean_weighs_layers_by_thickness() -> None:
    mean = keel_mean(column([1.0, 0.5, 0.0, 9.0]), 100.0)
    assert float(mean["uo"][0, 0]) == pytest.approx((20 * 1.0 + 30 * 0.5 + 50 * 0.0) / 100.0)


def test_mean_ends_at_the_sea_floor() -> None:
    mean = keel_mean(column([1.0, 0.5, 0.0, 0.0], dry=2), 166.0)
    assert float(mean["uo"][0, 0]) == pytest.approx((20 * 1.0 + 30 * 0.5) / 50.0)
    assert np.isnan(keel_mean(column([1.0] * 4, dry=4), 50.0)["uo"]).all()


def test_draft_below_the_levels_is_an_error() -> None:
    with pytest.raises(ForcingError, match=r"outside the layers of the data, 0\.\.190 m"):
        keel_mean(column([1.0] * 4), 250.0)
    with pytest.raises(ForcingError, match="no currents on levels"):
        keel_mean(column([1.0] * 4).isel(depth=0, drop=True), 100.0)


def test_every_element_by_its_own_draft() -> None:
    ds = column([1.0, 0.5, 0.0, 0.0])
    drafts = xr.DataArray([[20.0, 50.0], [100.0, 190.0]], dims=("lat", "lon"))
    expected = [[1.0, 35.0 / 50.0], [35.0 / 100.0, 35.0 / 190.0]]
    np.testing.assert_allclose(keel_mean(ds, drafts)["uo"].transpose("lat", "lon"), expected)


def test_real_glorys_column(shared: Path) -> None:
    ds = open_product(shared / "data" / "samples" / "GLORYS_NA_20120101.nc")
    surface, mean = ds["uo"].isel(depth=0), keel_mean(ds, 100.0)["uo"]
    np.testing.assert_array_equal(np.isnan(mean.values), np.isnan(surface.values))
    low = ds["uo"].isel(depth=slice(0, 3)).min("depth")
    high = ds["uo"].isel(depth=slice(0, 3)).max("depth")
    wet = ~np.isnan(mean.values)
    assert np.all(mean.values[wet] >= low.values[wet] - 1e-9)
    assert np.all(mean.values[wet] <= high.values[wet] + 1e-9)
