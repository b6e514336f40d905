"""Displacements along great circles of a sphere of 6371 km, by vectors: independent of those of the package."""

from __future__ import annotations

from typing import Any

import numpy as np

KM = 6371.0


def unit_vector(lon: Any, lat: Any) -> np.ndarray:
    """Return the direction from the centre of the Earth; components along the first axis."""
    a, b = np.radians(lon), np.radians(lat)
    return np.stack(np.broadcast_arrays(np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)))


def displace(lon: Any, lat: Any, east: Any, north: Any) -> tuple[Any, Any]:
    """Return longitude and latitude at the end of a great circle that begins so many km east and north; arrays or numbers."""
    a, b = np.radians(lon), np.radians(lat)
    to_east = np.stack(np.broadcast_arrays(-np.sin(a), np.cos(a), 0.0 * a))
    to_north = np.stack(np.broadcast_arrays(-np.sin(b) * np.cos(a), -np.sin(b) * np.sin(a), np.cos(b)))
    east, north = np.asarray(east, float), np.asarray(north, float)
    way = np.hypot(east, north)
    angle, (e, n) = way / KM, np.divide([east, north], np.where(way > 0.0, way, 1.0))
    shape = (3,) + (1,) * (e.ndim - np.ndim(lon))
    start, to_east, to_north = (
        v.reshape(shape) if v.ndim == 1 else v for v in (unit_vector(lon, lat), to_east, to_north)
    )
    x, y, z = start * np.cos(angle) + (to_east * e + to_north * n) * np.sin(angle)
    degrees = np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(np.clip(z, -1.0, 1.0)))
    return degrees if e.ndim or np.ndim(lon) else (float(degrees[0]), float(degrees[1]))


def distance(lon: Any, lat: Any, other_lon: Any, other_lat: Any) -> Any:
    """Return the length of the great circle between two positions, km."""
    a, b = unit_vector(lon, lat), unit_vector(other_lon, other_lat)
    return KM * np.arctan2(np.linalg.norm(np.cross(a, b, axis=0), axis=0), (a * b).sum(axis=0))
