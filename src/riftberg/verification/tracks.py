"""A benchmark of drift on observed tracks: which starts and positions count, simple forecasts to beat, scores by berg.

Tracks are tables of the BYU/NIC database (Budge and Long 2018, https://doi.org/10.1109/JSTARS.2017.2784186). A position counts
where a scatterometer saw the berg that day (flag 1; positions of NIC, weekly, and interpolated ones do not). A case is a day on
which the berg lies north of 60 S, where three days before it was seen too and has moved at least 9 km since, with the positions
1, 3, 5 and 7 days later that were seen. The bergs are the sample, not the days: pieces of one berg and days in a row repeat
each other, so intervals come from drawing bergs.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np

from riftberg.config.values import parse_date
from riftberg.diagnostics.observed import SENSORS
from riftberg.errors import InputError
from riftberg.state import Floats
from riftberg.system.atomic_files import write_text
from riftberg.system.input_files import is_folder, is_seen, read_csv_rows, value_shown
from riftberg.verification.scores import (
    FEWEST,
    Point,
    along_across,
    bootstrap_interval,
    distance,
    extrapolate,
    local,
    moved,
    position_scores,
)

LEADS: Final = (1, 3, 5, 7)
"""Lead times, days."""

NORTH_OF: Final = -60.0
"""Latitude north of which a case starts, degrees: further south sea ice and the coast hold bergs."""

DAYS_BEFORE: Final = 3
"""Days over which the motion before a start is measured."""

SLOWEST: Final = 3.0
"""Least mean speed over these days, km a day: a berg aground, or in fast ice, is no case of drift."""

FASTEST: Final = 60.0
"""Speed, km a day, beyond which a position is an error: no berg is that fast, and the sensors confuse bergs."""

TUNED: Final = ("A68A",)
"""Bergs to whose drift oceans in this package were fitted (``riftberg run a68a``)."""

HELD_OUT: Final = ("A38", "B17", "C19")
"""Families of bergs, by the parent's name, that nothing may be tuned on. Families, because pieces drift in the same water."""

DRESSED_MEMBERS: Final = 50
"""Members of a dressed forecast."""


@dataclass(frozen=True)
class Start:
    """Input of a drift model: where a berg is, and where it was."""

    berg: str  # Name
    date: datetime
    lon: float  # Degrees
    lat: float  # Degrees
    before: Mapping[datetime, tuple[float, float]]  # Earlier positions that may be known, longitude and latitude
    forcing: Any = None  # What drives the berg, where a suite gives it
    columns: Mapping[str, Any] = field(default_factory=dict)  # What else is known, by column of the table of starts

    def __str__(self) -> str:
        return f"{self.berg}, {self.day}"

    @property
    def day(self) -> str:
        """Date of the start, with its time unless that is midnight."""
        return f"{self.date:%Y-%m-%d %H:%M}".removesuffix(" 00:00")

    @property
    def key(self) -> tuple[str, datetime]:
        """Name and date, as tables of forecasts name a start."""
        return self.berg.upper(), to_ten_minutes(self.date)

    def with_forcing(self, forcing: Any) -> Start:
        """Return the same start with its forcing."""
        return replace(self, forcing=forcing)

    @property
    def days_before(self) -> float:
        """Days from the earliest position that is known to the start."""
        return (self.date - min(self.before)) / timedelta(days=1)

    @property
    def speed(self) -> float:
        """Mean speed before the start, km a day; NaN where it is not known."""
        return float(np.hypot(*self.heading)) / self.days_before if self.before else np.nan

    @property
    def origin(self) -> tuple[float, float]:
        """Longitude and latitude at the begin of the motion before the start."""
        return self.before[min(self.before)]

    @property
    def heading(self) -> tuple[float, float]:
        """Motion over the days before the start, km east and north, as directions at the start have it."""
        east, north = local(self.lon, self.lat, *self.origin)
        return -float(east), -float(north)


