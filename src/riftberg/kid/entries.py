"""Look-up of KID's namelist entries: names, types, what Riftberg does with what a file sets, and what an entry needs to act.

Source: dynamics, 0.2 and quirks Q19, Q25; files 7.1, 7.2.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

from riftberg.errors import NamelistError
from riftberg.kid.entry_table import COUPLED, DRIVER, ICEBERGS, INTEGER, LOGICAL, REAL, REALS, REFUSED, Entry, Value
from riftberg.system.input_files import value_shown

GROUPS: Final[dict[str, tuple[Entry, ...]]] = {
    "icebergs_nml": ICEBERGS,
    "icebergs_driver_nml": DRIVER,
    "drv_nml": COUPLED,
}
"""The groups that matter, with their entries."""

_BY_NAME: Final = {group: {e.name.lower(): e for e in entries} for group, entries in GROUPS.items()}

REALS_SIZE: Final = 10
"""Length of the tables of size classes."""


def find_entry(group: str, name: str, where: str = "") -> Entry:
    """Return the entry ``name`` (any case) of a group."""
    known = _BY_NAME[group]
    entry = known.get(name.lower())
    if entry is not None:
        return entry
    other = next((g for g, names in _BY_NAME.items() if g != group and name.lower() in names), None)
    if other:
        remedy = f"It belongs to &{other}"
    else:
        near = difflib.get_close_matches(name.lower()[:80], known, n=1, cutoff=0.5)
        remedy = f"Did you mean '{known[near[0]].name}'?" if near else "Delete it, or see the list of KID's entries"
    raise NamelistError(f"unknown entry '{name}'", where=where, remedy=remedy)


def convert(entry: Entry, raw: Any, where: str = "", start: int = 1) -> Value:
    """Return a raw namelist value as the entry's type; ``start``: place from which a list fills a table, from 1."""

    def wrong(expected: str, value: object = raw) -> NamelistError:
        what = f"{entry.name} = {value_shown(value)} is not {expected}"
        return NamelistError(what, where=where, remedy=f"KID's default is {entry.default!r}")

    def is_number(value: object) -> bool:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)

    if raw is None:
        return entry.default
    if entry.kind == REALS:
        items = raw if isinstance(raw, list) else [raw]
        values = list(entry.default) if isinstance(entry.default, tuple) else []
        if start < 1 or start - 1 + len(items) > REALS_SIZE:
            raise wrong(f"a list of at most {REALS_SIZE} numbers")
        for k, item in enumerate(items, start - 1):
            if item is not None and not is_number(item):
                raise wrong("a finite number", item)
            values[k] = values[k] if item is None else float(item)
        return tuple(values)
    if isinstance(raw, list):
        raise wrong("a single value")
    if entry.kind == LOGICAL:
        letter = raw.strip().lstrip(".")[:1].lower() if isinstance(raw, str) else ""
        if not isinstance(raw, bool) and letter not in ("t", "f"):
            raise wrong("a logical (.true. or .false.)")
        return raw if isinstance(raw, bool) else letter == "t"
    if entry.kind == INTEGER:
        if not is_number(raw) or raw != int(raw):
            raise wrong("a whole number")
        return int(raw)
    if entry.kind == REAL:
        if not is_number(raw):
            raise wrong("a finite number")
        return float(raw)
    if not isinstance(raw, str):
        raise wrong("a text in quotes")
    return raw.strip()


def refused(entries: Iterable[Entry], values: dict[str, Value]) -> list[tuple[Entry, Value]]:
    """Return the entries that are refused at the value they have, with that value."""
    return [(e, values[e.name]) for e in entries if e.treatment == REFUSED and values[e.name] != e.accepted]


# What else a namelist must set for an entry to act. Each line names entries and what they need: logical entries that must be
# on, or off where a minus sign stands before them; alternatives are parted by a bar.
_DEM: Final = "mts dem iceberg_bonds_on"
_SHELF: Final = "melt_icebergs_as_ice_shelf | use_mixed_melting"
_BY_CLASS: Final = "save_nonfl_traj_by_class -ignore_traj"

