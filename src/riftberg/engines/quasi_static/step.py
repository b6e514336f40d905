"""Quasi-static stepping: fragments move as rigid bodies, their lattices stand in equilibrium with the loads.

A time step is a sequence of trial steps, each up to the first event in it (`TimeStep`):

1. checkpoint: arrays that a trial changes in the model are copied;
2. trial step: contact and the bed in sub-steps, predictor, constraint of land, forcing at the new place, corrector, equilibrium;
3. events: fracture by contact or the sea floor, overload; the trial is rolled back and taken again to the first;
4. acceptance: forces and, unless a crack follows, peak stresses of the trial are recorded;
5. fracture: bonds break one by one under fixed loads until none is overloaded, and pieces become bodies of their own.

Elastic waves are left out: they pass within minutes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from riftberg.engines.common.forces.media import FORCES
from riftberg.engines.common.forces.sizes import interaction_sizes
from riftberg.engines.common.fragments.connectivity import connected_parts, drop_broken_bonds, drop_parted_bonds
from riftberg.engines.common.run_state import RunState
from riftberg.engines.quasi_static.bodies.dynamics import longest_trial_step
from riftberg.engines.quasi_static.bodies.pose import Bodies, bodies_from_elements, split_bodies
from riftberg.engines.quasi_static.fracture.brittle_lattice import MAX_LOW_RANK_UPDATES, BrittleLattice
from riftberg.engines.quasi_static.fracture.criteria import (
    Equilibrium,
    begin_peak_stress,
    record_peak_stress,
    store_stresses,
)
from riftberg.engines.quasi_static.ground.landing import SHORTEST_PUSHED_STEP, TOUCH_STEP
from riftberg.engines.quasi_static.lattice.equilibrium import released_energy
from riftberg.engines.quasi_static.memory import Memory
from riftberg.engines.quasi_static.rigid_step import BodyState, StepSnapshot, accumulate_step_forces
from riftberg.engines.quasi_static.trial import FragmentMotion, Trial
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Ints

MAX_CRACKS_PER_STEP = 64
"""Cracks begin at most this often in a time step: overloads that follow each other sooner are found together."""

SHORTEST_BLOW = 1e-3
"""Shortest sub-step (s) that decides how closely a crack by contact is located: shorter ones only close a gap."""

EVENT_TOLERANCE = 1.0 / 64.0
"""Events are located to this part of the shortest interval between two of them: the shortest sub-step for fracture by contact,
the shortest interval between two cracks for overload (under half a second in a step of half an hour)."""

CLOSE = 0.01
"""Part of the strength by which the stress may exceed it where a crack by an impact begins: a tenth of what the load
grows by in a sub-step at most."""

IMPACT_SUBSTEPS = 25
"""Sub-steps of an impact, from touching to parting: how far before its peak the bracket of a crack begins to look."""

UNEVEN = 0.05
"""Part of the strength by which the stress may miss it where loads that grow evenly would reach it: beyond it they do not."""

LONGEST_CONTACT_STEP = 1800.0
"""Longest trial step (s) in which fragments touch each other, or the bed catches, turns or frees one: in longer ones the loads at
its end are not those of the impact, and a berg that lifts off the bed comes free hours too early."""

SHRINK, GROWTH, SAFETY = 0.25, 4.0, 0.85
"""Where others push a fragment over the bed the next trial is so long that the hold of the bed changes by `SAFETY` of what a step
may change; no shorter than the first and no longer than the second of these times the last one."""


class TimeStep:
    """One time step of a model, from event to event, from the memory of the step before.

    ``unknown``: bodies that take the velocity of their elements, None where the twists in the memory are right; ``last_crack``:
    the highest number of a crack in the run.
    """

    def __init__(
        self, model: RunState, memory: Memory | None = None, unknown: NDArray[np.bool_] | None = None, last_crack: int = 0
    ) -> None:  # fmt: skip
        self.model, self.el, self.bonds = model, model.elements, model.bonds
        self._memory = memory = memory or Memory()
        self.laws, sizes = memory.laws, memory.sizes or interaction_sizes(self.el, model.constants)
        self.motion = FragmentMotion(model, self.laws, sizes, memory.workspace)
        self.start, self.dt, self.cracked = model.time, model.parameters.time_step, False
        self.applied = np.zeros((self.el.size, len(FORCES), 2))  # mean accelerations so far, by their part of the step
        self.touched: list[tuple[Ints, Ints]] = []  # elements of the pairs in contact so far
        self._max_dt = self._longest = self.dt  # Longest trial step to come next, and for the rest of the time step
        newly_made = memory.bodies is None or unknown is not None
        bodies = memory.bodies
        if bodies is None:
            bodies = first_bodies(self.el, self.bonds, model.constants)
        lattice = memory.lattice
        if lattice is None:
            cells = memory.cells, memory.topology
            lattice = BrittleLattice(model, bodies, sizes, cells, memory.tips, last_crack)
        else:  # the arrays of this step may be others than those of the last one
            lattice.follow_cracks(bodies, memory.tips)
        self.motion.lattice = lattice
        if newly_made:
            has_twist = np.zeros(bodies.pose.shape[0], np.bool_) if unknown is None else ~unknown
            bodies = bodies._replace(twist=np.where(has_twist[:, None], bodies.twist, self.motion.fit_twists(bodies)))
        if self.laws.seabed is not None:
            self.laws.seabed.check_start(model, bodies)
        self.state = memory.state or self.motion.find_state(bodies, model.time)
        if newly_made:
            self.state = self.motion.in_equilibrium(self.state)
        self.motion.frozen_displacement = self.state.bodies.displacement
        begin_peak_stress(self.bonds.peak_stress, lattice.intact, self._equilibrium(self.state).stress)

    @property
    def lattice(self) -> BrittleLattice:
        """The lattice of the bonds that are intact now."""
        return self.motion.lattice

    def run(self) -> None:
        """Advance to the end of the time step."""
        may_break = self.model.parameters.fracture.enabled
        if may_break and self.model.step_number == 0:
            self._propagate_crack()
        longest = longest_trial_step(self.state.operators.forcing, self.dt)
        if self._begins_touching():  # they go on to touch, as a rule: a longer trial would be taken in vain
            longest = min(longest, LONGEST_CONTACT_STEP)
        self._longest = longest
        self._max_dt = min(longest, self._memory.longest_trial)  # as the last step ended
        end, next_dt = self.start + self.dt, math.inf
        while (rest := end - self.state.time) > 1e-9 * self.dt:
            # The rest in equal parts, so that the last one is no shorter than it must be.
            h = min(rest / math.ceil(rest / self._max_dt - 1e-9), next_dt)
            next_dt = self._advance_to_event(h, may_break)
        equilibrium = self._equilibrium(self.state)
        self._store(equilibrium)
        self.tips = self.lattice.tips_with_intensities(equilibrium)

    def _begins_touching(self) -> bool:
        """Whether fragments press each other at the start, or one moves on the bed."""
        faces, keel = self.laws.faces, self.el.keel
        if faces is not None and faces.pairs.pair.size > 0:
            return True
        return self.laws.seabed is not None and bool(((keel.floor_load > 0.0) & (keel.floor_substep < self.dt)).any())

    def remember(self, snapshot: StepSnapshot | None = None, key: tuple[bytes, ...] = ()) -> Memory:
        """Return the memory for the next step; ``snapshot``, ``key``: of the state that the step has left."""
        lattice = self.lattice
        return self._memory._replace(
            snapshot=snapshot, topology_key=key, workspace=self.motion.work,
            bodies=self.state.bodies, cells=lattice.elastic_cells, tips=self.tips, lattice=lattice,
            longest_trial=self._max_dt if self._max_dt < self._longest else math.inf,
            # After a crack the loads are those of a lattice that has been renumbered since: the next step finds them anew, as a
            # restarted run does.
            state=None if self.cracked else self.state, sizes=self.motion.sizes, topology=lattice.topology,
        )  # fmt: skip

    # One step to the first event

    def _advance_to_event(self, h: float, may_break: bool) -> float:
        """Take one step of at most ``h`` s that ends at the first event in it; returns the longest step to come next (s).

        Events are looked for in this order, since each invalidates what the trial shows of those after it; a new kind of event
        takes its place here:

        1. Fragments touch each other or the bed in a step of hours, or push one to where the hold of the bed changes. All loads
           of the trial are then wrong: it is rejected, and shorter ones follow, in which all events are looked for again. Steps
           grow again when nothing is pushed.
        2. Fracture by contact or the sea floor. These loads peak within the step, so it comes before an overload at the end.
        3. Overload under the loads at the end, which grow evenly from the start of the step.

        A fracture always ends the step, as the pieces are other bodies. No bond is overloaded at its start, as the crack of the
        step before ran until none was; one that is now has been weakened by damage in this step, and breaks at its end.
        """
        tolerance = self.dt / MAX_CRACKS_PER_STEP * EVENT_TOLERANCE
        self._checkpoint()
        trial = self.motion.trial(self.state, h)
        if trial.touching and h > LONGEST_CONTACT_STEP * (1.0 + 1e-9):
            self._longest = LONGEST_CONTACT_STEP
            return self._retry(LONGEST_CONTACT_STEP)
        allowed = h * SAFETY / trial.hold_change if trial.hold_change > 0.0 else math.inf
        if trial.hold_change > 1.0 and h > SHORTEST_PUSHED_STEP * (1.0 + 1e-9):
            return self._retry(max(SHORTEST_PUSHED_STEP, SHRINK * h, allowed))
        self._max_dt = min(self._longest, GROWTH * self._max_dt, max(SHORTEST_PUSHED_STEP, allowed))

        if not may_break:
            self._accept(trial)
            return math.inf

        # After a first crack the next one begins no sooner than this: a berg that shatters must not stop the clock.
        least = self.dt / MAX_CRACKS_PER_STEP if self.cracked else 0.0
        if trial.contact is not None and self.lattice.overload(self._peak_equilibrium(trial)) > 0.0:
            # Cracks by contact may follow each other as quickly as its sub-steps.
            shortest = max(trial.contact.shortest_substep, SHORTEST_BLOW)
            # The load of an impact grows within seconds, all others over minutes.
            close = CLOSE if shortest < TOUCH_STEP else 0.0
            tolerance = shortest * EVENT_TOLERANCE
            trial = self._locate_event(trial, self._find_overload, tolerance, min(least, shortest), close)
            if self._peak_equilibrium(trial) is not None and self._overload_at_end(trial) <= 0.0:
                # Contact presses harder within the step than at its end: the crack runs under the peak loads.
                assert trial.contact is not None
                peak_load = self.motion.peak_load(trial.state, trial.contact.peak_load)
                trial.state = self.motion.in_equilibrium(trial.state._replace(load=peak_load))
            self._accept(trial, cracks=True)
            # From the most critical bond, if any: where contact presses has shifted a little.
            self._propagate_crack(impact=True)
            # The next crack by crushing follows soon. A longer trial knows the hardest push on each body alone, which may hide
            # that a weaker one before it has broken the ice: with trials ten times as long a third fewer bonds broke.
            return max(8.0 * trial.h, shortest)

        if self._overload_at_end(trial) <= 0.0:
            self._accept(trial)
            return 8.0 * trial.h if self.cracked and trial.contact is not None else math.inf
        start, end, h = self._equilibrium(self.state), self._equilibrium(trial.state), trial.h
        after = h
        if (at_start := self.lattice.overload(start)) <= 0.0:
            after = first_moment(
                lambda t: self.lattice.overload(self._between(start, end, t / h)),
                (0.0, at_start),
                (h, self.lattice.overload(end)),
                tolerance,
            )
        first_broken = self.lattice.critical_bond(self._between(start, end, after / h))[0]
        if (short := max(after, least)) < h * (1.0 - 1e-9):
            self._rollback()
            whole, trial = trial, self.motion.trial(self.state, short)
            if short == after and abs(self._overload_at_end(trial)) > UNEVEN:  # as where contact begins to load the ice
                trial = self._locate_event(whole, self._overload_at_end, tolerance, least)
                first_broken = self.lattice.critical_bond(self._equilibrium(trial.state))[0]
        self._accept(trial, cracks=True)
        # In the located step the loads may fall short of those between its ends by a little: the bond that was found there
        # breaks in any case.
        self._propagate_crack(first_broken)
        return math.inf

    def _retry(self, longest: float) -> float:
        """Reject a trial that was too long; the next ones take at most ``longest`` s."""
        self._rollback()
        self._max_dt = min(self._max_dt, longest)
        return math.inf

    def _locate_event(
        self, trial: Trial, event: Callable[[Trial], float], tolerance: float, least: float = 0.0, close: float = 0.0
    ) -> Trial:  # fmt: skip
        """Return a trial that ends at most ``tolerance`` s after the first event in ``trial``.

        ``event`` is above 0 where a trial holds one, and at most ``close`` is near enough. In the first ``least`` s none is
        located. Trials without an event become the state, and the returned trial starts from there: an impact need not be gone
        through from its start each time.
        """
        elapsed, latest = 0.0, (trial.h, trial)

        def until(t: float) -> float:
            nonlocal elapsed, latest
            self._rollback()
            latest = t, self.motion.trial(self.state, t - elapsed)
            value = event(latest[1])
            if value <= 0.0:
                self._accept(latest[1])
                self._checkpoint()
                elapsed = t
            return value

        lower, upper = (0.0, -1.0), (trial.h, event(trial))
        if 0.0 < least < trial.h:
            early = least, until(least)
            lower, upper = (early, upper) if early[1] <= 0.0 else (lower, early)
        if upper[0] > least:
            lower, upper = self._bracket_impact(trial, until, lower, upper)
        end = upper[0] if upper[0] <= least else first_moment(until, lower, upper, tolerance, close)
        if latest[0] == end > elapsed:
            return latest[1]
        self._rollback()
        return self.motion.trial(self.state, end - elapsed)

    def _bracket_impact(
        self, trial: Trial, value: Callable[[float], float], lower: tuple[float, float], upper: tuple[float, float]
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Narrow a bracket to the impact that breaks the ice: it takes seconds, where halving begins with hours.

        ``lower``, ``upper``: ends of the bracket, and the values there.
        """
        peak, contact = self._peak_equilibrium(trial), trial.contact
        if contact is None or peak is None:
            return lower, upper
        bond, ratio = self.lattice.critical_bond(peak)
        struck = contact.peak_load.bodies == trial.state.bodies.body[self.bonds.first[bond]]
        if ratio <= 1.0 or not struck.any():
            return lower, upper
        # A shorter trial takes other sub-steps: two more of them, and it has seen the peak.
        t = float(contact.peak_load.time[struck][0]) + 2.0 * contact.shortest_substep
        back = IMPACT_SUBSTEPS * contact.shortest_substep
        while lower[0] < t < upper[0]:
            end = t, value(t)
            if end[1] <= 0.0:
                return end, upper
            upper, t, back = end, t - back, 4.0 * back
        return lower, upper

    def _checkpoint(self) -> None:
        """Copy the arrays that a trial step changes in the model and that the next trial reads before it fills them anew."""
        self._saved = [array.copy() for array in self._changed_by_trials()], self.laws.checkpoint()

    def _changed_by_trials(self) -> tuple[np.ndarray, ...]:
        el = self.el
        damage = (self.bonds.damage,) if self.model.parameters.damage.enabled else ()
        on_bed = (*el.keel, el.environment.depth) if self.laws.seabed is not None else ()
        return *el.place, *el.shown, el.motion.rotation, *damage, *on_bed

    def _rollback(self) -> None:
        """Return to the last checkpoint."""
        saved, laws = self._saved
        for array, values in zip(self._changed_by_trials(), saved, strict=True):
            array[:] = values
        self.laws.rollback(laws)

    def _accept(self, trial: Trial, cracks: bool = False) -> None:
        """Make a trial step the state: record its forces, its contacts and, unless a crack follows, its peak stresses."""
        start, end, contact = self.state, trial.state, trial.contact
        self.state = end
        previous = self.applied[contact.rows] if contact else self.applied[:0]
        accumulate_step_forces(
            start.operators, start.terms, end.terms, start.bodies.twist, trial.kick, 0.5 * trial.h, 0.5 * trial.h / self.dt,
            self.applied,
        )  # fmt: skip
        if contact is not None:
            # In contact the impulses of all forces were summed over the sub-steps instead.
            self.applied[contact.rows] = previous + contact.applied / self.dt
            self.touched.append((contact.first, contact.second))
        if not cracks:
            self._record_peaks(self._equilibrium(end), self._peak_equilibrium(trial))

    def _record_peaks(self, *moments: Equilibrium | None) -> None:
        """Record the largest stress of each bond within the time step."""
        for moment in moments:
            if moment is not None:
                record_peak_stress(self.bonds.peak_stress, self.lattice.intact, moment.stress)

    # Events

    def _find_overload(self, trial: Trial) -> float:
        """Event function of fracture in a trial, by contact on the way or under the loads at its end."""
        return max(self.lattice.overload(self._peak_equilibrium(trial)), self._overload_at_end(trial))

    def _overload_at_end(self, trial: Trial) -> float:
        """Event function of fracture under the loads at the end of a trial."""
        return self.lattice.overload(self._equilibrium(trial.state))

    def _between(self, start: Equilibrium, end: Equilibrium, share: float) -> Equilibrium:
        """Return the equilibrium at a part of a trial: loads change linearly from start to end, and displacements with them."""
        displacement = start.displacement + share * (end.displacement - start.displacement)
        return self.lattice.moment(displacement, start.load + share * (end.load - start.load))

    def _peak_equilibrium(self, trial: Trial) -> Equilibrium | None:
        """Return the equilibrium under the peak contact loads of a trial; None where no bonded fragment was touched."""
        contact, lattice = trial.contact, self.lattice
        if contact is None or not contact.peak_load.rows.size:
            return None
        if trial.peak is None:
            load = self.motion.peak_load(trial.state, contact.peak_load)
            trial.peak = lattice.moment(lattice.displacements(load), load)
        return trial.peak

    def _equilibrium(self, state: BodyState) -> Equilibrium:
        """Return the equilibrium of a state."""
        return self.lattice.equilibrium(state.bodies.displacement, state.load)

    # Fracture

    def _propagate_crack(self, first: int = -1, impact: bool = False) -> None:
        """Break bonds under fixed loads until none is overloaded: a crack runs faster than the loads change.

        The most critical bond breaks, then the next one in the equilibrium without it. ``first`` (a row of the state)
        begins in any case where none is overloaded. ``impact``: the loads are the peak loads of a contact. They
        end where a piece parts: the next step finds the contact of the pieces.
        """
        equilibrium = self._equilibrium(self.state)
        self._store(equilibrium)
        bond, ratio = self.lattice.critical_bond(equilibrium)
        bond = bond if ratio > 1.0 else first
        if bond < 0:
            return
        bond = self.lattice.next_bond(equilibrium, bond)
        self.cracked, first_broken, area = True, bond, 0.0
        initial = self.state
        while True:
            area += self.lattice.facet_area(bond)
            self.bonds.break_strength[bond] = self.lattice.exceeded(equilibrium, bond)
            self._break_bond(bond)
            equilibrium = self._equilibrium(self.state)
            bond, ratio = self.lattice.critical_bond(equilibrium)
            if ratio <= 1.0:
                break
            # What the last bonds bear while a crack runs through them is no stress that the ice has borne.
            bond = self.lattice.next_bond(equilibrium, bond)
        final = self.state
        # What the load of an impact has stored goes into the rebound of the pieces.
        parted = final.bodies.pose.shape[0] != initial.bodies.pose.shape[0]
        if not (impact and parted):
            self.bonds.released_energy[first_broken] = released_energy(
                initial.bodies.displacement, initial.load, final.bodies.displacement, final.load
            )
        self.bonds.cracked_area[first_broken] = area
        self._renumber(parted=parted)
        self._record_peaks(self._equilibrium(self.state))

    def _break_bond(self, bond: int) -> None:
        """Break one bond and find the equilibrium without it, with new bodies where a piece has parted."""
        el, bonds, state, c = self.el, self.bonds, self.state, self.model.constants
        i, j = bonds.first[bond], bonds.second[bond]
        aground = state.operators.forcing.aground
        bonds.status[bond] = 1
        bonds.break_time[bond] = state.time
        bonds.break_grounded[bond] = 1 if aground[i] > 0.0 or aground[j] > 0.0 else 0
        el.bond_count[i] -= 1
        el.bond_count[j] -= 1
        body = connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status)
        if int(body.max()) + 1 != state.bodies.pose.shape[0]:
            # Elements stay where they are, with the displacements at the start of the time step: on their last bonds
            # alone they would be found turned by up to 30 degrees, for which a crack leaves no time.
            frozen = self.motion.frozen_displacement
            el.rotation[:] += frozen[:, 2] - state.bodies.displacement[:, 2]
            bodies = split_bodies(
                state.bodies._replace(displacement=frozen), body, state.operators.forcing.mass, c.latlon, c.earth_radius
            )
            self.motion.frozen_displacement = bodies.displacement
            self.motion.lattice = self.lattice.anew(bodies)
            self.motion.publish_positions(bodies)
            self.state = self.motion.find_state(bodies, state.time)
        elif self.lattice.update_rank >= MAX_LOW_RANK_UPDATES:
            self.motion.lattice = self.lattice.anew(state.bodies)
        else:
            self.lattice.remove(bond)
        self.state = self.motion.in_equilibrium(self.state)

    def _renumber(self, *, parted: bool) -> None:
        """Number the fragments anew, and start from fresh factors, which a restarted run has too."""
        model, el, bonds = self.model, self.el, self.bonds
        if model.constants.broken_as_contact:
            drop_parted_bonds(bonds, connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status))
        else:
            drop_broken_bonds(bonds)
        model.fragments.update(el, bonds, self.state.time, model.constants)
        if parted and self.laws.seabed is not None:
            self.laws.seabed.settle_pieces(model, self.state.bodies, self.state.time)
        if self.lattice.update_rank:  # else it has just been factored, as where pieces part
            self.motion.lattice = self.lattice.anew(self.state.bodies)
        self.state = self.motion.in_equilibrium(self.motion.find_state(self.state.bodies, self.state.time))

    def _store(self, equilibrium: Equilibrium) -> None:
        """Write stresses and deformations to the state."""
        store_stresses(
            self.bonds,
            equilibrium.lattice,
            equilibrium.intact,
            equilibrium.displacement,
            equilibrium.stress,
            self.state.operators.levers,
        )


