"""What the sub-steps of a long step share, whatever law the bonds have, and the outer kicks around them.

A sub-step is velocity Verlet with the forces of bonds and contact (docs/explanation/equations.md, 6.4): `mid_step_velocity`
and `drifted` are its drift, `kicked` is its kick with the drag of the sea floor. Two modules loop over them, one for each way
in which elements stand in memory: `springs` (arrays of the state) and `tile_kernels` (tiles, bonds as beams).

The outer kicks are two half kicks per long step (the same section). As in r-RESPA, drag, slope and Coriolis
force act in half kicks at both ends of the long step, bonds in the sub-steps between. The second half kick of one step and
the first of the next follow each other at one time, with one evaluation of the forces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, kernel, stage
from riftberg.engines.common.forces.implicit_velocity import (
    INTERACTIONS_ONLY,
    OUTER_KICK,
    OUTER_KICK_UNCENTRED,
    WITH_SURROUNDINGS,
    ElementState,
    Solve,
    find_isolated,
    solve_in_contact,
)
from riftberg.engines.common.forces.media import LINEAR, QUADRATIC, SEA_FLOOR, Surroundings, grounded_part, spin_after
from riftberg.engines.common.forces.pair_law import (
    ContactTable,
    NeighbourLists,
    PairLaw,
    allocate_contact_table,
    fill_contact_table,
)
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.explicit.contact import ContactPairs, allocate_pairs
from riftberg.engines.explicit.tiles import AT_ONCE, BondTiles, allocate_tiles
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import fast_cos_latitude
from riftberg.physics.seabed import grounding_spin_rate
from riftberg.state import Bonds, Elements, Floats, Ints

POLAR_LATITUDE = 88.0
"""North of this (degrees) the tangent plane, used from 89 degrees on, may be needed within a long step."""


class StepPlan(NamedTuple):
    """What holds for one long step."""

    dt: float  # Length of the long step, s
    substeps: int
    time: float  # Seconds since the start at its beginning
    starting: bool  # First step with a proper start: evaluate all forces before moving
    skip_outer: bool  # Leave out the outer forces (skip_first_outer_mts_step)
    by_search: bool  # Contact inside a berg goes over candidates of a search, not over broken bonds
    break_inline: bool  # Test for fracture in every sub-step
    break_after: bool  # Test for fracture once, after the second outer half kick
    apply_outer: bool = True  # Apply the outer forces at its start: both half kicks, and fracture after the step before
    apply_inner: bool = True  # Take its sub-steps
    sync_only: bool = False  # Apply the outer half kick that completes the step before, and nothing else
    at_once: int = AT_ONCE  # Sub-steps of beams that go through the bonds together


class SubstepFields(NamedTuple):
    """One value per element, as long as the sub-steps of a long step last."""

    active: Floats  # 1 where it moves
    aground: Floats  # How far it is aground, 0 to 1
    per_mass: Floats  # 1 over its mass, kg-1
    per_inertia: Floats  # 1 over its moment of inertia, kg-1 m-2
    floor_linear: Floats  # Drag of the sea floor: linear rate, s-1
    floor_quadratic: Floats  # Its quadratic coefficient, m-1
    floor_rate: Floats  # Its rate at the velocity now, s-1
    floor_decay: Floats  # What an implicit sub-step leaves of the velocity, 0 to 1
    floor_spin_decay: Floats  # What an implicit sub-step leaves of the spin, 0 to 1
    floor_impulse_x: Floats  # Sum over the sub-steps of the accelerations by the sea floor, m s-2
    floor_impulse_y: Floats
    accel_x: Floats  # Acceleration in this sub-step, m s-2
    accel_y: Floats


class Workspace(NamedTuple):
    """Arrays that the sub-steps of some bergs work in."""

    tiles: BondTiles
    pairs: ContactPairs  # Pairs of broken bonds, or candidates of a search; behind them those of bergs that may meet
    fields: SubstepFields


def allocate_fields(count: int) -> SubstepFields:
    """Return zeros for ``count`` elements."""
    return SubstepFields(*(np.zeros(count) for _ in SubstepFields._fields))


def allocate_workspace(elements: Elements, bonds: Bonds, p: KernelParameters) -> Workspace:
    """Return a workspace for the sub-steps of these elements and bonds."""
    pairs = allocate_pairs(max(bonds.first.size, 1))
    return Workspace(allocate_tiles(elements, bonds), pairs, allocate_fields(elements.size))


@kernel
def mid_step_velocity(
    u: float, v: float, ax: float, ay: float, bx: float, by: float, half: float, q1: bool
) -> tuple[float, float, float]:
    """Velocity ``half`` a sub-step ahead, and its northward part as pair forces see it.

    With ``q1`` the latter takes the eastward implicit acceleration, as the reference does (Q1).
    """
    return u + half * (ax + bx), v + half * (ay + by), v + half * (ay + (bx if q1 else by))


@kernel
def drifted(x: float, y: float, u: float, v: float, step: float, to_degrees: float) -> tuple[float, float]:
    """Position after a drift; ``step`` is the time times units per metre, ``to_degrees`` 1 on the sphere and 0 on a plane."""
    return x + step * (u / fast_cos_latitude(to_degrees * y)), y + step * v


@kernel
def kicked(
    u: float, v: float, ax_old: float, ay_old: float, ax: float, ay: float, rate: float, decay: float, half: float,
    implicit_floor: bool,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Velocity after half the old and half the new acceleration, and the new acceleration with an explicit sea floor.

    The drag of the sea floor at ``rate`` is explicit (part of the acceleration, at the velocity before the sub-step) or
    implicit: the new velocity is multiplied by ``decay``, 1 / (1 + rate dt), which is stable for any rate. A rate that
    grows with the speed is taken at the velocity before the sub-step. Near the pole the reference turns velocity and
    acceleration to the tangent plane and back with one longitude, which changes nothing.
    """
    # A product instead of a branch, which would keep the loop from vectorising.
    explicit, factor = (0.0, decay) if implicit_floor else (1.0, 1.0)
    ax -= explicit * rate * u
    ay -= explicit * rate * v
    return (u + half * ax_old + half * ax) * factor, (v + half * ay_old + half * ay) * factor, ax, ay


