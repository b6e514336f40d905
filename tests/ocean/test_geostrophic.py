"""The slope of the sea surface that balances the current: by hand, against ORAS5's own sea level, and what is said of it."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from ocean.test_files_forcing import EXPERIMENT, LEVELS, field, folder, mean_to, with_levels
from riftberg import DatasetForcing, build
from riftberg.constants import DEGREE, EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError
from riftberg.ocean.product_part import averaged_product, product_part
from riftberg.products import open_all
from riftberg.state import Elements, Floats, new_elements

__all__ = ["folder"]

START = datetime(2020, 12, 9, 13)


def at(lon: Floats, lat: Floats) -> Elements:
    e = new_elements(lon.size)
    e.place.lon[:], e.place.lat[:], e.body.thickness[:] = lon, lat, 200.0
    return e


def sampled(forcing: DatasetForcing, lon: Floats, lat: Floats, time: float = 0.0) -> Elements:
    e = at(lon, lat)
    forcing.sample(e, time)
    return e


def currents(east: object, hours: int, records: int) -> xr.Dataset:
    """Currents (a function of hours since the first record, and 0.1 m/s to the north) every so many hours."""
    time = np.datetime64("2020-12-09T00", "ns") + hours * np.arange(records) * np.timedelta64(1, "h")
    axes = {"time": time, "lat": np.arange(-60.0, -49.0), "lon": np.arange(-44.0, -30.0)}
    values = east(hours * np.arange(records))  # type: ignore[operator]
    shape = tuple(map(len, axes.values()))
    return xr.Dataset(
        {
            "uo": (
                tuple(axes), np.broadcast_to(np.asarray(values, float)[:, None, None], shape).copy(),
                {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"},
            ),
            "vo": (
                tuple(axes), np.full(shape, 0.1), {"units": "m s-1", "standard_name": "northward_sea_water_velocity"},
            ),
        },
        {
            "time": time,
            "lat": ("lat", axes["lat"], {"units": "degrees_north", "standard_name": "latitude"}),
            "lon": ("lon", axes["lon"], {"units": "degrees_east", "standard_name": "longitude"}),
        },
    )  # fmt: skip


@pytest.mark.parametrize("hours", [3, 5, 6, 24])
def test_the_slope_balances_the_mean_current_of_25_hours_twice(hours: int) -> None:
    """A current that grows evenly has the slope of its middle, but for the ends, where the mean shifts inwards."""
    tide = currents(lambda t: 0.2 + 0.001 * t, hours, 96 // hours + 1)
    forcing = DatasetForcing.from_xarray(tide, "2020-12-09", sea_level="geostrophic")
    lon, lat = np.array([-40.0, -35.3]), np.array([-58.0, -51.2])
    per_speed = 2.0 * EARTH_ROTATION * np.sin(lat * DEGREE) / GRAVITY
    for t in (36.0, 48.0, 57.5):
        e = sampled(forcing, lon, lat, 3600.0 * t)
        np.testing.assert_allclose(e.slope_y, -per_speed * (0.2 + 0.001 * t), rtol=1e-9)
        np.testing.assert_allclose(e.slope_x, per_speed * 0.1, rtol=1e-9)
    # At the start the second mean is that of the first 25 hours, in whose first half the first mean is of these hours too.
    first = sampled(forcing, lon, lat, 0.0)
    np.testing.assert_allclose(
        first.slope_y, -per_speed * (0.2 + (0.015625 if hours < 24 else 0.0)), rtol=1e-9 if hours == 24 else 4e-3
    )
    assert (sampled(DatasetForcing.from_xarray(tide, "2020-12-09", sea_level="none"), lon, lat).slope_x == 0.0).all()
    assert ("the mean current over 25 hours, taken twice" in forcing.describe()) == (hours < 24)


def test_records_of_less_than_a_day_and_land_in_some() -> None:
    short = currents(lambda t: 0.1 + 0.01 * t, 6, 3)
    short["uo"][1, :, :7] = np.nan
    lon, lat = np.array([-40.0, -32.0]), np.array([-56.0, -56.0])
    e = sampled(DatasetForcing.from_xarray(short, "2020-12-09", sea_level="geostrophic"), lon, lat, 3600.0)
    speed = -e.slope_y * GRAVITY / (2.0 * EARTH_ROTATION * np.sin(lat * DEGREE))
    # 0.1, 0.16 and 0.22 m/s with weights of 1, 2, 1; where the middle one is missing the others count.
    np.testing.assert_allclose(speed, [0.16, 0.16], rtol=1e-9)
    short["uo"][2] = np.nan
    short["uo"][2, :, 7:] = 0.22
    e = sampled(DatasetForcing.from_xarray(short, "2020-12-09", sea_level="geostrophic"), lon, lat, 3600.0)
    speed = -e.slope_y * GRAVITY / (2.0 * EARTH_ROTATION * np.sin(lat * DEGREE))
    np.testing.assert_allclose(speed, [0.1, 0.16], rtol=1e-9)


def test_against_the_sea_level_of_oras5(shared: Path) -> None:
    """0.012 m/s with means over the draft, 0.041 m/s with surface currents: root mean squares over the region.

    The slope alone moves a large berg at g/f times the slope, so this is the error of its drift.
    """
    files = {name: str(next((shared / "data" / "a68a").glob(f"*{name}*.nc"))) for name in ("ocean_surf", "ssh")}
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(-49.0, -21.0, 20000), rng.uniform(-65.0, -47.0, 20000)
    per_slope = GRAVITY / np.abs(2.0 * EARTH_ROTATION * np.sin(lat * DEGREE))
    errors = {}
    for product in ("a68a", "a68a-keel-mean"):
        sea = open_all(files["ocean_surf"], product)
        parts = [product_part(ds, START) for ds in (*sea, *open_all(files["ssh"]))]
        truth = sampled(DatasetForcing(parts), lon, lat)
        forcing = DatasetForcing(parts[:1], balance=averaged_product(parts[0]))
        e = sampled(forcing, lon, lat)
        off = per_slope * np.hypot(e.slope_x - truth.slope_x, e.slope_y - truth.slope_y)
        errors[product] = float(np.sqrt(np.mean(off**2)))
        assert any("errs by 0.04 m/s" in notice for notice in forcing.notices) == (product == "a68a")
    assert errors == pytest.approx({"a68a": 0.041, "a68a-keel-mean": 0.012}, abs=0.0005)


@pytest.mark.quick(1)
@pytest.mark.parametrize("more", ["", "  currents: surface\n", "  spacing: 0.25\n  every_hours: 3\n"])
def test_an_experiment_file_takes_levels_over_the_draft(folder: Path, more: str) -> None:
    """Also where the surface alone drives the berg; the sea level of the files is left out."""
    with_levels(folder)
    text = EXPERIMENT.replace("  spacing: 0.25\n", more) + "  sea_level: geostrophic\n"
    (folder / "files.yaml").write_text(text)
    model, info = build(str(folder / "files.yaml"))
    e = model.elements
    if model.forcing.grid is not None:
        model.forcing.grid.locate(e)
    model.forcing.sample(e, 0.0)
    draft = float(e.thickness[0]) * 850.0 / 1025.0
    per_speed = 2.0 * EARTH_ROTATION * np.sin(e.lat * DEGREE) / GRAVITY
    np.testing.assert_allclose(e.slope_y, -per_speed * mean_to(draft), rtol=1e-5)
    np.testing.assert_allclose(e.slope_x, per_speed * 0.5 * mean_to(draft), rtol=1e-5)
    surface = 0.4 if "surface" in more else mean_to(draft)
    np.testing.assert_allclose(e.uo, surface, rtol=1e-5)
    assert not any("sea level" in notice or "near the surface" in notice for notice in info.notices)
    assert LEVELS[-1] > draft


def test_surface_currents_get_a_notice_with_the_error(folder: Path) -> None:
    (folder / "files.yaml").write_text(EXPERIMENT + "  sea_level: geostrophic\n")
    _, info = build(str(folder / "files.yaml"))
    notice = next(text for text in info.notices if "sea_level: geostrophic" in text)
    assert all(part in notice for part in ("currents.nc", "0.04 m/s", "0.012 m/s"))


def test_what_cannot_be_balanced_is_refused() -> None:
    with pytest.raises(ForcingError, match="'level' is no choice") as error:
        DatasetForcing.from_xarray(currents(lambda t: t, 6, 3) * 0.0, START, sea_level="level")
    assert "geostrophic" in error.value.remedy
    wind = field(lambda x, y, t: 5.0, "ua", "m s-1", "eastward_wind", 4)
    north = field(lambda x, y, t: 5.0, "va", "m s-1", "northward_wind", 4)
    with pytest.raises(ForcingError, match="nothing gives currents, which the sea surface could balance"):
        DatasetForcing.from_xarray(xr.merge([wind, north]), START, sea_level="geostrophic")
