"""Heave, tilt and bending of a fragment on the floor: the rise of its keel at which water and bed carry its weight together.

The rise of a point of the keel is ``z + tx y - ty x + u``: heave, tilts about the centroid of the water plane, and the bending
of the ice where the floor presses. They minimise the energy

    (z, tx, ty) K (z, tx, ty) / 2 + sum over columns s u^2 / 2 + k_v integral (<d>^2 - <d - q_u / k_v>^2) / 2

which is convex, so Newton's method with its exact tangent and halved corrections finds them. Bending is that of an elastic
plate on water under the loads of a patch, resolved in columns along the line of the patch. What a patch gives way by is that of
the plate less that of the rigid fragment: heave and tilt are already part of what a floating plate does. The stiffness of the
columns depends on the loads, so both are found in turns.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.physics.seabed import (
    WATER_STIFFNESS,
    add_moments,
    bending_length,
    bending_stress,
    cut,
    friction_depth,
    line_stiffness,
    point_stiffness,
    pressed,
)
from riftberg.state import Floats, Ints
from riftberg.stepping.fragments.connectivity import connected_parts
from riftberg.stepping.ground.floor import CORNERS, Patches
from riftberg.stepping.mat3 import solve

MAX_ITERATIONS: Final = 100
"""Of Newton's method; five to ten are usual."""

ROUNDS: Final = 12
"""Of loads and stiffness of the bending in turns."""

SETTLED: Final = 1e-4
"""Relative change of the load of the floor at which the rounds end."""

COLUMNS_PER_LAMBDA: Final = 8.0
"""Columns of a patch are at most this part of ``lambda`` wide."""

LEAST_COLUMNS: Final = 6
"""Columns of a patch at least, so that it shows where bending falls to zero."""

DISC: Final = np.array([[math.cos(a), math.sin(a)] for a in np.arange(64) * (math.pi / 32.0)])
"""Circle of radius 1 about a point."""

RIGID: Final = 1e40
"""Stiffness against tilt (N m) of a fragment that takes none."""


class Bed(NamedTuple):
    """The floor, and how the ice bends on it."""

    stiffness: float  # k_v, Pa m-1
    strength: float  # q_u, Pa
    friction: float  # mu
    shear_strength: float  # alpha s_u, Pa; 0 for none
    anchor_way: float  # m
    bends: bool  # Whether the ice bends
    modulus: float  # Young's modulus of the ice, Pa
    poisson: float


class Hull(NamedTuple):
    """What carries a fragment afloat."""

    centre: Floats  # Centroid of the water plane, m; shape (2,)
    stiffness: Floats  # Against heave and both tilts; shape (3, 3)
    ice: Any  # Outline of its ice (shapely)


class Bending(NamedTuple):
    """How the ice bends over a patch of loaded elements."""

    largest: float  # m
    stress: float  # Largest bending stress, Pa
    share: float  # Part of the ice around the deepest point: 1 inside, 1/2 at an edge, 1/4 at a corner
    length: float  # lambda, m
    axis: tuple[float, float]  # Direction of the line of the patch
    area: Any  # What encloses the loaded area (shapely)
    inside: NDArray[np.bool_]  # Whether an element belongs to the patch; shape (elements,)


class Pressure(NamedTuple):
    """What the floor does to the elements of a fragment."""

    rise: Floats  # Heave (m) and tilts (rad); shape (3,)
    load: Floats  # N; shape (elements,), as those below
    x: Floats  # Where it acts, m, in the coordinates of the fragment
    y: Floats
    capacity: Floats  # Of friction, N
    slope: Floats  # Push by the slope of the floor, east and north, N; shape (elements, 2)
    excess: Floats  # Volume in which the overlap exceeds what the bed bears, m3; of each polygon
    patches: Patches  # The polygons, with the overlap that was found
    bending: list[Bending]  # Of each patch

    @property
    def touches(self) -> bool:
        """Whether the floor carries anything."""
        return bool((self.load > 0.0).any())


