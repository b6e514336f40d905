"""Schemes without sub-steps: velocity Verlet and Runge-Kutta of fourth order (equations 6.2, 6.3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.engines.common.broad_phase import NO_PAIRS, NeighbourSearch, contact_cells, contact_rows
from riftberg.engines.common.forces.implicit_velocity import (
    INTERACTIONS_ONLY,
    VERLET,
    WITH_SURROUNDINGS,
    ElementState,
    Solve,
    runge_kutta_scheme,
    solve_velocity,
)
from riftberg.engines.common.forces.media import Surroundings, allocate_surroundings, find_surroundings
from riftberg.engines.common.forces.pair_law import NeighbourLists, pair_law, pair_view
from riftberg.engines.common.forces.sizes import Sizes, interaction_sizes
from riftberg.engines.common.run_state import RunState
from riftberg.engines.common.stepper import Stateless, apply_boundaries, publish_positions
from riftberg.ocean.cells import round_trip, settle_elements
from riftberg.ocean.gridded import GriddedForcing
from riftberg.parameters import KernelParameters
from riftberg.physics.geometry import add_velocity, metres_per_unit, move
from riftberg.state import Elements, Floats, Ints
from riftberg.state.neighbours import ANY, no_pairs


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
        """See `riftberg.engines.common.stepper.Stepper.applied`."""
        return self._around.applied

    @property
    def touched(self) -> tuple[Ints, Ints]:
        """See `riftberg.engines.common.stepper.Stepper.touched`."""
        return self._touched

    def sample_forcing(self, run: RunState) -> None:
        """Do nothing: these schemes sample within the step."""

    def _partners(self, run: RunState, sizes: Sizes) -> NeighbourLists:
        el, bonds, c, search = run.elements, run.bonds, run.constants, self._near
        none, group = no_pairs(el.size), np.zeros(0, np.int64)  # nothing is repeated until it converges
        if not c.interactions:
            return NeighbourLists(none, none, none, np.zeros(0), group)
        bonded, rest = none, np.zeros(0)
        # Rows have come or gone: lists of the search name rows of before.
        if self._version != run.population.version:
            search, self._version = NeighbourSearch(), run.population.version
            self._near = search
        if c.bonds_on:
            bonded, rest = search.springs(el, bonds, c)
        reach, cells = 2.0 * float(sizes.radius.max()), self._cells
        if c.plain_kid_branch:
            neighbour_cells = None if cells is None else cells.within(1)
            return NeighbourLists(bonded, none, search.find(el, reach, ANY, c, neighbour_cells), rest, group)
        inside = None if cells is None else cells.within(2)
        touching = search.same_berg(el, bonds, reach, c, inside) if c.bonds_on else none
        collisions = search.collisions(el, sizes, c, cells)
        self._touched = contact_rows(el, collisions, sizes, c)
        return NeighbourLists(bonded, touching, collisions, rest, group)


class VerletStepper(SingleStepper):
    """Single-step velocity Verlet (equations 6.2)."""

    def step(self, run: RunState) -> None:
        """Advance by one step."""
        el, c, dt = run.elements, run.constants, run.parameters.time_step
        publish_positions(el)
        if run.step_number == 0 and c.grid_position_round_trip and run.forcing.grid is not None:
            round_trip(el, run.forcing.grid.arrays)
        run.forcing.sample(el, run.time)
        if self._around.coriolis.size != el.size:
            self._around = allocate_surroundings(el.size)
        self._update_velocities(run, el, self._around)
        update_positions(el, dt, c)
        apply_boundaries(run)
        el.u_pair[:], el.v_pair[:] = el.u, el.v
        run.time += dt

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Take the velocity that the next step begins with, on a copy of the elements."""
        el = run.elements.copy()
        run.forcing.sample(el, run.time)
        self._update_velocities(run, el, allocate_surroundings(el.size))
        return el.u, el.v

    def _update_velocities(self, run: RunState, el: Elements, surroundings: Surroundings) -> None:
        """Update the velocities of ``el``, or impose those that are given: then no force has acted."""
        c, dt = run.constants, run.parameters.time_step
        sizes = interaction_sizes(el, c)
        update_velocities(el, self._partners(run, sizes), sizes, surroundings, dt, c)
        imposed = run.parameters.stepping.fixed_velocity
        if imposed is not None:
            impose_velocity(el, *imposed)
            surroundings.applied[:] = 0.0


