"""External forces recomputed from a run file, against formulas and against the motion of a real run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from contract import FORCES_IN_TABLES
from riftberg import A68A_2022_MTS, Forcing, Iceberg, Model, open_run
from riftberg.diagnostics.cut import accelerations, external_forces
from riftberg.runs.derived import force_variables
from riftberg.runs.run_file import RunWriter

P = A68A_2022_MTS.changed(stepping={"substeps": None}, bonds={"constant_size": False})


@pytest.fixture(scope="module")
def floating(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Half a day of a small berg in current, wind, sloping sea and sea ice."""
    path = tmp_path_factory.mktemp("forces") / "run.nc"
    sea = Forcing.uniform(current=(0.3, -0.1), wind=(8.0, -4.0), slope=(2e-6, -1e-6), sea_ice=(0.1, 0.05, 1.5))
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-37.0, -56.0))
    Model(berg, sea, P).advance(0.5, recorders=[RunWriter(path, every_hours=0.5)])
    return open_run(path)


def test_each_force_is_that_of_its_formula(floating: xr.Dataset) -> None:
    record = 7
    forces = external_forces(floating, record, P.kernel_values())
    assert tuple(forces) == FORCES_IN_TABLES
    now = floating.isel(time=record)
    mass, u, v = (now[name].values.astype(float) for name in ("mass", "u", "v"))
    area, height, draft = 9e6, 200.0, 200.0 * 850.0 / 1025.0
    sides = (4 - now["bond_count"].values) / 4.0
    np.testing.assert_allclose(forces["surface slope"], np.outer(mass, [-9.8 * 2e-6, 9.8 * 1e-6]), rtol=1e-6)
    f = 2 * 7.292e-5 * np.sin(np.radians(now["lat"].values))
    np.testing.assert_allclose(forces["Coriolis"], np.stack([mass * f * v, -mass * f * u], axis=-1), rtol=1e-6)
    water = 1025.0 * 17.8 * (0.45 * sides * 3e3 * (draft - 1.5) + 0.0012 * area)
    speed = np.hypot(u - 0.3, v + 0.1)
    np.testing.assert_allclose(forces["ocean drag"][:, 0], -water * speed * (u - 0.3), rtol=1e-6)
    air = 1.1 * (0.65 * sides * 3e3 * (height - draft) + 0.0055 * area)
    np.testing.assert_allclose(forces["wind drag"][:, 1], -air * np.hypot(u - 8, v + 4) * (v + 4), rtol=1e-6)
    ice = 916.7 * 0.45 * sides * 3e3 * 1.5
    np.testing.assert_allclose(forces["sea ice"][:, 0], -ice * np.hypot(u - 0.1, v - 0.05) * (u - 0.1), rtol=1e-6)
    np.testing.assert_allclose(forces["waves"][:, 0], -2.0 * forces["waves"][:, 1], rtol=1e-6)
    assert (forces["sea floor"] == 0.0).all()


def test_the_budget_of_a_whole_berg_closes(floating: xr.Dataset) -> None:
    mass = floating["mass"].values
    for record in (6, 12, 20):
        forces = external_forces(floating, record, P.kernel_values())
        rate = accelerations(floating, record, 0, floating.sizes["time"] - 1)
        made = sum(force.sum(axis=0) for force in forces.values())
        moved = (mass[:, None] * rate).sum(axis=0)
        size = sum(np.hypot(*force.sum(axis=0)) for force in forces.values())
        assert np.hypot(*(moved - made)) < 0.01 * size, (record, moved, made)


def test_the_sea_floor_slows_by_its_rate(tmp_path: Path) -> None:
    sea = Forcing.uniform(depth=150.0)
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.5, 0.0))
    for p in (P, P.changed(bonds={"constant_size": True, "constant_length": 2e3, "constant_width": 2e3})):
        Model(berg, sea, p).advance(steps=1, recorders=[RunWriter(tmp_path / "run.nc", every_hours=0.5)])
        with open_run(tmp_path / "run.nc") as run:
            force = external_forces(run, 0, p.kernel_values())["sea floor"]
        side = 2e3 if p.bonds.constant_size else 3e3
        rate = 1e4 * side**2 / (side**2 * 200.0 * 850.0)
        np.testing.assert_allclose(force[:, 0], -rate * 0.5 * 9e6 * 200.0 * 850.0, rtol=1e-6)
        assert np.abs(force[:, 1]).max() == 0.0


def test_the_quadratic_floor_slows_by_its_coefficient(tmp_path: Path) -> None:
    """The budgets of why read the same table as the schemes: force by speed squared and excess draft."""
    berg = Iceberg.rectangle(6e3, 6e3, thickness=200.0, placement=(-37.0, -56.0), velocity=(0.5, 0.0))
    p = P.changed(grounding={"law": "quadratic", "quadratic_coefficient": 2e3})
    Model(berg, Forcing.uniform(depth=150.0), p).advance(
        steps=1, recorders=[RunWriter(tmp_path / "run.nc", every_hours=0.5)]
    )
    with open_run(tmp_path / "run.nc") as run:
        force = external_forces(run, 0, p.kernel_values())["sea floor"]
    excess = 200.0 * 850.0 / 1025.0 - 150.0
    np.testing.assert_allclose(force[:, 0], -2e3 * 9e6 * excess * 0.25, rtol=1e-6)
    assert np.abs(force[:, 1]).max() == 0.0


def test_a_file_without_sea_ice_is_read_as_open_water(floating: xr.Dataset) -> None:
    forces = external_forces(floating.drop_vars(["ui", "vi", "ice_thickness"]), 3, P.kernel_values())
    assert (forces["sea ice"] == 0.0).all()


def test_accelerations_are_central_within_their_limits(floating: xr.Dataset) -> None:
    u = floating["u"].transpose("trajectory", "time").values.astype(float)
    np.testing.assert_allclose(accelerations(floating, 5, 0, 20)[:, 0], (u[:, 6] - u[:, 4]) / 3600.0, rtol=1e-5)
    np.testing.assert_allclose(accelerations(floating, 5, 0, 5)[:, 0], (u[:, 5] - u[:, 4]) / 1800.0, rtol=1e-5)
    assert np.isnan(accelerations(floating, 5, 5, 5)).all()


def test_recorded_forces_are_means_of_both_sides_of_a_record(floating: xr.Dataset) -> None:
    """They are means since the record before: at the first and the last record one side alone is known."""
    dims, last = ("time", "trajectory"), floating.sizes["time"] - 1
    ones, since = np.ones([floating.sizes[dim] for dim in dims]), np.arange(last + 1.0)[:, None]
    run = floating.assign(
        {v.name: (dims, ones * since if v.name == "force_air_x" else 0.0 * ones) for v in force_variables()}
    )
    for record, expected in ((0, 1.0), (1, 1.5), (7, 7.5), (last - 1, last - 0.5), (last, float(last))):
        forces = external_forces(run, record, P.kernel_values())
        assert tuple(forces) == FORCES_IN_TABLES
        np.testing.assert_allclose(forces["wind drag"], [[expected, 0.0]] * floating.sizes["trajectory"])
        assert not forces["ocean drag"].any()
