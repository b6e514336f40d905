"""From KID's namelists to Riftberg's parameters, with KID's derived rules.

Source: equations 0.2, 5.1, 6.4, 7 and the catalogue of quirks (11).
"""

from __future__ import annotations

import math
import sys
from typing import Any, Final

from riftberg.errors import InputError
from riftberg.kid.namelist import KidNamelist, NamelistGroup, check_supported
from riftberg.parameters import BondLaw, Compatibility, Parameters, Scheme
from riftberg.stepping.speed_limit import DEBRIS_SPEED
from riftberg.system.limits import extreme_allowed

LONGEST_STEP: Final = 864_000.0
"""Longest long step that is taken, s (10 days)."""

NEVER: Final = sys.float_info.max
"""Threshold of a stress that never breaks a bond, Pa."""


def to_parameters(namelist: KidNamelist) -> Parameters:
    """Return the physics of the namelist with the numerics and quirks of the reference."""
    check_supported(namelist)
    group = namelist.icebergs
    _check_scheme(group)
    try:
        return Parameters(**_groups(group, time_step(namelist)))
    except InputError as error:
        place = f"{error.where}: " if error.where else ""
        raise group.error(f"gives {place}{error.what}", "Correct that entry") from error


def time_step(namelist: KidNamelist) -> float:
    """Return the long step (s) after a check."""
    name = "dt" if namelist.coupled else "ibdt"
    dt = namelist.driver.number(name)
    if dt <= 0:
        raise namelist.driver.error(f"{name} = {dt} is no time step", "Give a positive number of seconds")
    if dt > LONGEST_STEP:
        raise namelist.driver.error(
            f"{name} = {dt:g} s is longer than {LONGEST_STEP:g} s", "Give minutes or hours, in s"
        )
    return dt


def uses_dem(group: NamelistGroup) -> bool:
    """Whether DEM bonds act; without ``mts`` they do not (quirk Q25)."""
    return group.flag("dem") and group.flag("mts") and group.flag("iceberg_bonds_on")


def bond_law(group: NamelistGroup) -> BondLaw:
    """Return the law of the bonds."""
    if not group.flag("iceberg_bonds_on"):
        return "none"
    return "dem" if uses_dem(group) else "spring"


def scheme(group: NamelistGroup) -> Scheme:
    """Return the stepping scheme; ``mts`` overrides ``Runge_not_Verlet``."""
    if group.flag("mts"):
        return "mts"
    return "runge_kutta" if group.flag("Runge_not_Verlet") else "verlet"


def contact_stiffness(group: NamelistGroup) -> float:
    """Return the stiffness between bergs (s-2); ``spring_coef`` where none is given."""
    stated = group.number("contact_spring_coef")
    return stated if stated > 0 else group.number("spring_coef")


def namelist_period(group: NamelistGroup) -> float:
    """Return the zonal period; the default of 360 means none on a Cartesian grid."""
    stated = group.number("Lx")
    return -1.0 if stated == 360.0 and not group.flag("grid_is_latlon") else stated


def substeps(group: NamelistGroup, dt: float) -> int:
    """Return the number of sub-steps; -1 asks for ``ceil(dt / (0.3 / sqrt(spring_coef)))``."""
    stated = group.whole("mts_sub_steps")
    if stated >= 1 or not group.flag("mts"):
        return max(stated, 1)
    spring = group.number("spring_coef")
    if stated != -1 or spring <= 0:
        raise group.error(
            f"mts_sub_steps = {stated} with spring_coef = {spring} gives no sub-steps", "Give a positive mts_sub_steps"
        )
    return math.ceil(dt / (0.3 / math.sqrt(spring)))


def is_plain_kid(group: NamelistGroup) -> bool:
    """Whether repulsion comes from the cell search and attraction from the bonds (branch B of section 5.1)."""
    far = group.number("contact_distance") > 0
    return not (group.flag("mts") or far or contact_stiffness(group) != group.number("spring_coef"))


def _check_scheme(group: NamelistGroup) -> None:
    if group.flag("dem") and scheme(group) == "runge_kutta":
        raise group.error("dem = .true. with Runge_not_Verlet = .true.", "Set Runge_not_Verlet = .false.")
    if group.flag("footloose") and scheme(group) == "runge_kutta":
        raise group.error("footloose = .true. with Runge_not_Verlet = .true.", "Set Runge_not_Verlet = .false.")
    if group.flag("footloose") and not group.flag("use_operator_splitting"):
        raise group.error(
            "footloose = .true. with use_operator_splitting = .false.", "Set use_operator_splitting = .true."
        )


