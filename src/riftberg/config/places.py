"""Places, areas and lengths of time as people write them."""

from __future__ import annotations

import math
from typing import Final

POINTS: Final = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def place_text(lon: float, lat: float, *, latlon: bool, digits: int = 3) -> str:
    """Return a place such as ``55.02 S, 37.56 W``, or x and y of a Cartesian run in that order.

    ``lon``, ``lat``: degrees (a longitude on any turn), or x and y in m.
    """
    if latlon:
        lon = (lon + 180.0) % 360.0 - 180.0
        sides = "S" if lat < 0.0 else "N", "W" if lon < 0.0 else "E"
        return f"{abs(lat):.{digits}f} {sides[0]}, {abs(lon):.{digits}f} {sides[1]}"
    if max(abs(lon), abs(lat)) < 1e4:
        return f"x {lon:.6g} m, y {lat:.6g} m"
    return f"x {lon / 1e3:.6g} km, y {lat / 1e3:.6g} km"


def box_text(west: float, east: float, south: float, north: float, *, latlon: bool = True) -> str:
    """Return what a box covers: latitudes and longitudes in degrees, or x and y (m)."""
    if not latlon:
        return f"x {west:g} to {east:g} m, y {south:g} to {north:g} m"
    # More than once round has no letters; west of Greenwich comes before east of it.
    around = "all longitudes" if east - west >= 359.0 else f"{_degrees(west, 'WE')} to {_degrees(east, 'WE')}"
    return f"{_degrees(south, 'SN')} to {_degrees(north, 'SN')}, {around}"


def _degrees(value: float, letters: str) -> str:
    value = (value + 180.0) % 360.0 - 180.0 if letters == "WE" and value != 180.0 else value
    return f"{abs(value):g}{f' {letters[value > 0.0]}' if value else ''}"


def drift_text(east: float, north: float) -> str:
    """Return a way (m) as a distance and a point of the compass, such as ``12.3 km north-east``."""
    metres = math.hypot(east, north)
    towards = POINTS[round(math.degrees(math.atan2(east, north)) / 45.0) % 8]
    return f"{metres / 1e3:.3g} km {towards}" if metres >= 1e3 else f"{metres:.0f} m {towards}"


def area_text(area: float, *, squared: str = "2") -> str:
    """Return an area (m2) in km2, or in m2 where that is less than a hectare; ``squared`` is how the power is written."""
    km2 = area / 1e6
    if km2 >= 9.5:
        return f"{km2:,.0f} km{squared}" if squared != "2" else f"{km2:.0f} km{squared}"
    return f"{km2:.2g} km{squared}" if km2 >= 0.01 or area <= 0.0 else f"{area:.3g} m{squared}"


def duration_text(days: float) -> str:
    """Return a length of time (days) in the unit that suits it: ``17 days``, ``8.33 h``, ``10 s``."""
    seconds = 86_400.0 * days
    if seconds >= 86_400.0 * 0.999:
        return f"{days:g} day" + ("s" if days != 1.0 else "")
    if seconds >= 3.0 * 3600.0:
        return f"{seconds / 3600.0:.3g} h"
    return f"{seconds / 60.0:.3g} min" if seconds > 180.0 else f"{seconds:.3g} s"
