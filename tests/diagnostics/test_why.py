"""Reasons of break-ups: loads across a cut under known forces, histories of bonds, controls, words."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread

from contract import FORCES_IN_TABLES
from fakes import EXPLICIT, FakeModel
from riftberg import Forcing, Iceberg, Model, Parameters, build, draw_reasons, explain, open_run
from riftberg.diagnostics.why import control_fate, reason_lines
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import Scene

FLOOR = "The force of the sea floor is not recorded: it is taken to be what closes the budget"

PIECE = slice(18, 24)
"""Rows of the last two columns of the fake berg of 8 by 3 elements, which break off after a day."""


def made(path: Path, **how: Any) -> xr.Dataset:
    """Run the fake berg for two days."""
    model = FakeModel(**{"turn_per_day": 0.0, **how})
    model.advance(2, recorders=[RunWriter(path, every_hours=1, experiment="fake")])
    return open_run(path)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Return a run in which the last two columns break off."""
    return made(tmp_path_factory.mktemp("why") / "run.nc")


def explained(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch, force: np.ndarray) -> Any:
    """Explain the break-up with a given force called ocean drag, and no other."""

    def forces(run: xr.Dataset, record: int, p: Any) -> dict[str, np.ndarray]:
        return {name: force if name == "ocean drag" else np.zeros_like(force) for name in FORCES_IN_TABLES}

    monkeypatch.setattr("riftberg.diagnostics.cut.external_forces", forces)
    (breakup,) = explain(run).breakups
    return breakup


def field(piece: tuple[float, float], rest: tuple[float, float]) -> np.ndarray:
    """Return a force on each element of piece and rest."""
    force = np.tile(np.array(rest, float), (24, 1))
    force[PIECE] = piece
    return force


def test_the_break_is_described(run: xr.Dataset) -> None:
    (breakup,) = explain(run).breakups
    assert (breakup.fragment, breakup.parent, breakup.elements, breakup.bonds) == (2, 1, 6, 3)
    assert breakup.area_km2 == 54.0
    assert breakup.time == "2020-12-10T13:00:00"
    assert breakup.grounded
    assert sorted(breakup.members) == list(range(19, 25))
    assert breakup.decisive.cut_km == pytest.approx(9.0, rel=1e-3)
    assert breakup.decisive.thickness == 200.0


@pytest.mark.slow
def test_what_a_crack_released_is_told_per_area_and_as_toughness(run: xr.Dataset) -> None:
    """G = energy / area and K = sqrt(E G); the scheme of this run knows neither, so both are put in by hand."""
    assert explain(run).breakups[0].released_per_area is None
    (before,) = explain(run).breakups
    energy, area = np.zeros(run.sizes["bond"]), np.zeros(run.sizes["bond"])
    energy[before.first_bonds[0].bond], area[before.first_bonds[0].bond] = 3e9, 1.5e6
    (b,) = explain(run.assign(released_energy=("bond", energy), cracked_area=("bond", area))).breakups
    assert b.released_per_area == pytest.approx(2000.0)
    assert b.released_toughness == pytest.approx(np.sqrt(2000.0 * Scene(run).parameters.bonds.youngs_modulus))
    assert "2000 J/m2" in " ".join(reason_lines(replace(explain(run), breakups=[b])))


