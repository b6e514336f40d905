"""Slow forces of the multiple-time-step scheme: two half kicks per long step (equations 6.4, parts 1 and 2)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.physics.drag import spin_drag
from riftberg.physics.grounding import grounding_spin_rate
from riftberg.state import Elements, Floats
from riftberg.stepping.explicit.springs import SubstepFields, publish_all_velocities
from riftberg.stepping.forces.implicit_velocity import (
    INTERACTIONS_ONLY,
    WITH_SURROUNDINGS,
    find_isolated,
    solve_in_contact,
)
from riftberg.stepping.forces.interactions import PairLaw, Partners
from riftberg.stepping.forces.media import LINEAR, QUADRATIC, SEA_FLOOR, Surroundings, grounded_part
from riftberg.stepping.forces.sizes import Sizes
from riftberg.stepping.forces.touching import Touching, allocate_touching, find_touching


class OuterWorkspace(NamedTuple):
    """Room for the slow half kick.

    Whether each element has no partner; who touches whom; of each group of bergs whether it has settled, and sums over its
    velocities: of changes, of squares now and before, and those of a pass.
    """

    isolated: NDArray[np.bool_]
    touching: Touching
    unconverged: NDArray[np.bool_]
    change: Floats
    norm: Floats
    norm_before: Floats
    sums: Floats


def allocate_outer_workspace(count: int, partners: Partners) -> OuterWorkspace:
    """Return room for ``count`` elements with these partners."""
    groups = 1 if partners.group.size == 0 else int(partners.group.max()) + 1
    touching = allocate_touching(count, partners.collision.partner.size)
    sums = (np.zeros(groups) for _ in range(4))
    return OuterWorkspace(np.zeros(count, np.bool_), touching, np.zeros(groups, np.bool_), *sums)


@stage
def begin_substeps(
    el: Elements, around: Surroundings, fields: SubstepFields, sizes: Sizes, dt: float, p: KernelParameters
) -> tuple[bool, bool]:
    """Find what moves, what is aground and how the floor stops it in sub-steps of ``dt`` seconds (equations 6.4, 3b and 3c).

    Depth holds for the long step.
    """
    static, thickness, depth = el.body.static, el.body.thickness, el.environment.depth
    radius, mass, media = sizes.bond_radius, sizes.bond_mass, around.media
    active, subcycled, aground, rate = fields.active, fields.subcycled, fields.aground, fields.ground_rate
    linear, quadratic = fields.ground_linear, fields.ground_quadratic
    decay, spin_decay = fields.ground_decay, fields.ground_spin_decay
    in_substeps = not around.acts[SEA_FLOOR]
    acts = varies = False
    fields.floor_impulse_x[:] = 0.0
    fields.floor_impulse_y[:] = 0.0
    for e in range(active.size):
        active[e] = 1.0 if static[e] < 0.5 and subcycled[e] == 0.0 else 0.0
        fraction = grounded_part(thickness[e], depth[e], p)
        aground[e] = fraction
        turning = grounding_spin_rate(p.ground_coefficient, radius[e], mass[e], fraction)
        spin_decay[e] = 1.0 / (1.0 + turning * dt) if p.ground_torque and p.dem else 1.0
        fields.per_mass[e], fields.per_inertia[e] = 1.0 / mass[e], 2.0 / (mass[e] * radius[e] * radius[e])
        linear[e] = media[e, SEA_FLOOR, LINEAR] if in_substeps else 0.0
        quadratic[e] = media[e, SEA_FLOOR, QUADRATIC] if in_substeps else 0.0
        rate[e], decay[e] = linear[e], 1.0 / (1.0 + linear[e] * dt)
        varies = varies or quadratic[e] != 0.0
        acts = acts or varies or linear[e] != 0.0
    return acts, varies


@stage
def end_substeps(around: Surroundings, fields: SubstepFields, substeps: int) -> None:
    """Keep the mean acceleration by which the sea floor stopped the elements in the sub-steps."""
    applied, floor_impulse_x, floor_impulse_y = around.applied, fields.floor_impulse_x, fields.floor_impulse_y
    for e in range(floor_impulse_x.size):
        applied[e, SEA_FLOOR, 0] = floor_impulse_x[e] / substeps
        applied[e, SEA_FLOOR, 1] = floor_impulse_y[e] / substeps


@kernel
def _solve_pass(el, dt, around, isolated, touching, group, unconverged, norm, by_speed, kick, first, p):
    """Solve for the slow accelerations of all moving elements, or in later passes of those in contact.

    The first pass marks the groups with elements in contact in ``unsettled``; later ones leave settled groups alone.
    ``norm`` takes the sum of the squared velocities of those solved for, per group.
    """
    motion, kicks, body = el.motion, el.kicks, el.body
    u, v, u_sync, v_sync, mass = motion.u, motion.v, motion.u_sync, motion.v_sync, body.mass
    ax, ay, bx, by, static, in_contact = kicks.ax, kicks.ay, kicks.bx, kicks.by, body.static, body.in_contact
    media, rates, acts, coriolis, applied = around.media, around.rate, around.acts, around.coriolis, around.applied
    mode = INTERACTIONS_ONLY if p.only_interactions else WITH_SURROUNDINGS
    u_shown, v_shown, one = el.shown.u_pair, el.shown.v_pair, group.size == 0
    norm[:] = 0.0
    for e in range(u.size):
        g = 0 if one else group[e]
        if first and not p.sticky_collision_flags:
            in_contact[e] = 0.0
        if static[e] >= 0.5 or not (first or (in_contact[e] != 0.0 and unconverged[g])):
            continue
        s = solve_in_contact(
            e, u[e], v[e], media, rates, acts, coriolis, applied, not p.uncentred_half_kicks, mode, dt, mass[e], touching,
            u_shown, v_shown, by_speed,
        )  # fmt: skip
        ax[e], ay[e], bx[e], by[e] = s.a_x, s.a_y, s.b_x, s.b_y
        # A lone element cannot collide; asked without that, a velocity that is not a number would count as contact.
        if first and not isolated[e] and (s.damping_x != 0.0 or (s.damping_y != 0.0 and p.iterate)):
            unconverged[g] = True
            in_contact[e] = 1.0
        u_sync[e] = u[e] + kick * dt * s.total_x
        v_sync[e] = v[e] + kick * dt * s.total_y
        norm[g] += u_sync[e] ** 2 + v_sync[e] ** 2


@stage
def _check_convergence(el, group, unconverged, change, norm, norm_before, tolerance):
    """Mark the groups whose elements in contact have hardly changed their velocities since the pass before."""
    u_shown, v_shown, u, v = el.shown.u_pair, el.shown.v_pair, el.motion.u_sync, el.motion.v_sync
    static, in_contact, one = el.body.static, el.body.in_contact, group.size == 0
    change[:] = 0.0
    norm[:] = 0.0
    for e in range(u.size):
        if static[e] < 0.5 and in_contact[e] != 0.0:
            g = 0 if one else group[e]
            change[g] += (u[e] - u_shown[e]) ** 2 + (v[e] - v_shown[e]) ** 2
            norm[g] += u[e] ** 2 + v[e] ** 2
    for g in range(unconverged.size):
        scale = math.sqrt(norm_before[g]) + math.sqrt(norm[g])
        if scale == 0.0 or 2.0 * math.sqrt(change[g]) / scale < tolerance:
            unconverged[g] = False
        norm_before[g] = norm[g]


@kernel
def any_of(marks):
    """Whether one of them is set."""
    some = False
    for mark in marks:
        some = some or mark
    return some


@stage
def second_half_kick(
    el: Elements, dt: float, around: Surroundings, partners: Partners, work: OuterWorkspace, sizes: Sizes, law: PairLaw,
    starting: bool, p: KernelParameters,
) -> int:  # fmt: skip
    """Complete the slow half kick of the step before; leaves the synchronised velocity in ``u_sync`` (part 1).

    Elements in contact see each other's velocity, so the solve is repeated until the velocities settle, in each group
    of bergs that can meet for itself.

    ``dt``: long step, s.
    """
    u, v, u_sync, v_sync, static = el.motion.u, el.motion.v, el.motion.u_sync, el.motion.v_sync, el.body.static
    find_touching(el, partners.collision, sizes, law, work.touching)
    kick = 0.0 if starting else 1.0
    find_isolated(partners, work.isolated)
    group, unconverged, norm_before = partners.group, work.unconverged, work.norm_before
    unconverged[:] = False
    iterations, sums = 0, norm_before
    while True:
        first = iterations == 0  # not the words True and False, each of which would be compiled for itself
        _solve_pass(
            el, dt, around, work.isolated, work.touching, group, unconverged, sums, law.by_speed, kick, first, p
        )
        iterations += 1
        if not p.iterate:
            for e in range(u.size):
                if static[e] < 0.5:
                    u[e], v[e] = u_sync[e], v_sync[e]
            return iterations
        if not first:
            _check_convergence(el, group, unconverged, work.change, work.norm, norm_before, p.tolerance)
        publish_all_velocities(el, u_sync, v_sync)
        if not any_of(unconverged):
            return iterations
        if iterations >= p.max_iterations:
            return -1
        sums = work.sums


@stage
def first_half_kick(el: Elements, dt: float, sizes: Sizes, p: KernelParameters) -> None:
    """Start the long step with its first slow half kick (part 2), and the rotational drag of the water."""
    motion, kicks, static, vorticity, spin = (
        el.motion,
        el.kicks,
        el.body.static,
        el.environment.vorticity,
        el.motion.spin,
    )
    u, v, u_sync, v_sync, u_shown, v_shown = (
        motion.u, motion.v, motion.u_sync, motion.v_sync, el.shown.u_pair, el.shown.v_pair,
    )  # fmt: skip
    ax, ay, bx, by = kicks.ax, kicks.ay, kicks.bx, kicks.by
    ax_fast, ay_fast, bx_fast, by_fast = kicks.ax_fast, kicks.ay_fast, kicks.bx_fast, kicks.by_fast
    radius, mass = sizes.bond_radius, sizes.bond_mass
    half = 0.5 * dt
    for e in range(u.size):
        if static[e] >= 0.5:
            continue
        u[e] = u_sync[e] + half * (ax[e] + bx[e])
        v[e] = v_sync[e] + half * (ay[e] + by[e])
        u_shown[e], v_shown[e] = u[e], v[e]
        if p.iterate:
            ax[e], ay[e], bx[e], by[e] = ax_fast[e], ay_fast[e], bx_fast[e], by_fast[e]
        if p.rotational_drag and p.dem and not p.only_interactions:
            inertia = 0.5 * mass[e] * radius[e] ** 2
            drag = spin_drag(inertia, radius[e], p.ocean_scale)
            # The decay of a spin under a drag quadratic in it, solved exactly over the step.
            water = 0.5 * vorticity[e]
            relative = spin[e] - water
            spin[e] = water + relative / (1.0 + dt * drag * abs(relative))
