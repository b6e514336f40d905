"""The benchmark on tracks: which starts count, the baselines, models from outside, and forecasts of other programs."""

from __future__ import annotations

import csv
import json
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from riftberg.cli.main import app
from riftberg.errors import InputError
from riftberg.verification import tracks
from riftberg.verification.scores import distance, extrapolate, local, moved

DRESSED_MEMBERS = 50
HELD_OUT = ("A38", "B17", "C19")

FIRST = datetime(2003, 1, 1)
NORTHWARD = 10.0 / 111.19  # Degrees of 10 km


def write_track(folder: Path, name: str, places, *, flags=None, first: datetime = FIRST, sensor: str = "qscat") -> None:
    """Write a table of BYU: one day after the other from the first, None for a day without data."""
    folder.mkdir(exist_ok=True)
    with (folder / f"{name}.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow([f"{sensor}_1", f"{sensor}_2", f"{sensor}_3", "date"])
        for k, place in enumerate(places):
            lon, lat = (0, 0) if place is None else place
            flag = 0 if place is None else 1 if flags is None else flags[k]
            table.writerow([lat, lon, flag, f"{first + timedelta(days=k):%Y%j}"])


def straight(days: int, lon: float = -40.0, lat: float = -56.0, step: float = NORTHWARD):
    return [(lon, lat + step * k) for k in range(days)]


def test_a_straight_track_is_what_constant_velocity_forecasts(tmp_path: Path) -> None:
    write_track(tmp_path, "x01", straight(12))
    cases = tracks.read_cases(tmp_path)
    assert [case.start.date for case in cases] == [FIRST + timedelta(days=k) for k in range(3, 11)]
    assert sorted(cases[0].seen) == [1, 3, 5, 7]
    assert sorted(cases[-1].seen) == [1]
    straight_on = tracks.table(tracks.compute_errors(tracks.constant_velocity, cases))
    still = tracks.table(tracks.compute_errors(tracks.staying_put, cases))
    assert [row["median_km"] for row in straight_on] == pytest.approx([0.0] * 4, abs=1e-6)
    assert [row["median_km"] for row in still] == pytest.approx([10.0, 30.0, 50.0, 70.0], rel=1e-3)
    assert straight_on[0]["low_km"] is None  # one berg says nothing of others


@pytest.mark.parametrize(
    ("places", "flags", "starts"),
    [
        (straight(5, step=0.2 * NORTHWARD), None, 0),  # 2 km a day: aground or in ice
        (straight(5, lat=-62.0), None, 0),  # south of 60 S
        (straight(5), [1, 1, 1, 0, 1], 0),  # interpolated at the start
        ([*straight(4)[:1], None, *straight(5)[2:]], None, 1),  # a gap within the three days
        ([None, *straight(5)[1:]], None, 0),  # not seen three days before
        ([*straight(4), (-41.2, -55.7)], None, 0),  # 76 km in a day: the later position is an error
        ([*straight(3), (-41.2, -55.7), *straight(5)[4:]], None, 0),  # so is this one, at the start
    ],
)
def test_which_starts_count(tmp_path: Path, places, flags, starts: int) -> None:
    write_track(tmp_path, "x01", places, flags=flags)
    write_track(tmp_path, "y01", straight(5))
    write_track(tmp_path, "z01", straight(5), sensor="nic")  # weekly positions of charts are not taken
    assert [case.start.berg for case in tracks.read_cases(tmp_path)] == ["X01"] * starts + ["Y01"]


FAR = (-20.0, -56.0)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ([FAR], straight(8)),  # it took 20 days until a berg of 60 km a day could have come back
        ([FAR, None], straight(8)),
        ([*straight(3), *[None] * 30, FAR], straight(8)),  # after a gap in which it might have gone there
    ],
)
def test_a_position_that_all_later_ones_contradict_is_the_wrong_one(tmp_path: Path, before, after) -> None:
    """A wrong first position stayed, and right ones were dropped until they could be reached from it."""
    write_track(tmp_path, "x01", [*before, *after])
    first = FIRST + timedelta(days=len(before))
    starts = [case.start.date for case in tracks.read_cases(tmp_path) if case.start.date >= first]
    assert starts == [first + timedelta(days=k) for k in range(3, 7)]


