"""Quasi-static stepping: fragments move as rigid bodies, their lattices stand in equilibrium with the loads.

A time step is a sequence of trial steps, each up to the first event in it (`TimeStep`):

1. checkpoint: what a trial changes in the model is copied;
2. trial step: contact in sub-steps, predictor, constraint of land, forcing at the new place, corrector, equilibrium;
3. events: touch-down on the sea floor, fracture by contact, overload; the trial is rolled back and taken again to the first;
4. fracture: bonds break one by one under fixed loads until none is overloaded, and pieces become bodies of their own;
5. acceptance: forces and peak stresses of the step are recorded.

Elastic waves are left out: they pass within minutes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.errors import RunError
from riftberg.ocean.cells import settle_elements
from riftberg.parameters import KernelParameters
from riftberg.physics.bonds import stress_ratio
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.population import put_back
from riftberg.stepping.bodies.dynamics import (
    BodyOperators,
    BodyWorkspace,
    ForceTerms,
    allocate_body_workspace,
    check_converged,
    half_kick_newton,
    longest_trial_step,
)
from riftberg.stepping.bodies.pose import (
    Bodies,
    bodies_from_elements,
    place_elements,
    split_bodies,
    tangent_coordinates,
)
from riftberg.stepping.contact.broad_phase import NO_PAIRS, concatenate_pairs
from riftberg.stepping.contact.faces import NO_FACE_PAIRS, FaceContact, FacePairs
from riftberg.stepping.contact.islands import (
    ContactPhase,
    PeakContactLoad,
    scatter_peak_load,
    trapezoidal_correction,
)
from riftberg.stepping.contact.land import (
    corrected_poses,
    find_near_circles,
    land_corrections,
    leading_elements,
    stopped_by_land,
)
from riftberg.stepping.forces.media import FORCES
from riftberg.stepping.forces.sizes import Sizes, interaction_sizes
from riftberg.stepping.fracture.crack_tips import (
    NO_TIPS,
    TIP_NAMES,
    CrackPaths,
    CrackTips,
    tips_from_arrays,
    tips_of_rifts,
)
from riftberg.stepping.fracture.criteria import (
    FLEXURAL,
    NORMAL,
    SHEAR,
    Criterion,
    Equilibrium,
    Strengths,
    criterion_for,
    grow_damage,
    overloads,
    record_peak_stress,
    residual_strengths,
    store_stresses,
)
from riftberg.stepping.fragments.connectivity import connected_parts, drop_broken_bonds, drop_parted_bonds
from riftberg.stepping.ground.landing import GroundPhase, Seabed, bodies_that_are_struck, joined, without
from riftberg.stepping.lattice.cell_stiffness import CellSolver, CellStiffness, CellTopology
from riftberg.stepping.lattice.cells import (
    CELL_NAMES,
    ElasticCells,
    cells_from_arrays,
    cells_to_arrays,
    with_new_cells,
)
from riftberg.stepping.lattice.equilibrium import (
    ElasticLattice,
    StiffnessSolver,
    Supports,
    balanced_loads,
    elastic_energy,
    find_lattice,
)
from riftberg.stepping.lattice.footprints import FootprintBook
from riftberg.stepping.quasi_static.lone_bergs import (
    bodies_of,
    find_lone_bergs,
    joined_bodies,
    run_of,
    step_lone_bergs,
)
from riftberg.stepping.quasi_static.rigid_step import (
    BodyState,
    StepSnapshot,
    accumulate_step_forces,
    assemble_operators,
    correct,
    predict,
    remove_rigid_modes,
    sync_bodies,
    take_snapshot,
)
from riftberg.stepping.run_state import RunState

MAX_CRACKS_PER_STEP = 64
"""Cracks begin at most this often in a time step: overloads that follow each other sooner are found together."""

EVENT_TOLERANCE = 1.0 / 64.0
"""Events are located to this part of the shortest interval between two of them: the shortest sub-step for fracture by contact,
the shortest interval between two cracks for touch-down and overload (under half a second in a step of half an hour)."""

LONGEST_CONTACT_STEP = 1800.0
"""Longest trial step (s) in which fragments touch: in longer ones the loads at its end are not those of the impact."""

LONGEST_SLIDING_STEP = 20.0
"""Longest trial step (s) in which a fragment slides over a bed of sediment that others press: an impact lasts some 15 s."""

YIELDS = 0.02
"""Way (m) that a held fragment gives in a long step from which on it may be pushed harder than the bed can bear: at 1 mm/s under
that force, for the time of an impact."""

AT_REST = 0.01
"""Speed (m s-1) below which a fragment on the bed is held when others strike it."""

PARTED = 0.5
"""Largest distance (m) between the places to which contact and the bed take a fragment that slides in a long step."""

MAX_LOW_RANK_UPDATES = 90
"""Rank of the correction for broken bonds beyond which the stiffness matrix is factored anew: about where that is quicker."""

FEW_SUBSTEPS = 8.0
"""Shortest sub-steps from which on a trial of fragments in contact is accepted where the next crack is located (chosen)."""

GROWTH = 16.0
"""A step that contact has made short is followed by one this many times as long. Chosen: an empty step costs some 3 ms, one
through the impacts of fifty pieces a thousand times as much."""

BODY_NAMES = ("rigid_body", "rigid_shape", "rigid_pose", "rigid_rate", "rigid_bend")
"""Names of the fields of `Bodies` in a restart file."""

SNAPSHOT_NAMES = tuple(f"rigid_left_{name}" for name in StepSnapshot._fields)
"""Names of the fields of `StepSnapshot` there."""


class QuasiStaticStepper:
    """The scheme, and what lives from one time step to the next."""

    def __init__(self, model: RunState) -> None:
        self._bodies: Bodies | None = None
        # Where the ice is elastic in cells, they are made at the start of a run; a restart holds them from then on.
        self._cells: ElasticCells | None = None
        self._cell_topology: CellTopology | None = None  # found once as long as ice melts but nothing breaks
        self._tips = NO_TIPS
        if model.parameters.elastic_cells and model.elements.size and model.step_number == 0:
            self._cells = with_new_cells(None, model.elements, model.bonds, model.outlines, model.constants)
            self._tips = tips_of_rifts(model.elements, model.bonds, model.constants)
        self._footprints = FootprintBook(model)
        self._faces = FaceContact(model, self._footprints)
        aground = model.parameters.grounding.law == "seabed"
        self._seabed = Seabed(model, self._footprints) if aground else None
        self._laws = LawsWithMemory(self._seabed, self._faces)
        self._lattice: FactoredLattice | None = None
        self._state: BodyState | None = None
        self._applied = np.zeros((0, len(FORCES), 2))
        self._topology: list[bytes] = []
        self._sizes: Sizes | None = None
        self._work: BodyWorkspace | None = None
        self._touched = NO_PAIRS
        self._snapshot: StepSnapshot | None = None
        # All of that at the start of the last step, with its time, for a model that takes a failed step back.
        self._last_start: tuple[float, Bodies | None, StepSnapshot | None, ElasticCells | None, CrackTips, Memory] = (
            math.nan, None, None, None, NO_TIPS, (None, None),
        )  # fmt: skip

    @property
    def applied(self) -> Floats:
        """See `riftberg.stepping.stepper.Stepper.applied`: by the trapezoidal rule over all parts of the step."""
        return self._applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """See `riftberg.stepping.stepper.Stepper.touched`."""
        return self._touched

    @property
    def plastic(self) -> Floats:
        """See `riftberg.stepping.stepper.Stepper.plastic`."""
        return np.append(self._faces.pairs.dissipated, np.zeros(2) if self._seabed is None else self._seabed.plastic)

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart file must hold beside the state."""
        bodies = {} if self._bodies is None else dict(zip(BODY_NAMES, self._bodies, strict=True))
        before = {} if self._snapshot is None else dict(zip(SNAPSHOT_NAMES, self._snapshot, strict=True))
        tips = dict(zip(TIP_NAMES, self._tips, strict=True)) if self._tips.crack.size else {}
        cells = {} if self._cells is None else cells_to_arrays(self._cells)
        laws = [law.state_dict() for law in (self._footprints, self._seabed, self._faces) if law]
        return {**bodies, **before, **cells, **tips, **{name: array for law in laws for name, array in law.items()}}

    def load_state_dict(self, saved: Mapping[str, Any]) -> None:
        """Restore what `state_dict` gave."""
        if all(name in saved for name in BODY_NAMES):
            body, *rest = (np.asarray(saved[name]) for name in BODY_NAMES)
            self._bodies = Bodies(body.astype(np.int64), *(np.array(a, np.float64) for a in rest))
        if all(name in saved for name in SNAPSHOT_NAMES):
            ids, *rest = (np.asarray(saved[name]) for name in SNAPSHOT_NAMES)
            self._snapshot = StepSnapshot(ids.astype(np.int64), *(np.array(a, np.float64) for a in rest))
        if all(name in saved for name in CELL_NAMES):
            self._cells = cells_from_arrays(saved)
        self._tips = tips_from_arrays(saved)
        for law in (self._footprints, self._seabed, self._faces):
            if law is not None:
                law.load_state_dict(saved)

    def sample_forcing(self, model: RunState) -> None:
        """Sample at the present positions."""
        model.forcing.sample(model.elements, model.time)

    def synchronised(self, model: RunState) -> tuple[Floats, Floats]:
        """Return the velocity, which belongs to the positions."""
        return model.elements.u_sync.copy(), model.elements.v_sync.copy()

    def step(self, model: RunState) -> None:
        """Advance by one time step."""
        if self._last_start[0] == model.time:  # the model has taken the last step back
            (_, self._bodies, self._snapshot, self._cells, self._tips, law_states), self._state = self._last_start, None
            self._laws.rollback(law_states)
        self._last_start = (
            model.time, self._bodies, self._snapshot, self._cells, self._tips, self._laws.checkpoint()
        )  # fmt: skip
        unknown = self._sync(model)
        if self._step_population(model, unknown):
            return
        step = TimeStep(
            model,
            self._bodies,
            self._lattice,
            self._state,
            self._sizes,
            self._work,
            unknown,
            (self._cells, self._cell_topology),
            (self._tips, 0),
            self._laws,
        )
        self._lattice = self._state = None  # a step that fails leaves them half changed
        step.run()
        # After a crack the loads are those of a lattice that has been renumbered since: the next step finds them anew, as a
        # restarted run does.
        self._bodies, self._lattice, self._state = step.state.bodies, step.lattice, None if step.cracked else step.state
        self._applied, self._touched = step.applied, concatenate_pairs(step.touched)
        self._sizes, self._work, self._cells, self._tips = step.sizes, step.work, step.cells, step.tips
        self._cell_topology = step.topology
        if step.cracked:
            self._topology = _topology_key(model)
        self._snapshot = take_snapshot(model.elements)
        model.time = step.start + model.parameters.stepping.time_step

    def _step_population(self, model: RunState, unknown: NDArray[np.bool_] | None) -> bool:
        """Take a step in which most bergs are lone ones, which go by themselves; returns whether it is one."""
        bodies, bonds, c = self._bodies, model.bonds, model.constants
        # A force of one's own may look at all elements, and a bed of sediment holds them by row.
        if self._seabed is not None or model.laws.force is not None:
            return False
        if bodies is None:
            bodies = first_bodies(model.elements, bonds, c)
            unknown = np.ones(bodies.pose.shape[0], np.bool_)
        sizes = self._sizes or interaction_sizes(model.elements, c)
        found = find_lone_bergs(model, bodies, sizes, self._faces)
        if found is None:
            return False
        (lone, quiet), self._lattice, self._state = found, None, None
        applied = np.zeros((model.elements.size, len(FORCES), 2))
        done = step_lone_bergs(model, bodies, unknown, lone, sizes, applied)
        # The quiet, fragments of several elements that nobody may touch, then the company of all that may meet: events cut the
        # step of each group alone.
        company = ~quiet
        company[done.rows] = False
        parts, touched, cracked = [(done.rows, done.bodies)], [], False
        if not company.any():
            self._faces.part()
        for among in (quiet, company):
            if not among.any():
                continue
            rows = np.flatnonzero(among)
            (group, bond_rows), (theirs, numbers) = run_of(model, rows), bodies_of(bodies, rows)
            topology = self._cell_topology if among is quiet else None
            step = TimeStep(
                group, theirs, unknown=None if unknown is None else unknown[numbers], cells=(self._cells, topology),
                cracks=(self._tips, int(bonds.crack.max(initial=0))),
                laws=LawsWithMemory(None, self._faces) if among is company else None,  # faces meet in company alone
            )  # fmt: skip
            step.run()
            put_back(model.elements, bonds, rows, bond_rows, group.elements, group.bonds)
            applied[rows] = step.applied
            touched += [(rows[first], rows[second]) for first, second in step.touched]
            self._cells, self._tips, cracked = step.cells, step.tips, cracked or step.cracked
            if among is quiet:
                self._cell_topology = step.topology
            parts.append((rows, step.state.bodies))
        body = connected_parts(model.elements.size, bonds.first, bonds.second, bonds.status)
        self._bodies = joined_bodies(body, tuple(parts))
        self._applied, self._touched, self._sizes, self._work = applied, concatenate_pairs(touched), sizes, None
        if cracked:
            self._topology = _topology_key(model)
        self._snapshot = take_snapshot(model.elements)
        model.time += model.parameters.stepping.time_step
        return True

    def _sync(self, model: RunState) -> NDArray[np.bool_] | None:
        """Discard the lattice where ice, bonds or supports have changed since the last step, and bring the bodies up to date.

        Returns which bodies take the velocity of their elements; None where all are as the last step has left them.
        """
        now, count = _topology_key(model), model.elements.size
        same_connectivity = self._topology[:N_CONNECTIVITY] == now[:N_CONNECTIVITY]
        if self._topology and self._topology != now:
            self._lattice = self._state = self._sizes = None
        self._topology = now
        if self._bodies is None:
            return None
        if self._snapshot is None or self._snapshot.id.size != self._bodies.body.size:
            self._bodies = self._bodies if self._bodies.body.size == count else None
        elif not (same_connectivity and self._snapshot.is_current(model.elements)):
            bodies, unknown = sync_bodies(model.elements, model.bonds, self._bodies, self._snapshot, model.constants)
            self._state = None  # given forces may have changed
            if unknown.any() or not np.array_equal(bodies.body, self._bodies.body):
                self._bodies, self._lattice = bodies, None
                return unknown
        return None


