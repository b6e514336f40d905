"""No sea level in the data: the slope that balances the current, and what is said of it."""

from __future__ import annotations

import itertools
import logging
import re
from typing import Any

import numpy as np
import pytest
import xarray as xr

from riftberg import DatasetForcing, Forcing, Iceberg, Model
from riftberg.constants import DEGREE, EARTH_ROTATION, GRAVITY
from riftberg.errors import ForcingError
from riftberg.ocean.balance import mean_record_weights
from riftberg.ocean.mean_currents import mean_currents
from riftberg.ocean.product_records import ProductRecords
from riftberg.state import Elements, Floats, new_elements

APART = 5.0 * 3600.0
MEAN = 25.0 * 3600.0

START = np.datetime64("2020-12-01", "ns")
PER_SPEED = -2.0 * EARTH_ROTATION * np.sin(-60.0 * DEGREE) / GRAVITY
"""Northward slope that balances an eastward current of 1 m/s at 60 S."""


def sea(
    east: Any, hours: Floats, *, level: Any = None, lat: tuple[float, float] = (-62.0, -58.0), north: float = 0.0
) -> xr.Dataset:
    """Currents: eastward a function of hours since the first record; optionally a sea level, one value or a field."""
    axes = {
        "time": START + (np.asarray(hours) * 3600e9).astype("timedelta64[ns]"),
        "lat": np.linspace(*lat, 9), "lon": np.linspace(-42.0, -30.0, 13),
    }  # fmt: skip
    shape = tuple(map(len, axes.values()))
    values = {
        "a": np.broadcast_to(np.asarray(east(np.asarray(hours)), float)[:, None, None], shape),
        "b": np.full(shape, north),
    }
    fields = {name: (tuple(axes), value.copy(), {"units": "m s-1"}) for name, value in values.items()}
    if level is not None:
        fields["eta"] = (tuple(axes), np.broadcast_to(level, shape).copy(), {"units": "m"})
    return xr.Dataset(fields, axes)


def forcing_of(ds: xr.Dataset, **options: Any) -> DatasetForcing:
    names = {"uo": "a", "vo": "b", **({"ssh": "eta"} if "eta" in ds else {})}
    return Forcing.from_dataset(ds, "2020-12-01", **names, **options)


def steady(speed: float = 0.2, **options: Any) -> xr.Dataset:
    return sea(lambda t: speed + 0.0 * t, np.arange(0.0, 97.0, 24.0), **options)


def sampled(forcing: Any, time: float = 0.0, lon: float = -36.0, lat: float = -60.0) -> Elements:
    e = new_elements(1)
    e.place.lon[:], e.place.lat[:], e.body.thickness[:] = lon, lat, 200.0
    forcing.sample(e, time)
    return e


def lone(size: float, thickness: float, lat: float = -60.0) -> Iceberg:
    return Iceberg.rectangle(size, size, thickness=thickness, placement=(-36.0, lat), radius=0.5 * size)


def drifted(size: float, thickness: float, forcing: Any, lat: float = -60.0) -> float:
    """Kilometres to the east in two days."""
    model = Model(lone(size, thickness, lat), forcing)
    model.advance(2)
    return float(model.elements.lon[0] + 36.0) * 111.195 * np.cos(lat * DEGREE)


# ---- the fault: a large berg stood still in a current, in silence ------------------------------------------------------------


def test_a_large_berg_goes_with_the_water_where_no_sea_level_is_given(caplog: pytest.LogCaptureFixture) -> None:
    """30 km in 0.2 m/s at 60 S: 34 km in two days, not 0.1; and the notice has these figures."""
    with caplog.at_level(logging.WARNING, logger="riftberg"):
        assert drifted(30e3, 200.0, forcing_of(steady())) == pytest.approx(34.3, abs=0.2)
    (notice,) = (text for text in caplog.messages if "sea level" in text)
    assert "a berg of 30 km moves 34.3 km in two days with it, 0.2 without" in notice
    assert "no depth is given either" in notice
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="riftberg"):
        assert abs(drifted(30e3, 200.0, forcing_of(steady(), sea_level="none"))) < 0.3
    assert not [text for text in caplog.messages if "sea level" in text]