def test_two_wrong_positions_in_a_row_do_not_undo_the_track_before(tmp_path: Path) -> None:
    track = straight(12)
    write_track(tmp_path, "x01", [*track[:5], FAR, FAR, *track[7:]])
    cases = tracks.read_cases(tmp_path)
    assert FAR not in {place for case in cases for place in (*case.seen.values(), (case.start.lon, case.start.lat))}
    assert cases[0].start.date == FIRST + timedelta(days=3)


def test_across_the_date_line_nothing_changes(tmp_path: Path) -> None:
    write_track(tmp_path, "x01", [((179.6 + 0.16 * k + 180.0) % 360.0 - 180.0, -56.0) for k in range(11)])
    (case, *_) = tracks.read_cases(tmp_path)
    assert case.start.heading == pytest.approx((29.8, 0.0), abs=0.2)
    (row,) = (row for row in tracks.compute_errors(tracks.constant_velocity, [case]) if row.lead == 7)
    assert row.error < 1.0  # the berg keeps to its parallel, the forecast to the great circle
    west, east, south, north = case.box
    assert west < -187.0 < -173.0 < east
    assert south < -59.7 < -52.3 < north


def test_places_and_displacements_are_inverse() -> None:
    random = np.random.default_rng(1)
    lon, lat = random.uniform(-180.0, 180.0, 50), random.uniform(-89.0, 89.0, 50)
    east, north = random.uniform(-500.0, 500.0, (2, 50))
    there = moved(lon, lat, east, north)
    np.testing.assert_allclose(local(lon, lat, *there), [east, north], atol=1e-6)
    np.testing.assert_allclose(distance(lon, lat, *there), np.hypot(east, north), rtol=1e-9)
    on = extrapolate(10.0, 20.0, 11.0, 21.0, np.array([0.0, 1.0]))
    assert (on[0][0], on[1][0]) == pytest.approx((11.0, 21.0))
    assert distance(10.0, 20.0, on[0][1], on[1][1]) == pytest.approx(2 * distance(10.0, 20.0, 11.0, 21.0))


def test_the_axes_of_errors_know_the_motion_before_alone(tmp_path: Path) -> None:
    write_track(tmp_path, "x01", straight(8))
    case = tracks.read_cases(tmp_path)[0]
    assert np.allclose(case.start.heading, (0.0, 30.0), atol=0.1)
    assert all(day < case.start.date for day in case.start.before)


def test_dressed_forecasts_have_the_errors_of_other_bergs(tmp_path: Path) -> None:
    """Training bergs go north and turn 5 km a day to the left; the other goes east, so its left is north."""
    for k in range(3):
        places = straight(4, lon=-40.0 + k)
        lon, lat = places[-1]
        later = moved(lon, lat, -5.0 * np.arange(1.0, 8.0), 10.0 * np.arange(1.0, 8.0))
        write_track(tmp_path, f"x0{k}", [*places, *zip(*later, strict=True)])
    training = [case for case in tracks.read_cases(tmp_path) if case.start.date == FIRST + timedelta(days=3)]
    write_track(tmp_path, "y01", [(-40.0 + 0.16 * k, -56.0) for k in range(11)])
    case = next(case for case in tracks.read_cases(tmp_path) if case.start.berg == "Y01")
    dressed = tracks.Dressed(tracks.constant_velocity, training)
    for lead, made in tracks.forecast(dressed, case).items():
        bare = tracks.forecast(tracks.constant_velocity, case)[lead][0]
        east, north = local(*bare, made[:, 0], made[:, 1])
        assert made.shape == (DRESSED_MEMBERS, 2)
        np.testing.assert_allclose(east, 0.0, atol=0.06 * 5.0 * lead)
        np.testing.assert_allclose(north, 5.0 * lead, rtol=0.02)


