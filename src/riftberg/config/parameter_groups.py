"""Typed parameter groups: value, unit, range, one-line meaning and source of everything that can be set.

Each group is a frozen pydantic model that refuses unknown keys and impossible values; `riftberg.parameters` gathers them.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, BeforeValidator, ValidationError, model_validator

from riftberg import constants
from riftberg.config.values import Section, UnfitError, explained, fields_of, key, sections_in
from riftberg.errors import InputError, nearest
from riftberg.system.input_files import value_shown

Scheme = Literal["mts", "verlet", "runge_kutta", "quasi_static"]
BondLaw = Literal["none", "spring", "dem"]
GroundingLaw = Literal["seabed", "none", "linear", "quadratic"]
Capture = Literal["limited", "locked", "none"]
Sediment = Literal["rock", "sand", "clay", "other"]
DeepKeel = Literal["aground", "refuse"]
Packing = Literal["square", "hexagonal"]
MeltMode = Literal["exposed", "berg", "shelf", "mixed"]
BaseLaw = Literal["turbulent", "two_equation", "three_equation"]
RollingScheme = Literal["updated", "weeks_mellor", "legacy"]
FootlooseStyle = Literal["bits", "bergs"]


def quantity(default: Any, unit: str, meaning: str, source: str, **limits: Any) -> Any:
    """Describe one parameter: default, unit, meaning, source and the limits that pydantic checks."""
    return key(default, unit, meaning, source=source, **limits)


class Group(Section):
    """Base of all parameter groups: immutable, unknown keys refused, numbers finite.

    Values may be texts with units (``"18 kPa"``) and numbers of NumPy; mistakes get the words of an experiment file.
    """

    _unknown_key: ClassVar[tuple[str, str]] = ("there is no such parameter", "{} has ")

    # What stands in the place of keys of earlier versions, a sentence each
    _gone: ClassVar[dict[str, str]] = {}

    def __init__(self, /, **given: Any) -> None:
        try:
            super().__init__(**given)
        except ValidationError as error:
            group = type(self)
            outer = any(sections_in(field.annotation) for field in fields_of(group).values())
            raise explained(error, group, name="" if outer else group.__name__) from error

    # Tells pydantic not to call it for groups within groups: the first mistake there would end the search for more.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def _no_section(cls, value: Any) -> UnfitError:
        """Return the refusal of what is no group."""
        remedy = f"Give {cls.__name__}(...) or a dict with {', '.join(fields_of(cls))}"
        return UnfitError(f"{value_shown(value)} is no group of parameters", remedy)

    def __setattr__(self, name: str, value: Any) -> None:
        raise InputError(
            "parameters are not changed in place", where=f"{type(self).__name__}.{name}",
            remedy="Make new ones, such as parameters.changed(fracture={'normal_strength': '20 kPa'})",
        )  # fmt: skip

    def __getattr__(self, name: str) -> Any:
        """Name what there is, with the nearest, for a parameter that is not known."""
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        known = type(self).model_fields
        what = "group" if type(self).__name__ == "Parameters" else "parameter"
        raise AttributeError(
            f"{type(self).__name__} has no {what} {name!r}. {nearest(name, known)}It has {', '.join(known)}"
        )

    def __dir__(self) -> list[str]:
        """List what is of this package for the tab key, not the dozens of names of pydantic; these can be used all the same."""
        foreign = set(dir(BaseModel))
        return sorted(name for name in super().__dir__() if name.startswith("__") or name not in foreign)

    def describe(self) -> str:
        """Return one line per parameter: name, value, unit and meaning."""
        lines = [f"{type(self).__name__}"]
        for name, field in type(self).model_fields.items():
            extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
            unit = str(extra.get("unit", ""))
            lines.append(f"  {name} = {getattr(self, name)} {unit}  {field.description or ''}".rstrip())
        return "\n".join(lines)


class Ice(Group):
    """Properties of the ice."""

    density: float = quantity(
        850.0, "kg m-3", "ice density, sets draft and freeboard", "KID's rho_bergs", gt=0, lt=constants.RHO_SEAWATER
    )


class Drag(Group):
    """Drag of water, air and sea ice on an element."""

    water_side: float = quantity(
        0.9, "1", "form drag of the water on the sides, on 0.5 rho u^2", "Gladstone et al. 2001", ge=0, le=10
    )
    water_base: float = quantity(
        0.0025, "1", "skin drag of the water on the base, on rho u^2",
        "Asay-Davis et al. 2016, base of ice shelves; KID 0.0012", ge=0, le=1,
    )  # fmt: skip
    air_side: float = quantity(
        1.3, "1", "form drag of the air on the sail, on 0.5 rho u^2", "Gladstone et al. 2001", ge=0, le=10
    )
    air_top: float = quantity(
        0.0015, "1", "skin drag of the 10-m wind on the top, on rho u^2",
        "Amory et al. 2017, Antarctic snow, 0.0015 to 0.002; Andreas & Claffey 1995, 0.0013 to 0.0025; KID 0.0055",
        ge=0, le=1,
    )  # fmt: skip
    ice_side: float = quantity(
        0.9, "1", "drag of sea ice on the sides, on 0.5 rho u^2 of its thickness", "Gladstone et al. 2001", ge=0, le=10
    )
    ocean_scale: float = quantity(1.0, "1", "multiplies both ocean drag coefficients", "KID's ocean_drag_scale", ge=0)
    sides_by_bonds: bool = quantity(
        True, "", "side drag only on sides that no bond covers", "equations 4.1, KID's internal_bergs_for_drag"
    )
    rotational: bool = quantity(
        True,
        "",
        "skin drag of the water on a spinning element, so that loose elements come to rest",
        "Riftberg; reference has none",
    )


class PackIce(Group):
    """Sea ice around bergs: what a pack bears and when it holds (quasi_static; explicit schemes drag by thickness alone)."""

    capture: Capture = quantity(
        "limited",
        "",
        "what a pack does beside its drag; limited: it holds a berg by as much as it bears on its front. locked: it carries a "
        "berg along where it is dense and strong, as published models have it. none: nothing",
        "limited: Riftberg; locked: Lichey & Hellmer 2001",
    )
    strength: float = quantity(
        20e3, "Pa", "strength P* of a closed pack per metre of thickness", "Hibler 1979; 20 kPa in Lichey & Hellmer 2001",
        ge=0, le=1e7,
    )  # fmt: skip
    decay: float = quantity(
        20.0,
        "1",
        "how the strength falls with the open water: P = P* h exp(-decay (1 - A))",
        "Hibler 1979",
        ge=0,
        le=1e3,
    )
    least_concentration: float = quantity(
        0.15, "1", "concentration below which the sea counts as open", "Lichey & Hellmer 2001", ge=0, le=1
    )
    locked_concentration: float = quantity(
        0.86, "1", "capture locked: concentration from which on a pack carries bergs along",
        "FESOM-IB (Rackow et al. 2017), whose capture begins there and is complete at 0.9", ge=0, le=1,
    )  # fmt: skip
    locked_strength: float = quantity(
        13e3,
        "N m-1",
        "capture locked: strength P of the pack from which on it does",
        "Lichey & Hellmer 2001",
        ge=0,
        le=1e9,
    )


class Grounding(Group):
    """The sea floor on which keels run aground: a bed of sediment that carries them (seabed), or a drag of explicit schemes."""

    _gone: ClassVar[dict[str, str]] = {
        "cell": "Leave it out: the keel is cut into pads by the length over which the ice bends",
        "depth_error": "Write floor_error.offset for one run; forecasts draw floor_error.spread, share and length",
    }

    law: GroundingLaw | None = quantity(
        None,
        "",
        "law of the sea floor; seabed: a bed that carries the berg and holds it by friction (quasi_static). linear: a drag by "
        "speed, quadratic: by its square and the draft in excess of the depth (mts, verlet, runge_kutta). none: no sea floor. "
        "auto means seabed with quasi_static, else linear",
        "equations 4.1; quadratic, seabed: Riftberg",
    )
    coefficient: float = quantity(
        1e4,
        "kg m-2 s-1",
        "grounding drag of the linear law per base area and speed",
        "KID's cdrag_grounding; paper",
        ge=0,
    )
    quadratic_coefficient: float = quantity(
        0.0,
        "kg m-4",
        "grounding drag of the quadratic law per base area, excess draft and speed squared",
        "Riftberg",
        ge=0,
    )
    ramp_height: float = quantity(0.0, "m", "clearance over which the drag sets in", "KID's h_to_init_grounding", ge=0)
    on_substeps: bool = quantity(
        True, "", "apply in every sub-step (explicit ones of mts) instead of the long step", "equations 6.4 3b"
    )
    implicit: bool = quantity(
        True, "", "apply the sub-step drag implicitly (explicit needs c_g A dt_f / m < 2)", "Riftberg"
    )
    torque: bool = quantity(False, "", "sea floor also damps rotation", "equations 6.4 3c use_grounding_torque")
    sediment: Sediment = quantity(
        "sand", "", "bed of the law seabed, which sets what is left out below; other needs all of it", "Riftberg"
    )
    stiffness: float | None = quantity(
        None, "Pa m-1", "k_v, stiffness of the bed: 1e9 rock, 1e7 sand, 1e6 clay", "order of Terzaghi 1955", gt=0
    )
    bearing_strength: float | None = quantity(
        None,
        "Pa",
        "q_u, pressure at which the bed yields: 1e7 rock (that of ice), 1e6 sand, six times the shear strength on clay",
        "handbook soil mechanics",
        gt=0,
    )
    friction: float | None = quantity(
        None, "1", "Coulomb friction between keel and bed: 0.5", "handbook soil mechanics, 0.3 to 0.6", ge=0
    )
    shear_strength: float | None = quantity(
        None, "Pa", "undrained shear strength, which limits friction: 2e4 clay, others none", "5 to 50 kPa", gt=0
    )
    adhesion: float = quantity(1.0, "1", "part of the shear strength that holds the keel", "Riftberg", gt=0, le=1)
    anchor_way: float = quantity(0.1, "m", "way after which a keel slides over the bed", "Riftberg", gt=0)
    bending: bool = quantity(True, "", "the ice bends where the bed lifts it; off: a rigid berg", "Riftberg")
    ice_modulus: float = quantity(
        9e9, "Pa", "Young's modulus of that bending; 1e9 for warm, crevassed ice", "glacier ice, small strains", gt=0
    )
    start: DeepKeel = quantity(
        "aground",
        "",
        "a keel that starts below the bed: aground, lifted with its load, or refuse, if more than 1 m",
        "Riftberg",
    )


class Contact(Group):
    """Repulsion between bergs and between the pieces of a broken berg.

    In quasi_static faces bear a limited pressure and rub; in mts, verlet and runge_kutta springs and dampers act between centres.
    """

    _gone: ClassVar[dict[str, str]] = {
        "law": "Leave it out: faces crush with stepping.scheme = 'quasi_static', springs act with the other schemes"
    }

    crushing_strength: float = quantity(
        1.5e6,
        "Pa",
        "p_c, largest mean pressure on a face (quasi_static)",
        "Riftberg; small impacts: 25 to 41 MPa",
        gt=0,
    )
    crushing_depth: float = quantity(
        20.0, "m", "a, depth of crushing over which that pressure is reached", "Riftberg", gt=0
    )
    unloading_ratio: float = quantity(
        100.0, "1", "stiffness of unloading over that of loading; faces rebound at one over its root", "Riftberg", ge=1
    )
    friction: float = quantity(0.2, "1", "Coulomb friction between faces (quasi_static)", "Riftberg", ge=0)
    spring: float | None = quantity(
        None,
        "s-2",
        "stiffness between different bergs; none means that of the ice between both centres, E / (rho (R1 + R2)^2)",
        "KID's contact_spring_coef; none: Riftberg",
        ge=0,
    )
    distance: float = quantity(
        0.0,
        "m",
        "contact starts at max(this, R1 + R2): at 0 where the elements touch",
        "KID's contact_distance",
        ge=0,
    )
    on_substeps: bool = quantity(
        True,
        "",
        "contact between bergs acts in the explicit sub-steps of mts; otherwise in the long step, which stiff ice needs shorter",
        "Riftberg; reference: long step",
    )
    critical_damping: bool = quantity(True, "", "radial damping 2 sqrt(k)", "equations 5.2")
    tangential_critical_damping: bool = quantity(False, "", "tangential damping a quarter of critical", "equations 5.2")
    radial_damping: float = quantity(0.0, "s-1", "radial damping where not critical", "KID's radial_damping_coef", ge=0)
    tangential_damping: float = quantity(
        0.0, "s-1", "tangential damping where not critical", "KID's tangental_damping_coef", ge=0
    )
    iterate: bool = quantity(
        True, "", "iterate the velocity coupling to convergence", "equations 6.4, KID's force_convergence"
    )
    tolerance: float = quantity(
        1e-4, "1", "tolerance of that iteration", "equations 6.4, KID's convergence_tolerance", gt=0
    )
    max_iterations: int = quantity(
        10_000, "1", "the run stops with an error beyond this many", "Riftberg", ge=1, le=10**9
    )


class BondParameters(Group):
    """Bonds between the elements of a berg."""

    _gone: ClassVar[dict[str, str]] = {
        "elasticity": "Leave it out: with stepping.scheme = 'quasi_static' the ice is elastic, alike in all directions; with "
        "stepping.scheme = 'mts' its bonds are, as published"
    }

    law: BondLaw = quantity("dem", "", "dem (normal, shear, bending) or spring (KID) or none", "equations 5")
    packing: Packing = quantity("square", "", "square or hexagonal elements", "equations 1.4")
    spring: float | None = quantity(
        None,
        "s-2",
        "stiffness of spring bonds and of contact inside a berg; none means that of the ice between both centres, "
        "E / (rho (R1 + R2)^2)",
        "KID's spring_coef; none: Riftberg",
        ge=0,
    )
    youngs_modulus: float = quantity(
        5e6, "Pa", "Young's modulus E of DEM bonds", "KID's dem_spring_coef", ge=0, le=1e12
    )
    poisson: float = quantity(0.3, "1", "Poisson's ratio of DEM bonds", "equations 0.2", gt=-1, lt=0.5)
    damping: float = quantity(1.0, "1", "damping ratio of DEM bonds", "KID's dem_damping_coef", ge=0)
    objective_damping: bool = quantity(
        True, "", "damp relative motion at the contact only, so that rigid rotation is free", "Riftberg; quirk Q43"
    )
    no_shear: bool = quantity(False, "", "leave out shear forces", "equations 5.4, KID's ignore_tangential_force")
    linear_bending: bool = quantity(
        True, "", "bending moment from the angle instead of its sine", "equations 5.4, KID's orig_dem_moment_of_inertia"
    )
    max_bonds: int | None = quantity(
        None,
        "1",
        "bonds of an interior element; none means 4 for squares and 6 for hexagons",
        "equations 0.2",
        ge=0,
        le=12,
    )
    constant_size: bool = quantity(
        False, "", "use one length and width for all interactions", "equations 1.4, KID's constant_interaction_LW"
    )
    constant_length: float = quantity(0.0, "m", "that length; 0 means the mean of all elements", "equations 1.4", ge=0)
    constant_width: float = quantity(0.0, "m", "that width; 0 means the mean of all elements", "equations 1.4", ge=0)


def _no_stress_of_bonds(criterion: Any) -> Any:
    if criterion == "bond":
        raise UnfitError(
            "the criterion 'bond' is gone",
            "Leave it out: each bond breaks by its own stress with stepping.scheme = 'mts', the ice by its own with "
            "'quasi_static'",
        )
    return criterion


Criterion = Annotated[Literal["ice", "toughness"], BeforeValidator(_no_stress_of_bonds)]


class Fracture(Group):
    """When a bond breaks."""

    enabled: bool = quantity(True, "", "bonds can break", "equations 7, KID's fracture_criterion")
    normal_strength: float | None = quantity(
        18e3,
        "Pa",
        "largest tensile stress a bond bears; none where crevasse_strength is given",
        "paper; equations 10.5",
    )
    crevasse_strength: float | None = quantity(
        None,
        "Pa",
        "tension at the tips of crevasses at which they go on; with it a bond in quasi_static bears the reserve that its "
        "thickness leaves, in place of normal_strength",
        "Riftberg; Vaughan 1993: 90 to 320 kPa where crevasses are seen",
        gt=0,
    )
    shear_strength: float = quantity(100e3, "Pa", "largest shear stress a bond bears", "equations 10.5")
    flexural_strength: float | None = quantity(
        None,
        "Pa",
        "largest bending stress of ice that a bed of sediment lifts (grounding.law seabed); none: bending breaks nothing",
        "Vaughan 1993: 90 to 320 kPa of glacier ice in tension; Aly et al. 2019: 84 kPa by volume for a plate of 200 m",
        gt=0,
    )
    criterion: Criterion | None = quantity(
        None,
        "",
        "what the strengths are compared with in quasi_static; ice: the largest tension and shear of the ice. toughness: the "
        "same, and the toughness at the tips of cracks and rifts of three elements and more. none means ice; explicit schemes "
        "have the stress of each bond alone",
        "Riftberg",
    )
    toughness: float = quantity(
        0.0,
        "Pa m1/2",
        "with 'toughness': fracture toughness K_Ic of the ice, 5e4 to 1.5e5 in laboratories",
        "Petrovic 2003",
        ge=0,
    )
    on_substeps: bool = quantity(True, "", "test in every sub-step instead of after the long step", "equations 7.2")
    broken_as_contact: bool = quantity(
        True,
        "",
        "a broken bond stays as a contact pair until its ends part",
        "equations 7.2, KID's use_broken_bonds_for_substep_contact",
    )
    not_in_first_step: bool = quantity(
        False, "", "no test during the first long step", "equations 7.1, KID's no_frac_first_ts"
    )

    @model_validator(mode="after")
    def _one_tensile_strength(self) -> Fracture:
        if self.crevasse_strength is not None and "normal_strength" not in self.model_fields_set:
            self.__dict__["normal_strength"] = None  # its default; in files it stands as none
        if (self.crevasse_strength is None) == (self.normal_strength is None):
            raise ValueError(
                "the ice has one tensile strength: give either normal_strength, or crevasse_strength, from which it follows"
            )
        return self


class Damage(Group):
    """Strength that bonds lose by the history of their stress; not calibrated for icebergs."""

    enabled: bool = quantity(False, "", "stress takes from the strength of the bonds", "Riftberg")
    threshold: float = quantity(
        0.3, "1", "stress over remaining strength below which nothing happens", "Riftberg", ge=0, lt=1
    )
    time_scale: float = quantity(
        constants.SECONDS_PER_DAY, "s", "time in which a stress at the strength takes all of it", "Riftberg", gt=0
    )
    exponent: float = quantity(2.0, "1", "power of the stress in the rate of damage", "Riftberg", gt=0)


class Stepping(Group):
    """How the equations are stepped in time."""

    _gone: ClassVar[dict[str, str]] = {
        "landing_steps": "Leave it out: on a bed of sediment a landing takes the sub-steps that it needs"
    }

    scheme: Scheme = quantity(
        "quasi_static",
        "",
        "quasi_static, mts, verlet or runge_kutta; mts where sub-steps or spring bonds are set and no scheme is named",
        "equations 6; quasi_static: Riftberg",
    )
    time_step: float = quantity(
        1800.0,
        "s",
        "time step; with mts the long step, which a notice names where stress rings with it",
        "equations 10.5",
        gt=0,
    )
    substeps: int | None = quantity(
        None,
        "1",
        "sub-steps in a long step; none means the stable number",
        "equations 6.4, KID's mts_sub_steps",
        ge=1,
        le=10**12,
    )
    safety: float = quantity(
        0.8,
        "1",
        "largest sub-step as a part of the stable one, when the number is found automatically",
        "Riftberg",
        gt=0,
        le=1,
    )
    explicit_substeps: bool = quantity(True, "", "explicit sub-steps (always with DEM bonds)", "equations 6.4")
    predictor_corrector: bool = quantity(
        True, "", "Runge-Kutta drag by the mean of two speeds, not the speed of the mean", "equations 4.2"
    )
    skip_first_long_force: bool = quantity(
        False, "", "the first long step has no long-step forces", "equations 6.4, KID's skip_first_outer_mts_step"
    )
    only_interactions: bool = quantity(False, "", "leave out all forces of ocean, air and floor", "equations 4.2")
    frozen: bool = quantity(False, "", "no element moves", "equations 6.1 Static_icebergs")
    fixed_velocity: tuple[float, float] | None = quantity(
        None, "m s-1", "impose this velocity on all elements", "equations 4.2, KID's override_iceberg_velocities"
    )
    interactions: bool = quantity(True, "", "bergs act on each other", "KID's interactive_icebergs_on")
    speed_limit: float = quantity(
        10.0,
        "m s-1",
        "speed that no ice reaches: an element beyond it ends the run (not KID's speed_limit)",
        "Riftberg",
        gt=0,
    )


class Earth(Group):
    """Coordinates."""

    latlon: bool = quantity(True, "", "positions in degrees; otherwise metres", "equations 2")
    radius: float = quantity(constants.EARTH_RADIUS_A68, "m", "radius of the sphere", "equations 10.5", gt=0)
    period: float = quantity(
        360.0,
        "degree or m",
        "zonal period, 0 or less if there is none; the default of 360 means none where positions are metres",
        "equations 2.4, KID's Lx",
    )
    f_plane: bool = quantity(False, "", "constant Coriolis parameter", "equations 2.6")
    reference_latitude: float = quantity(
        0.0, "degree", "latitude of the f-plane and of Cartesian runs", "equations 2.6", ge=-90, le=90
    )

    @model_validator(mode="before")
    @classmethod
    def _degrees_are_no_metres(cls, given: Any) -> Any:
        """Take the default of 360 as no period where positions are metres: nothing is periodic after 360 m."""
        if (
            isinstance(given, dict)
            and given.get("latlon") in (False, 0, "false")
            and given.get("period", 360.0) == 360.0
        ):
            return {**given, "period": 0.0}
        return given


class Melt(Group):
    """Melt of sides, base and by waves, and the bergy bits that waves break off."""

    enabled: bool = quantity(False, "", "bergs melt", "files 1")
    mode: MeltMode = quantity(
        "exposed",
        "",
        "exposed: sides where no bond covers them, base by the law below; berg: all sides of every element; "
        "shelf: the base alone; mixed: blended by the part of the sides that bonds cover",
        "files 1.2 to 1.4; exposed: Riftberg",
    )
    base: BaseLaw = quantity(
        "three_equation",
        "",
        "law of the base: turbulent (small bergs), two or three equations of the layer under an ice shelf; "
        "shelf and mixed know the last two only, berg the first",
        "files 1.2, 1.5",
    )
    temperature: float | None = quantity(
        None, "degree_Celsius", "of the sea, everywhere; none means that of the forcing", "Riftberg", ge=-3, le=40
    )
    salinity: float | None = quantity(
        None, "1e-3", "of the sea, everywhere; none means that of the forcing", "Riftberg", ge=0, le=50
    )
    salinity_from_ocean: bool = quantity(
        True,
        "",
        "the law of the base takes the salinity of the ocean; otherwise 35",
        "files 1.4 use_mixed_layer_salinity_for_thermo",
    )
    split: bool = quantity(
        True, "", "base, sides and waves act one after the other, so that their losses add up", "files 1.6"
    )
    bits_fraction: float = quantity(
        0.0, "1", "part of what waves erode that becomes bergy bits", "files 1.9 bergy_bit_erosion_fraction", ge=0, le=1
    )
    const_gamma: bool = quantity(
        True, "", "constant exchange coefficients in the three equations; otherwise by the boundary layer", "files 1.5"
    )
    gamma_t: float = quantity(0.022, "1", "that coefficient for heat; for salt a 35th", "files 1.5 Gamma_T_3EQ", gt=0)
    friction_drag: float = quantity(1.5e-3, "1", "drag coefficient of water at the base", "files 1.5", ge=0)
    least_friction: float = quantity(1e-3, "m s-1", "smallest friction velocity", "files 1.5 ustar_icebergs_bg", ge=0)
    tide: float = quantity(
        0.0,
        "m s-1",
        "speed of tides that the current lacks, at the base; not in the turbulent law of mode berg and mixed",
        "files 1.5 utide_icebergs",
        ge=0,
    )
    least_gap: float | None = quantity(
        None,
        "m",
        "water under the keel below which the base does not melt; none means no such limit",
        "files 1.4",
        ge=0,
    )


class Rolling(Group):
    """When bergs of one element roll over; elements with bonds never do."""

    enabled: bool = quantity(False, "", "narrow bergs roll over", "files 1.11 allow_bergs_to_roll")
    scheme: RollingScheme = quantity(
        "updated",
        "",
        "updated (width against thickness), weeks_mellor, or legacy, which is known to be wrong",
        "files 1.11",
    )
    tip: float = quantity(
        0.0,
        "1",
        "with updated: rolls where this times the thickness exceeds the width; 0 means by density",
        "files 1.11",
    )


class Footloose(Group):
    """Pieces that the buoyancy of a submerged foot breaks from the edge; waves make the foot, so melt must be on."""

    enabled: bool = quantity(False, "", "edges calve by the footloose mechanism", "files 2")
    youngs: float = quantity(1e7, "Pa", "Young's modulus of the bending edge", "files 2.1 fl_youngs", gt=0)
    strength: float = quantity(250e3, "Pa", "yield stress of the edge", "files 2.1 fl_strength", gt=0)
    style: FootlooseStyle = quantity(
        "bits", "", "pieces are kept as bits of the parent, or become bergs at once", "files 2.3 fl_style"
    )
    displace: bool = quantity(True, "", "children start on the rim of the parent", "files 2.4 displace_fl_bergs")
    berg_mass: float = quantity(
        1e12, "kg", "mass of bits from which a berg is made", "files 2.3 new_berg_from_fl_bits_mass_thres", gt=0
    )
    seed: int = quantity(0, "1", "of the random places on the rim", "Riftberg", ge=0, le=2**63 - 1)


class ClassTable(Group):
    """Size classes into which the ice that leaves the land is put; lists of one length."""

    mass: tuple[float, ...] = quantity((), "kg", "mass of one berg", "files 3.1")
    fraction: tuple[float, ...] = quantity((), "1", "part of the ice; what no class takes is not calved", "files 3.1")
    scaling: tuple[float, ...] = quantity((), "1", "number of bergs that one element stands for", "files 3.1")
    thickness: tuple[float, ...] = quantity((), "m", "thickness of the bergs", "files 3.1")

    @model_validator(mode="after")
    def _one_length(self) -> ClassTable:
        lengths = {name: len(getattr(self, name)) for name in type(self).model_fields}
        if len(set(lengths.values())) != 1 or not self.mass:
            raise ValueError(f"the lists of size classes must have one length: {lengths}")
        for name in ("mass", "scaling", "thickness"):
            if min(getattr(self, name)) <= 0.0:
                raise ValueError(f"{name} of a size class is {min(getattr(self, name)):g}: give numbers above 0")
        if min(self.fraction) < 0.0 or not 0.0 < sum(self.fraction) <= 1.0 + 1e-9:
            raise ValueError(f"fractions sum to {sum(self.fraction):g}: give parts of 0 or more that sum to at most 1")
        return self


SOUTHERN_CLASSES = ClassTable(
    mass=(8.8e7, 4.1e8, 3.3e9, 1.8e10, 3.8e10, 7.5e10, 1.2e11, 2.2e11, 3.9e11, 7.4e11),
    fraction=(0.24, 0.12, 0.15, 0.18, 0.12, 0.07, 0.03, 0.03, 0.03, 0.02),
    scaling=(2000.0, 200.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 1.0, 1.0),
    thickness=(40.0, 67.0, 133.0, 175.0, 250.0, 250.0, 250.0, 250.0, 250.0, 250.0),
)
"""Size classes of the Southern Ocean (files 3.1)."""

NORTHERN_CLASSES = ClassTable(
    mass=(4.58e8, 3.61e9, 1.22e10, 2.91e10, 5.09e10, 7.34e10, 1.15e11, 1.65e11, 2.94e11, 5.59e11),
    fraction=(0.14, 0.15, 0.20, 0.15, 0.08, 0.07, 0.05, 0.05, 0.05, 0.05),
    scaling=(200.0, 50.0, 25.0, 13.0, 8.0, 5.0, 2.0, 1.0, 1.0, 1.0),
    thickness=(80.4, 159.5, 240.0, 320.0, 360.0, 360.0, 360.0, 360.0, 360.0, 360.0),
)
"""Size classes of the north, where a run is to have its own (files 3.1)."""


class Calving(Group):
    """Bergs from the flux of ice that leaves the land; acts where an ocean model hands one over."""

    south: ClassTable = quantity(SOUTHERN_CLASSES, "", "size classes of the south", "files 3.1")
    north: ClassTable | None = quantity(
        None, "", "size classes of the north; none means those of the south", "files 3.1"
    )
    fractions: Literal["mass", "number"] = quantity(
        "mass", "", "what the fractions of the classes are parts of", "files 3.1 input_freq_distribution"
    )
    length_over_width: float = quantity(1.5, "1", "shape of a new berg", "files 3.1 LoW_ratio", gt=0)
    smoothing_time: float = quantity(
        0.0, "s", "time over which the flux is averaged; 0 takes it as it comes", "files 3.2 tau_calving", ge=0
    )


OF_NAMELISTS = (
    "plain_kid_branch", "grid_position_round_trip",
    "radius_based", "damping_by_speed", "zero_rates", "keep_shape", "one_draw",
)  # fmt: skip
"""Switches of `Compatibility` that the reference's namelists, and its kinds of grid, turn on: no quirks of every run."""


