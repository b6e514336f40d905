"""Runs side by side: break-ups with dates and positions, and the distance of each run from observations, day by day.

The same break-up of all runs stands in one row (`riftberg.diagnostics.compare`). Each run is read from its folder
(``summary.json`` and ``run.nc``). The berg at an observed day is the largest fragment, together with further ones,
largest first, of the same berg and within a length of the largest, as long as they bring its area closer to the observed
area: so a finger that is off but still in the observed outline counts to the berg, and a tip that was left behind does not.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from riftberg.config.units import area_text, minute_text, place_text
from riftberg.diagnostics.observed import Fix
from riftberg.diagnostics.score import root_mean_square
from riftberg.diagnostics.summary import read_summary
from riftberg.ocean.grid import haversine
from riftberg.parameters import GROUPS
from riftberg.runs.accessor import Course, Event, align_breakups, compare_courses, find_course
from riftberg.runs.layout import COMMAND, FILE, run_parameters
from riftberg.runs.opendrift import Trajectory
from riftberg.runs.run_file import open_run
from riftberg.runs.scene import Scene
from riftberg.runs.tracks import Position, axis_difference, berg_position
from riftberg.system.atomic_files import write_json


def shown_records(times: NDArray[np.datetime64]) -> list[int]:
    """Return the records that a table shows: on whole days after the first, at most a dozen, and the last."""
    days = (times - times[0]) / np.timedelta64(1, "D")
    step = float(np.ceil(days[-1] / 12.0)) if days[-1] > 2.0 else float(days[-1]) / 6.0
    chosen_days = np.arange(0.0, days[-1], step) if step else np.zeros(1)
    return sorted({len(days) - 1, *(int(np.argmin(np.abs(days - day))) for day in chosen_days)})


MOST_NAMED: Final = 3
"""Parameters named; of more only the number is given."""


def differences(summaries: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Return rows in which the runs differ: experiment, forcing, parameters; nothing for a single run."""
    rows: dict[str, list[str]] = {}
    for label in ("experiment", "forcing"):
        texts = [str(summary.get(label, "")) for summary in summaries]
        if len(set(texts)) > 1:
            rows[label] = texts
    flat = [
        {f"{group}.{name}": value for group, values in summary["numerics"].items() for name, value in values.items()}
        if "program" not in summary else {}
        for summary in summaries
    ]  # fmt: skip
    own_settings = [settings for settings in flat if settings]  # other programs have parameters of their own
    # Parameters that one engine alone has do not differ.
    names = sorted({
        name for settings in own_settings for name in settings
        if any(other.get(name, settings[name] if name.partition(".")[0] in GROUPS else None) != settings[name]
               for other in own_settings)
    })  # fmt: skip
    if names:
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        rows["parameters that differ"] = [
            ", ".join(f"{name} {_value_text(settings.get(name))}" for name in names[:MOST_NAMED]) + more
            if settings
            else ""
            for settings in flat
        ]
    return rows


def differing_lines(texts: Sequence[str]) -> list[str]:
    """Return of each text the lines that another one has not, the first few."""
    lines = [[line.strip() for line in text.splitlines()] for text in texts]
    rows = []
    for mine in lines:
        differing = [line for line in mine if line and any(line not in other for other in lines)]
        more = f" and {len(differing) - MOST_NAMED} lines more" if len(differing) > MOST_NAMED else ""
        rows.append("; ".join(differing[:MOST_NAMED]) + more)
    return rows


def _value_text(value: Any) -> str:
    if value is None:  # of the experiment, not set
        return "as it was"
    return f"{value:g}" if isinstance(value, float) else str(value)


SMALL: Final = 50.0
"""Pieces below this area (km2) are counted, not listed."""

MOST_EVENTS: Final = 6
"""Break-ups listed; further ones are counted."""


@dataclass(frozen=True)
class RealEvent:
    """Observations of the real event, for columns beside the runs."""

    # Texts by the label of a row, of the published run and of the real berg
    published: dict[str, str] = field(default_factory=dict)
    observed: dict[str, str] = field(default_factory=dict)
    fixes: Sequence[Fix] = ()  # Where the berg was

    def within(self, begin: np.datetime64, end: np.datetime64) -> RealEvent:
        """Return the part within these dates (an hour apart at most); texts stand beside positions, not alone."""
        hour = np.timedelta64(1, "h")
        fixes = [fix for fix in self.fixes if begin - hour <= np.datetime64(fix.when) <= end + hour]
        return replace(self, fixes=fixes) if fixes else RealEvent()