@kernel
def floor_drag_rate(linear: float, quadratic: float, u: float, v: float) -> float:
    """Rate (s-1) of the drag of the sea floor at a velocity."""
    return linear + quadratic * math.sqrt(u * u + v * v)


@stage
def begin_substeps(
    el: Elements, surroundings: Surroundings, fields: SubstepFields, sizes: Sizes, dt: float, p: KernelParameters
) -> tuple[bool, bool]:
    """Find what moves, what is aground and how the floor stops it in sub-steps of ``dt`` seconds (equations 6.4).

    Depth holds for the long step. Returns whether the sea floor acts in the sub-steps, and whether it grows with the speed.
    """
    static, thickness, depth = el.body.static, el.body.thickness, el.environment.depth
    radius, mass, media = sizes.bond_radius, sizes.bond_mass, surroundings.media
    active, aground, rate = fields.active, fields.aground, fields.floor_rate
    linear, quadratic = fields.floor_linear, fields.floor_quadratic
    decay, spin_decay = fields.floor_decay, fields.floor_spin_decay
    # A floor that acts in the outer kicks must not act here again.
    in_substeps = not surroundings.acts[SEA_FLOOR]
    acts = varies = False
    fields.floor_impulse_x[:] = 0.0
    fields.floor_impulse_y[:] = 0.0
    for e in range(active.size):
        active[e] = 1.0 if static[e] < 0.5 else 0.0
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
def end_substeps(surroundings: Surroundings, fields: SubstepFields, substeps: int) -> None:
    """Record the mean acceleration by which the sea floor stopped the elements in the sub-steps."""
    applied, floor_impulse_x, floor_impulse_y = surroundings.applied, fields.floor_impulse_x, fields.floor_impulse_y
    for e in range(floor_impulse_x.size):
        applied[e, SEA_FLOOR, 0] = floor_impulse_x[e] / substeps
        applied[e, SEA_FLOOR, 1] = floor_impulse_y[e] / substeps


@kernel
def reaches_pole(lat: Floats) -> bool:
    """Whether an element stands so far north that it may come near the pole within a long step."""
    near_pole = False
    for at in lat:
        near_pole = near_pole or at > POLAR_LATITUDE
    return near_pole


@stage
def store_inner(el: Elements) -> None:
    """Copy the inner accelerations of this sub-step to the arrays of the outer kick, where the reference keeps them."""
    ax, ay, bx, by = el.kicks.ax, el.kicks.ay, el.kicks.bx, el.kicks.by
    ax_fast, ay_fast, bx_fast, by_fast = el.kicks.ax_fast, el.kicks.ay_fast, el.kicks.bx_fast, el.kicks.by_fast
    for e in range(ax.size):
        ax[e], ay[e], bx[e], by[e] = ax_fast[e], ay_fast[e], bx_fast[e], by_fast[e]


@kernel
def publish_velocities(el: Elements, active: Floats) -> None:
    """Let pair forces see the new velocities of the elements that move."""
    shown, motion = el.shown, el.motion
    for e in range(el.place.lon.size):
        # All values are read before one is selected: a load under a condition would keep the loop from vectorising.
        u, v, u_shown, v_shown, moves = motion.u[e], motion.v[e], shown.u_pair[e], shown.v_pair[e], active[e] > 0.0
        shown.u_pair[e] = u if moves else u_shown
        shown.v_pair[e] = v if moves else v_shown


@kernel
def publish_all_velocities(el: Elements, u: Floats, v: Floats) -> None:
    """Let pair forces see these velocities of all elements that are not held."""
    u_shown, v_shown, static = el.shown.u_pair, el.shown.v_pair, el.body.static
    for e in range(u.size):
        if static[e] < 0.5:
            u_shown[e], v_shown[e] = u[e], v[e]


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
    el: Elements, dt: float, surroundings: Surroundings, partners: NeighbourLists, work: OuterWorkspace, sizes: Sizes,
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
        _solve_pass(el, dt, surroundings, work, group, sums, law.by_speed, kick, first, p)
        iterations += 1
        if not p.iterate:
            for e in range(u.size):
                if static[e] < 0.5:
                    u[e], v[e] = u_sync[e], v_sync[e]
            return iterations
        if not first:
            _check_convergence(el, group, unconverged, work.change, work.norm, norm_before, p.tolerance)
        publish_all_velocities(el, u_sync, v_sync)
        if not is_any_set(unconverged):
            return iterations
        if iterations >= p.max_iterations:
            return -1
        sums = work.sums


@borrower
def _solve_pass(
    el: Elements, dt: float, surroundings: Surroundings, work: OuterWorkspace, group: Ints, norm: Floats, by_speed: bool,
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
        s = solve_in_contact(e, w, surroundings, how, table, u_shown, v_shown, by_speed)
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
def is_any_set(marks: NDArray[np.bool_]) -> bool:
    """Whether one of them is set; a loop, since NumPy's function takes seconds to compile."""
    any_set = False
    for mark in marks:
        any_set = any_set or mark
    return any_set


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
