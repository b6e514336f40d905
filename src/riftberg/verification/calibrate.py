"""Fit of an experiment to observed positions, headings and break-up: which inputs agree with the observations.

Members are sweeps of a design (`riftberg.ensembles.sweep`), history matching and posterior are in `riftberg.ensembles.matching`.
A break-up is a jump in the inputs; the margin to it is none: largest stress over strength until a date, of a berg that holds. A
member that has broken by then is run once more with ice that does not break, which gives the margin beyond 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, Literal, Unpack, cast

import numpy as np
import xarray as xr

from riftberg.config.units import count_text
from riftberg.config.values import check_names
from riftberg.diagnostics.observed import Observations
from riftberg.ensembles.distributions import member_seed, shares
from riftberg.ensembles.forecast import LATTICE, default_errors
from riftberg.ensembles.matching import Matched, Posterior, Targets, likeliest, match, posterior
from riftberg.ensembles.probability import quantiles
from riftberg.ensembles.sweep import (
    Plan,
    Store,
    SweepOptions,
    WorkerOptions,
    common_options,
    make_plan,
    read_draws,
    run_sweep,
)
from riftberg.ensembles.uncertain import SEED, has_fields
from riftberg.ensembles.vary import Varied, read_varied
from riftberg.errors import InputError
from riftberg.state import Floats
from riftberg.verification.scores import AZIMUTH_ERROR, USUAL_ERROR
from riftberg.verification.sightings import DAY, axis_angles, berg_offsets, check_dates, select_sightings, track_dates

if TYPE_CHECKING:
    from riftberg.ensembles.member import Maker
    from riftberg.experiments.registry import Options

WAVES: Final = 3

MOST_WAVES: Final = 10

PER_INPUT: Final = 10
"""Members of a wave for each input (Loeppky and others 2009)."""

MOST_DATES: Final = 12
"""Dates that are compared, evenly over those that were observed: positions of nearby days say the same."""

MODEL_ERROR: Final = {"km": 3.0, "degree": 5.0, "log": 0.15}
"""Error of the model itself: position, azimuth, margin; a guess."""

EVERY: Final = 1.0
"""Interval of the tracks, h: a berg on an inertial circle is 1 km beside the line between two positions 6 h apart."""

MEMORY: Final = 5.0
"""Time in which the error of the model's position is forgotten, days: its errors of one day and the next are nearly the same."""

FIRM: Final = 20.0
"""Factor on the strength of ice that does not break."""

STRONGEST: Final = 100.0
"""Largest factor on the strength."""

LEAST_MARGIN: Final = 0.05
"""Margins below it are alike: such a berg is far from breaking."""

UNKNOWN: Final = 0.8
"""Width of the interval of an input, over that of its distribution, above which the data cannot tell it."""

LEVEL: Final = 0.9
"""Of the intervals."""


@dataclass(frozen=True)
class Seen:
    """Observations at the dates that are compared."""

    name: str  # Of the berg
    positions: Mapping[datetime, tuple[float, float]]  # Longitude and latitude, degrees
    azimuths: Mapping[datetime, float]  # Long axis, degrees clockwise from north
    whole_until: datetime | None  # When it was last seen whole
    broken: datetime | None  # When it was first seen broken
    one_break_until: datetime | None = None  # When it was last seen broken only once
    second_break: datetime | None = None  # When it was first seen broken a second time

    @property
    def breaks(self) -> tuple[tuple[str, datetime, bool, float], ...]:
        """Observations of break-ups: in words, date, whether of the second one, and 1 for broken, -1 for not."""
        rows = (("whole until", self.whole_until, False, -1.0), ("broken by", self.broken, False, 1.0),
                ("one break until", self.one_break_until, True, -1.0),
                ("second break by", self.second_break, True, 1.0))  # fmt: skip
        return tuple((word, when, second, side) for word, when, second, side in rows if when is not None)


