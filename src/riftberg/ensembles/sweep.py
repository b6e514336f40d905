"""A sweep: a run for every combination of the varied inputs, on all cores or machines, and one result of all runs."""

from __future__ import annotations

import json
import logging
import math
import re
import shutil
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, Literal, TypedDict, Unpack

import numpy as np
import xarray as xr

from riftberg.config.units import count_text, duration_text
from riftberg.config.values import check_names, native, number
from riftberg.constants import SECONDS_PER_DAY
from riftberg.ensembles.cluster import compute_members, connect_client, cores
from riftberg.ensembles.distributions import PLANS
from riftberg.ensembles.member import (
    CELLS,
    CONTROL,
    CONTROL_RUN,
    STOP,
    UNDO,
    Job,
    Maker,
    Outcome,
    build_member,
    compute_digest,
    with_values,
)
from riftberg.ensembles.probability import Breaks, with_probabilities
from riftberg.ensembles.result import (
    MEANS,
    MOST_LISTED,
    build_dataset,
    longest_text,
    open_sweep,
    write_blocks,
    write_sweep,
)
from riftberg.ensembles.uncertain import check_sizes, with_errors
from riftberg.ensembles.vary import Draws, Varied, grouped, list_members, plan_from_design, read_varied, vary_with_file
from riftberg.errors import InputError, without_secrets
from riftberg.experiments.changes import changed, format_settings, origin
from riftberg.experiments.registry import Options
from riftberg.ocean.files_forcing import forget_forcings
from riftberg.parameters import GROUPS
from riftberg.plane import EqualAreaPlane
from riftberg.runs.progress import SweepBar
from riftberg.state import Floats
from riftberg.system.atomic_files import only_writer, replacing, write_text
from riftberg.system.input_files import check_file, is_folder, large_allowed, reading, value_shown
from riftberg.system.process import Hold, held

if TYPE_CHECKING:
    from riftberg.runs.model import Model

_LOG = logging.getLogger(__name__)

PLAN: Final = "sweep.json"
"""File that says what a sweep is."""

DIGEST: Final = "checksum"
"""Entry of each file that a sweep goes on from."""

MEMBERS: Final = "members"
"""Folder of what is done."""

PART: Final = re.compile(r"part-(\d+)-of-(\d+)")
"""Name of the folder of a part of a sweep: its number, and how many there are."""

WEIGHTS: Final = "weights.json"
"""File of the weights of members after new sightings."""

BLOCK: Final = 250
"""Members that are in memory at once while the result is written."""

FIRST_LOOK: Final = 20
"""Runs after which a first result is written while the others go on; then whenever they have doubled."""

MOST_LAG: Final = 30.0
"""Days that a member of a forecast may start before it, or the length of the forecast."""

MEMBER: Final = "forcing.member"
"""Key of the member of a product."""


USUAL_HOURS: Final = 6.0
"""Interval of the tracks, h."""


class WorkerOptions(TypedDict, total=False):
    """Where the members of a sweep run."""

    scheduler: Any  # Address of a dask scheduler, or a client of it, whose workers run the members
    # Processes of this machine, one for each core by default; 0 runs one member after the other in this process
    workers: int | None
    save_seconds: float  # Wall time between two saved states of a member, s; 60 by default
    # Wall time (s, or text such as "10 min") after which a member is left unfinished; none by default
    member_time: float | str | None


class SweepOptions(WorkerOptions, total=False):
    """Options of `sweep` beside its own arguments: where the members run, and settings that all of them share."""

    # Write fresh water, heat and mass of each member on cells this wide (degrees), as ``riftberg run --cells``, into
    # the folder ``cells`` of ``output``. A member that is stopped or lost begins anew then
    cells: float | None
    changes: Mapping[str, Mapping[str, Any]] | None  # Parameters by group and name
    without: Iterable[str]  # As for ``riftberg run``
    data: str | Path | None  # As for ``riftberg run``
    numerics: Literal["own", "reference"] | None  # As for ``riftberg run``
    members: int | None  # How often is drawn what has a distribution, and the random errors
    plan: Literal["sobol", "random", "latin-hypercube"]  # How it is drawn; Sobol' numbers by default
    seed: int  # Seed of all that is drawn; 1 by default


