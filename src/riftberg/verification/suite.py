"""A table of errors of drift models on observed bergs: cases, entrants, paired differences with intervals, subsets.

A suite is a folder with a folder for each case. ``case.yaml`` (`CaseFile`) describes the case, ``starts.csv`` all a model may
know at each start (berg, date, lon, lat, length, width, thickness; an earlier position as date_before, lon_before, lat_before;
more columns for subsets), ``observed.csv`` where bergs were seen. A series for each start is a table with the columns berg and
start before those of `riftberg.ocean.series`. Two entrants are compared on the starts that both answer; all means of a row are
over the starts that all its entrants answer.
"""

from __future__ import annotations

import inspect
import logging
import operator
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, ValidationError, field_validator

from riftberg.bergs.iceberg import Iceberg
from riftberg.config.values import Section, UnfitError, explained, findings, key, number, parse_date
from riftberg.constants import SECONDS_PER_DAY
from riftberg.diagnostics.observed import read_observed
from riftberg.errors import InputError, nearest
from riftberg.experiments.changes import changed, parse_settings
from riftberg.experiments.schema import SeriesForcing, forcing_kind
from riftberg.experiments.yaml_file import Document
from riftberg.model import BareModel
from riftberg.ocean.files_schema import FileForcing
from riftberg.ocean.series import Series, make_series
from riftberg.parameters import Parameters
from riftberg.runs.tracks import main_position
from riftberg.state import Floats
from riftberg.system.input_files import in_folder, is_folder, is_seen, read_csv_rows, value_shown
from riftberg.verification.scores import EARTH_KM, FEWEST, distance
from riftberg.verification.tracks import (
    BASELINES,
    FASTEST,
    Case,
    DriftModel,
    Forecasts,
    Start,
    forecast,
    read_forecasts,
)

DRAWS: Final = 10_000
"""Samples of bergs or starts from which an interval comes."""

ADVECTION_STEP: Final = 3600.0
"""Step (s) in which a point goes with the current, at the middle of it."""

AT_THE_TIME: Final = 60.0
"""Seconds within which an observation counts as one at the time itself."""

RIFTBERG: Final = "riftberg"

USUAL: Final = (*BASELINES, "current", RIFTBERG)
"""Entrants of every case; the last one is the reference."""

ALL: Final = "all"


class CaseFile(Section):
    """Description of a case of a suite."""

    name: str = key("", "", "name of the case, else that of its folder")
    sentence: str = key(..., "", "what it is, in a sentence", min_length=1)
    source: str = key(..., "", "where positions and forcing come from", min_length=1)
    licence: str = key(..., "", "under which terms they may be used, or that none are stated", min_length=1)
    leads: list[float] = key(..., "day", "lead times", min_length=1)
    unit: Literal["berg", "start"] = key("berg", "", "what the bootstrap draws; starts of one berg share their weather")
    starts: str = key("starts.csv", "", "table of starts")
    observed: str = key("observed.csv", "", "table of observed positions that count")
    within: float = key(
        0.0, "h", "positions are linear between observations at most so far apart; 0: only at the time", ge=0
    )
    forcing: Annotated[
        Annotated[SeriesForcing, Tag("along")] | Annotated[FileForcing, Tag("files")],
        Field(discriminator=Discriminator(forcing_kind)),
    ] = key(..., "", "series along the tracks (along), or files")
    entrants: dict[str, str] = key(
        {}, "", "further entrants by name, such as no slope: riftberg forcing.sea_level=none"
    )
    subsets: dict[str, str] = key({}, "", "starts by what is known of them, such as afloat: draft < depth")
    held_out: list[str] = key([], "", "bergs that nothing may be tuned on")
    hindcast: bool = key(False, "", "the forcing is along the observed tracks: it tells a model where the berg went")

    @field_validator("leads", mode="before")
    @classmethod
    def _in_days(cls, leads: Any) -> Any:
        try:
            return [number(lead, "day", where="leads") for lead in leads] if isinstance(leads, list) else leads
        except InputError as error:
            raise UnfitError(error.what, error.remedy) from error