def _groups(group: NamelistGroup, dt: float) -> dict[str, dict[str, Any]]:
    return {
        "ice": {"density": group.number("rho_bergs")},
        "drag": _drag_parameters(group),
        "grounding": _grounding(group),
        "contact": _contact(group),
        "bonds": _bond_parameters(group),
        "fracture": _fracture(group),
        "stepping": _stepping(group, dt),
        "earth": _earth(group),
        **life_groups(group),
        "calving": _calving(group),
        "compatibility": _compatibility(group).model_dump(),
    }


def _drag_parameters(group: NamelistGroup) -> dict[str, Any]:
    return {
        "ocean_scale": group.number("ocean_drag_scale"),
        "sides_by_bonds": group.flag("internal_bergs_for_drag"),
        "radius_based": group.flag("radius_based_drag") and group.flag("hexagonal_icebergs") and uses_dem(group),
        "rotational": False,
    }


def _grounding(group: NamelistGroup) -> dict[str, Any]:
    return {
        "coefficient": group.number("cdrag_grounding"),
        "ramp_height": max(group.number("h_to_init_grounding"), 0.0),
        "on_substeps": group.flag("short_step_mts_grounding") and group.flag("mts"),
        "implicit": False,
        "torque": group.flag("use_grounding_torque"),
    }


def _contact(group: NamelistGroup) -> dict[str, Any]:
    return {
        "spring": contact_stiffness(group),
        "on_substeps": False,
        "distance": max(group.number("contact_distance"), 0.0),
        "critical_damping": group.flag("critical_interaction_damping_on"),
        "tangential_critical_damping": group.flag("tang_crit_int_damp_on"),
        "radial_damping": group.number("radial_damping_coef"),
        "tangential_damping": group.number("tangental_damping_coef"),
        "damping_by_speed": group.flag("scale_damping_by_pmag"),
        "iterate": group.flag("force_convergence"),
        "tolerance": group.number("convergence_tolerance"),
    }


def _bond_parameters(group: NamelistGroup) -> dict[str, Any]:
    return {
        "law": bond_law(group),
        "packing": "hexagonal" if group.flag("hexagonal_icebergs") else "square",
        "spring": group.number("spring_coef"),
        "youngs_modulus": group.number("dem_spring_coef"),
        "poisson": group.number("poisson"),
        "damping": group.number("dem_damping_coef"),
        "objective_damping": False,
        "no_shear": group.flag("ignore_tangential_force"),
        "linear_bending": group.flag("orig_dem_moment_of_inertia"),
        "max_bonds": group.whole("max_bonds") if group.flag("iceberg_bonds_on") else 0,
        "constant_size": group.flag("constant_interaction_LW"),
        "constant_length": group.number("constant_length"),
        "constant_width": group.number("constant_width"),
    }


def _fracture(group: NamelistGroup) -> dict[str, Any]:
    """Map the fracture entries (sections 7.1, 7.2; quirks Q8, Q9).

    In sub-steps the thresholds count as they stand. After the long step a threshold of 0 or less means never, and
    two of them mean that nothing is tested, whatever the criterion.
    """
    normal = group.number("frac_thres_n") * group.number("frac_thres_scaling")
    shear = group.number("frac_thres_t") * group.number("frac_thres_scaling")
    inline = group.flag("break_bonds_on_sub_steps")
    enabled = uses_dem(group) and (inline or normal > 0 or shear > 0)
    if enabled:
        _check_criterion(group, inline)
    if not inline:
        normal, shear = (value if value > 0 else NEVER for value in (normal, shear))
    return {
        "enabled": enabled,
        "normal_strength": normal,
        "shear_strength": shear,
        "on_substeps": inline,
        "broken_as_contact": group.flag("use_broken_bonds_for_substep_contact") and inline,
        "not_in_first_step": group.flag("no_frac_first_ts"),
    }


def _check_criterion(group: NamelistGroup, inline: bool) -> None:
    criterion = group.text("fracture_criterion")
    if criterion.lower() == "stress":
        return
    cause = "break_bonds_on_sub_steps = .true." if inline else "positive frac_thres_n or frac_thres_t"
    raise group.error(
        f"fracture_criterion = '{criterion}' with {cause}",
        "Set fracture_criterion = 'stress', or switch fracture off",
    )


