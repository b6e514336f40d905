"""Twin of whole steps: Verlet (equations 6.2), Runge-Kutta (6.3) and the multiple-time-step scheme (6.4).

Cells, land and environment are not updated here: the environment that the elements carry holds for the step.
"""

from __future__ import annotations

import numpy as np

from twins import geometry
from twins.elements import assign, copies, moves, vector
from twins.substep import explicit_substep, implicit_substep, set_convergence
from twins.velocity import movers, slow_acceleration, stage_acceleration, verlet_acceleration


def verlet_step(elements, bonds, p, dt):
    """One step of single-step Verlet; returns new elements."""
    old, new = copies(elements), copies(elements)
    for k in movers(old):
        e, n = old[k], new[k]
        result = verlet_acceleration(k, old, bonds, p, dt)
        star = vector(e, "u") + dt / 2 * vector(e, "a")
        assign(n, "u_sync", vector(e, "u") - dt / 2 * vector(e, "b"))
        assign(n, "u", geometry.add_velocity(e.lon, e.lat, star, result.A, dt, p.latlon))
        assign(n, "a", result.a)
        assign(n, "b", result.b)
    for k in movers(new):
        n = new[k]
        mid = vector(n, "u") + dt / 2 * (vector(n, "a") + vector(n, "b"))
        n.lon, n.lat = map(float, geometry.move(n.lon, n.lat, mid, dt, p.latlon, p.earth_radius))
        if p.interactions:
            show(n)
    return new


def show(e):
    """Let the others see position and velocity."""
    e.lon_pair, e.lat_pair = e.lon, e.lat
    assign(e, "u_pair", vector(e, "u"))


def runge_kutta_step(elements, bonds, p, dt, *, mean_speeds=False):
    """One fourth-order Runge-Kutta step with the environment of the start; returns new elements."""
    new = copies(elements)
    for k in movers(elements):
        e, n = elements[k], new[k]
        start = np.array([e.lon, e.lat])
        u0 = vector(e, "u")

        def slopes(place, u, dt_stage, k=k):
            result = stage_acceleration(k, elements, bonds, p, dt_stage, u, place[1], mean_speeds=mean_speeds)
            return u / geometry.metric(place[1], p.latlon, p.earth_radius), result

        v1, r1 = slopes(start, u0, dt / 2)
        v2, r2 = slopes(start + dt / 2 * v1, u0 + dt / 2 * r1.A, dt / 2)
        v3, r3 = slopes(start + dt / 2 * v2, u0 + dt / 2 * r2.A, dt)
        v4, r4 = slopes(start + dt * v3, u0 + dt * r3.A, dt)
        n.lon, n.lat = map(float, start + dt / 6 * (v1 + v4 + 2 * (v2 + v3)))
        mean = (r1.A + r4.A + 2 * (r2.A + r3.A)) / 6
        a = (r1.a + r4.a + 2 * (r2.a + r3.a)) / 6
        assign(n, "u", u0 + dt * mean)
        assign(n, "a", a)
        assign(n, "b", mean - a / 2)
    if p.interactions:
        for k in movers(new):
            show(new[k])
    return new


def closing_half_kick(elements, bonds, p, dt):
    """PART 1 of equations 6.4: slow accelerations and synchronised velocities, by Jacobi passes until they settle.

    The flags of Q2 are kept from earlier steps with ``p.sticky_collision_flags``, else cleared first.

    Returns
    -------
    elements, passes
    """
    elements = copies(elements)
    active = movers(elements)
    if not p.sticky_collision_flags:
        for k in active:
            elements[k].in_contact = 0.0
    iterations, last_norm, collided = 0, 0.0, False
    while True:
        iterations += 1
        rows = active if iterations == 1 else [k for k in active if elements[k].in_contact]
        results = {k: slow_acceleration(k, elements, bonds, p, dt) for k in rows}
        for k, result in results.items():
            e = elements[k]
            new = vector(e, "u") + dt * result.A
            assign(e, "u_sync", new)
            if not p.iterate:
                assign(e, "u", new)
            assign(e, "a", result.a)
            assign(e, "b", result.b)
            if result.damping[0] != 0 or (result.damping[1] != 0 and p.iterate):
                collided = True
                e.in_contact = 1.0
        if not p.iterate:
            return elements, iterations
        before = {k: vector(elements[k], "u_pair") for k in rows}
        for k in active:
            assign(elements[k], "u_pair", vector(elements[k], "u_sync"))
        if not collided:
            return elements, iterations
        norm = sum(np.sum(vector(elements[k], "u_sync") ** 2) for k in rows)
        if iterations > 1:
            change = sum(np.sum((vector(elements[k], "u_sync") - before[k]) ** 2) for k in rows)
            size = np.sqrt(last_norm) + np.sqrt(norm)
            if size == 0 or 2 * np.sqrt(change) / size < p.tolerance:
                return elements, iterations
        last_norm = norm


def opening_half_kick(elements, p, dt):
    """PART 2 of equations 6.4: first slow half kick from the synchronised velocity."""
    elements = copies(elements)
    for e in elements:
        if not moves(e):
            continue
        assign(e, "u", vector(e, "u_sync") + dt / 2 * (vector(e, "a") + vector(e, "b")))
        assign(e, "u_pair", vector(e, "u"))
        if p.iterate:
            assign(e, "a", vector(e, "a_fast"))
            assign(e, "b", vector(e, "b_fast"))
    return elements


def multiple_step(elements, bonds, p, dt, substeps, *, skip_outer=False, may_break=False, time=0.0):
    """One long step of equations 6.4 without the cell update at its end.

    Parameters
    ----------
    skip_slow : bool
        Leave out PART 1 and PART 2.
    may_break : bool
        In-line fracture.

    Returns
    -------
    elements, bonds, broken, passes
    """
    iterations, broken = 0, 0
    if not skip_outer:
        elements, iterations = closing_half_kick(elements, bonds, p, dt)
        elements = opening_half_kick(elements, p, dt)
    set_convergence(elements, bonds, p)
    for b in bonds:
        b.peak_stress = b.normal_stress
    for n in range(substeps):
        if p.explicit_substeps or p.dem:
            elements, bonds, more = explicit_substep(
                elements,
                bonds,
                p,
                dt / substeps,
                may_break=may_break,
                time=time + (n + 1) * dt / substeps,
            )
            broken += more
        else:
            elements, _ = implicit_substep(elements, bonds, p, dt / substeps)
    elements = copies(elements)
    for e in elements:
        if moves(e):
            show(e)
    return elements, bonds, broken, iterations