@dataclass(frozen=True)
class Case:
    """One start with the positions seen afterwards."""

    start: Start
    seen: Mapping[float, tuple[float, float]]  # Longitude and latitude by lead time, days
    kept_back: bool | None = None  # By the list of a suite

    @property
    def held_out(self) -> bool:
        """Of a berg, or of a family, that nothing may be tuned on."""
        return family(self.start.berg) in HELD_OUT if self.kept_back is None else self.kept_back

    @property
    def tuned(self) -> bool:
        """Of a berg that oceans of this package were fitted to."""
        return self.start.berg in TUNED

    @property
    def box(self) -> tuple[float, float, float, float]:
        """West, east, south and north (degrees) of the area that products must cover: wherever the fastest berg could come."""
        reach = FASTEST * max(self.seen)
        north = min(float(moved(self.start.lon, self.start.lat, np.array(0.0), np.array(reach))[1]), 90.0)
        south = max(float(moved(self.start.lon, self.start.lat, np.array(0.0), np.array(-reach))[1]), -90.0)
        half = np.degrees(reach / (6371.0 * np.cos(np.radians(min(max(abs(north), abs(south)), 85.0)))))
        return self.start.lon - half, self.start.lon + half, south, north

    @property
    def dates(self) -> tuple[datetime, datetime]:
        """First and last date that products must cover."""
        return self.start.date, self.start.date + timedelta(days=max(self.seen))


DriftModel = Callable[..., Any]
"""A drift model of a start and dates, and in a suite of the forcing: returns longitude and latitude in degrees at each date, as
an array ``(dates, 2)``, or of an ensemble ``(members, dates, 2)``."""


def family(berg: str) -> str:
    """Return the name of the berg that a piece broke from: ``B15`` of ``B15AA``."""
    match = re.match(r"[A-Z]+\d+", berg)
    return match[0] if match else berg


def dressed_without(cases: Sequence[Case], berg: str) -> dict[str, Dressed]:
    """Return the baselines with their errors on training bergs, without a berg's own family.

    Pieces of one berg drift in the same water, and the parent's errors are the errors of the berg.
    """
    own_family = family(berg.upper().replace("-", ""))
    training = [case for case in cases if not case.held_out and family(case.start.berg) != own_family]
    return {name: Dressed(model, training) for name, model in BASELINES.items()}


def read_cases(folder: str | Path, leads: Sequence[int] = LEADS) -> list[Case]:
    """Read the cases of all tables of BYU and NIC in a folder.

    Parameters
    ----------
    folder : path
        Folder with one CSV table per berg; tables without columns of scatterometers are passed over.
    leads : sequence of int, optional
        Lead times, days.

    Returns
    -------
    list of Case
        By berg and date.

    Raises
    ------
    InputError
        If the folder holds no such table, or no case.
    """
    folder = Path(folder)
    remedy = "Name the folder of the unpacked database, with files such as a68a.csv"
    if not is_folder(folder):
        raise InputError("no such folder", where=str(folder), remedy=remedy)
    if not leads or any(not 1 <= lead <= 90 for lead in leads):
        raise InputError(f"lead times {list(leads)}", where="leads", remedy="Give whole days from 1 to 90")
    tables = [(path.stem.upper(), positions) for path in sorted(folder.glob("*.csv")) if (positions := _seen(path))]
    if not tables:
        raise InputError("no table with positions of scatterometers", where=str(folder), remedy=remedy)
    cases = [case for berg, positions in tables for case in _cases(berg, _without_jumps(positions), leads)]
    if not cases:
        raise InputError(
            f"no berg that moved north of {-NORTH_OF:g} S and was seen again", where=str(folder), remedy=remedy
        )
    return cases


def _seen(path: Path) -> dict[datetime, tuple[float, float]]:
    """Return the positions (longitude, latitude) of the days on which a scatterometer saw the berg."""
    rows = read_csv_rows(path)[0]
    names = {str(name).strip().lower() for name in rows[0] if name is not None}
    sensors = [s for s in SENSORS if s != "nic" and {f"{s}_1", f"{s}_2", f"{s}_3", "date"} <= names]
    seen = {}
    for number, row in enumerate(rows if sensors else ()):
        where = f"{path}, line {number + 2}"
        for s in sensors:
            try:
                lat, lon, flag = (float(row[f"{s}_{k}"] or 0.0) for k in (1, 2, 3))
            except (TypeError, ValueError) as error:
                raise InputError(f"{s}: no number", where=where, remedy="Get the table again") from error
            if flag == 1.0 and is_seen(lon, lat):
                if not (abs(lat) <= 90.0 and abs(lon) <= 360.0):
                    raise InputError(
                        f"{s}: latitude {lat:g}, longitude {lon:g}", where=where, remedy="Get the table again"
                    )
                seen[parse_date(row["date"], where=where)[0]] = (lon, lat)
                break
    return dict(sorted(seen.items()))


