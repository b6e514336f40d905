"""One member of a sweep: built, run, kept restartable, and told in plain numbers that travel between machines.

A member that is stopped, or whose machine is lost, goes on from the state that it saved last, or begins anew; both give
the same digits, for a run that goes on from a restart file gives bit for bit the run that never stopped.
"""

from __future__ import annotations

import hashlib
import math
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from riftberg.bergs.regions import turned
from riftberg.config.units import duration_text
from riftberg.constants import SECONDS_PER_DAY
from riftberg.engines.common.forces.media import on_the_floor
from riftberg.engines.common.fragments.tree import centroid
from riftberg.engines.common.reserves import bond_strengths
from riftberg.ensembles.uncertain import is_uncertain, with_errors
from riftberg.ensembles.vary import grouped
from riftberg.errors import InputError, RiftbergError, without_secrets
from riftberg.experiments.registry import Options
from riftberg.ocean.errors import UncertainForcing
from riftberg.ocean.files_forcing import sharing_forcings
from riftberg.plane import EqualAreaPlane, near
from riftberg.runs.run_file import RunWriter
from riftberg.runs.scene import SMALL
from riftberg.runs.tracks import Shapes, is_channel, track_longitudes
from riftberg.state.population import find_rows
from riftberg.system.input_files import allow_large, value_shown

if TYPE_CHECKING:
    from riftberg.model import BareModel, Recorder
    from riftberg.runs.model import Model

Maker = Callable[..., "Model"]
"""A function that makes the model of a member from its values."""

STOP: Final = "stop"
"""File in the folder of a sweep that asks its members to stop."""

LOOK_SECONDS: Final = 0.5
"""Wall time between two looks for that file."""

UNDO: Final = "Undo the change, or begin anew in another folder"

CONTROL: Final = -1
"""Number of the run of a forecast in which nothing is varied."""

CONTROL_RUN: Final = "control.nc"
"""Run file of that run, in the folder of the forecast."""

CELLS: Final = "cells"
"""Folder of fresh water, heat and mass on cells, beside that of the members."""

_REMEMBERED: Final = "sweep_track"
_TOLERANCE: Final = 1e-6  # s


@dataclass(frozen=True)
class Job:
    """Input of a worker for one member."""

    number: int  # From 0
    values: Mapping[str, Any]  # Values by name of what is varied
    experiment: str | Maker  # Name, YAML file, or a function that makes the model
    options: Options  # What is changed for all members
    days: float  # Length of the run
    every: float  # Interval of the tracks, s
    folder: Path  # Where states are saved, and the file that asks to stop is looked for
    save_seconds: float = 60.0  # Wall time between two saved states, s
    large: bool = False  # Runs beyond the limits are allowed
    # Width (degrees) of the cells on which fresh water, heat and mass are written, in the folder `CELLS`
    cells: float | None = None
    digest: str = ""  # Of the experiment file when the sweep began
    lag: float = 0.0  # How much earlier than the forecast the member starts, s
    most_seconds: float = math.inf  # Wall time of an attempt; the control of a forecast takes what it needs
    time_step: float = 0.0  # That of the first member, s; 0 before it is known

    @property
    def cells_path(self) -> Path:
        """Begin of the names of the member's files on cells."""
        return self.folder.parent / CELLS / f"{self.number:05d}"

    @property
    def run_file(self) -> Path | None:
        """The run file that the member writes: of a forecast the control has one, where the folder can be reached."""
        return self.folder.parent / CONTROL_RUN if self.number == CONTROL and self.folder.is_dir() else None

    @property
    def begins_anew(self) -> bool:
        """Whether a member that is stopped begins anew, for it writes files at its end that a saved state does not hold."""
        return self.cells is not None or self.number == CONTROL

    @property
    def state_file(self) -> Path:
        """The state that the member saved last."""
        return self.folder / f"{self.number:05d}.restart.nc"


@dataclass
class Outcome:
    """Result of a member, in numbers and texts alone."""

    number: int  # Of the member
    status: str  # "done", "failed", "unfinished" if it took too long, or "stopped" if it was asked to stop
    message: str = ""  # Why it failed or is unfinished
    time: float = 0.0  # Model time reached, s
    wall_seconds: float = 0.0  # Wall time spent by the attempt that ended it, s
    totals: dict[str, float] = field(default_factory=dict)  # Counts and sizes at the end
    fragments: dict[str, list[float]] = field(default_factory=dict)  # Table of bergs and fragments
    # Rows of time, number, longitude, latitude, area, 1 where aground, azimuth, the largest stress over strength so far,
    # length over width, and the largest stress over strength since the first break-up
    track: list[list[float]] = field(default_factory=list)
    # Broken bonds: time (s), middle east and north of the berg's centre at the start (m), length of the crack across it (m)
    cracks: list[list[float]] = field(default_factory=list)
    # Of one that broke up the outline of each piece at the end, where its ice lay at the start: number, and corners (m east and
    # north of the middle of the berg)
    shapes: list[list[Any]] = field(default_factory=list)


