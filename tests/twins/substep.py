"""Twin of one sub-step of the multiple-time-step scheme: equations 5.3, 5.4, 5.5, 6.4 (3a to 3d) and 7.2."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from twins import bonds as bond_law
from twins import contact, fracture, geometry, grounding
from twins.elements import assign, between, bond_size, bonded_to, copies, draft, moves, own_size, vector
from twins.velocity import implicit_acceleration, kid_pair


def drift(elements, p, dt):
    """3a: move by the mid-step velocity and show position and velocity; Q1 where it is kept."""
    for e in elements:
        if not moves(e):
            continue
        mid = vector(e, "u") + dt / 2 * (vector(e, "a_fast") + vector(e, "b_fast"))
        e.lon, e.lat = map(float, geometry.move(e.lon, e.lat, mid, dt, p.latlon, p.earth_radius))
        e.lon_pair, e.lat_pair = e.lon, e.lat
        if p.swapped_implicit_velocity:
            mid[1] = e.v + dt / 2 * (e.ay_fast + e.bx_fast)
        assign(e, "u_pair", mid)


def dem_law(p):
    """Options of the bond law."""
    return SimpleNamespace(
        E=p.youngs_modulus,
        nu=p.poisson,
        gamma=p.bond_damping,
        no_shear=p.no_shear,
        linear_bending=p.linear_bending,
        objective=p.objective_damping,
        shared_lever=p.shared_shear_lever,
        thickness_of_second=p.bond_thickness_of_second,
    )


def end(e, p, position):
    """One end of a bond as the bond law wants it."""
    r, mass, _ = bond_size(e, p)
    return SimpleNamespace(
        r=position,
        u=vector(e, "u_pair"),
        spin=e.spin,
        rotation=e.rotation,
        radius=r,
        mass=mass,
        thickness=e.thickness,
    )


def contact_inside(e, c, p, u0, sizes, span=0.0):
    """Contact of two elements of one berg (equations 5.5): acceleration of ``e``."""
    (r1, m1, _), (r2, m2, _) = sizes(e, p), sizes(c, p)
    stiffness = contact.stiffness(p.spring, p.modulus, r1 + r2)
    damping = contact.coefficients(
        stiffness, p.critical_damping, p.tangential_critical_damping, p.radial_damping, p.tangential_damping
    )
    u2 = vector(c, "u_pair")
    spring, tensor, _ = contact.pair(
        between(e, c, p),
        r1 + r2,
        stiffness,
        (m1, m2),
        damping,
        p.damping_by_speed,
        u2,
        u0,
        u0,
        acts=lambda d, rest: d < rest,
    )
    # The trace of the tensor is the sum of radial and tangential damping, times the mass ratio.
    rate = np.trace(tensor) * m1 / min(m1, m2)
    return spring + tensor @ (u2 - vector(e, "u_pair")) / (1 + 2 * span * rate)


def searched(k, elements, bonds, p):
    """Partners of element ``k`` in the search inside the berg (equations 5.3, item 2), unmarked ones only."""
    e = elements[k]
    marked = set(bonded_to(k, bonds, 0)) | set(bonded_to(k, bonds, 1))
    return [
        j
        for j, c in enumerate(elements)
        if j != k and j not in marked and c.berg == e.berg and c.bond_count < p.max_bonds
    ]


def set_convergence(elements, bonds, p):
    """Turn of the axes between the ends of each bond, rad per radian of longitude; it holds for the long step."""
    for b in bonds:
        mean = np.radians(0.5 * (elements[b.first].lat_pair + elements[b.second].lat_pair))
        b.convergence = np.sin(mean) if p.latlon and not p.flat_relative_velocity else 0.0


def evaluate_bonds(elements, bonds, p, dt, *, may_break, time, aground):
    """All unbroken bonds: update ``bonds`` and return forces and torques (elastic and damping together) per element."""
    force = np.zeros((len(elements), 2))
    torque = np.zeros(len(elements))
    fresh = []
    for b in bonds:
        i, j = b.first, b.second
        if b.status != 0 or not (moves(elements[i]) or moves(elements[j])):
            continue
        apart = between(elements[i], elements[j], p)
        one, two = end(elements[i], p, apart), end(elements[j], p, np.zeros(2))
        dlon = elements[i].lon_pair - elements[j].lon_pair
        dlon = np.radians(dlon - p.period * np.round(dlon / p.period) if p.period > 0 else dlon)
        apart_in_axes = 0.5 * b.convergence * dlon * np.array([-1.0, 1.0]) * (0.5 * (one.u + two.u))[::-1]
        one.u, two.u = one.u + apart_in_axes, two.u - apart_in_axes
        result = bond_law.pair(one, two, np.array([b.shear_x, b.shear_y]), dem_law(p), dt)
        b.shear_x, b.shear_y = map(float, result.s)
        b.normal_stress, b.shear_stress = float(result.sigma_n), float(result.sigma_s)
        b.peak_stress = max(b.peak_stress, b.normal_stress)
        b.bond_length = float(result.length)
        b.relative_rotation += result.turn
        strengths = (b.strength * p.normal_strength, b.strength * p.shear_strength)
        limits = (*strengths, 1 - b.damage)
        broken = may_break and fracture.breaks(b.normal_stress, b.shear_stress, *limits)
        if broken:
            b.status, b.break_time = 1, time
            b.break_grounded = int(aground[i] or aground[j])
            fresh.append(b)
        result = bond_law.after_fracture(result, broken)
        force[i] += result.force + result.force_d
        force[j] -= result.force + result.force_d
        torque[i] += result.torque[0] + result.torque_d[0]
        torque[j] += result.torque[1] + result.torque_d[1]
    return force, torque, fresh


def dem_accelerations(elements, bonds, p, dt, *, may_break=False, time=0.0):
    """Equations 5.3 with DEM: accelerations (list of arrays) and spin rates; ``elements`` and ``bonds`` are changed.

    Contact pairs are the bonds that were broken before this evaluation, or those that a search finds.
    """
    old_broken = [(b.first, b.second) for b in bonds if b.status == 1]
    counts = [e.bond_count for e in elements]
    candidates = [searched(k, elements, bonds, p) for k in range(len(elements))]
    aground = [grounding.fraction(e.depth, draft(e, p), p.ground_ramp) > 0 for e in elements]
    force, torque, fresh = evaluate_bonds(elements, bonds, p, dt, may_break=may_break, time=time, aground=aground)
    accelerations = []
    for k, e in enumerate(elements):
        r, mass, _ = bond_size(e, p)
        force[k] = np.array([1.0, e.free_y]) * force[k] + [e.load_x, e.load_y]
        if p.broken_as_contact:
            touching = [j if i == k else i for i, j in old_broken if k in (i, j)]
        else:
            touching = candidates[k] if counts[k] != p.max_bonds else []
        u0 = vector(e, "u")
        total = force[k] / mass
        for j in touching:
            span = 0.0 if p.explicit_contact_damping else dt * p.max_bonds
            total = total + contact_inside(e, elements[j], p, u0, bond_size, span)
        accelerations.append(total)
        e.spin_rate = float(torque[k] / (0.5 * mass * r**2))
    for b in fresh:
        elements[b.first].bond_count -= 1
        elements[b.second].bond_count -= 1
        if not p.broken_as_contact:
            b.status = 2
    return accelerations, len(fresh)


def spring_accelerations(elements, bonds, p):
    """Equations 5.3 without DEM: KID's bonds and contact inside the berg, explicit."""
    accelerations = []
    for k, e in enumerate(elements):
        u0, own = vector(e, "u"), vector(e, "u_pair")
        total = np.zeros(2)
        for j in bonded_to(k, bonds):
            spring, tensor, _ = kid_pair(e, elements[j], p, "bonded", u0, u0, sizes=bond_size)
            total = total + spring + tensor @ (vector(elements[j], "u_pair") - own)
        for j in searched(k, elements, bonds, p):
            total = total + contact_inside(e, elements[j], p, u0, own_size)
        accelerations.append(total)
    return accelerations


