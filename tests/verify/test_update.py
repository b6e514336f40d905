"""New sightings: weights against Bayes' rule for normal errors, and members drawn anew that keep what is known."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from ensembles.made import small_berg
from riftberg import Fix, Observations, open_sweep
from riftberg.cli.main import app
from riftberg.ensembles.probability import effective
from riftberg.ensembles.vary import Draws, list_members, read_varied
from riftberg.errors import InputError
from riftberg.verification.sightings import log_likelihood, redraw_members, weighted

KM = 1.0 / 111.195  # degrees of latitude
DAYS = np.datetime64("2020-12-09", "ns") + np.arange(3) * np.timedelta64(1, "D")


def spread(north: Any, broken: Any = None) -> xr.Dataset:
    """Return members that stand kilometres north of 56 S; ``broken``: day on which each breaks up, NaN for never."""
    lat = -56.0 + KM * np.repeat(np.asarray(north, float)[:, None, None], 3, axis=2)
    days = np.full(len(north), np.nan) if broken is None else np.asarray(broken, float)
    date = np.where(
        np.isnan(days), np.datetime64("NaT", "ns"), DAYS[0] + (np.nan_to_num(days) * 864e11).astype("m8[ns]")
    )
    return xr.Dataset(
        {"lon": (("member", "fragment", "time"), np.full_like(lat, -37.0)), "lat": (("member", "fragment", "time"), lat),
         "status": ("member", np.zeros(len(north), int)), "first_breakup": ("member", date)},
        coords={"time": DAYS},
    )  # fmt: skip


def fix(north: float, day: int = 1) -> Observations:
    """Return a position."""
    when = DAYS[day].astype("datetime64[us]").item()
    return Observations("seen.csv", fixes=[Fix("a", when, False, -37.0, -56.0 + KM * north)])


def test_weights_are_those_of_bayes_for_normal_errors() -> None:
    """Members of a spread of 10 km, seen 12 km north with an error of 5 km: mean 12 x 100 / 125, variance 100 x 25 / 125."""
    north = 10.0 * np.random.default_rng(1).standard_normal(40_000)
    found = log_likelihood(spread(north), fix(12.0), error=5.0)
    weight = np.exp(found - found.max())
    weight /= weight.sum()
    mean = weight @ north
    assert mean == pytest.approx(9.6, abs=0.15)
    assert weight @ (north - mean) ** 2 == pytest.approx(20.0, rel=0.04)


def test_a_long_axis_weighs_by_its_error() -> None:
    """Axes of 170 and 5 degrees are 15 apart, three standard deviations."""
    ds = spread([0.0, 0.0])
    seen = fix(0.0)
    axis = Observations("seen.csv", fixes=[Fix("a", seen.fixes[0].when, False, -37.0, -56.0, 170.0)])
    turned = ds.assign(azimuth=(("member", "fragment", "time"), np.repeat([[[170.0]], [[5.0]]], 3, axis=2)))
    found = log_likelihood(turned, axis, error=5.0, azimuth_error=5.0)
    assert found[1] - found[0] == pytest.approx(-4.5)
    assert np.ptp(log_likelihood(turned, axis, error=5.0, azimuth_error=None)) == pytest.approx(0.0)


def test_a_sighting_of_a_break_up_weighs_by_its_doubt() -> None:
    ds = spread([0.0, 0.0, 0.0], [0.5, 1.5, np.nan])
    date = DAYS[1].astype("datetime64[us]").item()
    assert np.exp(log_likelihood(ds, None, error=5.0, broken=date, doubt=0.1)) == pytest.approx([0.9, 0.1, 0.1])
    assert np.exp(log_likelihood(ds, None, error=5.0, whole_until=date, doubt=0.1)) == pytest.approx([0.1, 0.9, 0.9])
    with pytest.raises(InputError, match="no sighting"):
        log_likelihood(ds, None, error=5.0)
    with pytest.raises(InputError, match="not within the forecast"):
        log_likelihood(ds, None, error=5.0, broken=date.replace(year=2022))


def test_positions_need_a_forecast_in_degrees() -> None:
    ds = spread([0.0, 0.0], [np.nan, 1.5]).rename(lon="x", lat="y")
    with pytest.raises(InputError, match="ensemble: positions in metres"):
        log_likelihood(ds, fix(0.0), error=5.0)


def test_a_break_up_that_no_member_had_is_said(caplog: pytest.LogCaptureFixture) -> None:
    ds = spread([0.0, 0.0], [np.nan, 1.5])
    log_likelihood(ds, None, error=5.0, broken=DAYS[1].astype("datetime64[us]").item())
    assert "no member had broken up by" in caplog.text
    caplog.clear()
    log_likelihood(ds, None, error=5.0, whole_until=DAYS[1].astype("datetime64[us]").item())
    assert not caplog.text


def test_sightings_that_no_member_explains_are_refused_and_not_weighed() -> None:
    """Bug: columns of longitude and latitude the wrong way round left one member, with an area of 0 by 0 km."""
    ds = spread([-20.0, 0.0, 30.0])
    swapped = Observations("seen.csv", fixes=[Fix("a", DAYS[1].astype("datetime64[us]").item(), False, -56.0, -37.0)])
    with pytest.raises(
        InputError, match=r"seen.csv: on 2020-12-10 00:00 the berg was seen 2,\d\d\d km from the nearest member"
    ):
        log_likelihood(ds, swapped, error=6.0)
    with pytest.raises(InputError, match=r"70 km from the nearest member, with an error of 6 km.*--error"):
        log_likelihood(ds, fix(100.0), error=6.0)
    assert np.isfinite(log_likelihood(ds, fix(100.0), error=20.0)).all()
    early, late = (DAYS[n].astype("datetime64[us]").item() for n in (0, 1))
    with pytest.raises(InputError, match="--whole-until: whole until after it broke"):
        log_likelihood(ds, None, error=6.0, broken=early, whole_until=late)
    failed = ds.assign(status=("member", np.array([1, 1, 1])))
    with pytest.raises(InputError, match="no member came to its end"):
        log_likelihood(failed, fix(0.0), error=6.0)


def test_a_sweep_is_called_no_forecast(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bug: the answer spoke of an option --resume that was not given."""
    monkeypatch.setattr("riftberg.ensembles.sweep.read_plan", lambda folder: {"members": 2})
    said = CliRunner().invoke(app, ["update", str(tmp_path), "--broken", "2020-12-10"])
    assert said.exit_code == 2
    assert "holds a sweep, no forecast. Name a folder of 'riftberg forecast'" in said.output


