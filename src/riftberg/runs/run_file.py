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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final

import netCDF4
import numpy as np
from numpy.typing import NDArray

from riftberg.config.values import required
from riftberg.errors import InputError, RunError
from riftberg.parameters import QuasiStaticParameters
from riftberg.runs.derived import (
    APPLIED,
    Means,
    define_ledgers,
    list_ledgers,
    own_applied,
    user_variables,
    values_now,
    write_fragment_melt,
)
from riftberg.runs.layout import (
    BOND_HISTORY,
    BOND_LATEST,
    COMMAND,
    FILE,
    PLACE,
    SHAPE,
    TABLES,
    Layout,
    define_texts,
    element_history,
    in_file,
    open_checked,
    position_names,
    reorder,
    run_attributes,
    texts,
    time_units,
)
from riftberg.runs.scene import add_background
from riftberg.runs.tracks import (
    ELEMENT_COLUMNS,
    GOES_ON,
    ON_BED,
    berg_rows,
    is_channel,
    ragged,
    split_blocks,
    track_longitudes,
    write_tracks,
)
from riftberg.state import BOND_VARIABLES, ELEMENT_VARIABLES, Floats, Ints, Variable
from riftberg.system.atomic_files import OneWriter, refusal, replacing
from riftberg.system.input_files import is_folder, reading
from riftberg.system.netcdf_lock import open_netcdf

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.model import BareModel

DOUBLE: Final = frozenset({"lon", "lat", "rotation"})
"""Variables kept in double precision at every record; the others are stored in single precision."""

MISSING: Final = -1
"""Value of whole numbers where an element is not there."""