@dataclass(frozen=True)
class SuiteCase:
    """One case: its description, and its starts with the observed positions."""

    file: CaseFile
    folder: Path
    cases: list[Case]
    opened: dict[str, Any] = field(default_factory=dict, repr=False)  # Files of the forcing, by what names them

    @property
    def leads(self) -> list[float]:
        """Lead times, days."""
        return sorted(self.file.leads)

    def groups(self) -> list[str]:
        """Return the group of each start in means and intervals."""
        alone = self.file.unit == "start"
        return [f"{case.start.berg} {case.start.date}" if alone else case.start.berg for case in self.cases]

    def subsets(self) -> dict[str, NDArray[np.bool_]]:
        """Return which starts each subset holds."""
        masks = {ALL: np.ones(len(self.cases), bool)}
        if self.file.held_out:
            held_out = np.array([case.start.berg in self.file.held_out for case in self.cases])
            masks |= {"open": ~held_out, "held out": held_out}
        where, bergs = f"{self.folder / 'case.yaml'}, subsets", {case.start.berg for case in self.cases}
        reserved = next((name for name in self.file.subsets if name in (ALL, "open", "held out")), None)
        if reserved:
            raise InputError(f"{reserved!r} is a subset of every case", where=where, remedy="Give it another name")
        return masks | {
            name: np.array([_holds(text, case.start, f"{where}.{name}", bergs) for case in self.cases])
            for name, text in self.file.subsets.items()
        }


def read_suite(folder: str | Path) -> list[SuiteCase]:
    """Read the cases of a suite.

    Raises
    ------
    InputError
        If there is no case, a case lacks a key, a forcing ends before a lead, or a berg that is held out is missing.
    """
    folder = Path(folder)
    files = sorted(folder.glob("*/case.yaml")) if is_folder(folder) else []
    if not files:
        raise InputError(
            "no case", where=str(folder), remedy="Name a folder that holds a folder for each case, with case.yaml"
        )
    return [_read_case(file) for file in files]


def _read_case(path: Path) -> SuiteCase:
    document = Document(path, ", ".join(CaseFile.model_fields))
    values: dict[str, Any] = {"name": path.parent.name, **document.values}
    forcing = values.get("forcing")
    if isinstance(forcing, dict) and "kind" not in forcing:
        values["forcing"] = {"kind": "along" if "along" in forcing else "files", **forcing}
    try:
        file = CaseFile.model_validate(values)
    except ValidationError as error:
        raise document.refusal(findings(error, CaseFile)) from error
    if min(file.leads) <= 0.0 or len(set(file.leads)) < len(file.leads):
        raise document.refusal([(("leads",), InputError("lead times rise from above 0", remedy="Give each once"))])
    starts = list(_starts(path.parent / file.starts))
    unknown = [name for name in file.held_out if name not in {start.berg for start in starts}]
    if unknown:
        bergs = sorted({start.berg for start in starts})
        remedy = f"{nearest(unknown[0], bergs)}Bergs are {', '.join(bergs)}"
        raise document.refusal([(("held_out",), InputError(f"no berg {unknown[0]!r} starts", remedy=remedy))])
    forced = file.forcing
    if isinstance(forced, FileForcing):
        return SuiteCase(file, path.parent, _with_seen(file, path.parent / file.observed, starts))
    series = series_by_start(forced, path.parent, starts)
    starts = [start.with_forcing(series[start.key]) for start in starts]
    cases = _with_seen(file, path.parent / file.observed, starts)
    for case in cases:
        days, lead = case.start.forcing.cover[1] / SECONDS_PER_DAY, max(case.seen)
        if days < lead - AT_THE_TIME / SECONDS_PER_DAY:
            raise InputError(
                f"the forcing of {case.start} ends after {days:.4g} days, before the lead of {lead:.4g}",
                where=str(path.parent / forced.along),
                remedy="Give more of it, hold its end (forcing.hold), or leave the lead out",
            )  # fmt: skip
    return SuiteCase(file, path.parent, cases)


SIZED: Final = {
    "lon": (-360.0, 360.0),
    "lat": (-90.0, 90.0),
    **dict.fromkeys(("length", "width", "thickness"), (0.1, 1e6)),
}
"""Columns of starts that must hold numbers, and their limits, degrees and m."""


