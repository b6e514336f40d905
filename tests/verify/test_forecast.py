"""Ensembles against observations: axes, lead times, break-up, pooled bergs, and what the command writes."""

from __future__ import annotations

import csv
import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr
from shapely.affinity import rotate
from typer.testing import CliRunner

from ensembles.made import forecast_of, outcome
from fakes import FakeModel
from riftberg import Fix, Forcing, Iceberg, Model, Observations, Outline, Parameters, read_observed, sweep
from riftberg.cli.main import app
from riftberg.diagnostics.outlines import intersection_over_union
from riftberg.ensembles.result import write_sweep
from riftberg.errors import InputError
from riftberg.runs.run_file import RunWriter
from riftberg.verification.forecast import report, verified
from riftberg.verification.scores import local, moved
from riftberg.verification.sightings import Sighting, member_outlines, read_first_outline, read_pieces, select_sightings
from riftberg.verification.tracks import Case, Start, dressed_without

from .test_calibrate import eddied

START = datetime(2020, 12, 9, 13)
SPEED = 12.0  # km a day, eastward


def ensemble(seed: int, members: int = 30, days: int = 7, spread: float = 5.0) -> xr.Dataset:
    """Return the tracks of members that drift eastward, each with an error of velocity (km a day)."""
    random = np.random.default_rng(seed)
    time = np.arange(0, 24 * days + 1, 6) / 24.0
    velocity = np.array([SPEED, 0.0]) + random.normal(0.0, spread, (members, 2))
    lon, lat = moved(-40.0, -56.0, velocity[:, :1] * time, velocity[:, 1:] * time)
    dims = ("member", "fragment", "time")
    broken = np.where(
        np.arange(members) % 2 == 0, np.datetime64(START, "ns") + np.timedelta64(60, "h"), np.datetime64("NaT")
    )
    return xr.Dataset(
        {"status": ("member", np.zeros(members, "i4")), "message": ("member", np.full(members, "", object)),
         "lon": (dims, lon[:, None]), "lat": (dims, lat[:, None]), "first_breakup": ("member", broken),
         "fragment_birth_time": (("member", "fragment"), np.full((members, 1), np.datetime64(START, "ns")))},
        {"member": np.arange(members), "fragment": [1],
         "time": np.datetime64(START, "ns") + (time * 86400e9).astype("timedelta64[ns]")},
    )  # fmt: skip


def observe(
    path: Path, seed: int, spread: float = 5.0, *, noise: float = 0.0, days: int = 7, name: str = "A01"
) -> Path:
    """Write positions of three days before the start, and of a truth that drifts as one more member would."""
    random = np.random.default_rng(1000 + seed)
    velocity = np.array([SPEED, 0.0]) + random.normal(0.0, spread, 2)
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["berg", "date", "lon", "lat"])
        for day in range(-3, days + 1):
            east, north = (velocity if day > 0 else np.array([SPEED, 0.0])) * day + random.normal(0.0, 1.0, 2) * noise
            lon, lat = moved(-40.0, -56.0, np.array(east), np.array(north))
            table.writerow([name, (START + timedelta(days=day)).isoformat(), float(lon), float(lat)])
    return path


def test_errors_are_along_and_across_the_motion_before(tmp_path: Path) -> None:
    found = verified(ensemble(1), read_observed(observe(tmp_path / "seen.csv", 1)))
    assert found.heading == pytest.approx((3 * SPEED, 0.0), abs=0.5)
    assert sorted(found.points) == [1, 2, 3, 4, 5, 6, 7]
    (point,) = found.points[5]
    assert point.members.mean(axis=0) == pytest.approx((5 * SPEED, 0.0), abs=15.0)
    velocity = point.observed / 5.0
    assert velocity == pytest.approx(found.points[1][0].observed, abs=0.2)
    (still,) = found.baselines["staying put"][5]
    (steady,) = found.baselines["constant velocity"][5]
    assert still.members == pytest.approx(np.zeros((1, 2)))
    assert steady.members[0] == pytest.approx((5 * SPEED, 0.0), abs=0.5)


