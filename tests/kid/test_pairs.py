"""Pairs of namelist entries: a covering table over what is honoured, and a run of its own for each pair that is refused.

The table has every pair of values of its factors that may stand together, in some forty runs; all of them:
``python -m pytest -m "slow or not slow" tests/kid/test_pairs.py``. A random table is refused at once in 19 of 20 rows.
"""

from __future__ import annotations

import functools
from typing import Any, Final

import numpy as np
import pytest

from contract import HEAT_CLOSES, MASS_CLOSES
from riftberg.errors import InputError, RiftbergError
from riftberg.system.input_files import allow_extreme

from . import scenes
from .covering import Row, covering_table, uncovered
from .entry_trials import CUT, FLIP
from .entry_trials import ICEBERGS as TRIALS
from .scenes import COMMON, SCHEMES, Values, bergs

PERIODS: Final = {"berg": 20e3, "seamount": 225e3, "a68": 360.0, "ocean": 60e3}

FIXED: Final = {
    "Runge_not_Verlet", "mts", "dem", "grid_is_latlon", "Lx", "manually_initialize_bonds", "restart_input_dir", "A68_test",
    "traj_name", "bond_traj_name", "mts_sub_steps",
}  # fmt: skip
"""Entries that the factors "scheme", "scene" and "cyclic" set, or that name files."""

MORE: Final[dict[str, list[Any]]] = {
    "scheme": list(SCHEMES),
    "scene": list(PERIODS),
    "cyclic": [False, True],
    "fracture_criterion": ["none", "stress"],
    "frac_thres_n": [0.0, 25.0],
    "frac_thres_t": [0.0, 30.0],
    "length_for_manually_initialize_bonds": ["bonded", "part", -1.0],
    "fl_style": ["new_bergs", "fl_bits"],
    "mts_sub_steps": [20, 33],
    "ibdt": ["whole", "half"],
    "sea": ["warm", "cold"],
    "land": [False, True],
}
"""Factors that are no logical entry, and entries whose values go together."""

BONDING: Final = {
    ("berg", "bonded"): 430.0, ("berg", "part"): 406.0, ("seamount", "bonded"): 3300.0, ("seamount", "part"): 3050.0,
    ("a68", "bonded"): 3300.0, ("a68", "part"): 3050.0, ("ocean", "bonded"): -1.0, ("ocean", "part"): -1.0,
}  # fmt: skip


def all_factors() -> dict[str, list[Any]]:
    """Return the factors: those above, and the two values of each honoured entry of ``icebergs_nml``."""
    factors = dict(MORE)
    defaults = {entry.name: entry.default for entry in scenes_entries()}
    for name, trial in TRIALS.items():
        if name not in FIXED and name not in factors:
            value = {**defaults, **COMMON, **trial.given}[name] if name not in COMMON else COMMON[name]
            factors[name] = [value, not value if trial.value is FLIP else trial.value]
    return factors


def scenes_entries() -> Any:
    from riftberg.kid.entries import ICEBERGS

    return ICEBERGS


FORBIDDEN: Final = (
    ({"footloose": True}, {"scheme": "runge"}),
    ({"footloose": True}, {"use_operator_splitting": False}),
    ({"footloose": True}, {"manually_initialize_bonds_from_radii": True}),
    ({"footloose": True}, {"length_for_manually_initialize_bonds": "bonded"}),
    ({"footloose": True}, {"length_for_manually_initialize_bonds": "part"}),
    ({"fracture_criterion": "none"}, {"frac_thres_n": 25.0}),
    ({"fracture_criterion": "none"}, {"frac_thres_t": 30.0}),
    ({"fracture_criterion": "none"}, {"break_bonds_on_sub_steps": True}),
    ({"iceberg_bonds_on": True}, {"scene": "ocean"}),
    ({"save_bond_forces": False}, {"scheme": "dem"}),
    ({"cdrag_grounding": 2e3}, {"scene": "a68"}),
    ({"ibdt": "half"}, {"scene": "a68"}),
)
"""Pairs that are refused, or that no case can have; `REFUSED` runs each of them."""