def hull_of(corner: Floats, start: Ints, owner: Ints, thickness: Floats, draft: Floats) -> Hull:
    """Find what carries a fragment afloat; ``thickness``, ``draft``: of its elements, m."""
    sums, moment = np.zeros(10), 0.0
    ring = np.column_stack([corner, np.ones(len(corner))])
    for k, e in enumerate(owner.tolist()):
        before = sums[3]
        add_moments(ring[start[k] : start[k + 1]], int(start[k + 1] - start[k]), 0.0, 1.0, sums)
        # Distance of the centres of mass and of buoyancy, by the volume of water.
        moment += (sums[3] - before) * draft[e] * 0.5 * (thickness[e] - draft[e])
    area, x, y = sums[3], sums[4] / sums[3], sums[5] / sums[3]
    xx, xy, yy = sums[6] - area * x * x, sums[7] - area * x * y, sums[8] - area * y * y
    plane = WATER_STIFFNESS * np.array([[yy, -xy], [-xy, xx]])
    tilts = plane - WATER_STIFFNESS * moment * np.eye(2)
    stiffness = np.diag([WATER_STIFFNESS * area, RIGID, RIGID])
    least = np.linalg.eigvalsh(plane)
    narrow = math.sqrt(12.0 * least[0] / (WATER_STIFFNESS * area)) < thickness.mean()
    if not narrow and (np.linalg.eigvalsh(tilts) > 0.5 * least).all():
        stiffness[1:, 1:] = tilts
    rings = [shapely.Polygon(corner[a:b]) for a, b in pairwise(start.tolist())]
    # Neighbours share their edges but for round-off.
    return Hull(np.array([x, y]), stiffness, shapely.unary_union(shapely.buffer(rings, 0.01, join_style="mitre")))


# Many arguments: the nine arrays at the end are filled anew in each iteration of `minimise`, which makes them once.
@kernel
def _assemble(
    start: Ints, corner: Floats, column: Ints, xc: float, yc: float, q: Floats, u: Floats, stiffness: float, top: float,
    hull: Floats, springs: Floats, gradient: Floats, gradient_u: Floats, hessian: Floats, mixed: Floats, diagonal: Floats,
    loads: Floats, piece: Floats, room: Floats, sums: Floats,
) -> float:  # fmt: skip
    """Fill gradient and Hessian of the energy at rise ``q`` and bending ``u``, and the loads of columns; returns the energy."""
    energy = 0.0
    for i in range(3):
        gradient[i] = 0.0
        for j in range(3):
            gradient[i] += hull[i, j] * q[j]
            hessian[i, j] = hull[i, j]
        energy += 0.5 * q[i] * gradient[i]
    for c in range(u.size):
        gradient_u[c] = springs[c] * u[c]
        diagonal[c] = springs[c]
        energy += 0.5 * springs[c] * u[c] * u[c]
        loads[c] = 0.0
        for i in range(3):
            mixed[c, i] = 0.0
    for k in range(column.size):
        c, size = column[k], start[k + 1] - start[k]
        bent = u[c] if c >= 0 else 0.0
        for n in range(size):
            x, y = corner[start[k] + n, 0] - xc, corner[start[k] + n, 1] - yc
            piece[n, 0], piece[n, 1] = x, y
            piece[n, 2] = corner[start[k] + n, 2] - (q[0] + q[1] * y - q[2] * x) - bent
        pressed(piece, size, top, room, sums)
        if sums[0] == 0.0:
            continue
        energy += stiffness * sums[9]
        load, area, sx, sy = stiffness * sums[0], stiffness * sums[3], stiffness * sums[4], stiffness * sums[5]
        gradient[0] -= load
        gradient[1] -= stiffness * sums[2]
        gradient[2] += stiffness * sums[1]
        xx, xy, yy = stiffness * sums[6], stiffness * sums[7], stiffness * sums[8]
        hessian[0, 0] += area
        hessian[0, 1] += sy
        hessian[0, 2] -= sx
        hessian[1, 0] += sy
        hessian[1, 1] += yy
        hessian[1, 2] -= xy
        hessian[2, 0] -= sx
        hessian[2, 1] -= xy
        hessian[2, 2] += xx
        if c >= 0:
            loads[c] += load
            gradient_u[c] -= load
            diagonal[c] += area
            mixed[c, 0] += area
            mixed[c, 1] += sy
            mixed[c, 2] -= sx
    return energy