class RungeKuttaStepper(SingleStepper):
    """Fourth-order Runge-Kutta (equations 6.3)."""

    def __init__(self, run: RunState) -> None:
        super().__init__(run)
        self._allocate(run.elements.size)

    def _allocate(self, count: int) -> None:
        self._stages = allocate_stages(count)
        self._around = allocate_surroundings(count)
        self._applied = np.zeros_like(self._around.applied)

    @property
    def applied(self) -> Floats:
        """See `riftberg.engines.common.stepper.Stepper.applied`."""
        return self._applied

    def step(self, run: RunState) -> None:
        """Advance by one step.

        All elements go through a stage together, because the forcing is sampled at the positions of the stage; partners are
        seen where they were at the start of the step, so this changes nothing. Stages go from the cell at the start of the step.
        """
        el, c, dt = run.elements, run.constants, run.parameters.time_step
        publish_positions(el)
        mean_speeds = run.parameters.stepping.predictor_corrector
        sizes = interaction_sizes(el, c)
        partners = self._partners(run, sizes)
        # Each stage looks for its cell from that of the start: from the one of the stage before, it could be another
        # beside land.
        cells = el.cell_i.copy(), el.cell_j.copy(), el.xi.copy(), el.eta.copy()
        pair_positions = el.lon_pair.copy(), el.lat_pair.copy()
        if self._stages.x0.size != el.size:
            self._allocate(el.size)
        imposed = run.parameters.stepping.fixed_velocity
        # The reference imposes it at the end of a step, so that its first one still moves as forces have it.
        if imposed is not None and not run.parameters.quirks.imposed_velocity_late:
            impose_velocity(el, *imposed)
        begin_stages(el, self._stages)
        self._applied[:] = 0.0
        for stage in range(4):
            if stage > 0:
                go_to_stage(el, self._stages, stage, AHEAD[stage], dt, c)
                self._locate_stage(run, cells, pair_positions)
            ahead = 0.0 if run.parameters.quirks.forcing_lag else AHEAD[stage] * dt
            if isinstance(run.forcing, GriddedForcing):  # no other draws random numbers: one pair for all stages
                run.forcing.sample(el, run.time + ahead, drawn_in=cells[:2])
            else:
                run.forcing.sample(el, run.time + ahead)
            evaluate_stage(el, self._stages, stage, FRACTION[stage], partners, sizes, self._around, dt, mean_speeds, c)
            if imposed is None:
                self._applied += WEIGHT[stage] * self._around.applied
            else:
                clear_accelerations(self._stages, stage)
        combine_stages(el, self._stages, dt, c)
        if imposed is not None:
            impose_velocity(el, *imposed)
        if run.parameters.quirks.elements_stopped_alone:
            self._locate_stage(run, cells, pair_positions)
        else:
            el.cell_i[:], el.cell_j[:], el.xi[:], el.eta[:] = cells
        apply_boundaries(run, cells[:2])
        el.u_pair[:], el.v_pair[:] = el.u, el.v
        run.time += dt

    def synchronised(self, run: RunState) -> tuple[Floats, Floats]:
        """Return the velocity of the end of the step."""
        return run.elements.u.copy(), run.elements.v.copy()

    @staticmethod
    def _locate_stage(
        run: RunState, cells: tuple[Ints, Ints, Floats, Floats], pair_positions: tuple[Floats, Floats]
    ) -> None:
        """Find the cells of a stage from those at the start; the positions that pair forces see stay."""
        el, grid = run.elements, run.forcing.grid
        if grid is None:
            return
        el.cell_i[:], el.cell_j[:], el.xi[:], el.eta[:] = cells
        settle_elements(el, grid.arrays, run.constants)
        el.lon_pair[:], el.lat_pair[:] = pair_positions


