"""What the sub-steps of a long step share, whatever law the bonds have: plan, arrays, and the formulae of drift and kick.

A sub-step is velocity Verlet with the forces of bonds and contact (equations 6.4, part 3): `mid_step_velocity` and `drifted`
are its drift (3a), `kicked` is its kick with the drag of the sea floor (3b). Three modules loop over them, one for each way in
which elements stand in memory: `springs` (arrays of the state), `tile_kernels` (tiles, bonds as beams) and `lone_bergs` (a table
for each island of single elements).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import fast_cos_latitude
from riftberg.physics.seabed import grounding_spin_rate
from riftberg.state import Bonds, Elements, Floats
from riftberg.stepping.explicit.breaking import ContactPairs, allocate_pairs
from riftberg.stepping.explicit.tiles import BondTiles, allocate_tiles
from riftberg.stepping.forces.media import LINEAR, QUADRATIC, SEA_FLOOR, Surroundings, grounded_part
from riftberg.stepping.forces.sizes import Sizes

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
    grow_damage: bool  # Stress takes from the strength of the bonds, in every sub-step
    apply_outer: bool = True  # Apply the outer forces at its start: both half kicks, and fracture after the step before
    apply_inner: bool = True  # Take its sub-steps
    sync_only: bool = False  # Apply the outer half kick that completes the step before, and nothing else
    threads: int = 1  # Threads for the sub-steps of a large lattice with bonds as beams


class SubstepFields(NamedTuple):
    """One value per element, as long as the sub-steps of a long step last."""

    active: Floats  # 1 where it moves
    subcycled: Floats  # 1 where it has sub-steps of its own (`riftberg.stepping.explicit.lone_bergs`)
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
    return Workspace(allocate_tiles(elements, bonds, p), pairs, allocate_fields(elements.size))


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
def floor_rate_at(linear: float, quadratic: float, u: float, v: float) -> float:
    """Rate (s-1) of the drag of the sea floor at a velocity."""
    return linear + quadratic * math.sqrt(u * u + v * v)


@stage
def begin_substeps(
    el: Elements, around: Surroundings, fields: SubstepFields, sizes: Sizes, dt: float, p: KernelParameters
) -> tuple[bool, bool]:
    """Find what moves, what is aground and how the floor stops it in sub-steps of ``dt`` seconds (equations 6.4, 3b and 3c).

    Depth holds for the long step. Returns whether the sea floor acts in the sub-steps, and whether it grows with the speed.
    """
    static, thickness, depth = el.body.static, el.body.thickness, el.environment.depth
    radius, mass, media = sizes.bond_radius, sizes.bond_mass, around.media
    active, subcycled, aground, rate = fields.active, fields.subcycled, fields.aground, fields.floor_rate
    linear, quadratic = fields.floor_linear, fields.floor_quadratic
    decay, spin_decay = fields.floor_decay, fields.floor_spin_decay
    # A floor that acts in the outer kicks must not act here again.
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
    """Record the mean acceleration by which the sea floor stopped the elements in the sub-steps."""
    applied, floor_impulse_x, floor_impulse_y = around.applied, fields.floor_impulse_x, fields.floor_impulse_y
    for e in range(floor_impulse_x.size):
        applied[e, SEA_FLOOR, 0] = floor_impulse_x[e] / substeps
        applied[e, SEA_FLOOR, 1] = floor_impulse_y[e] / substeps


@kernel
def reaches_pole(lat: Floats) -> bool:
    """Whether an element stands so far north that it may come near the pole within a long step."""
    near = False
    for at in lat:
        near = near or at > POLAR_LATITUDE
    return near


@stage
def store_inner(el: Elements) -> None:
    """Copy the inner accelerations of this sub-step to those of the outer kick, where the reference keeps them."""
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
    """Let pair forces see these velocities of all elements that are not held, also of those with sub-steps of their own."""
    u_shown, v_shown, static = el.shown.u_pair, el.shown.v_pair, el.body.static
    for e in range(u.size):
        if static[e] < 0.5:
            u_shown[e], v_shown[e] = u[e], v[e]
