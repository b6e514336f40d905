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
from riftberg.physics.geometry import solve
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

MAX_ITERATIONS: Final = 100
"""Of Newton's method; five to ten are usual."""

ROUNDS: Final = 8
"""Of loads and stiffness of the bending in turns, at most."""

SETTLED: Final = 1e-4
"""Relative change of the load of the floor at which the rounds end."""

COLUMNS_PER_LAMBDA: Final = 8.0
"""Columns of a patch are at most this part of ``lambda`` wide."""

LEAST_COLUMNS: Final = 6
"""Columns of a patch at least, so that it shows where bending falls to zero."""

DISC_CORNERS: Final = 64
"""Of the polygon that stands for the circle about the deepest point."""

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
    start: Ints  # Where the rings of the outline of its ice begin; holes go round clockwise
    ring: Floats  # Corners of these, m; shape (corners, 2)


class Bending(NamedTuple):
    """How the ice bends over a patch of loaded elements."""

    largest: float  # m
    stress: float  # Largest bending stress, Pa
    share: float  # Part of the ice around the deepest point: 1 inside, 1/2 at an edge, 1/4 at a corner
    length: float  # lambda, m
    axis: tuple[float, float]  # Direction of the line of the patch
    area: Any  # What encloses the loaded area (shapely)
    inside: NDArray[np.bool_]  # Whether an element belongs to the patch; shape (elements,)


class Patch(NamedTuple):
    """The line of a patch of loaded elements, and how the ice gives way along it."""

    axis_x: float  # Its direction
    axis_y: float
    begin: float  # Where its first column begins, m along the direction: on both sides beyond what is loaded
    width: float  # Of the columns, m
    columns: int
    line: float  # K_l, Pa
    point: float  # K_0, N m-1
    first_end: float  # Stiffness of the ice beyond the ends, N m-1; 0 where there is none
    last_end: float
    rigid: float  # Compliance of the rigid fragment at the load, m N-1
    reach: float  # l, m
    share: float  # Of the disc about the deepest point that is ice
    thickness: float  # Of the ice, m


class Loaded(NamedTuple):
    """Polygons cut by the columns of the patches, and the part of them that is loaded."""

    start: Ints
    corner: Floats
    origin: Ints  # The polygon from which each comes
    column: Ints  # -1: none
    overlap: Floats  # Of the corners, m
    area: Floats  # Area of the loaded part, its moments by x and y, second moments xx, xy, yy; shape (polygons, 6)


class Bent(NamedTuple):
    """How the ice bends over the patches of a fragment."""

    group: Ints  # Patch of each element; -1: none
    patches: list[Patch]
    columns: Ints  # Where the columns of each patch begin
    u: Floats  # Bending of the columns, m
    springs: Floats  # Their stiffness, N m-1
    loaded: Loaded  # What the patches were measured by


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
    bent: Bent | None  # None where the ice does not bend

    @property
    def touches(self) -> bool:
        """Whether the floor carries anything."""
        return bool((self.load > 0.0).any())

    def bending(self) -> list[Bending]:
        """How the ice bends over each patch."""
        if self.bent is None:
            return []
        group, shape, columns, u, _, loaded = self.bent
        return [
            _bending(patch, group == g, float(u[columns[g] : columns[g + 1]].max()), loaded, self.patches.owner)
            for g, patch in enumerate(shape)
        ]


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
    ice = shapely.orient_polygons(shapely.unary_union(shapely.buffer(rings, 0.01, join_style="mitre")))
    lines = [shapely.get_coordinates(line)[:-1] for line in shapely.get_rings(shapely.get_parts(ice))]
    return Hull(np.array([x, y]), stiffness, np.cumsum([0, *(len(line) for line in lines)]), np.vstack(lines))


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
            s2 = cut(whole, size, 3, left, 1.0, room)
            s2 = cut(room, s2, 3, right, -1.0, piece)
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


