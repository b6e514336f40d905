"""The schemes behind one interface: what a model calls once per long step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from riftberg.errors import RunError
from riftberg.ocean.cells import round_trip, settle_elements
from riftberg.parameters import KernelParameters
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import ANY, SAME_BERG, no_pairs
from riftberg.state.order import enter_cells, listed
from riftberg.stepping.contact.broad_phase import NeighbourSearch, contact_cells, rest_lengths, with_partners
from riftberg.stepping.contact.groups import NO_PAIRS, concatenate_pairs, contact_groups, contact_rows, group_substeps
from riftberg.stepping.contact.land import apply_land_constraint
from riftberg.stepping.explicit import runge_kutta, verlet
from riftberg.stepping.explicit.batches import Batch
from riftberg.stepping.explicit.breaking import allocate_pairs
from riftberg.stepping.explicit.lone_bergs import collide, find_islands
from riftberg.stepping.explicit.mts import StepReport, take_long_step
from riftberg.stepping.explicit.springs import POLAR_LATITUDE, allocate_room, pairs_from_list
from riftberg.stepping.explicit.step_plan import StepPlan
from riftberg.stepping.forces.interactions import Partners
from riftberg.stepping.forces.media import FORCES, Surroundings, allocate_surroundings
from riftberg.stepping.forces.sizes import Sizes, interaction_sizes
from riftberg.stepping.fragments.connectivity import connected_parts, drop_broken_bonds, drop_parted_bonds
from riftberg.stepping.run_state import RunState


class Stepper(Protocol):
    """Advances the state of a model by one long step, including cells, environment and fragments."""

    def step(self, run: RunState) -> None:
        """Advance by one long step; ``run.time`` moves on, ``run.step_number`` does not."""

    def sample_forcing(self, run: RunState) -> None:
        """Sample the forcing for the environment that the elements carry between two steps."""

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Return the velocity (m s-1) at the time of the positions, after a step; the state stays as it is."""

    @property
    def applied(self) -> Floats:
        """Mean accelerations (m s-2) over the last long step, shape (elements, forces, 2)."""

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """Rows of the pairs of elements of different bergs that were in contact in the last long step."""

    def state_dict(self) -> dict[str, Any]:
        """Return what a restart must hold beside the state, as arrays, for the run to go on bit for bit."""

    def load_state_dict(self, kept: Mapping[str, Any]) -> None:
        """Restore what `state_dict` gave; other arrays in ``kept`` are left alone."""


class Stateless:
    """Schemes that need nothing beside the state."""

    def state_dict(self) -> dict[str, Any]:
        """Return nothing."""
        return {}

    def load_state_dict(self, kept: Mapping[str, Any]) -> None:
        """Restore nothing."""


def make_stepper(run: RunState) -> Stepper:
    """Return the stepper of the scheme that the parameters name."""
    scheme = run.parameters.stepping.scheme
    if run.parameters.stepping.frozen:
        return FrozenStepper()
    if run.parameters.stepping.fixed_velocity is not None and scheme in ("mts", "quasi_static"):
        return ImposedStepper()
    if scheme == "mts":
        return MultipleStepper(run)
    if scheme == "quasi_static":
        # Its sparse solver takes half a second to import, which runs by other schemes do not wait for.
        from riftberg.stepping.quasi_static.step import QuasiStaticStepper

        return QuasiStaticStepper()
    return VerletStepper(run) if scheme == "verlet" else RungeKuttaStepper(run)


