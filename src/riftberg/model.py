"""The model: state, parameters and forcing meet here and are stepped in time; it knows nothing of files.

`riftberg.Model` (in `riftberg.runs.model`) is this with files: a run file, restart files, and going on from them.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import date, datetime
from typing import Any, Protocol, Self

import numpy as np

from riftberg.bergs.bonded import card, portrait
from riftberg.bergs.bonding import Metric, count_bonds, refuse_overlap
from riftberg.bergs.iceberg import Iceberg
from riftberg.config.usual_ranges import of_length
from riftberg.config.values import moment, number, required
from riftberg.engines.common.applied_forces import AppliedForces
from riftberg.engines.common.forces.media import OWN
from riftberg.engines.common.fragments.contact_log import ContactLog
from riftberg.engines.common.fragments.tree import Fragment, FragmentTree
from riftberg.engines.common.laws import Laws, WithOwnForces
from riftberg.engines.common.rift_tips import RiftTip, standing_tips
from riftberg.engines.common.run_state import Checkpoint, RunState
from riftberg.engines.common.speed_limit import check_forcing, check_speed, refuse_forcing
from riftberg.engines.common.stepper import Stepper
from riftberg.engines.common.time_step import LONG_STEP, StepLimit, longest_time_step
from riftberg.engines.schemes import make_stepper
from riftberg.errors import InputError
from riftberg.life.census import Census, follow_changes
from riftberg.life.coming import COMING, bear, split_by_date
from riftberg.life.grid_edge import count_turns, element_turns, find_lost
from riftberg.life.motion import MotionLedger
from riftberg.ocean.forcing import Forcing, as_forcing
from riftberg.parameters import Parameters
from riftberg.start.checks import (
    check_arguments,
    check_balance,
    check_coordinates,
    check_coverage,
    check_length,
    check_step_count,
    time_zero,
    whole_steps,
)
from riftberg.start.description import describe_run, find_unusual, heading, list_notices, sea_level_notice
from riftberg.start.preparation import adopt_packing, fill_constant_size, make_life, prepare_steps, resume_environment
from riftberg.state import Bonds, Elements, Floats, copy_state
from riftberg.state.population import Population, Saved, cut_out
from riftberg.system.input_files import check_work, shortened, value_shown
from riftberg.system.process import Hold, held

_LOG = logging.getLogger(__name__)


class Recorder(Protocol):
    """What a run calls: once before the first step, after every long step, and once at the end, also after an error."""

    def start(self, model: BareModel) -> None:
        """Prepare; the model stands at its initial state."""

    def record(self, model: BareModel) -> None:
        """Take note of the state after a long step."""

    def finish(self, model: BareModel) -> None:
        """Close files."""


Process = Callable[["BareModel"], None]
"""What may change the state after each long step: melt, calving, exchange with an ocean. See `BareModel.after_step`."""


class BareModel(RunState):
    """Bonded icebergs in an ocean, without files.

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
    laws : Laws, optional
        A force, a melt law and a fracture criterion of one's own.

    Attributes
    ----------
    elements, bonds : Elements, Bonds
        The state; take them anew after elements have come or gone.
    time : float
        Seconds since the start.
    step_number : int
        Long steps taken.
    fragments : FragmentTree
        Family tree of the fragments.
    after_step : list of callables
        Processes, called with the model after each long step in turn, whatever the scheme. They may change mass,
        thickness, length and width of elements, and `append` and `remove` elements. What follows from that (bonds
        counted, fragments numbered, newly born placed, sub-steps chosen anew) is done after the last of them. A process
        that fails takes the whole step back. A run that is resumed goes on bit for bit if a process takes what it needs
        from the model (state, ``time``, ``step_number``) and keeps nothing itself.
    life : LifeProcess or None
        Melt, rolling and footloose calving, where the parameters ask for them; acts before the processes above.
    motion : MotionLedger
        Momentum and mechanical energy by force; ``motion.balance(model, model.remembered)``.
    departed : tuple of Elements and Bonds, or None
        What left the grid over an open edge in the last step: whole bergs. Another model takes them with `append`.
    remembered : dict of str to array
        What recorders must know again to go on exactly; it is saved with the state.
    """

    _step_limit: StepLimit | None = None  # Of a step that may yet be taken; none where it is settled
    _step_reason = ""  # Why the time step is what it is, where it was not given

    def __init__(
        self,
        berg: Iceberg,
        forcing: Forcing,
        parameters: Parameters | None = None,
        start: datetime | date | str | np.datetime64 | None = None,
        *,
        laws: Laws | None = None,
    ) -> None:
        requested, forcing = Parameters() if parameters is None else parameters, as_forcing(forcing)
        check_arguments(berg, forcing, requested)
        began = time_zero(forcing, None if start is None else moment(start, where="start"))
        check_coordinates(berg, forcing, requested)
        check_balance(forcing, requested)
        p = adopt_packing(requested, berg)
        elements, bonds = copy_state(berg.elements, berg.bonds)
        present, bergs, later = (
            split_by_date(elements, berg.dates, began, berg.bergs) if berg.dates else (elements, berg.bergs, {})
        )
        if p.stepping.time_step is None:
            self._step_limit = longest_time_step(elements, bonds, forcing, p)
            self._step_reason = self._step_limit.reason
            p = p.changed(stepping={"time_step": self._step_limit.divide(LONG_STEP).seconds})
        p = fill_constant_size(p, present, bonds)
        self._begin(Population(present, bonds), forcing, p, began, bergs=bergs, outlines=berg.outlines, laws=laws)
        self.remembered.update(later)
        # Runs with the reference's quirks must run as they stand, and bergs that do not act on each other may overlap.
        if not requested.quirks.zero_start and requested.stepping.interactions:
            earth = requested.earth
            refuse_overlap(self.elements, requested.bonds.packing, Metric(earth.latlon, earth.radius, earth.period))

    @classmethod
    def from_state(
        cls, population: Population, forcing: Forcing, parameters: Parameters, start: datetime, time: float,
        step_number: int, fragments: Sequence[Fragment], bergs: Sequence[tuple[str, int]] = (),
        contacts: ContactLog | None = None, laws: Laws | None = None,
    ) -> Self:  # fmt: skip
        """Return a model that stands at a state reached before."""
        model = cls.__new__(cls)
        model._begin(population, forcing, parameters, start, time, step_number, fragments, bergs, laws=laws)
        model.contacts = ContactLog() if contacts is None else contacts
        return model

    def _begin(
        self, population: Population, forcing: Forcing, parameters: Parameters, start: datetime, time: float = 0.0,
        step_number: int = 0, fragments: Sequence[Fragment] = (), bergs: Sequence[tuple[str, int]] = (),
        outlines: tuple[Any, ...] = (), laws: Laws | None = None,
    ) -> None:  # fmt: skip
        """Check the state and set up the stepper."""
        custom_laws, forcing = Laws() if laws is None else laws, as_forcing(forcing)
        required(custom_laws, Laws, "Laws(force=..., melt=..., fracture=...)", where="Model, laws")
        custom_laws.check(parameters)
        # Errors of an ensemble may be put around the forcing later; the forces are still called through this.
        self._force = (
            None if custom_laws.force is None and custom_laws.drag is None else WithOwnForces(forcing, custom_laws)
        )
        super().__init__(
            population, self._force or forcing, parameters,
            parameters.kernel_values()._replace(ice_drift_known=forcing.ice_drift_known),
            FragmentTree(list(fragments), bergs), start, time, step_number, outlines=outlines,
            laws=custom_laws,
        )  # fmt: skip
        self._start_ledgers()
        self.after_step: list[Process] = []
        self.departed: tuple[Elements, Bonds] | None = None
        prepare_steps(self)
        self._long_step = LongStep(self)
        self._stepper: Stepper = make_stepper(self)
        if self._long_step.started:
            resume_environment(self, self._stepper)

    def _start_ledgers(self) -> None:
        """Begin the life of the bergs and the ledger of their motion, by the parameters."""
        self.life = make_life(self.parameters, self.laws.melt)
        self.motion = MotionLedger(self.parameters, self.laws.several())

    def fit_time_step(self, interval: float) -> None:
        """Let the time step divide an interval (s) of records, or a step of an ocean, unless it was given or taken before.

        It does nothing once the run has begun.
        """
        if self._step_limit is not None:
            self.take_time_step(*self._step_limit.divide(interval))

    def take_time_step(self, step: float, reason: str) -> None:
        """Take a time step (s) that was chosen for this run and others, unless one was given or the run has begun."""
        if self._step_limit is None or self._long_step.started:
            return
        self._step_limit, self._step_reason = None, reason
        if step == self.parameters.time_step:
            return
        self.parameters = self.parameters.changed(stepping={"time_step": step})
        self.constants = self.parameters.kernel_values()._replace(ice_drift_known=self.constants.ice_drift_known)
        self._start_ledgers()
        self._stepper = make_stepper(self)

    def take_forcing(self, forcing: Forcing) -> None:
        """Take another forcing before the first step; the scheme asks it for the depth of the sea floor too."""
        self.forcing = forcing
        self._stepper = make_stepper(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy: not the stepper, whose tables point into the arrays of this model."""
        state = dict(self.__dict__)
        stepper = state.pop("_stepper")
        return {**state, "_stepper_state": stepper.state_dict(), "_applied": stepper.applied}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take up a state with a stepper of its own, which goes on bit for bit."""
        stepper_state, applied = state.pop("_stepper_state"), state.pop("_applied")
        self.__dict__.update(state)
        self._stepper = make_stepper(self)
        self._stepper.load_state_dict(stepper_state)
        if self._stepper.applied.shape == applied.shape:
            self._stepper.applied[...] = applied

    @property
    def turns(self) -> Floats:
        """Times that each element has gone round a periodic grid eastward: each takes its longitude (x) back by a period."""
        return element_turns(self)

    def velocity(self) -> tuple[Floats, Floats]:
        """Return the eastward and northward velocity (m s-1) of the elements at the time of their positions.

        Between two steps ``elements.u`` lacks the last slow half kick, which the next step begins with.
        """
        if self.step_number == 0 or self.elements.size == 0:
            return self.elements.u.copy(), self.elements.v.copy()
        return self._stepper.synchronised(self)

    def applied_forces(self, elements: Elements | None = None) -> Floats:
        """Return the mean forces (N) on the elements over the last long step, as they were applied.

        The drag of the sea floor in the sub-steps and the implicit solves are included. Zero before the first step, for
        elements that never move and for those born since.

        Parameters
        ----------
        elements : Elements, optional
            Those of now by default; what `departed` in this step, too.

        Returns
        -------
        array, shape (elements, forces, 2)
            East and north, for each name of `riftberg.engines.common.forces.media.FORCES`.
        """
        return self._long_step.forces.on_elements(
            self._stepper.applied, self.elements if elements is None else elements
        )

    def own_forces(self) -> Floats:
        """Return the mean forces (N) of each of several laws of one's own over the last long step.

        Returns
        -------
        array, shape (elements, forces, 2)
            East and north, in the order of `Laws.several`; together they are the force ``own`` of `applied_forces`.
        """
        return self._long_step.forces.own_on_elements(self.elements, len(self.laws.several()))

    def step(self) -> None:
        """Advance the state by one long step, and run the processes of `after_step`.

        Ctrl-C does not tear it apart: it comes into force after the step.

        Raises
        ------
        RunError
            If the contact iteration does not converge, an element is faster than ``stepping.speed_limit``, or a position is
            no longer a number.
        ForcingError
            Before the first step, where the forcing does not cover the berg.
        """
        with held():
            self._long_step.take(self)

    def checkpoint(self) -> Callable[[], None]:
        """Return a function that brings this state back: for a step of an ocean that fails after births or steps of the bergs."""
        return self._long_step.checkpoint(self)

    def check(self, days: float | str | None = None, *, steps: int | None = None) -> int:
        """Return the number of long steps of a run, or refuse it as its start would; nothing is changed.

        Raises
        ------
        InputError
            If it is too long, or the forcing does not cover it.
        """
        count = self._count_steps(days, steps)
        check_work(count, self.substeps, self.elements.mass.size, where="Model.run")
        check_coverage(self, count)
        return count

    def advance(
        self, days: float | str | None = None, *, steps: int | None = None, recorders: Sequence[Recorder] = (),
        step: Callable[[], object] | None = None,
    ) -> None:  # fmt: skip
        """Run for some days, calling the recorders; see `run`.

        Ctrl-C and requests to terminate take effect between two steps, after the recorders have finished. A recorder may
        have a method ``interrupted(model)``, which is called then. ``step`` takes the model on in place of its own `step`, by
        one long step or several, as an exchange with an ocean does.
        """
        check_recorders(recorders)
        count = self.check(days, steps=steps)
        if days is not None:
            for text in of_length(number(days, "day", where="days"), self.parameters):
                _LOG.warning(text)
        if self.step_number == 0:
            # The state before the first step is part of the record.
            self._long_step.begin(self)
            for text in self.notices:
                _LOG.warning(text)
        with held() as hold:
            take_steps(self, count, recorders, hold, step or self.step)

    def _count_steps(self, days: float | str | None, steps: int | None) -> int:
        """Return the number of long steps of a run of some days, which the time step is fitted to, or as it is given."""
        if (days is None) == (steps is None):
            raise InputError("give either days or steps", where="Model.run")
        if days is None:
            return check_step_count(steps)
        seconds = check_length(days)
        self.fit_time_step(min(LONG_STEP, seconds))
        return whole_steps(seconds, self.parameters.time_step)

    def describe(self) -> str:
        """Return what this model is, in plain words, with all parameters."""
        return describe_run(self, self.notices, self._step_reason)

    @property
    def rift_tips(self) -> list[RiftTip]:
        """Tips of the rifts that were there from the start, with their stress intensity after the last step."""
        return standing_tips(self._stepper.tips, self.elements, self.bonds)

    @property
    def notices(self) -> tuple[str, ...]:
        """What should be known of a run with these parameters, a sentence each."""
        return list_notices(self)

    @property
    def sea_level_notice(self) -> str:
        """What is assumed of the sea level where no data give one, with a figure for the largest berg; empty where they do."""
        return sea_level_notice(self)

    @property
    def unusual(self) -> dict[str, str]:
        """What lies outside its usual range or has no effect, a sentence for each name (`riftberg.config.usual_ranges`)."""
        return find_unusual(self)

    def __repr__(self) -> str:
        first, *others = heading(self)
        forcing = shortened(" ".join(self.forcing.describe().split()), 200)
        return "\n".join([f"<{first}", *others, f"  forcing: {forcing}>"])

    def _repr_html_(self) -> str:
        hexagonal = self.parameters.bonds.packing == "hexagonal"
        picture = portrait(self.elements, latlon=self.parameters.earth.latlon, hexagonal=hexagonal)
        return card(picture, "\n".join([repr(self)[1:-1], f"  parameters: {self.parameters!r}"]))


class LongStep:
    """The long step of a model: scheme, ledgers, life and processes, taken back as a whole where one of them fails."""

    def __init__(self, model: BareModel) -> None:
        self.census = Census.of(model)
        self.forces = AppliedForces(model.elements)
        self.started = model.step_number > 0  # The bergs have their numbers, and the elements an environment
        self._saved: Saved | None = None  # The population before the last step

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, which saves its own population."""
        return {**self.__dict__, "_saved": None}

    def begin(self, model: BareModel) -> None:
        """Place the elements on the grid, number the bergs and take the first environment."""
        if model.forcing.grid is not None:
            model.forcing.grid.locate(model.elements)
        count_bonds(model.elements, model.bonds)
        self.started = True
        model.forcing.sample(model.elements, model.time)
        model.fragments.update(model.elements, model.bonds, model.time, model.constants)
        if model.life is not None:
            model.life.follow_outlines(model)
        # They lie where the run began: ice that is born there later, such as a footloose child beside its parent, is not theirs.
        model.outlines = ()

    def take(self, model: BareModel) -> None:
        """Advance a model by one long step."""
        model.departed = None
        if model.step_number == 0 and not self.started:
            if not model.parameters.quirks.zero_start:  # runs of the reference take what their driver hands over
                check_coverage(model, 1)
            self.begin(model)
        self.follow_changes(model)
        # A scheme alone changes neither rows nor sizes, so half of the copies are spared.
        scheme_alone = model.life is None and not model.after_step and COMING not in model.remembered
        self._saved = saved = model.population.saved(stepped_only=scheme_alone, into=self._saved)
        checkpoint = Checkpoint.of(model, saved)
        try:
            if model.elements.size:
                self._move(model, saved.elements)
                self._account(model, checkpoint)
                self._drop_lost(model)
            else:
                model.time += model.parameters.time_step
            model.step_number += 1
            if model.life is not None:
                # Melt and calving act on what the step has moved, and the processes of the user on what they left.
                model.life.act(model)
                model.motion.changed(model, "life", model.remembered)
            bear(model)
            for process in model.after_step:
                process(model)
            if not scheme_alone:
                self.follow_changes(model)
        except BaseException:  # whatever it was, an interrupt too: the state must stay one that can be saved
            self._go_back(model, checkpoint)
            raise

    def _move(self, model: BareModel, previous: Elements) -> None:
        """Take the step of the scheme; whatever fails in a run that has flown apart, the reason is that."""
        stepper = model._stepper
        if model._force is not None:
            model._force.begin_step()
        try:
            stepper.step(model)
        except Exception as error:
            check_speed(model, previous, stepper.applied)
            refuse_forcing(model, previous, error)
            raise
        self.forces.take_masses(model.elements)
        check_speed(model, previous, stepper.applied)
        check_forcing(model)
        count_turns(model, previous)

    def _account(self, model: BareModel, checkpoint: Checkpoint) -> None:
        """Enter a step of the scheme into the ledger of motion and the logs, which compare with the state before it."""
        stepper, began, previous = model._stepper, checkpoint.time, checkpoint.population
        if model._force is not None and model.laws.several():
            self.forces.own = model._force.shared(model.elements.body.mass, stepper.applied[:, OWN])
        model.motion.moved(
            previous.elements,
            previous.bonds,
            model,
            stepper.applied,
            model.remembered,
            stepper.plastic,
            self.forces.own,
        )
        # Contacts need the speed before bergs touched.
        model.contacts.update(previous.elements, stepper.touched, began, model.time, model.fragments, model.constants)
        model.groundings.update(
            previous.elements, model.elements, (began, model.time), model.fragments, model.constants,
            model.applied_forces, stepper.clearance, model.forcing.sea_level,
        )  # fmt: skip

    def _drop_lost(self, model: BareModel) -> None:
        """Take out the bergs that have left the grid over an open edge."""
        lost = find_lost(model)
        if lost.any():
            model.departed = cut_out(model.elements, model.bonds, np.flatnonzero(lost))[:2]
            model.remove(model.elements.body.id[lost])
            self.follow_changes(model)

    def follow_changes(self, model: BareModel) -> None:
        """Follow up births, deaths and changes of mass or size since the last census."""
        self.census = follow_changes(model, self.census, started=self.started)

    def _go_back(self, model: BareModel, checkpoint: Checkpoint) -> None:
        """Return to the state before a step that failed, so that it can be saved."""
        checkpoint.restore(model)
        model._stepper.take_back(model)
        self.census = Census.of(model)

    def checkpoint(self, model: BareModel) -> Callable[[], None]:
        """Return a function that brings the present state of a model back, with changes that are yet to be followed up."""
        checkpoint = Checkpoint.of(model, model.population.saved())
        census, started, outlines, departed = self.census, self.started, model.outlines, model.departed

        def go_back() -> None:
            self._go_back(model, checkpoint)
            self.census, self.started, model.outlines, model.departed = census, started, outlines, departed

        return go_back


