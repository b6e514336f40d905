"""Calibration: observations as numbers, margins of bergs that broke, a synthetic truth of real runs, bad input, the command."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import riftberg
from riftberg import Errors, Fix, Forcing, Iceberg, Model, Observations, Outline, Parameters, sweep
from riftberg.cli.main import app
from riftberg.ensembles.sweep import run_sweep
from riftberg.errors import InputError
from riftberg.parameters import PUBLISHED_DRAG
from riftberg.verification import calibrate as module
from riftberg.verification.calibrate import (
    collect_observations,
    compute_results,
    is_known,
    make_targets,
)

START = datetime(2020, 12, 9)
KM = 1.0 / 111.195  # degrees of latitude


def members(margin: Any, broke: Any, north: Any = (0.0, 0.0)) -> xr.Dataset:
    """Return members with margins at three daily records, and the day on which each broke up (NaN: never)."""
    times = np.datetime64(START, "ns") + np.arange(3) * np.timedelta64(1, "D")
    count = len(margin)
    lat = -56.0 + KM * np.repeat(np.asarray(north, float)[:, None, None], 3, axis=2)
    days = np.asarray(broke, float)
    date = np.where(
        np.isnan(days), np.datetime64("NaT", "ns"), times[0] + (np.nan_to_num(days) * 864e11).astype("m8[ns]")
    )
    dims = ("member", "fragment", "time")
    return xr.Dataset(
        {"lon": (dims, np.full_like(lat, -37.0)), "lat": (dims, lat), "azimuth": (dims, np.full_like(lat, 10.0)),
         "status": ("member", np.zeros(count, int)), "first_breakup": ("member", date),
         "stress_ratio_so_far": (("member", "time"), np.asarray(margin, float))},
        coords={"time": times},
    )  # fmt: skip


def test_members_beside_what_was_seen() -> None:
    day = START + timedelta(days=1)
    seen = collect_observations(
        Observations("s", fixes=[Fix("a", day, False, -37.0, -56.0 + 3 * KM, 170.0)]), START, 2.0, broken=day
    )
    found = compute_results(members([[0, 0.5, 0.9], [0, 1, 1]], [np.nan, 0.5], (0.0, 5.0)), seen)
    # East, north (km from the place that was seen), azimuth (10 is 20 degrees clockwise from 170), logarithm of the margin.
    assert found[:, 0] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert found[:, 1] == pytest.approx([-3.0, 2.0], abs=1e-3)
    assert found[:, 2] == pytest.approx([20.0, 20.0])
    assert np.exp(found[:, 3]) == pytest.approx([0.5, 1.0])
    names = make_targets(seen, Errors()).names
    assert names == ["2020-12-10 00:00 east, km", "2020-12-10 00:00 north, km", "2020-12-10 00:00 azimuth, degree",
                     "broken by 2020-12-10 00:00, log margin"]  # fmt: skip


def test_the_margin_to_the_second_break_up_goes_on_beyond_it_by_the_days_since() -> None:
    """Whole; broken once, with half of the strength reached since; broken twice, a day and an hour before."""
    ds = members([[0, 0.4, 0.5], [1, 1, 1], [1, 1, 1], [1, 1, 1]], [np.nan, 0.1, 0.1, 0.1], np.zeros(4))
    ds["stress_ratio_again"] = ("member", "time"), np.array([[0.0] * 3, [0.3, 0.4, 0.5], [0.9, 1, 1], [0.9, 1, 1]])
    twice = np.array(["NaT", "NaT", "2020-12-10T00:00", "2020-12-10T23:00"], "datetime64[ns]")
    ds["second_breakup"] = "member", twice
    day = START + timedelta(days=2)
    seen = collect_observations(None, START, 2.0, second_break=day, broken=START + timedelta(days=1))
    assert [name[:20] for name in make_targets(seen, Errors()).names] == [
        "broken by 2020-12-10",
        "second break by 2020",
    ]
    found = compute_results(ds, seen)
    assert np.exp(found[:, 1]) == pytest.approx([0.05 * 0.5, 0.5, 2.0, 1.0 + 1 / 24])
    assert make_targets(seen, Errors()).misfit(found)[:, 1].tolist()[2:] == [0.0, 0.0]
    once = collect_observations(None, START, 2.0, one_break_until=day)
    assert make_targets(once, Errors()).misfit(compute_results(ds, once))[:, 0].argmax() == 2


def test_break_ups_out_of_order_are_refused() -> None:
    day = START + timedelta(days=1)
    with pytest.raises(InputError, match="broken by 2020-12-10 12:00, but second break by 2020-12-10 00:00"):
        collect_observations(None, START, 2.0, broken=day + timedelta(hours=12), second_break=day)
    with pytest.raises(InputError, match="one break until 2020-12-10 00:00, but second break by 2020-12-10 00:00"):
        collect_observations(None, START, 2.0, one_break_until=day, second_break=day)
    with pytest.raises(InputError, match=r"--second-break: 2020-12-19 00:00 is not within the runs"):
        collect_observations(None, START, 2.0, second_break=START + timedelta(days=10))


def test_errors_of_the_model_last_and_those_of_observations_do_not() -> None:
    days = [START + timedelta(days=k) for k in (1, 6)]
    seen = collect_observations(
        Observations("s", fixes=[Fix("a", day, False, -37.0, -56.0) for day in days]), START, 9.0
    )
    found = make_targets(seen, Errors(position=4.0, model=3.0)).covariance
    assert found.shape == (4, 4)
    assert found[0, 0] == pytest.approx(25.0)
    assert found[0, 1] == pytest.approx(9.0 / np.e)  # five days apart
    assert found[0, 2] == 0.0  # east and north


def test_the_margin_of_a_berg_that_broke_is_that_of_ice_that_holds() -> None:
    ds = members([[0, 0.4, 0.7], [0, 0.9, 1.0], [0, 1.0, 1.0]], [np.nan, 1.5, 0.5], np.zeros(3))
    firm = members([[0, 9, 9], [0, 0.05, 0.08], [0, 0.1, 0.1]], [np.nan] * 3, np.zeros(3))  # 20 times as strong
    factor = np.array([1.0, 20.0, 20.0])
    day = START + timedelta(days=1)

    def margins(when: datetime, *ice: Any) -> Any:
        return np.exp(compute_results(ds, collect_observations(None, START, 2.0, broken=when), *ice)[:, 0])

    assert margins(day, firm, factor) == pytest.approx([0.4, 0.9, 2.0])
    assert margins(day + timedelta(days=1), firm, factor) == pytest.approx([0.7, 1.6, 2.0])
    assert margins(day) == pytest.approx([0.4, 0.9, 1.0])


def test_few_members_make_nothing_known_by_chance() -> None:
    """Found with A68a in an ocean with errors: eight members that count narrowed all inputs, more than 31 did without errors."""
    assert is_known(np.array([0.4, 0.6, 0.75]), 8.0).tolist() == [True, False, False]
    assert is_known(np.array([0.4, 0.6, 0.76, 0.78]), 1000.0).tolist() == [True, True, True, False]


def test_many_dates_become_twelve_and_the_outline_gives_the_axis() -> None:
    hours = [START + timedelta(hours=k) for k in range(1, 49)]
    seen = collect_observations(
        Observations("s", fixes=[Fix("a", when, False, -37.0, -56.0) for when in hours]), START, 2.0
    )
    assert len(seen.positions) == 12
    assert hours[-1] in seen.positions
    ring = np.array([[-37.0, -56.0], [-36.0, -56.0], [-36.0, -55.9], [-37.0, -55.9]])  # along a parallel
    drawn = collect_observations(
        Observations("s", outlines=[Outline("a", datetime(2020, 12, 10), True, ring)]), START, 2.0
    )
    assert list(drawn.azimuths.values()) == [pytest.approx(90.0, abs=1.0)]


def test_a_member_that_broke_up_had_reached_its_strength() -> None:
    """Largest stress over strength was that of the step before: 0.07 in A68a, whose tip breaks within the step of its landing."""
    ds = sweep(eddied, {"start.strength": [0.02, 20.0]}, days="3 h", every_hours=3, workers=0)
    assert ds["breakups"].values[0] > 0
    assert ds["stress_ratio"].values[0] >= 1.0
    assert 0.0 < ds["stress_ratio"].values[1] < 0.1
    assert ds["stress_ratio_so_far"].values[:, -1] == pytest.approx(ds["stress_ratio"].values)
    # What is left goes on towards the next break-up; a berg that holds has none to go on from.
    assert ds["stress_ratio_again"].values[0, -1] > 0.0
    assert (ds["stress_ratio_again"].values[1] == 0.0).all()
    assert ds["stress_ratio_again"].values[0, -1] == 1.0 or ds["breakups"].values[0] == 1
    assert ds["azimuth"].values[1, 0, 0] == pytest.approx(90.0, abs=0.1)
    assert ds["elongation"].values[1, 0, 0] == pytest.approx(10.0 / 3.0, rel=1e-3)  # ten by three elements


def eddied(speed: float = 0.6, east: float = 0.2, nothing: float = 1.0) -> Model:
    """Return a berg of thirty elements in an eddy; one argument does nothing."""
    berg = Iceberg.rectangle("30 km", "9 km", thickness=200.0, placement=(-37.0, -56.0))
    sea = Forcing.uniform(current=(east, 0.05)) + Forcing.eddy((-37.1, -56.1), radius=15e3, speed=speed)
    return Model(berg, sea, Parameters(drag=dict(PUBLISHED_DRAG)), start=START.isoformat())


PRIOR = {"speed": "~uniform(0.3, 1.0)", "east": "~uniform(0.05, 0.35)", "nothing": "~normal(1, 0.2)",
         "start.strength": "~lognormal(0.04, 0.8)"}  # fmt: skip


def truth(speed: float, east: float, strength: float, error: float) -> Observations:
    """Return what is seen every three hours of a berg that holds, with an error (km)."""
    ds = sweep(
        eddied, {"speed": [speed], "east": [east], "start.strength": [strength]}, days="12 h", every_hours=3, workers=0
    )
    assert np.isnat(ds["first_breakup"].values[0])
    random = np.random.default_rng(5)
    dates = ds["time"].values[1:].astype("datetime64[us]").tolist()
    east_of, north_of = error * KM * random.standard_normal((2, 4))
    lon, lat = ds["lon"].values[0, 0, 1:] + east_of / np.cos(np.radians(56.0)), ds["lat"].values[0, 0, 1:] + north_of
    fixes = [Fix("a", when, False, x, y) for when, x, y in zip(dates, lon.tolist(), lat.tolist(), strict=True)]
    return Observations("truth", fixes=fixes)


@pytest.mark.slow
def test_a_synthetic_truth_of_real_runs_is_found_again() -> None:
    observed = truth(0.7, 0.15, 0.08, 0.3)
    found = riftberg.calibrate(
        eddied, observed, PRIOR, days="12 h", errors=Errors(position=0.3, model=0.2), waves=2, members=20, workers=0,
        whole_until=observed.fixes[-1].when,
    )  # fmt: skip
    row = {name: found.sel(parameter=name) for name in PRIOR}
    for name, value in (("speed", 0.7), ("east", 0.15), ("start.strength", 0.08)):
        assert float(row[name]["posterior_low"]) < value < float(row[name]["posterior_high"]), name
    assert bool(row["east"]["known"])
    assert float(row["east"]["narrowed"]) < 0.5
    assert float(row["speed"]["likeliest"]) == pytest.approx(0.7, abs=0.15)
    assert not bool(row["nothing"]["known"])  # what the data cannot tell is no number
    # That it held excludes weak ice, by margins beyond 1 of members that broke and below 1 of those that held.
    assert float(row["start.strength"]["posterior_low"]) > 1.5 * float(row["start.strength"]["prior_low"])
    margins = found["member_result"].values[:, -1]
    assert (margins > 0.1).any()
    assert (margins < -0.1).any()
    broke = ~np.isnat(found["member_first_breakup"].values)
    assert (broke == (margins >= 0.0)).mean() > 0.95


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"vary": {"speed": [0.3, 0.5]}}, "2 values"),
        ({"vary": {"speed": "~choice(0.3, 0.5)"}}, "a choice cannot be calibrated"),
        ({"vary": {"speed": [0.3]}}, "nothing to calibrate"),
        ({"members": 6}, "6 members for 4 inputs"),
        ({"broken": datetime(2021, 1, 1)}, "is not within the runs"),
        ({"broken": datetime(2020, 12, 9, 3), "whole_until": datetime(2020, 12, 9, 6)}, "whole until after it broke"),
        ({"observed": None}, "nothing to compare with"),
        (
            {"observed": Observations("late", fixes=[Fix("a", datetime(2021, 1, 1), False, 0.0, 0.0)])},
            "nothing was observed",
        ),
        ({"berg": "b"}, "no positions of b"),
        ({"waves": 0}, "0 waves"),
    ],
)
def test_bad_input_is_refused_before_the_first_member(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    seen = Observations("s", fixes=[Fix("a", datetime(2020, 12, 9, 6), False, -37.0, -56.0)])
    given: dict[str, Any] = {"observed": seen, "vary": PRIOR, "days": "12 h", "workers": 0, **change}
    with pytest.raises(InputError, match=said):
        riftberg.calibrate(eddied, given.pop("observed"), given.pop("vary"), output=tmp_path / "c", **given)
    assert not (tmp_path / "c").exists()


@pytest.mark.slow
@pytest.mark.compiled
def test_the_command_writes_table_and_pictures_and_goes_on(tmp_path: Path) -> None:
    seen = tmp_path / "seen.csv"
    seen.write_text("date,lon,lat\n2020-12-10T13:00,-38.92,-55.01\n")
    out = tmp_path / "c"
    words = ["calibrate", "a68a", str(seen), "--vary", "current_error.scale~normal(1, 0.2)", "--days", "1", "--waves", "1",
             "--members", "6", "--error", "2", "-o", str(out), "--workers", "0"]  # fmt: skip
    refused = CliRunner().invoke(app, [*words, "--vary", "fracture.normal_strength~uniform(40 kPa, 50 kPa)"])
    assert refused.exit_code == 2
    assert "excludes the" in refused.output
    assert not out.exists()
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 0, said.output
    assert "wave 1, 6 members" in said.output
    assert "current_error.scale" in said.output
    assert {p.name for p in out.iterdir()} == {"wave-1", "calibration.nc", "calibration.csv", "calibration.json",
                                               "posterior.png", "predictive.png"}  # fmt: skip
    table = (out / "calibration.csv").read_text("utf-8").splitlines()
    assert table[0].startswith("parameter,unit,prior_low")
    assert json.loads((out / "calibration.json").read_text("utf-8"))["waves"] == 1
    again = CliRunner().invoke(app, words)
    assert again.exit_code == 2
    assert "holds a calibration already" in again.output
    before = sorted(p.stat().st_mtime_ns for p in (out / "wave-1" / "members").glob("*.json"))
    more = CliRunner().invoke(app, ["calibrate", "--resume", str(out), "--no-figure"])
    assert more.exit_code == 0, more.output
    assert (
        sorted(p.stat().st_mtime_ns for p in (out / "wave-1" / "members").glob("*.json")) == before
    )  # nothing was run again


@pytest.mark.slow
@pytest.mark.compiled
def test_one_that_was_stopped_goes_on_to_the_same_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = tmp_path / "seen.csv"
    seen.write_text("date,lon,lat\n2020-12-09T19:00,-38.97,-55.49\n")
    berg = tmp_path / "berg.yaml"
    berg.write_text(
        "start: 2020-12-09 13:00\ndays: 1\nberg: {rectangle: {length: 12 km, width: 6 km}, placement: [-39.0, -55.5]}\n"
        "forcing: {uniform: {current: [0.1, 0.05], slope: [0, 0]}}\n"
    )
    words = ["calibrate", str(berg), str(seen), "--vary", "current_error.scale~normal(1, 0.2)",
             "--vary", "current_error.speed=0.02 m/s", "--days", "0.25", "--waves", "2", "--members", "6", "--error", "2",
             "--no-figure", "--workers", "0"]  # fmt: skip
    whole, parted = tmp_path / "whole", tmp_path / "parted"
    assert CliRunner().invoke(app, [*words, "-o", str(whole)]).exit_code == 0

    def stopped(store: Any, **where: Any) -> Any:
        if store.folder.name == "wave-2":
            raise KeyboardInterrupt
        return run_sweep(store, **where)

    monkeypatch.setattr(module, "run_sweep", stopped)
    said = CliRunner().invoke(app, [*words, "-o", str(parted)])
    assert said.exit_code != 0
    assert f"riftberg calibrate --resume {parted}" in said.output
    monkeypatch.undo()
    more = CliRunner().invoke(app, ["calibrate", "--resume", str(parted), "--no-figure", "--workers", "0"])
    assert more.exit_code == 0, more.output
    with xr.open_dataset(whole / "calibration.nc") as one, xr.open_dataset(parted / "calibration.nc") as other:
        xr.testing.assert_identical(one.load(), other.load())
    seeds = []
    for wave in ("wave-1", "wave-2"):
        with xr.open_dataset(whole / wave / "sweep.nc") as ds:
            seeds += ds["errors_seed"].values.tolist()
    assert len(set(seeds)) == 12  # each member of each wave has random fields of its own


def test_a_wave_in_numbers(tmp_path: Path) -> None:
    """Errors as given, the side of what was seen, firm ice in place of what broke, correlations of normal scores."""
    day = START + timedelta(hours=3)
    seen = Observations("s", fixes=[Fix("a", day, False, -36.98, -56.0)])
    found = riftberg.calibrate(
        eddied, seen, {"east": "~uniform(0.05, 0.35)", "start.strength": "~lognormal(0.04, 2)"}, days="3 h", members=8,
        waves=1, workers=0, broken=day, errors=Errors(position=3.0, model=4.0), output=tmp_path / "c", seed=4,
    )  # fmt: skip
    assert found["error"].values[:2].tolist() == [5.0, 5.0]
    assert found["side"].values.tolist() == [0.0, 0.0, 1.0]
    broke = ~np.isnat(found["member_first_breakup"].values)
    assert 0 < broke.sum() < 8
    assert riftberg.open_sweep(tmp_path / "c" / "wave-1-firm").sizes["member"] == broke.sum()
    margin = found["member_result"].values[:, -1]
    assert (margin[broke] >= 0.0).all()
    assert (margin[~broke] < 0.0).all()
    from scipy.stats import norm

    score, weight = norm.ppf(np.clip(found["sample_share"].values, 1e-6, 1.0 - 1e-6)), found["sample_weight"].values
    both = np.cov(score.T, aweights=weight, ddof=0)
    between = both[0, 1] / np.sqrt(both[0, 0] * both[1, 1])
    assert found["correlation"].values[0, 1] == pytest.approx(between, abs=1e-6)
    assert np.abs(weight @ score).max() > 0.1  # far from the middle of the prior, where a wrong mean would not tell
