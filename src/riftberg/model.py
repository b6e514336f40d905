"""The model: state, parameters and forcing meet here and are stepped in time; it knows nothing of files.

`riftberg.Model` (in `riftberg.runs.model`) is this with files: a run file, restart files, and going on from them.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from datetime import date, datetime
from functools import partial
from typing import Any, Final, Protocol, Self

import numpy as np

from riftberg.bergs.bonded import card, portrait
from riftberg.bergs.bonding import Metric, count_bonds, refuse_overlap
from riftberg.bergs.iceberg import Iceberg
from riftberg.config.units import place_text
from riftberg.config.usual_ranges import of_length, unusual
from riftberg.config.values import moment, native, number, required
from riftberg.engines.common.forces.media import OWN
from riftberg.engines.common.fragments.connectivity import connected_parts
from riftberg.engines.common.fragments.contact_log import ContactLog
from riftberg.engines.common.fragments.grounding_log import GroundingLog
from riftberg.engines.common.fragments.tree import Fragment, FragmentTree, measure_outlines
from riftberg.engines.common.laws import OWN_VARIABLES, Laws, WithOwnForces
from riftberg.engines.common.reserves import reserve_lines
from riftberg.engines.common.rift_tips import RiftTip, rift_notices, standing_tips
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.slenderness import narrow_warning
from riftberg.engines.common.speed_limit import check_forcing, check_speed, refuse_fast_start, refuse_forcing
from riftberg.engines.common.stepper import Stepper, complete_state, sample_new_elements
from riftberg.engines.common.time_step import LONG_STEP, divide_interval, longest_time_step
from riftberg.engines.schemes import assign_substeps, check_long_step, make_stepper, resonance_warning, size_bins
from riftberg.errors import InputError
from riftberg.life.coming import COMING, bear, coming, coming_text, split_by_date
from riftberg.life.motion import MotionLedger
from riftberg.life.process import LifeProcess, check_water, lives
from riftberg.ocean.balance import slope_notice
from riftberg.ocean.floor_notices import floor_notices
from riftberg.ocean.forcing import Forcing, as_forcing
from riftberg.parameters import ExplicitParameters, Parameters
from riftberg.state import ELEMENT_VARIABLES, Bonds, Elements, Environment, Floats, Ints, copy_state
from riftberg.state.population import Population, Saved, by_identifier, changed_rows, cut_out
from riftberg.state.rules import Rule, find_breach, is_positive
from riftberg.system.input_files import check_work, shortened, value_shown
from riftberg.system.process import Hold, held

_LOG = logging.getLogger(__name__)

_TURNS = "turns"
"""Name under which `BareModel.turns` are remembered, by identifier."""

DEFAULT_START = datetime(2020, 12, 9, 13)


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

    remembered: dict[str, Floats]
    _step_limit: float | None = None  # Longest time step (s) that may yet be taken; none where it is settled
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
        if requested.bonds.packing == "hexagonal" and berg.packing == "square" and berg.elements.size:
            raise InputError(
                "bonds.packing = 'hexagonal', but the berg has square elements", where="Model",
                remedy="Make the berg with packing='hexagonal', or leave bonds.packing out: it follows the berg",
            )  # fmt: skip
        # The berg knows how it is packed; parameters of another packing would give its elements wrong radii.
        packed = (
            requested.changed(bonds={"packing": berg.packing}) if berg.packing != requested.bonds.packing else requested
        )
        elements, bonds = copy_state(berg.elements, berg.bonds)
        present, present_bergs, later = (
            split_by_date(elements, berg.dates, began, berg.bergs) if berg.dates else (elements, berg.bergs, {})
        )
        if packed.stepping.time_step is None:
            self._step_limit, self._step_reason = longest_time_step(elements, bonds, forcing, packed)
            packed = packed.changed(stepping={"time_step": divide_interval(LONG_STEP, self._step_limit)})
        sized = _with_constant_size(packed, present, bonds)
        self._begin(
            Population(present, bonds), forcing, sized, began, bergs=present_bergs, outlines=berg.outlines, laws=laws
        )
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
        self.life = LifeProcess(parameters, custom_laws.melt) if lives(parameters) else None
        self.motion = MotionLedger(parameters, custom_laws.several())
        self._own: Floats | None = None  # Accelerations by each of several own forces, (elements, forces, 2)
        self.after_step: list[Process] = []
        self.departed: tuple[Elements, Bonds] | None = None
        self.remembered = {}
        self._saved: Saved | None = None  # the state before the last step
        self._visited = step_number > 0
        check_state(self.elements, self.bonds, self.parameters.earth.latlon)
        check_strengths(self.bonds, parameters)
        refuse_fast_start(self.elements, parameters)
        check_water(forcing, parameters)
        complete_state(self)
        # A number that is given may be larger than an array can hold.
        check_work(
            1, getattr(parameters.stepping, "substeps", None) or 1, self.elements.size, where="stepping.substeps"
        )
        assign_substeps(self, self.elements.body.substeps == 0)
        check_long_step(self)
        check_work(1, self.substeps, self.elements.mass.size, where="stepping.substeps")
        self._look()
        self._stepper: Stepper = make_stepper(self)
        self._stepped, self._stepped_mass = self.elements.body.id.copy(), self.elements.body.mass.copy()
        if self._visited:
            if not self.elements.body.berg_length.all():  # of a restart file that does not hold it
                measure_outlines(self.elements, self.constants)
            if forcing.grid is not None:
                forcing.grid.check_cells(self.elements)
            # The same values as in the file, unless the run failed because its forcing was at fault. A force of one's own may
            # have been taken at velocities that are no more: it stays. An ocean model that has yet to hand over its fields
            # (`OceanForcing`) would be one at rest.
            if forcing.given:
                environment = self.elements.environment
                by_user = [getattr(environment, name) for name in OWN_VARIABLES]
                values_by_user = [array.copy() for array in by_user]
                # What this forcing does not give is not known: it may stem from another one, such as the water at a keel.
                for variable in ELEMENT_VARIABLES:
                    if variable.name in Environment._fields:
                        getattr(environment, variable.name)[:] = variable.default
                self._stepper.sample_forcing(self)
                for array, values in zip(by_user, values_by_user, strict=True):
                    array[:] = values

    def fit_time_step(self, interval: float) -> None:
        """Let the time step divide an interval (s) of records, or a step of an ocean, unless it was given or taken before.

        It does nothing once the run has begun.
        """
        if self._step_limit is not None:
            step, reason = divide_interval(interval, self._step_limit), self._step_reason
            self.take_time_step(
                step, reason if step == self._step_limit else f"it divides {interval / 3600.0:g} h; {reason}"
            )

    def take_time_step(self, step: float, reason: str) -> None:
        """Take a time step (s) that was chosen for this run and others, unless one was given or the run has begun."""
        if self._step_limit is None or self._visited:
            return
        self._step_limit, self._step_reason = None, reason
        if step == self.parameters.time_step:
            return
        self.parameters = self.parameters.changed(stepping={"time_step": step})
        self.constants = self.parameters.kernel_values()._replace(ice_drift_known=self.constants.ice_drift_known)
        self.life = LifeProcess(self.parameters, self.laws.melt) if lives(self.parameters) else None
        self.motion = MotionLedger(self.parameters, self.laws.several())
        self._stepper = make_stepper(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy: not the stepper, whose tables point into the arrays of this model."""
        state = dict(self.__dict__)
        stepper = state.pop("_stepper")
        return {**state, "_saved": None, "_stepper_state": stepper.state_dict(), "_applied": stepper.applied}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take up a state with a stepper of its own, which goes on bit for bit."""
        stepper_state, applied = state.pop("_stepper_state"), state.pop("_applied")
        self.__dict__.update(state)
        self._stepper = make_stepper(self)
        self._stepper.load_state_dict(stepper_state)
        if self._stepper.applied.shape == applied.shape:
            self._stepper.applied[...] = applied

    @property
    def substeps(self) -> int:
        """Sub-steps in a long step; of the berg that has most of them."""
        return max(1, int(self.elements.body.substeps.max(initial=1)))

    @property
    def bonds_broken(self) -> int:
        """Number of bonds that have broken so far."""
        return int(np.isfinite(self.bonds.break_time).sum())

    @property
    def fragment_count(self) -> int:
        """Number of fragments now."""
        return int(np.unique(self.elements.berg).size)

    @property
    def turns(self) -> Floats:
        """Times that each element has gone round a periodic grid eastward: each takes its longitude (x) back by a period."""
        ids, turns = self.remembered.get(_TURNS, np.zeros((0, 2))).T
        return by_identifier(ids, turns, self.elements.body.id)

    def velocity(self) -> tuple[Floats, Floats]:
        """Return the eastward and northward velocity (m s-1) of the elements at the time of their positions.

        Between two steps ``elements.u`` lacks the last slow half kick, which the next step begins with.
        """
        if self.step_number == 0 or self.elements.size == 0:
            return self.elements.u.copy(), self.elements.v.copy()
        return self._stepper.synchronised(self)

    def append(
        self, elements: Elements, bonds: Bonds | None = None, *, parent: int = 0, ids: Ints | None = None
    ) -> Ints:
        """Add elements, with bonds between them; for use between two steps or in `after_step`.

        Parameters
        ----------
        elements : Elements
            The newly born, as `riftberg.state.new_elements` or an `Iceberg` gives them: position, velocity ``u`` and
            ``v``, mass and sizes are read.
        bonds : Bonds, optional
            Bonds between them; their ends are rows of ``elements``.
        parent : int, optional
            Number of the fragment that they come from.
        ids : array of int, optional
            Their identifiers, which must never have been used; the next free ones if left out.

        Returns
        -------
        array of int
            Their identifiers; identifiers are never used again.
        """
        rows = self.elements.size
        ids = self.population.append(elements, bonds, ids=ids)
        new = slice(rows, None)
        current = self.elements
        current.body.berg[new] = parent
        current.place.entered[new] = current.place.entered[:rows].max(initial=-1) + 1
        for copy, name in (("lon_pair", "lon"), ("lat_pair", "lat"), ("u_pair", "u"), ("v_pair", "v")):
            getattr(current, copy)[new] = getattr(current, name)[new]
        current.motion.u_sync[new], current.motion.v_sync[new] = current.motion.u[new], current.motion.v[new]
        return ids

    def remove(self, ids: Sequence[int] | Ints) -> None:
        """Take elements out, with their bonds; for use between two steps or in `after_step`."""
        self.population.remove(ids)

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
        return self._of_last_step(self._stepper.applied, self.elements if elements is None else elements)

    def _of_last_step(self, accelerations: Floats, elements: Elements) -> Floats:
        """Return forces (N) on elements, with the masses of the last step: life has changed them since."""
        if accelerations.shape[0] != self._stepped_mass.size:  # no step has been taken
            accelerations = np.zeros((self._stepped_mass.size, *accelerations.shape[1:]))
        forces = self._stepped_mass[:, None, None] * accelerations
        if np.array_equal(self._stepped, elements.body.id):
            return forces
        return by_identifier(self._stepped, forces, elements.body.id)

    def own_forces(self) -> Floats:
        """Return the mean forces (N) of each of several laws of one's own over the last long step.

        Returns
        -------
        array, shape (elements, forces, 2)
            East and north, in the order of `Laws.several`; together they are the force ``own`` of `applied_forces`.
        """
        accelerations, count = self._own, len(self.laws.several())
        if accelerations is None:
            return np.zeros((self.elements.size, count, 2))
        return self._of_last_step(accelerations, self.elements)

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
            self._step()

    def _step(self) -> None:
        self.departed = None
        if self.step_number == 0 and not self._visited:
            if not self.parameters.quirks.zero_start:  # runs of the reference take what their driver hands over
                self._check_forcing(1)
            self._first_visit()
        self._follow_changes()
        # A scheme alone changes neither rows nor sizes, so half of the copies are spared.
        stepped_only = self.life is None and not self.after_step and COMING not in self.remembered
        self._saved = saved = self.population.saved(stepped_only=stepped_only, into=self._saved)
        checkpoint = self._before(saved)
        try:
            if self.elements.size:
                if self._force is not None:
                    self._force.begin_step()
                self._take_step(saved.elements)
                self._count_turns(saved.elements)
                # The ledgers see the state before the step; contacts need it too, for the speed before bergs touched.
                applied = self._stepper.applied
                if self._force is not None and self.laws.several():
                    self._own = self._force.shared(self.elements.body.mass, applied[:, OWN])
                self.motion.moved(
                    saved.elements, saved.bonds, self, applied, self.remembered, self._stepper.plastic, self._own
                )
                self.contacts.update(
                    saved.elements, self._stepper.touched, checkpoint[0], self.time, self.fragments, self.constants
                )
                self.groundings.update(
                    saved.elements, self.elements, (checkpoint[0], self.time), self.fragments, self.constants,
                    self.applied_forces, self._stepper.clearance, self.forcing.sea_level,
                )  # fmt: skip
                self._drop_lost()
            else:
                self.time += self.parameters.time_step
            self.step_number += 1
            if self.life is not None:
                # Melt and calving act on what the step has moved, and the processes of the user on what they left.
                self.life.act(self)
                self.motion.changed(self, "life", self.remembered)
            bear(self)
            for process in self.after_step:
                process(self)
            if not stepped_only:  # a scheme changes neither rows nor sizes
                self._follow_changes()
        except BaseException:  # whatever it was, an interrupt too: the state must stay one that can be saved
            self._go_back(*checkpoint)
            raise

    def _count_turns(self, previous: Elements) -> None:
        """Count the turns of a step; no element goes half a period in one."""
        grid, el = self.forcing.grid, self.elements
        if grid is not None and grid.arrays.period > 0.0:
            turns = np.round((previous.place.lon - el.place.lon) / grid.arrays.period)
            if turns.any():
                self.remembered[_TURNS] = np.column_stack([el.body.id, self.turns + turns])

    def _drop_lost(self) -> None:
        """Take out the bergs that have left the grid over an open edge; single elements by the reference's rules."""
        grid = self.forcing.grid
        if grid is None or (inside := grid.has_in_domain(self.elements)).all():
            return
        lost = ~inside
        if not self.parameters.quirks.lost_over_edge:
            component = connected_parts(inside.size, self.bonds.first, self.bonds.second, self.bonds.status)
            lost = np.isin(component, component[lost])
        self.departed = cut_out(self.elements, self.bonds, np.flatnonzero(lost))[:2]
        self.remove(self.elements.body.id[lost])
        self._follow_changes()

    def _take_step(self, previous: Elements) -> None:
        """Take the step of the scheme; whatever fails in a run that has flown apart, the reason is that."""
        try:
            self._stepper.step(self)
        except Exception as error:
            check_speed(self, previous, self._stepper.applied)
            refuse_forcing(self, previous, error)
            raise
        self._stepped, self._stepped_mass = self.elements.body.id.copy(), self.elements.body.mass.copy()
        check_speed(self, previous, self._stepper.applied)
        check_forcing(self)

    def _before(
        self, population: Saved
    ) -> tuple[float, int, list[Fragment], Saved, dict[str, Floats], ContactLog, GroundingLog]:
        """Return the arguments of `_go_back`, from the state before a step."""
        return (
            self.time, self.step_number, list(self.fragments.rows), population, dict(self.remembered),
            self.contacts.saved(), self.groundings.saved(),
        )  # fmt: skip

    def _go_back(
        self, time: float, step_number: int, rows: list[Fragment], population: Saved, remembered: dict[str, Floats],
        contacts: ContactLog, groundings: GroundingLog,
    ) -> None:  # fmt: skip
        """Return to the state before a step that failed, so that it can be saved."""
        self.remembered, self.contacts, self.groundings = remembered, contacts, groundings
        self.time, self.step_number, self.fragments.rows = time, step_number, rows
        self.fragments.calved_from.clear()
        self.population.restore(population)
        self._stepper.take_back(self)
        self._look()

    def checkpoint(self) -> Callable[[], None]:
        """Return a function that brings this state back: for a step of an ocean that fails after births or steps of the bergs."""
        names = ("_seen_rows", "_seen_bonds", "_seen_ids", "_seen_bytes", "_seen_coarse", "_visited", "outlines")
        attributes = {name: getattr(self, name) for name in (*names, "departed")}
        checkpoint = self._before(self.population.saved())

        def go_back() -> None:
            self._go_back(*checkpoint)
            # What came before the step and has not been followed up is still to be, and so is the first visit.
            for name, value in attributes.items():
                setattr(self, name, value)

        return go_back

    def _look(self, coarse: tuple[Floats, ...] | None = None) -> None:
        """Note the values to follow up when they change: which rows there are, mass and sizes; those in steps if known."""
        body, population = self.elements.body, self.population
        self._seen_rows, self._seen_bonds = (population.version, population.next_bond), self.bonds.id.copy()
        self._seen_ids, self._seen_bytes = body.id.copy(), _to_bytes(_element_sizes(self.elements))
        self._seen_coarse = size_bins(self) if coarse is None else coarse

    def _follow_changes(self) -> None:
        """Follow up births, deaths and changes of mass or size since the last look."""
        version, next_bond = self._seen_rows
        ids = self._seen_ids
        # Most steps change nothing: then the rows are the same, and comparing their bytes is enough, and quick.
        if self.population.version == version and _to_bytes(_element_sizes(self.elements)) == self._seen_bytes:
            return
        # Sizes in bins: melt changes every element in every step, the number of sub-steps only where that matters.
        coarse = size_bins(self)
        changed = changed_rows(self.elements.body.id, coarse, ids, self._seen_coarse)
        check_state(self.elements, self.bonds, self.parameters.earth.latlon)
        measured = self.population.version != version and self._follow_rows(ids)
        if self._visited and not measured:
            measure_outlines(self.elements, self.constants)
        new_bonds = self.bonds.id >= next_bond
        changed[self.bonds.first[new_bonds]] = True
        assign_substeps(self, changed)
        self._look(coarse)

    def _follow_rows(self, ids: Ints) -> bool:
        """Follow up elements and bonds that came or went, and return whether fragments were found and measured.

        ``ids``: identifiers before.
        """
        newborn = ~np.isin(self.elements.body.id, ids)
        sample_new_elements(self, newborn, self._visited)
        complete_state(self)
        if not self._visited:
            return False
        count_bonds(self.elements, self.bonds)
        # Where lone elements went and nothing else, every fragment that is left is as it was.
        if not newborn.any() and np.array_equal(self.bonds.id, self._seen_bonds):
            return False
        self.fragments.update(self.elements, self.bonds, self.time, self.constants)
        return True

    def _check_forcing(self, steps: int) -> None:
        """Raise `ForcingError` unless the forcing covers the berg for some steps from now."""
        if self.forcing.grid is not None and self.step_number == 0:
            self.forcing.grid.locate(self.elements)
        end = self.time + steps * self.parameters.time_step
        self.forcing.check(self.elements, self.time, end)
        times, later = coming(self.remembered)
        if (born := times <= end).any():
            late = later.taken(np.flatnonzero(born))
            if self.forcing.grid is not None:
                self.forcing.grid.locate(late)
            self.forcing.check(late, self.time, end)

    def _first_visit(self) -> None:
        """Place the elements on the grid, number the bergs and take the first environment."""
        if self.forcing.grid is not None:
            self.forcing.grid.locate(self.elements)
        count_bonds(self.elements, self.bonds)
        self._visited = True
        self.forcing.sample(self.elements, self.time)
        self.fragments.update(self.elements, self.bonds, self.time, self.constants)
        if self.life is not None:
            self.life.follow_outlines(self)
        # They lie where the run began: ice that is born there later, such as a footloose child beside its parent, is not theirs.
        self.outlines = ()

    def check(self, days: float | str | None = None, *, steps: int | None = None) -> int:
        """Return the number of long steps of a run, or refuse it as its start would; nothing is changed.

        Raises
        ------
        InputError
            If it is too long, or the forcing does not cover it.
        """
        count = self._count_steps(days, steps)
        check_work(count, self.substeps, self.elements.mass.size, where="Model.run")
        self._check_forcing(count)
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
            self._first_visit()
            for text in self.notices:
                _LOG.warning(text)
        with held() as hold:
            try:
                self._record_steps(count, recorders, hold, step or self.step)
                # A signal that came after the last step comes into force here, when all recorders have their record.
                hold.check()
            except (KeyboardInterrupt, SystemExit):
                for recorder in recorders:
                    getattr(recorder, "interrupted", _nothing)(self)
                raise

    def _record_steps(self, count: int, recorders: Sequence[Recorder], hold: Hold, step: Callable[[], object]) -> None:
        """Take steps until they are done or a signal waits."""
        started: list[Recorder] = []
        failed: BaseException | None = None
        logged = len(self.fragments.rows)
        _LOG.info("%d steps from %s, %d sub-steps in each", count, f"{self.date:%Y-%m-%d %H:%M}", self.substeps)
        if self._step_reason:
            _LOG.info("time step of %g s: %s", self.parameters.time_step, self._step_reason)
        try:
            for recorder in recorders:
                recorder.start(self)
                started.append(recorder)
            end = self.step_number + count
            while self.step_number < end:
                if hold.requested:
                    return
                step()
                logged = self._log_breakups(logged)
                for recorder in recorders:
                    recorder.record(self)
        except BaseException as error:
            failed = error
            raise
        finally:
            _LOG.info("stands at %s", f"{self.date:%Y-%m-%d %H:%M}")
            finish_all(started, self, failed)

    def _log_breakups(self, logged: int) -> int:
        """Log the fragments that are new, and return how many there have been now."""
        for row in self.fragments.rows[logged:]:
            if row.parent > 0:
                _LOG.info(
                    "%s: fragment %d of %.4g km2 broke off %d", f"{self.date:%Y-%m-%d %H:%M}", row.number,
                    row.area / 1e6, row.parent,
                )  # fmt: skip
        return len(self.fragments.rows)

    def _count_steps(self, days: float | str | None, steps: int | None) -> int:
        if (days is None) == (steps is None):
            raise InputError("give either days or steps", where="Model.run")
        if steps is not None:
            steps = native(steps)
            if isinstance(steps, bool) or not isinstance(steps, int | float) or int(steps) != steps or steps < 1:
                raise InputError(f"{steps!r} steps", where="Model.run", remedy="Give a whole number from 1")
            return int(steps)
        assert days is not None
        days = number(days, "day", where="days")
        if not math.isfinite(days) or days <= 0.0:
            raise InputError(f"{days:g} days", where="Model.run", remedy="Give a finite number above 0")
        self.fit_time_step(min(LONG_STEP, 86400.0 * days))
        # To the nearest step: 0.1 days are no exact multiple of any.
        count = round(days * 86400.0 / self.parameters.time_step)
        if count < 1:
            raise InputError(
                f"{days:g} days are less than one long step of {self.parameters.time_step:g} s",
                where="Model.run",
                remedy="Run longer",
            )
        return count

    def describe(self) -> str:
        """Return what this model is, in plain words, with all parameters."""
        from riftberg.life.edges import EdgeIce, front_lines  # with shapely, half a second

        notices = [f"  notice: {text}" for text in self.notices]
        forcing = f"  forcing: {self.forcing.describe()}"
        e = self.elements
        names = {row.number: row.name for row in self.fragments.rows}
        if not names:  # before the first step
            begins = np.cumsum([0, *(count for _, count in self.fragments.bergs)])
            names = {int(e.berg[k]): name for k, (name, _) in zip(begins, self.fragments.bergs, strict=False)}
        bears = reserve_lines(e.berg, e.thickness, e.length * e.width, names, self.parameters)
        fronts = front_lines(EdgeIce(e.lon, e.lat, e.length, e.width, e.thickness), e.berg, self.parameters)
        ice = [f"  ice: {text}" for text in (*fronts, *bears)]
        step = [f"  time step of {self.parameters.time_step:g} s: {self._step_reason}"] if self._step_reason else []
        return "\n".join([*self._heading(), *step, *notices, forcing, *ice, self.parameters.describe()])

    @property
    def rift_tips(self) -> list[RiftTip]:
        """Tips of the rifts that were there from the start, with their stress intensity after the last step."""
        return standing_tips(self._stepper.tips, self.elements, self.bonds)

    @property
    def notices(self) -> tuple[str, ...]:
        """What should be known of a run with these parameters, a sentence each."""
        rings = resonance_warning(self.elements, self.bonds, self.parameters)
        stiff = narrow_warning(self.elements, self.parameters)
        of_floor = floor_notices(self.forcing, self.elements, self.parameters, placed=self.step_number == 0)
        return (
            *(text for text in (self.sea_level_notice, rings, stiff) if text),
            *rift_notices(self.elements, self.bonds, self.parameters),
            *of_floor,
            *self.unusual.values(),
        )

    @property
    def sea_level_notice(self) -> str:
        """What is assumed of the sea level where no data give one, with a figure for the largest berg; empty where they do."""
        if not (self.forcing.assumes_slope or self.forcing.level_gaps):
            return ""
        body, bonds = self.elements.body, self.bonds
        component = connected_parts(body.id.size, bonds.first, bonds.second, bonds.status)
        areas = np.bincount(component, weights=body.length * body.width)
        largest = np.flatnonzero(component == areas.argmax()) if areas.size else component
        return slope_notice(self.forcing, self.elements, largest, self.parameters)

    @property
    def unusual(self) -> dict[str, str]:
        """What lies outside its usual range or has no effect, a sentence for each name (`riftberg.config.usual_ranges`)."""
        return unusual(self.parameters, self.elements, self.forcing, placed=self.step_number == 0)

    def __repr__(self) -> str:
        first, *others = self._heading()
        forcing = shortened(" ".join(self.forcing.describe().split()), 200)
        return "\n".join([f"<{first}", *others, f"  forcing: {forcing}>"])

    def _repr_html_(self) -> str:
        hexagonal = self.parameters.bonds.packing == "hexagonal"
        picture = portrait(self.elements, latlon=self.parameters.earth.latlon, hexagonal=hexagonal)
        return card(picture, "\n".join([repr(self)[1:-1], f"  parameters: {self.parameters!r}"]))

    def _heading(self) -> list[str]:
        p = self.parameters
        return [
            f"Model at {self.date:%Y-%m-%d %H:%M}, step {self.step_number} of {p.time_step:g} s "
            f"({self.substeps} sub-steps, scheme {p.stepping.scheme})",
            f"  {self.elements.mass.size} elements, {self.bonds.first.size} bonds, {self.bonds_broken} broken",
            *([f"  {text}"] if (text := coming_text(self.remembered, self.start)) else []),
        ]


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


