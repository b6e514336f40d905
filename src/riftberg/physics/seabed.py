"""The sea floor under a keel: its drag (equations 4.1, 6.4; paper, methods), or pressure and friction of a bed of sediment.

Where the keel overlaps a bed of sediment by d, this presses back with ``p = min(k_v <d>, q_u)``: elastic up to its bearing
strength. Per unit of area it holds ``min(mu p, alpha s_u)`` against sliding: Coulomb's friction, or the shear strength of clay.
Both are integrated exactly over polygons.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.constants import GRAVITY, RHO_SEAWATER

Floats = NDArray[np.float64]

WATER_STIFFNESS = RHO_SEAWATER * GRAVITY
"""Weight of the water that one metre of heave displaces, Pa m-1."""

POISSON = 0.3
"""Of the ice that bends."""

SIDES_PER_LAMBDA = 4.0
"""Sides of the pads, in which a keel asks for the floor, that make ``lambda``, at least."""

UNBENT_MODULUS = 9e9
"""Young's modulus (Pa) by which ice that does not bend is cut into pads: as finely as solid ice, for the sake of the floor."""

PLATE_STEP = 0.02
"""Distance between the values of `PLATE_DEFLECTION`, over `bending_length`."""

PLATE_SIZE = 501
"""Their number."""

EDGE_STRESS = 3.0 * math.sin(0.25 * math.pi) * math.exp(-0.25 * math.pi)
"""Of `bending_stress` along an edge."""

CORNER_STRESS = 3.0 * 0.786 / 2.0
"""Of `bending_stress` at a corner: ``3 N / H^2`` with the stiffness ``0.786 k_w l^2``."""


@kernel
def grounded_fraction(depth: float, draft: float, ramp_height: float) -> float:
    """How far an element is aground, 0 to 1: ``clip(1 - (depth - draft) / h_g, 0, 1)``, or a step if h_g = 0.

    Parameters
    ----------
    depth, draft : float
        Depth of water and of the keel, m.
    ramp_height : float
        Clearance over which the drag sets in, m.
    """
    if ramp_height > 0.0:
        return min(max(1.0 - (depth - draft) / ramp_height, 0.0), 1.0)
    return 1.0 if draft > depth else 0.0


@kernel
def grounding_rate(coefficient: float, area: float, mass: float, fraction: float) -> float:
    """Rate (s-1) at which the sea floor slows an element: ``c_g A chi / m``. Linear in velocity."""
    return coefficient * area * fraction / mass


@kernel
def quadratic_grounding(coefficient: float, area: float, mass: float, excess: float) -> float:
    """Coefficient (m-1) of the quadratic grounding drag: ``k_g A (D - d) / m``, so that the force is ``-k_g A (D - d) |u| u``.

    A keel that is pressed into the floor by more of its draft ploughs more of it aside, as a dense fluid.

    Parameters
    ----------
    coefficient : float
        ``k_g``, kg m-4.
    area, mass : float
        Base (m2) and mass (kg) of the element.
    excess : float
        Draft in excess of the depth of water, ``D - d``, m; nothing acts where it is not positive.
    """
    return coefficient * area * max(excess, 0.0) / mass


@kernel
def grounding_spin_rate(coefficient: float, radius: float, mass: float, fraction: float) -> float:
    """Rate (s-1) at which the sea floor slows rotation in the reference: ``c_g chi pi R^2 / m`` (equations 6.4)."""
    return coefficient * fraction * math.pi * radius * radius / mass


@kernel
def friction_depth(stiffness: float, strength: float, friction: float, shear_strength: float) -> float:
    """Overlap (m) up to which friction grows with pressure: that at which the bed yields, or shears first.

    Parameters
    ----------
    stiffness, strength : float
        ``k_v`` (Pa m-1) and ``q_u`` (Pa).
    friction : float
        Coefficient ``mu``.
    shear_strength : float
        ``alpha s_u``, Pa; 0 for a bed without.
    """
    depth = strength / stiffness
    if shear_strength > 0.0 and friction > 0.0:
        return min(depth, shear_strength / (friction * stiffness))
    return depth