def _topology_key(model: RunState) -> list[bytes]:
    """What bodies and lattice are made of: elements, supports, intact bonds, and ice; as bytes, which compare quickly."""
    body, bonds = model.elements.body, model.bonds
    arrays = (
        body.id,
        body.static,
        body.free_y,
        bonds.id,
        bonds.status,
        body.mass,
        body.thickness,
        body.length,
        body.width,
    )
    return [array.tobytes() for array in arrays]


N_CONNECTIVITY = 5
"""How many of them are about connectivity: which elements there are, how they are bonded and supported."""


Memory = tuple[tuple[dict[int, Floats], Floats] | None, FacePairs | None]
"""Gouges of the sea floor and the work that went into it, and faces that press each other."""


class LawsWithMemory(NamedTuple):
    """Laws that keep something from one step to the next: a bed of sediment if it is chosen, faces where fragments may meet."""

    seabed: Seabed | None = None
    faces: FaceContact | None = None

    def checkpoint(self) -> Memory:
        """Return what a step changes of them."""
        return (
            None if self.seabed is None else self.seabed.checkpoint(),
            None if self.faces is None else self.faces.pairs,
        )

    def rollback(self, before: Memory) -> None:
        """Return to what `checkpoint` gave."""
        bed, pairs = before
        if self.seabed is not None and bed is not None:
            self.seabed.rollback(bed)
        if self.faces is not None and pairs is not None:
            self.faces.pairs = pairs


