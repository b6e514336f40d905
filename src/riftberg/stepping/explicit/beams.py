"""The sub-steps of a long step with bonds as beams, in one thread or several (equations 6.4, part 3).

Bonds and elements stand in tiles (`riftberg.stepping.explicit.tiles`). A sub-step has two halves: forces of the bonds, then
sums over them, kick, and the drift of the sub-step that follows.

In threads, each has a share of the elements with the bonds that begin there, and all wait for each other after both halves.
What one thread writes no other reads before that, and each element sums over its bonds in the order that it always has, so
results are those of one thread, bit for bit. These are plain Python threads around kernels that let go of the interpreter. A
sub-step of so many elements takes milliseconds, and handing it over some 0.1 ms; threads inside compiled code would need a
second compiled form of it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, plain, stage
from riftberg.parameters import KernelParameters
from riftberg.state import Body, Bonds, Elements, Floats, Ints, Kicks, Motion, Shown
from riftberg.stepping.explicit import tiles as tile
from riftberg.stepping.explicit.breaking import (
    add_contacts,
    break_overloaded,
    count_loaded,
    grow_damage,
    record_breaks,
    store_bonds,
)
from riftberg.stepping.explicit.substeps import (
    StepPlan,
    SubstepFields,
    Workspace,
    begin_substeps,
    end_substeps,
    publish_all_velocities,
    reaches_pole,
    store_inner,
)
from riftberg.stepping.explicit.tile_kernels import (
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
from riftberg.stepping.explicit.tiles import BondTiles, may_cross_seam, pack, pack_bonds, unpack
from riftberg.stepping.forces.media import Surroundings
from riftberg.stepping.forces.pair_law import PairLaw, pair_law
from riftberg.stepping.forces.sizes import Sizes

WORTH_THREADS: Final = 20_000
"""With fewer elements handing over costs more than a second thread gains."""


class SubstepFlags(NamedTuple):
    """A sub-step as the bonds meet it."""

    dt: float  # Its length, s
    time: float  # Time since the start at its end, s
    may_break: bool  # Whether to test for fracture at all
    grow_damage: bool  # Whether stress takes from the strength
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
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps in one thread; returns the number of bonds broken."""
    tiles, pairs, fields, law = work.tiles, work.pairs, work.fields, pair_law(p)
    context = _step_context(el, bonds, work, sizes, around, rank, plan, p)
    in_use, count, broken = tiles.in_use[: context.bond_tiles], tile.tile_count(el.place.lon.size), 0
    for n in range(_first_substep(plan, p), plan.substeps):
        flags = _substep_flags(n, plan, context.period)
        # Contact before the bonds: one that breaks in this sub-step touches from the next one on.
        _add_contact(el, bonds, work, plan.by_search, sizes, law, flags.dt, p)
        newly_broken = _apply_bonds(bonds, tiles, in_use, tiles.scratch, fields.aground, flags, p)
        if newly_broken > 0:
            record_breaks(tiles, bonds, el.body.bond_count, pairs, flags.time, p.broken_as_contact)
            broken += newly_broken
        _kick_and_drift(tiles, 0, count, tiles.scratch, n, plan, context, p)
    _end(el, work, around, plan, context, p)
    return broken