def possible(a: str, v: Any, b: str, w: Any) -> bool:
    return not any(one.get(a, FLIP) == v and other.get(b, FLIP) == w for one, other in FORBIDDEN)


REFUSED: Final[dict[str, tuple[str, str, Values, Values, tuple[str, ...]]]] = {
    # name: scene, scheme, entries of the driver, of icebergs_nml, and what the refusal names
    "dem, Runge-Kutta": ("berg", "runge", {}, {"dem": True}, ("dem = .true.", "Runge_not_Verlet = .true.")),
    "footloose, Runge-Kutta": (
        "berg", "runge", {}, {"footloose": True}, ("footloose = .true.", "Runge_not_Verlet = .true.")),
    "footloose, no operator splitting": (
        "ocean", "verlet", {}, {"footloose": True, "use_operator_splitting": False},
        ("footloose = .true.", "use_operator_splitting = .false.")),
    "footloose, bonds": (
        "berg", "springs", {}, {"footloose": True}, ("footloose = .true.", "iceberg_bonds_on = .true.", "2 bonds")),
    "no criterion, tensile threshold": (
        "berg", "dem", {}, {"frac_thres_n": 25.0}, ("fracture_criterion = 'none'", "frac_thres_n")),
    "no criterion, shear threshold": (
        "berg", "dem", {}, {"frac_thres_t": 30.0}, ("fracture_criterion = 'none'", "frac_thres_t")),
    "no criterion, breaking on sub-steps": (
        "berg", "dem", {}, {"break_bonds_on_sub_steps": True},
        ("fracture_criterion = 'none'", "break_bonds_on_sub_steps = .true.")),
    "bonds by side, melt": (
        "berg", "dem", {}, {"save_bond_forces": False}, ("save_bond_forces = .false.", "that melt")),
    "bonds, an ocean": ("ocean", "verlet", {}, {"iceberg_bonds_on": True}, ("iceberg_bonds_on = T", "drv_nml")),
    "grounding, A68 data without depth": (
        "a68", "dem", {}, {"cdrag_grounding": 2e3, "A68_test": False}, ("cdrag_grounding > 0", "A68_test")),
    "grounding, A68 data without multiple steps": (
        "a68", "verlet", {}, {"cdrag_grounding": 2e3}, ("cdrag_grounding > 0", "mts = .true.")),
    "another step, hourly A68 data": ("a68", "dem", {"ibdt": 900.0}, {}, ("ibdt = 900.0", "hourly A68 data")),
    "no start, A68 data": (
        "a68", "dem", {"transient_a68_data_start_ind": 0}, {}, ("transient_a68_data_start_ind = 0", "a68_test")),
    "degrees, the driver's grid in metres": (
        "berg", "dem", {}, {"grid_is_latlon": True}, ("grid_is_latlon = True", "the driver's grid is in metres")),
    "degrees, an ocean": ("ocean", "dem", {}, {"grid_is_latlon": True}, ("grid_is_latlon = T", "drv_nml")),
    "metres, A68 data": (
        "a68", "dem", {}, {"grid_is_latlon": False}, ("grid_is_latlon = False", "the driver's grid is in degrees")),
    "a period, another width": ("berg", "dem", {}, {"Lx": 30e3}, ("Lx = 30000.0", "ni x gridres = 20000.0")),
    "the seamount, other cells": (
        "seamount", "dem", {"gridres": 1000.0}, {}, ("big_grounding_test", "gridres = 1000.0")),
    "no sub-steps, by rule": (
        "berg", "springs", {}, {"mts_sub_steps": -1, "spring_coef": 0.0}, ("mts_sub_steps = -1", "spring_coef = 0.0")),
    "no length, no steps": ("berg", "dem", {"ibhrs": 0, "nmax": 4}, {}, ("ibhrs = 0", "nmax = 4")),
    "one name, two files": (
        "berg", "dem", {}, {"traj_name": "a.nc", "bond_traj_name": "a.nc"}, ("traj_name", "bond_traj_name", "'a.nc'")),
}  # fmt: skip
"""Pairs that are refused before the first step, and what the refusal names: both entries."""


