"""The sub-steps of a long step with bonds as beams (equations 6.4, part 3).

Bonds and elements stand in blocks (`riftberg.stepping.explicit.bond_blocks`). A sub-step has two halves: forces of the
bonds, then sums over them, kick, and the drift of the sub-step that follows.
"""

from __future__ import annotations

from typing import NamedTuple

from riftberg.compiled.kernels import kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.explicit import bond_blocks as row
from riftberg.stepping.explicit.bond_law import add_to_first, apply_bond_law, gather_ends, next_ends
from riftberg.stepping.explicit.bond_rows import BondRows, crosses, load_rows
from riftberg.stepping.explicit.breaking import ContactPairs, add_contacts, break_overloaded, note_all, record_breaks
from riftberg.stepping.explicit.damage import damage_rows, loaded
from riftberg.stepping.explicit.element_blocks import (
    drift_block,
    drift_block_near_pole,
    kick_block,
    load_elements,
    rates_of_floor,
    show_elements,
    start_block,
    stopped_by_floor,
    store_elements,
    sum_over_bonds,
    take_contact,
)
from riftberg.stepping.explicit.outer_kick import begin_substeps, end_substeps
from riftberg.stepping.explicit.springs import Workspace, publish_all_velocities, reaches_pole, store_inner
from riftberg.stepping.explicit.step_plan import StepPlan
from riftberg.stepping.forces.interactions import PairLaw, pair_law
from riftberg.stepping.forces.media import Surroundings
from riftberg.stepping.forces.scratch import Scratch
from riftberg.stepping.forces.sizes import Sizes


@stage
def touch_broken(
    el: Elements, bonds: Bonds, rows: BondRows, pairs: ContactPairs, by_search: bool, scratch: Scratch, sizes: Sizes,
    law: PairLaw, dt: float, p: KernelParameters,
) -> None:  # fmt: skip
    """Accelerations by contact of elements whose bond has broken, or of bergs that meet.

    Before the bonds act: one that breaks then touches from the next sub-step on.
    """
    if pairs.count[0] > 0:
        show_elements(rows, el)
        scratch.accel_x[:] = 0.0
        scratch.accel_y[:] = 0.0
        soft_dt = 0.0 if p.explicit_contact_damping else dt
        add_contacts(
            pairs, bonds.status, el, sizes, law, scratch.accel_x, scratch.accel_y, by_search, p.max_bonds, True, soft_dt
        )
        take_contact(rows, scratch.accel_x, scratch.accel_y)


class BondTest(NamedTuple):
    """A sub-step as the bonds meet it.

    Its length, and the time since the start at its end, s; whether to test for fracture at all; whether stress takes from the
    strength; whether what the bonds bear goes to the state; period of x, where bonds may lie across its seam, else 0.
    """

    dt: float
    time: float
    may_break: bool
    grow_damage: bool
    last: bool
    period: float


@stage
def act_on_ends(
    bonds: Bonds, rows: BondRows, used: Ints, sheet: Floats, aground: Floats, test: BondTest, p: KernelParameters
) -> int:
    """Forces of the bonds in the blocks ``used`` on their ends, which are shown; returns the number of bonds broken.

    What `record_breaks` has to do for these is left to it: several threads may each go through some blocks.
    """
    width, broken = row.blocks_of(aground.size), 0
    for b in used:
        # Views of one block: LLVM sees that no index in it is negative, which an offset from outside would hide.
        block, e = rows.block[b * row.BLOCK : (b + 1) * row.BLOCK], b % width
        ends, sums = rows.ends[e * row.ENDS : (e + 1) * row.ENDS], rows.sums[e * row.SUMS : (e + 1) * row.SUMS]
        first, end = b * row.LANES, (b + 1) * row.LANES
        if b < width:
            next_ends(sheet, rows.ends[e * row.ENDS : (e + 2) * row.ENDS])
        else:
            gather_ends(sheet, rows.second[first:end], rows.ends)
        apply_bond_law(
            block, sheet, ends, test.dt, p.poisson, p.objective_damping, p.no_shear, p.linear_bending,
            p.flat_relative_velocity, p.latlon, p.earth_radius, test.period,
        )  # fmt: skip
        if test.grow_damage:
            damage_rows(block, sheet, test.dt, p)
        if test.may_break and loaded(block, sheet, 1.0) > 0:
            broken += break_overloaded(rows.bond[first:end], block, sheet, ends, rows.turned, bonds, aground, test.time)
        if test.last:
            note_all(rows.bond[first:end], bonds, block, sheet, rows.turned)
        add_to_first(block, sheet, sums)
    return broken


