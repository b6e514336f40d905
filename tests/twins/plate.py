"""Slow, plain balance of a berg on the floor: small squares in place of polygons, and a root finder without a tangent."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.optimize import root
from scipy.special import kei

WATER = 1025.0 * 9.81
SHARE = (0.25, 0.3, 0.35, 0.46, 0.5, 0.6, 0.7, 0.92, 1.0)
KAPPA = (0.786, 0.875, 0.980, 1.377, 2.0, 2.44, 2.96, 4.92, 8.0)


class Balance(NamedTuple):
    """What was found."""

    q: np.ndarray
    load: float
    bending: np.ndarray


def balance(pads: Any, overlap: Any, hull: Any, length: float, bed: Any, fine: float = 20.0) -> Balance:
    """Rise and loads of a berg; ``overlap(x, y)`` without rise, m."""
    x, y, part, square = [], [], [], []
    keys = [tuple(s) for s in pads.square.tolist()]
    number = {key: n for n, key in enumerate(dict.fromkeys(keys))}
    for k, key in enumerate(keys):
        ring = shapely.Polygon(pads.corner[pads.start[k] : pads.start[k + 1]])
        west, south, east, north = ring.bounds
        n, m = (max(math.ceil((b - a) / fine), 2) for a, b in ((west, east), (south, north)))
        px, py = np.meshgrid(
            west + (np.arange(n) + 0.5) / n * (east - west), south + (np.arange(m) + 0.5) / m * (north - south)
        )
        inside = shapely.contains_xy(ring, px, py)
        x += px[inside].tolist()
        y += py[inside].tolist()
        part += [ring.area / inside.sum()] * int(inside.sum())
        square += [number[key]] * int(inside.sum())
    x, y, part, square, top = np.array(x), np.array(y), np.array(part), np.array(square), bed.strength / bed.stiffness
    d, count = overlap(x, y), len(number)
    middle = np.array([[np.average(v[square == i], weights=part[square == i]) for v in (x, y)] for i in range(count)])
    area, reach = np.bincount(square, part, count), math.sqrt(2.0) * length
    q, c, u = np.zeros(3), np.zeros(count), np.zeros(count)

    def pressed(q: Any, u: Any, most: float) -> Any:
        left = d - (q[0] + q[1] * y - q[2] * x) - u[square]
        return np.clip(left, 0.0, most) * part, left

    for most in (math.inf, top):
        volume, left = pressed(q, u, most)
        weight = np.bincount(square, volume, count)
        place = np.empty((count, 2))
        for i in range(count):
            mine = square == i
            place[i] = (
                [np.average(v[mine], weights=volume[mine]) for v in (x, y)]
                if weight[i] > 0.0 else [v[mine][left[mine].argmax()] for v in (x, y)]
            )  # fmt: skip
        r = np.hypot(*(place[:, None] - middle[None]).transpose(2, 0, 1)) / reach
        share = (area * np.clip(1.0 - r**2, 0.0, None) ** 2).sum(axis=1) / (math.pi * reach**2 / 3.0)
        kappa = np.interp(share, SHARE, KAPPA)
        r = np.hypot(*(place[:, None] - place[None]).transpose(2, 0, 1)) / length
        g = np.where(r < 9.98, -4.0 / math.pi * kei(np.maximum(r, 1e-12)), 0.0)
        np.fill_diagonal(g, 1.0)
        g /= WATER * length**2 * np.sqrt(kappa[:, None] * kappa[None])
        total = np.array([weight.sum(), (weight * place[:, 1]).sum(), -(weight * place[:, 0]).sum()])
        g *= max(1.0 - total @ np.linalg.solve(hull, total) / (weight @ g @ weight), 0.0)

        def residual(values: Any, g: Any = g) -> Any:
            q, c = values[:3], values[3:] * 1e8
            force = bed.stiffness * pressed(q, g @ c, top)[0]
            given = np.array([force.sum(), (force * y).sum(), -(force * x).sum()])
            load = np.bincount(square, force, count)
            return np.concatenate([np.linalg.solve(hull, given) - q, (load - c) / 1e8])

        found = root(residual, np.concatenate([q, c / 1e8]), method="hybr", options={"xtol": 1e-8, "maxfev": 40000})
        assert np.abs(found.fun).max() < 1e-3, found.message
        q, c = found.x[:3], found.x[3:] * 1e8
        u = g @ c
    loaded = np.bincount(square, pressed(q, u, top)[0], count) > 0.0
    return Balance(q, float(bed.stiffness * pressed(q, u, top)[0].sum()), u[loaded])