@borrower
def update_velocities(
    el: Elements, partners: NeighbourLists, sizes: Sizes, surroundings: Surroundings, dt: float, p: KernelParameters
) -> None:
    """Update velocities and accelerations at the current positions; the others are seen as they were before.

    ``u_sync`` receives the reference's diagnostic u - dt/2 b of the velocity before the update.
    """
    place, motion, kicks, body = el.place, el.motion, el.kicks, el.body
    view, law = pair_view(el, sizes), pair_law(p)
    how = Solve(VERLET, INTERACTIONS_ONLY if p.only_interactions else WITH_SURROUNDINGS, dt)
    find_surroundings(el, sizes, surroundings, p)
    for e in range(motion.u.size):
        if body.static[e] >= 0.5:
            continue
        u, v = motion.u[e], motion.v[e]
        motion.u_sync[e], motion.v_sync[e] = u - 0.5 * dt * kicks.bx[e], v - 0.5 * dt * kicks.by[e]
        us, vs = u + 0.5 * dt * kicks.ax[e], v + 0.5 * dt * kicks.ay[e]
        w = ElementState(place.lon[e], place.lat[e], us, vs, u, v, u, v)
        s = solve_velocity(e, w, surroundings, how, partners, p.plain_kid_branch, False, view, law)
        motion.u[e], motion.v[e] = add_velocity(place.lon[e], place.lat[e], us, vs, s.total_x, s.total_y, dt, p.latlon)
        kicks.ax[e], kicks.ay[e], kicks.bx[e], kicks.by[e] = s.a_x, s.a_y, s.b_x, s.b_y


@borrower
def impose_velocity(el: Elements, u: float, v: float) -> None:
    """Give all moving elements one velocity (m s-1) and no acceleration."""
    motion, kicks, body = el.motion, el.kicks, el.body
    for e in range(motion.u.size):
        if body.static[e] < 0.5:
            motion.u[e], motion.v[e] = u, v
            kicks.ax[e] = kicks.ay[e] = kicks.bx[e] = kicks.by[e] = 0.0


@borrower
def update_positions(el: Elements, dt: float, p: KernelParameters) -> None:
    """Move by the new velocity and half kick: x += dt (u + dt/2 (a + b))."""
    place, motion, kicks, body = el.place, el.motion, el.kicks, el.body
    for e in range(motion.u.size):
        if body.static[e] >= 0.5:
            continue
        u = motion.u[e] + 0.5 * dt * kicks.ax[e] + 0.5 * dt * kicks.bx[e]
        v = motion.v[e] + 0.5 * dt * kicks.ay[e] + 0.5 * dt * kicks.by[e]
        place.lon[e], place.lat[e] = move(place.lon[e], place.lat[e], u, v, dt, p.latlon, p.earth_radius)


class Stages(NamedTuple):
    """The start of the step, (n,), and its four stages, (4, n)."""

    x0: Floats  # Position, degrees or m
    y0: Floats
    u0: Floats  # Velocity, m s-1
    v0: Floats
    rate_x: Floats  # Change of position, degrees or m per second
    rate_y: Floats
    u: Floats  # Velocity, m s-1
    v: Floats
    total_x: Floats  # Acceleration, m s-2
    total_y: Floats
    a_x: Floats  # Its explicit part, m s-2
    a_y: Floats


def allocate_stages(count: int) -> Stages:
    """Return arrays for ``count`` elements."""
    flat, deep = [np.zeros(count) for _ in range(4)], [np.zeros((4, count)) for _ in range(8)]
    return Stages(*flat, *deep)


FRACTION = (0.5, 0.5, 1.0, 1.0)
"""Part of the step that the semi-implicit solve of each stage spans."""

WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
"""Part of each stage in the acceleration of the step."""

AHEAD = (0.0, 0.5, 0.5, 1.0)
"""Place of each stage in the step."""


@kernel
def begin_stages(el: Elements, stages: Stages) -> None:
    """Store the start of the step; it is also the first stage."""
    motion = el.motion
    stages.x0[:], stages.y0[:], stages.u0[:], stages.v0[:] = el.place.lon, el.place.lat, motion.u, motion.v
    stages.u[0, :], stages.v[0, :] = motion.u, motion.v