class FrozenStepper(Stateless):
    """Nothing moves: time goes on, and the environment with it."""

    def __init__(self) -> None:
        self._applied = np.zeros((0, len(FORCES), 2))

    def step(self, run: RunState) -> None:
        """Advance by one long step."""
        self._move(run)
        run.time += run.parameters.stepping.time_step
        self._applied = np.zeros((run.elements.size, len(FORCES), 2))
        self.sample_forcing(run)

    def _move(self, run: RunState) -> None:
        """Leave everything where it is."""

    def sample_forcing(self, run: RunState) -> None:
        """Sample where the elements stand."""
        p = run.parameters
        lag = p.stepping.time_step if p.compatibility.forcing_lag else 0.0
        run.forcing.sample(run.elements, run.time - lag)

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Return the velocity as it stands."""
        return run.elements.u.copy(), run.elements.v.copy()

    @property
    def applied(self) -> Floats:
        """No force has acted."""
        return self._applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """Nothing has met."""
        return NO_PAIRS


class ImposedStepper(FrozenStepper):
    """Bergs go at an imposed velocity whatever acts on them, in the schemes that have sub-steps (equations 4.2)."""

    def _move(self, run: RunState) -> None:
        el, p, imposed = run.elements, run.parameters, run.parameters.stepping.fixed_velocity
        show_places(el)
        moving, kicks = el.static < 0.5, el.kicks
        for kick in kicks:
            kick[moving] = 0.0
        if imposed is not None and not p.compatibility.imposed_velocity_late:
            el.u[moving], el.v[moving] = imposed
        count = int(el.substeps.max(initial=1))
        for _ in range(count):
            verlet.update_positions(el, p.stepping.time_step / count, run.constants)
        el.rotation[moving] += p.stepping.time_step * el.spin[moving]
        for mine, shown in ((el.u, (el.u_pair, el.u_sync)), (el.v, (el.v_pair, el.v_sync))):
            for other in shown:
                other[moving] = mine[moving]
        settle(run)


def show_places(el: Elements) -> None:
    """Let moving elements see each other where they are, also those that a user, or a process after a step, has moved."""
    moving = el.static < 0.5
    np.copyto(el.lon_pair, el.lon, where=moving)
    np.copyto(el.lat_pair, el.lat, where=moving)


def settle(run: RunState, cells: tuple[Ints, Ints] | None = None) -> None:
    """Find the cells after a move from ``cells``, stop bergs at land, wrap longitudes (equations 8)."""
    el, grid = run.elements, run.forcing.grid
    if grid is not None:
        if run.parameters.compatibility.elements_stopped_alone:
            columns, rows = (el.cell_i.copy(), el.cell_j.copy()) if cells is None else cells
            settle_elements(el, grid.arrays, run.constants)
            enter_cells(el, columns, rows)
        else:
            apply_land_constraint(el, run.bonds, grid.arrays, run.constants)
        if run.constants.grid_position_round_trip:
            el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
            round_trip(el, grid.arrays)
    show_places(el)


def _processing_rank(run: RunState) -> Ints:
    """Rank of the elements in the reference's order."""
    rank = np.empty(run.elements.size, np.int64)
    rank[listed(run.elements)] = np.arange(rank.size)
    return rank


def _update_fragments(run: RunState) -> None:
    """Number fragments after bonds have broken, and forget broken bonds whose ends have parted (equations 1.5)."""
    el, bonds, c = run.elements, run.bonds, run.constants
    if c.broken_as_contact and c.fracture_on_substeps:
        drop_parted_bonds(bonds, connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status))
    else:
        drop_broken_bonds(bonds)
    run.fragments.update(el, bonds, run.time, c)


