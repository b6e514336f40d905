"""Outer forces of the multiple-time-step scheme: two half kicks per long step (equations 6.4, parts 1 and 2).

As in r-RESPA, drag, slope and Coriolis force act in half kicks at both ends of the long step, bonds in the sub-steps between.
The second half kick of one step and the first of the next follow each other at one time, with one evaluation of the forces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints
from riftberg.stepping.explicit.substeps import publish_all_velocities
from riftberg.stepping.forces.implicit_velocity import (
    INTERACTIONS_ONLY,
    OUTER_KICK,
    OUTER_KICK_UNCENTRED,
    WITH_SURROUNDINGS,
    ElementState,
    Solve,
    find_isolated,
    solve_in_contact,
)
from riftberg.stepping.forces.media import Surroundings, spin_after
from riftberg.stepping.forces.pair_law import (
    ContactTable,
    NeighbourLists,
    PairLaw,
    allocate_contact_table,
    fill_contact_table,
)
from riftberg.stepping.forces.sizes import Sizes


class OuterWorkspace(NamedTuple):
    """Arrays that an outer half kick, or an implicit sub-step, works in."""

    isolated: NDArray[np.bool_]  # Whether each element has no partner
    table: ContactTable
    unconverged: NDArray[np.bool_]  # Of each group of bergs, as what follows
    change: Floats  # Sum of the squared changes of velocity in the last iteration
    norm: Floats  # Sum of the squared velocities of those in contact
    norm_before: Floats  # The same one iteration before
    sums: Floats  # Sum of the squared velocities of those solved for, not used


def allocate_outer_workspace(count: int, partners: NeighbourLists) -> OuterWorkspace:
    """Return a workspace for ``count`` elements with these partners."""
    groups = 1 if partners.group.size == 0 else int(partners.group.max()) + 1
    table = allocate_contact_table(count, partners.collision.partner.size)
    sums = (np.zeros(groups) for _ in range(4))
    return OuterWorkspace(np.zeros(count, np.bool_), table, np.zeros(groups, np.bool_), *sums)


@stage
def second_half_kick(
    el: Elements, dt: float, around: Surroundings, partners: NeighbourLists, work: OuterWorkspace, sizes: Sizes,
    law: PairLaw, starting: bool, p: KernelParameters,
) -> int:  # fmt: skip
    """Complete the outer half kick of the step before, of ``dt`` seconds; the synchronised velocity is in ``u_sync`` (part 1).

    Elements in contact see each other's velocity, so the solve is repeated until the velocities converge, in each group
    of bergs that can meet for itself. Returns the iterations, or -1 if they did not converge.
    """
    u, v, u_sync, v_sync, static = el.motion.u, el.motion.v, el.motion.u_sync, el.motion.v_sync, el.body.static
    fill_contact_table(el, partners.collision, sizes, law, work.table)
    # At the start of a run there is no step before: the solve finds the accelerations and leaves the velocity.
    kick = 0.0 if starting else 1.0
    find_isolated(partners, work.isolated)
    group, unconverged, norm_before = partners.group, work.unconverged, work.norm_before
    unconverged[:] = False
    # The first iteration solves for all, and its norm is what the second is compared with.
    iterations, sums = 0, norm_before
    while True:
        first = iterations == 0  # not the words True and False, each of which would be compiled for itself
        _solve_pass(el, dt, around, work, group, sums, law.by_speed, kick, first, p)
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


@borrower
def _solve_pass(
    el: Elements, dt: float, around: Surroundings, work: OuterWorkspace, group: Ints, norm: Floats, by_speed: bool,
    kick: float, first: bool, p: KernelParameters,
) -> None:  # fmt: skip
    """Solve for the outer accelerations of all moving elements, or in later passes of those in contact.

    The first pass marks the groups with elements in contact in ``unconverged``; later ones leave groups alone that have
    converged. ``norm`` takes the sum of the squared velocities of those solved for, per group.
    """
    motion, kicks, body = el.motion, el.kicks, el.body
    u, v, u_sync, v_sync, lon, lat = motion.u, motion.v, motion.u_sync, motion.v_sync, el.place.lon, el.place.lat
    ax, ay, bx, by, static, in_contact = kicks.ax, kicks.ay, kicks.bx, kicks.by, body.static, body.in_contact
    isolated, unconverged, table = work.isolated, work.unconverged, work.table
    scheme = OUTER_KICK_UNCENTRED if p.uncentred_half_kicks else OUTER_KICK
    how = Solve(scheme, INTERACTIONS_ONLY if p.only_interactions else WITH_SURROUNDINGS, dt)
    u_shown, v_shown, one_group = el.shown.u_pair, el.shown.v_pair, group.size == 0
    norm[:] = 0.0
    for e in range(u.size):
        g = 0 if one_group else group[e]
        if first and not p.sticky_collision_flags:
            in_contact[e] = 0.0
        if static[e] >= 0.5 or not (first or (in_contact[e] != 0.0 and unconverged[g])):
            continue
        w = ElementState(lon[e], lat[e], u[e], v[e], u[e], v[e], u[e], v[e])
        s = solve_in_contact(e, w, around, how, table, u_shown, v_shown, by_speed)
        ax[e], ay[e], bx[e], by[e] = s.a_x, s.a_y, s.b_x, s.b_y
        # An isolated element cannot collide; without that test, a velocity that is not a number would count as contact.
        if first and not isolated[e] and (s.damping_x != 0.0 or (s.damping_y != 0.0 and p.iterate)):
            unconverged[g] = True
            in_contact[e] = 1.0
        u_sync[e] = u[e] + kick * dt * s.total_x
        v_sync[e] = v[e] + kick * dt * s.total_y
        norm[g] += u_sync[e] ** 2 + v_sync[e] ** 2


@stage
def _check_convergence(
    el: Elements, group: Ints, unconverged: NDArray[np.bool_], change: Floats, norm: Floats, norm_before: Floats,
    tolerance: float,
) -> None:  # fmt: skip
    """Mark the groups whose elements in contact have hardly changed their velocities since the pass before."""
    u_shown, v_shown, u, v = el.shown.u_pair, el.shown.v_pair, el.motion.u_sync, el.motion.v_sync
    static, in_contact, one_group = el.body.static, el.body.in_contact, group.size == 0
    change[:] = 0.0
    norm[:] = 0.0
    for e in range(u.size):
        if static[e] < 0.5 and in_contact[e] != 0.0:
            g = 0 if one_group else group[e]
            change[g] += (u[e] - u_shown[e]) ** 2 + (v[e] - v_shown[e]) ** 2
            norm[g] += u[e] ** 2 + v[e] ** 2
    mark_converged(unconverged, change, norm, norm_before, tolerance)


@kernel
def mark_converged(
    unconverged: NDArray[np.bool_], change: Floats, norm: Floats, norm_before: Floats, tolerance: float
) -> None:
    """Mark the groups whose velocities have changed by less than ``tolerance`` of themselves."""
    for g in range(unconverged.size):
        scale = math.sqrt(norm_before[g]) + math.sqrt(norm[g])
        if scale == 0.0 or 2.0 * math.sqrt(change[g]) / scale < tolerance:
            unconverged[g] = False
        norm_before[g] = norm[g]


@kernel
def any_of(marks: NDArray[np.bool_]) -> bool:
    """Whether one of them is set; a loop, since NumPy's function takes seconds to compile."""
    found = False
    for mark in marks:
        found = found or mark
    return found