@kernel
def cut(polygon: Floats, count: int, column: int, level: float, sign: float, out: Floats) -> int:
    """Cut a polygon to where ``sign (value - level) >= 0``; returns the number of corners written to ``out``.

    Corners that are not convex leave edges that run forth and back along the cut: they enclose no area, and integrals by
    triangles from one corner stay exact.

    Parameters
    ----------
    polygon, out : ndarray
        Corners in rows; all columns are linear along the edges.
    count : int
        Corners of the polygon.
    column : int
        Column whose value decides.
    level, sign : float
        Where to cut, and which side stays (1: above, -1: below).
    """
    size = 0
    if count == 0:
        return 0
    before = count - 1
    a = sign * (polygon[before, column] - level)
    for n in range(count):
        b = sign * (polygon[n, column] - level)
        if (a >= 0.0) != (b >= 0.0):
            t = a / (a - b)
            for k in range(polygon.shape[1]):
                out[size, k] = polygon[before, k] + t * (polygon[n, k] - polygon[before, k])
            size += 1
        if b >= 0.0:
            for k in range(polygon.shape[1]):
                out[size, k] = polygon[n, k]
            size += 1
        before, a = n, b
    return size


@kernel
def add_moments(p: Floats, count: int, level: float, sign: float, sums: Floats) -> None:
    """Add the integrals over a polygon (x, y, d in columns 0, 1, 2) of what lies above ``level``, times ``sign``, to ``sums``.

    Parameters
    ----------
    p : ndarray
        Corners, all with ``d >= level`` (`cut`).
    count : int
        Corners.
    level, sign : float
        Level (m), and 1 or -1.
    sums : ndarray
        Takes, in this order: of ``d - level`` the integral (m3) and its moments by x and y (m4); of 1 the integral (m2), the
        moments by x and y and the second moments xx, xy, yy; of half the square of ``d - level`` (m4); and, if it has room
        for 13, the second moments xx, xy, yy of ``d - level`` (m5).
    """
    for n in range(1, count - 1):
        x0, y0, d0 = p[0, 0], p[0, 1], p[0, 2] - level
        x1, y1, d1 = p[n, 0], p[n, 1], p[n, 2] - level
        x2, y2, d2 = p[n + 1, 0], p[n + 1, 1], p[n + 1, 2] - level
        area = sign * 0.5 * ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
        # Over a triangle the integral of f g is area / 12 ((sum f) (sum g) + sum f g), of f area / 3 sum f.
        sx, sy, sd, twelfth = x0 + x1 + x2, y0 + y1 + y2, d0 + d1 + d2, area / 12.0
        sums[0] += area / 3.0 * sd
        sums[1] += twelfth * (sx * sd + x0 * d0 + x1 * d1 + x2 * d2)
        sums[2] += twelfth * (sy * sd + y0 * d0 + y1 * d1 + y2 * d2)
        sums[3] += area
        sums[4] += area / 3.0 * sx
        sums[5] += area / 3.0 * sy
        sums[6] += twelfth * (sx * sx + x0 * x0 + x1 * x1 + x2 * x2)
        sums[7] += twelfth * (sx * sy + x0 * y0 + x1 * y1 + x2 * y2)
        sums[8] += twelfth * (sy * sy + y0 * y0 + y1 * y1 + y2 * y2)
        sums[9] += 0.5 * twelfth * (sd * sd + d0 * d0 + d1 * d1 + d2 * d2)
        if sums.size > 10:
            # Of f g h: area / 60 (f g h + f sum g h + g sum f h + h sum f g + 2 sum f g h), with the sums of f, g and h.
            dx, dy, fifth = d0 * x0 + d1 * x1 + d2 * x2, d0 * y0 + d1 * y1 + d2 * y2, 0.2 * twelfth
            sums[10] += fifth * (
                sd * (sx * sx + x0 * x0 + x1 * x1 + x2 * x2)
                + 2.0 * (sx * dx + d0 * x0 * x0 + d1 * x1 * x1 + d2 * x2 * x2)
            )
            sums[11] += fifth * (
                sd * (sx * sy + x0 * y0 + x1 * y1 + x2 * y2)
                + (sx * dy + sy * dx + 2.0 * (d0 * x0 * y0 + d1 * x1 * y1 + d2 * x2 * y2))
            )
            sums[12] += fifth * (
                sd * (sy * sy + y0 * y0 + y1 * y1 + y2 * y2)
                + 2.0 * (sy * dy + d0 * y0 * y0 + d1 * y1 * y1 + d2 * y2 * y2)
            )


