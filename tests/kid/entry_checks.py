"""What the specification says of the direction or size of a change, entry by entry: before and after, in one scheme."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from .scenes import BERG, Outcome, bergs

Check = Callable[[Outcome, Outcome], Any]
START: Final = bergs("berg")


def mean(name: str, run: Outcome) -> float:
    """Mean of a variable of the restart over all ice."""
    return float(np.average(run.state[name], weights=run.state["mass"]))


def grows(name: str) -> Check:
    """The mean over all ice is larger afterwards."""
    return lambda before, after: mean(name, after) > mean(name, before)


def shrinks(name: str) -> Check:
    """The mean over all ice is smaller afterwards."""
    return lambda before, after: mean(name, after) < mean(name, before)


def ice(run: Outcome) -> float:
    """All ice, with its bits, kg."""
    return float((run.state["mass_scaling"] * (run.state["mass"] + run.state["mass_of_bits"])).sum())


def melts_more(before: Outcome, after: Outcome) -> bool:
    """Less ice is left."""
    return ice(after) < ice(before)


def melts_less(before: Outcome, after: Outcome) -> bool:
    """More ice is left."""
    return ice(after) > ice(before)


def gap(run: Outcome) -> float:
    """Distance of the large berg from the element that it touches, m."""
    lon, lat = run.state["lon"], run.state["lat"]
    return float(np.hypot(lon[4] - lon[1], lat[4] - lat[1]))


def speed(run: Outcome) -> float:
    """Speed of the centre of all ice, m/s."""
    return float(np.hypot(mean("uvel", run), mean("vvel", run)))


def records(run: Outcome) -> int:
    """Records of elements."""
    return len(run.files["iceberg_trajectories.nc"]["lon"])


def newborn(name: str, run: Outcome) -> np.ndarray:
    """A variable of the bergs that calved."""
    return run.state[name][run.state["start_lon"] > 0.0]


def slimness(run: Outcome) -> float:
    """Length over width of the bergs that calved, which have melted a little."""
    return float(np.median(newborn("length", run) / newborn("width", run)))


def nearer_the_current(before: Outcome, after: Outcome) -> bool:
    """The centre of all ice moves more as the water does."""
    away = [np.hypot(mean("uvel", r) - BERG["ibuo"], mean("vvel", r) - BERG["ibvo"]) for r in (before, after)]
    return bool(away[1] < away[0])


def imposed(east: float, north: float) -> Check:
    """All elements have the imposed velocity, and have gone with it at least since the end of the first step."""

    def check(before: Outcome, after: Outcome) -> None:
        told = after.files["iceberg_trajectories.nc"]
        for name, place, velocity in (("uvel", "lon", east), ("vvel", "lat", north)):
            np.testing.assert_array_equal(after.state[name], velocity)
            by_step = told[place].reshape(4, 5)[:, np.argsort(told["id_cnt"][:5] * 2**20 + told["id_ij"][:5])]
            np.testing.assert_allclose(by_step[3] - by_step[0], 3 * 600.0 * velocity, rtol=1e-9, atol=1e-9)

    return check


def stands(before: Outcome, after: Outcome) -> bool:
    """Nothing moves."""
    return all(np.array_equal(after.state[name], START[name]) for name in ("lon", "lat", "uvel", "vvel"))


def keeps_mass(before: Outcome, after: Outcome) -> None:
    """The bergs are as they were at the start."""
    np.testing.assert_allclose(after.state["mass"], START["mass"], rtol=1e-15)


def rolled(before: Outcome, after: Outcome) -> bool:
    """The single berg lies on its side in one of the two runs."""
    return abs(before.state["thickness"][4] - after.state["thickness"][4]) > 10.0


def records_by(count: int) -> Check:
    """So many records are left of twenty."""
    return lambda before, after: (records(before), records(after)) == (20, count)


def has(file: str, *, after_only: bool = True) -> Check:
    """A file that only one of the runs has."""
    return lambda before, after: (file in after.files) is after_only and (file in before.files) is not after_only


def columns(*names: str) -> Check:
    """Variables of the trajectory that only one of the runs has."""
    return lambda before, after: all(
        (name in before.files["iceberg_trajectories.nc"]) != (name in after.files["iceberg_trajectories.nc"])
        for name in names
    )


def returned(name: str, factor: float) -> Check:
    """A field that the ocean gets is so many times what it was."""

    def check(before: Outcome, after: Outcome) -> None:
        np.testing.assert_allclose(after.files["ocean.nc"][name], factor * before.files["ocean.nc"][name], rtol=1e-13)

    return check


CHECKS: Final[dict[str, Check]] = {
    # The mean of all bergs: forces between them cancel there.
    "ocean_drag_scale": nearer_the_current,
    "lat_ref": shrinks("vvel"),  # from 60 S to 30 N: to the right of an eastward path
    "ibuo": grows("uvel"), "ibvo": grows("vvel"), "ibua": grows("uvel"), "ibuy": grows("vvel"),
    "uo0": grows("uvel"), "vo0": grows("vvel"), "ua0": grows("uvel"), "va0": grows("vvel"),
    "ui0": grows("uvel"), "vi0": grows("vvel"),
    "Static_icebergs": stands,
    "cdrag_grounding": lambda before, after: speed(after) < speed(before),
    "bump_depth": lambda before, after: speed(after) > speed(before),
    "h_to_init_grounding": lambda before, after: speed(after) > speed(before),
    "contact_spring_coef": lambda before, after: gap(after) > gap(before),
    "contact_distance": lambda before, after: gap(after) > gap(before),
    "interactive_icebergs_on": lambda before, after: gap(after) < gap(before),
    "Lx": lambda before, after: (after.state["lon"] < 20e3).all() and after.state["lon"].min() < 1e3,
    "ibdt": lambda before, after: (np.unique(after.files["iceberg_trajectories.nc"]["day"])[1] * 86400.0).round() == 500,
    "nmax": records_by(15),
    # Melt.
    "sst": melts_more, "sst0": melts_more, "sstk": melts_more, "utide_icebergs": melts_more, "Gamma_T_3EQ": melts_more,
    "cdrag_icebergs": melts_more, "ustar_icebergs_bg": melts_more, "sicn_shift": melts_less, "cn0": melts_less,
    "melt_cutoff": melts_less, "apply_thickness_cutoff_to_bergs_melt": melts_less,
    "melt_icebergs_as_ice_shelf": lambda before, after: np.array_equal(after.state["width"], START["width"]),
    "bergy_bit_erosion_fraction": grows("mass_of_bits"),
    "Iceberg_melt_without_decay": keeps_mass, "set_melt_rates_to_zero": keeps_mass,
    "allow_bergs_to_roll": rolled, "use_updated_rolling_scheme": rolled,
    # Calving.
    "LoW_ratio": lambda before, after: slimness(before) < slimness(after) < 1.9,
    "calvh0": lambda before, after: newborn("heat_density", after).min() < newborn("heat_density", before).min(),
    "mass_scaling": lambda before, after: set(newborn("mass_scaling", after)) == {2.0},
    "initial_mass": lambda before, after: set(newborn("start_mass", after)) == {5e7},
    "initial_mass_n": lambda before, after: set(newborn("start_mass", after)) == {5e7},
    "mass_scaling_n": lambda before, after: set(newborn("mass_scaling", after)) == {2.0},
    "initial_thickness": lambda before, after: newborn("thickness", after).min() > 80.0,
    "calv0": lambda before, after: len(after.state["mass"]) > len(before.state["mass"]),
    "footloose": lambda before, after: len(after.state["mass"]) > len(before.state["mass"]),
    "fl_strength": lambda before, after: after.state["fl_k"].max() != before.state["fl_k"].max(),
    # Files.
    "iceberg_bonds_on": has("iceberg_trajectories_bonds_restart.nc", after_only=False),
    "save_bond_traj": has("bond_trajectories.nc", after_only=False),
    "ignore_traj": has("iceberg_trajectories.nc", after_only=False),
    "traj_name": has("other.nc"), "bond_traj_name": has("other.nc"),
    "traj_sample_hrs": records_by(10), "debug_write": records_by(10), "traj_area_thres": records_by(16),
    "save_short_traj": columns("uvel_prev", "uo", "od", "width"), "save_fl_traj": columns("mass", "uvel"),
    "save_all_traj_year": lambda before, after: (records(before), records(after)) == (16, 20),
    "save_nonfl_traj_by_class": lambda before, after: (records(before), records(after)) == (16, 20),
    "traj_area_thres_sntbc": records_by(16), "save_traj_by_class_start_mass_thres_n": records_by(16),
    "passive_mode": returned("mass_berg", 0.0), "add_weight_to_ocean": returned("mass_berg", 0.0),
}  # fmt: skip
"""Where the specification says more than "differs"; a check asserts, or returns whether it holds."""

BY_SCHEME: Final[dict[tuple[str, str], Check]] = {
    **{("override_iceberg_velocities", scheme): imposed(0.25, -0.1) for scheme in ("verlet", "runge")},
    **{("u_override", scheme): imposed(0.25, 0.0) for scheme in ("verlet", "runge")},
    **{("v_override", scheme): imposed(0.0, 0.25) for scheme in ("verlet", "runge")},
    # With multiple steps no force acts and nothing sets the velocity: each keeps what it had (dynamics, 13.4).
    ("override_iceberg_velocities", "springs"): lambda before, after: np.array_equal(
        after.state["uvel"], START["uvel"]
    ),
    ("override_iceberg_velocities", "dem"): lambda before, after: np.array_equal(after.state["uvel"], START["uvel"]),
}
