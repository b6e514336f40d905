"""The size of each berg as a whole, and the part of its sides that each element bears.

Waves and the drag on sides act on the outline of a berg. How many sides of its elements are counted along that outline depends
on how the lattice lies in it (up to the root of two more), so the outline is measured by what does not: area and second moments.
"""

from __future__ import annotations

import math

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.drag import exposed_sides
from riftberg.physics.geometry import nearest_image
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.forces.sizes import sides_of


def measure_outlines(elements: Elements, p: KernelParameters) -> None:
    """Set length and width of the berg that each element belongs to, and the element's share of its sides.

    Bergs whose area is that of their rectangle stay as they were measured: what happens to others must not change their digits.
    """
    if p.forces_by_element:  # nothing there reads them
        return
    place, body = elements.place, elements.body
    numbers, part = np.unique(body.berg, return_inverse=True)
    count = numbers.size
    share_sides(body.length, body.width, body.sides, body.bond_count, part, count, p, body.side_share)
    area = np.bincount(part, body.length * body.width, count)
    stale = np.zeros(count, bool)
    stale[part[np.abs(body.berg_length * body.berg_width - area[part]) > 1e-12 * area[part]]] = True
    if not stale.any():
        return
    length, width = equivalent_rectangles(
        place.lon, place.lat, body.length, body.width, part, count, p.latlon, p.earth_radius, p.period
    )
    rows = stale[part]
    body.berg_length[rows], body.berg_width[rows] = length[part[rows]], width[part[rows]]


@kernel
def _on_sphere(lon: float, lat: float, start: float, latlon: bool, period: float) -> tuple[float, float, float]:
    """Direction from the centre of the sphere; on a plane the place (m) in its image nearest to ``start``."""
    if not latlon:
        return start + nearest_image(lon - start, period), lat, 0.0
    lam, phi = math.radians(lon), math.radians(lat)
    return math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)


@kernel
def equivalent_rectangles(
    lon: Floats, lat: Floats, length: Floats, width: Floats, part: Ints, count: int, latlon: bool, radius: float, period: float
) -> tuple[Floats, Floats]:  # fmt: skip
    """Length and width (m) of the rectangle with the area of each berg and the ratio of its principal second moments.

    With the principal moments ``i_1 >= i_2`` of the area A: ``L = sqrt(A r)``, ``W = sqrt(A / r)``, ``r = sqrt(i_1 / i_2)``. A
    rectangle of elements gives its own sides, and a berg of one element those of the element.

    Parameters
    ----------
    lon, lat : ndarray
        Positions, degrees (m if not ``latlon``).
    length, width : ndarray
        Sides of the elements, m.
    part : ndarray of int
        Berg of each element, from 0.
    count : int
        Number of bergs.
    latlon : bool
        Positions are degrees.
    radius, period : float
        Radius of the sphere, m, and period of the longitude (0: none).
    """
    first, number, area = np.full(count, -1, np.int64), np.zeros(count), np.zeros(count)
    ixx, iyy, ixy = np.zeros((3, count))
    for e in range(part.size):
        k = part[e]
        if first[k] < 0:
            first[k] = e
        number[k] += 1.0
        area[k] += length[e] * width[e]
    # Centres on the sphere itself, and distances on the plane that touches it there: degrees of longitude are none at a pole.
    centre = np.zeros((count, 3))
    for e in range(part.size):
        k, a = part[e], length[e] * width[e]
        if number[k] > 1.0:
            x, y, z = _on_sphere(lon[e], lat[e], lon[first[k]], latlon, period)
            centre[k, 0] += a * x
            centre[k, 1] += a * y
            centre[k, 2] += a * z
    for e in range(part.size):
        k, a = part[e], length[e] * width[e]
        if number[k] > 1.0:
            x, y, z = _on_sphere(lon[e], lat[e], lon[first[k]], latlon, period)
            if latlon:
                cx, cy, cz = centre[k]
                along, whole = math.hypot(cx, cy), math.sqrt(cx * cx + cy * cy + cz * cz)
                c, s = (cx / along, cy / along) if along > 0.0 else (1.0, 0.0)
                x, y = radius * (c * y - s * x), radius * (along * z - cz * (c * x + s * y)) / whole
            else:
                x, y = x - centre[k, 0] / area[k], y - centre[k, 1] / area[k]
            # An element of many may lie any way round: the mean of its own two moments counts along both axes.
            own = (length[e] * length[e] + width[e] * width[e]) / 24.0
            ixx[k] += a * (x * x + own)
            iyy[k] += a * (y * y + own)
            ixy[k] += a * x * y
    long, short = np.empty(count), np.empty(count)
    for k in range(count):
        if number[k] > 1.0:
            half = 0.5 * math.sqrt((ixx[k] - iyy[k]) ** 2 + 4.0 * ixy[k] * ixy[k])
            mean = 0.5 * (ixx[k] + iyy[k])
            ratio = math.sqrt((mean + half) / (mean - half))
        else:
            one = first[k]
            ratio = max(length[one], width[one]) / min(length[one], width[one])
        long[k], short[k] = math.sqrt(area[k] * ratio), math.sqrt(area[k] / ratio)
    return long, short


@kernel
def share_sides(
    length: Floats, width: Floats, sides: Ints, bonds: Ints, part: Ints, count: int, p: KernelParameters, share: Floats
) -> None:  # fmt: skip
    """Write to ``share`` the part of the sides of its berg that each element bears: by the sides that no bond covers."""
    total = np.zeros(count)
    for e in range(part.size):
        share[e] = exposed_sides(bonds[e], sides_of(sides[e], p), p.bonds_on) * math.sqrt(length[e] * width[e])
        total[part[e]] += share[e]
    for e in range(part.size):
        if total[part[e]] > 0.0:
            share[e] /= total[part[e]]