def _starts(path: Path) -> Iterator[Start]:
    """Give the starts of a table, each once."""
    lines: dict[Any, int] = {}
    for line, row in enumerate(read_csv_rows(path)[0], start=2):
        where, texts = (
            f"{path}, line {line}",
            {str(name).strip().lower(): (text or "").strip() for name, text in row.items()},
        )
        values: dict[str, Any] = {name: as_number(text) for name, text in texts.items()}
        missing = next((name for name in ("berg", "date", *SIZED) if name not in texts), None)
        wrong = next((name for name, (low, high) in SIZED.items() if not low <= values.get(name, np.nan) <= high), "")
        if missing or wrong:
            raise InputError(
                f"no column {missing!r}" if missing else f"{wrong} = {value_shown(texts[wrong])} is not possible", where=where,
                remedy="Columns are berg, date, lon, lat (degrees), length, width and thickness (m)",
            )  # fmt: skip
        if not is_seen(values["lon"], values["lat"]):
            raise InputError(
                f"latitude {values['lat']:g}, longitude {values['lon']:g} are no position", where=where,
                remedy="Leave the row out",
            )  # fmt: skip
        date, earlier_positions = parse_date(texts["date"], where=where)[0], {}
        previous = values.get("lon_before", np.nan), values.get("lat_before", np.nan)
        if texts.get("date_before") and (np.isnan(previous).any() or is_seen(*previous)):
            earlier = parse_date(texts["date_before"], where=where)[0]
            if not earlier < date or np.isnan(previous).any():
                raise InputError(
                    f"{earlier} and {previous} are no earlier date and position", where=where,
                    remedy="Give date_before, lon_before and lat_before, or leave all three empty",
                )  # fmt: skip
            earlier_positions[earlier] = previous
        start = Start(texts["berg"], date, values["lon"], values["lat"], earlier_positions, columns=values)
        if lines.setdefault(start.key, line) != line:
            raise InputError(
                f"{start} starts in line {lines[start.key]} too", where=where, remedy="Give each start once"
            )
        yield start


def as_number(text: str) -> float:
    """Return a cell as a number, NaN for an empty cell or one of text."""
    try:
        return float(text)
    except ValueError:
        return np.nan


@lru_cache(maxsize=4)
def _rows_by_start(path: Path, written: int) -> tuple[dict[Any, list[tuple[int, dict[str, str]]]], str]:
    """Return the rows of a table of series by start, and its separator; ``written``: when, for a table may change."""
    rows, separator = read_csv_rows(path)
    groups: dict[Any, list[tuple[int, dict[str, str]]]] = {}
    keys: dict[tuple[str, str], Any] = {}
    for line, row in enumerate(rows, start=2):
        if "berg" not in row or "start" not in row:
            raise InputError("no columns berg and start", where=str(path), remedy="Each row belongs to a start")
        texts = row["berg"].strip(), row["start"].strip()
        if texts not in keys:
            keys[texts] = Start(texts[0], parse_date(texts[1], where=f"{path}, line {line}")[0], 0.0, 0.0, {}).key
        groups.setdefault(keys[texts], []).append((line, row))
    return groups, separator


def series_by_start(settings: SeriesForcing, folder: Path, starts: Sequence[Start]) -> dict[Any, Series]:
    """Return the series of the starts, by their keys; a column ``depth`` of the starts is their floor."""
    path = Path(in_folder(folder, settings.along))
    groups, separator = _rows_by_start(path, path.stat().st_mtime_ns if path.exists() else 0)
    options: dict[str, Any] = {
        "sea_level": settings.sea_level, "wind_layer": settings.wind_layer, "hold": 3600.0 * settings.hold,
        "means": settings.means,
    }  # fmt: skip
    if settings.wind == "none":
        options |= {"ua": None, "va": None}
    series = {}
    for start in starts:
        if start.key not in groups:
            raise InputError(
                f"no forcing for {start}", where=str(path), remedy="Give its series: columns berg and start"
            )
        depth = start.columns.get("depth", np.nan)
        floor = {} if np.isnan(depth) else {"depth": depth}
        series[start.key] = make_series(groups[start.key], separator, path, start=start.date, **floor, **options)
    return series


def _with_seen(file: CaseFile, path: Path, starts: Sequence[Start]) -> list[Case]:
    """Return the starts with the positions that were observed at the lead times; those with none are left out."""
    tracks: dict[str, list[tuple[float, float, float]]] = {}
    for fix in read_observed(path).fixes:
        tracks.setdefault(fix.name.upper(), []).append((_seconds(fix.when), fix.lon, fix.lat))
    cases = []
    for start in starts:
        track = np.array(sorted(tracks.get(start.berg.upper(), [(0.0, np.nan, np.nan)])))
        positions = {
            lead: _position(track, _seconds(start.date) + lead * SECONDS_PER_DAY, 3600.0 * file.within)
            for lead in file.leads
        }
        seen = {lead: position for lead, position in positions.items() if position is not None}
        if seen:
            cases.append(Case(start, seen, start.berg in file.held_out))
    if not cases:
        raise InputError("no start was seen again at a lead", where=str(path), remedy="Give positions at the leads")
    return cases