def sweep(
    experiment: str | Path | Maker,
    vary: Mapping[str, Any] | Iterable[str] = (),
    *,
    days: float | str | None = None,
    every_hours: float | str | None = None,
    output: str | Path | None = None,
    resume: bool = False,
    progress: bool = False,
    **options: Unpack[SweepOptions],
) -> xr.Dataset:
    """Run an experiment for every combination of the values of some parameters, on many cores or machines.

    Parameters
    ----------
    experiment : str, path or callable
        Built-in experiment or YAML file; or a function that takes the varied inputs by name and returns a `riftberg.Model`.
    vary : mapping, or iterable of str, optional
        Inputs to vary, beside or instead of the section ``vary`` of an experiment file. Values by ``group.name``: a list, an
        array, or a text such as ``"14..24kPa:11"`` (eleven values) or ``"14, 18, 24 kPa"``.
        The last one changes fastest. Or texts such as ``"fracture.normal_strength=14..24kPa:11"``.
        A distribution needs ``members``: ``"lognormal(18 kPa, 20 %)"``. Beside parameters, ``start``,
        ``current_error``, ``wind_error`` and ``floor_error`` may be varied (`riftberg.ensembles.uncertain`).
    days : float or str, optional
        Length of the runs; needed where a function makes the models.
    every_hours : float or str, optional
        Interval of the tracks; by default 6 h, or the length of the runs where they are shorter.
    output : path, optional
        Folder for ``sweep.nc`` and the outcomes so far; without it nothing is kept on disk. Workers on other machines
        must reach it to save states there.
    resume : bool
        Go on with the sweep in ``output``: members that are done stay, those that failed are tried again.
    progress : bool, optional
        Show how many members are done.
    **options
        Settings that all members share (changes, without, data, numerics, cells), how they are drawn (members, plan, seed),
        and where they run, and how long (scheduler, workers, save_seconds, member_time): `SweepOptions`.

    Returns
    -------
    xarray.Dataset
        Dimensions ``member``, ``fragment`` and ``time``; see `riftberg.ensembles.result`. A member that failed has status 1
        and its message; the others are not touched by it.

    Raises
    ------
    InputError
        If an input cannot be varied; before the first run.
    KeyboardInterrupt
        After Ctrl-C, when the members under way have saved their states; `resume` goes on.

    Examples
    --------
    >>> from riftberg import Forcing, Iceberg, Model
    >>> def drifting(speed):
    ...     berg = Iceberg.rectangle("6 km", "3 km", thickness=200.0, placement=(-37.0, -56.0))
    ...     return Model(berg, Forcing.uniform(current=(speed, 0.0)))
    >>> result = sweep(drifting, {"speed": [0.1, 0.2]}, days="1 h", every_hours=1, workers=0)
    >>> result.sizes["member"], result["status"].values.tolist()
    (2, [0, 0])
    """
    check_names(options, SweepOptions)
    every = None if every_hours is None else number(every_hours, "h", where="every_hours")
    plan = make_plan(experiment, vary, common_options(days, options), every, options.get("cells"), read_draws(options))
    return run_plan(plan, output, resume, progress, options)


def run_plan(
    plan: Plan, output: str | Path | None, resume: bool, progress: bool, options: Mapping[str, Any]
) -> xr.Dataset:
    """Run a plan in its folder, or in one that is removed afterwards, and return the result in memory."""
    if plan.cells is not None and output is None:
        raise InputError("files on cells need a folder", where="cells", remedy="Give output")
    where: dict[str, Any] = {name: value for name, value in options.items() if name in WorkerOptions.__annotations__}
    with TemporaryDirectory(prefix="riftberg-") if output is None else nullcontext(output) as folder:
        store = Store(Path(folder).absolute(), plan, resume=resume)
        bar = SweepBar(len(store.numbers)) if progress else None
        return run_sweep(store, bar=bar, **where).load()