def press(
    patches: Patches, elements: int, hull: Hull, bed: Bed, thickness: Floats, first: Ints, second: Ints, rise: Floats
) -> Pressure:
    """Find rise and loads of a fragment.

    ``thickness``: of its elements, m; ``first``, ``second``: intact bonds between them; ``rise``: where the search begins.
    """
    top, count = bed.strength / bed.stiffness, patches.owner.size
    grip = friction_depth(bed.stiffness, bed.strength, bed.friction, bed.shear_strength)
    xc, yc = hull.centre.tolist()
    q, u, springs, bent = rise.copy(), np.zeros(0), np.zeros(0), None

    def minimised() -> Floats:
        iterations, loads = minimise(
            cut_up.start, cut_up.corner, cut_up.column, xc, yc, q, u, bed.stiffness, top, hull.stiffness, springs
        )
        if iterations < 0:
            raise FloatingPointError
        return loads

    def evaluate() -> Pressure:
        load, x, y, capacity = np.zeros((4, elements))
        push, excess = np.zeros((elements, 2)), np.zeros(count)
        _loads(
            cut_up.start, cut_up.corner, cut_up.origin, patches.owner, patches.gradient, cut_up.column, xc, yc, q, u,
            bed.stiffness, top, grip, load, x, y, capacity, push, excess, cut_up.overlap, cut_up.area,
        )  # fmt: skip
        some = np.where(load > 0.0, load, 1.0)
        x, y = np.where(load > 0.0, x / some, 0.0), np.where(load > 0.0, y / some, 0.0)
        return Pressure(q, load, x, y, bed.friction * capacity, push, excess, patches, bent)

    overlap, area = np.zeros(len(patches.corner)), np.zeros((count, 6))
    cut_up = Loaded(patches.start, patches.corner, np.arange(count), np.full(count, -1), overlap, area)
    minimised()
    found = evaluate()
    if not (bed.bends and found.touches):
        return found
    for _ in range(ROUNDS):
        before = found.load.sum()
        group = _groups(found.load, first, second)
        shape = [
            Patch(*_measure(
                group == g, found.load, found.x, found.y, thickness, bed.modulus, bed.poisson, patches.owner, cut_up.origin,
                cut_up.start, cut_up.corner, cut_up.overlap, cut_up.area, hull.centre, hull.stiffness, hull.start, hull.ring,
            ))
            for g in range(group.max() + 1)
        ]  # fmt: skip
        columns = np.cumsum([0, *(patch.columns for patch in shape)])
        u, springs = np.zeros(columns[-1]), np.empty(columns[-1])
        bent = Bent(group, shape, columns, u, springs, cut_up)
        cut_up = _cut_up(patches, bent)
        even = np.ones(columns[-1])
        _set_springs(bent, even, even)
        loads = minimised()
        # The distribution of the bending along the lines decides on their stiffness.
        for _ in range(4):
            _set_springs(bent, u, loads)
            loads = minimised()
        found = evaluate()
        now = found.load.sum()
        if not found.touches or abs(now - before) <= SETTLED * now:
            break
    return found


def _groups(load: Floats, first: Ints, second: Ints) -> Ints:
    """Patch of each element: loaded elements that are bonded to each other; -1 where nothing presses."""
    loaded = load > 0.0
    both = loaded[first] & loaded[second]
    part = connected_parts(load.size, first[both], second[both], np.zeros(int(both.sum()), np.int64))
    group = np.full(load.size, -1)
    group[loaded] = np.unique(part[loaded], return_inverse=True)[1]
    return group


def _cut_up(patches: Patches, bent: Bent) -> Loaded:
    """Cut the polygons by the columns of the patches."""
    axis_x, axis_y, begin, width = np.array([patch[:4] for patch in bent.patches]).T.copy()
    room = 2 * patches.owner.size + 64
    while True:
        start, out = np.zeros(room + 1, np.int64), np.empty((8 * room, 3))
        origin, column = np.empty(room, np.int64), np.empty(room, np.int64)
        count = _split(
            patches.start, patches.corner, patches.owner, bent.group, axis_x, axis_y, begin, width, bent.columns, start, out,
            origin, column,
        )  # fmt: skip
        if count >= 0:
            corners = int(start[count])
            none, area = np.zeros(corners), np.zeros((count, 6))
            return Loaded(start[: count + 1], out[:corners], origin[:count], column[:count], none, area)
        room *= 2