def floor_rates(e, p):
    """Rates of the sea floor's drag and rotational drag in the sub-steps; zero where they are not applied there."""
    r, mass, area = bond_size(e, p)
    chi = grounding.fraction(e.depth, draft(e, p), p.ground_ramp)
    plough = grounding.quadratic(p.ground_quadratic, area, mass, e.depth, draft(e, p)) * np.hypot(e.u, e.v)
    slide = grounding.rate(p.ground_coefficient, area, mass, chi) + plough if p.ground_on_substeps else 0.0
    turn = grounding.spin_rate(p.ground_coefficient, r, mass, chi) if p.ground_torque else 0.0
    return slide, turn


def explicit_substep(elements, bonds, p, dt, *, may_break=False, time=0.0):
    """3a to 3d for all elements: returns new elements, new bonds and the number of bonds broken.

    Parameters
    ----------
    dt : float
        Sub-step, s.
    may_break : bool
        Test for fracture in line (equations 7.2).
    time : float
        Time at the end of the sub-step, s.
    """
    elements, bonds = copies(elements), copies(bonds)
    drift(elements, p, dt)
    if p.dem:
        accelerations, broken = dem_accelerations(elements, bonds, p, dt, may_break=may_break, time=time)
    else:
        accelerations, broken = spring_accelerations(elements, bonds, p), 0
    for e, acceleration in zip(elements, accelerations, strict=True):
        if not moves(e):
            continue
        slide, turn = floor_rates(e, p)
        u0 = vector(e, "u")
        star = u0 + dt / 2 * (vector(e, "a_fast") + vector(e, "b_fast"))
        if not p.ground_implicit:
            acceleration = acceleration - slide * u0
        new = geometry.add_velocity(e.lon, e.lat, star, acceleration / 2, dt, p.latlon)
        if p.ground_implicit:
            new = new / (1 + slide * dt)
        assign(e, "u", new)
        assign(e, "a_fast", acceleration)
        assign(e, "b_fast", (0.0, 0.0))
        if p.dem:
            e.spin = (e.spin + dt * e.spin_rate) / (1 + turn * dt)
            e.rotation += dt * e.spin
    for e in elements:
        if moves(e):
            assign(e, "u_pair", vector(e, "u"))
            if p.iterate:
                assign(e, "a", vector(e, "a_fast"))
                assign(e, "b", vector(e, "b_fast"))
    return elements, bonds, broken