def take_steps(
    model: BareModel, count: int, recorders: Sequence[Recorder], hold: Hold, step: Callable[[], object]
) -> None:
    """Take steps until they are done or a signal waits, calling the recorders; the signal comes into force at the end."""
    logged, end = len(model.fragments.rows), model.step_number + count
    _LOG.info("%d steps from %s, %d sub-steps in each", count, f"{model.date:%Y-%m-%d %H:%M}", model.substeps)
    if model._step_reason:
        _LOG.info("time step of %g s: %s", model.parameters.time_step, model._step_reason)
    try:
        with recording(recorders, model) as record:
            try:
                while model.step_number < end and not hold.requested:
                    step()
                    logged = log_breakups(model, logged)
                    record()
            finally:
                _LOG.info("stands at %s", f"{model.date:%Y-%m-%d %H:%M}")
        hold.check()  # now that all recorders have their record
    except (KeyboardInterrupt, SystemExit):
        for recorder in recorders:
            getattr(recorder, "interrupted", _nothing)(model)
        raise


def log_breakups(model: BareModel, logged: int) -> int:
    """Log the fragments that are new, and return how many there have been now."""
    for row in model.fragments.rows[logged:]:
        if row.parent > 0:
            _LOG.info(
                "%s: fragment %d of %.4g km2 broke off %d", f"{model.date:%Y-%m-%d %H:%M}", row.number, row.area / 1e6,
                row.parent,
            )  # fmt: skip
    return len(model.fragments.rows)