@dataclass(frozen=True)
class Errors:
    """Standard deviations of observations and model."""

    position: float = USUAL_ERROR  # km, along each axis
    azimuth: float = AZIMUTH_ERROR  # degrees
    model: float = MODEL_ERROR["km"]  # km, along each axis


def collect_observations(
    observed: Observations | None, start: datetime, days: float, *, berg: str | None = None, hour: float | None = None,
    **dates: datetime | None,
) -> Seen:  # fmt: skip
    """Return the observations during the runs; dates outside of them are refused. ``dates``: of break-ups, as in `Seen`."""
    end = start + timedelta(days=days)
    name = berg or "berg"
    positions: dict[datetime, tuple[float, float]] = {}
    azimuths: dict[datetime, float] = {}
    any_date = any(date is not None for date in dates.values())
    if observed is not None:
        where = str(observed.source)
        name, sightings = select_sightings(observed, berg, start, hour)
        sightings = [s for s in sightings if start < s.when <= end]
        if not sightings and not any_date:
            raise InputError(
                f"nothing was observed from {start:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M}", where=where,
                remedy="Give observations of the time of the runs, or a date by --broken or --whole-until",
            )  # fmt: skip
        if len(sightings) > MOST_DATES:
            chosen = np.linspace(0, len(sightings) - 1, MOST_DATES).round().astype(int)
            sightings = [sightings[k] for k in chosen]
        positions = {s.when: s.place for s in sightings}
        azimuths = {s.when: s.azimuth for s in sightings if np.isfinite(s.azimuth)}
    for name_, date in dates.items():
        if date is not None and not start < date <= end:
            raise InputError(
                f"{date:%Y-%m-%d %H:%M} is not within the runs", where=f"--{name_.replace('_', '-')}",
                remedy=f"Give a date from {start:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M}",
            )  # fmt: skip
    if not positions and not any_date:
        raise InputError(
            "nothing to compare with", where="calibrate", remedy="Give observations, --broken or --whole-until"
        )
    seen = Seen(name, positions, azimuths, dates.get("whole_until"), dates.get("broken"), dates.get("one_break_until"),
                 dates.get("second_break"))  # fmt: skip
    check_dates(seen.broken, seen.whole_until)
    for (word, earlier, *_), (other, later, *_) in pairwise(seen.breaks):
        if later < earlier or (later == earlier and word == "one break until"):
            raise InputError(
                f"{word} {earlier:%Y-%m-%d %H:%M}, but {other} {later:%Y-%m-%d %H:%M}", where="calibrate",
                remedy="Dates come in this order: --whole-until, --broken, --one-break-until, --second-break",
            )  # fmt: skip
    return seen


def make_targets(seen: Seen, errors: Errors) -> Targets:
    """Return the numbers that a member is to reach: kilometres from the places that were seen, degrees, logarithms of margins."""
    from scipy.linalg import block_diag

    names: list[str] = []
    blocks: list[Floats] = []
    sides: list[float] = []
    for axis in ("east", "north"):
        names += [f"{when:%Y-%m-%d %H:%M} {axis}, km" for when in seen.positions]
        blocks.append(_covariance(list(seen.positions), errors.position, errors.model))
    names += [f"{when:%Y-%m-%d %H:%M} azimuth, degree" for when in seen.azimuths]
    blocks.append(_covariance(list(seen.azimuths), errors.azimuth, MODEL_ERROR["degree"]))
    for word, when, _, side in seen.breaks:
        names.append(f"{word} {when:%Y-%m-%d %H:%M}, log margin")
        blocks.append(np.array([[MODEL_ERROR["log"] ** 2]]))
        sides.append(side)
    covariance = block_diag(*(block for block in blocks if block.size))
    return Targets(names, np.zeros(len(names)), covariance, np.array([0.0] * (len(names) - len(sides)) + sides))


