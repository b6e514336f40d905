"""The sub-steps of a long step with bonds as beams (equations 6.4, part 3).

Bonds and elements stand in blocks (`riftberg.stepping.explicit.tiles`). A sub-step has two halves: forces of the
bonds, then sums over them, kick, and the drift of the sub-step that follows.
"""

from __future__ import annotations

from typing import NamedTuple

from riftberg.compiled.kernels import kernel, stage
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.explicit import tiles as tile
from riftberg.stepping.explicit.bond_law import (
    accumulate_first_ends,
    apply_bond_law,
    gather_second_ends,
    shift_second_ends,
)
from riftberg.stepping.explicit.bond_rows import BondTiles, may_cross_seam, pack_bonds
from riftberg.stepping.explicit.breaking import ContactPairs, add_contacts, break_overloaded, record_breaks, store_bonds
from riftberg.stepping.explicit.damage import count_loaded, grow_damage
from riftberg.stepping.explicit.element_blocks import (
    accumulate_floor_impulse,
    drift_tile,
    drift_tile_near_pole,
    floor_rates,
    kick_tile,
    pack_contact,
    pack_elements,
    start_tile,
    sum_over_bonds,
    unpack_elements,
    unpack_pair_state,
)
from riftberg.stepping.explicit.outer_kick import begin_substeps, end_substeps
from riftberg.stepping.explicit.springs import (
    SubstepFields,
    Workspace,
    publish_all_velocities,
    reaches_pole,
    store_inner,
)
from riftberg.stepping.explicit.step_plan import StepPlan
from riftberg.stepping.forces.interactions import PairLaw, pair_law
from riftberg.stepping.forces.media import Surroundings
from riftberg.stepping.forces.sizes import Sizes


@stage
def add_pair_contact(
    el: Elements, bonds: Bonds, tiles: BondTiles, pairs: ContactPairs, by_search: bool, fields: SubstepFields, sizes: Sizes,
    law: PairLaw, dt: float, p: KernelParameters,
) -> None:  # fmt: skip
    """Accelerations by contact of elements whose bond has broken, or of bergs that meet.

    Before the bonds act: one that breaks then touches from the next sub-step on.
    """
    if pairs.count[0] > 0:
        unpack_pair_state(tiles, el)
        fields.accel_x[:] = 0.0
        fields.accel_y[:] = 0.0
        soft_dt = 0.0 if p.explicit_contact_damping else dt
        add_contacts(
            pairs, bonds.status, el, sizes, law, fields.accel_x, fields.accel_y, by_search, p.max_bonds, True, soft_dt
        )
        pack_contact(tiles, fields.accel_x, fields.accel_y)


class SubstepFlags(NamedTuple):
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
def apply_bonds(
    bonds: Bonds,
    tiles: BondTiles,
    in_use: Ints,
    scratch: Floats,
    aground: Floats,
    flags: SubstepFlags,
    p: KernelParameters,
) -> int:
    """Forces of the bonds in the blocks ``used`` on their ends, which are shown; returns the number of bonds broken.

    What `record_breaks` has to do for these is left to it: several threads may each go through some blocks.
    """
    width, broken = tile.tile_count(aground.size), 0
    for b in in_use:
        # Views of one block: LLVM sees that no index in it is negative, which an offset from outside would hide.
        bond, e = tiles.bond[b * tile.BOND_TILE : (b + 1) * tile.BOND_TILE], b % width
        ends, sums = (
            tiles.ends[e * tile.END_TILE : (e + 1) * tile.END_TILE],
            tiles.sums[e * tile.SUM_TILE : (e + 1) * tile.SUM_TILE],
        )
        first, end = b * tile.LANES, (b + 1) * tile.LANES
        if b < width:
            shift_second_ends(scratch, tiles.ends[e * tile.END_TILE : (e + 2) * tile.END_TILE])
        else:
            gather_second_ends(scratch, tiles.second_end[first:end], tiles.ends)
        apply_bond_law(
            bond, scratch, ends, flags.dt, p.poisson, p.objective_damping, p.no_shear, p.linear_bending,
            p.flat_relative_velocity, p.latlon, p.earth_radius, flags.period,
        )  # fmt: skip
        if flags.grow_damage:
            grow_damage(bond, scratch, flags.dt, p)
        if flags.may_break and count_loaded(bond, scratch, 1.0) > 0:
            broken += break_overloaded(
                tiles.bond_ids[first:end], bond, scratch, ends, tiles.rotation, bonds, aground, flags.time
            )
        if flags.last:
            store_bonds(tiles.bond_ids[first:end], bonds, bond, scratch, tiles.rotation)
        accumulate_first_ends(bond, scratch, sums)
    return broken


@kernel
def substep_flags(n: int, plan: StepPlan, period: float) -> SubstepFlags:
    """What happens to the bonds in sub-step ``n``; -1 is the evaluation before the first, in which no time passes."""
    moving = n >= 0
    dt = plan.dt / plan.substeps if moving else 0.0
    may_break, grow_damage = plan.break_inline and moving, plan.grow_damage and moving
    return SubstepFlags(dt, plan.time + (n + 1) * dt, may_break, grow_damage, n == plan.substeps - 1, period)


