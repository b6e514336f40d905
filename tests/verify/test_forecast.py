"""Ensembles against observations: axes, lead times, break-up, pooled bergs, and what the command writes."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr
from scipy import stats
from shapely.affinity import rotate
from typer.testing import CliRunner

from ensembles.made import forecast_of, outcome
from riftberg import Fix, Forcing, Iceberg, Model, Observations, Outline, Parameters, read_observed, sweep
from riftberg.cli.main import app
from riftberg.ensembles.result import write_sweep
from riftberg.errors import InputError
from riftberg.verification.forecast import report, verified
from riftberg.verification.sightings import read_pieces

from .sphere import displace
from .test_calibrate import eddied

START = datetime(2020, 12, 9, 13)
SPEED = 12.0  # km a day, eastward


def ensemble(seed: int, members: int = 30, days: int = 7, spread: float = 5.0) -> xr.Dataset:
    """Return the tracks of members that drift eastward, each with an error of velocity (km a day)."""
    random = np.random.default_rng(seed)
    time = np.arange(0, 24 * days + 1, 6) / 24.0
    velocity = np.array([SPEED, 0.0]) + random.normal(0.0, spread, (members, 2))
    lon, lat = displace(-40.0, -56.0, velocity[:, :1] * time, velocity[:, 1:] * time)
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
            lon, lat = displace(-40.0, -56.0, np.array(east), np.array(north))
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


def track(path: Path, ways: list[float]) -> Observations:
    """Return daily positions of a berg that goes so many km eastward from one day to the next."""
    rows = [displace(-40.0, -56.0, way, 0.0) for way in np.cumsum(ways)]
    lines = [f"{(START + timedelta(days=k + 1)).isoformat()},{lon},{lat}" for k, (lon, lat) in enumerate(rows)]
    path.write_text("\n".join(["date,lon,lat", *lines]))
    return read_observed(path)


@pytest.mark.parametrize(
    ("ways", "skill"),
    [
        # Ways so far 10, 20, 30; members 12 km a day on are 2, 4 and 6 km off.
        ([10.0, 10.0, 10.0], 1.0 - 12.0 / 60.0),
        ([12.0, 12.0], 1.0),
        ([-10.0, -10.0], 0.0),  # 22 and 44 km off, after 10 and 20 km
        ([0.0, 0.0], 0.0),  # the berg stays, and the members do not
    ],
)
def test_the_skill_of_liu_and_weisberg_by_hand(ways: list[float], skill: float, tmp_path: Path) -> None:
    found = verified(ensemble(1, spread=1e-9), track(tmp_path / "seen.csv", ways)).liu_weisberg
    assert found == pytest.approx({"mean of the members": skill, "median of the members": skill}, abs=1e-3)


def test_the_score_of_a_break_up_is_brier_s_less_what_few_members_add(tmp_path: Path) -> None:
    """Half of thirty members broke: 0.25, less 0.25 / 29."""
    found = verified(ensemble(1), track(tmp_path / "seen.csv", [12.0] * 7), broken=START + timedelta(days=4))
    days = report([found], 0.0)["forecasts"][0]["broken"]
    assert [day["fair_brier"] for day in days[2:]] == pytest.approx([0.25 - 0.25 / 29.0] * 5)
    late = verified(ensemble(1), track(tmp_path / "seen.csv", [12.0] * 7), broken=START + timedelta(days=1))
    assert report([late], 0.0)["forecasts"][0]["broken"][0]["fair_brier"] == 1.0


def test_reliability_shows_what_was_given_and_what_occurred(tmp_path: Path) -> None:
    """Days on which some of a hundred members had broken, and the berg as often as that, or every other day."""
    found, random = verified(ensemble(1), track(tmp_path / "seen.csv", [12.0])), np.random.default_rng(4)
    broken = random.integers(0, 101, 8000)
    chance = random.random(broken.size)
    members = np.tril(np.ones((101, 100)), -1)  # so many of a hundred

    def bins(occurred: Any) -> list[dict[str, Any]]:
        days = {
            day: (members[count], bool(over)) for day, (count, over) in enumerate(zip(broken, occurred, strict=True))
        }
        return report([replace(found, broken=days)], 0.0)["reliability"]

    honest = bins(chance < broken / 100.0)
    assert [b["cases"] > 1200 for b in honest] == [True] * 5
    assert all(abs(b["forecast"] - b["observed"]) < 0.03 for b in honest)
    bold = bins(chance < 0.5)
    assert bold[0]["observed"] > 0.4 > 0.2 > bold[0]["forecast"]
    assert bold[0]["interval"][0] < bold[0]["observed"] < bold[0]["interval"][1]
    (one,) = report([replace(found, broken={1: (np.ones(2), True)})], 0.0)["reliability"]
    assert one["interval"][0] == pytest.approx(1 / (1 + stats.norm.ppf(0.95) ** 2))


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
    lon, lat = displace(-40.0, -56.0, SPEED * days, 0.0 * days)
    return ds.assign_coords(cone=[0.5, 0.9]).assign(
        cone_lon=("time", lon), cone_lat=("time", lat), cone_azimuth=("time", np.zeros(days.size)),
        cone_major=(("cone", "time"), factor * 1e3 * sigma * days), cone_minor=(("cone", "time"), factor * 500.0 * sigma * days),
    )  # fmt: skip


def test_coverage_of_the_forecast_s_own_ellipses(tmp_path: Path) -> None:
    """What was seen 20 km north of the middle is 2 sigma away after two days where the ellipse points north."""
    path = tmp_path / "seen.csv"
    for axis, inside in (((0.0, 20.0), True), ((20.0, 0.0), False)):
        lon, lat = displace(-40.0, -56.0, np.array(2 * SPEED + axis[0]), np.array(axis[1]))
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


@pytest.mark.parametrize(("berg", "error"), [("A68a", 2.0), ("A-68D", 2.0), ("A68", 2.0), ("B22A", 38.0)])
def test_the_family_of_the_berg_trains_no_baseline(berg: str, error: float, tmp_path: Path) -> None:
    """A68a and its pieces went 50 km a day, B22A 10, the berg 12; staying put has the errors of other families."""
    from verify.test_tracks import write_track

    for name, speed in (("a68a", 50.0), ("a68", 50.0), ("a68d", 50.0), ("b22a", 10.0)):
        write_track(tmp_path / "tracks", name, [displace(-40.0, -56.0, speed * day, 0.0) for day in range(5)])
    write_sweep(ensemble(1), tmp_path / "sweep.nc")
    seen = observe(tmp_path / "seen.csv", 1, 0.0, name=berg)
    text = said(tmp_path / "sweep.nc", seen, "--tracks", tmp_path / "tracks", "--json", "--no-figure")
    still = json.loads(text.partition("\nWritten")[0])["baselines"]["staying put, dressed"]
    assert still[0]["error_of_mean_km"] == pytest.approx(error, abs=0.5)


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
    lon, lat = displace(*displace(-40.0, -56.0, 60.0, 0.0), ring[:, 0], ring[:, 1])
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


def test_the_outline_of_the_berg_at_the_start_is_that_of_the_ice_of_the_control(tmp_path: Path) -> None:
    """An L of 24 by 9 km, which members carry eastward and an image shows after five days; its mirror image is another."""
    corners = np.array([[-12.0, -4.5], [12.0, -4.5], [12.0, -1.5], [0.0, -1.5], [0.0, 4.5], [-12.0, 4.5]])
    corners -= np.array(shapely.Polygon(corners).centroid.coords)
    berg = Iceberg.from_outline(np.column_stack(displace(-40.0, -56.0, *corners.T)), thickness=200.0, radius=750.0)
    Model(berg, Forcing.uniform(), start=START.isoformat()).run(steps=1, output=tmp_path / "control.nc")
    azimuth = 101.4  # of the long axis of the L
    ds = turning(ensemble(1, spread=1e-9), 0.0)
    write_sweep(ds.assign(azimuth=0.0 * ds["area"] + azimuth, area=0.0 * ds["area"] + 144e6), tmp_path / "sweep.nc")
    for sides, least, most in (((1.0, 1.0), 0.98, 1.0), ((1.0, -1.0), 0.3, 0.6)):
        ring = np.column_stack(displace(*displace(-40.0, -56.0, 5 * SPEED, 0.0), *(corners * sides).T)).tolist()
        image = {"type": "Feature", "properties": {"date": (START + timedelta(days=5)).isoformat()},
                 "geometry": {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}}  # fmt: skip
        (tmp_path / "seen.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [image]}))
        text = said(tmp_path, tmp_path / "seen.geojson", "--error", 0, "--json", "--no-figure")
        (row,) = json.loads(text.partition("\nWritten")[0])["with_error"]
        assert least < row["overlap"] < most


def outlined(*rings: tuple[float, float, float, float], at: datetime = START, day_only: bool = True) -> list[Outline]:
    """Return boxes about places km east and north of the start, with half their length and half their width (km)."""
    corners = [(np.array([-a, a, a, -a]) + east, np.array([-b, -b, b, b]) + north) for east, north, a, b in rings]
    return [Outline("A01", at, day_only, np.column_stack(displace(-40.0, -56.0, x, y))) for x, y in corners]


def test_of_several_pieces_the_largest_counts() -> None:
    """400 km2, not 360 or 72, at six in the morning; a position of that moment counts no more."""
    day = datetime(2020, 12, 11)
    observed = Observations("s", outlines=outlined((0, 0, 30, 3), (50, 0, 2, 9), (0, 40, 5, 20), at=day),
                            fixes=[Fix("A01", day, True, -41.0, -57.0, 33.0)])  # fmt: skip
    found = verified(ensemble(1, spread=1e-9), observed, hour=6.0)
    (point,) = found.points[2]
    assert (found.name, len(found.points)) == ("A01", 1)
    assert point.observed == pytest.approx((0.0, 40.0), abs=0.05)
    assert point.members == pytest.approx(np.full((30, 2), (SPEED * 41.0 / 24.0, 0.0)), abs=0.05)


def drifter(east: float = 0.2, eddy: float = 0.5, spacing: float = 3000.0, step: float = 1800.0) -> Model:
    """Return a berg in an eddy, with a lattice and a step of its own."""
    berg = Iceberg.rectangle("30 km", "9 km", radius=0.5 * spacing, thickness=200.0, placement=(-37.0, -56.0))
    sea = Forcing.uniform(current=(east, 0.05)) + Forcing.eddy((-37.1, -56.1), radius=15e3, speed=eddy)
    return Model(berg, sea, Parameters(stepping={"time_step": step}), start=START.isoformat())


def test_outlines_of_members_that_broke_up() -> None:
    """Bars of 30 by 10 km lose their eastern third after a day and turn all the time, by 100 degrees in two days.

    Of the last day their outline is that of two thirds, so their axis says; later pieces belong to it until they break off.
    """
    day = 86400.0
    members = [outcome(k, [-40.0] * 3, [-56.0] * 3, area=300e6, piece=100e6, broken=1) for k in range(4)]
    thirds = [[[x, -5e3], [x + 10e3, -5e3], [x + 10e3, 5e3], [x, 5e3]] for x in (-15e3, -5e3, 5e3)]
    for member in members:
        for row in (row for row in member.track if row[1] == 1):
            row[6] = (90.0 + 50.0 * row[0] / day) % 180.0  # azimuth: east and west at the start, clockwise
        member.shapes = [[1, [thirds[0][0], thirds[1][1], thirds[1][2], thirds[0][3]]], [2, thirds[2]]]
    ds = forecast_of(members, 2)
    start = shapely.box(-15.0, -5.0, 15.0, 5.0)

    def score(days: float, length: float, **known: Any) -> dict[str, Any]:
        expected = rotate(shapely.box(-0.5 * length, -5.0, 0.5 * length, 5.0), -50.0 * days, origin=(0.0, 0.0))
        ring = np.column_stack(displace(-40.0, -56.0, *np.array(expected.exterior.coords)[:-1].T))
        seen = Observations("s", outlines=[Outline("A01", datetime(2020, 12, 9) + timedelta(days=days), False, ring)])
        (row,) = report([verified(ds, seen, outline=start, **known)], 0.0)["with_error"]
        return row

    for days, length in ((0.5, 30.0), (1.0, 20.0), (2.0, 20.0)):
        assert score(days, length, pieces=lambda number: members[number].shapes)["overlap"] > 0.98, days
    assert score(0.5, 30.0)["known"] == 1.0
    assert "overlap" not in score(2.0, 20.0)  # of an ensemble of an earlier version there are no pieces


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