def _covariance(dates: Sequence[datetime], error: float, model: float) -> Floats:
    """Return the covariance of errors at some dates: errors of observations are independent, errors of the model last."""
    days = np.array([(date - dates[0]).total_seconds() / 86400.0 for date in dates])
    return np.asarray(error**2 * np.eye(len(days)) + model**2 * np.exp(-np.abs(days[:, None] - days) / MEMORY))


def compute_results(ds: xr.Dataset, seen: Seen, firm: xr.Dataset | None = None, factor: Floats | None = None) -> Floats:
    """Return the results of the members of a sweep (members, targets) relative to the observations; NaN where one failed.

    ``firm``: the runs of the members with ice that does not break, with their factors on the strength (``factor``); a member
    that has none of its own is whole.
    """
    # A piece that breaks off shifts centroid and axis by a jump. While the berg was seen whole, one that broke is compared as if
    # it had held: its margin rules it out, and what the emulator learns has no jump.
    held_until = {
        when for when in (*seen.positions, *seen.azimuths) if seen.whole_until is not None and when <= seen.whole_until
    }
    columns: list[Floats] = []
    offsets = [
        _compare_members(berg_offsets, ds, firm, when, position, when in held_until)
        for when, position in seen.positions.items()
    ]
    for axis in range(2):
        columns += [position[:, axis] for position in offsets]
    columns += [
        _compare_members(axis_angles, ds, firm, when, axis, when in held_until) for when, axis in seen.azimuths.items()
    ]
    for _, when, second, _ in seen.breaks:
        margin = second_margin(ds, when) if second else margin_until(ds, when, firm, factor)
        columns.append(np.log(np.maximum(margin, LEAST_MARGIN**2 if second else LEAST_MARGIN)))
    results = np.stack(columns, axis=1)
    results[ds["status"].values != 0] = np.nan
    return results


def _compare_members(
    result: Callable[[xr.Dataset, datetime, Any], Floats], ds: xr.Dataset, firm: xr.Dataset | None, when: datetime,
    observed: Any, unbroken: bool,
) -> Floats:  # fmt: skip
    """Return a result of each member relative to an observation; where ``unbroken``, of the run that did not break."""
    values = result(ds, when, observed)
    broke = ds["first_breakup"].values <= np.datetime64(when, "ns")
    if unbroken and firm is not None and broke.any():
        values[broke] = np.where(firm["status"].values[broke] == 0, result(firm, when, observed)[broke].T, np.nan).T
    return values


def margin_until(
    ds: xr.Dataset, when: datetime, firm: xr.Dataset | None = None, factor: Floats | None = None
) -> Floats:
    """Return the largest stress over strength of each member until a date, also beyond 1."""
    margin = _so_far(ds, when)
    broke = ds["first_breakup"].values <= np.datetime64(when, "ns")
    if firm is not None and factor is not None and broke.any():
        beyond = np.where(firm["status"].values == 0, _so_far(firm, when) * factor, np.nan)
        margin = np.where(broke, np.maximum(beyond, 1.0), np.minimum(margin, 1.0))
    return margin


def second_margin(ds: xr.Dataset, when: datetime) -> Floats:
    """Return how near each member came to its second break-up until a date: 1 where it breaks just then.

    Below 1 it is the largest stress over strength since the first break-up. A berg that has not broken once has its margin to
    that, times `LEAST_MARGIN`. Beyond 1 it grows by 1 with each day that has passed since: stress says no more.
    """
    date = np.datetime64(when, "ns")
    once = ds["first_breakup"].values <= date
    margin = np.where(
        once, np.minimum(_so_far(ds, when, "again"), 1.0), LEAST_MARGIN * np.minimum(_so_far(ds, when), 1.0)
    )
    since = (ds["second_breakup"].values - date) / -DAY
    return np.where(since >= 0.0, 1.0 + since, margin)


def _so_far(ds: xr.Dataset, when: datetime, period: str = "so_far") -> Floats:
    """Return the largest stress over strength until the first record from a date on."""
    times = track_dates(ds)
    record = min(int(np.searchsorted(times, np.datetime64(when, "ns"))), len(times) - 1)
    return np.asarray(ds[f"stress_ratio_{period}"].values[:, record], float)