# Many arguments: polygons, columns and springs of one balance are arrays apart, as the loops of `_assemble` read
# them.
@kernel
def minimise(
    start: Ints, corner: Floats, column: Ints, xc: float, yc: float, q: Floats, u: Floats, stiffness: float, top: float,
    hull: Floats, springs: Floats,
) -> tuple[int, Floats]:  # fmt: skip
    """Find rise ``q`` and bending ``u`` (in place) of least energy; returns the iterations and the loads of the columns (N)."""
    columns, most = u.size, CORNERS
    for k in range(column.size):
        most = max(most, 2 * (start[k + 1] - start[k]) + 4)
    gradient, hessian, matrix, right = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    gradient_u, diagonal, loads, mixed = np.zeros(columns), np.zeros(columns), np.zeros(columns), np.zeros((columns, 3))
    piece, room, sums = np.zeros((most, 3)), np.zeros((most, 3)), np.zeros(10)
    new_q, new_u, step_u = np.zeros(3), np.zeros(columns), np.zeros(columns)
    energy = _assemble(
        start, corner, column, xc, yc, q, u, stiffness, top, hull, springs, gradient, gradient_u, hessian, mixed, diagonal,
        loads, piece, room, sums,
    )  # fmt: skip
    for iteration in range(MAX_ITERATIONS):
        # Each column is coupled to the rise alone, so the columns are eliminated first.
        for i in range(3):
            right[i] = -gradient[i]
            for j in range(3):
                matrix[i, j] = hessian[i, j]
        for c in range(columns):
            for i in range(3):
                right[i] += mixed[c, i] * gradient_u[c] / diagonal[c]
                for j in range(3):
                    matrix[i, j] -= mixed[c, i] * mixed[c, j] / diagonal[c]
        dz, dx, dy = solve(matrix, right)
        decrement = -(gradient[0] * dz + gradient[1] * dx + gradient[2] * dy)
        for c in range(columns):
            step_u[c] = -(gradient_u[c] + mixed[c, 0] * dz + mixed[c, 1] * dx + mixed[c, 2] * dy) / diagonal[c]
            decrement -= gradient_u[c] * step_u[c]
        # Late iterations move within round-off.
        if decrement <= (1e-20 if iteration < 20 else 1e-9) * abs(energy):
            return iteration, loads
        part = 1.0
        while True:
            new_q[0], new_q[1], new_q[2] = q[0] + part * dz, q[1] + part * dx, q[2] + part * dy
            for c in range(columns):
                new_u[c] = u[c] + part * step_u[c]
            new = _assemble(
                start, corner, column, xc, yc, new_q, new_u, stiffness, top, hull, springs, gradient, gradient_u, hessian,
                mixed, diagonal, loads, piece, room, sums,
            )  # fmt: skip
            if new <= energy - 1e-4 * part * decrement:
                break
            # On the sphere depth is linear over a polygon to 1e-5 alone, so that the last digits of the energy do not count.
            if part < 1e-3 or decrement < 1e-9 * abs(energy):
                break
            part *= 0.5
        for i in range(3):
            q[i] = new_q[i]
        for c in range(columns):
            u[c] = new_u[c]
        energy = new
    return -1, loads


