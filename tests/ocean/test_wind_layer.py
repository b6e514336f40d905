"""The wind's own layer, taken out of currents at the surface: a share of the wind, turned by 45 degrees."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import Forcing, Iceberg, Model, Parameters, build
from riftberg.constants import EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError

START = "2020-12-09"
LAYER = 0.005 * 10.0 * np.sqrt(0.5)  # m/s to each side, of a wind of 10 m/s


def dataset(lat: float, *, levels: bool = False, wind: bool = True, hours: float = 24.0) -> xr.Dataset:
    """A current of (0.3, 0.1) and a wind of (10, 0) m/s, the same everywhere, for ten days."""
    axes = {
        "time": np.datetime64(START, "ns") + (np.arange(0.0, 241.0, hours) * 3600e9).astype("timedelta64[ns]"),
        "lat": np.linspace(lat - 2.0, lat + 2.0, 9), "lon": np.linspace(-42.0, -32.0, 11),
    }  # fmt: skip
    ds = xr.Dataset(coords={
        "time": axes["time"], "lat": ("lat", axes["lat"], {"units": "degrees_north"}),
        "lon": ("lon", axes["lon"], {"units": "degrees_east"}),
    })  # fmt: skip
    shape = tuple(array.size for array in axes.values())
    for names, way, value in (("uo ua", "eastward", (0.3, 10.0)), ("vo va", "northward", (0.1, 0.0))):
        for name, one, kind in zip(names.split(), value, ("sea_water_velocity", "wind"), strict=True):
            if kind == "wind" and not wind:
                continue
            dims, field = tuple(axes), np.full(shape, one)
            if kind == "sea_water_velocity" and levels:
                dims, field = ("time", "depth", "lat", "lon"), np.repeat(field[:, None], 3, axis=1)
            ds[name] = dims, field, {"standard_name": f"{way}_{kind}", "units": "m s-1"}
    if levels:
        ds = ds.assign_coords(
            depth=("depth", [0.5, 60.0, 400.0], {"units": "m", "positive": "down", "standard_name": "depth"})
        )
    return ds


def sampled(forcing: Any, lat: float) -> Any:
    elements = Iceberg.rectangle("2 km", "2 km", thickness=200.0, placement=(-37.0, lat)).elements
    forcing.sample(elements, 5.0 * 86400.0)
    return elements


@pytest.mark.parametrize(("lat", "turn"), [(-56.0, 1.0), (70.0, -1.0)])
@pytest.mark.parametrize("hours", [24.0, 3.0])
@pytest.mark.parametrize("series", [True, False])
def test_current_and_slope_lose_the_layer_left_of_the_wind_in_the_south(
    lat: float, turn: float, hours: float, series: bool
) -> None:
    def made(layer: float) -> Any:
        if series:
            times = np.arange(0.0, 241.0, hours) * 3600.0
            return Forcing.along(times, uo=0.3, vo=0.1, ua=10.0, va=0.0, wind_layer=layer)
        return Forcing.from_dataset(dataset(lat, hours=hours), START, wind_layer=layer)

    plain, less = sampled(made(0.0), lat), sampled(made(0.005), lat)
    np.testing.assert_allclose(plain.uo - less.uo, LAYER, rtol=1e-6)
    np.testing.assert_allclose(plain.vo - less.vo, turn * LAYER, rtol=1e-6)
    f = 2.0 * EARTH_ROTATION * np.sin(np.radians(less.lat))
    np.testing.assert_allclose(less.slope_y, -f / GRAVITY * (0.3 - LAYER), rtol=1e-6)
    np.testing.assert_allclose(less.slope_x, f / GRAVITY * (0.1 - turn * LAYER), rtol=1e-6)
    np.testing.assert_array_equal(less.ua, plain.ua)  # the wind on the sail stays


def test_gusts_are_no_slope() -> None:
    """The slope takes the wind as it takes the current, by means over 25 hours twice; the drag takes that of the hour."""
    ds = dataset(-56.0, hours=1.0)
    gust = ds.ua.copy()
    gust[120] = 30.0
    calm, windy = (sampled(Forcing.from_dataset(d, START, wind_layer=0.005), -56.0) for d in (ds, ds.assign(ua=gust)))
    np.testing.assert_allclose(calm.uo - windy.uo, 2.0 * LAYER, rtol=1e-5)
    steeper = np.abs(windy.slope_y - calm.slope_y) / np.abs(calm.slope_y)
    assert (steeper < 0.02).all()
    assert (steeper > 0.0).all()


def test_it_is_off_unless_asked_and_told_where_it_is_on() -> None:
    berg = Iceberg.rectangle("20 km", "20 km", thickness=200.0, placement=(-37.0, -56.0))
    off = Model(berg, Forcing.from_dataset(dataset(-56.0), START), Parameters())
    on = Model(berg, Forcing.from_dataset(dataset(-56.0), START, wind_layer=0.005), Parameters())
    assert "wind_layer" not in off.describe()
    assert "0.005 of the wind, 45 degrees to its left in the south" in on.describe()
    assert "wind drift has no slope" in off.describe()
    assert "wind drift has no slope" not in on.describe()
    along = Forcing.along([0.0, 86400.0], uo=0.1, vo=0.0, ua=5.0, va=0.0, wind_layer=0.01)
    assert "0.01 of the wind" in along.describe()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Forcing.from_dataset(dataset(-56.0, levels=True), START, wind_layer=0.005), "no currents at the surface"),
        (lambda: Forcing.from_dataset(dataset(-56.0, wind=False), START, wind_layer=0.005), "no wind"),
        (lambda: Forcing.along([0.0, 86400.0], uo=0.1, vo=0.0, wind_layer=0.005), "the series has none"),
        (lambda: Forcing.along([0.0, 86400.0], uo=0.1, vo=0.0, ua=1.0, va=0.0, wind_layer=5), "5 is no share"),
        (lambda: Forcing.from_dataset(dataset(-56.0), START, wind_layer=-0.01), "no share"),
    ],
)  # fmt: skip
def test_what_has_no_such_layer_is_refused(make: Any, said: str) -> None:
    with pytest.raises(ForcingError, match=said):
        make()


def test_an_experiment_file_says_it(tmp_path: Path) -> None:
    for levels in (False, True):
        dataset(-56.0, levels=levels).to_netcdf(tmp_path / f"{levels}.nc")
    text = """
start: 2020-12-11
days: 1
berg: {placement: [-37.0, -56.0], thickness: 200 m, rectangle: {length: 2 km, width: 2 km}}
forcing: {kind: files, files: [FILE], wind_layer: 0.005CURRENTS}
"""
    path = tmp_path / "e.yaml"
    path.write_text(text.replace("FILE", "False.nc").replace("CURRENTS", ""))
    model, _ = build(str(path))
    model.step()
    np.testing.assert_allclose(model.elements.uo, 0.3 - LAYER, rtol=1e-5)
    path.write_text(text.replace("FILE", "True.nc").replace("CURRENTS", ""))
    with pytest.raises(ForcingError, match=r"forcing.wind_layer.*means over the draft"):
        build(str(path))
    path.write_text(text.replace("FILE", "True.nc").replace("CURRENTS", ", currents: surface"))
    model, _ = build(str(path))
    model.step()
    np.testing.assert_allclose(model.elements.uo, 0.3 - LAYER, rtol=1e-5)
    # That of the slope is a mean over the draft: it keeps its current.
    f = 2.0 * EARTH_ROTATION * np.sin(np.radians(model.elements.lat))
    np.testing.assert_allclose(model.elements.slope_y, -f / GRAVITY * 0.3, rtol=1e-4)