class Runner:
    """Runs the members of the waves, each a sweep in a folder of its own."""

    def __init__(
        self, folder: Path, experiment: Any, varied: Sequence[Varied], options: Options, seen: Seen, *, seed: int,
        resume: bool, nuisance: Sequence[Varied] = (), **where: Any,
    ) -> None:  # fmt: skip
        self.folder, self.experiment, self.varied, self.nuisance = folder, experiment, varied, nuisance
        self.options, self.seen, self.seed, self.resume, self.where = options, seen, seed, resume, where
        self.waves: list[xr.Dataset] = []
        self.bar: Any = None

    @property
    def inputs(self) -> list[Varied]:
        """Inputs to calibrate: those with a distribution."""
        return [v for v in self.varied if v.distribution is not None]

    def columns(self, wave: int, u: Floats) -> dict[str, list[Any]]:
        """Return the values of the members of a wave by name."""
        columns = {v.name: d.quantiles(u[:, k]) for k, v in enumerate(self.inputs) if (d := v.distribution)}
        columns |= {v.name: [v.values[0]] * len(u) for v in self.varied if v.distribution is None}
        components = sum(v.components for v in self.nuisance)
        drawn = shares(len(u), components, "random", self.seed + 7919 * (wave + 1))
        first = 0
        for v in self.nuisance:
            assert v.distribution is not None
            rows = [v.distribution.quantiles(drawn[:, first + k]) for k in range(v.components)]
            columns[v.name] = rows[0] if v.components == 1 else [list(pair) for pair in zip(*rows, strict=True)]
            first += v.components
        if has_fields(columns) and SEED not in columns:
            columns[SEED] = [member_seed(self.seed + wave, k) for k in range(len(u))]
        return columns

    def plan(self, wave: int, u: Floats) -> Plan:
        """Return the sweep of a wave, checked."""
        return self._make_plan(self.columns(wave, u), self.options)

    def _make_plan(self, columns: dict[str, list[Any]], options: Options) -> Plan:
        every = EVERY if options.days is None else min(EVERY, 24.0 * options.days)
        return make_plan(self.experiment, columns, options, every, design=True)

    def __call__(self, wave: int, u: Floats) -> Floats:
        """Run a wave and return its results (members, targets)."""
        ds = self._run(f"wave-{wave + 1}", self.plan(wave, u))
        self.waves.append(ds)
        dates = [date for date in (self.seen.whole_until, self.seen.broken) if date is not None]
        broke = ds["first_breakup"].values <= np.datetime64(max(dates), "ns") if dates else np.zeros(len(u), bool)
        if not broke.any():
            return compute_results(ds, self.seen)
        rows = np.flatnonzero(broke)
        columns = {name: [values[k] for k in rows] for name, values in self.columns(wave, u).items()}
        strength = np.array(columns.get("start.strength", [1.0] * len(rows)), float)
        columns["start.strength"] = np.minimum(FIRM * strength, STRONGEST).tolist()
        start = track_dates(ds)[0]
        # Until the record that follows the last date: beyond it nobody asks.
        days = min((np.datetime64(max(dates), "ns") - start) / DAY + 0.25, self._days(ds))
        firm = self._run(f"wave-{wave + 1}-firm", self._make_plan(columns, replace(self.options, days=float(days))))
        unbroken = firm.isel(
            member=np.cumsum(broke) - 1
        )  # members that did not break get some other's, which is not used
        factor = np.ones(len(u))
        factor[rows] = np.array(columns["start.strength"]) / strength
        return compute_results(ds, self.seen, unbroken, factor)

    def _days(self, ds: xr.Dataset) -> float:
        return float((ds["time"].values[-1] - ds["time"].values[0]) / DAY)

    def _run(self, name: str, plan: Plan) -> xr.Dataset:
        folder = self.folder / name
        store = Store(folder, plan, resume=self.resume and (folder / "sweep.json").exists())
        bar = None if self.bar is None else self.bar(name, len(plan.members))
        return run_sweep(store, bar=bar, **self.where).load()