# Many arguments: polygons come in and go out as flat lists of corners, owners and starts, without an object for each.
@kernel
def _split(
    start: Ints, corner: Floats, owner: Ints, group: Ints, axis_x: Floats, axis_y: Floats, begin: Floats, width: Floats,
    first: Ints, out_start: Ints, out: Floats, origin: Ints, column: Ints,
) -> int:  # fmt: skip
    """Cut the polygons of the elements of patches by the columns of these; returns how many there are, -1 where they do not fit.

    ``group``: patch of each element, -1 for none; of each patch the direction of its line, where its first column begins (m
    along it) and the numbers of its columns. ``origin``: polygon from which each comes; ``column``: -1 for none.
    """
    count, most = 0, CORNERS
    for k in range(owner.size):
        most = max(most, 2 * (start[k + 1] - start[k]) + 8)
    whole, room, piece = np.empty((most, 4)), np.empty((most, 4)), np.empty((most, 4))
    for k in range(owner.size):
        g, size = group[owner[k]], start[k + 1] - start[k]
        low, high = math.inf, -math.inf
        for n in range(size):
            x, y, d = corner[start[k] + n, 0], corner[start[k] + n, 1], corner[start[k] + n, 2]
            s = 0.0 if g < 0 else (axis_x[g] * x + axis_y[g] * y - begin[g]) / width[g]
            whole[n, 0], whole[n, 1], whole[n, 2], whole[n, 3] = x, y, d, s
            low, high = min(low, s), max(high, s)
        columns = 1 if g < 0 else first[g + 1] - first[g]
        a, b = (0, 0) if g < 0 else (max(math.floor(low), -1), min(math.floor(high), columns))
        for c in range(a, b + 1):
            # Beyond the columns the ice does not bend: it may come to lie on the floor, and the patch then grows.
            left, right = (-math.inf if c < 0 else float(c)), (math.inf if c >= columns else c + 1.0)
            if g < 0:
                right = math.inf
            s2 = size
            if left > low:
                s2 = cut(whole, size, 3, left, 1.0, room)
            else:
                for n in range(size):
                    for i in range(4):
                        room[n, i] = whole[n, i]
            if right < high:
                s2 = cut(room, s2, 3, right, -1.0, piece)
            else:
                for n in range(s2):
                    for i in range(4):
                        piece[n, i] = room[n, i]
            if s2 < 3:
                continue
            if count + 1 >= out_start.size or out_start[count] + s2 > len(out):
                return -1
            at = out_start[count]
            for n in range(s2):
                out[at + n, 0], out[at + n, 1], out[at + n, 2] = piece[n, 0], piece[n, 1], piece[n, 2]
            out_start[count + 1], origin[count] = at + s2, k
            column[count] = first[g] + c if g >= 0 and 0 <= c < columns else -1
            count += 1
    return count


# Many arguments: seven sums over elements and polygons are added to in one pass over the same cut polygons.
@kernel
def _loads(
    start: Ints, corner: Floats, origin: Ints, owner: Ints, slope: Floats, column: Ints, xc: float, yc: float, q: Floats,
    u: Floats, stiffness: float, top: float, grip: float, load: Floats, x: Floats, y: Floats, capacity: Floats, push: Floats,
    excess: Floats, overlap: Floats, area: Floats,
) -> None:  # fmt: skip
    """Sum over the elements: load, its moments, friction capacity over mu, push of the slope; per polygon the excess volume.

    ``overlap`` takes the overlap of all corners that was found, ``area`` of the loaded part of each polygon the area, its moments
    by x and y, and the second moments xx, xy, yy.
    """
    most = CORNERS
    for k in range(column.size):
        most = max(most, 2 * (start[k + 1] - start[k]) + 4)
    piece, room, sums = np.zeros((most, 3)), np.zeros((most, 3)), np.zeros(10)
    for k in range(column.size):
        c, size, e = column[k], start[k + 1] - start[k], owner[origin[k]]
        bent, highest = (u[c] if c >= 0 else 0.0), -math.inf
        for n in range(size):
            px, py = corner[start[k] + n, 0], corner[start[k] + n, 1]
            piece[n, 0], piece[n, 1] = px, py
            piece[n, 2] = corner[start[k] + n, 2] - (q[0] + q[1] * (py - yc) - q[2] * (px - xc)) - bent
            overlap[start[k] + n] = piece[n, 2]
            highest = max(highest, piece[n, 2])
        if highest <= 0.0:
            continue
        pressed(piece, size, top, room, sums)
        load[e] += stiffness * sums[0]
        x[e] += stiffness * sums[1]
        y[e] += stiffness * sums[2]
        push[e, 0] += stiffness * sums[0] * slope[origin[k], 0]
        push[e, 1] += stiffness * sums[0] * slope[origin[k], 1]
        if grip < top:
            pressed(piece, size, grip, room, sums)
        capacity[e] += stiffness * sums[0]
        sums[:] = 0.0
        s = cut(piece, size, 2, 0.0, 1.0, room)
        add_moments(room, s, 0.0, 1.0, sums)
        for i in range(6):
            area[k, i] = sums[3 + i]
        if highest > top:
            sums[:] = 0.0
            s = cut(piece, size, 2, top, 1.0, room)
            add_moments(room, s, top, 1.0, sums)
            excess[origin[k]] += sums[0]


