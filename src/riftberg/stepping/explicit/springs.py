"""One explicit sub-step of the multiple-time-step scheme (equations 6.4, part 3).

Here stand the room for the sub-steps, the forces of bonds, and the loops over elements where bonds are springs or there are none.
With bonds as beams the elements go through the sub-steps in blocks (`riftberg.stepping.explicit.element_blocks`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, stage
from riftberg.constants import DEGREE
from riftberg.physics.geometry import fast_cos_latitude, move
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import PairList
from riftberg.stepping.explicit.bond_rows import BondTiles, allocate_tiles
from riftberg.stepping.explicit.breaking import (
    ContactPairs,
    add_contacts,
    allocate_pairs,
)
from riftberg.stepping.forces.interactions import PairLaw, Partners, interaction_terms, pair_view
from riftberg.stepping.forces.sizes import Sizes

POLAR_LATITUDE = 88.0
"""North of this (degrees) the tangent plane may be needed within a long step."""


class SubstepFields(NamedTuple):
    """One value per element, as long as the sub-steps of a long step last."""

    active: Floats  # 1 where it moves
    subcycled: Floats  # 1 where it has sub-steps of its own (`lone_bergs`)
    aground: Floats  # How far it is aground, 0 to 1
    per_mass: Floats  # 1 over its mass, kg-1
    per_inertia: Floats  # 1 over its moment of inertia, kg-1 m-2
    ground_linear: Floats  # Drag of the sea floor: linear rate, s-1
    ground_quadratic: Floats  # Its quadratic coefficient, m-1
    ground_rate: Floats  # Its rate at the velocity now, s-1
    ground_decay: Floats  # What an implicit sub-step leaves of the velocity, 0 to 1
    ground_spin_decay: Floats  # What an implicit sub-step leaves of the spin, 0 to 1
    floor_impulse_x: Floats  # Sum over the sub-steps of the accelerations by the sea floor, m s-2
    floor_impulse_y: Floats
    accel_x: Floats  # Acceleration in this sub-step, m s-2
    accel_y: Floats


def allocate_fields(count: int) -> SubstepFields:
    """Return zeros for ``count`` elements."""
    return SubstepFields(*(np.zeros(count) for _ in SubstepFields._fields))


class Workspace(NamedTuple):
    """Arrays that the sub-steps of some bergs work in."""

    tiles: BondTiles
    pairs: ContactPairs  # Pairs of broken bonds, or candidates of a search
    fields: SubstepFields


def allocate_workspace(elements: Elements, bonds: Bonds) -> Workspace:
    """Return room for the sub-steps of these elements and bonds."""
    pairs = allocate_pairs(max(bonds.first.size, 1))
    return Workspace(allocate_tiles(bonds, elements.size), pairs, allocate_fields(elements.size))


@kernel
def drift(el: Elements, active: Floats, dt: float, latlon: bool, radius: float, q1: bool) -> None:
    """Move the elements by their mid-step velocity and show position and velocity to the others (equations 6.4, 3a).

    With ``q1`` the northward mid-step velocity uses the eastward implicit acceleration, as the reference does (Q1).
    """
    place, shown, motion, kicks = el.place, el.shown, el.motion, el.kicks
    half = 0.5 * dt
    per_unit = DEGREE * radius if latlon else 1.0
    per_metre = 1.0 / per_unit
    to_degrees = 1.0 if latlon else 0.0
    for e in range(el.place.lon.size):
        # All loads stand before all stores, so that the loop vectorises (see `kick`).
        u, v, ax, ay = motion.u[e], motion.v[e], kicks.ax_fast[e], kicks.ay_fast[e]
        bx, by, lon, lat = kicks.bx_fast[e], kicks.by_fast[e], place.lon[e], place.lat[e]
        u_shown, v_shown, moves = shown.u_pair[e], shown.v_pair[e], active[e]
        wu = u + half * (ax + bx)
        wv = v + half * (ay + by)
        step = moves * dt * per_metre
        lon += step * (wu / fast_cos_latitude(to_degrees * lat))
        lat += step * wv
        seen = v + half * (ay + (bx if q1 else by))
        place.lon[e], place.lat[e] = lon, lat
        shown.lon_pair[e], shown.lat_pair[e] = lon, lat
        shown.u_pair[e] = wu if moves > 0.0 else u_shown
        shown.v_pair[e] = seen if moves > 0.0 else v_shown


@stage
def drift_near_pole(el: Elements, active: Floats, dt: float, radius: float, q1: bool) -> None:
    """As `drift`, on the tangent plane where latitude is above 89 degrees."""
    place, shown, motion, kicks = el.place, el.shown, el.motion, el.kicks
    for e in range(el.place.lon.size):
        if active[e] == 0.0:
            continue
        wu = motion.u[e] + 0.5 * dt * (kicks.ax_fast[e] + kicks.bx_fast[e])
        wv = motion.v[e] + 0.5 * dt * (kicks.ay_fast[e] + kicks.by_fast[e])
        place.lon[e], place.lat[e] = move(place.lon[e], place.lat[e], wu, wv, dt, True, radius)
        shown.lon_pair[e], shown.lat_pair[e] = place.lon[e], place.lat[e]
        shown.u_pair[e] = wu
        shown.v_pair[e] = motion.v[e] + 0.5 * dt * (kicks.ay_fast[e] + kicks.bx_fast[e]) if q1 else wv


@kernel
def spring_accelerations(
    el: Elements, partners: Partners, bond_size: bool, fields: SubstepFields, sizes: Sizes, law: PairLaw
):
    """Accelerations (m s-2) by KID's bonds and contact inside the berg (equations 5.3 without DEM)."""
    place, shown, motion = el.place, el.shown, el.motion
    view = pair_view(el, sizes)
    for e in range(place.lon.size):
        ix, iy, p11, p12, p22, px, py = interaction_terms(
            e,
            place.lon[e],
            place.lat[e],
            motion.u[e],
            motion.v[e],
            motion.u[e],
            motion.v[e],
            partners,
            False,
            bond_size,
            view,
            law,
        )
        uw, vw = shown.u_pair[e], shown.v_pair[e]
        fields.accel_x[e] = ix + px - p11 * uw - p12 * vw
        fields.accel_y[e] = iy + py - p12 * uw - p22 * vw


