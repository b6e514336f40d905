"""Places in degrees as people write them."""

from __future__ import annotations


def latitude(value: float, digits: int) -> str:
    """Return a latitude (degrees) such as ``55.02 S``."""
    return f"{abs(value):.{digits}f} {'S' if value < 0.0 else 'N'}"


def longitude(value: float, digits: int) -> str:
    """Return a longitude (degrees, on any turn) such as ``37.56 W``."""
    value = (value + 180.0) % 360.0 - 180.0
    return f"{abs(value):.{digits}f} {'W' if value < 0.0 else 'E'}"