class _Columns(NamedTuple):
    """Polygons cut by the columns of the patches."""

    start: Ints
    corner: Floats
    origin: Ints
    column: Ints


def press(
    patches: Patches, elements: int, hull: Hull, bed: Bed, thickness: Floats, first: Ints, second: Ints, rise: Floats
) -> Pressure:
    """Find rise and loads of a fragment.

    ``thickness``: of its elements, m; ``first``, ``second``: intact bonds between them; ``rise``: where the search begins.
    """
    top = bed.strength / bed.stiffness
    grip = friction_depth(bed.stiffness, bed.strength, bed.friction, bed.shear_strength)
    count, (xc, yc) = patches.owner.size, hull.centre.tolist()
    cut_up = _Columns(patches.start, patches.corner, np.arange(count), np.full(count, -1))
    q, u, springs = rise.copy(), np.zeros(0), np.zeros(0)
    bending: list[Bending] = []

    def evaluate() -> tuple[Pressure, Floats, Floats]:
        load, x, y, capacity = np.zeros((4, elements))
        push, excess = np.zeros((elements, 2)), np.zeros(count)
        overlap, area = np.zeros(len(cut_up.corner)), np.zeros((cut_up.column.size, 6))
        _loads(
            cut_up.start, cut_up.corner, cut_up.origin, patches.owner, patches.gradient, cut_up.column, xc, yc, q, u,
            bed.stiffness, top, grip, load, x, y, capacity, push, excess, overlap, area,
        )  # fmt: skip
        some = np.where(load > 0.0, load, 1.0)
        x, y = np.where(load > 0.0, x / some, 0.0), np.where(load > 0.0, y / some, 0.0)
        found = Pressure(q, load, x, y, bed.friction * capacity, push, excess, patches, bending)
        return found, overlap, area

    _minimised(cut_up, xc, yc, q, u, bed, top, hull, springs)
    found, overlap, area = evaluate()
    if not (bed.bends and found.touches):
        return found
    before = found.load.sum()
    for n in range(ROUNDS):
        group = _groups(found.load, first, second)
        shape = [
            _Patch.of(g, group, found, cut_up, patches, overlap, area, hull, bed, thickness)
            for g in range(group.max() + 1)
        ]
        columns = np.cumsum([0, *(len(patch.length) for patch in shape)])
        if n < ROUNDS - 4:  # then the polygons stay, and the stiffness settles
            cut_up = _cut_up(patches, group, shape, columns)
        else:
            break
        u, springs = np.zeros(columns[-1]), np.concatenate([patch.springs for patch in shape])
        if np.isinf(springs).all():
            break
        loads = _minimised(cut_up, xc, yc, q, u, bed, top, hull, springs)
        # The distribution of the bending along the lines decides on their stiffness.
        for _ in range(4):
            for patch, a, b in zip(shape, columns, columns[1:], strict=False):
                springs[a:b] = patch.stiffness(u[a:b], loads[a:b])
            loads = _minimised(cut_up, xc, yc, q, u, bed, top, hull, springs)
        bending = [
            patch.bent_by(float(u[a:b].max())) for patch, (a, b) in zip(shape, pairwise(columns.tolist()), strict=True)
        ]
        found, overlap, area = evaluate()
        now = found.load.sum()
        if not found.touches or abs(now - before) <= SETTLED * now:
            break
        before = now
    return found


def _minimised(
    polygons: _Columns, xc: float, yc: float, q: Floats, u: Floats, bed: Bed, top: float, hull: Hull, springs: Floats
) -> Floats:
    iterations, loads = minimise(
        polygons.start, polygons.corner, polygons.column, xc, yc, q, u, bed.stiffness, top, hull.stiffness, springs
    )
    if iterations < 0:
        raise FloatingPointError
    return loads


