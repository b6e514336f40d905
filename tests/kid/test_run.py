"""Whole KID runs: files written, case folder only read, refusals before the first step."""

from __future__ import annotations

import os
import shutil
import stat
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg import Model
from riftberg.errors import InputError, NamelistError, RunError
from riftberg.kid.restart import write_bonds
from riftberg.kid.run import load_case, run_kid

from . import scenes
from .conftest import namelist_text, restart_variables, write_nc


def change(case: Path, driver: dict[str, Any] | None = None, **icebergs: Any) -> Path:
    (case / "input.nml").write_text(namelist_text(driver, icebergs))
    return case


def read(path: Path) -> dict[str, Any]:
    with netCDF4.Dataset(path) as dataset:
        dataset.set_auto_mask(False)
        return {name: variable[...] for name, variable in dataset.variables.items()}


def test_a_run_from_a_folder_that_is_only_read(case: Path, tmp_path: Path) -> None:
    before = {p: p.read_bytes() for p in case.rglob("*") if p.is_file()}
    for path in [case, *case.rglob("*")]:
        path.chmod(stat.S_IRUSR | (stat.S_IXUSR if path.is_dir() else 0))
    try:
        report = run_kid(case, tmp_path / "out" / "KID.nc")
        assert {p: p.read_bytes() for p in case.rglob("*") if p.is_file()} == before
    finally:
        for path in [case, *case.rglob("*")]:
            os.chmod(path, stat.S_IRWXU)
    names = [path.name for path in report.files]
    assert names == ["KID.nc", "KID_bonds.nc", "KID_restart.nc", "KID_bonds_restart.nc"]
    assert all(path.is_file() for path in report.files)
    found = read(report.files[0])
    assert found["day"].tolist() == [0.0, 0.0, 1 / 24, 1 / 24]
    assert found["n_bonds"].tolist() == [1] * 4
    assert 0.0 < found["uvel"][0] < found["uvel"][2] < 0.1
    assert "spring_coef = 1e-05: honoured" in report.describe()
    assert "KID_restart.nc" in report.describe()
    restart = read(report.files[2])
    np.testing.assert_array_equal(restart["lon"], report.case.model.elements.lon)
    assert len(read(report.files[3])["tangd1"]) == 2


