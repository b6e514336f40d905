"""What files say themselves about the time between their records."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from riftberg.constants import SECONDS_PER_DAY
from riftberg.products.dates import iso_seconds, stated_interval
from riftberg.products.records import Gap, cover_of, empty_records, gap_limit, long_gaps, own_interval, usual_interval

MONTH_SECONDS = 30.4 * 86400.0


def raw(time: dict[str, str] | None = None, **attributes: str) -> xr.Dataset:
    """Return an undecoded dataset of two records."""
    bounds = ("time", "two"), [[0.0, 24.0], [24.0, 48.0]]
    return xr.Dataset({"edges": bounds}, {"time": ("time", [12.0, 36.0], time or {})}, attributes)


@pytest.mark.parametrize(
    ("ds", "name", "seconds"),
    [
        (raw({"bounds": "edges", "units": "hours since 2020-12-01"}), "a.nc", SECONDS_PER_DAY),
        (raw({"bounds": "edges", "units": "days since 2020-12-01"}), "a.nc", 24 * SECONDS_PER_DAY),
        (raw({"delta_t": "0000-00-00 06:00:00"}), "a.nc", 6 * 3600.0),
        (raw({"delta_t": "0000-01-00 00:00:00"}), "a.nc", MONTH_SECONDS),
        (raw(time_coverage_resolution="P1D"), "a.nc", SECONDS_PER_DAY),
        (raw(frequency="1hr"), "a.nc", 3600.0),
        (raw(frequency="3hr"), "a.nc", 3 * 3600.0),
        (raw(frequency="6hr"), "a.nc", 6 * 3600.0),
        (raw(frequency="day"), "a.nc", SECONDS_PER_DAY),
        (raw(frequency="mon"), "a.nc", MONTH_SECONDS),
        (raw(title="Monthly mean fields for product GLOBAL_MULTIYEAR_PHY_001_030"), "a.nc", MONTH_SECONDS),
        (raw(title="daily mean fields, updated Daily"), "a.nc", SECONDS_PER_DAY),
        (raw(id="cmems_mod_glo_phy_my_0.083deg_P1M-m"), "a.nc", MONTH_SECONDS),
        (raw(), "cmems_mod_glo_phy_my_0.083deg_P1D-m_uo.nc", SECONDS_PER_DAY),
        (raw(), "/data/mercatorglorys12v1_gl12_mean_202012.nc", MONTH_SECONDS),
        (raw(), "mercatorglorys12v1_gl12_mean_20201209_R20201216.nc", SECONDS_PER_DAY),
        (raw(title="ERA5 hourly data on single levels", time_coverage_resolution="unknown"), "monthly/a.nc", 0.0),
    ],
)
def test_the_interval_that_a_file_states(ds: xr.Dataset, name: str, seconds: float) -> None:
    assert stated_interval(ds, name) == pytest.approx(seconds)


def test_durations() -> None:
    assert iso_seconds("PT1H30M") == 5400.0
    assert iso_seconds("P1W") == 7 * SECONDS_PER_DAY
    assert iso_seconds("P1M") == MONTH_SECONDS
    assert iso_seconds("PT1M") == 60.0
    assert iso_seconds("one day") == iso_seconds("") == iso_seconds("P") == 0.0


def dates(*days: float) -> np.ndarray:
    return np.datetime64("2020-12-01", "ns") + np.round(24 * np.array(days)).astype(int) * np.timedelta64(1, "h")


def series(*days: float, **attributes: float) -> xr.Dataset:
    values = np.ones((len(days), 2, 2))
    return xr.Dataset({"uo": (("time", "lat", "lon"), values)}, {"time": dates(*days)}, attributes)


def test_the_interval_is_the_shortest_of_what_is_known() -> None:
    assert usual_interval(dates(1, 2, 5)) == SECONDS_PER_DAY  # of two in the middle the shorter
    assert usual_interval(dates(1)) == 0.0
    assert own_interval(series(1, 6)) == 5 * SECONDS_PER_DAY
    assert own_interval(series(1, 6, averaging_seconds=SECONDS_PER_DAY)) == SECONDS_PER_DAY
    assert own_interval(series(1, 2, stated_seconds=MONTH_SECONDS)) == SECONDS_PER_DAY
    assert own_interval(series(1, 6, interval_seconds=3600.0)) == 3600.0
    # Two records that are 20 days apart may be snapshots of something faster; many, or what a file states, are not.
    assert own_interval(series(1, 21)) == SECONDS_PER_DAY
    assert own_interval(series(1, 21, 41, 61, 81)) == 20 * SECONDS_PER_DAY
    assert own_interval(series(1, 21, stated_seconds=MONTH_SECONDS)) == 20 * SECONDS_PER_DAY
    assert gap_limit(series(1, 2, 3)) == 2.5 * SECONDS_PER_DAY
    assert gap_limit(series(1, 2, 3, max_gap_seconds=7.0)) == 7.0
    assert cover_of(series(1, 2, averaging_seconds=SECONDS_PER_DAY)) == tuple(dates(0.5, 2.5))
    assert cover_of(series(1, 2, averaging_seconds=SECONDS_PER_DAY, hold_seconds=0.0)) == tuple(dates(1, 2))


def test_gaps_that_touch_a_span() -> None:
    records = dates(1, 2, 5, 6, 10)
    assert long_gaps(records, 2.5 * SECONDS_PER_DAY, records[0], records[-1]) == [Gap(*records[1:3]), Gap(*records[3:])]
    assert long_gaps(records, 2.5 * SECONDS_PER_DAY, *dates(5, 6)) == []
    assert long_gaps(records, 2.5 * SECONDS_PER_DAY, *dates(4.9, 6)) == [Gap(*records[1:3])]
    assert long_gaps(records, 3.0 * SECONDS_PER_DAY, *dates(1, 6)) == []


def test_empty_records_are_found_whatever_row_has_the_values() -> None:
    """Against looking at everything: rows are read one by one only to be fast."""
    rng = np.random.default_rng(3)
    values = np.where(rng.random((40, 5, 6)) < 0.04, 1.0, np.nan)
    field = xr.DataArray(values, dims=("time", "lat", "lon"))
    expected = ~np.isfinite(values).any(axis=(1, 2))
    assert 0 < expected.sum() < 40
    np.testing.assert_array_equal(empty_records(field), expected)
    np.testing.assert_array_equal(empty_records(field.transpose("lat", "time", "lon")), expected)
    deep = xr.concat([field, xr.full_like(field, 1.0)], dim="depth")
    np.testing.assert_array_equal(empty_records(deep), expected)  # the uppermost level counts
