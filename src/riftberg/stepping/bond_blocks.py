"""How the rows of the bonds stand in memory in the sub-steps.

A row is one unbroken bond. `LANES` rows make a block, in which each quantity of all its rows stands side by side; the
blocks follow each other in one array. So quantity ``NX`` of the row in lane ``k`` of the block that begins at ``at`` is
``block[at + NX + k]``, and that of row ``r`` is ``block[place_of(r) + NX]``.

Why: what one loop over a block leaves for the next is still in the first-level cache, and all distances in memory are known
when it is compiled. With an array for each quantity, code that proves that none of forty overlaps took more room than the
law itself.
"""

from __future__ import annotations

from typing import Final

from riftberg.kernels import kernel

LANES: Final = 32
"""Rows of a block."""

QUANTITIES: Final = 47
"""Quantities of a row."""

BLOCK: Final = LANES * QUANTITIES
"""Numbers in a block."""

# Gathered from both ends: differences and means of what they show, spins, difference of angles.
DX, DY, Y_MEAN, DU, DV, U_MEAN, V_MEAN, SPIN1, SPIN2, ANGLE = (LANES * n for n in range(10))
# Constants of the law; ALIVE is 1, or 0 for a bond that has broken in this long step.
ALIVE, REST, RADIUS1, RADIUS2, LEVER1, LEVER2, RADIUS_SMALL, RADIUS_GAP = (LANES * n for n in range(10, 18))
THICKNESS_SMALL, THICKNESS_GAP, DAMPING, CONVERGENCE, STRENGTH = (LANES * n for n in range(18, 23))
# What the stress may reach, which damage lowers.
NORMAL_LIMIT, SHEAR_LIMIT, DAMAGE = (LANES * n for n in range(23, 26))
# Geometry of the moment: the bond in metres, its direction, half its overlap, width, thickness, length, sine of the angle.
RX, RY, NX, NY, HALF, WIDTH, THICKNESS, LENGTH, SINE = (LANES * n for n in range(26, 35))
# Shear displacement (m), turn of one end against the other, damping force, and what the law gives.
SX, SY, RELATIVE_ROTATION, DAMP_X, DAMP_Y = (LANES * n for n in range(35, 40))
FX, FY, TORQUE1, TORQUE2, NORMAL_STRESS, SHEAR_STRESS, PEAK_STRESS = (LANES * n for n in range(40, 47))


@kernel
def place_of(row: int) -> int:
    """Where the quantities of a row begin: ``block[place_of(row) + NX]`` is its ``NX``."""
    return (row // LANES) * BLOCK + row % LANES


@kernel
def blocks_of(count: int) -> int:
    """Blocks that ``count`` rows take."""
    return (count + LANES - 1) // LANES