@kernel
def add_collisions(
    pairs: ContactPairs,
    bonds: Bonds,
    el: Elements,
    sizes: Sizes,
    law: PairLaw,
    fields: SubstepFields,
    most: int,
    dt: float,
) -> None:
    """Add the accelerations (m s-2) by contact between bergs, where bonds are springs or there are none."""
    if pairs.count[0] > 0:
        add_contacts(pairs, bonds.status, el, sizes, law, fields.accel_x, fields.accel_y, False, most, False, dt)


@kernel
def floor_rates(el: Elements, fields: SubstepFields, dt: float) -> None:
    """Find the rates of the sea floor's drag at the velocities now, where it grows with the speed."""
    motion = el.motion
    for e in range(el.place.lon.size):
        speed = math.sqrt(motion.u[e] * motion.u[e] + motion.v[e] * motion.v[e])
        rate = fields.ground_linear[e] + fields.ground_quadratic[e] * speed
        fields.ground_rate[e], fields.ground_decay[e] = rate, 1.0 / (1.0 + rate * dt)


@kernel
def accumulate_floor_impulse(el: Elements, fields: SubstepFields) -> None:
    """Add the accelerations by the sea floor in this sub-step: before an explicit kick, after an implicit one."""
    motion = el.motion
    for e in range(el.place.lon.size):
        rate = fields.active[e] * fields.ground_rate[e]
        fields.floor_impulse_x[e] -= rate * motion.u[e]
        fields.floor_impulse_y[e] -= rate * motion.v[e]


