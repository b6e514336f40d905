"""Coefficients of all external forces on one element (spec 4.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.coriolis import coriolis_parameter
from riftberg.physics.drag import air_drag, draft_of, exposed_sides, ocean_drag, sea_ice_drag, side_width
from riftberg.physics.grounding import grounded_fraction, grounding_rate
from riftberg.physics.slope import slope_acceleration
from riftberg.physics.waves import wave_acceleration
from riftberg.state import Elements, Floats


class Surroundings(NamedTuple):
    """External forces on one element.

    ``drag_*`` in m-1 (times a speed gives a rate), ``grounding`` in s-1, ``push_*`` (slope and waves) in m s-2,
    ``coriolis`` in s-1, velocities of water, air and sea ice in m s-1.
    """

    drag_ocean: float
    drag_air: float
    drag_ice: float
    grounding: float
    push_x: float
    push_y: float
    coriolis: float
    uo: float
    vo: float
    ua: float
    va: float
    ui: float
    vi: float


@kernel
def external_forces(
    mass: float, length: float, width: float, thickness: float, bonds: int, depth: float, ice_thickness: float,
    uo: float, vo: float, ua: float, va: float, ui: float, vi: float, slope_x: float, slope_y: float,
    latitude: float, multiple_steps: bool, p: KernelParameters,
) -> Surroundings:  # fmt: skip
    """Find the external forces on one element (units as in `riftberg.state.ELEMENT_VARIABLES`).

    Parameters
    ----------
    bonds : int
        Unbroken bonds of the element.
    latitude : float
        Degrees; of the Runge-Kutta stage where that differs.
    multiple_steps : bool
        Whether the multiple-time-step rules hold (side face of hexagons, grounding moved to the sub-steps).
    """
    draft = draft_of(thickness, p.rho_ice)
    freeboard = thickness - draft
    ice = min(ice_thickness, draft)
    by_diameter = multiple_steps and p.dem and p.hexagonal and p.radius_based
    side = side_width(length, width, by_diameter)
    wave_length = side if by_diameter else length
    exposed = exposed_sides(bonds, p.max_sides, p.bonds_on and p.sides_by_bonds)
    down_x, down_y = slope_acceleration(slope_x, slope_y)
    wave_x, wave_y = wave_acceleration(ua, va, uo, vo, mass, freeboard, wave_length, side)
    ground = 0.0
    if not (multiple_steps and p.ground_on_substeps) and p.ground_coefficient > 0.0:
        fraction = grounded_fraction(depth, draft, p.ground_ramp)
        ground = grounding_rate(p.ground_coefficient, width * length, mass, fraction)
    return Surroundings(
        ocean_drag(mass, length, width, side, max(0.0, draft - ice), exposed, p.ocean_scale),
        air_drag(mass, length, width, side, freeboard, exposed),
        sea_ice_drag(mass, side, ice, exposed, ui, vi, p.frozen_sea_ice_drag),
        ground,
        down_x + wave_x,
        down_y + wave_y,
        coriolis_parameter(latitude, p.latlon, p.f_plane, p.reference_latitude),
        uo,
        vo,
        ua,
        va,
        ui,
        vi,
    )


@kernel
def surroundings_of_all(el: Elements, multiple_steps: bool, p: KernelParameters) -> Floats:
    """Find the external forces on all elements from the environment that they carry.

    Arrays are taken out of the state before the loop: numba counts references at each access to a field of a named
    tuple, which would cost more than the forces.

    Returns
    -------
    array of float, shape (n, 13)
        The fields of `Surroundings` of each element.
    """
    body, environment = el.body, el.environment
    mass, length, width, thickness, bonds = body.mass, body.length, body.width, body.thickness, body.bond_count
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
    table = np.empty((mass.size, 13))
    for e in range(mass.size):
        forces = external_forces(
            mass[e], length[e], width[e], thickness[e], bonds[e], depth[e], ice[e], uo[e], vo[e], ua[e], va[e], ui[e],
            vi[e], sx[e], sy[e], lat[e], multiple_steps, p,
        )  # fmt: skip
        for k in range(13):
            table[e, k] = forces[k]
    return table


@kernel
def surroundings_of(table: Floats, e: int) -> Surroundings:
    """Return the external forces on element ``e`` from the table of all."""
    t = table[e]
    return Surroundings(t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8], t[9], t[10], t[11], t[12])