def _seconds(date: datetime) -> float:
    return (date - datetime(2000, 1, 1)).total_seconds()


def _position(track: Floats, when: float, within: float) -> tuple[float, float] | None:
    """Return the longitude and latitude at a time, linear between observations not too far apart; None where there is none."""
    after = int(np.searchsorted(track[:, 0], when))
    for k in (after - 1, after):
        if 0 <= k < len(track) and abs(track[k, 0] - when) < AT_THE_TIME:
            return float(track[k, 1]), float(track[k, 2])
    if not 0 < after < len(track) or track[after, 0] - track[after - 1, 0] > within:
        return None
    first, second = track[after - 1], track[after]
    share, turn = (when - first[0]) / (second[0] - first[0]), (second[1] - first[1] + 180.0) % 360.0 - 180.0
    return float(first[1] + share * turn), float(first[2] + share * (second[2] - first[2]))


_COMPARISON: Final = re.compile(r"\s*(\w+)\s*(<=|>=|<|>|==)\s*([\w.+-]+)\s*")
_OPERATORS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
}  # fmt: skip


def _holds(text: str, start: Start, where: str, bergs: Collection[str]) -> bool:
    """Whether a start is of a subset: ``NAME < NUMBER`` or ``NAME < NAME``, of its columns and ``speed`` (km a day)."""
    match, columns = _COMPARISON.fullmatch(text), {**start.columns, "berg": start.berg, "speed": start.speed}
    if not match or match[1] not in columns:
        raise InputError(
            f"{value_shown(text)} compares no column", where=where,
            remedy=f"Write NAME < NUMBER or NAME == BERG, with a name of {', '.join(columns)}",
        )  # fmt: skip
    other: Any = columns.get(match[3], match[3])
    if match[1] == "berg" and match[3] not in bergs:
        raise InputError(f"no berg {match[3]!r} starts", where=where, remedy=f"Bergs are {', '.join(sorted(bergs))}")
    if isinstance(other, str) and match[1] != "berg":
        try:
            other = float(other)
        except ValueError as error:
            raise InputError(f"{match[3]!r} is no column and no number", where=where) from error
    return bool(_OPERATORS[match[2]](columns[match[1]], other))


# ---- entrants ---------------------------------------------------------------------------------------------------------------


def make_advected(factor: float) -> DriftModel:
    """Return the model of a point that goes with a share of the current."""

    def model(start: Start, dates: Sequence[datetime], forcing: Any) -> Floats:
        ends = np.array([(when - start.date).total_seconds() for when in dates])
        times = np.unique(np.append(np.arange(0.0, ends.max(), ADVECTION_STEP), ends))
        step, middle = factor * np.diff(times), 0.5 * (times[1:] + times[:-1])
        metre = np.degrees(1e-3 / EARTH_KM)
        if isinstance(forcing, Series):  # which is the same everywhere
            u, v = forcing.current_series(middle)
            lat = start.lat + metre * np.concatenate([[0.0], np.cumsum(step * v)])
            east = metre * step * u / np.cos(np.radians(0.5 * (lat[1:] + lat[:-1])))
            lon = start.lon + np.concatenate([[0.0], np.cumsum(east)])
        else:
            lon, lat = np.full(times.size, start.lon), np.full(times.size, start.lat)
            for k in range(step.size):
                u, v = (
                    np.nan_to_num(component)
                    for component in forcing.currents(lon[k : k + 1], lat[k : k + 1], middle[k])
                )
                lat[k + 1] = lat[k] + metre * step[k] * v[0]
                lon[k + 1] = lon[k] + metre * step[k] * u[0] / np.cos(np.radians(lat[k]))
        rows = np.searchsorted(times, ends)
        return np.column_stack([lon[rows], lat[rows]])

    return model