@kernel
def kick(el: Elements, fields: SubstepFields, dt: float, implicit_ground: bool) -> None:
    """Update velocities by half the old and half the new fast acceleration (equations 6.4, 3b).

    The drag of the sea floor is explicit (part of the fast acceleration, at the velocity before the sub-step) or
    implicit: the new velocity is divided by ``1 + rate dt``, which is stable for any rate. A rate that grows with the speed
    is taken at the velocity before the sub-step. Near the pole the reference
    turns velocity and acceleration to the tangent plane and back with one longitude, which changes nothing.
    """
    motion, kicks = el.motion, el.kicks
    half = 0.5 * dt
    explicit = 0.0 if implicit_ground else 1.0
    for e in range(el.place.lon.size):
        # All loads stand before all stores: a load under a condition would keep the loop from vectorising.
        u, v, ax_old, ay_old = motion.u[e], motion.v[e], kicks.ax_fast[e], kicks.ay_fast[e]
        rate, moves = fields.ground_rate[e], fields.active[e] > 0.0
        factor = fields.ground_decay[e] if implicit_ground else 1.0
        ax = fields.accel_x[e] - explicit * rate * u
        ay = fields.accel_y[e] - explicit * rate * v
        new_u = (u + half * ax_old + half * ax) * factor
        new_v = (v + half * ay_old + half * ay) * factor
        motion.u[e] = new_u if moves else u
        motion.v[e] = new_v if moves else v
        kicks.ax_fast[e] = ax if moves else ax_old
        kicks.ay_fast[e] = ay if moves else ay_old


@kernel
def publish_velocities(el: Elements, active: Floats) -> None:
    """Let the others see the new velocities."""
    shown, motion = el.shown, el.motion
    for e in range(el.place.lon.size):
        u, v, u_shown, v_shown, moves = motion.u[e], motion.v[e], shown.u_pair[e], shown.v_pair[e], active[e] > 0.0
        shown.u_pair[e] = u if moves else u_shown
        shown.v_pair[e] = v if moves else v_shown


@kernel
def pairs_from_list(pairs: ContactPairs, candidates: PairList, bonded: PairList, bond_of: Ints) -> None:
    """Fill ``pairs`` with the candidates of a search, each once, with the bond that still joins them or -1."""
    k = 0
    for e in range(candidates.start.size - 1):
        for n in range(candidates.start[e], candidates.start[e + 1]):
            c = candidates.partner[n]
            if c <= e:
                continue
            pairs.first[k], pairs.second[k], pairs.bond[k] = e, c, -1
            for q in range(bonded.start[e], bonded.start[e + 1]):
                if bonded.partner[q] == c:
                    pairs.bond[k] = bond_of[q]
            k += 1
    pairs.count[0] = k


@kernel
def reaches_pole(lat: Floats) -> bool:
    """Whether an element stands so far north that it may come near the pole within a long step."""
    near = False
    for at in lat:
        near = near or at > POLAR_LATITUDE
    return near


@stage
def store_inner(el):
    """Keep the fast accelerations of this sub-step where the reference keeps them."""
    ax, ay, bx, by = el.kicks.ax, el.kicks.ay, el.kicks.bx, el.kicks.by
    ax_fast, ay_fast, bx_fast, by_fast = el.kicks.ax_fast, el.kicks.ay_fast, el.kicks.bx_fast, el.kicks.by_fast
    for e in range(ax.size):
        ax[e], ay[e], bx[e], by[e] = ax_fast[e], ay_fast[e], bx_fast[e], by_fast[e]


@kernel
def publish_all_velocities(el: Elements, u: Floats, v: Floats) -> None:
    """Let the others see these velocities of all elements that are not held, of those too that waited."""
    u_shown, v_shown, static = el.shown.u_pair, el.shown.v_pair, el.body.static
    for e in range(u.size):
        if static[e] < 0.5:
            u_shown[e], v_shown[e] = u[e], v[e]