def _calving(group: NamelistGroup) -> dict[str, Any]:
    """Map calving (files, 3); the smoothing time is divided by the seconds of a year (quirk T14)."""
    south = ("initial_mass", "distribution", "mass_scaling", "initial_thickness")
    north = ("initial_mass_n", "distribution_n", "mass_scaling_n", "initial_thickness_n")
    ours = ("mass", "fraction", "scaling", "thickness")
    tables = [{k: group.numbers(name) for k, name in zip(ours, names, strict=True)} for names in (south, north)]
    return {
        "south": tables[0],
        "north": tables[1] if group.flag("separate_distrib_for_n_hemisphere") else None,
        "fractions": "number" if group.flag("input_freq_distribution") else "mass",
        "length_over_width": group.number("LoW_ratio"),
        "smoothing_time": max(group.number("tau_calving"), 0.0) / (365.0 * 24.0 * 60.0 * 60.0),
    }


def _stepping(group: NamelistGroup, dt: float) -> dict[str, Any]:
    fixed = (group.number("u_override"), group.number("v_override"))
    return {
        "scheme": scheme(group),
        "time_step": dt,
        "substeps": substeps(group, dt),
        "explicit_substeps": group.flag("explicit_inner_mts") or group.flag("dem"),
        "predictor_corrector": group.flag("use_new_predictive_corrective"),
        "skip_first_long_force": group.flag("skip_first_outer_mts_step"),
        "only_interactions": group.flag("only_interactive_forces"),
        "frozen": group.flag("Static_icebergs"),
        "fixed_velocity": fixed if group.flag("override_iceberg_velocities") else None,
        "interactions": group.flag("interactive_icebergs_on"),
        **({"speed_limit": DEBRIS_SPEED} if extreme_allowed() else {}),
    }


def _earth(group: NamelistGroup) -> dict[str, Any]:
    return {
        "latlon": group.flag("grid_is_latlon"),
        "radius": group.number("Rearth"),
        "period": namelist_period(group),
        "f_plane": group.flag("use_f_plane"),
        "reference_latitude": group.number("lat_ref"),
    }


def _compatibility(group: NamelistGroup) -> Compatibility:
    plain = is_plain_kid(group)
    return Compatibility.kid(
        shared_shear_lever=group.flag("save_bond_forces"),
        grid_position_round_trip=plain,
        plain_kid_branch=plain,
    )


_TIP_OF_SCHEME_TWO: Final = 999.0


def life_groups(group: NamelistGroup) -> dict[str, dict[str, Any]]:
    """Return the parameter groups ``melt``, ``rolling`` and ``footloose`` of a namelist."""
    return {"melt": _melt(group), "rolling": _rolling(group), "footloose": _footloose(group)}


def _melt(group: NamelistGroup) -> dict[str, Any]:
    shelf, mixed = group.flag("melt_icebergs_as_ice_shelf"), group.flag("use_mixed_melting")
    equations = "three_equation" if group.flag("Use_three_equation_model") else "two_equation"
    cutoff = group.number("melt_cutoff")
    return {
        "enabled": True,
        "mode": "mixed" if mixed else ("shelf" if shelf else "berg"),
        "base": equations if mixed or shelf else "turbulent",
        "salinity_from_ocean": group.flag("use_mixed_layer_salinity_for_thermo"),
        "split": group.flag("use_operator_splitting"),
        "sea_ice_shift": group.number("sicn_shift"),
        "bits_fraction": max(group.number("bergy_bit_erosion_fraction"), 0.0),
        "zero_rates": group.flag("set_melt_rates_to_zero"),
        "keep_shape": group.flag("Iceberg_melt_without_decay"),
        "const_gamma": group.flag("const_gamma"),
        "gamma_t": group.number("Gamma_T_3EQ"),
        "friction_drag": group.number("cdrag_icebergs"),
        "least_friction": group.number("ustar_icebergs_bg"),
        "tide": group.number("utide_icebergs"),
        "least_gap": cutoff if cutoff >= 0.0 and group.flag("apply_thickness_cutoff_to_bergs_melt") else None,
    }


def _rolling(group: NamelistGroup) -> dict[str, Any]:
    tip = group.number("tip_parameter")
    older = "weeks_mellor" if tip >= _TIP_OF_SCHEME_TWO else "legacy"
    scheme = "updated" if group.flag("use_updated_rolling_scheme") else older
    return {"enabled": group.flag("allow_bergs_to_roll"), "scheme": scheme, "tip": tip}


def _footloose(group: NamelistGroup) -> dict[str, Any]:
    return {
        "enabled": group.flag("footloose"),
        "youngs": group.number("fl_youngs"),
        "strength": 1000.0 * group.number("fl_strength"),
        "style": "bergs" if group.text("fl_style") == "new_bergs" else "bits",
        "displace": group.flag("displace_fl_bergs"),
        "one_draw": group.flag("fl_init_child_xy_by_pe"),
        "berg_mass": group.number("new_berg_from_fl_bits_mass_thres"),
    }
