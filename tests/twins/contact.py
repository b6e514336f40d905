"""Twin of KID's pair law, equations 5.2, and of contact inside a berg, equations 5.5."""

from __future__ import annotations

import numpy as np


def coefficients(stiffness, critical, tangential_critical, radial, tangential):
    """Radial and tangential damping coefficients c_r, c_t."""
    if critical:
        radial = 2 * np.sqrt(stiffness)
        if tangential_critical:
            tangential = 2 * np.sqrt(stiffness) / 4
    return radial, tangential


def stiffness(given, modulus, distance, stiffest=np.inf):
    """Stiffness of a pair: as given, or of a bar of ice between both centres, no stiffer than the step bears."""
    return given if given >= 0 else min(modulus / distance**2, stiffest)


def tensor(normal, radial, tangential, mass_ratio, by_speed, relative0, relative1):
    """P as a matrix; relative velocities are those of the partner, u_2 - u_0 and u_2 - u_1."""
    along = np.outer(normal, normal)
    across = np.eye(2) - along
    total = np.zeros((2, 2))
    for coefficient, projector in ((radial, along), (tangential, across)):
        c = coefficient * mass_ratio
        if by_speed:
            speeds = [np.linalg.norm(projector @ np.asarray(w, dtype=float)) for w in (relative1, relative0)]
            c *= 0.5 * sum(speeds)
        total += c * projector
    return total


def pair(r, rest, stiffness, masses, damping, by_speed, u2, u0, u1, *, acts=lambda d, rest: True):
    """Whole law of 5.2 on element 1: spring acceleration I, matrix P and vector p.

    Parameters
    ----------
    r : array
        From 2 to 1, m.
    rest : float
        Critical distance.
    masses : tuple
        m_1 and m_2.
    damping : tuple
        c_r and c_t.
    acts : callable
        Whether the pair acts at a distance d with this rest length, beside d > 0.
    """
    r, u2 = np.asarray(r, dtype=float), np.asarray(u2, dtype=float)
    d = np.linalg.norm(r)
    if d == 0 or not acts(d, rest):
        return np.zeros(2), np.zeros((2, 2)), np.zeros(2)
    n = r / d
    ratio = min(masses) / masses[0]
    spring = stiffness * ratio * (rest - d) * n
    p = tensor(n, *damping, ratio, by_speed, u2 - np.asarray(u0), u2 - np.asarray(u1))
    return spring, p, p @ u2
