"""KID's namelist entries: the one table of types, defaults, units, meanings and treatment by Riftberg, and its look-up.

Source: dynamics, 0.2 and quirks Q19, Q25; files 7.1, 7.2.
"""

from __future__ import annotations

import difflib
import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from riftberg.constants import EARTH_RADIUS_KID
from riftberg.errors import NamelistError
from riftberg.system.input_files import value_shown

Kind = Literal["logical", "integer", "real", "reals", "text"]
Treatment = Literal["honoured", "refused", "reported"]
Value = bool | int | float | str | tuple[float, ...]

LOGICAL: Final = "logical"
INTEGER: Final = "integer"
REAL: Final = "real"
REALS: Final = "reals"
TEXT: Final = "text"

HONOURED: Final = "honoured"
REFUSED: Final = "refused"
REPORTED: Final = "reported"

CALVING: Final = (
    "in cases with an ocean (group drv_nml) or with melt and passive_mode = .false.; else no ice leaves the land"
)
OCEAN: Final = (
    "in cases with an ocean (group drv_nml) or with melt and passive_mode = .false.; else nothing is returned to any"
)
MESSAGES: Final = "messages and checks of the reference; progress is shown instead"
ONE_PROCESS: Final = "the run is a single process with one file"


@dataclass(frozen=True)
class Entry:
    """One namelist entry."""

    name: str  # Name as KID spells it; namelists ignore the case
    kind: Kind  # ``"logical"``, ``"integer"``, ``"real"``, ``"reals"`` (ten of them) or ``"text"``
    default: Value  # Value where the namelist is silent
    unit: str  # Unit, empty where there is none
    meaning: str  # What it does in KID
    # Honoured; refused unless it has the ``accepted`` value; or only reported, being without effect here
    treatment: Treatment = HONOURED
    note: str = ""  # How it is honoured, why it is refused, or why it has no effect
    accepted: bool | float | None = None  # The value of a refused entry that a run may have
    remedy: str = ""  # What to write instead of a refused value


def _yes(name: str, kind: Kind, default: Value, unit: str, meaning: str, note: str = "") -> Entry:
    """Describe an entry that is honoured."""
    return Entry(name, kind, default, unit, meaning, HONOURED, note)


def _nil(name: str, kind: Kind, default: Value, unit: str, meaning: str, note: str) -> Entry:
    """Describe an entry without effect here."""
    return Entry(name, kind, default, unit, meaning, REPORTED, note)


def _not(
    name: str, kind: Kind, default: Value, unit: str, meaning: str, note: str, accepted: bool | float, remedy: str
) -> Entry:
    """Describe an entry that a run may have at one value only."""
    return Entry(name, kind, default, unit, meaning, REFUSED, note, accepted, remedy)


