"""Displacements on the sphere as kilometres along and across a direction, and back."""

from __future__ import annotations

from typing import Final

import numpy as np

from riftberg.plane import unit_vectors
from riftberg.state import Floats

EARTH_KM: Final = 6371.0
"""Mean radius of the Earth, km."""


def distance(lon1: Floats | float, lat1: Floats | float, lon2: Floats | float, lat2: Floats | float) -> Floats:
    """Return great-circle distances, km."""
    east, north = local(lon1, lat1, lon2, lat2)
    return np.hypot(east, north)


def local(
    lon0: Floats | float, lat0: Floats | float, lon: Floats | float, lat: Floats | float
) -> tuple[Floats, Floats]:
    """Return kilometres east and north of a place, with the distance and first direction of the great circle."""
    a, b, b0 = np.radians(np.subtract(lon, lon0)), np.radians(lat), np.radians(lat0)
    east = np.cos(b) * np.sin(a)
    north = np.cos(b0) * np.sin(b) - np.sin(b0) * np.cos(b) * np.cos(a)
    sine = np.hypot(east, north)
    angle = np.arctan2(sine, np.sin(b0) * np.sin(b) + np.cos(b0) * np.cos(b) * np.cos(a))
    stretch = EARTH_KM * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0)
    return stretch * east, stretch * north


def moved(lon0: Floats | float, lat0: Floats | float, east: Floats, north: Floats) -> tuple[Floats, Floats]:
    """Return longitude and latitude of points kilometres east and north of a place; the inverse of `local`."""
    length = np.hypot(east, north)
    angle, b0 = length / EARTH_KM, np.radians(lat0)
    sine = np.divide(np.sin(angle), length, out=np.zeros_like(length), where=length > 0.0)
    lat = np.arcsin(np.clip(np.cos(angle) * np.sin(b0) + north * sine * np.cos(b0), -1.0, 1.0))
    lon = np.arctan2(east * sine, np.cos(b0) * np.cos(angle) - np.sin(b0) * north * sine)
    return (lon0 + np.degrees(lon) + 180.0) % 360.0 - 180.0, np.degrees(lat)


def carried_on(lon1: float, lat1: float, lon2: float, lat2: float, ratio: Floats) -> tuple[Floats, Floats]:
    """Return where a great circle from one place through another leads: ``ratio`` times as far again beyond the second."""
    first, second = unit_vectors(np.array(lon1), np.array(lat1)), unit_vectors(np.array(lon2), np.array(lat2))
    angle = np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)
    ahead = second * np.cos(angle) - first
    length = np.linalg.norm(ahead)
    turn = angle * np.asarray(ratio)[..., None]
    # Without motion there is no direction, and the turn is zero.
    place = second * np.cos(turn) + (ahead / length if length > 0.0 else ahead) * np.sin(turn)
    return np.degrees(np.arctan2(place[..., 1], place[..., 0])), np.degrees(
        np.arcsin(np.clip(place[..., 2], -1.0, 1.0))
    )


def along_across(east: Floats, north: Floats, heading: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return displacements along a heading (east and north, any length) and to the left of it."""
    e, n = np.divide(heading, np.hypot(*heading))
    return east * e + north * n, north * e - east * n
