"""Connected parts of the lattice, bonds that no longer count, and bridges of the graph of bonds (equations 1.5, 7.1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from riftberg.compiled.kernels import kernel, stage
from riftberg.physics.bonds import exceeds
from riftberg.state import Bonds, Elements, Floats, Ints
from riftberg.state.neighbours import partners_over_bonds


@kernel
def connected_parts(count: int, first: Ints, second: Ints, status: Ints) -> Ints:
    """Number the connected parts 0, 1, ... in order of their first element.

    ``first``, ``second``, ``status``: ends of the bonds (shape (bonds,)).
    """
    start, partner, _ = partners_over_bonds(first, second, status, count)
    component = np.full(count, -1, np.int64)
    stack = np.empty(count, np.int64)
    components = 0
    for seed in range(count):
        if component[seed] >= 0:
            continue
        component[seed] = components
        # A stack of its own: recursion would go as deep as the berg has elements.
        stack[0] = seed
        depth = 1
        while depth > 0:
            depth -= 1
            e = stack[depth]
            for k in range(start[e], start[e + 1]):
                c = partner[k]
                if component[c] < 0:
                    component[c] = components
                    stack[depth] = c
                    depth += 1
        components += 1
    return component


@kernel
def drop_parted_bonds(bonds: Bonds, component: Ints) -> None:
    """Retire broken bonds whose ends now belong to different parts (status 2): contact between fragments takes over."""
    for b in range(bonds.first.size):
        if bonds.status[b] == 1 and component[bonds.first[b]] != component[bonds.second[b]]:
            bonds.status[b] = 2


@kernel
def drop_broken_bonds(bonds: Bonds) -> None:
    """Retire all broken bonds, where they are not kept as contact pairs."""
    for b in range(bonds.first.size):
        if bonds.status[b] == 1:
            bonds.status[b] = 2


@stage
def break_after_step(el: Elements, bonds: Bonds, normal_strength: float, shear_strength: float, time: float) -> int:
    """Break and drop the bonds whose stored stress is above a threshold; a threshold <= 0 never breaks (equations 7.1)."""
    first, second, status, count = bonds.first, bonds.second, bonds.status, el.body.bond_count
    normal_stress, shear_stress, break_time = bonds.normal_stress, bonds.shear_stress, bonds.break_time
    own_strength, damage, broken_at = bonds.strength, bonds.damage, bonds.break_strength
    normal = normal_strength if normal_strength > 0.0 else np.inf
    shear = shear_strength if shear_strength > 0.0 else np.inf
    broken = 0
    for b in range(first.size):
        strength = own_strength[b] * (1.0 - damage[b])
        if status[b] == 0 and exceeds(normal_stress[b], shear_stress[b], normal, shear, strength):
            status[b] = 2
            break_time[b] = time
            broken_at[b] = 1 if normal_stress[b] > normal * strength else 2
            count[first[b]] -= 1
            count[second[b]] -= 1
            broken += 1
    return broken


class Bridges(NamedTuple):
    """Bridges of a lattice, and a depth-first search of it, by which the loads on one side of each add up."""

    bond: Ints  # Rows among the intact bonds; shape (bridges,)
    below: Ints  # Element that the search reached by way of the bridge; shape (bridges,)
    order: Ints  # Elements in the order in which the search reached them; shape (elements,)
    above: Ints  # Element from which each was reached, -1 where the search began
    root: Ints  # Element where the search of its fragment began


def find_bridges(first: Ints, second: Ints, intact: Ints, elements: int) -> Bridges:
    """Find which intact bonds are bridges, by depth-first search (Tarjan 1974, Inf. Process. Lett. 2)."""
    return Bridges(*_find_bridges(first, second, intact, elements))


@kernel
def _find_bridges(first: Ints, second: Ints, intact: Ints, count: int) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Return the fields of `Bridges` (no named tuple: see `riftberg.compiled.kernels`)."""
    start = np.zeros(count + 1, np.int64)
    for b in intact:
        start[first[b] + 1] += 1
        start[second[b] + 1] += 1
    start = np.cumsum(start)
    fill, partner, by = start[:-1].copy(), np.empty(2 * intact.size, np.int64), np.empty(2 * intact.size, np.int64)
    for k in range(intact.size):
        i, j = first[intact[k]], second[intact[k]]
        partner[fill[i]], by[fill[i]] = j, k
        partner[fill[j]], by[fill[j]] = i, k
        fill[i] += 1
        fill[j] += 1

    # Depth-first: the order of visits, the bond and the element by which each was reached, and the earliest element that it
    # or what was reached from it is bonded to.
    visit, low = np.full(count, -1, np.int64), np.zeros(count, np.int64)
    above, reached_by = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    order, root = np.empty(count, np.int64), np.empty(count, np.int64)
    edge, stack, visited = start[:-1].copy(), np.empty(count, np.int64), 0
    for seed in range(count):
        if visit[seed] >= 0:
            continue
        stack[0], depth = seed, 1
        visit[seed] = low[seed] = visited
        order[visited], root[seed] = seed, seed
        visited += 1
        while depth > 0:
            e = stack[depth - 1]
            if edge[e] == start[e + 1]:
                depth -= 1
                if above[e] >= 0:
                    low[above[e]] = min(low[above[e]], low[e])
                continue
            n, k = partner[edge[e]], by[edge[e]]
            edge[e] += 1
            if k == reached_by[e]:
                continue
            if visit[n] >= 0:
                low[e] = min(low[e], visit[n])
                continue
            visit[n] = low[n] = visited
            order[visited], root[n] = n, seed
            visited += 1
            above[n], reached_by[n] = e, k
            stack[depth] = n
            depth += 1
    below = np.array([e for e in range(count) if above[e] >= 0 and low[e] > visit[above[e]]], np.int64)
    return reached_by[below], below, order, above, root