@stage
def first_half_kick(el: Elements, dt: float, media: Floats, p: KernelParameters) -> None:
    """Begin the long step with its first outer half kick (part 2), and the drag of the media on the spins over all of it."""
    motion, kicks, static, spin = el.motion, el.kicks, el.body.static, el.motion.spin
    u, v, u_sync, v_sync = motion.u, motion.v, motion.u_sync, motion.v_sync
    u_shown, v_shown, ax, ay, bx, by = el.shown.u_pair, el.shown.v_pair, kicks.ax, kicks.ay, kicks.bx, kicks.by
    ax_fast, ay_fast, bx_fast, by_fast = kicks.ax_fast, kicks.ay_fast, kicks.bx_fast, kicks.by_fast
    half = 0.5 * dt
    for e in range(u.size):
        if static[e] >= 0.5:
            continue
        u[e] = u_sync[e] + half * (ax[e] + bx[e])
        v[e] = v_sync[e] + half * (ay[e] + by[e])
        u_shown[e], v_shown[e] = u[e], v[e]
        if p.iterate:
            # The reference keeps the inner accelerations in the same variables in between.
            ax[e], ay[e], bx[e], by[e] = ax_fast[e], ay_fast[e], bx_fast[e], by_fast[e]
        if p.dem and not p.only_interactions:
            spin[e] = spin_after(media, e, spin[e], dt)
