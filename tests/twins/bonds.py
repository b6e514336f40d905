"""Twin of the DEM bond law, equations 5.4, evaluated whole for one pair, with in-line fracture as in 7.2."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np


def cross(a, b):
    """Vertical part of the vector product."""
    return a[0] * b[1] - a[1] * b[0]


def section(ends, half_overlap, length, *, thickness_of_second):
    """Width and thickness at the contact (equations 5.4, Q11).

    ``ends`` holds (radius, thickness) of elements 1 and 2; with ``thickness_of_second`` the size of the difference is
    added as the reference does, else the thickness is linear between the two centres.
    """
    (r1, t1), (r2, t2) = ends
    (small, t_small), (_, t_other) = ((r1, t1), (r2, t2)) if r1 < r2 else ((r2, t2), (r1, t1))
    reach = (small - half_overlap) / length
    width = 2 * (small + reach * abs(r1 - r2))
    gap = abs(t1 - t2) if thickness_of_second else t_other - t_small
    return width, t_small + reach * gap


def shear_displacement(s, n, c, dt):
    """New tangential displacement: old one turned into the tangent at constant size, plus the slip."""
    across = np.eye(2) - np.outer(n, n)
    turned = across @ s
    size = np.linalg.norm(turned)
    turned = turned * (np.linalg.norm(s) / size) if size > 0 else np.zeros(2)
    return turned + dt * across @ c


def pair(one, two, s, law, dt):
    """Force, torque and stresses of an unbroken bond on both elements.

    Parameters
    ----------
    one, two : namespace
        ``r`` (position, m), ``u``, ``spin``, ``rotation``, ``radius``, ``mass``, ``thickness``.
    s : array
        Tangential displacement of element 1, m.
    law : namespace
        ``E``, ``nu``, ``gamma``, ``no_shear``, ``linear_bending``, ``objective``, ``shared_lever``,
        ``thickness_of_second``.
    dt : float
        Sub-step, s.

    Returns
    -------
    namespace
        ``s``, ``length``, ``sigma_n``, ``sigma_s``, elastic and damping ``force``, ``force_d`` on 1 (2 gets the
        opposite), torques ``torque`` and ``torque_d`` as (on 1, on 2), and the normal force ``normal``.
    """
    r = one.r - two.r
    length = np.linalg.norm(r)
    n = r / length
    rest = one.radius + two.radius
    half = 0.5 * (rest - length)
    lever1, lever2 = one.radius - half, two.radius - half
    width, thickness = section(
        [(one.radius, one.thickness), (two.radius, two.thickness)],
        half,
        length,
        thickness_of_second=law.thickness_of_second,
    )
    normal = law.E * thickness * 2 * half * width / rest * n
    turning = lever1 * one.spin + lever2 * two.spin
    c = one.u - two.u + turning * np.array([n[1], -n[0]])
    s = shear_displacement(s, n, c, dt)
    stiffness = 0.0 if law.no_shear else width * thickness * law.E / (rest * 2 * (1 + law.nu))
    shear = -stiffness * s
    shear_torque1 = -lever1 * cross(n, shear)
    shear_torque2 = shear_torque1 if law.shared_lever else -lever2 * cross(n, shear)
    angle = one.rotation - two.rotation
    theta = angle if law.linear_bending else np.sin(angle)
    bending = -law.E * (2 / 3) * (width / 2) ** 3 * thickness * theta / rest
    k_d = 2 * law.E / (3 * (1 - law.nu**2))
    c_d = law.gamma * np.sqrt(k_d * one.mass * two.mass / (one.mass + two.mass))
    spin_damping = -c_d * (one.spin - two.spin)
    if law.objective:
        force_d = -c_d * c
        torque_d = (-lever1 * cross(n, force_d) + spin_damping, -lever2 * cross(n, force_d) - spin_damping)
    else:
        force_d = -c_d * (one.u - two.u)
        torque_d = (spin_damping, -spin_damping)
    return SimpleNamespace(
        s=s,
        length=length,
        sigma_n=law.E / rest * (-2 * half + abs(theta * width / 2)),
        sigma_s=np.linalg.norm(shear) / (width * thickness),
        normal=normal,
        force=normal + shear,
        force_d=force_d,
        plain_damping=-c_d * (one.u - two.u),
        torque=(shear_torque1 + bending, shear_torque2 - bending),
        torque_d=torque_d,
        turn=(one.spin - two.spin) * dt,
    )


def after_fracture(bond, breaks):
    """Contribution of a bond in the evaluation in which it breaks (equations 7.2).

    Only a bond that fails in shear while compressed still pushes and damps once, without torques; its damper acts on
    the velocities of the centres, because a force at the contact would need its torque.
    """
    if not breaks:
        return bond
    nothing = (0.0, 0.0)
    if bond.sigma_n < 0:
        return SimpleNamespace(
            **{
                **vars(bond),
                "force": bond.normal,
                "force_d": bond.plain_damping,
                "torque": nothing,
                "torque_d": nothing,
            }
        )
    zero = np.zeros(2)
    return SimpleNamespace(**{**vars(bond), "force": zero, "force_d": zero, "torque": nothing, "torque_d": nothing})