def take_substeps_in_threads(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """As `take_substeps_of_beams`, in ``plan.threads`` threads."""
    tiles, broken = work.tiles, 0
    context = StepContext(*_begin_alone(el, bonds, work, sizes, around, rank, plan, p))
    shares = partition(tiles, context.bond_tiles, el.size, plan.threads)
    with ThreadPoolExecutor(plan.threads) as team:
        for n in range(plain(_first_substep)(plan, p), plan.substeps):
            flags = plain(_substep_flags)(n, plan, context.period)
            if work.pairs.used[0] > 0:
                _add_contact_alone(el, bonds, work, plan.by_search, sizes, flags.dt, p)
            forces = [
                team.submit(_apply_bonds_alone, bonds, tiles, x.in_use, x.scratch, work.fields.aground, flags, p)
                for x in shares
            ]
            # All forces before any kick: a kick moves ends that other threads may still read.
            newly_broken = sum(done.result() for done in forces)
            if newly_broken > 0:
                record_breaks(tiles, bonds, el.body.bond_count, work.pairs, flags.time, p.broken_as_contact)
                broken += newly_broken
            kicks = [
                team.submit(_kick_and_drift, tiles, x.begin, x.end, x.scratch, n, plan, context, p) for x in shares
            ]
            for done in kicks:
                done.result()
    _end_alone(el, work, around, plan, context, p)
    return broken


@stage
def _step_context(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> StepContext:  # fmt: skip
    """Pack bonds and elements into tiles, and move the elements to the positions of the first sub-step."""
    tiles, fields, dt = work.tiles, work.fields, plan.dt / plan.substeps
    floor_acts, floor_varies = begin_substeps(el, around, fields, sizes, dt, p)
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
    """Pack the elements into tiles; nothing has been summed, and nothing has turned."""
    tiles.elem[:] = 0.0
    tiles.sums[:] = 0.0
    tiles.rotation[:] = 0.0
    _pack_motion(tiles, el.shown, el.motion, el.kicks)
    _pack_bodies(tiles.elem, el.body, fields)


@kernel
def _pack_motion(tiles: BondTiles, shown: Shown, motion: Motion, kicks: Kicks) -> None:
    """Place, motion and accelerations; elements that do not move keep what pair forces saw of them before."""
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
    """What elements are, in this long step, and what the floor does to them."""
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
    may_break, damaging = plan.break_inline and moving, plan.grow_damage and moving
    return SubstepFlags(dt, plan.time + (n + 1) * dt, may_break, damaging, n == plan.substeps - 1, period)


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
    """Write to the state what contact reads there: places, velocities, and those that pair forces see."""
    shown, motion, elem, ends = el.shown, el.motion, tiles.elem, tiles.ends
    unpack(shown.lon_pair, ends, tile.END_TILE, tile.X)
    unpack(shown.lat_pair, ends, tile.END_TILE, tile.Y)
    unpack(shown.u_pair, ends, tile.END_TILE, tile.U)
    unpack(shown.v_pair, ends, tile.END_TILE, tile.V)
    unpack(motion.u, elem, tile.ELEMENT_TILE, tile.VELOCITY_X)
    unpack(motion.v, elem, tile.ELEMENT_TILE, tile.VELOCITY_Y)


@stage
def _apply_bonds(
    bonds: Bonds, tiles: BondTiles, in_use: Ints, scratch: Floats, aground: Floats, flags: SubstepFlags,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Forces of the bonds in the tiles ``in_use`` on their ends; returns the number of bonds broken.

    What `record_breaks` has to do for these is left to it: several threads may each go through some tiles.
    """
    width, broken = tile.tile_count(aground.size), 0
    for b in in_use:
        # Views of one tile: LLVM sees that no index in it is negative, which an offset from outside would hide.
        bond, e = tiles.bond[b * tile.BOND_TILE : (b + 1) * tile.BOND_TILE], b % width
        ends = tiles.ends[e * tile.END_TILE : (e + 1) * tile.END_TILE]
        shape = tiles.shape[tiles.shape_of[b] : tiles.shape_of[b] + tile.SHAPE_TILE]
        first, end = b * tile.LANES, (b + 1) * tile.LANES
        if b < width:
            # The first layer holds the bonds to the next element: its second ends lie side by side.
            shift_second_ends(scratch, tiles.ends[e * tile.END_TILE : (e + 2) * tile.END_TILE])
        else:
            gather_second_ends(scratch, tiles.second_end[first:end], tiles.ends)
        apply_bond_law(bond, shape, scratch, ends, tiles.kinds[b // width], flags.dt, p, flags.period)
        bears = tiles.kinds[b // width, 2] > 0.0  # diagonals have neither a stress nor a strength
        if bears and flags.grow_damage:
            grow_damage(bond, scratch, flags.dt, p)
        if bears and flags.may_break and count_loaded(bond, scratch, 1.0) > 0:
            broken += break_overloaded(
                tiles.bond_ids[first:end], bond, shape, scratch, ends, tiles.rotation, bonds, aground, flags.time
            )
        if bears and flags.last:
            store_bonds(tiles.bond_ids[first:end], bonds, bond, scratch, tiles.rotation)
        accumulate_first_ends(bond, scratch, tiles.sums[e * tile.SUM_TILE : (e + 1) * tile.SUM_TILE])
    return broken


@kernel
def _kick_and_drift(
    tiles: BondTiles, begin: int, end: int, scratch: Floats, n: int, plan: StepPlan, on: StepContext,
    p: KernelParameters,
) -> None:  # fmt: skip
    """Kick the elements of tiles ``begin`` to ``end`` in sub-step ``n``, and move them to the positions of the next one."""
    dt = plan.dt / plan.substeps
    for b in range(begin, end):
        _kick(tiles, b, scratch, dt, n < 0, on.floor_acts, on.floor_varies, p.ground_implicit)
        if n < plan.substeps - 1:
            _drift(tiles, b, dt, on.near_pole, p)


@kernel
def _kick(
    tiles: BondTiles, b: int, scratch: Floats, dt: float, first: bool, floor_acts: bool, floor_varies: bool,
    implicit: bool,
) -> None:  # fmt: skip
    """Complete a sub-step for the elements of tile ``b``; ``first`` is the evaluation before the first one."""
    elem = tiles.elem[b * tile.ELEMENT_TILE : (b + 1) * tile.ELEMENT_TILE]
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
    el: Elements, work: Workspace, around: Surroundings, plan: StepPlan, context: StepContext, p: KernelParameters
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
        end_substeps(around, fields, plan.substeps)
    publish_all_velocities(el, motion.u, motion.v)


class Share(NamedTuple):
    """What one thread does."""

    begin: int  # Its tiles of elements, from here
    end: int  # to before here
    in_use: Ints  # The tiles of bonds that begin there
    scratch: Floats  # A scratch tile of its own


def partition(tiles: BondTiles, count: int, elements: int, threads: int) -> list[Share]:
    """Share out the tiles of a lattice."""
    width = tile.tile_count(elements)
    # Each thread has the tiles of its own elements, so that no two write to the same sums.
    limits = np.linspace(0, width, threads + 1).astype(np.int64).tolist()
    in_use = tiles.in_use[:count]
    place = in_use % width
    return [
        Share(begin, end, in_use[(place >= begin) & (place < end)].copy(), np.zeros(tile.SCRATCH_TILE))
        for begin, end in pairwise(limits)
    ]


# Kernels of their own around the stages above, for threads alone: a run in one thread compiles all of them as one kernel.


@kernel
def _begin_alone(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> tuple[int, bool, bool, bool, float]:  # fmt: skip
    on = _step_context(el, bonds, work, sizes, around, rank, plan, p)
    # Numbers, not the named tuple: see `riftberg.compiled.kernels`.
    return on.bond_tiles, on.floor_acts, on.floor_varies, on.near_pole, on.period


@kernel
def _add_contact_alone(
    el: Elements, bonds: Bonds, work: Workspace, by_search: bool, sizes: Sizes, dt: float, p: KernelParameters
) -> None:
    _add_contact(el, bonds, work, by_search, sizes, pair_law(p), dt, p)


@kernel
def _apply_bonds_alone(
    bonds: Bonds, tiles: BondTiles, in_use: Ints, scratch: Floats, aground: Floats, flags: SubstepFlags,
    p: KernelParameters,
) -> int:  # fmt: skip
    return _apply_bonds(bonds, tiles, in_use, scratch, aground, flags, p)


@kernel
def _end_alone(
    el: Elements, work: Workspace, around: Surroundings, plan: StepPlan, context: StepContext, p: KernelParameters
) -> None:
    _end(el, work, around, plan, context, p)
