"""The sub-steps of a long step with bonds as beams (docs/explanation/equations.md, 6.4).

Bonds and elements stand in tiles (`riftberg.engines.explicit.tiles`). A sub-step goes through the elements once: forces of the
bonds that begin in a tile, and, as soon as all bonds of a tile of elements are done, the sums over them, the kick, and the drift
to the positions of the sub-step that follows. So forces are summed while they are in the cache.

Several sub-steps go through the elements together, one close behind the other, so that bonds and elements of a large berg
come out of memory once for all of them. One that follows takes the bonds of a tile as soon as the one before has moved on all
elements that they see. So each does what it would do alone, in the same order, to the last bit. Where a bond breaks, those
behind stop: its ends have not been moved on yet, so they have not met these. They go on from where they stand when the break
has been recorded; one by one if anything may touch, since contact looks at all elements at one time.
"""

from __future__ import annotations

from typing import NamedTuple

from riftberg.compiled.kernels import kernel, stage
from riftberg.engines.common.forces.media import Surroundings
from riftberg.engines.common.forces.pair_law import PairLaw, pair_law
from riftberg.engines.common.forces.sizes import Sizes
from riftberg.engines.explicit import tiles as tile
from riftberg.engines.explicit.contact import add_contacts
from riftberg.engines.explicit.fracture import break_overloaded, count_overloaded, record_breaks, store_bonds
from riftberg.engines.explicit.substeps import (
    StepPlan,
    SubstepFields,
    Workspace,
    begin_substeps,
    end_substeps,
    publish_all_velocities,
    reaches_pole,
    store_inner,
)
from riftberg.engines.explicit.tile_kernels import (
    accumulate_first_ends,
    accumulate_floor_impulse,
    apply_bond_law,
    drift_tile,
    drift_tile_near_pole,
    floor_rates,
    gather_second_ends,
    kick_tile,
    shift_second_ends,
    start_tile,
    sum_over_bonds,
)
from riftberg.engines.explicit.tiles import BondTiles, may_cross_seam, pack, pack_bonds, unpack
from riftberg.parameters import KernelParameters
from riftberg.state import Body, Bonds, Elements, Floats, Ints, Kicks, Motion, Shown


class SubstepFlags(NamedTuple):
    """A sub-step as the bonds meet it."""

    dt: float  # Its length, s
    time: float  # Time since the start at its end, s
    may_break: bool  # Whether to test for fracture at all
    last: bool  # Whether to store stresses and lengths in the state
    period: float  # Period of x, where bonds may lie across its seam, else 0


class StepContext(NamedTuple):
    """What holds in all sub-steps of a long step."""

    bond_tiles: int  # Tiles of bonds in use
    floor_acts: bool
    floor_varies: bool  # Whether the drag of the sea floor grows with the speed
    near_pole: bool  # Whether an element may come near the pole
    period: float  # Period of x, where bonds may lie across its seam, else 0


