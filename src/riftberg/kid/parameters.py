"""From KID's namelists to Riftberg's parameters, with KID's derived rules; checks before the first step.

Source: equations 0.2, 5.1, 6.4, 7 and the catalogue of quirks (11).
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.errors import BergError, InputError
from riftberg.kid.entries import REALS_SIZE
from riftberg.kid.namelist import KidNamelist, NamelistGroup, check_supported
from riftberg.kid.restart import CALVING_FILE, DENSITIES, id_text, read_stores, split_id
from riftberg.ocean.grid import Grid
from riftberg.parameters import Compatibility, Packing, Parameters, Scheme
from riftberg.state import Bonds, Elements
from riftberg.stepping.speed_limit import DEBRIS_SPEED
from riftberg.system.limits import extreme_allowed

LONGEST_STEP: Final = 864_000.0
"""Longest long step that is taken, s (10 days)."""

NEVER: Final = sys.float_info.max
"""Threshold of a stress that never breaks a bond, Pa."""

TIP_OF_SCHEME_TWO: Final = 999.0
"""KID's ``tip_parameter`` from which its second scheme of rolling acts."""


def to_parameters(namelist: KidNamelist) -> Parameters:
    """Return the physics of the namelist with the numerics and quirks of the reference."""
    check_supported(namelist)
    group = namelist.icebergs
    if group.number("rho_bergs") < DENSITIES[0]:
        raise group.error(
            f"rho_bergs = {group.number('rho_bergs'):g} kg m-3 is no density of ice",
            f"Give it in kg m-3: ice has {DENSITIES[0]:g} to {DENSITIES[1]:g}",
        )
    if group.flag("dem") and scheme(group) == "runge_kutta":
        raise group.error("dem = .true. with Runge_not_Verlet = .true.", "Set Runge_not_Verlet = .false.")
    if group.flag("footloose") and scheme(group) == "runge_kutta":
        raise group.error("footloose = .true. with Runge_not_Verlet = .true.", "Set Runge_not_Verlet = .false.")
    if group.flag("footloose") and not group.flag("use_operator_splitting"):
        raise group.error(
            "footloose = .true. with use_operator_splitting = .false.", "Set use_operator_splitting = .true."
        )
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


def scheme(group: NamelistGroup) -> Scheme:
    """Return the stepping scheme; ``mts`` overrides ``Runge_not_Verlet``."""
    if group.flag("mts"):
        return "mts"
    return "runge_kutta" if group.flag("Runge_not_Verlet") else "verlet"


def contact_stiffness(group: NamelistGroup) -> float:
    """Return the stiffness between bergs (s-2); ``spring_coef`` where none is given."""
    stated = group.number("contact_spring_coef")
    if (
        stated < 0.0
    ):  # the reference takes it for 0; a slip of sign would make ice a thousand times as soft without a word
        raise group.error(
            f"contact_spring_coef = {stated:g} is below 0", "Give 0 for that of spring_coef, or a stiffness"
        )
    return stated if stated > 0.0 else group.number("spring_coef")


def namelist_period(group: NamelistGroup) -> float:
    """Return the zonal period; the default of 360 means none on a Cartesian grid."""
    stated = group.number("Lx")
    return -1.0 if stated == 360.0 and not group.flag("grid_is_latlon") else stated


def substeps(group: NamelistGroup, dt: float) -> int:
    """Return the number of sub-steps; -1 means ``ceil(dt / (0.3 / sqrt(spring_coef)))``."""
    stated = group.whole("mts_sub_steps")
    if stated >= 1 or not group.flag("mts"):
        return max(stated, 1)
    spring = group.number("spring_coef")
    if stated != -1 or spring <= 0:
        raise group.error(
            f"mts_sub_steps = {stated} with spring_coef = {spring} gives no sub-steps", "Give a positive mts_sub_steps"
        )
    return math.ceil(dt / (0.3 / math.sqrt(spring)))


