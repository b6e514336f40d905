"""The benchmark on tracks: which starts count, the baselines, models from outside, and forecasts of other programs."""

from __future__ import annotations

import csv
import json
import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from riftberg.cli.main import app
from verify.sphere import displace, distance, unit_vector

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


def said(*words: object) -> str:
    done = CliRunner().invoke(app, ["verify-tracks", *map(str, words)], env={"COLUMNS": "200"})
    return done.output if done.exit_code == 0 else f"exit {done.exit_code}: {done.stderr}"


def score(folder: Path, *words: object) -> dict[str, Any]:
    """Score drift models on the tracks of a folder; errors of members are added nowhere."""
    text = said(folder, "--error", 0, "--json", *words)
    return json.loads(text.partition("Written:")[0])


def read_cases(folder: Path) -> list[dict[str, str]]:
    """Return the rows of ``cases.csv``: one for each start and lead time."""
    score(folder, "-o", folder.parent / "cases")
    return list(csv.DictReader((folder.parent / "cases" / "cases.csv").read_text().splitlines()))


def read_starts(folder: Path) -> list[tuple[str, datetime]]:
    """Return berg and date of each start, once."""
    return list(dict.fromkeys((row["berg"], datetime.fromisoformat(row["start"])) for row in read_cases(folder)))


def median(rows: list[dict[str, Any]]) -> list[float]:
    return [row["median_km"] for row in rows]


def test_a_straight_track_is_what_constant_velocity_forecasts(tmp_path: Path) -> None:
    write_track(tmp_path / "t", "x01", straight(12))
    cases = read_cases(tmp_path / "t")
    assert read_starts(tmp_path / "t") == [("X01", FIRST + timedelta(days=k)) for k in range(3, 11)]
    leads = [[int(row["lead_days"]) for row in cases if row["start"] == day] for day in ("2003-01-04", "2003-01-11")]
    assert leads == [[1, 3, 5, 7], [1]]
    assert {(row["first"], row["last"]) for row in cases[:4]} == {("2003-01-04", "2003-01-11")}  # for its products
    errors = score(tmp_path / "t")["errors"]
    assert median(errors["constant velocity"]) == pytest.approx([0.0] * 4, abs=1e-6)
    assert median(errors["staying put"]) == pytest.approx([10.0, 30.0, 50.0, 70.0], rel=1e-3)
    assert errors["staying put"][0]["low_km"] is None  # one berg says nothing of others


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
    write_track(tmp_path / "t", "x01", places, flags=flags)
    write_track(tmp_path / "t", "y01", straight(5))
    write_track(tmp_path / "t", "z01", straight(5), sensor="nic")  # weekly positions of charts are not taken
    assert [berg for berg, _ in read_starts(tmp_path / "t")] == ["X01"] * starts + ["Y01"]


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
    write_track(tmp_path / "t", "x01", [*before, *after])
    first = FIRST + timedelta(days=len(before))
    starts = [date for _, date in read_starts(tmp_path / "t") if date >= first]
    assert starts == [first + timedelta(days=k) for k in range(3, 7)]


def test_two_wrong_positions_in_a_row_do_not_undo_the_track_before(tmp_path: Path) -> None:
    track = straight(12)
    write_track(tmp_path / "t", "x01", [*track[:5], FAR, FAR, *track[7:]])
    cases = read_cases(tmp_path / "t")
    assert cases[0]["start"] == "2003-01-04"
    assert {float(row["start_lon"]) for row in cases} == {-40.0}
    assert max(median(score(tmp_path / "t")["errors"]["staying put"])) < 71.0  # nor is it seen there


def test_across_the_date_line_nothing_changes(tmp_path: Path) -> None:
    write_track(tmp_path / "t", "x01", [((179.6 + 0.16 * k + 180.0) % 360.0 - 180.0, -56.0) for k in range(11)])
    (first, *_) = read_cases(tmp_path / "t")
    west, east, south, north = (float(first[side]) for side in ("west", "east", "south", "north"))
    assert west < -187.0 < -173.0 < east
    assert south < -59.7 < -52.3 < north
    errors = score(tmp_path / "t", "--between", "2003-01-04,2003-01-11")["errors"]
    # The berg keeps to its parallel, the forecast to the great circle through the first and the fourth position.
    a, b = unit_vector(179.6, -56.0), unit_vector(-179.92, -56.0)
    turn = np.arccos(a @ b)
    x, y, z = (b * np.sin(10 / 3 * turn) - a * np.sin(7 / 3 * turn)) / np.sin(turn)
    off = distance(-178.8, -56.0, np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z)))
    assert 0.5 < off < 1.0
    assert errors["constant velocity"][3]["median_km"] == pytest.approx(off, rel=1e-3)


