"""Bonds laid out for the sub-steps: unbroken bonds in rows, and the rows that meet in each element.

Bringing both ends of the bonds beside their rows, applying the law to whole rows and summing over the bonds of each element is
several times faster than one loop over bonds that does all at once. The law becomes vector instructions, and the sum has a
fixed order per element, so results do not depend on threads. `riftberg.stepping.explicit.tiles` tells how rows
stand in memory.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.constants import DEGREE
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import damping_constant, signed_slip
from riftberg.physics.geometry import fast_cos_latitude, separation
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.explicit import tiles as tile
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fracture.strengths import limits_left

Indices = NDArray[np.uint32]
"""Unsigned, because numba then leaves out the test for negative (wrap-around) indices."""


class BondTiles(NamedTuple):
    """Unbroken bonds in rows, layer by layer (see `riftberg.stepping.explicit.tiles`)."""

    bond_ids: Ints  # Number of the bond of each row, or -1
    # Where the element at its second end stands in ``ends``. The first end of a row is its place in the layer
    second_end: Indices
    # What the bonds see of the elements, in blocks, and one block more. Where no element is, numbers that differ
    ends: Floats
    elem: Floats  # What the elements have for themselves, in blocks (`riftberg.stepping.explicit.element_blocks`)
    sums: Floats  # Forces (N) and torques (N m) of all bonds that begin at each element, in blocks
    bond: Floats  # All quantities of all rows; one block more holds zeros
    scratch: Floats  # What a block needs within a sub-step
    in_use: Ints  # Numbers of the blocks with bonds, in order; as many as `pack_bonds` says
    # Where the k-th bond that ends in each element begins in ``block``; in the block of zeros where there are fewer;
    # shape (elements, slots)
    slots: Indices
    rotation: Floats  # By how much the elements have turned since the rows were loaded, rad
    counter: Ints  # Room for a number for each element


def _aligned(count: int) -> Floats:
    """Return zeros that begin with a line of the cache, so that no vector lies across two."""
    room = np.zeros(count + 8)
    begin = -(room.ctypes.data // 8) % 8
    return room[begin : begin + count]


def allocate_tiles(bonds: Bonds, element_count: int) -> BondTiles:
    """Allocate rows for all bonds of the state; `pack_bonds` fills them."""
    further = bonds.first[bonds.second != bonds.first + 1]
    begin, end = (np.bincount(end_ids, minlength=element_count) for end_ids in (further, bonds.second))
    width = tile.tile_count(element_count)
    blocks = width * (1 + int(begin.max(initial=0))) if bonds.first.size else 0
    size = blocks * tile.LANES
    ends = _aligned((width + 1) * tile.END_TILE)
    ends[:] = np.arange(ends.size)
    return BondTiles(
        bond_ids=np.zeros(size, np.int64),
        second_end=np.zeros(size, np.uint32),
        ends=ends,
        elem=_aligned(width * tile.ELEMENT_TILE),
        sums=_aligned(width * tile.SUM_TILE),
        bond=_aligned((blocks + 1) * tile.BOND_TILE),
        scratch=_aligned(tile.SCRATCH_TILE),
        in_use=np.zeros(blocks, np.int64),
        slots=np.zeros((element_count, max(int(end.max(initial=0)), 1)), np.uint32),
        rotation=np.zeros(width * tile.LANES),
        counter=np.zeros(element_count, np.int64),
    )


@kernel
def _thickness_rule(r1, r2, t1, t2, first_is_earlier, quirk):
    """Thickness (m) from which the section starts, and the difference that is added to it (equations 5.4; quirk Q11)."""
    # Without a smaller radius the reference starts from the element processed second.
    second_is_small = r2 < r1 or (r1 == r2 and first_is_earlier)
    small, other = (t2, t1) if second_is_small else (t1, t2)
    return small, (abs(t1 - t2) if quirk else other - small)


@kernel
def _fill_constants(bond, at, i, j, b, elements, rest_length, sizes, rank, p):
    """Constants of the law for the row of bond ``b`` from element i to j (equations 5.4; quirks Q10, Q11)."""
    r1, r2, thickness = sizes.bond_radius[i], sizes.bond_radius[j], elements.body.thickness
    rest = r1 + r2
    if not p.rest_length_from_sizes and not math.isnan(rest_length[b]):
        # A bond keeps the shape with which it formed: sides that melt since do not strain or narrow it.
        rest = rest_length[b]
        formed = rest / (r1 + r2)
        r1, r2 = r1 * formed, r2 * formed
    first_is_earlier = rank[i] <= rank[j]
    bond[at + tile.REST], bond[at + tile.RADIUS1], bond[at + tile.RADIUS2] = rest, r1, r2
    bond[at + tile.THICKNESS_SMALL], bond[at + tile.THICKNESS_GAP] = _thickness_rule(
        r1, r2, thickness[i], thickness[j], first_is_earlier, p.bond_thickness_of_second
    )
    shared = r1 if first_is_earlier else r2
    bond[at + tile.LEVER1], bond[at + tile.LEVER2] = (shared, shared) if p.shared_shear_lever else (r1, r2)
    bond[at + tile.DAMPING] = damping_constant(
        p.youngs_modulus, p.poisson, p.bond_damping, sizes.bond_mass[i], sizes.bond_mass[j]
    )
    bond[at + tile.MODULUS] = p.youngs_modulus / rest


@kernel
def _fill_place(bond, at, i, j, sx, sy, elements, p):
    """Latitude of the row with its cosine and sine, and the shear displacement along the tangent of the moment."""
    x, y = elements.shown.lon_pair, elements.shown.lat_pair
    mean = 0.5 * (y[i] + y[j])
    per_unit = DEGREE * p.earth_radius if p.latlon else 1.0
    bond[at + tile.Y_REFERENCE] = mean
    bond[at + tile.METRES_COS] = per_unit * (fast_cos_latitude(mean) if p.latlon else 1.0)
    bond[at + tile.METRES_SIN] = per_unit * (math.sin(mean * DEGREE) if p.latlon else 0.0)
    rx, ry = separation(x[i], y[i], x[j], y[j], p.latlon, p.earth_radius, p.period)
    bond[at + tile.SLIP] = signed_slip(sx, sy, rx, ry)


@kernel
def _copy_bond(bond, at, b, bonds, p):
    """What the state knows of bond ``b``."""
    strength, damage = bonds.strength[b], bonds.damage[b]
    bond[at + tile.INTACT] = 1.0
    bond[at + tile.PEAK_STRESS] = bonds.normal_stress[b]
    bond[at + tile.STRENGTH], bond[at + tile.DAMAGE] = strength, damage
    bond[at + tile.NORMAL_LIMIT], bond[at + tile.SHEAR_LIMIT] = limits_left(
        p.normal_strength, p.shear_strength, strength, damage
    )


@kernel
def _assign_lanes(tiles, bonds):
    """Give each unbroken bond a layer: the first one to the next element, else the next one of its first end."""
    bond_ids, second, counter, status = tiles.bond_ids, tiles.second_end, tiles.counter, bonds.status
    width = tile.tile_count(counter.size) * tile.LANES
    bond_ids[:] = -1
    counter[:] = 0
    for b in range(status.size):
        if status[b] == 0:
            i, j = bonds.first[b], bonds.second[b]
            layer = 0
            if j != i + 1:
                counter[i] += 1
                layer = counter[i]
            r = layer * width + i
            bond_ids[r], second[r] = b, tile.end_offset(j)


@kernel
def _list_blocks(tiles):
    """List the blocks with bonds; returns their number."""
    bond_ids, second, bond, in_use = tiles.bond_ids, tiles.second_end, tiles.bond, tiles.in_use
    width = tile.tile_count(tiles.counter.size) * tile.LANES
    count = 0
    for b in range(in_use.size):
        some = False
        for r in range(b * tile.LANES, (b + 1) * tile.LANES):
            some = some or bond_ids[r] >= 0
            if bond_ids[r] < 0:
                bond[tile.bond_offset(r) + tile.INTACT] = 0.0
                # To the next one, so that it has a length, also where that stands due east on a plane.
                second[r] = tile.end_offset(r % width + 1)
                bond[tile.bond_offset(r) + tile.METRES_COS] = 1.0
        if some:
            in_use[count] = b
            count += 1
    return count


@kernel
def _fill_slots(tiles, second):
    """List the rows that end in each element, in order of row; unused slots name the block of zeros."""
    slots, counter, bond_ids = tiles.slots, tiles.counter, tiles.bond_ids
    counter[:] = 0
    slots[:, :] = tiles.bond.size - tile.BOND_TILE
    for r in range(bond_ids.size):
        if bond_ids[r] >= 0:
            j = second[bond_ids[r]]
            slots[j, counter[j]] = tile.bond_offset(r)
            counter[j] += 1


@stage
def pack_bonds(
    tiles: BondTiles, elements: Elements, bonds: Bonds, sizes: Sizes, rank: Ints, p: KernelParameters
) -> int:
    """Copy the unbroken bonds into the rows and find the rows of each element."""
    _assign_lanes(tiles, bonds)
    count = _list_blocks(tiles)
    _fill_slots(tiles, bonds.second)
    bond, first, second, sx, sy = tiles.bond, bonds.first, bonds.second, bonds.shear_x, bonds.shear_y
    for r in range(tiles.bond_ids.size):
        b = tiles.bond_ids[r]
        if b >= 0:
            at, i, j = tile.bond_offset(r), first[b], second[b]
            _copy_bond(bond, at, b, bonds, p)
            _fill_constants(bond, at, i, j, b, elements, bonds.rest_length, sizes, rank, p)
            _fill_place(bond, at, i, j, sx[b], sy[b], elements, p)
    return count


@kernel
def may_cross_seam(x: Floats, period: float) -> bool:
    """Whether bonds may lie across the seam of a periodic domain: elements stand on both sides of it, or far apart."""
    least, largest = math.inf, -math.inf
    for at in x:
        least, largest = min(least, at), max(largest, at)
    return period > 0.0 and largest - least > 0.25 * period
