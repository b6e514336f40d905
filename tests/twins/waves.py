"""Twin of the wave radiation force of equations 4.1."""

from __future__ import annotations

import numpy as np


def acceleration(wind, current, mass, freeboard, length, width):
    """Force per mass along the wind."""
    wind, current = np.asarray(wind, dtype=float), np.asarray(current, dtype=float)
    if not wind.any():
        return np.zeros(2)
    q = np.sum((wind - current) ** 2)
    amplitude = 0.5 * 0.02025 * q
    wave_length = 0.32 * q
    cut_off, top = 0.125 * wave_length, 0.25 * wave_length
    share = np.clip((length - cut_off) / ((top - cut_off) + 1e-30), 0.0, 1.0)
    harmonic = 2 * width * length / (width + length)
    size = 0.5 * 1025.0 / mass * 0.06 * share * 9.8 * amplitude * min(amplitude, freeboard) * harmonic
    return size * wind / np.sqrt(wind @ wind)


def acceleration_by_given(height, period, way, mass, freeboard, length, width):
    """Force per mass of waves of a significant height and a mean period (None: not known) that travel along ``way``."""
    way = np.asarray(way, dtype=float)
    amplitude = height / 2
    wave_length = 9.8 * period**2 / (2 * np.pi) if period else 0.32 * height / 0.02025
    cut_off, top = wave_length / 8, wave_length / 4
    share = np.clip((length - cut_off) / (top - cut_off), 0.0, 1.0)
    harmonic = 2 * width * length / (width + length)
    return (
        0.5
        * 1025.0
        / mass
        * 0.06
        * share
        * 9.8
        * amplitude
        * min(amplitude, freeboard)
        * harmonic
        * way
        / np.hypot(*way)
    )
