"""Bonds laid out for the sub-steps: unbroken bonds in rows, and the rows that meet in each element.

Bringing both ends of the bonds beside their rows, applying the law to whole rows and summing over the bonds of each element is
several times faster than one loop over bonds that does all at once. The law becomes vector instructions, and the sum has a
fixed order per element, so results do not depend on threads. `riftberg.stepping.explicit.bond_blocks` tells how rows
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
from riftberg.stepping.explicit import bond_blocks as row
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.fracture.strengths import residual_strength

Indices = NDArray[np.uint32]
"""Unsigned, because numba then leaves out the test for negative (wrap-around) indices."""


class BondRows(NamedTuple):
    """Unbroken bonds in rows, layer by layer (see `riftberg.stepping.explicit.bond_blocks`)."""

    bond: Ints  # Number of the bond of each row, or -1
    # Where the element at its second end stands in ``ends``. The first end of a row is its place in the layer
    second: Indices
    # What the bonds see of the elements, in blocks, and one block more. Where no element is, numbers that differ
    ends: Floats
    own: Floats  # What the elements have for themselves, in blocks (`riftberg.stepping.explicit.element_blocks`)
    sums: Floats  # Forces (N) and torques (N m) of all bonds that begin at each element, in blocks
    block: Floats  # All quantities of all rows; one block more holds zeros
    sheet: Floats  # What a block needs within a sub-step
    used: Ints  # Numbers of the blocks with bonds, in order; as many as `load_rows` says
    # Where the k-th bond that ends in each element begins in ``block``; in the block of zeros where there are fewer;
    # shape (elements, slots)
    slot: Indices
    turned: Floats  # By how much the elements have turned since the rows were loaded, rad
    met: Ints  # Room for a number for each element


def _aligned(count: int) -> Floats:
    """Return zeros that begin with a line of the cache, so that no vector lies across two."""
    room = np.zeros(count + 8)
    begin = -(room.ctypes.data // 8) % 8
    return room[begin : begin + count]


def allocate_rows(bonds: Bonds, element_count: int) -> BondRows:
    """Allocate rows for all bonds of the state; `load_rows` fills them."""
    further = bonds.first[bonds.second != bonds.first + 1]
    begin, end = (np.bincount(ends, minlength=element_count) for ends in (further, bonds.second))
    width = row.blocks_of(element_count)
    blocks = width * (1 + int(begin.max(initial=0))) if bonds.first.size else 0
    size = blocks * row.LANES
    ends = _aligned((width + 1) * row.ENDS)
    ends[:] = np.arange(ends.size)
    return BondRows(
        bond=np.zeros(size, np.int64),
        second=np.zeros(size, np.uint32),
        ends=ends,
        own=_aligned(width * row.OWN),
        sums=_aligned(width * row.SUMS),
        block=_aligned((blocks + 1) * row.BLOCK),
        sheet=_aligned(row.SHEET),
        used=np.zeros(blocks, np.int64),
        slot=np.zeros((element_count, max(int(end.max(initial=0)), 1)), np.uint32),
        turned=np.zeros(width * row.LANES),
        met=np.zeros(element_count, np.int64),
    )


@kernel
def _thickness_rule(r1, r2, t1, t2, first_is_earlier, quirk):
    """Thickness (m) from which the section starts, and the difference that is added to it (equations 5.4; quirk Q11)."""
    # Without a smaller radius the reference starts from the element processed second.
    second_is_small = r2 < r1 or (r1 == r2 and first_is_earlier)
    small, other = (t2, t1) if second_is_small else (t1, t2)
    return small, (abs(t1 - t2) if quirk else other - small)


@kernel
def _fill_constants(block, at, i, j, b, elements, rest_length, sizes, earlier, p):
    """Constants of the law for the row of bond ``b`` from element i to j (equations 5.4; quirks Q10, Q11)."""
    r1, r2, thickness = sizes.bond_radius[i], sizes.bond_radius[j], elements.body.thickness
    rest = r1 + r2
    if not p.rest_length_from_sizes and not math.isnan(rest_length[b]):
        # A bond keeps the shape with which it formed: sides that melt since do not strain or narrow it.
        rest = rest_length[b]
        formed = rest / (r1 + r2)
        r1, r2 = r1 * formed, r2 * formed
    first_is_earlier = earlier[i] <= earlier[j]
    block[at + row.REST], block[at + row.RADIUS1], block[at + row.RADIUS2] = rest, r1, r2
    block[at + row.THICKNESS_SMALL], block[at + row.THICKNESS_GAP] = _thickness_rule(
        r1, r2, thickness[i], thickness[j], first_is_earlier, p.bond_thickness_of_second
    )
    shared = r1 if first_is_earlier else r2
    block[at + row.LEVER1], block[at + row.LEVER2] = (shared, shared) if p.shared_shear_lever else (r1, r2)
    block[at + row.DAMPING] = damping_constant(
        p.youngs_modulus, p.poisson, p.bond_damping, sizes.bond_mass[i], sizes.bond_mass[j]
    )
    block[at + row.MODULUS] = p.youngs_modulus / rest


@kernel
def _fill_place(block, at, i, j, sx, sy, elements, p):
    """Latitude of the row with its cosine and sine, and the shear displacement along the tangent of the moment."""
    x, y = elements.shown.lon_pair, elements.shown.lat_pair
    mean = 0.5 * (y[i] + y[j])
    per_unit = DEGREE * p.earth_radius if p.latlon else 1.0
    block[at + row.Y_LOADED] = mean
    block[at + row.METRES_COS] = per_unit * (fast_cos_latitude(mean) if p.latlon else 1.0)
    block[at + row.METRES_SIN] = per_unit * (math.sin(mean * DEGREE) if p.latlon else 0.0)
    rx, ry = separation(x[i], y[i], x[j], y[j], p.latlon, p.earth_radius, p.period)
    block[at + row.SLIP] = signed_slip(sx, sy, rx, ry)


@kernel
def _copy_bond(block, at, b, bonds, p):
    """What the state knows of bond ``b``."""
    strength, damage = bonds.strength[b], bonds.damage[b]
    block[at + row.ALIVE] = 1.0
    block[at + row.PEAK_STRESS] = bonds.normal_stress[b]
    block[at + row.STRENGTH], block[at + row.DAMAGE] = strength, damage
    block[at + row.NORMAL_LIMIT], block[at + row.SHEAR_LIMIT] = residual_strength(
        p.normal_strength, p.shear_strength, strength, damage
    )


@kernel
def _lay_out(rows, bonds):
    """Give each unbroken bond a layer: the first one to the next element, else the next one of its first end."""
    bond, second, met, status = rows.bond, rows.second, rows.met, bonds.status
    width = row.blocks_of(met.size) * row.LANES
    bond[:] = -1
    met[:] = 0
    for b in range(status.size):
        if status[b] == 0:
            i, j = bonds.first[b], bonds.second[b]
            layer = 0
            if j != i + 1:
                met[i] += 1
                layer = met[i]
            r = layer * width + i
            bond[r], second[r] = b, row.end_of(j)


@kernel
def _list_blocks(rows):
    """List the blocks with bonds; returns their number."""
    bond, second, block, used = rows.bond, rows.second, rows.block, rows.used
    width = row.blocks_of(rows.met.size) * row.LANES
    count = 0
    for b in range(used.size):
        some = False
        for r in range(b * row.LANES, (b + 1) * row.LANES):
            some = some or bond[r] >= 0
            if bond[r] < 0:
                block[row.place_of(r) + row.ALIVE] = 0.0
                # To the next one, so that it has a length, also where that stands due east on a plane.
                second[r] = row.end_of(r % width + 1)
                block[row.place_of(r) + row.METRES_COS] = 1.0
        if some:
            used[count] = b
            count += 1
    return count


@kernel
def _fill_slots(rows, ends):
    """List the rows that end in each element, in order of row; unused slots name the block of zeros."""
    slot, met, bond = rows.slot, rows.met, rows.bond
    met[:] = 0
    slot[:, :] = rows.block.size - row.BLOCK
    for r in range(bond.size):
        if bond[r] >= 0:
            j = ends[bond[r]]
            slot[j, met[j]] = row.place_of(r)
            met[j] += 1


@stage
def load_rows(
    rows: BondRows, elements: Elements, bonds: Bonds, sizes: Sizes, earlier: Ints, p: KernelParameters
) -> int:
    """Copy the unbroken bonds into the rows and find the rows of each element."""
    _lay_out(rows, bonds)
    count = _list_blocks(rows)
    _fill_slots(rows, bonds.second)
    block, first, second, sx, sy = rows.block, bonds.first, bonds.second, bonds.shear_x, bonds.shear_y
    for r in range(rows.bond.size):
        b = rows.bond[r]
        if b >= 0:
            at, i, j = row.place_of(r), first[b], second[b]
            _copy_bond(block, at, b, bonds, p)
            _fill_constants(block, at, i, j, b, elements, bonds.rest_length, sizes, earlier, p)
            _fill_place(block, at, i, j, sx[b], sy[b], elements, p)
    return count


@kernel
def crosses(x: Floats, period: float) -> bool:
    """Whether bonds may lie across the seam of a periodic domain: elements stand on both sides of it, or far apart."""
    least, largest = math.inf, -math.inf
    for at in x:
        least, largest = min(least, at), max(largest, at)
    return period > 0.0 and largest - least > 0.25 * period