@pytest.mark.parametrize(
    ("size", "thickness", "lat", "km"),
    [(100.0, 80.0, -60.0, 34.3), (20e3, 250.0, -6.0, 27.4), (20e3, 250.0, 3.0, 16.9)],
)
def test_small_bergs_and_low_latitudes_follow_as_the_momentum_balance_has_it(
    size: float, thickness: float, lat: float, km: float
) -> None:
    """The slope fades with f, without a cut near the equator; the figure of the notice is that of the run."""
    forcing = forcing_of(steady(lat=(lat - 2.0, lat + 2.0)))
    way = drifted(size, thickness, forcing, lat)
    assert way == pytest.approx(km, abs=0.6)
    told = re.search(
        r"moves ([\d.]+) km in two days with it", Model(lone(size, thickness, lat), forcing).sea_level_notice
    )
    assert told is not None
    assert float(told[1]) == pytest.approx(way, rel=0.02)


def test_the_notice_stands_in_results_and_descriptions() -> None:
    model = Model(lone(20e3, 250.0), forcing_of(steady()))
    run = model.run(steps=1)
    assert run.attrs["sea_level"] == model.sea_level_notice
    assert model.sea_level_notice in model.describe()
    assert "for no sea level is given" in model.forcing.describe()
    assert "sea_level" not in Model(lone(20e3, 250.0), forcing_of(steady(level=0.1))).run(steps=1).attrs


# ---- what auto takes ---------------------------------------------------------------------------------------------------------


def test_a_level_in_the_data_is_taken_and_nothing_is_said() -> None:
    tilted = 1e-6 * 111195.0 * (np.linspace(-62.0, -58.0, 9) + 60.0)[None, :, None]
    e = sampled(forcing := forcing_of(steady(level=tilted)))
    assert float(e.slope_y[0]) == pytest.approx(1e-6, rel=2e-3)
    assert e.slope_x[0] == 0.0
    assert Model(lone(20e3, 250.0), forcing).sea_level_notice == ""


def test_a_level_with_gaps_is_that_of_the_data_and_the_gaps_are_told() -> None:
    level = np.zeros((5, 9, 13))
    level[:, 6:, :] = np.nan
    forcing = forcing_of(steady(level=level))
    assert (sampled(forcing).slope_y == 0.0).all()
    model = Model(lone(3e3, 200.0), forcing)
    assert "the sea level is unknown at 33 % of the points whose current is known" in model.sea_level_notice
    later = np.zeros((5, 9, 13))
    later[-1, :, 9:] = np.nan
    model = Model(lone(3e3, 200.0), forcing_of(steady(level=later)))
    assert model.sea_level_notice == ""
    model.check(4)
    assert "unknown at 31 %" in model.sea_level_notice


def test_land_without_a_level_is_no_gap() -> None:
    ds = steady(level=0.0)
    for name in ds:
        ds[name][:, :, 10:] = np.nan
    assert Model(lone(3e3, 200.0), forcing_of(ds)).sea_level_notice == ""


@pytest.mark.parametrize(
    ("choice", "ds", "said"),
    [
        ("files", steady(), "nothing gives a sea level"),
        ("level", steady(), "'level' is no choice"),
        (True, steady(), "is no choice"),
    ],
)
def test_what_is_not_there_is_refused(choice: Any, ds: xr.Dataset, said: str) -> None:
    with pytest.raises(ForcingError, match=said) as error:
        forcing_of(ds, sea_level=choice)
    assert error.value.remedy


def test_geostrophic_leaves_a_given_level_out_and_has_no_figure() -> None:
    forcing = forcing_of(steady(level=0.3), sea_level="geostrophic")
    assert float(sampled(forcing).slope_y[0]) == pytest.approx(
        -2 * EARTH_ROTATION * np.sin(-60 * DEGREE) * 0.2 / GRAVITY
    )
    assert Model(lone(20e3, 250.0), forcing).sea_level_notice == ""
    assert any("sea_level: geostrophic" in text for text in forcing.notices)


# ---- sums take one slope -----------------------------------------------------------------------------------------------------


class Tilt(Forcing):
    """A formula that says that it gives the slope of the sea surface."""

    provides = frozenset({"slope_x", "slope_y"})

    def add_to(self, elements: Elements, time: float) -> None:
        elements.environment.slope_x[:] += 3e-7