_REGISTRY: Final = {v.name: v for v in ELEMENT_VARIABLES}
_VALUES_PER_CHUNK = 2048
_PATIENCE = 20.0  # records are held at least this many times as long as writing takes
_ANEW = "Go on from the restart into another folder (--resume FILE --output FOLDER)"
_ROUND = 1e-6  # s; a record is due although the sum of steps misses its time by round-off


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
        Add currents and sea floor around the run for maps (`riftberg.runs.scene`) at the end.

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
        self._asked = self._derived = [*([APPLIED] if forces else []), *user_variables(derived or {})]
        self.records = 0
        self._made = False
        self._held: list[_Record] = []
        self._last_flush = self._pause = 0.0
        self._next = 0.0
        self._latest = self._flushed = float("nan")
        self._peak: Floats = np.zeros(0)
        self._peak_ids: Ints = np.zeros(0, np.int64)
        self._layout = Layout()
        self._tracks: list[dict[str, NDArray[Any]]] = []  # rows of the bergs of written records, by block
        self._add_tracks = True
        self._names: dict[str, str] = {}
        self._attributes: dict[str, Any] = {}
        self._taken = OneWriter(self.path)

    def start(self, model: BareModel) -> None:
        """Create the file and hold the first record; or take up the file that is there."""
        os.makedirs(self.path.parent, exist_ok=True)
        self._taken.take()
        self._names = position_names(model.parameters.earth.latlon)
        self._layout = Layout()
        self.records, self._held, self._tracks = 0, [], []
        self._attributes = run_attributes(model, experiment=self.experiment, seed=self.seed) | self.origin
        self._derived = [*self._asked, *(own_applied(model) if self.forces else ())]
        self._means = Means(model, self._derived)
        try:
            if self.goes_on:
                self._take_up_file(model)
            else:
                self._layout.follow(model.elements, model.bonds, SHAPE, BOND_LATEST)
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
        due = model.time >= self._next - _ROUND
        self._remember(model)
        if due:
            self._take(model)
            self._schedule(model)
            if clock.monotonic() - self._last_flush >= self._pause:
                self._flush(model)

    def finish(self, model: BareModel) -> None:
        """Write the held records, and the last state even where no record was due."""
        try:
            if model.time > self._latest + _ROUND:
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
        self._layout.follow(model.elements, model.bonds, SHAPE, BOND_LATEST)
        derived = {**self._means.values(model), **values_now(model, self._derived)}
        self._held.append(_Record(model, self._peak, derived, self._layout))
        self._latest = model.time

    def _schedule(self, model: BareModel) -> None:
        """Begin the interval up to the next record."""
        self._means.begin()
        self._peak, self._peak_ids = model.bonds.normal_stress.copy(), model.bonds.id.copy()
        self._next = model.time if self.interval <= 0.0 else self._next + self.interval

    def _define(self, file: netCDF4.Dataset, model: BareModel) -> None:
        _define(file, model, self._names, self._layout)
        _define_histories(file, [v for entry in self._derived for v in entry.variables], self._names, self._layout)
        file.setncatts(self._attributes)
        self._layout.written()

    def _remember(self, model: BareModel) -> None:
        """Store in the model the data of the record of this moment beyond its state, and when the next is due."""
        memory: dict[str, Any] = {"peak_stress": self._peak.copy(), "times": np.array([model.time, self._next])}
        layout = self._layout
        memory |= {**self._means.kept, "rows_of_elements": layout.ids, "rows_of_bonds": layout.bond_ids}
        memory["rows_change"] = np.array([layout.gaps, *(name in layout.moving for name in SHAPE)], float)
        model.remembered.update({self._key(name): value for name, value in memory.items()})

    def _key(self, name: str) -> str:
        return f"record_{name}_every_{self.interval:g}_s"

    def _first_due(self, time: float) -> float:
        """Return when the first record is due, in step with a run from the start."""
        return time if self.interval <= 0.0 else self.interval * np.ceil((time - _ROUND) / self.interval)

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
            raise InputError("the restart file does not know its last record", where=str(self.path), remedy=_ANEW)
        else:
            # Where nothing was recorded before, the largest stress known is that of the last long step.
            bonds = model.bonds
            self._peak = np.maximum(bonds.normal_stress, bonds.peak_stress if model.step_number else -np.inf)
            self._next = self._first_due(model.time)
        self._peak_ids = model.bonds.id.copy()
        self._remember(model)
        due = model.time >= self._next - _ROUND
        if due or not self.goes_on:  # a file that goes on has the records of the run that never stopped
            self._take(model)
        if due:
            self._schedule(model)

    def _take_up_file(self, model: BareModel) -> None:
        """Lay the file out as it was when the state of the model was saved, with the records from before."""
        memory: dict[str, Any] = model.remembered
        layout, location = self._layout, f"{self.path}, going on with it"
        with reading(location, "a damaged run file", _ANEW), open_netcdf(self.path) as old:
            old.set_auto_mask(False)
            gap = missing_records(old["time"][:], memory, self.interval)
            if gap:
                raise InputError(gap, where=location, remedy=_ANEW)
            on_bed = ON_BED if model.parameters.grounding.law == "seabed" else ()
            if self.forces != (APPLIED.variables[0].name in old.variables):
                raise InputError(
                    f"its records have {'no ' if self.forces else ''}forces", where=location,
                    remedy=f"{'Leave out' if self.forces else 'Give'} --forces, as for the run that made it",
                )  # fmt: skip
            layout.ids, layout.bond_ids = memory[self._key("rows_of_elements")], memory[self._key("rows_of_bonds")]
            elements, bonds = layout.ids.size, layout.bond_ids.size
            if not np.array_equal(old["trajectory"][:elements], layout.ids) or old.dimensions["bond"].size < bonds:
                raise InputError(
                    "its elements are not those of the restart file", where=location, remedy="Name another"
                )
            # The command that made the run, not the one that continues it.
            self._attributes |= {name: old.getncattr(name) for name in (COMMAND, FILE, PLACE) if name in old.ncattrs()}
            if old.getncattr("parameters_json") != self._attributes["parameters_json"]:
                raise InputError(
                    "a run with other parameters than those of the restart file", where=location,
                    remedy=_ANEW,
                )  # fmt: skip
            change = memory[self._key("rows_change")].tolist()
            layout.taken_up(
                {name: _first_seen(old[in_file(name)][:elements]) for name in SHAPE},
                {name: old[in_file(name)][:bonds] for name in BOND_LATEST},
                gaps=bool(change[0]), moving=[name for name, moves in zip(SHAPE, change[1:], strict=True) if moves],
            )  # fmt: skip
            self.records = int(np.searchsorted(old["time"][:], model.time - _ROUND))
            self._latest = self._flushed = float(old["time"][self.records - 1])
            rows = {"trajectory": slice(elements), "bond": slice(bonds)}
            for block in split_blocks(self.records, elements):
                columns = {
                    name: variable[tuple(rows.get(dim, block) for dim in variable.dimensions)]
                    for name in (*ELEMENT_COLUMNS, *on_bed, *bond_history(model))
                    for variable in [old[self._names.get(name, name)]]
                }
                self._tracks.append(berg_rows(old["time"][block], layout.latest | columns, model.parameters))
        self._lay_out_anew(model)

    def _flush(self, model: BareModel, *, new: bool = False, last: bool = False) -> None:
        flush_start = clock.monotonic()
        try:
            if self._layout.outgrown and not new:
                self._lay_out_anew(model)
            # Never an old file emptied: HDF5 refuses to write what this process still has open for reading.
            with replacing(self.path, copy=not new) as copy, open_netcdf(copy, "w" if new else "a") as file:
                if new:
                    self._define(file, model)
                file.set_auto_mask(False)
                self._write(file, model)
                if last and self._tracks and self._add_tracks:  # a berg lies in one piece, and cannot be appended to
                    fragments = {row.number: vars(row) for row in model.fragments.rows}
                    write_tracks(file, ragged(self._tracks, fragments, model.start, not self._names))
                if last and self.background:
                    add_background(file, model)
        except (OSError, RuntimeError) as error:  # HDF5 says the latter where a file may not grow
            raise RunError(f"cannot write {self.path} ({refusal(error)}); {self._good(model)}") from error
        self.records += len(self._held)
        self._flushed = self._held[-1].time if self._held else self._flushed
        self._held = []
        self._last_flush = clock.monotonic()
        # Files of gigabytes take longer to copy; then records are held longer, so that writing stays a small part.
        self._pause = (
            max(self.flush_seconds, _PATIENCE * (self._last_flush - flush_start)) if self.flush_seconds else 0.0
        )

    def _good(self, model: BareModel) -> str:
        """Say up to when the file holds records."""
        if not self.records:
            return "it holds no records yet"
        return f"it holds good records up to {model.start + timedelta(seconds=self._flushed):%Y-%m-%d %H:%M}"

    def _lay_out_anew(self, model: BareModel) -> None:
        """Write the file again, with room for elements and bonds that have come since."""
        with replacing(self.path) as temporary, open_netcdf(self.path) as old, open_netcdf(temporary, "w") as file:
            old.set_auto_mask(False)
            file.set_auto_mask(False)
            self._define(file, model)
            block = slice(0, self.records)
            file["time"][block] = old["time"][block]
            has_position = np.isfinite(old[self._names.get("lon", "lon")][:, block])
            for name, variable in old.variables.items():
                if name not in file.variables or file[name].dimensions[1:] != ("time",):
                    continue  # written with the latest state, or fixed since it was laid out
                rows = slice(0, min(variable.shape[0], file[name].shape[0]))
                if variable.dimensions[1:] == ("time",):
                    file[name][rows, block] = variable[rows, block]
                else:
                    file[name][rows, block] = np.where(has_position[rows], variable[rows][:, None], np.nan)

    def _write(self, file: netCDF4.Dataset, model: BareModel) -> None:
        # Write the present state of the bonds and the family tree, over the earlier ones.
        self._layout.refresh(model.elements, model.bonds, BOND_LATEST)
        for name in BOND_LATEST:
            file[in_file(name)][:] = self._layout.latest[name]
        events: tuple[Sequence[Any], ...] = (
            model.fragments.rows, model.contacts.rows, model.groundings.rows, model.rift_tips,
        )  # fmt: skip
        if written := file.dimensions["rift_tip"].size:
            file["rift_tip_crack"][:written] = 0  # tips that stand no more keep their rows
        for (kind, variables), rows in zip(TABLES, events, strict=True):
            for v in variables if rows else ():
                values = [getattr(row, v.name) for row in rows]
                column = texts(values) if v.dtype == "str" else np.array(values, v.dtype)
                file[f"{kind}_{self._names.get(v.name, v.name)}"][: len(rows)] = column
        write_fragment_melt(file, model)
        if self._held:
            self._write_records(file, model, slice(self.records, self.records + len(self._held)))

    def _write_records(self, file: netCDF4.Dataset, model: BareModel, block: slice) -> None:
        layout, records = self._layout, self._held
        columns: dict[str, NDArray[Any]] = {}
        for v in [*histories(model), *(_REGISTRY[name] for name in SHAPE)]:
            missing = MISSING if v.dtype == "i8" else np.nan
            columns[v.name] = np.stack(
                [reorder(r.ids, r.elements[v.name], layout.ids, missing) for r in records], axis=1
            )
        for name in bond_history(model):
            columns[name] = np.stack(
                [reorder(r.bond_ids, r.bonds[name], layout.bond_ids, np.nan) for r in records], axis=1
            )
        for name, values in columns.items():
            if name not in SHAPE or name in layout.moving:
                file[self._names.get(name, in_file(name))][:, block] = values
        for name in records[0].ledger:
            file[name][:, block] = np.stack([r.ledger[name] for r in records], axis=1)
        for name in records[0].derived:
            derived = [reorder(r.ids, r.derived[name], layout.ids, np.nan) for r in records]
            file[name][:, block] = np.stack(derived, axis=1)
        times = np.array([r.time for r in records])
        file["time"][block] = times
        self._tracks.append(berg_rows(times, layout.latest | columns, model.parameters))


