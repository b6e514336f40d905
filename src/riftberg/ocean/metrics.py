"""Lengths and areas of grid cells on the sphere and in the plane (equations 2.1, 10.5)."""

from __future__ import annotations

import numpy as np

from riftberg.state import Floats


def haversine(
    lon1: Floats | float, lat1: Floats | float, lon2: Floats | float, lat2: Floats | float, radius: float
) -> Floats:
    """Return great-circle distances.

    ``lon1``, ``lat1``, ``lon2``, ``lat2``: ends, degrees; ``radius``: radius of the sphere, m; returns distances, m: R
    2 atan2(sqrt a, sqrt(1 - a)), a = sin2(dlat/2) + cos lat1 cos lat2 sin2(dlon/2) (equations 10.5).
    """
    phi1, phi2 = np.radians(lat1), np.radians(lat2)
    across = np.sin(0.5 * np.radians(np.subtract(lon2, lon1))) ** 2
    a = np.sin(0.5 * (phi2 - phi1)) ** 2 + np.cos(phi1) * np.cos(phi2) * across
    return np.asarray(2.0 * radius * np.arctan2(np.sqrt(a), np.sqrt(np.maximum(1.0 - a, 0.0))))


def _sphere_edge(lon1: Floats, lat1: Floats, lon2: Floats, lat2: Floats) -> Floats:
    """Integral of sin(lat) dlon along an edge that is straight in longitude and latitude, rad."""
    turn = np.radians((lon2 - lon1 + 180.0) % 360.0 - 180.0)
    half = np.radians(0.5 * (lat2 - lat1))
    return np.asarray(turn * np.sin(np.radians(0.5 * (lat1 + lat2))) * np.sinc(half / np.pi))


def cell_areas(lon: Floats, lat: Floats, radius: float, latlon: bool) -> Floats:
    """Return areas (m2) of the cells between corners of shape (n + 1, m + 1); shape (n, m).

    On the sphere edges are straight in longitude and latitude, so that cells of a regular grid have the exact area
    R2 dlon |sin lat_n - sin lat_s| (equations 10.5).
    """
    corners = [(q[:-1, :-1], q[:-1, 1:], q[1:, 1:], q[1:, :-1]) for q in (lon, lat)]
    total = np.zeros_like(corners[0][0])
    for k in range(4):
        x1, x2 = corners[0][k], corners[0][(k + 1) % 4]
        y1, y2 = corners[1][k], corners[1][(k + 1) % 4]
        if latlon:
            total += _sphere_edge(x1, y1, x2, y2)
        else:
            # About the first corner, so that large coordinates cost no digits.
            total += 0.5 * ((x1 - corners[0][0]) * (y2 - corners[1][0]) - (x2 - corners[0][0]) * (y1 - corners[1][0]))
    return np.abs(total) * (radius**2 if latlon else 1.0)


def edge_lengths(lon: Floats, lat: Floats, radius: float, latlon: bool) -> tuple[Floats, Floats]:
    """Return (dx, dy): lengths (m) of the north and the east edge of each cell; shape of the corners.

    The first column of dx and the first row of dy belong to no cell and repeat their neighbours.
    """
    if latlon:
        north = haversine(lon[:, :-1], lat[:, :-1], lon[:, 1:], lat[:, 1:], radius)
        east = haversine(lon[:-1], lat[:-1], lon[1:], lat[1:], radius)
    else:
        north = np.hypot(np.diff(lon, axis=1), np.diff(lat, axis=1))
        east = np.hypot(np.diff(lon, axis=0), np.diff(lat, axis=0))
    return np.concatenate([north[:, :1], north], axis=1), np.concatenate([east[:1], east], axis=0)