# fmt: off
ICEBERGS: Final[tuple[Entry, ...]] = (
    _yes("Runge_not_Verlet", LOGICAL, True, "", "RK4 (T) or velocity Verlet (F) stepping"),
    _yes("use_new_predictive_corrective", LOGICAL, False, "", "drag by the mean of two speeds",
         "in Runge-Kutta stepping; the others always have it"),
    _yes("rho_bergs", REAL, 850.0, "kg m-3", "ice density of all bergs"),
    _yes("LoW_ratio", REAL, 1.5, "1", "length/width of newly calved bergs", CALVING),
    _nil("speed_limit", REAL, 0.0, "1",
         ">0: counts bergs faster than this multiple of cell size/dt, -1: warns; never changes motion",
         "never changes the motion in the reference either (quirk Q3)"),
    _yes("tau_is_velocity", LOGICAL, False, "", "wind input is a velocity, skip stress inversion"),
    _yes("use_f_plane", LOGICAL, False, "", "constant Coriolis parameter"),
    _yes("lat_ref", REAL, 0.0, "degree", "latitude for the f-plane (and for Cartesian grids)"),
    _yes("coastal_drift", REAL, 0.0, "m s-1", "velocity pushing bergs off land cells"),
    _yes("tidal_drift", REAL, 0.0, "m s-1", "amplitude of random near-coast velocity"),
    _yes("ocean_drag_scale", REAL, 1.0, "1", "multiplies ocean drag coefficients"),
    _yes("internal_bergs_for_drag", LOGICAL, False, "", "reduce side drag of elements according to their bonds"),
    _yes("radius_based_drag", LOGICAL, False, "", "side-face area from element diameter (hex, dem)"),
    _yes("override_iceberg_velocities", LOGICAL, False, "", "impose the velocity of all moving bergs",
         "with Runge_not_Verlet from the second step on; with mts bergs keep the velocity that they start with"),
    _yes("u_override", REAL, 0.0, "m s-1", "imposed zonal velocity"),
    _yes("v_override", REAL, 0.0, "m s-1", "imposed meridional velocity"),
    _yes("Static_icebergs", LOGICAL, False, "", "no berg moves"),
    _yes("only_interactive_forces", LOGICAL, False, "", "only contact/bond forces act"),
    _yes("grid_is_latlon", LOGICAL, True, "", "coordinates are degrees (else metres)"),
    _yes("grid_is_regular", LOGICAL, True, "", "Cartesian grid uniform: local coordinates by division"),
    _yes("Lx", REAL, 360.0, "grid units", "zonal period; <=0 none; 360 with Cartesian means -1"),
    _yes("Rearth", REAL, EARTH_RADIUS_KID, "m", "sphere radius for degree-to-metre conversion"),
    _nil("halo", INTEGER, 4, "cells", "halo width of the berg domain", "the grid keeps a halo of its own width"),
    _yes("old_bug_bilin", LOGICAL, True, "", "use the inverted bilinear weights", "in the interpolation of fields"),
    _nil("use_roundoff_fix", LOGICAL, True, "", "nudge bergs lost to round-off into their cell",
         "has no effect in the reference either (quirk Q38)"),
    _nil("use_slow_find", LOGICAL, True, "", "exhaustive cell search on restart",
         "cells are always found by a full search"),
    _yes("interactive_icebergs_on", LOGICAL, False, "", "contact forces between bergs"),
    _yes("iceberg_bonds_on", LOGICAL, False, "", "bonds allowed"),
    _yes("max_bonds", INTEGER, 6, "1", "bonds per element carried in messages (0 if bonds off)"),
    _yes("manually_initialize_bonds", LOGICAL, False, "", "create bonds by distance instead of reading them"),
    _yes("manually_initialize_bonds_from_radii", LOGICAL, False, "", "distance criterion 1.25 x sum of radii"),
    _yes("length_for_manually_initialize_bonds", REAL, 1000.0, "m",
         "distance criterion otherwise (negative means no bonds)"),
    _yes("spring_coef", REAL, 1e-08, "s-2", "spring constant of bonded interaction"),
    _yes("contact_spring_coef", REAL, 0.0, "s-2", "spring constant of contact (0 means spring_coef)"),
    _yes("contact_distance", REAL, 0.0, "m", "contact starts at max(this, R1+R2)"),
    _nil("bond_coef", REAL, 1e-08, "s-2", "unused", "unused in the reference too"),
    _yes("radial_damping_coef", REAL, 0.0001, "s-1", "damping along the line of centres if not critical"),
    _yes("tangental_damping_coef", REAL, 2e-05, "s-1", "damping across it if not critical"),
    _yes("critical_interaction_damping_on", LOGICAL, True, "", "critical radial damping"),
    _yes("tang_crit_int_damp_on", LOGICAL, True, "", "critical tangential damping too"),
    _yes("scale_damping_by_pmag", LOGICAL, True, "", "scale damping with size of projected relative velocity"),
    _yes("constant_interaction_LW", LOGICAL, False, "", "use one fixed element size for interactions"),
    _yes("constant_length", REAL, 0.0, "m",
         "that length; 0 (either) means mean of initial lengths (the declaration says max)"),
    _yes("constant_width", REAL, 0.0, "m", "that width, same rule"),
    _yes("mts", LOGICAL, False, "", "multiple-time-step scheme"),
    _yes("mts_sub_steps", INTEGER, -1, "1", "number of sub-steps; -1 means ceil(dt sqrt(spring_coef)/0.3)"),
    _yes("explicit_inner_mts", LOGICAL, False, "", "explicit sub-steps (T if dem)"),
    _yes("force_convergence", LOGICAL, False, "", "iterate the implicit velocity coupling"),
    _yes("convergence_tolerance", REAL, 1e-08, "1", "its tolerance"),
    _nil("remove_unused_bergs", LOGICAL, True, "", "trim unneeded copies after transfers", ONE_PROCESS),
    _yes("skip_first_outer_mts_step", LOGICAL, False, "", "omit long-step forcing in the first step"),
    _yes("short_step_mts_grounding", LOGICAL, False, "", "grounding drag on sub-steps"),
    _nil("ewsame", LOGICAL, False, "", "two PEs in x with cyclic x (east PE = west PE)", ONE_PROCESS),
    _yes("dem", LOGICAL, False, "", "discrete-element bonds with rotation"),
    _yes("dem_spring_coef", REAL, 0.0, "Pa", "bond Young's modulus"),
    _yes("dem_damping_coef", REAL, 0.1, "1", "bond damping ratio"),
    _yes("poisson", REAL, 0.3, "1", "Poisson ratio of bonds"),
    _yes("ignore_tangential_force", LOGICAL, False, "", "no shear force in bonds"),
    _yes("orig_dem_moment_of_inertia", LOGICAL, False, "", "older bond torque law"),
    _yes("save_bond_forces", LOGICAL, True, "", "compute each bond once per pair",
         "off means that each side of a bond has its own lever arm; refused where both sides would count with unequal thickness"),
    _yes("dem_beam_test", INTEGER, 0, "1", "1 supported beam, 2 cantilever, 3 spin test",
         "3 does nothing, as in the reference"),
    _yes("fracture_criterion", TEXT, "none", "", "'stress' or 'none'"),
    _yes("frac_thres_scaling", REAL, 1.0, "1", "multiplies both thresholds"),
    _yes("frac_thres_n", REAL, 0.0, "Pa", "tensile threshold"),
    _yes("frac_thres_t", REAL, 0.0, "Pa", "shear threshold"),
    _yes("break_bonds_on_sub_steps", LOGICAL, False, "", "test bonds every sub-step"),
    _yes("use_broken_bonds_for_substep_contact", LOGICAL, False, "", "sub-step contact only across broken bonds"),
    _yes("no_frac_first_ts", LOGICAL, False, "", "no breaking in the first step"),
    _nil("print_fracture", LOGICAL, True, "", "report each break", MESSAGES),
    _yes("cdrag_grounding", REAL, 0.0, "kg m-2 s-1", "bottom drag coefficient"),
    _yes("h_to_init_grounding", REAL, 100.0, "m", "under-keel clearance at which it sets in"),
    _yes("use_grounding_torque", LOGICAL, False, "", "bottom drag also damps rotation"),
    _yes("grounding_fraction", REAL, 0.0, "1", "fraction of water depth at which weight on the ocean is capped",
         OCEAN),
    _yes("rev_mind", LOGICAL, False, "", "alternative 3x3 stencil parity for depth interpolation"),
    _yes("A68_test", LOGICAL, False, "", "artificial depth: 0 in a quadrant, 1000 m elsewhere"),
    _yes("A68_xdisp", REAL, 0.0, "degree", "western limit (-360 convention) of that quadrant"),
    _yes("A68_ydisp", REAL, 0.0, "degree", "southern limit"),
    _yes("read_ocean_depth_from_file", LOGICAL, False, "", "depth from topog.nc",
         "of the folder of restarts; where it is not there, the depth stays that of the driver"),
    _yes("use_operator_splitting", LOGICAL, True, "", "sequential melt update"),
    _yes("sicn_shift", REAL, 0.0, "1", "added to ice concentration in the erosion law"),
    _yes("bergy_bit_erosion_fraction", REAL, 0.0, "1", "part of erosion turned into bits"),
    _yes("allow_bergs_to_roll", LOGICAL, True, "", "rolling"),
    _yes("use_updated_rolling_scheme", LOGICAL, False, "", "rolling scheme 1"),
    _yes("tip_parameter", REAL, 0.0, "1", "scheme-1 ratio if >0; >=999 selects scheme 2 when not updated"),
    _yes("set_melt_rates_to_zero", LOGICAL, False, "", "zero the three berg rates"),
    _yes("Iceberg_melt_without_decay", LOGICAL, False, "", "send fluxes but keep bergs unchanged"),
    _yes("melt_icebergs_as_ice_shelf", LOGICAL, False, "", "only basal melt of the ice-shelf law"),
    _yes("use_mixed_melting", LOGICAL, False, "", "blend by bond fraction"),
    _yes("Use_three_equation_model", LOGICAL, True, "", "3- versus 2-equation basal melt"),
    _yes("const_gamma", LOGICAL, True, "", "constant exchange coefficient (3-eq)"),
    _yes("Gamma_T_3EQ", REAL, 0.022, "1", "that coefficient; salt /35"),
    _yes("use_mixed_layer_salinity_for_thermo", LOGICAL, False, "", "ocean salinity instead of 35"),
    _yes("utide_icebergs", REAL, 0.0, "m s-1", "tidal speed in friction velocity"),
    _yes("ustar_icebergs_bg", REAL, 0.001, "m s-1", "minimum friction velocity"),
    _yes("cdrag_icebergs", REAL, 0.0015, "1", "drag coefficient in friction velocity"),
    _yes("melt_cutoff", REAL, -1.0, "m", "minimum water gap for melt; <0 off"),
    _yes("apply_thickness_cutoff_to_bergs_melt", LOGICAL, False, "", "apply to the basal melt of bergs"),
    _yes("apply_thickness_cutoff_to_gridded_melt", LOGICAL, False, "", "apply to gridded melt", OCEAN),
    _yes("find_melt_using_spread_mass", LOGICAL, False, "", "melt flux from change of spread mass", OCEAN),
    _yes("footloose", LOGICAL, False, "", "footloose calving"),
    _yes("fl_youngs", REAL, 10000000.0, "Pa", "Young's modulus"),
    _yes("fl_strength", REAL, 250.0, "kPa", "yield stress"),
    _yes("fl_style", TEXT, "new_bergs", "", "'new_bergs' tracks children; anything else (use 'fl_bits') bins them"),
    _yes("displace_fl_bergs", LOGICAL, True, "", "random position on the parent's rim"),
    _yes("fl_init_child_xy_by_pe", LOGICAL, False, "", "same random number for all children of a PE"),
    _nil("fl_bits_erosion_to_bergy_bits", LOGICAL, True, "", "unused", "unused in the reference too"),
    _yes("new_berg_from_fl_bits_mass_thres", REAL, 1000000000000.0, "kg", "binned mass that spawns a tracked berg"),
    _yes("initial_mass", REALS, (8.8e7, 4.1e8, 3.3e9, 1.8e10, 3.8e10, 7.5e10, 1.2e11, 2.2e11, 3.9e11, 7.4e11), "kg",
         "class masses (S, or both)", CALVING),
    _yes("distribution", REALS, (0.24, 0.12, 0.15, 0.18, 0.12, 0.07, 0.03, 0.03, 0.03, 0.02), "1", "class fractions",
         CALVING),
    _yes("mass_scaling", REALS, (2000.0, 200.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 1.0, 1.0), "1", "bergs per particle",
         CALVING),
    _yes("initial_thickness", REALS, (40.0, 67.0, 133.0, 175.0, *(250.0,) * 6), "m", "class thickness", CALVING),
    _yes("separate_distrib_for_n_hemisphere", LOGICAL, False, "", "use the _n tables in the north", CALVING),
    _yes("initial_mass_n", REALS,
         (4.58e8, 3.61e9, 1.22e10, 2.91e10, 5.09e10, 7.34e10, 1.15e11, 1.65e11, 2.94e11, 5.59e11), "kg",
         "northern table", CALVING),
    _yes("distribution_n", REALS, (0.14, 0.15, 0.20, 0.15, 0.08, 0.07, 0.05, 0.05, 0.05, 0.05), "1", "northern table",
         CALVING),
    _yes("mass_scaling_n", REALS, (200.0, 50.0, 25.0, 13.0, 8.0, 5.0, 2.0, 1.0, 1.0, 1.0), "1", "northern table",
         CALVING),
    _yes("initial_thickness_n", REALS, (80.4, 159.5, 240.0, 320.0, *(360.0,) * 6), "m", "northern table", CALVING),
    _yes("input_freq_distribution", LOGICAL, False, "", "fractions are number- not mass-based", CALVING),
    _yes("tau_calving", REAL, 0.0, "yr", "smoothing time of the calving flux", CALVING),
    _yes("make_calving_reproduce", LOGICAL, False, "", "PE-independent random initial stores", CALVING),
    _yes("add_weight_to_ocean", LOGICAL, True, "", "spread and return berg mass", OCEAN),
    _yes("passive_mode", LOGICAL, False, "", "return nothing to the host", OCEAN),
    _nil("time_average_weight", LOGICAL, False, "", "accumulate weight during stepping",
         "the averages of the reference give a mass of 0 (T20), and are not built"),
    _yes("pass_fields_to_ocean_model", LOGICAL, False, "", "fill area, velocity, friction velocity grids", OCEAN),
    _yes("hexagonal_icebergs", LOGICAL, False, "", "elements are hexagons"),
    _yes("initial_orientation", REAL, 0.0, "degree", "reference angle of hexagons", OCEAN),
    _nil("rotate_icebergs_for_mass_spreading", LOGICAL, True, "", "orientation from bonds",
         "bergs have no bonds in cases that exchange with an ocean"),
    _yes("use_old_spreading", LOGICAL, True, "", "every rectangular berg one cell wide", OCEAN),
    _not("add_iceberg_thickness_to_SSH", LOGICAL, False, "", "replace ssh by berg contribution",
         "the weight of bergs is not added to the sea level; accepted where there is neither weight nor sea level", False,
         "set it to .false."),
    _nil("old_bug_rotated_weights", LOGICAL, False, "", "no component swap at the tri-polar fold",
         "grids of these cases have no fold"),
    _yes("restart_input_dir", TEXT, "INPUT/", "", "restart directory"),
    _nil("ignore_ij_restart", LOGICAL, False, "", "locate bergs by position, not stored indices",
         "cells are always found from the positions"),
    _nil("ignore_missing_restart_bergs", LOGICAL, False, "", "unused", "unused in the reference too"),
    _nil("require_restart", LOGICAL, False, "", "stop without a restart",
         "a missing restart file is always an error"),
    _not("generate_test_icebergs", LOGICAL, False, "", "make test bergs if no restart",
         "bergs are read from a restart file only; accepted where there is one", False,
         "set it to .false. and give INPUT/icebergs.res.nc"),
    _nil("fix_restart_dates", LOGICAL, True, "", "shift start years", "start dates are carried through unchanged"),
    _nil("read_old_restarts", LOGICAL, False, "", "obsolete: warning only", "obsolete in the reference too"),
    _not("orig_read", LOGICAL, False, "", "obsolete: fatal if T", "the reference stops with this entry as well",
         False, "set it to .false."),
    _yes("traj_name", TEXT, "iceberg_trajectories.nc", "", "trajectory file",
         "unless the run is given another output file"),
    _yes("bond_traj_name", TEXT, "bond_trajectories.nc", "", "bond trajectory file",
         "unless the run is given another output file"),
    _yes("traj_sample_hrs", REAL, 24.0, "h", "sampling interval; -1 every step"),
    _yes("traj_write_hrs", REAL, 480.0, "h", "writing interval; -1 every step",
         "records reach the file at least this often"),
    _yes("ignore_traj", LOGICAL, False, "", "no trajectories (but -1 above still samples)"),
    _yes("save_short_traj", LOGICAL, True, "", "short record"),
    _yes("save_fl_traj", LOGICAL, True, "", "add mass/velocity/footloose record"),
    _yes("save_bond_traj", LOGICAL, False, "", "bond file"),
    _yes("traj_area_thres", REAL, 0.0, "km²", "minimum area of recorded unbonded bergs"),
    _yes("traj_area_thres_sntbc", REAL, 0.0, "km²", "same for the by-class option"),
    _yes("traj_area_thres_fl", REAL, 1000000000.0, "km²", "same for child bergs"),
    _yes("save_all_traj_year", REAL, sys.float_info.max, "yr", "after this year record everything"),
    _yes("save_nonfl_traj_by_class", LOGICAL, False, "", "record by initial mass"),
    _yes("save_traj_by_class_start_mass_thres_n", REAL, 0.0, "kg", "northern threshold"),
    _yes("save_traj_by_class_start_mass_thres_s", REAL, 0.0, "kg", "southern threshold"),
    _nil("force_all_pes_traj", LOGICAL, False, "", "one trajectory file per PE", ONE_PROCESS),
    _nil("verbose", LOGICAL, False, "", "messages", MESSAGES),
    _nil("verbose_hrs", REAL, 24.0, "h", "interval of messages and budgets", MESSAGES),
    _nil("budget", LOGICAL, True, "", "print budgets", MESSAGES),
    _nil("debug", LOGICAL, False, "", "checks and checksums", MESSAGES),
    _nil("really_debug", LOGICAL, False, "", "more of it, implies debug", MESSAGES),
    _nil("halo_debugging", LOGICAL, False, "", "print halo contents", MESSAGES),
    _yes("debug_write", LOGICAL, False, "", "record halo bergs too",
         "samples the trajectory every traj_write_hrs; there are no halo bergs to record"),
    _nil("debug_iceberg_with_id", INTEGER, -1, "", "monitor one berg", MESSAGES),
    _nil("do_unit_tests", LOGICAL, False, "",
         "id and bilinear self-tests (the bilinear ones fail with old_bug_bilin=T)", MESSAGES),
    _nil("parallel_reprod", LOGICAL, True, "", "sorted lists", ONE_PROCESS),
)
"""Group ``icebergs_nml``: 163 entries."""