def entrant(definition: str, suite_case: SuiteCase) -> DriftModel:
    """Return the drift model of a definition.

    One of `USUAL`, ``current x F``, ``riftberg group.name=value ...`` or ``forecasts FILE.csv``.
    """
    word, _, rest = definition.strip().partition(" ")
    if definition in BASELINES:
        return BASELINES[definition]
    if definition == "current":
        return make_advected(1.0)
    share = re.fullmatch(r"current x ([\d.]+)", definition)
    if share:
        return make_advected(float(share[1]))
    if word == RIFTBERG:
        return _riftberg(suite_case, rest.split())
    if word == "forecasts" and rest:
        return read_forecasts(suite_case.folder / rest, complete=False)
    raise InputError(
        f"no entrant {value_shown(definition)}", where=f"{suite_case.file.name}, entrants",
        remedy=f"{nearest(definition, (*USUAL, *suite_case.file.entrants))}Use {', '.join(USUAL)}, current x 0.5, riftberg "
        "group.name=value, forecasts FILE.csv, or a name that case.yaml defines",
    )  # fmt: skip


def _riftberg(suite_case: SuiteCase, settings: Sequence[str]) -> Forecasts:
    """Run Riftberg for all starts: lone bergs that do not act on each other, those with series of their own in one model."""
    changes = parse_settings(settings)
    forcing = changes.pop("forcing", {})
    parameters = changed(Parameters(stepping={"interactions": False}), changes)
    forecasts = Forecasts(f"{RIFTBERG} {' '.join(settings)}".strip(), complete=False)
    if isinstance(suite_case.file.forcing, FileForcing):
        for case in suite_case.cases:
            _advance(
                [case], _file_forcing(suite_case, case, forcing, parameters), parameters, forecasts, [case.start.lon]
            )
        return forecasts
    series = series_by_start(
        _changed_section(suite_case, forcing), suite_case.folder, [case.start for case in suite_case.cases]
    )
    has_floor = any("depth" in each.provides for each in series.values())
    batch = _largest_batch(suite_case) if has_floor else len(suite_case.cases)
    for first in range(0, len(suite_case.cases), batch):
        cases = suite_case.cases[first : first + batch]
        middles = -180.0 + 360.0 * (np.arange(len(cases)) + 0.5) / len(cases)
        ocean = Series.side_by_side([series[case.start.key] for case in cases])
        _advance(cases, ocean, parameters, forecasts, middles.tolist())
    return forecasts


@contextmanager
def _without_notices() -> Iterator[None]:
    """Silence the notices of hundreds of runs: all starts of a case lack the same."""
    log = logging.getLogger("riftberg.model")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _largest_batch(suite_case: SuiteCase) -> int:
    """Return for how many bergs a parallel has room, each in a sector that the fastest does not leave."""
    north = max(abs(case.start.lat) for case in suite_case.cases) + 2.0
    half = np.degrees(FASTEST * max(suite_case.leads) / (EARTH_KM * np.cos(np.radians(min(north, 89.0)))))
    return max(1, int(180.0 / half))


def _advance(
    cases: Sequence[Case], forcing: Any, parameters: Parameters, forecasts: Forecasts, lon: Sequence[float]
) -> None:
    """Advance a model with a berg for each start, at its latitude and some longitude; keep where they are at the leads."""
    lat, length, width, thickness = (
        np.array([case.start.columns[name] for case in cases], float) for name in ("lat", "length", "width", "thickness")
    )  # fmt: skip
    radius = cases[0].start.columns.get("radius", np.nan)
    if len(cases) == 1 and np.isfinite(radius):
        size = {"thickness": thickness[0], "radius": radius, "placement": (lon[0], float(lat[0]))}
        bergs = Iceberg.rectangle(length[0], width[0], **size)
    else:
        bergs = Iceberg.from_points(lon, lat, length=length, width=width, thickness=thickness, overlap=True)
    model, reached = BareModel(bergs, forcing, parameters, cases[0].start.date), 0.0
    for lead in sorted({lead for case in cases for lead in case.seen}):
        with _without_notices():
            model.advance(lead - reached)
        reached, middle = lead, main_position(model)
        alone, centres = len(cases) == 1, model.elements.place
        for k, case in enumerate(cases):
            x, y = (middle.lon, middle.lat) if alone else (float(centres.lon[k]), float(centres.lat[k]))
            forecasts.keep(case.start.berg, case.start.date, lead, case.start.lon + x - lon[k], y)


