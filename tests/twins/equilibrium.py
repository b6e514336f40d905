"""Slow, plain twin of the loads of a fragment: the equations as written."""

from __future__ import annotations

import numpy as np


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
