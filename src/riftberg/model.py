"""The model: state, parameters and forcing meet here and are stepped in time."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from riftberg.bergs.assembly import refuse_overlap
from riftberg.bergs.bonding import Metric, count_bonds
from riftberg.bergs.iceberg import Iceberg
from riftberg.errors import InputError, RiftbergError, RunError
from riftberg.interrupts import Hold, held, say
from riftberg.ocean.forcing import Forcing
from riftberg.parameters import KernelParameters, Parameters
from riftberg.state import Bonds, Elements, Floats, copy_state
from riftberg.stepping.fragments import Fragment, FragmentTree
from riftberg.stepping.schemes import Stepper, make_stepper
from riftberg.stepping.sizes import interaction_sizes
from riftberg.stepping.substep_choice import choose_substeps

if TYPE_CHECKING:
    import xarray as xr

DEFAULT_START = datetime(2020, 12, 9, 13)


class Recorder(Protocol):
    """What a run calls: once before the first step, after every long step, and once at the end, also after an error."""

    def start(self, model: Model) -> None:
        """Prepare; the model stands at its initial state."""

    def record(self, model: Model) -> None:
        """Take note of the state after a long step."""

    def finish(self, model: Model) -> None:
        """Close files."""


class Model:
    """Bonded icebergs in an ocean.

    Parameters
    ----------
    berg : Iceberg
        Elements and bonds at the start; copied.
    forcing : Forcing
        Ocean, air, sea ice and sea floor.
    parameters : Parameters, optional
        All parameters; the published A68a physics with Riftberg's numerics by default.
    start : datetime.datetime, optional
        Date of time zero (UTC).

    Attributes
    ----------
    elements, bonds : Elements, Bonds
        The state.
    time : float
        Seconds since the start.
    step_number : int
        Long steps taken.
    fragments : FragmentTree
        Family tree of the fragments.
    substeps : int
        Sub-steps in a long step.
    remembered : dict of str to array
        What recorders must know again to go on exactly; it is saved with the state.

    Examples
    --------
    >>> from riftberg import Iceberg, Model, Steady
    >>> berg = Iceberg.rectangle(30e3, 12e3, centre=(-37.0, -56.0))
    >>> model = Model(berg, Steady(current=(0.2, 0.0)))
    >>> model.run(days=1).sizes["trajectory"]
    40
    """

    def __init__(
        self,
        berg: Iceberg,
        forcing: Forcing,
        parameters: Parameters | None = None,
        start: datetime = DEFAULT_START,
    ) -> None:
        from riftberg.parameters import A68A_2022

        given = A68A_2022 if parameters is None else parameters
        check_coordinates(berg, forcing, given)
        self.elements, self.bonds = copy_state(berg.elements, berg.bonds)
        # The berg knows how it is packed; parameters of another packing would give its elements wrong radii.
        packed = given.changed(bonds={"packing": berg.packing}) if berg.packing != given.bonds.packing else given
        self.parameters = _with_constant_size(packed, self.elements)
        self.forcing = forcing
        self.start = start
        self.time = 0.0
        self.step_number = 0
        self.fragments = FragmentTree()
        self.remembered: dict[str, Floats] = {}
        self._prepare()
        if not given.compatibility.zero_start:  # runs with the reference's quirks must run as they stand
            earth = given.earth
            refuse_overlap(self.elements, given.bonds.packing, Metric(earth.latlon, earth.radius, earth.period))

    def _prepare(self) -> None:
        """Check the state and set up the stepper."""
        self.constants: KernelParameters = self.parameters.kernel_values()
        check_state(self.elements, self.bonds)
        check_strengths(self.bonds, self.parameters)
        sizes = interaction_sizes(self.elements, self.constants)
        self.substeps = 1
        if self.parameters.stepping.scheme == "mts":
            self.substeps = choose_substeps(self.parameters, self.elements, self.bonds, sizes)
        self._visited = self.step_number > 0
        self._stepper: Stepper = make_stepper(self)

    @property
    def date(self) -> datetime:
        """Date of the present state."""
        return self.start + timedelta(seconds=self.time)

    @property
    def bonds_broken(self) -> int:
        """Number of bonds that have broken so far."""
        return int(np.isfinite(self.bonds.break_time).sum())

    @property
    def fragment_count(self) -> int:
        """Number of fragments now."""
        return int(np.unique(self.elements.berg).size)

    def velocity(self) -> tuple[Floats, Floats]:
        """Return the eastward and northward velocity (m s-1) of the elements at the time of their positions.

        Between two steps ``elements.u`` lacks the last slow half kick, which the next step begins with.
        """
        if self.step_number == 0:
            return self.elements.u.copy(), self.elements.v.copy()
        return self._stepper.synchronised(self)

    def applied_forces(self) -> Floats:
        """Return the mean forces (N) on the elements over the last long step, as they were applied.

        The drag of the sea floor in the sub-steps and the implicit solves are included. Zero before the first step, and for
        elements that never move.

        Returns
        -------
        array, shape (elements, forces, 2)
            East and north, for each name of `riftberg.stepping.media.FORCES`.
        """
        return self.elements.mass[:, None, None] * self._stepper.applied

    def step(self) -> None:
        """Advance the state by one long step, which Ctrl-C does not tear apart: it comes into force after the step.

        Raises
        ------
        RunError
            If the contact iteration does not settle, or a position is no longer a number.
        """
        with held():
            self._step()

    def _step(self) -> None:
        if self.step_number == 0 and not self._visited:
            self._first_visit()
        before = self.time, list(self.fragments.rows), *copy_state(self.elements, self.bonds)
        try:
            self._stepper.step(self)
            self._check_finite()
        except BaseException:  # whatever it was, an interrupt too: the state must stay one that can be saved
            self._go_back(*before)
            raise
        self.step_number += 1

    def _check_finite(self) -> None:
        if not np.isfinite(self.elements.lon).all() or not np.isfinite(self.elements.lat).all():
            bad = int(np.flatnonzero(~np.isfinite(self.elements.lon + self.elements.lat))[0])
            raise RunError(
                f"element {bad + 1} has no finite position after step {self.step_number + 1} ({self.date:%Y-%m-%d %H:%M}); "
                "the run is unstable: use more sub-steps (stepping.substeps) or a softer berg"
            )

    def _go_back(self, time: float, rows: list[Fragment], elements: Elements, bonds: Bonds) -> None:
        """Return to the state before a step that failed, so that it can be saved."""
        self.time, self.fragments.rows = time, rows
        for now, then in ((self.elements, elements), (self.bonds, bonds)):
            for name, array in now.arrays().items():
                array[:] = getattr(then, name)

    def _first_visit(self) -> None:
        """Place the elements on the grid, number the bergs and take the first environment."""
        if self.forcing.grid is not None:
            self.forcing.grid.locate(self.elements)
        count_bonds(self.elements, self.bonds)
        self._visited = True
        self.forcing.sample(self.elements, self.time)
        self.fragments.update(self.elements, self.bonds, self.time, self.constants)

    def run(
        self,
        days: float | None = None,
        *,
        steps: int | None = None,
        recorders: Sequence[Recorder] = (),
        output: str | Path | None = None,
        every_hours: float = 1.0,
        forces: bool = False,
    ) -> xr.Dataset:
        """Run for some days and return the trajectory.

        Parameters
        ----------
        days : float
            Length of the run; or give ``steps``.
        steps : int
            Number of long steps.
        recorders : sequence of Recorder
            Called after every long step.
        output : path, optional
            Run file to write; kept in memory only if left out.
        every_hours : float
            Interval of the records in the run file.
        forces : bool, optional
            Record the mean force of each medium on each element too.

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
        from riftberg.runs.run_file import memory_run

        before = self.step_number
        with held(), memory_run(output, every_hours, forces) as writer:
            try:
                self.advance(days, steps=steps, recorders=[*recorders, writer])
            except (KeyboardInterrupt, SystemExit):
                say(f"Stopped at {self.date:%Y-%m-%d %H:%M}. {self._rescued(output, 'interrupted')}")
                raise
            except RiftbergError as error:
                if self.step_number == before and not isinstance(error, RunError):
                    raise  # refused before the first step: there is nothing to save
                raise RunError(
                    f"the run failed at {self.date:%Y-%m-%d %H:%M}: {error}. {self._rescued(output)}"
                ) from error
            return writer.dataset()

    def _rescued(self, output: str | Path | None, why: str = "failed") -> str:
        """Save the last good state where there is a place for it, and say how to go on."""
        if output is None:
            return "The model is left at its last good state: save it with model.save(path)"
        path = Path(output)
        saved = self.save(path.with_name(f"{path.stem}.{why}.restart.nc"))
        return f"Go on with Model.resume({str(saved)!r}, forcing)"

    def advance(
        self, days: float | None = None, *, steps: int | None = None, recorders: Sequence[Recorder] = ()
    ) -> None:
        """Run for some days, calling the recorders; see `run`.

        Ctrl-C and requests to terminate take effect between two steps, after the recorders have finished. A recorder may
        have a method ``interrupted(model)``, which is called then.
        """
        count = self._number_of_steps(days, steps)
        dt = self.parameters.stepping.time_step
        if self.forcing.grid is not None and self.step_number == 0:
            self.forcing.grid.locate(self.elements)
        self.forcing.check(self.elements, self.time, self.time + count * dt)
        if self.step_number == 0:
            # The state before the first step is part of the record.
            self._first_visit()
        with held() as hold:
            try:
                self._record_steps(count, recorders, hold)
                hold.check()
            except (KeyboardInterrupt, SystemExit):
                for recorder in recorders:
                    getattr(recorder, "interrupted", _nothing)(self)
                raise

    def _record_steps(self, count: int, recorders: Sequence[Recorder], hold: Hold) -> None:
        """Take steps until they are done or a signal waits."""
        started: list[Recorder] = []
        try:
            for recorder in recorders:
                recorder.start(self)
                started.append(recorder)
            for _ in range(count):
                if hold.requested:
                    return
                self.step()
                for recorder in recorders:
                    recorder.record(self)
        finally:
            for recorder in started:
                recorder.finish(self)

    def _number_of_steps(self, days: float | None, steps: int | None) -> int:
        if (days is None) == (steps is None):
            raise InputError("give either days or steps", where="Model.run")
        if steps is not None:
            return steps
        assert days is not None
        count = round(days * 86400.0 / self.parameters.stepping.time_step)
        if count < 1:
            raise InputError(
                f"{days:g} days are less than one long step of {self.parameters.stepping.time_step:g} s",
                where="Model.run",
                remedy="Run longer",
            )
        return count

    def save(self, path: str | Path) -> Path:
        """Write a restart file from which `resume` goes on bit for bit."""
        from riftberg.runs.restart import save

        # The memory of the stepper comes last: what a resumed run remembers of it is old.
        return save(self, path, extra={"substeps": self.substeps, **self.remembered, **self._stepper.memory()})

    @classmethod
    def resume(cls, path: str | Path, forcing: Forcing) -> Model:
        """Go on from a restart file; gives bit for bit the run that never stopped.

        Parameters
        ----------
        path : path
            File written by `save`.
        forcing : Forcing
            The same forcing as before.
        """
        from riftberg.runs.restart import load_state

        state = load_state(path)
        model = cls.__new__(cls)
        model.elements, model.bonds = state.elements, state.bonds
        model.parameters, model.forcing, model.start = state.parameters, forcing, state.start
        model.time, model.step_number = state.time, state.step_number
        model.fragments = FragmentTree(state.fragment_rows())
        model.remembered = {name: value for name, value in state.extra.items() if name != "substeps"}
        model._prepare()
        # A number found anew would depend on the bonds broken since.
        model.substeps = int(state.extra.get("substeps", model.substeps))
        model._stepper.recall(state.extra)
        if model.step_number > 0:
            # The same values as in the file, unless the run failed because its forcing was at fault.
            model._stepper.surround(model)
        return model

    def describe(self) -> str:
        """Return what this model is, in plain words."""
        p = self.parameters
        return "\n".join(
            [
                f"Model at {self.date:%Y-%m-%d %H:%M}, step {self.step_number} of {p.stepping.time_step:g} s "
                f"({self.substeps} sub-steps, scheme {p.stepping.scheme})",
                f"  {self.elements.mass.size} elements, {self.bonds.first.size} bonds, {self.bonds_broken} broken",
                f"  forcing: {self.forcing.describe()}",
                p.describe(),
            ]
        )