def _without_jumps(seen: Mapping[datetime, tuple[float, float]]) -> dict[datetime, tuple[float, float]]:
    """Drop positions that need more than `FASTEST` from the last one kept.

    If the next two fit each other and the positions kept before, the last one was wrong: a first position, or one
    after a gap, has nothing near by to be judged by.
    """

    def fit(*one_and_later: tuple[datetime, tuple[float, float]]) -> bool:
        (when, position), (later, later_position) = one_and_later
        return bool(distance(*position, *later_position) <= FASTEST * (later - when).days)

    positions = list(seen.items())
    accepted: list[tuple[datetime, tuple[float, float]]] = []
    for here, after in zip(positions, [*positions[1:], None], strict=True):
        if accepted and not fit(accepted[-1], here):
            two = after is not None and fit(here, after) and not fit(accepted[-1], after)
            if not two or not all(fit(previous, here) for previous in accepted[-2:-1]):
                continue
            accepted.pop()
        accepted.append(here)
    return dict(accepted)


def _cases(berg: str, seen: Mapping[datetime, tuple[float, float]], leads: Sequence[int]) -> Iterator[Case]:
    for when, position in seen.items():
        origin = seen.get(when - timedelta(days=DAYS_BEFORE))
        if position[1] <= NORTH_OF or origin is None or distance(*origin, *position) < SLOWEST * DAYS_BEFORE:
            continue
        dates: dict[float, datetime] = {lead: when + timedelta(days=lead) for lead in leads}
        later = {lead: seen[date] for lead, date in dates.items() if date in seen}
        days = (when - timedelta(days=back) for back in range(DAYS_BEFORE, 0, -1))
        if later:
            yield Case(Start(berg, when, *position, {day: seen[day] for day in days if day in seen}), later)


def staying_put(start: Start, dates: Sequence[datetime]) -> Floats:
    """Forecast that the berg stays where it is."""
    return np.tile([start.lon, start.lat], (len(dates), 1))


def constant_velocity(start: Start, dates: Sequence[datetime]) -> Floats:
    """Forecast that the berg goes on along its great circle with the mean velocity of the days before the start."""
    if not start.before:
        return np.full((len(dates), 2), np.nan)
    ratio = np.array([(when - start.date) / timedelta(days=start.days_before) for when in dates])
    return np.stack(extrapolate(*start.origin, start.lon, start.lat, ratio), axis=-1)


BASELINES: Final[Mapping[str, DriftModel]] = {"staying put": staying_put, "constant velocity": constant_velocity}


class Dressed:
    """A forecast with the errors that it made on other bergs: an ensemble.

    Parameters
    ----------
    model : callable
        Drift model of one position per date.
    training : iterable of Case
        Cases whose errors, along and across the motion before the start, are put on.
    """

    def __init__(self, model: DriftModel, training: Iterable[Case]) -> None:
        self.model = model
        errors: dict[float, list[tuple[float, float]]] = {}
        for case in training:
            for lead, members in forecast(model, case).items():
                (lon, lat), seen = members[0], case.seen[lead]
                east, north = local(lon, lat, *seen)
                ahead, left = along_across(east, north, case.start.heading)
                errors.setdefault(lead, []).append((float(ahead), float(left)))
        if not errors:
            raise InputError("no cases to take errors from", where="Dressed", remedy="Give cases of other bergs")
        self.errors = {lead: np.array(values) for lead, values in errors.items()}

    def __call__(self, start: Start, dates: Sequence[datetime]) -> Floats:
        """Return the members at each date."""
        positions = np.asarray(self.model(start, dates), float)
        days = [(when - start.date) / timedelta(days=1) for when in dates]
        # A case gets the same members in any order of the cases.
        random = np.random.default_rng([1, start.date.toordinal(), *start.berg.encode()])
        return np.stack([self.around(positions[k], start.heading, lead, random) for k, lead in enumerate(days)], axis=1)

    def around(
        self, position: Floats, heading: tuple[float, float], days: float, random: np.random.Generator
    ) -> Floats:
        """Return members (members, 2) around a forecast position, with the errors of the nearest lead time."""
        lead = min(self.errors, key=lambda each: abs(each - days))
        ahead, left = random.choice(self.errors[lead], DRESSED_MEMBERS).T
        e, n = np.divide(heading, np.hypot(*heading))
        return np.stack(moved(position[0], position[1], ahead * e - left * n, ahead * n + left * e), axis=-1)


