"""Twin of the slow acceleration of one element given its neighbours (equations 4.1, 4.2, 4.3, 5.1, 5.2)."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from twins import contact, coriolis, drag, grounding, momentum, slope, waves
from twins.elements import between, bond_size, bonded_to, draft, moves, own_size, vector

NOTHING = (np.zeros(2), np.zeros((2, 2)), np.zeros(2))


def surroundings(e, p, *, latitude, multiple):
    """External forces of equations 4.1 on one element; ``multiple`` selects the rules of the MTS routine."""
    keel = draft(e, p)
    freeboard = e.thickness - keel
    ice = min(e.ice_thickness, keel)
    exposed = drag.exposed(e.bond_count, p.max_sides, p.bonds_on and p.sides_by_bonds)
    by_radius = multiple and p.dem and p.hexagonal and p.radius_based
    width, length = (drag.side(e.length, e.width, True),) * 2 if by_radius else (e.width, e.length)
    chi = grounding.fraction(e.depth, keel, p.ground_ramp)
    ploughing = grounding.quadratic(p.ground_quadratic, e.length * e.width, e.mass, e.depth, keel)
    on_floor = grounding.rate(p.ground_coefficient, e.length * e.width, e.mass, chi)
    wave = waves.acceleration((e.ua, e.va), (e.uo, e.vo), e.mass, freeboard, length, width)
    return SimpleNamespace(
        ocean=drag.ocean(
            e.mass,
            e.length,
            e.width,
            width,
            max(0.0, keel - ice),
            exposed,
            p.ocean_scale,
            p.water_side_drag,
            p.water_base_drag,
        ),
        air=drag.air(e.mass, e.length, e.width, width, freeboard, exposed, p.air_side_drag, p.air_top_drag),
        ice=drag.sea_ice(e.mass, width, ice, exposed, e.ui, e.vi, p.frozen_sea_ice_drag, p.ice_side_drag),
        floor=0.0 if multiple and p.ground_on_substeps else on_floor,
        ploughing=0.0 if multiple and p.ground_on_substeps else ploughing,
        push=slope.acceleration((e.slope_x, e.slope_y)) + wave,
        f=coriolis.parameter(latitude, p.latlon, p.f_plane, p.reference_latitude),
    )


def kid_pair(e, c, p, kind, u0, u1, *, sizes=own_size):
    """KID law on ``e`` due to ``c``: I, P, p. Kinds: bonded, inside, collision, plain contact, plain bond."""
    (r1, m1, _), (r2, m2, _) = sizes(e, p), sizes(c, p)
    far = kind in ("collision", "plain contact")
    given, most = (p.contact_spring, p.contact_stiffest) if far else (p.spring, np.inf)
    stiffness = contact.stiffness(given, p.modulus, r1 + r2, most)
    rest = max(r1 + r2, p.contact_distance) if far else r1 + r2
    acts = {
        "bonded": lambda d, rest: True,
        "plain bond": lambda d, rest: d > rest,
    }.get(kind, lambda d, rest: d < rest)
    damping = contact.coefficients(
        stiffness, p.critical_damping, p.tangential_critical_damping, p.radial_damping, p.tangential_damping
    )
    u2 = vector(c, "u_pair")
    return contact.pair(between(e, c, p), rest, stiffness, (m1, m2), damping, p.damping_by_speed, u2, u0, u1, acts=acts)


def total(terms):
    """Sum of the contributions (I, P, p) of all pairs."""
    return tuple(sum(parts, start=zero) for parts, zero in zip(zip(*terms, strict=True), NOTHING, strict=True))


def kid_terms(k, elements, bonds, p, u0, u1, *, inside, outside, multiple, plain=False):
    """Sum over the partners of element ``k`` (equations 5.1).

    Parameters
    ----------
    inside, outside : bool
        Whether part A1 (own berg) and part A2 (other bergs) act.
    multiple : bool
        Bonded pairs use the constant size in MTS only (equations 1.4, v).
    plain : bool
        Branch B.
    """
    e = elements[k]
    others = [j for j in range(len(elements)) if j != k]
    partners = bonded_to(k, bonds) if p.bonds_on else []
    terms = [NOTHING]
    if plain:
        terms += [kid_pair(e, elements[j], p, "plain contact", u0, u1) for j in others]
        terms += [kid_pair(e, elements[j], p, "plain bond", u0, u1) for j in partners]
        return total(terms)
    if inside and p.bonds_on:
        sizes = bond_size if multiple else own_size
        terms += [kid_pair(e, elements[j], p, "bonded", u0, u1, sizes=sizes) for j in partners]
        near = [j for j in others if elements[j].berg == e.berg and j not in partners]
        terms += [kid_pair(e, elements[j], p, "inside", u0, u1) for j in near]
    if outside:
        foreign = [j for j in others if elements[j].berg != e.berg]
        terms += [kid_pair(e, elements[j], p, "collision", u0, u1) for j in foreign]
    return total(terms)


def solve(
    e, env, pairs, p, dt, *, u_star, u0, u_stage=None, share=1.0, stage=False, mean_speeds=True, only=False,
    centred=False,
):  # fmt: skip
    """Two-pass semi-implicit solve of equations 4.2 and 4.3.

    Parameters
    ----------
    env : namespace
        From `surroundings`.
    pairs : callable
        ``pairs(u0, u1)`` gives I, P, p.
    u_star, u0, u_stage : array
        Velocity with the explicit half kick, at the start, and of the Runge-Kutta stage.
    share : float
        1, or 1/2 for a long step applied as two half kicks.
    stage : bool
        Runge-Kutta: all explicit, no Coriolis force in the matrix.
    mean_speeds : bool
        Mean of the two speeds (predictor-corrector) or speed of the mean velocity.
    only : bool
        Interactions only.
    centred : bool
        Coriolis force and drag all at the new velocity (Riftberg's own long step).

    Returns
    -------
    namespace
        ``A``, ``a``, ``b`` (m s-2) and ``damping`` = M (p - P U3), N.
    """
    u_stage = u0 if u_stage is None else u_stage
    media = [(env.ocean, vector(e, "uo")), (env.air, vector(e, "ua")), (env.ice, vector(e, "ui"))]
    media.append((env.ploughing, np.zeros(2)))
    spring, tensor, vec = pairs(u0, u_stage)
    skew = np.array([[0.0, 1.0], [-1.0, 0.0]])
    explicit = env.push + spring + env.f * skew @ (u_stage if stage else u_star)
    u = u_stage if stage else u0
    for step in (1, 2):
        if step == 2:
            spring, tensor, vec = pairs(u0, u)
        if only:
            right = spring / 2 - share * (tensor @ u_star - vec)
            matrix = np.eye(2) + share * dt * tensor
        else:
            rates = []
            for c, medium in media:
                if centred:
                    rates.append(c * np.linalg.norm(u - medium))
                elif mean_speeds:
                    rates.append(c * momentum.mean_speed(u, u0, medium))
                else:
                    rates.append(c * np.linalg.norm((u + u_stage) / 2 - medium))
            drags = -sum(d * (u_star - m) for d, (_, m) in zip(rates, media, strict=True)) - env.floor * u_star
            right = explicit * (1.0 if stage else 0.5) + share * drags - share * (tensor @ u_star - vec)
            matrix = np.eye(2) * (1 + share * dt * (sum(rates) + env.floor)) + share * dt * tensor
            if not stage:
                matrix = matrix - share * dt * (1.0 if centred else 0.5) * env.f * skew
        acceleration = momentum.solve(matrix, right)
        u = u_star + dt * acceleration
    if only:
        a = spring
    elif stage:
        a = np.zeros(2)
    else:
        a = env.push + spring + env.f * skew @ u
    return SimpleNamespace(A=acceleration, a=a, b=(acceleration - a / 2) / share, damping=e.mass * (vec - tensor @ u))


def verlet_acceleration(k, elements, bonds, p, dt):
    """Single-step Verlet, equations 4.2; partners by branch A or B of equations 5.1."""
    e = elements[k]
    u0 = vector(e, "u")

    def pairs(u0, u1):
        if not p.interactions:
            return NOTHING
        return kid_terms(
            k, elements, bonds, p, u0, u1, inside=True, outside=True, multiple=False, plain=p.plain_kid_branch
        )

    env = surroundings(e, p, latitude=e.lat, multiple=False)
    return solve(e, env, pairs, p, dt, u_star=u0 + dt / 2 * vector(e, "a"), u0=u0, only=p.only_interactions)


def stage_acceleration(k, elements, bonds, p, dt_stage, u_stage, latitude, *, mean_speeds=False):
    """Runge-Kutta variant of equations 4.2 for one stage; positions of pairs are those shown at the start."""
    e = elements[k]
    u0 = vector(e, "u")

    def pairs(u0, u1):
        if not p.interactions:
            return NOTHING
        return kid_terms(
            k, elements, bonds, p, u0, u1, inside=True, outside=True, multiple=False, plain=p.plain_kid_branch
        )

    env = surroundings(e, p, latitude=latitude, multiple=False)
    return solve(
        e,
        env,
        pairs,
        p,
        dt_stage,
        u_star=u0 + dt_stage / 2 * vector(e, "a"),
        u0=u0,
        u_stage=np.asarray(u_stage),
        stage=True,
        mean_speeds=mean_speeds,
        only=p.only_interactions,
    )


def slow_acceleration(k, elements, bonds, p, dt):
    """Long step of MTS, equations 4.3: environment and collisions with other bergs, applied as two half kicks."""
    e = elements[k]
    u0 = vector(e, "u")

    def pairs(u0, u1):
        if not p.interactions:
            return NOTHING
        return kid_terms(k, elements, bonds, p, u0, u1, inside=False, outside=True, multiple=True)

    env = surroundings(e, p, latitude=e.lat, multiple=True)
    return solve(
        e, env, pairs, p, dt, u_star=u0, u0=u0, share=0.5, only=p.only_interactions,
        centred=not p.uncentred_half_kicks,
    )  # fmt: skip


def implicit_acceleration(k, elements, bonds, p, dt):
    """Implicit sub-step of MTS, equations 4.3 (part 3): own berg only, no environment."""
    e = elements[k]
    u0 = vector(e, "u")
    u_star = u0 + dt / 2 * (vector(e, "a_fast") + vector(e, "b_fast"))

    def pairs(u0, u1):
        return kid_terms(k, elements, bonds, p, u0, u1, inside=True, outside=False, multiple=True)

    env = surroundings(e, p, latitude=e.lat, multiple=True)
    return solve(e, env, pairs, p, dt, u_star=u_star, u0=u0, share=0.5, only=True)


def movers(elements):
    """Rows of the elements that move."""
    return [k for k, e in enumerate(elements) if moves(e)]
