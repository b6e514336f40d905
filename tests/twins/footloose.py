"""Twin of the footloose mechanism of files 2."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

G, RHO_W = 9.8, 1025.0


def lengths(thickness, youngs, strength, rho):
    """Buoyancy length, width of a piece, foot at which it breaks off (m)."""
    bending = youngs * thickness**3 / (12.0 * (1.0 - 0.3**2))
    buoyancy = (bending / (G * RHO_W)) ** 0.25
    foot = np.exp(np.pi / 4) * RHO_W * strength / (6.0 * rho * G * (RHO_W - rho)) * thickness / buoyancy
    return buoyancy, np.pi / (2.0 * np.sqrt(2.0)) * buoyancy, foot


def pieces(foot, thickness, width, length, youngs, strength, rho):
    """Number of pieces that break off."""
    _, b, f = lengths(thickness, youngs, strength, rho)
    least = [side - np.ceil((side - 3 * b) / (3 * b)) * 3 * b for side in (length, width)]
    most = max(np.floor((length * width - least[0] * least[1]) / (3 * b * b)), 0.0)
    return 0.0 if most == 0.0 else min(np.floor(foot / (f * 3 * b)), most)


def sides(count, thickness, width, length, youngs, rho=850.0):
    """Width and length left."""
    _, b, _ = lengths(thickness, youngs, 1.0, rho)
    steps = np.ceil((width - 3 * b) / (3 * b))
    if steps <= 0:
        return width, length - 3 * count * b * b / width
    total = length + width
    cut = 0.5 * (total - np.sqrt(total**2 - 12 * b * b * count))
    narrow, least = width - cut, width - steps * 3 * b
    if narrow < least:
        return least, (length - cut) * narrow / least
    return narrow, length - cut


def relaxed(thickness, growth, strength, rho, viscosity, *, couple):
    """Young's modulus, foot and width of a piece (m) of an edge that breaks after it has relaxed since its foot began to grow.

    A beam on water, bent by the buoyancy of the foot at its end, with its couple or without (strength and bending, 5 and 7).
    """
    y = np.linspace(0.0, 4.0, 40001)

    def bent(age):
        youngs, foot = 9e9 / (1.0 + age * 9e9 / viscosity), growth * age
        length = np.sqrt(2.0) * lengths(thickness, youngs, strength, rho)[0]
        shear = (RHO_W - rho) * G * rho / RHO_W * thickness * foot
        arm = length * np.exp(-y) * np.sin(y) + couple * 0.5 * foot * np.exp(-y) * (np.cos(y) + np.sin(y))
        return 6.0 * shear * arm.max() / thickness**2, youngs, foot, length * y[arm.argmax()]

    return bent(brentq(lambda age: bent(age)[0] - strength, 1.0, 1e10))[1:]