def read_draws(options: Mapping[str, Any]) -> Draws:
    """Return how members are drawn, checked."""
    count, seed, plan = (native(options.get(name)) for name in ("members", "seed", "plan"))
    seed, plan = 1 if seed is None else seed, plan or "sobol"
    for name, value, least in (("members", count, 1), ("seed", seed, 0)):
        if value is not None and (not isinstance(value, int) or isinstance(value, bool) or value < least):
            raise InputError(
                f"{value_shown(value)} is not possible", where=name, remedy=f"Give a whole number, {least} or more"
            )
    if plan not in PLANS:
        raise InputError(f"{value_shown(plan)} is no plan", where="plan", remedy=f"Use {', '.join(PLANS)}")
    return Draws(count or 0, plan, seed)


def common_options(days: float | str | None, options: SweepOptions) -> Options:
    """Return the options that all members share."""
    data = options.get("data")
    return Options(
        changes=dict(options.get("changes") or {}), days=None if days is None else number(days, "day", where="days"),
        data=None if data is None else Path(data), without=frozenset(options.get("without", ())),
        numerics=options.get("numerics"),
    )  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """A checked plan of a sweep."""

    experiment: str | Maker
    options: Options  # Common to all members
    varied: tuple[Varied, ...]
    members: Sequence[dict[str, Any]]  # Values by name of each member
    first: Model  # Of the first member, at its start
    days: float  # Length of the runs, days, and interval of the tracks, s
    every: float  # Length of the runs, days, and interval of the tracks, s
    cells: float | None = None  # Width (degrees) of the cells on which each member writes
    draws: Draws = field(default_factory=Draws)  # How members are drawn
    forecast: bool = False  # A control is run too, and the result holds probabilities
    design: bool = False  # Members are rows of a table, not combinations
    digest: str = ""  # Checksum of the experiment file
    start: datetime = datetime.min  # Of the forecast, or of the first member of a sweep

    def lag(self, number: int) -> float:
        """Return how much earlier than the forecast a member starts, s."""
        start = None if number == CONTROL or not self.forecast else self.members[number].get("start")
        return 0.0 if start is None else (self.start - datetime.fromisoformat(str(start))).total_seconds()

    @property
    def named(self) -> str:
        """Name of the experiment."""
        if isinstance(self.experiment, str):
            return self.experiment
        return str(getattr(self.experiment, "__qualname__", self.experiment))

    @property
    def control(self) -> dict[str, Any]:
        """Values of the run in which nothing is varied: of products with members the first, which is their control."""
        return {MEMBER: 0} if any(v.name == MEMBER for v in self.varied) else {}

    def described(self) -> dict[str, Any]:
        """Return the settings that a resumed sweep must share with the earlier one, as plain data."""
        o = self.options
        return {
            "experiment": self.named,
            "days": self.days,
            "every": self.every,
            "changes": {group: dict(values) for group, values in o.changes.items()},
            "without": sorted(o.without),
            "data": None if o.data is None else str(o.data),
            "numerics": o.numerics,
            "cells": self.cells,
            "vary": {v.name: v.plain() for v in self.varied},
            **({"digest": self.digest} if self.digest else {}),
            **({"forecast": True} if self.forecast else {}),
            **({"design": True} if self.design else {}),
            **({"members": d.number, "plan": d.plan, "seed": d.seed} if (d := self.draws).number else {}),
        }

    def job(self, number: int, folder: Path, save_seconds: float, most_seconds: float = math.inf) -> Job:
        """Return the input of a worker for a member."""
        values = self.control if number == CONTROL else self.members[number]
        lag = self.lag(number)
        return Job(
            number, values, self.experiment, self.options, self.days + lag / SECONDS_PER_DAY, self.every, folder, save_seconds,
            large_allowed(), self.cells, self.digest, lag, most_seconds, self.first.parameters.time_step,
        )  # fmt: skip