def _nothing(model: Model) -> None:
    """Stand for a method that a recorder does not have."""


def _with_constant_size(p: Parameters, elements: Elements) -> Parameters:
    """Fill in the constant interaction size: if one side is 0, both become the means of all elements (Q37)."""
    b = p.bonds
    if not b.constant_size or (b.constant_length > 0.0 and b.constant_width > 0.0):
        return p
    length, width = float(np.mean(elements.length)), float(np.mean(elements.width))
    return p.changed(bonds={"constant_length": length, "constant_width": width})


def check_coordinates(berg: Iceberg, forcing: Forcing, p: Parameters) -> None:
    """Refuse a berg, a grid and parameters that do not agree whether positions are degrees or metres.

    Raises
    ------
    InputError
        Naming who disagrees.
    """
    said = {"the berg": berg.latlon}
    if forcing.grid is not None:
        said["the grid of the forcing"] = forcing.grid.arrays.latlon
    for who, latlon in said.items():
        if latlon != p.earth.latlon:
            ours, theirs = ("degrees", "metres") if latlon else ("metres", "degrees")
            raise InputError(
                f"positions of {who} are {ours}, those of the parameters {theirs}",
                where=f"earth.latlon = {p.earth.latlon}",
                remedy=f"Set earth.latlon = {latlon}, or make {who} in {theirs}",
            )