@kernel
def pressed(p: Floats, count: int, top: float, room: Floats, sums: Floats) -> None:
    """Set ``sums`` to the integrals of ``min(<d>, top)`` over a polygon; the columns are those of `add_moments`.

    The integrals of 1 are over the part that is pressed elastically, ``0 < d < top``: the tangent of the others.

    Parameters
    ----------
    p : ndarray
        Corners: x, y (m) and the overlap d (m) in columns 0, 1, 2.
    count : int
        Corners.
    top : float
        Overlap from which the pressure grows no more, m.
    room, sums : ndarray
        Scratch for two more corners than ``count``, and the result (10 or 13).
    """
    sums[:] = 0.0
    highest = lowest = p[0, 2]
    for n in range(1, count):
        highest, lowest = max(highest, p[n, 2]), min(lowest, p[n, 2])
    if highest <= 0.0:
        return
    if lowest >= 0.0:
        add_moments(p, count, 0.0, 1.0, sums)
    else:
        add_moments(room, cut(p, count, 2, 0.0, 1.0, room), 0.0, 1.0, sums)
    if highest > top:
        add_moments(room, cut(p, count, 2, top, 1.0, room), top, -1.0, sums)


@kernel
def bending_length(modulus: float, poisson: float, thickness: float) -> float:
    """Length (m) over which a floating plate spreads a load: ``l = (D / k_w)^(1/4)``, ``D = E H^3 / (12 (1 - nu^2))``.

    Parameters
    ----------
    modulus : float
        Young's modulus of the ice, Pa.
    poisson : float
        Its Poisson's ratio.
    thickness : float
        Of the ice, m.
    """
    rigidity = modulus * thickness**3 / (12.0 * (1.0 - poisson**2))
    return math.sqrt(math.sqrt(rigidity / WATER_STIFFNESS))


def _deflection_table() -> Floats:
    """Deflection of an endless plate by the distance from a load, over that under it: ``-(4 / pi) kei(x)``, by its series."""
    x = PLATE_STEP * np.arange(1, PLATE_SIZE)
    half, digamma = 0.5 * x, -np.euler_gamma
    ber, bei, rest, term = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x), np.ones_like(x)
    for n in range(60):  # term: (x / 2)^(2 n) / n!^2, digamma: of n + 1
        sign = -1.0 if n % 4 > 1 else 1.0
        if n % 2:
            bei += sign * term
            rest += sign * digamma * term
        else:
            ber += sign * term
        term = term * (half / (n + 1)) ** 2
        digamma += 1.0 / (n + 1)
    return np.concatenate([[1.0], -4.0 / math.pi * (rest - np.log(half) * bei - 0.25 * math.pi * ber)])


PLATE_DEFLECTION = _deflection_table()
"""See `plate_deflection`."""


@kernel
def plate_deflection(distance: float) -> float:
    """Deflection of an endless plate on water by a load at a point, over that under the load: ``-(4 / pi) kei(r / l)``.

    Parameters
    ----------
    distance : float
        From the load, over `bending_length`. Beyond 10 nothing is left.
    """
    at = distance / PLATE_STEP
    if at >= PLATE_DEFLECTION.size - 1:
        return 0.0
    n = int(at)
    return float(PLATE_DEFLECTION[n] + (at - n) * (PLATE_DEFLECTION[n + 1] - PLATE_DEFLECTION[n]))


@kernel
def bending_stress(length: float, share: float, thickness: float, bending: float) -> float:
    """Largest bending stress (Pa) of floating ice that a load on a patch lifts: ``c k_w lambda^2 u / H^2``.

    Of a beam on an elastic bed (Hetenyi) ``c = 3`` inside, under a line of load, for the moment is ``k_w lambda^2 u / 2``; and
    ``6 sin(pi / 4) exp(-pi / 4) / 2 = 0.967`` for a line of load on an edge, ``pi lambda / 4`` from it. At a right-angled corner
    the stress is at most ``3 N / H^2`` (Westergaard), which with the stiffness of a corner, ``0.786 k_w l^2``, is ``c = 1.179``.
    Between them ``c`` is linear in ``share``.

    Parameters
    ----------
    length : float
        `bending_length`, m.
    share : float
        Part of the surroundings of the load that is ice, weighted with ``(1 - r^2 / lambda^2)^2``: 1 inside, 1/2 at an edge,
        1/4 at a corner.
    thickness : float
        H, m.
    bending : float
        Largest bending u of the ice, beyond heave and tilt, m.
    """
    if share >= 0.5:
        factor = EDGE_STRESS + (3.0 - EDGE_STRESS) * (min(share, 1.0) - 0.5) / 0.5
    else:
        factor = CORNER_STRESS + (EDGE_STRESS - CORNER_STRESS) * max(share - 0.25, 0.0) / 0.25
    return factor * WATER_STIFFNESS * 2.0 * length * length * bending / (thickness * thickness)