class Ashore(NamedTuple):
    """Fragments that land has put back."""

    bodies: Ints
    leading: Ints  # The elements that went farthest over land, theirs or of a fragment that they push
    own: NDArray[np.bool_]  # Whether it is theirs
    correction: Floats  # Of these, m east and north; shape (fragments, 2)


def _stop_at_land(twist: Floats, levers: Floats, ashore: list[Ashore]) -> None:
    """Take from fragments the velocity into the land that stops their leading elements, or those that they push."""
    for bodies, leading, own, correction in ashore:
        m, q = levers[leading], twist[bodies]
        q[:, 2] *= own  # of a fragment that pushes the motion of its centre counts
        u, v = np.sum(m[:, 0:3] * q, axis=1), np.sum(m[:, 3:6] * q, axis=1)
        du, dv = stopped_by_land(0.0 * u, 0.0 * v, u, v, correction)
        # From the axes of the element to those of the centre: the inverse of a rotation.
        twist[bodies, 0] += m[:, 0] * du + m[:, 3] * dv
        twist[bodies, 1] += m[:, 1] * du + m[:, 4] * dv


@dataclass
class Trial:
    """A trial step from the state at its start; positions, rotation and damage in the model have followed it."""

    h: float  # s
    state: BodyState  # At its end
    contact: ContactPhase | None  # What contact did on the way
    slides: bool = False  # Whether a bed of sediment cannot hold a fragment that others press
    peak: Equilibrium | None = None  # Under the peak contact loads, once it has been needed


class Move(NamedTuple):
    """The first part of a trial step, before the velocities at its end are known."""

    bodies: Bodies  # At the new place, with the velocities at mid-step
    operators: BodyOperators  # There
    ashore: list[Ashore]
    contact: ContactPhase | None  # Of bodies that met
    ground: GroundPhase | None  # Of bodies on a bed of sediment
    phase: ContactPhase | None  # Of both
    slides: bool  # Whether that bed cannot hold a body that met another