def test_the_axes_do_not_know_the_outcome(tmp_path: Path) -> None:
    """Whatever was observed after the start, the members' coordinates stay."""
    first, second = (verified(ensemble(1), read_observed(observe(tmp_path / f"{seed}.csv", seed))) for seed in (1, 2))
    np.testing.assert_array_equal(first.points[7][0].members, second.points[7][0].members)


def test_without_a_position_before_the_axes_are_east_and_north(tmp_path: Path) -> None:
    path = tmp_path / "seen.csv"
    path.write_text("date,lon,lat\n2020-12-12T13:00,-40,-55\n")
    found = verified(ensemble(1), read_observed(path))
    assert found.points[3][0].observed == pytest.approx((0.0, 111.2), abs=0.1)
    assert report([found], 0.0)["forecasts"][0]["axes"] == "east and north"
    assert list(found.baselines) == ["staying put"]


@pytest.mark.quick(1)
@pytest.mark.parametrize(("factor", "word"), [(1.0, "reliable"), (2.5, "overconfident"), (0.4, "underconfident")])
def test_pooled_twins_are_called_what_they_are(factor: float, word: str, tmp_path: Path) -> None:
    """Truth from the ensemble's own errors, and from larger and smaller ones; twenty bergs."""
    found = [
        verified(ensemble(k), read_observed(observe(tmp_path / f"{k}.csv", k, 5.0 * factor, name=f"A{k:02d}")))
        for k in range(20)
    ]
    rows = report(found, 0.0)["with_error"]
    assert rows[3]["bergs"] == 20
    assert rows[3]["verdict"] == word
    if word == "reliable":
        assert rows[3]["inside_90%"] == pytest.approx(0.9, abs=0.15)
        # A perfect ensemble beats both forecasts that cost nothing.
        assert all(row["energy_km"] < row["error_of_mean_km"] for row in rows)


@pytest.mark.slow
def test_the_error_of_observations_is_added_to_the_members(tmp_path: Path) -> None:
    found = [
        verified(
            ensemble(k, spread=3.0), read_observed(observe(tmp_path / f"{k}.csv", k, 3.0, noise=6.0, name=f"A{k:02d}"))
        )
        for k in range(20)
    ]
    result = report(found, 6.0)
    assert result["with_error"][0]["inside_90%"] > result["without_error"][0]["inside_90%"] + 0.2
    assert result["with_error"][0]["energy_km"] < result["without_error"][0]["energy_km"]


