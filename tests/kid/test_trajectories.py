"""KID's trajectory files: layout, stamps, sampling, selection, blocks."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import netCDF4
import numpy as np
import pytest

from riftberg.bergs.bonding import BondRule, Metric, form_bonds
from riftberg.errors import InputError, NamelistError
from riftberg.kid import ncfile
from riftberg.kid.parameters import Clock, KidNamelist, read_namelist, to_parameters
from riftberg.kid.restart import join_id
from riftberg.kid.trajectories import BondRecorder, TrajectoryRecorder
from riftberg.state import new_elements

from .conftest import namelist_text


class Ocean:
    """A forcing that notes at which times it was asked."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def sample(self, elements: Any, time: float) -> None:
        self.asked.append(time)
        elements.uo[:], elements.depth[:] = 0.5, 77.0


def namelist(tmp_path: Path, **icebergs: Any) -> KidNamelist:
    path = tmp_path / "input.nml"
    path.write_text(namelist_text({}, icebergs))
    return read_namelist(path)


def fake_model(tmp_path: Path, size: int = 3, **icebergs: Any) -> Any:
    """Return something with the attributes of a model that recorders read: a row of squares, all values different."""
    elements = new_elements(size)
    for k, name in enumerate(elements.arrays()):
        getattr(elements, name)[:] = 100 * k + np.arange(size)
    elements.id[:] = join_id(np.arange(1, size + 1), 10 * np.arange(1, size + 1))
    elements.lon[:], elements.lat[:] = 400.0 * np.arange(size), 50.0
    elements.length[:] = elements.width[:] = 400.0
    elements.life.start_mass[:], elements.life.fl_k[:] = 5.0, 0.0
    elements.thickness[:], elements.mass[:] = 200.0, 850.0 * 200.0 * 400.0**2
    bonds = form_bonds(elements, BondRule(), Metric(latlon=False))
    nml = namelist(tmp_path, **icebergs)
    return SimpleNamespace(
        elements=elements, bonds=bonds, parameters=to_parameters(nml), step_number=0, forcing=Ocean(), namelist=nml
    )


def recorder(kind: Any, model: Any, path: Path, dt: float = 1800.0) -> Any:
    return kind(path, model.namelist.icebergs, Clock(dt, 100, 0.0))


def run(kind: Any, model: Any, path: Path, steps: int, dt: float = 1800.0) -> dict[str, Any]:
    writer = recorder(kind, model, path, dt)
    writer.start(model)
    for _ in range(steps):
        model.step_number += 1
        writer.record(model)
    writer.finish(model)
    with netCDF4.Dataset(path) as dataset:
        dataset.set_auto_mask(False)
        return {name: variable[:] for name, variable in dataset.variables.items()}


def test_values_and_stamps(tmp_path: Path) -> None:
    """Hourly records of half-hour steps; the stamp is the start of the step (quirks Q7, T28)."""
    model = fake_model(tmp_path, traj_sample_hrs=1.0)
    found = run(TrajectoryRecorder, model, tmp_path / "t.nc", steps=6)
    assert found["day"].tolist() == [0.0] * 3 + [1 / 24] * 3 + [2 / 24] * 3
    assert found["year"].tolist() == [1] * 9
    assert found["id_cnt"].tolist() == [1, 2, 3] * 3
    assert found["id_ij"].tolist() == [10, 20, 30] * 3
    renamed = {"uvel": "u", "vvel": "v", "uvel_prev": "u_sync", "vvel_prev": "v_sync", "ssh_x": "slope_x", "ssh_y": "slope_y",
               "cn": "ice_fraction", "hi": "ice_thickness", "od": "depth", "ang_vel": "spin", "ang_accel": "spin_rate",
               "rot": "rotation"}  # fmt: skip
    renamed |= {f"{a}{x}n{fast}": f"{a}{x}{fast}" for a in "ab" for x in "xy" for fast in ("", "_fast")}
    known = {name: renamed.get(name, name) for name in found if renamed.get(name, name) in model.elements.arrays()}
    assert set(found) - set(known) == {"year", "day", "id_cnt", "id_ij", "halo_berg", "n_bonds"}
    for name, field in known.items():
        np.testing.assert_array_equal(found[name][:3], getattr(model.elements, field), err_msg=name)
    assert not found["halo_berg"].any()


def test_every_step(tmp_path: Path) -> None:
    found = run(TrajectoryRecorder, fake_model(tmp_path, traj_sample_hrs=-1.0), tmp_path / "t.nc", steps=5)
    assert len(found["day"]) == 15


@pytest.mark.parametrize(
    ("icebergs", "size", "absent"),
    [
        ({}, 43, ""),
        ({"save_short_traj": True}, 12, "uo"),
        ({"save_short_traj": True, "save_fl_traj": False}, 6, "uvel"),
        ({"save_fl_traj": False}, 37, "uvel"),
        ({"dem": False}, 40, "rot"),
        ({"iceberg_bonds_on": False}, 42, "n_bonds"),
        ({"mts": False, "dem": False}, 36, "axn_fast"),
    ],
)
def test_layouts(tmp_path: Path, icebergs: dict[str, Any], size: int, absent: str) -> None:
    names = list(run(TrajectoryRecorder, fake_model(tmp_path, **icebergs), tmp_path / "t.nc", steps=1))
    assert len(names) == size
    assert absent not in names