class TimeStep:
    """One time step of a model, from event to event.

    ``lattice``, ``state``, ``sizes`` and ``work`` are those of the step before, where nothing has changed since. ``unknown``:
    bodies that take the velocity of their elements, None where the twists of ``bodies`` are right; ``cells``: the elastic cells
    and the topology of their mesh; ``cracks``: the tips, and the highest number of a crack in the run.
    """

    def __init__(
        self, model: RunState, bodies: Bodies | None = None, lattice: FactoredLattice | None = None,
        state: BodyState | None = None, sizes: Sizes | None = None, work: BodyWorkspace | None = None,
        unknown: NDArray[np.bool_] | None = None,
        cells: tuple[ElasticCells | None, CellTopology | None] = (None, None),
        cracks: tuple[CrackTips, int] = (NO_TIPS, 0), laws: LawsWithMemory | None = None,
    ) -> None:  # fmt: skip
        # Tips, and the highest number of a crack, which may be one in ice that is not here.
        tips, self._last_crack = self._first_tips, _ = cracks
        (self.cells, self.topology), self.laws = cells, laws or LawsWithMemory()
        self.seabed, self.faces = self.laws
        self.model, self.el, self.bonds, self.c = model, model.elements, model.bonds, model.constants
        self.sizes, self.work = sizes or interaction_sizes(self.el, self.c), work
        self.start, self.dt, self.cracked = model.time, model.parameters.stepping.time_step, False
        self.applied = np.zeros((self.el.size, len(FORCES), 2))  # mean accelerations so far, by their part of the step
        self.touched: list[tuple[Ints, Ints]] = []  # elements of the pairs in contact so far
        self._max_dt = self.dt  # longest trial step for the rest of the time step
        fresh = bodies is None or unknown is not None
        if bodies is None:
            bodies = first_bodies(self.el, self.bonds, self.c)
        self.lattice = lattice or self._factored_lattice(bodies, tips)
        if self.lattice.cells is not None:  # of the arrays of this step, which may be others than in the last one
            self.lattice.paths = self._crack_paths(tips, bodies, self.lattice)
        if fresh:
            known = np.zeros(bodies.pose.shape[0], np.bool_) if unknown is None else ~unknown
            bodies = bodies._replace(twist=np.where(known[:, None], bodies.twist, self._twists_of_elements(bodies)))
        if self.seabed is not None and model.step_number == 0:
            self.seabed.check_start(model, bodies)
        self.state = state or self._state_at(bodies, model.time)
        if fresh:
            self.state = self._in_equilibrium(self.state)
        self.frozen_displacement = self.state.bodies.displacement
        self.bonds.peak_stress[self.lattice.intact] = self._equilibrium(self.state).stress[:, 0]

    def run(self) -> None:
        """Advance to the end of the time step."""
        fracture, first_step = self.model.parameters.fracture, self.model.step_number == 0
        may_break = fracture.enabled and not (first_step and fracture.not_in_first_step)
        if may_break and first_step:
            self._propagate_crack()
        self._max_dt = longest_trial_step(self.state.operators.forcing, self.dt)
        end, next_dt = self.start + self.dt, math.inf
        while (left := end - self.state.time) > 1e-9 * self.dt:
            # The rest in equal parts, so that the last one is no shorter than it must be.
            h = min(left / math.ceil(left / self._max_dt - 1e-9), next_dt)
            # After a crack by contact steps grow from its sub-steps up: one over all the rest would go through impacts in which
            # nothing breaks, only to show that something breaks before.
            next_dt = max(self._advance_to_event(h, may_break), GROWTH * h if h == next_dt else 0.0)
        self._store(self._equilibrium(self.state))

    @property
    def tips(self) -> CrackTips:
        """The tips of cracks, as the last break has left them."""
        return self._first_tips if self.lattice.paths is None else self.lattice.paths.tips

    # One step to the first event

    def _advance_to_event(self, h: float, may_break: bool) -> float:
        """Take one step of at most ``h`` s that ends at the first event in it; returns the longest step to come next (s).

        The order in which events are looked for is the order in which one invalidates what the trial shows about the next:

        1. The set of grounded elements changes in a step that is too long to resolve the drag of the sea floor, or fragments
           touch in one of hours. All loads of the trial are then wrong, so it is rejected whatever else is in it, and the
           rest of the time step is taken in shorter steps, in which all events are looked for again.
        2. Touch-down. The floor acts at once and with full force, and stress is largest at that moment. Before a bond is
           judged, the step must end either just before the touch or just after it: in a longer step the load at its end
           would be that of a fragment that the floor has slowed already.
        3. Fracture by contact. Its loads peak within the step, so it comes before what the end of the step shows.
        4. Overload under the loads at the end, which grow evenly from the start of the step.

        A step that ends before a touch-down may still hold a fracture; a fracture always ends the step, as the pieces are
        other bodies. No bond is overloaded at its start: the crack of the step before ran until none was.
        """
        # On a bed of sediment the load of a landing grows from nothing, in sub-steps of its own.
        grounding_dt = math.inf if self.seabed else self.dt / self.model.parameters.stepping.landing_steps
        tolerance = self.dt / MAX_CRACKS_PER_STEP * EVENT_TOLERANCE
        self._checkpoint()
        trial = self._trial(h)
        too_long = (
            (grounding_dt, self._grounded_set_changed(trial)),
            (LONGEST_CONTACT_STEP, trial.contact is not None and trial.contact.first.size > 0),
            (LONGEST_SLIDING_STEP, trial.slides),
        )
        for longest, happened in too_long:
            if happened and h > longest * (1.0 + 1e-9):
                self._rollback()
                self._max_dt = min(self._max_dt, longest)
                return math.inf

        touched_down = False
        if grounding_dt < self.dt and self._touch_down(trial) > 0.0:
            first = self._any_event if may_break else self._touch_down
            trial = self._located(trial, first, tolerance)
            touched_down = self._touch_down(trial) > 0.0
        if not may_break:
            self._accept(trial)
            return math.inf

        # After a first crack the next one begins no sooner than this: a berg that shatters must not stop the clock.
        least = self.dt / MAX_CRACKS_PER_STEP if self.cracked else 0.0
        if trial.contact is not None and self._overload(self._peak_equilibrium(trial)) > 0.0:
            # Cracks by contact may follow each other as quickly as its sub-steps.
            shortest = trial.contact.shortest_substep
            # A trial of a few sub-steps ends in the middle of one: whether a body that rests was struck shows in whole ones.
            located = shortest * EVENT_TOLERANCE, min(least, shortest), FEW_SUBSTEPS * shortest
            trial = self._located(trial, self._overload_in, *located)
            if self._peak_equilibrium(trial) is not None and self._overload(self._end(trial)) <= 0.0:
                # Contact presses harder within the step than at its end: the crack runs under the peak loads.
                assert trial.contact is not None
                peak_load = self._peak_load(trial.state, trial.contact.peak_load)
                trial.state = self._in_equilibrium(trial.state._replace(load=peak_load))
            self._accept(trial, cracks=True)
            self._propagate_crack()  # from the most critical bond, if any: where contact presses has shifted a little
            return shortest  # the next crack by crushing follows soon

        if self._overload(self._end(trial)) <= 0.0:
            self._accept(trial)
            return math.inf
        first_broken = -1
        if not touched_down:  # the load of a touch-down sets in at its end, not evenly over the step
            start, end, h = self._equilibrium(self.state), self._end(trial), trial.h
            after = first_moment(
                lambda t: self._overload(self._between(start, end, t / h)),
                (0.0, self._overload(start)),
                (h, self._overload(end)),
                tolerance,
            )
            first_broken = self._critical_bond(self._between(start, end, after / h))[0]
            if (short := max(after, least)) < h * (1.0 - 1e-9):
                self._rollback()
                trial = self._trial(short)
        self._accept(trial, cracks=True)
        # In the located step the loads may fall short of those between its ends by a little: the bond that was found there
        # breaks in any case.
        self._propagate_crack(first_broken)
        return math.inf

    def _located(
        self, trial: Trial, event: Callable[[Trial], float], tolerance: float, least: float = 0.0, short: float = 0.0
    ) -> Trial:
        """Advance to shortly before an event in ``trial``, and return the trial from there to at most ``tolerance`` s after it.

        ``event`` is above 0 where a trial holds one. In the first ``least`` s none is located; trials of up to ``short`` s are
        not accepted.
        """
        # A trial without an event is as good a step as any: it is accepted, and the next ones start at its end. A berg that
        # shatters would go through the same impacts twenty times if each started where the first one did.
        done, latest = 0.0, (trial.h, trial)

        def until(t: float) -> float:
            nonlocal done, latest
            self._rollback()
            latest = t, self._trial(t - done)
            value = event(latest[1])
            if value <= 0.0 and latest[1].h > short:
                self._accept(latest[1])
                self._checkpoint()
                done = t
            return value

        before, after = (0.0, -1.0), (trial.h, event(trial))
        if 0.0 < least < trial.h:
            early = least, until(least)
            before, after = (early, after) if early[1] <= 0.0 else (before, early)
        end = after[0] if after[0] <= least else first_moment(until, before, after, tolerance)
        if latest[0] == end > done:
            return latest[1]
        self._rollback()
        return self._trial(end - done)

    def _checkpoint(self) -> None:
        """Copy what a trial step changes in the model and the next trial needs as it was; all else is found anew."""
        self._kept = [array.copy() for array in self._changed_by_trials()], self.laws.checkpoint()

    def _changed_by_trials(self) -> tuple[np.ndarray, ...]:
        el = self.el
        damage = (self.bonds.damage,) if self.model.parameters.damage.enabled else ()
        return *el.place, *el.shown, el.motion.rotation, *damage, *(el.keel if self.seabed is not None else ())

    def _rollback(self) -> None:
        """Return to the last checkpoint."""
        kept, laws = self._kept
        for array, values in zip(self._changed_by_trials(), kept, strict=True):
            array[:] = values
        self.laws.rollback(laws)

    def _accept(self, trial: Trial, cracks: bool = False) -> None:
        """Make a trial step the state: record its forces, its contacts and, unless a crack follows, its peak stresses."""
        start, end, contact, work = self.state, trial.state, trial.contact, self._workspace(trial.state.bodies)
        self.state = end
        before = self.applied[contact.rows] if contact else self.applied[:0]
        part = 0.5 * trial.h / self.dt
        middle, drag_twist = np.empty_like(start.bodies.twist), np.empty_like(start.bodies.twist)
        op, end_op = start.operators, end.operators
        accumulate_step_forces(
            op.body, op.levers, end_op.levers, op.forcing.floor_rate, end_op.forcing.floor_rate, op.matrices,
            end_op.matrices, start.terms, end.terms, start.bodies.twist, end.bodies.twist, 0.5 * trial.h, part, middle,
            drag_twist, self.applied, work,
        )  # fmt: skip
        if contact is not None:
            # In contact the impulses of all forces were summed over the sub-steps instead.
            self.applied[contact.rows] = before + contact.applied / self.dt
            self.touched.append((contact.first, contact.second))
        if not cracks:
            self._record_peaks(self._equilibrium(end), self._peak_equilibrium(trial))

    def _record_peaks(self, *moments: Equilibrium | None) -> None:
        """Record the largest stress of each bond within the time step."""
        for moment in moments:
            if moment is not None:
                record_peak_stress(self.bonds.peak_stress, self.lattice.intact, moment.stress)

    # The trial step

    def _move(self, h: float) -> Move:
        """Move the fragments over ``h`` s, and find what moves them at the new place."""
        el, c, start = self.el, self.c, self.state
        bodies, work = start.bodies, self._workspace(start.bodies)

        # Contact: fragments that may touch each other go through the step in sub-steps, island by island; then those that
        # touch a bed of sediment. ``phase`` holds what both have done; it is None where no fragment took sub-steps.
        contact, ground, slides = self._resolve_contacts_and_bed(start, h)
        phase = contact if ground is None else joined(contact, ground.motion, bodies.body)

        # Predictor: first half kick and drift. Bodies in contact drift with the mean twist of their sub-steps.
        new = bodies._replace(pose=np.empty_like(bodies.pose), twist=np.empty_like(bodies.twist))
        contact_bodies, contact_mean = (phase.bodies, phase.mean) if phase else (NO_PAIRS[0], bodies.twist[:0])
        predict(
            new, bodies, start.operators.matrices, start.operators.levers, start.terms.net_force, self.frozen_displacement,
            h, c.latlon, c.earth_radius, c.period, el.place.lon, el.place.lat, el.body.static, el.motion.rotation,
            contact_bodies, contact_mean, work,
        )  # fmt: skip
        new, ashore = self._constrained_by_land(new)

        self.model.forcing.sample(el, start.time + h)
        return Move(new, self._operators(new), ashore, contact, ground, phase, slides)

    def _trial(self, h: float) -> Trial:
        """Take a trial step of ``h`` s: the fragments at the new place with their velocities, loads and equilibrium."""
        (new, op, ashore, contact, ground, phase, slides), start = self._move(h), self.state
        bodies = start.bodies
        work, time = self._workspace(bodies), start.time + h

        # Corrector: second half kick, with the forces at the new place and time. Bodies in contact have their twists.
        twist = 2.0 * new.twist - bodies.twist  # first guess: the second half changes it as the first has done
        if ashore and phase is None:
            # Each half kick drives a body into the land that stops it.
            _stop_at_land(new.twist, op.levers, ashore)
            work.active[:] = True
            check_converged(half_kick_newton(op, new.twist, twist, 0.5 * h, work))
            _stop_at_land(twist, op.levers, ashore)
            state = self._corrected(new, op, time, twist)
        elif phase is None:
            state = self._corrected(new, op, time, twist, 0.5 * h)
        else:
            work.active[:] = True
            work.active[phase.bodies] = False
            check_converged(half_kick_newton(op, new.twist, twist, 0.5 * h, work))
            if contact is not None:
                afloat = contact if ground is None else without(contact, ground.motion.bodies, bodies.body)
                twist, phase = trapezoidal_correction(afloat, start.operators, op, twist, h)
            if ground is not None:
                twist[ground.motion.bodies] = ground.motion.twist
                phase = joined(phase if contact else None, ground.motion, bodies.body)
            _stop_at_land(twist, op.levers, ashore)
            state = self._corrected(new, op, time, twist)

        state = self._in_equilibrium(state)
        if self.model.parameters.damage.enabled:
            # By the equilibrium in the middle of the step (explicit midpoint rule).
            lattice, c, displacement = self.lattice, self.c, 0.5 * (bodies.displacement + state.bodies.displacement)
            middle = lattice.moment(displacement, 0.5 * (start.load + state.load), c)
            drive = lattice.criterion.damage_drive(middle, lattice.strengths(self.bonds, c))
            grow_damage(self.bonds, lattice.intact, drive, h, c)
        return Trial(h, state, phase, slides)

    def _resolve_contacts_and_bed(
        self, start: BodyState, h: float
    ) -> tuple[ContactPhase | None, GroundPhase | None, bool]:
        """Take fragments through contact and over a bed of sediment; the third value is that of `Move.slides`.

        What stands on the bed is held while others press it, unless it turns out to slide then: it goes through the contact as
        if it were afloat, and over the bed with the mean force, in steps in which friction takes little of its speed.
        """
        none = NO_PAIRS[0]
        if self.seabed is None:
            return self._resolve_contacts(start, h, none), None, False
        memory, keel = self.laws.checkpoint(), [array.copy() for array in self.el.keel]
        contact = self._resolve_contacts(start, h, none)
        ground = self._run_aground(start, h, contact)
        if contact is None or ground is None:
            return contact, ground, False
        both, of_contact, of_floor = np.intersect1d(contact.bodies, ground.motion.bodies, return_indices=True)
        struck = np.isin(both, bodies_that_are_struck(contact, start.operators, start.bodies.twist))
        pushed, gone = h * contact.mean[of_contact, :2], h * ground.motion.mean[of_floor, :2]
        if h > LONGEST_SLIDING_STEP * (1.0 + 1e-9):
            # The mean force of an impact in a long step is small, but what it does to a fragment that is held shows.
            rests = np.hypot(*start.bodies.twist[both, :2].T) < AT_REST
            too_long = np.hypot(*np.where(rests[:, None], pushed, pushed - gone).T) > np.where(rests, YIELDS, PARTED)
            return contact, ground, bool((struck & too_long).any())
        slides = both[struck & (np.hypot(*gone.T) > self.seabed.bed.anchor_way)]
        if slides.size:
            self.laws.rollback(memory)
            for array, values in zip(self.el.keel, keel, strict=True):
                array[:] = values
            contact = self._resolve_contacts(start, h, slides)
            ground = self._run_aground(start, h, contact)
        return contact, ground, bool(slides.size)

    def _run_aground(self, start: BodyState, h: float, contact: ContactPhase | None) -> GroundPhase | None:
        """Take the fragments that touch a bed of sediment within ``h`` s through sub-steps, up to what it does at the end."""
        if self.seabed is None:
            return None
        ground = self.seabed.resolve(self.model, start.bodies, start.operators, start.time, h, contact)
        for n, array in enumerate(self.el.keel):
            array[:] = 0.0 if ground is None else ground.keel[n]
        self.bonds.flexural_stress[:] = 0.0 if ground is None else ground.flexure
        return ground

    def _resolve_contacts(self, start: BodyState, h: float, slides: Ints) -> ContactPhase | None:
        """Take the fragments that may touch each other within ``h`` s through sub-steps; the bed does not hold ``slides``."""
        bodies = start.bodies
        if self.faces is None or bodies.pose.shape[0] < 2 or not self.c.interactions:
            return None
        op = (
            start.operators
            if self.seabed is None
            else self.seabed.held_in_contact(self.model, start.operators, bodies.twist, slides)
        )
        try:
            return self.faces.resolve(self.model, bodies, op, h, self.sizes)
        except FloatingPointError:
            raise RunError(
                f"the velocities of bergs in contact did not converge at {self.model.date:%Y-%m-%d %H:%M}"
            ) from None

    def _constrained_by_land(self, bodies: Bodies) -> tuple[Bodies, list[Ashore]]:
        """Find the cells of the elements; where land stops one, its fragment is put back, with those in its way."""
        el, c, grid, ashore = self.el, self.c, self.model.forcing.grid, []
        for n in range(5):  # a correction may lead onto other land
            if grid is None:
                break
            if n > 0:
                place_elements(
                    bodies._replace(displacement=self.frozen_displacement), el.lon, el.lat, el.static, c.latlon,
                    c.earth_radius, c.period,
                )  # fmt: skip
            lon, lat = el.lon.copy(), el.lat.copy()
            settle_elements(el, grid.arrays, c)
            correction = land_corrections(el, lon, lat, c)
            if not correction.any():
                break
            if self.faces is None:  # nobody may touch another
                find_near = partial(find_near_circles, el, lon, lat, bodies.body, c)
            else:
                find_near = partial(self.faces.find_near, self.model, bodies, lon, lat, None)
            leading = leading_elements(correction, bodies.body, find_near)
            bodies = bodies._replace(pose=corrected_poses(bodies.pose, el, lon, lat, leading, c))
            stopped = np.flatnonzero(leading >= 0)
            own = bodies.body[leading[stopped]] == stopped
            ashore.append(Ashore(stopped, leading[stopped], own, correction[leading[stopped]]))
        self._publish_positions(bodies)
        return bodies, ashore

    def _publish_positions(self, bodies: Bodies) -> None:
        """Let fragments see each other as they are without load."""
        # A slender piece bends by more than its contact is pressed in, and displacements lag by one step: seen bent, it
        # came out of contact in one step and deeper into it in the next.
        el, c = self.el, self.c
        el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
        if bodies.pose.shape[0] > 1:
            undeformed = bodies._replace(displacement=np.zeros_like(bodies.displacement))
            place_elements(undeformed, el.lon_pair, el.lat_pair, el.static, c.latlon, c.earth_radius, c.period)

    def _operators(self, bodies: Bodies) -> BodyOperators:
        """Find what moves the fragments, from the environment that the elements carry."""
        el, c = self.el, self.c
        op = assemble_operators(el, self.sizes, bodies, c, self._workspace(bodies))
        for b, inside in self._supported(bodies):
            # Fragments with supports move only as these allow: Z (Z^T M Z)^-1 Z^T in place of M^-1.
            z = self.lattice.supports.rigid_modes(inside, self.lattice.xy)
            op.matrices.mobility[b] = z @ np.linalg.solve(z.T @ op.matrices.inertia[b] @ z, z.T) if z.size else 0.0
        return op

    def _supported(self, bodies: Bodies) -> list[tuple[int, Ints]]:
        """Fragments with supports, and their elements."""
        if not self.lattice.supports.any:
            return []
        supported = np.unique(bodies.body[(self.el.static >= 0.5) | (self.el.free_y < 0.5)])
        return [(int(b), np.flatnonzero(bodies.body == b)) for b in supported]

    def _corrected(
        self, bodies: Bodies, op: BodyOperators, time: float, twist: Floats, half_dt: float = 0.0
    ) -> BodyState:
        """Forces and loads at ``twist``; with ``half_dt`` it is a first guess, and the second half kick is taken before."""
        el, count = self.el, self.el.size
        terms = ForceTerms(np.zeros((count, len(FORCES), 2)), np.zeros_like(twist))
        force, load, sums = np.empty((count, 3)), np.empty((count, 3)), np.empty((twist.shape[0], 7))
        iterations = correct(
            op, bodies.twist, twist, half_dt, half_dt > 0.0, self.lattice.xy, terms, force, load, el.motion, el.shown,
            el.kicks.spin_rate, sums, self._workspace(bodies),
        )  # fmt: skip
        check_converged(iterations)
        if self.seabed is not None:
            # The floor loads the lattice, but is no part of the forces by which the next step begins.
            keel = el.keel
            force += np.column_stack([keel.floor_x, keel.floor_y, keel.floor_torque])
            op.forcing.aground[:] = keel.floor_load > 0.0
        if self.faces is not None and self.faces.pairs.pair.size:
            force += self.faces.force(self.model)
        if self.seabed is not None or (self.faces is not None and self.faces.pairs.pair.size):
            axes, forcing = op.levers[:, 9:11], op.forcing
            load = balanced_loads(
                bodies.body, self.lattice.xy, axes, force, forcing.mass, forcing.inertia, twist[:, 2].copy()
            )
        state = BodyState(time, bodies._replace(twist=twist), op, terms, force, load)
        self._set_supported_loads(state, load, op.levers[:, 9:11], force)
        return state

    def _state_at(self, bodies: Bodies, time: float) -> BodyState:
        """Forces and loads where the bodies are."""
        return self._corrected(bodies, self._operators(bodies), time, bodies.twist)

    def _set_supported_loads(self, state: BodyState, balanced: Floats, turn: Floats, force: Floats) -> None:
        """Replace the loads of fragments with supports, which carry a part of them, in those of free fragments."""
        lattice, forcing = self.lattice, state.operators.forcing
        for _, inside in self._supported(state.bodies):
            z = lattice.supports.rigid_modes(inside, lattice.xy)
            balanced[inside] = _supported_loads(inside, z, lattice.xy, turn, force, forcing.mass, forcing.inertia)

    def _in_equilibrium(self, state: BodyState) -> BodyState:
        """Return the state with the displacements of the equilibrium under its loads."""
        bodies, count = state.bodies, state.bodies.pose.shape[0]
        displacement = self.lattice.solver.solve(state.load)
        supported = np.zeros(count, np.bool_)
        for b, _ in self._supported(bodies):
            supported[b] = True
        finite = remove_rigid_modes(
            bodies.body, self.lattice.xy, displacement, bodies.displacement, self.el.rotation, state.operators.forcing,
            supported, np.empty((count, 3)), np.empty((count, 4)),
        )  # fmt: skip
        if not finite:
            raise RunError(f"the equilibrium of the lattice is not a number at {self.model.date:%Y-%m-%d %H:%M}")
        return state._replace(bodies=bodies._replace(displacement=displacement))

    # Events

    def _overload(self, moment: Equilibrium | None) -> float:
        """Sign function of fracture: stress over strength in the most critical place, less 1; negative without a moment."""
        return -1.0 if moment is None else self._critical_bond(moment)[1] - 1.0

    def _overload_in(self, trial: Trial) -> float:
        """Sign function of fracture in a trial, by contact on the way or under the loads at its end."""
        return max(self._overload(self._peak_equilibrium(trial)), self._overload(self._end(trial)))

    def _touch_down(self, trial: Trial) -> float:
        """Sign function of touch-down: above 0 where an element touches the floor that did not at the start."""
        # A step and no slope: on a shoal the first to touch may be any of many.
        now, before = trial.state.operators.forcing.aground, self.state.operators.forcing.aground
        # Afloat, as nearly always, the bytes are the same, and compared quickly.
        return 1.0 if now.tobytes() != before.tobytes() and ((now > 0.0) & (before == 0.0)).any() else -1.0

    def _grounded_set_changed(self, trial: Trial) -> bool:
        """Whether an element has touched down, or come off."""
        now, before = trial.state.operators.forcing.aground, self.state.operators.forcing.aground
        return now.tobytes() != before.tobytes() and bool(((now > 0.0) != (before > 0.0)).any())

    def _any_event(self, trial: Trial) -> float:
        """Sign function of all events."""
        return max(self._touch_down(trial), self._overload_in(trial))

    def _end(self, trial: Trial) -> Equilibrium:
        """Return the equilibrium at the end of a trial."""
        return self._equilibrium(trial.state)

    def _between(self, start: Equilibrium, end: Equilibrium, share: float) -> Equilibrium:
        """Return the equilibrium at a part of a trial: loads change linearly from start to end, and displacements with them."""
        displacement = start.displacement + share * (end.displacement - start.displacement)
        return self.lattice.moment(displacement, start.load + share * (end.load - start.load), self.c)

    def _peak_equilibrium(self, trial: Trial) -> Equilibrium | None:
        """Return the equilibrium under the peak contact loads of a trial; None where no bonded fragment was touched."""
        contact, lattice = trial.contact, self.lattice
        if contact is None or not contact.peak_load.rows.size:
            return None
        if trial.peak is None:
            load = self._peak_load(trial.state, contact.peak_load)
            trial.peak = lattice.moment(lattice.solver.solve(load), load, self.c)
        return trial.peak

    def _peak_load(self, state: BodyState, peak: PeakContactLoad) -> Floats:
        """Balanced loads at the end of a trial, those of the touched fragments at the moment of their peak contact load."""
        forcing, lattice = state.operators.forcing, self.lattice
        force, axes, spin = scatter_peak_load(peak, self.el.size, state.bodies.pose.shape[0])
        at_peak = balanced_loads(state.bodies.body, lattice.xy, axes, force, forcing.mass, forcing.inertia, spin)
        self._set_supported_loads(state, at_peak, axes, force)
        load = state.load.copy()
        load[peak.rows] = at_peak[peak.rows]
        return load

    # Fracture

    def _propagate_crack(self, first: int = -1) -> None:
        """Break bonds under fixed loads until none is overloaded: a crack runs faster than the loads change.

        The most critical bond breaks, then the next one in the equilibrium without it. ``first`` (a row of the state)
        begins in any case where none is overloaded.
        """
        now = self._equilibrium(self.state)
        self._store(now)
        bond, ratio = self._critical_bond(now)
        bond = bond if ratio > 1.0 else first
        if bond < 0:
            return
        bond = self._bond_on_path(now, bond)
        self.cracked, first_broken, area = True, bond, 0.0
        energy = elastic_energy(self.state.bodies.displacement, self.state.load)
        while True:
            area += self._facet_area(bond)
            self.bonds.break_strength[bond] = self._exceeded(now, bond)
            self._break_bond(bond)
            now = self._equilibrium(self.state)
            bond, ratio = self._critical_bond(now)
            if ratio <= 1.0:
                break
            # What the last bonds bear while a crack runs through them is no stress that the ice has borne.
            bond = self._bond_on_path(now, bond)
        self.bonds.released_energy[first_broken] = energy - elastic_energy(
            self.state.bodies.displacement, self.state.load
        )
        self.bonds.cracked_area[first_broken] = area
        self._renumber()
        self._record_peaks(self._equilibrium(self.state))

    def break_under(self, peak: PeakContactLoad) -> Floats:
        """Break what is overloaded where peak contact loads come to those of the state; returns the stress before (Pa)."""
        load, of_peak = self.state.load.copy(), self._peak_load(self.state, peak)
        load[peak.rows] += of_peak[peak.rows]
        self.state = self._in_equilibrium(self.state._replace(load=load))
        stress = np.zeros(self.bonds.first.size)
        stress[self.lattice.intact] = self._equilibrium(self.state).stress[:, 0]
        self._propagate_crack()
        return stress

    def _equilibrium(self, state: BodyState) -> Equilibrium:
        """Return the equilibrium of a state."""
        return self.lattice.equilibrium(state.bodies.displacement, state.load, self.c)

    def _critical_bond(self, moment: Equilibrium) -> tuple[int, float]:
        """Row in the state of the bond that breaks next (-1 without bonds), and stress over strength: above 1 it breaks."""
        row, ratio = self.lattice.criterion.most_critical(moment, self.lattice.strengths(self.bonds, self.c))
        bent, most_bent = self._most_bent(moment.intact)
        if most_bent > max(ratio, 1.0):
            return bent, most_bent
        return (int(moment.intact[row]) if row >= 0 else -1), ratio

    def _most_bent(self, intact: Ints) -> tuple[int, float]:
        """Row in the state of the bond that bending on the sea floor breaks next, and stress over its flexural strength."""
        if self.model.parameters.fracture.flexural_strength is None or not intact.size:
            return -1, 0.0
        ratio = self._bending_ratios(intact)
        return int(intact[ratio.argmax()]), float(ratio.max())

    def _bending_ratios(self, intact: Ints) -> Floats:
        """Bending stress over flexural strength of some bonds; 0 where bending breaks nothing."""
        bonds, strength = self.bonds, self.model.parameters.fracture.flexural_strength
        if strength is None:
            return np.zeros(intact.size)
        left = strength * bonds.strength[intact] * (1.0 - bonds.damage[intact])
        stress = bonds.flexural_stress[intact]
        return np.where(left > 0.0, stress / np.where(left > 0.0, left, 1.0), np.where(stress > 0.0, np.inf, 0.0))

    def _exceeded(self, now: Equilibrium, bond: int) -> int:
        """Which strength a bond exceeds most: normal, shear or flexural."""
        row, bonds = int(np.searchsorted(now.intact, bond)), self.bonds
        left = self.lattice.strengths(bonds, self.c)
        ratios = [
            stress_ratio(now.stress[row, 0], 0.0, left.normal[row], left.shear[row]),
            stress_ratio(0.0, now.stress[row, 1], left.normal[row], left.shear[row]),
            self._bending_ratios(now.intact[row : row + 1])[0],
        ]
        return (NORMAL, SHEAR, FLEXURAL)[int(np.argmax(ratios))]

    def _bond_on_path(self, now: Equilibrium, failing: int) -> int:
        """Return the bond that breaks where one fails: with elastic cells the next one on the way of a crack line."""
        paths, bonds = self.lattice.paths, self.bonds
        if paths is None or self._exceeded(now, failing) == FLEXURAL:  # bending says itself along which line
            return failing
        row = int(np.searchsorted(now.intact, failing))
        strengths = self.lattice.strengths(bonds, self.c)
        ratio, strength = np.zeros(bonds.first.size), np.zeros(bonds.first.size)
        ratio[now.intact], strength[now.intact] = overloads(now.stress, strengths), strengths.normal
        last = row in now.bridges
        return paths.next_bond(failing, last, now.tensor[row], now.triangle_stress, ratio, strength)

    def _facet_area(self, bond: int) -> float:
        """Area (m2) of the section of a bond: with elastic cells of the side along which its cells meet."""
        lattice, cells = self.lattice.lattice, self.lattice.cells
        return (
            float(lattice.width[bond] * lattice.thickness[bond]) if cells is None else cells.facet_area(lattice, bond)
        )

    def _break_bond(self, bond: int) -> None:
        """Break one bond and find the equilibrium without it, with new bodies where a piece has parted."""
        el, bonds, lattice, state, c = self.el, self.bonds, self.lattice, self.state, self.c
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
            frozen = self.frozen_displacement
            el.rotation[:] += frozen[:, 2] - state.bodies.displacement[:, 2]
            bodies = split_bodies(
                state.bodies._replace(displacement=frozen), body, state.operators.forcing.mass, c.latlon, c.earth_radius
            )
            self.frozen_displacement = bodies.displacement
            self.lattice = self._factored_lattice(bodies, self.tips)
            self._publish_positions(bodies)
            self.state = self._state_at(bodies, state.time)
        elif lattice.solver.update_rank >= MAX_LOW_RANK_UPDATES:
            self.lattice = self._factored_lattice(state.bodies, self.tips)
        else:
            lattice.solver.downdate(bond)
            lattice.intact, lattice.fresh = lattice.intact[lattice.intact != bond], False
        self.state = self._in_equilibrium(self.state)

    def _renumber(self) -> None:
        """Number the fragments anew, and start from fresh factors, which a restarted run has too."""
        model, el, bonds = self.model, self.el, self.bonds
        if self.c.broken_as_contact:
            drop_parted_bonds(bonds, connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status))
        else:
            drop_broken_bonds(bonds)
        model.fragments.update(el, bonds, self.state.time, self.c)
        if not self.lattice.fresh:  # the last break has parted pieces, as most do at which a crack ends
            self.lattice = self._factored_lattice(self.state.bodies, self.tips)
        self.state = self._state_at(self.state.bodies, self.state.time)

    # Set-up and output

    def _twists_of_elements(self, bodies: Bodies) -> Floats:
        """Return the rigid motions nearest to the velocities of the elements: those of the same momentum."""
        el, op = self.el, self._operators(bodies)
        m, mass, inertia = op.levers, op.forcing.mass, op.forcing.inertia
        momentum = mass[:, None] * (m[:, 0:3] * el.u[:, None] + m[:, 3:6] * el.v[:, None])
        momentum += (inertia * el.spin)[:, None] * m[:, 6:9]
        sums = np.array([np.bincount(bodies.body, momentum[:, k], bodies.pose.shape[0]) for k in range(3)]).T
        return np.asarray((op.matrices.mobility @ sums[:, :, None])[:, :, 0])

    def _workspace(self, bodies: Bodies) -> BodyWorkspace:
        """Return a workspace for the fragments."""
        if self.work is None or self.work.residual.shape != bodies.twist.shape:
            self.work = allocate_body_workspace(bodies.pose.shape[0])
        return self.work

    def _factored_lattice(self, bodies: Bodies, tips: CrackTips) -> FactoredLattice:
        """Describe and factor the lattice of the intact bonds."""
        el, bonds, c = self.el, self.bonds, self.c
        xy = tangent_coordinates(bodies.reference, c.latlon, c.earth_radius)
        lattice = find_lattice(bonds, xy, el.thickness, self.sizes, c)
        intact = np.flatnonzero(bonds.status == 0)
        supports = Supports(el.static, el.free_y)
        gauge_springs = supports.gauge_springs(bodies.body, xy)
        cells: CellStiffness | None = None
        solver: Callable[..., StiffnessSolver] = StiffnessSolver
        if self.model.parameters.elastic_cells and intact.size:
            self.cells = with_new_cells(self.cells, el, bonds, (), c)
            cells = CellStiffness(self.cells, el, bonds, bodies.body, xy, c, self.topology)
            self.topology = cells.topology
            solver = partial(CellSolver, cells)
        criterion = criterion_for(self.model.parameters.fracture, intact, cells, self.model.laws.fracture)
        factors = solver(lattice, intact, supports, gauge_springs)
        found = FactoredLattice(xy, lattice, intact, supports, factors, criterion, cells)
        if cells is not None:
            found.paths = self._crack_paths(tips, bodies, found)
        return found

    def _crack_paths(self, tips: CrackTips, bodies: Bodies, lattice: FactoredLattice) -> CrackPaths:
        """Where the tips of cracks stand in the fragments."""
        assert lattice.cells is not None
        return CrackPaths(tips, self.bonds, self.el.body.id, bodies.body, lattice.xy, lattice.cells, self._last_crack)

    def _store(self, now: Equilibrium) -> None:
        """Write stresses and deformations to the state."""
        store_stresses(self.bonds, now.lattice, now.intact, now.deformation, now.stress, self.state.operators.levers)