class MultipleStepper(Stateless):
    """Multiple time steps (equations 6.4).

    The slow kicks are those of all bergs together. The sub-steps concern each group of bergs that may meet in the step
    and are taken by batches of groups that have the same number of them. Bergs collide in the sub-steps, or with
    ``contact.on_substeps`` off in the slow kicks.
    """

    def __init__(self, run: RunState) -> None:
        c = run.constants
        self._near = NeighbourSearch()
        self._cells = contact_cells(run.parameters, run.forcing.grid)
        self._around = allocate_surroundings(run.elements.size)
        self._touched = NO_PAIRS
        self._kept: list[Batch] = []
        self._standing: tuple[int, bytes] | None = None
        self._quirky_order = c.shared_shear_lever or c.bond_thickness_of_second
        self._contact_by_bonds = c.dem and c.broken_as_contact and c.fracture_on_substeps

    def step(self, run: RunState) -> None:
        """Advance by one long step."""
        el, bonds, c = run.elements, run.bonds, run.constants
        show_places(el)
        sizes = interaction_sizes(el, c)
        earlier = np.arange(el.size)
        if self._quirky_order and not _uniform(run):
            earlier = _processing_rank(run)
        dt = run.parameters.stepping.time_step
        slow = self._collisions(run, sizes)
        meeting = self._near.candidate_pairs(el, sizes, dt, c) if c.contact_on_substeps else NO_PAIRS
        islands, general = find_islands(run, sizes, *meeting, POLAR_LATITUDE)
        meeting = meeting[0][general], meeting[1][general]
        substeps = group_substeps(run, sizes, *meeting)
        batches = self._batches(run, substeps)
        waits = np.zeros(el.size)
        if islands is not None:
            waits[islands.rows] = 1.0
        for batch in batches:
            self._gather_pairs(batch, dt, c)
            batch.add_meetings(*meeting)
            batch.room.scratch.waits[:] = batch.of_all(waits)
        inner = [self._inner_partners(batch, batch.of_all(slow.group), run) for batch in batches]
        plan = self._plan(run)
        if self._around.coriolis.size != el.size:
            self._around = allocate_surroundings(el.size)
        if batches[0].rows is None:
            plan = plan._replace(substeps=int(substeps[0]))
            report = take_long_step(
                el, bonds, batches[0].room, slow, inner[0], sizes, self._around, earlier, plan, c
            )  # fmt: skip
            self._check_settled(report, run)
            broken = report.broken
        else:
            broken = self._step_in_batches(run, batches, slow, inner, sizes, earlier, substeps, plan)
        met = NO_PAIRS if islands is None else collide(el, islands, sizes, self._around, dt, plan.starting, c)
        if plan.starting:
            # A proper start has the second of the two half kicks alone; what acts in the sub-steps acts all the time.
            slowly = np.append(self._around.acts, True)
            self._around.applied[:, slowly] *= 0.5
        self._touched = concatenate_pairs(
            [contact_rows(el, slow.collision, sizes, c), met, *(batch.touched() for batch in batches)]
        )
        settle(run)
        run.time += run.parameters.stepping.time_step
        self.sample_forcing(run)
        if broken > 0:
            _update_fragments(run)

    def _step_in_batches(
        self, run: RunState, batches: list[Batch], slow: Partners, inner: list[Partners], sizes: Sizes, earlier: Ints,
        substeps: Ints, plan: StepPlan,
    ) -> int:  # fmt: skip
        """Take the sub-steps of each batch for itself; returns the number of bonds broken."""
        c = run.constants
        first = batches[0].room  # the slow forces need no room
        report = take_long_step(
            run.elements, run.bonds, first, slow, slow, sizes, self._around, earlier, plan._replace(moves=False), c
        )  # fmt: skip
        self._check_settled(report, run)
        broken = report.broken
        for batch, fast in zip(batches, inner, strict=True):
            batch.take(run)
            some, around = batch.elements, batch.surroundings(self._around)
            part = plan._replace(substeps=int(batch.of_all(substeps)[0]), kicks=False)
            report = take_long_step(
                some, batch.bonds, batch.room, fast, fast, interaction_sizes(some, c), around, batch.of_all(earlier),
                part, c,
            )  # fmt: skip
            batch.give(run, around, self._around)
            self._check_settled(report, run)
            broken += report.broken
        return broken

    @staticmethod
    def _check_settled(report: StepReport, run: RunState) -> None:
        if report.passes < 0:
            raise RunError(
                f"the contact iteration did not settle within {run.constants.max_iterations} passes at "
                f"{run.date:%Y-%m-%d %H:%M}; raise contact.tolerance or shorten stepping.time_step"
            )

    def sample_forcing(self, run: RunState) -> None:
        """Sample at the new positions: the fields of the next step, or with the lag of Q5 of the step just taken."""
        p = run.parameters
        lag = p.stepping.time_step if p.compatibility.forcing_lag else 0.0
        run.forcing.sample(run.elements, run.time - lag)

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Complete the slow half kick that the next step begins with, on a copy of the elements."""
        c = run.constants
        el = run.elements.copy()
        sizes = interaction_sizes(el, c)
        slow = self._collisions(run, sizes)
        # The kernel of the step, so that none is compiled for this alone; no sub-steps are taken that would need room.
        room = self._kept[0].room if self._kept else allocate_room(el, run.bonds)
        plan = self._plan(run)._replace(starting=False, skip_slow=False, moves=False, closes=True)
        report = take_long_step(
            el, run.bonds, room, slow, slow, sizes, allocate_surroundings(el.size), np.arange(el.size), plan, c
        )  # fmt: skip
        return (el.u_sync, el.v_sync) if report.passes >= 0 else (run.elements.u_sync, run.elements.v_sync)

    @property
    def applied(self) -> Floats:
        """See `Stepper.applied`."""
        return self._around.applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """See `Stepper.touched`."""
        return self._touched

    def _collisions(self, run: RunState, sizes: Sizes) -> Partners:
        """Partners of the slow kicks: elements of other bergs."""
        near, c = self._near, run.constants
        if c.contact_on_substeps:
            none = no_pairs(run.elements.size)
            return Partners(none, none, none, np.zeros(0), np.zeros(0, np.int64))
        near_by = near.collisions(run.elements, sizes, c, self._cells)
        one_group = run.parameters.compatibility.bergs_coupled
        group = np.zeros(0, np.int64) if one_group else contact_groups(run.elements, near_by, sizes.radius, c)
        none = no_pairs(run.elements.size)
        return Partners(none, none, near_by, np.zeros(0), group)

    def _batches(self, run: RunState, substeps: Ints) -> list[Batch]:
        """Split the elements by number of sub-steps, and those near the pole from the others."""
        kind = substeps
        if run.constants.latlon and run.elements.lat.max(initial=0.0) > POLAR_LATITUDE:
            kind = 2 * kind + _has_berg_north_of(run.elements, POLAR_LATITUDE)
        together = bool((kind == kind[0]).all()) or run.parameters.compatibility.bergs_coupled
        # As long as no row comes or goes and the kinds stay, so do the batches, with their room and their lists.
        standing = run.population.version, b"" if together else kind.tobytes()
        if self._standing == standing:
            for batch in self._kept:
                batch.take(run)
            return self._kept
        self._standing = standing
        self._kept = (
            [Batch(run, None)] if together else [Batch(run, np.flatnonzero(kind == k)) for k in np.unique(kind)]
        )
        return self._kept

    def _plan(self, run: RunState) -> StepPlan:
        p, first = run.parameters, run.step_number == 0
        quirks = p.compatibility
        held = first and p.fracture.not_in_first_step
        inline = p.fracture.on_substeps and (not held or quirks.inline_break_in_first_step)
        after = not p.fracture.on_substeps and not held
        return StepPlan(
            dt=p.stepping.time_step,
            substeps=1,
            time=run.time,
            starting=first and not quirks.zero_start,
            skip_slow=first and p.stepping.skip_first_long_force,
            search=not self._contact_by_bonds,
            break_inline=p.fracture.enabled and inline,
            break_after=p.fracture.enabled and after,
            # A start that must not break bonds must not wear them either.
            wears=p.damage.enabled and (inline or after),
            threads=p.stepping.threads,
        )

    def _inner_partners(self, batch: Batch, group: Ints, run: RunState) -> Partners:
        """With spring bonds, bonded pairs and contacts inside the berg, which the sub-steps use."""
        el, near, c = batch.elements, batch.near, run.constants
        none = no_pairs(el.size)
        # Groups of a batch may leave out numbers; that costs nothing.
        if c.dem or not c.bonds_on:
            return Partners(none, none, none, np.zeros(0), group)
        bonded, bond = near.bonded(el, batch.bonds)
        reach = _inner_reach(el, interaction_sizes(el, c), run.parameters.stepping.time_step)
        cells = None if self._cells is None else self._cells.within(1 if c.explicit_substeps else 2)
        touching = near.same_berg(el, batch.bonds, reach, c, cells)
        if c.explicit_substeps:
            touching = with_partners(touching, el.bond_count < c.max_bonds)
        return Partners(bonded, touching, none, rest_lengths(batch.bonds, bond, c), group)

    def _gather_pairs(self, batch: Batch, dt: float, c: KernelParameters) -> None:
        """List the pairs inside bergs that may touch in this step."""
        el, bonds, pairs = batch.elements, batch.bonds, batch.room.pairs
        if not c.dem:
            pairs.count[0] = 0
            return
        if self._contact_by_bonds:
            waiting = np.flatnonzero(bonds.status == 1)
            pairs.first[: waiting.size] = bonds.first[waiting]
            pairs.second[: waiting.size] = bonds.second[waiting]
            pairs.bond[: waiting.size] = -1
            pairs.count[0] = waiting.size
            return
        cells = None if self._cells is None else self._cells.within(1)
        candidates = batch.near.find(el, _inner_reach(el, interaction_sizes(el, c), dt), SAME_BERG, c, cells)
        if candidates.partner.size > pairs.first.size:
            pairs = allocate_pairs(2 * candidates.partner.size)
            batch.room = batch.room._replace(pairs=pairs)
        bonded, bond = batch.near.bonded(el, bonds)
        pairs_from_list(pairs, candidates, bonded, bond)


def _has_berg_north_of(el: Elements, latitude: float) -> Ints:
    """1 for the elements of bergs that reach beyond a latitude, else 0."""
    return np.isin(el.berg, el.berg[el.lat > latitude]).astype(np.int64)


def _inner_reach(el: Elements, sizes: Sizes, dt: float) -> float:
    """Distance (m) within which elements of one berg may come into contact during a long step.

    Twice the contact distance, or as far as the present relative speeds would carry them in two long steps.
    """
    touching = 2.0 * float(sizes.bond_radius.max())
    spread = float(np.ptp(el.u) + np.ptp(el.v)) * dt
    return touching + max(touching, 2.0 * spread)


def _uniform(run: RunState) -> bool:
    """Whether all elements have one size and thickness, so that the order of processing cannot matter."""
    el = run.elements
    return all(bool(np.ptp(a) <= 1e-12 * abs(a[0])) for a in (el.length, el.width, el.thickness))


class SingleStepper(Stateless):
    """What the single-step schemes share: partners by the rules of equations 5.1."""

    def __init__(self, run: RunState) -> None:
        self._near = NeighbourSearch()
        self._cells = contact_cells(run.parameters, run.forcing.grid)
        self._version = -1
        self._around = allocate_surroundings(run.elements.size)
        self._touched = NO_PAIRS

    @property
    def applied(self) -> Floats:
        """See `Stepper.applied`."""
        return self._around.applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """See `Stepper.touched`."""
        return self._touched

    def sample_forcing(self, run: RunState) -> None:
        """Do nothing: these schemes sample within the step."""

    def _partners(self, run: RunState, sizes: Sizes) -> Partners:
        el, bonds, c, near = run.elements, run.bonds, run.constants, self._near
        none, group = no_pairs(el.size), np.zeros(0, np.int64)  # nothing is repeated until it settles
        if not c.interactions:
            return Partners(none, none, none, np.zeros(0), group)
        bonded, rest = none, np.zeros(0)
        if self._version != run.population.version:
            near, self._version = NeighbourSearch(), run.population.version
            self._near = near
        if c.bonds_on:
            bonded, bond = near.bonded(el, bonds)
            rest = rest_lengths(bonds, bond, c)
        reach, cells = 2.0 * float(sizes.radius.max()), self._cells
        if c.plain_kid_branch:
            around = None if cells is None else cells.within(1)
            return Partners(bonded, none, near.find(el, reach, ANY, c, around), rest, group)
        inside = None if cells is None else cells.within(2)
        touching = near.same_berg(el, bonds, reach, c, inside) if c.bonds_on else none
        collisions = near.collisions(el, sizes, c, cells)
        self._touched = contact_rows(el, collisions, sizes, c)
        return Partners(bonded, touching, collisions, rest, group)


class VerletStepper(SingleStepper):
    """Single-step velocity Verlet (equations 6.2)."""

    def step(self, run: RunState) -> None:
        """Advance by one step."""
        el, c, dt = run.elements, run.constants, run.parameters.stepping.time_step
        show_places(el)
        if run.step_number == 0 and c.grid_position_round_trip and run.forcing.grid is not None:
            round_trip(el, run.forcing.grid.arrays)
        run.forcing.sample(el, run.time)
        if self._around.coriolis.size != el.size:
            self._around = allocate_surroundings(el.size)
        self._update_velocities(run, el, self._around)
        verlet.update_positions(el, dt, c)
        settle(run)
        el.u_pair[:], el.v_pair[:] = el.u, el.v
        run.time += dt

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Take the velocity that the next step begins with, on a copy of the elements."""
        el = run.elements.copy()
        run.forcing.sample(el, run.time)
        self._update_velocities(run, el, allocate_surroundings(el.size))
        return el.u, el.v

    def _update_velocities(self, run: RunState, el: Elements, around: Surroundings) -> None:
        """Update the velocities of ``el``, or impose those that are given: then no force has acted."""
        c, dt = run.constants, run.parameters.stepping.time_step
        sizes = interaction_sizes(el, c)
        verlet.update_velocities(el, self._partners(run, sizes), sizes, around, dt, c)
        imposed = run.parameters.stepping.fixed_velocity
        if imposed is not None:
            verlet.impose_velocity(el, *imposed)
            around.applied[:] = 0.0