@dataclass(frozen=True)
class RunDay:
    """One run at one observed time."""

    time: str  # ISO 8601, of the observation
    distance_km: float  # Between the centroids
    azimuth_difference: float | None  # Long axes, model minus observed, degrees in [-90, 90)
    area_km2: float  # Of the fragments that were compared


@dataclass(frozen=True)
class ComparedRun:
    """One run: its name, its summary, and its days."""

    name: str
    summary: dict[str, Any]
    days: list[RunDay]
    course: Course
    file: str = ""  # Text of its experiment file

    def rms(self) -> tuple[float, float | None] | None:
        """Return root mean squares of distance (km) and of the difference of the axes (degrees); None without days."""
        distance = root_mean_square(day.distance_km for day in self.days)
        return None if distance is None else (distance, root_mean_square(day.azimuth_difference for day in self.days))


@dataclass(frozen=True)
class Comparison:
    """Runs side by side."""

    columns: list[str]  # Headings; the first column holds the labels of the rows
    rows: list[tuple[str, list[str]]]
    runs: list[ComparedRun]
    fixes: Sequence[Fix] = ()  # Where the berg was seen

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, texts, lists and dicts."""
        runs = [
            {
                "name": run.name,
                "breakups": run.summary["breakups"],
                "bonds_broken": run.summary["bonds_broken"],
                "bonds_total": run.summary["bonds_total"],
                "largest_km2": run.summary["largest_km2"],
                "seconds_per_day": run.summary["seconds_per_day"],
                "days": [asdict(day) for day in run.days],
            }
            for run in self.runs
        ]
        rows = [[label, *cells] for label, cells in self.rows]
        return {"columns": self.columns, "rows": rows, "runs": runs, "apart": self.apart()}

    def apart(self) -> list[dict[str, Any]]:
        """Return how far each further run is from the first, by time."""
        first, entries = self.runs[0], []
        for run in self.runs[1:]:
            by_time = compare_courses(first.course, run.course)
            turned = [None if math.isnan(turn) else turn for turn in by_time["rotation"].tolist()]
            entries.append({
                "first": first.name, "second": run.name, "berg": first.course.berg,
                "time": np.datetime_as_string(by_time["time"], "s").tolist(),
                "distance_km": (by_time["distance"] / 1e3).tolist(), "rotation": turned,
                "area_first_km2": (by_time["area_first"] / 1e6).tolist(),
                "area_second_km2": (by_time["area_second"] / 1e6).tolist(),
            })  # fmt: skip
        return entries

    def apart_rows(self) -> list[tuple[str, list[str]]]:
        """Return the same as a table: dates with position and area of the first run, and the distances of the others."""
        first, rows = self.runs[0].course, []
        others = [compare_courses(first, run.course) for run in self.runs[1:]]
        if not others:
            return []
        times = first.times[
            [k for k, time in enumerate(first.times) if any(time in separation["time"] for separation in others)]
        ]
        for time in times[shown_records(times)]:
            k = int(np.searchsorted(first.times, time))
            position = place_text(float(first.x[k]), float(first.y[k]), latlon=first.latlon, digits=2)
            cells = [f"{position}, {area_text(float(first.area[k]))}"]
            for separation in others:
                at = np.flatnonzero(separation["time"] == time)
                cells.append(
                    ""
                    if not at.size
                    else _gap(*(float(separation[n][at[0]]) for n in ("distance", "rotation", "area_second")))
                )
            rows.append((minute_text(str(time)[:19]), cells))
        return rows

    def write(self, path: str | Path) -> Path:
        """Write as JSON."""
        return write_json(self.as_dict(), path)


def _gap(metres: float, turned: float, area: float) -> str:
    return f"{metres / 1e3:.1f} km" + ("" if math.isnan(turned) else f", {turned:+.0f}°") + f", {area_text(area)}"


def read_compared(folder: Path, name: str, fixes: Sequence[Fix]) -> ComparedRun:
    """Read a run from its folder and compare it with the observed positions."""
    with open_run(folder) as dataset:
        return compare_run(folder, dataset, name, fixes)


def compare_run(folder: Path, dataset: xr.Dataset, name: str, fixes: Sequence[Fix]) -> ComparedRun:
    """Compare a run that is open with the observed positions; its summary is read from its folder."""
    summary, scene = read_summary(folder / "summary.json"), Scene(dataset)
    days = [day for fix in fixes if (day := _compare_fix(scene, fix)) is not None] if scene.latlon else []
    numerics = summary["numerics"] | _set_beside_parameters(str(dataset.attrs.get(COMMAND, "")), summary["numerics"])
    return ComparedRun(
        name, {**summary, "numerics": numerics}, days, find_course(dataset), str(dataset.attrs.get(FILE, ""))
    )


def compare_trajectory(trajectory: Trajectory, name: str, fixes: Sequence[Fix]) -> ComparedRun:
    """Compare a trajectory of another program, of which there are positions alone."""
    course = trajectory.course()
    summary = {
        "experiment": Path(trajectory.source).stem, "program": trajectory.program or "another program", "breakups": [],
        "numerics": {"earth": {"latlon": True, "radius": course.radius, "period": 0.0}}, "bonds_broken": 0, "bonds_total": None,
        "largest_km2": float(course.area[-1]) / 1e6, "seconds_per_day": None,
    }  # fmt: skip
    return ComparedRun(name, summary, _compare_course(course, fixes), course)


def _set_beside_parameters(command: str, numerics: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return settings of berg, start and forcing in a command, which a summary does not name, by group and name."""
    settings: dict[str, dict[str, str]] = {}
    for option, setting in pairwise(shlex.split(command)):
        path, equals, value = setting.partition("=")
        group, _, name = path.strip().partition(".")
        if option in ("--set", "-s") and equals and group not in numerics:
            settings.setdefault(group, {})[name] = value
    return settings