def test_a_run_that_fails_leaves_its_last_good_state(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(model: Model) -> None:
        if model.step_number == 2:
            raise RunError("it blew up")
        step(model)

    step = Model.step
    monkeypatch.setattr(Model, "step", fail)
    with pytest.raises(RunError, match=r"it blew up; the last good state is in .*t_restart.nc.*To go on, put"):
        run_kid(change(case, traj_sample_hrs=-1.0), tmp_path / "t.nc")
    assert len(read(tmp_path / "t.nc")["lon"]) == 4
    np.testing.assert_array_equal(read(tmp_path / "t_restart.nc")["lon"], read(tmp_path / "t.nc")["lon"][2:])


def test_what_goes_on_takes_the_steps_and_hours_that_are_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bug: followed to the letter, the advice went on with the first hour of the forcing, for all steps again."""
    whole = scenes.run("a68", "verlet").state
    step = Model.step

    def fail(model: Model) -> None:
        if model.step_number == 2:
            raise RunError("it blew up")
        step(model)

    folder = tmp_path / "case"
    folder.mkdir()
    (folder / "input.nml").write_text(scenes.text_of("a68", "verlet", {}, {}))
    write_nc(folder / "INPUT" / "icebergs.res.nc", scenes.bergs("a68"))
    scenes.write_a68_data(folder / "data")
    monkeypatch.setattr(Model, "step", fail)
    with pytest.raises(RunError, match=r"set nmax = 2 and transient_a68_data_start_ind = 2$"):
        run_kid(folder, tmp_path / "t.nc")
    monkeypatch.setattr(Model, "step", step)

    def go_on(copy: Path) -> None:
        shutil.copy(tmp_path / "t_restart.nc", copy / "INPUT" / "icebergs.res.nc")
        shutil.copy(tmp_path / "t_bonds_restart.nc", copy / "INPUT" / "bonds_iceberg.res.nc")

    rest = {"nmax": 2, "transient_a68_data_start_ind": 2}
    found = scenes.run("a68", "verlet", rest, {"manually_initialize_bonds": False}, prepare=go_on).state
    for name in ("uvel", "vvel", "lon", "lat"):
        np.testing.assert_allclose(found[name], whole[name], rtol=1e-9)


def test_output_folder_takes_the_names_of_the_namelist(case: Path, tmp_path: Path) -> None:
    change(case, {"nmax": 1}, traj_name="mine.nc", bond_traj_name="bonds.nc")
    out = tmp_path / "out"
    out.mkdir()
    names = sorted(path.name for path in run_kid(case, out).files)
    assert names == ["bonds.nc", "mine.nc", "mine_bonds_restart.nc", "mine_restart.nc"]


def test_no_trajectory(case: Path, tmp_path: Path) -> None:
    change(case, {"nmax": 1}, ignore_traj=True, iceberg_bonds_on=False, dem=False)
    assert [path.name for path in run_kid(case, tmp_path / "t.nc").files] == ["t_restart.nc"]


def test_bonds_are_read_where_the_namelist_says_so(case: Path) -> None:
    formed = load_case(case)
    elements = formed.model.elements
    formed.model.bonds.shear_x[:] = 0.25
    write_bonds(case / "INPUT" / "bonds_iceberg.res.nc", elements, formed.model.bonds, formed.grid, dem=True)
    loaded = load_case(change(case, manually_initialize_bonds=False))
    assert loaded.model.bonds.shear_x.tolist() == [0.25]
    (case / "INPUT" / "bonds_iceberg.res.nc").unlink()
    with pytest.raises(InputError, match=r"bonds_iceberg.res.nc: no such file"):
        load_case(case)


def test_bonds_by_length(case: Path) -> None:
    by_length = {"manually_initialize_bonds_from_radii": False}
    assert len(load_case(change(case, length_for_manually_initialize_bonds=401.0, **by_length)).model.bonds.first) == 1
    assert len(load_case(change(case, length_for_manually_initialize_bonds=399.0, **by_length)).model.bonds.first) == 0


def test_width_and_length_are_ordered(case: Path) -> None:
    values = restart_variables()
    values["width"][:] = 500.0
    write_nc(case / "INPUT" / "icebergs.res.nc", values)
    loaded = load_case(case)
    assert loaded.model.elements.length.tolist() == [500.0, 500.0]
    assert loaded.model.elements.width.tolist() == [400.0, 400.0]
    assert "length and width exchanged in 2 elements" in loaded.notes[0]


def thick(case: Path, **icebergs: Any) -> Path:
    values = restart_variables()
    values["thickness"][:] = 700.0
    write_nc(case / "INPUT" / "icebergs.res.nc", values)
    return change(case, allow_bergs_to_roll=True, use_updated_rolling_scheme=True, **icebergs)


def test_life_is_attached_where_an_element_could_roll(case: Path) -> None:
    """Section 1.11 with the updated scheme: sqrt(6 q (1 - q)) T > W; bonded elements never roll unless bonds break."""
    assert load_case(thick(case)).model.life is None
    assert load_case(thick(case, fracture_criterion="stress", frac_thres_n=1e3)).model.life is not None
    assert load_case(thick(case, iceberg_bonds_on=False)).model.life is not None
    assert load_case(thick(case, iceberg_bonds_on=False, tip_parameter=0.5)).model.life is None
    assert load_case(thick(case, iceberg_bonds_on=False, tip_parameter=0.6)).model.life is not None


def test_elements_roll_although_the_rates_are_zero(case: Path) -> None:
    """The mass stays, thickness and width change places, in the first step."""
    model = load_case(thick(case, iceberg_bonds_on=False)).model
    before = model.elements.mass.copy()
    model.step()
    assert model.elements.thickness.tolist() == [400.0, 400.0]
    assert model.elements.width.tolist() == [400.0, 400.0]
    assert model.elements.length.tolist() == [700.0, 700.0]
    np.testing.assert_array_equal(model.elements.mass, before)


def test_legacy_rolling_schemes(case: Path) -> None:
    """Scheme 3: max(W, L) < sqrt(0.92 D2 + 58.32 D); scheme 2 has no real root below T = 133 m, so thin ones stay."""
    legacy = {"iceberg_bonds_on": False, "use_updated_rolling_scheme": False}
    thick(case)
    assert load_case(change(case, allow_bergs_to_roll=True, **legacy)).model.life is not None
    assert load_case(change(case, allow_bergs_to_roll=True, tip_parameter=999.0, **legacy)).model.life is not None


def test_bits_melt_although_the_rates_are_zero(case: Path) -> None:
    """Quirk T5; without the fraction nothing happens to them."""
    write_nc(case / "INPUT" / "icebergs.res.nc", {**restart_variables(), "mass_of_bits": np.full(2, 1e6)})
    assert load_case(case).model.life is None
    model = load_case(change(case, {"ibuo": 0.3, "sst": 2.0}, bergy_bit_erosion_fraction=0.2)).model
    mass = model.elements.mass.copy()
    model.advance(steps=2)
    assert (model.elements.mass_of_bits < 1e6).all()
    np.testing.assert_array_equal(model.elements.mass, mass)


@pytest.mark.parametrize(("stored", "refused"), [(1e11, False), (3e11, True)])
def test_a_full_calving_store_is_refused(case: Path, stored: float, refused: bool) -> None:
    """Class 10 calves at 7.4e11 kg x 1, class 1 at 8.8e7 kg x 2000 = 1.76e11 kg."""
    with netCDF4.Dataset(case / "INPUT" / "calving.res.nc", "w") as dataset:
        for name, size in (("Time", 1), ("zaxis_1", 10), ("yaxis_1", 20), ("xaxis_1", 20)):
            dataset.createDimension(name, size)
        values = dataset.createVariable("stored_ice", "f8", ("Time", "zaxis_1", "yaxis_1", "xaxis_1"))
        values[:] = 0.0
        values[0, 0, 3, 4] = stored
    if refused:
        with pytest.raises(NamelistError, match=r"stores 3e\+11 kg in size class 1"):
            load_case(case)
    else:
        load_case(case)


def test_beam_test_puts_loads_and_origin(case: Path) -> None:
    loaded = load_case(change(case, dem_beam_test=2))
    assert loaded.model.elements.load_y.tolist() == [0.0, -1.5e10 / 3.0]
    assert loaded.model.elements.start_lon.tolist() == loaded.model.elements.lon.tolist()


def test_missing_folder_namelist_and_restart(case: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        load_case(tmp_path / "nowhere")
    (case / "INPUT" / "icebergs.res.nc").unlink()
    with pytest.raises(InputError, match=r"INPUT/icebergs.res.nc: no such file"):
        load_case(case)
    (case / "input.nml").unlink()
    with pytest.raises(NamelistError, match=r"input.nml: no such file"):
        load_case(case)


def test_a_refused_run_writes_nothing(case: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(NamelistError, match="add_iceberg_thickness_to_SSH"):
        run_kid(change(case, add_iceberg_thickness_to_SSH=True), out / "t.nc")
    assert not out.exists()


@pytest.mark.parametrize(
    ("name", "bonds"),
    [
        ("collision_KID", 26),
        ("collision_iKID_wide", 26),
        ("dem_ssbeam", 28),
        ("dem_cbeam", 147),
        ("a68_synthetic", None),
    ],
)
def test_reference_cases_load(shared: Path, name: str, bonds: int | None) -> None:
    loaded = load_case(shared / "reference" / name)
    if bonds is not None:
        assert len(loaded.model.bonds.first) == bonds
    with netCDF4.Dataset(shared / "reference" / name / "expected" / "final_restart.nc") as dataset:
        known = {(int(c), int(i)) for c, i in zip(dataset["id_cnt"][:], dataset["id_ij"][:], strict=True)}
    ids = loaded.model.elements.id
    assert {(int(k >> 32), int(k & 0xFFFFFFFF)) for k in ids} == known


def test_colliding_bergs_follow_the_reference(shared: Path, tmp_path: Path) -> None:
    """collision_iKID crosses the periodic boundary; all recorded variables agree, and so does the restart."""
    case = shared / "reference" / "collision_iKID"
    report = run_kid(case, tmp_path / "t.nc")
    ours, theirs = read(report.files[0]), read(case / "expected" / "trajectories.nc")
    a, b = (np.lexsort((q["id_ij"], q["id_cnt"], q["day"])) for q in (ours, theirs))
    assert len(a) == len(b) == 768
    for name in theirs:
        if name != "n_bonds":  # wrong in the reference on more than one process
            tolerance = 1e-6 if name in ("lon", "lat") else 1e-9
            np.testing.assert_allclose(ours[name][a], theirs[name][b], rtol=0, atol=tolerance, err_msg=name)
    restart, expected = read(report.files[1]), read(case / "expected" / "final_restart.nc")
    a, b = (np.lexsort((q["id_ij"], q["id_cnt"])) for q in (restart, expected))
    assert set(restart) - {"i"} == set(expected) - {"i"}
    for name in set(expected) - {"i"}:
        np.testing.assert_allclose(restart[name][a], expected[name][b], rtol=1e-12, atol=1e-6, err_msg=name)