def make_plan(
    experiment: str | Path | Maker, vary: Any, options: Options, every_hours: float | None, cells: float | None = None,
    draws: Draws | None = None, *, forecast: bool = False, design: bool = False,
) -> Plan:  # fmt: skip
    """Check all of a sweep that can be checked before its first run; without an interval the usual one is taken."""
    source: Any = experiment if callable(experiment) else str(experiment)
    if isinstance(source, str) and source.endswith((".yaml", ".yml")):
        source = str(Path(source).absolute())
    draws = draws or Draws()
    if design:
        varied, members = plan_from_design(vary, free=callable(experiment))
        check_sizes([v.name for v in varied])
    else:
        varied = read_varied(vary_with_file(experiment, vary, options.data), free=callable(experiment))
        check_sizes([v.name for v in varied])
        members = list_members(varied, draws)
    length = options.days
    if isinstance(source, str):
        from riftberg.experiments import build

        first, info = build(source, with_values(options, members[0]))
        length = info.days if length is None else length
        # All combinations by their parameters alone, which is quick; only the first and the last are built.
        _check_members(first, members, varied)
        try:
            last, _ = build(source, with_values(options, members[-1]))
        except InputError as error:  # the first could be built, so it is what is varied
            raise InputError(error.what, where=_member_text(members[-1]), remedy=error.remedy) from error
        for model, values in ((first, members[0]), (last, members[-1])):
            with_errors(model, values)
        # What the experiment sets itself, such as the packing of its bonds, cannot be varied.
        for model, values in ((first, members[0]), (last, members[-1])):
            for group, inner in grouped(values).items():
                for key, value in inner.items() if group in GROUPS else ():
                    actual = getattr(getattr(model.parameters, group, None), key, None)
                    if actual != value and value:  # 0 and none mean: find it
                        raise InputError(
                            f"{source} keeps {group}.{key} = {value_shown(actual)} whatever is given",
                            where=f"--vary {group}.{key}",
                            remedy="Vary another parameter, or give a function that makes the models",
                        )  # fmt: skip
    elif length is None:
        raise InputError("the length of the runs is missing", where="days", remedy="Give days")
    else:
        first = build_member(Job(0, members[0], source, options, length, 1.0, Path()))
    if not 0.0 < length < 1e6:
        raise InputError(f"{length:g} days", where="days", remedy="Give a finite number above 0")
    if every_hours is None:
        every_hours = min(USUAL_HOURS, 24.0 * length)
    if not 0.0 < every_hours <= 24.0 * length:
        raise InputError(
            f"a position every {every_hours:g} h in runs of {duration_text(length)}", where="every_hours",
            remedy="Give a number above 0, at most the length of the runs",
        )  # fmt: skip
    first.fit_time_step(3600.0 * every_hours)
    return Plan(
        source,
        options,
        varied,
        members,
        first,
        length,
        3600.0 * every_hours,
        _cells(cells, first),
        draws,
        forecast,
        design,
        compute_digest(source),
        _find_start(source, options, members, first, length) if forecast else first.start,
    )


def _find_start(
    experiment: Any, options: Options, members: Sequence[dict[str, Any]], first: Model, days: float
) -> datetime:
    """Return the start of a forecast: of its file or its control. Members that start at other dates start before it."""
    if "start" not in members[0]:
        return first.start
    if isinstance(experiment, str):
        from riftberg.experiments.yaml_file import read_file

        start = read_file(Path(experiment), options.changes, options.data)[0].start
    else:
        try:
            start = build_member(Job(CONTROL, {}, experiment, options, days, 1.0, Path())).start
        except Exception:  # a function that must be given a start has no control
            start = first.start
    dates = [datetime.fromisoformat(str(member["start"])) for member in members]
    if max(dates) > start or min(dates) <= start - timedelta(days=max(days, MOST_LAG)):
        wrong = max(dates) if max(dates) > start else min(dates)
        raise InputError(
            f"a member starts on {wrong:%Y-%m-%d %H:%M}, the forecast on {start:%Y-%m-%d %H:%M}", where="start",
            remedy=f"Members start with the forecast or up to {max(days, MOST_LAG):g} days before it",
        )  # fmt: skip
    return start


