"""The schemes behind one interface: what `riftberg.model.Model` calls once per long step."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from riftberg.errors import RunError
from riftberg.kernels import plain
from riftberg.ocean.cells import round_trip, settle_elements
from riftberg.state import Elements, Floats, Ints, copy_state
from riftberg.stepping import runge_kutta, verlet
from riftberg.stepping.bond_rows import allocate_rows
from riftberg.stepping.breaking import allocate_pairs
from riftberg.stepping.conglomerates import connected_parts, drop_broken_bonds, drop_parted_bonds
from riftberg.stepping.interactions import Partners, pair_law
from riftberg.stepping.long_kick import closing_half_kick
from riftberg.stepping.media import Surroundings, allocate_surroundings, find_surroundings
from riftberg.stepping.multiple import StepPlan, advance
from riftberg.stepping.neighbours import ANY, OTHER_BERG, SAME_BERG, PairList, adjacency, find_pairs, no_pairs
from riftberg.stepping.quasi_static import QuasiStaticStepper
from riftberg.stepping.sizes import Sizes, interaction_sizes
from riftberg.stepping.substep import allocate_scratch, pairs_from_list

if TYPE_CHECKING:
    from riftberg.model import Model


class Stepper(Protocol):
    """Advances the state of a model by one long step, including cells, environment and fragments."""

    def step(self, model: Model) -> None:
        """Advance by one long step; ``model.time`` moves on, ``model.step_number`` does not."""

    def surround(self, model: Model) -> None:
        """Take the environment that the elements carry between two steps from the forcing."""

    def synchronised(self, model: Model) -> tuple[Floats, Floats]:
        """Return the velocity (m s-1) at the time of the positions, after a step; the state stays as it is."""

    def memory(self) -> dict[str, Any]:
        """Return arrays of numbers, beside the state, that a run needs to go on bit for bit."""

    def recall(self, kept: Mapping[str, Any]) -> None:
        """Take up what `memory` gave, from among other arrays."""

    @property
    def applied(self) -> Floats:
        """Mean accelerations (m s-2) over the last step by the forces of `riftberg.stepping.media.FORCES`, as applied.

        Shape (elements, forces, 2): east and north.
        """


class Forgetful:
    """Schemes whose state is all that they need."""

    def memory(self) -> dict[str, Any]:
        """Return nothing."""
        return {}

    def recall(self, kept: Mapping[str, Any]) -> None:
        """Take up nothing."""


def make_stepper(model: Model) -> Stepper:
    """Return the stepper of the scheme that the parameters name."""
    scheme = model.parameters.stepping.scheme
    if scheme == "mts":
        return MultipleStepper(model)
    if scheme == "quasi_static":
        return QuasiStaticStepper(model)
    return VerletStepper(model) if scheme == "verlet" else RungeKuttaStepper(model)


def settle(model: Model) -> None:
    """Find the cells after a move, stop elements at land, wrap longitudes (spec 8)."""
    el, grid = model.elements, model.forcing.grid
    if grid is not None:
        settle_elements(el, grid.arrays, model.constants)
        if model.constants.grid_position_round_trip:
            el.lon_pair[:], el.lat_pair[:] = el.lon, el.lat
            round_trip(el, grid.arrays)
    moving = el.static < 0.5
    el.lon_pair[moving], el.lat_pair[moving] = el.lon[moving], el.lat[moving]


class Neighbourhood:
    """Finds partners for the pair law; bonded pairs are listed anew only when bonds have changed."""

    def __init__(self, model: Model) -> None:
        count = model.elements.mass.size
        self._none = no_pairs(count)
        self._bonded: tuple[PairList, Ints] | None = None
        self._standing = -1

    def bonded(self, model: Model) -> tuple[PairList, Ints]:
        """Partners over unbroken bonds and the bond of each entry."""
        standing = int((model.bonds.status == 0).sum())
        if self._bonded is None or standing != self._standing:
            b = model.bonds
            self._bonded = adjacency(b.first, b.second, b.status, model.elements.mass.size)
            self._standing = standing
        return self._bonded

    def find(self, model: Model, reach: float, rule: int) -> PairList:
        """Partners within ``reach`` metres by the positions that others see."""
        el, c = model.elements, model.constants
        if el.mass.size < 2 or reach <= 0.0:
            return self._none
        return find_pairs(el.lon_pair, el.lat_pair, el.berg, reach, rule, c.latlon, c.earth_radius, c.period)

    def collisions(self, model: Model, sizes: Sizes) -> PairList:
        """Partners of other bergs within reach of contact."""
        if not model.constants.interactions or not (model.elements.berg != model.elements.berg[0]).any():
            return self._none
        return self.find(model, _contact_reach(model, sizes), OTHER_BERG)

    def same_berg(self, model: Model, reach: float) -> PairList:
        """Unbonded partners of the same berg within ``reach``."""
        found = self.find(model, reach, SAME_BERG)
        return without(found, self.bonded(model)[0])

    @property
    def none(self) -> PairList:
        """A list without partners."""
        return self._none


def with_partners(pairs: PairList, allowed: np.ndarray) -> PairList:
    """Return ``pairs`` with only those partners that are allowed (Q21: partners with fewer than ``max_bonds`` bonds)."""
    count = pairs.start.size - 1
    owner = np.repeat(np.arange(count), np.diff(pairs.start))
    keep = allowed[pairs.partner]
    start = np.concatenate([[0], np.cumsum(np.bincount(owner[keep], minlength=count))])
    return PairList(start, pairs.partner[keep])


def without(pairs: PairList, excluded: PairList) -> PairList:
    """Return ``pairs`` less those that stand in ``excluded``."""
    count = pairs.start.size - 1
    owner = np.repeat(np.arange(count), np.diff(pairs.start))
    taken = np.repeat(np.arange(count), np.diff(excluded.start)) * count + excluded.partner
    keep = ~np.isin(owner * count + pairs.partner, taken)
    start = np.concatenate([[0], np.cumsum(np.bincount(owner[keep], minlength=count))])
    return PairList(start, pairs.partner[keep])


def _contact_reach(model: Model, sizes: Sizes) -> float:
    """Largest distance (m) at which two elements can be in contact."""
    return max(2.0 * float(sizes.radius.max()), model.constants.contact_distance)


def _processing_rank(model: Model) -> Ints:
    """Rank of the elements in the reference's order: by row, then column of their cell, newest first (spec 1.6)."""
    el = model.elements
    rank = np.empty(el.mass.size, np.int64)
    rank[np.lexsort((-np.arange(rank.size), el.cell_i, el.cell_j))] = np.arange(rank.size)
    return rank