DRIVER: Final[tuple[Entry, ...]] = (
    _yes("ni", INTEGER, 0, "cells", "grid size (must be >0; from the data file for A68)"),
    _yes("nj", INTEGER, 0, "cells", "grid size (must be >0; from the data file for A68)"),
    _nil("halo", INTEGER, 1, "cells", "driver-domain halo (the tests use 3)",
         "the grid keeps a halo of its own width"),
    _yes("gridres", REAL, 1000.0, "m", "cell size"),
    _yes("ibdt", REAL, 3600.0, "s", "time step"),
    _yes("ibhrs", INTEGER, 2, "h", "run length"),
    _yes("nmax", INTEGER, 2000000000, "steps", "maximum number of steps"),
    _yes("ibuo", REAL, 0.0, "m s-1", "ocean velocity"),
    _yes("ibvo", REAL, 0.0, "m s-1", "ocean velocity"),
    _yes("ibui", REAL, 0.0, "m s-1", "sea-ice velocity"),
    _yes("ibvi", REAL, 0.0, "m s-1", "sea-ice velocity"),
    _yes("ibua", REAL, 0.0, "Pa (m s-1 if tau_is_velocity)", "zonal, meridional wind argument"),
    _yes("ibuy", REAL, 0.0, "Pa (m s-1 if tau_is_velocity)", "zonal, meridional wind argument"),
    _yes("sst", REAL, -2.0, "degree_Celsius or K", "uniform sea temperature"),
    _yes("bump_depth", REAL, 0.0, "m", "depth of the seamount top (big_grounding_test)"),
    _yes("collision_test", LOGICAL, False, "", "converging meridional current"),
    _yes("big_grounding_test", LOGICAL, False, "", "seamount case"),
    _yes("fl_test", LOGICAL, False, "", "vo := -vo where corner lon >10000"),
    _yes("a68_test", LOGICAL, False, "", "A68a case"),
    _yes("data_dir", TEXT, "data/", "", "A68 data"),
    _yes("transient_a68_data_start_ind", INTEGER, 0, "1",
         "first hourly index; must be >0 with a68_test, forced 0 otherwise"),
    _yes("REarth", REAL, 6378000.0, "m", "radius for the A68 grid metrics only"),
    _nil("saverestart", LOGICAL, False, "", "write restarts at the end", "restart files are always written"),
    _nil("write_time_inc", INTEGER, 1, "steps", "progress message interval", "progress is shown instead"),
    _nil("debug", LOGICAL, True, "", "messages", "progress is shown instead"),
)
"""Group ``icebergs_driver_nml``: 25 entries."""

