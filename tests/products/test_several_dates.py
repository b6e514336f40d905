"""Several dates along the records: names and attributes decide which of them the values hold at, the run says which it took."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from products.test_dates_and_neighbours import dated, day, growing
from products.test_odd_files import CENTRE, elements, refused, truth, written
from riftberg.errors import ForcingError
from riftberg.ocean.files_forcing import Run, forcing_from_files
from riftberg.ocean.files_schema import FileForcing

HOURS = 12.0 * np.arange(7)
SINCE = {"units": "hours since 2020-12-16"}


def with_dates(folder: Path, dates: dict[str, tuple[float, dict[str, Any]]], dim: str = "record") -> Path:
    """A field that grows by the day, with its dates each so many hours from the true ones, in this order in the file."""
    ds = growing(HOURS / 24.0).rename(time=dim)
    for name, (hours, said) in dates.items():
        ds[name] = dim, HOURS + hours, {**SINCE, **said}
    return written(folder, ds)


def taken(path: Path, **names: str) -> tuple[float, str]:
    """Return by how many hours the dates are wrong, and what the run says."""
    box = {"longitude": (CENTRE - 2.0, CENTRE + 2.0), "latitude": (-57.5, -53.5), "hold": 48.0}
    asked, e = FileForcing(kind="files", files=[{"file": path.name, "names": names}], **box), elements()
    forcing = forcing_from_files(asked, path.parent, Run.of(day(1.5), 0.0, e.thickness, 850.0))
    forcing.sample(e, 0.0)
    grown = float((e.uo - truth("uo", e.lon, e.lat)).mean())
    return round(240.0 * (0.15 - grown), 2), "\n".join(forcing.notices)


REFERENCE = {"standard_name": "forecast_reference_time"}


@pytest.mark.quick(3)
@pytest.mark.parametrize(
    ("dates", "right", "other"),
    [
        ({"reftime": (-6.0, {"long_name": "reference time"}), "valtime": (0.0, {})}, "valtime", "reftime"),
        ({"a_time": (-6.0, {"long_name": "time of issue"}), "b_time": (0.0, {})}, "b_time", "a_time"),
        ({"runtime": (-6.0, {}), "date": (0.0, {"long_name": "hours since start of run"})}, "date", "runtime"),
        ({"dates": (-6.0, REFERENCE), "times": (0.0, {"standard_name": "time"})}, "times", "dates"),
        ({"date": (-6.0, {}), "verification_time": (0.0, {})}, "verification_time", "date"),
        ({"date": (3.0, {}), "times": (0.0, {"axis": "T"})}, "times", "date"),
        ({"base_date": (-6.0, {"standard_name": "time"}), "t": (0.0, {"standard_name": "time"})}, "t", "base_date"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("first", [True, False])
def test_the_date_of_validity_is_taken_and_told(
    tmp_path: Path, dates: dict[str, tuple[float, dict[str, Any]]], right: str, other: str, first: bool
) -> None:
    path = with_dates(tmp_path, dates if first else dict(reversed(dates.items())))
    wrong, said = taken(path)
    assert wrong == 0.0
    assert f"the dates of the records are those of {right}, not of {other}" in said


def test_a_dimension_of_valid_dates_beats_its_neighbours(tmp_path: Path) -> None:
    path = with_dates(tmp_path, {"file_date": (99.0, {}), "time": (0.0, {})}, dim="time")
    assert taken(path)[0] == 0.0


def test_the_lead_tells_which_of_two_is_valid(tmp_path: Path) -> None:
    """Neither name nor attribute says it, but one lies ahead of the other by the length of the forecast."""
    ds = growing(HOURS / 24.0).rename(time="record")
    ds["date_a"] = "record", HOURS - np.arange(7), SINCE
    ds["date_b"] = "record", HOURS, SINCE
    ds["lead"] = "record", np.arange(7.0), {"standard_name": "forecast_period", "units": "hours"}
    wrong, said = taken(written(tmp_path, ds))
    assert wrong == 0.0
    assert "those of date_b, not of date_a" in said


@pytest.mark.parametrize("lead", ["scalar", "along the records", "of one step"])
def test_issue_and_lead_make_the_date(tmp_path: Path, lead: str) -> None:
    ds = growing(HOURS / 24.0).rename(time="issued")
    ahead = 60.0 * (np.full(7, 6.0) if lead != "along the records" else 3.0 * np.arange(7))
    ds = ds.assign_coords(issued=("issued", HOURS - ahead / 60.0, {**SINCE, **REFERENCE}))
    told = {"units": "minutes"}
    if lead == "of one step":
        ds = ds.expand_dims(step=1).assign_coords(step=("step", ahead[:1], told))
    else:
        ds = ds.assign_coords(step=((), ahead[0], told) if lead == "scalar" else ("issued", ahead, told))
    assert taken(written(tmp_path, ds))[0] == 0.0


def test_issue_alone_is_told(tmp_path: Path) -> None:
    ds = growing(HOURS / 24.0).rename(time="issued")
    _, said = taken(written(tmp_path, ds.assign_coords(issued=("issued", HOURS, {**SINCE, **REFERENCE}))))
    assert "those of issued, and nothing says how far ahead they hold" in said


@pytest.mark.quick(2)
@pytest.mark.parametrize("names", [("start_date", "end_date"), ("begin", "stop"), ("average_T1", "average_T2")])
@pytest.mark.parametrize("beside", ["", "start", "middle"])
def test_start_and_end_are_bounds_of_means(tmp_path: Path, names: tuple[str, str], beside: str) -> None:
    dates: dict[str, tuple[float, dict[str, Any]]] = {names[0]: (-6.0, {}), names[1]: (6.0, {})}
    if beside:
        dates["time"] = -6.0 if beside == "start" else 0.0, {"standard_name": "time"}
    wrong, said = taken(with_dates(tmp_path, dates, dim="time" if beside else "record"))
    assert wrong == 0.0
    assert f"the records are means from {names[0]} to {names[1]}, and hold in the middle" in said


@pytest.mark.parametrize("named", ["date_a", "date_b"])
def test_what_cannot_be_decided_is_refused_with_both_named(tmp_path: Path, named: str) -> None:
    path = with_dates(tmp_path, {"date_a": (-6.0, {}), "date_b": (0.0, {})})
    refused(
        path,
        "date_a and date_b both hold dates",
        "2020-12-15T18:00 and 2020-12-16T00:00",
        remedy="names: {time: date_a}",
    )
    assert taken(path, time=named)[0] == (0.0 if named == "date_b" else -6.0)


def test_bounds_count_before_a_date_of_their_end(tmp_path: Path) -> None:
    ds = dated(growing(HOURS / 24.0), HOURS + 6.0, "hours since 2020-12-16", bounds="time_bnds")
    ds["time_bnds"] = ("time", "nv"), np.stack([HOURS - 6.0, HOURS + 6.0], axis=1)
    ds["end_date"] = "time", HOURS + 7.0, SINCE
    wrong, said = taken(written(tmp_path, ds))
    assert wrong == 0.0
    assert "those of time, not of end_date" in said


def test_accumulations_from_one_start_are_no_means(tmp_path: Path) -> None:
    ds = growing(HOURS / 24.0).rename(time="record")
    ds["start"], ds["end"] = ("record", np.full(7, -3.0), SINCE), ("record", HOURS, SINCE)
    refused(written(tmp_path, ds), "both hold dates")


def test_dates_that_agree_need_no_choice(tmp_path: Path) -> None:
    path = with_dates(tmp_path, {"date_a": (0.0, {}), "date_b": (0.0, {})})
    wrong, said = taken(path)
    assert wrong == 0.0
    assert "the dates of the records" not in said


def test_dates_that_are_all_missing_are_no_candidates(tmp_path: Path) -> None:
    ds = dated(growing(HOURS / 24.0), np.full(7, np.nan))
    ds["valid_time"] = "time", HOURS, SINCE
    assert taken(written(tmp_path, ds))[0] == 0.0


@pytest.mark.parametrize("ends", ["swapped", "in order"])
def test_bounds_in_either_order(tmp_path: Path, ends: str) -> None:
    ds = dated(growing(HOURS / 24.0), HOURS - 6.0, "hours since 2020-12-16", bounds="time_bnds")
    edges = np.stack([HOURS - 6.0, HOURS + 6.0], axis=1)
    ds["time_bnds"] = ("time", "nv"), edges[:, ::-1] if ends == "swapped" else edges
    assert taken(written(tmp_path, ds))[0] == 0.0


@pytest.mark.quick(2)
@pytest.mark.parametrize("issue", [{}, REFERENCE])
@pytest.mark.parametrize("steps", ["one of seven issues", "seven of one issue"])
def test_a_table_of_valid_dates_by_issue_and_step(tmp_path: Path, issue: dict[str, str], steps: str) -> None:
    """Forecasts of one lead were dated by their issue, for valid_time(time, step) has two dimensions."""
    ds = growing(HOURS / 24.0)
    if steps == "one of seven issues":
        ds = ds.assign_coords(time=("time", HOURS - 6.0, {**SINCE, **issue})).expand_dims(step=1, axis=1)
        table = HOURS[:, None]
    else:
        ds = ds.rename(time="step").drop_vars("step", errors="ignore").expand_dims(time=1, axis=0)
        ds = ds.assign_coords(time=("time", [0.0], {**SINCE, **issue}))
        table = HOURS[None, :]
    assert taken(written(tmp_path, ds.assign_coords(valid_time=(("time", "step"), table, SINCE))))[0] == 0.0


@pytest.mark.parametrize(
    ("name", "told", "per_hour"),
    [("hour", {}, 1.0), ("datesec", {}, 3600.0), ("seconds_of_day", {"units": "s"}, 3600.0), ("UTC_hour", {}, 1.0)],
)
def test_the_time_of_day_beside_whole_days_counts(
    tmp_path: Path, name: str, told: dict[str, str], per_hour: float
) -> None:
    """Every second record was left out as one that repeats a date."""
    ds = growing(HOURS / 24.0).rename(time="record")
    ds["date"] = "record", np.array([20201216 + int(h // 24.0) for h in HOURS])
    ds[name] = "record", HOURS % 24.0 * per_hour, told
    wrong, said = taken(written(tmp_path, ds))
    assert wrong == 0.0
    assert "repeat a date" not in said


@pytest.mark.parametrize(
    "dates",
    [
        {"time_local": (-3.0, {}), "time_utc": (0.0, {})},
        {"date": (-3.0, {"long_name": "local date"}), "times": (0.0, {})},
        {"time": (-3.0, {}), "time_gmt": (0.0, {})},
    ],
)
def test_universal_time_goes_before_that_of_a_place(tmp_path: Path, dates: dict[str, Any]) -> None:
    assert taken(with_dates(tmp_path, dates))[0] == 0.0


def test_two_numbered_dates_are_refused(tmp_path: Path) -> None:
    refused(with_dates(tmp_path, {"t0": (-6.0, {}), "t1": (6.0, {})}), "t0 and t1 both hold dates")


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("units", "calendar", "first"),
    [
        ("days since -4713-11-24 12:00:00", "", 2459199.5),
        ("days since -4713-11-24", "proleptic_gregorian", 2459200.0),
        ("days since -4712-01-01 12:00:00", "julian", 2459199.5),
        ("days since -4712-1-1T12:00 UTC", "standard", 2459199.5),
    ],
)
def test_julian_days_are_counted_from_their_noon(tmp_path: Path, units: str, calendar: str, first: float) -> None:
    """The library has no year 0 in one calendar and has it in another: the dates were a year off, with a warning of its own."""
    told = {"calendar": calendar} if calendar else {}
    ds = dated(growing(HOURS / 24.0), first + HOURS / 24.0, units, **told)
    assert taken(written(tmp_path, ds))[0] == 0.0


@pytest.mark.parametrize("units", ["days since -0100-01-01", "days since 0000-01-01", "hours since -1-1-1 00:00:00"])
def test_counts_from_before_the_year_1_are_refused(tmp_path: Path, units: str) -> None:
    path = written(tmp_path, dated(growing(HOURS / 24.0), 737000.0 + HOURS, units))
    with pytest.raises(ForcingError, match="which begins before the year 1"):
        taken(path)
