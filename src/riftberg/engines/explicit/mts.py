"""Multiple-time-step velocity Verlet: outer half kick, sub-steps of the bonds, outer half kick (equations 6.4)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import borrower, stage
from riftberg.engines.common.broad_phase import (
    NO_PAIRS,
    NeighbourSearch,
    candidate_pairs,
    concatenate_pairs,
    contact_cells,
    contact_groups,
    contact_rows,
    group_substeps,
    with_partners,
)
from riftberg.engines.common.forces.media import Surroundings, allocate_surroundings, find_surroundings
from riftberg.engines.common.forces.pair_law import NeighbourLists, pair_law
from riftberg.engines.common.forces.sizes import Sizes, interaction_sizes
from riftberg.engines.common.fragments.connectivity import break_after_step
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.stepper import (
    Stateless,
    apply_boundaries,
    publish_positions,
    sample_between_steps,
    update_fragments,
)
from riftberg.engines.explicit.beams import take_substeps_of_beams
from riftberg.engines.explicit.contact import OTHER_BERGS, TOUCHED, allocate_pairs, pairs_from_list
from riftberg.engines.explicit.springs import take_substeps_of_springs
from riftberg.engines.explicit.substeps import (
    POLAR_LATITUDE,
    OuterWorkspace,
    StepPlan,
    Workspace,
    allocate_outer_workspace,
    allocate_workspace,
    first_half_kick,
    second_half_kick,
)
from riftberg.errors import RunError
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import SAME_BERG, no_pairs
from riftberg.state.population import cut_out, listed, put_back


class Batch:
    """Bergs that take the same number of sub-steps: all of a run, or a copy of some of them."""

    def __init__(self, run: RunState, rows: Ints | None) -> None:
        self.rows = rows
        # Rows that follow one another are views into the state; others are copied out and back.
        self._block = None if rows is None or rows[-1] - rows[0] + 1 != rows.size else slice(rows[0], rows[-1] + 1)
        self._bond_rows: Ints = np.zeros(0, np.int64)
        self.near = NeighbourSearch()
        self._inside = 0
        self.gather(run)
        self.work = allocate_workspace(self.elements, self.bonds, run.constants)

    def gather(self, run: RunState) -> None:
        """Copy its elements and bonds from the state of a run."""
        if self.rows is None:
            self.elements, self.bonds = run.elements, run.bonds
        else:
            self.elements, self.bonds, self._bond_rows = cut_out(run.elements, run.bonds, self.rows, self._block)

    def surroundings(self, of_all: Surroundings) -> Surroundings:
        """Return the forces on its elements."""
        if self.rows is None:
            return of_all
        rows = self.rows if self._block is None else self._block
        return Surroundings(
            **{name: values if name == "acts" else values[rows] for name, values in of_all._asdict().items()}
        )

    def scatter(self, run: RunState, surroundings: Surroundings, all_surroundings: Surroundings) -> None:
        """Copy its elements and bonds, and the forces that were applied, back to the run."""
        if self.rows is not None:
            put_back(run.elements, run.bonds, self.rows, self._bond_rows, self.elements, self.bonds, self._block)
            if self._block is None:
                all_surroundings.applied[self.rows] = surroundings.applied

    def add_candidates(self, first: Ints, second: Ints) -> None:
        """List the pairs of different bergs that may come into contact, behind those inside bergs."""
        pairs = self.work.pairs
        used = int(pairs.used[0])
        self._inside = used
        if self.rows is not None:
            position = np.full(int(max(self.rows.max(), first.max(initial=0), second.max(initial=0))) + 1, -1, np.int64)
            position[self.rows] = np.arange(self.rows.size)
            inside = position[first] >= 0
            first, second = position[first[inside]], position[second[inside]]
        if first.size == 0:
            return
        # Bonds that break in the sub-steps are listed behind them.
        if used + first.size + self.bonds.first.size > pairs.first.size:
            bigger = allocate_pairs(2 * (used + first.size + self.bonds.first.size))
            for old, new in zip(pairs[:3], bigger[:3], strict=True):
                new[:used] = old[:used]
            self.work = self.work._replace(pairs=bigger)
            pairs = bigger
        block = slice(used, used + first.size)
        pairs.first[block], pairs.second[block], pairs.bond[block] = first, second, OTHER_BERGS
        pairs.used[0] = used + first.size

    def touched(self) -> tuple[Ints, Ints]:
        """Return the rows (of the run) of the pairs of different bergs that have touched in the sub-steps."""
        pairs = self.work.pairs
        count = int(pairs.used[0])
        k = np.flatnonzero(pairs.bond[self._inside : count] == TOUCHED) + self._inside
        first, second = pairs.first[k], pairs.second[k]
        return (first, second) if self.rows is None else (self.rows[first], self.rows[second])

    def of_all(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of its elements."""
        return values if self.rows is None or values.size == 0 else values[self.rows]