@pytest.mark.quick(5)
@pytest.mark.parametrize("name", REFUSED)
def test_a_refused_pair_is_named(name: str) -> None:
    scene, scheme, driver, icebergs, words = REFUSED[name]
    with pytest.raises(InputError) as refusal:
        scenes.run(scene, scheme, driver, icebergs)
    assert not [word for word in (*words, "input.nml", "icebergs") if word not in str(refusal.value)]


FACTORS: Final = all_factors()

MASKS: Final = {
    "Static_icebergs": False, "only_interactive_forces": False, "override_iceberg_velocities": False, "ignore_traj": False,
    "set_melt_rates_to_zero": False, "Iceberg_melt_without_decay": False, "interactive_icebergs_on": True,
}  # fmt: skip
"""Entries that hide what others do, at the value at which they do not: all pairs of the others stand in such rows."""

ROWS: Final = 36
QUICK: Final = (0, 7, 14, 21, 28, 35)


@functools.cache
def table() -> list[Row]:
    plain = {name: [MASKS[name]] if name in MASKS else values for name, values in FACTORS.items()}
    return covering_table(FACTORS, possible, rows=covering_table(plain, possible))


NO_ENTRIES: Final = ("scheme", "scene", "cyclic", "ibdt", "sea", "land")


def run_row(row: Row) -> scenes.Outcome:
    entries = {name: value for name, value in row.items() if name not in NO_ENTRIES}
    scene, bonds = row["scene"], row["length_for_manually_initialize_bonds"]
    entries["length_for_manually_initialize_bonds"] = BONDING.get((scene, bonds), -1.0)
    entries["Lx"] = PERIODS[scene] if row["cyclic"] else -1.0
    if scene == "a68":
        entries["A68_test"] = True
    entries["spring_coef"] *= 1.0 if scene == "berg" else 1e-2  # larger bergs are softer in these units
    entries["contact_spring_coef"] *= 1.0 if scene == "berg" else 1e-2
    driver: Values = {"dt" if scene == "ocean" else "ibdt": 300.0} if row["ibdt"] == "half" else {}
    driver["sst0" if scene == "ocean" else "sst"] = 3.0 if row["sea"] == "warm" else -1.5
    if row["land"] and scene == "ocean":
        driver["land"] = 1.0
    restart = CUT if row["footloose"] else {}
    # Winds of A68's files, in m/s, are stresses of 10 Pa where an entry takes them as that: meant here.
    with allow_extreme(scene == "a68"):
        return scenes.run(scene, row["scheme"], driver, entries, restart=restart)


def test_the_table_covers_every_possible_pair() -> None:
    assert len(FACTORS) > 110
    assert len(table()) == ROWS
    assert uncovered(table(), FACTORS, possible) == []
    for row in table():
        assert all(possible(a, row[a], b, row[b]) for a in row for b in row)


def rows() -> list[Any]:
    return [pytest.param(k, marks=() if k in QUICK else pytest.mark.slow, id=f"row{k}") for k in range(ROWS)]


_RAN: dict[int, bool] = {}


@pytest.mark.quick(3)
@pytest.mark.parametrize("number", rows())
def test_a_row_runs_with_its_ledger_closed(number: int) -> None:
    """Nothing but Riftberg's own errors comes out; what runs is finite, and its ice is all accounted for."""
    row = table()[number]
    try:
        found = run_row(row)
    except RiftbergError:  # refused in words
        _RAN[number] = False
        return
    _RAN[number] = True
    for name, file in found.files.items():
        for variable, values in file.items():
            assert np.isfinite(values).all(), (name, variable)
    if found.ledger is not None:
        assert abs(found.ledger) <= MASS_CLOSES
        assert found.heat is not None
        assert abs(found.heat) <= HEAT_CLOSES
    else:
        np.testing.assert_array_equal(np.sort(found.state["mass"]), np.sort(bergs(row["scene"])["mass"]))


def test_at_least_nine_rows_of_ten_run() -> None:
    """Counts the rows that this process ran: the sample, or all."""
    assert len(_RAN) >= 3
    assert sum(_RAN.values()) >= 0.9 * len(_RAN)
