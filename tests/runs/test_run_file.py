"""The trajectory file of a run."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from fakes import FakeModel
from riftberg import open_run
from riftberg.errors import InputError, RunError
from riftberg.runs.layout import read_parameters
from riftberg.runs.run_file import RunWriter, memory_run
from riftberg.state import ELEMENT_VARIABLES

CALLED = {"u_sync": "u", "v_sync": "v"}
"""Names in a run file of variables that the state calls otherwise."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[FakeModel, Path]:
    """Run two days and return the model with the file it wrote."""
    path = tmp_path_factory.mktemp("run") / "run.nc"
    model = FakeModel()
    model.advance(2, recorders=[RunWriter(path, every_hours=3, experiment="fake", seed=7)])
    return model, path


def test_opens_in_xarray_without_options(run: tuple[FakeModel, Path]) -> None:
    model, path = run
    with xr.open_dataset(path) as ds:
        tables = {"fragment": 2, "contact": 0, "grounding": 0, "rift_tip": 0}
        assert dict(ds.sizes) == {"trajectory": 24, "time": 17, "bond": 37, **tables}
        assert set(ds.coords) == {"trajectory", "time", "lon", "lat"}
        assert ds.time.values[0] == np.datetime64("2020-12-09T13:00:00")
        assert ds.time.values[-1] == np.datetime64("2020-12-11T13:00:00")
        np.testing.assert_array_equal(ds.lon[:, -1], model.elements.lon)
        np.testing.assert_array_equal(ds.trajectory, model.elements.id)


def test_every_output_variable_is_there_with_its_units(run: tuple[FakeModel, Path]) -> None:
    with netCDF4.Dataset(run[1]) as file:
        for v in ELEMENT_VARIABLES:
            if v.output and v.name not in ("id", "floor_load", "floor_yield"):  # the last two on a bed of sediment
                assert file[CALLED.get(v.name, v.name)].dimensions == ("trajectory", "time"), v.name
                assert file[CALLED.get(v.name, v.name)].units == v.units
        assert not {"u_sync", "v_sync", "sides", "first", "second"} & set(file.variables)
        named = [v for v in ELEMENT_VARIABLES if v.output and v.standard_name]
        assert len(named) > 3
        assert all(file[CALLED.get(v.name, v.name)].standard_name == v.standard_name for v in named)
        assert file["lon"].dtype == file["lat"].dtype == file["rotation"].dtype == np.float64


def test_bond_table_and_family_tree(run: tuple[FakeModel, Path]) -> None:
    model, path = run
    ds = open_run(path.parent)
    broken = ds.status.values == 2
    assert broken.sum() == 3
    assert set(ds.break_time.values[broken]) == {np.datetime64("2020-12-10T13:00:00")}
    assert np.isnat(ds.break_time.values[~broken]).all()
    np.testing.assert_array_equal(ds["bond_first"], model.bonds.first)
    np.testing.assert_allclose(ds.normal_stress[0], 1000.0 + np.arange(17) * 108.0, rtol=1e-6)
    assert ds.fragment_parent.values.tolist() == [0, 1]
    assert ds.fragment_birth_time.values[1] == np.datetime64("2020-12-10T13:00:00")
    assert ds.fragment_area.values[1] == 6 * 9e6
    assert ds.fragment_grounded.values.tolist() == [0, 1]


def test_peak_stress_is_the_largest_since_the_record_before(run: tuple[FakeModel, Path]) -> None:
    """Of both long steps of 1800 s up to a record the first has the larger peak, by 470 Pa less 18 Pa of growth."""
    ds = open_run(run[1])
    np.testing.assert_array_equal(ds.peak_stress[:, 0], ds.normal_stress[:, 0])
    np.testing.assert_allclose((ds.peak_stress - ds.normal_stress)[:, 1:], 500.0 - 18.0, rtol=1e-4)
    assert "since the record before" in ds.peak_stress.attrs["long_name"]


def test_the_peak_of_a_new_bond_begins_with_its_first_step(tmp_path: Path) -> None:
    class Growing(FakeModel):
        def step(self) -> None:
            super().step()
            if self.step_number == 5:  # the first of the two steps up to the third record
                self.bonds.id[-1], self.bonds.second[-1] = 999, 0  # another bond in its place

    Growing().advance(0.25, recorders=[RunWriter(tmp_path / "run.nc", every_hours=1)])
    new = open_run(tmp_path).isel(bond=-1)
    assert np.isnan(new.peak_stress[:3]).all()
    np.testing.assert_allclose((new.peak_stress - new.normal_stress)[3:], 500.0 - 18.0, rtol=1e-4)