_LINES: Final = {
    "Runge_not_Verlet": "-mts",
    "use_new_predictive_corrective": "Runge_not_Verlet -mts",
    "use_f_plane": "grid_is_latlon",
    "lat_ref": "-grid_is_latlon | use_f_plane",
    "radius_based_drag": f"{_DEM} hexagonal_icebergs",
    "internal_bergs_for_drag manually_initialize_bonds": "iceberg_bonds_on",
    "u_override v_override": "override_iceberg_velocities -mts",
    "manually_initialize_bonds_from_radii": "iceberg_bonds_on manually_initialize_bonds",
    "length_for_manually_initialize_bonds":
        "iceberg_bonds_on manually_initialize_bonds -manually_initialize_bonds_from_radii",
    "contact_spring_coef contact_distance": "interactive_icebergs_on",
    "spring_coef critical_interaction_damping_on scale_damping_by_pmag":
        "interactive_icebergs_on | mts iceberg_bonds_on",
    "radial_damping_coef": "-critical_interaction_damping_on",
    "tang_crit_int_damp_on": "critical_interaction_damping_on",
    "tangental_damping_coef": "-critical_interaction_damping_on | -tang_crit_int_damp_on",
    "max_bonds constant_interaction_LW": "mts iceberg_bonds_on",
    "constant_length constant_width": "mts iceberg_bonds_on constant_interaction_LW",
    "mts_sub_steps force_convergence skip_first_outer_mts_step short_step_mts_grounding rev_mind A68_test": "mts",
    "explicit_inner_mts": "mts -dem",
    "convergence_tolerance": "mts force_convergence",
    "A68_xdisp A68_ydisp": "mts A68_test",
    "dem_spring_coef dem_damping_coef poisson ignore_tangential_force orig_dem_moment_of_inertia save_bond_forces "
    "use_grounding_torque fracture_criterion frac_thres_scaling frac_thres_n frac_thres_t break_bonds_on_sub_steps "
    "no_frac_first_ts": _DEM,
    "use_broken_bonds_for_substep_contact": f"{_DEM} break_bonds_on_sub_steps",
    "use_updated_rolling_scheme tip_parameter": "allow_bergs_to_roll | footloose",
    "Use_three_equation_model use_mixed_layer_salinity_for_thermo": _SHELF,
    "utide_icebergs ustar_icebergs_bg cdrag_icebergs": f"{_SHELF} | pass_fields_to_ocean_model",
    "const_gamma": "Use_three_equation_model melt_icebergs_as_ice_shelf | Use_three_equation_model use_mixed_melting",
    "Gamma_T_3EQ": "Use_three_equation_model const_gamma melt_icebergs_as_ice_shelf"
                   " | Use_three_equation_model const_gamma use_mixed_melting",
    "melt_cutoff": "apply_thickness_cutoff_to_bergs_melt | apply_thickness_cutoff_to_gridded_melt",
    "apply_thickness_cutoff_to_bergs_melt": _SHELF,
    "apply_thickness_cutoff_to_gridded_melt": "pass_fields_to_ocean_model",
    "fl_youngs fl_strength fl_style displace_fl_bergs fl_init_child_xy_by_pe new_berg_from_fl_bits_mass_thres":
        "footloose",
    "traj_area_thres_fl": "footloose -ignore_traj",
    "initial_mass_n distribution_n mass_scaling_n initial_thickness_n": "separate_distrib_for_n_hemisphere",
    "initial_orientation": "hexagonal_icebergs",
    "traj_sample_hrs traj_write_hrs save_short_traj save_fl_traj traj_area_thres save_all_traj_year "
    "save_nonfl_traj_by_class debug_write": "-ignore_traj",
    "save_bond_traj": "iceberg_bonds_on -ignore_traj",
    "bond_traj_name": "iceberg_bonds_on save_bond_traj -ignore_traj",
    "traj_area_thres_sntbc save_traj_by_class_start_mass_thres_n save_traj_by_class_start_mass_thres_s": _BY_CLASS,
    "bump_depth": "big_grounding_test -a68_test",
    "gridres ibuo ibvo ibua ibuy collision_test big_grounding_test fl_test ni nj": "-a68_test",
    "data_dir transient_a68_data_start_ind REarth": "a68_test",
}  # fmt: skip

NEEDS: Final = {name: line for names, line in _LINES.items() for name in names.split()}


def lacking(name: str, values: Mapping[str, Value]) -> str:
    """Return what an entry needs to act, in words, where a group does not have it; empty where it acts."""
    ways = [way.split() for way in NEEDS.get(name, "").split(" | ")]
    if any(all(bool(values.get(flag.lstrip("-"))) is not flag.startswith("-") for flag in way) for way in ways):
        return ""
    words = (" and ".join(f"{f.lstrip('-')} = {'.false.' if f[0] == '-' else '.true.'}" for f in way) for way in ways)
    return f"it acts with {', or with '.join(words)} only"
