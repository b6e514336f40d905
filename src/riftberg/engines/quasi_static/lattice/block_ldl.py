"""Sparse factors ``K = L D L^T`` of the stiffness matrix of a lattice, in blocks of 3 by 3: one for each pair of elements.

Elements are eliminated in the order of minimum degree (Liu 1985, ACM Trans. Math. Softw. 11), which keeps L sparse. As ``K``
is symmetric and positive definite, no pivoting is needed, L alone is kept, and one index stands for nine numbers.

The factors are found row by row (up-looking; Davis 2006, Direct Methods for Sparse Linear Systems, chapter 4).
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from riftberg.compiled.kernels import borrower, kernel
from riftberg.physics.geometry import invert_symmetric, subtract_product
from riftberg.state import Floats, Ints


def minimum_degree(count: int, first: Ints, second: Ints) -> Ints:
    """Return the elements in the order in which they are to be eliminated.

    SuperLU finds it, for a matrix with a number in place of each block. That takes as long as the factors of a berg of some
    hundred elements, so it is cached: melt changes the matrix in each step, but the set of intact bonds changes in few.
    """
    return _minimum_degree(count, first.tobytes(), second.tobytes())


@lru_cache(maxsize=4)
def _minimum_degree(count: int, firsts: bytes, seconds: bytes) -> Ints:
    from scipy.sparse import csc_matrix  # takes half a second to load, and not every run has a lattice
    from scipy.sparse.linalg import splu

    first, second = np.frombuffer(firsts, np.int64), np.frombuffer(seconds, np.int64)
    elements = np.arange(count)
    row, column = np.concatenate([first, second, elements]), np.concatenate([second, first, elements])
    degree = np.bincount(row, minlength=count)
    value = np.concatenate([np.full(2 * first.size, -1.0), degree.astype(np.float64)])
    matrix = csc_matrix((value, (row, column)), shape=(count, count))
    position = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).perm_c
    order = np.asarray(np.argsort(position), np.int64)
    order.flags.writeable = False  # it is shared
    return order


class Factors(NamedTuple):
    """L by columns and D, all by position in the order of elimination."""

    order: Ints  # Elements; shape (elements,)
    start: Ints  # Where each column of L starts; shape (elements + 1,)
    row: Ints  # Of each block of L; shape (blocks,)
    lower: Floats  # Blocks of L; shape (blocks, 3, 3)
    inverse: Floats  # Inverse blocks of D; shape (elements, 3, 3)
    work: Floats  # Workspace of a solve; shape (elements, 3)


class BlockLDL:
    """Factors of a symmetric positive definite matrix of 3 by 3 blocks.

    ``diagonal`` are the blocks of the elements (elements, 3, 3), ``between`` the blocks of the bonds, in the row of the first
    end and the column of the second (bonds, 3, 3).
    """

    def __init__(self, first: Ints, second: Ints, diagonal: Floats, between: Floats) -> None:
        order = minimum_degree(diagonal.shape[0], first, second)
        start, row, lower, inverse = _factor(order, first, second, diagonal, between)
        self.factors = Factors(order, start, row, lower, inverse, np.empty((order.size, 3)))
        self._unit_radius, self._free = np.ones(order.size), np.ones(3 * order.size)

    def solve(self, right: Floats) -> Floats:
        """Return the solution for a right-hand side, shape (3 elements,)."""
        out = np.empty((self._unit_radius.size, 3))
        self.solve_scaled(right.reshape(out.shape), self._unit_radius, self._free, out)
        return out.ravel()

    def solve_scaled(self, right: Floats, radius: Floats, free: Floats, out: Floats) -> float:
        """See `solve_factored`."""
        return float(solve_factored(self.factors, right, radius, free, out))


@kernel
def _neighbours(position: Ints, first: Ints, second: Ints) -> tuple[Ints, Ints]:
    """Bonds of each position in the order to earlier positions: where its list starts, and the bonds."""
    start, fill = np.zeros(position.size + 1, np.int64), np.zeros(position.size, np.int64)
    for b in range(first.size):
        start[max(position[first[b]], position[second[b]]) + 1] += 1
    for k in range(position.size):
        start[k + 1] += start[k]
    bond = np.empty(first.size, np.int64)
    for b in range(first.size):
        k = max(position[first[b]], position[second[b]])
        bond[start[k] + fill[k]] = b
        fill[k] += 1
    return start, bond


@kernel
def _parents(position: Ints, first: Ints, second: Ints, start: Ints, bond: Ints) -> Ints:
    """Elimination tree: the first later position in the column of each, -1 for none."""
    count = position.size
    parent, ancestor = np.full(count, -1, np.int64), np.full(count, -1, np.int64)
    for k in range(count):
        for n in range(start[k], start[k + 1]):
            i = min(position[first[bond[n]]], position[second[bond[n]]])
            while i != -1 and i < k:
                next_ancestor = ancestor[i]
                ancestor[i] = k
                if next_ancestor == -1:
                    parent[i] = k
                i = next_ancestor
    return parent


@kernel
def _reach(
    k: int, position: Ints, first: Ints, second: Ints, start: Ints, bond: Ints, parent: Ints, seen: Ints, stack: Ints
) -> int:
    """Columns that row ``k`` of L has, in the order of elimination, from the returned position to the end of ``stack``."""
    top = position.size
    seen[k] = k
    for n in range(start[k], start[k + 1]):
        i = min(position[first[bond[n]]], position[second[bond[n]]])
        length = 0
        while seen[i] != k:
            stack[length] = i
            seen[i] = k
            length += 1
            i = parent[i]
        while length > 0:
            length -= 1
            top -= 1
            stack[top] = stack[length]
    return top


@kernel
def _factor(
    order: Ints, first: Ints, second: Ints, diagonal: Floats, between: Floats
) -> tuple[Ints, Ints, Floats, Floats]:
    """Return L by columns (where each starts, rows, blocks) and the inverse blocks of D, all by position in the order."""
    count = order.size
    position = np.empty(count, np.int64)
    for k in range(count):
        position[order[k]] = k
    bond_start, bond = _neighbours(position, first, second)
    parent = _parents(position, first, second, bond_start, bond)
    seen, stack = np.full(count, -1, np.int64), np.empty(count, np.int64)
    start = np.zeros(count + 1, np.int64)
    for k in range(count):
        for n in range(_reach(k, position, first, second, bond_start, bond, parent, seen, stack), count):
            start[stack[n] + 1] += 1
    for k in range(count):
        start[k + 1] += start[k]
    end, row = start[:-1].copy(), np.empty(start[count], np.int64)
    lower, inverse = np.empty((start[count], 3, 3)), np.empty((count, 3, 3))
    seen[:] = -1
    _eliminate(
        order, position, first, second, diagonal, between, bond_start, bond, parent, seen, stack, start, end, row, lower, inverse,
        np.zeros((count, 3, 3)), np.empty((2, 3, 3)),
    )  # fmt: skip
    return start, row, lower, inverse


# Many arguments: a borrower makes no arrays, so graph, factor and workspace come one by one; its inner loops count no
# references.
@borrower
def _eliminate(
    order: Ints, position: Ints, first: Ints, second: Ints, diagonal: Floats, between: Floats, bond_start: Ints, bond: Ints,
    parent: Ints, seen: Ints, stack: Ints, start: Ints, end: Ints, row: Ints, lower: Floats, inverse: Floats, work: Floats,
    scratch: Floats,
) -> None:  # fmt: skip
    """Fill rows, blocks of L and inverse blocks of D, element by element; ``work`` is zero, ``scratch`` holds two blocks."""
    count, pivot, scaled = order.size, scratch[0], scratch[1]
    for k in range(count):
        for n in range(bond_start[k], bond_start[k + 1]):
            b = bond[n]
            i, is_transposed = position[first[b]], position[first[b]] < position[second[b]]
            i = i if is_transposed else position[second[b]]
            for x in range(3):
                for y in range(3):
                    work[i, x, y] += between[b, y, x] if is_transposed else between[b, x, y]
        for x in range(3):
            for y in range(3):
                pivot[x, y] = diagonal[order[k], x, y]
        for n in range(_reach(k, position, first, second, bond_start, bond, parent, seen, stack), count):
            i = stack[n]
            block = work[i]
            for x in range(3):
                for y in range(3):
                    z = block[x, 0] * inverse[i, 0, y] + block[x, 1] * inverse[i, 1, y] + block[x, 2] * inverse[i, 2, y]
                    scaled[x, y] = z
            for p in range(start[i], end[i]):
                subtract_product(work[row[p]], block, lower[p])
            subtract_product(pivot, scaled, block)
            row[end[i]] = k
            for x in range(3):
                for y in range(3):
                    lower[end[i], x, y], block[x, y] = scaled[x, y], 0.0
            end[i] += 1
        invert_symmetric(pivot, inverse[k])


@borrower
def solve_factored(factors: Factors, right: Floats, radius: Floats, free: Floats, out: Floats) -> float:
    """Solve for loads ``right`` (N, N, N m), whose moments act at the rims ``radius`` (m); returns the largest load, N.

    Unknowns beyond the last row of ``right`` bear none. ``free`` is 0 where loads are left out, else 1 (3 elements,); ``out``
    takes the solution (elements, 3). Forward substitution by columns, then back.
    """
    order, start, row, lower, inverse, x = (
        factors.order, factors.start, factors.row, factors.lower, factors.inverse, factors.work
    )  # fmt: skip
    count, largest = order.size, 0.0
    for k in range(count):
        e = order[k]
        if e >= right.shape[0]:
            x[k, 0] = x[k, 1] = x[k, 2] = 0.0
            continue
        for i in range(2):
            x[k, i] = right[e, i] * free[3 * e + i]
        x[k, 2] = right[e, 2] / radius[e] * free[3 * e + 2]
        largest = max(largest, max(abs(x[k, 0]), max(abs(x[k, 1]), abs(x[k, 2]))))
    for k in range(count):
        a, b, c = x[k, 0], x[k, 1], x[k, 2]
        if a == 0.0 and b == 0.0 and c == 0.0:  # nearly all of a bond that breaks
            continue
        for p in range(start[k], start[k + 1]):
            r, m = row[p], lower[p]
            x[r, 0] -= m[0, 0] * a + m[0, 1] * b + m[0, 2] * c
            x[r, 1] -= m[1, 0] * a + m[1, 1] * b + m[1, 2] * c
            x[r, 2] -= m[2, 0] * a + m[2, 1] * b + m[2, 2] * c
    for k in range(count - 1, -1, -1):
        d, a, b, c = inverse[k], x[k, 0], x[k, 1], x[k, 2]
        u = d[0, 0] * a + d[0, 1] * b + d[0, 2] * c
        v = d[1, 0] * a + d[1, 1] * b + d[1, 2] * c
        w = d[2, 0] * a + d[2, 1] * b + d[2, 2] * c
        for p in range(start[k], start[k + 1]):
            r, m = row[p], lower[p]
            e, f, g = x[r, 0], x[r, 1], x[r, 2]
            u -= m[0, 0] * e + m[1, 0] * f + m[2, 0] * g
            v -= m[0, 1] * e + m[1, 1] * f + m[2, 1] * g
            w -= m[0, 2] * e + m[1, 2] * f + m[2, 2] * g
        x[k, 0], x[k, 1], x[k, 2] = u, v, w
        j = order[k]
        out[j, 0], out[j, 1], out[j, 2] = u, v, w
    return largest