def test_probability_of_having_broken_by_day(tmp_path: Path) -> None:
    """Half of the members break on day 2.5; those that never do stay in the denominator."""
    seen = read_observed(observe(tmp_path / "seen.csv", 1))
    found = verified(ensemble(1), seen, broken=START + timedelta(days=4))
    days = report([found], 0.0)["forecasts"][0]["broken"]
    assert [day["probability"] for day in days] == [0.0, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert [day["occurred"] for day in days] == [False, False, False, True, True, True, True]
    assert days[0]["fair_brier"] == 0.0
    # Last seen whole on day 1, broken on day 4: of days 2 and 3 nobody knows.
    found = verified(ensemble(1), seen, broken=START + timedelta(days=4), whole_until=START + timedelta(days=1))
    assert sorted(found.broken) == [1, 4, 5, 6, 7]
    # Never seen broken.
    found = verified(ensemble(1), seen, whole_until=START + timedelta(days=5))
    assert [over for _, over in found.broken.values()] == [False] * 5


def test_members_count_by_their_weights_and_failed_ones_not(tmp_path: Path) -> None:
    seen = read_observed(observe(tmp_path / "seen.csv", 1))
    ds = ensemble(1).assign_coords(weight=("member", np.r_[np.full(29, 1e-9), 1.0]))
    alone = verified(ds, seen).points[4][0].members
    assert np.ptp(alone, axis=0) == pytest.approx((0.0, 0.0), abs=1e-9)
    ds = ensemble(1)
    ds["status"][:10] = 1
    found = verified(ds, seen)
    assert (found.members, found.failed, len(found.points[4][0].members)) == (20, 10, 20)


def test_the_skill_of_liu_and_weisberg_is_that_of_the_track(tmp_path: Path) -> None:
    path = observe(tmp_path / "seen.csv", 1, 0.0)
    found = verified(ensemble(1, spread=1e-6), read_observed(path))
    assert found.liu_weisberg["mean of the members"] == pytest.approx(1.0, abs=1e-3)
    still = verified(ensemble(1, spread=3.0), read_observed(path))
    assert still.liu_weisberg["median of the members"] < found.liu_weisberg["median of the members"]


def said(*words: object) -> str:
    done = CliRunner().invoke(app, ["verify", *map(str, words)], env={"COLUMNS": "200"})
    return done.output if done.exit_code == 0 else f"exit {done.exit_code}: {done.stderr}"


def folders(tmp_path: Path, count: int) -> list[Path]:
    pairs = []
    for k in range(count):
        (tmp_path / f"forecast{k}").mkdir()
        write_sweep(ensemble(k), tmp_path / f"forecast{k}" / "sweep.nc")
        pairs += [tmp_path / f"forecast{k}", observe(tmp_path / f"seen{k}.csv", k, name=f"A{k:02d}")]
    return pairs


@pytest.mark.slow
def test_the_command_pools_forecasts_and_writes_numbers_and_a_figure(tmp_path: Path) -> None:
    pairs = folders(tmp_path, 6)
    dates = [
        word
        for k in range(6)
        for word in (
            "--broken",
            "2020-12-12" if k % 2 else "never",
            "--whole-until",
            "2020-12-11" if k % 2 else "2020-12-16",
        )
    ]
    text = said(*pairs, *dates, "-o", tmp_path / "out")
    assert "A00, start 2020-12-09 13:00: 30 members" in text
    assert "Spread against error over 6 bergs" in text
    result = json.loads((tmp_path / "out" / "verification.json").read_text())
    assert [row["lead_days"] for row in result["with_error"]] == [1, 2, 3, 4, 5, 6, 7]
    assert sum(row["cases"] for row in result["reliability"]) == sum(len(one["broken"]) for one in result["forecasts"])
    assert (tmp_path / "out" / "verification.png").stat().st_size > 10_000
    assert "1 berg says nothing of the spread" in said(*pairs[:2], "--no-figure")
    assert (pairs[0] / "verification.json").exists()


def test_baselines_get_the_errors_of_other_bergs(tmp_path: Path) -> None:
    from verify.test_tracks import straight, write_track

    for name in ("b15a", "b15b"):
        write_track(tmp_path / "tracks", name, straight(20))
    result = json.loads(
        said(*folders(tmp_path, 1), "--tracks", tmp_path / "tracks", "--json", "--no-figure").partition("\nWritten")[0]
    )
    still = result["baselines"]["staying put, dressed"][4]
    assert "energy_km" in still
    assert result["baselines"]["staying put"][4]["error_of_mean_km"] > 30.0


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["forecast0"], "1 paths. Give FOLDER OBSERVED"),
        (["nowhere", "seen0.csv"], "Name a folder that"),
        (["forecast0", "missing.csv"], "missing.csv"),
        (["forecast0", "seen0.csv", "--berg", "B09"], "no positions of B09. Name one with --berg: A00"),
        (["forecast0", "two.csv"], "several bergs. Name one with --berg: A01, A02"),
        (["forecast0", "late.csv"], "no position of LATE from 2020-12-09 13:00 to 2020-12-16 13:00"),
        (["forecast0", "seen0.csv", "--broken", "soon"], "'soon' is not a date"),
        (["forecast0", "seen0.csv", "--broken", "2020-12-12", "--broken", "never"], "2 dates for 1 forecasts"),
        (
            ["forecast0", "seen0.csv", "--broken", "2020-12-12", "--whole-until", "2020-12-13"],
            "whole until after it broke",
        ),
        (["forecast0", "seen0.csv", "--error", "-1"], "-1 is not possible"),
    ],
)
def test_bad_input_is_one_clear_sentence(words, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders(tmp_path, 1)
    (tmp_path / "two.csv").write_text("berg,date,lon,lat\nA01,2020-12-10,-40,-56\nA02,2020-12-10,-40,-56\n")
    (tmp_path / "late.csv").write_text("date,lon,lat\n2021-12-10,-40,-56\n")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    text = said(*words)
    assert text.startswith("exit 2")
    assert message in " ".join(text.split())
    assert sorted(tmp_path.rglob("*")) == before


def test_one_member_is_no_ensemble(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="1 members are done"):
        verified(ensemble(1, members=1), read_observed(observe(tmp_path / "seen.csv", 1)))


def with_cones(ds: xr.Dataset, sigma: float) -> xr.Dataset:
    """Return an ensemble with ellipses around the mean track: so many km a day long, half as wide, across the motion."""
    days = (ds["time"].values - ds["time"].values[0]) / np.timedelta64(1, "D")
    factor = np.sqrt(-2.0 * np.log(1.0 - np.array([0.5, 0.9])))[:, None]
    lon, lat = moved(-40.0, -56.0, SPEED * days, 0.0 * days)
    return ds.assign_coords(cone=[0.5, 0.9]).assign(
        cone_lon=("time", lon), cone_lat=("time", lat), cone_azimuth=("time", np.zeros(days.size)),
        cone_major=(("cone", "time"), factor * 1e3 * sigma * days), cone_minor=(("cone", "time"), factor * 500.0 * sigma * days),
    )  # fmt: skip


def test_coverage_of_the_forecast_s_own_ellipses(tmp_path: Path) -> None:
    """What was seen 20 km north of the middle is 2 sigma away after two days where the ellipse points north."""
    path = tmp_path / "seen.csv"
    for axis, inside in (((0.0, 20.0), True), ((20.0, 0.0), False)):
        lon, lat = moved(-40.0, -56.0, np.array(2 * SPEED + axis[0]), np.array(axis[1]))
        path.write_text(f"date,lon,lat\n2020-12-11T13:00,{float(lon)},{float(lat)}\n")
        found = verified(with_cones(ensemble(1), 5.0), read_observed(path))
        offset, covariance = found.own_areas[2][0]
        assert offset == pytest.approx(axis, abs=0.2)
        assert np.diag(covariance) == pytest.approx([25.0, 100.0], rel=1e-6)
        row = report([found], 0.0)["with_error"][0]
        assert row["own_50%"] == 0.0
        assert row["own_90%"] == float(inside)  # 2 sigma; the ellipse of 90 % ends at 2.15
    # An error of the observation widens them.
    assert report([found], 20.0)["with_error"][0]["own_90%"] == 1.0
    assert report([found], 20.0)["without_error"][0]["own_90%"] == 0.0


def test_unequal_weights_count_by_their_effective_number(tmp_path: Path) -> None:
    """With the weight on four of thirty members, intervals were those of thirty."""
    weight = np.where(np.arange(30) < 4, 1.0, 1e-6)
    ds = ensemble(1).assign_coords(weight=("member", weight))
    found = verified(ds, read_observed(observe(tmp_path / "seen.csv", 1)), broken=START + timedelta(days=3))
    assert len(found.points[3][0].members) == 4
    equal = verified(ensemble(1), read_observed(tmp_path / "seen.csv"), broken=START + timedelta(days=3))
    few, many = (np.diff(report([f], 0.0)["forecasts"][0]["broken"][4]["interval"])[0] for f in (found, equal))
    assert few > 1.5 * many


def test_the_family_of_the_berg_trains_no_baseline() -> None:
    def case(berg: str, east: float) -> Case:
        before = {START - timedelta(days=3): (-40.0, -56.0)}
        lon, lat = moved(-40.0, -56.0, np.array(east), np.array(0.0))
        return Case(Start(berg, START, -40.5, -56.0, before), {1: (float(lon), float(lat))})

    cases = [case("A68A", 500.0), case("A68", 500.0), case("A68D", 500.0), case("B22A", 10.0)]
    for name in ("A68a", "A-68D", "A68"):
        errors = dressed_without(cases, name)["staying put"].errors[1]
        assert len(errors) == 1
    assert len(dressed_without(cases, "B22A")["staying put"].errors[1]) == 3


RECTANGLE = shapely.box(-40.0, -10.0, 40.0, 10.0)  # km; its long axis lies east and west


def turning(ds: xr.Dataset, degrees: float) -> xr.Dataset:
    """Return an ensemble of rectangles that turn clockwise by so many degrees a day, by half a turn more than once."""
    days = (ds["time"].values - ds["time"].values[0]) / np.timedelta64(1, "D")
    dims, shape = ("member", "fragment", "time"), ds["lon"].shape
    azimuth = (90.0 + degrees * days) % 180.0
    return ds.assign(azimuth=(dims, np.broadcast_to(azimuth, shape)), area=(dims, np.full(shape, 1.6e9)))


def test_outlines_of_members_are_turned_and_moved_like_them(tmp_path: Path) -> None:
    """The truth is a rectangle that turned by 150 degrees in five days while it drifted 60 km east; the members do the same."""
    ring = np.array(rotate(RECTANGLE, -150.0).exterior.coords)
    lon, lat = moved(*map(float, moved(-40.0, -56.0, np.array(60.0), np.array(0.0))), ring[:, 0], ring[:, 1])
    when = START + timedelta(days=5)
    seen = Observations("seen", outlines=[Outline("A01", when, False, np.column_stack([lon, lat])[:-1])])
    exact = turning(ensemble(1, spread=1e-9), 30.0)
    found = verified(exact, seen, outline=RECTANGLE)
    row = report([found], 0.0)["with_error"][0]
    assert row["overlap"] == pytest.approx(1.0, abs=0.02)
    assert row["area_km2"] < 0.02 * RECTANGLE.area
    assert row["known"] == 0.5  # every second member breaks after 2.5 days
    for wrong in (turning(ensemble(1, spread=1e-9), 20.0), turning(ensemble(1, spread=4.0), 30.0)):
        other = report([verified(wrong, seen, outline=RECTANGLE)], 0.0)["with_error"][0]
        assert other["overlap"] < row["overlap"] - 0.1
        assert other["area_km2"] > row["area_km2"] + 50.0
    # Members of four times the area are twice as long and wide.
    large = report([verified(exact.assign(area=4.0 * exact["area"]), seen, outline=RECTANGLE)], 0.0)["with_error"][0]
    assert large["overlap"] == pytest.approx(0.25, abs=0.01)
    # An error of the observation moves the members; positions alone have no outlines; nor has a forecast without its control.
    assert report([found], 10.0)["with_error"][0]["overlap"] < 0.8
    track = read_observed(observe(tmp_path / "seen.csv", 1))
    assert "overlap" not in report([verified(exact, track, outline=RECTANGLE)], 0.0)["with_error"][0]
    assert "overlap" not in report([verified(exact, seen)], 0.0)["with_error"][0]


def test_the_outline_of_a_run_is_that_of_its_ice(tmp_path: Path) -> None:
    FakeModel(8, 3, turn_per_day=0.0).advance(0.25, recorders=[RunWriter(tmp_path / "run.nc", every_hours=6)])
    assert read_first_outline(tmp_path / "run.nc").symmetric_difference(shapely.box(-12.0, -4.5, 12.0, 4.5)).area < 1.5


def test_of_several_pieces_the_largest_counts_with_its_axis() -> None:
    def ring(east: float, north: float, long: float, wide: float) -> Outline:
        x, y = np.array([-long, long, long, -long]) + east, np.array([-wide, -wide, wide, wide]) + north
        return Outline("A01", START, True, np.column_stack(moved(-40.0, -56.0, x, y)))

    observed = Observations("s", outlines=[ring(0, 0, 30, 3), ring(50, 0, 2, 9), ring(0, 40, 5, 20)],
                            fixes=[Fix("A01", START, True, -41.0, -57.0, 33.0)])  # fmt: skip
    name, (seen,) = select_sightings(observed, None, START, 6.0)
    assert (name, seen.when) == ("A01", START + timedelta(hours=6))
    assert local(-40.0, -56.0, seen.lon, seen.lat) == pytest.approx((0.0, 40.0), abs=0.05)  # 400, not 360 or 72 km2
    assert abs((seen.azimuth + 90.0) % 180.0 - 90.0) < 0.5


def drifter(east: float = 0.2, eddy: float = 0.5, spacing: float = 3000.0, step: float = 1800.0) -> Model:
    """Return a berg in an eddy, with a lattice and a step of its own."""
    berg = Iceberg.rectangle("30 km", "9 km", radius=0.5 * spacing, thickness=200.0, placement=(-37.0, -56.0))
    sea = Forcing.uniform(current=(east, 0.05)) + Forcing.eddy((-37.1, -56.1), radius=15e3, speed=eddy)
    return Model(berg, sea, Parameters(stepping={"time_step": step}), start=START.isoformat())


def test_outlines_of_members_that_broke_up() -> None:
    """A bar of 30 by 10 km loses its eastern third after a day and turns all the time, by 100 degrees in two days.

    Of the last day its outline is that of two thirds, so its axis says; later pieces belong to it until they break off.
    """
    day = 86400.0
    one = outcome(0, [-37.0] * 3, [-56.0] * 3, area=300e6, piece=100e6, broken=1)
    for row in (row for row in one.track if row[1] == 1):
        row[6] = (90.0 + 50.0 * row[0] / day) % 180.0  # azimuth: east and west at the start, clockwise
    thirds = [[[x, -5e3], [x + 10e3, -5e3], [x + 10e3, 5e3], [x, 5e3]] for x in (-15e3, -5e3, 5e3)]
    one.shapes = [[1, [thirds[0][0], thirds[1][1], thirds[1][2], thirds[0][3]]], [2, thirds[2]]]
    ds = forecast_of([one], 2)
    start = shapely.box(-15.0, -5.0, 15.0, 5.0)
    for k, length in ((0, 30.0), (1, 20.0), (2, 20.0)):
        seen = Sighting(datetime(2020, 12, 9 + k), -37.0, -56.0, np.nan, None)
        (found,) = member_outlines(ds, start, seen, lambda number: one.shapes)
        expected = rotate(shapely.box(-0.5 * length, -5.0, 0.5 * length, 5.0), -50.0 * k, origin=(0.0, 0.0))
        assert intersection_over_union(found, expected) > 0.98, k
    assert not member_outlines(ds, start, seen)  # of an ensemble of an earlier version there are none


def test_pieces_of_a_real_run_cover_the_berg_at_its_start(tmp_path: Path) -> None:
    sweep(eddied, {"start.strength": [0.02]}, days="3 h", every_hours=3, workers=0, output=tmp_path / "s")
    rings = read_pieces(tmp_path / "s", 0)
    shapes = [shapely.Polygon(np.array(ring) / 1e3) for _, ring in rings]
    assert len(shapes) > 1
    assert min(number for number, _ in rings) == 1
    assert sum(shape.area for shape in shapes) == pytest.approx(270.0, rel=0.05)
    assert shapely.union_all(shapes).difference(shapely.box(-15.0, -4.5, 15.0, 4.5)).area < 5.0
    assert read_pieces(tmp_path / "nothing", 0) == []


@pytest.mark.slow
def test_a_truth_with_another_lattice_and_step_is_reliable_too() -> None:
    """The third twin: errors of the ensemble's own, but elements of 1.5 km for 3 km and steps of 15 for 30 minutes."""
    vary = {"east": "~normal(0.2, 0.04)", "eddy": "~normal(0.5, 0.08)", "start.north": "~normal(0 km, 1 km)"}
    common: dict[str, Any] = {"days": "2 day", "every_hours": 6, "workers": 0, "plan": "random"}  # Sobol' is too even
    truths = sweep(drifter, {**vary, "spacing": [1500.0], "step": [900.0]}, members=16, seed=5, **common)
    made = sweep(drifter, vary, members=20, seed=6, **common)
    found = []
    for k in range(truths.sizes["member"]):
        track = truths.isel(member=k, fragment=0)
        fixes = [Fix(f"A{k:02d}", when, False, float(lon), float(lat)) for when, lon, lat in zip(
            track["time"].values[1:].astype("datetime64[us]").tolist(), track["lon"].values[1:], track["lat"].values[1:],
            strict=True)]  # fmt: skip
        found.append(verified(made, Observations("truth", fixes=fixes)))
    rows = report(found, 0.0)["with_error"]
    assert [row["verdict"] for row in rows] == ["reliable"] * 2