def _file_forcing(suite_case: SuiteCase, case: Case, changes: Mapping[str, Any], parameters: Parameters) -> Any:
    """Return the forcing from files for one start."""
    from riftberg.ocean.files_forcing import Run, forcing_from_files, opened_files

    start, thickness = case.start, np.array([case.start.columns["thickness"]], float)
    position = np.array([start.lon]), np.array([start.lat])
    run = Run.of(start.date, max(case.seen) + 0.1, thickness, parameters.ice.density, place=position)
    settings = _changed_section(suite_case, changes)
    key = settings.model_dump_json(include={"files", "member"})
    if key not in suite_case.opened:  # once for all starts and entrants
        suite_case.opened[key] = opened_files(settings, suite_case.folder)
    return forcing_from_files(settings, suite_case.folder, run, suite_case.opened[key])


def _changed_section(suite_case: SuiteCase, changes: Mapping[str, Any]) -> Any:
    """Return the forcing section of a case, with the settings of an entrant."""
    section = type(suite_case.file.forcing)
    try:
        return section.model_validate({**suite_case.file.forcing.model_dump(exclude_unset=True), **changes})
    except ValidationError as error:
        raise explained(error, section, name="forcing") from error


# ---- the table --------------------------------------------------------------------------------------------------------------


def entrant_errors(model: DriftModel, suite_case: SuiteCase) -> Floats:
    """Return the errors of an entrant, km, by start and lead; NaN where it gives no position or none was seen."""
    errors = np.full((len(suite_case.cases), len(suite_case.leads)), np.nan)
    wants_forcing = not isinstance(model, Forecasts) and len(inspect.signature(model).parameters) > 2
    for k, case in enumerate(suite_case.cases):
        ocean = case.start.forcing
        if wants_forcing and ocean is None:
            ocean = _file_forcing(suite_case, case, {}, Parameters())
        driven = bind_forcing(ocean, model) if wants_forcing else model
        for lead, positions in forecast(driven, case, complete=False).items():
            lon, lat = positions.mean(axis=0)
            errors[k, suite_case.leads.index(lead)] = float(distance(lon, lat, *case.seen[lead]))
    return errors


def bind_forcing(forcing: Any, model: DriftModel) -> DriftModel:
    """Return a drift model that takes the forcing as its third argument as one of start and dates."""
    return lambda start, dates: model(start, dates, forcing)


@dataclass(frozen=True)
class Mean:
    """A mean over bergs (or starts) with its 90 % interval; None of few."""

    mean: float
    interval: tuple[float, float] | None


def grouped_mean(values: Floats, groups: Sequence[str]) -> Mean:
    """Return the mean over groups of the means of their values, and its interval from drawing groups.

    It does not depend on the order of the values.
    """
    names = sorted(set(groups))
    owner = np.array(groups)
    means = np.array([np.sort(values[owner == name]).mean() for name in names])
    if len(names) < FEWEST:
        return Mean(float(means.mean()), None)
    drawn = means[np.random.default_rng(1).integers(0, len(names), (DRAWS, len(names)))].mean(axis=1)
    low, high = np.quantile(drawn, [0.05, 0.95])
    return Mean(float(means.mean()), (float(low), float(high)))


def standing(difference: Mean) -> str:
    """Judge a paired difference from another entrant: better, worse, or level where nothing is certain."""
    if difference.interval is None:
        return ""
    low, high = difference.interval
    return "better" if high < 0.0 else "worse" if low > 0.0 else "level"


def table(case: SuiteCase, errors: Mapping[str, Floats], reference: str) -> dict[str, Any]:
    """Return a case's table: by subset and lead the errors of all entrants on the starts that all answer, paired with one."""
    file, groups, rows = case.file, np.array(case.groups()), []
    for subset, inside in case.subsets().items():
        for j, lead in enumerate(case.leads):
            common = inside & np.all([np.isfinite(values[:, j]) for values in errors.values()], axis=0)
            owners = groups[common].tolist()
            row: dict[str, Any] = {"subset": subset, "lead_days": lead, "starts": int(common.sum())}
            row["bergs"] = len(
                {start_case.start.berg for start_case, is_common in zip(case.cases, common, strict=True) if is_common}
            )
            answered = {name: values[common, j] for name, values in errors.items()} if owners else {}
            row["entrants"] = {
                name: _entrant_row(values, answered[reference], owners, name == reference)
                for name, values in answered.items()
            }
            rows.append(row)
    return {"name": file.name, "sentence": file.sentence, "source": file.source, "licence": file.licence, "unit": file.unit,
            "held_out": file.held_out, "hindcast": file.hindcast, "reference": reference, "leads_days": case.leads,
            "starts": len(case.cases), "rows": rows}  # fmt: skip