def test_opposite_pulls_are_carried_as_tension(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    # 6 elements pulled east with 3 GN in all, 18 pulled west with as much.
    load = explained(run, monkeypatch, field((5e8, 0.0), (-3e9 / 18, 0.0))).decisive
    assert load.tension["ocean drag"] == pytest.approx(3e9, rel=1e-3)
    assert abs(load.shear["ocean drag"]) < 2e7
    assert abs(load.couple["ocean drag"]) < 3e9 * 30.0
    assert load.stress["ocean drag"] == pytest.approx(3e9 / (200.0 * 9e3), rel=0.06)
    assert load.tension_recorded == pytest.approx(3e9, rel=1e-3)


@pytest.mark.quick(1)
@pytest.mark.parametrize("turn", [-35.0, 50.0, 130.0])
def test_tension_and_shear_are_those_along_the_cut_however_the_berg_lies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, turn: float
) -> None:
    """The berg has turned when it breaks; the pull is along its long axis, the drag across it, both in balance."""
    run = made(tmp_path / "run.nc", turn_per_day=turn)
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    for along, across in ((5e8, 0.0), (0.0, 5e8)):
        east, north = along * c - across * s, along * s + across * c
        load = explained(run, monkeypatch, field((east, north), (-east / 3.0, -north / 3.0))).decisive
        assert load.tension["ocean drag"] == pytest.approx(6.0 * along, rel=0.02, abs=3e8)
        assert (abs(load.shear["ocean drag"]) > 4e8) == (across > 0.0)


@pytest.mark.parametrize(("aground", "afloat"), [((), 23), ((19, 20, 21, 22, 23, 24), 17), ((10, 11), 23)])
def test_the_budget_is_closed_where_no_force_of_the_floor_is_made_up(
    run: xr.Dataset, monkeypatch: pytest.MonkeyPatch, aground: tuple[int, ...], afloat: int
) -> None:
    """At the last record at which the whole berg floats until the next one: else the floor takes what is left."""
    depth = run["depth"].copy(data=np.full(run["depth"].shape, 1000.0))
    depth[dict(time=list(aground), trajectory=5)] = 20.0

    def forces(run: xr.Dataset, record: int, p: Any) -> dict[str, np.ndarray]:
        drag, wind = np.tile([1e8 * (record + 1), 0.0], (24, 1)), np.tile([-1e8, 0.0], (24, 1))
        return {name: {"ocean drag": drag, "wind drag": wind}.get(name, np.zeros((24, 2))) for name in FORCES_IN_TABLES}

    monkeypatch.setattr("riftberg.diagnostics.cut.external_forces", forces)
    (breakup,) = explain(run.assign(depth=depth)).breakups
    assert breakup.closure == pytest.approx(afloat / (afloat + 2.0), rel=1e-3)


