"""Laws of one's own: they act in the scheme, and outputs and ledgers know them as they know the built-in ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from riftberg import Iceberg, Laws, Model, Parameters, Steady
from riftberg.diagnostics.cut import external_forces
from riftberg.errors import InputError, RunError
from riftberg.stepping.forces.media import FORCES
from stepping.test_elastic_cells import pulled

WARM = Parameters().changed(melt={"enabled": True, "temperature": 2.0, "salinity": 34.0})
METRES = Parameters().changed(earth={"latlon": False, "f_plane": True, "reference_latitude": -60.0, "period": 0.0})


def berg(**options) -> Iceberg:
    return Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-37.0, -56.0), **options)


def towed(elements, time):
    """A pull that grows by the hour, less a drag."""
    return 2e6 * (1.0 + time / 3600.0) - 1e7 * elements.motion.u, -1e7 * elements.motion.v


def test_a_force_of_ones_own_is_in_outputs_ledger_and_why(tmp_path: Path) -> None:
    plane = Iceberg.rectangle(6e3, 3e3, thickness=200.0, latlon=False, offset=(0.0, 0.0))
    model = Model(plane, Steady(), METRES, laws=Laws(force=towed))
    run = model.run(steps=6, every_hours=0.0, forces=True)
    own = run["force_own_x"].values[:, 1:]
    assert (own > 1.9e6).all()
    dt, balance = model.parameters.stepping.time_step, model.motion.balance(model, model.remembered)
    assert balance.impulse["own"][0] == pytest.approx(dt * own.sum(), rel=1e-6)
    assert balance.work["own"] > 0.0
    assert balance.momentum_error < 1e-9
    told = external_forces(run, 2, model.constants)["own force"][:, 0]
    np.testing.assert_allclose(told, 0.5 * (own[:, 1] + own[:, 2]), rtol=1e-6)
    assert "towed" in model.forcing.describe()
    assert run.attrs["laws"] == "force by towed"
    assert "own force +" in " ".join(balance.lines())
    assert (run["x"].values[:, -1] > Model(plane, Steady(), METRES).run(steps=6)["x"].values[:, -1] + 10.0).all()


@pytest.mark.parametrize("scheme", ["quasi_static", "verlet", "runge_kutta", "mts"])
def test_a_resumed_run_with_a_force_of_ones_own_has_the_same_digits(scheme, tmp_path: Path) -> None:
    """The force depends on the velocity, which is another one when the file is read."""
    bonds = {"law": "none"} if scheme in ("verlet", "runge_kutta") else {}
    p = Parameters().changed(
        stepping={"scheme": scheme, "time_step": 600.0, "substeps": 40}, bonds=bonds, fracture={"enabled": False}
    )
    laws, sea = Laws(force=towed), Steady(current=(0.2, 0.1))
    whole, first = (Model(berg(), sea, p, laws=laws) for _ in range(2))
    whole.advance(steps=5)
    first.advance(steps=2)
    again = Model.resume(first.save(tmp_path / "it.restart.nc"), sea, laws=laws)
    again.advance(steps=3)
    for name in ("lon", "lat", "u", "v", "own_x"):
        np.testing.assert_array_equal(getattr(again.elements, name), getattr(whole.elements, name))
    np.testing.assert_array_equal(again.applied_forces(), whole.applied_forces())
    assert np.abs(whole.applied_forces()[:, FORCES.index("own")]).max() > 0.0


def test_a_melt_law_of_ones_own_is_in_the_ledger_and_the_rest_stays() -> None:
    """A tenth of a metre an hour from below, the built-in laws at the sides."""
    built_in = Model(berg(), Steady(current=(0.1, 0.0)), WARM)
    own = Model(
        berg(), Steady(current=(0.1, 0.0)), WARM, laws=Laws(melt=lambda elements, time: (0.1 / 3600.0, None, None))
    )
    for model in (built_in, own):
        model.advance(steps=4)
    hours = own.time / 3600.0
    np.testing.assert_allclose(own.elements.thickness, 200.0 - 0.1 * hours, rtol=1e-12)
    water, before = own.life.balance(own).water, built_in.life.balance(built_in).water
    assert water["base"] == pytest.approx(850.0 * 18e6 * 0.1 * hours, rel=1e-3)
    assert water["sides"] == pytest.approx(before["sides"], rel=1e-2)
    assert before["base"] != pytest.approx(water["base"], rel=0.1)
    assert abs(own.life.balance(own).error) < 1e-12


def test_a_criterion_of_ones_own_decides_what_breaks() -> None:
    """The ice's own criterion written as a function breaks the same bonds; one of half the strength breaks more of the bar."""

    def largest(moment, strengths):
        return np.maximum(moment.stress[:, 0] / strengths.normal, moment.stress[:, 1] / strengths.shear)

    def bar(laws: Laws | None) -> Model:
        at = pulled()
        model = Model.going_on(at.population, at.forcing, at.parameters, at.start, 0.0, 0, (), laws=laws)
        model.step()
        return model

    plain = pulled()
    plain.step()
    same, weak, strong = (
        bar(Laws(fracture=lambda moment, strengths, factor=factor: factor * largest(moment, strengths)))
        for factor in (1.0, 1.2, 0.9)
    )
    np.testing.assert_array_equal(np.isfinite(same.bonds.break_time), np.isfinite(plain.bonds.break_time))
    assert weak.bonds_broken >= same.bonds_broken == 3
    assert np.nanmin(weak.bonds.break_time) <= np.nanmin(same.bonds.break_time)
    assert strong.bonds_broken == 0


