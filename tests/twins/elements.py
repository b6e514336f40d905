"""Elements and bonds as plain lists of namespaces, and their sizes in interactions (equations 1.4)."""

from __future__ import annotations

from copy import deepcopy
from types import SimpleNamespace

import numpy as np

from twins import drag, geometry


def unpack(arrays):
    """Turn a struct of arrays (named tuple) into a list of namespaces with plain numbers."""
    named = arrays.arrays()
    size = len(next(iter(named.values())))
    return [SimpleNamespace(**{n: a[k].item() for n, a in named.items()}) for k in range(size)]


def column(items, name):
    """One variable of all items as an array."""
    return np.array([getattr(item, name) for item in items])


def copies(items):
    """Items that share nothing with the originals."""
    return deepcopy(items)


def moves(e):
    """Whether the element takes part in the motion (static_berg < 0.5)."""
    return e.static < 0.5


def vector(e, name):
    """Two numbers ``namex, namey`` (or ``u, v`` and their kin) as a vector."""
    if name.startswith("u"):
        return np.array([getattr(e, name), getattr(e, "v" + name[1:])])
    x, y = (f"{name[0]}{axis}{name[1:]}" for axis in "xy")
    return np.array([getattr(e, x), getattr(e, y)])


def assign(e, name, value):
    """Inverse of `vector`."""
    names = (name, "v" + name[1:]) if name.startswith("u") else tuple(f"{name[0]}{axis}{name[1:]}" for axis in "xy")
    for n, x in zip(names, value, strict=True):
        setattr(e, n, float(x))


def radius(area, p, *, bonded):
    """Inscribed circle of a hexagon or square; disc of the same area for unbonded squares."""
    if p.hexagonal:
        return np.sqrt(area / (2 * np.sqrt(3)))
    return np.sqrt(area) / 2 if bonded else np.sqrt(area / np.pi)


def own_size(e, p):
    """Radius, mass and area from the element's own length, width and mass."""
    area = e.length * e.width
    return radius(area, p, bonded=p.bonds_on), e.mass, area


def bond_size(e, p):
    """Radius, mass and area as bonds and sub-steps see them (constant_interaction_LW)."""
    if not p.constant_size:
        area = e.length * e.width
        return radius(area, p, bonded=True), e.mass, area
    area = p.constant_length * p.constant_width
    return radius(area, p, bonded=True), area * e.thickness * p.rho_ice, area


def draft(e, p):
    """Depth of the keel, m."""
    return drag.draft(e.thickness, p.rho_ice)


def between(e, c, p):
    """Metres from ``c`` to ``e`` by the positions that they show (nearest image)."""
    return geometry.separation((e.lon_pair, e.lat_pair), (c.lon_pair, c.lat_pair), p.latlon, p.earth_radius, p.period)


def bonded_to(k, bonds, status=0):
    """Elements that share a bond of this status with element ``k``, in order of the bonds."""
    ends = [(b.first, b.second) for b in bonds if b.status == status]
    return [j if i == k else i for i, j in ends if k in (i, j)]