def forecast(model: DriftModel, case: Case, *, complete: bool = True) -> dict[float, Floats]:
    """Return the positions ``(members, 2)`` that a model gives by lead time; checked.

    Unless they must be ``complete``, a model may give NaN for no position.
    """
    leads = sorted(case.seen)
    dates = [case.start.date + timedelta(days=lead) for lead in leads]
    where = str(case.start)
    try:
        positions = np.asarray(model(case.start, dates), float)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"the model fails: {type(error).__name__}: {error}", where=where) from error
    positions = positions[None] if positions.ndim == 2 else positions
    if positions.ndim != 3 or positions.shape[1:] != (len(leads), 2):
        raise InputError(
            f"the model returns an array of shape {positions.shape}", where=where,
            remedy=f"Return ({len(leads)}, 2), or (members, {len(leads)}, 2): longitude and latitude at each date",
        )  # fmt: skip
    has_position = np.isfinite(positions).all(axis=(0, 2))
    if (complete and not has_position.all()) or np.abs(positions[:, has_position, 1]).max(initial=0.0) > 90.0:
        raise InputError(
            f"the model returns {value_shown(positions)}", where=where, remedy="Return degrees for each date"
        )
    return {lead: positions[:, k] for k, lead in enumerate(leads) if has_position[k]}


@dataclass(frozen=True)
class Row:
    """Error of a forecast of one case at one lead time."""

    berg: str
    date: datetime
    lead: float  # Days
    error: float  # Distance of the mean of the members from the position that was seen, km
    held_out: bool
    tuned: bool


def compute_errors(model: DriftModel, cases: Iterable[Case]) -> list[Row]:
    """Return the errors of a model at all cases and lead times."""
    rows = []
    for case in cases:
        for lead, members in forecast(model, case).items():
            east, north = local(*case.seen[lead], members[:, 0], members[:, 1])
            error = float(np.hypot(east.mean(), north.mean()))
            rows.append(Row(case.start.berg, case.start.date, lead, error, case.held_out, case.tuned))
    return rows


def table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return bergs, starts and the median error by lead time, km, with its 90 % interval from drawing bergs, None of few."""
    result = []
    for lead in sorted({row.lead for row in rows}):
        by_berg: dict[str, list[float]] = {}
        for row in rows:
            if row.lead == lead:
                by_berg.setdefault(row.berg, []).append(row.error)
        groups = [np.array(errors) for errors in by_berg.values()]
        few = len(groups) < FEWEST
        low, high = (None, None) if few else bootstrap_interval(groups, np.median)
        pooled = np.concatenate(groups)
        result.append(
            {"lead_days": lead, "bergs": len(groups), "starts": len(pooled), "median_km": float(np.median(pooled)),
             "low_km": low, "high_km": high, "p90_km": float(np.quantile(pooled, 0.9))}
        )  # fmt: skip
    return result


def ensemble_table(model: DriftModel, cases: Iterable[Case], error: float) -> list[dict[str, Any]]:
    """Return the scores of an ensemble by lead time, with an error of the observation (km) added to its members."""
    points: dict[float, list[Point]] = {}
    for case in cases:
        for lead, members in forecast(model, case).items():
            if len(members) < 2:
                raise InputError(
                    f"{len(members)} members", where="ensemble_table", remedy="Give an ensemble, or dress it"
                )
            ahead = np.stack(_in_axes(case.start, members[:, 0], members[:, 1]), axis=-1)
            points.setdefault(lead, []).append(
                Point(case.start.berg, ahead, np.array(_in_axes(case.start, *case.seen[lead])))
            )
    return [{"lead_days": lead, **position_scores(points[lead], error)} for lead in sorted(points)]


def _in_axes(start: Start, lon: Any, lat: Any) -> tuple[Floats, Floats]:
    """Return kilometres from the start, along and across the motion before it."""
    return along_across(*local(start.lon, start.lat, lon, lat), start.heading)


COLUMNS: Final = ("berg", "start", "lead_days", "lon", "lat")
"""Columns of a table of forecasts, made by any program."""


def write_cases(cases: Iterable[Case], path: Path, names: Sequence[str] = ()) -> Path:
    """Write the starts, with box and dates of the products that each needs, one row per lead time; no observations.

    ``names``: of the case of a suite that each start belongs to; a column where they are given.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        (*(["case"] if names else []), "berg", "start", "lead_days", "start_lon", "start_lat", "lon_3_days_before",
         "lat_3_days_before", "held_out", "tuned", "west", "east", "south", "north", "first", "last")
    )  # fmt: skip
    for k, case in enumerate(cases):
        s, box, (first, last) = case.start, case.box, case.dates
        for lead in sorted(case.seen):
            writer.writerow(
                (*names[k : k + 1], s.berg, s.day, lead, s.lon, s.lat, *(s.origin if s.before else ("", "")),
                 int(case.held_out), int(case.tuned), *(f"{side:.2f}" for side in box), f"{first:%Y-%m-%d}", f"{last:%Y-%m-%d}")
            )  # fmt: skip
    write_text(path, text.getvalue())
    return path