def _groups(load: Floats, first: Ints, second: Ints) -> Ints:
    """Patch of each element: loaded elements that are bonded to each other; -1 where nothing presses."""
    loaded = load > 0.0
    both = loaded[first] & loaded[second]
    part = connected_parts(load.size, first[both], second[both], np.zeros(int(both.sum()), np.int64))
    group = np.full(load.size, -1)
    group[loaded] = np.unique(part[loaded], return_inverse=True)[1]
    return group


def _cut_up(patches: Patches, group: Ints, shape: list[_Patch], columns: Ints) -> _Columns:
    """Cut the polygons by the columns of the patches."""
    axis = np.array([patch.axis for patch in shape])
    begin, width = np.array([[patch.begin, patch.width] for patch in shape]).T.copy()
    room = 2 * patches.owner.size + 64
    while True:
        start, out = np.zeros(room + 1, np.int64), np.empty((8 * room, 3))
        origin, column = np.empty(room, np.int64), np.empty(room, np.int64)
        count = _split(
            patches.start, patches.corner, patches.owner, group, axis[:, 0].copy(), axis[:, 1].copy(), begin, width,
            columns.astype(np.int64), start, out, origin, column,
        )  # fmt: skip
        if count >= 0:
            return _Columns(start[: count + 1], out[: start[count]], origin[:count], column[:count])
        room *= 2


