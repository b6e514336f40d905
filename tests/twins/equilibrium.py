"""Slow, plain twins of the quasi-static scheme: equilibrium by a dense pseudo-inverse, motion by the equations as written."""

from __future__ import annotations

import math

import numpy as np


def bond_matrix(place1, place2, radius1, radius2, thickness1, thickness2, youngs, poisson):
    """Stiffness (3), rows (3 x 6; m, m, rad for each end) and section (width, rest length) of one bond."""
    rx, ry = place1[0] - place2[0], place1[1] - place2[1]
    length, rest = math.hypot(rx, ry), radius1 + radius2
    n, t = (rx / length, ry / length), (ry / length, -rx / length)
    lever1, lever2 = radius1 + (length - rest) / 2, radius2 + (length - rest) / 2
    # From the smaller element the section goes linearly to that of the other, up to the point of contact.
    small, other = (1, 2) if radius1 <= radius2 else (2, 1)
    radius = {1: radius1, 2: radius2}
    thickness = {1: thickness1, 2: thickness2}
    part = (radius[small] - (rest - length) / 2) / length
    width = 2 * (radius[small] + part * (radius[other] - radius[small]))
    height = thickness[small] + part * (thickness[other] - thickness[small])
    normal = youngs * height * width / rest
    stiffness = np.array([normal, normal / (2 * (1 + poisson)), normal * width**2 / 12])
    rows = np.array(
        [
            [n[0], n[1], 0, -n[0], -n[1], 0],
            [t[0], t[1], lever1, -t[0], -t[1], lever2],
            [0, 0, 1, 0, 0, -1],
        ]
    )
    return stiffness, rows, width, rest


def balanced(places, mass, inertia, force, spin):
    """Loads of one fragment: forces less mass times the acceleration of the rigid body (axes of the fragment)."""
    total = mass.sum()
    centre = (mass[:, None] * places).sum(axis=0) / total
    r = places - centre
    a = force[:, :2].sum(axis=0) / total
    moment = (r[:, 0] * force[:, 1] - r[:, 1] * force[:, 0] + force[:, 2]).sum()
    alpha = moment / ((mass * (r**2).sum(axis=1)).sum() + inertia.sum())
    turned = np.column_stack([-r[:, 1], r[:, 0]])
    load = force.copy()
    load[:, :2] -= mass[:, None] * (a + alpha * turned - spin**2 * r)
    load[:, 2] -= inertia * alpha
    return load


def equilibrium(places, bonds, radius, thickness, load, youngs, poisson, held=()):
    """Displacements (m, m, rad) of least size, and tensile and shear stress (Pa) of each bond."""
    count = len(places)
    matrix = np.zeros((3 * count, 3 * count))
    described = []
    for i, j in bonds:
        k, rows, width, rest = bond_matrix(
            places[i], places[j], radius[i], radius[j], thickness[i], thickness[j], youngs, poisson
        )
        at = [3 * i, 3 * i + 1, 3 * i + 2, 3 * j, 3 * j + 1, 3 * j + 2]
        matrix[np.ix_(at, at)] += rows.T @ np.diag(k) @ rows
        described.append((at, rows, width, rest))
    free = np.setdiff1d(np.arange(3 * count), held)
    scale = np.tile([1.0, 1.0, 1.0 / radius.mean()], count)[free]
    d = np.zeros(3 * count)
    small = scale[:, None] * matrix[np.ix_(free, free)] * scale
    d[free] = scale * np.linalg.lstsq(small, scale * load.ravel()[free], rcond=1e-13)[0]
    stress = []
    for at, rows, width, rest in described:
        e, s, angle = rows @ d[at]
        stress.append((youngs / rest * (e + abs(angle) * width / 2), youngs / rest / (2 * (1 + poisson)) * abs(s)))
    return d.reshape(-1, 3), np.array(stress)
