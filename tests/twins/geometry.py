"""Twin of equations 2.2 (metric), 2.3 (polar plane), 8.2 (nearest image) and the position update of 6.2 and 6.4."""

from __future__ import annotations

import numpy as np


def metric(latitude, latlon, radius):
    """Metres per unit of x and of y (equations 2.2)."""
    if not latlon:
        return np.array([1.0, 1.0])
    return np.array([np.pi / 180 * radius * np.cos(np.radians(latitude)), np.pi / 180 * radius])


def nearest_image(difference, period):
    """Shift by whole periods until the difference lies in [-period/2, period/2)."""
    if period <= 0:
        return difference
    while difference >= period / 2:
        difference -= period
    while difference < -period / 2:
        difference += period
    return difference


def separation(first, second, latlon, radius, period):
    """Metres from ``second`` to ``first``, both (x, y), by the metric of the mean latitude."""
    units = np.array([nearest_image(first[0] - second[0], period), first[1] - second[1]])
    return metric((first[1] + second[1]) / 2, latlon, radius) * units


def to_plane(lon, lat, radius):
    """Position on the polar plane: distance from the pole along the meridian, turned by the longitude."""
    distance = radius * np.radians(90 - lat)
    point = distance * np.exp(1j * np.radians(lon))
    return np.array([point.real, point.imag])


def from_plane(point, radius):
    """Longitude and latitude of a point of the polar plane (arc cosine and sign as in equations 2.3)."""
    x, y = point
    distance = np.hypot(x, y)
    lon = np.degrees(np.arccos(x / distance)) * (1.0 if y >= 0 else -1.0)
    return np.array([lon, 90 - np.degrees(distance / radius)])


def rotation(lon):
    """Matrix from (east, north) to the polar plane (equations 2.3); it is orthogonal, so its transpose goes back."""
    c, s = np.cos(np.radians(lon)), np.sin(np.radians(lon))
    return np.array([[-s, -c], [c, -s]])


def move(lon, lat, velocity, dt, latlon, radius):
    """Position after ``dt`` seconds; metric of the latitude before the move, polar plane north of 89 degrees."""
    velocity = np.asarray(velocity)
    if latlon and lat > 89:
        return from_plane(to_plane(lon, lat, radius) + dt * rotation(lon) @ velocity, radius)
    return np.array([lon, lat]) + dt * velocity / metric(lat, latlon, radius)


def add_velocity(lon, lat, velocity, acceleration, dt, latlon):
    """Velocity after ``dt`` seconds of an acceleration, by way of the polar plane north of 89 degrees."""
    velocity, acceleration = np.asarray(velocity), np.asarray(acceleration)
    if latlon and lat > 89:
        turn = rotation(lon)
        return turn.T @ (turn @ velocity + dt * (turn @ acceleration))
    return velocity + dt * acceleration