def _element_sizes(elements: Elements) -> tuple[Floats, ...]:
    """Mass and sizes of the elements, which melt and calving change."""
    body = elements.body
    return body.mass, body.thickness, body.length, body.width


def _to_bytes(arrays: tuple[Floats, ...]) -> list[bytes]:
    return [a.tobytes() for a in arrays]


def _with_constant_size(p: Parameters, elements: Elements, bonds: Bonds) -> Parameters:
    """Fill in the constant interaction size: if one side is 0, both become the means of all elements (Q37).

    Several bergs have their own means (`riftberg.engines.common.stepper`), unless they are coupled as in the reference.
    """
    if not isinstance(p, ExplicitParameters):
        return p
    b = p.bonds
    if not b.constant_size or (b.constant_length > 0.0 and b.constant_width > 0.0):
        return p
    component = connected_parts(elements.size, bonds.first, bonds.second, bonds.status)
    if component.any() and not p.quirks.bergs_coupled:
        return p
    length, width = float(np.mean(elements.length)), float(np.mean(elements.width))
    return p.changed(bonds={"constant_length": length, "constant_width": width})


def check_arguments(berg: object, forcing: object, parameters: object) -> None:
    """Refuse arguments that are no berg, no forcing and no parameters: they are easily given in another order."""
    good = {
        "berg": (isinstance(berg, Iceberg), "an Iceberg, for example Iceberg.rectangle(...)"),
        "forcing": (
            isinstance(forcing, Forcing),
            "a forcing, for example Forcing.uniform(current=(0.2, 0.0))",
        ),
        "parameters": (isinstance(parameters, Parameters), "Parameters(...), or A68A_2022.changed(...)"),
    }
    for (name, (fits, expected)), value in zip(good.items(), (berg, forcing, parameters), strict=True):
        if not fits:
            raise InputError(f"{value_shown(value)} is no {name}", where=f"Model, {name}", remedy=f"Give {expected}")


