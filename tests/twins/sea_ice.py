"""Twin of the law of pack ice on rigid bergs: plain numbers, one element at a time, and the drift by an own root."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import least_squares

from twins import drag

P_STAR, DECAY, LEAST, LOCKED_FROM, LOCKED_STRENGTH, YIELD = 20e3, 20.0, 0.15, 0.86, 13e3, 1e-4


def strength(thickness, fraction):
    """What the pack bears on a metre of front, N."""
    return P_STAR * thickness / math.exp(DECAY * (1.0 - fraction))


def row(mass, front, share, thickness, fraction, draft, capture):
    """Quadratic coefficient (m-1), linear rate (s-1), limit (m s-2) and share of the waves of an element.

    ``front``: half the sum of length and width of its berg; ``share``: its part of the sides.
    """
    if fraction < LEAST:
        return 0.0, 0.0, 0.0, 1.0
    depth = min(thickness * fraction, draft)
    quadratic = drag.sea_ice(mass, front, depth, share, 0.1, 0.0, False, 0.9)
    bears = strength(thickness, fraction)
    held = depth > 0.0
    limit = bears * front * share / mass if capture == "limited" and held else 0.0
    dense = fraction >= LOCKED_FROM and bears >= LOCKED_STRENGTH
    return quadratic, 1.0 if capture == "locked" and held and dense else 0.0, limit, 1.0 - fraction


def hold(limit, velocity, ice):
    """Acceleration (m s-2) along the pack's velocity relative to the berg: limited, proportional below `YIELD`."""
    through = np.asarray(ice, float) - np.asarray(velocity, float)
    speed = math.hypot(*through)
    return limit * min(speed / YIELD, 1.0) * through / speed if speed > 0.0 else np.zeros(2)


def drift(length, width, thickness, latitude, wind, ice, depth, fraction, base, top, current=(0.0, 0.0), outline=False):
    """Velocity (m s-1) at which water, air, Coriolis force and a pack that holds are in balance on a rectangle.

    As the table that it is compared with: no slope but that of the current, no waves, no quadratic drag of the pack, and a
    corner rounded at `YIELD`, so that the root is found from anywhere. The sides face the axes; the water's drag on them is the
    mean over all directions, or with ``outline`` the integral over the four sides.
    """
    f, mass = 2 * 7.292e-5 * math.sin(math.radians(latitude)), 850.0 * thickness * length * width
    front, draft = 0.5 * (length + width), 850.0 / 1025.0 * thickness
    sides = 1025.0 * 0.45 * draft * (np.array([width, length]) if outline else front)
    air = 1.1 * (0.65 * front * (thickness - draft) + top * length * width)
    limit = strength(depth, fraction) * front

    def total(u):
        past = u - current
        speed = abs(past) if outline else math.hypot(*past)
        bottom = 1025.0 * base * length * width * math.hypot(*past)
        force = -(sides * speed + bottom) * past - air * math.hypot(*(u - wind)) * (u - wind)
        force += limit * (ice - u) / math.hypot(*(ice - u), YIELD)
        return (force + mass * f * np.array([u[1] - current[1], current[0] - u[0]])) / (limit + 1e6)

    wind, ice, current = (np.asarray(v, float) for v in (wind, ice, current))
    tries = (
        least_squares(total, start, xtol=1e-14, ftol=1e-14) for start in (ice, 0.3 * ice, [0.0, 0.0], [-0.02, 0.05])
    )
    return min(tries, key=lambda found: found.cost).x
