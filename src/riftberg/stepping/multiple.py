"""Multiple-time-step velocity Verlet: slow half kick, sub-steps of the bonds, slow half kick (equations 6.4)."""

from __future__ import annotations

from typing import NamedTuple

from riftberg.kernels import borrower, kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping import bond_blocks as row
from riftberg.stepping.bond_rows import BondRows, crosses, load_rows
from riftberg.stepping.conglomerates import break_after_step
from riftberg.stepping.element_blocks import (
    drift_block,
    drift_block_near_pole,
    kick_block,
    load_elements,
    rates_of_floor,
    start_block,
    stopped_by_floor,
    store_elements,
    sum_over_bonds,
)
from riftberg.stepping.implicit_substep import implicit_kick
from riftberg.stepping.interactions import Partners, pair_law
from riftberg.stepping.long_kick import (
    SlowRoom,
    allocate_slow_room,
    begin_substeps,
    closing_half_kick,
    end_substeps,
    opening_half_kick,
)
from riftberg.stepping.media import Surroundings, find_surroundings
from riftberg.stepping.sizes import Sizes
from riftberg.stepping.substep import (
    Room,
    act_on_ends,
    add_collisions,
    drift,
    drift_near_pole,
    floor_rates,
    kick,
    show_velocities,
    spring_accelerations,
    sum_stopped,
)

POLAR_LATITUDE = 88.0
"""North of this (degrees) the tangent plane may be needed within a long step."""


class StepPlan(NamedTuple):
    """What holds for one long step.

    Attributes
    ----------
    dt : float
        Length of the long step, s.
    substeps : int
    time : float
        Seconds since the start at its beginning.
    starting : bool
        First step with a proper start: evaluate all forces before moving.
    skip_slow : bool
        Leave out the slow forces (skip_first_outer_mts_step).
    search : bool
        Contact inside a berg goes over candidates of a search, not over broken bonds.
    break_inline, break_after : bool
        Test for fracture in every sub-step, or once after the closing half kick.
    wears : bool
        Stress takes from the strength of the bonds, in every sub-step.
    kicks : bool
        Apply the slow forces at its start: both half kicks, and fracture after the step before.
    moves : bool
        Take its sub-steps.
    closes : bool
        Apply nothing but the slow half kick that completes the step before, for the velocity at the time of the positions.
    """

    dt: float
    substeps: int
    time: float
    starting: bool
    skip_slow: bool
    search: bool
    break_inline: bool
    break_after: bool
    wears: bool
    kicks: bool = True
    moves: bool = True
    closes: bool = False


class StepReport(NamedTuple):
    """Bonds broken in the long step and passes of the contact iteration (-1: it did not settle)."""

    broken: int
    passes: int


@kernel
def _reaches_pole(lat: Floats) -> bool:
    """Whether an element stands so far north that it may come near the pole within a long step."""
    near = False
    for at in lat:
        near = near or at > POLAR_LATITUDE
    return near


@stage
def _remember_fast(el):
    """Keep the fast accelerations of this sub-step where the reference keeps them."""
    ax, ay, bx, by = el.kicks.ax, el.kicks.ay, el.kicks.bx, el.kicks.by
    ax_fast, ay_fast, bx_fast, by_fast = el.kicks.ax_fast, el.kicks.ay_fast, el.kicks.bx_fast, el.kicks.by_fast
    for e in range(ax.size):
        ax[e], ay[e], bx[e], by[e] = ax_fast[e], ay_fast[e], bx_fast[e], by_fast[e]


@stage
def _start_fast(el, scratch, implicit_ground):
    """Take the accelerations just found as those before the first sub-step, so that it has its first half kick.

    What the sea floor does in that half kick is kept with what it does in the sub-steps.
    """
    motion, kicks = el.motion, el.kicks
    for e in range(motion.u.size):
        rate = 0.0 if implicit_ground else scratch.active[e] * scratch.ground_rate[e]
        kicks.ax_fast[e] = scratch.active[e] * scratch.accel_x[e] - rate * motion.u[e]
        kicks.ay_fast[e] = scratch.active[e] * scratch.accel_y[e] - rate * motion.v[e]
        scratch.stopped_x[e] -= 0.5 * rate * motion.u[e]
        scratch.stopped_y[e] -= 0.5 * rate * motion.v[e]


@stage
def _drift_and_show(el, scratch, dt, near_pole, p):
    """Positions of the sub-step, on the tangent plane if an element may be near the pole."""
    q1 = p.swapped_implicit_velocity and not p.explicit_substeps
    if near_pole:
        drift_near_pole(el, scratch.active, dt, p.earth_radius, q1)
    else:
        drift(el, scratch.active, dt, p.latlon, p.earth_radius, q1)


@stage
def _kick(el, scratch, dt, floor_acts, implicit_ground):
    """Update the velocities and show them, and keep what the sea floor did to them where it acts."""
    if floor_acts and not implicit_ground:
        sum_stopped(el, scratch)
    kick(el, scratch, dt, implicit_ground)
    if floor_acts and implicit_ground:
        sum_stopped(el, scratch)
    show_velocities(el, scratch.active)


