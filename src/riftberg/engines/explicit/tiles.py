"""How bonds and elements stand in memory in the sub-steps: tiles, packed from the state and unpacked into it.

A lane holds one intact bond. `LANES` of them make a tile, in which each quantity of all its bonds stands side by side; the
tiles follow each other in one array (an array of structures of arrays). So quantity ``REST`` of lane ``k`` of the tile that
begins at ``at`` is ``bond[at + REST + k]``, and that of bond lane ``r`` is ``bond[bond_offset(r) + REST]``. What is needed
within a sub-step alone stands in a scratch tile, which all tiles use one after the other. Elements stand in tiles too: what
bonds see of them in ``ends``, what they have for themselves in ``elem``.

Lanes stand in layers: the first layer holds the bonds from each element to the next one, in order of the elements, the others
one more bond each that begins there. So the first ends of a tile of bonds are one tile of elements, which lie side by side too;
the tiles of all layers that begin at the same elements follow each other, in the order in which a sub-step goes through them.
Where an element has no such bond its lane is not intact; a tile without a bond is left out. What the sizes of their ends make of
bonds stands in tiles of its own, ``shape``, and tiles of a layer that are alike share one: ice of one thickness has one for each
layer, which stays in the cache.

Why: numbers have to come from the second-level cache, or from memory, in each sub-step, and that takes longer than the law
itself; so a lane holds as little as it can, and all that happens to a tile happens while it is in the cache. All distances
in memory are known when the loops are compiled: with an array for each quantity, code that proves that none of forty overlaps
took more room than the law. What belongs to the first ends is read, and summed, by vector instructions, that of the second
ends one by one. Each element sums over its bonds in a fixed order.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.constants import DEGREE
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import damping_constant, residual_strength, signed_slip
from riftberg.physics.geometry import fast_cos_latitude, separation
from riftberg.state import Bonds, Elements, Floats, Ints, zeros

Indices = NDArray[np.uint32]
"""Unsigned, because numba then leaves out the test for negative (wrap-around) indices."""

LANES: Final = 32
"""Lanes of a tile: eight 256-bit vectors of each quantity."""

# What bonds see of an element: place (units of the grid), velocity (m s-1), spin (s-1), angle (rad). In a tile of ends and,
# for the second ends of a tile of bonds, in the scratch tile.
X, Y, U, V, SPIN, ANGLE = (LANES * n for n in range(6))

END_TILE: Final = LANES * 6
"""Numbers in a tile of ends."""

# What elements have for themselves: velocity (m s-1), inner accelerations before this sub-step, explicit and implicit, and that
# by contact (m s-2).
VELOCITY_X, VELOCITY_Y, AX, AY, BX, BY, CONTACT_X, CONTACT_Y = (LANES * n for n in range(8))
# 1 where it moves; 1 over its mass (kg-1) and its inertia (kg-1 m-2); steady loads (N), 0 where a roller takes what is northward.
ACTIVE, PER_MASS, PER_INERTIA, LOAD_X, LOAD_Y, FREE_Y, SPIN_RATE = (LANES * n for n in range(8, 15))
# The sea floor: rate at the velocity now (s-1), its linear and its quadratic part (m-1), what an implicit sub-step leaves of
# velocity and of spin (0 to 1), and the sum of its decelerations (m s-2).
FLOOR_RATE, FLOOR_LINEAR, FLOOR_QUADRATIC, DECAY, SPIN_DECAY, FLOOR_IMPULSE_X, FLOOR_IMPULSE_Y = (
    LANES * n for n in range(15, 22)
)

ELEMENT_TILE: Final = LANES * 22
"""Numbers in a tile of elements."""

# Of a bond, constants of the law that its ends' sizes make. MODULUS is that against extension over the length at rest, in
# Pa m-1; DAMPING in kg s-1.
REST, RADIUS1, RADIUS2, LEVER1, LEVER2, THICKNESS_SMALL, THICKNESS_GAP, DAMPING, MODULUS = (LANES * n for n in range(9))

SHAPE_TILE: Final = LANES * 9
"""Numbers in a tile of shapes."""

# Of a bond; INTACT is 1, or 0 where no bond is or it has broken in this long step. Mean latitude of the ends when the bonds were
# packed, and its cosine and sine, times metres in a degree.
INTACT, Y_REFERENCE, METRES_COS, METRES_SIN = (LANES * n for n in range(4))
# What the stress may reach, and its largest in this long step, Pa; shear displacement along the tangent, m.
NORMAL_LIMIT, SHEAR_LIMIT, PEAK_STRESS, SLIP = (LANES * n for n in range(4, 8))
# Force on the first end, N, and torque on the second, N m.
FX, FY, TORQUE2 = (LANES * n for n in range(8, 11))

BOND_TILE: Final = LANES * 11
"""Numbers in a tile of bonds."""

# In the scratch tile, after the second ends: direction of the bond, half its overlap, length, width, thickness, turn of the
# local axes from one end to the other (rad), sine of the angle.
NX, NY, HALF, LENGTH, WIDTH, THICKNESS, TURN, SINE = (LANES * n for n in range(6, 14))
# Torque on the first end, N m, and stresses, Pa.
TORQUE1, NORMAL_STRESS, SHEAR_STRESS = (LANES * n for n in range(14, 17))

SCRATCH_TILE: Final = LANES * 17
"""Numbers in the scratch tile."""

# Sums over the bonds that begin at an element: forces (N) and torques (N m).
SUM_X, SUM_Y, SUM_TORQUE = (LANES * n for n in range(3))

SUM_TILE: Final = LANES * 3
"""Numbers in a tile of sums."""

AT_ONCE: Final = 8
"""Sub-steps that go through the tiles one close behind the other: a tile comes from memory once for all of them."""

TILE, BONDS, MOVED, BROKEN = range(4)
"""How far a sub-step has come: elements whose bonds are done, tiles of bonds done, elements moved on, bonds that broke."""


@kernel
def bond_offset(lane: int) -> int:
    """Where the quantities of a bond lane begin: ``bond[bond_offset(lane) + REST]`` is its ``REST``."""
    return (lane // LANES) * BOND_TILE + lane % LANES


@kernel
def bond_lane(layer: int, element: int, layers: int) -> int:
    """Lane of the bond of a layer that begins at an element."""
    return ((element // LANES) * layers + layer) * LANES + element % LANES


@kernel
def end_offset(element: int) -> int:
    """Offset in ``ends`` of the values of an element that bonds see."""
    return (element // LANES) * END_TILE + element % LANES


@kernel
def tile_count(count: int) -> int:
    """Tiles that ``count`` elements take."""
    return (count + LANES - 1) // LANES


EMPTY: Final = -1
"""Stands for a bond in a lane that holds none."""


class BondTiles(NamedTuple):
    """Intact bonds in lanes, layer by layer, and the elements that they join."""

    bond_ids: Ints  # Row in the state of the bond of each lane, or `EMPTY`
    second_end: Indices  # Where its second end begins in ``ends``; its first end is its place in the layer
    ends: Floats  # What bonds see of elements, in tiles, and one tile more; where no element is, numbers that differ
    elem: Floats  # What elements have for themselves, in tiles
    sums: Floats  # Sums over all bonds that begin at each element, in tiles
    bond: Floats  # All quantities of all bonds but their shapes, in tiles; one tile more holds zeros
    shape: Floats  # Shapes of bonds, in tiles; as many as there are different ones
    shape_of: Ints  # Where the shapes of each tile of bonds begin in ``shape``
    scratch: Floats  # What a tile of bonds needs within a sub-step
    in_use: Ints  # Tiles that hold bonds, in order; as many as `pack_bonds` says
    last_tile: Ints  # Of each tile of elements: the last one in which a bond begins that it sees; shape (tiles,)
    farthest: Ints  # Of each tile of elements: the last one that the bonds that begin in it see; shape (tiles,)
    fronts: Ints  # How far each of the sub-steps at work has come: `TILE` and what follows it; shape (AT_ONCE, 4)
    slots: Indices  # Where the k-th bond that ends at each element begins in ``bond``, or the zeros; shape (elements, slots)
    rotation: Floats  # By how much elements have turned since the bonds were packed, rad
    counter: Ints  # Work space, one number for each element
    layers: int


def _aligned(count: int) -> Floats:
    """Return zeros that begin with a line of the cache, so that no vector lies across two."""
    padded = zeros(count + 8)  # a line holds 64 bytes, eight numbers
    begin = -(padded.ctypes.data // 8) % 8
    return padded[begin : begin + count]


def allocate_tiles(elements: Elements, bonds: Bonds) -> BondTiles:
    """Allocate lanes for all bonds of the state; `pack_bonds` fills them."""
    count = elements.size
    # Bonds to the next element have a layer of their own before all others.
    begin = np.bincount(bonds.first[bonds.second != bonds.first + 1], minlength=count)
    end = np.bincount(bonds.second, minlength=count)
    width, layers = tile_count(count), 1 + int(begin.max(initial=0))
    tiles = width * layers if bonds.first.size else 0
    size = tiles * LANES
    ends = _aligned((width + 1) * END_TILE)
    # Numbers that differ, so that lanes without a bond divide by no length of 0.
    ends[:] = np.arange(ends.size)
    return BondTiles(
        bond_ids=np.zeros(size, np.int64),
        second_end=np.zeros(size, np.uint32),
        ends=ends,
        elem=_aligned(width * ELEMENT_TILE),
        sums=_aligned(width * SUM_TILE),
        bond=_aligned((tiles + 1) * BOND_TILE),
        shape=_aligned(tiles * SHAPE_TILE),  # what is never written takes no memory
        shape_of=np.zeros(tiles, np.int64),
        scratch=_aligned(SCRATCH_TILE),
        in_use=np.zeros(tiles, np.int64),
        last_tile=np.zeros(width, np.int64),
        farthest=np.zeros(width, np.int64),
        fronts=np.zeros((AT_ONCE, 4), np.int64),
        slots=np.zeros((count, max(int(end.max(initial=0)), 1)), np.uint32),
        rotation=np.zeros(width * LANES),
        counter=np.zeros(count, np.int64),
        layers=layers,
    )


@kernel
def _assign_lanes(tiles: BondTiles, bonds: Bonds) -> None:
    """Give each unbroken bond a layer: the first one to the next element, else the next one of its first end."""
    bond_ids, second, counter, status = tiles.bond_ids, tiles.second_end, tiles.counter, bonds.status
    bond_ids[:] = EMPTY
    counter[:] = 1
    for b in range(status.size):
        if status[b] == 0:
            i, j = bonds.first[b], bonds.second[b]
            layer = 0
            # Layer 0 is kept for the bonds to the next element, whose second ends need no gathering.
            if j != i + 1:
                layer = counter[i]
                counter[i] += 1
            r = bond_lane(layer, i, tiles.layers)
            bond_ids[r], second[r] = b, end_offset(j)


@kernel
def _list_tiles(tiles: BondTiles) -> int:
    """List the tiles with bonds; returns their number."""
    bond_ids, second, bond, in_use, layers = tiles.bond_ids, tiles.second_end, tiles.bond, tiles.in_use, tiles.layers
    count = 0
    for b in range(in_use.size):
        holds_bonds = False
        for r in range(b * LANES, (b + 1) * LANES):
            holds_bonds = holds_bonds or bond_ids[r] != EMPTY
            if bond_ids[r] == EMPTY:
                bond[bond_offset(r) + INTACT] = 0.0
                # A bond to the next element, so that its length is not 0, also where that lies due east on a plane.
                second[r] = end_offset(b // layers * LANES + r % LANES + 1)
                bond[bond_offset(r) + METRES_COS] = 1.0
        if holds_bonds:
            in_use[count] = b
            count += 1
    return count


@kernel
def _fill_slots(tiles: BondTiles, second: Ints) -> None:
    """List the bonds that end at each element, layer by layer, and which tiles of elements see each other.

    Unused slots point at the tile of zeros.
    """
    slots, counter, bond_ids, layers = tiles.slots, tiles.counter, tiles.bond_ids, tiles.layers
    last, farthest = tiles.last_tile, tiles.farthest
    counter[:] = 0
    for e in range(last.size):
        last[e] = farthest[e] = e
    # The last tile holds zeros for good: an unused slot adds nothing, and no branch is needed.
    slots[:, :] = tiles.bond.size - BOND_TILE
    for layer in range(layers if bond_ids.size else 0):
        for i in range(counter.size):
            r = bond_lane(layer, i, layers)
            if bond_ids[r] != EMPTY:
                j = second[bond_ids[r]]
                slots[j, counter[j]] = bond_offset(r)
                counter[j] += 1
                last[j // LANES] = max(last[j // LANES], i // LANES)
                farthest[i // LANES] = max(farthest[i // LANES], j // LANES)


@kernel
def _copy_bond(bond: Floats, at: int, b: int, bonds: Bonds, p: KernelParameters) -> None:
    """What the state holds of bond ``b``."""
    bond[at + INTACT] = 1.0
    # The step begins where the last one ended.
    bond[at + PEAK_STRESS] = bonds.normal_stress[b]
    bond[at + NORMAL_LIMIT], bond[at + SHEAR_LIMIT] = residual_strength(
        p.normal_strength, p.shear_strength, bonds.strength[b], bonds.damage[b]
    )


@kernel
def _thickness_rule(
    r1: float, r2: float, t1: float, t2: float, first_is_earlier: bool, quirk: bool
) -> tuple[float, float]:
    """Thickness (m) from which the section starts, and the difference that is added to it (equations 5.4; quirk Q11)."""
    # Without a smaller radius the reference starts from the element processed second.
    second_is_small = r2 < r1 or (r1 == r2 and first_is_earlier)
    small, other = (t2, t1) if second_is_small else (t1, t2)
    return small, (abs(t1 - t2) if quirk else other - small)


@kernel
def _fill_shape(
    shape: Floats, k: int, i: int, j: int, rest_length: float, elements: Elements, sizes: Sizes, rank: Ints,
    p: KernelParameters,
) -> None:  # fmt: skip
    """Constants of the law for a bond from i to j in lane k (equations 5.4, Q10, Q11)."""
    r1, r2, thickness = sizes.bond_radius[i], sizes.bond_radius[j], elements.body.thickness
    rest = r1 + r2
    if not p.rest_length_from_sizes and not math.isnan(rest_length):
        # A bond keeps the shape with which it formed: sides that melt since do not strain or narrow it.
        rest = rest_length
        formed = rest / (r1 + r2)
        r1, r2 = r1 * formed, r2 * formed
    first_is_earlier = rank[i] <= rank[j]
    shape[k + REST], shape[k + RADIUS1], shape[k + RADIUS2] = rest, r1, r2
    shape[k + THICKNESS_SMALL], shape[k + THICKNESS_GAP] = _thickness_rule(
        r1, r2, thickness[i], thickness[j], first_is_earlier, p.bond_thickness_of_second
    )
    shared = r1 if first_is_earlier else r2
    shape[k + LEVER1], shape[k + LEVER2] = (shared, shared) if p.shared_shear_lever else (r1, r2)
    shape[k + DAMPING] = damping_constant(
        p.youngs_modulus, p.poisson, p.bond_damping, sizes.bond_mass[i], sizes.bond_mass[j]
    )
    shape[k + MODULUS] = p.youngs_modulus / rest


@kernel
def _fill_place(
    bond: Floats, at: int, i: int, j: int, sx: float, sy: float, elements: Elements, p: KernelParameters
) -> None:
    """Latitude of a bond with its cosine and sine, and the shear displacement along its present tangent."""
    x, y = elements.shown.lon_pair, elements.shown.lat_pair
    mean = 0.5 * (y[i] + y[j])
    per_unit = DEGREE * p.earth_radius if p.latlon else 1.0
    bond[at + Y_REFERENCE] = mean
    bond[at + METRES_COS] = per_unit * (fast_cos_latitude(mean) if p.latlon else 1.0)
    bond[at + METRES_SIN] = per_unit * (math.sin(mean * DEGREE) if p.latlon else 0.0)
    rx, ry = separation(x[i], y[i], x[j], y[j], p.latlon, p.earth_radius, p.period)
    bond[at + SLIP] = signed_slip(sx, sy, rx, ry)


@stage
def pack_bonds(
    tiles: BondTiles, elements: Elements, bonds: Bonds, sizes: Sizes, rank: Ints, p: KernelParameters
) -> int:
    """Copy the intact bonds into the tiles and list the bonds of each element; returns the number of tiles with bonds."""
    _assign_lanes(tiles, bonds)
    count = _list_tiles(tiles)
    _fill_slots(tiles, bonds.second)
    free = 0
    for b in range(tiles.shape_of.size):
        free = _fill_shapes(tiles, b, free, elements, bonds, sizes, rank, p)
    bond, first, second, sx, sy = tiles.bond, bonds.first, bonds.second, bonds.shear_x, bonds.shear_y
    for r in range(tiles.bond_ids.size):
        b, at = tiles.bond_ids[r], bond_offset(r)
        if b != EMPTY:
            _copy_bond(bond, at, b, bonds, p)
            _fill_place(bond, at, first[b], second[b], sx[b], sy[b], elements, p)
    return count


@kernel
def _fill_shapes(
    tiles: BondTiles, b: int, free: int, elements: Elements, bonds: Bonds, sizes: Sizes, rank: Ints, p: KernelParameters
) -> int:
    """Find the shapes of tile ``b`` of bonds, those before it are known; returns from where on ``shape`` is free."""
    rest, layers, shape = bonds.rest_length, tiles.layers, tiles.shape[free : free + SHAPE_TILE]
    # Of the same layer, at the elements before.
    previous = tiles.shape_of[max(b - layers, 0)]
    filled = -1
    for k in range(LANES):
        bond = tiles.bond_ids[b * LANES + k]
        if bond == EMPTY:
            continue
        _fill_shape(shape, k, bonds.first[bond], bonds.second[bond], rest[bond], elements, sizes, rank, p)
        filled = k
    alike = b >= layers
    for n in range(SHAPE_TILE):
        # Lanes without a bond have the shape of one that is there: where a row ends is no reason for a tile of its own.
        if filled >= 0 and tiles.bond_ids[b * LANES + n % LANES] == EMPTY:
            shape[n] = shape[n // LANES * LANES + filled]
        alike = alike and (filled < 0 or shape[n] == tiles.shape[previous + n])
    tiles.shape_of[b] = previous if alike else free
    return free if alike else free + SHAPE_TILE


@kernel
def may_cross_seam(x: Floats, period: float) -> bool:
    """Whether bonds may lie across the seam of a periodic domain: elements lie more than a quarter of it apart."""
    least, largest = math.inf, -math.inf
    for at in x:
        least, largest = min(least, at), max(largest, at)
    return period > 0.0 and largest - least > 0.25 * period


@kernel
def pack(tiles: Floats, size: int, quantity: int, source: Floats) -> None:
    """Copy the values of all elements to one quantity of their tiles, which are ``size`` numbers long."""
    for b in range(tile_count(source.size)):
        values = source[b * LANES : min((b + 1) * LANES, source.size)]
        lanes = tiles[b * size + quantity : b * size + quantity + LANES]
        for k in range(values.size):
            lanes[k] = values[k]


@kernel
def unpack(target: Floats, tiles: Floats, size: int, quantity: int) -> None:
    """Copy back the values that `pack` has copied."""
    for b in range(tile_count(target.size)):
        values = target[b * LANES : min((b + 1) * LANES, target.size)]
        lanes = tiles[b * size + quantity : b * size + quantity + LANES]
        for k in range(values.size):
            values[k] = lanes[k]