def _set_springs(bent: Bent, bending: Floats, load: Floats) -> None:
    """Set the stiffness of all columns by their bending and load."""
    for patch, (a, b) in zip(bent.patches, pairwise(bent.columns.tolist()), strict=True):
        column_stiffness(
            patch.line, patch.width, patch.point, patch.first_end, patch.last_end, patch.rigid, bending[a:b], load[a:b],
            bent.springs[a:b],
        )  # fmt: skip


# Many arguments: elements, polygons and the hull are arrays apart, which is what `press` has at hand.
@kernel
def _measure(
    inside: NDArray[np.bool_], load: Floats, load_x: Floats, load_y: Floats, thickness: Floats, modulus: float, poisson: float,
    owner: Ints, origin: Ints, start: Ints, corner: Floats, overlap: Floats, area: Floats, centre: Floats, stiffness: Floats,
    ring_start: Ints, ring: Floats,
) -> tuple[float, float, float, float, int, float, float, float, float, float, float, float, float]:  # fmt: skip
    """Measure a patch and the ice around it; returns the fields of `Patch`.

    ``inside``: whether an element belongs to it; ``area``: moments of the loaded part of each polygon, as `_loads` finds them.
    """
    weight, thick, x, y = 0.0, 0.0, 0.0, 0.0
    for e in range(load.size):
        if inside[e]:
            weight += load[e]
            thick += load[e] * thickness[e]
            x += load[e] * load_x[e]
            y += load[e] * load_y[e]
    thick, x, y = thick / weight, x / weight, y / weight
    reach = bending_length(modulus, poisson, thick)
    around = math.sqrt(2.0) * reach

    # Its line is the major axis of the loaded area, by exact moments: means over corners would depend on the cuts.
    whole, mx, my, mxx, mxy, myy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    most = CORNERS
    for k in range(origin.size):
        if inside[owner[origin[k]]] and area[k, 0] > 0.0:
            whole, mx, my = whole + area[k, 0], mx + area[k, 1], my + area[k, 2]
            mxx, mxy, myy = mxx + area[k, 3], mxy + area[k, 4], myy + area[k, 5]
            most = max(most, 2 * (start[k + 1] - start[k]) + 4)
    angle = 0.5 * math.atan2(2.0 * (mxy - mx * my / whole), (mxx - mx * mx / whole) - (myy - my * my / whole))
    ax, ay = math.cos(angle), math.sin(angle)

    # How far what is loaded reaches along the line (s) and across (t), and its deepest point without any rise.
    s0, s1, t0, t1, deepest, deep_x, deep_y = math.inf, -math.inf, math.inf, -math.inf, -math.inf, 0.0, 0.0
    piece, room = np.empty((most, 4)), np.empty((most, 4))
    for k in range(origin.size):
        if not (inside[owner[origin[k]]] and area[k, 0] > 0.0):
            continue
        for n in range(_loaded_part(start, corner, overlap, k, piece, room)):
            px, py = room[n, 0], room[n, 1]
            s, t = px * ax + py * ay, py * ax - px * ay
            s0, s1, t0, t1 = min(s0, s), max(s1, s), min(t0, t), max(t1, t)
            if room[n, 2] > deepest:
                deepest, deep_x, deep_y = room[n, 2], px, py
    s1 = max(s1, s0 + 1e-3)

    # Parts of the neighbourhood that are ice: strips on both sides of the line, short ones beyond its ends, and a disc.
    wide, beyond = max(t1 - t0, 1.0), 0.25 * around
    left = _ice_in_box(ax, ay, s0, s1, t1, t1 + around, ring_start, ring)
    right = _ice_in_box(ax, ay, s0, s1, t0 - around, t0, ring_start, ring)
    before = _ice_in_box(ax, ay, s0 - beyond, s0, t0 - 0.5 * wide, t1 + 0.5 * wide, ring_start, ring)
    after = _ice_in_box(ax, ay, s1, s1 + beyond, t0 - 0.5 * wide, t1 + 0.5 * wide, ring_start, ring)
    disc = np.empty((DISC_CORNERS, 2))
    for n in range(DISC_CORNERS):
        turn = 2.0 * math.pi * n / DISC_CORNERS
        disc[n, 0], disc[n, 1] = deep_x + around * math.cos(turn), deep_y + around * math.sin(turn)
    share = share_of_ice(disc, ring_start, ring)

    inner = max(0.5 * (left + right), 0.05)
    end = WATER_STIFFNESS * reach * reach * (1.08 + (4.0 - 1.08) * min(max(left + right - 1.0, 0.0), 1.0))
    matrix, lever = stiffness.copy(), np.array([1.0, y - centre[1], centre[0] - x])
    compliance = lever.copy()
    z, tilt_x, tilt_y = solve(matrix, compliance)
    rigid = lever[0] * z + lever[1] * tilt_x + lever[2] * tilt_y
    count = max(LEAST_COLUMNS, math.ceil((s1 - s0) * COLUMNS_PER_LAMBDA / around))
    width, pad = (s1 - s0) / count, (count + 1) // 2
    # At an edge the ice gives way by 1 - x / lambda at a distance x; a wide patch lifts all of its water.
    line, middle = line_stiffness(reach, inner), y * ax - x * ay
    line += WATER_STIFFNESS * abs(right - left) * ((t1 - middle) if left < right else (middle - t0))
    line = max(line, WATER_STIFFNESS * whole / (s1 - s0))
    return (
        ax, ay, s0 - pad * width, width, count + 2 * pad, line, point_stiffness(reach, share), end * min(before / inner, 1.0),
        end * min(after / inner, 1.0), rigid, reach, share, thick,
    )  # fmt: skip


