"""The media that act on an element, one row each: what the schemes compose and everything else reads.

Per unit mass a medium that moves at V acts on an element that moves at U by

    push - (linear + quadratic |U - V|) (U - V)

so that a law is a number or two in the row of its medium. From the rows come the velocity solve of all schemes, the
sub-step, the applied forces that a run keeps, and the budgets of ``riftberg why``: none of them knows a law by name.

A new law of a medium is a term in its row in `media_of`. A new medium is a field of `Media` and its row there.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.coriolis import coriolis_parameter
from riftberg.physics.drag import air_drag, exposed_sides, ocean_drag, sea_ice_drag, side_width
from riftberg.physics.floating import draft_of
from riftberg.physics.grounding import grounded_fraction, grounding_rate, quadratic_grounding
from riftberg.physics.slope import slope_acceleration
from riftberg.physics.waves import Waves, given_wave_acceleration, wave_acceleration
from riftberg.state import Body, Elements, Environment, Floats, Place
from riftberg.stepping.forces.sizes import Sizes, sides_of


class Medium(NamedTuple):
    """One row: linear rate (s-1), quadratic coefficient (m-1), velocity of the medium (m s-1), push (m s-2)."""

    linear: float
    quadratic: float
    u: float
    v: float
    push_x: float
    push_y: float


class Media(NamedTuple):
    """The rows of one element, in the order in which they are summed."""

    water: Medium
    slope: Medium
    air: Medium
    sea_ice: Medium
    waves: Medium
    sea_floor: Medium


MEDIA: Final = Media._fields
"""Names of the media."""

LINEAR, QUADRATIC, U, V, PUSH_X, PUSH_Y = range(len(Medium._fields))
"""Columns of a row."""

SEA_FLOOR: Final = MEDIA.index("sea_floor")
"""Row of the one medium that may act in the sub-steps instead of the long step."""

CORIOLIS: Final = len(MEDIA)
"""Row of the Coriolis force among the applied forces, after the media."""

FORCES: Final = (*MEDIA, "coriolis")
"""Names of the rows of `Surroundings.applied`."""


class Surroundings(NamedTuple):
    """What acts on all elements from outside during a step, and how it did."""

    media: Floats  # The rows of each element; shape (elements, media, columns)
    coriolis: Floats  # Coriolis parameter, s-1; shape (elements,)
    # Which media act in the solve for the velocity; the sea floor may act in the sub-steps instead; shape (media,)
    acts: NDArray[np.bool_]
    # Rate (s-1) of the drag in the last solve: linear, and quadratic times the speed at which it was taken; shape
    # (elements, media)
    rate: Floats
    # Mean acceleration (m s-2, east and north) over the step by each force of `FORCES`, as it was applied; shape
    # (elements, forces, 2)
    applied: Floats


def allocate_surroundings(count: int) -> Surroundings:
    """Return room for ``count`` elements."""
    return Surroundings(
        np.zeros((count, len(MEDIA), len(Medium._fields))),
        np.zeros(count),
        np.ones(len(MEDIA), np.bool_),
        np.zeros((count, len(MEDIA))),
        np.zeros((count, len(FORCES), 2)),
    )


@kernel
def dragged(quadratic: float, u: float, v: float) -> Medium:
    """Row of a medium that drags with the square of the relative speed."""
    return Medium(0.0, quadratic, u, v, 0.0, 0.0)


@kernel
def pushed(push: tuple[float, float]) -> Medium:
    """Row of a medium that accelerates whatever the velocity."""
    return Medium(0.0, 0.0, 0.0, 0.0, push[0], push[1])


@kernel
def sea_floor(thickness: float, depth: float, area: float, mass: float, p: KernelParameters) -> Medium:
    """Row of the sea floor, which stands still; ``area`` (m2) and ``mass`` (kg) as the sea floor sees them."""
    fraction = grounded_part(thickness, depth, p)
    if fraction == 0.0:
        return Medium(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    linear = grounding_rate(p.ground_coefficient, area, mass, fraction)
    quadratic = quadratic_grounding(p.ground_quadratic, area, mass, draft_of(thickness, p.rho_ice) - depth)
    return Medium(linear, quadratic, 0.0, 0.0, 0.0, 0.0)


@kernel
def grounded_part(thickness: float, depth: float, p: KernelParameters) -> float:
    """How far an element is aground, 0 to 1; 0 where the sea floor exerts no drag. The one place where this is decided.

    ``thickness``, ``depth``: of the ice and of the water, m.
    """
    if p.ground_coefficient <= 0.0 and p.ground_quadratic <= 0.0:
        return 0.0
    return grounded_fraction(depth, draft_of(thickness, p.rho_ice), p.ground_ramp)


@kernel
def media_of(
    mass: float, length: float, width: float, thickness: float, sides: int, bonds: int, depth: float, ice_thickness: float,
    uo: float, vo: float, ua: float, va: float, ui: float, vi: float, slope_x: float, slope_y: float,
    waves: Waves, ground_area: float, ground_mass: float, p: KernelParameters,
) -> Media:  # fmt: skip
    """Find the rows of one element (equations 4.1; units as in `riftberg.state.ELEMENT_VARIABLES`).

    ``ground_area``, ``ground_mass``: area (m2) and mass (kg) that the sea floor sees.
    """
    draft = draft_of(thickness, p.rho_ice)
    freeboard = thickness - draft
    ice = min(ice_thickness, draft)
    by_diameter = p.multiple_steps and p.dem and sides == 6 and p.radius_based
    side = side_width(length, width, by_diameter)
    wave_length = side if by_diameter else length
    exposed = exposed_sides(bonds, sides, p.bonds_on and p.sides_by_bonds)
    if waves.height < 0.0:
        by_waves = wave_acceleration(ua, va, uo, vo, mass, freeboard, wave_length, side)
    else:
        by_waves = given_wave_acceleration(waves, mass, freeboard, wave_length, side)
    return Media(
        dragged(ocean_drag(mass, length, width, side, max(0.0, draft - ice), exposed, p.ocean_scale), uo, vo),
        pushed(slope_acceleration(slope_x, slope_y)),
        dragged(air_drag(mass, length, width, side, freeboard, exposed), ua, va),
        dragged(sea_ice_drag(mass, side, ice, exposed, ui, vi, p.frozen_sea_ice_drag), ui, vi),
        pushed(by_waves),
        sea_floor(thickness, depth, ground_area, ground_mass, p),
    )


@kernel
def put_row(media: Floats, e: int, k: int, row: Medium) -> None:
    """Write row ``k`` of element ``e``; columns by name, for a tuple that is asked by number is searched each time."""
    media[e, k, LINEAR], media[e, k, QUADRATIC] = row.linear, row.quadratic
    media[e, k, U], media[e, k, V] = row.u, row.v
    media[e, k, PUSH_X], media[e, k, PUSH_Y] = row.push_x, row.push_y


class Seen(NamedTuple):
    """Groups of `riftberg.state.Elements` that forces from outside hang on."""

    place: Place
    body: Body
    environment: Environment


@kernel
def find_surroundings(el: Elements | Seen, sizes: Sizes, around: Surroundings, p: KernelParameters) -> None:
    """Fill the rows of all elements from the environment that they carry; nothing has been applied yet.

    Arrays are taken out of the state before the loop: numba counts references at each access to a field of a named
    tuple, which would cost more than the forces.
    """
    body, environment = el.body, el.environment
    mass, length, width, thickness, bonds = body.mass, body.length, body.width, body.thickness, body.bond_count
    sides = body.sides
    depth, ice, lat, sx, sy = (
        environment.depth,
        environment.ice_thickness,
        el.place.lat,
        environment.slope_x,
        environment.slope_y,
    )
    uo, vo, ua, va, ui, vi = (
        environment.uo,
        environment.vo,
        environment.ua,
        environment.va,
        environment.ui,
        environment.vi,
    )
    height, period, wave_x, wave_y = (
        environment.wave_height,
        environment.wave_period,
        environment.wave_x,
        environment.wave_y,
    )
    media, coriolis, ground_area, ground_mass = around.media, around.coriolis, sizes.bond_area, sizes.bond_mass
    for e in range(mass.size):
        area, m = (ground_area[e], ground_mass[e]) if p.ground_on_substeps else (width[e] * length[e], mass[e])
        rows = media_of(
            mass[e], length[e], width[e], thickness[e], sides_of(sides[e], p), bonds[e], depth[e], ice[e], uo[e],
            vo[e], ua[e], va[e], ui[e], vi[e], sx[e], sy[e], Waves(height[e], period[e], wave_x[e], wave_y[e]), area, m, p,
        )  # fmt: skip
        put_row(media, e, 0, rows.water)
        put_row(media, e, 1, rows.slope)
        put_row(media, e, 2, rows.air)
        put_row(media, e, 3, rows.sea_ice)
        put_row(media, e, 4, rows.waves)
        put_row(media, e, 5, rows.sea_floor)
        coriolis[e] = coriolis_parameter(lat[e], p.latlon, p.f_plane, p.reference_latitude)
    around.acts[SEA_FLOOR] = not p.ground_on_substeps
    around.applied[:] = 0.0


@kernel
def keep_applied(
    e: int, u: float, v: float, turning_u: float, turning_v: float, media: Floats, rates: Floats, acts: NDArray[np.bool_],
    f: float, applied: Floats,
) -> None:  # fmt: skip
    """Keep the accelerations by which element ``e`` came to its new velocity (u, v), m s-1.

    Drag was taken at the new velocity, with the rates of the last pass of the solve, and the Coriolis force at the velocity
    (turning_u, turning_v); ``f`` is the Coriolis parameter, the arrays are fields of `Surroundings`.
    """
    for m in range(len(MEDIA)):
        if acts[m]:
            applied[e, m, 0] = media[e, m, PUSH_X] - rates[e, m] * (u - media[e, m, U])
            applied[e, m, 1] = media[e, m, PUSH_Y] - rates[e, m] * (v - media[e, m, V])
    applied[e, CORIOLIS, 0], applied[e, CORIOLIS, 1] = f * turning_v, -f * turning_u


@kernel
def aground(thickness: Floats, depth: Floats, p: KernelParameters) -> NDArray[np.bool_]:
    """Whether the sea floor acts on elements, by their thickness and the depth of water (m), of any one shape."""
    flat, water = thickness.ravel(), depth.ravel()
    touching = np.empty(flat.size, np.bool_)
    for e in range(flat.size):
        touching[e] = grounded_part(flat[e], water[e], p) > 0.0
    return touching.reshape(thickness.shape)