def test_noise_alone_lowers_the_score_of_a_bare_forecast(tmp_path: Path) -> None:
    """So baselines must be dressed to be fair opponents of an ensemble."""
    random = np.random.default_rng(2)
    for k in range(8):
        write_track(
            tmp_path,
            f"{'x' if k < 4 else 'a38'}{'abcdefgh'[k]}",
            np.array([-40.0, -56.0]) + np.cumsum(random.normal([0.05, 0.05], 0.08, (40, 2)), axis=0),
        )
    cases = tracks.read_cases(tmp_path)
    held, training = ([case for case in cases if case.held_out is out] for out in (True, False))
    scored = tracks.ensemble_table(tracks.Dressed(tracks.staying_put, training), held, 0.0)
    bare = {
        lead: np.mean([row.error for row in tracks.compute_errors(tracks.staying_put, held) if row.lead == lead])
        for lead in (1, 3, 5, 7)
    }
    assert all(row["energy_km"] < 0.85 * bare[row["lead_days"]] for row in scored)


@pytest.mark.slow
def test_the_baselines_are_those_of_the_published_tables(shared: Path) -> None:
    """Within a kilometre, with intervals from drawing bergs; computed independently from the same tables and rules."""
    cases = tracks.read_cases(shared / "data" / "tracks")
    still, steady = (tracks.table(tracks.compute_errors(model, cases)) for model in tracks.BASELINES.values())
    assert [row["median_km"] for row in still] == pytest.approx([12.0, 34.0, 55.0, 72.0], abs=1.0)
    assert [row["median_km"] for row in steady] == pytest.approx([11.0, 29.0, 52.0, 76.0], abs=1.0)
    for row, interval in ((still[-1], (62.0, 82.0)), (steady[-1], (69.0, 86.0))):
        assert (row["low_km"], row["high_km"]) == pytest.approx(interval, abs=1.5)
    assert 2700 < still[-1]["starts"] < 2900
    assert {tracks.family(case.start.berg) for case in cases if case.held_out} == set(HELD_OUT)


def three_bergs(folder: Path) -> Path:
    for name, lon in (("a38b", -40.0), ("b15a", -35.0), ("a68a", -30.0)):
        write_track(folder / "tracks", name, straight(12, lon=lon))
    return folder / "tracks"


def said(*words: object) -> str:
    done = CliRunner().invoke(app, ["verify-tracks", *map(str, words)], env={"COLUMNS": "200"})
    return done.output if done.exit_code == 0 else f"exit {done.exit_code}: {done.stderr}"