def test_a_push_is_negative_tension(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    load = explained(run, monkeypatch, field((-5e8, 0.0), (3e9 / 18, 0.0))).decisive
    assert load.tension["ocean drag"] == pytest.approx(-3e9, rel=1e-3)


def test_the_same_force_per_mass_loads_no_cut(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    load = explained(run, monkeypatch, np.tile([4e8, -7e8], (24, 1))).decisive
    scale = 24 * 8e8
    assert abs(load.tension["ocean drag"]) < 1e-3 * scale
    assert abs(load.couple["ocean drag"]) < 1e-3 * scale * 9e3


def test_bending_is_that_of_a_free_beam(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    # Forces north at both ends, south in the middle: moment at the cut = sum of the piece's forces times their arms,
    # because the body neither shifts nor turns.
    north = np.zeros(24)
    column = np.repeat(np.arange(8), 3)
    north[(column == 0) | (column == 7)] = 1e9
    north[(column == 3) | (column == 4)] = -1e9
    load = explained(run, monkeypatch, np.column_stack([np.zeros(24), north])).decisive
    arm = 4.5e3  # from the cut (between columns 5 and 6) to the middle of column 7
    assert load.couple["ocean drag"] == pytest.approx(-3e9 * arm, rel=2e-3)
    assert load.shear["ocean drag"] == pytest.approx(-3e9, rel=2e-3)
    assert load.nominal == pytest.approx(6.0 * 3e9 * arm / (200.0 * 9e3**2), rel=5e-3)


@pytest.mark.slow
def test_history_of_the_first_bonds(run: xr.Dataset) -> None:
    (breakup,) = explain(run).breakups
    assert len(breakup.first_bonds) == 3
    bond = breakup.first_bonds[0]
    assert bond.time == "2020-12-10T13:00:00"
    assert bond.strength == 18e3
    assert bond.hours[0] == -24.0
    assert bond.hours[-1] == 0.0
    np.testing.assert_allclose(bond.tension, 1000.0 + (86_400.0 + 3600.0 * np.array(bond.hours)) / 100.0, rtol=1e-6)
    np.testing.assert_allclose(bond.peak[1:], np.array(bond.tension[1:]) + 482.0, rtol=1e-4)
    assert breakup.sudden
    assert breakup.highest == pytest.approx(1000.0 + 23 * 36.0)
    assert breakup.peak == pytest.approx(1000.0 + 23 * 36.0 + 482.0)


@pytest.mark.slow
def test_ringing_between_records_is_told(run: xr.Dataset) -> None:
    text, *_ = reason_lines(explain(run))
    assert (
        "Its largest tensile stress between records was 1.0 kPa 24 h before, 2.1 kPa 6 h before, 2.3 kPa just before"
        in text
    )
    assert "more than 1.8 kPa at the record before, but 2.3 kPa between that and the one before it" in text


@pytest.mark.slow
def test_a_landing_in_the_quasi_static_scheme_is_told_as_one() -> None:
    """Bug: nothing rings in that scheme, but the tip of A68a "broke in the ringing after the kicks of the slow forces"."""
    model, _ = build("a68a")
    reasons = explain(model.run(days=8.0))
    (tip,) = reasons.breakups
    assert (tip.grounded, tip.in_equilibrium) == (True, True)
    assert "ringing" not in reason_lines(reasons)[0]
    # On a bed the load grows for an hour; had it come at once:
    tip = dataclasses.replace(tip, sudden=True)
    landed = [tip, dataclasses.replace(tip, decisive=dataclasses.replace(tip.decisive, aground=0))]
    landed[1].first_bonds[0] = dataclasses.replace(tip.first_bonds[0], grounded=True)
    texts = reason_lines(replace(reasons, breakups=landed))[:2]
    for text in texts:
        assert "on impact" in text
        assert "ringing" not in text
        assert "no force parts the cut" not in text
    assert "before it touched the sea floor; the impact broke it" in texts[1]


@pytest.mark.slow
def test_files_without_peaks_are_explained_by_their_records(run: xr.Dataset) -> None:
    (breakup,) = explain(run.drop_vars("peak_stress")).breakups
    assert breakup.first_bonds[0].peak == []
    assert breakup.peak is None
    assert "Its tensile stress was 1.0 kPa 24 h before" in reason_lines(explain(run.drop_vars("peak_stress")))[0]


@pytest.mark.slow
def test_a_worn_bond_is_told_by_the_strength_that_was_left(run: xr.Dataset) -> None:
    """And a stress that is small for a whole bond is not small for one with a tenth of its strength."""
    worn = np.full((run.sizes["bond"], run.sizes["time"]), 0.9)
    (breakup,) = explain(run.assign(damage=(("bond", "time"), worn))).breakups
    assert breakup.first_bonds[0].strength == pytest.approx(1.8e3)
    assert breakup.highest == pytest.approx(1000.0 + 23 * 36.0)
    assert not breakup.sudden


@pytest.mark.slow
def test_a_weak_bond_that_reaches_its_own_strength_did_not_break_suddenly(run: xr.Dataset) -> None:
    """Bug: its stress was held against the strength of the ice, so weak bergs always broke "suddenly"."""
    weak = run.assign(strength=("bond", np.full(run.sizes["bond"], 0.1)))
    (breakup,) = explain(weak).breakups
    assert breakup.first_bonds[0].strength == pytest.approx(1.8e3)
    assert breakup.highest == pytest.approx(1000.0 + 23 * 36.0)
    assert not breakup.sudden


@pytest.mark.slow
def test_a_run_that_melts_is_explained(run: xr.Dataset) -> None:
    """Bug: mass and area change with time there, and were taken for columns of the elements: TypeError."""
    left = np.linspace(1.0, 0.5, run.sizes["time"])
    changing = {
        name: (("trajectory", "time"), run[name].values[:, None] * left**part)
        for name, part in {"mass": 1.0, "length": 0.1, "width": 0.1}.items()
    }
    (breakup,) = explain(run.assign(changing)).breakups
    before, part = breakup.budgets["fragment"].mass, float(run["mass"].values[PIECE].sum())
    assert before == pytest.approx(part * left[23])


def test_small_pieces_are_counted_not_told(run: xr.Dataset) -> None:
    reasons = explain(run, smallest=0.5)
    assert reasons.breakups == []
    assert reasons.small == 1
    assert reason_lines(reasons)[0] == "Nothing broke off but 1 small piece (--all lists them)."


@pytest.mark.slow
def test_a_control_removes_a_break_or_delays_it(run: xr.Dataset, tmp_path: Path) -> None:
    (breakup,) = explain(run).breakups
    assert control_fate(breakup, run) == "breaks off at 2020-12-10T13:00:00"
    later = made(tmp_path / "later.nc", break_time=1.5 * 86_400.0)
    assert control_fate(breakup, later) == "breaks off at 2020-12-11T01:00:00"
    assert control_fate(breakup, made(tmp_path / "never.nc", break_time=math.inf)) == "removed"


@pytest.mark.slow
def test_a_control_in_which_another_piece_breaks_off_is_told_with_both_areas(run: xr.Dataset) -> None:
    (breakup,) = explain(run).breakups
    inside, whole = breakup.members, [int(n) for n in run["trajectory"].values]
    away = [n for n in whole if n not in inside]
    breakup.members = inside[:2]
    told = "breaks off at 2020-12-10T13:00:00 with another area, 54 km2 instead of 18 km2"
    assert control_fate(breakup, run) == told
    breakup.members = inside + away[:5]
    told = "breaks off at 2020-12-10T13:00:00 with another area, 54 km2 instead of 99 km2"
    assert control_fate(breakup, run) == told
    breakup.members = inside[:2] + away[:3]
    told = "breaks off only in part, 18 of 45 km2 at 2020-12-10T13:00:00"
    assert control_fate(breakup, run) == told
    breakup.members = away
    assert control_fate(breakup, run) == "removed"


@pytest.mark.slow
def test_a_piece_that_differs_by_less_than_a_tenth_is_the_same(tmp_path: Path) -> None:
    run = made(tmp_path / "run.nc", ny=12)
    (breakup,) = explain(run).breakups
    whole = breakup.members
    breakup.members = [*whole, next(int(n) for n in run["trajectory"].values if n not in whole)]
    assert len(breakup.members) == 25
    assert control_fate(breakup, run) == "breaks off at 2020-12-10T13:00:00"


@pytest.mark.quick(1)
@pytest.mark.parametrize(("share", "named"), [(0.021, True), (0.019, False)])
def test_causes_below_a_fiftieth_of_the_largest_are_not_named(run: xr.Dataset, share: float, named: bool) -> None:
    (breakup,) = explain(run).breakups
    stress = dict.fromkeys(breakup.decisive.stress, 0.0) | {"ocean drag": 20e3, "wind drag": -share * 20e3}
    breakup.decisive = dataclasses.replace(breakup.decisive, stress=stress)
    text, *_ = reason_lines(replace(explain(run), breakups=[breakup]))
    assert "ocean drag +20.0 kPa" in text
    assert ("wind drag -0.4 kPa" in text) == named


def test_words_json_and_figure(run: xr.Dataset, tmp_path: Path) -> None:
    reasons = explain(run)
    reasons.breakups[0].controls = {"without shoal": "removed", "without shear": "breaks off at 2020-12-10T13:00:00"}
    text, *_ = reason_lines(reasons)
    for part in ("fragment 2 (54 km2, 6 elements) broke off berg 1, aground", "3 bonds failed", "strength is 18 kPa",
                 "Without shoal it does not break off.", "Without shear it still breaks off at 2020-12-10 13:00."):  # fmt: skip
        assert part in text, text
    content = json.loads(reasons.write(tmp_path / "why.json").read_text())
    assert content["breakups"][0]["decisive"]["bonds"] == 3
    picture = imread(draw_reasons(reasons, tmp_path / "why.png", dpi=60))
    assert picture[..., :3].std() > 0.04
    reasons.breakups = []
    assert draw_reasons(reasons, tmp_path / "nothing.png", dpi=60).exists()


def test_a_run_that_does_not_break_tells_how_near_it_came(tmp_path: Path) -> None:
    """Named for a white sheet headed 'why it broke': margin, place, nearest bond, forces, and a picture of them."""
    run = made(tmp_path / "run.nc", break_time=math.inf)
    stress = np.zeros(run["peak_stress"].shape)
    bond, record = 7, 3
    stress[(bond, record) if run["peak_stress"].dims[0] == "bond" else (record, bond)] = 9e3
    run["peak_stress"] = (run["peak_stress"].dims, stress)
    reasons = explain(run)
    assert reasons.whole is not None
    assert reasons.whole.nearest is not None
    nearest, ends = reasons.whole.nearest, [int(run[name].values[bond]) for name in ("bond_first", "bond_second")]
    assert nearest.elements == run["trajectory"].values[ends].tolist()
    assert nearest.time == str(run["time"].values[record])[:19]
    assert reasons.whole.used[record] == pytest.approx(0.5) == pytest.approx(max(reasons.whole.used))
    assert nearest.lon == pytest.approx(run["lon"].transpose("trajectory", "time").values[ends, record].mean())
    first, second, *_ = reason_lines(reasons)
    assert first == "Nothing broke off."
    assert f"9 of 18 kPa (50 %) in the bond of elements {nearest.elements[0]} and {nearest.elements[1]} at" in second
    picture = imread(draw_reasons(reasons, tmp_path / "why.png", dpi=60))
    assert picture[..., :3].std() > 0.04  # an empty sheet has some 0.01


def test_a_whole_berg_tells_which_forces_drove_and_braked_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A force along the way drives, one against it brakes, one across does neither; a weak bond counts by its own strength."""
    run = made(tmp_path / "run.nc", break_time=math.inf)
    u, v = (np.nan_to_num(run[name].transpose("trajectory", "time").values[:, 0]) for name in ("u", "v"))
    along = np.column_stack([u, v]) / np.hypot(u, v)[:, None]
    forces = {name: 0.0 * along for name in FORCES_IN_TABLES}
    forces |= {"ocean drag": 3e8 * along, "waves": 1e8 * along, "sea ice": -2e8 * along,
               "wind drag": 9e8 * np.column_stack([-along[:, 1], along[:, 0]])}  # fmt: skip
    monkeypatch.setattr("riftberg.diagnostics.cut.external_forces", lambda run, record, p: forces)
    run["strength"] = ("bond", np.where(np.arange(run.sizes["bond"]) == 3, 0.01, 1.0))
    run["peak_stress"] = run["peak_stress"] * 0.0 + 90.0
    reasons = explain(run)
    told = reason_lines(reasons)[1]
    assert "driven by ocean drag (75 %) and waves (25 %), braked by sea ice (100 %)" in told
    assert reasons.whole is not None
    assert max(reasons.whole.used) == pytest.approx(0.5)


def test_a_bond_that_broke_is_not_the_one_that_came_nearest_to_breaking(tmp_path: Path) -> None:
    """Bug: a bond that failed inside a berg that stayed whole bore "25.7 of 18 kPa (1.4e+02 %)" and was the nearest."""
    run = made(tmp_path / "run.nc", break_time=math.inf)
    stress, dates = np.full((run.sizes["time"], run.sizes["bond"]), 9e3), run["break_time"].values.copy()
    stress[2, 5], dates[5] = 25.7e3, run["time"].values[2]
    run["peak_stress"], run["break_time"] = (("time", "bond"), stress), ("bond", dates)
    whole = explain(run).whole
    assert whole is not None
    assert whole.nearest is not None
    assert max(whole.used) == whole.nearest.stress / whole.nearest.strength == pytest.approx(0.5)


def test_a_berg_that_nothing_pushes_is_drawn_without_a_legend_of_forces(tmp_path: Path) -> None:
    """Matplotlib warned of an empty legend on the terminal."""
    berg = Iceberg.rectangle(6e3, 3e3, thickness=200.0, radius=1500.0, placement=(-40.0, -55.0))
    Model(berg, Forcing.uniform(depth=400.0)).run(steps=4, output=tmp_path / "still.nc")
    with open_run(tmp_path / "still.nc") as still:
        assert draw_reasons(explain(still), tmp_path / "still.png", dpi=40).exists()


def test_a_berg_without_bonds_and_one_that_may_not_break_are_told_as_such(tmp_path: Path) -> None:
    """Sisters of the run that did not break: a lone berg has no bond to name, and without fracture none can fail."""
    lone = made(tmp_path / "run.nc", break_time=math.inf).isel(bond=slice(0, 0))
    reasons = explain(lone)
    assert reasons.whole is not None
    assert reasons.whole.nearest is None
    assert "nearest to breaking" not in reason_lines(reasons)[1]
    assert draw_reasons(reasons, tmp_path / "lone.png", dpi=40).exists()
    parameters = EXPLICIT.changed(fracture={"enabled": False})
    unbroken = made(tmp_path / "b.nc", break_time=math.inf, parameters=parameters)
    assert "fracture.enabled is false" in reason_lines(explain(unbroken))[1]


def test_the_sea_floor_is_found_from_the_balance(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bug: a force of the floor from the velocity of one moment was ten times the one that stopped the berg."""
    aground = run.copy()
    depth = np.full((24, run.sizes["time"]), 1e4)
    depth[23] = 100.0
    aground["depth"] = (("trajectory", "time"), depth)
    load = explained(aground, monkeypatch, np.tile([0.0, 2e8], (24, 1))).decisive
    # The berg does not change its velocity, so the floor holds all 4.8 GN at the last element of the piece.
    assert load.aground == 1
    x, y = 3e3 * (np.repeat(np.arange(8), 3) - 3.5), 3e3 * (np.tile(np.arange(3), 8) - 1.0)
    turn = -4.8e9 * x[23] / float((x**2 + y**2 + 9e6 / (2.0 * math.pi)).sum())
    needed = 6 * -4.8e9 / 24 + turn * x[PIECE].sum() + 4.8e9
    assert load.shear["sea floor"] == pytest.approx(needed, rel=2e-3)
    reasons = explain(aground)
    assert FLOOR in reason_lines(reasons)[0]  # the reader is told that the budget closes by construction
    told, *_ = reason_lines(replace(reasons, breakups=[replace(reasons.breakups[0], closure=0.012)]))
    assert "recorded motion when it was last afloat within 1.2 %" in told
    budget = reasons.breakups[0].budgets["both"]
    assert budget.residual is not None
    assert np.hypot(*budget.residual) < 1e-6 * 4.8e9


def test_no_force_is_blamed_for_a_cut_that_carries_little(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    """Named for a piece that hung on one bond: its cut carried 0.8 kPa, and was said to have broken by ocean drag."""
    breakup = explained(run, monkeypatch, field((5e8, 0.0), (-3e9 / 18, 0.0)))
    assert breakup.decisive.nominal < 0.25 * 18e3
    reasons = explain(run)
    reasons.breakups[:] = [breakup]
    text, *_ = reason_lines(reasons)
    assert "no force parts the cut as a whole" in text
    assert "broke because" not in text


def test_coriolis_and_slope_are_weighed_together(run: xr.Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    pull = field((5e9, 0.0), (-3e10 / 18, 0.0))
    parts = {"ocean drag": 0.5, "Coriolis": 2.0, "surface slope": -1.0}
    forces = {name: parts.get(name, 0.0) * pull for name in FORCES_IN_TABLES}
    monkeypatch.setattr("riftberg.diagnostics.cut.external_forces", lambda run, record, p: forces)
    reasons = explain(run)
    text, *_ = reason_lines(reasons)
    nominal = reasons.breakups[0].decisive.nominal
    assert f"(Coriolis and surface slope, {nominal / 1.5 / 1e3:+.1f} kPa, 67 % of what pulls)" in text
    assert "as in a sheared current" in text
    # Named for a page that gave the largest alone, which was a third of the load: the second is told too.
    assert (
        f"and because the current exerts a different drag on its parts (ocean drag, {nominal / 3e3:+.1f} kPa, 33 %"
        in text
    )
    assert "Coriolis" not in reasons.breakups[0].budgets["both"].forces


@pytest.mark.slow
def test_a_break_soon_after_the_start_is_told_as_one(run: xr.Dataset) -> None:
    reasons = explain(run)
    assert reasons.breakups[0].hours_since_start == 24.0
    assert "after the start" not in reason_lines(reasons)[0]
    early = dataclasses.replace(reasons.breakups[0], hours_since_start=2.5)
    reasons.breakups[:] = [early]
    assert "This is 2.5 h after the start" in reason_lines(reasons)[0]


@pytest.mark.parametrize(
    ("minutes", "counts"), [(-1, False), (0, True), (60, True), (89, True), (91, False), (600, False)]
)
def test_a_break_up_is_of_a_collision_while_it_lasts_and_one_step_longer(
    run: xr.Dataset, minutes: int, counts: bool
) -> None:
    """Contact for an hour, with long steps of half an hour; the other berg is named whichever side it stands on."""
    assert Scene(run).parameters.time_step == 1800.0
    begin = np.datetime64(explain(run).breakups[0].first_break, "ns") - np.timedelta64(minutes, "m")
    for first, second in ((1, 7), (7, 1)):
        (found,) = explain(run.drop_dims("contact").assign({
            "contact_time": ("contact", [begin]), "contact_end": ("contact", [begin + np.timedelta64(1, "h")]),
            "contact_first": ("contact", [first]), "contact_second": ("contact", [second]),
            "contact_speed": ("contact", [0.3]),
        })).breakups  # fmt: skip
        assert (found.collision is not None) == counts
        if found.collision is not None:
            assert (found.collision.berg, found.collision.speed) == ("berg 7", 0.3)


def test_strengths_that_were_exceeded_are_told_where_it_was_not_tension_alone(run: xr.Dataset) -> None:
    reasons = explain(run)

    def words(**count: int) -> str:
        text, *_ = reason_lines(replace(reasons, breakups=[replace(reasons.breakups[0], by_strength=count)]))
        return text

    assert words() == words(normal=7)
    assert "exceeded" not in words()
    assert "7 bonds exceeded their normal strength and 2 their flexural one: the sea floor lifted" in words(
        normal=7, flexural=2
    )
    assert "1 bond exceeded its shear strength." in words(shear=1)


@pytest.mark.compiled
def test_the_line_of_a_crack_is_told_by_length_and_direction() -> None:
    """A berg pulled apart along its length cracks across: 9 km wide, from north to south."""
    berg = Iceberg.rectangle("30 km", "9 km", thickness="200 m", placement=(-38.0, -56.0))
    p = Parameters(fracture={"normal_strength": 1e3}, stepping={"only_interactions": True})
    model, force = Model(berg, Forcing.uniform(), p, start="2020-12-09"), np.sign(berg.elements.lon + 38.0)

    def pull(model: Model) -> None:
        model.elements.load_x[:] = 4e9 * force / np.abs(force).sum()

    model.after_step.append(pull)
    run = model.run(days=2 / 24, every_hours=0.5)
    (breakup, *_) = explain(run).breakups
    assert breakup.crack_km == pytest.approx(9.0, rel=0.01)
    assert breakup.crack_towards is not None
    assert min(breakup.crack_towards, 180.0 - breakup.crack_towards) < 10.0
    assert "The crack runs" in reason_lines(explain(run))[0]