def check_recorders(recorders: object) -> None:
    """Refuse an argument that is no list of recorders, before the first step."""
    expected = "recorders in a list, such as [RunWriter('run.nc')]"
    required(recorders, (list, tuple), expected, where="Model.run, recorders")
    for recorder in recorders if isinstance(recorders, list | tuple) else ():
        if not all(callable(getattr(recorder, name, None)) for name in ("start", "record", "finish")):
            raise InputError(
                f"{value_shown(recorder)} is no recorder", where="Model.run, recorders", remedy=f"Give {expected}"
            )


def time_zero(forcing: Forcing, start: datetime | None) -> datetime:
    """Return the date of time zero: as given, or that from which the forcing counts."""
    forcing_start = forcing.start
    if start is not None and forcing_start is not None and forcing_start != start:
        raise InputError(
            f"the forcing counts its time from {forcing_start}, the model from {start}",
            where="start",
            remedy=f"Give both the same start, such as Forcing.from_dataset(ds, start='{start:%Y-%m-%d %H:%M}')",
        )
    return start or forcing_start or DEFAULT_START


def check_coordinates(berg: Iceberg, forcing: Forcing, p: Parameters) -> None:
    """Refuse a berg, a grid and parameters that do not agree whether positions are degrees or metres."""
    units_in_degrees = {"the berg": berg.latlon}
    if forcing.grid is not None:
        units_in_degrees["the grid of the forcing"] = forcing.grid.arrays.latlon
    if forcing.latlon is not None:
        units_in_degrees["the forcing"] = forcing.latlon
    for who, latlon in units_in_degrees.items():
        if latlon != p.earth.latlon:
            actual, expected = ("degrees", "metres") if latlon else ("metres", "degrees")
            raise InputError(
                f"positions of {who} are {actual}, those of the parameters {expected}",
                where=f"earth.latlon = {p.earth.latlon}",
                remedy=f"Set earth.latlon = {latlon}, or make {who} in {expected}",
            )
    if forcing.grid is not None and forcing.grid.arrays.period not in (0.0, p.earth.period):
        period = forcing.grid.arrays.period
        raise InputError(
            f"the grid of the forcing repeats after {period:g}, and earth.period is {p.earth.period:g}",
            where="earth.period",
            remedy=f"Set earth.period = {period:g}: bonds and contact go across the seam of the grid by it",
        )