def _entrant_row(errors: Floats, reference: Floats, owners: Sequence[str], is_reference: bool) -> dict[str, Any]:
    """Return the errors of an entrant on some starts, and how far the reference is from it; ``owners``: berg of each start."""
    mean, medians = (
        grouped_mean(errors, owners),
        [np.median(errors[np.array(owners) == name]) for name in sorted(set(owners))],
    )
    alone = len(medians) == len(errors)
    median = float(np.median(errors) if alone else np.mean(medians))
    row: dict[str, Any] = {"mean_km": mean.mean, "interval_km": mean.interval, "median_km": median}
    if is_reference:
        return row
    paired = grouped_mean(reference - errors, owners)
    row |= {"reference_minus_this_km": paired.mean, "difference_interval_km": paired.interval}
    return row | {"reference_is": standing(paired)}


def tables(
    suite: Sequence[SuiteCase], chosen: Sequence[str] = (), *, models: Mapping[str, DriftModel] | None = None,
    reference: str = RIFTBERG,
) -> list[dict[str, Any]]:  # fmt: skip
    """Return the tables of all cases.

    Parameters
    ----------
    suite : sequence of SuiteCase
    chosen : sequence of str, optional
        Entrants: usual ones, names of ``case.yaml``, definitions (`entrant`) or ``NAME: DEFINITION``; by default the usual ones
        and all of ``case.yaml``.
    models : mapping, optional
        Further drift models by name: functions of start and dates, and of the forcing if they have a third argument.
    reference : str, optional
        Entrant with which the others are paired, where it takes part; else the last one.
    """
    results = []
    for case in suite:
        file_entrants = case.file.entrants
        definitions = dict(_named(text, file_entrants) for text in (chosen or (*USUAL, *file_entrants)))
        entrants = {**{name: entrant(text, case) for name, text in definitions.items()}, **(models or {})}
        errors = {name: entrant_errors(model, case) for name, model in entrants.items()}
        results.append(table(case, errors, reference if reference in errors else list(errors)[-1]))
    return results


def _named(text: str, file_entrants: Mapping[str, str]) -> tuple[str, str]:
    """Return name and definition of an entrant."""
    name, colon, definition = (piece.strip() for piece in text.partition(": "))
    return (name, definition) if colon else (name, file_entrants.get(name, name))


def as_markdown(result: Sequence[Mapping[str, Any]]) -> str:
    """Return tables as a page: a row for each entrant, mean errors by lead, and how far the reference is from it."""
    lines = []
    for case in result:
        kind = "Hindcast along the observed track: it tells a model where the berg went. " if case["hindcast"] else ""
        unit = f"90 % intervals from drawing {case['unit']}s"
        lines += [f"## {case['name']}", "", f"{case['sentence']} {kind}Mean error, km; {unit}.", "",
                  f"Source: {case['source']}. Licence: {case['licence']}.", ""]  # fmt: skip
        for subset in dict.fromkeys(row["subset"] for row in case["rows"]):
            rows = [row for row in case["rows"] if row["subset"] == subset and row["starts"]]
            leads = [f"{row['lead_days']:.4g} d ({row['starts']})" for row in rows]
            lines += [f"| {subset} | {' | '.join(leads)} |", "|---|" + "---|" * len(rows)]
            for name in rows[0]["entrants"] if rows else ():
                cells = [_cell(row["entrants"][name]) for row in rows]
                lines.append(f"| {name} | {' | '.join(cells)} |")
            lines.append("")
        lines += [f"In brackets: {case['reference']} minus the row.", ""]
    return "\n".join(lines)


def _cell(cell: Mapping[str, Any]) -> str:
    text = f"{cell['mean_km']:.1f}"
    if "reference_minus_this_km" not in cell:
        return text
    ends = cell["difference_interval_km"]
    interval = f" ({ends[0]:.1f}..{ends[1]:.1f})" if ends else ""
    return f"{text} [{cell['reference_minus_this_km']:+.1f}{interval}]"
