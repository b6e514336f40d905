"""How bonds and elements stand in memory in the sub-steps.

A row is one unbroken bond. `LANES` rows make a block, in which each quantity of all its rows stands side by side; the
blocks follow each other in one array. So quantity ``REST`` of the row in lane ``k`` of the block that begins at ``at`` is
``block[at + REST + k]``, and that of row ``r`` is ``block[place_of(r) + REST]``. What is needed within a sub-step alone stands
in a sheet for one block, which all blocks use one after the other. Elements stand in blocks too: what bonds see of them in one,
what they have for themselves in another.

Rows stand in layers: the first layer holds the bonds from each element to the next one, in order of the elements, the others
one more bond each that begins there. So the first ends of a block of rows are one block of elements, whose numbers stand
side by side too. Where an element has no such bond its row is not alive; a block without a bond is left out.

Why: numbers have to come from the second-level cache, or from memory, in each sub-step, and that takes longer than the law
itself; so a row holds as little as it can, and all that happens to a block happens while it is at hand. All distances in memory
are known when the loops are compiled: with an array for each quantity, code that proves that none of forty overlaps took
more room than the law. What belongs to the first ends is read, and summed, by vector instructions, that of the second ends
one by one.
"""

from __future__ import annotations

from typing import Final

from riftberg.compiled.kernels import kernel

LANES: Final = 32
"""Rows of a block."""

# What bonds see of an element: place (units of the grid), velocity (m s-1), spin (s-1), angle (rad). In a block of elements
# and, for the second ends of a block of rows, in the sheet.
X, Y, U, V, SPIN, ANGLE = (LANES * n for n in range(6))

END_TILE: Final = LANES * 6
"""Numbers in a block of elements."""

# What elements have for themselves. Velocity (m s-1), fast accelerations before this sub-step, explicit and implicit, and that by
# contact (m s-2).
VELOCITY_X, VELOCITY_Y, AX, AY, BX, BY, CONTACT_X, CONTACT_Y = (LANES * n for n in range(8))
# 1 where it moves; 1 over its mass (kg-1) and its inertia (kg-1 m-2); steady loads (N), 0 where a roller takes what is northward.
ACTIVE, PER_MASS, PER_INERTIA, LOAD_X, LOAD_Y, FREE_Y, SPIN_RATE = (LANES * n for n in range(8, 15))
# The sea floor: rate at the velocity now (s-1), its linear and its quadratic part (m-1), what an implicit sub-step leaves of
# velocity and of spin (0 to 1), and the sum of its decelerations (m s-2).
FLOOR_RATE, FLOOR_LINEAR, FLOOR_QUADRATIC, DECAY, SPIN_DECAY, FLOOR_IMPULSE_X, FLOOR_IMPULSE_Y = (
    LANES * n for n in range(15, 22)
)

ELEMENT_TILE: Final = LANES * 22
"""Numbers in a block of what elements have for themselves."""

# In a row, constants of the law; ALIVE is 1, or 0 where no bond is or it has broken in this long step. MODULUS is E over the
# length at rest; DAMPING in kg s-1.
INTACT, REST, RADIUS1, RADIUS2, LEVER1, LEVER2, THICKNESS_SMALL, THICKNESS_GAP, DAMPING, MODULUS = (
    LANES * n for n in range(10)
)
# Mean latitude of the ends when the rows were loaded, and its cosine and sine, times metres in a degree.
Y_REFERENCE, METRES_COS, METRES_SIN = (LANES * n for n in range(10, 13))
# What the stress may reach, and its largest in this long step, Pa; shear displacement along the tangent, m.
NORMAL_LIMIT, SHEAR_LIMIT, PEAK_STRESS, SLIP = (LANES * n for n in range(13, 17))
# Force on the first end, N, and torque on the second, N m.
FX, FY, TORQUE2 = (LANES * n for n in range(17, 20))
# What only damage asks for.
STRENGTH, DAMAGE = (LANES * n for n in range(20, 22))

BOND_TILE: Final = LANES * 22
"""Numbers in a block of rows."""

# In the sheet, after the second ends: direction of the bond, half its overlap, length, width, thickness, turn of the local
# axes from one end to the other (rad), sine of the angle.
NX, NY, HALF, LENGTH, WIDTH, THICKNESS, TURN, SINE = (LANES * n for n in range(6, 14))
# Torque on the first end, N m, and stresses, Pa.
TORQUE1, NORMAL_STRESS, SHEAR_STRESS = (LANES * n for n in range(14, 17))

SCRATCH_TILE: Final = LANES * 17
"""Numbers in the sheet."""

# In the sums of a block of elements: forces (N) and torques (N m) of the bonds that begin there.
SUM_X, SUM_Y, SUM_TORQUE = (LANES * n for n in range(3))

SUM_TILE: Final = LANES * 3
"""Numbers in the sums of a block of elements."""


@kernel
def bond_offset(tile: int) -> int:
    """Where the quantities of a row begin: ``block[place_of(row) + REST]`` is its ``REST``."""
    return (tile // LANES) * BOND_TILE + tile % LANES


@kernel
def end_offset(element: int) -> int:
    """Where what bonds see of an element begins."""
    return (element // LANES) * END_TILE + element % LANES


@kernel
def tile_count(count: int) -> int:
    """Blocks that ``count`` elements take."""
    return (count + LANES - 1) // LANES