def check_inputs(
    experiment: Any, vary: Mapping[str, Any] | Iterable[str]
) -> tuple[tuple[Varied, ...], tuple[Varied, ...]]:
    """Return the inputs to calibrate, and those that scatter beside them: the lattice, which is no property of the ice."""
    varied = read_varied(vary, free=callable(experiment))
    for v in varied:
        where = f"--vary {v.name}"
        if v.distribution is None and len(v.values) > 1:
            raise InputError(
                f"{len(v.values)} values",
                where=where,
                remedy="Give a distribution, such as ~uniform(5 kPa, 30 kPa), or one value",
            )
        if v.distribution is not None and (v.distribution.choices or v.components > 1):
            kind = "a choice" if v.distribution.choices else "several numbers"
            raise InputError(f"{kind} cannot be calibrated", where=where, remedy="Give one number with a distribution")
    if not any(v.distribution is not None for v in varied):
        raise InputError("nothing to calibrate", where="--vary", remedy="Give a distribution, such as "
                         "'start.strength~lognormal(1, 40 %)'")  # fmt: skip
    names = {v.name for v in varied}
    lattice = read_varied(LATTICE.vary) if LATTICE in default_errors(experiment) else ()
    return varied, tuple(v for v in lattice if v.name not in names)


def check_within(plan: Plan, varied: Sequence[Varied], options: Options) -> None:
    """Refuse a distribution that excludes the value of the experiment: the search would never reach it."""
    if not isinstance(plan.experiment, str):
        return
    from riftberg.ensembles.uncertain import UNCERTAIN
    from riftberg.experiments import build

    parameters = build(plan.experiment, options)[0].parameters
    for v in varied:
        group, _, key = v.name.partition(".")
        if v.distribution is None:
            continue
        section = UNCERTAIN[group]() if group in UNCERTAIN else getattr(parameters, group, None)
        value = getattr(section, key, None)
        if not isinstance(value, int | float) or isinstance(value, bool) or value == 0.0:
            continue  # 0 and none mean: find it, or none of it
        share = float(v.distribution.shares_below(np.array([float(value)]))[0])
        if not 0.001 < share < 0.999:
            unit = f" {v.unit}" if v.unit not in ("", "1") else ""
            raise InputError(
                f"{v.distribution.text} excludes the {value:g}{unit} of the experiment", where=f"--vary {v.name}",
                remedy="Widen it, or set another value with --set",
            )  # fmt: skip


class CalibrateOptions(WorkerOptions, total=False):
    """Options of `calibrate` beside its own arguments; not ``plan`` and ``cells`` of a sweep, which would do nothing."""

    changes: Mapping[str, Mapping[str, Any]] | None  # As for `riftberg.sweep`
    without: Iterable[str]  # As for `riftberg.sweep`
    data: str | Path | None  # As for `riftberg.sweep`
    numerics: Literal["own", "reference"] | None  # As for `riftberg.sweep`
    members: int | None  # Of each wave; by default ten for each input
    seed: int | None  # Of all that is drawn; 1 by default
    waves: int  # 3 by default
    berg: str | None  # Name of the berg, where the observations have several
    hour: float | None  # Of observations without a time (UTC); by default that of the start
    one_break_until: datetime | None  # When the berg was last seen broken only once
    second_break: datetime | None  # When it was first seen broken a second time
    bar: Any  # Takes name and number of runs of a wave and returns its progress bar