def missing_records(times: Floats, memory: Mapping[str, Any], interval: float) -> str:
    """Say which records of a run file are missing before a state that shall go on with it; nothing where all are there.

    ``times``: of the records in the file, s; ``interval``: interval of the records that is asked for, s.
    """
    moment = memory.get(f"record_times_every_{interval:g}_s")
    if moment is None or f"record_rows_change_every_{interval:g}_s" not in memory:
        return f"the run had no records every {interval / 3600.0:g} h"
    due = float(moment[1]) - interval
    if due > -_ROUND and not (times.size and times[-1] >= due - _ROUND):
        return f"its records end before {due / 86400.0:.2f} days, when the state was saved"
    return ""


def _first_seen(values: NDArray[Any]) -> NDArray[Any]:
    """Return the shape of each element at its first record."""
    if values.ndim == 1:
        return values
    first: NDArray[Any] = values[np.arange(len(values)), np.argmax(np.isfinite(values), axis=1)]
    return first


class _Record:
    """Copies of the variables of one time, as the file has them, so that the tracks are those that a reader finds from it."""

    def __init__(self, model: BareModel, peak: Floats, derived: dict[str, Floats], layout: Layout) -> None:
        self.time = float(model.time)
        elements, bonds = model.elements, model.bonds
        # Identifiers of the layout itself where they are the same: `reorder` then need not compare them for each variable.
        self.ids = layout.ids if np.array_equal(elements.id, layout.ids) else elements.id.copy()
        self.bond_ids = layout.bond_ids if np.array_equal(bonds.id, layout.bond_ids) else bonds.id.copy()
        moving = dict(zip(("u", "v", "lon"), (*model.velocity(), track_longitudes(model)), strict=True))
        self.elements = {
            v.name: moving.get(v.name, getattr(elements, v.name)).astype(_stored_kind(v)) for v in histories(model)
        }
        self.elements |= {name: getattr(elements, name).copy() for name in SHAPE}
        self.bonds = {name: getattr(bonds, name).astype("f4") for name in bond_history(model)}
        self.bonds["peak_stress"] = peak.astype("f4")
        self.derived = derived
        self.ledger = values_now(model, list_ledgers(model))