class MultipleStepper(Stateless):
    """Multiple time steps (equations 6.4).

    The outer kicks are those of all bergs together. The sub-steps concern each group of bergs that may meet in the step
    and are taken by batches of groups that have the same number of them. Bergs collide in the sub-steps, or with
    ``contact.on_substeps`` off in the outer kicks.
    """

    def __init__(self, run: RunState) -> None:
        c = run.constants
        self._near = NeighbourSearch()
        self._cells = contact_cells(run.parameters, run.forcing.grid)
        self._around = allocate_surroundings(run.elements.size)
        self._touched = NO_PAIRS
        self._batches: list[Batch] = []
        self._batch_key: tuple[int, bytes] | None = None
        self._needs_rank = c.shared_shear_lever or c.bond_thickness_of_second
        self._contact_by_bonds = c.dem and c.broken_as_contact and c.fracture_on_substeps

    def step(self, run: RunState) -> None:
        """Advance by one long step."""
        el, bonds, c, dt = run.elements, run.bonds, run.constants, run.parameters.time_step
        publish_positions(el)
        sizes = interaction_sizes(el, c)
        # Two quirks make the bonds of the reference depend on which end it processes first.
        rank = _processing_rank(run) if self._needs_rank and not _uniform(run) else np.arange(el.size)
        # Partners of the outer kicks by the positions now; the sub-steps look for theirs farther ahead.
        outer = self._collisions(run, sizes)

        # Broad phase: pairs that may meet in the step.
        candidates = candidate_pairs(el, el.berg, sizes, dt, c) if c.contact_on_substeps else NO_PAIRS
        # Bergs that may meet take the same number of sub-steps, the largest of them.
        substeps = group_substeps(run, sizes, *candidates)
        batches = self._split_into_batches(run, substeps)
        for batch in batches:
            self._gather_pairs(batch, dt, c)
            batch.add_candidates(*candidates)
        inner = [self._inner_partners(batch, batch.of_all(outer.group), run) for batch in batches]
        plan = self._plan(run)
        # Elements were born or have gone since the last step.
        if self._around.coriolis.size != el.size:
            self._around = allocate_surroundings(el.size)

        # Outer kicks and sub-steps: in one call where all bergs take the same number of sub-steps.
        if batches[0].rows is None:
            plan = plan._replace(substeps=int(substeps[0]))
            report = take_long_step(el, bonds, batches[0].work, outer, inner[0], sizes, self._around, rank, plan, c)
            self._check_converged(report, run)
            broken = report.broken
        else:
            broken = self._step_in_batches(run, batches, outer, inner, sizes, rank, substeps, plan)
        if plan.starting:
            # A proper start has the second of the two half kicks alone; what acts in the sub-steps acts all the time.
            in_kicks = np.append(self._around.acts, True)
            self._around.applied[:, in_kicks] *= 0.5
        self._touched = concatenate_pairs(
            [contact_rows(el, outer.collision, sizes, c), *(batch.touched() for batch in batches)]
        )

        # Positions have moved: land, cells, then the forcing of the next step, then fragments.
        apply_boundaries(run)
        run.time += dt
        self.sample_forcing(run)
        if broken > 0:
            update_fragments(run)

    def _step_in_batches(
        self, run: RunState, batches: list[Batch], outer: NeighbourLists, inner: list[NeighbourLists], sizes: Sizes,
        rank: Ints, substeps: Ints, plan: StepPlan,
    ) -> int:  # fmt: skip
        """Apply the outer kicks to all, and take the sub-steps of each batch for itself; returns the number of bonds broken."""
        c = run.constants
        work = batches[0].work  # the outer forces need none
        outer_only = plan._replace(apply_inner=False)
        report = take_long_step(run.elements, run.bonds, work, outer, outer, sizes, self._around, rank, outer_only, c)
        self._check_converged(report, run)
        broken = report.broken
        for batch, partners in zip(batches, inner, strict=True):
            batch.gather(run)  # anew, since the kicks have changed the state
            members, surroundings = batch.elements, batch.surroundings(self._around)
            inner_only = plan._replace(substeps=int(batch.of_all(substeps)[0]), apply_outer=False)
            report = take_long_step(
                members, batch.bonds, batch.work, partners, partners, interaction_sizes(members, c), surroundings,
                batch.of_all(rank), inner_only, c,
            )  # fmt: skip
            batch.scatter(run, surroundings, self._around)
            self._check_converged(report, run)
            broken += report.broken
        return broken

    @staticmethod
    def _check_converged(report: StepReport, run: RunState) -> None:
        if report.iterations < 0:
            raise RunError(
                f"the contact iteration did not settle within {run.constants.max_iterations} passes at "
                f"{run.date:%Y-%m-%d %H:%M}; raise contact.tolerance or shorten stepping.time_step"
            )

    def sample_forcing(self, run: RunState) -> None:
        """See `riftberg.engines.common.stepper.Stepper.sample_forcing`."""
        sample_between_steps(run, run.elements)

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Complete the outer half kick that the next step begins with, on a copy of the elements."""
        c = run.constants
        el = run.elements.copy()
        sizes = interaction_sizes(el, c)
        outer, surroundings = self._collisions(run, sizes), allocate_surroundings(el.size)
        # The kernel of the step, so that none is compiled for this alone; no sub-steps are taken that would need a workspace.
        work = self._batches[0].work if self._batches else allocate_workspace(el, run.bonds, c)
        plan = self._plan(run)._replace(starting=False, skip_outer=False, apply_inner=False, sync_only=True)
        report = take_long_step(el, run.bonds, work, outer, outer, sizes, surroundings, np.arange(el.size), plan, c)
        return (el.u_sync, el.v_sync) if report.iterations >= 0 else (run.elements.u_sync, run.elements.v_sync)

    @property
    def applied(self) -> Floats:
        """See `riftberg.engines.common.stepper.Stepper.applied`."""
        return self._around.applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """See `riftberg.engines.common.stepper.Stepper.touched`."""
        return self._touched

    def _collisions(self, run: RunState, sizes: Sizes) -> NeighbourLists:
        """Return the partners of the outer kicks: elements of other bergs."""
        search, c = self._near, run.constants
        none = no_pairs(run.elements.size)
        if c.contact_on_substeps:
            return NeighbourLists(none, none, none, np.zeros(0), np.zeros(0, np.int64))
        collisions = search.collisions(run.elements, sizes, c, self._cells)
        one_group = run.parameters.quirks.bergs_coupled
        group = np.zeros(0, np.int64) if one_group else contact_groups(run.elements, collisions, sizes.radius, c)
        return NeighbourLists(none, none, collisions, np.zeros(0), group)

    def _split_into_batches(self, run: RunState, substeps: Ints) -> list[Batch]:
        """Split the elements by number of sub-steps, and those near the pole from the others."""
        key = substeps
        if run.constants.latlon and run.elements.lat.max(initial=0.0) > POLAR_LATITUDE:
            # Number of sub-steps and nearness in one whole number: even away from the pole, odd near it. A batch near the pole
            # drifts on the tangent plane, element by element; the others shall not lose their vector instructions for it.
            key = 2 * key + _mark_northern_bergs(run.elements, POLAR_LATITUDE)
        one_batch = bool((key == key[0]).all()) or run.parameters.quirks.bergs_coupled
        # As long as no row comes or goes and the keys stay, so do the batches, with their workspaces and their lists.
        batch_key = run.population.version, b"" if one_batch else key.tobytes()
        if self._batch_key == batch_key:
            for batch in self._batches:
                batch.gather(run)
            return self._batches
        self._batch_key = batch_key
        self._batches = (
            [Batch(run, None)] if one_batch else [Batch(run, np.flatnonzero(key == k)) for k in np.unique(key)]
        )
        return self._batches

    def _plan(self, run: RunState) -> StepPlan:
        p, first = run.parameters, run.step_number == 0
        quirks = p.quirks
        unbreakable = first and p.fracture.not_in_first_step
        inline = p.fracture.on_substeps and (not unbreakable or quirks.inline_break_in_first_step)
        after = not p.fracture.on_substeps and not unbreakable
        return StepPlan(
            dt=p.time_step,
            substeps=1,
            time=run.time,
            starting=first and not quirks.zero_start,
            skip_outer=first and p.stepping.skip_first_long_force,
            by_search=not self._contact_by_bonds,
            break_inline=p.fracture.enabled and inline,
            break_after=p.fracture.enabled and after,
        )

    def _inner_partners(self, batch: Batch, group: Ints, run: RunState) -> NeighbourLists:
        """With spring bonds, bonded pairs and contacts inside the berg, which the sub-steps use."""
        el, search, c = batch.elements, batch.near, run.constants
        none = no_pairs(el.size)
        # Groups of a batch may leave out numbers; that costs nothing.
        if c.dem or not c.bonds_on:
            return NeighbourLists(none, none, none, np.zeros(0), group)
        bonded, rest = search.springs(el, batch.bonds, c)
        reach = _inner_reach(el, interaction_sizes(el, c), run.parameters.time_step)
        cells = None if self._cells is None else self._cells.within(1 if c.explicit_substeps else 2)
        touching = search.same_berg(el, batch.bonds, reach, c, cells)
        if c.explicit_substeps:
            touching = with_partners(touching, el.bond_count < c.max_bonds)
        return NeighbourLists(bonded, touching, none, rest, group)

    def _gather_pairs(self, batch: Batch, dt: float, c: KernelParameters) -> None:
        """List the pairs inside bergs that may touch in this step."""
        el, bonds, pairs = batch.elements, batch.bonds, batch.work.pairs
        if not c.dem:
            pairs.used[0] = 0
            return
        # In the reference only ends of broken bonds touch within a berg, and these are listed by the bonds
        # themselves.
        if self._contact_by_bonds:
            broken = np.flatnonzero(bonds.status == 1)
            pairs.first[: broken.size] = bonds.first[broken]
            pairs.second[: broken.size] = bonds.second[broken]
            pairs.bond[: broken.size] = -1
            pairs.used[0] = broken.size
            return
        cells = None if self._cells is None else self._cells.within(1)
        candidates = batch.near.find(el, _inner_reach(el, interaction_sizes(el, c), dt), SAME_BERG, c, cells)
        # Broken bonds that the reference has not dropped are pairs, too, where their ends have parted.
        parted = np.flatnonzero((bonds.status == 1) & (el.berg[bonds.first] != el.berg[bonds.second]))
        # Twice as many as needed: candidates become more as pieces part, and each new table is compiled code's to
        # check.
        if candidates.partner.size + parted.size > pairs.first.size:
            pairs = allocate_pairs(2 * (candidates.partner.size + parted.size))
            batch.work = batch.work._replace(pairs=pairs)
        bonded, bond = batch.near.bonded(el, bonds)
        pairs_from_list(pairs, candidates, bonded, bond)
        behind = slice(int(pairs.used[0]), int(pairs.used[0]) + parted.size)
        pairs.first[behind], pairs.second[behind], pairs.bond[behind] = bonds.first[parted], bonds.second[parted], -1
        pairs.used[0] = behind.stop


def _processing_rank(run: RunState) -> Ints:
    """Rank of the elements in the reference's order of processing."""
    rank = np.empty(run.elements.size, np.int64)
    rank[listed(run.elements)] = np.arange(rank.size)
    return rank