def _update_fragments(model: Model) -> None:
    """Number fragments after bonds have broken, and forget broken bonds whose ends have parted (spec 1.5)."""
    el, bonds, c = model.elements, model.bonds, model.constants
    if c.broken_as_contact and c.fracture_on_substeps:
        drop_parted_bonds(bonds, connected_parts(el.mass.size, bonds.first, bonds.second, bonds.status))
    else:
        drop_broken_bonds(bonds)
    model.fragments.update(el, bonds, model.time, c)


class MultipleStepper(Forgetful):
    """Multiple time steps (spec 6.4)."""

    def __init__(self, model: Model) -> None:
        self._near = Neighbourhood(model)
        self._rows = allocate_rows(model.bonds, model.elements.mass.size)
        self._pairs = allocate_pairs(max(model.bonds.first.size, 1))
        self._scratch = allocate_scratch(model.elements.mass.size)
        self._around = allocate_surroundings(model.elements.mass.size)
        self._rank = np.arange(model.elements.mass.size)
        c = model.constants
        self._ranked = (c.shared_shear_lever or c.bond_thickness_of_second) and not _uniform(model)
        self._contact_by_bonds = c.dem and c.broken_as_contact and c.fracture_on_substeps

    def step(self, model: Model) -> None:
        """Advance by one long step."""
        el, bonds, c = model.elements, model.bonds, model.constants
        sizes = interaction_sizes(el, c)
        if self._ranked:
            self._rank = _processing_rank(model)
        self._gather_pairs(model, sizes)
        report = advance(
            el, bonds, self._rows, self._pairs, self._partners(model, sizes), self._scratch, sizes, self._around,
            self._rank, self._plan(model), c,
        )  # fmt: skip
        if report.passes < 0:
            raise RunError(
                f"the contact iteration did not settle within {c.max_iterations} passes at {model.date:%Y-%m-%d %H:%M}; "
                "raise contact.tolerance or shorten stepping.time_step"
            )
        settle(model)
        model.time += model.parameters.stepping.time_step
        self.surround(model)
        if report.broken > 0:
            _update_fragments(model)

    def surround(self, model: Model) -> None:
        """Sample at the new positions: the fields of the next step, or with the lag of Q5 of the step just taken."""
        p = model.parameters
        lag = p.stepping.time_step if p.compatibility.forcing_lag else 0.0
        model.forcing.sample(model.elements, model.time - lag)

    def synchronised(self, model: Model) -> tuple[Floats, Floats]:
        """Complete the slow half kick that the next step begins with, on a copy of the elements."""
        c, dt = model.constants, model.parameters.stepping.time_step
        el, _ = copy_state(model.elements, model.bonds)
        sizes = interaction_sizes(el, c)
        slow = Partners(self._near.none, self._near.none, self._near.collisions(model, sizes))
        around = allocate_surroundings(el.mass.size)
        find_surroundings(el, sizes, around, c)
        passes = closing_half_kick(el, dt, around, slow, sizes, plain(pair_law)(c), False, c)
        return (el.u_sync, el.v_sync) if passes >= 0 else (model.elements.u_sync, model.elements.v_sync)

    @property
    def applied(self) -> Floats:
        """See `Stepper.applied`."""
        return self._around.applied

    def _plan(self, model: Model) -> StepPlan:
        p, first = model.parameters, model.step_number == 0
        quirks = p.compatibility
        held = first and p.fracture.not_in_first_step
        inline = p.fracture.on_substeps and (not held or quirks.inline_break_in_first_step)
        after = not p.fracture.on_substeps and not held
        return StepPlan(
            dt=p.stepping.time_step,
            substeps=model.substeps,
            time=model.time,
            starting=first and not quirks.zero_start,
            skip_slow=first and p.stepping.skip_first_long_force,
            search=not self._contact_by_bonds,
            break_inline=p.fracture.enabled and inline,
            break_after=p.fracture.enabled and after,
            # A start that must not break bonds must not wear them either.
            wears=p.damage.enabled and (inline or after),
        )

    def _partners(self, model: Model, sizes: Sizes) -> Partners:
        """Collisions; with spring bonds also bonded pairs and contacts inside the berg, which the sub-steps use."""
        collisions = self._near.collisions(model, sizes)
        if model.constants.dem or not model.constants.bonds_on:
            return Partners(self._near.none, self._near.none, collisions)
        bonded, _ = self._near.bonded(model)
        touching = self._near.same_berg(model, _inner_reach(model, sizes))
        if model.constants.explicit_substeps:
            touching = with_partners(touching, model.elements.bond_count < model.constants.max_bonds)
        return Partners(bonded, touching, collisions)

    def _gather_pairs(self, model: Model, sizes: Sizes) -> None:
        """List the pairs inside bergs that may touch in this step."""
        if not model.constants.dem:
            return
        if self._contact_by_bonds:
            waiting = np.flatnonzero(model.bonds.status == 1)
            self._pairs.first[: waiting.size] = model.bonds.first[waiting]
            self._pairs.second[: waiting.size] = model.bonds.second[waiting]
            self._pairs.bond[: waiting.size] = -1
            self._pairs.count[0] = waiting.size
            return
        found = self._near.find(model, _inner_reach(model, sizes), SAME_BERG)
        if found.partner.size > self._pairs.first.size:
            self._pairs = allocate_pairs(2 * found.partner.size)
        bonded, bond = self._near.bonded(model)
        pairs_from_list(self._pairs, found, bonded, bond)