@kernel
def _loaded_part(start: Ints, corner: Floats, overlap: Floats, k: int, piece: Floats, out: Floats) -> int:
    """Write the corners of the loaded part of a polygon to ``out``: x, y, overlap without any rise, overlap."""
    size = start[k + 1] - start[k]
    for n in range(size):
        for i in range(3):
            piece[n, i] = corner[start[k] + n, i]
        piece[n, 3] = overlap[start[k] + n]
    return cut(piece, size, 3, 0.0, 1.0, out)


@kernel
def _ice_in_box(ax: float, ay: float, s0: float, s1: float, t0: float, t1: float, start: Ints, ring: Floats) -> float:
    """Share of a box that is ice; ``s`` along the direction (ax, ay), ``t`` to its left, m."""
    box = np.empty((4, 2))
    box[0, 0], box[0, 1] = s0 * ax - t0 * ay, s0 * ay + t0 * ax
    box[1, 0], box[1, 1] = s1 * ax - t0 * ay, s1 * ay + t0 * ax
    box[2, 0], box[2, 1] = s1 * ax - t1 * ay, s1 * ay + t1 * ax
    box[3, 0], box[3, 1] = s0 * ax - t1 * ay, s0 * ay + t1 * ax
    return share_of_ice(box, start, ring)


