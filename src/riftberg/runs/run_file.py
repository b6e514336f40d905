"""The trajectory file of a run: one CF-1.11 NetCDF-4 file that xarray, TrajAn and clouddrift open directly.

Layout
------
The elements of a run share their times, so every variable of an element is a plain table ``(trajectory, time)`` with one
time axis, the layout that OpenDrift writes and TrajAn calls orthogonal.
Bonds have their own dimension: constants ``(bond)``, stresses ``(bond, time)``. The family tree of the
fragments lies along ``fragment``.

The group ``tracks`` holds the bergs and fragments, one after the other, as CF contiguous ragged arrays: made of each block of
records as it is written, and added at the end of the run (`riftberg.runs.tracks`).

Elements that are born in the run get trajectories behind the elements of the start, in order of birth, without values before
their birth; those that are removed have none after their end. Then, and only then, the variables have a fill value.
``length``, ``width`` and ``mass`` are tables ``(trajectory)`` unless they change in the run. ``bond_first`` and
``bond_second`` are rows of the file.

Safety
------
Records are held for about ``flush_seconds`` of wall time. Then a copy of the file takes them and its name: whoever
opens the file meets a complete one, nobody who has it open can stop the run, and a run killed at any moment loses its
last record, or the last second of a run that makes many records in a second. An interrupt loses nothing, because
``finish`` writes the held records.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from riftberg.config.values import required
from riftberg.errors import InputError, RunError
from riftberg.runs.derived import APPLIED, Means, own_applied, user_variables, values_now
from riftberg.runs.layout import open_checked, reorder, run_attributes
from riftberg.runs.record_file import ANEW, ROUND, Record, RecordFile
from riftberg.state import Floats, Ints
from riftberg.system.atomic_files import OneWriter, refusal
from riftberg.system.input_files import is_folder, reading
from riftberg.system.netcdf_lock import open_netcdf

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.model import BareModel

_PATIENCE = 20.0  # records are held at least this many times as long as writing takes


class RunWriter:
    """Recorder that writes the trajectory file.

    Parameters
    ----------
    path : path
        The file; an existing one is replaced at the start of the run.
    every_hours : float, optional
        Interval between records, in hours of model time; 0 records every long step.
    experiment : str, optional
        Name of the experiment, for the attributes.
    seed : int, optional
        Seed of random numbers, for the attributes.
    flush_seconds : float, optional
        Wall time for which records may be held in memory, in s; 0 writes each at once.
    background : bool, optional
        Add currents and sea floor around the run for maps (`riftberg.runs.background`) at the end.

    forces : bool, optional
        Write the mean force of each medium on each element since the record before (`riftberg.runs.derived`).
    derived : mapping, optional
        Further variables of the elements, by name: unit, and a function of the model that returns a value for each element.
    goes_on : bool, optional
        Go on with the file that is there: its records from before the state of the model stay, and the file becomes that of
        the run that never stopped.

    Examples
    --------
    >>> model.advance(days=14, recorders=[RunWriter("run.nc", every_hours=1.0)])  # doctest: +SKIP
    >>> speed = {"speed": ("m s-1", lambda model: np.hypot(*model.velocity()))}
    >>> model.advance(days=14, recorders=[RunWriter("run.nc", derived=speed)])  # doctest: +SKIP
    """

    def __init__(
        self,
        path: str | Path,
        *,
        every_hours: float = 1.0,
        experiment: str = "",
        seed: int | None = None,
        flush_seconds: float = 1.0,
        background: bool = True,
        forces: bool = False,
        derived: Mapping[str, tuple[str, Callable[[Any], Any]]] | None = None,
        goes_on: bool = False,
        origin: Mapping[str, str] | None = None,
    ) -> None:
        self.path, self.origin = Path(path), dict(origin or {})
        self.interval = 3600.0 * every_hours
        self.experiment, self.seed = experiment, seed
        self.flush_seconds, self.background = flush_seconds, background
        self.forces, self.goes_on = forces, goes_on
        self._derived = [*([APPLIED] if forces else []), *user_variables(derived or {})]
        self._made = False
        self._held: list[Record] = []
        self._last_flush = self._pause = 0.0
        self._next = 0.0
        self._latest = float("nan")
        self._peak: Floats = np.zeros(0)
        self._peak_ids: Ints = np.zeros(0, np.int64)
        self._with_tracks = True
        self._taken = OneWriter(self.path)

    @property
    def records(self) -> int:
        """Number of records in the file."""
        return self._file.records

    def start(self, model: BareModel) -> None:
        """Create the file and hold the first record; or take up the file that is there."""
        os.makedirs(self.path.parent, exist_ok=True)
        self._taken.take()
        derived = [*self._derived, *(own_applied(model) if self.forces else ())]
        attributes = run_attributes(model, experiment=self.experiment, seed=self.seed) | self.origin
        self._file = RecordFile(self.path, model, derived, attributes, tracks=self._with_tracks)
        self._held, self._means = [], Means(model, derived)
        try:
            if self.goes_on:
                self._take_up_file(model)
            else:
                self._file.follow(model)
            self._take_up(model)
            # A new file takes the place of an old one with its first record, not before.
            self._flush(model, new=not self.goes_on)
            self._made = not self.goes_on
        except BaseException:
            self._taken.give_back()
            raise

    def record(self, model: BareModel) -> None:
        """Hold a record where one is due, and write records that have been held for long enough."""
        if not np.array_equal(self._peak_ids, model.bonds.id):
            self._peak = reorder(self._peak_ids, self._peak, model.bonds.id, -np.inf)
            self._peak_ids = model.bonds.id.copy()
        np.maximum(self._peak, model.bonds.peak_stress, out=self._peak)
        self._means.add(model)
        due = model.time >= self._next - ROUND
        self._remember(model)
        if due:
            self._take(model)
            self._schedule(model)
            if clock.monotonic() - self._last_flush >= self._pause:
                self._flush(model)

    def finish(self, model: BareModel) -> None:
        """Write the held records, and the last state even where no record was due."""
        try:
            if model.time > self._latest + ROUND:
                self._take(model)
            self._flush(model, last=True)
        finally:
            self._taken.give_back()

    def flush(self, model: BareModel) -> None:
        """Write the held records, so that the file is complete up to this moment."""
        if self._held:
            self._flush(model)

    def discard(self) -> None:
        """Remove the file of a run that came to nothing; one that this run did not make stays."""
        if self._made:
            self.path.unlink(missing_ok=True)

    def _take(self, model: BareModel) -> None:
        self._file.follow(model)
        derived = {**self._means.values(model), **values_now(model, self._file.derived)}
        self._held.append(Record(model, self._peak, derived, self._file.layout))
        self._latest = model.time

    def _schedule(self, model: BareModel) -> None:
        """Begin the interval up to the next record."""
        self._means.begin()
        self._peak, self._peak_ids = model.bonds.normal_stress.copy(), model.bonds.id.copy()
        self._next = model.time if self.interval <= 0.0 else self._next + self.interval

    def _remember(self, model: BareModel) -> None:
        """Store in the model the data of the record of this moment beyond its state, and when the next is due."""
        memory: dict[str, Any] = {"peak_stress": self._peak.copy(), "times": np.array([model.time, self._next])}
        memory |= {**self._means.kept, **self._file.memory}
        model.remembered.update({self._key(name): value for name, value in memory.items()})

    def _key(self, name: str) -> str:
        return f"record_{name}_every_{self.interval:g}_s"

    def _first_due(self, time: float) -> float:
        """Return when the first record is due, in step with a run from the start."""
        return time if self.interval <= 0.0 else self.interval * np.ceil((time - ROUND) / self.interval)

    def _take_up(self, model: BareModel) -> None:
        """Take the first record; where a run goes on, it and the later ones equal those in a run that never stopped."""
        memory = model.remembered
        last_time, due = memory.get(self._key("times"), (np.nan, np.nan))
        peak = memory.get(self._key("peak_stress"), np.zeros(0))
        goes_on = last_time == model.time and peak.shape == model.bonds.normal_stress.shape
        if goes_on:
            self._peak, self._next = np.array(peak), float(due)
            self._means.take_up(memory.get(self._key("sums")), memory.get(self._key("seconds")))
        elif self.goes_on:
            raise InputError("the restart file does not know its last record", where=str(self.path), remedy=ANEW)
        else:
            # Where nothing was recorded before, the largest stress known is that of the last long step.
            bonds = model.bonds
            self._peak = np.maximum(bonds.normal_stress, bonds.peak_stress if model.step_number else -np.inf)
            self._next = self._first_due(model.time)
        self._peak_ids = model.bonds.id.copy()
        self._remember(model)
        due = model.time >= self._next - ROUND
        if due or not self.goes_on:  # a file that goes on has the records of the run that never stopped
            self._take(model)
        if due:
            self._schedule(model)

    def _take_up_file(self, model: BareModel) -> None:
        """Lay the file out as it was when the state of the model was saved, with the records from before."""
        location = f"{self.path}, going on with it"
        with reading(location, "a damaged run file", ANEW), open_netcdf(self.path) as old:
            old.set_auto_mask(False)
            gap = missing_records(old["time"][:], model.remembered, self.interval)
            if gap:
                raise InputError(gap, where=location, remedy=ANEW)
            if self.forces != (APPLIED.variables[0].name in old.variables):
                raise InputError(
                    f"its records have {'no ' if self.forces else ''}forces", where=location,
                    remedy=f"{'Leave out' if self.forces else 'Give'} --forces, as for the run that made it",
                )  # fmt: skip
            layout = {name: model.remembered[self._key(name)] for name in self._file.memory}
            self._file.take_up(old, model, layout, location)
        self._latest = self._file.last_time
        self._file.lay_out_anew(model)

    def _flush(self, model: BareModel, *, new: bool = False, last: bool = False) -> None:
        flush_start = clock.monotonic()
        try:
            self._file.save(model, self._held, new=new, last=last, background=self.background)
        except (OSError, RuntimeError) as error:  # HDF5 says the latter where a file may not grow
            raise RunError(f"cannot write {self.path} ({refusal(error)}); {self._good(model)}") from error
        self._held = []
        self._last_flush = clock.monotonic()
        # Files of gigabytes take longer to copy; then records are held longer, so that writing stays a small part.
        self._pause = (
            max(self.flush_seconds, _PATIENCE * (self._last_flush - flush_start)) if self.flush_seconds else 0.0
        )

    def _good(self, model: BareModel) -> str:
        """Say up to when the file holds records."""
        if not self._file.records:
            return "it holds no records yet"
        return f"it holds good records up to {model.start + timedelta(seconds=self._file.last_time):%Y-%m-%d %H:%M}"


def missing_records(times: Floats, memory: Mapping[str, Any], interval: float) -> str:
    """Say which records of a run file are missing before a state that shall go on with it; nothing where all are there.

    ``times``: of the records in the file, s; ``interval``: interval of the records that is asked for, s.
    """
    moment = memory.get(f"record_times_every_{interval:g}_s")
    if moment is None or f"record_rows_change_every_{interval:g}_s" not in memory:
        return f"the run had no records every {interval / 3600.0:g} h"
    due = float(moment[1]) - interval
    if due > -ROUND and not (times.size and times[-1] >= due - ROUND):
        return f"its records end before {due / 86400.0:.2f} days, when the state was saved"
    return ""


def open_run(path: str | Path) -> xr.Dataset:
    """Open the trajectory file of a run, finished or under way.

    Parameters
    ----------
    path : path
        ``run.nc``, or the folder that holds it.

    Returns
    -------
    xarray.Dataset
        With dimensions ``trajectory`` (elements), ``time``, ``bond`` and ``fragment``; ``run.riftberg`` has its bergs,
        fragments and elements (`riftberg.runs.accessor.RunAccessor`).

    Raises
    ------
    InputError
        If it is no run file, or a damaged one: see `riftberg.runs.layout`.
    """
    import riftberg.runs.accessor  # noqa: F401  (run.riftberg)

    required(path, (str, Path), "the path of a run.nc, or of its folder", where="open_run")
    path = Path(path)
    file = path / "run.nc" if is_folder(path) else path
    return open_checked(file)


def open_own(file: Path) -> xr.Dataset:
    """Open a run file that this process has just written: its values need not be checked again."""
    import riftberg.runs.accessor  # noqa: F401  (run.riftberg)

    return open_checked(file, trusted=True)


class _RunWithDataset(RunWriter):
    """Writer whose file can be had as a dataset; one without a name of its own lives in memory afterwards."""

    def __init__(self, path: Path, every_hours: float, in_memory: bool, forces: bool) -> None:
        # The background is read from a file; a run in memory can do without.
        super().__init__(path, every_hours=every_hours, background=not in_memory, forces=forces)
        self._in_memory, self._with_tracks = in_memory, not in_memory

    def dataset(self) -> xr.Dataset:
        """Return the written run."""
        dataset = open_own(self.path)
        if self._in_memory:
            dataset.load()
            dataset.close()
        return dataset


@contextmanager
def memory_run(output: str | Path | None, every_hours: float, forces: bool = False) -> Iterator[_RunWithDataset]:
    """Give a recorder for ``output``, or for a passing file whose content ends up in memory.

    ``every_hours``: interval between records, in hours of model time.
    """
    with TemporaryDirectory(prefix="riftberg-") as folder:
        path = Path(folder) / "run.nc" if output is None else Path(output)
        yield _RunWithDataset(path, every_hours, in_memory=output is None, forces=forces)