def _groups(group: NamelistGroup, dt: float) -> dict[str, dict[str, Any]]:
    """Parameters by group, entry by entry; melt, rolling, footloose and calving follow in `_groups_of_life`."""
    flag, number, mts = group.flag, group.number, group.flag("mts")
    dem = mts and flag("dem") and flag("iceberg_bonds_on")  # without ``mts`` they do not act (quirk Q25)
    # Thresholds of fracture (equations 7.1, 7.2; quirks Q8, Q9): in sub-steps they count as they stand. After the long step
    # one of 0 or less means never, and two of them mean that nothing is tested, whatever the criterion.
    inline = flag("break_bonds_on_sub_steps")
    normal, shear = (number(name) * number("frac_thres_scaling") for name in ("frac_thres_n", "frac_thres_t"))
    fracture = dem and (inline or normal > 0 or shear > 0)
    if fracture and (criterion := group.text("fracture_criterion")).lower() != "stress":
        cause = "break_bonds_on_sub_steps = .true." if inline else "positive frac_thres_n or frac_thres_t"
        raise group.error(
            f"fracture_criterion = '{criterion}' with {cause}",
            "Set fracture_criterion = 'stress', or switch fracture off",
        )
    if not inline:
        normal, shear = (value if value > 0 else NEVER for value in (normal, shear))
    # Repulsion comes from the cell search and attraction from the bonds (branch B of section 5.1).
    plain = not (mts or number("contact_distance") > 0 or contact_stiffness(group) != number("spring_coef"))
    return {
        "ice": {"density": number("rho_bergs")},
        "drag": {
            "ocean_scale": number("ocean_drag_scale"),
            "sides_by_bonds": flag("internal_bergs_for_drag"),
            "rotational": False,
        },
        "grounding": {
            "coefficient": number("cdrag_grounding"),
            "ramp_height": max(number("h_to_init_grounding"), 0.0),
            "on_substeps": flag("short_step_mts_grounding") and mts,
            "implicit": False,
            "torque": flag("use_grounding_torque"),
        },
        "contact": {
            "spring": contact_stiffness(group),
            "on_substeps": False,
            "distance": max(number("contact_distance"), 0.0),
            "critical_damping": flag("critical_interaction_damping_on"),
            "tangential_critical_damping": flag("tang_crit_int_damp_on"),
            "radial_damping": number("radial_damping_coef"),
            "tangential_damping": number("tangental_damping_coef"),
            "iterate": flag("force_convergence"),
            "tolerance": number("convergence_tolerance"),
        },
        "bonds": {
            "law": "none" if not flag("iceberg_bonds_on") else ("dem" if dem else "spring"),
            "packing": "hexagonal" if flag("hexagonal_icebergs") else "square",
            "spring": number("spring_coef"),
            "youngs_modulus": number("dem_spring_coef"),
            "poisson": number("poisson"),
            "damping": number("dem_damping_coef"),
            "objective_damping": False,
            "no_shear": flag("ignore_tangential_force"),
            "linear_bending": flag("orig_dem_moment_of_inertia"),
            "max_bonds": group.whole("max_bonds") if flag("iceberg_bonds_on") else 0,
            "constant_size": flag("constant_interaction_LW"),
            "constant_length": number("constant_length"),
            "constant_width": number("constant_width"),
        },
        "fracture": {
            "enabled": fracture,
            "normal_strength": normal,
            "shear_strength": shear,
            "on_substeps": inline,
            "broken_as_contact": flag("use_broken_bonds_for_substep_contact") and inline,
            "not_in_first_step": flag("no_frac_first_ts"),
        },
        "stepping": {
            "scheme": scheme(group),
            "time_step": dt,
            "substeps": substeps(group, dt),
            "explicit_substeps": flag("explicit_inner_mts") or flag("dem"),
            "predictor_corrector": flag("use_new_predictive_corrective"),
            "skip_first_long_force": flag("skip_first_outer_mts_step"),
            "only_interactions": flag("only_interactive_forces"),
            "frozen": flag("Static_icebergs"),
            "fixed_velocity": (
                (number("u_override"), number("v_override")) if flag("override_iceberg_velocities") else None
            ),
            "interactions": flag("interactive_icebergs_on"),
            **({"speed_limit": DEBRIS_SPEED} if extreme_allowed() else {}),
        },
        "earth": {
            "latlon": flag("grid_is_latlon"),
            "radius": number("Rearth"),
            "period": namelist_period(group),
            "f_plane": flag("use_f_plane"),
            "reference_latitude": number("lat_ref"),
        },
        **_groups_of_life(group),
        "compatibility": Compatibility.kid(
            shared_shear_lever=flag("save_bond_forces"),
            grid_position_round_trip=plain,
            plain_kid_branch=plain,
            radius_based=flag("radius_based_drag") and flag("hexagonal_icebergs") and dem,
            damping_by_speed=flag("scale_damping_by_pmag"),
            sea_ice_shift=number("sicn_shift"),
            zero_rates=flag("set_melt_rates_to_zero"),
            keep_shape=flag("Iceberg_melt_without_decay"),
            one_draw=flag("fl_init_child_xy_by_pe"),
        ).model_dump(),
    }