def compare_member(member: xr.Dataset, name: str, fixes: Sequence[Fix]) -> ComparedRun:
    """Compare one member of a sweep, of which there are tracks and break-ups, but no elements."""
    course = find_course(member)
    numerics = run_parameters(member).model_dump(mode="json")
    for coordinate in member.coords.values():
        group, _, parameter = str(coordinate.attrs.get("parameter", "")).partition(".")
        if parameter:
            numerics.setdefault(group, {})[parameter] = coordinate.item()
    span = float((course.times[-1] - course.times[0]) / np.timedelta64(1, "D"))
    summary = {
        "experiment": Path(member.attrs.get("experiment", "")).stem, "numerics": numerics, "breakups": course.births,
        "bonds_broken": int(member["bonds_broken"]), "bonds_total": None,
        "largest_km2": float(member["largest_area"]) / 1e6,
        "seconds_per_day": float(member["wall_time"]) / span if span else None,
    }  # fmt: skip
    return ComparedRun(name, summary, _compare_course(course, fixes), course)


def _compare_course(course: Course, fixes: Sequence[Fix]) -> list[RunDay]:
    """Return how far a course is from observed positions."""
    days = []
    for fix in fixes:
        when = np.array([fix.when], "datetime64[ns]")
        x, y, _, area = (float(a[0]) for a in course.at(when))
        if course.latlon and math.isfinite(x):
            metres = float(haversine(x, y, fix.lon, fix.lat, course.radius))
            days.append(RunDay(fix.when.isoformat(), metres / 1e3, None, area / 1e6))
    return days


def _compare_fix(scene: Scene, fix: Fix) -> RunDay | None:
    hours = np.abs(scene.times - np.datetime64(fix.when)) / np.timedelta64(1, "h")
    record = int(np.argmin(hours))
    if hours[record] > 1.0:
        return None
    modelled = match_observed(scene, record, fix.area)
    turned = axis_difference(modelled.azimuth, fix.azimuth)
    return RunDay(
        fix.when.isoformat(),
        float(haversine(modelled.lon, modelled.lat, fix.lon, fix.lat, scene.radius)) / 1e3,
        None if math.isnan(turned) else turned,
        modelled.area / 1e6,
    )


def match_observed(scene: Scene, record: int, area: float) -> Position:
    """Return place and heading of the fragments that make up the berg as it was seen.

    ``area``: observed area, m2.
    """
    berg, sizes, areas = scene.berg[record], scene.fragment_areas(record), scene.areas[record]

    def place(rows: NDArray[np.bool_]) -> Position:
        return berg_position(scene.x[record][rows], scene.y[record][rows], areas[rows], radius=scene.radius)

    largest = next(iter(sizes))
    middle = place(berg == largest)
    distance = haversine(scene.x[record], scene.y[record], middle.lon, middle.lat, scene.radius)
    length = 2.0 * distance[berg == largest].max() + math.sqrt(areas[berg == largest].max())
    chosen, total = [largest], sizes.pop(largest)
    for number, size in sizes.items():
        is_near = scene.origin(number) == scene.origin(largest) and distance[berg == number].min() <= length
        if is_near and abs(total + size - area) < abs(total - area):
            chosen.append(number)
            total += size
    return place(np.isin(berg, chosen))


