"""Plain twin of the sampling at the elements: value by value, in the words of `riftberg.ocean.product_records`."""

from __future__ import annotations

import math


def over_draft(column, limits, draft):
    """Mean of the levels with water from the surface to the draft; None without water."""
    parts = []
    for level, value in enumerate(column):
        thickness = max(0.0, min(draft, limits[level + 1]) - limits[level])
        if thickness > 0.0 and not math.isnan(value):
            parts.append((thickness, value))
    water = sum(thickness for thickness, _ in parts)
    return sum(thickness * value for thickness, value in parts) / water if water else None


def in_cell(corners, xi, eta):
    """Bilinear over the known ones of SW, SE, NW, NE; None if none is known."""
    weights = ((1 - xi) * (1 - eta), xi * (1 - eta), (1 - xi) * eta, xi * eta)
    known = [(w, q) for w, q in zip(weights, corners, strict=True) if q is not None and w > 1e-9]
    return sum(w * q for w, q in known) / sum(w for w, _ in known) if known else None


def near(record, limits, draft, j, i, reach=2):
    """Value of the nearest point within reach that knows one, in order of distance, then of row and column."""
    offsets = [(b, a) for b in range(-reach, reach + 1) for a in range(-reach, reach + 1)]
    offsets = [o for o in offsets if o[0] ** 2 + o[1] ** 2 <= reach**2]
    for b, a in sorted(offsets, key=lambda o: (o[0] ** 2 + o[1] ** 2, o)):
        row, column = j + b, i + a
        if 0 <= row < record.shape[1] and 0 <= column < record.shape[2]:
            value = over_draft(record[:, row, column], limits, draft)
            if value is not None:
                return value
    return None


def value_at(records, weight, limits, draft, cell, xi, eta, absent=None):
    """Value of a field at one place: in the cell (or near), then in time."""
    j, i = cell
    found = []
    for record in records:
        corners = [over_draft(record[:, j + b, i + a], limits, draft) for b in (0, 1) for a in (0, 1)]
        value = in_cell(corners, xi, eta)
        if value is None:
            value = near(record, limits, draft, j + (eta > 0.5), i + (xi > 0.5))
        found.append(absent if value is None else value)
    first, last = found
    if weight == 0.0 or last is None:
        return first if first is not None or weight == 0.0 else last
    return last if first is None else (1 - weight) * first + weight * last
