"""Heave, tilt and bending of a fragment on the floor: the rise of its keel at which water and bed carry its weight together.

The rise of a point of the keel is ``z + tx y - ty x + u``: heave and tilts about the centroid of the water plane, q, and the
bending of its pad, ``u = G N`` under the loads of all pads, with the compliance G of a plate on water (`.plate`)
between the places where they act, less that of the same ice against heave and tilts. q and coefficients c, which are the loads in
the end, minimise

    q K q / 2 + c G c / 2 + sum over pads k_v integral (<d>^2 - <d - q_u / k_v>^2) / 2

which is convex: Newton's method, with its exact tangent and corrections halved until the energy falls, finds them from zero,
or, that failing, from the balance on a bed that does not yield. Where the load of a pad acts follows from the overlap that is
left where the keel is lifted until the bed would yield nowhere, and then from the pressure that was found; of a pad that bears
nothing it is where it would touch first. Ice that does not bend is one square without compliance.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.common.bed import Bed
from riftberg.engines.quasi_static.ground.pads import (
    CLEAR,
    CORNERS,
    Pads,
    measure_ice_share,
)
from riftberg.engines.quasi_static.ground.plate import (
    Plates,
    bend_plate,
    cubics,
    fit_plate,
    list_unknowns,
)
from riftberg.physics.geometry import solve
from riftberg.physics.seabed import WATER_STIFFNESS, bending_stress, plate_deflection, pressed
from riftberg.state import Floats, Ints

MAX_ITERATIONS: Final = 50
"""Of Newton's method in one search; four to ten are usual."""

EXACT: Final = 1e-16
ROUGH: Final = 1e-6
LATE: Final = 1e-9
"""Part of the energy by which the last correction may lower it: in the balance, in one that only leads to where loads act, and
after twenty corrections, which move within round-off."""

STAGES: Final = 2
"""How often it is found where loads act: once it leads to 1 to 8 % of the load of a berg aground, twice to 0.3 %."""

MOST_PADS: Final = 150
"""Loaded pads that bend one by one; of more, squares of 2, 4, ... sides bend as one."""

CLIFF: Final = 1.0
"""Slope from which a plane is no floor of second order: land of no known depth beside deep water, 45 degrees."""

DIMPLE: Final = 0.14
"""Bending length of what the cubics of an element miss under a load, over its side: an endless plate on a stiffer bed. Without it
the deflection under a load is 3.3 to 3.9 % too small on average of 150 points (sides of 0.92 to 1 ``lambda``)."""

GRAZE: Final = 0.01
"""Where the floor meets a square along a line, round-off decides which of its corners touches first: its load acts as if it
overlapped the bed by so much, m."""

SLIVER: Final = 1e-10
"""Part of a pad that counts as none: its compliance would overflow, and where its load acts would be round-off over round-off."""


class Footing(NamedTuple):
    """A fragment over the floor: the overlap of its polygons without rise, a plane over each, and what resists the rise."""

    polygons: Ints  # Those that may touch the floor, by their numbers in `Pads`
    plane: Floats  # Overlap at the centroid of each, m, and its slopes; shape (polygons, 3)
    gradient: Floats  # Of the overlap by which the floor pushes; shape (polygons, 2)
    highest: Floats  # Largest overlap of each, m
    hull: Floats  # Stiffness of the water against heave and tilts; shape (3, 3)
    stiffness: float  # Of the bed, Pa m-1
    top: float  # Overlap from which its pressure grows no more, m
    side: float  # Of the pads, m
    piece: Floats  # Room for the corners of a polygon
    room: Floats  # Room for those of what is cut off it
    sums: Floats  # Its integrals (`pressed`); shape (10,)


class Squares(NamedTuple):
    """Squares of ice that bend as one, on the way to the balance."""

    polygons: Ints  # Those in them, by their places in `Footing`
    square: Ints  # Number of the square of each
    compliance: Floats  # G, m N-1; shape (squares, squares)
    coefficient: Floats  # c, N
    bending: Floats  # u, m
    load: Floats  # N
    elastic: Floats  # Stiffness of what is pressed elastically, N m-1
    mixed: Floats  # The same with its moments: heave, both tilts; shape (squares, 3)
    position: Floats  # Where the load acts, m; shape (squares, 2)