def _groups_of_life(group: NamelistGroup) -> dict[str, dict[str, Any]]:
    """Melt, rolling, footloose calving and calving from land ice (files 1, 2, 3)."""
    flag, number = group.flag, group.number
    shelf, mixed = flag("melt_icebergs_as_ice_shelf"), flag("use_mixed_melting")
    equations = "three_equation" if flag("Use_three_equation_model") else "two_equation"
    cutoff, tip = number("melt_cutoff"), number("tip_parameter")
    older = "weeks_mellor" if tip >= TIP_OF_SCHEME_TWO else "legacy"

    def classes(*names: str) -> dict[str, tuple[float, ...]]:
        ours = ("mass", "fraction", "scaling", "thickness")
        return {key: group.numbers(name) for key, name in zip(ours, names, strict=True)}

    south = classes("initial_mass", "distribution", "mass_scaling", "initial_thickness")
    north = classes("initial_mass_n", "distribution_n", "mass_scaling_n", "initial_thickness_n")
    return {
        "melt": {
            "enabled": True,
            "mode": "mixed" if mixed else ("shelf" if shelf else "berg"),
            "base": equations if mixed or shelf else "turbulent",
            "salinity_from_ocean": flag("use_mixed_layer_salinity_for_thermo"),
            "split": flag("use_operator_splitting"),
            "bits_fraction": max(number("bergy_bit_erosion_fraction"), 0.0),
            "const_gamma": flag("const_gamma"),
            "gamma_t": number("Gamma_T_3EQ"),
            "friction_drag": number("cdrag_icebergs"),
            "least_friction": number("ustar_icebergs_bg"),
            "tide": number("utide_icebergs"),
            "least_gap": cutoff if cutoff >= 0.0 and flag("apply_thickness_cutoff_to_bergs_melt") else None,
        },
        "rolling": {
            "enabled": flag("allow_bergs_to_roll"),
            "scheme": "updated" if flag("use_updated_rolling_scheme") else older,
            "tip": tip,
        },
        "footloose": {
            "enabled": flag("footloose"),
            "youngs": number("fl_youngs"),
            "strength": 1000.0 * number("fl_strength"),  # kPa in namelists
            "style": "bergs" if group.text("fl_style") == "new_bergs" else "bits",
            "displace": flag("displace_fl_bergs"),
            "berg_mass": number("new_berg_from_fl_bits_mass_thres"),
        },
        "calving": {
            "south": south,
            "north": north if flag("separate_distrib_for_n_hemisphere") else None,
            "fractions": "number" if flag("input_freq_distribution") else "mass",
            "length_over_width": number("LoW_ratio"),
            # Given in years; KID divides by the seconds of a year all the same (quirk T14).
            "smoothing_time": max(number("tau_calving"), 0.0) / (365.0 * 24.0 * 60.0 * 60.0),
        },
    }


