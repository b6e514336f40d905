"""The sub-steps of a large lattice in several threads (equations 6.4, part 3, with bonds as beams).

Each thread has a part of the elements with the bonds that begin there. A sub-step has two halves, and all threads wait for each
other after both: forces of the bonds, then sums over them, kick and drift. What one thread writes no other reads before that, and
each element sums over its bonds in the order that it always has, so results are those of one thread, bit for bit.

These are plain Python threads around kernels that let go of the interpreter. A sub-step of so many elements takes milliseconds,
and handing it over some 0.1 ms; threads inside compiled code would ask for a second compiled form of it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from riftberg.compiled.kernels import kernel, plain
from riftberg.parameters import KernelParameters
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.stepping.explicit import tiles as tile
from riftberg.stepping.explicit.beams import (
    StepContext,
    SubstepFlags,
    add_pair_contact,
    apply_bonds,
    begin_beams,
    end_beams,
    first_substep,
    kick_and_drift,
    substep_flags,
)
from riftberg.stepping.explicit.bond_rows import BondTiles
from riftberg.stepping.explicit.breaking import record_breaks
from riftberg.stepping.explicit.springs import Workspace
from riftberg.stepping.explicit.step_plan import StepPlan
from riftberg.stepping.forces.interactions import pair_law
from riftberg.stepping.forces.media import Surroundings
from riftberg.stepping.forces.sizes import Sizes

WORTH_THREADS: Final = 20_000
"""With fewer elements handing over costs more than a second thread gains."""


class Share(NamedTuple):
    """What one thread does: blocks of elements ``begin`` to ``end``, the blocks of rows that begin there; and its own sheet."""

    begin: int
    end: int
    in_use: Ints
    scratch: Floats


def partition(tiles: BondTiles, count: int, elements: int, threads: int) -> list[Share]:
    """Share out the blocks of a lattice."""
    blocks = tile.tile_count(elements)
    limits = np.linspace(0, blocks, threads + 1).astype(np.int64).tolist()
    in_use = tiles.in_use[:count]
    place = in_use % blocks
    return [
        Share(begin, end, in_use[(place >= begin) & (place < end)].copy(), np.zeros(tile.SCRATCH_TILE))
        for begin, end in pairwise(limits)
    ]


@kernel
def _begin(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> tuple[int, bool, bool, bool, float]:  # fmt: skip
    """As `begin_beams`; see `riftberg.compiled.kernels` why no named tuple."""
    context = begin_beams(el, bonds, work, sizes, around, rank, plan, p)
    return context.count, context.floor_acts, context.floor_varies, context.near_pole, context.period


@kernel
def _act(
    bonds: Bonds,
    tiles: BondTiles,
    in_use: Ints,
    scratch: Floats,
    aground: Floats,
    flags: SubstepFlags,
    p: KernelParameters,
) -> int:
    """As `apply_bonds`."""
    return apply_bonds(bonds, tiles, in_use, scratch, aground, flags, p)


@kernel
def _touch(
    el: Elements, bonds: Bonds, work: Workspace, by_search: bool, sizes: Sizes, dt: float, p: KernelParameters
) -> None:
    """As `add_pair_contact`."""
    add_pair_contact(el, bonds, work.tiles, work.pairs, by_search, work.fields, sizes, pair_law(p), dt, p)


@kernel
def _end(
    el: Elements, work: Workspace, around: Surroundings, plan: StepPlan, context: StepContext, p: KernelParameters
) -> None:
    """As `end_beams`."""
    end_beams(el, work, around, plan, context, p)


def take_substeps_in_threads(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps of a long step in ``plan.threads`` threads; returns the number of bonds broken."""
    tiles, broken = work.tiles, 0
    context = StepContext(*_begin(el, bonds, work, sizes, around, rank, plan, p))
    parts = partition(tiles, context.count, el.size, plan.threads)
    with ThreadPoolExecutor(plan.threads) as team:
        for n in range(plain(first_substep)(plan, p), plan.substeps):
            flags = plain(substep_flags)(n, plan, context.period)
            if work.pairs.count[0] > 0:
                _touch(el, bonds, work, plan.by_search, sizes, flags.dt, p)
            acts = [team.submit(_act, bonds, tiles, x.in_use, x.scratch, work.fields.aground, flags, p) for x in parts]
            now = sum(act.result() for act in acts)
            if now > 0:
                record_breaks(tiles, bonds, el.body.bond_count, work.pairs, flags.time, p.broken_as_contact)
                broken += now
            kicks = [team.submit(kick_and_drift, tiles, x.begin, x.end, x.scratch, n, plan, context, p) for x in parts]
            for kick in kicks:
                kick.result()
    _end(el, work, around, plan, context, p)
    return broken