@kernel
def share_of_ice(convex: Floats, start: Ints, ring: Floats) -> float:
    """Part of a convex polygon (corners counter-clockwise) that is ice: the rings of its outline, cut by each side."""
    ice, size = 0.0, len(convex)
    for r in range(start.size - 1):
        count = start[r + 1] - start[r]
        one, other = np.empty((2 * count, 3)), np.empty((2 * count, 3))
        for n in range(count):
            one[n, 0], one[n, 1] = ring[start[r] + n, 0] - convex[0, 0], ring[start[r] + n, 1] - convex[0, 1]
        for side in range(size):
            x, y = convex[side, 0] - convex[0, 0], convex[side, 1] - convex[0, 1]
            last = convex[(side + 1) % size]
            dx, dy = last[0] - convex[side, 0], last[1] - convex[side, 1]
            for n in range(count):
                one[n, 2] = dx * (one[n, 1] - y) - dy * (one[n, 0] - x)
            if len(other) < 2 * count:  # a cut leaves at most twice as many corners
                other = np.empty((2 * count, 3))
            count = cut(one, count, 2, 0.0, 1.0, other)
            one, other = other, one
        for n in range(count):
            m = n + 1 if n + 1 < count else 0
            ice += 0.5 * (one[n, 0] * one[m, 1] - one[m, 0] * one[n, 1])
    whole = 0.0
    for n in range(1, size - 1):
        ux, uy = convex[n, 0] - convex[0, 0], convex[n, 1] - convex[0, 1]
        vx, vy = convex[n + 1, 0] - convex[0, 0], convex[n + 1, 1] - convex[0, 1]
        whole += 0.5 * (ux * vy - vx * uy)
    return ice / whole


@kernel
def column_stiffness(
    line: float, width: float, point: float, first_end: float, last_end: float, rigid: float, bending: Floats, load: Floats,
    out: Floats,
) -> None:  # fmt: skip
    """Write the stiffness of the columns of a patch (N m-1) by their bending and load to ``out``.

    None gives way where heave and tilt do all.
    """
    total, largest, whole, work = 0.0, 0.0, 0.0, 0.0
    one, two, second, last = -1, -1, -1, -1  # loaded columns at both ends
    for c in range(bending.size):
        total += line * width * bending[c]
        largest = max(largest, bending[c])
        whole += load[c]
        work += bending[c] * load[c]
        if load[c] > 0.0:
            two = c if one >= 0 > two else two
            one = c if one < 0 else one
            second, last = last, c
    if not (whole > 0.0 and largest > 0.0):
        out[:] = max(line * width, 1e-3 * point)
        return
    at_ends = total
    if two >= 0:
        at_ends += first_end * max(1.5 * bending[one] - 0.5 * bending[two], 0.0)
        at_ends += last_end * max(1.5 * bending[last] - 0.5 * bending[second], 0.0)
    factor = max(point * largest, at_ends) / total
    patch = factor * total / (work / whole)
    out[:] = width * line * factor / max(1.0 - rigid * patch, 1e-9)


def _bending(patch: Patch, inside: NDArray[np.bool_], largest: float, loaded: Loaded, owner: Ints) -> Bending:
    """Return what the largest bending (m) of a patch means."""
    mine = np.flatnonzero(inside[owner[loaded.origin]] & (loaded.area[:, 0] > 0.0))
    corners = _loaded_corners(loaded.start, loaded.corner, loaded.overlap, mine)
    stress = bending_stress(patch.reach, patch.share, patch.thickness, largest)
    area, length = shapely.MultiPoint(corners).convex_hull, math.sqrt(2.0) * patch.reach
    return Bending(largest, stress, patch.share, length, (patch.axis_x, patch.axis_y), area, inside)


@kernel
def _loaded_corners(start: Ints, corner: Floats, overlap: Floats, mine: Ints) -> Floats:
    """Corners of the loaded part of some polygons, m."""
    size, most = 0, CORNERS
    for k in mine:
        size += 2 * (start[k + 1] - start[k]) + 4
        most = max(most, 2 * (start[k + 1] - start[k]) + 4)
    out, count = np.empty((size, 2)), 0
    piece, room = np.empty((most, 4)), np.empty((most, 4))
    for k in mine:
        for n in range(_loaded_part(start, corner, overlap, k, piece, room)):
            out[count, 0], out[count, 1] = room[n, 0], room[n, 1]
            count += 1
    return out[:count]
