"""Groups of parameters of the explicit engine: drag aground, springs between bergs, beams and their stress, quirks of motion."""

from __future__ import annotations

from typing import Any, ClassVar, Final, Literal

from riftberg.config.parameter_groups import (
    BondParameters,
    Contact,
    Drag,
    Fracture,
    Grounding,
    Group,
    Stepping,
    quantity,
    quirk,
)
from riftberg.config.values import Usual, field_extra, section_fields

_SPRING: Final = Usual(1e-9, 10.0, "E / (rho (R1 + R2)^2) of elements of 10 m to 10 km")
_SIZE: Final = Usual(5.0, 2e4, "elements of lattices are some m to some km wide", off=True)


class ElementDrag(Drag):
    """Drag of water, air and sea ice on an element."""

    sides_by_bonds: bool = quantity(
        True, "", "side drag only on sides that no bond covers", "equations 4.1, KID's internal_bergs_for_drag",
        kernel="sides_by_bonds",
    )  # fmt: skip


class GroundDrag(Grounding):
    """The sea floor: a drag on keels that it reaches."""

    law: Literal["linear", "quadratic", "none"] = quantity(
        "linear", "",
        "law of the sea floor; linear: a drag by speed, quadratic: by its square and the draft in excess of the depth. "
        "none: no sea floor", "equations 4.1; quadratic: Riftberg",
    )  # fmt: skip
    coefficient: float = quantity(
        1e4, "kg m-2 s-1", "grounding drag of the linear law per base area and speed", "KID's cdrag_grounding; paper", ge=0,
        usual=Usual(1e2, 1e6, "1e4 in Huth et al. 2022", off=True), trial=2e4,
    )  # fmt: skip
    quadratic_coefficient: float = quantity(
        0.0, "kg m-4", "grounding drag of the quadratic law per base area, excess draft and speed squared", "Riftberg", ge=0,
        usual=Usual(1.0, 1e6, "of the order of 1e3: as much drag as 1e4 at some m and m s-1", off=True), trial=20.0,
    )  # fmt: skip
    ramp_height: float = quantity(
        0.0, "m", "clearance over which the drag sets in", "KID's h_to_init_grounding", ge=0,
        usual=Usual(0.1, 100.0, "KID's h_to_init_grounding: a part of the draft", off=True), trial=50.0, kernel="ground_ramp",
    )  # fmt: skip
    on_substeps: bool = quantity(
        True, "", "apply in every sub-step (explicit ones of mts) instead of the long step", "equations 6.4"
    )
    implicit: bool = quantity(
        True, "", "apply the sub-step drag implicitly (explicit needs c_g A dt_f / m < 2)", "Riftberg",
        kernel="ground_implicit",
    )  # fmt: skip
    torque: bool = quantity(
        False, "", "sea floor also damps rotation", "equations 6.4, KID's use_grounding_torque", kernel="ground_torque"
    )


class Springs(Contact):
    """Repulsion between bergs and between the pieces of a broken berg: springs and dampers between centres."""

    spring: float | None = quantity(
        None, "s-2",
        "stiffness between different bergs; none means that of the ice between both centres, E / (rho (R1 + R2)^2)",
        "KID's contact_spring_coef; none: Riftberg", ge=0, usual=_SPRING, trial=1e-6,
    )  # fmt: skip
    distance: float = quantity(
        0.0, "m", "contact starts at max(this, R1 + R2): at 0 where the elements touch", "KID's contact_distance", ge=0,
        usual=Usual(1.0, 1e4, "4000 m in Huth et al. 2022", off=True), trial=900.0,
    )  # fmt: skip
    on_substeps: bool = quantity(
        True, "",
        "contact between bergs acts in the explicit sub-steps of mts; otherwise in the long step, which stiff ice needs "
        "shorter", "Riftberg; reference: long step",
    )  # fmt: skip
    critical_damping: bool = quantity(True, "", "radial damping 2 sqrt(k)", "equations 5.2", kernel="critical_damping")
    tangential_critical_damping: bool = quantity(
        False, "", "tangential damping a quarter of critical", "equations 5.2", kernel="tangential_critical_damping"
    )
    radial_damping: float = quantity(
        0.0, "s-1", "radial damping where not critical", "KID's radial_damping_coef", ge=0, trial=1e-3, kernel="radial_damping",
    )  # fmt: skip
    tangential_damping: float = quantity(
        0.0, "s-1", "tangential damping where not critical", "KID's tangental_damping_coef", ge=0, trial=1e-3,
        kernel="tangential_damping",
    )  # fmt: skip
    iterate: bool = quantity(
        True, "", "iterate the velocity coupling to convergence", "equations 6.4, KID's force_convergence", kernel="iterate",
    )  # fmt: skip
    tolerance: float = quantity(
        1e-4, "1", "tolerance of that iteration", "equations 6.4, KID's convergence_tolerance", gt=0,
        usual=Usual(1e-12, 1e-2, "1e-4 in KID"), trial=0.5, kernel="tolerance",
    )  # fmt: skip
    max_iterations: int = quantity(
        10_000, "1", "the run stops with an error beyond this many", "Riftberg", ge=1, le=10**9, trial=1,
        kernel="max_iterations",
    )  # fmt: skip