def _uniform(run: RunState) -> bool:
    """Whether all elements have one size and thickness, so that the order of processing cannot matter."""
    el = run.elements
    return all(bool(np.ptp(a) <= 1e-12 * abs(a[0])) for a in (el.length, el.width, el.thickness))


def _mark_northern_bergs(el: Elements, latitude: float) -> Ints:
    """1 for the elements of bergs that reach beyond a latitude, else 0."""
    return np.isin(el.berg, el.berg[el.lat > latitude]).astype(np.int64)


def _inner_reach(el: Elements, sizes: Sizes, dt: float) -> float:
    """Distance (m) within which elements of one berg may come into contact during a long step.

    Twice the contact distance, or as far as the present relative speeds would carry them in two long steps.
    """
    touching = 2.0 * float(sizes.bond_radius.max())
    # An upper bound of the relative speed of any two elements, without looking at pairs.
    spread = float(np.ptp(el.u) + np.ptp(el.v)) * dt
    return touching + max(touching, 2.0 * spread)


class StepReport(NamedTuple):
    """What a long step reports."""

    broken: int  # Bonds broken in it
    iterations: int  # Iterations of the contact (-1: it did not converge)


def take_long_step(
    el: Elements, bonds: Bonds, work: Workspace, outer: NeighbourLists, inner: NeighbourLists, sizes: Sizes,
    surroundings: Surroundings, rank: Ints, plan: StepPlan, p: KernelParameters,
) -> StepReport:  # fmt: skip
    """Apply the outer forces and take the sub-steps of a long step; cells, environment and fragments are the caller's.

    One call for both, since handing the state to compiled code takes some 40 us; and one kernel, since what is compiled by
    itself and again within another takes twice as long. Where bergs take different numbers of sub-steps, the outer forces
    are applied to all at once (``plan.apply_inner`` false), and each batch moves for itself (``plan.apply_outer`` false).
    """
    outer_work = allocate_outer_workspace(el.size, outer)
    if not p.dem:
        within, without = Solved(inner, allocate_outer_workspace(el.size, inner)), Solved(outer, outer_work)
        report = _take_spring_step(el, bonds, work, without, within, sizes, surroundings, plan, p)
        return StepReport(*report)
    return StepReport(*_take_beam_step(el, bonds, work, outer, outer_work, sizes, surroundings, rank, plan, p))