def first_bodies(el: Elements, bonds: Bonds, p: KernelParameters) -> Bodies:
    """Make bodies of the elements as they are, taken to be free of load."""
    body = connected_parts(el.size, bonds.first, bonds.second, bonds.status)
    return bodies_from_elements(el.lon, el.lat, body, el.mass, p.latlon, p.earth_radius, p.period)


BREAK_NAMES = ("status", "break_time", "break_grounded", "break_strength", "released_energy", "cracked_area")
"""What a break leaves in the bonds."""


def break_under_impact(
    model: RunState, bodies: Bodies, peak: PeakContactLoad, faces: FaceContact
) -> tuple[int, Floats]:
    """Break the bonds that do not bear an impact; returns their number, and the stress (Pa) of all under it.

    For schemes whose lattices oscillate: all but the bonds, and the numbers of the fragments, stays as it is. ``bodies``: the
    fragments where the impact finds them; its forces come to those of the media.
    """
    el, bonds, pairs = model.elements, model.bonds, faces.pairs
    kept = [(array, array.copy()) for group in (el.motion, el.shown, el.kicks) for array in group]
    kept += [(array, array.copy()) for name, array in bonds.arrays().items() if name not in BREAK_NAMES]
    before = int(np.count_nonzero(bonds.status))
    faces.pairs = NO_FACE_PAIRS  # what presses before the impact is over is a part of its largest force
    step = TimeStep(model, bodies, laws=LawsWithMemory(None, faces))
    faces.pairs = pairs
    stress = step.break_under(peak)
    for array, values in kept:
        array[:] = values
    return int(np.count_nonzero(bonds.status)) - before, stress


