"""Bending of bonds that are the last between two parts of a fragment: the bridges of the graph of bonds."""

from __future__ import annotations

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats, Ints
from riftberg.stepping.lattice.cells import Booleans


@kernel
def bridge_moments(
    first: Ints, second: Ints, intact: Ints, xy: Floats, load: Floats, held: Booleans
) -> tuple[Booleans, Floats]:
    """Find which intact bonds are bridges, and the moment (N m) that each alone bears about its middle, 0 for other bonds.

    From the balance of the part on one side of the bond. Loads of free fragments are in balance, so either side will do; a
    part with supports (``held``: of the elements) bears unknown forces, and the other one counts. Bridges are found by
    depth-first search (Tarjan 1974, Inf. Process. Lett. 2).
    """
    count = xy.shape[0]
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

    # Sums over what was reached from each element: force (2), moment about the origin, and whether it has supports.
    sums = np.zeros((count, 4))
    for n in range(count - 1, -1, -1):
        e = order[n]
        sums[e, 0] += load[e, 0]
        sums[e, 1] += load[e, 1]
        sums[e, 2] += load[e, 2] + xy[e, 0] * load[e, 1] - xy[e, 1] * load[e, 0]
        sums[e, 3] += 1.0 if held[e] else 0.0
        if above[e] >= 0:
            sums[above[e]] += sums[e]
    bridge, moment = np.zeros(intact.size, np.bool_), np.zeros(intact.size)
    for e in range(count):
        if above[e] < 0 or low[e] <= visit[above[e]]:
            continue
        bridge[reached_by[e]] = True
        part = sums[e]
        if part[3] > 0.0:
            part = sums[root[e]] - part
            if part[3] > 0.0:
                continue
        b = intact[reached_by[e]]
        x, y = 0.5 * (xy[first[b], 0] + xy[second[b], 0]), 0.5 * (xy[first[b], 1] + xy[second[b], 1])
        moment[reached_by[e]] = part[2] - (x * part[1] - y * part[0])
    return bridge, moment