def implicit_substep(elements, bonds, p, dt):
    """3a to 3c with the implicit solver of equations 4.3, repeated until the velocities settle if ``p.iterate``.

    Returns
    -------
    elements, passes
    """
    elements = copies(elements)
    drift(elements, p, dt)
    active = [k for k, e in enumerate(elements) if moves(e)]
    last_norm, iterations = 0.0, 0
    while True:
        iterations += 1
        for k in active:
            e = elements[k]
            result = implicit_acceleration(k, elements, bonds, p, dt)
            star = vector(e, "u") + dt / 2 * (vector(e, "a_fast") + vector(e, "b_fast"))
            assign(e, "u", geometry.add_velocity(e.lon, e.lat, star, result.A, dt, p.latlon))
            assign(e, "a_fast", result.a)
            assign(e, "b_fast", result.b)
        norm = sum(vector(elements[k], "u") @ vector(elements[k], "u") for k in active)
        change = sum(np.sum((vector(elements[k], "u") - vector(elements[k], "u_pair")) ** 2) for k in active)
        size = np.sqrt(last_norm) + np.sqrt(norm)
        settled = size == 0 or 2 * np.sqrt(change) / size < p.tolerance
        if not p.iterate or (iterations > 1 and settled):
            break
        last_norm = norm
        for k in active:
            e = elements[k]
            assign(e, "u_pair", vector(e, "u"))
            kicks = sum(vector(e, name) for name in ("a_fast", "b_fast", "a", "b"))
            assign(e, "u", vector(e, "u") - dt / 2 * kicks)
            assign(e, "a_fast", vector(e, "a"))
            assign(e, "b_fast", vector(e, "b"))
    for k in active:
        e = elements[k]
        assign(e, "u_pair", vector(e, "u"))
        if p.iterate:
            assign(e, "a", vector(e, "a_fast"))
            assign(e, "b", vector(e, "b_fast"))
    return elements, iterations
