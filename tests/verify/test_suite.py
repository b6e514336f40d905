"""The table of a suite: cases, entrants, paired differences, subsets; observed bergs where the data are."""

from __future__ import annotations

import csv
import importlib.util
import json
import random
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from riftberg.cli.main import app
from riftberg.errors import InputError
from riftberg.ocean import files_forcing
from riftberg.verification.suite import read_suite, tables

FIRST = datetime(2025, 10, 1)
BERGS = {f"X{k:02d}": 0.02 + 0.04 * k for k in range(6)}  # Eastward current, m/s
METRE = 1e-3 / 6371.0 * 180.0 / np.pi

CASE = """sentence: Six made bergs.
source: made here
licence: none needed
leads: [1, 48 h]
forcing: {along: forcing.csv}
"""


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([columns, *rows])


def at(berg: str, days: float, lon: float = 179.9) -> tuple[float, float]:
    """Return where the water takes a berg, across the date line."""
    east = METRE * 86400.0 * days * BERGS[berg] / np.cos(np.radians(-60.0))
    return (lon + east + 180.0) % 360.0 - 180.0, -60.0


def write_suite(
    folder: Path, case: str = CASE, *, depth: Callable[[str], Any] | None = None, hours: int = 49, order: int = 0
) -> Path:
    """Write a suite of one case: bergs that go with the water, two starts each."""
    folder = folder / "suite" / "made"
    folder.mkdir(parents=True)
    days = [-1.0, 0.0, 1.0, 2.0, 3.0]
    write_table(folder / "observed.csv", ("berg", "date", "lon", "lat"),
                [(b, FIRST + timedelta(days=d), *at(b, d)) for b in BERGS for d in days])  # fmt: skip
    rows = []
    for berg in BERGS:
        for day in (0.0, 1.0):
            date = FIRST + timedelta(days=day, seconds=31)
            before = [] if berg == "X05" else [date - timedelta(days=1), *at(berg, day - 1.0)]
            rows.append([berg, date, *at(berg, day), 800.0, 800.0, 200.0, *(before or [""] * 3), 100.0 * int(berg[1:]),
                         *([depth(berg)] if depth else [])])  # fmt: skip
    random.Random(order).shuffle(rows) if order else None
    names = (
        "berg",
        "date",
        "lon",
        "lat",
        "length",
        "width",
        "thickness",
        "date_before",
        "lon_before",
        "lat_before",
        "sea",
    )
    write_table(folder / "starts.csv", (*names, *(["depth"] if depth else [])), rows)
    write_table(folder / "forcing.csv", ("berg", "start", "time", "uo", "vo"),
                [(row[0], row[1], 3600 * h, BERGS[row[0]], 0.0) for row in rows for h in range(hours)])  # fmt: skip
    (folder / "case.yaml").write_text(case)
    return folder.parent


def table(folder: Path, *entrants: str, **options: Any) -> dict[str, Any]:
    (result,) = tables(read_suite(folder), entrants, **options)
    return result


def row(result: dict[str, Any], lead: float, subset: str = "all") -> dict[str, Any]:
    (found,) = (one for one in result["rows"] if (one["lead_days"], one["subset"]) == (lead, subset))
    return found


def test_the_means_are_those_of_the_ways_of_the_water(tmp_path: Path) -> None:
    result = table(
        write_suite(tmp_path), "staying put", "current", "current x 0.5", "constant velocity", reference="current"
    )
    mean = 86.4 * float(
        np.mean([speed for berg, speed in BERGS.items() if berg != "X05"])
    )  # that one has no earlier position
    for lead in (1.0, 2.0):
        one = row(result, lead)
        assert (one["starts"], one["bergs"]) == (10, 5)
        assert one["entrants"]["staying put"]["mean_km"] == pytest.approx(lead * mean, rel=2e-3)
        assert one["entrants"]["current x 0.5"]["mean_km"] == pytest.approx(0.5 * lead * mean, rel=2e-3)
        assert one["entrants"]["current"]["mean_km"] == pytest.approx(0.0, abs=0.02)
        assert one["entrants"]["constant velocity"]["mean_km"] == pytest.approx(0.0, abs=0.2)
        assert one["entrants"]["staying put"]["reference_minus_this_km"] == pytest.approx(-lead * mean, rel=2e-3)
        assert one["entrants"]["staying put"]["reference_is"] == "better"
        low, high = one["entrants"]["staying put"]["difference_interval_km"]
        assert low < -lead * mean < high < 0.0