def check_calving_store(folder: Path, group: NamelistGroup, grid: Grid) -> None:
    """Refuse a store of calved ice that is large enough to release a berg."""
    path = folder / CALVING_FILE
    stores = read_stores(path, grid, REALS_SIZE)
    if stores is None:
        return
    classes = stores.ice
    northern = "_n" if group.flag("separate_distrib_for_n_hemisphere") else ""
    for suffix in {"", northern}:
        mass, scaling = group.numbers(f"initial_mass{suffix}"), group.numbers(f"mass_scaling{suffix}")
        for k, (m, s) in enumerate(zip(mass, scaling, strict=True)):
            if float(classes[k].max()) >= m * s:
                raise group.error(
                    f"{path} stores {float(classes[k].max()):g} kg in size class {k + 1}, enough to calve a berg",
                    "Only cases with an ocean (group drv_nml) calve: remove the file",
                )


TOO_CLOSE: Final = 0.01
"""Distance of two elements, in sums of their radii, that no run can start from."""


def check_distances(elements: Elements, packing: Packing, metric: Metric) -> None:
    """Refuse elements that lie on top of each other: contact and bonds have no direction between them."""
    near = form_bonds(elements, BondRule(packing=packing, radii_factor=TOO_CLOSE), metric)
    if len(near.first):
        names = " and ".join(id_text(elements.id[rows[0]]) for rows in (near.first, near.second))
        raise BergError(
            f"two elements lie on top of each other, {near.bond_length[0]:.3g} m apart at "
            f"{elements.lon[near.first[0]]:g}, {elements.lat[near.first[0]]:g}",
            where=f"elements {names}",
            remedy="Remove one of them from the iceberg restart",
        )


def check_both_sides(elements: Elements, bonds: Bonds, group: NamelistGroup, p: Parameters) -> None:
    """Refuse bonds whose two sides KID would compute with unequal thickness: it then pulls at both with unequal forces.

    So it is with equal sizes, where the side that is not its own gives the thickness (quirk Q11).
    """
    if p.bonds.law != "dem" or p.compatibility.shared_shear_lever:
        return
    body, i, j = elements.body, bonds.first, bonds.second
    melts = p.melt.enabled and not p.compatibility.zero_rates  # elements with bonds never roll
    alike = p.bonds.constant_size | (body.length[i] * body.width[i] == body.length[j] * body.width[j])
    unequal = alike & ((body.thickness[i] != body.thickness[j]) | melts)
    if unequal.any():
        k = int(np.argmax(unequal))
        (one, other), thickness = (split_id(elements.id[[i[k], j[k]]])), body.thickness
        raise group.error(
            f"save_bond_forces = .false. with bonded elements of {thickness[i[k]]:g} and {thickness[j[k]]:g} m (id_cnt = "
            f"{one[0]} and {one[1]}, id_ij = {other[0]} and {other[1]}){' that melt' if melts else ''}: each "
            "side of the bond then has a force of its own, and the berg drives itself",
            "Set save_bond_forces = .true.",
        )


def check_footloose(elements: Elements, group: NamelistGroup) -> None:
    """Refuse footloose calving of elements with bonds, at which the reference stops in its first step (files, 2)."""
    bonded = (elements.bond_count > 0) & (elements.static < 0.5) & (elements.life.fl_k >= 0.0)
    if group.flag("footloose") and bonded.any():
        k = int(np.argmax(bonded))
        raise group.error(
            f"footloose = .true. with iceberg_bonds_on = .true.: the element at {elements.lon[k]:g}, {elements.lat[k]:g} has "
            f"{elements.bond_count[k]} bonds, and the reference stops there too",
            "Set one of them to .false.",
        )


def order_sides(elements: Elements) -> int:
    """Make length the longer side, as KID does in its first step; return how many elements changed."""
    wrong = elements.width > elements.length
    elements.width[wrong], elements.length[wrong] = elements.length[wrong], elements.width[wrong]
    return int(wrong.sum())
