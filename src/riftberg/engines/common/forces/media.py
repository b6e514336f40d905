"""The media that act on an element, one row each: what the schemes compose and everything else reads.

Per unit mass a medium that moves at V acts on an element that moves at U by

    push - (linear + quadratic |U - V|) (U - V) - limit min(|U - V| / yield, 1) (U - V) / |U - V|

and per unit moment of inertia, where it turns at S and the element at W, by

    - (spin_linear + spin_quadratic |W - S|) (W - S)

so that a law is a number or two in the row of its medium, its torque with it. From the rows come the velocity solve of all
schemes, the sub-step, the applied forces that a run keeps, and the budgets of ``riftberg why``: none of them knows a law by
name. Two laws are no rows in the default engine: the drag on the outline of a bonded fragment, and the spin of an element, which
the water alone brakes (`riftberg.engines.quasi_static.bodies.dynamics`).

A new law of a medium is a term in its row in `gather_media`. A new medium is a field of `Media`, its row there, and its
`put_row` in `find_surroundings`. A quantity of the element that a law needs is a field of `ElementView`, filled in
`find_surroundings`.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.engines.common.forces.sizes import Sizes, count_sides, disc_inertia, rectangle_inertia
from riftberg.parameters import KernelParameters
from riftberg.physics.drag import (
    Waves,
    air_drag,
    exposed_sides,
    given_wave_acceleration,
    ocean_drag,
    sea_ice_drag,
    side_spin_drag,
    side_width,
    slope_acceleration,
    spin_drag,
    wave_acceleration,
)
from riftberg.physics.floating import draft_of
from riftberg.physics.geometry import coriolis_parameter
from riftberg.physics.sea_ice import LIMITED, LOCKED, OF_REFERENCE, open_share, pack_depth, pack_strength
from riftberg.physics.seabed import grounded_fraction, grounding_rate, grounding_spin_rate, quadratic_grounding
from riftberg.state import Body, Elements, Environment, Floats, Place


class Medium(NamedTuple):
    """One row."""

    linear: float  # Rate of linear drag, s-1
    quadratic: float  # Coefficient of quadratic drag, m-1
    u: float  # Velocity of the medium, m s-1
    v: float
    push_x: float  # Acceleration whatever the velocity, m s-2
    push_y: float
    spin_linear: float  # Rate of linear drag on the spin, s-1
    spin_quadratic: float  # Coefficient of quadratic drag on the spin, rad-1
    spin: float  # Spin of the medium, s-1
    limit: float  # Largest deceleration by a hold that yields, m s-2; of rigid fragments alone
    yield_speed: float  # Speed through the medium from which on it yields, m s-1


class Media(NamedTuple):
    """The rows of one element, in the order in which they are summed."""

    water: Medium
    slope: Medium
    air: Medium
    sea_ice: Medium
    waves: Medium
    sea_floor: Medium
    own: Medium


MEDIA: Final = Media._fields
"""Names of the media."""

LINEAR, QUADRATIC, U, V, PUSH_X, PUSH_Y, SPIN_LINEAR, SPIN_QUADRATIC, SPIN, LIMIT, YIELD = range(len(Medium._fields))
"""Columns of a row."""

WATER: Final = MEDIA.index("water")

SEA_ICE: Final = MEDIA.index("sea_ice")

SEA_FLOOR: Final = MEDIA.index("sea_floor")
"""Row of the one medium that may act in the sub-steps instead of the long step; its drag on the spin always does."""

OWN: Final = MEDIA.index("own")
"""Row of the forces by laws of the user."""

YIELD_SPEED: Final = 1e-4
"""Speed (m s-1) through a pack of sea ice from which on it yields: a berg that it holds goes 9 m in a day."""

LOCKED_RATE: Final = 1.0
"""Rate (s-1) at which a pack that carries bergs along brings them to its velocity: winds and currents shift them by 0.1 mm/s."""

CORIOLIS: Final = len(MEDIA)
"""Row of the Coriolis force among the applied forces, after the media."""

FORCES: Final = (*MEDIA, "coriolis")
"""Names of the rows of `Surroundings.applied`."""


class Surroundings(NamedTuple):
    """What acts on all elements from outside during a step, and how it did."""

    media: Floats  # The rows of each element; shape (elements, media, columns)
    coriolis: Floats  # Coriolis parameter, s-1; shape (elements,)
    acts: NDArray[np.bool_]  # Which media act in the solve for the velocity, not in the sub-steps; shape (media,)
    # Rate (s-1) of the drag in the last solve: linear, and quadratic times the speed at which it was taken; (elements, media)
    rate: Floats
    # Mean acceleration (m s-2, east and north) over the step by each force of `FORCES`, as it was applied; (elements, forces, 2)
    applied: Floats


def allocate_surroundings(count: int) -> Surroundings:
    """Return arrays for ``count`` elements."""
    return Surroundings(
        np.zeros((count, len(MEDIA), len(Medium._fields))),
        np.zeros(count),
        np.ones(len(MEDIA), np.bool_),
        np.zeros((count, len(MEDIA))),
        np.zeros((count, len(FORCES), 2)),
    )


class ElementView(NamedTuple):
    """One element as the laws of the media see it; units as in `riftberg.state.ELEMENT_VARIABLES`."""

    mass: float
    length: float
    width: float
    thickness: float
    sides: int
    bonds: int
    radius: float  # As bonds see it, m
    bond_mass: float  # As bonds see it, kg
    inertia: float  # Moment of inertia about its own centre, kg m2
    ground_area: float  # Area that the sea floor sees, m2
    ground_mass: float  # Mass that it sees, kg
    depth: float
    ice_thickness: float
    ice_fraction: float
    uo: float
    vo: float
    ua: float
    va: float
    ui: float
    vi: float
    slope_x: float
    slope_y: float
    vorticity: float
    waves: Waves
    side_share: float  # Part of the sides of its berg that the element bears
    berg_length: float
    berg_width: float
    own_x: float  # Force by a law of the user (`riftberg.engines.common.laws`), N
    own_y: float
    own_rate: float  # What that force falls by with the velocity, kg s-1
    own_water_drag: float  # Drags by laws of the user, kg m-1; negative: built-in ones
    own_air_drag: float
    own_ice_drag: float


@kernel
def spin_after(media: Floats, e: int, w: float, dt: float) -> float:
    """Spin (s-1) of element ``e``, before ``w``, after ``dt`` seconds of drag by all media but the sea floor.

    One after the other, each solved exactly: ``r' = -(l + c |r|) r`` of the spin r relative to the medium.
    """
    for m in range(len(MEDIA)):
        linear, quadratic = media[e, m, SPIN_LINEAR], media[e, m, SPIN_QUADRATIC]
        if m == SEA_FLOOR or (linear == 0.0 and quadratic == 0.0):
            continue
        relative = w - media[e, m, SPIN]
        span = dt
        if linear != 0.0:
            relative, span = relative * math.exp(-linear * dt), math.expm1(linear * dt) / linear
        w = media[e, m, SPIN] + relative / (1.0 + span * quadratic * abs(relative))
    return w


@kernel
def dragged(quadratic: float, u: float, v: float) -> Medium:
    """Row of a medium that drags with the square of the relative speed, and on no spin."""
    return Medium(0.0, quadratic, u, v, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def pushed(push: tuple[float, float]) -> Medium:
    """Row of a medium that accelerates whatever the velocity."""
    return Medium(0.0, 0.0, 0.0, 0.0, push[0], push[1], 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def sea_ice(el: ElementView, side: float, depth: float, exposed: float, p: KernelParameters) -> Medium:
    """Row of sea ice of a mean ``depth`` (m) beside an element, which bears the share ``exposed`` of sides of ``side`` m."""
    drag = sea_ice_drag(el.mass, side, depth, exposed, el.ui, el.vi, p.frozen_sea_ice_drag, p.ice_side_drag)
    if el.own_ice_drag >= 0.0:
        drag = el.own_ice_drag / el.mass
    linear = limit = 0.0
    if depth > 0.0 and (p.ice_capture == LIMITED or p.ice_capture == LOCKED):
        strength = pack_strength(el.ice_thickness, el.ice_fraction, p.ice_strength, p.ice_decay)
        if p.ice_capture == LIMITED:
            limit = strength * side * exposed / el.mass
        elif el.ice_fraction >= p.locked_fraction and strength >= p.locked_strength:
            linear = LOCKED_RATE
    return Medium(linear, drag, el.ui, el.vi, 0.0, 0.0, 0.0, 0.0, 0.0, limit, YIELD_SPEED)


@kernel
def sea_floor(el: ElementView, p: KernelParameters) -> Medium:
    """Row of the sea floor, which stands still."""
    fraction = grounded_part(el.thickness, el.depth, p)
    if fraction == 0.0:
        return Medium(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    excess = draft_of(el.thickness, p.rho_ice) - el.depth
    linear = grounding_rate(p.ground_coefficient, el.ground_area, el.ground_mass, fraction)
    quadratic = quadratic_grounding(p.ground_quadratic, el.ground_area, el.ground_mass, excess)
    turning = grounding_spin_rate(p.ground_coefficient, el.radius, el.bond_mass, fraction) if p.ground_torque else 0.0
    return Medium(linear, quadratic, 0.0, 0.0, 0.0, 0.0, turning, 0.0, 0.0, 0.0, 0.0)


@kernel
def grounded_part(thickness: float, depth: float, p: KernelParameters) -> float:
    """How far an element is aground, 0 to 1; 0 where the sea floor exerts no drag. The one place where this is decided.

    ``thickness``, ``depth``: of the ice and of the water, m.
    """
    if p.ground_coefficient <= 0.0 and p.ground_quadratic <= 0.0:
        return 0.0
    return grounded_fraction(depth, draft_of(thickness, p.rho_ice), p.ground_ramp)


@kernel
def ice_depth(thickness: float, fraction: float, draft: float, p: KernelParameters) -> float:
    """Depth (m) to which sea ice covers the sides of an element; ``thickness`` and ``fraction`` are of the ice."""
    depth = thickness
    if p.ice_capture != OF_REFERENCE:
        depth = pack_depth(thickness, fraction, p.least_ice) if p.ice_drift_known else 0.0
    return min(depth, draft)


@kernel
def gather_media(el: ElementView, p: KernelParameters) -> Media:
    """Find the rows of one element (equations 4.1)."""
    draft = draft_of(el.thickness, p.rho_ice)
    freeboard = el.thickness - draft
    ice = ice_depth(el.ice_thickness, el.ice_fraction, draft, p)
    open_side = open_share(el.ice_fraction, p.least_ice) if p.ice_capture != OF_REFERENCE else 1.0
    if p.forces_by_element:
        # The reference takes the sides of an element from its radius, but only in its code for hexagons with beams.
        by_diameter = p.multiple_steps and p.dem and el.sides == 6 and p.radius_based
        side = side_width(el.length, el.width, by_diameter)
        exposed = exposed_sides(el.bonds, el.sides, p.bonds_on and p.sides_by_bonds)
        facing_length, facing_width, facing = (side if by_diameter else el.length), side, 1.0
    else:
        # What acts on the sides is that on the sides of the berg, a quarter of whose perimeter faces the flow, and each
        # element bears its share: on counted sides it would depend on how the lattice lies in the outline.
        side, exposed = 0.5 * (el.berg_length + el.berg_width), el.side_share
        facing_length, facing_width, facing = el.berg_length, el.berg_width, el.side_share
    wet = max(0.0, draft - ice)
    water = ocean_drag(
        el.mass, el.length, el.width, side, wet, exposed, p.ocean_scale, p.water_side_drag, p.water_base_drag
    )
    turning = spin_drag(el.inertia, el.radius, p.ocean_scale, p.water_base_drag) if p.rotational_drag else 0.0
    if p.rotational_drag and p.rigid_bodies and el.bonds == 0:
        # Bonded elements turn with their berg: the drag on its sides has its levers there.
        turning += side_spin_drag(el.inertia, el.length, el.width, wet, p.ocean_scale, p.water_side_drag)
    air = air_drag(el.mass, el.length, el.width, side, freeboard, exposed, p.air_side_drag, p.air_top_drag)
    if el.own_water_drag >= 0.0:
        water = el.own_water_drag / el.mass
    if el.own_air_drag >= 0.0:
        air = el.own_air_drag / el.mass
    if el.waves.height < 0.0:
        push = wave_acceleration(el.ua, el.va, el.uo, el.vo, el.mass, freeboard, facing_length, facing_width)
    else:
        push = given_wave_acceleration(el.waves, el.mass, freeboard, facing_length, facing_width)
    return Media(
        # Water under the element turns with half its vorticity.
        Medium(0.0, water, el.uo, el.vo, 0.0, 0.0, 0.0, turning, 0.5 * el.vorticity, 0.0, 0.0),
        pushed(slope_acceleration(el.slope_x, el.slope_y)),
        dragged(air, el.ua, el.va),
        sea_ice(el, side, ice, exposed, p),
        pushed((open_side * facing * push[0], open_side * facing * push[1])),
        sea_floor(el, p),
        Medium(el.own_rate / el.mass, 0.0, 0.0, 0.0, el.own_x / el.mass, el.own_y / el.mass, 0.0, 0.0, 0.0, 0.0, 0.0),
    )


@kernel
def put_row(media: Floats, e: int, k: int, row: Medium) -> None:
    """Write row ``k`` of element ``e``; columns by name, since a tuple taken by a number in a loop is searched each time."""
    media[e, k, LINEAR], media[e, k, QUADRATIC] = row.linear, row.quadratic
    media[e, k, U], media[e, k, V] = row.u, row.v
    media[e, k, PUSH_X], media[e, k, PUSH_Y] = row.push_x, row.push_y
    media[e, k, SPIN_LINEAR], media[e, k, SPIN_QUADRATIC], media[e, k, SPIN] = (
        row.spin_linear,
        row.spin_quadratic,
        row.spin,
    )
    media[e, k, LIMIT], media[e, k, YIELD] = row.limit, row.yield_speed


class ForcedElements(NamedTuple):
    """Groups of `riftberg.state.Elements` that forces from outside hang on."""

    place: Place
    body: Body
    environment: Environment


@kernel
def find_surroundings(
    el: Elements | ForcedElements, sizes: Sizes, surroundings: Surroundings, p: KernelParameters
) -> None:
    """Fill the rows of all elements from the environment that they carry; nothing has been applied yet."""
    # Arrays are taken out of the state before the loop: numba counts references at each access to a field of a named tuple,
    # which would cost more than the forces.
    body, env, lat = el.body, el.environment, el.place.lat
    mass, length, width, thickness = body.mass, body.length, body.width, body.thickness
    sides, bonds, depth, ice, vorticity = body.sides, body.bond_count, env.depth, env.ice_thickness, env.vorticity
    fraction = env.ice_fraction
    uo, vo, ua, va, ui, vi, sx, sy = env.uo, env.vo, env.ua, env.va, env.ui, env.vi, env.slope_x, env.slope_y
    height, period, wave_x, wave_y = env.wave_height, env.wave_period, env.wave_x, env.wave_y
    side_share, berg_length, berg_width = body.side_share, body.berg_length, body.berg_width
    own_x, own_y, own_rate = env.own_x, env.own_y, env.own_rate
    own_water, own_air, own_ice = env.own_water_drag, env.own_air_drag, env.own_ice_drag
    bond_radius, bond_area, bond_mass = sizes.bond_radius, sizes.bond_area, sizes.bond_mass
    media, coriolis = surroundings.media, surroundings.coriolis
    for e in range(mass.size):
        # In the sub-steps the sea floor sees the sizes that bonds see.
        area, m = (bond_area[e], bond_mass[e]) if p.ground_on_substeps else (width[e] * length[e], mass[e])
        inertia = disc_inertia(bond_mass[e], bond_radius[e])
        if p.rigid_bodies:
            inertia = rectangle_inertia(mass[e], length[e], width[e])
        view = ElementView(
            mass[e], length[e], width[e], thickness[e], count_sides(sides[e], p), bonds[e], bond_radius[e], bond_mass[e],
            inertia, area, m, depth[e], ice[e], min(fraction[e], 1.0), uo[e], vo[e], ua[e], va[e], ui[e], vi[e], sx[e], sy[e],
            vorticity[e],
            Waves(height[e], period[e], wave_x[e], wave_y[e]), side_share[e], berg_length[e], berg_width[e],
            own_x[e], own_y[e], own_rate[e], own_water[e], own_air[e], own_ice[e],
        )  # fmt: skip
        rows = gather_media(view, p)
        put_row(media, e, 0, rows.water)
        put_row(media, e, 1, rows.slope)
        put_row(media, e, 2, rows.air)
        put_row(media, e, 3, rows.sea_ice)
        put_row(media, e, 4, rows.waves)
        put_row(media, e, 5, rows.sea_floor)
        put_row(media, e, 6, rows.own)
        coriolis[e] = coriolis_parameter(lat[e], p.latlon, p.f_plane, p.reference_latitude)
    surroundings.acts[SEA_FLOOR] = not p.ground_on_substeps
    surroundings.applied[:] = 0.0


@kernel
def record_applied(
    e: int, u: float, v: float, turning_u: float, turning_v: float, media: Floats, rates: Floats,
    acts: NDArray[np.bool_], f: float, applied: Floats,
) -> None:  # fmt: skip
    """Record the accelerations by which element ``e`` came to its new velocity (u, v), m s-1.

    Drag was taken at the new velocity, with the rates of the last pass of the solve, and the Coriolis force at the velocity
    (turning_u, turning_v); ``f`` is the Coriolis parameter, the arrays are fields of `Surroundings`.
    """
    for m in range(len(MEDIA)):
        if acts[m]:
            applied[e, m, 0] = media[e, m, PUSH_X] - rates[e, m] * (u - media[e, m, U])
            applied[e, m, 1] = media[e, m, PUSH_Y] - rates[e, m] * (v - media[e, m, V])
    applied[e, CORIOLIS, 0], applied[e, CORIOLIS, 1] = f * turning_v, -f * turning_u


@kernel
def touches_floor(thickness: float, depth: float, floor_load: float, p: KernelParameters) -> bool:
    """Whether the sea floor acts on an element, by either law; see `on_the_floor`."""
    # In a lattice without its surroundings, such as a beam, the drag of the floor only brings it to rest.
    return not p.only_interactions and (floor_load > 0.0 or grounded_part(thickness, depth, p) > 0.0)


@kernel
def _find_touching(thickness: Floats, depth: Floats, floor_load: Floats, p: KernelParameters) -> NDArray[np.bool_]:
    """Return `touches_floor` of elements, in arrays of any one shape."""
    flat, water, load = thickness.ravel(), depth.ravel(), floor_load.ravel()
    touching = np.empty(flat.size, np.bool_)
    for e in range(flat.size):
        touching[e] = touches_floor(flat[e], water[e], load[e], p)
    return touching.reshape(thickness.shape)


def on_the_floor(
    thickness: Floats, depth: Floats, floor_load: Floats | float, p: KernelParameters
) -> NDArray[np.bool_]:
    """Which elements the sea floor acts on, by either law: a bed carries the deepest point of a keel in water deeper elsewhere.

    ``floor_load``: the load that a bed of sediment carries, N; 0 where there is none.
    """
    load = np.ascontiguousarray(np.broadcast_to(np.asarray(floor_load, np.float64), np.shape(thickness)))
    return np.asarray(_find_touching(thickness, depth, load, p))