def check_balance(forcing: Forcing, p: Parameters) -> None:
    """Refuse a current that is balanced for a Coriolis parameter other than the run's."""
    if forcing.latlon is None:
        return
    forcing_latitude = forcing.latitude
    plane = p.earth.f_plane or not p.earth.latlon
    run_latitude = p.earth.reference_latitude if plane else None
    if forcing_latitude != run_latitude:
        words = ["that of each place" if at is None else f"{at:g} degrees" for at in (forcing_latitude, run_latitude)]
        raise InputError(
            f"the forcing is balanced for the latitude {words[0]}, the parameters have {words[1]}",
            where="earth.reference_latitude" if plane else "forcing, latitude",
            remedy="Give the forcing latitude=earth.reference_latitude on an f-plane or in metres, and no latitude otherwise",
        )


STATE_RULES: Final = (
    *(Rule(name, np.isfinite, "a finite number") for name in ("lon", "lat", "u", "v", "spin", "rotation")),
    *(Rule(name, is_positive, "a finite number above zero") for name in ("mass", "thickness", "length", "width")),
)
"""Rules for elements that can be stepped."""

BOND_RULES: Final = (
    Rule("strength", lambda values: np.isfinite(values) & (values >= 0.0), "a finite factor, 0 or more"),
    Rule("damage", lambda values: (values >= 0.0) & (values < 1.0), "from 0 up to, not including, 1"),
)
"""Rules for bonds that can break."""