def histories(model: BareModel) -> list[Variable]:
    """Return the variables of the elements that every record of this run holds."""
    return [v for v in element_history() if v.name not in ON_BED or model.parameters.grounding.law == "seabed"]


def bond_history(model: BareModel) -> tuple[str, ...]:
    """Return the variables of the bonds that every record of this run holds."""
    p = model.parameters
    return (*BOND_HISTORY, "damage") if isinstance(p, QuasiStaticParameters) and p.damage.enabled else BOND_HISTORY


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
        self._in_memory, self._add_tracks = in_memory, not in_memory

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


def _define(file: netCDF4.Dataset, model: BareModel, names: dict[str, str], layout: Layout) -> None:
    """Create dimensions and variables, and write the constants."""
    file.setncatts({"Conventions": "CF-1.11", "featureType": "trajectory"})
    file.createDimension("trajectory", len(layout.ids))
    file.createDimension("time", None)
    file.createDimension("bond", len(layout.bond_ids))
    for kind, _ in TABLES:
        file.createDimension(kind, None)
    about = {"standard_name": "time", "long_name": "time", **time_units(model.start), "axis": "T"}
    _create(file, "time", "f8", ("time",), **about)
    # CF before 1.9 knows no 64-bit whole numbers; identifiers that need them are those of no run of ours.
    kind = "i4" if layout.ids.max(initial=0) <= np.iinfo(np.int32).max else "i8"
    number = _create(
        file, "trajectory", kind, ("trajectory",), cf_role="trajectory_id", long_name="identifier of the element"
    )
    number[:] = layout.ids
    for name in SHAPE:
        described = _variable_attributes(_REGISTRY[name], names)
        if name in layout.moving:
            _create(
                file, in_file(name), "f8", ("trajectory", "time"), layout.gaps, **described, coordinates=_where(names)
            )
        else:
            kind = "i4" if _REGISTRY[name].dtype == "i8" else "f8"
            _create(file, in_file(name), kind, ("trajectory",), **described)[:] = layout.shape[name]
    _define_histories(file, histories(model), names, layout)
    if is_channel(model.parameters):
        file[names.get("lon", "lon")].comment = GOES_ON
    registry = {v.name: v for v in BOND_VARIABLES}
    for name in BOND_LATEST:
        v = registry[name]
        attributes = _variable_attributes(v, {})
        if name == "break_time":
            attributes |= {**time_units(model.start), "long_name": "time of breaking, missing while unbroken"}
        if name == "status":
            attributes |= {"flag_meanings": "unbroken broken_in_contact gone"}
        stored = _create(file, in_file(name), "i4" if v.dtype == "i8" else "f8", ("bond",), **attributes)
        if name == "status":
            stored.flag_values = np.arange(3, dtype="i4")
    for name in bond_history(model):
        attributes = _variable_attributes(registry[name], {})
        if name == "peak_stress":
            attributes["long_name"] = "largest normal_stress of any sub-step since the record before"
        _create(file, name, "f4", ("bond", "time"), layout.gaps, **attributes)
    for kind, variables in TABLES:
        for v in variables:
            attributes = {**_variable_attributes(v, names), "long_name": v.long_name}
            attributes.pop("axis", None)
            if v.name in ("lon", "lat") and not names:
                attributes["standard_name"] = {"lon": "longitude", "lat": "latitude"}[v.name]
            if v.name in ("birth_time", "time", "end"):
                attributes |= time_units(model.start)
            name = f"{kind}_{names.get(v.name, v.name)}"
            if v.dtype == "str":
                define_texts(file, name, kind).setncatts(
                    {key: value for key, value in attributes.items() if value != ""}
                )
                continue
            _create(file, name, _COLUMNS.get(v.dtype, "f8"), (kind,), **attributes)
    define_ledgers(file, model)


