"""Laws of one's own: they act in the scheme, and outputs and ledgers know them as they know the built-in ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from contract import FORCES
from engines.test_elastic_cells import pulled
from riftberg import Forcing, Iceberg, Laws, Model, Parameters
from riftberg.diagnostics.cut import external_forces
from riftberg.ensembles.uncertain import with_errors
from riftberg.errors import InputError, RunError

WARM = Parameters().changed(melt={"enabled": True, "temperature": 2.0, "salinity": 34.0})
METRES = Parameters().changed(earth={"latlon": False, "f_plane": True, "reference_latitude": -60.0, "period": 0.0})


def berg(**options) -> Iceberg:
    return Iceberg.rectangle(6e3, 3e3, thickness=200.0, placement=(-37.0, -56.0), **options)


def towed(elements, time):
    """A pull that grows by the hour, less a drag."""
    return 2e6 * (1.0 + time / 3600.0) - 1e7 * elements.motion.u, -1e7 * elements.motion.v


def test_a_force_of_ones_own_is_in_outputs_ledger_and_why(tmp_path: Path) -> None:
    plane = Iceberg.rectangle(6e3, 3e3, thickness=200.0, latlon=False, offset=(0.0, 0.0))
    model = Model(plane, Forcing.uniform(), METRES, laws=Laws(force=towed))
    run = model.run(steps=6, every_hours=0.0, forces=True)
    own = run["force_own_x"].values[:, 1:]
    assert (own > 1.9e6).all()
    dt, balance = model.parameters.time_step, model.motion.balance(model, model.remembered)
    assert balance.impulse["own"][0] == pytest.approx(dt * own.sum(), rel=1e-6)
    assert balance.work["own"] > 0.0
    assert balance.momentum_error < 1e-9
    told = external_forces(run, 2, model.constants)["own force"][:, 0]
    np.testing.assert_allclose(told, 0.5 * (own[:, 1] + own[:, 2]), rtol=1e-6)
    assert "towed" in model.forcing.describe()
    assert run.attrs["laws"] == "force by towed"
    assert "own force +" in " ".join(balance.lines())
    assert (
        run["x"].values[:, -1] > Model(plane, Forcing.uniform(), METRES).run(steps=6)["x"].values[:, -1] + 10.0
    ).all()


@pytest.mark.quick(2)
@pytest.mark.parametrize("scheme", ["quasi_static", "verlet", "runge_kutta", "mts"])
def test_a_resumed_run_with_a_force_of_ones_own_has_the_same_digits(scheme, tmp_path: Path) -> None:
    """The force depends on the velocity, which is another one when the file is read."""
    bonds = {"law": "none"} if scheme in ("verlet", "runge_kutta") else {}
    substeps = {"substeps": 40} if scheme == "mts" else {}
    p = Parameters().changed(
        stepping={"scheme": scheme, "time_step": 600.0, **substeps}, bonds=bonds, fracture={"enabled": False}
    )
    laws, sea = Laws(force=towed), Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0))
    whole, first = (Model(berg(), sea, p, laws=laws) for _ in range(2))
    whole.advance(steps=5)
    first.advance(steps=2)
    again = Model.resume(first.save(tmp_path / "it.restart.nc"), sea, laws=laws)
    again.advance(steps=3)
    for name in ("lon", "lat", "u", "v", "own_x"):
        np.testing.assert_array_equal(getattr(again.elements, name), getattr(whole.elements, name))
    np.testing.assert_array_equal(again.applied_forces(), whole.applied_forces())
    assert np.abs(whole.applied_forces()[:, FORCES.index("own")]).max() > 0.0


@pytest.mark.quick(1)
@pytest.mark.parametrize("scheme", ["quasi_static", "mts", "verlet"])
def test_several_forces_act_as_their_sum_and_stand_under_their_names(scheme, tmp_path: Path) -> None:
    def tug(elements, time):
        return 2e6 * (time < 5400.0), 0.0

    def mooring(elements, time):
        return -3e5 * elements.motion.u, -3e5 * elements.motion.v - 1e4

    def both(elements, time):
        return tuple(a + b for a, b in zip(tug(elements, time), mooring(elements, time), strict=True))

    bonds = {"law": "none"} if scheme == "verlet" else {}
    p = Parameters().changed(stepping={"scheme": scheme}, bonds=bonds, fracture={"enabled": False})
    sea = Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0))
    runs = [
        (model := Model(berg(), sea, p, laws=Laws(force=force)), model.run("3 h", every_hours=1, forces=True))
        for force in (both, {"tug": tug, "mooring": mooring}, tug)
    ]
    (one, whole), (two, parts), (alone, by_tug) = runs
    for name in ("lon", "u", "force_own_x", "force_own_y"):
        np.testing.assert_allclose(parts[name], whole[name], rtol=1e-9, atol=1e-9)
    assert "force_tug_x" not in whole
    for axis in "xy":
        together = parts[f"force_tug_{axis}"] + parts[f"force_mooring_{axis}"]
        np.testing.assert_allclose(together, parts[f"force_own_{axis}"], rtol=1e-5, atol=1.0)
    told = external_forces(parts, 2, two.constants)
    assert {"tug", "mooring"} <= set(told)
    assert "own force" not in told
    np.testing.assert_allclose(told["tug"][:, 0], parts["force_tug_x"].isel(time=slice(2, 4)).mean("time"), rtol=1e-6)
    assert "own force" in external_forces(whole, 2, one.constants)
    # What a force gives that knows no velocity is the same whatever acts beside it.
    np.testing.assert_allclose(parts["force_tug_x"], by_tug["force_own_x"], rtol=1e-6, atol=0.1)
    balance = two.motion.balance(two, two.remembered)
    assert balance.impulse["own"] == pytest.approx(one.motion.balance(one, one.remembered).impulse["own"], rel=1e-9)
    for k, sum_of in enumerate((*balance.impulse["own"], balance.work["own"])):
        assert sum(given[k] for given in balance.own.values()) == pytest.approx(sum_of, rel=1e-9)
    given = alone.motion.balance(alone, alone.remembered).impulse["own"][0]
    assert balance.own["tug"][0] == pytest.approx(given, rel=1e-6)
    assert parts["impulse_tug_x"].isel(time=-1).item() == pytest.approx(balance.own["tug"][0])
    assert parts["work_mooring"].isel(time=-1).item() == pytest.approx(balance.own["mooring"][2])
    assert parts.attrs["laws"] == "force by tug and mooring"
    assert "of it tug" in balance.lines()[0]


def test_forces_that_cancel_are_not_lost() -> None:
    def east(elements, time):
        return 1e6, 0.0

    def west(elements, time):
        return -1e6, 0.0

    model = with_errors(Model(berg(), Forcing.uniform(), laws=Laws(force=[east, west])), {"current_error.scale": 1.1})
    model.step()
    np.testing.assert_allclose(model.own_forces()[:, :, 0], [[1e6, -1e6]] * model.elements.size, rtol=1e-6)


def test_forces_without_names_of_their_own_are_refused() -> None:
    def tug(elements, time):
        return 0.0, 0.0

    with pytest.raises(InputError, match="two forces of one name"):
        Model(berg(), Forcing.uniform(), laws=Laws(force=[tug, tug]))
    for name in ("water", "the tug"):
        with pytest.raises(InputError, match="cannot name a force"):
            Model(berg(), Forcing.uniform(), laws=Laws(force={name: tug, "other": tug}))
    with pytest.raises(InputError, match=r"Laws, mooring: 3\.0 is no function"):
        Model(berg(), Forcing.uniform(), laws=Laws(force={"tug": tug, "mooring": 3.0}))


def test_a_melt_law_of_ones_own_is_in_the_ledger_and_the_rest_stays() -> None:
    """A tenth of a metre an hour from below, the built-in laws at the sides."""
    built_in = Model(berg(), Forcing.uniform(current=(0.1, 0.0), slope=(0.0, 0.0)), WARM)
    own = Model(
        berg(),
        Forcing.uniform(current=(0.1, 0.0), slope=(0.0, 0.0)),
        WARM,
        laws=Laws(melt=lambda elements, time: (0.1 / 3600.0, None, None)),
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

    def largest(equilibrium, strengths):
        return np.maximum(equilibrium.stress[:, 0] / strengths.normal, equilibrium.stress[:, 1] / strengths.shear)

    def bar(laws: Laws | None) -> Model:
        at = pulled()
        model = Model.from_state(at.population, at.forcing, at.parameters, at.start, 0.0, 0, (), laws=laws)
        model.step()
        return model

    plain = pulled()
    plain.step()
    same, weak, strong = (
        bar(Laws(fracture=lambda equilibrium, strengths, factor=factor: factor * largest(equilibrium, strengths)))
        for factor in (1.0, 1.2, 0.9)
    )
    np.testing.assert_array_equal(np.isfinite(same.bonds.break_time), np.isfinite(plain.bonds.break_time))
    assert weak.bonds_broken >= same.bonds_broken == 3
    assert np.nanmin(weak.bonds.break_time) <= np.nanmin(same.bonds.break_time)
    assert strong.bonds_broken == 0


@pytest.mark.parametrize("name", ["stress", "displacement"])
def test_a_criterion_that_changes_the_equilibrium_is_refused(name: str) -> None:
    """Bug: one that halved `equilibrium.stress` changed what was stored and recorded."""

    def halving(equilibrium, strengths):
        getattr(equilibrium, name)[:] *= 0.5
        return equilibrium.stress[:, 0] / strengths.normal

    at = pulled()
    model = Model.from_state(
        at.population, at.forcing, at.parameters, at.start, 0.0, 0, (), laws=Laws(fracture=halving)
    )
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
        Model(berg(), Forcing.uniform(), laws=laws)


def test_a_criterion_is_refused_where_the_scheme_has_its_own() -> None:
    mts = Parameters().changed(stepping={"scheme": "mts"})
    with pytest.raises(InputError, match="the scheme mts has its own"):
        Model(berg(), Forcing.uniform(), mts, laws=Laws(fracture=towed))
    with pytest.raises(InputError, match="no bond can break"):
        Model(berg(), Forcing.uniform(), Parameters().changed(fracture={"enabled": False}), laws=Laws(fracture=towed))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (5.0, r"Laws, force: law returns 5.0 instead of 2 arrays \(eastward, northward\)"),
        (
            (np.zeros(3), 0.0),
            "Laws, force: law, eastward: array.*is no number and no array of 2. Return a number, or an array",
        ),
        ((0.0, np.array([0.0, np.nan])), "Laws, force: law, northward: nan for element 2"),
        ((None, 0.0), "Laws, force: law, eastward: nan for element 1. Return a number"),
        (("strong", 0.0), "Laws, force: law, eastward: 'strong' is no number"),
    ],
)
def test_what_a_law_returns_is_checked(given, words) -> None:
    def law(elements, time):
        return given

    with pytest.raises(RunError, match=words):
        Model(berg(), Forcing.uniform(), laws=Laws(force=law)).advance(steps=1)


def test_ice_does_not_grow_by_a_melt_law() -> None:
    model = Model(berg(), Forcing.uniform(), WARM, laws=Laws(melt=lambda elements, time: (-1e-6, None, None)))
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

    model = Model(berg(), Forcing.uniform(current=(0.1, 0.0), slope=(0.0, 0.0)), laws=Laws(force=moving))
    before = model.elements.lon.copy()
    with pytest.raises(RunError, match=r"Laws, force: moving changes the elements.*Model.after_step"):
        model.advance(steps=1)
    np.testing.assert_array_equal(model.elements.lon, before)
    model.elements.lon[:] = before  # and may be written again
    warm = Parameters().changed(melt={"enabled": True})
    model = Model(berg(), Forcing.uniform(temperature=2.0, salinity=34.0), warm, laws=Laws(melt=thinning))
    with pytest.raises(RunError, match="Laws, melt: thinning changes the elements"):
        model.advance(steps=1)


def test_a_run_with_laws_is_not_resumed_without_them(tmp_path: Path) -> None:
    """Bug: it went on without the force, to another place."""
    laws, sea = (
        Laws(force=towed, fracture=lambda equilibrium, strengths: np.zeros(len(equilibrium.stress))),
        Forcing.uniform(),
    )
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


def built_in_drag(elements, time):
    """The built-in drag of the water on a berg of one element."""
    body = elements.body
    draft = 850.0 / 1025.0 * body.thickness
    return 1025.0 * (0.45 * 0.5 * (body.length + body.width) * draft + 0.0025 * body.length * body.width)


def lone(side: float = 60.0, thickness: float = 40.0) -> Iceberg:
    return Iceberg.from_points([-37.0], [-56.0], length=side, width=side, thickness=thickness)


@pytest.mark.parametrize("scheme", ["quasi_static", "verlet", "runge_kutta", "mts"])
def test_a_drag_that_is_the_built_in_one_changes_nothing(scheme: str) -> None:
    bonds = {"law": "none"} if scheme in ("verlet", "runge_kutta") else {}
    p = Parameters(stepping={"scheme": scheme, "time_step": 600.0}, bonds=bonds)
    sea = Forcing.uniform(current=(0.2, 0.1), wind=(5.0, -3.0), slope=(0.0, 0.0))
    runs = [Model(lone(), sea, p, laws=laws) for laws in (None, Laws(drag={"water": built_in_drag}))]
    for model in runs:
        model.advance(steps=6)
    for name in ("lon", "lat", "u", "v"):
        np.testing.assert_allclose(
            getattr(runs[1].elements, name), getattr(runs[0].elements, name), rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize("medium", ["water", "air", "sea_ice"])
@pytest.mark.parametrize("scheme", ["quasi_static", "mts"])
def test_a_stiff_drag_brings_the_berg_to_its_medium_and_never_past_it(medium: str, scheme: str) -> None:
    """Ten times the rate that a step of half an hour resolves, and a hundred times."""
    sea = Forcing.uniform(
        current=(0.2, 0.0), wind=(0.2, 0.0), sea_ice=(0.2, 0.0, 1.0), ice_fraction=0.5, slope=(0.0, 0.0)
    )
    p = METRES.changed(
        stepping={"scheme": scheme, "time_step": 1800.0}, earth={"reference_latitude": 0.0},
        drag={"water_side": 0.0, "water_base": 0.0, "air_side": 0.0, "air_top": 0.0, "ice_side": 0.0},
        **({"sea_ice": {"capture": "none"}} if scheme == "quasi_static" else {}),
    )  # fmt: skip
    plane = Iceberg.from_points([0.0], [0.0], length=60.0, width=60.0, thickness=40.0, latlon=False)
    for stiff in (10.0, 100.0):

        def law(elements, time, stiff=stiff):
            return elements.body.mass * stiff / (1800.0 * 0.2)

        model = Model(plane, sea, p, laws=Laws(drag={medium: law}))
        speeds = []
        for _ in range(8):
            model.step()
            speeds.append(float(model.elements.u[0]))
        assert max(speeds) <= 0.2 + 1e-9
        assert speeds[-1] == pytest.approx(0.2, abs=0.02)


def test_a_force_with_its_rate_needs_no_short_step() -> None:
    """Bug: a mooring of k dt = 10 ended the run at 11 m/s; with its rate it holds the berg as a short step has it."""

    def mooring(elements, time):
        k = elements.body.mass * 10.0 / 1800.0
        return k * (0.04 - elements.motion.u), -k * elements.motion.v, k

    model = Model(lone(), Forcing.uniform(), Parameters(stepping={"time_step": 1800.0}), laws=Laws(force=mooring))
    model.advance(steps=8)
    assert float(model.elements.u[0]) == pytest.approx(0.04, abs=2e-3)
    assert float(model.elements.v[0]) == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize(
    ("drag", "words"),
    [
        (
            {"water": lambda elements, time: -1.0},
            "Laws, drag of water: .*coefficient: -1 for element 1. Return a number of 0 or more",
        ),
        (
            {"water": lambda elements, time: None},
            "Laws, drag of water: .*coefficient: nan for element 1. Return a number",
        ),
        ({"sea_ice": lambda elements, time: "much"}, "Laws, drag of sea_ice: .*coefficient: 'much' is no number"),
        ({"air": lambda elements, time: np.zeros(5)}, "Laws, drag of air: .*is no number and no array of 1"),
    ],
)
def test_what_a_drag_returns_is_checked(drag, words) -> None:
    with pytest.raises(RunError, match=words):
        Model(lone(), Forcing.uniform(), laws=Laws(drag=drag)).advance(steps=1)


def test_a_rate_below_zero_is_refused() -> None:
    def growing(elements, time):
        return 0.0, 0.0, -1.0

    with pytest.raises(RunError, match="Laws, force: growing, rate: -1 kg s-1 for element 1"):
        Model(lone(), Forcing.uniform(), laws=Laws(force=growing)).advance(steps=1)


@pytest.mark.parametrize("drag", [built_in_drag, {"ice": built_in_drag}, {"water": 5.0}])
def test_a_drag_without_its_medium_is_refused_before_the_run(drag) -> None:
    with pytest.raises(InputError, match="Laws, "):
        Model(lone(), Forcing.uniform(), laws=Laws(drag=drag))


def test_a_run_with_a_drag_of_ones_own_goes_on_bit_for_bit(tmp_path: Path) -> None:
    laws, sea = Laws(force=towed, drag={"water": built_in_drag}), Forcing.uniform(current=(0.2, 0.1), slope=(0.0, 0.0))
    whole, first = (Model(lone(), sea, laws=laws) for _ in range(2))
    whole.advance(steps=5)
    first.advance(steps=2)
    again = Model.resume(first.save(tmp_path / "it.restart.nc"), sea, laws=laws)
    again.advance(steps=3)
    np.testing.assert_array_equal(again.elements.lon, whole.elements.lon)
    assert "drag by water" in laws.named()
    with pytest.raises(InputError, match="drag"):
        Model.resume(tmp_path / "it.restart.nc", sea)