@stage
def _kick_slowly(
    el: Elements, bonds: Bonds, partners: Partners, room: SlowRoom, sizes: Sizes, around: Surroundings, plan: StepPlan,
    p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """Apply the slow forces; returns what `StepReport` holds."""
    find_surroundings(el, sizes, around, p)
    if plan.skip_slow:
        return 0, 1
    passes = closing_half_kick(el, plan.dt, around, partners, room, sizes, pair_law(p), plan.starting, p)
    if passes < 0 or plan.closes:
        return 0, passes
    broken = 0
    if plan.break_after:
        broken = break_after_step(el, bonds, p.normal_strength, p.shear_strength, plan.time)
    opening_half_kick(el, plan.dt, sizes, p)
    return broken, passes


def take_long_step(
    el: Elements, bonds: Bonds, room: Room, slow: Partners, fast: Partners, sizes: Sizes, around: Surroundings,
    earlier: Ints, plan: StepPlan, p: KernelParameters,
) -> StepReport:  # fmt: skip
    """Apply the slow forces and take the sub-steps of a long step; cells, environment and conglomerates are the caller's.

    One call for both, for to hand the state to compiled code takes some 40 us; and one kernel, for what is compiled by
    itself and again within another takes twice as long. Where bergs take different numbers of sub-steps, the slow forces
    are applied to all at once (``plan.moves`` false), and each batch moves for itself (``plan.kicks`` false).

    Parameters
    ----------
    el, bonds : Elements, Bonds
        The state, changed in place.
    room : Room
        Room for the sub-steps, with the pairs that may touch.
    slow : Partners
        Collisions between bergs.
    fast : Partners
        With spring bonds, bonded pairs and contacts inside a berg.
    sizes : Sizes
    around : Surroundings
        The slow part fills it from the environment that the elements carry; afterwards it holds the forces that were
        applied. The sea floor may act in the sub-steps.
    earlier : array of int
        Rank of the elements in the order of processing (quirks Q10, Q11).
    plan : StepPlan
    p : KernelParameters

    Returns
    -------
    StepReport
    """
    slow_room = allocate_slow_room(el.size, slow)
    if p.dem:
        return StepReport(*_step_of_beams(el, bonds, room, slow, slow_room, sizes, around, earlier, plan, p))
    fast_room = allocate_slow_room(el.size, fast)
    return StepReport(*_step_of_springs(el, bonds, room, slow, slow_room, fast, fast_room, sizes, around, plan, p))


class Pace(NamedTuple):
    """A sub-step: its length (s); whether it is the evaluation before the first; whether the floor acts, and with the speed."""

    dt: float
    first: bool
    floor_acts: bool
    floor_varies: bool


@kernel
def _drift_block(rows: BondRows, b: int, dt: float, near_pole: bool, p: KernelParameters) -> None:
    """Move the elements of block ``b`` to the positions of a sub-step, and show them."""
    q1 = p.swapped_implicit_velocity and not p.explicit_substeps
    own, ends = rows.own[b * row.OWN : (b + 1) * row.OWN], rows.ends[b * row.ENDS : (b + 1) * row.ENDS]
    turned = rows.turned[b * row.LANES : (b + 1) * row.LANES]
    if near_pole:
        drift_block_near_pole(own, ends, turned, dt, p.earth_radius, q1)
    else:
        drift_block(own, ends, turned, dt, p.latlon, p.earth_radius, q1)


@kernel
def _kick_block(rows: BondRows, b: int, sheet: Floats, pace: Pace, implicit: bool) -> None:
    """Complete a sub-step for the elements of block ``b``."""
    own, ends = rows.own[b * row.OWN : (b + 1) * row.OWN], rows.ends[b * row.ENDS : (b + 1) * row.ENDS]
    sums, slot = rows.sums[b * row.SUMS : (b + 1) * row.SUMS], rows.slot[b * row.LANES : (b + 1) * row.LANES]
    sum_over_bonds(sheet, sums, slot, rows.block)
    if pace.floor_varies:
        rates_of_floor(own, 0.0 if pace.first else pace.dt)
    if pace.first:
        start_block(own, ends, sheet, pace.dt, implicit)
        return
    if pace.floor_acts and not implicit:
        stopped_by_floor(own)
    kick_block(own, ends, sheet, pace.dt, implicit)
    if pace.floor_acts and implicit:
        stopped_by_floor(own)


@stage
def _take_substeps_of_beams(
    el: Elements, bonds: Bonds, room: Room, sizes: Sizes, around: Surroundings, earlier: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps, with bonds as beams; returns the number of bonds broken."""
    rows, pairs, scratch, law = room.rows, room.pairs, room.scratch, pair_law(p)
    whole = plan.dt / plan.substeps
    floor_acts, floor_varies = begin_substeps(el, around, scratch, sizes, whole, p)
    near_pole = p.latlon and _reaches_pole(el.place.lat)
    broken = 0
    count = load_rows(rows, el, bonds, sizes, earlier, p)
    load_elements(rows, el, scratch)
    period = p.period if crosses(el.shown.lon_pair, p.period) else 0.0
    blocks, last = row.blocks_of(el.place.lon.size), plan.substeps - 1
    # With a proper start, one evaluation without moving stands before the first sub-step.
    start = -1 if plan.starting and p.bonds_on else 0
    if start == 0:
        for b in range(blocks):
            _drift_block(rows, b, whole, near_pole, p)
    for n in range(start, plan.substeps):
        moving = n >= 0
        dt = whole if moving else 0.0
        now, may_break, wears = plan.time + (n + 1) * dt, plan.break_inline and moving, plan.wears and moving
        broken += act_on_ends(
            el, bonds, rows, count, pairs, plan.search, scratch, sizes, law, dt, now, may_break, wears, n == last, period, p,
        )  # fmt: skip
        pace = Pace(whole, not moving, floor_acts, floor_varies)
        for b in range(blocks):
            _kick_block(rows, b, rows.sheet, pace, p.ground_implicit)
            if n < last:
                _drift_block(rows, b, whole, near_pole, p)
    store_elements(rows, el, scratch)
    if p.iterate:
        _remember_fast(el)
    if floor_acts:
        end_substeps(around, scratch, plan.substeps)
    _show_all(el)
    return broken


@stage
def _take_substeps_of_springs(
    el: Elements, bonds: Bonds, room: Room, fast: Partners, fast_room: SlowRoom, sizes: Sizes, around: Surroundings,
    plan: StepPlan, p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps, with bonds as springs; returns the passes of the iteration, as `StepReport` does."""
    pairs, scratch, law = room.pairs, room.scratch, pair_law(p)
    floor_acts, floor_varies = begin_substeps(el, around, scratch, sizes, plan.dt / plan.substeps, p)
    near_pole = p.latlon and _reaches_pole(el.place.lat)
    passes = 1
    explicit = p.explicit_substeps
    # With a proper start, one evaluation without moving stands before the first sub-step.
    for n in range(-1 if plan.starting and p.bonds_on else 0, plan.substeps):
        moving = n >= 0
        dt = plan.dt / plan.substeps if moving else 0.0
        if moving:
            _drift_and_show(el, scratch, dt, near_pole, p)
        if explicit or not moving:
            spring_accelerations(el, fast, p.constant_size, scratch, sizes, law)
            add_collisions(pairs, bonds, el, sizes, law, scratch, p.max_bonds, dt)
        if floor_varies:
            floor_rates(el, scratch, dt)
        if not moving:
            _start_fast(el, scratch, p.ground_implicit)
            continue
        if explicit:
            _kick(el, scratch, dt, floor_acts, p.ground_implicit)
        else:
            passes = implicit_kick(el, dt, around, fast, fast_room, sizes, law, scratch, p)
            if passes < 0:
                return passes
            show_velocities(el, scratch.active)
        if p.iterate and not explicit:
            _remember_fast(el)
    if p.iterate:
        _remember_fast(el)
    if floor_acts:
        end_substeps(around, scratch, plan.substeps)
    _show_all(el)
    return passes


@stage
def _show_all(el: Elements) -> None:
    """Let the others see the velocities after the sub-steps, of those too that waited."""
    u, v, u_shown, v_shown, static = (
        el.motion.u, el.motion.v, el.shown.u_pair, el.shown.v_pair, el.body.static,
    )  # fmt: skip
    for e in range(u.size):
        if static[e] < 0.5:
            u_shown[e], v_shown[e] = u[e], v[e]


@borrower
def _step_of_beams(
    el: Elements, bonds: Bonds, room: Room, slow: Partners, slow_room: SlowRoom, sizes: Sizes, around: Surroundings,
    earlier: Ints, plan: StepPlan, p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """Return what `StepReport` holds; see `riftberg.kernels` why no named tuple.

    Beams and springs have a kernel each: together they take half as long again to compile, and a run needs one of them.
    """
    broken, passes = 0, 1
    if plan.kicks:
        broken, passes = _kick_slowly(el, bonds, slow, slow_room, sizes, around, plan, p)
    if plan.moves and passes >= 0:
        broken += _take_substeps_of_beams(el, bonds, room, sizes, around, earlier, plan, p)
        passes = 1
    return broken, passes


@borrower
def _step_of_springs(
    el: Elements, bonds: Bonds, room: Room, slow: Partners, slow_room: SlowRoom, fast: Partners, fast_room: SlowRoom,
    sizes: Sizes, around: Surroundings, plan: StepPlan, p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """As `_step_of_beams`."""
    broken, passes = 0, 1
    if plan.kicks:
        broken, passes = _kick_slowly(el, bonds, slow, slow_room, sizes, around, plan, p)
    if plan.moves and passes >= 0:
        passes = _take_substeps_of_springs(el, bonds, room, fast, fast_room, sizes, around, plan, p)
    return broken, passes
