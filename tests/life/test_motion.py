"""The ledger of momentum and mechanical energy: what forces gave, and what became of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases import CASES
from contract import FORCES
from engines.test_media import SCHEMES
from engines.test_media import model as adrift
from riftberg import Forcing, Iceberg, Model, Parameters, open_run
from riftberg.cli.run import ledger_lines
from riftberg.diagnostics.summary import summarize
from riftberg.errors import InputError
from riftberg.system.atomic_files import write_json
from verification.setups import energy, lattice, parameters, shake

CLOSES = 1e-9
GIVERS = (*FORCES, "loads", "supports", "time_step", "elements", "life", "other")

ALONE = {"only_interactions": True, "time_step": 600.0}


def balance(model: Model) -> Any:
    return model.motion.balance(model, model.remembered)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_forces_give_all_momentum_that_there_is_to_round_off(scheme) -> None:
    """Bonded elements aground in everything; what they give each other sums up to nothing.

    The explicit floor acts for half a sub-step before the first, which the ledger did not know: a berg that started aground
    had a part of its momentum go nowhere.
    """
    model = adrift(scheme)
    forces = np.zeros((len(FORCES), 2))
    for _ in range(5):
        model.step()
        forces += model.parameters.time_step * model.applied_forces().sum(axis=0)
    b = balance(model)
    assert b.momentum_error < CLOSES
    given = np.array([b.impulse[name] for name in FORCES])
    np.testing.assert_allclose(given, forces, rtol=1e-12)
    change = np.array(b.momentum_now) - np.array(b.momentum_start)
    np.testing.assert_allclose(given.sum(axis=0), change, rtol=0.0, atol=1e-9 * np.abs(given).sum())
    assert (np.abs(given).sum(axis=1) > 0.0).all()
    assert b.impulse["life"] == b.impulse["other"] == (0.0, 0.0)


@pytest.mark.slow
def test_what_the_floor_takes_in_a_landing_that_breaks_a_berg_is_told_to_round_off() -> None:
    """The quasi-static scheme told the drag of the floor at the ends of its steps, up to 6 % of all momentum off."""
    model = CASES["grounding-fracture"]()
    assert model.parameters.stepping.scheme == "quasi_static"
    model.advance(days=0.5)
    assert (model.bonds.status != 0).any()
    assert balance(model).momentum_error < 1e-12


@pytest.mark.parametrize("scheme", ["unbonded", "verlet", "runge_kutta"])
def test_work_of_the_forces_is_the_kinetic_energy_of_single_elements_to_round_off(scheme) -> None:
    model = adrift(scheme, depth=5000.0, stepping={"interactions": False}, contact={"on_substeps": False})
    for _ in range(5):
        model.step()
    b = balance(model)
    scale = sum(abs(b.work[name]) for name in FORCES)
    assert abs(b.work["elements"]) < 1e-10 * scale
    assert b.kinetic_now - b.kinetic_start == pytest.approx(sum(b.work.values()), abs=1e-10 * scale)
    # Water that moves as the ice does gives nothing; the Coriolis force does no work but by the time step, and that is named so.
    assert b.work["coriolis"] == 0.0
    assert 0.0 < abs(b.work["time_step"]) < 0.2 * scale


def test_bonds_and_contacts_make_no_energy_of_drag() -> None:
    """Sides in the current are pushed more than the middle, and bonds share it: that loses energy and never gains any."""
    model = adrift("mts", depth=5000.0, grounding={"coefficient": 0.0}, bonds={"damping": 1.0})
    for _ in range(6):
        model.step()
    b = balance(model)
    assert b.work["elements"] < 0.0
    assert b.dissipated > 0.0


@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_what_dampers_take_is_what_motion_and_bonds_lose(damping: float) -> None:
    """Against the energy of the tests of the lattice, which is written down anew there."""
    model = lattice(parameters(stepping=ALONE, bonds={"damping": damping, "linear_bending": True}))
    shake(model, speed=0.1, spin=5e-5)
    model.step()
    first = balance(model)
    before = energy(model)
    for _ in range(20):
        model.step()
    b = balance(model)
    assert b.kinetic_now + b.elastic_now == pytest.approx(energy(model), rel=1e-9)
    lost = b.dissipated - first.dissipated
    assert lost == pytest.approx(before - energy(model), abs=1e-9 * before)
    assert (lost > 0.5 * before) if damping else (abs(lost) < 0.1 * before)


@pytest.mark.parametrize("linear", [True, False])
def test_bonds_that_are_neither_bent_nor_stretched_hold_no_energy(linear: bool) -> None:
    model = lattice(parameters(stepping=ALONE, bonds={"linear_bending": linear}))
    at_rest = balance(model).elastic_now
    model.elements.rotation[:] = 1e-3 * np.arange(model.elements.size)
    assert abs(at_rest) < 1e-9 * balance(model).elastic_now


def test_bonds_hold_the_same_energy_when_sides_melt() -> None:
    """Bug: their section was taken from the sides of today, not from those with which they formed."""
    model = lattice(parameters(stepping=ALONE))
    shake(model, speed=0.1, spin=5e-5)
    model.step()
    held = balance(model).elastic_now
    model.elements.length[:] *= 0.95
    model.elements.width[:] *= 0.95
    assert held > 0.0
    assert balance(model).elastic_now == pytest.approx(held, rel=1e-12)


def test_bonds_that_break_release_what_they_held() -> None:
    model = lattice(parameters(stepping=ALONE, bonds={"linear_bending": True}, fracture={"enabled": True}))
    shake(model, speed=0.05, spin=2e-5)
    for _ in range(2):
        model.step()
    assert balance(model).released == 0.0
    held = balance(model).elastic_now
    model.bonds.strength[:] = 1e-9
    model.step()
    assert (model.bonds.status != 0).any()
    b = balance(model)
    assert 0.0 < b.released <= held * (1.0 + 1e-12)
    if (model.bonds.status != 0).all():
        assert b.released == pytest.approx(held, rel=1e-12)
        assert b.elastic_now == 0.0


def test_loads_and_supports_are_in_the_ledger() -> None:
    """Bug: the cantilever left over all of its momentum, and had lost minus the work of its load."""
    model = lattice(parameters(stepping=ALONE, bonds={"damping": 1.0, "linear_bending": True}))
    el, steps = model.elements, 4
    el.static[el.lon == el.lon.min()] = 1.0
    el.load_y[el.lon == el.lon.max()] = 1e7
    start = el.copy()
    model.advance(steps=steps)
    b = balance(model)
    time = steps * model.parameters.time_step
    load = float(el.load_y.sum())
    assert b.impulse["loads"] == pytest.approx((0.0, load * time), rel=1e-12)
    assert b.work["loads"] == pytest.approx(float((el.load_y * (el.lat - start.lat)).sum()), rel=1e-9)
    assert b.work["loads"] > 0.0
    assert b.momentum_error < 1e-12
    total = np.sum([b.impulse[giver] for giver in GIVERS], axis=0)
    np.testing.assert_allclose(
        total, np.subtract(b.momentum_now, b.momentum_start), rtol=0, atol=1e-9 * abs(load) * time
    )
    assert b.impulse["supports"][1] * load < 0.0  # they bear it
    assert 0.0 <= b.dissipated <= b.work["loads"]
    # Energy of motion and bonds, what dampers take: all of it is work of the load.
    held = b.kinetic_now + b.elastic_now + b.dissipated
    assert held == pytest.approx(b.work["loads"], rel=1e-9)
    assert any("loads" in line for line in b.lines())


def test_supports_take_nothing_of_bergs_that_they_do_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    """With one element held anywhere the ledger closed whatever free bergs lost: their left-over counted as the supports'."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(3) * 2e3, np.arange(2) * 2e3))
    far, near = 60e3, 6.6e3  # a free berg far off, one that presses on the held one
    berg = Iceberg.from_points(
        np.concatenate([x, x + far, x + near]), np.tile(y, 3), thickness=200.0, radius=1e3, latlon=False,
        static=np.arange(18) < 6, velocity=(np.repeat([0.0, 0.3, -0.3], 6), 0.0),
    )  # fmt: skip
    p = Parameters(earth={"latlon": False, "f_plane": True, "reference_latitude": -55.0, "period": 0.0})
    model = Model(
        berg, Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0)), p.changed(stepping={"time_step": 1800.0})
    )
    model.advance(steps=4)
    b = balance(model)
    given = np.hypot(*b.momentum_start)
    assert b.momentum_error < CLOSES
    assert b.impulse["supports"][0] > 0.01 * given  # they stop the berg that comes
    # A law that is broken: the free berg far off loses a tenth of its momentum, which nothing that is told has taken.
    enter, lost = model.motion.moved, []

    def broken(*told: Any) -> None:
        model.elements.u[6:12] *= 0.9
        lost.append(float((model.elements.mass * model.elements.u)[6:12].sum()) / 9.0)
        enter(*told)

    monkeypatch.setattr(model.motion, "moved", broken)
    model.step()
    assert balance(model).impulse["elements"][0] == pytest.approx(-lost[0], rel=1e-6)
    assert balance(model).momentum_error > 1e-3