@kernel
def _drift_tile(tiles: BondTiles, b: int, dt: float, near_pole: bool, p: KernelParameters) -> None:
    """Move the elements of block ``b`` to the positions of a sub-step, and show them."""
    q1 = p.swapped_implicit_velocity and not p.explicit_substeps
    elem, ends = (
        tiles.elem[b * tile.ELEMENT_TILE : (b + 1) * tile.ELEMENT_TILE],
        tiles.ends[b * tile.END_TILE : (b + 1) * tile.END_TILE],
    )
    rotation = tiles.rotation[b * tile.LANES : (b + 1) * tile.LANES]
    if near_pole:
        drift_tile_near_pole(elem, ends, rotation, dt, p.earth_radius, q1)
    else:
        drift_tile(elem, ends, rotation, dt, p.latlon, p.earth_radius, q1)


@kernel
def _kick_tile(
    tiles: BondTiles,
    b: int,
    scratch: Floats,
    dt: float,
    first: bool,
    floor_acts: bool,
    floor_varies: bool,
    implicit: bool,
) -> None:
    """Complete a sub-step for the elements of block ``b``; ``first`` is the evaluation before the first one."""
    elem, ends = (
        tiles.elem[b * tile.ELEMENT_TILE : (b + 1) * tile.ELEMENT_TILE],
        tiles.ends[b * tile.END_TILE : (b + 1) * tile.END_TILE],
    )
    sums, slots = (
        tiles.sums[b * tile.SUM_TILE : (b + 1) * tile.SUM_TILE],
        tiles.slots[b * tile.LANES : (b + 1) * tile.LANES],
    )
    sum_over_bonds(scratch, sums, slots, tiles.bond)
    if floor_varies:
        floor_rates(elem, 0.0 if first else dt)
    if first:
        start_tile(elem, ends, scratch, dt, implicit)
        return
    if floor_acts and not implicit:
        accumulate_floor_impulse(elem)
    kick_tile(elem, ends, scratch, dt, implicit)
    if floor_acts and implicit:
        accumulate_floor_impulse(elem)


class StepContext(NamedTuple):
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
) -> StepContext:  # fmt: skip
    """Lay out bonds and elements for the sub-steps, and move the elements to the positions of the first one."""
    tiles, fields, whole = work.tiles, work.fields, plan.dt / plan.substeps
    floor_acts, floor_varies = begin_substeps(el, around, fields, sizes, whole, p)
    near_pole = p.latlon and reaches_pole(el.place.lat)
    count = pack_bonds(tiles, el, bonds, sizes, rank, p)
    pack_elements(tiles, el, fields)
    period = p.period if may_cross_seam(el.shown.lon_pair, p.period) else 0.0
    if first_substep(plan, p) == 0:
        for b in range(tile.tile_count(el.place.lon.size)):
            _drift_tile(tiles, b, whole, near_pole, p)
    return StepContext(count, floor_acts, floor_varies, near_pole, period)


@kernel
def first_substep(plan: StepPlan, p: KernelParameters) -> int:
    """Return 0, or -1: with a proper start, one evaluation without moving stands before the first sub-step."""
    return -1 if plan.starting and p.bonds_on else 0


@kernel
def kick_and_drift(
    tiles: BondTiles,
    begin: int,
    end: int,
    scratch: Floats,
    n: int,
    plan: StepPlan,
    context: StepContext,
    p: KernelParameters,
) -> None:
    """Kick the elements of blocks ``begin`` to ``end`` in sub-step ``n``, and move them to the positions of the next one."""
    whole, implicit = plan.dt / plan.substeps, p.ground_implicit
    for b in range(begin, end):
        _kick_tile(tiles, b, scratch, whole, n < 0, context.floor_acts, context.floor_varies, implicit)
        if n < plan.substeps - 1:
            _drift_tile(tiles, b, whole, context.near_pole, p)


@stage
def end_beams(
    el: Elements, work: Workspace, around: Surroundings, plan: StepPlan, context: StepContext, p: KernelParameters
) -> None:
    """Give the elements back to the state after the sub-steps."""
    unpack_elements(work.tiles, el, work.fields)
    if p.iterate:
        store_inner(el)
    if context.floor_acts:
        end_substeps(around, work.fields, plan.substeps)
    publish_all_velocities(el, el.motion.u, el.motion.v)


@stage
def take_substeps_of_beams(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps, with bonds as beams; returns the number of bonds broken.

    `riftberg.stepping.explicit.threads` does the same with some threads.
    """
    tiles, pairs, fields, law = work.tiles, work.pairs, work.fields, pair_law(p)
    context = begin_beams(el, bonds, work, sizes, around, rank, plan, p)
    in_use, blocks, broken = tiles.in_use[: context.count], tile.tile_count(el.place.lon.size), 0
    for n in range(first_substep(plan, p), plan.substeps):
        flags = substep_flags(n, plan, context.period)
        add_pair_contact(el, bonds, tiles, pairs, plan.by_search, fields, sizes, law, flags.dt, p)
        now = apply_bonds(bonds, tiles, in_use, tiles.scratch, fields.aground, flags, p)
        if now > 0:
            record_breaks(tiles, bonds, el.body.bond_count, pairs, flags.time, p.broken_as_contact)
            broken += now
        kick_and_drift(tiles, 0, blocks, tiles.scratch, n, plan, context, p)
    end_beams(el, work, around, plan, context, p)
    return broken