def test_a_model_of_ones_own_and_forecasts_of_other_programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = three_bergs(tmp_path)
    (tmp_path / "own_drift.py").write_text(
        "import numpy as np\n\n\ndef northward(start, dates):\n"
        "    days = np.array([(d - start.date).days for d in dates])\n"
        "    lat = start.lat + 10.0 / 111.19 * days\n"
        "    return np.stack([np.full(len(days), start.lon), lat], axis=-1)\n"
    )
    monkeypatch.chdir(tmp_path)
    assert "Written:" in said(folder, "-o", "out")
    rows = list(csv.DictReader((tmp_path / "out" / "cases.csv").read_text().splitlines()))
    assert {row["berg"]: (row["held_out"], row["tuned"]) for row in rows} == {
        "A38B": ("1", "0"), "B15A": ("0", "0"), "A68A": ("0", "1"),
    }  # fmt: skip
    assert {"west", "east", "south", "north", "first", "last"} <= set(rows[0])
    with (tmp_path / "made.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["Berg", " START", *tracks.COLUMNS[2:]])  # names count without case and blanks
        for row in rows:
            for east in (-0.1, 0.1):
                table.writerow([row["berg"].lower(), row["start"], row["lead_days"], float(row["start_lon"]) + east,
                                float(row["start_lat"]) + 10.0 / 111.19 * int(row["lead_days"])])  # fmt: skip
    result = json.loads(said(folder, "--model", "own_drift:northward", "--forecasts", "made.csv", "--json"))
    assert result["errors"]["own_drift:northward"][3]["median_km"] == pytest.approx(0.0, abs=0.1)
    assert result["errors"]["made.csv"][3]["median_km"] == pytest.approx(0.0, abs=0.1)
    assert set(result["ensembles"]) == {
        "staying put, dressed", "constant velocity, dressed", "own_drift:northward, dressed", "made.csv"
    }  # fmt: skip
    assert result["tuned"]["staying put"] == {"bergs": ["A68A"], "starts": 20}
    assert "A68A (20 rows): an ocean of Riftberg was fitted" in said(folder)
    assert "fitted" not in said(folder, "--bergs", "held-out")


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "no such folder"),
        (["."], "no table with positions of scatterometers"),
        (["tracks", "--leads", "soon"], "'soon' are no days"),
        (["tracks", "--leads", "0"], "lead times [0]"),
        (["tracks", "--bergs", "some"], "'some' is not known"),
        (["tracks", "--error", "nan"], "nan is not possible"),
        (["tracks", "--error", "101"], "101 is not possible"),
        (["tracks", "--model", "nothing"], "'nothing' names no function"),
        (["tracks", "--model", "no_module_here:f"], "No module named"),
        (["tracks", "--model", "typing_error:f"], "SyntaxError"),
        (["tracks", "--model", "leaves:f"], "SystemExit: 3"),
        (["tracks", "--model", "divides:f"], "A38B, 2003-01-04: the model fails: ZeroDivisionError"),
        (["tracks", "--forecasts", "short.csv"], "no forecast. Forecast every row"),
        (["tracks", "--forecasts", "other.csv"], "no column 'berg'"),
        (["tracks", "--between", "1999-01-01,1999-02-01"], "no case"),
        (["torn"], "torn.csv, line 2: qscat: no number"),
    ],
)
def test_bad_input_is_one_clear_sentence(words, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    three_bergs(tmp_path)
    (tmp_path / "short.csv").write_text("berg,start,lead_days,lon,lat\nA38B,2003-01-04,1,-40,-55\n")
    for name, text in (
        ("typing_error", "def f(start, dates)\n"), ("leaves", "raise SystemExit(3)\n"),
        ("divides", "def f(start, dates):\n    return 1 / 0\n"),
    ):  # fmt: skip
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    (tmp_path / "other.csv").write_text("name,date\nA38B,2003-01-04\n")
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn" / "torn.csv").write_text("qscat_1,qscat_2,qscat_3,date\nx,2,1,2003001\n")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    text = said(*words, "-o", "out")
    assert text.startswith("exit 2")
    assert message in " ".join(text.split())
    assert sorted(tmp_path.rglob("*")) == before


def test_a_model_that_returns_nonsense_is_named(tmp_path: Path) -> None:
    case = tracks.read_cases(three_bergs(tmp_path))[0]
    with pytest.raises(InputError, match=r"A38B, 2003-01-04: the model returns an array of shape \(3,\)"):
        tracks.forecast(lambda start, dates: [1.0, 2.0, 3.0], case)
    with pytest.raises(InputError, match="the model returns"):
        tracks.forecast(lambda start, dates: np.full((len(dates), 2), np.nan), case)


def test_products_must_cover_a_case_to_its_last_lead(tmp_path: Path) -> None:
    write_track(tmp_path, "x01", straight(12))
    case = tracks.read_cases(tmp_path)[0]
    assert case.dates == (case.start.date, case.start.date + timedelta(days=7))
