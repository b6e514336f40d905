"""Friction of a keel that slides and spins at once: Coulomb's law in each patch of the area on which it stands.

Forces here are parts of the largest friction, lengths parts of the radius of gyration of the area, torques of their product.
A slip n, with its spin, meets the friction and dissipation

    P(n) = sum w_i B_i^T B_i n / |B_i n|,    D(n) = n P(n)

of the patches i, with their weights w_i and B_i n the slip of each. P is the surface of what can be held. A force f beyond it
gives way by the slip s n to its nearest point (the springs of the patches are as stiff against spin as against slip):

    f = s n + P(n),    s = max f n - D(n)

over the unit vectors n. Nothing slips where no n gives s > 0.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.physics.elementary import cos_array, sin_array
from riftberg.physics.geometry import solve
from riftberg.state import Floats

AROUND: Final = 8
"""Patches in each of three rings: bergs that slide and spin go within 1 to 5 % as on many small patches."""

SPREAD: Final = 0.05
"""Radius of a patch: it resists its own spin, which rounds the surface where a patch is the pole of the motion."""

SURELY_HELD: Final = 0.8
"""Torque that any area holds: its mean radius is no less than 0.866 of that of gyration, as of a line."""

MOST_TURNS: Final = 60
"""Of Newton's method for the direction of the slip; some five are usual."""


def _disc() -> Floats:
    """Patches of a disc with unit variances: place and weight; their mean of r^-1, r and r^2 is that of the disc."""
    # Gauss and Legendre's points by hand, and sines of our own: those of NumPy hang on the processor in their last digits.
    root, weight = np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)]), np.array([5.0, 8.0, 5.0]) / 9.0
    r = np.repeat(0.5 * (root + 1.0), AROUND)
    angle = 2.0 * math.pi * (np.arange(r.size) % AROUND + 0.5 * (np.arange(r.size) // AROUND % 2)) / AROUND
    east, north = 2.0 * r * cos_array(angle), 2.0 * r * sin_array(angle)
    return np.column_stack([east, north, np.repeat(weight, AROUND) * r / AROUND])


DISC: Final = _disc()


@kernel
def lay_patches(xx: float, xy: float, yy: float, c: float, s: float) -> Floats:
    """Return the patches (place, weight) of an ellipse with the variances of an area, turned by an angle.

    ``c``, ``s``: cosine and sine of the angle.
    """
    # The root of the matrix of variances stretches the disc to the ellipse.
    gyration = math.sqrt(xx + yy)
    area = math.sqrt(max(xx * yy - xy * xy, 0.0))
    scale = 1.0 / (gyration * math.sqrt(xx + yy + 2.0 * area))
    patches = np.empty_like(DISC)
    for i in range(len(DISC)):
        x = scale * ((xx + area) * DISC[i, 0] + xy * DISC[i, 1])
        y = scale * (xy * DISC[i, 0] + (yy + area) * DISC[i, 1])
        patches[i, 0], patches[i, 1], patches[i, 2] = c * x - s * y, s * x + c * y, DISC[i, 2]
    return patches


@borrower
def find_friction(patches: Floats, slip: Floats, friction: Floats, curvature: Floats) -> float:
    """Find the friction against a slip (east, north, spin) and minus its derivative; returns the dissipation."""
    total = 0.0
    friction[:], curvature[:, :] = 0.0, 0.0
    for i in range(len(patches)):
        x, y, weight = patches[i, 0], patches[i, 1], patches[i, 2]
        u, v, w = slip[0] - y * slip[2], slip[1] + x * slip[2], SPREAD * slip[2]
        size = math.sqrt(u * u + v * v + w * w)
        total += weight * size
        u, v, w = u / size, v / size, w / size
        turn, stiffness = x * v - y * u + SPREAD * w, weight / size
        friction[0] += weight * u
        friction[1] += weight * v
        friction[2] += weight * turn
        curvature[0, 0] += stiffness * (1.0 - u * u)
        curvature[0, 1] -= stiffness * u * v
        curvature[0, 2] -= stiffness * (y + u * turn)
        curvature[1, 1] += stiffness * (1.0 - v * v)
        curvature[1, 2] += stiffness * (x - v * turn)
        curvature[2, 2] += stiffness * (x * x + y * y + SPREAD * SPREAD - turn * turn)
    for i in range(3):
        for j in range(i):
            curvature[i, j] = curvature[j, i]
    return total


@kernel
def give_way(patches: Floats, force: Floats, friction: Floats, tangent: Floats) -> bool:
    """Find what is left of a force on the patches, and its derivative by the force; returns whether they slip."""
    tangent[:, :] = 0.0
    for k in range(3):
        friction[k], tangent[k, k] = force[k], 1.0
    if math.hypot(force[0], force[1]) + abs(force[2]) / SURELY_HELD <= 1.0:
        return False
    n, trial, turn, unit = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    surface, curvature, matrix = np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    size = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    for k in range(3):
        n[k] = force[k] / size
    slip = size - find_friction(patches, n, surface, curvature)
    for _ in range(MOST_TURNS):
        for i in range(3):
            turn[i] = force[i] - surface[i] - slip * n[i]
            for j in range(3):
                matrix[i, j] = curvature[i, j] + n[i] * n[j] + (max(slip, 1e-9) if i == j else 0.0)
        turn[0], turn[1], turn[2] = solve(matrix, turn)
        if math.sqrt(turn[0] ** 2 + turn[1] ** 2 + turn[2] ** 2) < 1e-13:
            break
        share, previous_slip = 1.0, slip
        while True:
            for k in range(3):
                trial[k] = n[k] + share * turn[k]
            size = math.sqrt(trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2)
            for k in range(3):
                trial[k] /= size
            slip = force[0] * trial[0] + force[1] * trial[1] + force[2] * trial[2]
            slip -= find_friction(patches, trial, surface, curvature)
            if slip >= previous_slip - 1e-14 or share < 1e-6:
                break
            share *= 0.5
        n[:] = trial
    if slip <= 0.0:
        return False
    for i in range(3):
        friction[i] = force[i] - slip * n[i]
        for j in range(3):
            matrix[i, j] = curvature[i, j] + n[i] * n[j] + (slip if i == j else 0.0)
    for j in range(3):
        unit[:] = 0.0
        unit[j] = 1.0
        turn[0], turn[1], turn[2] = solve(matrix, unit)
        for i in range(3):
            tangent[i, j] -= slip * turn[i] + n[i] * n[j] / (1.0 + slip)
    return True