@pytest.mark.parametrize("name", ["collision_KID", "collision_iKID", "a68_story"])
def test_names_and_attributes_are_those_of_the_reference(shared: Path, tmp_path: Path, name: str) -> None:
    case = shared / "reference" / name
    nml = read_namelist(case / "input.nml")
    model = fake_model(tmp_path)
    model.namelist, model.parameters = nml, to_parameters(nml)
    run(TrajectoryRecorder, model, tmp_path / "t.nc", steps=1)
    with netCDF4.Dataset(tmp_path / "t.nc") as ours, netCDF4.Dataset(case / "expected" / "trajectories.nc") as theirs:
        for name, variable in theirs.variables.items():
            assert (ours[name].long_name, ours[name].units) == (variable.long_name, variable.units)
            assert ours[name].dtype == variable.dtype


def test_bond_columns_are_those_of_the_reference(tmp_path: Path, shared: Path) -> None:
    run(BondRecorder, fake_model(tmp_path), tmp_path / "b.nc", steps=1)
    reference = shared / "reference" / "a68_story" / "expected" / "bonds.nc"
    with netCDF4.Dataset(tmp_path / "b.nc") as ours, netCDF4.Dataset(reference) as theirs:
        assert list(ours.variables) == list(theirs.variables)
        for name, variable in theirs.variables.items():
            assert (ours[name].long_name, ours[name].units) == (variable.long_name, variable.units)


def test_bond_records(tmp_path: Path) -> None:
    """Both directions; displacements change sign, stresses do not; n is divided by the berg's length (T36)."""
    model = fake_model(tmp_path, size=4)
    model.bonds.status[:] = 0, 1, 2
    model.bonds.shear_x[:], model.bonds.normal_stress[:] = 3.0, 4.0
    model.elements.length[:] = 800.0
    found = run(BondRecorder, model, tmp_path / "b.nc", steps=1)
    assert found["id_cnt1"].tolist() == [1, 2, 2, 3]
    assert found["id_cnt2"].tolist() == [2, 3, 1, 2]
    assert found["lon"].tolist() == [200.0, 600.0, 200.0, 600.0]
    assert found["n1"].tolist() == [-0.5, -0.5, 0.5, 0.5]
    assert found["tangd1"].tolist() == [3.0, 3.0, -3.0, -3.0]
    assert found["nstress"].tolist() == [4.0] * 4
    assert found["broken"].tolist() == [0, 1, 0, 1]
    assert found["length"].tolist() == [400.0] * 4


def test_spring_bonds_record_the_initial_length(tmp_path: Path) -> None:
    model = fake_model(tmp_path, dem=False)
    writer = recorder(BondRecorder, model, tmp_path / "b.nc")
    writer.start(model)
    model.elements.lon[:] *= 2.0
    model.step_number = 1
    writer.record(model)
    writer.finish(model)
    with netCDF4.Dataset(tmp_path / "b.nc") as dataset:
        assert dataset["length"][:].tolist() == [400.0] * 4
        assert "tangd1" not in dataset.variables


def test_single_step_schemes_look_around_after_the_move(tmp_path: Path) -> None:
    """The environment is that of the new position and the old fields, the depth that of the step (files 1.1)."""
    model = fake_model(tmp_path, mts=False, dem=False, traj_sample_hrs=-1.0)
    depth = model.elements.depth.copy()
    found = run(TrajectoryRecorder, model, tmp_path / "t.nc", steps=2)
    assert model.forcing.asked == [0.0, 1800.0]
    assert set(found["uo"]) == {0.5}
    np.testing.assert_array_equal(found["od"][:3], depth)
    multiple = fake_model(tmp_path)
    run(TrajectoryRecorder, multiple, tmp_path / "m.nc", steps=2)
    assert multiple.forcing.asked == []


def test_selection_by_area_bonds_year_and_class(tmp_path: Path) -> None:
    def chosen(year: int = 1, **icebergs: Any) -> list[int]:
        """Return the elements that a step in a year records: the first is bonded, the third the largest."""
        model = fake_model(tmp_path, traj_area_thres=0.2, traj_sample_hrs=-1.0, **icebergs)
        model.elements.bond_count[:] = 1, 0, 0
        model.elements.mass[2] *= 2.0
        model.step_number = round((year - 1) * 360 * 48)
        return (run(TrajectoryRecorder, model, tmp_path / "t.nc", steps=1)["id_cnt"] - 1).tolist()

    assert chosen() == [0, 2]
    assert chosen(2, save_all_traj_year=1.0) == [0, 1, 2]
    assert chosen(1, save_all_traj_year=1.0) == [0, 2]
    by_class = {"save_nonfl_traj_by_class": True}
    assert chosen(save_traj_by_class_start_mass_thres_n=6.0, **by_class) == [0, 2]
    assert chosen(save_traj_by_class_start_mass_thres_n=5.0, **by_class) == [0, 1, 2]


