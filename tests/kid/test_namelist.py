"""KID namelists: leniencies of Intel's compiler, and errors that say what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from riftberg.errors import NamelistError
from riftberg.kid.parameters import KidNamelist, read_namelist
from riftberg.kid.run import load_case

from .conftest import namelist_text

ACCEPTED = (
    "collision_KID", "collision_KID_wide", "collision_MTS_KID", "collision_MTS_KID_wide", "collision_iKID",
    "collision_iKID_wide", "dem_ssbeam", "dem_cbeam", "dem_ground_frac", "a68_synthetic", "a68_story", "a68_oras5",
)  # fmt: skip


def read(tmp_path: Path, icebergs: str = "", driver: str = "ni=2, nj=2") -> KidNamelist:
    path = tmp_path / "input.nml"
    path.write_text(f"&icebergs_driver_nml\n {driver}\n/\n&icebergs_nml\n{icebergs}\n/\n")
    return read_namelist(path)


@pytest.mark.parametrize(
    ("written", "name", "value"),
    [
        ("traj_name=KID.nc", "traj_name", "KID.nc"),
        ("traj_name = KID.nc ! comment with traj_name=other", "traj_name", "KID.nc"),
        ("restart_input_dir=INPUT/", "restart_input_dir", "INPUT/"),
        ("TRAJ_NAME='it''s.nc'", "traj_name", "it's.nc"),
        ("fracture_criterion=stress,", "fracture_criterion", "stress"),
        ("mts_sub_steps=1e5", "mts_sub_steps", 100_000),
        ("mts_sub_steps=1.e5", "mts_sub_steps", 100_000),
        ("MTS_sub_STEPS = 90", "mts_sub_steps", 90),
        ("spring_coef = 1.d-5", "spring_coef", 1e-5),
        ("spring_coef = 2", "spring_coef", 2.0),
        ("mts = T", "mts", True),
        ("mts = .t.", "mts", True),
        ("mts = .TRUE.", "mts", True),
        ("parallel_reprod = f", "parallel_reprod", False),
        ("mass_scaling = 10*1.0", "mass_scaling", (1.0,) * 10),
        ("mass_scaling = 2*3, 8*1", "mass_scaling", (3.0, 3.0) + (1.0,) * 8),
        ("initial_thickness(3:4) = 7., 8.", "initial_thickness", (40.0, 67.0, 7.0, 8.0) + (250.0,) * 6),
        ("spring_coef = 1., spring_coef = 3.", "spring_coef", 3.0),
        ("spring_coef =", "spring_coef", 1e-8),
        ("! nothing but a comment with / in it", "spring_coef", 1e-8),
    ],
)
def test_leniencies(tmp_path: Path, written: str, name: str, value: object) -> None:
    found = read(tmp_path, written).icebergs.values[name]
    assert found == value
    assert type(found) is type(value)


def test_old_style_group_ends(tmp_path: Path) -> None:
    path = tmp_path / "input.nml"
    driver = "&icebergs_driver_nml ni=3 nj=4 data_dir=./d/ /"
    path.write_text(f" $ICEBERGS_NML lat_ref=-55., mts=T, $END\n{driver}\n&fms_nml\n/")
    namelist = read_namelist(path)
    assert namelist.icebergs.number("lat_ref") == -55.0
    assert namelist.driver.whole("nj") == 4
    assert namelist.driver.text("data_dir") == "./d/"
    assert namelist.ignored_groups == ("fms_nml",)
    assert any("fms_nml: ignored" in line for line in namelist.report())


def test_unquoted_file_name_closed_by_slash_ends_the_group(tmp_path: Path) -> None:
    path = tmp_path / "input.nml"
    path.write_text("&icebergs_nml traj_name=out/KID.nc/\n&icebergs_driver_nml ni=2, nj=2 /\n")
    assert read_namelist(path).icebergs.text("traj_name") == "out/KID.nc"


def test_groups_of_other_programs_need_not_parse(tmp_path: Path) -> None:
    path = tmp_path / "input.nml"
    path.write_text(namelist_text() + "&diag_manager_nml\n x = %%% 'a/b' \n/\n")
    assert read_namelist(path).ignored_groups == ("diag_manager_nml",)


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ("spring_coeff = 1.0", ["unknown entry 'spring_coeff'", "Did you mean 'spring_coef'", "icebergs_nml"]),
        ("ibuo = 1.0", ["unknown entry 'ibuo'", "belongs to &icebergs_driver_nml"]),
        ("mts_sub_steps = 1.5", ["mts_sub_steps = 1.5", "whole number", "default is -1"]),
        ("mts = 3", ["mts = 3", "logical"]),
        ("spring_coef = 'stiff'", ["spring_coef = 'stiff'", "finite number"]),
        ("spring_coef = 1., 2.", ["spring_coef = [1.0, 2.0]", "single value"]),
        ("mass_scaling = 11*1.0", ["mass_scaling", "at most 10"]),
        ("traj_name = 'a', 'b'", ["traj_name = ['a', 'b']", "single value"]),
        ("initial_thickness(3) = 7., 8.", ["cannot be parsed", "8.0 is not assigned"]),
        ("spring_coef = 1.0, mts = ,, T ()", ["&icebergs_nml"]),
    ],
)
def test_wrong_entries_are_named(tmp_path: Path, written: str, words: list[str]) -> None:
    with pytest.raises(NamelistError) as error:
        read(tmp_path, written)
    for word in [*words, "input.nml"]:
        assert word in str(error.value)


def test_missing_file_group_and_end(tmp_path: Path) -> None:
    with pytest.raises(NamelistError, match="no such file"):
        read_namelist(tmp_path / "nothing.nml")
    path = tmp_path / "input.nml"
    path.write_text("&icebergs_nml\n/\n&ocean_nml\n/\n")
    with pytest.raises(NamelistError, match=r"&icebergs_driver_nml is missing.*&ocean_nml"):
        read_namelist(path)
    path.write_text("&icebergs_nml\n mts = T\n")
    with pytest.raises(NamelistError, match="&icebergs_nml has no end"):
        read_namelist(path)


def test_every_entry_of_a_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "input.nml"
    path.write_text(namelist_text())
    namelist = read_namelist(path)
    lines = namelist.report()
    for name in namelist.icebergs.given | namelist.driver.given:
        assert any(line.startswith(f"{name} = ") for line in lines), name
    assert any("add_weight_to_ocean = True (default): no effect here" in line for line in lines)


@pytest.mark.quick(3)
@pytest.mark.parametrize("name", ACCEPTED)
def test_reference_cases_are_accepted(shared: Path, name: str) -> None:
    assert load_case(shared / "reference" / name).clock.steps > 0


def test_coupling_cases_are_read(shared: Path) -> None:
    files = sorted((shared / "reference" / "coupling").glob("*/input.nml"))
    assert files
    for path in files:
        namelist = read_namelist(path)
        assert namelist.coupled
        assert namelist.driver.whole("nsteps") == 40
        assert any(line.startswith("add_weight_to_ocean = True (default): honoured") for line in namelist.report())


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_a_byte_order_mark_hides_no_group(tmp_path: Path, ends: str) -> None:
    """The first group was "missing" with it."""
    text = ends.join(["\ufeff&icebergs_driver_nml", " ni=2, nj=3", "/", "&icebergs_nml", " spring_coef = 2.", "/", ""])
    (tmp_path / "input.nml").write_bytes(text.encode())
    found = read_namelist(tmp_path / "input.nml")
    assert (found.driver.whole("nj"), found.icebergs.number("spring_coef")) == (3, 2.0)