@dataclass
class FactoredLattice:
    """The lattice between two breaks, with its factors and what decides that its bonds break."""

    xy: Floats  # Reference coordinates of the elements in their fragments, m; shape (elements, 2)
    lattice: ElasticLattice
    intact: Ints  # As rows of the state
    supports: Supports
    solver: StiffnessSolver
    criterion: Criterion
    cells: CellStiffness | None = None  # Where the ice is elastic in cells; else along its bonds
    paths: CrackPaths | None = None  # Of cracks through elastic cells
    fresh: bool = True  # No bond has broken since it was factored
    _latest: Equilibrium | None = None
    _strengths: tuple[tuple[int, bytes, bytes], Strengths] | None = None

    def strengths(self, bonds: Bonds, p: KernelParameters) -> Strengths:
        """Return the residual strengths of the intact bonds, found anew where strength or damage has changed."""
        key = self.intact.size, bonds.strength.tobytes(), bonds.damage.tobytes()
        if self._strengths is None or self._strengths[0] != key:
            self._strengths = key, residual_strengths(bonds, self.intact, p)
        return self._strengths[1]

    def equilibrium(self, displacement: Floats, load: Floats, p: KernelParameters) -> Equilibrium:
        """Return the equilibrium with these displacements; the latest is cached, so that its stresses are found once."""
        latest, intact = self._latest, self.intact
        if latest and latest.displacement is displacement and latest.load is load and latest.intact is intact:
            return latest
        self._latest = self.moment(displacement, load, p)
        return self._latest

    def moment(self, displacement: Floats, load: Floats, p: KernelParameters) -> Equilibrium:
        """Return an equilibrium of any moment."""
        return Equilibrium(self.lattice, self.intact, displacement, load, p, self.cells, self.paths)