# fmt: off
COUPLED: Final[tuple[Entry, ...]] = (
    _yes("ni", INTEGER, 0, "cells", "grid size"),
    _yes("nj", INTEGER, 0, "cells", "grid size"),
    _yes("gridres", REAL, 1000.0, "m", "cell size"),
    _yes("lat0", REAL, 0.0, "m", "added to the second coordinate of all corners; below 0 lies the south"),
    _yes("land", REAL, 0.0, "", "above 0: land in three cells"),
    _yes("dt", REAL, 3600.0, "s", "time step"),
    _yes("nsteps", INTEGER, 1, "steps", "run length"),
    _yes("uo0", REAL, 0.0, "m s-1", "ocean velocity"),
    _yes("vo0", REAL, 0.0, "m s-1", "ocean velocity"),
    _yes("ui0", REAL, 0.0, "m s-1", "sea-ice velocity"),
    _yes("vi0", REAL, 0.0, "m s-1", "sea-ice velocity"),
    _yes("ua0", REAL, 0.0, "Pa (m s-1 if tau_is_velocity)", "zonal wind argument"),
    _yes("va0", REAL, 0.0, "Pa (m s-1 if tau_is_velocity)", "meridional wind argument"),
    _yes("sst0", REAL, 0.0, "degree_Celsius", "sea temperature at the corner of the grid"),
    _yes("sstk", REAL, 0.0, "K", "added to it: 273.15 hands it over in kelvin"),
    _yes("sss0", REAL, 0.0, "1e-3", "salinity at the corner of the grid"),
    _yes("cn0", REAL, 0.0, "1", "sea-ice concentration of column 10"),
    _yes("hi0", REAL, 1.0, "m", "sea-ice thickness"),
    _yes("calv0", REAL, 0.0, "kg m-2 s-1", "flux of land ice"),
    _yes("calvh0", REAL, 0.0, "W m-2", "heat that it lacks"),
)
"""Group ``drv_nml`` of cases that exchange with an ocean: 20 entries."""


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
    entries = _BY_NAME[group]
    entry = entries.get(name.lower())
    if entry is not None:
        return entry
    other = next((g for g, names in _BY_NAME.items() if g != group and name.lower() in names), None)
    if other:
        remedy = f"It belongs to &{other}"
    else:
        matches = difflib.get_close_matches(name.lower()[:80], entries, n=1, cutoff=0.5)
        remedy = f"Did you mean '{entries[matches[0]].name}'?" if matches else "Delete it, or see the list of KID's entries"
    raise NamelistError(f"unknown entry '{name}'", where=where, remedy=remedy)


def convert(entry: Entry, raw: Any, where: str = "", start: int = 1) -> Value:
    """Return a raw namelist value as the entry's type; ``start``: place from which a list fills a table, from 1."""

    def wrong(expected: str, value: object = raw) -> NamelistError:
        fault = f"{entry.name} = {value_shown(value)} is not {expected}"
        return NamelistError(fault, where=where, remedy=f"KID's default is {entry.default!r}")

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


def refused_entries(entries: Iterable[Entry], values: dict[str, Value]) -> list[tuple[Entry, Value]]:
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
    """Return the requirements of an entry, in words, where a group does not meet them; empty where the entry acts."""
    choices = [choice.split() for choice in NEEDS.get(name, "").split(" | ")]
    if any(all(bool(values.get(flag.lstrip("-"))) is not flag.startswith("-") for flag in choice) for choice in choices):
        return ""
    words = (" and ".join(f"{f.lstrip('-')} = {'.false.' if f[0] == '-' else '.true.'}" for f in choice) for choice in choices)
    return f"it acts with {', or with '.join(words)} only"