@borrower
def _take_beam_step(
    el: Elements, bonds: Bonds, work: Workspace, outer: NeighbourLists, outer_work: OuterWorkspace, sizes: Sizes,
    surroundings: Surroundings, rank: Ints, plan: StepPlan, p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """Return the numbers of `StepReport`.

    Beams and springs have a kernel each: together they take half as long again to compile, and a run needs one of them.
    """
    broken, iterations = 0, 1
    if plan.apply_outer:
        broken, iterations = _outer_kick(el, bonds, outer, outer_work, sizes, surroundings, plan, p)
    if plan.apply_inner and iterations >= 0:
        broken += take_substeps_of_beams(el, bonds, work, sizes, surroundings, rank, plan, p)
        iterations = 1
    return broken, iterations


class Solved(NamedTuple):
    """Partners of the elements in an implicit solve, and its workspace."""

    partners: NeighbourLists
    work: OuterWorkspace


@borrower
def _take_spring_step(
    el: Elements, bonds: Bonds, work: Workspace, outer: Solved, inner: Solved, sizes: Sizes, surroundings: Surroundings,
    plan: StepPlan, p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """As `_take_beam_step`; ``inner`` are the partners in the sub-steps."""
    broken, iterations = 0, 1
    if plan.apply_outer:
        broken, iterations = _outer_kick(el, bonds, outer.partners, outer.work, sizes, surroundings, plan, p)
    if plan.apply_inner and iterations >= 0:
        iterations = take_substeps_of_springs(el, bonds, work, inner.partners, inner.work, sizes, surroundings, plan, p)
    return broken, iterations


@stage
def _outer_kick(
    el: Elements, bonds: Bonds, partners: NeighbourLists, work: OuterWorkspace, sizes: Sizes, surroundings: Surroundings,
    plan: StepPlan, p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """Complete the step before, break bonds after it, and begin this one; returns the numbers of `StepReport`."""
    find_surroundings(el, sizes, surroundings, p)
    if plan.skip_outer:
        return 0, 1
    iterations = second_half_kick(el, plan.dt, surroundings, partners, work, sizes, pair_law(p), plan.starting, p)
    if iterations < 0 or plan.sync_only:
        return 0, iterations
    broken = 0
    if plan.break_after:
        broken = break_after_step(el, bonds, p.normal_strength, p.shear_strength, plan.time)
    first_half_kick(el, plan.dt, surroundings.media, p)
    return broken, iterations