def first_moment(
    value: Callable[[float], float], before: tuple[float, float], after: tuple[float, float], tolerance: float
) -> float:
    """Find the first moment at which ``value`` is above 0, to ``tolerance`` (s): the end of the bracket, just after it.

    ``before`` and ``after``: the ends of a bracket, and the values there. By the ITP method (Oliveira and Takahashi 2020,
    doi:10.1145/3423597): the secant through both ends, moved towards the middle, and never so far from it that bisection would
    need more than one evaluation less. Values may jump, as the sea floor and other fragments act from one moment to the next;
    of signs alone it makes bisection.
    """
    (a, low), (b, high), width = before, after, after[0] - before[0]
    most = math.ceil(math.log2(max(width / tolerance, 1.0))) + 1  # one more than bisection
    for n in range(most):
        if b - a <= tolerance:
            break
        low, high, middle = max(-1.0, low), min(high, 1.0), 0.5 * (a + b)  # without ice or strength they are infinite
        from_secant = middle - (a * high - b * low) / (high - low)
        away = max(abs(from_secant) - 0.2 / width * (b - a) ** 2, 0.0)
        away = min(away, max(0.5 * tolerance * 2.0 ** (most - n) - 0.5 * (b - a), 0.0))
        t = middle - math.copysign(away, from_secant)
        now = value(t)
        if now > 0.0:
            b, high = t, now
        else:
            a, low = t, now
    return b


def _supported_loads(
    inside: Ints, z: Floats, xy: Floats, turn: Floats, force: Floats, mass: Floats, inertia: Floats
) -> Floats:
    """Loads on a fragment with supports: forces less what moves it in the rigid motions ``z`` that they allow."""
    c, s, f, m = turn[inside, 0], turn[inside, 1], force[inside], mass[inside]
    load = np.column_stack([c * f[:, 0] + s * f[:, 1], c * f[:, 1] - s * f[:, 0], f[:, 2]])
    if not z.size:
        return load
    x, y = xy[inside].T
    one, none = np.ones(inside.size), np.zeros(inside.size)
    rows = np.stack([np.array([one, none, -y]), np.array([none, one, x]), np.array([none, none, one])])
    weight = np.stack([m, m, inertia[inside]])
    matrix = np.einsum("ran,rn,rbn->ab", rows, weight, rows)
    sums = np.einsum("ran,nr->a", rows, load)
    acceleration = z @ np.linalg.solve(z.T @ matrix @ z, z.T @ sums)
    return np.asarray(load - (weight * np.einsum("ran,a->rn", rows, acceleration)).T)