def calibrate(
    experiment: str | Path | Maker,
    observed: Observations | None,
    vary: Mapping[str, Any] | Iterable[str],
    *,
    days: float | str | None = None,
    errors: Errors | None = None,
    broken: datetime | None = None,
    whole_until: datetime | None = None,
    output: str | Path | None = None,
    resume: bool = False,
    **options: Unpack[CalibrateOptions],
) -> xr.Dataset:
    """Find the inputs of an experiment that agree with observations.

    Parameters
    ----------
    experiment : str, path or callable
        As for `riftberg.sweep`.
    observed : Observations, optional
        Outlines or positions, from `riftberg.read_observed`.
    vary : mapping, or iterable of str
        Inputs to calibrate: numbers with a distribution, as for `riftberg.sweep`. Random errors of current, wind and floor may
        stand beside them with one value; they scatter.
    days : float or str, optional
        Length of the runs; needed where a function makes the models.
    errors : Errors, optional
        Standard deviations of observations and model.
    broken, whole_until : datetime, optional
        When the berg was first seen broken, and last seen whole.
    output : path, optional
        Folder in which the members are kept.
    resume : bool, optional
        Go on with the members in that folder.
    **options
        ``waves`` (3), ``members`` of each (ten for each input), ``berg`` and ``hour`` of observations, ``one_break_until`` and
        ``second_break`` (`CalibrateOptions`);
        others as for `riftberg.sweep` (changes, data, without, numerics, seed, scheduler, workers).

    Returns
    -------
    xarray.Dataset
        See "Calibrate" in the documentation: `parameter`, `sample`, `member`, `target`, `wave`.

    Raises
    ------
    InputError
        If an input cannot be varied or an observation is not possible; before the first run.
    RunError
        If no inputs agree with the observations.
    """
    check_names(options, CalibrateOptions)
    waves = options.get("waves", WAVES)
    varied, nuisance = check_inputs(experiment, vary)
    if not 1 <= waves <= MOST_WAVES:
        raise InputError(f"{waves} waves", where="waves", remedy=f"Give 1 to {MOST_WAVES}")
    seed = read_draws({"seed": options.get("seed")}).seed
    common = common_options(days, cast(SweepOptions, options))
    where = {name: value for name, value in options.items() if name in WorkerOptions.__annotations__}
    with TemporaryDirectory(prefix="riftberg-calibrate-") if output is None else nullcontext(output) as folder:
        runner = Runner(Path(folder).absolute(), experiment, varied, common, Seen("", {}, {}, None, None), seed=seed,
                      resume=resume, nuisance=nuisance, **where)  # fmt: skip
        inputs = runner.inputs
        count = options.get("members") or PER_INPUT * len(inputs)
        if count < len(inputs) + 4:
            raise InputError(
                f"{count} members for {count_text(len(inputs), 'input')}",
                where="members",
                remedy=f"Give {len(inputs) + 4} or more",
            )
        plan = runner.plan(0, np.full((1, len(inputs)), 0.5))
        if not plan.first.parameters.earth.latlon:
            raise InputError("runs in metres", where="calibrate", remedy="Observations need longitude and latitude")
        check_within(plan, varied, common)
        runner.bar, runner.seen = options.get("bar"), collect_observations(
            observed, plan.first.start, plan.days, berg=options.get("berg"), hour=options.get("hour"), broken=broken,
            whole_until=whole_until, one_break_until=options.get("one_break_until"), second_break=options.get("second_break"),
        )  # fmt: skip
        targets = make_targets(runner.seen, errors or Errors())
        matched = match(runner, len(inputs), targets, waves=waves, members=count, seed=seed)
        broke = np.concatenate([ds["first_breakup"].values for ds in runner.waves])
    after = posterior(matched, seed=seed)
    best = likeliest(matched.region, len(inputs), seed=seed)
    return _describe_calibration(inputs, matched, after, best, broke, runner.seen)