class Forecasts:
    """Positions that were forecast, as a drift model; several of a start and lead time are members.

    Parameters
    ----------
    source : str
        Where they come from, for messages.
    complete : bool, optional
        Refuse a start that is missing, or one whose lead times differ in their members; otherwise there is no position.
    """

    def __init__(self, source: str, *, complete: bool = True) -> None:
        self.source, self.complete = source, complete
        self._made: dict[tuple[str, datetime, datetime], list[tuple[float, float]]] = {}

    def keep(self, berg: str, date: datetime, lead: float, lon: float, lat: float) -> None:
        """Keep a position; ``lead``: days."""
        key = berg.upper(), to_ten_minutes(date), to_ten_minutes(date + timedelta(days=lead))
        self._made.setdefault(key, []).append((lon, lat))

    def __call__(self, start: Start, dates: Sequence[datetime]) -> Any:
        """Return the positions at dates."""
        keys = [(*start.key, to_ten_minutes(when)) for when in dates]
        members = {len(self._made.get(key, ())) for key in keys}
        if self.complete and (0 in members or len(members) > 1):
            fault = "no forecast" if 0 in members else "lead times with different numbers of members"
            raise InputError(
                fault,
                where=f"{self.source}: {start}",
                remedy="Forecast every row of cases.csv, with as many members each",
            )
        most = max(*members, 1)
        rows = [[*self._made.get(key, ()), *[(np.nan, np.nan)] * most][:most] for key in keys]
        return np.array(rows).swapaxes(0, 1)


def to_ten_minutes(date: datetime) -> datetime:
    """Return a date to the nearest ten minutes: programs write dates some seconds off."""
    later = date + timedelta(minutes=5)
    return later.replace(minute=later.minute // 10 * 10, second=0, microsecond=0)


def read_forecasts(path: Path, *, complete: bool = True) -> Forecasts:
    """Return the forecasts of a table (`COLUMNS`; several rows of a start and lead time are members) as a drift model."""
    rows = [{str(key).strip().lower(): value or "" for key, value in row.items()} for row in read_csv_rows(path)[0]]
    missing = [name for name in COLUMNS if name not in rows[0]]
    if missing:
        raise InputError(f"no column {missing[0]!r}", where=str(path), remedy=f"Columns are {', '.join(COLUMNS)}")
    forecasts = Forecasts(str(path), complete=complete)
    for number, row in enumerate(rows):
        where = f"{path}, line {number + 2}"
        try:
            lead, lon, lat = float(row["lead_days"]), float(row["lon"]), float(row["lat"])
        except (TypeError, ValueError) as error:
            raise InputError(
                "lead_days, lon or lat is no number", where=where, remedy="Give days and degrees"
            ) from error
        if not is_seen(lon, lat):
            raise InputError(
                f"latitude {lat:g}, longitude {lon:g} are no position", where=where, remedy="Leave the row out"
            )
        forecasts.keep(row["berg"], parse_date(row["start"], where=where)[0], lead, lon, lat)
    return forecasts