PRESSED: Final = 12
LOAD, LOAD_X, LOAD_Y, HOLD, PUSH_X, PUSH_Y, LIFT, STRESS, YIELD, SPREAD_XX, SPREAD_XY, SPREAD_YY = range(PRESSED)
"""Effect of the floor on an element: load (N), where it acts (m, along the axes of the fragment), largest friction (N), push by
the slope of the floor (N, the same axes), largest lift of the keel (m), bending stress (Pa), how deep the bed yields (m), and
the variances of where friction acts (m2, the same axes)."""


SMOOTH: Final = 0.25
"""How far (m) the plane of a pad may stand above its shallowest point, as on the side of a knoll: at most as far as a floor of
second order leads it."""


@borrower
def _lay_planes(pads: Pads, footing: Footing, depth: Floats, sounding: Ints, draft: Floats, level: float) -> float:
    """Lay a plane through the overlap of each polygon without rise; returns the largest overlap, or minus the clearance (m).

    Its mean is Simpson's, exact for floors of second order, its gradient the mean one. ``depth``, ``sounding``: as in
    `press`.
    """
    largest, asked, corner = -math.inf, depth.size - footing.polygons.size, footing.piece
    for m in range(footing.polygons.size):
        k = footing.polygons[m]
        first, size, keel = pads.start[k], pads.start[k + 1] - pads.start[k], draft[pads.owner[k]] - level
        x, y, mx, my, mv = pads.centre[k, 0], pads.centre[k, 1], 0.0, 0.0, 0.0
        shallow = deep = depth[asked + m]
        for n in range(size):
            c = first + n
            corner[n, 0], corner[n, 1], corner[n, 2] = pads.corner[c, 0], pads.corner[c, 1], depth[sounding[c]]
            mx += corner[n, 0] / size
            my += corner[n, 1] / size
            shallow, deep = min(shallow, corner[n, 2]), max(deep, corner[n, 2])
        # A plane through a cliff would overshoot into the keel: water beside it counts as no deeper than such a slope makes it.
        drop = CLIFF * 2.0 * math.hypot(corner[0, 0] - mx, corner[0, 1] - my)
        cliff = deep - shallow > drop
        deepest = shallow + drop if cliff else math.inf
        for n in range(size):
            corner[n, 2] = keel - min(corner[n, 2], deepest)
            mv += corner[n, 2] / size
        gx = gy = area = mean = 0.0
        for n in range(size):
            o = n + 1 if n + 1 < size else 0
            x0, y0, v0, x1, y1, v1 = corner[n, 0], corner[n, 1], corner[n, 2], corner[o, 0], corner[o, 1], corner[o, 2]
            gx += 0.5 * (v0 + v1) * (y1 - y0)
            gy -= 0.5 * (v0 + v1) * (x1 - x0)
            triangle = 0.5 * ((x0 - mx) * (y1 - my) - (x1 - mx) * (y0 - my))
            area += triangle
            mean += triangle * (mv + v0 + v1) / 3.0
        gx, gy, mean = gx / area, gy / area, mean / area
        middle = keel - min(depth[asked + m], deepest)
        mean += 2.0 / 3.0 * (middle - mean)
        # Where the floor has an edge its mean slope leads the plane far above the shallowest point.
        top, rise, share = keel - shallow + min(max(2.0 / 3.0 * (middle - mv), 0.0), SMOOTH), -math.inf, 1.0
        for n in range(size):
            rise = max(rise, gx * (corner[n, 0] - x) + gy * (corner[n, 1] - y))
        if rise > 0.0 and mean + rise > top:
            share = max(top - mean, 0.0) / rise
        # A step in the floor stays where it is while the berg moves a little: a push by it would be energy out of nothing.
        footing.gradient[m, 0], footing.gradient[m, 1] = 0.0 if cliff else gx, 0.0 if cliff else gy
        footing.plane[m, 0], footing.plane[m, 1], footing.plane[m, 2] = mean, share * gx, share * gy
        footing.highest[m] = mean + share * rise
        largest = max(largest, footing.highest[m])
    return largest