@stage
def take_substeps_of_beams(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, surroundings: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps; returns the number of bonds broken."""
    tiles, pairs, law, broken = work.tiles, work.pairs, pair_law(p), 0
    context = _step_context(el, bonds, work, sizes, surroundings, rank, plan, p)
    n = _first_substep(plan, p)
    while n < plan.substeps:
        # Contact before the bonds: one that breaks in this sub-step touches from the next one on.
        _add_contact(el, bonds, work, plan.by_search, sizes, law, _substep_flags(n, plan, context.period).dt, p)
        end = n + 1 if pairs.used[0] > 0 else min(n + plan.at_once, plan.substeps)
        n, newly_broken = _take_substeps(bonds, tiles, work.fields.aground, n, end, plan, context, p)
        if newly_broken > 0:
            time = _substep_flags(n - 1, plan, context.period).time
            record_breaks(tiles, bonds, el.body.bond_count, pairs, time, p.broken_as_contact)
            broken += newly_broken
    _end(el, work, surroundings, plan, context, p)
    return broken


@stage
def _step_context(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, surroundings: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> StepContext:  # fmt: skip
    """Pack bonds and elements into tiles, and move the elements to the positions of the first sub-step."""
    tiles, fields, dt = work.tiles, work.fields, plan.dt / plan.substeps
    floor_acts, floor_varies = begin_substeps(el, surroundings, fields, sizes, dt, p)
    near_pole = p.latlon and reaches_pole(el.place.lat)
    count = pack_bonds(tiles, el, bonds, sizes, rank, p)
    pack_elements(tiles, el, fields)
    # Without a period the law looks for no nearest images: most bergs lie far from any seam.
    period = p.period if may_cross_seam(el.shown.lon_pair, p.period) else 0.0
    if _first_substep(plan, p) == 0:
        for b in range(tile.tile_count(el.place.lon.size)):
            _drift(tiles, b, dt, near_pole, p)
    return StepContext(count, floor_acts, floor_varies, near_pole, period)


@stage
def pack_elements(tiles: BondTiles, el: Elements, fields: SubstepFields) -> None:
    """Pack the elements into tiles; nothing has been summed, nothing has turned, and no sub-step has begun."""
    tiles.elem[:] = 0.0
    tiles.sums[:] = 0.0
    tiles.rotation[:] = 0.0
    tiles.fronts[:] = 0
    _pack_motion(tiles, el.shown, el.motion, el.kicks)
    _pack_bodies(tiles.elem, el.body, fields)


@kernel
def _pack_motion(tiles: BondTiles, shown: Shown, motion: Motion, kicks: Kicks) -> None:
    """Place, motion and accelerations; elements that do not move keep the values that pair forces saw before."""
    elem, ends = tiles.elem, tiles.ends
    pack(ends, tile.END_TILE, tile.X, shown.lon_pair)
    pack(ends, tile.END_TILE, tile.Y, shown.lat_pair)
    pack(ends, tile.END_TILE, tile.U, shown.u_pair)
    pack(ends, tile.END_TILE, tile.V, shown.v_pair)
    pack(ends, tile.END_TILE, tile.SPIN, motion.spin)
    pack(ends, tile.END_TILE, tile.ANGLE, motion.rotation)
    pack(elem, tile.ELEMENT_TILE, tile.VELOCITY_X, motion.u)
    pack(elem, tile.ELEMENT_TILE, tile.VELOCITY_Y, motion.v)
    pack(elem, tile.ELEMENT_TILE, tile.AX, kicks.ax_fast)
    pack(elem, tile.ELEMENT_TILE, tile.AY, kicks.ay_fast)
    pack(elem, tile.ELEMENT_TILE, tile.BX, kicks.bx_fast)
    pack(elem, tile.ELEMENT_TILE, tile.BY, kicks.by_fast)
    pack(elem, tile.ELEMENT_TILE, tile.SPIN_RATE, kicks.spin_rate)


@kernel
def _pack_bodies(elem: Floats, body: Body, fields: SubstepFields) -> None:
    """Properties of the elements in this long step, and the action of the floor on them."""
    pack(elem, tile.ELEMENT_TILE, tile.ACTIVE, fields.active)
    pack(elem, tile.ELEMENT_TILE, tile.PER_MASS, fields.per_mass)
    pack(elem, tile.ELEMENT_TILE, tile.PER_INERTIA, fields.per_inertia)
    pack(elem, tile.ELEMENT_TILE, tile.LOAD_X, body.load_x)
    pack(elem, tile.ELEMENT_TILE, tile.LOAD_Y, body.load_y)
    pack(elem, tile.ELEMENT_TILE, tile.FREE_Y, body.free_y)
    pack(elem, tile.ELEMENT_TILE, tile.FLOOR_RATE, fields.floor_rate)
    pack(elem, tile.ELEMENT_TILE, tile.FLOOR_LINEAR, fields.floor_linear)
    pack(elem, tile.ELEMENT_TILE, tile.FLOOR_QUADRATIC, fields.floor_quadratic)
    pack(elem, tile.ELEMENT_TILE, tile.DECAY, fields.floor_decay)
    pack(elem, tile.ELEMENT_TILE, tile.SPIN_DECAY, fields.floor_spin_decay)


@kernel
def _first_substep(plan: StepPlan, p: KernelParameters) -> int:
    """Return 0, or -1: with a proper start, one evaluation without moving stands before the first sub-step."""
    return -1 if plan.starting and p.bonds_on else 0


@kernel
def _substep_flags(n: int, plan: StepPlan, period: float) -> SubstepFlags:
    """What happens to the bonds in sub-step ``n``; in -1, the evaluation before the first, no time passes."""
    moving = n >= 0
    dt = plan.dt / plan.substeps if moving else 0.0
    return SubstepFlags(dt, plan.time + (n + 1) * dt, plan.break_inline and moving, n == plan.substeps - 1, period)


@stage
def _add_contact(
    el: Elements, bonds: Bonds, work: Workspace, by_search: bool, sizes: Sizes, law: PairLaw, dt: float,
    p: KernelParameters,
) -> None:  # fmt: skip
    """Accelerations by contact of elements whose bond has broken, or of bergs that meet; it looks at the state."""
    pairs, fields, tiles = work.pairs, work.fields, work.tiles
    if pairs.used[0] > 0:
        _unpack_pair_state(tiles, el)
        fields.accel_x[:] = 0.0
        fields.accel_y[:] = 0.0
        soft_dt = 0.0 if p.explicit_contact_damping else dt
        add_contacts(
            pairs, bonds.status, el, sizes, law, fields.accel_x, fields.accel_y, by_search, p.max_bonds, soft_dt
        )
        pack(tiles.elem, tile.ELEMENT_TILE, tile.CONTACT_X, fields.accel_x)
        pack(tiles.elem, tile.ELEMENT_TILE, tile.CONTACT_Y, fields.accel_y)


@kernel
def _unpack_pair_state(tiles: BondTiles, el: Elements) -> None:
    """Write to the state the places and velocities that contact reads, and the ones that pair forces see."""
    shown, motion, elem, ends = el.shown, el.motion, tiles.elem, tiles.ends
    unpack(shown.lon_pair, ends, tile.END_TILE, tile.X)
    unpack(shown.lat_pair, ends, tile.END_TILE, tile.Y)
    unpack(shown.u_pair, ends, tile.END_TILE, tile.U)
    unpack(shown.v_pair, ends, tile.END_TILE, tile.V)
    unpack(motion.u, elem, tile.ELEMENT_TILE, tile.VELOCITY_X)
    unpack(motion.v, elem, tile.ELEMENT_TILE, tile.VELOCITY_Y)


@stage
def _take_substeps(
    bonds: Bonds, tiles: BondTiles, aground: Floats, first: int, end: int, plan: StepPlan, on: StepContext,
    p: KernelParameters,
) -> tuple[int, int]:  # fmt: skip
    """Take the sub-steps from ``first`` on, before ``end``, together.

    Returns which is next, and how many bonds broke in the last one: it ends with the first sub-step in which any breaks.
    """
    fronts, farthest, count = tiles.fronts, tiles.farthest, tiles.last_tile.size
    for e in range(fronts[first % tile.AT_ONCE, tile.TILE], count):
        n = first
        while n < end:
            front, ahead = fronts[n % tile.AT_ONCE], fronts[(n - 1) % tile.AT_ONCE]
            # The first one goes on by one tile, the others as far as they can.
            while front[tile.TILE] < count and (
                front[tile.TILE] <= e if n == first else farthest[front[tile.TILE]] < ahead[tile.MOVED]
            ):
                _take_tile(bonds, tiles, aground, n, front, plan, on, p)
            if front[tile.BROKEN] > 0:
                end = n + 1
            n += 1
    broken = fronts[(end - 1) % tile.AT_ONCE, tile.BROKEN]
    for n in range(first, end):  # for those that come after them
        fronts[n % tile.AT_ONCE, :] = 0
    return end, broken


@stage
def _take_tile(
    bonds: Bonds, tiles: BondTiles, aground: Floats, n: int, front: Ints, plan: StepPlan, on: StepContext,
    p: KernelParameters,
) -> None:  # fmt: skip
    """Take sub-step ``n`` through its next tile of elements, and move on those whose bonds are all done."""
    dt, e, flags = plan.dt / plan.substeps, front[tile.TILE], _substep_flags(n, plan, on.period)
    while front[tile.BONDS] < on.bond_tiles and tiles.in_use[front[tile.BONDS]] // tiles.layers == e:
        front[tile.BROKEN] += _apply_bonds(bonds, tiles, tiles.in_use[front[tile.BONDS]], aground, flags, p)
        front[tile.BONDS] += 1
    # A kick moves ends: it waits for all bonds that see them.
    ready = front[tile.MOVED]
    while ready <= e and tiles.last_tile[ready] <= e:
        _kick(tiles, ready, dt, n < 0, on.floor_acts, on.floor_varies, p.ground_implicit)
        if n < plan.substeps - 1:
            _drift(tiles, ready, dt, on.near_pole, p)
        ready += 1
    front[tile.TILE], front[tile.MOVED] = e + 1, ready


@stage
def _apply_bonds(
    bonds: Bonds, tiles: BondTiles, b: int, aground: Floats, flags: SubstepFlags, p: KernelParameters
) -> int:
    """Forces of the bonds in tile ``b`` on their ends; returns the number of bonds broken.

    What `record_breaks` has to do for these is left to it.
    """
    scratch, e = tiles.scratch, b // tiles.layers
    # Views of one tile: LLVM sees that no index in it is negative, which an offset from outside would hide.
    bond = tiles.bond[b * tile.BOND_TILE : (b + 1) * tile.BOND_TILE]
    ends = tiles.ends[e * tile.END_TILE : (e + 1) * tile.END_TILE]
    shape = tiles.shape[tiles.shape_of[b] : tiles.shape_of[b] + tile.SHAPE_TILE]
    first, end, broken = b * tile.LANES, (b + 1) * tile.LANES, 0
    if b % tiles.layers == 0:
        # The first layer holds the bonds to the next element: its second ends lie side by side.
        shift_second_ends(scratch, tiles.ends[e * tile.END_TILE : (e + 2) * tile.END_TILE])
    else:
        gather_second_ends(scratch, tiles.second_end[first:end], tiles.ends)
    apply_bond_law(bond, shape, scratch, ends, flags.dt, p, flags.period)
    if flags.may_break and count_overloaded(bond, scratch) > 0:
        broken = break_overloaded(
            tiles.bond_ids[first:end], bond, shape, scratch, ends, tiles.rotation, bonds, aground, flags.time
        )
    if flags.last:
        store_bonds(tiles.bond_ids[first:end], bonds, bond, scratch, tiles.rotation)
    accumulate_first_ends(bond, scratch, tiles.sums[e * tile.SUM_TILE : (e + 1) * tile.SUM_TILE])
    return broken


@kernel
def _kick(
    tiles: BondTiles, b: int, dt: float, first: bool, floor_acts: bool, floor_varies: bool, implicit: bool
) -> None:
    """Complete a sub-step for the elements of tile ``b``; ``first`` is the evaluation before the first one."""
    elem, scratch = tiles.elem[b * tile.ELEMENT_TILE : (b + 1) * tile.ELEMENT_TILE], tiles.scratch
    ends = tiles.ends[b * tile.END_TILE : (b + 1) * tile.END_TILE]
    sums = tiles.sums[b * tile.SUM_TILE : (b + 1) * tile.SUM_TILE]
    sum_over_bonds(scratch, sums, tiles.slots[b * tile.LANES : (b + 1) * tile.LANES], tiles.bond)
    if floor_varies:
        floor_rates(elem, 0.0 if first else dt)
    if first:
        start_tile(elem, ends, scratch, dt, implicit)
        return
    # The floor stops an element at the velocity that its drag is taken at: the old one, or with an implicit floor the new one.
    if floor_acts and not implicit:
        accumulate_floor_impulse(elem)
    kick_tile(elem, ends, scratch, dt, implicit)
    if floor_acts and implicit:
        accumulate_floor_impulse(elem)


@kernel
def _drift(tiles: BondTiles, b: int, dt: float, near_pole: bool, p: KernelParameters) -> None:
    """Move the elements of tile ``b`` to the positions of a sub-step."""
    q1 = p.swapped_implicit_velocity and not p.explicit_substeps
    elem = tiles.elem[b * tile.ELEMENT_TILE : (b + 1) * tile.ELEMENT_TILE]
    ends = tiles.ends[b * tile.END_TILE : (b + 1) * tile.END_TILE]
    rotation = tiles.rotation[b * tile.LANES : (b + 1) * tile.LANES]
    if near_pole:
        drift_tile_near_pole(elem, ends, rotation, dt, p.earth_radius, q1)
    else:
        drift_tile(elem, ends, rotation, dt, p.latlon, p.earth_radius, q1)


@stage
def _end(
    el: Elements, work: Workspace, surroundings: Surroundings, plan: StepPlan, context: StepContext, p: KernelParameters
) -> None:
    """Unpack the elements into the state after the sub-steps."""
    tiles, fields, place, motion, kicks = work.tiles, work.fields, el.place, el.motion, el.kicks
    elem, ends = tiles.elem, tiles.ends
    _unpack_pair_state(tiles, el)
    unpack(place.lon, ends, tile.END_TILE, tile.X)
    unpack(place.lat, ends, tile.END_TILE, tile.Y)
    unpack(motion.spin, ends, tile.END_TILE, tile.SPIN)
    unpack(motion.rotation, ends, tile.END_TILE, tile.ANGLE)
    unpack(kicks.ax_fast, elem, tile.ELEMENT_TILE, tile.AX)
    unpack(kicks.ay_fast, elem, tile.ELEMENT_TILE, tile.AY)
    unpack(kicks.spin_rate, elem, tile.ELEMENT_TILE, tile.SPIN_RATE)
    unpack(fields.floor_impulse_x, elem, tile.ELEMENT_TILE, tile.FLOOR_IMPULSE_X)
    unpack(fields.floor_impulse_y, elem, tile.ELEMENT_TILE, tile.FLOOR_IMPULSE_Y)
    if p.iterate:
        store_inner(el)
    if context.floor_acts:
        end_substeps(surroundings, fields, plan.substeps)
    publish_all_velocities(el, motion.u, motion.v)
