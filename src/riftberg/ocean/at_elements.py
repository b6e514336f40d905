"""Fields of a product at the elements: once in time, once in space, on the product's own points.

In space a field is bilinear over those of the four points around an element where it is known, their weights brought
to a sum of 1; where none of them is known (land) the nearest known point within `REACH` points counts. In time it is
linear between two records; where only one of them knows a value that one is taken. Currents on levels are averaged
over the draft at each point first.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.constants import EARTH_RADIUS_A68
from riftberg.products.mesh import Places, Points, beside
from riftberg.state import Floats, Ints

REACH: Final = 2
"""Points inland that the nearest known value is used."""

RINGS: Final = np.array(
    sorted(
        ((dj, di) for dj in range(-REACH, REACH + 1) for di in range(-REACH, REACH + 1) if math.hypot(dj, di) <= REACH),
        key=lambda ring: (math.hypot(*ring), ring),
    )
)
"""Rows and columns to a point near by, the nearest first."""

NO_RINGS: Final = RINGS[:0]
"""For maps: land stays land."""

SURFACE: Final = np.array([0.0, 1.0])
"""Limits (m) of the only layer of a field without levels."""


class Blend(NamedTuple):
    """A field at one time, between two records."""

    before: Floats  # Records around the time; NaN where nothing is known; shape (levels, rows, columns)
    after: Floats  # Records around the time; NaN where nothing is known; shape (levels, rows, columns)
    weight: float  # Weight of ``after``
    limits: Floats  # Depths (m) of the limits of the levels' layers; shape (levels + 1,)
    absent: float  # What counts where a record knows nothing; NaN if the other record is to count


@kernel
def mean_to_draft(levels: Floats, limits: Floats, draft: float, j: int, i: int) -> float:
    """Return the mean from the surface to a draft at one point; NaN where there is no water.

    ``u(D) = sum(u_l w_l) / sum(w_l)`` over the levels with water, ``w_l`` being the part of the layer of level ``l`` (between
    the limits ``l`` and ``l + 1``) that lies above ``D``. In water shallower than the draft the mean ends at the sea floor;
    below the last limit the last counts.

    ``levels``: values (shape (levels, rows, columns)); ``limits``: depths (m) of the limits, ascending from 0.
    """
    total, water = 0.0, 0.0
    for level in range(levels.shape[0]):
        share = min(draft, limits[level + 1]) - limits[level]
        if share <= 0.0:
            break
        value = levels[level, j, i]
        if value == value:
            total += share * value
            water += share
    return total / water if water > 0.0 else math.nan


@kernel
def blend_known(sw: float, se: float, nw: float, ne: float, xi: float, eta: float) -> float:
    """Return the bilinear value of those corners that are known (not NaN), weights brought to a sum of 1; else NaN."""
    total, share = 0.0, 0.0
    for k in range(4):
        # A loop over four numbers, not four blocks: south-west, south-east, north-west, north-east.
        value = sw if k == 0 else (se if k == 1 else (nw if k == 2 else ne))
        weight = (xi if k % 2 == 1 else 1.0 - xi) * (eta if k >= 2 else 1.0 - eta)
        if value == value:
            total += weight * value
            share += weight
    # A share below this is rounding of a weight that ought to be zero.
    return total / share if share > 1e-9 else math.nan


@kernel
def in_time(before: float, after: float, weight: float, absent: float) -> float:
    """Return the value between two records; where only one of them knows a value that one counts."""
    before = before if before == before else absent
    after = after if after == after else absent
    # At the very time of a record that one counts alone, gaps included.
    if weight <= 0.0 or after != after:
        return before if before == before or weight <= 0.0 else after
    return after if before != before else (1.0 - weight) * before + weight * after


@kernel
def _point_at(moment: Blend, draft: float, j: int, i: int) -> float:
    """Value of a point at the time of the moment."""
    before = mean_to_draft(moment.before, moment.limits, draft, j, i)
    if moment.weight <= 0.0:
        return in_time(before, before, 0.0, moment.absent)
    after = mean_to_draft(moment.after, moment.limits, draft, j, i)
    return in_time(before, after, moment.weight, moment.absent)


@kernel
def _nearest_known(levels: Floats, limits: Floats, draft: float, j: int, i: int, around: int, near: Ints) -> float:
    """Value of the nearest point that knows one, in the order of ``near``; NaN if none does."""
    for k in range(near.shape[0]):
        row, column = j + near[k, 0], i + near[k, 1]
        column = column % around if around > 0 else column
        if 0 <= row < levels.shape[1] and 0 <= column < levels.shape[2]:
            value = mean_to_draft(levels, limits, draft, row, column)
            if value == value:
                return value
    return math.nan


@kernel
def _record_at(
    levels: Floats, limits: Floats, draft: float, corners: tuple[int, int, int, int], xi: float, eta: float,
    around: int, near: Ints,
) -> float:  # fmt: skip
    """Value of one record in a cell."""
    j, i, j1, i1 = corners
    value = blend_known(
        mean_to_draft(levels, limits, draft, j, i), mean_to_draft(levels, limits, draft, j, i1),
        mean_to_draft(levels, limits, draft, j1, i), mean_to_draft(levels, limits, draft, j1, i1), xi, eta,
    )  # fmt: skip
    if value == value:
        return value
    # No corner is known: from the corner nearest to the place outward.
    return _nearest_known(levels, limits, draft, j1 if eta > 0.5 else j, i1 if xi > 0.5 else i, around, near)


@kernel
def fill_values(moment: Blend, places: Places, draft: Floats, columns: int, near: Ints, out: Floats) -> None:
    """Fill a field at many places; NaN where it is unknown, and outside.

    ``draft``: drafts, m.
    """
    before, after, weight, limits, absent = moment
    for n in range(out.size):
        if places.row[n] < 0:
            out[n] = math.nan
            continue
        corners = (places.row[n], places.column[n], places.next_row[n], places.next_column[n])
        xi, eta = places.xi[n], places.eta[n]
        first = _record_at(before, limits, draft[n], corners, xi, eta, columns, near)
        last = first if weight <= 0.0 else _record_at(after, limits, draft[n], corners, xi, eta, columns, near)
        out[n] = in_time(first, last, weight, absent)


@kernel
def gradient(q_xi: float, q_eta: float, along: tuple[float, float], across: tuple[float, float]) -> tuple[float, float]:
    """Return the slope to the east and north from the changes of a quantity along both sides of a cell.

    ``(dq/dxi, dq/deta) = J (dq/dE, dq/dN)``, the rows of ``J`` being the sides (east, north) in m: grids may be turned or
    skewed. 0 where the sides enclose nothing.
    """
    area = along[0] * across[1] - along[1] * across[0]
    if area == 0.0 or area != area:
        return 0.0, 0.0
    return (q_xi * across[1] - q_eta * along[1]) / area, (along[0] * q_eta - across[0] * q_xi) / area


@kernel
def _across_cell(sw: float, se: float, nw: float, ne: float, xi: float, eta: float) -> tuple[float, float]:
    """Changes of a bilinear quantity along both sides of a cell."""
    return (1.0 - eta) * (se - sw) + eta * (ne - nw), (1.0 - xi) * (nw - sw) + xi * (ne - se)


@kernel
def fill_vorticity(
    east: Blend, north: Blend, places: Places, points: Points, lon: Floats, lat: Floats, draft: Floats, out: Floats
) -> None:
    """Fill the vorticity ``dv/dE - du/dN`` (s-1) of a current; 0 where a point around does not know it.

    ``lon``, ``lat``: positions of the places, degrees.
    """
    x, y = points.lon, points.lat
    for n in range(out.size):
        j, i, j1, i1 = places.row[n], places.column[n], places.next_row[n], places.next_column[n]
        xi, eta, d = places.xi[n], places.eta[n], draft[n]
        e0, n0 = beside(x[j, i], y[j, i], lon[n], lat[n])
        e1, n1 = beside(x[j, i1], y[j, i1], lon[n], lat[n])
        e2, n2 = beside(x[j1, i], y[j1, i], lon[n], lat[n])
        e3, n3 = beside(x[j1, i1], y[j1, i1], lon[n], lat[n])
        e_xi, e_eta = _across_cell(e0, e1, e2, e3, xi, eta)
        n_xi, n_eta = _across_cell(n0, n1, n2, n3, xi, eta)
        u_xi, u_eta = _across_cell(
            _point_at(east, d, j, i), _point_at(east, d, j, i1), _point_at(east, d, j1, i), _point_at(east, d, j1, i1),
            xi, eta,
        )  # fmt: skip
        v_xi, v_eta = _across_cell(
            _point_at(north, d, j, i), _point_at(north, d, j, i1),
            _point_at(north, d, j1, i), _point_at(north, d, j1, i1), xi, eta,
        )  # fmt: skip
        _, u_north = gradient(u_xi, u_eta, (e_xi, n_xi), (e_eta, n_eta))
        v_east, _ = gradient(v_xi, v_eta, (e_xi, n_xi), (e_eta, n_eta))
        turn = (v_east - u_north) / EARTH_RADIUS_A68
        out[n] = turn if turn == turn else 0.0


@kernel
def _faces(position: float, first: int, last: int, around: int) -> tuple[int, int, float]:
    """Two neighbouring faces around a position between points, and the weight of the second one.

    Face ``k`` lies half-way between the points ``k`` and ``k + 1``; beyond the outermost the outermost counts.
    """
    # Up to the middle of the cell the place lies behind face ``first``, from there on before it.
    lower = first if position >= 0.5 else first - 1
    weight = position - 0.5 if position >= 0.5 else position + 0.5
    if around > 0:
        return lower % around, (lower + 1) % around, weight
    return min(max(lower, 0), last), min(max(lower + 1, 0), last), weight


@kernel
def _change(
    level: Blend, points: Points, j: int, i: int, j1: int, i1: int, lon: float, lat: float
) -> tuple[float, float, float]:
    """Change of the field, and of the position to the east and north (rad), from one point to the next."""
    e0, n0 = beside(points.lon[j, i], points.lat[j, i], lon, lat)
    e1, n1 = beside(points.lon[j1, i1], points.lat[j1, i1], lon, lat)
    step = _point_at(level, 1.0, j1, i1) - _point_at(level, 1.0, j, i)
    return (step if step == step else 0.0), e1 - e0, n1 - n0


@kernel
def fill_slopes(
    level: Blend, places: Places, points: Points, lon: Floats, lat: Floats, out_x: Floats, out_y: Floats
) -> None:
    """Fill the slope of the sea surface to the east and north.

    Changes half-way between points, 0 beside land, are interpolated linearly to the place (as in equations 3.2), and so are
    the distances between the points: the slope of a plane is exact on any grid.

    ``level``: sea level, m.
    """
    rows, columns = points.lon.shape
    for n in range(out_x.size):
        j, i, j1, i1 = places.row[n], places.column[n], places.next_row[n], places.next_column[n]
        xi, eta = places.xi[n], places.eta[n]
        west, east, right = _faces(xi, i, columns - 2, points.columns)
        south, north, upper = _faces(eta, j, rows - 2, 0)
        q_xi = e_xi = n_xi = q_eta = e_eta = n_eta = 0.0
        for k in range(4):
            second = k % 2 == 1
            side = (right if second else 1.0 - right) * (eta if k >= 2 else 1.0 - eta)
            column, row = east if second else west, j1 if k >= 2 else j
            beyond = (column + 1) % points.columns if points.columns > 0 else column + 1
            q, e, m = _change(level, points, row, column, row, beyond, lon[n], lat[n])
            q_xi, e_xi, n_xi = q_xi + side * q, e_xi + side * e, n_xi + side * m
            side = (upper if second else 1.0 - upper) * (xi if k >= 2 else 1.0 - xi)
            row, column = north if second else south, i1 if k >= 2 else i
            q, e, m = _change(level, points, row, column, row + 1, column, lon[n], lat[n])
            q_eta, e_eta, n_eta = q_eta + side * q, e_eta + side * e, n_eta + side * m
        # Positions are in rad, so the slope is per rad until it is divided by the radius.
        slope = gradient(q_xi, q_eta, (e_xi, n_xi), (e_eta, n_eta))
        out_x[n], out_y[n] = slope[0] / EARTH_RADIUS_A68, slope[1] / EARTH_RADIUS_A68


@kernel
def add_shore_drift(
    moment: Blend, places: Places, points: Points, lon: Floats, lat: Floats, speed: float, out_x: Floats, out_y: Floats
) -> None:
    """Add a current away from land (m s-1): ``speed`` times how much more water there is on one side of the cell."""
    x, y = points.lon, points.lat
    for n in range(out_x.size):
        j, i, j1, i1 = places.row[n], places.column[n], places.next_row[n], places.next_column[n]
        known = np.zeros(4)
        for k in range(4):
            value = _point_at(moment, 1.0, j1 if k >= 2 else j, i1 if k % 2 == 1 else i)
            known[k] = 1.0 if value == value else 0.0
        eastward, northward = (
            0.5 * (known[1] + known[3] - known[0] - known[2]),
            0.5 * (known[2] + known[3] - known[0] - known[1]),
        )
        e0, n0 = beside(x[j, i], y[j, i], lon[n], lat[n])
        e1, n1 = beside(x[j, i1], y[j, i1], lon[n], lat[n])
        e2, n2 = beside(x[j1, i], y[j1, i], lon[n], lat[n])
        length, height = math.hypot(e1 - e0, n1 - n0), math.hypot(e2 - e0, n2 - n0)
        if length > 0.0 and height > 0.0:
            out_x[n] += speed * (eastward * (e1 - e0) / length + northward * (e2 - e0) / height)
            out_y[n] += speed * (eastward * (n1 - n0) / length + northward * (n2 - n0) / height)