@pytest.mark.parametrize("name", ["stress", "displacement"])
def test_a_criterion_that_changes_the_equilibrium_is_refused(name: str) -> None:
    """Bug: one that halved `moment.stress` changed what was stored and recorded."""

    def halving(moment, strengths):
        getattr(moment, name)[:] *= 0.5
        return moment.stress[:, 0] / strengths.normal

    at = pulled()
    model = Model.going_on(at.population, at.forcing, at.parameters, at.start, 0.0, 0, (), laws=Laws(fracture=halving))
    with pytest.raises(RunError, match="Laws, fracture: halving changes the equilibrium"):
        model.step()


@pytest.mark.parametrize(
    ("laws", "words"),
    [
        (Laws(force=3.0), "3.0 is no function"),
        (Laws(melt=towed), "a melt law is given, but nothing melts"),
        (3.0, "3.0 cannot be used here"),
    ],
)
def test_laws_that_cannot_act_are_refused_before_the_run(laws, words) -> None:
    with pytest.raises(InputError, match=words):
        Model(berg(), Steady(), laws=laws)


def test_a_criterion_is_refused_where_the_scheme_has_its_own() -> None:
    mts = Parameters().changed(stepping={"scheme": "mts"})
    with pytest.raises(InputError, match="the scheme mts has its own"):
        Model(berg(), Steady(), mts, laws=Laws(fracture=towed))
    with pytest.raises(InputError, match="no bond can break"):
        Model(berg(), Steady(), Parameters().changed(fracture={"enabled": False}), laws=Laws(fracture=towed))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (5.0, r"Laws, force: law returns 5.0 instead of 2 arrays \(eastward, northward\)"),
        ((np.zeros(3), 0.0), "Laws, force: law, eastward: .*; there are 2 elements"),
        ((0.0, np.array([0.0, np.nan])), "Laws, force: law, northward: nan for element 2"),
    ],
)
def test_what_a_law_returns_is_checked(given, words) -> None:
    def law(elements, time):
        return given

    with pytest.raises(RunError, match=words):
        Model(berg(), Steady(), laws=Laws(force=law)).advance(steps=1)


def test_ice_does_not_grow_by_a_melt_law() -> None:
    model = Model(berg(), Steady(), WARM, laws=Laws(melt=lambda elements, time: (-1e-6, None, None)))
    with pytest.raises(RunError, match="base: -1e-06 for element 1"):
        model.advance(steps=1)


def test_a_law_that_changes_elements_is_refused_and_changes_nothing() -> None:
    """Bug: a force that moved its berg by a degree at each call ran to the end."""

    def moving(elements, time):
        elements.place.lon[:] += 1.0
        return 0.0, 0.0

    def thinning(elements, time):
        elements.body.thickness *= 0.5
        return None, None, None

    model = Model(berg(), Steady(current=(0.1, 0.0)), laws=Laws(force=moving))
    before = model.elements.lon.copy()
    with pytest.raises(RunError, match=r"Laws, force: moving changes the elements.*Model.after_step"):
        model.advance(steps=1)
    np.testing.assert_array_equal(model.elements.lon, before)
    model.elements.lon[:] = before  # and may be written again
    warm = Parameters().changed(melt={"enabled": True})
    model = Model(berg(), Steady(temperature=2.0, salinity=34.0), warm, laws=Laws(melt=thinning))
    with pytest.raises(RunError, match="Laws, melt: thinning changes the elements"):
        model.advance(steps=1)


def test_a_run_with_laws_is_not_resumed_without_them(tmp_path: Path) -> None:
    """Bug: it went on without the force, to another place."""
    laws, sea = Laws(force=towed, fracture=lambda moment, strengths: np.zeros(len(moment.stress))), Steady()
    model = Model(berg(), sea, laws=laws)
    model.advance(steps=1)
    file = model.save(tmp_path / "it.restart.nc")
    for given in (None, Laws(), Laws(melt=towed)):
        with pytest.raises(
            InputError, match=r"law of one's own for force and fracture.*laws=Laws\(force=..., fracture=...\)"
        ):
            Model.resume(file, sea, laws=given)
    with pytest.raises(InputError, match=r"law of one's own for fracture"):
        Model.resume(file, sea, laws=Laws(force=towed))
    Model.resume(file, sea, laws=laws).advance(steps=1)
    Model.resume(Model(berg(), sea).save(tmp_path / "plain.restart.nc"), sea).advance(steps=1)
