"""States kept on the way, so that a run that was killed, or whose machine is lost, goes on from the last of them."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import InputError, RiftbergError
from riftberg.runs.restart import load_state
from riftberg.runs.run_file import RunWriter, missing_records, open_run
from riftberg.system.atomic_files import refusal
from riftberg.system.netcdf_lock import open_netcdf
from riftberg.system.process import say

if TYPE_CHECKING:
    from riftberg.runs.restart import RestartState

ENDING: Final = ".restart.nc"

_NAMES: Final = (f"kept-1{ENDING}", f"kept-2{ENDING}")


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
        """Remove the states of a run that has come to its end, which nobody needs."""
        for path in self._paths() if self.writer.goes_on else self.written:
            path.unlink(missing_ok=True)


def last_good(
    folder: Path, interval: float, check: Callable[[RestartState, Path], None], tell: Callable[[str], None] = say
) -> Path:
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
        tell(f"Notice: {text}")
    return max(good)[1]