@contextmanager
def recording(recorders: Sequence[Recorder], model: BareModel) -> Iterator[Callable[[], None]]:
    """Start recorders, give the call that records a step, and let all that have started finish, however the run ends."""
    started: list[Recorder] = []
    failed: BaseException | None = None

    def record() -> None:
        for recorder in recorders:
            recorder.record(model)

    try:
        for recorder in recorders:
            recorder.start(model)
            started.append(recorder)
        yield record
    except BaseException as error:
        failed = error
        raise
    finally:
        finish_all(started, model, failed)


def finish_all(recorders: Sequence[Recorder], model: BareModel, failed: BaseException | None) -> None:
    """Let every recorder finish; the first error is raised at the end, unless another one has ended the run before."""
    first: Exception | None = None
    for recorder in recorders:
        try:
            recorder.finish(model)
        except Exception as error:
            _LOG.info("at the end of the run: %s", error)
            first = first or error
    if first is not None and failed is None:
        raise first


def _nothing(model: BareModel) -> None:
    """Stand for a method that a recorder does not have."""


def check_recorders(recorders: object) -> None:
    """Refuse an argument that is no list of recorders, before the first step."""
    expected = "recorders in a list, such as [RunWriter('run.nc')]"
    required(recorders, (list, tuple), expected, where="Model.run, recorders")
    for recorder in recorders if isinstance(recorders, list | tuple) else ():
        if not all(callable(getattr(recorder, name, None)) for name in ("start", "record", "finish")):
            raise InputError(
                f"{value_shown(recorder)} is no recorder", where="Model.run, recorders", remedy=f"Give {expected}"
            )
