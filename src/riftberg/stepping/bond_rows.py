"""Bonds laid out for the sub-steps: contiguous rows of unbroken bonds, and the rows that meet in each element.

Measured on one core, gathering both ends of each bond into contiguous rows, applying the law to whole rows and then
summing over the incident bonds of each element is several times faster than one loop over bonds that does all at once:
the law becomes vector instructions, and the sum has a fixed order per element, so results do not depend on threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import damping_constant
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.sizes import Sizes

Indices = NDArray[np.uint32]
"""Unsigned, because numba then leaves out the test for negative (wrap-around) indices."""


class BondRows(NamedTuple):
    """Unbroken bonds in contiguous rows; one spare row at the end always holds zeros.

    ``sx``, ``sy`` hold the shear displacement (m); ``fx``, ``fy`` the force on the first element (N); ``torque`` the
    torques (N m) on the first ends and, behind the spare row, on the second ends (``torque1`` and ``torque2`` are views
    of the two halves: with one array LLVM could not prove that the halves are apart, and would not vectorise); the other rows are geometry and
    constants of the law. ``slot[k, e]`` is the row of the k-th bond of element e, ``sign`` +1 if e is its first end,
    -1 if its second, 0 for the spare row; ``torque_slot`` the matching place in ``torque``.
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
    dx: Floats
    dy: Floats
    y_mean: Floats
    du: Floats
    dv: Floats
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
def _bond_constants(rows, r, i, j, elements, sizes, earlier, p):
    """Constants of the law for row ``r`` between elements i and j (spec 5.4; quirks Q10, Q11)."""
    r1, r2 = sizes.bond_radius[i], sizes.bond_radius[j]
    t1, t2 = elements.thickness[i], elements.thickness[j]
    rows.rest[r] = r1 + r2
    rows.radius1[r], rows.radius2[r] = r1, r2
    rows.radius_small[r] = min(r1, r2)
    rows.radius_gap[r] = abs(r1 - r2)
    # Without a smaller radius the reference starts from the element processed second.
    second_is_small = r2 < r1 or (r1 == r2 and earlier[i] <= earlier[j])
    small, other = (t2, t1) if second_is_small else (t1, t2)
    rows.thickness_small[r] = small
    rows.thickness_gap[r] = abs(t1 - t2) if p.bond_thickness_of_second else other - small
    rows.lever1[r], rows.lever2[r] = r1, r2
    if p.shared_shear_lever:
        rows.lever1[r] = rows.lever2[r] = r1 if earlier[i] <= earlier[j] else r2
    rows.damping[r] = damping_constant(
        p.youngs_modulus, p.poisson, p.bond_damping, sizes.bond_mass[i], sizes.bond_mass[j]
    )


@kernel
def load_rows(rows: BondRows, elements: Elements, bonds: Bonds, sizes: Sizes, earlier: Ints, p: KernelParameters) -> int:
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
    count = 0
    for b in range(bonds.first.size):
        if bonds.status[b] != 0:
            continue
        i, j = bonds.first[b], bonds.second[b]
        rows.bond[count] = b
        rows.first[count], rows.second[count] = i, j
        rows.alive[count] = 1.0
        rows.sx[count], rows.sy[count] = bonds.shear_x[b], bonds.shear_y[b]
        rows.relative_rotation[count] = bonds.relative_rotation[b]
        rows.normal_limit[count] = p.normal_strength * bonds.strength[b]
        rows.shear_limit[count] = p.shear_strength * bonds.strength[b]
        _bond_constants(rows, count, i, j, elements, sizes, earlier, p)
        count += 1
    rows.fx[count] = rows.fy[count] = 0.0
    _fill_slots(rows, count)
    return count


@kernel
def _fill_slots(rows, count):
    """List the rows that meet in each element, in order of row; unused slots name the spare row."""
    size = rows.alive.size
    slots, elements = rows.slot.shape
    used = np.zeros(elements, np.int64)
    rows.slot[:, :] = count
    rows.torque_slot[:, :] = count
    rows.sign[:, :] = 0.0
    rows.torque[count] = 0.0
    for r in range(count):
        i, j = rows.first[r], rows.second[r]
        rows.slot[used[i], i], rows.sign[used[i], i], rows.torque_slot[used[i], i] = r, 1.0, r
        rows.slot[used[j], j], rows.sign[used[j], j], rows.torque_slot[used[j], j] = r, -1.0, size + r
        used[i] += 1
        used[j] += 1


@kernel
def store_rows(rows: BondRows, count: int, bonds: Bonds) -> None:
    """Copy displacements, stresses and lengths from the rows back to the state."""
    for r in range(count):
        b = rows.bond[r]
        if bonds.status[b] != 0:
            continue  # broken in this long step: the state keeps what held when it broke
        bonds.shear_x[b], bonds.shear_y[b] = rows.sx[r], rows.sy[r]
        bonds.normal_stress[b], bonds.shear_stress[b] = rows.normal_stress[r], rows.shear_stress[r]
        bonds.bond_length[b] = rows.length[r]
        bonds.relative_rotation[b] = rows.relative_rotation[r]