def first_bodies(el: Elements, bonds: Bonds, p: KernelParameters) -> Bodies:
    """Make bodies of the elements as they are, taken to be free of load."""
    body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
    return bodies_from_elements(el.lon, el.lat, body, el.mass, p.latlon, p.earth_radius, p.period)


def first_moment(
    value: Callable[[float], float],
    lower: tuple[float, float],
    upper: tuple[float, float],
    tolerance: float,
    close: float = 0.0,
) -> float:
    """Find the first moment at which ``value`` is above 0, to ``tolerance`` (s): the end of the bracket, just after it.

    ``lower`` and ``upper``: the ends of a bracket, and the values there; ``close``: a value that is near enough to 0. By the ITP
    method (Oliveira and Takahashi 2020, doi:10.1145/3423597): the secant through both ends, moved towards the middle, and never
    so far from it that bisection would need more than one evaluation less. Values may jump, as the sea floor and other fragments
    act from one moment to the next; of signs alone it makes bisection.
    """
    (a, low), (b, high), width = lower, upper, upper[0] - lower[0]
    most = math.ceil(math.log2(max(width / tolerance, 1.0))) + 1  # one more than bisection
    for n in range(most):
        if b - a <= tolerance or high <= close:
            break
        low, high, middle = max(-1.0, low), min(high, 1.0), 0.5 * (a + b)  # without ice or strength they are infinite
        from_secant = middle - (a * high - b * low) / (high - low)
        shift = max(abs(from_secant) - 0.2 / width * (b - a) ** 2, 0.0)
        shift = min(shift, max(0.5 * tolerance * 2.0 ** (most - n) - 0.5 * (b - a), 0.0))
        t = middle - math.copysign(shift, from_secant)
        latest = value(t)
        if latest > 0.0:
            b, high = t, latest
        else:
            a, low = t, latest
    return b