class Beams(BondParameters):
    """Bonds between the elements of a berg: beams, or springs."""

    spring: float | None = quantity(
        None, "s-2",
        "stiffness of spring bonds and of contact inside a berg; none means that of the ice between both centres, E / (rho "
        "(R1 + R2)^2)", "KID's spring_coef; none: Riftberg", ge=0, usual=_SPRING, trial=1e-6,
    )  # fmt: skip
    damping: float = quantity(
        1.0, "1", "damping ratio of DEM bonds", "KID's dem_damping_coef", ge=0,
        usual=Usual(0.01, 2.0, "1 is critical damping", off=True), trial=0.5, kernel="bond_damping",
    )  # fmt: skip
    objective_damping: bool = quantity(
        True, "", "damp relative motion at the contact only, so that rigid rotation is free", "Riftberg; quirk Q43",
        kernel="objective_damping",
    )  # fmt: skip
    no_shear: bool = quantity(
        False, "", "leave out shear forces", "equations 5.4, KID's ignore_tangential_force", kernel="no_shear"
    )
    linear_bending: bool = quantity(
        True, "", "bending moment from the angle instead of its sine", "equations 5.4, KID's orig_dem_moment_of_inertia",
        kernel="linear_bending",
    )  # fmt: skip
    max_bonds: int | None = quantity(
        None, "1", "bonds of an interior element; none means 4 for squares and 6 for hexagons", "equations 0.2", ge=0, le=12,
        trial=1,
    )  # fmt: skip
    constant_length: float = quantity(
        0.0, "m", "that length; 0 means the mean of all elements", "equations 1.4", ge=0, usual=_SIZE, trial=590.0,
        kernel="constant_length",
    )  # fmt: skip
    constant_width: float = quantity(
        0.0, "m", "that width; 0 means the mean of all elements", "equations 1.4", ge=0, usual=_SIZE, trial=590.0,
        kernel="constant_width",
    )  # fmt: skip


class BondFracture(Fracture):
    """When a bond breaks: by its own stress."""

    _instead: ClassVar[dict[str, str]] = {
        "criterion": "leave it out; each bond breaks by its own stress",
        "flexural_strength": "leave it out; nothing bends the ice on the sea floor",
        "crevasse_strength": "write fracture.normal_strength",
    }

    normal_strength: float = quantity(
        18e3, "Pa", "largest tensile stress a bond bears", "paper; equations 10.5",
        usual=Usual(1e3, 2e6, "18 kPa for A68a (Huth et al. 2022), 1 MPa in laboratories (Petrovic 2003)"), trial=1e6,
    )  # fmt: skip
    on_substeps: bool = quantity(
        True, "", "test in every sub-step instead of after the long step", "equations 7.2", kernel="fracture_on_substeps",
    )  # fmt: skip
    broken_as_contact: bool = quantity(
        True, "", "a broken bond stays as a contact pair until its ends part",
        "equations 7.2, KID's use_broken_bonds_for_substep_contact", kernel="broken_as_contact",
    )  # fmt: skip
    not_in_first_step: bool = quantity(
        False, "", "no test during the first long step", "equations 7.1, KID's no_frac_first_ts"
    )


class ExplicitStepping(Stepping):
    """Explicit time steps."""

    scheme: Literal["mts", "verlet", "runge_kutta"] = quantity(
        "mts", "", "of quasi_static, mts (multiple time steps), verlet and runge_kutta; quasi_static is of the other engine",
        "equations 6",
    )  # fmt: skip
    frozen: bool = quantity(False, "", "no element moves", "equations 6.1, KID's Static_icebergs")
    substeps: int | None = quantity(
        None, "1", "sub-steps in a long step; none means the stable number", "equations 6.4, KID's mts_sub_steps", ge=1,
        le=10**12, trial=400,
    )  # fmt: skip
    safety: float = quantity(
        0.8, "1", "largest sub-step as a part of the stable one, when the number is found automatically", "Riftberg", gt=0,
        le=1, trial=0.4,
    )  # fmt: skip
    explicit_substeps: bool = quantity(
        True, "", "explicit sub-steps (always with DEM bonds)", "equations 6.4", kernel="explicit_substeps"
    )
    predictor_corrector: bool = quantity(
        True, "", "Runge-Kutta drag by the mean of two speeds, not the speed of the mean", "equations 4.2"
    )
    skip_first_long_force: bool = quantity(
        False, "", "the first long step has no long-step forces", "equations 6.4, KID's skip_first_outer_mts_step"
    )