def _inner_reach(model: Model, sizes: Sizes) -> float:
    """Distance (m) within which elements of one berg may come into contact during a long step.

    Twice the contact distance, or as far as the present relative speeds would carry them in two long steps.
    """
    el, touching = model.elements, 2.0 * float(sizes.bond_radius.max())
    spread = float(np.ptp(el.u) + np.ptp(el.v)) * model.parameters.stepping.time_step
    return touching + max(touching, 2.0 * spread)


def _uniform(model: Model) -> bool:
    """Whether all elements have one size and thickness, so that the order of processing cannot matter."""
    el = model.elements
    return all(bool(np.ptp(a) <= 1e-12 * abs(a[0])) for a in (el.length, el.width, el.thickness))


class SingleStepper(Forgetful):
    """What the single-step schemes share: partners by the rules of spec 5.1."""

    def __init__(self, model: Model) -> None:
        self._near = Neighbourhood(model)
        self._around = allocate_surroundings(model.elements.mass.size)

    @property
    def applied(self) -> Floats:
        """See `Stepper.applied`."""
        return self._around.applied

    def surround(self, model: Model) -> None:
        """Do nothing: these schemes sample within the step."""

    def _partners(self, model: Model, sizes: Sizes) -> Partners:
        c, near = model.constants, self._near
        if not c.interactions:
            return Partners(near.none, near.none, near.none)
        bonded = near.bonded(model)[0] if c.bonds_on else near.none
        if c.plain_kid_branch:
            return Partners(bonded, near.none, near.find(model, 2.0 * float(sizes.radius.max()), ANY))
        touching = near.same_berg(model, 2.0 * float(sizes.radius.max())) if c.bonds_on else near.none
        return Partners(bonded, touching, near.collisions(model, sizes))