@kernel
def bridge_moments(
    bridges: Bridges, first: Ints, second: Ints, intact: Ints, xy: Floats, load: Floats, supported: NDArray[np.bool_],
    shift: Floats,
) -> Floats:  # fmt: skip
    """Find the moment (N m) that each bridge alone bears about the middle of its face; 0 between two parts with supports.

    ``shift``: how far the middle of the face of each intact bond lies to the left of that of the bond, over its length.

    From the balance of the part on one side of the bond. Loads of free fragments are in balance, so either side will do; a
    part with supports (``supported``: of the elements) bears unknown forces, and the other one counts.
    """
    order, above, count = bridges.order, bridges.above, xy.shape[0]
    # Sums over what was reached from each element: force (2), moment about the origin, and whether it has supports.
    sums, moment = np.zeros((count, 4)), np.zeros(bridges.bond.size)
    for n in range(count - 1, -1, -1):
        e = order[n]
        sums[e, 0] += load[e, 0]
        sums[e, 1] += load[e, 1]
        sums[e, 2] += load[e, 2] + xy[e, 0] * load[e, 1] - xy[e, 1] * load[e, 0]
        sums[e, 3] += 1.0 if supported[e] else 0.0
        if above[e] >= 0:
            for i in range(4):
                sums[above[e], i] += sums[e, i]
    for n in range(bridges.bond.size):
        e = bridges.below[n]
        fx, fy, turning = sums[e, 0], sums[e, 1], sums[e, 2]
        if sums[e, 3] > 0.0:
            r = bridges.root[e]
            if sums[r, 3] - sums[e, 3] > 0.0:
                continue
            fx, fy, turning = sums[r, 0] - fx, sums[r, 1] - fy, sums[r, 2] - turning
        b = intact[bridges.bond[n]]
        dx, dy, left = xy[second[b], 0] - xy[first[b], 0], xy[second[b], 1] - xy[first[b], 1], shift[bridges.bond[n]]
        x, y = xy[first[b], 0] + 0.5 * dx - left * dy, xy[first[b], 1] + 0.5 * dy + left * dx
        moment[n] = turning - (x * fy - y * fx)
    return moment
