"""Coefficients of all external forces on one element (spec 4.1)."""

from __future__ import annotations

from typing import NamedTuple

from riftberg.kernels import kernel
from riftberg.parameters import KernelParameters
from riftberg.physics.coriolis import coriolis_parameter
from riftberg.physics.drag import air_drag, draft_of, exposed_sides, ocean_drag, sea_ice_drag, side_width
from riftberg.physics.grounding import grounded_fraction, grounding_rate
from riftberg.physics.slope import slope_acceleration
from riftberg.physics.waves import wave_acceleration
from riftberg.state import Elements


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
def surroundings_of(el: Elements, e: int, latitude: float, multiple_steps: bool, p: KernelParameters) -> Surroundings:
    """Compute the external forces on element ``e`` from the environment that it carries.

    Parameters
    ----------
    el : Elements
    e : int
    latitude : float
        Degrees; of the Runge-Kutta stage where that differs.
    multiple_steps : bool
        Whether the multiple-time-step rules hold (side face of hexagons, grounding moved to the sub-steps).
    p : KernelParameters
    """
    mass, length, width, thickness = el.mass[e], el.length[e], el.width[e], el.thickness[e]
    draft = draft_of(thickness, p.rho_ice)
    freeboard = thickness - draft
    ice = min(el.ice_thickness[e], draft)
    by_diameter = multiple_steps and p.dem and p.hexagonal and p.radius_based
    side = side_width(length, width, by_diameter)
    wave_length = side if by_diameter else length
    exposed = exposed_sides(el.bond_count[e], p.max_sides, p.bonds_on and p.sides_by_bonds)
    uo, vo, ua, va, ui, vi = el.uo[e], el.vo[e], el.ua[e], el.va[e], el.ui[e], el.vi[e]
    slope_x, slope_y = slope_acceleration(el.slope_x[e], el.slope_y[e])
    wave_x, wave_y = wave_acceleration(ua, va, uo, vo, mass, freeboard, wave_length, side)
    ground = 0.0
    if not (multiple_steps and p.ground_on_substeps) and p.ground_coefficient > 0.0:
        fraction = grounded_fraction(el.depth[e], draft, p.ground_ramp)
        ground = grounding_rate(p.ground_coefficient, width * length, mass, fraction)
    return Surroundings(
        ocean_drag(mass, length, width, side, max(0.0, draft - ice), exposed, p.ocean_scale),
        air_drag(mass, length, width, side, freeboard, exposed),
        sea_ice_drag(mass, side, ice, exposed, ui, vi, p.frozen_sea_ice_drag),
        ground,
        slope_x + wave_x,
        slope_y + wave_y,
        coriolis_parameter(latitude, p.latlon, p.f_plane, p.reference_latitude),
        uo,
        vo,
        ua,
        va,
        ui,
        vi,
    )
