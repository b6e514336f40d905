"""Damage in whole runs: off without a trace, the life under constant stress, files, what it is refused with, rifts."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from riftberg import A68A_2022, A68A_2022_KID, Forcing, Iceberg, Model, Parameters, open_run
from riftberg.cli.main import app
from riftberg.errors import InputError
from riftberg.experiments.changes import reference_numerics
from riftberg.runs.layout import run_parameters
from test_resume import PHYSICS, bergs, differing, knoll
from verification.setups import RADIUS, parameters

STRENGTH = 10e3
HOUR = 3600.0

HALF_HOUR = {"time_step": 1800.0}


def pulled(r: float, columns: int = 2, *, time_step: float = 600.0, **damage: Any) -> Model:
    """Return a row of elements, held at one end and pulled at the other so that its bonds bear about ``r`` times the strength."""
    x = 2.0 * RADIUS * np.arange(columns)
    berg = Iceberg.from_points(x, 0.0 * x, thickness=200.0, radius=RADIUS, static=x == 0.0, latlon=False)
    berg.elements.load_x[-1] = r * STRENGTH * 2.0 * RADIUS * 200.0
    p = parameters(
        fracture={"enabled": True, "normal_strength": STRENGTH}, damage={"enabled": True, **damage},
        stepping={"scheme": "quasi_static", "time_step": time_step, "only_interactions": True},
    )  # fmt: skip
    return Model(berg, Forcing.uniform(), p)


def borne(r: float) -> float:
    """Stress of the bond of two such elements over its strength: the ends of a short row share the load with no one."""
    model = pulled(r)
    model.step()
    return float(model.bonds.normal_stress[0]) / STRENGTH


def life(model: Model) -> float:
    """Run until a bond breaks and return when it did, s."""
    while model.bonds_broken == 0:
        model.step()
    return float(np.nanmin(model.bonds.break_time))


@pytest.mark.quick(1)
@pytest.mark.parametrize(("r", "m"), [(0.5, 2.0), (0.5, 1.0), (0.8, 3.0)])
def test_the_life_of_a_bond_tends_to_the_closed_form_as_the_step_shrinks(r: float, m: float) -> None:
    """``t_f = tau (1 - r^(m + 1)) / ((m + 1) r^m)``; it comes out late, as steps from the slow side do."""
    tau, ratio = 4 * HOUR, borne(r)
    exact = tau * (1.0 - ratio ** (m + 1)) / ((m + 1) * ratio**m)
    late = []
    for dt in (600.0, 150.0, 37.5):
        late.append(life(pulled(r, time_step=dt, threshold=0.0, time_scale=tau, exponent=m)) - exact)
        assert 0.0 < late[-1] < 3.0 * dt
    assert late[-1] < 1e-2 * exact
    assert all(fine < coarse for coarse, fine in pairwise(late))


def test_damage_over_time_is_the_closed_form() -> None:
    model, ratio = pulled(0.5, time_step=60.0, threshold=0.0, time_scale=4 * HOUR, exponent=2.0), borne(0.5)
    for _ in range(200):
        model.step()
        exact = 1.0 - (1.0 - 3.0 * ratio**2 * model.time / (4 * HOUR)) ** (1.0 / 3.0)
        assert model.bonds.damage[0] == pytest.approx(exact, rel=1e-2)


@pytest.mark.slow
def test_a_time_scale_ten_times_as_long_makes_a_life_ten_times_as_long() -> None:
    short, long = (
        life(pulled(0.9, time_step=dt, threshold=0.3, time_scale=tau))
        for dt, tau in ((60.0, 5 * HOUR), (600.0, 50 * HOUR))
    )
    assert long == pytest.approx(10.0 * short, rel=1e-6)


def test_a_bond_below_the_threshold_lives_for_ever_and_above_it_dies_sooner_the_more_it_bears() -> None:
    threshold = borne(0.5)
    model = pulled(0.49, threshold=threshold, time_scale=HOUR)
    model.advance(days=1)
    assert (model.bonds.damage == 0.0).all()
    lives = [life(pulled(r, threshold=threshold, time_scale=HOUR)) for r in (0.6, 0.8, 0.95, 1.2)]
    assert all(later > sooner for later, sooner in pairwise(lives))


def test_weak_bonds_of_a_rift_go_first() -> None:
    """Relative strength and damage multiply: a bond of half the strength bears twice the ratio."""
    model = pulled(0.4, columns=5, time_step=60.0, threshold=0.0, time_scale=4 * HOUR, exponent=2.0)
    model.bonds.strength[2] = 0.5
    model.step()
    ratio = 2.0 * model.bonds.normal_stress[2] / STRENGTH
    assert life(model) == pytest.approx(4 * HOUR * (1.0 - ratio**3) / (3.0 * ratio**2), rel=0.02)
    np.testing.assert_array_equal(np.flatnonzero(model.bonds.status), [2])
    assert model.bonds.damage[2] > 2.0 * model.bonds.damage[[0, 1, 3]].max()


def test_a_rift_without_strength_stays_one() -> None:
    """No 0 / 0: it bears no tension, and in compression nothing is taken."""
    berg = Iceberg.rectangle(12e3, 6e3, thickness=200.0, placement=(-39.0, -55.0))
    cut = berg.with_rifts([[-39.0, -56.0], [-39.0, -54.0]], strength=0.0)
    model = Model(
        cut,
        Forcing.uniform(current=(0.2, 0.0), slope=(0.0, 0.0)),
        A68A_2022.changed(damage={"enabled": True, "threshold": 0.0}),
    )
    model.advance(days=0.5)
    assert np.isfinite(model.bonds.damage).all()
    assert model.bonds_broken == int((cut.bonds.strength == 0.0).sum())


def run_of(p: Parameters, steps: int = 7) -> Model:
    """Return a model of two bergs after some steps in which bonds break."""
    model = Model(bergs(), knoll(), p)
    for _ in range(steps):
        model.step()
    return model


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", [name for name in PHYSICS if name.startswith("quasi-static")])
def test_off_it_leaves_no_trace(name: str) -> None:
    """Bit for bit, whatever its other parameters, and the same as a threshold that is never reached."""
    plain = PHYSICS[name].changed(damage={"enabled": False})
    off = run_of(plain)
    assert (off.bonds.damage == 0.0).all()
    fierce = run_of(plain.changed(damage={"threshold": 0.0, "time_scale": 1.0, "exponent": 0.1}))
    assert differing(fierce, off) == ["parameters"]


def test_a_stress_that_is_never_reached_changes_no_bit() -> None:
    p = A68A_2022.changed(stepping=HALF_HOUR, fracture={"normal_strength": 1e9, "shear_strength": 1e9})
    on = run_of(p.changed(damage={"enabled": True, "threshold": 0.9}))
    assert (on.elements.lon != bergs().elements.lon).any()
    assert differing(on, run_of(p)) == ["parameters"]


def test_it_makes_a_berg_break_that_else_holds() -> None:
    """Above the 30 kPa at which the impact breaks bonds itself: whichever breaks first decides there what breaks after it."""
    p = A68A_2022.changed(stepping=HALF_HOUR, fracture={"normal_strength": 40e3, "shear_strength": 1e9})
    whole = run_of(p)
    worn = run_of(p.changed(damage={"enabled": True, "threshold": 0.0, "time_scale": 0.5}))
    assert whole.bonds_broken == 0
    assert worn.bonds_broken > whole.bonds_broken


def test_it_is_in_the_run_file_where_it_is_on(tmp_path: Path) -> None:
    model = pulled(0.4, columns=4, threshold=0.0, time_scale=4 * HOUR)
    model.run(days=0.125, output=tmp_path / "run.nc", every_hours=1.0)
    with open_run(tmp_path) as run:
        assert run["damage"].dims == ("bond", "time")
        assert run["damage"].attrs["units"] == "1"
        assert (np.diff(run["damage"].values, axis=1) > 0.0).all()
        np.testing.assert_array_equal(run["damage"].values[:, -1], model.bonds.damage.astype("f4"))
    off = Model(bergs(), Forcing.uniform()).run(days=0.125)
    assert "damage" not in off


@pytest.mark.parametrize(
    ("name", "value"),
    [("threshold", -0.1), ("threshold", 1.0), ("time_scale", 0.0), ("exponent", 0.0), ("exponent", float("nan"))],
)
def test_impossible_parameters_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        Parameters(damage={name: value})


@pytest.mark.parametrize(("groups", "now"), [
    ({"fracture": {"enabled": False}}, "damage lowers the strength of bonds that can break"),
    ({"bonds": {"law": "none"}}, "damage lowers the strength of bonds that can break"),
    ({"bonds": {"law": "spring"}}, "leave it out, or set stepping.scheme = 'quasi_static'"),
    ({"stepping": {"scheme": "mts"}}, "leave it out, or set stepping.scheme = 'quasi_static'"),
])  # fmt: skip
def test_it_needs_bonds_that_can_break_in_equilibrium(groups: dict[str, Any], now: str) -> None:
    with pytest.raises(InputError, match=now):
        Parameters(damage={"enabled": True}, **groups)


@pytest.mark.parametrize("name", ["normal_strength", "shear_strength"])
@pytest.mark.parametrize("value", [0.0, -18e3])
def test_strengths_that_are_none_are_refused(name: str, value: float) -> None:
    changed = {name: value}
    with pytest.raises(InputError, match=rf"fracture.{name} = {value:g} Pa is no strength.*fracture.enabled = false"):
        Model(bergs(), Forcing.uniform(), A68A_2022.changed(fracture=changed))
    Model(bergs(), Forcing.uniform(), A68A_2022.changed(fracture={**changed, "enabled": False}))
    Model(bergs(), Forcing.uniform(), A68A_2022_KID.changed(fracture=changed))  # runs of KID must run as they stand


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("strength", -0.5),
        ("strength", np.nan),
        ("strength", np.inf),
        ("damage", -0.1),
        ("damage", 1.0),
        ("damage", np.nan),
    ],
)
def test_impossible_values_of_a_bond_are_named(name: str, value: float) -> None:
    berg = bergs()
    getattr(berg.bonds, name)[3] = value
    ends = berg.bonds.first[3], berg.bonds.second[3]
    with pytest.raises(
        InputError, match=rf"bond in row 3, between the elements in rows {ends[0]} and {ends[1]}: {name}"
    ):
        Model(berg, Forcing.uniform())


def test_numerics_of_the_reference_and_runs_of_kid_know_no_damage() -> None:
    assert not hasattr(A68A_2022_KID, "damage")
    notices: list[str] = []
    reference_numerics(A68A_2022.changed(damage={"enabled": True}), notices=notices)
    assert notices == ["stepping.scheme = 'mts' has no damage.enabled: left out"]


@pytest.mark.slow
def test_it_is_set_on_the_command_line(tmp_path: Path) -> None:
    settings = ["damage.enabled=true", "damage.time_scale=6 hours", "damage.threshold=0.2", "damage.exponent=3"]
    words = [word for setting in settings for word in ("--set", setting)]
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["run", "a68a", "--days", "0.25", "-o", str(out), "-q", "--no-map", *words])
    assert result.exit_code == 0, result.output
    with open_run(out) as run:
        used = run_parameters(run).damage
        assert "damage" in run
    assert (used.enabled, used.time_scale, used.threshold, used.exponent) == (True, 6 * HOUR, 0.2, 3.0)
    result = CliRunner().invoke(app, ["run", "a68a", "-o", str(out / "b"), "--set", "damage.threshold=1"])
    assert result.exit_code == 2
    assert "damage.threshold" in result.output