@borrower
def evaluate_stage(
    el: Elements, stages: Stages, stage: int, fraction: float, partners: NeighbourLists, sizes: Sizes,
    surroundings: Surroundings, dt: float, mean_speeds: bool, p: KernelParameters,
) -> None:  # fmt: skip
    """Find the accelerations of a stage; ``el.lon``, ``el.lat`` hold its positions, ``stages.u[stage]`` its velocity."""
    place, shown, kicks, body = el.place, el.shown, el.kicks, el.body
    view, law = pair_view(el, sizes), pair_law(p)
    mode, span = INTERACTIONS_ONLY if p.only_interactions else WITH_SURROUNDINGS, fraction * dt
    how = Solve(runge_kutta_scheme(mean_speeds, p.stages_from_start), mode, span)
    find_surroundings(el, sizes, surroundings, p)
    for e in range(el.motion.u.size):
        if body.static[e] >= 0.5:
            continue
        u0, v0 = stages.u0[e], stages.v0[e]
        us, vs = stages.u[stage, e], stages.v[stage, e]
        half_u, half_v = u0 + 0.5 * span * kicks.ax[e], v0 + 0.5 * span * kicks.ay[e]
        w = ElementState(shown.lon_pair[e], shown.lat_pair[e], half_u, half_v, u0, v0, us, vs)
        s = solve_velocity(e, w, surroundings, how, partners, p.plain_kid_branch, False, view, law)
        stages.total_x[stage, e], stages.total_y[stage, e] = s.total_x, s.total_y
        stages.a_x[stage, e], stages.a_y[stage, e] = s.a_x, s.a_y
        mx, my = metres_per_unit(place.lat[e], p.latlon, p.earth_radius)
        stages.rate_x[stage, e], stages.rate_y[stage, e] = us / mx, vs / my


def clear_accelerations(stages: Stages, stage: int) -> None:
    """Let nothing accelerate the elements in a stage."""
    for values in (stages.total_x, stages.total_y, stages.a_x, stages.a_y):
        values[stage] = 0.0


@borrower
def go_to_stage(el: Elements, stages: Stages, stage: int, fraction: float, dt: float, p: KernelParameters) -> None:
    """Place the elements at stage 1, 2 or 3: ``fraction`` of a step from the start with the slopes of the stage before."""
    place, body = el.place, el.body
    for e in range(el.motion.u.size):
        if body.static[e] >= 0.5:
            continue
        span = fraction * dt
        if p.latlon and stages.y0[e] > 89.0:
            place.lon[e], place.lat[e] = move(
                stages.x0[e], stages.y0[e], stages.u[stage - 1, e], stages.v[stage - 1, e], span, True, p.earth_radius
            )
        else:
            place.lon[e] = stages.x0[e] + span * stages.rate_x[stage - 1, e]
            place.lat[e] = stages.y0[e] + span * stages.rate_y[stage - 1, e]
        stages.u[stage, e] = stages.u0[e] + span * stages.total_x[stage - 1, e]
        stages.v[stage, e] = stages.v0[e] + span * stages.total_y[stage - 1, e]


@kernel
def _weighted(values: Floats, e: int) -> float:
    """Mean of four stages with weights 1, 2, 2, 1."""
    return float((values[0, e] + values[3, e] + 2.0 * (values[1, e] + values[2, e])) / 6.0)


@borrower
def combine_stages(el: Elements, stages: Stages, dt: float, p: KernelParameters) -> None:
    """Combine the stages into the new position, velocity and accelerations."""
    place, motion, kicks, body = el.place, el.motion, el.kicks, el.body
    for e in range(motion.u.size):
        if body.static[e] >= 0.5:
            continue
        if p.latlon and stages.y0[e] > 89.0:
            u, v = _weighted(stages.u, e), _weighted(stages.v, e)
            place.lon[e], place.lat[e] = move(stages.x0[e], stages.y0[e], u, v, dt, True, p.earth_radius)
        else:
            place.lon[e] = stages.x0[e] + dt * _weighted(stages.rate_x, e)
            place.lat[e] = stages.y0[e] + dt * _weighted(stages.rate_y, e)
        total_x, total_y = _weighted(stages.total_x, e), _weighted(stages.total_y, e)
        motion.u[e], motion.v[e] = stages.u0[e] + dt * total_x, stages.v0[e] + dt * total_y
        motion.u_sync[e], motion.v_sync[e] = motion.u[e], motion.v[e]
        kicks.ax[e], kicks.ay[e] = _weighted(stages.a_x, e), _weighted(stages.a_y, e)
        kicks.bx[e], kicks.by[e] = total_x - 0.5 * kicks.ax[e], total_y - 0.5 * kicks.ay[e]