def melting(**changes) -> Model:
    p = Parameters(
        stepping={"scheme": "mts", "time_step": 1800.0}, melt={"enabled": True, "temperature": 5.0, "salinity": 34.0}
    )
    berg = Iceberg.rectangle(6e3, 6e3, thickness=120.0, placement=(-37.0, -56.0), velocity=(0.3, 0.1))
    return Model(
        berg,
        Forcing.uniform(current=(0.4, -0.1), wind=(8.0, 2.0), slope=(0.0, 0.0)),
        p.changed(**changes) if changes else p,
    )


def test_melt_takes_momentum_and_energy_along_and_others_are_named() -> None:
    model = melting()
    for _ in range(3):
        model.step()
    b = balance(model)
    assert b.momentum_error < CLOSES
    assert b.impulse["life"][0] < 0.0 < b.momentum_now[0]
    assert b.work["life"] < 0.0
    el = model.elements
    gain = np.array([0.1 * el.mass.sum(), 0.0, (el.mass * (0.1 * el.u + 0.005)).sum()])
    el.u[:] += 0.1
    after = balance(model)
    np.testing.assert_allclose([*after.impulse["other"], after.work["other"]], gain, rtol=1e-12, atol=1e-3)
    model.step()
    np.testing.assert_allclose(balance(model).impulse["other"], gain[:2], rtol=1e-12, atol=1e-3)
    total = np.sum([balance(model).impulse[name] for name in GIVERS], axis=0)
    change = np.array(balance(model).momentum_now) - np.array(balance(model).momentum_start)
    np.testing.assert_allclose(total, change, rtol=1e-9)