class VerletStepper(SingleStepper):
    """Single-step velocity Verlet (spec 6.2)."""

    def step(self, model: Model) -> None:
        """Advance by one step."""
        el, c, dt = model.elements, model.constants, model.parameters.stepping.time_step
        if model.step_number == 0 and c.grid_position_round_trip and model.forcing.grid is not None:
            round_trip(el, model.forcing.grid.arrays)
        model.forcing.sample(el, model.time)
        self._update_velocities(model, el, self._around)
        verlet.update_positions(el, dt, c)
        settle(model)
        el.u_pair[:], el.v_pair[:] = el.u, el.v
        model.time += dt

    def synchronised(self, model: Model) -> tuple[Floats, Floats]:
        """Take the velocity that the next step begins with, on a copy of the elements."""
        el, _ = copy_state(model.elements, model.bonds)
        model.forcing.sample(el, model.time)
        self._update_velocities(model, el, allocate_surroundings(el.mass.size))
        return el.u, el.v

    def _update_velocities(self, model: Model, el: Elements, around: Surroundings) -> None:
        """Update the velocities of ``el``, or impose those that are given: then no force has acted."""
        c, dt = model.constants, model.parameters.stepping.time_step
        sizes = interaction_sizes(el, c)
        verlet.update_velocities(el, self._partners(model, sizes), sizes, around, dt, c)
        imposed = model.parameters.stepping.fixed_velocity
        if imposed is not None:
            verlet.impose_velocity(el, *imposed)
            around.applied[:] = 0.0


class RungeKuttaStepper(SingleStepper):
    """Fourth-order Runge-Kutta (spec 6.3)."""

    def __init__(self, model: Model) -> None:
        super().__init__(model)
        self._stages = runge_kutta.allocate_stages(model.elements.mass.size)
        self._applied = np.zeros_like(self._around.applied)

    @property
    def applied(self) -> Floats:
        """See `Stepper.applied`."""
        return self._applied

    def step(self, model: Model) -> None:
        """Advance by one step; stages go from the cell at the start of the step."""
        el, c, dt = model.elements, model.constants, model.parameters.stepping.time_step
        mean_speeds = model.parameters.stepping.predictor_corrector
        sizes = interaction_sizes(el, c)
        partners = self._partners(model, sizes)
        cells = el.cell_i.copy(), el.cell_j.copy(), el.xi.copy(), el.eta.copy()
        shown = el.lon_pair.copy(), el.lat_pair.copy()
        runge_kutta.begin(el, self._stages)
        self._applied[:] = 0.0
        for stage in range(4):
            if stage > 0:
                runge_kutta.go_to_stage(el, self._stages, stage, runge_kutta.AHEAD[stage], dt, c)
                self._settle_stage(model, cells, shown)
            ahead = 0.0 if model.parameters.compatibility.forcing_lag else runge_kutta.AHEAD[stage] * dt
            model.forcing.sample(el, model.time + ahead)
            runge_kutta.evaluate(
                el,
                self._stages,
                stage,
                runge_kutta.FRACTION[stage],
                partners,
                sizes,
                self._around,
                dt,
                mean_speeds,
                c,
            )
            self._applied += runge_kutta.WEIGHT[stage] * self._around.applied
        runge_kutta.finish(el, self._stages, dt, c)
        self._settle_stage(model, cells, shown)
        settle(model)
        el.u_pair[:], el.v_pair[:] = el.u, el.v
        model.time += dt

    def synchronised(self, model: Model) -> tuple[Floats, Floats]:
        """Return the velocity of the end of the step."""
        return model.elements.u.copy(), model.elements.v.copy()

    @staticmethod
    def _settle_stage(model: Model, cells: tuple[Ints, Ints, Floats, Floats], shown: tuple[Floats, Floats]) -> None:
        """Find the cells of a stage from those at the start; what the others see stays."""
        el, grid = model.elements, model.forcing.grid
        if grid is None:
            return
        el.cell_i[:], el.cell_j[:], el.xi[:], el.eta[:] = cells
        settle_elements(el, grid.arrays, model.constants)
        el.lon_pair[:], el.lat_pair[:] = shown