class Compatibility(Group):
    """Quirks of the reference, each behind one switch; all off here, on where parity needs them.

    The names of the quirks are those of the list of quirks (equations 11).
    """

    inline_break_in_first_step: bool = quirk(
        "Q9: bonds may break in the sub-steps of the first step in spite of not_in_first_step", "equations 7.1"
    )
    flat_relative_velocity: bool = quirk(
        "bonds compare velocities whose axes differ by the convergence of the meridians; a hexagonal berg that rotates then "
        "loads itself", "equations 5.4", kernel="flat_relative_velocity",
    )  # fmt: skip
    zero_start: bool = quirk("Q6: no initial bond force, first sub-step without its first half kick", "equations 6.4")
    forcing_lag: bool = quirk("Q5: long step n uses the forcing of step n-1", "equations 3.3")
    sticky_collision_flags: bool = quirk(
        "Q2: an element once in contact stays in the convergence norm", "equations 6.4", kernel="sticky_collision_flags"
    )
    shared_shear_lever: bool = quirk(
        "Q10: shear torque on the partner uses the first lever arm", "equations 5.4", kernel="shared_shear_lever"
    )
    bond_thickness_of_second: bool = quirk(
        "Q11: contact thickness always adds the difference", "equations 5.4", kernel="bond_thickness_of_second"
    )
    grid_position_round_trip: bool = quantity(
        False, "", "Q40: positions pass through cell coordinates", "equations 8.2", kernel="grid_position_round_trip"
    )
    swapped_implicit_velocity: bool = quirk(
        "Q1: mid-step v uses the implicit x-acceleration", "equations 6.4", kernel="swapped_implicit_velocity"
    )
    uncentred_half_kicks: bool = quirk(
        "half kicks of the long step take half the Coriolis force and of the drag's speed from before the kick: first "
        "order, and inertial motion grows at f^2 dt / 4", "equations 4.3", kernel="uncentred_half_kicks",
    )  # fmt: skip
    explicit_contact_damping: bool = quirk(
        "contact inside a berg is damped explicitly: unstable beyond about 0.2 / sqrt(k)", "equations 5.5",
        kernel="explicit_contact_damping",
    )  # fmt: skip
    frozen_sea_ice_drag: bool = quirk(
        "Q36: motionless sea ice exerts no drag", "equations 4.1", kernel="frozen_sea_ice_drag"
    )
    forces_by_element: bool = quirk(
        "Q34: each element feels waves as a berg of its own, inner ones too, and drag on as many sides as no bond covers; "
        "sides melt by length and width of each element; drift and melt then depend on the size of the elements",
        "equations 4.1",
    )
    rest_length_from_sizes: bool = quirk(
        "the rest length of a bond is the sum of the present radii, so that melting sides strain it", "equations 5.4",
        kernel="rest_length_from_sizes",
    )  # fmt: skip
    bergs_coupled: bool = quirk(
        "contact iteration, sub-steps and constant bond size are common to all bergs of a run, however far apart",
        "equations 6.4",
    )
    plain_kid_branch: bool = quantity(
        False, "", "Q40: repulsion by cell search, attraction by bond", "equations 5.1", kernel="plain_kid_branch",
    )  # fmt: skip
    births_at_centre: bool = quirk(
        "bergs are born on others: all of a cell in its middle, footloose children on the rim of their parent",
        "files 2.4, 3.2",
    )
    elements_stopped_alone: bool = quirk(
        "land stops each element for itself and leaves it its velocity, which tears bonded bergs apart and pushes bergs "
        "into each other", "equations 8.1",
    )  # fmt: skip
    stages_from_start: bool = quirk(
        "a Runge-Kutta stage starts the iteration of its damping, and with predictor_corrector of its drag, from the "
        "velocity of the start of the step", "equations 4.2", kernel="stages_from_start",
    )  # fmt: skip
    contact_by_cells: bool = quirk(
        "partners of contact are looked for in the cells around an element's own, so that bergs wider than a cell meet late",
        "equations 5.1",
    )
    lost_over_edge: bool = quirk(
        "an element that leaves the grid over a closed edge is gone, without melt water", "equations 8.1"
    )
    imposed_velocity_late: bool = quirk(
        "an imposed velocity comes into force at the end of the first step with runge_kutta, and never with mts",
        "equations 4.2",
    )
    flung_debris: bool = quirk(
        "Q42: contact, bonds and loads may fling elements beyond stepping.speed_limit, up to 1000 m/s", "equations 11",
        trial=False,
    )  # fmt: skip
    radius_based: bool = quantity(
        False, "", "side face from the diameter of hexagonal DEM elements", "equations 4, KID's radius_based_drag",
        kernel="radius_based",
    )  # fmt: skip
    damping_by_speed: bool = quantity(
        False, "", "damping of contact is multiplied by the projected relative speed, which makes it quadratic",
        "equations 5.2, KID's scale_damping_by_pmag", kernel="damping_by_speed",
    )  # fmt: skip

    @classmethod
    def kid(cls, **overrides: Any) -> Compatibility:
        """All quirks of motion as KID/iKID has them, and the options that are given."""
        on = {name: True for name, field in section_fields(cls).items() if field_extra(field, "quirk")}
        return cls(**{**on, **overrides})
