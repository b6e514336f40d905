"""Centroid and long axis."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes import FakeModel
from riftberg.diagnostics.summary import summarize
from riftberg.plane import EqualAreaPlane
from riftberg.runs.tracks import DailyTrack, berg_position

RADIUS = 6_363_827.0


def rectangle(azimuth: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points of a 100 km x 20 km rectangle whose long axis points to ``azimuth`` (degrees from north)."""
    along, across = np.meshgrid(np.linspace(-50e3, 50e3, 21), np.linspace(-10e3, 10e3, 5))
    s, c = math.sin(math.radians(azimuth)), math.cos(math.radians(azimuth))
    return (along * s + across * c).ravel(), (along * c - across * s).ravel()


@given(azimuth=st.floats(0.0, 179.9))
def test_long_axis_of_a_rectangle(azimuth: float) -> None:
    x, y = rectangle(azimuth)
    found = berg_position(x, y, np.ones_like(x), latlon=False).azimuth
    assert abs((found - azimuth + 90.0) % 180.0 - 90.0) < 1e-6
    assert 0.0 <= found < 180.0


def test_a_square_has_no_long_axis() -> None:
    x, y = np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0, 1.0])
    assert math.isnan(berg_position(x, y, np.ones(4), latlon=False).azimuth)


@pytest.mark.parametrize(("lon", "lat"), [(-39.2, -55.0), (179.9, -70.0), (0.0, 60.0)])
def test_azimuth_and_centroid_on_the_sphere(lon: float, lat: float) -> None:
    x, y = rectangle(113.0)
    places = np.column_stack(EqualAreaPlane(lon, lat, RADIUS).inverse(x, y))
    wrapped = (places[:, 0] + 180.0) % 360.0 - 180.0
    found = berg_position(wrapped, places[:, 1], np.full(len(x), 4e6), radius=RADIUS)
    assert abs((found.lon - lon + 180.0) % 360.0 - 180.0) < 1e-4
    assert found.lat == pytest.approx(lat, abs=1e-4)
    assert found.azimuth == pytest.approx(113.0, abs=0.01)
    assert found.area == pytest.approx(105 * 4e6)


def test_the_main_berg_of_a_model_has_the_largest_area_not_the_most_elements() -> None:
    """And of the sides of an element their product counts: three of 1 by 1 km, one of 3 by 2 km."""
    model = FakeModel(4, 1, latlon=False)
    e = model.elements
    e.length[:], e.width[:], e.berg[:] = [1e3, 1e3, 1e3, 3e3], [1e3, 1e3, 1e3, 2e3], [1, 1, 1, 2]
    track = DailyTrack()
    track.start(model)
    ((_, found),) = track.rows
    assert (found.lon, found.lat, found.area) == (e.lon[3], e.lat[3], 6e6)


def test_area_weighs() -> None:
    found = berg_position(np.array([0.0, 10.0]), np.array([0.0, 0.0]), np.array([3.0, 1.0]), latlon=False)
    assert (found.lon, found.lat, found.azimuth) == (2.5, 0.0, 90.0)


def test_daily_track_follows_drift_and_turn() -> None:
    model, track = FakeModel(20, 4, turn_per_day=-12.0, break_time=1e9), DailyTrack()
    model.advance(3.3, recorders=[track])
    assert [when for when, _ in track.rows] == [datetime(2020, 12, day, 13) for day in (9, 10, 11, 12)]
    assert [p.azimuth for _, p in track.rows] == pytest.approx([90.0, 102.0, 114.0, 126.0], abs=0.5)
    east = math.radians(track.rows[3][1].lon - track.rows[0][1].lon) * RADIUS * math.cos(math.radians(55.0))
    assert east == pytest.approx(0.2 * 3 * 86400, rel=1e-3)
    assert summarize(model, track=track.rows)["track"][1]["time"] == "2020-12-10T13:00:00"


def test_a_berg_on_the_seam_of_a_channel_is_put_together() -> None:
    """Bug: its centroid stood in the middle of the channel, and its long axis lay along it."""
    x, y = np.array([19.0, 0.5, 0.5, 19.5]) * 1e3, np.array([0.0, 4.0, 6.0, 2.0]) * 1e3
    found = berg_position(x, y, np.full(4, 1e6), latlon=False, period=20e3)
    assert (found.lon, found.lat) == (pytest.approx(19_875.0), pytest.approx(3000.0))
    assert found.azimuth == pytest.approx(
        berg_position(np.array([-1.0, 0.5, 0.5, -0.5]) * 1e3, y, np.full(4, 1e6), latlon=False).azimuth
    )


def test_a_lone_element_has_no_long_axis_whatever_its_place() -> None:
    """Bug: its second moments are round-off, so its axis pointed north, east or nowhere by chance."""
    for lon in np.linspace(-37.3, -37.2, 50):
        one = berg_position(np.array([lon]), np.array([-55.4 + 0.3 * lon]), np.array([9e6]), latlon=True)
        assert np.isnan(one.azimuth)


def test_a_resumed_track_has_the_days_before_at_their_dates() -> None:
    whole, before, after = (DailyTrack() for _ in range(3))
    FakeModel(turn_per_day=0.0).advance(3.0, recorders=[whole])
    model = FakeModel(turn_per_day=0.0)
    model.remembered = {}
    model.advance(1.5, recorders=[before])
    model.advance(1.5, recorders=[after])
    assert after.rows == whole.rows