def check_state(elements: Elements, bonds: Bonds) -> None:
    """Refuse elements that cannot be stepped, before the first step.

    Raises
    ------
    InputError
        Naming the element, the variable and the value.
    """
    for name in ("lon", "lat", "u", "v", "mass", "thickness", "length", "width", "spin", "rotation"):
        values = getattr(elements, name)
        bad = ~np.isfinite(values)
        if name in ("mass", "thickness", "length", "width"):
            bad |= values <= 0.0
        if bad.any():
            e = int(np.flatnonzero(bad)[0])
            raise InputError(
                f"{name} is {values[e]:g}",
                where=f"element {int(elements.id[e])} (row {e}) at {elements.lon[e]:.5f}, {elements.lat[e]:.5f}",
                remedy="It must be a finite number"
                + (" above zero" if name in ("mass", "thickness", "length", "width") else ""),
            )
    count = elements.mass.size
    ends = np.concatenate([bonds.first, bonds.second])
    if ends.size and (ends.min() < 0 or ends.max() >= count):
        raise InputError(f"a bond names element row {int(ends.max())} of {count}", where="bonds")


def check_strengths(bonds: Bonds, p: Parameters) -> None:
    """Refuse strengths that are no strengths; runs with the reference's quirks take those of the parameters as they stand.

    Raises
    ------
    InputError
        Naming the strength, or the bond, and what is possible.
    """
    own, f = not p.compatibility.zero_start, p.fracture
    for name, value in (("normal_strength", f.normal_strength), ("shear_strength", f.shear_strength)):
        if f.enabled and own and value <= 0.0:
            raise InputError(
                f"fracture.{name} = {value:g} Pa is no strength",
                where="parameters",
                remedy="Give a positive one, or set fracture.enabled = false so that no bond breaks",
            )
    for name, values, bad, possible in (
        (
            "strength",
            bonds.strength,
            ~(np.isfinite(bonds.strength) & (bonds.strength >= 0.0)),
            "a finite factor, 0 or more",
        ),
        ("damage", bonds.damage, ~((bonds.damage >= 0.0) & (bonds.damage < 1.0)), "from 0 up to, not including, 1"),
    ):
        if bad.any():
            b = int(np.flatnonzero(bad)[0])
            raise InputError(
                f"{name} is {values[b]:g}",
                where=f"bond in row {b}, between the elements in rows {bonds.first[b]} and {bonds.second[b]}",
                remedy=f"It must be {possible}",
            )