def test_means_are_over_the_starts_that_all_answer(tmp_path: Path) -> None:
    folder = write_suite(tmp_path, CASE + "entrants: {theirs: forecasts theirs.csv}\n")
    theirs = [(b, FIRST, 1.0, *at(b, 1.5)) for b in ("X01", "X04")]  # dates differ by 31 s from those of starts.csv
    write_table(folder / "made" / "theirs.csv", ("berg", "start", "lead_days", "lon", "lat"), theirs)
    one = row(table(folder, "staying put", "theirs", reference="staying put"), 1.0)
    assert (one["starts"], one["bergs"]) == (2, 2)
    assert one["entrants"]["theirs"]["mean_km"] == pytest.approx(0.5 * 86.4 * 0.12, rel=2e-3)
    assert one["entrants"]["theirs"]["difference_interval_km"] is None  # two bergs say nothing of others
    assert row(table(folder, "staying put", "theirs"), 2.0)["starts"] == 0


def test_the_interval_does_not_depend_on_the_order_of_the_starts(tmp_path: Path) -> None:
    results = [
        table(write_suite(tmp_path / str(k), order=k), "staying put", "current", reference="current") for k in range(3)
    ]
    assert results[0]["rows"] == results[1]["rows"] == results[2]["rows"]


def test_riftberg_runs_all_starts_at_once_each_with_its_own_water_and_floor(tmp_path: Path) -> None:
    aground = write_suite(tmp_path / "a", depth=lambda berg: 120.0 if berg == "X03" else "")
    result = table(aground, "riftberg drag.ocean_scale=10000", "staying put")
    assert row(result, 2.0)["entrants"]["riftberg drag.ocean_scale=10000"]["mean_km"] == pytest.approx(
        2.0 * 86.4 * 0.14 / 6.0, abs=0.5
    )
    afloat = write_suite(tmp_path / "b")
    assert row(table(afloat, "riftberg", "staying put"), 2.0)["entrants"]["riftberg"]["mean_km"] < 2.0
    still = "riftberg forcing.sea_level=none drag.ocean_scale=0"  # no water moves it
    standing = row(table(afloat, still, "staying put", reference="staying put"), 2.0)["entrants"][still]
    assert standing["reference_minus_this_km"] == pytest.approx(0.0, abs=1e-6)


def test_subsets_are_known_before_the_start(tmp_path: Path) -> None:
    more = "subsets: {deep: sea >= 300, fast: speed > 8, one: berg == X02}\nheld_out: [X01, X02]\n"
    result = table(write_suite(tmp_path, CASE + more), "staying put")
    counts = {name: row(result, 1.0, name)["starts"] for name in ("all", "open", "held out", "deep", "fast", "one")}
    assert counts == {"all": 12, "open": 8, "held out": 4, "deep": 6, "fast": 6, "one": 2}


def test_a_model_of_ones_own_takes_start_and_dates_and_the_forcing_if_it_asks(tmp_path: Path) -> None:
    suite = read_suite(write_suite(tmp_path))

    def plain(start: Any, dates: Sequence[datetime]) -> Any:
        return [at(start.berg, (when - FIRST) / timedelta(days=1)) for when in dates]

    def driven(start: Any, dates: Sequence[datetime], forcing: Any) -> Any:
        u, _ = forcing.currents(np.zeros(1), np.zeros(1), 0.0)
        assert u[0] == BERGS[start.berg]
        return np.tile([start.lon, start.lat], (len(dates), 1))

    (result,) = tables(suite, ["staying put"], models={"plain": plain, "driven": driven}, reference="plain")
    one = row(result, 2.0)["entrants"]
    assert one["plain"]["mean_km"] == pytest.approx(0.0, abs=0.01)
    assert one["driven"] == one["staying put"]