def test_attributes_allow_the_run_to_be_repeated(run: tuple[FakeModel, Path]) -> None:
    attributes = open_run(run[1]).attrs
    assert attributes["Conventions"] == "CF-1.11"
    assert read_parameters(attributes["parameters_json"], run[1], goes_on=True) == run[0].parameters
    assert "normal_strength = 18000.0 Pa" in attributes["parameters"]
    assert "eabq6974" in attributes["references"]
    assert "A uniform current" in attributes["references"]
    assert "made up for tests" in attributes["forcing"]
    assert attributes["seed"] == "7"
    assert set(json.loads(attributes["versions_json"])) >= {"riftberg", "python", "numpy", "numba"}


def test_cartesian_run_has_metres(tmp_path: Path) -> None:
    FakeModel(latlon=False).advance(0.25, recorders=[RunWriter(tmp_path / "run.nc")])
    ds = open_run(tmp_path)
    assert ds.x.attrs["units"] == ds.y.attrs["units"] == "m"
    assert ds.x.attrs["standard_name"] == "projection_x_coordinate"
    assert "lon" not in ds.variables
    assert "fragment_x" in ds


def test_last_state_is_kept_even_off_schedule(tmp_path: Path) -> None:
    FakeModel().advance(2.5 / 24, recorders=[RunWriter(tmp_path / "run.nc")])
    hours = (open_run(tmp_path).time - np.datetime64("2020-12-09T13:00:00")) / np.timedelta64(1, "h")
    assert hours.values.tolist() == [0.0, 1.0, 2.0, 2.5]


@pytest.mark.slow
def test_readable_after_every_record_while_another_program_keeps_it_open(tmp_path: Path) -> None:
    model, writer = FakeModel(), RunWriter(tmp_path / "run.nc", every_hours=1, flush_seconds=0)
    writer.start(model)
    look = "import sys, netCDF4; d = netCDF4.Dataset(sys.argv[1]); print(d['time'][:], flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", look, str(tmp_path / "run.nc")]
    environment = {k: v for k, v in os.environ.items() if k != "HDF5_USE_FILE_LOCKING"}
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as reader:
        assert reader.stdout is not None
        assert reader.stdout.readline() == b"[0.]\n"
        for hour in range(1, 4):
            model.step()
            model.step()
            writer.record(model)
            with xr.open_dataset(tmp_path / "run.nc") as ds:
                assert ds.sizes["time"] == hour + 1
                np.testing.assert_array_equal(ds.lat[:, -1], model.elements.lat)


def test_a_new_run_may_replace_a_file_that_is_still_open_here(tmp_path: Path) -> None:
    FakeModel().advance(0.25, recorders=[RunWriter(tmp_path / "run.nc")])
    earlier = open_run(tmp_path)
    FakeModel().advance(0.5, recorders=[RunWriter(tmp_path / "run.nc")])
    assert open_run(tmp_path).sizes["time"] == 13
    assert np.isfinite(earlier.lon.values).all()


@pytest.mark.slow
def test_killed_run_leaves_a_complete_file(tmp_path: Path) -> None:
    script = """
    import sys
    from fakes import FakeModel
    from riftberg.runs.run_file import RunWriter
    model, writer = FakeModel(), RunWriter(sys.argv[1], every_hours=1, flush_seconds=0)
    writer.start(model)
    for step in range(4):
        model.step()
        writer.record(model)
    print("ready", flush=True)
    sys.stdin.read()
    """
    here = str(Path(__file__).parent.parent)
    command = [sys.executable, "-c", textwrap.dedent(script), str(tmp_path / "run.nc")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])}
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.send_signal(signal.SIGKILL)
    ds = open_run(tmp_path)
    assert ds.sizes["time"] == 3
    assert np.isfinite(ds.lon.values).all()


def test_records_are_held_back_to_spare_time(tmp_path: Path) -> None:
    model, writer = FakeModel(), RunWriter(tmp_path / "run.nc", flush_seconds=3600)
    writer.start(model)
    for _ in range(10):
        model.step()
        writer.record(model)
    assert writer.records == 1
    writer.finish(model)
    assert open_run(tmp_path).sizes["time"] == 6