def test_members_drawn_anew_keep_mean_and_spread_and_respect_the_distribution() -> None:
    varied = read_varied(
        ["start.turn~normal(0, 5)", "start.strength~lognormal(1, 30 %)", "bonds.packing~choice(square, hexagonal)"]
    )
    members = list_members(varied, Draws(4096))
    plan: Any = SimpleNamespace(varied=varied, members=members)
    turn = np.array([m["start.turn"] for m in members])
    likelihood = -0.5 * ((turn - 6.0) / 2.0) ** 2
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    assert effective(weight) < 2000
    columns, base, parents = redraw_members(plan, weight, likelihood)
    assert 1000 < parents < 4096
    new = np.array(columns["start.turn"])
    mean = weight @ turn
    assert new.mean() == pytest.approx(mean, abs=0.1)
    assert new.std() == pytest.approx(np.sqrt(weight @ (turn - mean) ** 2), rel=0.06)
    assert min(columns["start.strength"]) > 0.0
    assert np.log(columns["start.strength"]).std() == pytest.approx(0.3, rel=0.1)  # nothing was seen of it
    assert set(columns["bonds.packing"]) == {"square", "hexagonal"}
    assert len(base) == 4096
    assert np.mean(base) > np.mean(likelihood)
    assert len(np.unique(new)) == 4096