class RungeKuttaStepper(SingleStepper):
    """Fourth-order Runge-Kutta (equations 6.3)."""

    def __init__(self, run: RunState) -> None:
        super().__init__(run)
        self._make_room(run.elements.size)

    def _make_room(self, count: int) -> None:
        self._stages = runge_kutta.allocate_stages(count)
        self._around = allocate_surroundings(count)
        self._applied = np.zeros_like(self._around.applied)

    @property
    def applied(self) -> Floats:
        """See `Stepper.applied`."""
        return self._applied

    def step(self, run: RunState) -> None:
        """Advance by one step; stages go from the cell at the start of the step."""
        el, c, dt = run.elements, run.constants, run.parameters.stepping.time_step
        show_places(el)
        mean_speeds = run.parameters.stepping.predictor_corrector
        sizes = interaction_sizes(el, c)
        partners = self._partners(run, sizes)
        cells = el.cell_i.copy(), el.cell_j.copy(), el.xi.copy(), el.eta.copy()
        shown = el.lon_pair.copy(), el.lat_pair.copy()
        if self._stages.x0.size != el.size:
            self._make_room(el.size)
        imposed = run.parameters.stepping.fixed_velocity
        if imposed is not None and not run.parameters.compatibility.imposed_velocity_late:
            verlet.impose_velocity(el, *imposed)
        runge_kutta.begin(el, self._stages)
        self._applied[:] = 0.0
        for stage in range(4):
            if stage > 0:
                runge_kutta.go_to_stage(el, self._stages, stage, runge_kutta.AHEAD[stage], dt, c)
                self._settle_stage(run, cells, shown)
            ahead = 0.0 if run.parameters.compatibility.forcing_lag else runge_kutta.AHEAD[stage] * dt
            run.forcing.sample(el, run.time + ahead)
            runge_kutta.evaluate(
                el, self._stages, stage, runge_kutta.FRACTION[stage], partners, sizes, self._around, dt, mean_speeds, c
            )
            if imposed is None:
                self._applied += runge_kutta.WEIGHT[stage] * self._around.applied
            else:
                runge_kutta.keep_velocity(self._stages, stage)
        runge_kutta.finish(el, self._stages, dt, c)
        if imposed is not None:
            verlet.impose_velocity(el, *imposed)
        if run.parameters.compatibility.elements_stopped_alone:
            self._settle_stage(run, cells, shown)
        else:
            el.cell_i[:], el.cell_j[:], el.xi[:], el.eta[:] = cells
        settle(run, cells[:2])
        el.u_pair[:], el.v_pair[:] = el.u, el.v
        run.time += dt

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Return the velocity of the end of the step."""
        return run.elements.u.copy(), run.elements.v.copy()

    @staticmethod
    def _settle_stage(run: RunState, cells: tuple[Ints, Ints, Floats, Floats], shown: tuple[Floats, Floats]) -> None:
        """Find the cells of a stage from those at the start; what the others see stays."""
        el, grid = run.elements, run.forcing.grid
        if grid is None:
            return
        el.cell_i[:], el.cell_j[:], el.xi[:], el.eta[:] = cells
        settle_elements(el, grid.arrays, run.constants)
        el.lon_pair[:], el.lat_pair[:] = shown
