"""Contact laws: KID's spring and damper between two elements (equations 5.2, 5.5), and faces of ice that crush each other.

Crushing (Riftberg) has pressure up to a limit, stiff unloading and Coulomb friction.
A face of chord b (m) on ice of thickness h (m) that overlaps another by the area A (m2) bears

    F = min(r K <A - A_p>, K <A - A_e>, p_c h b),    K = p_c h / a

with the overlap A_e at which the faces touched, A_p to which the ice is crushed, the crushing strength p_c (Pa), the depth a (m)
over which it is reached, and the ratio r of the stiffness of unloading. Overlaps are remembered, not depths A / b: the chord of
a corner grows as it is pressed in. The energy that comes back is 1 / r of that which went in, so two faces rebound at
``1 / sqrt(r)`` of the speed at which they met, whatever that was.
"""

from __future__ import annotations

import math

from riftberg.compiled.kernels import kernel


@kernel
def pair_stiffness(given: float, modulus: float, distance: float, stiffest: float) -> float:
    """Stiffness (s-2) of a pair of elements: as given, or if that is negative ``E / (rho d^2)`` of the ice between both.

    A column of ice of the length d between two centres, as wide as they are, pushes back with ``E h w x / d`` when it is
    shortened by x; by the mass ``rho h w d`` this is ``E / (rho d^2) x`` (Riftberg).

    Parameters
    ----------
    given : float
        s-2.
    modulus : float
        Young's modulus over density, m2 s-2.
    distance : float
        Distance of the centres without force, m.
    stiffest : float
        What the time step can resolve, s-2; it limits the stiffness of the ice, not one that was given.
    """
    if given >= 0.0:
        return given
    return min(modulus / (distance * distance), stiffest)


@kernel
def damping_coefficients(
    stiffness: float, critical: bool, tangential_critical: bool, radial: float, tangential: float
) -> tuple[float, float]:
    """Radial and tangential damping (s-1): ``2 sqrt(k)`` and a quarter of it where critical, else as given."""
    if not critical:
        return radial, tangential
    full = 2.0 * math.sqrt(stiffness)
    return full, (full / 4.0 if tangential_critical else tangential)


@kernel
def spring_acceleration(
    nx: float, ny: float, distance: float, rest: float, stiffness: float, mass_ratio: float
) -> tuple[float, float]:
    """Acceleration of element 1: ``k (m_min / m_1) (rest - d) n`` (m s-2); n points from 2 to 1 (Stern et al. 6, 7)."""
    pull = stiffness * mass_ratio * (rest - distance)
    return pull * nx, pull * ny


@kernel
def _projected_speeds(nx: float, ny: float, u: float, v: float) -> tuple[float, float]:
    """Sizes of the parts of (u, v) along n and across it."""
    along = u * nx + v * ny
    return abs(along), math.sqrt((u - along * nx) ** 2 + (v - along * ny) ** 2)


@kernel
def damping_tensor(
    nx: float,
    ny: float,
    radial: float,
    tangential: float,
    mass_ratio: float,
    by_speed: bool,
    du0: float,
    dv0: float,
    du1: float,
    dv1: float,
) -> tuple[float, float, float]:
    """Symmetric tensor P (p11, p12, p22; s-1) with damping acceleration P (u_2 - u_1) of element 1.

    ``P = c_r N + c_t (1 - N)`` with N = n n^T; with ``by_speed`` each coefficient is multiplied by the mean of the
    projected relative speeds at the start of the step (du0, dv0) and at the current iterate (du1, dv1), m s-1.
    """
    radial *= mass_ratio
    tangential *= mass_ratio
    if by_speed:
        along0, across0 = _projected_speeds(nx, ny, du0, dv0)
        along1, across1 = _projected_speeds(nx, ny, du1, dv1)
        radial *= 0.5 * (along1 + along0)
        tangential *= 0.5 * (across1 + across0)
    p11 = radial * nx * nx + tangential * (1.0 - nx * nx)
    p12 = (radial - tangential) * nx * ny
    p22 = radial * ny * ny + tangential * (1.0 - ny * ny)
    return p11, p12, p22


@kernel
def face_stiffness(strength: float, thickness: float, chord: float, depth: float) -> float:
    """Stiffness of loading, N m-1: ``K b = p_c h b / a``.

    Parameters
    ----------
    strength : float
        Crushing strength of the face, Pa.
    thickness : float
        Of the thinner of both elements, m.
    chord : float
        Length of the face in plan, m.
    depth : float
        Depth over which the strength is reached, m.
    """
    return strength * thickness * chord / depth


@kernel
def crushing_force(
    overlap: float, touched: float, crushed: float, rate: float, ratio: float, limit: float, compliance: float
) -> float:
    """Force between two faces, N: the least of unloading, loading and crushing; never a pull.

    Parameters
    ----------
    overlap : float
        Area of the overlap without the force, m2.
    touched : float
        Overlap at which the faces touched, m2.
    crushed : float
        Overlap to which the ice is crushed, m2.
    rate : float
        K: what loading adds to the force, N m-2.
    ratio : float
        Rate of unloading over that of loading.
    limit : float
        Force at which the whole face is crushed, N.
    compliance : float
        How far the force presses the faces apart within the step, m2 N-1: the law is taken at ``overlap - compliance F``.

    Notes
    -----
    Each branch rises with the overlap, so the force under which law and motion agree is the least of those of the branches.
    """
    unloading = ratio * rate
    back = unloading * (overlap - crushed) / (1.0 + unloading * compliance)
    on = rate * (overlap - touched) / (1.0 + rate * compliance)
    return max(min(back, on, limit), 0.0)


@kernel
def sliding_force(last: float, way: float, stiffness: float, compliance: float, most: float) -> float:
    """Friction between two faces at the end of a step, N: what stops the sliding, up to Coulomb's.

    Parameters
    ----------
    last : float
        Friction at the end of the last step, N.
    way : float
        Way along the face within the step without friction, m.
    stiffness : float
        Of the ice along the face, N m-1.
    compliance : float
        How far friction takes the faces back within the step, m N-1: the law is taken at ``way - compliance T``.
    most : float
        The coefficient of friction times the force on the face, N.

    Notes
    -----
    Between rigid bodies friction is open where several faces lie in one line; ice that gives way shares it among them.
    """
    friction = (last + stiffness * way) / (1.0 + stiffness * compliance)
    return min(max(friction, -most), most)