def test_a_sum_takes_a_level_that_is_given_and_no_assumed_one_beside_it() -> None:
    e = sampled(forcing_of(steady()) + Tilt())
    assert (float(e.slope_x[0]), float(e.slope_y[0])) == (3e-7, 0.0)
    assert not (forcing_of(steady()) + Tilt()).assumes_slope


def test_a_level_without_currents_is_that_of_the_formulas() -> None:
    """One slope: that of the data; the formula's current does not bring its own."""
    ds = steady(level=1e-6 * 111195.0 * (np.linspace(-62.0, -58.0, 9) + 60.0)[None, :, None])[["eta"]]
    level = Forcing.from_dataset(ds, "2020-12-01", ssh="eta")
    e = sampled(level + Forcing.uniform(current=(0.2, 0.0)))
    assert float(e.uo[0]) == 0.2
    assert float(e.slope_y[0]) == pytest.approx(1e-6, rel=2e-3)
    turned = sampled(level + Forcing.eddy((-36.2, -60.0), radius=40e3, speed=0.5))
    assert (float(turned.slope_x[0]), float(turned.slope_y[0])) == (float(e.slope_x[0]), float(e.slope_y[0]))


def test_currents_of_data_and_of_a_formula_are_balanced_once_each() -> None:
    both = forcing_of(steady(0.15)) + Forcing.uniform(current=(0.05, 0.0))
    assert float(sampled(both).slope_y[0]) == pytest.approx(float(sampled(forcing_of(steady(0.2))).slope_y[0]))
    assert Model(lone(20e3, 250.0), both).sea_level_notice.startswith("no sea level is given")


# ---- the law -----------------------------------------------------------------------------------------------------------------


def test_the_slope_turns_with_the_current_and_scales_with_f() -> None:
    """North of the equator the sea stands higher on the right of the current, south of it on the left."""

    def slopes(east: float, north: float) -> Floats:
        """Slopes to the east and north at 60 N, 60 S and 30 N."""
        met = [
            sampled(forcing_of(steady(east, lat=(lat - 2.0, lat + 2.0), north=north)), lat=lat)
            for lat in (60.0, -60.0, 30.0)
        ]
        return np.array([[e.slope_x[0] for e in met], [e.slope_y[0] for e in met]])

    east, north = slopes(0.2, 0.0), slopes(0.0, 0.2)
    assert (east[1] * [1, -1, 1] < 0.0).all()
    assert (north[0] * [1, -1, 1] > 0.0).all()
    np.testing.assert_allclose(north[0], -east[1])
    assert east[1][0] / east[1][2] == pytest.approx(np.sin(60 * DEGREE) / 0.5)
    assert north[0][0] == pytest.approx(1.26316e-4 * 0.2 / 9.8, rel=2e-3)  # f v / g
    np.testing.assert_allclose(slopes(0.6, 0.0)[1], 3.0 * east[1])


# ---- the mean ----------------------------------------------------------------------------------------------------------------


def plain_mean_of_means(times: Floats, values: Floats, at: float) -> float:
    """Twin: the mean over 25 hours by fine steps, of means over 25 hours at the records, all linear between records."""

    def mean(series: Floats, middle: float) -> float:
        first = min(max(middle - MEAN / 2, times[0]), max(times[-1] - MEAN, times[0]))
        last = min(first + MEAN, times[-1])
        total, edges = 0.0, [first, *[t for t in times if first < t < last], last]
        for low, high in itertools.pairwise(edges):
            total += 0.5 * (np.interp(low, times, series) + np.interp(high, times, series)) * (high - low)
        return total / (last - first)

    once = np.array([mean(values, t) for t in times])
    return mean(once, at)


