"""The model with its files: a run file, restart files, and going on from them."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

from riftberg.config.usual_ranges import of_records
from riftberg.config.values import number, required
from riftberg.constants import SECONDS_PER_DAY
from riftberg.errors import RiftbergError, RunError
from riftberg.model import BareModel, Recorder, check_recorders
from riftberg.ocean.forcing import Forcing
from riftberg.runs.background import keep_water
from riftberg.runs.progress import ProgressRecorder
from riftberg.runs.restart import load_state, save
from riftberg.runs.run_file import memory_run
from riftberg.system.atomic_files import refusal
from riftberg.system.process import held, say

if TYPE_CHECKING:
    import xarray as xr

_LOG = logging.getLogger(__name__)

OWN_EXTRAS = ("next_element", "next_bond")
"""What a restart file holds beside the state that no recorder has left there."""


class Model(BareModel):
    """Bonded icebergs in an ocean.

    Parameters
    ----------
    berg : Iceberg
        Elements and bonds at the start; copied.
    forcing : Forcing
        Ocean, air, sea ice and sea floor.
    parameters : Parameters, optional
        All parameters; by default those of `Parameters`, which hold for bergs of any size (`A68A_2022` is tuned to one).
    start : date, optional
        Date of time zero (UTC): a datetime, a text such as ``"2020-12-09 13:00"``, a datetime64 or a Timestamp; by default
        that of the forcing, if it counts from a date.

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
    >>> from riftberg import Iceberg, Model, Steady
    >>> berg = Iceberg.rectangle("12 km", "6 km", thickness="200 m", placement=(-37.0, -56.0))
    >>> model = Model(berg, Steady(current=(0.2, 0.0)), start="2020-12-09 13:00")
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
        progress: bool = False,
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
            Show how far the run is: a bar in a terminal or a notebook, lines elsewhere.

        Returns
        -------
        xarray.Dataset
            The run, as `riftberg.runs.run_file` writes it.

        Raises
        ------
        ForcingError
            If the forcing does not serve the whole run; raised before the first step.
        RunError
            If the run fails; the state of the last good step is saved first, beside ``output``, and the message says
            where. Without ``output`` the model itself is left at that state.
        KeyboardInterrupt
            After Ctrl-C, at the end of the step in hand; the run file is complete up to there, and the state is saved as
            above. So it is with the SystemExit after a request to terminate.
        """
        check_recorders(recorders)
        if output is not None:
            required(output, (str, Path), "the path of a run file", where="Model.run, output")
        before = self.step_number
        hours = number(every_hours, "h", where="every_hours")
        left = self._number_of_steps(days, steps) * self.parameters.stepping.time_step
        length, end = left / SECONDS_PER_DAY, self.time + left
        for text in of_records(hours, length, self.parameters):
            _LOG.warning(text)
        shown = [ProgressRecorder(length)] if progress else []
        with held(), memory_run(output, hours, forces) as writer:
            try:
                self.advance(days, steps=steps, recorders=[*recorders, writer, *shown])
            except (KeyboardInterrupt, SystemExit):
                say(f"Stopped at {self.date:%Y-%m-%d %H:%M}. {self._rescued(output, end, 'interrupted')}")
                raise
            except RiftbergError as error:
                if self.step_number == before and not isinstance(error, RunError):
                    raise  # refused before the first step: there is nothing to save
                raise RunError(
                    f"the run failed at {self.date:%Y-%m-%d %H:%M}: {error}. {self._rescued(output, end)}"
                ) from error
            run = writer.dataset()
        if output is None:
            keep_water(run, self.forcing)
        return run

    def _rescued(self, output: str | Path | None, end: float, why: str = "failed") -> str:
        """Save the last good state where there is a place for it, and say how to go on."""
        if output is None:
            return "The model is left at its last good state: save it with model.save(path)"
        path = Path(output)
        try:
            saved = self.save(path.with_name(f"{path.stem}.{why}.restart.nc"))
        except (OSError, RiftbergError) as error:  # it must not hide why the run ended
            return f"The state cannot be saved ({refusal(error)}); the model is left at it: model.save(path)"
        left = round((end - self.time) / self.parameters.stepping.time_step)
        return f"Go on with Model.resume({str(saved)!r}, forcing).run(steps={left})"

    def save(self, path: str | Path) -> Path:
        """Write a restart file from which `resume` goes on bit for bit."""
        required(path, (str, Path), "the path of a restart file", where="Model.save")
        coming = {"next_element": self.population.next_element, "next_bond": self.population.next_bond}
        return save(self, path, extra={**coming, **self.remembered, **self._stepper.state_dict()})

    @classmethod
    def resume(cls, path: str | Path, forcing: Forcing) -> Self:
        """Go on from a restart file; gives bit for bit the run that never stopped.

        Parameters
        ----------
        path : path
            File written by `save`.
        forcing : Forcing
            The same forcing as before. Processes (``after_step``) are attached anew.
        """
        required(path, (str, Path), "the path of a restart file", where="Model.resume")
        state = load_state(path)
        model = cls.going_on(
            state.population(), forcing, state.parameters, state.start, state.time, state.step_number,
            state.fragment_rows(), state.bergs, state.contact_log(),
        )  # fmt: skip
        model.remembered = {name: value for name, value in state.extra.items() if name not in OWN_EXTRAS}
        model._stepper.load_state_dict(state.extra)
        return model