def _create(
    file: netCDF4.Dataset, name: str, kind: Any, dims: tuple[str, ...], gaps: bool = False, /, **attributes: Any
) -> netCDF4.Variable[Any]:
    packed = "time" in dims and len(dims) == 2
    chunks = None
    if packed:
        rows = max(1, file.dimensions[dims[0]].size)
        chunks = (rows, int(np.clip(_VALUES_PER_CHUNK // rows, 1, 512)))
    # Light compression only: a run must not wait for its file. Stresses of bonds, a third of the work, lose but a sixth by it.
    light = {"compression": "zlib", "complevel": 1, "shuffle": True}
    options: dict[str, Any] = light if packed and dims[0] != "bond" else {}
    missing = (MISSING if kind == "i4" else np.nan) if gaps and packed else False
    variable = file.createVariable(name, kind, dims, chunksizes=chunks, fill_value=missing, fletcher32=True, **options)
    variable.setncatts({key: value for key, value in attributes.items() if value != ""})
    return variable


def _variable_attributes(v: Variable, names: dict[str, str]) -> dict[str, str]:
    """Attributes of a variable; positions on a Cartesian grid are metres."""
    if v.name in names:
        axis = names[v.name]
        attributes = {"units": "m", "standard_name": f"projection_{axis}_coordinate", "long_name": f"{axis} position"}
        return {**attributes, "axis": axis.upper()}
    return {"units": v.units, "long_name": v.long_name, "standard_name": v.standard_name}


def _stored_kind(v: Variable) -> str:
    if v.dtype == "i8":
        return "i4"
    return "f8" if v.name in DOUBLE else "f4"


def _where(names: dict[str, str]) -> str:
    return f"time {names.get('lat', 'lat')} {names.get('lon', 'lon')}"


def _define_histories(
    file: netCDF4.Dataset, variables: Iterable[Variable], names: dict[str, str], layout: Layout
) -> None:
    """Create variables of the elements that every record holds."""
    where = _where(names)
    for v in variables:
        coordinates = "" if v.name in ("lon", "lat") else where
        _create(
            file,
            names.get(v.name, v.name),
            _stored_kind(v),
            ("trajectory", "time"),
            layout.gaps,
            **_variable_attributes(v, names),
            coordinates=coordinates,
        )


_COLUMNS: Final[dict[str, Any]] = {"i8": "i4", "str": str}