@pytest.mark.parametrize(
    "hours",
    [
        np.arange(0, 130, 1.0),
        np.arange(0, 130, 3.0),
        np.arange(0, 13, 1.0),
        np.array([0.0, 1, 2, 5, 9, 10, 30, 31, 33, 60, 61, 75]),
    ],
)
def test_means_are_those_of_a_slow_twin(hours: Floats) -> None:
    rng = np.random.default_rng(3)
    east = rng.normal(size=hours.size)
    ds = sea(lambda t: east, hours)
    canonical = ds.rename(a="uo", b="vo")
    of = ProductRecords(canonical, START.astype("datetime64[s]").item())
    means = mean_currents(of)
    for number in (0, len(means.times) // 2, len(means.times) - 1):
        time = means.times[number]
        got = float(means.field("uo", time).before[0, 4, 6])
        assert got == pytest.approx(plain_mean_of_means(np.asarray(of.times), east, time), rel=1e-11, abs=1e-13)
    assert max(np.diff(means.times)) <= max(APART, float(np.diff(hours).max()) * 3600.0)


def test_weights_are_a_triangle_of_fifty_hours() -> None:
    times = 3600.0 * np.arange(0.0, 200.0, 0.5)
    first, weights = mean_record_weights(times, times[200])
    assert (first, weights.size) == (175, 51)
    assert weights.sum() == pytest.approx(1.0)
    means = mean_currents(
        ProductRecords(
            sea(lambda t: 0.0 * t, times / 3600.0).rename(a="uo", b="vo"), START.astype("datetime64[s]").item()
        )
    )
    number = int(np.argmin(np.abs(np.asarray(means.times) - times[200])))
    first, weights = means._shares[number]  # type: ignore[attr-defined]
    since = np.abs(times[first : first + weights.size] - means.times[number])
    np.testing.assert_allclose(weights, np.maximum(0.0, 1.0 - since / MEAN) * 1800.0 / MEAN, atol=3e-4)


def test_means_do_not_depend_on_where_they_begin() -> None:
    """A run that is resumed in the middle has the same bits; gaps in some records count for the others."""
    rng = np.random.default_rng(5)
    hours = np.arange(0.0, 200.0)
    ds = sea(lambda t: rng.normal(size=t.size), hours).rename(a="uo", b="vo")
    ds["uo"][50:60, 3, 3] = np.nan
    ds["uo"][:, 0, 0] = np.nan
    whole, late = (mean_currents(ProductRecords(ds, START.astype("datetime64[s]").item())) for _ in "ab")
    whole.check(0.0, 3600.0 * 199)
    for hour in (120.0, 55.0, 131.0):
        one, other = (means.field("uo", 3600.0 * hour) for means in (whole, late))
        assert one.before.tobytes() == other.before.tobytes()
        assert one.after.tobytes() == other.after.tobytes()
    middle = whole.field("uo", 3600.0 * 55).before
    assert np.isnan(middle[0, 0, 0])
    assert np.isfinite(middle[0, 3, 3])


@pytest.mark.parametrize("days", [1, 3])
def test_products_of_a_day_and_longer_are_left_as_they_are(days: int) -> None:
    values = np.array([0.1, 0.3, -0.2, 0.4])
    e = sampled(forcing_of(sea(lambda t: values, 24.0 * days * np.arange(4.0))), 86400.0 * days)
    assert float(e.slope_y[0]) == pytest.approx(PER_SPEED * 0.3)


@pytest.mark.slow
def test_inertial_motion_and_tides_do_not_shake_a_large_berg() -> None:
    """0.1 m/s of inertial current at 60 S: a 20-km berg stays below 0.2 m/s (a slope from hourly currents drives it to 0.7)."""
    hours = np.arange(0.0, 24.0 * 10 + 1)
    turning = 2.0 * EARTH_ROTATION * np.sin(60.0 * DEGREE) * 3600.0 * hours
    ds = sea(lambda t: 0.05 + 0.1 * np.cos(turning), hours)
    ds["b"][:] = (0.1 * np.sin(turning))[:, None, None]
    model = Model(lone(20e3, 250.0), forcing_of(ds))
    fastest = 0.0
    model.advance(6)
    for _ in range(96):
        model.advance(steps=1)
        fastest = max(fastest, float(np.hypot(model.elements.u, model.elements.v)[0]))
    assert 0.05 < fastest < 0.2
    for period in (12.42, 23.93):
        tide = sea(lambda t, p=period: 0.05 + 0.3 * np.cos(2 * np.pi * t / p), hours)  # type: ignore[misc]
        slopes = [float(sampled(forcing_of(tide), 3600.0 * t).slope_y[0]) for t in np.arange(40.0, 160.0, 3.0)]
        np.testing.assert_allclose(slopes, PER_SPEED * 0.05, rtol=0.02)
