"""Applied forces in the run file: chosen, closed against the motion, and what ``why`` makes of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from contract import FORCES_IN_TABLES
from riftberg import A68A_2022_MTS, Forcing, Iceberg, Model, Options, build, open_run
from riftberg.diagnostics.cut import applied_forces, external_forces, forces_recorded
from riftberg.errors import RunError
from riftberg.runs.derived import force_variables
from riftberg.runs.run_file import RunWriter

P = A68A_2022_MTS.changed(stepping={"substeps": 90, "time_step": 1800.0}, bonds={"constant_size": False})
SEA = {
    "current": (0.3, -0.1),
    "wind": (8.0, -4.0),
    "slope": (2e-6, -1e-6),
    "sea_ice": (0.1, 0.05, 1.5),
    "ice_fraction": 0.9,
}


def made(path: Path, *, depth: float = 1e4, steps: int = 4, forces: bool = True) -> xr.Dataset:
    """Run two elements for a few long steps; records every second one."""
    berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.5, 0.0))
    writer = RunWriter(path, every_hours=1.0, forces=forces, background=False)
    Model(berg, Forcing.uniform(**SEA, depth=depth), P).advance(steps=steps, recorders=[writer])
    return open_run(path)


def test_forces_are_written_only_where_they_are_asked_for(tmp_path: Path) -> None:
    with made(tmp_path / "without.nc", steps=2, forces=False) as plain, made(tmp_path / "with.nc", steps=2) as full:
        names = {v.name for v in force_variables()}
        assert not names & set(plain.variables)
        assert set(full.variables) - set(plain.variables) == names
        for name in plain.variables:
            np.testing.assert_array_equal(full[name].values, plain[name].values)
        assert full["force_sea_floor_x"].attrs["units"] == "N"


def test_forces_are_chosen_in_a_run_and_in_a_file(tmp_path: Path) -> None:
    berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-37.0, -56.0))
    assert forces_recorded(Model(berg, Forcing.uniform(), P).run(steps=1, every_hours=0.0, forces=True))
    assert not forces_recorded(Model(berg, Forcing.uniform(), P).run(steps=1, every_hours=0.0))
    text = (
        "start: 2020-12-09\ndays: 1\noutput_forces: true\nforcing: {uniform: {}}\n"
        "berg: {rectangle: {length: 6 km, width: 3 km}, placement: [-39, -55], thickness: 200 m}\n"
    )
    (tmp_path / "it.yaml").write_text(text)
    assert build(str(tmp_path / "it.yaml"), Options())[1].output_forces


def test_a_record_holds_the_mean_since_the_one_before(tmp_path: Path) -> None:
    """Two long steps make a record: its force is the mean of theirs, and the first record has none."""
    with made(tmp_path / "run.nc") as run:
        berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.5, 0.0))
        model, steps = Model(berg, Forcing.uniform(**SEA), P), []
        for _ in range(4):
            model.step()
            steps.append(model.applied_forces())
        assert np.isnan(run["force_water_x"].isel(time=0)).all()
        for k, v in enumerate(force_variables()):
            want = [0.5 * (steps[n] + steps[n + 1]).reshape(2, -1)[:, k] for n in (0, 2)]
            np.testing.assert_allclose(run[v.name].values[:, 1:].T, want, rtol=1e-6, atol=1.0)


def test_why_reads_the_applied_forces_where_they_are(tmp_path: Path) -> None:
    """On the floor the velocity of one moment says little: the force that was applied is what stopped the berg."""
    with made(tmp_path / "run.nc", depth=150.0) as run:
        assert forces_recorded(run)
        got = external_forces(run, 1, P.kernel_values())
        assert tuple(got) == FORCES_IN_TABLES
        mean = 0.5 * (run["force_sea_floor_x"].values[:, 1] + run["force_sea_floor_x"].values[:, 2])
        np.testing.assert_allclose(got["sea floor"][:, 0], mean, rtol=1e-6)
        floor = applied_forces(run, 1)["sea floor"][:, 0]
        momentum = run["mass"].values * 0.5
        # Most of the momentum went into the floor within the first hour; water and wind gave it more to take.
        assert (floor * 3600.0 < -0.9 * momentum).all()
        bare = run.drop_vars([v.name for v in force_variables()])
        moment = external_forces(bare, 0, P.kernel_values())["sea floor"][:, 0]
        assert (np.abs(moment) > 5.0 * np.abs(floor)).all()


def test_what_a_user_derives_is_a_function_of_the_model(tmp_path: Path) -> None:
    """A name, a unit and a function: it has the values of its records, also of elements that were born in the run."""
    berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.5, 0.0))
    speed = {"speed": ("m s-1", lambda model: np.hypot(*model.velocity()))}
    writer = RunWriter(tmp_path / "run.nc", every_hours=0.0, derived=speed, background=False)
    Model(berg, Forcing.uniform(**SEA), P).advance(steps=3, recorders=[writer])
    with open_run(tmp_path / "run.nc") as run:
        assert run["speed"].dims == ("trajectory", "time")
        assert run["speed"].attrs["units"] == "m s-1"
        np.testing.assert_allclose(run["speed"], np.hypot(run["u"], run["v"]), rtol=1e-6)


def test_a_derived_variable_of_another_shape_is_named(tmp_path: Path) -> None:
    berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-37.0, -56.0))
    writer = RunWriter(tmp_path / "run.nc", derived={"total": ("kg", lambda model: model.elements.mass.sum())})
    with pytest.raises(RunError, match=r"derived variable total: shape \(\), but there are 2 elements"):
        Model(berg, Forcing.uniform(), P).advance(steps=1, recorders=[writer])
