"""For every namelist entry a change, the scene in which it matters, and in which schemes the specification leaves it idle."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import netCDF4
import numpy as np

from riftberg.kid.restart import write_bonds
from riftberg.kid.run import load_case

from .scenes import Values, bergs

FLIP: Final = object()
"""The other value of a logical entry."""

SINGLE: Final = ("verlet", "runge")
MULTIPLE: Final = ("springs", "dem")
NO_DEM: Final = ("verlet", "runge", "springs")
ALL: Final = ("verlet", "runge", "springs", "dem")


@dataclass(frozen=True)
class Trial:
    """A change of one entry.

    ``given``, ``driver``, ``restart``: what else the scene has, changed or not. ``multiple``: what it has with multiple
    steps besides. ``idle``: schemes in which nothing may change. ``refused``: words of the refusal by scheme. ``where``:
    "state" (the restart differs), "files" (records or returned fields differ), "roundoff" (the same but for round-off),
    "same" (nothing in the files). ``only_files``: schemes in which the records differ, but not the state.
    """

    value: Any = FLIP
    scene: str = "berg"
    given: Values = field(default_factory=dict)
    driver: Values = field(default_factory=dict)
    multiple: Values = field(default_factory=dict)
    restart: Values = field(default_factory=dict)
    idle: tuple[str, ...] = ()
    refused: dict[str, str] = field(default_factory=dict)
    where: str = "state"
    only_files: tuple[str, ...] = ()
    prepare: Callable[[Path], None] | None = None


def moved(east: float, north: float = 0.0, scene: str = "berg") -> Values:
    """All elements elsewhere."""
    start = bergs(scene)
    return {"lon": start["lon"] + east, "lat": start["lat"] + north}


def squeezed(scene: str = "berg") -> Values:
    """The bonded berg pressed together, so that its diagonals touch."""
    start = bergs(scene)
    x, y = start["lon"].copy(), start["lat"].copy()
    x[1], x[3], y[2], y[3] = x[0] + 270.0, x[0] + 270.0, y[0] + 275.0, y[0] + 275.0
    return {"lon": x, "lat": y}


def tall(thickness: float, width: float) -> Values:
    """The single berg so tall and narrow."""
    start = bergs("berg")
    t, w, length, mass = (start[name].copy() for name in ("thickness", "width", "length", "mass"))
    t[4], w[4], length[4] = thickness, width, 800.0
    mass[4] = 850.0 * thickness * width * 800.0
    return {"thickness": t, "width": w, "length": length, "mass": mass}


def other_input(folder: Path) -> None:
    """Another restart folder, in which the bergs are faster."""
    shutil.copytree(folder / "INPUT", folder / "INPUT2")
    with netCDF4.Dataset(folder / "INPUT2" / "icebergs.res.nc", "a") as dataset:
        dataset["uvel"][:] = 0.3


def other_data(folder: Path) -> None:
    """Another folder of A68 data, with half the current."""
    shutil.copytree(folder / "data", folder / "data2")
    path = next(path for path in (folder / "data2").iterdir() if "ocean" in path.name)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset["uo"][:] = 0.5 * dataset["uo"][:]


def strained(folder: Path) -> None:
    """Bonds of a restart that were under more stress than they bear when it was written."""
    text = (folder / "input.nml").read_text()
    (folder / "input.nml").write_text(
        text.replace("manually_initialize_bonds = .false.", "manually_initialize_bonds = .true.")
    )
    case = load_case(folder)
    (folder / "input.nml").write_text(text)
    bonds = case.model.bonds
    bonds.normal_stress[:] = 1e6
    dem = case.namelist.icebergs.flag("dem")
    write_bonds(folder / "INPUT" / "bonds_iceberg.res.nc", case.model.elements, bonds, case.grid, dem=dem)


COLLIDES: Final = {"length_for_manually_initialize_bonds": 300.0}
SQUEEZED: Final = {"given": COLLIDES, "restart": squeezed()}
BREAKS: Final = {"fracture_criterion": "stress", "frac_thres_n": 25.0, "frac_thres_t": 1e6}
SHELF: Final = {"melt_icebergs_as_ice_shelf": True}
FOOT: Final = {
    "length_for_manually_initialize_bonds": -1.0,
    "footloose": True, "fl_youngs": 1e6, "fl_strength": 100.0, "fl_style": "fl_bits",
    "new_berg_from_fl_bits_mass_thres": 1e9,
}  # fmt: skip
CUT: Final = {"fl_k": 1e5 * np.ones(5)}
NO_RUNGE: Final = {"runge": "footloose = .true. with Runge_not_Verlet = .true."}
CALVES: Final = {
    "initial_mass": [4e7] * 10, "mass_scaling": [1.0] * 10, "interactive_icebergs_on": False,
    "tau_calving": 0.0,
    "allow_bergs_to_roll": False,
}  # fmt: skip
NORTH: Final = {
    "separate_distrib_for_n_hemisphere": True, "initial_mass_n": [3e7] * 10, "mass_scaling_n": [1.0] * 10,
    "distribution_n": [0.1] * 10, "initial_thickness_n": [100.0] * 10,
}  # fmt: skip
SMALL_ONES: Final = {"traj_area_thres": 10.0}
BY_CLASS: Final = {**SMALL_ONES, "save_nonfl_traj_by_class": True}


def _ocean(value: Any = FLIP, **more: Any) -> Trial:
    return Trial(value, "ocean", **{"where": "files", **more})


def _calves(value: Any = FLIP, **more: Any) -> Trial:
    return Trial(value, "ocean", given={**CALVES, **more.pop("given", {})}, **more)


def _north(value: Any) -> Trial:
    return _calves(value, given=NORTH)


def _foot(value: Any = FLIP, **more: Any) -> Trial:
    more = {"restart": CUT, "refused": NO_RUNGE, **more}
    return Trial(value, given={**FOOT, **more.pop("given", {})}, **more)


def _dem(value: Any = FLIP, **more: Any) -> Trial:
    return Trial(value, idle=NO_DEM, **more)


def _mts(value: Any = FLIP, **more: Any) -> Trial:
    return Trial(value, idle=SINGLE, **more)


ICEBERGS: Final[dict[str, Trial]] = {
    "Runge_not_Verlet": Trial(idle=MULTIPLE),
    "use_new_predictive_corrective": Trial(idle=("verlet", *MULTIPLE)),
    "rho_bergs": Trial(880.0),
    "LoW_ratio": _calves(1.8),
    "tau_is_velocity": Trial(driver={"ibua": 0.1, "ibuy": -0.05}),
    "use_f_plane": Trial(scene="a68"),
    "lat_ref": Trial(30.0),
    "coastal_drift": Trial(0.3, "ocean", driver={"land": 1.0}),
    "tidal_drift": Trial(0.3, "ocean", driver={"land": 1.0}),
    "ocean_drag_scale": Trial(2.0),
    "internal_bergs_for_drag": Trial(),
    "radius_based_drag": _dem(given={"hexagonal_icebergs": True}),
    "override_iceberg_velocities": Trial(given={"u_override": 0.25, "v_override": -0.1}),
    "u_override": Trial(0.25, given={"override_iceberg_velocities": True}, idle=MULTIPLE),
    "v_override": Trial(0.25, given={"override_iceberg_velocities": True}, idle=MULTIPLE),
    "Static_icebergs": Trial(),
    "only_interactive_forces": Trial(),
    "grid_is_latlon": Trial(refused=dict.fromkeys(ALL, "grid_is_latlon = True, but the driver's grid is in metres")),
    "grid_is_regular": Trial(where="roundoff", scene="seamount"),
    "Lx": Trial(20e3, restart=moved(10.3e3)),
    "Rearth": Trial(6.0e6, "a68"),
    "old_bug_bilin": Trial(scene="a68"),
    "interactive_icebergs_on": Trial(),
    "iceberg_bonds_on": Trial(),
    "max_bonds": _mts(2, **SQUEEZED),
    "manually_initialize_bonds": Trial(refused=dict.fromkeys(ALL, "bonds_iceberg.res.nc: no such file")),
    "manually_initialize_bonds_from_radii": Trial(),
    "length_for_manually_initialize_bonds": Trial(406.0),
    "spring_coef": Trial(1.2e-5, **SQUEEZED),
    "contact_spring_coef": Trial(4e-6),
    "contact_distance": Trial(700.0),
    "radial_damping_coef": Trial(1e-3, given={"critical_interaction_damping_on": False}),
    "tangental_damping_coef": Trial(1e-3, given={"critical_interaction_damping_on": False}),
    "critical_interaction_damping_on": Trial(),
    "tang_crit_int_damp_on": Trial(),
    "scale_damping_by_pmag": Trial(),
    "constant_interaction_LW": _mts(),
    "constant_length": _mts(410.0, given={"constant_interaction_LW": True, "constant_width": 390.0}),
    "constant_width": _mts(410.0, given={"constant_interaction_LW": True, "constant_length": 390.0}),
    "mts": Trial(refused={"dem": "dem = .true. with Runge_not_Verlet = .true."}),
    "mts_sub_steps": _mts(25),
    "explicit_inner_mts": Trial(idle=(*SINGLE, "dem")),
    "force_convergence": _mts(),
    "convergence_tolerance": _mts(1e-1),
    "skip_first_outer_mts_step": _mts(),
    "short_step_mts_grounding": _mts(scene="seamount"),
    "dem": Trial(
        given={"dem_spring_coef": 2e3},
        only_files=("verlet",),
        refused={"runge": "dem = .true. with Runge_not_Verlet = .true."},
    ),
    "dem_spring_coef": _dem(3e3),
    "dem_damping_coef": _dem(0.5),
    "poisson": _dem(0.2),
    "ignore_tangential_force": _dem(),
    "orig_dem_moment_of_inertia": _dem(),
    "save_bond_forces": _dem(given={"set_melt_rates_to_zero": True, "allow_bergs_to_roll": False}),
    "dem_beam_test": Trial(2),
    "fracture_criterion": _dem("none", given=BREAKS, refused={"dem": "fracture_criterion = 'none' with positive"}),
    "frac_thres_scaling": _dem(1e3, given=BREAKS),
    "frac_thres_n": _dem(1e6, given=BREAKS),
    "frac_thres_t": _dem(0.5, given=BREAKS),
    "break_bonds_on_sub_steps": _dem(given=BREAKS),
    "use_broken_bonds_for_substep_contact": _dem(
        given={**COLLIDES, **BREAKS, "frac_thres_t": 0.0, "break_bonds_on_sub_steps": True}, restart=squeezed()
    ),
    "no_frac_first_ts": _dem(
        given={**BREAKS, "frac_thres_n": 1e5, "manually_initialize_bonds": False}, prepare=strained
    ),
    "cdrag_grounding": Trial(2e3, "seamount"),
    "h_to_init_grounding": Trial(0.0, "seamount", driver={"bump_depth": 130.0}, restart=moved(1e3, 1.5e3, "seamount")),
    "use_grounding_torque": _dem(scene="seamount"),
    "grounding_fraction": _ocean(0.2),
    "rev_mind": _mts(scene="seamount"),
    "A68_test": _mts(scene="a68", where="files", given={"A68_xdisp": -50.0, "A68_ydisp": -70.0}),
    "A68_xdisp": _mts(-50.0, scene="a68", given={"A68_ydisp": -70.0}, multiple={"cdrag_grounding": 1e3}),
    "A68_ydisp": _mts(-70.0, scene="a68", given={"A68_xdisp": -50.0}, multiple={"cdrag_grounding": 1e3}),
    "use_operator_splitting": Trial(),
    "sicn_shift": Trial(0.3, "ocean"),
    "bergy_bit_erosion_fraction": Trial(0.6),
    "allow_bergs_to_roll": Trial(restart=tall(800.0, 650.0)),
    "use_updated_rolling_scheme": Trial(restart=tall(720.0, 650.0)),
    "tip_parameter": Trial(1.2, restart=tall(680.0, 650.0)),
    "set_melt_rates_to_zero": Trial(),
    "Iceberg_melt_without_decay": Trial(),
    "melt_icebergs_as_ice_shelf": Trial(),
    "use_mixed_melting": Trial(),
    "Use_three_equation_model": Trial(given=SHELF),
    "const_gamma": Trial(given=SHELF),
    "Gamma_T_3EQ": Trial(0.03, given=SHELF),
    "use_mixed_layer_salinity_for_thermo": Trial(scene="ocean", given=SHELF),
    "utide_icebergs": Trial(0.1, given=SHELF),
    "ustar_icebergs_bg": Trial(0.5, given=SHELF),
    "cdrag_icebergs": Trial(0.003, given=SHELF),
    "read_ocean_depth_from_file": Trial(where="same"),  # there is no file; with one: test_driver_corners.py
    "melt_cutoff": Trial(200.0, "ocean", given={**SHELF, "apply_thickness_cutoff_to_bergs_melt": True}),
    "apply_thickness_cutoff_to_bergs_melt": Trial(scene="ocean", given={**SHELF, "melt_cutoff": 200.0}),
    "apply_thickness_cutoff_to_gridded_melt": _ocean(given={"melt_cutoff": 200.0, "pass_fields_to_ocean_model": True}),
    "find_melt_using_spread_mass": _ocean(),
    "footloose": _foot(given={"footloose": False}),
    "fl_youngs": _foot(2e6),
    "fl_strength": _foot(30.0),
    "fl_style": _foot("new_bergs"),
    "displace_fl_bergs": _foot(),
    "fl_init_child_xy_by_pe": _foot(given={"fl_style": "new_bergs"}),
    "new_berg_from_fl_bits_mass_thres": _foot(1e14),
    "initial_mass": _calves([5e7] * 10),
    "distribution": _calves([0.1] * 10),
    "mass_scaling": _calves([2.0] * 10),
    "initial_thickness": _calves([90.0] * 10),
    "separate_distrib_for_n_hemisphere": _calves(
        given={k: v for k, v in NORTH.items() if k != "separate_distrib_for_n_hemisphere"}
    ),
    "initial_mass_n": _north([5e7] * 10),
    "distribution_n": _north([0.05] * 10),
    "mass_scaling_n": _north([2.0] * 10),
    "initial_thickness_n": _north([90.0] * 10),
    "input_freq_distribution": _calves(given={"initial_mass": [4e7, 5e7] * 5}),
    "tau_calving": _calves(1.0),
    "make_calving_reproduce": _calves(),
    "add_weight_to_ocean": _ocean(),
    "passive_mode": _ocean(),
    "pass_fields_to_ocean_model": _ocean(),
    "hexagonal_icebergs": Trial(),
    "initial_orientation": _ocean(20.0, given={"hexagonal_icebergs": True, "use_old_spreading": False}),
    "use_old_spreading": _ocean(),
    "restart_input_dir": Trial("INPUT2/", prepare=other_input),
    "traj_name": Trial("other.nc", where="files"),
    "bond_traj_name": Trial("other.nc", where="files"),
    "traj_sample_hrs": Trial(0.5, where="files"),
    "traj_write_hrs": Trial(0.5, where="same"),
    "ignore_traj": Trial(where="files"),
    "save_short_traj": Trial(where="files"),
    "save_fl_traj": Trial(where="files"),
    "save_bond_traj": Trial(where="files"),
    "traj_area_thres": Trial(10.0, where="files"),
    "traj_area_thres_sntbc": Trial(10.0, given=BY_CLASS, where="files"),
    "traj_area_thres_fl": _foot(0.0, given=SMALL_ONES, where="files"),
    "save_all_traj_year": Trial(0.0, given=SMALL_ONES, where="files"),
    "save_nonfl_traj_by_class": Trial(given=SMALL_ONES, where="files"),
    "save_traj_by_class_start_mass_thres_n": Trial(1e20, given=BY_CLASS, where="files"),
    "save_traj_by_class_start_mass_thres_s": Trial(
        1e20, "a68", given={**BY_CLASS, "traj_area_thres": 100.0}, where="files"
    ),
    "debug_write": Trial(where="files", given={"traj_write_hrs": 0.5}),
}
"""Entries of ``icebergs_nml`` that are called honoured."""

DRIVER: Final[dict[str, Trial]] = {
    "ni": Trial(22, restart=moved(10.3e3)),
    "nj": Trial(22, restart=moved(0.0, 10.9e3), driver={"ibvo": 0.3}),
    "gridres": Trial(900.0, driver={"collision_test": True}),
    "ibdt": Trial(500.0),
    "ibhrs": Trial(2, driver={"nmax": 100, "ibhrs": 1}),
    "nmax": Trial(3),
    "ibuo": Trial(0.5),
    "ibvo": Trial(0.5),
    "ibui": Trial(0.5, where="files"),
    "ibvi": Trial(0.5, where="files"),
    "ibua": Trial(12.0),
    "ibuy": Trial(12.0),
    "sst": Trial(4.0),
    "bump_depth": Trial(90.0, "seamount"),
    "collision_test": Trial(),
    "big_grounding_test": Trial(scene="seamount"),
    "fl_test": Trial(restart=moved(2e3)),
    "a68_test": Trial(refused=dict.fromkeys(ALL, "grid_is_latlon = False, but the driver's grid is in degrees")),
    "data_dir": Trial("data2/", "a68", prepare=other_data),
    "transient_a68_data_start_ind": Trial(3, "a68"),
    "REarth": Trial(6.0e6, "a68"),
}
"""Entries of ``icebergs_driver_nml`` that are called honoured."""

COUPLED: Final[dict[str, Trial]] = {
    "ni": Trial(14, "ocean"),
    "nj": _ocean(12),
    "gridres": Trial(5500.0, "ocean"),
    "lat0": Trial(-5000.0, "ocean"),
    "land": Trial(1.0, "ocean", given={"coastal_drift": 0.2}),
    "dt": Trial(1800.0, "ocean"),
    "nsteps": Trial(3, "ocean"),
    "uo0": Trial(0.5, "ocean"),
    "vo0": Trial(0.5, "ocean"),
    "ui0": Trial(0.5, "ocean"),
    "vi0": Trial(0.5, "ocean"),
    "ua0": Trial(12.0, "ocean"),
    "va0": Trial(12.0, "ocean"),
    "sst0": Trial(4.0, "ocean"),
    "sstk": Trial(1.0, "ocean"),
    "sss0": Trial(20.0, "ocean", given={**SHELF, "use_mixed_layer_salinity_for_thermo": True}),
    "cn0": Trial(0.9, "ocean"),
    "hi0": Trial(1.0, "ocean"),
    "calv0": _calves(3e-3),
    "calvh0": _calves(20.0),
}
"""Entries of ``drv_nml``: all are called honoured."""

TRIALS: Final = {"icebergs_nml": ICEBERGS, "icebergs_driver_nml": DRIVER, "drv_nml": COUPLED}
