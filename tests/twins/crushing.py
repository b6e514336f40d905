"""Twin of contact by crushing: the law by bisection on its definition, overlaps of polygons by shapely."""

from __future__ import annotations

import numpy as np
import shapely


def law(depth, touched, crushed, stiffness, ratio, limit):
    """Force at a depth: the least of unloading, loading and crushing, and no pull."""
    return max(0.0, min(ratio * stiffness * (depth - crushed), stiffness * (depth - touched), limit))


def force(depth, touched, crushed, stiffness, ratio, limit, compliance):
    """Force that agrees with the motion which it causes: F = law(depth - compliance F), by bisection."""
    low, high = 0.0, law(depth, touched, crushed, stiffness, ratio, limit)
    for _ in range(200):
        middle = 0.5 * (low + high)
        if law(depth - compliance * middle, touched, crushed, stiffness, ratio, limit) > middle:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def overlap(one, two):
    """Area, centroid and chord of the overlap of two polygons; the chord from the edges of the first that lie in the second."""
    a, b = shapely.Polygon(one), shapely.Polygon(two)
    both = shapely.intersection(a, b)
    chord = np.zeros(2)
    for start, end in zip(one, np.roll(one, -1, axis=0), strict=True):
        part = shapely.intersection(shapely.LineString([start, end]), b)
        if part.geom_type == "LineString" and not part.is_empty:
            ends = np.asarray(part.coords)
            along = end - start
            chord += along * ((ends[-1] - ends[0]) @ along / (along @ along))
    return both.area, np.asarray(both.centroid.coords[0]) if both.area > 0.0 else np.zeros(2), chord


def distance(one, two):
    """Distance of two polygons."""
    return shapely.distance(shapely.Polygon(one), shapely.Polygon(two))


def pressed_flat(push, mass, chord, thickness, strength, depth, ratio, step):
    """Ways and crushing work of a block on a wall that pushes (N), one after the other, press for a step (s) each, at rest.

    Overlap and place go on by the new velocity (backward Euler); the force answers the damped overlap of the end.
    """
    stiffness = strength * thickness / depth
    x = v = crushed = work = force_before = 0.0
    places = []
    for p in push:
        free = v + step * p / mass
        per_speed = chord * (step + 2.0 / np.sqrt(stiffness * chord / mass))
        f = force(
            chord * x + per_speed * free, 0.0, crushed, stiffness, ratio, strength * thickness * chord,
            per_speed * step / mass,
        )  # fmt: skip
        v = free - step * f / mass
        x += step * v
        if f > 0.0 and chord * x - f / (ratio * stiffness) > crushed:
            crushed = chord * x - f / (ratio * stiffness)
            stored = 0.5 * (f**2 - force_before**2) / (ratio * stiffness * chord)
            work += max(step * f * v - stored, 0.0)
        force_before = f
        places.append(x)
    return np.array(places), work
