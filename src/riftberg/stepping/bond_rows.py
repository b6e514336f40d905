"""Bonds laid out for the sub-steps: unbroken bonds in rows, and the rows that meet in each element.

Gathering both ends of each bond into rows, applying the law to whole rows and then summing over the bonds of each element is
several times faster than one loop over bonds that does all at once. The law becomes vector instructions, and the sum has a
fixed order per element, so results do not depend on threads. `riftberg.stepping.bond_blocks` tells how rows stand in memory.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.kernels import kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import damping_constant
from riftberg.physics.geometry import meridian_convergence
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping import bond_blocks as row
from riftberg.stepping.sizes import Sizes
from riftberg.stepping.wear import limits_left

Indices = NDArray[np.uint32]
"""Unsigned, because numba then leaves out the test for negative (wrap-around) indices."""


class BondRows(NamedTuple):
    """Unbroken bonds in rows.

    Attributes
    ----------
    bond : array of int
        Number of the bond of each row.
    first, second : array of int
        Elements at its ends.
    block : array of float
        All quantities of all rows. ``FX``, ``FY`` hold the force (N) on the first end, ``TORQUE1`` and ``TORQUE2`` the
        torques (N m) on both ends. Rows that fill up the last block repeat the first bond and are not alive. One block
        more holds zeros.
    slot : array of int, shape (elements, slots)
        Where the k-th bond of each element begins in ``block``; in the block of zeros where it has fewer bonds.
    torque_slot : array of int, shape (elements, slots)
        Where its torque stands.
    sign : array of float, shape (elements, slots)
        +1 if the element is the first end of the bond, -1 if its second, 0 where there is none.
    used : array of int
        Room for the number of slots in use, of each element.
    """

    bond: Ints
    first: Indices
    second: Indices
    block: Floats
    slot: Indices
    torque_slot: Indices
    sign: Floats
    used: Ints


def allocate_rows(bonds: Bonds, element_count: int) -> BondRows:
    """Allocate rows for all bonds of the state; `load_rows` fills them."""
    blocks = -(-len(bonds.first) // row.LANES)
    size = blocks * row.LANES
    degree = np.bincount(np.concatenate([bonds.first, bonds.second]), minlength=element_count)
    shape = (element_count, max(int(degree.max()) if len(bonds.first) else 1, 1))
    return BondRows(
        bond=np.zeros(size, np.int64),
        first=np.zeros(size, np.uint32),
        second=np.zeros(size, np.uint32),
        block=np.zeros((blocks + 1) * row.BLOCK),
        slot=np.zeros(shape, np.uint32),
        torque_slot=np.zeros(shape, np.uint32),
        sign=np.zeros(shape),
        used=np.zeros(element_count, np.int64),
    )


@kernel
def _thickness_rule(r1, r2, t1, t2, first_is_earlier, quirk):
    """Thickness (m) from which the section starts, and the difference that is added to it (equations 5.4; quirk Q11)."""
    # Without a smaller radius the reference starts from the element processed second.
    second_is_small = r2 < r1 or (r1 == r2 and first_is_earlier)
    small, other = (t2, t1) if second_is_small else (t1, t2)
    return small, (abs(t1 - t2) if quirk else other - small)


@kernel
def _fill_constants(rows, size, elements, rest_length, sizes, earlier, p):
    """Constants of the law for the rows in use (equations 5.4; quirks Q10, Q11)."""
    first, second, radius, mass, thickness = (
        rows.first, rows.second, sizes.bond_radius, sizes.bond_mass, elements.body.thickness,
    )  # fmt: skip
    latitude, block, bond = elements.shown.lat_pair, rows.block, rows.bond
    curved = p.latlon and not p.flat_relative_velocity
    for r in range(size):
        i, j, at = first[r], second[r], row.place_of(r)
        block[at + row.CONVERGENCE] = (
            meridian_convergence(0.5 * (latitude[i] + latitude[j]), p.earth_radius) if curved else 0.0
        )
        r1, r2 = radius[i], radius[j]
        rest = r1 + r2
        if not p.rest_length_from_sizes and not math.isnan(rest_length[bond[r]]):
            # A bond keeps the shape with which it formed: sides that melt since do not strain or narrow it.
            rest = rest_length[bond[r]]
            formed = rest / (r1 + r2)
            r1, r2 = r1 * formed, r2 * formed
        first_is_earlier = earlier[i] <= earlier[j]
        block[at + row.REST], block[at + row.RADIUS1], block[at + row.RADIUS2] = rest, r1, r2
        block[at + row.RADIUS_SMALL], block[at + row.RADIUS_GAP] = min(r1, r2), abs(r1 - r2)
        block[at + row.THICKNESS_SMALL], block[at + row.THICKNESS_GAP] = _thickness_rule(
            r1, r2, thickness[i], thickness[j], first_is_earlier, p.bond_thickness_of_second
        )
        shared = r1 if first_is_earlier else r2
        block[at + row.LEVER1], block[at + row.LEVER2] = (shared, shared) if p.shared_shear_lever else (r1, r2)
        block[at + row.DAMPING] = damping_constant(p.youngs_modulus, p.poisson, p.bond_damping, mass[i], mass[j])


@kernel
def _copy_bond(rows, r, b, alive, bonds, p):
    """Copy bond ``b`` into row ``r``."""
    block, at = rows.block, row.place_of(r)
    strength, damage = bonds.strength[b], bonds.damage[b]
    rows.bond[r], rows.first[r], rows.second[r] = b, bonds.first[b], bonds.second[b]
    block[at + row.ALIVE] = alive
    block[at + row.SX], block[at + row.SY] = bonds.shear_x[b], bonds.shear_y[b]
    block[at + row.RELATIVE_ROTATION], block[at + row.PEAK_STRESS] = bonds.relative_rotation[b], bonds.normal_stress[b]
    block[at + row.STRENGTH], block[at + row.DAMAGE] = strength, damage
    block[at + row.NORMAL_LIMIT], block[at + row.SHEAR_LIMIT] = limits_left(
        p.normal_strength, p.shear_strength, strength, damage
    )


@kernel
def _copy_unbroken(rows, bonds, p):
    """Copy the unbroken bonds into the rows, and fill up the last block; returns their number."""
    status = bonds.status
    count = 0
    for b in range(status.size):
        if status[b] == 0:
            _copy_bond(rows, count, b, 1.0, bonds, p)
            count += 1
    for r in range(count, row.blocks_of(count) * row.LANES):
        _copy_bond(rows, r, rows.bond[0], 0.0, bonds, p)
    return count


@stage
def load_rows(
    rows: BondRows, elements: Elements, bonds: Bonds, sizes: Sizes, earlier: Ints, p: KernelParameters
) -> int:
    """Copy the unbroken bonds into the rows and find the rows of each element.

    Parameters
    ----------
    rows : BondRows
    elements, bonds
        The state.
    sizes : Sizes
    earlier : array of int
        Rank of each element in the order of processing, which decides which end counts as first in Q10 and Q11.
    p : KernelParameters

    Returns
    -------
    int
        Number of rows in use.
    """
    count = _copy_unbroken(rows, bonds, p)
    _fill_constants(rows, row.blocks_of(count) * row.LANES, elements, bonds.rest_length, sizes, earlier, p)
    _fill_slots(rows, count)
    return count


@kernel
def _fill_slots(rows, count):
    """List the rows that meet in each element, in order of row; unused slots name the block of zeros."""
    slot, sign, torque_slot, first, second = rows.slot, rows.sign, rows.torque_slot, rows.first, rows.second
    used, zeros = rows.used, rows.block.size - row.BLOCK
    used[:] = 0
    slot[:, :] = zeros
    torque_slot[:, :] = zeros
    sign[:, :] = 0.0
    for r in range(count):
        i, j, at = first[r], second[r], row.place_of(r)
        slot[i, used[i]], sign[i, used[i]], torque_slot[i, used[i]] = at, 1.0, at + row.TORQUE1
        slot[j, used[j]], sign[j, used[j]], torque_slot[j, used[j]] = at, -1.0, at + row.TORQUE2
        used[i] += 1
        used[j] += 1


@stage
def store_rows(rows: BondRows, count: int, bonds: Bonds) -> None:
    """Copy displacements, stresses, lengths and damage from the rows back to the state."""
    bond, status, block = rows.bond, bonds.status, rows.block
    to_sx, to_sy, to_normal, to_shear = bonds.shear_x, bonds.shear_y, bonds.normal_stress, bonds.shear_stress
    to_peak, to_length, to_turned, to_damage = (
        bonds.peak_stress, bonds.bond_length, bonds.relative_rotation, bonds.damage,
    )  # fmt: skip
    for r in range(count):
        b, at = bond[r], row.place_of(r)
        if status[b] != 0:
            continue  # broken in this long step: the state keeps what held when it broke
        to_sx[b], to_sy[b] = block[at + row.SX], block[at + row.SY]
        to_normal[b], to_shear[b] = block[at + row.NORMAL_STRESS], block[at + row.SHEAR_STRESS]
        to_peak[b], to_length[b] = block[at + row.PEAK_STRESS], block[at + row.LENGTH]
        to_turned[b], to_damage[b] = block[at + row.RELATIVE_ROTATION], block[at + row.DAMAGE]
