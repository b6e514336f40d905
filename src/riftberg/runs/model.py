"""The model with its files: a run file, restart files, states kept on the way, and going on from them.

A run that was killed, or whose machine is lost, goes on from the last state that was kept.
"""

from __future__ import annotations

import logging
import sys
import time as clock
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from riftberg.config.usual_ranges import of_records
from riftberg.config.values import number, required
from riftberg.constants import SECONDS_PER_DAY
from riftberg.engines.common.laws import LAW_NAMES, Laws
from riftberg.errors import InputError, RiftbergError, RunError
from riftberg.model import BareModel, Recorder, check_recorders
from riftberg.ocean.forcing import Forcing
from riftberg.runs.background import keep_water
from riftberg.runs.progress import ProgressRecorder, in_notebook
from riftberg.runs.restart import load_state, save
from riftberg.runs.run_file import RunWriter, memory_run, missing_records, open_run
from riftberg.system.atomic_files import copy_file, refusal
from riftberg.system.netcdf_lock import open_netcdf
from riftberg.system.process import held, in_charge, say

if TYPE_CHECKING:
    import xarray as xr

    from riftberg.runs.restart import RestartState


ENDING: Final = ".restart.nc"

INTERRUPTED: Final = "interrupted.nc"
"""Where the records of a script that is stopped, and gave no file for them, end up, with its state beside it."""

_NAMES: Final = (f"kept-1{ENDING}", f"kept-2{ENDING}")


def in_script() -> bool:
    """Whether a model is run by a program that ends when it is stopped, and its model with it."""
    return in_charge() and not in_notebook() and not hasattr(sys, "ps1")


class StateKeeper:
    """Recorder that saves the state now and then, in two files by turns: one of them is whole at any moment.

    Give it after all recorders that leave something in the state. The run file is written first, so that it has all records
    up to a state that is kept.
    """

    def __init__(self, writer: RunWriter, *, every_days: float | None = None, minutes: float = 10.0) -> None:
        self.writer, self.minutes = writer, minutes
        self.seconds = None if every_days is None else every_days * SECONDS_PER_DAY
        self.written: list[Path] = []
        self._turn = 0
        self._saved, self._saved_time = clock.monotonic(), 0.0

    def start(self, model: Any) -> None:
        """Begin to count; the older of two states that are there is the first to be replaced."""
        self._saved, self._saved_time = clock.monotonic(), model.time
        ages = [path.stat().st_mtime if path.exists() else 0.0 for path in self._paths()]
        self._turn = int(ages[1] < ages[0])

    def record(self, model: Any) -> None:
        """Save the state where that is due."""
        by_wall = self.minutes > 0.0 and clock.monotonic() - self._saved >= 60.0 * self.minutes
        if by_wall or (self.seconds is not None and model.time - self._saved_time >= self.seconds - 1e-6):
            path = self._paths()[self._turn]
            self.writer.flush(model)
            try:
                model.save(path)
            except (OSError, RiftbergError) as error:  # what is kept for a bad day must not end a good one
                say(f"Notice: the state cannot be kept ({refusal(error)}); the run goes on")
            else:
                self._turn = 1 - self._turn
                self.written = list({*self.written, path})
            self._saved, self._saved_time = clock.monotonic(), model.time

    def _paths(self) -> list[Path]:
        return [self.writer.path.with_name(name) for name in _NAMES]

    def finish(self, model: Any) -> None:
        """Leave the states; see `remove`."""

    def remove(self) -> None:
        """Remove the states of a run that has come to its end, which are not needed."""
        for path in self._paths() if self.writer.goes_on else self.written:
            path.unlink(missing_ok=True)


def last_good(folder: Path, interval: float, check: Callable[[RestartState, Path], None]) -> Path:
    """Return the restart file from which the run in a folder goes on: the latest that is whole, with all records before it.

    ``interval``: interval of the records, s.
    """
    open_run(folder).close()  # refused here where it is none
    with open_netcdf(folder / "run.nc") as file:
        times = np.asarray(file["time"][:], np.float64)
    good: list[tuple[float, Path]] = []
    passed: list[str] = []
    for path in sorted(folder.glob(f"*{ENDING}")):
        try:
            state = load_state(path)
            check(state, path)
            missing = missing_records(times, state.extra, interval)
            if missing:
                raise InputError(missing, where=str(folder / "run.nc"))
            good.append((state.time, path))
        except RiftbergError as error:
            passed.append(f"{path.name} is passed over: {error}")
    if not good and not passed and (folder / "summary.json").exists():
        raise InputError(
            "the run has come to its end, and left no state to go on from", where=str(folder),
            remedy="For a longer run start anew with more days, without --resume",
        )  # fmt: skip
    if not good:
        raise InputError(
            f"no state to go on from{'; ' if passed else ''}{'; '.join(passed)}", where=str(folder),
            remedy="Start the run anew, without --resume",
        )  # fmt: skip
    for text in passed:
        say(f"Notice: {text}")
    return max(good)[1]


