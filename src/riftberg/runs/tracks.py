"""Where a berg is and which way it points: centroid and long axis of its elements.

The elements are projected orthographically onto the plane that touches the sphere at their centre; over a berg of
150 km lengths there are true to 1e-4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg import constants
from riftberg.plane import OrthographicPlane
from riftberg.state import Floats, Ints

if TYPE_CHECKING:
    from riftberg.model import BareModel

_TOLERANCE: Final = 1e-6  # s
_REMEMBERED: Final = "daily_track"


@dataclass(frozen=True)
class Position:
    """Place and heading of a berg."""

    lon: float  # Area-weighted centroid, degrees (metres on a Cartesian grid)
    lat: float  # Area-weighted centroid, degrees (metres on a Cartesian grid)
    azimuth: float  # Long axis, degrees clockwise from north, 0 to 180; NaN where no axis is longer
    area: float  # Plan area, m2


def long_axis(x: Floats, y: Floats, weight: Floats) -> float:
    """Azimuth of the axis of the largest second moment, degrees clockwise from north, 0 to 180.

    ``x``, ``y``: positions, m east and north.
    """
    dx, dy = x - np.average(x, weights=weight), y - np.average(y, weights=weight)
    xx, yy, xy = (float(np.average(p, weights=weight)) for p in (dx * dx, dy * dy, dx * dy))
    return principal_azimuth(xx, yy, xy)


def principal_azimuth(xx: float, yy: float, xy: float) -> float:
    """Return the azimuth of the larger principal axis of second moments about the centroid; NaN where both are equal."""
    if math.hypot(2.0 * xy, yy - xx) <= 1e-9 * (xx + yy):
        return math.nan
    return math.degrees(0.5 * math.atan2(2.0 * xy, yy - xx)) % 180.0


def berg_position(
    lon: Floats, lat: Floats, area: Floats, *, latlon: bool = True, radius: float = constants.EARTH_RADIUS_A68,
    period: float = 0.0,
) -> Position:  # fmt: skip
    """Return centroid, heading and area of the elements given.

    ``lon``, ``lat``: centres of the elements, degrees (metres where ``latlon`` is false); ``area``: their plan areas,
    m2; ``radius``: radius of the sphere, m; ``period``: length of a channel that comes round (m), where ``latlon`` is
    false.
    """
    if not latlon:
        x = lon - period * np.round((lon - lon[0]) / period) if period > 0.0 else lon
        centre = float(np.average(x, weights=area)), float(np.average(lat, weights=area))
        return Position(*centre, long_axis(x, lat, area), float(area.sum()))
    # A berg on the date line: differences to the first element are small, longitudes need not be.
    near = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0
    lon0, lat0 = float(np.average(near, weights=area)), float(np.average(lat, weights=area))
    plane = OrthographicPlane(lon0, lat0, radius)
    x, y = plane.forward(near, lat)
    mean = float(np.average(x, weights=area)), float(np.average(y, weights=area))
    lon_c, lat_c = plane.inverse(*(np.array(part) for part in mean))
    return Position(float(lon_c), float(lat_c), long_axis(x, y, area), float(area.sum()))


def main_berg(berg: Ints, area: Floats) -> int:
    """Return the number of the fragment with the largest area; the smallest number where two are equal."""
    numbers, index = np.unique(berg, return_inverse=True)
    return int(numbers[np.argmax(np.bincount(index, weights=area))])


def main_position(model: BareModel) -> Position:
    """Return place and heading of the largest fragment of a model."""
    e, earth = model.elements, model.parameters.earth
    area = e.length * e.width
    rows = e.berg == main_berg(e.berg, area)
    return berg_position(
        e.lon[rows], e.lat[rows], area[rows], latlon=earth.latlon, radius=earth.radius, period=earth.period
    )


class DailyTrack:
    """Recorder that keeps the position of the largest fragment once a day, at the hour of the start."""

    def __init__(self) -> None:
        self.rows: list[tuple[datetime, Position]] = []
        self._next = 0.0

    def start(self, model: BareModel) -> None:
        """Keep the first position; a resumed run knows the days before, and goes on at its next full day."""
        day = constants.SECONDS_PER_DAY
        known = getattr(model, "remembered", {}).get(_REMEMBERED, np.zeros((0, 5))).tolist()
        self.rows = [
            (model.start + timedelta(seconds=row[0]), Position(*row[1:])) for row in known if row[0] <= model.time
        ]
        self._next = day * math.ceil((model.time - _TOLERANCE) / day)
        if known and known[-1][0] >= self._next - _TOLERANCE:
            self._next += day
        else:
            self.record(model)

    def record(self, model: BareModel) -> None:
        """Keep the position where a day is full."""
        if model.time >= self._next - _TOLERANCE:
            position = main_position(model)
            self.rows.append((model.start + timedelta(seconds=model.time), position))
            self._next += constants.SECONDS_PER_DAY
            if hasattr(model, "remembered"):
                row = np.array([[model.time, position.lon, position.lat, position.azimuth, position.area]])
                model.remembered[_REMEMBERED] = np.concatenate([model.remembered.get(_REMEMBERED, row[:0]), row])

    def finish(self, model: BareModel) -> None:
        """Do nothing: the last day may be incomplete."""


def track_table(rows: Sequence[tuple[datetime, Position]]) -> list[dict[str, Any]]:
    """Return rows for a summary: time, lon, lat, azimuth (null where none), area in km2."""
    return [
        {
            "time": when.isoformat(),
            "lon": position.lon,
            "lat": position.lat,
            "azimuth": None if math.isnan(position.azimuth) else position.azimuth,
            "area_km2": position.area / 1e6,
        }
        for when, position in rows
    ]