def _cells(width: float | None, first: Model) -> float | None:
    """Return the width of the cells (degrees) on which the members write; refuses one on which they cannot."""
    if width is None:
        return None
    width = number(width, "degree", where="cells")
    if not 0.01 <= width <= 10.0:
        raise InputError(f"cells of {width:g} degrees", where="cells", remedy="Give 0.01 to 10 degrees")
    if not first.parameters.earth.latlon:
        raise InputError("the runs are in metres, cells in degrees", where="cells", remedy="Leave cells out")
    return width


def _check_members(first: Model, members: Sequence[dict[str, Any]], varied: Sequence[Varied]) -> None:
    """Refuse combinations of values that no run can have.

    All combinations of listed values are checked. Drawn values were checked one by one, so only the members with the smallest
    and the largest are checked: every one of 10,000 draws took half a minute.
    """
    inputs = [v for v in varied if v.name.partition(".")[0] in GROUPS]
    drawn = [v.name for v in inputs if v.distribution is not None and not v.distribution.choices]
    orders = [
        np.argsort([values[v.name] for values in members]) for v in inputs if v.name in drawn and v.components == 1
    ]
    ends = {int(order[end]) for order in orders for end in (0, -1)}
    seen: set[tuple[str, ...]] = set()
    for k, values in enumerate(members if inputs else ()):
        combination = tuple(str(values[v.name]) for v in inputs if v.name not in drawn)
        if combination not in seen or k in ends:
            seen.add(combination)
            changed(first.parameters, grouped(values), where=_member_text(values))


def _member_text(values: Mapping[str, Any]) -> str:
    settings = ", ".join(f"{name} = {value_shown(value)}" for name, value in values.items())
    return f"--vary, member with {settings}"


def write_record(path: Path, record: Mapping[str, Any], *, indent: int | None = None) -> None:
    """Write what a sweep goes on from as JSON, with a checksum, which reveals a flipped bit."""
    write_text(path, json.dumps({**record, DIGEST: _checksum(record)}, indent=indent) + "\n")


def read_record(path: Path) -> dict[str, Any]:
    """Return what `write_record` has written; a ValueError, TypeError or OSError says that it is not that."""
    record = dict(json.loads(path.read_text("utf-8")))
    if record.pop(DIGEST, None) != _checksum(record):
        raise ValueError("its values are not those that were written")
    return record


def _checksum(record: Mapping[str, Any]) -> int:
    return zlib.crc32(json.dumps(record, sort_keys=True).encode())