@kernel
def _group_in_squares(pads: Pads, b: int, footing: Footing, margin: float, bends: bool) -> tuple[Squares, int]:
    """Group polygons that are clear by less than ``margin`` m in squares that bend as one, and return their sides in pads too."""
    polygons = np.flatnonzero(footing.highest > -margin)
    square, rows, columns = np.zeros(polygons.size, np.int64), pads.shape[b, 0], pads.shape[b, 1]
    merged = count = 1
    while bends:
        wide = (columns - 1) // merged + 1
        number, count = np.full(((rows - 1) // merged + 1) * wide, -1), 0
        for m in range(polygons.size):
            k = footing.polygons[polygons[m]]
            s = (pads.square[k, 0] // merged) * wide + pads.square[k, 1] // merged
            if number[s] < 0:
                number[s] = count
                count += 1
            square[m] = number[s]
        if count <= MOST_PADS:
            break
        merged *= 2
    squares = Squares(
        polygons, square, np.zeros((count, count)), np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count),
        np.zeros((count, 3)), np.zeros((count, 2)),
    )  # fmt: skip
    return squares, merged


@borrower
def _rise(q: Floats, x: float, y: float) -> float:
    """Rise (m) of a point by heave and tilts."""
    return float(q[0] + q[1] * y - q[2] * x)


@borrower
def _lower_plane(pads: Pads, footing: Footing, p: int, q: Floats, bending: float) -> tuple[float, float, float]:
    """Overlap that rise and bending leave at the centroid of a polygon, m, and its slopes."""
    k = footing.polygons[p]
    middle = footing.plane[p, 0] - _rise(q, pads.centre[k, 0], pads.centre[k, 1]) - bending
    return middle, footing.plane[p, 1] + q[2], footing.plane[p, 2] - q[1]


@borrower
def _find_overlap(pads: Pads, footing: Footing, p: int, q: Floats, bending: float) -> tuple[int, float]:
    """Find the overlap that rise and bending leave at the corners of a polygon; returns their number and the largest (m)."""
    k, piece, highest = footing.polygons[p], footing.piece, -math.inf
    first, size, x, y = pads.start[k], pads.start[k + 1] - pads.start[k], pads.centre[k, 0], pads.centre[k, 1]
    middle, slope_x, slope_y = _lower_plane(pads, footing, p, q, bending)
    for n in range(size):
        piece[n, 0], piece[n, 1] = pads.corner[first + n, 0], pads.corner[first + n, 1]
        piece[n, 2] = middle + slope_x * (piece[n, 0] - x) + slope_y * (piece[n, 1] - y)
        highest = max(highest, piece[n, 2])
    return size, highest


@borrower
def _is_clear(pads: Pads, footing: Footing, p: int, q: Floats, bending: float) -> bool:
    """Whether rise and bending leave nothing of the overlap of a polygon, as far as its plane and its radius tell."""
    middle, slope_x, slope_y = _lower_plane(pads, footing, p, q, bending)
    radius = pads.radius[footing.polygons[p]]
    return bool(middle < 0.0 and (slope_x * slope_x + slope_y * slope_y) * radius**2 < middle * middle)


@borrower
def _bears(sums: Floats, highest: float, side: float) -> bool:
    """Whether a pad with these integrals of the overlap bears load: one that grazes the floor along an edge has no area there."""
    return bool(highest > 0.0 and sums[0] > SLIVER * highest * side * side)


@kernel
def _add_shape(pads: Pads, b: int, k: int, per: int, x: float, y: float, weight: float, shape: Floats) -> None:
    """Add the share of the unknowns of the element of polygon ``k`` in the rise at a point in it, times a weight."""
    of_x, of_y, h = np.empty(4), np.empty(4), per * pads.side[b]
    cubics((x - pads.low[b, 0]) / h - pads.square[k, 1] // per, 0, of_x)
    cubics((y - pads.low[b, 1]) / h - pads.square[k, 0] // per, 0, of_y)
    for n in range(16):
        shape[n] += weight * of_x[n // 4] * of_y[n % 4]


@kernel
def _place_loads(
    pads: Pads, plates: Plates, b: int, footing: Footing, sq: Squares, q: Floats, shape: Floats, which: Ints
) -> None:  # fmt: skip
    """Find where the loads of squares act, and the share of the unknowns ``which`` of the plate in the rise there (``shape``).

    Of a square that bears little or nothing as if it were pressed in until some of it overlaps the bed by `GRAZE`.
    """
    count, per, sums, margin = sq.load.size, plates.per_side[b], footing.sums, min(footing.top, GRAZE)
    weight, highest, polygon = np.zeros((count, 3)), np.full(count, -math.inf), np.empty(count, np.int64)
    for m in range(sq.polygons.size):
        i, p = sq.square[m], sq.polygons[m]
        if not _is_clear(pads, footing, p, q, sq.bending[i] + min(highest[i], 0.0)):
            highest[i] = max(highest[i], _find_overlap(pads, footing, p, q, sq.bending[i])[1])
    for m in range(sq.polygons.size):
        i, p = sq.square[m], sq.polygons[m]
        rise = sq.bending[i] - max(margin - highest[i], 0.0)
        polygon[i] = k = footing.polygons[p]
        if _is_clear(pads, footing, p, q, rise):
            continue
        size, _ = _find_overlap(pads, footing, p, q, rise)
        pressed(footing.piece, size, footing.top, footing.room, sums)
        if _bears(sums, margin, footing.side):
            _add_shape(pads, b, k, per, sums[1] / sums[0], sums[2] / sums[0], sums[0], shape[i])
            for n in range(3):
                weight[i, n] += sums[n]
    for i in range(count):
        k = polygon[i]
        if weight[i, 0] == 0.0:  # a sliver of ice
            weight[i, 0], weight[i, 1], weight[i, 2] = 1.0, pads.centre[k, 0], pads.centre[k, 1]
            _add_shape(pads, b, k, per, weight[i, 1], weight[i, 2], 1.0, shape[i])
        sq.position[i, 0], sq.position[i, 1] = weight[i, 1] / weight[i, 0], weight[i, 2] / weight[i, 0]
        for n in range(16):
            shape[i, n] /= weight[i, 0]
        j, n, nodes = pads.square[k, 0] // per, pads.square[k, 1] // per, plates.node[plates.node_start[b] :]
        list_unknowns(nodes, plates.columns[b], j, n, which[i])


@kernel
def _set_compliance(
    pads: Pads, plates: Plates, b: int, footing: Footing, sq: Squares, single: bool, q: Floats, length: float
) -> None:
    """Find where the loads of squares act, and the compliance of the plate there beyond heave and tilts.

    ``single``: whether squares are single pads.
    """
    count, rigid, heaved = sq.load.size, plates.rigid[b], np.empty(3)
    shape, which = np.zeros((count, 16)), np.empty((count, 16), np.int64)
    _place_loads(pads, plates, b, footing, sq, q, shape, which)
    bend_plate(plates, b, shape, which, sq.compliance)
    narrow = DIMPLE * min(plates.per_side[b] * footing.side, math.sqrt(2.0) * length)
    dimple = (narrow / length) ** 2 / (8.0 * WATER_STIFFNESS * length * length)
    for i in range(count):
        for n in range(3):
            heaved[n] = _rise(rigid[n], sq.position[i, 0], sq.position[i, 1])
        for j in range(i + 1):
            value = sq.compliance[i, j] - _rise(heaved, sq.position[j, 0], sq.position[j, 1])
            if single:
                dx, dy = sq.position[i, 0] - sq.position[j, 0], sq.position[i, 1] - sq.position[j, 1]
                value += dimple * plate_deflection(math.sqrt(dx**2 + dy**2) / narrow)
            sq.compliance[i, j] = sq.compliance[j, i] = value


@borrower
def _apply(matrix: Floats, vector: Floats, out: Floats) -> None:
    """``out = matrix vector`` with a symmetric matrix."""
    out[:] = 0.0
    for j in range(vector.size):
        value, row = vector[j], matrix[j]
        if value != 0.0:
            for i in range(out.size):
                out[i] += value * row[i]


@borrower
def _sum_up(
    pads: Pads, footing: Footing, sq: Squares, q: Floats, top: float, gradient: Floats, hessian: Floats
) -> float:
    """Find loads and stiffness of the squares, gradient and Hessian by the rise; returns the energy (J)."""
    energy, sums, hull = 0.0, footing.sums, footing.hull
    for i in range(3):
        gradient[i] = 0.0
        for j in range(3):
            gradient[i] += hull[i, j] * q[j]
            hessian[i, j] = hull[i, j]
        energy += 0.5 * q[i] * gradient[i]
    for i in range(sq.load.size):
        energy += 0.5 * sq.coefficient[i] * sq.bending[i]
        sq.load[i] = sq.elastic[i] = sq.mixed[i, 0] = sq.mixed[i, 1] = sq.mixed[i, 2] = 0.0
    for m in range(sq.polygons.size):
        i = sq.square[m]
        # Most of them are clear: that is seen without their corners.
        if _is_clear(pads, footing, sq.polygons[m], q, sq.bending[i]):
            continue
        size, highest = _find_overlap(pads, footing, sq.polygons[m], q, sq.bending[i])
        if highest <= 0.0:
            continue
        pressed(footing.piece, size, top, footing.room, sums)
        for n in range(10):
            sums[n] *= footing.stiffness
        energy += sums[9]
        gradient[0] -= sums[0]
        gradient[1] -= sums[2]
        gradient[2] += sums[1]
        hessian[0, 0] += sums[3]
        hessian[0, 1] += sums[5]
        hessian[0, 2] -= sums[4]
        hessian[1, 1] += sums[8]
        hessian[1, 2] -= sums[7]
        hessian[2, 2] += sums[6]
        sq.load[i] += sums[0]
        sq.elastic[i] += sums[3]
        sq.mixed[i, 0] += sums[3]
        sq.mixed[i, 1] += sums[5]
        sq.mixed[i, 2] -= sums[4]
    hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]
    for i in range(sq.load.size):
        if sq.elastic[i] < SLIVER * footing.stiffness * footing.side**2:
            sq.elastic[i] = sq.mixed[i, 0] = sq.mixed[i, 1] = sq.mixed[i, 2] = 0.0
    return energy


@borrower
def _solve_loaded(matrix: Floats, right: Floats) -> None:
    """Solve for right-hand sides, in rows, in place by Cholesky's factors, which overwrite the upper half of the matrix."""
    n = len(matrix)
    # Row by row: what a row takes from those below it goes through the processor at once.
    for k in range(n):
        row, root = matrix[k], math.sqrt(matrix[k, k])
        for j in range(k, n):
            row[j] /= root
        for i in range(k + 1, n):
            factor, below = row[i], matrix[i]
            for j in range(i, n):
                below[j] -= factor * row[j]
        for d in range(len(right)):
            side = right[d]
            side[k] /= root
            value = side[k]
            for i in range(k + 1, n):
                side[i] -= value * row[i]
    for i in range(n - 1, -1, -1):
        row = matrix[i]
        zero, one, two, three = right[0, i], right[1, i], right[2, i], right[3, i]
        for k in range(i + 1, n):
            zero -= row[k] * right[0, k]
            one -= row[k] * right[1, k]
            two -= row[k] * right[2, k]
            three -= row[k] * right[3, k]
        right[0, i], right[1, i], right[2, i], right[3, i] = zero / row[i], one / row[i], two / row[i], three / row[i]


# Many arguments: what it corrects, and by how much.
@kernel
def _correction(
    sq: Squares, gap: Floats, gradient: Floats, hessian: Floats, dq: Floats, dc: Floats, du: Floats
) -> float:  # fmt: skip
    """Newton's correction of rise, coefficients and bending; returns the decrement of the energy (J).

    On loaded squares ``(1 / k + G) dc = (f - c) / k - b dq + g`` with their load f, elastic stiffness k and ``g = u - G c``
    (``gap``), which a whole correction closes; others take up their load at once.
    """
    loaded, count = np.flatnonzero(sq.elastic > 0.0), sq.load.size
    n = loaded.size
    bent, matrix, answer = np.zeros((4, count)), np.empty((n, n)), np.empty((4, n))
    for i in range(count):
        dc[i] = 0.0 if sq.elastic[i] > 0.0 else sq.load[i] - sq.coefficient[i]
    _apply(sq.compliance, dc, bent[0])
    for i in range(count):
        bent[0, i] -= gap[i]
    for s in range(n):
        i = loaded[s]
        for t in range(s, n):
            matrix[s, t] = sq.compliance[i, loaded[t]]
        matrix[s, s] += 1.0 / sq.elastic[i]
        answer[0, s] = (sq.load[i] - sq.coefficient[i]) / sq.elastic[i] - bent[0, i]
        for d in range(3):
            answer[1 + d, s] = -sq.mixed[i, d] / sq.elastic[i]
    _solve_loaded(matrix, answer)
    for s in range(n):
        row = sq.compliance[loaded[s]]
        for d in range(4):
            value, out = answer[d, s], bent[d]
            for i in range(count):
                out[i] += value * row[i]
    right = np.empty(3)
    for d in range(3):
        right[d] = -gradient[d]
        for i in range(count):
            right[d] -= sq.mixed[i, d] * bent[0, i]
            for t in range(3):
                hessian[d, t] += sq.mixed[i, d] * bent[1 + t, i]
    dq[0], dq[1], dq[2] = solve(hessian, right)
    decrement = -(gradient[0] * dq[0] + gradient[1] * dq[1] + gradient[2] * dq[2])
    for s in range(n):
        dc[loaded[s]] = answer[0, s] + answer[1, s] * dq[0] + answer[2, s] * dq[1] + answer[3, s] * dq[2]
    for i in range(count):
        du[i] = bent[0, i] + bent[1, i] * dq[0] + bent[2, i] * dq[1] + bent[3, i] * dq[2]
        decrement += (sq.load[i] - sq.coefficient[i]) * du[i]
    return float(decrement)


@kernel
def _minimise(pads: Pads, footing: Footing, sq: Squares, q: Floats, top: float, end: float) -> int:
    """Find rise and bending of least energy from where they are; returns the iterations, -1 where there is no end.

    ``end``: part of the energy by which a last correction may lower it.
    """
    count = sq.load.size
    gradient, hessian, dq, dc, du = np.zeros(3), np.zeros((3, 3)), np.zeros(3), np.zeros(count), np.zeros(count)
    gap, largest_gap = np.empty(count), 0.0
    _apply(sq.compliance, sq.coefficient, gap)
    for i in range(count):
        gap[i] = sq.bending[i] - gap[i]
        largest_gap = max(largest_gap, abs(gap[i]))
    # Bending that was found with another compliance has no energy here: its pressure alone leads on.
    closes_gap = largest_gap > 1e-9 * np.abs(sq.bending).max()
    energy = _sum_up(pads, footing, sq, q, top, gradient, hessian)
    for iteration in range(MAX_ITERATIONS):
        if not closes_gap:
            gap[:] = 0.0
        decrement = _correction(sq, gap, gradient, hessian, dq, dc, du)
        if not closes_gap and decrement <= (end if iteration < 20 else LATE) * abs(energy):
            return iteration
        change = 1.0
        while True:
            for i in range(3):
                q[i] += change * dq[i]
            for i in range(count):
                sq.coefficient[i] += change * dc[i]
                sq.bending[i] += change * du[i]
            new = _sum_up(pads, footing, sq, q, top, gradient, hessian)
            # The energy is convex: a correction that is short enough lowers it, as far as round-off lets that be seen.
            if closes_gap or not new > energy - 1e-4 * abs(change) * decrement or decrement < 1e-9 * abs(energy):
                break
            change = -0.5 * abs(change)
        energy, closes_gap = new, False
    return -1


@kernel
def _lift(pads: Pads, footing: Footing, sq: Squares, rise: float, q: Floats) -> None:
    """Lift a fragment if that takes less energy than to press all of it in: where it yields, the bed leads to no balance."""
    gradient, hessian = np.empty(3), np.empty((3, 3))
    pressed_in = _sum_up(pads, footing, sq, q, footing.top, gradient, hessian)
    q[0] = rise
    if _sum_up(pads, footing, sq, q, footing.top, gradient, hessian) > pressed_in:
        q[0] = 0.0


@kernel
def _balance(pads: Pads, footing: Footing, sq: Squares, q: Floats, end: float) -> int:
    """Find the balance from the rise and bending that are there, as `_minimise` does."""
    iterations = _minimise(pads, footing, sq, q, footing.top, end)
    if iterations < 0:
        # Squares that yield resist no more: where stiff ice starts deep in rock, almost all do, and corrections overshoot by
        # hundreds of metres. On a bed of boundless strength they do not, and its balance is close.
        q[:], sq.coefficient[:], sq.bending[:] = 0.0, 0.0, 0.0
        _minimise(pads, footing, sq, q, math.inf, end)
        iterations = _minimise(pads, footing, sq, q, footing.top, end)
    return iterations


@kernel
def _balance_plate(
    pads: Pads, plates: Plates, b: int, footing: Footing, sq: Squares, merged: int, margin: float, q: Floats, length: float
) -> int:  # fmt: skip
    """Find the balance of ice that bends, by loads that act where the last balance has them; returns as `_minimise` does."""
    iterations = 0
    for stage in range(STAGES):
        _set_compliance(pads, plates, b, footing, sq, merged == 1, q, length)
        if stage == 0 and merged > 1:  # the balance of many pads lies closer to that of ice that does not bend
            rigid, _ = _group_in_squares(pads, b, footing, margin, False)
            _balance(pads, footing, rigid, q, ROUGH)
        iterations = _balance(pads, footing, sq, q, EXACT if stage == STAGES - 1 else ROUGH)
        if iterations < 0:
            return -1
    return iterations


# Many arguments: as in `press`, whose results it writes.
@kernel
def _share_out(
    pads: Pads, b: int, footing: Footing, sq: Squares, q: Floats, bed: Bed, length: float, thickness: float, loads: Floats,
    bent: Floats,
) -> None:  # fmt: skip
    """Write the loads on the elements (``loads``) and the polygons (``bent``)."""
    sums, share, (origin_x, origin_y) = np.empty(13), np.full(sq.load.size, -1.0), pads.origin[b]
    first, last = pads.row_start[b], pads.row_start[b + 1]
    moments = np.zeros((last - first, 3))  # of the friction of each element
    for m in range(sq.polygons.size):
        i, p = sq.square[m], sq.polygons[m]
        if _is_clear(pads, footing, p, q, sq.bending[i]):
            continue
        size, highest = _find_overlap(pads, footing, p, q, sq.bending[i])
        pressed(footing.piece, size, footing.top, footing.room, sums)
        if not _bears(sums, min(highest, footing.top), footing.side):
            continue
        load, x, y = bed.stiffness * sums[0], sums[1] / sums[0], sums[2] / sums[0]
        e = pads.owner[footing.polygons[p]]
        element = loads[e]
        element[LOAD] += load
        element[LOAD_X] += load * (x + origin_x)
        element[LOAD_Y] += load * (y + origin_y)
        # The gradient of the overlap is minus that of the depth, and the floor pushes where it is deeper.
        element[PUSH_X] -= load * footing.gradient[p, 0]
        element[PUSH_Y] -= load * footing.gradient[p, 1]
        element[LIFT] = max(element[LIFT], _rise(q, x, y) + sq.bending[i])
        if share[i] < 0.0 and length > 0.0:
            share[i] = measure_ice_share(pads, b, sq.position[i, 0], sq.position[i, 1], math.sqrt(2.0) * length)
        element[STRESS] = max(element[STRESS], bending_stress(length, share[i], thickness, sq.bending[i]))
        element[YIELD] = max(element[YIELD], highest - footing.top)
        bent[p, 0], bent[p, 1], bent[p, 2] = load, sq.bending[i], share[i]
        bent[p, 3], bent[p, 4] = x + origin_x, y + origin_y
        if bed.grip < footing.top:
            pressed(footing.piece, size, bed.grip, footing.room, sums)
        element[HOLD] += bed.friction * bed.stiffness * sums[0]
        for n in range(3):
            moments[e - first, n] += sums[n]
            element[SPREAD_XX + n] += sums[10 + n]
    for e in range(first, last):
        if loads[e, LOAD] > 0.0:
            loads[e, LOAD_X] /= loads[e, LOAD]
            loads[e, LOAD_Y] /= loads[e, LOAD]
            total = moments[e - first, 0]
            x, y = moments[e - first, 1] / total, moments[e - first, 2] / total
            loads[e, SPREAD_XX] = max(loads[e, SPREAD_XX] / total - x * x, 0.0)
            loads[e, SPREAD_XY] = loads[e, SPREAD_XY] / total - x * y
            loads[e, SPREAD_YY] = max(loads[e, SPREAD_YY] / total - y * y, 0.0)


@borrower
def _stay_clear(pads: Pads, footing: Footing, margin: float, q: Floats) -> bool:
    """Whether polygons that are clear by more than ``margin`` m stay so: rigid rise alone is the least of theirs."""
    for p in range(footing.polygons.size):
        if footing.highest[p] > -margin or _is_clear(pads, footing, p, q, 0.0):
            continue
        if _find_overlap(pads, footing, p, q, 0.0)[1] > 0.0:
            return False
    return True


# Many arguments: what the press finds goes into arrays of the caller, which makes them once for all sub-steps.
@kernel
def press(
    pads: Pads, plates: Plates, b: int, polygons: Ints, depth: Floats, sounding: Ints, draft: Floats, level: float, bed: Bed,
    hull: Floats, length: float, thickness: float, q: Floats, loads: Floats, bent: Floats,
) -> tuple[int, float]:  # fmt: skip
    """Press the keel of fragment ``b`` onto the floor; returns Newton's iterations, -1 for no end, and the largest overlap (m).

    ``polygons``: its polygons that may touch the floor; ``depth``: at their corners, by ``sounding``, then at their middles
    (m); ``draft``: of the elements ``pads.rows`` (m); ``length``: of bending, 0 for ice that does not, and ``thickness`` (m).
    ``q`` takes heave and tilts, ``loads`` the columns `LOAD` to `YIELD` of the elements, ``bent`` load (N), bending (m), share of
    ice and place (m) of each polygon.
    """
    most = CORNERS
    for k in polygons:
        most = max(most, 2 * (pads.start[k + 1] - pads.start[k]) + 8)
    loads[pads.row_start[b] : pads.row_start[b + 1]] = 0.0
    bent[:, 0] = 0.0
    footing = Footing(
        polygons, np.empty((polygons.size, 3)), np.empty((polygons.size, 2)), np.empty(polygons.size), hull, bed.stiffness,
        bed.strength / bed.stiffness, pads.side[b], np.empty((most, 3)), np.empty((most, 3)),
        np.empty(10),
    )  # fmt: skip
    largest, iterations, bends = _lay_planes(pads, footing, depth, sounding, draft, level), 0, length > 0.0
    q[:] = 0.0
    if largest <= 0.0:
        return 0, largest
    # Beyond CLEAR pads are looked at or not by the way that a fragment came; the last bit must not hang on it.
    margin = min(0.2 * largest + 0.02, CLEAR)
    while True:
        q[:] = 0.0
        sq, merged = _group_in_squares(pads, b, footing, margin, bends)
        if largest > footing.top:
            _lift(pads, footing, sq, largest - footing.top, q)
        if bends:
            fit_plate(pads, plates, b, polygons[sq.polygons], merged, length, bed.poisson)
            iterations = _balance_plate(pads, plates, b, footing, sq, merged, margin, q, length)
        else:
            iterations = _balance(pads, footing, sq, q, EXACT)
        if iterations < 0:
            return -1, largest
        if _stay_clear(pads, footing, margin, q):
            break
        margin *= 2.0
    _share_out(pads, b, footing, sq, q, bed, length, thickness, loads, bent)
    return iterations, largest