WRONG: list[tuple[str, str, str]] = [
    ("leads: [1, 48 h]\n", "", "leads: this key is missing"),
    ("licence: none needed\n", "", "licence: this key is missing"),
    ("leads: [1, 48 h]", "leads: []", "line 4, leads"),
    ("leads: [1, 48 h]", "leads: [1, 24 h]", "lead times rise"),
    ("leads: [1, 48 h]", "leads: [soon]", "leads"),
    ("leads: [1, 48 h]", "leads: [20]", "no start was seen again at a lead"),
    ("forcing:", "held_out: [X1]\nforcing:", "no berg 'X1' starts. Did you mean 'X01'"),
    ("forcing.csv", "nothing.csv", "no such file"),
    ("made bergs.", "made bergs.\nsubsets: {deep: floor > 3}", "'floor > 3' compares no column"),
    ("made bergs.", "made bergs.\nunit: month", "unit"),
    ("along: forcing.csv", "along: forcing.csv, files: [a.nc]", "forcing.files: there is no such key"),
    ("made bergs.", "made bergs.\nsubsets: {all: sea > 0}", "subsets: 'all' is a subset of every case"),
    ("made bergs.", "made bergs.\nsubsets: {one: berg == X7}", "subsets.one: no berg 'X7' starts. Bergs are X00, X01"),
]


@pytest.mark.parametrize(("text", "other", "said"), WRONG)
def test_a_case_that_lacks_what_it_must_say_is_refused(text: str, other: str, said: str, tmp_path: Path) -> None:
    folder = write_suite(tmp_path, CASE.replace(text, other))
    with pytest.raises(InputError) as refused:
        table(folder, "staying put")
    assert said in str(refused.value)


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    short = write_suite(tmp_path / "a", hours=40)
    with pytest.raises(
        InputError, match=r"forcing of X00, 2025-10-01.* ends after 1.625 days, before the lead of 2.*forcing.hold"
    ):
        read_suite(short)
    with pytest.raises(InputError, match="no case"):
        read_suite(tmp_path)
    folder = write_suite(tmp_path / "b")
    with pytest.raises(InputError, match=r"no entrant 'curent'. Did you mean 'current'"):
        table(folder, "curent")
    with pytest.raises(InputError, match="no group of parameters"):
        table(folder, "riftberg drg.ocean_scale=3")
    with pytest.raises(InputError, match=r"forcing\.sea_level.*level"):
        table(folder, "riftberg forcing.sea_level=level")
    starts = folder / "made" / "starts.csv"
    table_of_starts = starts.read_text()
    for text, other, said in (
        (",-60.0,800", ",-95.0,800", "lat = '-95.0' is not possible"), (",200.0,", ",-200.0,", "thickness = '-200.0'"),
        (",800.0,800.0", ",800.0,0", "width = '0'"), (",800.0,800.0", ",wide,800.0", "length = 'wide'"),
        ("lon_before", "west", r"2025-09-30 .* and \(nan, .* are no earlier date and position"),
        ("2025-09-30", "2025-12-30", "2025-12-30 .* are no earlier date"),
    ):  # fmt: skip
        starts.write_text(table_of_starts.replace(text, other))
        with pytest.raises(InputError, match=f"starts.csv, line 2: {said}"):
            read_suite(folder)
    starts.write_text(table_of_starts + table_of_starts.splitlines()[3])
    with pytest.raises(InputError, match=r"line 14: X01, 2025-10-01.* starts in line 4 too"):
        read_suite(folder)
    starts.write_text(table_of_starts.replace("X05", "X06"))
    with pytest.raises(InputError, match="no forcing for X06, 2025-10-01"):
        read_suite(folder)