def test_a_model_knows_the_motion_before_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Across the date line too: three days of 9.95 km eastward."""
    write_track(tmp_path / "t", "x01", [((179.6 + 0.16 * k + 180.0) % 360.0 - 180.0, -56.0) for k in range(8)])
    (tmp_path / "curious.py").write_text(
        "import json\nimport numpy as np\n\n\ndef ask(start, dates):\n"
        "    told = [str(start.date), list(start.heading), sorted(map(str, start.before))]\n"
        "    with open('told.json', 'a') as file:\n        file.write(json.dumps(told) + '\\n')\n"
        "    return np.tile([start.lon, start.lat], (len(dates), 1))\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    score(tmp_path / "t", "--model", "curious:ask")
    rows = [json.loads(line) for line in (tmp_path / "told.json").read_text().splitlines()]
    assert {row[0][:10] for row in rows} == {f"2003-01-{day:02d}" for day in (4, 5, 6, 7)}
    for date, heading, before in rows:
        assert heading == pytest.approx((29.8, 0.0), abs=0.2)
        assert len(before) == 3
        assert max(before) < date


def test_dressed_forecasts_have_the_errors_of_other_bergs(tmp_path: Path) -> None:
    """Training bergs go north and turn 5 km a day to the left; the other goes east and turns to its left, which is north."""
    lead = np.arange(1.0, 8.0)
    for k in range(3):
        places = straight(4, lon=-40.0 + k)
        write_track(
            tmp_path / "t", f"x0{k}", [*places, *zip(*displace(*places[-1], -5.0 * lead, 10.0 * lead), strict=True)]
        )
    east = [displace(-40.0, -56.0, 10.0 * k, 0.0) for k in range(-3, 1)]
    write_track(tmp_path / "t", "a38", [*east, *zip(*displace(-40.0, -56.0, 10.0 * lead, 5.0 * lead), strict=True)])
    for days in (1, 3, 5, 7):  # of the first start alone
        words = "--leads", days, "--between", f"2003-01-04,2003-01-{4 + days:02d}", "--bergs", "held-out"
        result = score(tmp_path / "t", *words)
        assert median(result["errors"]["constant velocity"]) == pytest.approx([5.0 * days], rel=0.01)
        (row,) = result["ensembles"]["constant velocity, dressed"]["without"]
        assert row["error_of_mean_km"] < 0.1 * days
        assert row["energy_km"] < 0.1 * days  # all members have the one error there is


def test_noise_alone_lowers_the_score_of_a_bare_forecast(tmp_path: Path) -> None:
    """So baselines must be dressed to be fair opponents of an ensemble."""
    random = np.random.default_rng(2)
    for k in range(8):
        write_track(
            tmp_path / "t",
            f"{'x' if k < 4 else 'a38'}{'abcdefgh'[k]}",
            np.array([-40.0, -56.0]) + np.cumsum(random.normal([0.05, 0.05], 0.08, (40, 2)), axis=0),
        )
    result = score(tmp_path / "t", "--bergs", "held-out")
    bare = result["errors"]["staying put"]
    scored = result["ensembles"]["staying put, dressed"]["without"]
    assert all(row["energy_km"] < 0.85 * single["median_km"] for row, single in zip(scored, bare, strict=True))


@pytest.mark.slow
def test_the_baselines_are_those_of_the_published_tables(shared: Path, tmp_path: Path) -> None:
    """Within a kilometre, with intervals from drawing bergs; computed independently from the same tables and rules."""
    errors = score(shared / "data" / "tracks", "-o", tmp_path / "out")["errors"]
    still, steady = errors["staying put"], errors["constant velocity"]
    assert median(still) == pytest.approx([12.0, 34.0, 55.0, 72.0], abs=1.0)
    assert median(steady) == pytest.approx([11.0, 29.0, 52.0, 76.0], abs=1.0)
    for row, interval in ((still[-1], (62.0, 82.0)), (steady[-1], (69.0, 86.0))):
        assert (row["low_km"], row["high_km"]) == pytest.approx(interval, abs=1.5)
    assert 2700 < still[-1]["starts"] < 2900
    rows = csv.DictReader((tmp_path / "out" / "cases.csv").read_text().splitlines())
    pieces = {row["berg"] for row in rows if row["held_out"] == "1"}
    assert {re.sub(r"(?<=\d)[A-Z]+$", "", berg) for berg in pieces} == {"A38", "B17", "C19"}


def three_bergs(folder: Path) -> Path:
    for name, lon in (("a38b", -40.0), ("b15a", -35.0), ("a68a", -30.0)):
        write_track(folder / "tracks", name, straight(12, lon=lon))
    return folder / "tracks"


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
        table.writerow(["Berg", " START", "lead_days", "lon", "lat"])  # names count without case and blanks
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


@pytest.mark.quick(6)
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
        (["tracks", "--model", "one_row:f"], "A38B, 2003-01-04: the model returns an array of shape (3,)"),
        (["tracks", "--model", "lost:f"], "A38B, 2003-01-04: the model returns"),
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
        ("one_row", "def f(start, dates):\n    return [1.0, 2.0, 3.0]\n"),
        ("lost", "def f(start, dates):\n    return [[float('nan')] * 2] * len(dates)\n"),
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
