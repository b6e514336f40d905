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
from riftberg.stepping.explicit import bond_blocks as row
from riftberg.stepping.explicit.beams import (
    BondTest,
    Conditions,
    act_on_ends,
    begin_beams,
    bond_test,
    complete_substep,
    end_beams,
    first_substep,
    touch_broken,
)
from riftberg.stepping.explicit.bond_rows import BondRows
from riftberg.stepping.explicit.breaking import record_breaks
from riftberg.stepping.explicit.springs import Workspace
from riftberg.stepping.explicit.step_plan import StepPlan
from riftberg.stepping.forces.interactions import pair_law
from riftberg.stepping.forces.media import Surroundings
from riftberg.stepping.forces.sizes import Sizes

WORTH_THREADS: Final = 20_000
"""With fewer elements handing over costs more than a second thread gains."""


class Part(NamedTuple):
    """What one thread does: blocks of elements ``begin`` to ``end``, the blocks of rows that begin there; and its own sheet."""

    begin: int
    end: int
    used: Ints
    sheet: Floats


def parts_of(rows: BondRows, count: int, elements: int, threads: int) -> list[Part]:
    """Share out the blocks of a lattice."""
    blocks = row.blocks_of(elements)
    limits = np.linspace(0, blocks, threads + 1).astype(np.int64).tolist()
    used = rows.used[:count]
    place = used % blocks
    return [
        Part(begin, end, used[(place >= begin) & (place < end)].copy(), np.zeros(row.SHEET))
        for begin, end in pairwise(limits)
    ]


@kernel
def _begin(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> tuple[int, bool, bool, bool, float]:  # fmt: skip
    """As `begin_beams`; see `riftberg.compiled.kernels` why no named tuple."""
    on = begin_beams(el, bonds, work, sizes, around, rank, plan, p)
    return on.count, on.floor_acts, on.floor_varies, on.near_pole, on.period


@kernel
def _act(
    bonds: Bonds, rows: BondRows, used: Ints, sheet: Floats, aground: Floats, test: BondTest, p: KernelParameters
) -> int:
    """As `act_on_ends`."""
    return act_on_ends(bonds, rows, used, sheet, aground, test, p)


@kernel
def _touch(
    el: Elements, bonds: Bonds, work: Workspace, by_search: bool, sizes: Sizes, dt: float, p: KernelParameters
) -> None:
    """As `touch_broken`."""
    touch_broken(el, bonds, work.rows, work.pairs, by_search, work.scratch, sizes, pair_law(p), dt, p)


@kernel
def _end(
    el: Elements, work: Workspace, around: Surroundings, plan: StepPlan, on: Conditions, p: KernelParameters
) -> None:
    """As `end_beams`."""
    end_beams(el, work, around, plan, on, p)


def take_substeps_in_threads(
    el: Elements, bonds: Bonds, work: Workspace, sizes: Sizes, around: Surroundings, rank: Ints, plan: StepPlan,
    p: KernelParameters,
) -> int:  # fmt: skip
    """Take the sub-steps of a long step in ``plan.threads`` threads; returns the number of bonds broken."""
    rows, broken = work.rows, 0
    on = Conditions(*_begin(el, bonds, work, sizes, around, rank, plan, p))
    parts = parts_of(rows, on.count, el.size, plan.threads)
    with ThreadPoolExecutor(plan.threads) as team:
        for n in range(plain(first_substep)(plan, p), plan.substeps):
            test = plain(bond_test)(n, plan, on.period)
            if work.pairs.count[0] > 0:
                _touch(el, bonds, work, plan.by_search, sizes, test.dt, p)
            acts = [team.submit(_act, bonds, rows, x.used, x.sheet, work.scratch.aground, test, p) for x in parts]
            now = sum(act.result() for act in acts)
            if now > 0:
                record_breaks(rows, bonds, el.body.bond_count, work.pairs, test.time, p.broken_as_contact)
                broken += now
            kicks = [team.submit(complete_substep, rows, x.begin, x.end, x.sheet, n, plan, on, p) for x in parts]
            for kick in kicks:
                kick.result()
    _end(el, work, around, plan, on, p)
    return broken