def test_sampling_counts_from_the_month(tmp_path: Path) -> None:
    """Quirk T23: 7 hours do not divide a month, so the rhythm starts anew."""
    model = fake_model(tmp_path, size=1, traj_sample_hrs=7.0)
    model.step_number = 29 * 24
    found = run(TrajectoryRecorder, model, tmp_path / "t.nc", steps=72, dt=3600.0)["day"]
    hours = np.round(24.0 * found).astype(int)
    assert (np.diff(hours) != 7).any()
    # Hours of the day of the month, which counts from 1; the year's day counts 31 days for every month.
    assert ((24 * (hours // 24 % 31 + 1) + hours % 24) % 7 == 0).all()


@pytest.mark.parametrize(
    ("dt", "hours", "first"),
    [
        (60.0, 1.0, [0, 3600, 7200]),
        (100.0, 0.05, [0, 900, 1800]),
        (1800.0, 1.0, [0, 3600, 7200]),
        (7.0, -1.0, [0, 7, 14]),
    ],
)
def test_sampling(tmp_path: Path, dt: float, hours: float, first: list[float]) -> None:
    model = fake_model(tmp_path, size=1, traj_sample_hrs=hours)
    starts = 86_400.0 * run(TrajectoryRecorder, model, tmp_path / "t.nc", steps=150, dt=dt)["day"]
    assert starts[:3] == pytest.approx(first, abs=1e-6)


@pytest.mark.parametrize("hours", [0.0, -2.0])
def test_no_interval(tmp_path: Path, hours: float) -> None:
    with pytest.raises(NamelistError, match=f"traj_sample_hrs = {hours}"):
        recorder(TrajectoryRecorder, fake_model(tmp_path, traj_sample_hrs=hours), tmp_path / "t.nc")


def test_debug_write_samples_at_the_writing_interval(tmp_path: Path) -> None:
    model = fake_model(tmp_path, debug_write=True, traj_write_hrs=2.0, traj_sample_hrs=1.0)
    assert len(run(TrajectoryRecorder, model, tmp_path / "t.nc", steps=8)["day"]) == 6


def lengths(writer: Any, model: Any, path: Path, steps: int) -> list[int]:
    """Return how many records a copy of the file has after each step, then the file itself."""
    found = []
    writer.start(model)
    for _ in range(steps):
        model.step_number += 1
        writer.record(model)
        (path.parent / "copy.nc").write_bytes(path.read_bytes())
        with netCDF4.Dataset(path.parent / "copy.nc") as dataset:
            found.append(len(dataset["lon"]))
    writer.finish(model)
    with netCDF4.Dataset(path) as dataset:
        return [*found, len(dataset["lon"])]


def test_an_interrupted_run_keeps_its_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ncfile, "BLOCK_RECORDS", 4)
    model = fake_model(tmp_path, size=2, traj_sample_hrs=-1.0)
    writer = recorder(TrajectoryRecorder, model, tmp_path / "b.nc")
    assert lengths(writer, model, tmp_path / "b.nc", 3) == [0, 4, 4, 6]


def test_writing_interval_brings_records_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ncfile, "PATIENCE", 0.0)  # else these would be held for a part of a second
    model = fake_model(tmp_path, traj_sample_hrs=-1.0, traj_write_hrs=1.0)
    writer = recorder(TrajectoryRecorder, model, tmp_path / "t.nc")
    writer.start(model)
    for _ in range(4):
        model.step_number += 1
        writer.record(model)
    copy = tmp_path / "copy.nc"
    copy.write_bytes((tmp_path / "t.nc").read_bytes())
    with netCDF4.Dataset(copy) as dataset:
        assert len(dataset["lon"]) == 9
    writer.finish(model)


def test_unwritable_output(tmp_path: Path) -> None:
    model = fake_model(tmp_path)
    with pytest.raises(InputError, match="cannot be written"):
        recorder(TrajectoryRecorder, model, tmp_path / "no" / "folder.nc").start(model)


def test_values_are_copied_when_recorded(tmp_path: Path) -> None:
    """The state is changed in place by the next step while records still wait."""
    model = fake_model(tmp_path, traj_sample_hrs=-1.0)
    writer = recorder(TrajectoryRecorder, model, tmp_path / "t.nc")
    writer.start(model)
    model.step_number = 1
    writer.record(model)
    model.elements.lat[:] = -1.0
    writer.finish(model)
    with netCDF4.Dataset(tmp_path / "t.nc") as dataset:
        assert dataset["lat"][:].tolist() == [50.0] * 3


def test_a_file_is_not_copied_for_each_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each write begins with a copy of the file: 18 days of A68a copied seven gigabytes."""
    monkeypatch.setattr(ncfile, "PATIENCE", 1e9)
    model = fake_model(tmp_path, size=2, traj_sample_hrs=-1.0, traj_write_hrs=0.5)
    writer = recorder(TrajectoryRecorder, model, tmp_path / "b.nc")
    assert lengths(writer, model, tmp_path / "b.nc", 3) == [2, 2, 2, 6]
