"""From namelist to parameters: names, defaults and derived rules."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import pytest

from riftberg import A68A_2022_KID, Parameters
from riftberg.errors import NamelistError
from riftberg.kid.parameters import read_namelist, to_parameters

from .conftest import namelist_text

NEVER = sys.float_info.max


def mapped(tmp_path: Path, driver: dict[str, Any] | None = None, **icebergs: Any) -> Parameters:
    path = tmp_path / "input.nml"
    path.write_text(namelist_text(driver, icebergs))
    return to_parameters(read_namelist(path))


@pytest.mark.parametrize("name", ["a68_synthetic", "a68_story", "a68_oras5"])
def test_the_a68_namelist_is_the_preset(shared: Path, name: str) -> None:
    found = to_parameters(read_namelist(shared / "reference" / name / "input.nml"))
    life = {name: getattr(found, name).model_dump() for name in ("melt", "rolling", "footloose", "calving")}
    assert found == A68A_2022_KID.changed(bonds={"max_bonds": 4}, **life)
    assert found.melt.zero_rates
    assert not found.footloose.enabled


def test_defaults_of_a_silent_namelist(tmp_path: Path) -> None:
    path = tmp_path / "input.nml"
    path.write_text("&icebergs_driver_nml ni=2 nj=2/\n&icebergs_nml set_melt_rates_to_zero=T/\n")
    p = to_parameters(read_namelist(path))
    assert p.stepping.scheme == "runge_kutta"
    assert p.time_step == 3600.0
    assert p.ice.density == 850.0
    assert p.bonds.law == "none"
    assert p.bonds.max_bonds == 0
    assert p.contact.spring == p.bonds.spring == 1e-8
    assert (p.contact.radial_damping, p.contact.tangential_damping) == (1e-4, 2e-5)
    assert p.compatibility.damping_by_speed
    assert p.contact.tangential_critical_damping
    assert p.grounding.ramp_height == 100.0
    assert p.earth.radius == 6_360_000.0
    assert p.earth.period == 360.0
    assert not p.stepping.interactions
    assert not p.drag.rotational
    assert not p.bonds.objective_damping
    assert not p.grounding.implicit


@pytest.mark.parametrize(("given", "found"), [(0.0, 1e-5), (2e-7, 2e-7)])
def test_contact_spring(tmp_path: Path, given: float, found: float) -> None:
    assert mapped(tmp_path, contact_spring_coef=given).contact.spring == found


def test_a_negative_contact_spring_is_refused_at_reading(tmp_path: Path) -> None:
    """Bug: it was taken for 0, as the reference does, and a slip of sign ended late, in bergs that lie on each other."""
    with pytest.raises(NamelistError, match="contact_spring_coef = -3 is below 0"):
        mapped(tmp_path, contact_spring_coef=-3.0)


@pytest.mark.parametrize(
    ("latlon", "given", "found"), [(False, 360.0, -1.0), (True, 360.0, 360.0), (False, 20e3, 20e3), (True, -1.0, -1.0)]
)
def test_period(tmp_path: Path, latlon: bool, given: float, found: float) -> None:
    assert mapped(tmp_path, grid_is_latlon=latlon, Lx=given).earth.period == found


def test_mts_forces_verlet_and_dem_needs_mts(tmp_path: Path) -> None:
    assert mapped(tmp_path, Runge_not_Verlet=True).stepping.scheme == "mts"
    without = mapped(tmp_path, mts=False)
    assert without.stepping.scheme == "verlet"
    assert without.bonds.law == "spring"
    with pytest.raises(NamelistError, match="Runge_not_Verlet"):
        mapped(tmp_path, mts=False, Runge_not_Verlet=True)


def test_substeps_by_rule(tmp_path: Path) -> None:
    assert mapped(tmp_path, mts_sub_steps=-1).stepping.substeps == math.ceil(600.0 / (0.3 / math.sqrt(1e-5)))
    assert mapped(tmp_path, mts_sub_steps=77).stepping.substeps == 77
    with pytest.raises(NamelistError, match="mts_sub_steps = 0"):
        mapped(tmp_path, mts_sub_steps=0)
    with pytest.raises(NamelistError, match="spring_coef = 0"):
        mapped(tmp_path, mts_sub_steps=-1, spring_coef=0.0)


def test_fracture_off_without_criterion_and_thresholds(tmp_path: Path) -> None:
    assert not mapped(tmp_path).fracture.enabled


def test_fracture_after_the_long_step(tmp_path: Path) -> None:
    p = mapped(tmp_path, fracture_criterion="stress", frac_thres_n=2e3, frac_thres_scaling=1.5)
    assert p.fracture.enabled
    assert p.fracture.normal_strength == 3e3
    assert p.fracture.shear_strength == NEVER
    assert not p.fracture.on_substeps
    assert not mapped(tmp_path, fracture_criterion="stress").fracture.enabled


def test_fracture_on_substeps_takes_thresholds_as_they_are(tmp_path: Path) -> None:
    """Quirk Q8: no threshold of 0 means off here."""
    p = mapped(tmp_path, fracture_criterion="stress", frac_thres_t=5e3, break_bonds_on_sub_steps=True)
    assert p.fracture.enabled
    assert p.fracture.normal_strength == 0.0
    assert p.fracture.shear_strength == 5e3


def test_fracture_needs_the_stress_criterion(tmp_path: Path) -> None:
    with pytest.raises(NamelistError, match="fracture_criterion = 'none' with break_bonds_on_sub_steps"):
        mapped(tmp_path, break_bonds_on_sub_steps=True)
    with pytest.raises(NamelistError, match="fracture_criterion = 'strain'"):
        mapped(tmp_path, fracture_criterion="strain", frac_thres_n=1.0)


def test_broken_bonds_as_contact_only_on_substeps(tmp_path: Path) -> None:
    stress = {"fracture_criterion": "stress", "frac_thres_n": 1e3, "use_broken_bonds_for_substep_contact": True}
    assert not mapped(tmp_path, **stress).fracture.broken_as_contact
    assert mapped(tmp_path, break_bonds_on_sub_steps=True, **stress).fracture.broken_as_contact


def test_no_fracture_in_the_first_step_does_not_hold_inline(tmp_path: Path) -> None:
    """Quirk Q9."""
    p = mapped(tmp_path, no_frac_first_ts=True)
    assert p.fracture.not_in_first_step
    assert p.compatibility.inline_break_in_first_step


@pytest.mark.parametrize(
    ("changes", "plain"),
    [
        ({"mts": False}, True),
        ({"mts": True}, False),
        ({"mts": False, "contact_distance": 100.0}, False),
        ({"mts": False, "contact_spring_coef": 1e-7}, False),
        ({"mts": False, "contact_spring_coef": 1e-5}, True),
    ],
)
def test_plain_kid_branch(tmp_path: Path, changes: dict[str, Any], plain: bool) -> None:
    found = mapped(tmp_path, **changes).compatibility
    assert found.plain_kid_branch is plain
    assert found.grid_position_round_trip is plain


def test_switches(tmp_path: Path) -> None:
    p = mapped(
        tmp_path, orig_dem_moment_of_inertia=True, save_bond_forces=False, Static_icebergs=True,
        override_iceberg_velocities=True, u_override=0.3, v_override=-0.1, hexagonal_icebergs=True,
        short_step_mts_grounding=True, ignore_tangential_force=True,
    )  # fmt: skip
    assert p.bonds.linear_bending
    assert p.bonds.no_shear
    assert p.bonds.packing == "hexagonal"
    assert not p.compatibility.shared_shear_lever
    assert p.stepping.frozen
    assert p.stepping.fixed_velocity == (0.3, -0.1)
    assert p.grounding.on_substeps


@pytest.mark.parametrize("density", [0.85, 85.0, 8.5e-4])
def test_a_density_in_other_units_is_refused(tmp_path: Path, density: float) -> None:
    with pytest.raises(
        NamelistError, match=r"input.nml, &icebergs_nml: rho_bergs = .* is no density of ice.*in kg m-3"
    ):
        mapped(tmp_path, rho_bergs=density)


def test_impossible_value_names_the_entry(tmp_path: Path) -> None:
    with pytest.raises(NamelistError, match=r"input.nml, &icebergs_nml: gives ice.density(: | = )1100.0"):
        mapped(tmp_path, rho_bergs=1100.0)
    with pytest.raises(NamelistError, match="ibdt = -1"):
        mapped(tmp_path, driver={"ibdt": -1.0})