def _describe_calibration(
    inputs: Sequence[Varied], matched: Matched, after: Posterior, best: Floats, broke: Any, seen: Seen
) -> xr.Dataset:
    """Return all of a calibration as one dataset."""
    targets = matched.region.targets

    def values(u: Floats) -> Floats:
        return np.array([d.quantiles(u[:, k]) for k, v in enumerate(inputs) if (d := v.distribution)], float).T

    ends = np.array([0.5 - LEVEL / 2.0, 0.5, 0.5 + LEVEL / 2.0])
    inner = np.array([quantiles(after.samples[:, k], after.weight, ends) for k in range(len(inputs))])
    determined = is_known((inner[:, 2] - inner[:, 0]) / LEVEL, after.effective)
    name = "the berg" if seen.name == "berg" else seen.name
    ds = xr.Dataset(attrs={"title": f"Calibration of {name}", "interval": f"{100 * LEVEL:.0f} %",
                           "effective_members": after.effective})  # fmt: skip
    ds.coords["parameter"] = ("parameter", [v.name for v in inputs])
    ds.coords["unit"] = ("parameter", [v.unit or "1" for v in inputs])
    ds.coords["target"] = ("target", list(targets.names))
    for k, word in enumerate(("low", "median", "high")):
        ds[f"prior_{word}"] = ("parameter", values(np.full((1, len(inputs)), ends[k]))[0])
        ds[f"posterior_{word}"] = ("parameter", values(inner[:, k][None])[0])
    ds["known"] = (
        "parameter",
        determined,
        {"long_name": f"the interval is narrower than {UNKNOWN:g} of that before, more than by chance"},
    )
    ds["narrowed"] = ("parameter", (inner[:, 2] - inner[:, 0]) / LEVEL,
                      {"long_name": "width of the interval over that before, in parts of the probability"})  # fmt: skip
    ds["likeliest"] = ("parameter", values(best[None])[0], {"long_name": "largest likelihood on the emulators"})
    ds["sample_value"] = (("sample", "parameter"), values(after.samples))
    ds["sample_share"] = (("sample", "parameter"), after.samples)
    ds["sample_weight"] = ("sample", after.weight)
    ds["member_value"] = (("member", "parameter"), values(matched.inputs))
    ds["member_share"] = (("member", "parameter"), matched.inputs)
    ds["member_wave"] = ("member", matched.wave + 1)
    ds["member_weight"] = ("member", after.members)
    ds["member_result"] = (("member", "target"), matched.results)
    ds["member_first_breakup"] = ("member", broke)
    ds["ruled_out"] = ("member", ~matched.region.inside(matched.inputs))
    ds["error"] = ("target", np.sqrt(np.diag(targets.covariance)), {"long_name": "of observation and model together"})
    ds["side"] = ("target", targets.sides)
    rows = np.random.default_rng(1).choice(len(after.weight), min(1000, len(after.weight)), p=after.weight)
    mean, variance = matched.region.emulated(after.samples[rows])
    predicted = mean + np.sqrt(variance) * np.random.default_rng(2).standard_normal(mean.shape)
    for word, level in zip(("low", "median", "high"), ends, strict=True):
        ds[f"predicted_{word}"] = ("target", np.quantile(predicted, level, axis=0))
    ds["wave_members"] = ("wave", [wave.members for wave in matched.waves])
    ds["wave_left"] = ("wave", [wave.left for wave in matched.waves], {"long_name": "part of the prior not ruled out"})
    from scipy.stats import norm

    z = norm.ppf(np.clip(after.samples, 1e-6, 1.0 - 1e-6))
    z = z - after.weight @ z
    covariance = (after.weight[:, None] * z).T @ z
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    ds["correlation"] = (("parameter", "other"), np.asarray(covariance / size[:, None] / size))
    return ds


def is_known(narrowed: Floats, members: float) -> Floats:
    """Return whether intervals are narrower than before the data by more than chance with so many members that count.

    The spread of n numbers has a relative error of ``1 / sqrt(2 n)``; 1.645 of these leave 5 % to chance.
    """
    return np.asarray(narrowed < UNKNOWN * (1.0 - 1.645 / np.sqrt(2.0 * members)))