class _Patch(NamedTuple):
    """The line of a patch of loaded elements, and how the ice gives way along it."""

    axis: tuple[float, float]  # Its direction
    begin: float  # Where its first column begins, m along the direction: on both sides beyond what is loaded
    width: float  # Of the columns, m
    length: Floats  # Length of the line in each column, m
    line: float  # K_l, Pa
    point: float  # K_0, N m-1
    ends: tuple[float, float]  # Stiffness of the ice beyond both ends, N m-1; 0 where there is none
    rigid: float  # Compliance of the rigid fragment at the load, m N-1
    springs: Floats  # First guess of the stiffness of the columns, N m-1
    reach: float  # l, m
    share: float  # Of the disc about the deepest point that is ice
    thickness: float  # Of the ice, m
    corners: Floats  # Of the loaded area, m
    inside: NDArray[np.bool_]  # Elements

    @classmethod
    def of(
        cls, number: int, group: Ints, found: Pressure, cut_up: _Columns, patches: Patches, overlap: Floats, area: Floats,
        hull: Hull, bed: Bed, thickness: Floats,
    ) -> _Patch:  # fmt: skip
        """Measure a patch and the ice around it."""
        inside = group == number
        mean_thickness = float(np.average(thickness[inside], weights=found.load[inside]))
        reach = bending_length(bed.modulus, bed.poisson, mean_thickness)
        around = math.sqrt(2.0) * reach
        mine = np.flatnonzero(inside[patches.owner[cut_up.origin]] & (area[:, 0] > 0.0))
        pressed_parts = _pressed_corners(cut_up.start, cut_up.corner, overlap, mine)
        corners = pressed_parts[:, :2]
        # Its line is the major axis of the loaded area, by exact moments: means over corners would depend on the cuts.
        whole, x, y, xx, xy, yy = area[mine].sum(axis=0)
        axis = np.linalg.eigh([[xx - x * x / whole, xy - x * y / whole], [xy - x * y / whole, yy - y * y / whole]])[1][
            :, 1
        ]
        across = np.array([-axis[1], axis[0]])
        s, t = corners @ axis, corners @ across
        s0, s1, t0, t1 = s.min(), max(s.max(), s.min() + 1e-3), t.min(), t.max()

        # Parts of the neighbourhood that are ice: strips on both sides of the line, short ones beyond its ends, and a disc.
        wide, deepest = max(t1 - t0, 1.0), corners[np.argmax(pressed_parts[:, 2])]
        boxes = np.array([
            (s0, s1, t1, t1 + around), (s0, s1, t0 - around, t0), (s0 - 0.25 * around, s0, t0 - 0.5 * wide, t1 + 0.5 * wide),
            (s1, s1 + 0.25 * around, t0 - 0.5 * wide, t1 + 0.5 * wide),
        ])  # fmt: skip
        strips = boxes[:, [0, 1, 1, 0], None] * axis + boxes[:, [2, 2, 3, 3], None] * across
        shapes = np.append(shapely.polygons(strips), shapely.Polygon(deepest + around * DISC))
        left, right, *over, at_point = (
            shapely.area(shapely.intersection(shapes, hull.ice)) / shapely.area(shapes)
        ).tolist()
        inner = 0.5 * (left + right)
        end = WATER_STIFFNESS * reach * reach * (1.08 + (4.0 - 1.08) * min(max(2.0 * inner - 1.0, 0.0), 1.0))
        beyond = [end * min(part / max(inner, 0.05), 1.0) for part in over]
        load = found.load[inside]
        x, y = np.average(found.x[inside], weights=load), np.average(found.y[inside], weights=load)
        centre = x * across[0] + y * across[1]
        lever = np.array([1.0, y - hull.centre[1], -(x - hull.centre[0])])
        rigid = float(lever @ np.linalg.solve(hull.stiffness, lever))
        count = max(LEAST_COLUMNS, math.ceil((s1 - s0) * COLUMNS_PER_LAMBDA / around))
        width, pad = (s1 - s0) / count, (count + 1) // 2
        length = np.full(count + 2 * pad, width)
        # At an edge the ice gives way by 1 - x / lambda at a distance x; a wide patch lifts all of its water.
        line = line_stiffness(reach, max(inner, 0.05))
        further_in = (t1 - centre) if left < right else (centre - t0)
        line += WATER_STIFFNESS * abs(right - left) * further_in
        line = max(line, WATER_STIFFNESS * whole / (s1 - s0))
        patch = cls(
            (float(axis[0]), float(axis[1])), float(s0 - pad * width), width, length, line, point_stiffness(reach, at_point),
            (beyond[0], beyond[1]), rigid, np.zeros(0), reach, at_point, mean_thickness, corners, inside,
        )  # fmt: skip
        even = np.ones(length.size)
        return patch._replace(springs=patch.stiffness(even, even))

    def bent_by(self, largest: float) -> Bending:
        """Return what a bending (m) means."""
        stress = bending_stress(self.reach, self.share, self.thickness, largest)
        area = shapely.MultiPoint(self.corners).convex_hull
        return Bending(largest, stress, self.share, math.sqrt(2.0) * self.reach, self.axis, area, self.inside)

    def stiffness(self, bending: Floats, load: Floats) -> Floats:
        """Stiffness of the columns (N m-1) by bending and load: none gives way where heave and tilt do all."""
        if not load.sum() > 0.0 or not bending.max() > 0.0:
            return np.maximum(self.line * self.length, 1e-3 * self.point)
        total = self.line * float((bending * self.length).sum())
        bent = bending[load > 0.0]
        first, last = (
            (max(1.5 * bent[a] - 0.5 * bent[b], 0.0) for a, b in ((0, 1), (-1, -2))) if bent.size > 1 else (0.0, 0.0)
        )
        at_ends = total + self.ends[0] * first + self.ends[1] * last
        factor = max(self.point * float(bending.max()), at_ends) / total
        patch = factor * total / float((bending * load).sum() / load.sum())
        left = max(1.0 - self.rigid * patch, 1e-9)
        return self.length * self.line * factor / left


@kernel
def _pressed_corners(start: Ints, corner: Floats, overlap: Floats, mine: Ints) -> Floats:
    """Corners of the loaded part of some polygons: x, y, overlap without any rise, m."""
    size, most = 0, CORNERS
    for k in mine:
        size += 2 * (start[k + 1] - start[k]) + 4
        most = max(most, 2 * (start[k + 1] - start[k]) + 4)
    out = np.empty((size, 3))
    piece, room, count = np.empty((most, 4)), np.empty((most, 4)), 0
    for k in mine:
        n = start[k + 1] - start[k]
        for i in range(n):
            for j in range(3):
                piece[i, j] = corner[start[k] + i, j]
            piece[i, 3] = overlap[start[k] + i]
        for i in range(cut(piece, n, 3, 0.0, 1.0, room)):
            for j in range(3):
                out[count, j] = room[i, j]
            count += 1
    return out[:count]