class Store:
    """The folder of a sweep: its plan and the outcomes so far."""

    def __init__(self, folder: Path, plan: Plan, *, resume: bool, part: tuple[int, int] | None = None) -> None:
        if part is None and resume and (match := PART.fullmatch(folder.name)):
            part = int(match[1]), int(match[2])  # a part that goes on stays one
        elif part is not None:
            folder = folder / f"part-{part[0]}-of-{part[1]}"
        self.folder, self.plan = folder, plan
        self.members = folder / MEMBERS
        self.numbers = range(CONTROL if plan.forecast else 0, len(plan.members))
        # Each part takes every n-th member, so that parts take equally long where the time depends on what is varied.
        self.assigned = [k for k in self.numbers if part is None or k % part[1] == part[0] - 1]
        self.file = folder / ("forecast.nc" if plan.forecast else "sweep.nc")
        self.look: Callable[[xr.Dataset], None] | None = None  # What is done with the result of the first members
        self.done: dict[int, str] = {}  # Status of the members that were run; what they came to is in their files
        self._fragments, self._means, self._message = 0, set[str](), 1  # What the result has room for
        # Through JSON, as the plan that is read back: a tuple would differ from the list that it became.
        described = json.loads(without_secrets(json.dumps(plan.described(), default=str)))
        where = str(folder)
        if (folder / PLAN).exists():
            saved = read_plan(folder)
            if not resume:
                raise InputError(
                    "holds a sweep already", where=where, remedy="Go on with it by --resume, or name another"
                )
            different = sorted(key for key in described if saved.get(key) != described[key])
            if different == ["members"]:
                if plan.draws.plan == "latin-hypercube":
                    raise InputError(
                        "members cannot be added to a Latin hypercube, which divides the range by their number", where=where,
                        remedy="Begin anew, or use --plan sobol, which takes more",
                    )  # fmt: skip
                if saved["members"] > described["members"]:
                    raise InputError(
                        f"holds {saved['members']} members", where=where, remedy="Give that number, or a larger one"
                    )
                different = []
            if "digest" in different:
                raise InputError(f"{plan.named} has changed since the sweep began", where=where, remedy=UNDO)
            if different:
                raise InputError(
                    f"holds another sweep: {different[0]} is {value_shown(saved.get(different[0]))}", where=where,
                    remedy=f"Here it is {value_shown(described[different[0]])}; name another folder",
                )  # fmt: skip
            for number in self.numbers:
                outcome = self.outcome(number)
                if outcome is not None:
                    self._count(outcome)
        elif resume:
            raise InputError("holds no sweep that could be gone on with", where=where, remedy="Leave --resume out")
        self._described = described

    @contextmanager
    def taken(self) -> Iterator[None]:
        """Hold the folder for this sweep alone; it is made here, when nothing else can be refused any more."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with only_writer(self.folder / PLAN):
            self.begin()
            yield

    def begin(self) -> None:
        """Write the plan."""
        self.members.mkdir(parents=True, exist_ok=True)
        (self.members / STOP).unlink(missing_ok=True)
        write_record(self.folder / PLAN, self._described, indent=1)

    def outcome(self, number: int) -> Outcome | None:
        """Return the outcome of a member; None where it cannot be read, so that the member runs again."""
        try:
            return Outcome(**read_record(self.members / f"{number:05d}.json"))
        except (ValueError, TypeError, OSError):
            return None

    def keep(self, outcome: Outcome) -> None:
        """Save the outcome of a member."""
        write_record(self.members / f"{outcome.number:05d}.json", vars(outcome))
        self._count(outcome)

    def _count(self, outcome: Outcome) -> None:
        self.done[outcome.number] = outcome.status
        self._fragments = max(self._fragments, min(len(outcome.fragments.get("number", ())), MOST_LISTED))
        self._means.update(name for name in MEANS if name in outcome.totals)
        self._message = max(self._message, len(outcome.message.encode()))

    def waiting(self) -> list[int]:
        """Return the members that are still to be run; those that failed are tried again, unfinished ones go on."""
        return [k for k in self.assigned if self.done.get(k) != "done"]

    def stop(self) -> None:
        """Ask the members under way to save their states and stop."""
        (self.members / STOP).touch()

    def write(self) -> None:
        """Write the result, a block of members at a time: memory does not grow with their number."""
        plan = self.plan
        kind = "Forecast" if plan.forecast else "Sweep"
        name = Path(plan.named).stem if plan.named.endswith((".yaml", ".yml")) else plan.named
        runs = count_text(len(plan.members), "run")
        title = f"{kind} of {name}: {runs} with {', '.join(v.name for v in plan.varied)} varied"
        about = {"title": title, "experiment": plan.named, "parameters_json": plan.first.parameters.model_dump_json(),
                 "comment": "parameters_json holds the parameters of the first member",
                 **({"plan": plan.draws.plan} if plan.draws.number else {}), **self._origin()}  # fmt: skip
        common: dict[str, Any] = {
            "start": plan.start, "lagged": plan.forecast, "days": plan.days, "every": plan.every,
            "latlon": plan.first.parameters.earth.latlon, "attributes": about,
        }  # fmt: skip
        weight = self.weights().get("weight")
        breaks = Breaks(self._ice(), weight) if plan.forecast else None

        def blocks() -> Iterator[xr.Dataset]:
            for first in range(0, len(plan.members), BLOCK):
                members = plan.members[first : first + BLOCK]
                read = {k: self.outcome(first + k) for k in range(len(members)) if first + k in self.done}
                outcomes = {k: outcome for k, outcome in read.items() if outcome is not None}
                ds = build_dataset(
                    plan.varied, members, outcomes, room=(self._fragments, sorted(self._means)), **common
                )
                ds = ds.assign_coords(member=("member", first + ds["member"].values, ds["member"].attrs))
                if breaks is not None:
                    breaks.add(ds, {first + k: _since(o.cracks, plan.lag(first + k)) for k, o in outcomes.items()})
                yield ds

        with replacing(self.file) as temporary:
            write_blocks(blocks(), temporary, max(self._message, longest_text(plan.members)))
            if breaks is not None:
                written = open_sweep(temporary, tracks=False)
                ds = with_probabilities(written, breaks, weight).assign(self._control(common))
                written.close()
                write_sweep(ds.drop_vars(list(written.variables)), temporary, more=True)

    def _ice(self) -> tuple[Floats, Floats, float]:
        """Return the places (m) of the elements of the first member about their middle, and their side (m)."""
        e, earth = self.plan.first.elements, self.plan.first.parameters.earth
        plane = EqualAreaPlane(float(e.lon.mean()), float(e.lat.mean()), earth.radius, earth.latlon)
        return *plane.forward(e.lon, e.lat), float(np.sqrt(np.mean(e.length * e.width)))

    def _origin(self) -> dict[str, str]:
        """Return the attributes by which ``riftberg rerun`` repeats one of the members."""
        o = self.plan.options
        if not isinstance(self.plan.experiment, str):
            return {}
        words = ["--days", repr(self.plan.days), *(word for name in sorted(o.without) for word in ("--without", name))]
        words += [] if o.numerics is None else ["--numerics", o.numerics]
        return origin(self.plan.experiment, words, format_settings(o.changes), o.data, self.folder)

    def weights(self) -> dict[str, Any]:
        """Return the weights of the members by new sightings; empty where there were none."""
        file = self.folder / WEIGHTS
        with reading(file, "damaged weights of members", "Remove it, and run 'riftberg update' again"):
            weights = read_record(file) if file.exists() else {}
        # Members that were added since have not been weighted yet.
        return weights if len(weights.get("base", self.plan.members)) == len(self.plan.members) else {}

    def set_base(self, base: Sequence[float]) -> None:
        """Note the logarithms of the probabilities by which members were chosen around others."""
        write_record(self.folder / WEIGHTS, {"base": list(base)})

    def _control(self, common: Mapping[str, Any]) -> dict[str, Any]:
        """Return the run of a forecast in which nothing is varied."""
        control = self.outcome(CONTROL)
        if control is None or control.status != "done":
            return {}
        alone = build_dataset((), [{}], {0: replace(control, number=0)}, **common).isel(member=0, drop=True)
        fields = {}
        for name in (n for n in ("lon", "lat", "x", "y", "area", "first_breakup", "largest_area") if n in alone):
            values = alone[name].drop_vars("fragment", errors="ignore")
            values = values.rename(fragment="control_fragment") if "fragment" in values.dims else values
            fields[f"control_{name}"] = values.assign_attrs(long_name=f"control: {values.attrs.get('long_name', name)}")
            fields[f"control_{name}"].attrs.pop("coordinates", None)  # those are of the members
        return fields


def _since(cracks: list[list[float]], lag: float) -> np.ndarray[Any, Any]:
    """Return broken bonds with their times (s) since the start of the forecast."""
    rows = np.array(cracks, float).reshape(-1, 4)
    rows[:, 0] -= lag
    return rows


def join_parts(folder: Path) -> list[int]:
    """Bring the members of all parts below a folder together in it, as one sweep; return the numbers of missing parts."""

    def refuse(fault: str, remedy: str) -> None:
        raise InputError(fault, where=f"--join {folder}", remedy=remedy)

    sources = sorted(folder.glob("part-*-of-*")) if is_folder(folder) else []
    plans = {path.name: read_plan(path) for path in sources}
    if not plans:
        refuse("holds no parts of a sweep", "Run them by --part 1/4 and the same --output")
    first, *others = plans.items()
    for name, plan in others:
        if plan != first[1]:
            refuse(f"{first[0]} and {name} are parts of different sweeps", "Run them alike")
    counts = {name.rpartition("-")[2] for name in plans}
    if len(counts) > 1:
        refuse(f"parts of {' and '.join(sorted(counts))}", "Remove those that do not belong")
    if (folder / PLAN).exists() and read_plan(folder) != first[1]:
        refuse("holds another sweep than its parts", "Move the parts to a folder of their own")
    for source in sources:
        for file in sorted(
            [*(source / MEMBERS).glob("*.json"), *(source / CELLS).glob("*.nc"), *source.glob(CONTROL_RUN)]
        ):
            target = folder / file.relative_to(source)
            target.parent.mkdir(exist_ok=True)
            with replacing(target) as copy:
                shutil.copyfile(file, copy)
    write_record(folder / PLAN, first[1], indent=1)
    present = {int(name.split("-")[1]) for name in plans}
    return sorted(set(range(1, int(counts.pop()) + 1)) - present)


def read_plan(folder: Path) -> dict[str, Any]:
    """Return the plan of the sweep in a folder."""
    file = folder / PLAN if is_folder(folder) else folder
    check_file(file, remedy="Name a folder that 'riftberg sweep' made", missing="holds no sweep")
    with reading(file, "not the plan of a sweep, or a damaged one", "Name a folder that 'riftberg sweep' made"):
        plan = read_record(file)
        plan["vary"], plan["experiment"], plan["days"]
    return plan


def run_sweep(
    store: Store, *, scheduler: Any = None, workers: int | None = None, save_seconds: float = 60.0,
    member_time: float | str | None = None, bar: SweepBar | None = None,
) -> xr.Dataset:  # fmt: skip
    """Run the members that wait, write the result, and return it with its tracks still in the file."""
    workers = native(workers)
    if workers is not None and (not isinstance(workers, int) or isinstance(workers, bool) or workers < 0):
        raise InputError(f"{workers!r} processes", where="workers", remedy="Give a whole number, 0 or more")
    most = math.inf if member_time is None else number(member_time, "s", where="member_time")
    if not most > 0.0:
        raise InputError(f"{most:g} s", where="member_time", remedy="Give a time above 0, such as 10 min")
    numbers = store.waiting()
    for k in numbers:
        store.done.pop(k, None)
    jobs = (store.plan.job(k, store.members, save_seconds, most) for k in numbers)
    _LOG.info("%d of %d members to run", len(numbers), len(store.plan.members))
    processes = min(cores() if workers is None else workers, len(numbers))
    with (
        held() as hold,
        connect_client(scheduler) if scheduler is not None and numbers else nullcontext() as client,
        store.taken(),
    ):
        try:
            _collect(store, compute_members(jobs, client, processes, hold), hold, bar)
        finally:  # what is done is kept, also after Ctrl-C
            forget_forcings()
            (store.members / STOP).unlink(missing_ok=True)
            store.write()
            if bar is not None:
                bar.stop()
    return open_sweep(store.file, tracks=False)


def _collect(store: Store, outcomes: Iterator[Outcome], hold: Hold, bar: SweepBar | None) -> None:
    if bar is not None:
        bar.show(store.done)
    # A signal asks the members to stop; the loop goes on until all of them have saved their states.
    hold.then(store.stop)
    due = max(FIRST_LOOK, 2 * len(store.done))
    for outcome in outcomes:
        if outcome.status == "stopped":
            continue
        store.keep(outcome)
        _LOG.info("member %d %s %s", outcome.number, outcome.status, outcome.message)
        if bar is not None:
            bar.show(store.done)
        if store.look is not None and len(store.done) >= due and len(store.done) < len(store.numbers):
            due = 2 * len(store.done)
            # Write the result of the members that are done, and show it; whatever goes wrong is left to the end.
            try:
                store.write()
                result = open_sweep(store.file, tracks=False)
                try:
                    assert store.look is not None
                    store.look(result)
                finally:
                    result.close()
            except Exception as error:  # the members go on
                _LOG.warning("no first result: %s", error)