def test_the_command_writes_numbers_page_picture_and_starts(tmp_path: Path) -> None:
    folder, out = write_suite(tmp_path, CASE + "hindcast: true\n"), tmp_path / "out"
    wanted = ["--entrants", "staying put, current, half: current x 0.5", "--reference", "half"]
    result = CliRunner().invoke(app, ["verify-tracks", "--suite", str(folder), *wanted, "-o", str(out)])
    assert result.exit_code == 0, result.output
    assert "it tells a model where the berg went" in result.output
    page = (out / "suite.md").read_text()
    assert "| half |" in page
    assert "Licence: none needed" in page
    assert json.loads((out / "suite.json").read_text())["cases"][0]["reference"] == "half"
    with (out / "cases.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 24
    assert {row["case"] for row in rows} == {"made"}
    assert (out / "suite.png").stat().st_size > 10_000
    both = CliRunner().invoke(app, ["verify-tracks", str(folder), "--suite", str(folder)])
    assert both.exit_code != 0
    assert "TRACKS, or --suite" in both.output


def test_files_of_a_case_are_opened_once_for_all_starts_and_entrants(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each start of each entrant opened them anew."""
    folder = write_suite(
        tmp_path, CASE.replace("forcing: {along: forcing.csv}", "forcing: {kind: files, files: [sea.nc]}")
    )
    times = np.datetime64("2025-09-30", "ns") + np.arange(0, 170, 24) * np.timedelta64(3600 * 10**9, "ns")
    axes = {"time": times, "lat": np.linspace(-63.0, -57.0, 13), "lon": np.linspace(174.0, 186.0, 25)}
    sea = xr.Dataset(coords={"time": times, "lat": ("lat", axes["lat"], {"units": "degrees_north"}),
                             "lon": ("lon", axes["lon"], {"units": "degrees_east"})})  # fmt: skip
    for name, way in (("uo", "eastward"), ("vo", "northward")):
        values = np.full([array.size for array in axes.values()], 0.1 * (name == "uo"))
        sea[name] = tuple(axes), values, {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"}
    sea.to_netcdf(folder / "made" / "sea.nc")
    opened, real = [], files_forcing.open_named

    def counted(*args: Any) -> Any:
        opened.append(args)
        return real(*args)

    monkeypatch.setattr(files_forcing, "open_named", counted)
    result = table(folder, "staying put", "current", "riftberg", "riftberg forcing.sea_level=none")
    assert len(opened) == 1
    assert row(result, 1.0)["starts"] == 12


# ---- observed bergs ---------------------------------------------------------------------------------------------------------

JULIETTE = {  # As measured, with the slope and the pack as they were then
    "staying put": (17.1, 28.6, 37.5), "constant velocity": (10.3, 22.5, 28.7), "current": (11.7, 19.1, 25.2),
    "current x 0.29": (15.4, 25.3, 33.3), "OpenBerg 1.14.9": (10.1, 18.7, 23.3), "then": (8.9, 16.2, 20.9),
    "then forcing.sea_level=none": (13.4, 23.1, 30.0), "then grounding.law=none": (11.3, 18.9, 26.9),
}  # fmt: skip
GIANTS = {
    "staying put": (15.4, 22.3, 32.5, 49.4, 59.7), "constant velocity": (17.8, 26.0, 36.8, 64.4, 94.0),
    "current": (22.5, 37.3, 51.5, 78.0, 102.4), "current x 0.29": (15.1, 22.1, 30.9, 45.3, 52.2),
    "riftberg": (23.1, 38.6, 53.4, 80.4, 105.3), "riftberg forcing.sea_level=none": (15.8, 22.9, 32.8, 49.5, 60.1),
}  # fmt: skip


@pytest.fixture(scope="module")
def observed(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the script that writes the suite, and the data."""
    file = Path(__file__).resolve().parents[2] / "benchmarks" / "skill.py"
    spec = importlib.util.spec_from_file_location("skill", file)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script, shared / "data" / "skill", tmp_path_factory.mktemp("skill")


@pytest.mark.compiled
def test_a_tagged_berg_is_as_far_off_as_measured(observed: Any) -> None:
    script, data, folder = observed
    script.juliette(data, folder / "a" / "juliette", "topaz4", 1000.0)
    then = "riftberg forcing.along=former.csv sea_ice.capture=none drag.water_base=0.0012 drag.air_top=0.0055"
    result = table(
        folder / "a", *(f"{name}: {name.replace('then', then)}" if "then" in name else name for name in JULIETTE)
    )
    for k, lead in enumerate(result["leads_days"]):
        one = row(result, lead)
        assert one["starts"] == (14, 14, 11)[k]
        for name, errors in JULIETTE.items():
            assert one["entrants"][name]["mean_km"] == pytest.approx(errors[k], abs=0.25), (name, lead)


@pytest.mark.slow
@pytest.mark.compiled
def test_giant_bergs_along_their_tracks_are_as_far_off_as_measured(observed: Any) -> None:
    script, data, folder = observed
    script.sih2026(data, folder / "b" / "sih2026")
    result = table(folder / "b", *GIANTS)
    for k, lead in enumerate(result["leads_days"]):
        one = row(result, lead)
        assert (one["starts"], one["bergs"]) == ((156, 141, 142, 131, 111)[k], 10)
        for name, errors in GIANTS.items():
            assert one["entrants"][name]["mean_km"] == pytest.approx(errors[k], abs=0.3), (name, lead)
    paired = row(result, 6.0)["entrants"]["staying put"]
    assert paired["reference_minus_this_km"] == pytest.approx(20.9, abs=0.3)
    assert paired["difference_interval_km"] == pytest.approx((0.7, 43.2), abs=0.6)


@pytest.mark.slow
def test_giant_bergs_in_a_day_of_altimetry_are_as_far_off_as_measured(observed: Any) -> None:
    script, data, folder = observed
    script.b09f(data, folder / "c" / "b09f")
    result = table(folder / "c", "riftberg", "current", "staying put")
    measured = {"riftberg": (7.7, 9.0, 15.2, 21.3, 9.4), "current": (8.0, 10.1, 15.0, 14.2, 19.0)}
    for name, errors in measured.items():
        found = [row(result, lead, "B09F")["entrants"][name]["mean_km"] for lead in result["leads_days"]]
        assert found == pytest.approx(errors, abs=0.3)


def test_a_point_that_goes_with_the_water_takes_the_current_in_the_middle_of_its_steps(tmp_path: Path) -> None:
    """In a current that grows evenly, by 0.1 m/s a day, the way is half of speed times time, to the digit."""
    folder = write_suite(tmp_path) / "made"
    header, *starts = csv.reader((folder / "starts.csv").read_text().splitlines())
    starts = [start for start in starts if start[1].startswith("2025-10-01")]
    write_table(folder / "starts.csv", header, starts)
    write_table(folder / "forcing.csv", ("berg", "start", "time", "uo", "vo"),
                [(*start[:2], 3600 * hour, 0.0, 0.1 * hour / 24.0) for start in starts for hour in range(49)])  # fmt: skip
    way = {days: 0.5 * 0.1 * days**2 * 86400.0 for days in (1, 2)}
    write_table(folder / "observed.csv", ("berg", "date", "lon", "lat"),
                [(start[0], FIRST + timedelta(days=days), start[2], -60.0 + METRE * way[days])
                 for start in starts for days in way])  # fmt: skip
    result = table(folder.parent, "current", "current x 0.5")
    for days in way:
        entrants = row(result, days)["entrants"]
        assert entrants["current"]["mean_km"] == pytest.approx(0.0, abs=1e-4)
        assert entrants["current x 0.5"]["mean_km"] == pytest.approx(0.5e-3 * way[days], abs=1e-4)


def test_a_start_at_no_position_is_refused_and_an_earlier_one_there_is_unknown(tmp_path: Path) -> None:
    """Latitude 0, longitude 0 was where a berg had been the day before: 'constant velocity' came from the equator."""
    suite = write_suite(tmp_path)
    path = suite / "made" / "starts.csv"
    rows = list(csv.reader(path.read_text().splitlines()))
    column = {name: k for k, name in enumerate(rows[0])}
    unseen = next(line[0] for line in rows[1:] if line[column["date_before"]])
    for line in rows[1:]:
        if line[0] == unseen:
            line[column["lon_before"]] = line[column["lat_before"]] = "0"
    write_table(path, rows[0], rows[1:])
    one = row(table(suite, "staying put", "constant velocity"), 1.0)
    assert one["bergs"] == 4
    assert one["entrants"]["constant velocity"]["mean_km"] == pytest.approx(0.0, abs=0.2)
    rows[2][column["lon"]] = rows[2][column["lat"]] = "0"
    write_table(path, rows[0], rows[1:])
    with pytest.raises(InputError, match=r"starts.csv, line 3: latitude 0, longitude 0 are no position"):
        table(suite, "staying put")