class StoppedError(RiftbergError):
    """The sweep was asked to stop."""


class TooLongError(RiftbergError):
    """A member took longer than a member may."""


def compute_digest(experiment: str | Maker) -> str:
    """Return the checksum of an experiment file; empty for other experiments."""
    if not isinstance(experiment, str) or not experiment.endswith((".yaml", ".yml")) or not Path(experiment).is_file():
        return ""
    # A token may be renewed.
    text = without_secrets(Path(experiment).read_text("utf-8-sig", errors="replace"))
    return hashlib.sha256(text.encode()).hexdigest()


def build_member(job: Job) -> Model:
    """Return the model of a member at its start, with the time step of the first one."""
    model = _make_model(job)
    if job.time_step:
        model.take_time_step(job.time_step, "it is that of the first member")
    return model


def _make_model(job: Job) -> Model:
    """Return the model of an experiment with the values of a member."""
    if not isinstance(job.experiment, str):
        model = job.experiment(**{name: value for name, value in job.values.items() if not is_uncertain(name)})
        if not callable(getattr(model, "advance", None)):
            raise InputError(
                f"{value_shown(model)} is no model", where="sweep", remedy="The function must return a riftberg.Model"
            )
        return with_errors(model, job.values)
    from riftberg.experiments import build

    if job.digest and compute_digest(job.experiment) not in ("", job.digest):
        raise InputError("this file has changed since the sweep began", where=job.experiment, remedy=UNDO)
    return with_errors(build(job.experiment, with_values(job.options, job.values))[0], job.values)


def with_values(options: Options, values: Mapping[str, Any]) -> Options:
    """Return options of an experiment with the values of a member among its changes."""
    changes = {group: dict(inner) for group, inner in options.changes.items()}
    for group, inner in grouped(values).items():
        changes[group] = {**changes.get(group, {}), **inner}
    return replace(options, changes=changes)


def run_member(job: Job) -> Outcome:
    """Run a member to its end; whatever goes wrong becomes its message."""
    began = clock.perf_counter()
    track = MemberTracks(job.every, job.lag)
    try:
        with allow_large(job.large), sharing_forcings():
            if (job.folder / STOP).exists():
                raise StoppedError("the sweep was asked to stop")
            model, fresh = _prepare_member(job)
            left = job.days - model.time / SECONDS_PER_DAY
            status, message = "done", ""
            if left * SECONDS_PER_DAY > 0.5 * model.parameters.time_step:
                try:
                    _advance(model, left, track, job)
                except TooLongError as error:  # what it came to until then is a result too
                    status, message = "unfinished", _sentence(error)
                    _forget_files(job)
            else:
                track.start(model)
            if status == "done":
                job.state_file.unlink(missing_ok=True)
            outcome = make_outcome(job.number, model, track)
            outcome.status, outcome.message = status, message
            outcome.cracks = _cracks(model, fresh, job.values)
            outcome.shapes = _shapes(model, fresh)
    except StoppedError:
        _forget_files(job)
        return Outcome(job.number, "stopped")
    except Exception as error:  # a failed member is a result too: the others go on
        outcome = Outcome(job.number, "failed", _sentence(error))
        _forget_files(job)
    outcome.wall_seconds = clock.perf_counter() - began
    return outcome