def check_state(elements: Elements, bonds: Bonds, latlon: bool) -> None:
    """Refuse elements that cannot be stepped, before the first step."""
    if breach := find_breach(STATE_RULES, partial(getattr, elements)):
        e = breach.row
        position = place_text(float(elements.lon[e]), float(elements.lat[e]), latlon=latlon, digits=5)
        raise InputError(
            f"{breach.rule.variable} is {breach.value:g}", where=f"element {int(elements.id[e])} (row {e}) at {position}",
            remedy=f"It must be {breach.rule.allowed}",
        )  # fmt: skip
    count = elements.mass.size
    ends = np.concatenate([bonds.first, bonds.second])
    if ends.size and (ends.min() < 0 or ends.max() >= count):
        raise InputError(f"a bond names element row {int(ends.max())} of {count}", where="bonds")


def check_strengths(bonds: Bonds, p: Parameters) -> None:
    """Refuse strengths that are no strengths; runs with the reference's quirks take the strengths of the parameters unchecked."""
    checked, f = not p.quirks.zero_start, p.fracture
    for name, value in (("normal_strength", f.normal_strength), ("shear_strength", f.shear_strength)):
        if f.enabled and checked and value is not None and value <= 0.0:
            raise InputError(
                f"fracture.{name} = {value:g} Pa is no strength",
                where="parameters",
                remedy="Give a positive one, or set fracture.enabled = false so that no bond breaks",
            )
    if breach := find_breach(BOND_RULES, partial(getattr, bonds)):
        b = breach.row
        raise InputError(
            f"{breach.rule.variable} is {breach.value:g}",
            where=f"bond in row {b}, between the elements in rows {bonds.first[b]} and {bonds.second[b]}",
            remedy=f"It must be {breach.rule.allowed}",
        )