def compare(runs: Sequence[ComparedRun], real_event: RealEvent | None = None) -> Comparison:
    """Return runs side by side."""
    real_event = real_event or RealEvent()
    seen = {}
    for fix in real_event.fixes:
        turned = "" if math.isnan(fix.azimuth) else f", {fix.azimuth:.0f}°"
        position = place_text(fix.lon, fix.lat, latlon=True, digits=2)
        seen[minute_text(fix.when.isoformat())] = f"{position}{turned}"
    beside = {
        name: texts for name, texts in (("published", real_event.published), ("observed", real_event.observed)) if texts
    }
    if seen:
        beside["observed"] = {**real_event.observed, **seen}
    cells: dict[str, list[str]] = {label: [""] * len(runs) for label in (*real_event.published, *real_event.observed)}
    cells |= differences([run.summary for run in runs])
    if len({run.file for run in runs}) > 1 and all(run.file for run in runs):
        cells["experiment file"] = differing_lines([run.file for run in runs])
    large = [[event for event in run.summary["breakups"] if event["area_km2"] >= SMALL] for run in runs]
    events = align_breakups(large, runs[0].summary["numerics"]["earth"]) if runs else []
    for k, run in enumerate(runs):
        for label, text in _run_cells(run, events[k]).items():
            cells.setdefault(label, [""] * len(runs))[k] = text
    order = sorted(cells, key=lambda label: (_RANK.get(label, 1 if label.startswith(_BREAK_UP) else 7), label))
    rows = [(label, [*(texts.get(label, "") for texts in beside.values()), *cells[label]]) for label in order]
    return Comparison(["", *beside, *(run.name for run in runs)], rows, list(runs), real_event.fixes)


_BREAK_UP: Final = "break-up"
_RANK: Final = {
    "experiment": 0,
    "program": 0,
    "experiment file": 0,
    "forcing": 0,
    "parameters that differ": 0,
    "further break-ups": 2,
    "smaller pieces": 3,
    "largest piece at the end": 4,
    "bonds broken": 5,
    "wall time a day": 6,
    "rms of the days": 8,
}


def _run_cells(run: ComparedRun, events: Sequence[Event | None]) -> dict[str, str]:
    """Return the cells of a run by label; ``events`` are its break-ups by row, None where it has none."""
    s = run.summary
    rows = {"program": str(s["program"])} if "program" in s else _ice_cells(s, events)
    if s["seconds_per_day"] is not None:
        rows["wall time a day"] = f"{s['seconds_per_day']:.3g} s"
    for day in run.days:
        turned = "" if day.azimuth_difference is None else f", {day.azimuth_difference:+.0f}°"
        rows[minute_text(day.time)] = f"{day.distance_km:.1f} km off{turned}"
    means = run.rms()
    if means is not None:
        rows["rms of the days"] = f"{means[0]:.1f} km" + ("" if means[1] is None else f", {means[1]:.0f}°")
    return rows


def _ice_cells(s: dict[str, Any], events: Sequence[Event | None]) -> dict[str, str]:
    """Return the cells of break-ups, pieces and bonds."""
    latlon = s["numerics"]["earth"]["latlon"]
    listed = enumerate(events[:MOST_EVENTS], 1)
    rows = {f"{_BREAK_UP} {k}": "none" if event is None else _event(event, latlon) for k, event in listed}
    beyond = sum(event is not None for event in events[MOST_EVENTS:])
    if beyond:
        rows["further break-ups"] = str(beyond)
    rows["smaller pieces"] = f"{sum(event['area_km2'] < SMALL for event in s['breakups'])} below {SMALL:g} km²"
    rows["largest piece at the end"] = f"{s['largest_km2']:.0f} km²"
    total = s["bonds_total"]
    of = "" if total is None else f" of {total} = {100.0 * s['bonds_broken'] / max(1, total):.1f} %"
    rows["bonds broken"] = f"{s['bonds_broken']}{of}"
    return rows


def _event(event: dict[str, Any], latlon: bool) -> str:
    when = datetime.fromisoformat(event["time"])
    ground = "aground" if event["grounded"] else "afloat"
    position = place_text(event["lon"], event["lat"], latlon=latlon, digits=2)
    return f"{when.day} {when:%b %H:%M} {ground}: {event['area_km2']:.0f} km², {event['bonds']} bonds, at {position}"


def set_hours(fixes: Sequence[Fix], hour: float) -> list[Fix]:
    """Return observations with an hour (UTC) for those that know only their day, and without interpolated ones."""
    return [
        Fix(f.name, f.when + timedelta(hours=hour), False, f.lon, f.lat, f.azimuth, f.area) if f.day_only else f
        for f in fixes
        if not f.interpolated
    ]