QUIRKS_OF_MOTION = (
    "inline_break_in_first_step", "flat_relative_velocity", "zero_start", "forcing_lag", "sticky_collision_flags",
    "shared_shear_lever", "bond_thickness_of_second", "grid_position_round_trip", "swapped_implicit_velocity",
    "uncentred_half_kicks", "explicit_contact_damping", "frozen_sea_ice_drag", "forces_by_element", "rest_length_from_sizes",
    "bergs_coupled", "plain_kid_branch", "elements_stopped_alone", "stages_from_start", "contact_by_cells", "lost_over_edge",
    "imposed_velocity_late", "flung_debris", "radius_based", "damping_by_speed",
    "births_at_centre",  # bergs on top of each other, which contact parts only from a zero start
)  # fmt: skip
"""Switches of `Compatibility` that the explicit schemes alone need; the others are of melt, footloose calving and births."""


class Compatibility(Group):
    """Quirks of the reference, each behind one switch; all off here, on where parity needs them.

    The names of the quirks are those of the list of quirks (equations 11).
    """

    inline_break_in_first_step: bool = quantity(
        False,
        "",
        "Q9: bonds may break in the sub-steps of the first step in spite of not_in_first_step",
        "equations 7.1",
    )
    flat_relative_velocity: bool = quantity(
        False,
        "",
        "bonds compare velocities whose axes differ by the convergence of the meridians; a hexagonal berg that rotates "
        "then loads itself",
        "equations 5.4",
    )
    zero_start: bool = quantity(
        False, "", "Q6: no initial bond force, first sub-step without its first half kick", "equations 6.4"
    )
    forcing_lag: bool = quantity(False, "", "Q5: long step n uses the forcing of step n-1", "equations 3.3")
    sticky_collision_flags: bool = quantity(
        False, "", "Q2: an element once in contact stays in the convergence norm", "equations 6.4"
    )
    shared_shear_lever: bool = quantity(
        False, "", "Q10: shear torque on the partner uses the first lever arm", "equations 5.4"
    )
    bond_thickness_of_second: bool = quantity(
        False, "", "Q11: contact thickness always adds the difference", "equations 5.4"
    )
    grid_position_round_trip: bool = quantity(
        False, "", "Q40: positions pass through cell coordinates", "equations 8.2"
    )
    swapped_implicit_velocity: bool = quantity(
        False, "", "Q1: mid-step v uses the implicit x-acceleration", "equations 6.4"
    )
    uncentred_half_kicks: bool = quantity(
        False,
        "",
        "half kicks of the long step take half the Coriolis force and of the drag's speed from before the kick: first order, "
        "and inertial motion grows at f^2 dt / 4",
        "equations 4.3",
    )
    explicit_contact_damping: bool = quantity(
        False, "", "contact inside a berg is damped explicitly: unstable beyond about 0.2 / sqrt(k)", "equations 5.5"
    )
    frozen_sea_ice_drag: bool = quantity(False, "", "Q36: motionless sea ice exerts no drag", "equations 4.1")
    forces_by_element: bool = quantity(
        False,
        "",
        "Q34: each element feels waves as a berg of its own, inner ones too, and drag on as many sides as no bond covers; "
        "sides melt by length and width of each element; drift and melt then depend on the size of the elements",
        "equations 4.1",
    )
    rest_length_from_sizes: bool = quantity(
        False,
        "",
        "the rest length of a bond is the sum of the present radii, so that melting sides strain it",
        "equations 5.4",
    )
    bergs_coupled: bool = quantity(
        False,
        "",
        "contact iteration, sub-steps and constant bond size are common to all bergs of a run, however far apart",
        "equations 6.4",
    )
    plain_kid_branch: bool = quantity(
        False, "", "Q40: repulsion by cell search, attraction by bond", "equations 5.1 branch B"
    )
    bits_melt_at_zero_rates: bool = quantity(
        False, "", "T5: bits melt although zero_rates says that nothing does", "files 1.4"
    )
    plain_basal_search: bool = quantity(
        False,
        "",
        "T6, T7: the flux of buoyancy under the base is evaluated once, the salinity at the ice by plain iteration",
        "files 1.5",
    )
    scaled_laminar_layer: bool = quantity(
        False,
        "",
        "T52: the boundary layer under the base divides the term of its laminar part by the constant of von Karman too, "
        "with which the base melts about 14 % slower than in the cited source; without const_gamma only",
        "files 1.5",
    )
    element_length_in_base_law: bool = quantity(
        False, "", "the turbulent law of the base takes the length of the element, not of its berg", "files 1.2"
    )
    half_west_rim: bool = quantity(
        False, "", "T11: children on the west side start in its middle half only", "files 2.4"
    )
    bits_always_roll: bool = quantity(False, "", "T12: footloose bits roll although rolling is off", "files 2.5")
    rolls_on: bool = quantity(
        False,
        "",
        "T53: a berg lighter than 808 kg m-3 rolls although it is wider than thick, at every step",
        "files 1.11",
    )
    unplaced_child_in_metres: bool = quantity(
        False, "", "T13: where a child finds no cell, corners are tried in metres, on degrees too", "files 2.6"
    )
    drop_orphan_bits: bool = quantity(
        False, "", "T44: bits of footloose bits vanish with these, without melt water", "files 1.9"
    )
    footloose_sets_density: bool = quantity(
        False, "", "T45: a berg that footloose calving cuts gets the density of the parameters", "files 2.3"
    )
    heat_of_one_class: bool = quantity(
        False, "", "T16: a new berg gets the heat of all classes over the ice of its own", "files 3.2"
    )
    births_at_centre: bool = quantity(
        False,
        "",
        "bergs are born on others: all of a cell in its middle, footloose children on the rim of their parent",
        "files 2.4, 3.2",
    )
    elements_stopped_alone: bool = quantity(
        False,
        "",
        "land stops each element for itself and leaves it its velocity, which tears bonded bergs apart and pushes bergs "
        "into each other",
        "equations 8.1",
    )
    stages_from_start: bool = quantity(
        False,
        "",
        "a Runge-Kutta stage starts the iteration of its damping, and with predictor_corrector of its drag, from the velocity "
        "of the start of the step",
        "equations 4.2",
    )
    contact_by_cells: bool = quantity(
        False,
        "",
        "partners of contact are looked for in the cells around an element's own, so that bergs wider than a cell meet late",
        "equations 5.1",
    )
    lost_over_edge: bool = quantity(
        False, "", "an element that leaves the grid over a closed edge is gone, without melt water", "equations 8.1"
    )
    imposed_velocity_late: bool = quantity(
        False,
        "",
        "an imposed velocity comes into force at the end of the first step with runge_kutta, and never with mts",
        "equations 4.2",
    )
    flung_debris: bool = quantity(
        False,
        "",
        "Q42: contact, bonds and loads may fling elements beyond stepping.speed_limit, up to 1000 m/s",
        "equations 11",
    )
    hemisphere_by_corner: bool = quantity(
        False, "", "T43: the north-east corner of a cell says of which hemisphere its size classes are", "files 3.1"
    )

    # Options of the reference's namelists, off by default there too.
    radius_based: bool = quantity(
        False, "", "side face from the diameter of hexagonal DEM elements", "equations 4, KID's radius_based_drag"
    )
    damping_by_speed: bool = quantity(
        False,
        "",
        "damping of contact is multiplied by the projected relative speed, which makes it quadratic",
        "equations 5.2, KID's scale_damping_by_pmag",
    )
    sea_ice_shift: float = quantity(
        0.0, "1", "added to the sea-ice fraction in the law by which waves erode", "files 1.2 sicn_shift", ge=-1, le=1
    )
    zero_rates: bool = quantity(
        False, "", "all rates of melt are zero, rolling stays", "files 1.4 set_melt_rates_to_zero"
    )
    keep_shape: bool = quantity(
        False, "", "the ocean gets the melt, but bergs stay as they are", "files 1.12 Iceberg_melt_without_decay"
    )
    one_draw: bool = quantity(False, "", "all footloose children start at the same part of the rim", "files 2.2")

    @classmethod
    def kid(cls, **overrides: Any) -> Compatibility:
        """All switches as KID/iKID behaves, except those given."""
        quirks = [
            name for name, field in fields_of(cls).items() if field.annotation is bool and name not in OF_NAMELISTS
        ]
        on = dict.fromkeys(quirks, True)
        return cls(**{**on, **overrides})