def test_members_around_a_single_one_are_no_copies_of_it() -> None:
    """Bug: one member that counts has no spread, so all new ones were the same, and every one of them counted."""
    varied = read_varied(["start.turn~normal(0, 5)"])
    plan: Any = SimpleNamespace(varied=varied, members=list_members(varied, Draws(64)))
    weight = np.eye(64)[3]
    columns, _, parents = redraw_members(plan, weight, np.log(weight + 1e-300))
    assert parents == 1
    assert np.std(columns["start.turn"]) == pytest.approx(0.3 * 5.0, rel=0.25)  # the kernel, of the spread of all


def test_sightings_that_contradict_each_other_are_said(caplog: pytest.LogCaptureFixture) -> None:
    """Of two positions at one moment the first had been left out without a word."""
    both = Observations("seen.csv", fixes=[fix(-25.0).fixes[0], fix(25.0).fixes[0]])
    found = log_likelihood(spread([-20.0, 0.0, 30.0]), both, error=6.0)
    expected = [-0.5 * (one**2 + other**2) / 36.0 for one, other in ((5.0, 45.0), (25.0, 25.0), (55.0, 5.0))]
    assert found == pytest.approx(expected, rel=1e-5)
    assert (
        "no member agrees with all 2 positions: the best one is 4.2 standard deviations off on average" in caplog.text
    )


def test_members_that_fit_far_better_than_their_parents_have_weights(tmp_path: Path) -> None:
    """Bug: the largest likelihood was taken off without those of the parents, and all weights became 0."""
    store: Any = SimpleNamespace(folder=tmp_path, weights=lambda: {"base": [-900.0, -905.0]}, write=lambda: None)
    weight, number = weighted(store, np.array([-10.0, -10.0]), "")
    assert weight.tolist() == pytest.approx([1.0 / (1.0 + np.exp(5.0)), 1.0 / (1.0 + np.exp(-5.0))])
    assert 1.0 <= number <= 2.0


@pytest.mark.compiled
def test_the_command_weights_a_forecast(tmp_path: Path) -> None:
    out, seen = tmp_path / "f", tmp_path / "seen.csv"
    seen.write_text("date,lon,lat\n2020-12-09T16:00,-39.2,-55.0\n")
    words = [
        "forecast",
        str(small_berg(tmp_path)),
        "--members",
        "2",
        "-o",
        str(out),
        "--no-map",
        "-q",
        "--workers",
        "0",
    ]
    assert CliRunner().invoke(app, words).exit_code == 0
    said = CliRunner().invoke(app, ["update", str(out), str(seen), "--error", "5", "--no-resample"])
    assert said.exit_code == 0, said.output
    weight = open_sweep(out)["weight"].values
    assert weight.sum() == pytest.approx(2.0)
    assert np.ptp(weight) > 0.01


@pytest.mark.slow
@pytest.mark.compiled
def test_the_command_weights_a_forecast_and_draws_anew(tmp_path: Path) -> None:
    out, seen = tmp_path / "f", tmp_path / "seen.csv"
    seen.write_text("date,lon,lat\n2020-12-09T16:00,-39.2,-55.0\n")
    words = ["forecast", str(small_berg(tmp_path)), "--members", "4", "-o", str(out), "--no-map", "-q"]
    assert CliRunner().invoke(app, [*words, "--workers", "0"]).exit_code == 0
    said = CliRunner().invoke(app, ["update", str(out), str(seen), "--error", "5", "--no-resample"])
    assert said.exit_code == 0, said.output
    weight = open_sweep(out)["weight"].values
    assert weight.sum() == pytest.approx(4.0)
    assert np.ptp(weight) > 0.01
    said = CliRunner().invoke(app, ["update", str(out), str(seen), "--error", "0.3", "-q", "--workers", "0"])
    assert said.exit_code == 0, said.output
    new = open_sweep(tmp_path / "f-updated")
    assert new.sizes["member"] == 4
    said = CliRunner().invoke(app, ["forecast", "--resume", str(out), "--members", "5", "--no-map", "--workers", "0"])
    assert "Weights of earlier sightings do not hold" in said.output
    assert float(new["start_east"].std()) < float(open_sweep(out)["start_east"].std())