@kernel
def bond_test(n: int, plan: StepPlan, period: float) -> BondTest:
    """What happens to the bonds in sub-step ``n``; -1 is the evaluation before the first, in which no time passes."""
    moving = n >= 0
    dt = plan.dt / plan.substeps if moving else 0.0
    may_break, grow_damage = plan.break_inline and moving, plan.grow_damage and moving
    return BondTest(dt, plan.time + (n + 1) * dt, may_break, grow_damage, n == plan.substeps - 1, period)


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
def _kick_block(
    rows: BondRows, b: int, sheet: Floats, dt: float, first: bool, floor_acts: bool, floor_varies: bool, implicit: bool
) -> None:
    """Complete a sub-step for the elements of block ``b``; ``first`` is the evaluation before the first one."""
    own, ends = rows.own[b * row.OWN : (b + 1) * row.OWN], rows.ends[b * row.ENDS : (b + 1) * row.ENDS]
    sums, slot = rows.sums[b * row.SUMS : (b + 1) * row.SUMS], rows.slot[b * row.LANES : (b + 1) * row.LANES]
    sum_over_bonds(sheet, sums, slot, rows.block)
    if floor_varies:
        rates_of_floor(own, 0.0 if first else dt)
    if first:
        start_block(own, ends, sheet, dt, implicit)
        return
    if floor_acts and not implicit:
        stopped_by_floor(own)
    kick_block(own, ends, sheet, dt, implicit)
    if floor_acts and implicit:
        stopped_by_floor(own)


class Conditions(NamedTuple):
    """What holds in all sub-steps of a long step, with bonds as beams.

    Blocks of rows in use; whether the sea floor acts, and changes with the speed; whether an element may come near the pole;
    period of x, where bonds may lie across its seam, else 0.
    """

    count: int
    floor_acts: bool
    floor_varies: bool
    near_pole: bool
    period: float


@stage
def begin_beams(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> Conditions:  # fmt: skip
    """Lay out bonds and elements for the sub-steps, and move the elements to the positions of the first one."""
    rows, scratch, whole = work.rows, work.scratch, plan.dt / plan.substeps
    floor_acts, floor_varies = begin_substeps(el, around, scratch, sizes, whole, p)
    near_pole = p.latlon and reaches_pole(el.place.lat)
    count = load_rows(rows, el, bonds, sizes, rank, p)
    load_elements(rows, el, scratch)
    period = p.period if crosses(el.shown.lon_pair, p.period) else 0.0
    if first_substep(plan, p) == 0:
        for b in range(row.blocks_of(el.place.lon.size)):
            _drift_block(rows, b, whole, near_pole, p)
    return Conditions(count, floor_acts, floor_varies, near_pole, period)


@kernel
def first_substep(plan: StepPlan, p: KernelParameters) -> int:
    """Return 0, or -1: with a proper start, one evaluation without moving stands before the first sub-step."""
    return -1 if plan.starting and p.bonds_on else 0


@kernel
def complete_substep(
    rows: BondRows, begin: int, end: int, sheet: Floats, n: int, plan: StepPlan, on: Conditions, p: KernelParameters
) -> None:
    """Kick the elements of blocks ``begin`` to ``end`` in sub-step ``n``, and move them to the positions of the next one."""
    whole, implicit = plan.dt / plan.substeps, p.ground_implicit
    for b in range(begin, end):
        _kick_block(rows, b, sheet, whole, n < 0, on.floor_acts, on.floor_varies, implicit)
        if n < plan.substeps - 1:
            _drift_block(rows, b, whole, on.near_pole, p)


@stage
def end_beams(
    el: Elements, work: Workspace, around: Surroundings, plan: StepPlan, on: Conditions, p: KernelParameters
) -> None:
    """Give the elements back to the state after the sub-steps."""
    store_elements(work.rows, el, work.scratch)
    if p.iterate:
        store_inner(el)
    if on.floor_acts:
        end_substeps(around, work.scratch, plan.substeps)
    publish_all_velocities(el, el.motion.u, el.motion.v)


@stage
def take_substeps_of_beams(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps, with bonds as beams; returns the number of bonds broken.

    `riftberg.stepping.explicit.threads` does the same with some threads.
    """
    rows, pairs, scratch, law = work.rows, work.pairs, work.scratch, pair_law(p)
    on = begin_beams(el, bonds, work, sizes, around, rank, plan, p)
    used, blocks, broken = rows.used[: on.count], row.blocks_of(el.place.lon.size), 0
    for n in range(first_substep(plan, p), plan.substeps):
        test = bond_test(n, plan, on.period)
        touch_broken(el, bonds, rows, pairs, plan.by_search, scratch, sizes, law, test.dt, p)
        now = act_on_ends(bonds, rows, used, rows.sheet, scratch.aground, test, p)
        if now > 0:
            record_breaks(rows, bonds, el.body.bond_count, pairs, test.time, p.broken_as_contact)
            broken += now
        complete_substep(rows, 0, blocks, rows.sheet, n, plan, on, p)
    end_beams(el, work, around, plan, on, p)
    return broken