_LOG = logging.getLogger(__name__)

OWN_EXTRAS = ("next_element", "next_bond", "own_laws")
"""Entries of a restart file beside the state that no recorder has left there."""


class Model(BareModel):
    """Bonded icebergs in an ocean.

    Parameters
    ----------
    berg : Iceberg
        Elements and bonds at the start; copied.
    forcing : Forcing
        Ocean, air, sea ice and sea floor.
    parameters : Parameters, optional
        All parameters; by default `Parameters`, which hold for bergs of any size (`A68A_2022` is tuned to one).
    start : date, optional
        Date of time zero (UTC): a datetime, a text such as ``"2020-12-09 13:00"``, a datetime64 or a Timestamp; by default
        the start of the forcing, if it counts from a date.
    laws : Laws, optional
        A force, a melt law and a fracture criterion of one's own.

    Attributes
    ----------
    elements : Elements
        The elements now; take them anew after some have come or gone.
    bonds : Bonds
        The bonds now; likewise.
    time : float
        Seconds since the start.
    step_number : int
        Long steps taken.
    fragments : FragmentTree
        Family tree of the fragments.
    after_step : list of callables
        Processes called after each long step, see `riftberg.model.BareModel`.
    substeps : int
        Sub-steps in a long step.

    Examples
    --------
    >>> from riftberg import Forcing, Iceberg, Model
    >>> berg = Iceberg.rectangle("12 km", "6 km", thickness="200 m", placement=(-37.0, -56.0))
    >>> model = Model(berg, Forcing.uniform(current=(0.2, 0.0)), start="2020-12-09 13:00")
    >>> run = model.run("1 h")
    >>> run.sizes["trajectory"]
    8
    """

    def run(
        self,
        days: float | str | None = None,
        *,
        steps: int | None = None,
        recorders: Sequence[Recorder] = (),
        output: str | Path | None = None,
        every_hours: float | str = 1.0,
        forces: bool = False,
        progress: bool | None = None,
    ) -> xr.Dataset:
        """Run for some days and return the trajectory.

        Parameters
        ----------
        days : float or str
            Length of the run, days or with a unit (``"36 h"``); or give ``steps``.
        steps : int
            Number of long steps.
        recorders : sequence of Recorder
            Called after every long step.
        output : path, optional
            Run file to write; kept in memory only if left out.
        every_hours : float or str
            Interval of the records in the run file, hours or with a unit (``"30 min"``).
        forces : bool, optional
            Record the mean force of each medium on each element too.
        progress : bool, optional
            Show how far the run is: a bar in a terminal or a notebook, lines elsewhere. By default a run that takes longer
            than some seconds does, with a line a minute; ``False`` shows nothing.

        Returns
        -------
        xarray.Dataset
            The run, as `riftberg.runs.run_file` writes it.

        Raises
        ------
        ForcingError
            If the forcing does not cover the whole run; raised before the first step.
        RunError
            If the run fails; the state of the last good step is saved first, beside ``output``, and the message says
            where. Without ``output`` the model itself is left at that state.
        KeyboardInterrupt
            After Ctrl-C, at the end of the step in hand; the run file is complete up to there, and the state is saved as
            above, those of a script without ``output`` in the current folder (``interrupted.nc``). So it is with the
            SystemExit after a request to terminate.
        """
        check_recorders(recorders)
        if output is not None:
            required(output, (str, Path), "the path of a run file", where="Model.run, output")
        start_step = self.step_number
        hours = number(every_hours, "h", where="every_hours")
        if days is not None:
            self.fit_time_step(min(3600.0 * hours, number(days, "day", where="days") * SECONDS_PER_DAY))
        left = self._count_steps(days, steps) * self.parameters.time_step
        length, end = left / SECONDS_PER_DAY, self.time + left
        for text in of_records(hours, length, self.parameters):
            _LOG.warning(text)
        progress_recorders, script = self._progress(length, progress), in_script()
        with held(), memory_run(output, hours, forces) as writer:
            try:
                super().advance(days, steps=steps, recorders=[*recorders, writer, *progress_recorders])
            except (KeyboardInterrupt, SystemExit):
                if output is None and script and writer.path.exists():
                    copy_file(writer.path, INTERRUPTED)
                    output = INTERRUPTED
                say(f"Stopped at {self.date:%Y-%m-%d %H:%M}. {self._rescue_state(output, end, 'interrupted')}")
                raise
            except RiftbergError as error:
                if self.step_number == start_step and not isinstance(error, RunError):
                    raise  # refused before the first step: there is nothing to save
                raise RunError(
                    f"the run failed at {self.date:%Y-%m-%d %H:%M}: {error}. {self._rescue_state(output, end)}"
                ) from error
            run = writer.dataset()
        if output is None:
            keep_water(run, self.forcing)
        return run

    def advance(
        self, days: float | str | None = None, *, steps: int | None = None, recorders: Sequence[Recorder] = (),
        step: Callable[[], object] | None = None, progress: bool | None = None,
    ) -> None:  # fmt: skip
        """Run for some days, calling the recorders; see `run`.

        Ctrl-C and requests to terminate take effect between two steps, after the recorders have finished their files. A
        recorder may have a method ``interrupted(model)``, which is called then. Of a script the state is saved in the current
        folder too (``interrupted.restart.nc``). ``step`` takes the model on in place of its own `step`, by one long step or
        several, as an exchange with an ocean does. ``progress``: as in `run`.
        """
        script = step is None and in_script()
        progress_recorders: list[Recorder] = []
        if progress or script:
            left = self._count_steps(days, steps) * self.parameters.time_step
            progress_recorders, end = self._progress(left / SECONDS_PER_DAY, progress), self.time + left
        with held():
            try:
                super().advance(days, steps=steps, recorders=[*recorders, *progress_recorders], step=step)
            except (KeyboardInterrupt, SystemExit):
                if script:
                    say(f"Stopped at {self.date:%Y-%m-%d %H:%M}. {self._rescue_state(INTERRUPTED, end, '')}")
                raise

    def _progress(self, days: float, progress: bool | None) -> list[Recorder]:
        """Return the recorders that show progress: the one requested, and in a script one that shows a run of some length."""
        if progress is False or not (progress or in_charge()):
            return []
        return [ProgressRecorder(days, patient=progress is None)]

    def _rescue_state(self, output: str | Path | None, end: float, why: str = "failed") -> str:
        """Save the last good state where there is a place for it, and say how to go on."""
        if output is None:
            return "The model is left at its last good state: save it with model.save(path)"
        path = Path(output)
        try:
            ending = f".{why}" if why and path.stem != why else ""
            saved = self.save(path.with_name(f"{path.stem}{ending}{ENDING}"))
        except (OSError, RiftbergError) as error:  # it must not hide why the run ended
            return f"The state cannot be saved ({refusal(error)}); the model is left at it: model.save(path)"
        left = round((end - self.time) / self.parameters.time_step)
        return f"Go on with Model.resume({str(saved)!r}, forcing).run(steps={left})"

    def save(self, path: str | Path) -> Path:
        """Write a restart file from which `resume` goes on bit for bit."""
        required(path, (str, Path), "the path of a restart file", where="Model.save")
        coming = {"next_element": self.population.next_element, "next_bond": self.population.next_bond}
        user_laws = self.laws.given()
        law_flags = {"own_laws": np.array([name in user_laws for name in LAW_NAMES], np.int64)} if user_laws else {}
        return save(self, path, extra={**coming, **law_flags, **self.remembered, **self._stepper.state_dict()})

    @classmethod
    def resume(cls, path: str | Path, forcing: Forcing, *, laws: Laws | None = None) -> Self:
        """Go on from a restart file; gives bit for bit the run that never stopped.

        Parameters
        ----------
        path : path
            File written by `save`.
        forcing : Forcing
            The same forcing as before. Processes (``after_step``) are attached anew.
        laws : Laws, optional
            The same laws of one's own as before.
        """
        required(path, (str, Path), "the path of a restart file", where="Model.resume")
        state = load_state(path)
        saved_laws = [name for name, was in zip(LAW_NAMES, state.extra.get("own_laws", ()), strict=False) if was]
        if missing := [name for name in saved_laws if laws is None or name not in laws.given()]:
            raise InputError(
                f"the run had a law of one's own for {' and '.join(missing)}", where=f"{path}, laws",
                remedy=f"Resume it with laws=Laws({', '.join(f'{name}=...' for name in missing)})",
            )  # fmt: skip
        model = cls.from_state(
            state.population(), forcing, state.parameters, state.start, state.time, state.step_number,
            state.fragments, state.bergs, state.contacts, laws,
        )  # fmt: skip
        model.groundings = state.groundings
        model.remembered = {name: value for name, value in state.extra.items() if name not in OWN_EXTRAS}
        model._stepper.load_state_dict(state.extra)
        return model
