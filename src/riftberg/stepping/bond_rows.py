"""Bonds laid out for the sub-steps: contiguous rows of unbroken bonds, and the rows that meet in each element.

Measured on one core, gathering both ends of each bond into contiguous rows, applying the law to whole rows and then
summing over the incident bonds of each element is several times faster than one loop over bonds that does all at once:
the law becomes vector instructions, and the sum has a fixed order per element, so results do not depend on threads.
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
from riftberg.stepping.sizes import Sizes
from riftberg.stepping.wear import limits_left

Indices = NDArray[np.uint32]
"""Unsigned, because numba then leaves out the test for negative (wrap-around) indices."""


class BondRows(NamedTuple):
    """Unbroken bonds in contiguous rows; one spare row at the end always holds zeros.

    ``sx``, ``sy`` hold the shear displacement (m); ``fx``, ``fy`` the force on the first element (N); ``torque`` the
    torques (N m) on the first ends and, behind the spare row, on the second ends. ``torque1`` and ``torque2`` are views
    of the two halves: with one array LLVM could not prove that the halves are apart, and would not vectorise. The other
    rows are geometry and constants of the law. ``slot[k, e]`` is the row of the k-th bond of element e, ``sign`` +1 if
    e is its first end, -1 if its second, 0 for the spare row; ``torque_slot`` the matching place in ``torque``.
    """

    bond: Ints
    first: Indices
    second: Indices
    alive: Floats
    rest: Floats
    radius1: Floats
    radius2: Floats
    lever1: Floats
    lever2: Floats
    radius_small: Floats
    radius_gap: Floats
    thickness_small: Floats
    thickness_gap: Floats
    damping: Floats
    normal_limit: Floats
    shear_limit: Floats
    strength: Floats
    damage: Floats
    dx: Floats
    dy: Floats
    y_mean: Floats
    du: Floats
    dv: Floats
    u_mean: Floats
    v_mean: Floats
    convergence: Floats
    spin1: Floats
    spin2: Floats
    angle: Floats
    nx: Floats
    ny: Floats
    sx: Floats
    sy: Floats
    fx: Floats
    fy: Floats
    torque: Floats
    torque1: Floats
    torque2: Floats
    normal_stress: Floats
    shear_stress: Floats
    peak_stress: Floats
    length: Floats
    relative_rotation: Floats
    slot: Indices
    sign: Floats
    torque_slot: Indices


def allocate_rows(bonds: Bonds, element_count: int) -> BondRows:
    """Allocate rows for all bonds of the state; `load_rows` fills them."""
    size = len(bonds.first) + 1
    degree = np.bincount(np.concatenate([bonds.first, bonds.second]), minlength=element_count)
    slots = max(int(degree.max()) if len(bonds.first) else 1, 1)
    floats = iter(np.zeros((len(BondRows._fields), size)))
    values: dict[str, NDArray[np.generic]] = {}
    for name in BondRows._fields:
        if name == "bond":
            values[name] = np.zeros(size, np.int64)
        elif name in ("first", "second"):
            values[name] = np.zeros(size, np.uint32)
        elif name in ("slot", "torque_slot"):
            values[name] = np.zeros((slots, element_count), np.uint32)
        elif name == "sign":
            values[name] = np.zeros((slots, element_count))
        elif name == "torque":
            values[name] = np.zeros(2 * size)
        else:
            # Separate allocations keep rows from sharing cache lines.
            values[name] = next(floats).copy()
    values["torque1"], values["torque2"] = values["torque"][:size], values["torque"][size:]
    return BondRows(**values)  # type: ignore[arg-type]


@kernel
def _thickness_rule(r1, r2, t1, t2, first_is_earlier, quirk):
    """Thickness (m) from which the section starts, and the difference that is added to it (equations 5.4; quirk Q11)."""
    # Without a smaller radius the reference starts from the element processed second.
    second_is_small = r2 < r1 or (r1 == r2 and first_is_earlier)
    small, other = (t2, t1) if second_is_small else (t1, t2)
    return small, (abs(t1 - t2) if quirk else other - small)


@kernel
def _fill_constants(rows, count, elements, rest_length, sizes, earlier, p):
    """Constants of the law for the rows in use (equations 5.4; quirks Q10, Q11)."""
    first, second, radius, mass, thickness = (
        rows.first, rows.second, sizes.bond_radius, sizes.bond_mass, elements.body.thickness,
    )  # fmt: skip
    latitude, convergence = elements.shown.lat_pair, rows.convergence
    curved = p.latlon and not p.flat_relative_velocity
    rest, radius1, radius2, lever1, lever2 = rows.rest, rows.radius1, rows.radius2, rows.lever1, rows.lever2
    radius_small, radius_gap, damping = rows.radius_small, rows.radius_gap, rows.damping
    thickness_small, thickness_gap = rows.thickness_small, rows.thickness_gap
    for r in range(count):
        i, j = first[r], second[r]
        convergence[r] = meridian_convergence(0.5 * (latitude[i] + latitude[j]), p.earth_radius) if curved else 0.0
        r1, r2 = radius[i], radius[j]
        rest[r] = r1 + r2
        if not p.rest_length_from_sizes and not math.isnan(rest_length[rows.bond[r]]):
            # A bond keeps the shape with which it formed: sides that melt since do not strain or narrow it.
            rest[r] = rest_length[rows.bond[r]]
            formed = rest[r] / (r1 + r2)
            r1, r2 = r1 * formed, r2 * formed
        first_is_earlier = earlier[i] <= earlier[j]
        radius1[r], radius2[r] = r1, r2
        radius_small[r], radius_gap[r] = min(r1, r2), abs(r1 - r2)
        thickness_small[r], thickness_gap[r] = _thickness_rule(
            r1, r2, thickness[i], thickness[j], first_is_earlier, p.bond_thickness_of_second
        )
        shared = r1 if first_is_earlier else r2
        lever1[r], lever2[r] = (shared, shared) if p.shared_shear_lever else (r1, r2)
        damping[r] = damping_constant(p.youngs_modulus, p.poisson, p.bond_damping, mass[i], mass[j])


@kernel
def _copy_unbroken(rows, bonds, p):
    """Copy the unbroken bonds into the rows; returns their number.

    Arrays are taken out of the named tuples first, because numba counts references at each access in a loop.
    """
    status, first, second, strength, damage = bonds.status, bonds.first, bonds.second, bonds.strength, bonds.damage
    shear_x, shear_y, turned = bonds.shear_x, bonds.shear_y, bonds.relative_rotation
    row_bond, row_first, row_second, alive = rows.bond, rows.first, rows.second, rows.alive
    sx, sy, row_turned, normal, shear = rows.sx, rows.sy, rows.relative_rotation, rows.normal_limit, rows.shear_limit
    row_strength, row_damage = rows.strength, rows.damage
    stress, peak = bonds.normal_stress, rows.peak_stress
    count = 0
    for b in range(first.size):
        if status[b] != 0:
            continue
        row_bond[count], row_first[count], row_second[count], alive[count] = b, first[b], second[b], 1.0
        sx[count], sy[count], row_turned[count] = shear_x[b], shear_y[b], turned[b]
        row_strength[count], row_damage[count], peak[count] = strength[b], damage[b], stress[b]
        normal[count], shear[count] = limits_left(p.normal_strength, p.shear_strength, strength[b], damage[b])
        count += 1
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
    _fill_constants(rows, count, elements, bonds.rest_length, sizes, earlier, p)
    rows.fx[count] = rows.fy[count] = 0.0
    _fill_slots(rows, count)
    return count


@kernel
def _fill_slots(rows, count):
    """List the rows that meet in each element, in order of row; unused slots name the spare row."""
    slot, sign, torque_slot, first, second = rows.slot, rows.sign, rows.torque_slot, rows.first, rows.second
    size = rows.alive.size
    used = np.zeros(slot.shape[1], np.int64)
    slot[:, :] = count
    torque_slot[:, :] = count
    sign[:, :] = 0.0
    rows.torque[count] = 0.0
    for r in range(count):
        i, j = first[r], second[r]
        slot[used[i], i], sign[used[i], i], torque_slot[used[i], i] = r, 1.0, r
        slot[used[j], j], sign[used[j], j], torque_slot[used[j], j] = r, -1.0, size + r
        used[i] += 1
        used[j] += 1


@stage
def store_rows(rows: BondRows, count: int, bonds: Bonds) -> None:
    """Copy displacements, stresses, lengths and damage from the rows back to the state."""
    bond, status = rows.bond, bonds.status
    sx, sy, normal, shear, peak = rows.sx, rows.sy, rows.normal_stress, rows.shear_stress, rows.peak_stress
    length, turned, damage = rows.length, rows.relative_rotation, rows.damage
    to_sx, to_sy, to_normal, to_shear = bonds.shear_x, bonds.shear_y, bonds.normal_stress, bonds.shear_stress
    to_peak, to_length, to_turned, to_damage = (
        bonds.peak_stress, bonds.bond_length, bonds.relative_rotation, bonds.damage,
    )  # fmt: skip
    for r in range(count):
        b = bond[r]
        if status[b] != 0:
            continue  # broken in this long step: the state keeps what held when it broke
        to_sx[b], to_sy[b], to_normal[b], to_shear[b] = sx[r], sy[r], normal[r], shear[r]
        to_peak[b], to_length[b], to_turned[b], to_damage[b] = peak[r], length[r], turned[r], damage[r]