def _sentence(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text if isinstance(error, RiftbergError) else f"{type(error).__name__}: {text}"


def _prepare_member(job: Job) -> tuple[Model, tuple[Any, Any, Any]]:
    """Return the model at the state that was saved last, or at its start, and ids and positions of the elements at the start."""
    fresh = build_member(job)
    e = fresh.elements
    start = e.id.copy(), e.lon.copy(), e.lat.copy()
    return _resume_member(job, fresh), start


def _resume_member(job: Job, fresh: Model) -> Model:
    if not job.state_file.exists():
        return fresh
    try:
        model = type(fresh).resume(job.state_file, fresh.forcing)
    except RiftbergError:  # a damaged file costs no more than the work that it stands for
        return fresh
    # A state of a sweep with other parameters in the same folder is none of this member.
    same = model.start == fresh.start and model.parameters == fresh.parameters
    if not same or model.time > job.days * SECONDS_PER_DAY + _TOLERANCE:
        return fresh
    model.after_step = fresh.after_step
    return model


def _advance(model: Model, days: float, track: MemberTracks, job: Job) -> None:
    keeper = Keeper(job, track)
    try:
        model.advance(days, recorders=[track, *_files(job), keeper])
    except (StoppedError, TooLongError, KeyboardInterrupt, SystemExit):
        keeper.save(model)
        raise


def _files(job: Job) -> list[Recorder]:
    """Return the recorders of the files of a member: the run of the control, and gridded output where requested."""
    recorders: list[Recorder] = []
    if job.run_file is not None:
        name = job.experiment if isinstance(job.experiment, str) else ""
        recorders.append(
            RunWriter(job.run_file, every_hours=job.every / 3600.0, experiment=f"{Path(name).stem} control")
        )
    if job.cells is not None:
        from riftberg.coupling.gridded import GridRecorder

        job.cells_path.parent.mkdir(exist_ok=True)
        recorders.append(GridRecorder(job.cells_path, job.cells))
    return recorders


def _forget_files(job: Job) -> None:
    """Remove the files of a member that did not come to its end."""
    files = list(job.cells_path.parent.glob(f"{job.cells_path.name}-*.nc")) if job.cells is not None else []
    for file in [*files, *([] if job.run_file is None else [job.run_file])]:
        file.unlink(missing_ok=True)


class MemberTracks:
    """Recorder of the centroid, area and long axis of every fragment at equal intervals.

    ``every``: interval, s; ``lag``: how much later than the run the intervals begin, s.
    """

    def __init__(self, every: float, lag: float = 0.0) -> None:
        self.every, self.lag = every, lag
        self.rows: list[list[float]] = []
        self.first_aground = np.nan  # s
        self.aground_at = [np.nan, np.nan]  # Where that was, degrees (m on a Cartesian grid)
        # Largest stress over strength of a bond until the first break-up, and from there until the second
        self.stress_ratios = [0.0, 0.0]

    def start(self, model: BareModel) -> None:
        """Take the rows of the part that was run before, and the first position."""
        saved = model.remembered.get(_REMEMBERED)
        rows = [] if saved is None else np.asarray(saved).tolist()
        # The last row holds what is known of the whole run.
        self.rows = rows[:-1]
        if rows:
            self.first_aground = rows[-1][0] if rows[-1][0] >= 0.0 else np.nan
            self.stress_ratios = rows[-1][1:3]
            self.aground_at = rows[-1][3:5] if rows[-1][0] >= 0.0 else [np.nan, np.nan]
        self.record(model)

    def record(self, model: BareModel) -> None:
        """Note the positions of the fragments at each interval, and events between them in each step."""
        touching = _aground(model)
        if np.isnan(self.first_aground) and touching.any():
            self.first_aground, e = model.time, model.elements
            self.aground_at = list(centroid(e.lon[touching], e.lat[touching], e.mass[touching], model.constants.period))
        rows = model.fragments.rows if model.fragments.breakups else []
        over = len(broken_off((row.number, row.parent, row.area, row.birth_time) for row in rows))
        # The step of a break-up ends with the stress of what is left; the ice that broke had reached its strength.
        ratios = [1.0] * min(over, 2) + ([_stress_ratio(model)] if over < 2 else [])
        self.stress_ratios[: len(ratios)] = map(max, self.stress_ratios, ratios)
        # Steps need not divide the interval: the step nearest to the time that is due is recorded.
        due = self.lag + self.every * round((model.time - self.lag) / self.every)
        last = self.rows[-1][0] if self.rows else -np.inf
        if due <= last + _TOLERANCE or abs(model.time - due) > 0.5 * model.parameters.time_step + _TOLERANCE:
            return
        e, earth = model.elements, model.parameters.earth
        numbers, group = np.unique(e.berg, return_inverse=True)
        here = Shapes(
            track_longitudes(model), e.lat, e.length * e.width, group, numbers.size, latlon=earth.latlon, radius=earth.radius,
            period=model.constants.period,
        )  # fmt: skip
        length, width = here.sides(e.length, e.width, (e.length**2 + e.width**2) / 12.0)
        # Without a longer axis there is no azimuth; 0 as any other.
        columns = [np.full(numbers.size, due), numbers, here.lon, here.lat, here.area,
                   here.sum(touching.astype(float)) > 0.0, np.nan_to_num(here.azimuth),
                   np.full(numbers.size, self.stress_ratios[0]), length / width,
                   np.full(numbers.size, self.stress_ratios[1])]  # fmt: skip
        self.rows += np.column_stack(columns).tolist()

    def kept(self) -> Any:
        """Return all rows as one array of finite numbers, for a saved state; -1 for a berg that has not been aground."""
        summary = [float(np.nan_to_num(self.first_aground, nan=-1.0)), *self.stress_ratios]
        summary += [*np.nan_to_num(self.aground_at).tolist(), *[0.0] * 5]
        return np.array([*self.rows, summary], dtype=np.float64)

    def finish(self, model: BareModel) -> None:
        """Leave the rows unchanged."""


def broken_off(rows: Iterable[Sequence[float]]) -> list[int]:
    """Return which rows are pieces that broke off and no crumbs, `SMALL` of the berg they come from or more, by date.

    ``rows``: number, parent (0 for a berg), area at birth and time of birth of each berg and fragment, parents first.
    """
    berg: dict[float, float] = {}  # Area of the berg that each comes from
    times = {}
    for k, (number, parent, area, time) in enumerate(rows):
        berg[number] = berg.get(parent, area)
        if parent > 0 and area >= SMALL * berg[number]:
            times[k] = time
    return sorted(times, key=lambda k: times[k])


def _aground(model: BareModel) -> Any:
    """Return which elements are aground."""
    e = model.elements
    return on_the_floor(e.body.thickness, e.environment.depth, e.keel.floor_load, model.constants)


def _stress_ratio(model: BareModel) -> float:
    """Return the largest stress over strength of an intact bond in the last step."""
    bonds, f = model.bonds, model.parameters.fracture
    intact = (bonds.status == 0) & (bonds.strength > 0.0)
    if not intact.any():
        return 0.0
    strength = bond_strengths(model.elements.thickness, bonds.first[intact], bonds.second[intact], model.constants)
    tension = np.fmax(bonds.peak_stress[intact], bonds.normal_stress[intact]) / strength
    left = bonds.strength[intact] * (1.0 - bonds.damage[intact])
    ratio = np.fmax(tension, np.abs(bonds.shear_stress[intact]) / f.shear_strength) / left
    return float(np.nanmax(ratio, initial=0.0))


def _cracks(model: BareModel, start: tuple[Any, Any, Any], values: Mapping[str, Any]) -> list[list[float]]:
    """Return the broken bonds where they lay in the berg at the start, before it was turned or sized."""
    ids, lon, lat = start
    bonds, e = model.bonds, model.elements
    broken = np.flatnonzero(np.isfinite(bonds.break_time))
    if not broken.size:
        return []
    x, y = turned(*_about_middle(model, lon, lat), -float(values.get("start.turn", 0.0)))
    size = float(values.get("start.size", 1.0))
    # Elements that came during the run were nowhere at the start.
    (i, i_known), (j, j_known) = (find_rows(ids, e.id[end[broken]]) for end in (bonds.first, bonds.second))
    present = i_known & j_known
    i, j = i[present], j[present]
    # The side of a square is the root of its area, that of a hexagon 0.62 of it.
    of = bonds.first[broken][present]
    across = np.sqrt((e.length * e.width)[of]) * np.where(e.sides[of] == 6, 0.6204, 1.0)
    middles = 0.5 * (x[i] + x[j]) / size, 0.5 * (y[i] + y[j]) / size
    rows = np.column_stack([bonds.break_time[broken][present], *middles, across / size])
    listed: list[list[float]] = rows[np.argsort(rows[:, 0], kind="stable")].tolist()
    return listed


def _about_middle(model: BareModel, lon: Any, lat: Any) -> tuple[Any, Any]:
    """Return metres east and north of the middle of a berg."""
    earth = model.parameters.earth
    return EqualAreaPlane(float(lon.mean()), float(lat.mean()), earth.radius, earth.latlon).forward(lon, lat)


def _shapes(model: BareModel, start: tuple[Any, Any, Any]) -> list[list[Any]]:
    """Return the outlines of the pieces at the end where their ice lay at the start; none of a berg that is whole."""
    if not model.fragments.breakups:
        return []
    ids, lon, lat = start
    e, (x, y) = model.elements, _about_middle(model, lon, lat)
    area = e.length * e.width
    side, (rows, present) = float(np.sqrt(area.mean())), find_rows(ids, e.id)
    outlines = []
    for number in np.unique(e.berg[present]).tolist():
        inside = (e.berg == number) & present
        if area[inside].sum() < SMALL * area.sum():  # crumbs, as for scenarios
            continue
        # Discs that overlap, and what they reach too far taken off again: as good for squares as for hexagons, however turned.
        # The edge of such discs side by side lies 0.74 of their distance from their middles, on average.
        ice = shapely.union_all(
            shapely.buffer(shapely.points(x[rows[inside]], y[rows[inside]]), 0.8 * side, quad_segs=4)
        )
        shape = max(shapely.get_parts(shapely.buffer(ice, -0.24 * side)), key=lambda piece: piece.area)
        corners = shapely.get_coordinates(shapely.simplify(shape, 0.1 * side).exterior)
        outlines.append([int(number), np.round(corners).tolist()])
    return outlines


class Keeper:
    """Recorder that saves the state now and then, and ends the run where the sweep is asked to stop."""

    def __init__(self, job: Job, track: MemberTracks) -> None:
        self.job, self.track = job, track
        self._began = self._saved = self._looked = clock.monotonic()

    def start(self, model: BareModel) -> None:
        """Do nothing."""

    def record(self, model: BareModel) -> None:
        """Look whether to stop, and save the state where the last one is old enough."""
        now = clock.monotonic()
        if now - self._looked >= LOOK_SECONDS:
            self._looked = now
            if (self.job.folder / STOP).exists():
                raise StoppedError("the sweep was asked to stop")
        last = model.time >= self.job.days * SECONDS_PER_DAY - _TOLERANCE
        if now - self._began > self.job.most_seconds and self.job.number != CONTROL and not last:
            limit, day = duration_text(self.job.most_seconds / SECONDS_PER_DAY), model.time / SECONDS_PER_DAY
            raise TooLongError(f"unfinished after {limit}, at day {day:.3g} of {self.job.days:g}")
        if now - self._saved >= self.job.save_seconds:
            self.save(model)

    def save(self, model: BareModel) -> None:
        """Save state and track, where the folder of the sweep can be reached."""
        self._saved = clock.monotonic()
        if self.job.folder.is_dir() and hasattr(model, "save") and not self.job.begins_anew:
            model.remembered[_REMEMBERED] = self.track.kept()
            model.save(self.job.state_file)
            del model.remembered[_REMEMBERED]

    def finish(self, model: BareModel) -> None:
        """Do nothing."""


FRAGMENT: Final = (
    "number",
    "parent",
    "birth_time",
    "lon",
    "lat",
    "elements",
    "area",
    "mass",
    "bonds_broken",
    "grounded",
)
"""What is kept of a berg or fragment."""


def make_outcome(number: int, model: BareModel, track: MemberTracks) -> Outcome:
    """Return the outcome of a finished member."""
    rows = model.fragments.rows
    e = model.elements
    numbers = np.unique(e.berg)
    area = np.array([(e.length * e.width)[e.berg == k].sum() for k in numbers])
    totals = {
        "pieces": float(len(numbers)),
        "bonds_broken": float(model.bonds_broken),
        "breakups": float(len(model.fragments.breakups)),
        "largest_area": float(area.max()) if area.size else 0.0,
        "first_aground": track.first_aground,
        "aground_lon": track.aground_at[0],
        "aground_lat": track.aground_at[1],
        "stress_ratio": track.stress_ratios[0],
        "fresh_water": sum(model.life.balance(model).water.values()) if model.life is not None else 0.0,
    }
    if isinstance(model.forcing, UncertainForcing) and track.rows:
        # What the random fields came to where the first berg was: inputs by which the spread is explained afterwards.
        time, _, lon, lat = np.array([row[:4] for row in track.rows if row[1] == 1.0] or [track.rows[0][:4]]).T
        for name, value in model.forcing.mean_errors(time, lon, lat).items():
            totals[name] = value
    table = {name: [float(getattr(row, name)) for row in rows] for name in FRAGMENT}
    if is_channel(model.parameters):  # births lie beside the tracks, however often these went round
        seen = {fragment: lon for _, fragment, lon, *_ in reversed(track.rows)}
        period = model.parameters.earth.period
        table["lon"] = [float(near(row.lon, seen.get(row.number, row.lon), period)) for row in rows]
    return Outcome(number, "done", "", model.time, 0.0, totals, table, track.rows)
