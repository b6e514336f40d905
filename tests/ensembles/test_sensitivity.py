"""Indices of functions whose indices are known, against scipy too; the command and its figure."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.stats import qmc, sobol_indices
from typer.testing import CliRunner

import riftberg
from riftberg import Fix, Forcing, Iceberg, Model, Observations, Parameters
from riftberg.cli.inputs import summary_lines
from riftberg.cli.main import app
from riftberg.ensembles.sensitivity import Result, indices, select_results
from riftberg.ensembles.vary import Draws, list_members, read_varied
from riftberg.errors import InputError
from riftberg.verification.sightings import drift_error
from riftberg.viz.ensemble import draw_sensitivity

from .made import forecast_of, outcome

STEP = 0.4

ANGLE = f"~uniform({-np.pi}, {np.pi})"


def drawn(vary: dict[str, str], plan: str, draws: int) -> tuple[xr.Dataset, Any]:
    """Return a sweep without runs, and the inputs of its members."""
    members = list_members(read_varied(vary, free=True), Draws(draws, plan, 1))
    ds = xr.Dataset({"status": ("member", np.zeros(len(members)))}, attrs={"plan": plan})
    x = {name: np.array([values[name] for values in members]) for name in vary}
    for name, values in x.items():
        ds.coords[name] = ("member", values, {"distribution": "uniform", "parameter": name})
    return ds, x


def ishigami(a: Any, b: Any, c: Any) -> Any:
    return np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)


def test_sobol_indices_of_ishigami() -> None:
    ds, x = drawn(dict.fromkeys("abc", ANGLE), "saltelli", 1024)
    found = indices(ds, {"f": Result(ishigami(**x), "1")}).isel(result=0)
    # Ishigami and Homma (1990), from the integrals.
    assert found["first"].values == pytest.approx([0.3139, 0.4424, 0.0], abs=0.05)
    assert found["total"].values == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.05)
    assert (found["total_low"] < [0.5576, 0.4424, 0.2437]).all()
    assert (found["total_high"] > [0.5576, 0.4424, 0.2437]).all()
    assert (found["first_low"] < [0.3139, 0.4424, 0.0]).all()
    assert (found["first_high"] > [0.3139, 0.4424, 0.0]).all()


@pytest.mark.parametrize(("draws", "wide"), [(64, True), (1024, False)])
def test_wide_intervals_of_total_indices_are_reported(draws: int, wide: bool) -> None:
    """Bug once: a page of the documentation showed indices with intervals of up to 2.3, and read digits from them."""
    ds, x = drawn(dict.fromkeys("abc", ANGLE), "saltelli", draws)
    note = indices(ds, {"f": Result(ishigami(**x), "1")}).attrs["note"]
    assert note.startswith("90 % intervals of total indices are up to 0.") if wide else not note


def test_sobol_indices_are_those_of_scipy() -> None:
    ds, x = drawn(dict.fromkeys("abc", ANGLE), "saltelli", 256)
    f = ishigami(**x).reshape(256, 5)
    found = indices(ds, {"f": Result(f.ravel(), "1")}).isel(result=0)
    known = sobol_indices(func={"f_A": f[:, 0], "f_B": f[:, -1], "f_AB": f[:, 1:-1].T[:, None]}, n=256)
    assert found["first"].values == pytest.approx(np.ravel(known.first_order), abs=1e-12)
    assert found["total"].values == pytest.approx(np.ravel(known.total_order), abs=1e-12)


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """90 % intervals of the total index of ``3 a + b``, 0.9 and 0.1, over plans with other seeds."""
    inside = []
    for seed in range(60):
        share = qmc.Sobol(4, rng=np.random.default_rng(seed)).random(64)
        a, b = share[:, :2], share[:, 2:]
        f = [3.0 * p[:, 0] + p[:, 1] for p in (a, np.c_[b[:, 0], a[:, 1]], np.c_[a[:, 0], b[:, 1]], b)]
        ds = xr.Dataset({"status": ("member", np.zeros(256))}, attrs={"plan": "saltelli"})
        for name in "ab":
            ds.coords[name] = ("member", np.zeros(256), {"distribution": "uniform"})
        one = indices(ds, {"f": Result(np.stack(f, axis=1).ravel(), "1")}, seed=seed).isel(result=0)
        inside.append(float(one["total_low"][0]) < 0.9 < float(one["total_high"][0]))
    assert 0.8 <= np.mean(inside) <= 1.0


def test_morris_effects_of_a_linear_model_and_of_ishigami() -> None:
    ds, x = drawn({"a": "~uniform(0, 1)", "b": "~uniform(0, 2)", "c": "~uniform(5, 6)"}, "morris", 32)
    found = indices(ds, {"f": Result(3.0 * x["a"] - 2.0 * x["b"], "1")}).isel(result=0)
    assert found["effect"].values == pytest.approx([3.0 * STEP, 4.0 * STEP, 0.0])
    assert found["signed_effect"].values == pytest.approx([3.0 * STEP, -4.0 * STEP, 0.0])
    assert found["scatter"].values == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    ds, x = drawn(dict.fromkeys("abc", ANGLE), "morris", 1024)
    found = indices(ds, {"f": Result(ishigami(**x), "1")}).isel(result=0)
    # Mean of |7 (sin(b + h)^2 - sin(b)^2)| over a full turn, h = 0.4 x 2 pi: 7 x |sin(h)| x 2 / pi.
    assert float(found["effect"][1]) == pytest.approx(14.0 / np.pi * abs(np.sin(2.0 * np.pi * STEP)), rel=0.02)
    assert float(found["effect"][2]) > 1.0
    assert abs(float(found["signed_effect"][2])) < 0.1 * float(found["effect"][2])  # even in c
    assert float(found["scatter"][2]) > float(found["effect"][2])


def test_a_draw_with_a_failed_member_counts_in_nothing() -> None:
    ds, x = drawn(dict.fromkeys("abc", ANGLE), "saltelli", 64)
    f = ishigami(**x)
    whole = indices(ds, {"f": Result(f, "1")}).isel(result=0)
    worse = np.concatenate([f, [np.nan, 1e9, 1e9, 1e9, 1e9]])
    more = xr.concat([ds, ds.isel(member=slice(5))], "member")
    more.attrs = ds.attrs
    found = indices(more, {"f": Result(worse, "1")}).isel(result=0)
    assert int(found["number"]) == 64
    assert found["first"].values == pytest.approx(whole["first"].values)


def test_what_only_some_have_is_said_of_these() -> None:
    ds, x = drawn(dict.fromkeys("ab", "~uniform(0, 1)"), "morris", 64)
    found = indices(ds, {"date": Result(np.where(x["a"] > 0.5, x["a"] ** 3, np.nan), "day", partial=True),
                         "none": Result(np.full(len(x["a"]), np.nan), "day", partial=True),
                         "same": Result(np.ones(len(x["a"])), "1")})  # fmt: skip
    one = found.sel(result="date")
    assert float(one["share"]) == pytest.approx((x["a"] > 0.5).mean())
    assert one["correlation"].values[0] == pytest.approx(1.0)
    assert abs(one["correlation"].values[1]) < 0.2
    assert one["correlation_low"].values[1] < 0.0 < one["correlation_high"].values[1]
    lines = summary_lines(found)
    assert "% that have one): a 1 (1 to 1)" in lines[0]
    assert "too few members have it" in lines[1]
    assert "the same in all runs" in lines[2]


def test_results_of_members() -> None:
    places = [-37.0] * 5, [-56.0] * 5
    ds = forecast_of([outcome(0, *places, broken=1, aground=3.0), outcome(1, *places)], 4)
    found = select_results(ds, [2.0])
    assert found["broken by day 2"].values.tolist() == [1.0, 0.0]
    assert found["aground by day 2"].values.tolist() == [0.0, 0.0]
    assert found["largest area at the end"].values.tolist() == [100.0, 100.0]
    assert found["date of the first break-up"].values == pytest.approx([1.0, np.nan], nan_ok=True)
    assert np.isfinite(found["lon of the first break-up"].values).tolist() == [True, False]
    assert "broken by day 4" in select_results(ds)


def test_days_after_the_end_of_the_runs_are_refused() -> None:
    """Bug: by day 9 of runs of four days nothing had broken, in any of them."""
    ds = forecast_of([outcome(0, [-37.0] * 5, [-56.0] * 5)], 4)
    for day in (9.0, 0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match=r"at_days: day .* of runs of 4 days"):
            select_results(ds, [day])
    assert "broken by day 4" in select_results(ds, [4.0])


def test_examples_in_the_help_are_of_parameters_that_exist() -> None:
    """Bug: the help of ``riftberg sensitivity`` showed a parameter that there is not."""
    runner, seen = CliRunner(), 0
    for command in ("sensitivity", "forecast", "sweep", "run", "rerun"):
        text = " ".join(runner.invoke(app, [command, "--help"], terminal_width=400).output.split())
        for example in re.findall(r"'([a-z_]+\.[a-z_]+[~=][^']+)'", text):
            read_varied([example])
            seen += 1
        for example in re.findall(r"(?<!['\w])([a-z_]+\.[a-z_]+)='([^']+)'", text):
            read_varied(["=".join(example)])
            seen += 1
    assert seen >= 4


def test_the_error_of_the_drift_is_the_mean_distance() -> None:
    ds = forecast_of(
        [outcome(0, [-37.0] * 5, [-56.0] * 5), outcome(1, [-37.0] * 5, [-56.0, -55.0, -54.0, -53.0, -52.0])], 4
    )
    dates = ds["time"].values.astype("datetime64[us]").tolist()
    seen = Observations(Path("seen.csv"), fixes=tuple(Fix("a", day, False, -37.0, -56.0) for day in dates))
    # A degree of latitude is 111.2 km; after 1 to 4 days 2.5 degrees on average.
    assert drift_error(ds, seen) == pytest.approx([0.0, 2.5 * 111.195], abs=0.5)
    late = Observations(Path("seen.csv"), fixes=(Fix("a", dates[-1].replace(year=2022), False, -37.0, -56.0),))
    with pytest.raises(InputError, match="no position of a"):
        drift_error(ds, late)


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="not drawn for it"):
        indices(xr.Dataset({"status": ("member", [0])}), {})
    with pytest.raises(InputError, match="is no method"):
        riftberg.sensitivity("a68a", method="fast")  # type: ignore[arg-type]
    lists = read_varied(["start.turn~normal(0, 5)", "fracture.normal_strength=14,18kPa"])
    with pytest.raises(InputError, match="lists of values"):
        list_members(lists, Draws(4, "morris", 1))


def test_random_fields_and_pairs_of_numbers_are_inputs_of_their_own() -> None:
    varied = read_varied(["current_error.speed=0.1 m/s", "berg.offset~uniform(0, 1)", "start.turn~normal(0, 5)"])
    members = list_members(varied, Draws(3, "morris", 1))
    assert len(members) == 3 * 4
    changes = [
        [name for name in ("berg.offset", "start.turn", "errors.seed") if members[k][name] != members[0][name]]
        for k in range(4)
    ]
    assert changes == [[], ["berg.offset"], ["start.turn"], ["errors.seed"]]
    assert list_members(varied, Draws(5, "morris", 1))[:12] == members  # more draws leave the first as they are


def drifting(speed: float = 0.1, strength: float = 1.0) -> Model:
    """Return two elements in a current; the strength does nothing."""
    berg = Iceberg.rectangle("6 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    return Model(
        berg, Forcing.uniform(current=(speed, 0.0), depth=2000.0, slope=(0.0, 0.0)), Parameters(), start="2020-12-09"
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize("result", [3.0, [1.0, 2.0], ["a"] * 4])
def test_a_result_that_is_no_number_for_each_member_is_refused(result: Any) -> None:
    with pytest.raises(InputError, match=r"the function of 'own' returns .* one number for each of the 4 members"):
        riftberg.sensitivity(
            drifting, {"speed": "~uniform(0.1, 0.2)"}, members=2, days="1 h", every_hours=1, workers=0,
            default_errors=False, results={"own": lambda ds: result},
        )  # fmt: skip


@pytest.mark.quick(1)
@pytest.mark.parametrize(("row", "berg", "said"), [
    ("2021-12-09T01:00,-37.0,-56.0", [], "no position of A1 from"),
    ("2020-12-09T14:00,-37.0,-56.0", ["--berg", "B1"], "no positions of B1"),
])  # fmt: skip
def test_observations_that_do_not_fit_are_refused_before_the_runs(
    row: str, berg: list[str], said: str, tmp_path: Path
) -> None:
    seen, out = tmp_path / "seen.csv", tmp_path / "out"
    seen.write_text(f"name,date,lon,lat\nA1,{row}\n")
    words = ["sensitivity", "a68a", "--days", "0.25", "--draws", "2", "--observed", str(seen), "-o", str(out)]
    result = CliRunner().invoke(app, [*words, *berg])
    assert said in " ".join(result.output.split())
    assert not out.exists()


@pytest.mark.slow
def test_a_function_of_inputs(tmp_path: Path) -> None:
    vary = {"speed": "~uniform(0.1, 0.2)", "strength": "~uniform(0.5, 1)"}
    found = riftberg.sensitivity(
        drifting, vary, members=2, days="6 h", every_hours=3, workers=0, default_errors=False,
        results={"east": lambda ds: ds["lon"].values[:, 0, -1]},
    )  # fmt: skip
    effect = found["effect"].sel(result="east").values
    assert effect[0] > 1e-3
    assert effect[1] == 0.0
    assert found["input"].values.tolist() == ["speed", "strength"]
    assert draw_sensitivity(found, tmp_path / "s.png", title="two", dpi=50).stat().st_size > 5_000


@pytest.mark.compiled
def test_the_command_writes_table_and_figure(tmp_path: Path) -> None:
    out = tmp_path / "s"
    words = [
        "sensitivity",
        "a68a",
        "--no-default-errors",
        "--vary",
        "start.turn~normal(0, 5)",
        "--days",
        "0.25",
        "--workers",
        "0",
    ]
    said = CliRunner().invoke(app, [*words, "--method", "sobol", "--draws", "2", "-o", str(out)])
    assert said.exit_code == 0, said.output
    assert "6 runs of 0.25 days" in said.output
    assert (out / "sensitivity.png").exists()
    table = (out / "sensitivity.csv").read_text("utf-8").splitlines()
    assert table[0].startswith("result,input,unit,share")
    assert any(line.startswith("largest stress over strength,start.turn") for line in table)
    kept = CliRunner().invoke(app, ["sensitivity", "--resume", str(out), "--days", "1", "--set", "ice.density=900"])
    assert kept.exit_code == 2
    assert "Leave out --set, --days" in kept.stderr
    again = CliRunner().invoke(app, ["sensitivity", "--resume", str(out), "--at-day", "0.1", "--no-figure"])
    assert again.exit_code == 0, again.output
    assert "broken by day 0.1" in again.output


def test_days_count_from_the_own_start_of_each_member() -> None:
    """Bug: of two members that both break a day after their start, one four days later, one was whole on day 2."""
    days = np.datetime64("2020-12-01", "ns") + np.arange(5) * np.timedelta64(1, "D")
    broke = np.array([days[1], days[1] + np.timedelta64(4, "D")])
    born = np.stack([broke - np.timedelta64(1, "D"), broke], axis=1)
    one = ("member", np.zeros(2))
    ds = xr.Dataset(
        {"status": one, "stress_ratio": one, "largest_area": one, "first_breakup": ("member", broke),
         "first_aground": ("member", np.full(2, np.datetime64("NaT", "ns"))),
         **{f"fragment_{name}": (("member", "fragment"), np.tile([0.0, 1.0], (2, 1))) for name in ("parent", "lon", "lat")},
         "fragment_birth_time": (("member", "fragment"), born), "lat": (("member", "fragment", "time"), np.zeros((2, 2, 5)))},
        {"time": days, "start_after": ("member", [0.0, 4 * 86400.0])},
    )  # fmt: skip
    found = select_results(ds, [2.0])
    assert found["broken by day 2"].values.tolist() == [1.0, 1.0]
    assert found["date of the first break-up"].values.tolist() == [1.0, 1.0]
    assert found["lon of the first break-up"].values.tolist() == [1.0, 1.0]
