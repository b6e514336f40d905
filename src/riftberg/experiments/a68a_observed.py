"""Observed state of A68a by day: centroid, heading and area, as numbers.

From the daily outlines of Huth et al. (2022), repository alex-huth/iKID_iceberg_A68a at b0bfa83 (digitised from MODIS
and Sentinel-1 images): centroid and area of each outline, azimuth of the long side of its least rectangle, degrees
clockwise from north. Until 23 December the outlines include the finger.
"""

from __future__ import annotations

from typing import NamedTuple


class ObservedDay(NamedTuple):
    """One day at about 13:00 UTC: day of December 2020, centroid (degrees), azimuth (degrees), area (km2)."""

    day: int
    lat: float
    lon: float
    azimuth: float
    area: float


A68A_OBSERVED = (
    ObservedDay(9, -55.0194, -39.2454, 99.0, 4151.0),
    ObservedDay(10, -55.0141, -38.9190, 113.0, 3269.0),
    ObservedDay(11, -55.0351, -38.6517, 116.0, 4090.0),
    ObservedDay(12, -55.0673, -38.3815, 129.0, 4235.0),
    ObservedDay(13, -55.1471, -38.1080, 145.0, 4057.0),
    ObservedDay(14, -55.2384, -37.8473, 163.0, 4285.0),
    ObservedDay(15, -55.3343, -37.6810, 175.0, 4081.0),
    ObservedDay(16, -55.4548, -37.4470, 8.0, 3965.0),
    ObservedDay(17, -55.6231, -37.3201, 13.0, 3891.0),
    ObservedDay(18, -55.7148, -37.1952, 172.0, 3984.0),
    ObservedDay(19, -55.8481, -37.1942, 5.0, 3861.0),
    ObservedDay(20, -56.0435, -37.0390, 4.0, 3909.0),
    ObservedDay(21, -56.2168, -36.9125, 174.0, 4025.0),
    ObservedDay(22, -56.3864, -36.7718, 172.0, 3959.0),
    ObservedDay(23, -56.5777, -36.5773, 164.0, 4180.0),
    ObservedDay(24, -56.6405, -36.4418, 16.0, 2133.0),
    ObservedDay(25, -56.8691, -36.2917, 9.0, 3080.0),
    ObservedDay(26, -57.0181, -36.0184, 177.0, 2776.0),
)
"""The observed days; those of 10 and 24 December saw only a part of the berg."""

REGION = (-41.5, -34.0), (-58.5, -54.0)
"""Longitudes and latitudes (degrees) that the berg and its pieces crossed until 27 December, with a margin."""

PARTIAL = (10, 24)
"""Days of December of which only a part of the berg was seen."""

PUBLISHED = {
    "break-up 1": "around 17 Dec, aground: the tip (A68D)",
    "break-up 2": "around 20 Dec, afloat: the finger",
    "wall time a day": "about 10 s (Xeon E5-2697 v4)",
}
"""What Huth et al. (2022) say of their run (text, Fig. 2, "Computational efficiency")."""

SEEN = {
    "break-up 1": "17 Dec, aground: 134 to 157 km² (A68D)",
    "break-up 2": "21 to 22 Dec, afloat: 595 to 652 km² (the finger)",
    "break-up 3": "seen 23 Dec: 222 to 226 km²",
    "largest piece at the end": "2596 to 2641 km² (23 to 25 Dec)",
}
"""What happened: Huth et al. (2022), and areas of the outlines in its repository."""
