"""Distributions as text, plans that draw from them, and members that stay what they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from riftberg import Forcing, Iceberg, Model, Parameters, open_sweep, sweep
from riftberg.cli.main import app
from riftberg.ensembles.sweep import write_record
from riftberg.ensembles.uncertain import with_errors
from riftberg.ensembles.vary import Draws, list_members, plan_from_design, read_varied
from riftberg.errors import InputError

from .made import small_berg

STRENGTH = "fracture.normal_strength"


def drifting(speed: float = 0.2) -> Model:
    """Return a model of two elements in a current."""
    berg = Iceberg.rectangle("6 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(berg, Forcing.uniform(current=(speed, 0.0), slope=(0.0, 0.0)), Parameters(), start="2020-12-09")


@pytest.mark.parametrize(
    ("text", "quantiles"),  # at 10, 50 and 90 %, from the tables of the normal distribution (z = 1.28155)
    [
        ("lognormal(18 kPa, 20 %)", (18e3 * np.exp(-0.256310), 18e3, 18e3 * np.exp(0.256310))),
        ("normal(18 kPa, 2 kPa)", (15436.9, 18e3, 20563.1)),
        ("normal(18, 2 kPa)", (15436.9, 18e3, 20563.1)),  # the unit of the last number is that of all
        ("normal(18 kPa, 10 %)", (15693.2, 18e3, 20306.8)),
        ("uniform(10, 20 kPa)", (11e3, 15e3, 19e3)),
        ("triangular(10, 15, 20 kPa)", (10e3 + 5e3 * np.sqrt(0.2), 15e3, 20e3 - 5e3 * np.sqrt(0.2))),
    ],
)
def test_the_numbers_of_a_distribution_are_what_they_are_called(text: str, quantiles: tuple[float, ...]) -> None:
    (varied,) = read_varied([f"{STRENGTH}~{text}"])
    assert varied.distribution is not None
    assert varied.distribution.quantiles(np.array([0.1, 0.5, 0.9])) == pytest.approx(quantiles, rel=1e-5)


@pytest.mark.parametrize("plan", ["sobol", "random", "latin-hypercube"])
def test_members_are_drawn_from_the_distribution(plan: str) -> None:
    varied = read_varied({STRENGTH: "~lognormal(18 kPa, 20 %)", "berg.packing": "~choice(square, hexagonal)"})
    members = list_members(varied, Draws(512, plan, 3))
    logs = np.log([m[STRENGTH] for m in members])
    assert logs.mean() == pytest.approx(np.log(18e3), abs=0.03)
    assert logs.std() == pytest.approx(0.2, rel=0.1)
    assert 180 < sum(m["berg.packing"] == "square" for m in members) < 332


@pytest.mark.parametrize("plan", ["sobol", "random"])
def test_further_members_leave_the_first_as_they_are(plan: str) -> None:
    varied = read_varied(
        {STRENGTH: "~normal(18 kPa, 1 kPa)", "damage.threshold": [0.1, 0.2], "current_error.speed": [0.1]}
    )
    few, many = list_members(varied, Draws(5, plan, 7)), list_members(varied, Draws(40, plan, 7))
    assert many[:10] == few
    assert len(many) == 80
    assert len({m["errors.seed"] for m in many}) == 40  # one for each draw, the same for both thresholds
    assert list_members(varied, Draws(5, plan, 8)) != few


def test_a_pair_of_numbers_has_both_drawn() -> None:
    members = list_members(read_varied(["berg.offset~uniform(0, 1)"]), Draws(64))
    pairs = np.array([m["berg.offset"] for m in members])
    assert pairs.shape == (64, 2)
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.2
    assert pairs.mean() == pytest.approx(0.5, abs=0.02)


def test_the_values_of_a_choice_take_the_unit_of_the_last_one() -> None:
    """As those of a list: choice(10, 20 kPa) had been 10 Pa or 20 kPa."""
    (varied,) = read_varied(["fracture.normal_strength~choice(10, 20 kPa)"])
    assert {m["fracture.normal_strength"] for m in list_members([varied], Draws(8))} == {10e3, 20e3}


def test_what_is_impossible_is_cut_off_and_told() -> None:
    (varied,) = read_varied(["start.thickness~normal(1, 0.5)"])
    assert varied.distribution is not None
    assert min(varied.distribution.quantiles(np.linspace(0.0001, 0.9999, 99))) > 0.0
    assert varied.told().endswith(
        "(normal, mean 1, standard deviation 0.5; limited to > 0 and < 10, which cuts off 2.3 %)"
    )
    assert "cuts off" not in read_varied(["start.thickness~lognormal(1, 15 %)"])[0].told()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fracture.normal_strength~lognormal(-18 kPa, 20 %)", "a median of -18000, but a lognormal number is above 0"),
        ("fracture.normal_strength~normal(-18 kPa, 2 kPa)", "100 % of the probability lies at impossible values"),
        ("fracture.normal_strength~normal(18 kPa, 0)", "a standard deviation of 0"),
        ("fracture.normal_strength~lognormal(18 kPa, 2 kPa)", "no standard deviation of a logarithm"),
        ("fracture.normal_strength~uniform(20, 10 kPa)", "is not below"),
        ("fracture.normal_strength~triangular(10, 30, 20 kPa)", "are not in order"),
        ("fracture.normal_strength~lognormal(18 kPa)", "has 1 number\\. Give"),
        ("wind_error.time=2 day", "the scale of an error that has no size"),
        ("fracture.normal_strength~gauss(18 kPa, 2 kPa)", "is no distribution"),
        ("fracture.normal_strength~normal(18 m, 2 m)", "is in m, but this is measured in Pa"),
        ("fracture.normal_strength~normal(18 kPa, 2)", "2 has no unit, but 18 kPa has"),
        ("fracture.normal_strength~triangular(14 kPa, 18 kPa, 24e3)", "24e3 has no unit, but 14 kPa has"),
        ("start.east~uniform(-5 km, 5)", "5 has no unit, but -5 km has"),
        ("fracture.normal_strength~lognormal(18 kPa, 20)", "a standard deviation of the logarithm of 20"),
        ("fracture.enabled~uniform(0, 1)", "no number with decimals"),
        ("start.south~normal(0, 3 km)", "no parameter 'south'"),
        ("fracture.normal_strength~choice(10 kPa, 20)", "20 has no unit, but 10 kPa has"),
        ("fracture.normal_strength~choice()", "has an empty place"),
        ("berg.placement~normal(-38, 1)", "one distribution for longitude and latitude"),
        ("current_error.length=0", "0.0 is not possible"),
    ],
)
def test_impossible_distributions_are_refused_before_the_first_member(text: str, message: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match=message):
        sweep("a68a", [text], members=4, output=out, workers=0)
    assert not out.exists()


def test_a_distribution_needs_members_and_members_a_distribution() -> None:
    with pytest.raises(InputError, match="is drawn, but not how often"):
        list_members(read_varied([f"{STRENGTH}~normal(18 kPa, 2 kPa)"]))
    with pytest.raises(InputError, match="is drawn, but not how often"):
        list_members(read_varied(["current_error.speed=0.1"]))
    with pytest.raises(InputError, match="nothing is drawn"):
        list_members(read_varied([f"{STRENGTH}=14,18kPa"]), Draws(4))
    for draws in (Draws(seed=2), Draws(plan="random")):
        with pytest.raises(InputError, match="plan, seed: nothing is drawn"):
            list_members(read_varied([f"{STRENGTH}=14,18kPa"]), draws)


def test_a_berg_starts_where_how_and_as_strong_as_its_member_says() -> None:
    before = drifting()
    values = {"start.east": 3e3, "start.north": -4e3, "start.turn": 90.0, "start.thickness": 1.5, "start.strength": 0.5}
    after = with_errors(drifting(), values)
    a, b = before.elements, after.elements
    degree = np.pi / 180.0 * before.parameters.earth.radius
    assert (b.lon.mean() - a.lon.mean()) * degree * np.cos(np.deg2rad(56.0)) == pytest.approx(3e3, rel=2e-3)
    assert (b.lat.mean() - a.lat.mean()) * degree == pytest.approx(-4e3, rel=1e-3)
    assert np.ptp(b.lat) * degree == pytest.approx(3e3, rel=1e-3)  # it lies north and south now
    assert np.ptp(b.lon) * degree == pytest.approx(0.0, abs=5.0)
    assert b.thickness == pytest.approx(1.5 * a.thickness)
    assert b.mass == pytest.approx(1.5 * a.mass)
    assert after.bonds.strength == pytest.approx(0.5 * before.bonds.strength)
    assert after.bonds.bond_length == pytest.approx(before.bonds.bond_length, rel=1e-4)


def test_a_berg_of_another_size_has_no_strain() -> None:
    before, after = drifting(), with_errors(drifting(), {"start.size": 1.1})
    assert after.elements.mass == pytest.approx(1.21 * before.elements.mass)
    assert after.bonds.bond_length == pytest.approx(1.1 * before.bonds.bond_length, rel=1e-6)


def test_nothing_uncertain_is_the_model_itself() -> None:
    model = drifting()
    assert with_errors(model, {"speed": 1.0, STRENGTH: 5.0}) is model


@pytest.mark.slow
def test_a_member_is_the_same_alone_and_among_others(tmp_path: Path) -> None:
    vary = {"speed": "~normal(0.2, 0.05)", "current_error.speed": ["0.1 m/s"], "start.north": "~normal(0 km, 3 km)"}
    options: dict[str, Any] = {"days": "6 h", "every_hours": 2, "workers": 0, "seed": 5}
    many = sweep(drifting, vary, members=4, **options)
    few = sweep(drifting, vary, members=2, output=tmp_path / "s", **options)
    assert many["lon"].values[:2].tolist() == few["lon"].values.tolist()
    assert len(set(many["errors_seed"].values.tolist())) == 4
    assert many["speed"].attrs["distribution"] == "normal(0.2, 0.05)"
    done = (tmp_path / "s" / "members" / "00000.json").stat().st_mtime_ns
    more = sweep(drifting, vary, members=4, output=tmp_path / "s", resume=True, **options)
    assert more["lon"].values.tolist() == many["lon"].values.tolist()
    assert (tmp_path / "s" / "members" / "00000.json").stat().st_mtime_ns == done


def test_a_latin_hypercube_takes_no_further_members(tmp_path: Path) -> None:
    vary = {"speed": "~normal(0.2, 0.05)"}
    options: dict[str, Any] = {"days": "1 h", "workers": 0, "plan": "latin-hypercube", "output": tmp_path / "s"}
    sweep(drifting, vary, members=2, **options)
    with pytest.raises(InputError, match="members cannot be added to a Latin hypercube"):
        sweep(drifting, vary, members=4, resume=True, **options)


def test_a_design_of_another_tool_has_one_row_for_each_member(tmp_path: Path) -> None:
    file = tmp_path / "plan.csv"
    text = "fracture.normal_strength,start.east\n18 kPa,1 km\n12000 Pa,1 km\n\n18 kPa,-2000 m\n"
    for name, written in (("comma", text), ("semicolon", text.replace(",", ";"))):
        file.write_text(written)
        words = ["sweep", str(small_berg(tmp_path)), "--design", str(file), "--days", "0.02", "--every", "0.48"]
        said = CliRunner().invoke(app, [*words, "-o", str(tmp_path / name), "--workers", "0", "--no-map"])
        assert said.exit_code == 0, said.output
        result = open_sweep(tmp_path / name)
        assert result["fracture_normal_strength"].values.tolist() == [18e3, 12e3, 18e3]
        assert result["start_east"].values.tolist() == [1e3, 1e3, -2e3]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fracture.normal_strength\n", "no rows below the line of names"),
        ("fracture.normal_strength,start.east\n1,2\n3\n", "line 3"),
        ("fracture.strength\n1\n", "has no parameter 'strength'"),
        ("start.thickness\n-1\n", "-1.0 is not possible"),
        ("strength\n1\n", "not of the form group.name"),
        ("start.east,start.north, start.east\n1,2,3\n", "two columns are called 'start.east'"),
        (",start.east\n0,1\n1,2\n", "column 1 has no name"),
        ("start.east;start.north\n1;2;3\n", "line 2: '3' has no name: 2 columns are named"),
    ],
)
def test_a_bad_design_is_refused(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "plan.csv"
    file.write_text(text)
    out = tmp_path / "out"
    said = CliRunner().invoke(app, ["sweep", "a68a", "--design", str(file), "-o", str(out), "--workers", "0"])
    assert said.exit_code != 0
    assert message in " ".join(said.output.split())
    assert not out.exists()


def test_a_design_names_keys_of_the_experiment_file_too() -> None:
    _, members = plan_from_design({"start": ["2020-12-09", "2020-12-10"], "forcing.uniform.current.0": ["0.1", "0.2"]})
    assert list(members) == [{"start": "2020-12-09", "forcing.uniform.current.0": 0.1},
                             {"start": "2020-12-10", "forcing.uniform.current.0": 0.2}]  # fmt: skip


def test_each_row_of_a_design_has_random_fields_of_its_own_unless_it_names_the_seed() -> None:
    _, members = plan_from_design({"current_error.speed": ["0.1", "0.1", "0.2"]})
    assert len({m["errors.seed"] for m in members}) == 3
    _, drawn = plan_from_design({"wind_error.speed": ["1", "2"], "start.east": ["0", "1 km"]})
    assert [m["errors.seed"] for m in drawn] == [m["errors.seed"] for m in members[:2]]  # they depend on the row alone
    _, given = plan_from_design({"current_error.speed": ["0.1", "0.2"], "errors.seed": ["7", "7"]})
    assert [m["errors.seed"] for m in given] == [7, 7]


@pytest.mark.parametrize("options", [["--days", "3"], ["--set", "drag.water=1"], ["--every", "2"], ["--seed", "4"]])
@pytest.mark.parametrize("command", ["sweep", "forecast"])
def test_what_a_sweep_that_goes_on_keeps_cannot_be_given_anew(command: str, options: list[str], tmp_path: Path) -> None:
    said = CliRunner().invoke(app, [command, "--resume", str(tmp_path), *options])
    assert said.exit_code == 2
    assert f"Leave out {options[0]}" in " ".join(said.output.split())


@pytest.mark.parametrize(("command", "holds"), [("sweep", "forecast"), ("forecast", "sweep")])
def test_a_forecast_goes_on_as_forecast_and_a_sweep_as_sweep(command: str, holds: str, tmp_path: Path) -> None:
    plan = {"experiment": "a68a", "vary": {}, "days": 1.0, "forecast": holds == "forecast"}
    write_record(tmp_path / "sweep.json", plan)
    said = CliRunner().invoke(app, [command, "--resume", str(tmp_path)])
    assert said.exit_code == 2
    assert f"holds a {holds}. Go on by 'riftberg {holds} --resume'" in " ".join(said.output.split())


def test_a_design_takes_no_more_members(tmp_path: Path) -> None:
    write_record(tmp_path / "sweep.json", {"experiment": "a68a", "vary": {}, "days": 1.0, "design": True})
    said = CliRunner().invoke(app, ["sweep", "--resume", str(tmp_path), "--members", "9"])
    assert said.exit_code == 2
    assert "its members are the rows of a table. Leave --members out" in " ".join(said.output.split())


@pytest.mark.parametrize("options", [["--days", "3"], ["--members", "4"], ["--vary", "start.east=1,2"]])
def test_parts_are_joined_as_they_are(options: list[str], tmp_path: Path) -> None:
    said = CliRunner().invoke(app, ["sweep", "--join", str(tmp_path), *options])
    assert said.exit_code == 2
    assert "Give --join FOLDER alone" in " ".join(said.output.split())


@pytest.mark.compiled
def test_the_command_line_draws_and_says_what(tmp_path: Path) -> None:
    out = tmp_path / "s"
    said = CliRunner().invoke(app, [
        "sweep", "a68a", "--vary", "fracture.normal_strength~lognormal(18 kPa, 20 %)", "--vary", "wind_error.speed=2 m/s",
        "--members", "2", "--days", "0.1", "--workers", "0", "-o", str(out), "--no-map",
    ])  # fmt: skip
    assert said.exit_code == 0, said.output
    assert "lognormal, median 18 kPa, standard deviation of the logarithm 0.2" in said.output
    more = CliRunner().invoke(app, ["sweep", "--resume", str(out), "--members", "3", "--workers", "0", "--no-map"])
    assert "3 members" in more.output
    assert "2 are done" in more.output


@pytest.mark.slow
@pytest.mark.compiled
def test_the_command_line_runs_a_design(tmp_path: Path) -> None:
    file, out = tmp_path / "plan.csv", tmp_path / "s"
    file.write_text("fracture.normal_strength,start.east\n18 kPa,0\n18 kPa,2 km\n")
    options = ["--design", str(file), "--days", "0.1", "--workers", "0", "-o", str(out), "--no-map"]
    said = CliRunner().invoke(app, ["sweep", "a68a", *options])
    assert said.exit_code == 0, said.output
    result = open_sweep(out)
    assert result["start_east"].values.tolist() == [0.0, 2000.0]
    assert result["lon"].values[1, 0, 0] > result["lon"].values[0, 0, 0]
    again = CliRunner().invoke(app, ["sweep", "--resume", str(out), "--workers", "0", "--no-map"])
    assert "2 are done" in again.output


@pytest.mark.slow
@pytest.mark.compiled
def test_parts_make_the_same_result_as_the_whole(tmp_path: Path) -> None:
    common = [
        "sweep",
        "a68a",
        "--vary",
        "start.east~normal(0 km, 3 km)",
        "--members",
        "4",
        "--days",
        "0.1",
        "--workers",
        "0",
        "--no-map",
    ]
    parts, whole = tmp_path / "parts", tmp_path / "whole"
    for part in ("1/2", "2/2"):
        said = CliRunner().invoke(app, [*common, "--part", part, "-o", str(parts)])
        assert said.exit_code == 0, said.output
        if part == "1/2":
            early = CliRunner().invoke(app, ["sweep", "--join", str(parts), "--no-map"])
            assert early.exit_code == 0, early.output
            assert open_sweep(parts)["status"].values.tolist() == [0, 2, 0, 2]  # the others wait
    assert CliRunner().invoke(app, ["sweep", "--join", str(parts), "--no-map"]).exit_code == 0
    assert CliRunner().invoke(app, [*common, "-o", str(whole)]).exit_code == 0
    assert open_sweep(parts)["lon"].values.tolist() == open_sweep(whole)["lon"].values.tolist()


@pytest.mark.parametrize("part", ["0/2", "3/2", "half", "1/0", "-1/2"])
def test_what_is_no_part_is_refused(part: str, tmp_path: Path) -> None:
    vary = ["--vary", "fracture.normal_strength=14,18kPa"]
    said = CliRunner().invoke(app, ["sweep", "a68a", *vary, f"--part={part}", "-o", str(tmp_path / "out")])
    assert "is no part" in said.output
    assert not (tmp_path / "out").exists()


def test_parts_of_different_sweeps_are_not_joined(tmp_path: Path) -> None:
    assert "holds no parts" in CliRunner().invoke(app, ["sweep", "--join", str(tmp_path)]).output
    for k, days in ((1, 1.0), (2, 2.0)):
        folder = tmp_path / f"part-{k}-of-2"
        folder.mkdir()
        write_record(folder / "sweep.json", {"vary": {}, "experiment": "a68a", "days": days})
    said = CliRunner().invoke(app, ["sweep", "--join", str(tmp_path)])
    assert "parts of different sweeps" in " ".join(said.output.split())
    assert not (tmp_path / "sweep.json").exists()


def test_shares_and_quantiles_are_inverse_also_of_what_is_cut_off() -> None:
    share = np.array([0.02, 0.3, 0.7, 0.98])
    for text in ("normal(5 kPa, 5 kPa)", "uniform(10, 20 kPa)"):
        (v,) = read_varied({STRENGTH: f"~{text}"})
        assert v.distribution is not None
        assert v.distribution.shares_below(np.array(v.distribution.quantiles(share))) == pytest.approx(share)


def notched() -> Model:
    """Return a berg in an eddy that breaks where it is weak: across, 8 km east of its middle."""
    berg = Iceberg.rectangle("30 km", "9 km", thickness=200.0, placement=(-37.0, -56.0))
    model = Model(berg, Forcing.eddy((-37.1, -56.1), radius=15e3, speed=0.6), Parameters(), start="2020-12-09")
    e, bonds = model.elements, model.bonds
    x = (e.lon - e.lon.mean()) * 111.2e3 * np.cos(np.radians(56.0))
    bonds.strength[(x[bonds.first] - 8e3) * (x[bonds.second] - 8e3) < 0.0] = 1e-4
    return model


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_cracks_are_told_where_they_lay_in_the_berg_before_it_was_turned(turn: float, tmp_path: Path) -> None:
    sweep(notched, {"start.turn": [turn]}, days=0.1, every_hours=1, workers=0, output=tmp_path)
    cracks = np.array(json.loads((tmp_path / "members" / "00000.json").read_text())["cracks"])
    assert len(cracks) > 0
    assert cracks[:, 1] == pytest.approx(np.full(len(cracks), 8e3), abs=2e3)
    assert np.abs(cracks[:, 2]).max() < 5e3