def test_writing_costs_little(tmp_path: Path) -> None:
    FakeModel(4, 2).advance(1, recorders=[RunWriter(tmp_path / "first.nc")])  # imports libraries
    model, writer = FakeModel(40, 12), RunWriter(tmp_path / "run.nc")
    before = time.process_time()
    model.advance(10, recorders=[writer])
    assert (time.process_time() - before) / 10 < 0.2  # s per day; 0.02 on a laptop


def test_opens_in_trajan(run: tuple[FakeModel, Path]) -> None:
    pytest.importorskip("trajan")
    with xr.open_dataset(run[1]) as ds:
        assert type(ds.traj).__name__ == "Orthogonal"
        assert ds.traj.trajectory_dim == "trajectory"
        speed = ds.traj.speed().isel(time=slice(0, -1)).mean().item()
        assert speed == pytest.approx(0.2, rel=0.1)
        gridded = ds.traj.gridtime("6h").sel(time="2020-12-10T06:00")
        assert np.isfinite(gridded.lon).all()


def test_opens_in_clouddrift(run: tuple[FakeModel, Path]) -> None:
    clouddrift = pytest.importorskip("clouddrift")
    with xr.open_dataset(run[1]) as ds:
        seconds = (ds.time - ds.time[0]) / np.timedelta64(1, "s")
        u, _v = clouddrift.kinematics.velocity_from_position(ds.lon, ds.lat, seconds)
        assert np.mean(u) == pytest.approx(0.2, abs=0.03)
        ragged, rowsize = clouddrift.ragged.regular_to_ragged(ds.lon.values)
        assert len(ragged) == 24 * 17
        assert set(rowsize) == {17}


def test_missing_and_foreign_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        open_run(tmp_path)
    xr.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(InputError, match="not the trajectory file of a run"):
        open_run(tmp_path / "other.nc")


def test_a_run_without_a_file_ends_in_memory() -> None:
    model = FakeModel()
    with memory_run(None, 6.0) as writer:
        model.advance(1, recorders=[writer])
        dataset = writer.dataset()
    assert not writer.path.exists()
    np.testing.assert_array_equal(dataset.lon[:, -1], model.elements.lon)
    assert dataset.sizes["time"] == 5


def test_killed_at_any_moment_the_earlier_file_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, writer = FakeModel(), RunWriter(tmp_path / "run.nc", flush_seconds=0)
    writer.start(model)
    before = (tmp_path / "run.nc").read_bytes()

    def killed(*_: object) -> None:
        raise SystemExit

    monkeypatch.setattr("riftberg.runs.run_file.os.replace", killed)
    for _ in range(2):
        model.step()
        if model.step_number == 2:
            with pytest.raises(SystemExit):
                writer.record(model)
    assert (tmp_path / "run.nc").read_bytes() == before


def test_a_file_that_vanished_is_named(tmp_path: Path) -> None:
    model, writer = FakeModel(), RunWriter(tmp_path / "run.nc")
    writer.start(model)
    (tmp_path / "run.nc").unlink()
    model.step()
    with pytest.raises(RunError, match=r"cannot write .*run.nc"):
        writer.finish(model)