def test_a_resumed_ledger_is_the_same_bit_for_bit(tmp_path: Path) -> None:
    whole, part = melting(), melting()
    for _ in range(4):
        whole.step()
    for _ in range(2):
        part.step()
    part.save(tmp_path / "r.nc")
    resumed = Model.resume(tmp_path / "r.nc", whole.forcing)
    for _ in range(2):
        resumed.step()
    assert balance(resumed) == balance(whole)


def test_a_step_that_fails_is_not_in_the_ledger() -> None:
    model = melting()
    model.step()
    before = balance(model)

    def fail(_: object) -> None:
        raise RuntimeError("no")

    model.after_step.append(fail)
    with pytest.raises(RuntimeError):
        model.step()
    assert balance(model) == before


@pytest.mark.parametrize("name", ["motion_ledger", "melt_by_fragment"])
def test_something_else_in_a_restart_is_refused_by_name(name: str) -> None:
    model = melting()
    model.step()
    model.remembered[name] = np.zeros(3)
    with pytest.raises(InputError, match=f"extra/{name}"):
        model.step()


def test_each_run_stores_and_prints_it(tmp_path: Path) -> None:
    model = melting(melt={"enabled": False})
    model.run(steps=4, output=tmp_path / "run.nc", every_hours=1.0)
    b = balance(model)
    with open_run(tmp_path / "run.nc") as run:
        assert run["force"].values.tolist() == list(GIVERS)
        last = run.isel(time=-1)
        np.testing.assert_array_equal(last["impulse_x"], [b.impulse[name][0] for name in GIVERS])
        np.testing.assert_array_equal(last["work"], [b.work[name] for name in GIVERS])
        assert float(last["kinetic_energy"].squeeze()) == b.kinetic_now
        assert float(last["dissipated_energy"].squeeze()) == b.dissipated
        assert float(run["impulse_x"].isel(time=0).sum()) == 0.0
    summary = summarize(model)
    assert summary["motion"]["impulse"]["water"] == b.impulse["water"]
    assert any("momentum closes to" in line for line in ledger_lines(summary))  # with --verbose
    assert "momentum (east, north; N s)" in "\n".join(summary["motion"]["lines"])
    write_json(summary, tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text())["motion"]["kinetic_now"] == b.kinetic_now


def test_a_run_file_has_no_variable_without_a_value(tmp_path: Path) -> None:
    """In equilibrium bonds do not vibrate: their energies were there, without a value in all records."""
    model = melting(melt={"enabled": False}, stepping={"scheme": "quasi_static"})
    model.run(steps=4, output=tmp_path / "run.nc", every_hours=1.0)
    with open_run(tmp_path / "run.nc") as run:
        assert "kinetic_energy" in run
        numbers = [name for name, v in run.variables.items() if v.dtype.kind == "f" and v.size]
        assert not [name for name in numbers if np.isnan(run[name].values).all()]


def test_a_restart_from_before_the_work_on_the_bed_was_kept_goes_on() -> None:
    """Bug: its ledger was refused, as it had a row less."""
    model = melting()
    model.step()
    del model.remembered["motion_on_bed"]
    b = balance(model)
    assert b.rubbed == 0.0
    model.step()