def two_meetings(ds: xr.Dataset) -> xr.Dataset:
    """Put two meetings into the dataset of a run that has none."""
    kept = ds.drop_vars([name for name in ds.variables if "contact" in ds[name].dims])
    dated = ("contact", [0.0, 3600.0], {"units": ds["time"].attrs["units"]})
    numbers = {"contact_first": ("contact", [1.0, 1.0]), "contact_second": ("contact", [2.0, 2.0])}
    return kept.assign(
        {**numbers, "contact_time": dated, "contact_end": dated, "contact_speed": ("contact", [0.1, 0.2])}
    )


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "index", "value", "said"),
    [
        ("fragment_number", 0, np.nan, "fragment_number is nan, not a whole number from 1 to"),
        (
            "fragment_number",
            0,
            1.5,
            "fragment_number, fragment 1: fragment_number is 1.5, not a whole number from 1 to",
        ),
        ("corners", 3, 5.0, "an element has 4 or 6 corners"),
        ("corners", 3, np.inf, "corners, element 4: corners is inf, not a whole number from 0 to 6"),
        ("contact_first", 1, np.nan, "contact_first, collision 2: contact_first is nan, not a whole number from 1 to"),
        ("contact_second", 1, 0.0, "contact_second is 0, not a whole number from 1 to"),
        ("contact_time", 1, np.nan, "a collision without a time"),
        ("contact_speed", 1, -1.0, "contact_speed is -1, not a number from 0 to"),
    ],
)
def test_a_number_that_names_nothing_is_refused(
    run: tuple[FakeModel, Path], tmp_path: Path, name: str, index: int, value: float, said: str
) -> None:
    """Bug once: NaN is neither below 1 nor double, and was drawn into a traceback."""
    ds = two_meetings(xr.load_dataset(run[1], decode_times=False).drop_encoding())
    ds[name] = ds[name].astype(np.float64)
    ds.to_netcdf(tmp_path / "good.nc")
    open_run(tmp_path / "good.nc").close()
    ds[name].values[index] = value
    ds.to_netcdf(tmp_path / "bad.nc")
    with pytest.raises(InputError, match=said) as error:
        open_run(tmp_path / "bad.nc")
    assert name in str(error.value)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["trajectory", "spin", "fragment_area"])
def test_a_variable_that_readers_use_is_missed(run: tuple[FakeModel, Path], tmp_path: Path, name: str) -> None:
    """Without the identifiers `riftberg why` named elements by their rows."""
    xr.load_dataset(run[1], decode_times=False).drop_encoding().drop_vars(name).to_netcdf(tmp_path / "bad.nc")
    with pytest.raises(InputError, match=f"variable {name} is missing"):
        open_run(tmp_path / "bad.nc")


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["corners", "damage", "contact_first"])
def test_letters_where_numbers_belong_are_refused(run: tuple[FakeModel, Path], tmp_path: Path, name: str) -> None:
    """Bug once: variables that only some readers use were not looked at before they were used."""
    ds = xr.load_dataset(run[1], decode_times=False).drop_encoding()
    dims = {"corners": ("trajectory",), "damage": ("bond", "time"), "contact_first": ("contact",)}[name]
    letters = np.full([ds.sizes[dim] for dim in dims], b"x", dtype="S1")
    ds.drop_vars(name, errors="ignore").assign({name: (dims, letters)}).to_netcdf(tmp_path / "bad.nc")
    with pytest.raises(InputError, match="numbers are needed"):
        open_run(tmp_path / "bad.nc")


@pytest.mark.quick(1)
@pytest.mark.parametrize("ids", ["letters", "real numbers", "twice the same"])
def test_identifiers_that_are_none_are_refused(run: tuple[FakeModel, Path], tmp_path: Path, ids: str) -> None:
    """A film was drawn of elements whose identifiers were letters."""
    ds = xr.load_dataset(run[1], decode_times=False).drop_encoding()
    size = ds.sizes["trajectory"]
    wrong = {"letters": np.full(size, b"x", dtype="S1"), "real numbers": np.arange(size) + 0.5,
             "twice the same": np.zeros(size, int)}[ids]  # fmt: skip
    ds.assign_coords(trajectory=("trajectory", wrong, {"cf_role": "trajectory_id"})).to_netcdf(tmp_path / "bad.nc")
    with pytest.raises(InputError, match="variable trajectory: identifiers are whole numbers"):
        open_run(tmp_path / "bad.nc")


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("path", ["", ".", "/"])
def test_an_output_without_a_name_is_refused(path: str) -> None:
    """Bug once: an error of Python's, and another one when the writer went."""
    with pytest.raises(InputError, match="has no name"):
        RunWriter(path)


def test_a_run_that_fails_at_its_first_record_leaves_the_run_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bug: the new file took the place of the old one before it held a record; a full disk then left an empty one."""
    path = tmp_path / "run.nc"
    FakeModel().advance(0.2, recorders=[RunWriter(path, every_hours=2)])
    whole = path.read_bytes()

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("riftberg.runs.record_file.write_fragment_melt", full)
    with pytest.raises(RunError, match="cannot write"):
        FakeModel().advance(0.2, recorders=[RunWriter(path, every_hours=2)])
    assert path.read_bytes() == whole
    with pytest.raises(RunError, match="cannot write"):
        FakeModel().advance(0.2, recorders=[RunWriter(tmp_path / "new.nc", every_hours=2)])
    assert not (tmp_path / "new.nc").exists()
