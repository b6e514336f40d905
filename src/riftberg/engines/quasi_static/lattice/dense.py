"""Small dense matrices with sums in a fixed order.

A library of linear algebra orders its sums by the number of threads and the kind of processor, and by the last digits of a
displacement a piece strikes another in a different way.
"""

from __future__ import annotations

import math

import numpy as np

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats


@kernel
def multiply_rows(w: Floats, a_t: Floats) -> Floats:
    """Return the product of a matrix and another, which is given by its columns in rows: (n, k) and (n, m) make (k, m)."""
    product = np.zeros((w.shape[1], a_t.shape[1]))
    for n in range(w.shape[0]):
        for i in range(w.shape[1]):
            factor = w[n, i]
            if factor != 0.0:
                for j in range(a_t.shape[1]):
                    product[i, j] += factor * a_t[n, j]
    return product


@kernel
def multiply_sparse(w: Floats, a: Floats) -> Floats:
    """Return the products of the rows of two matrices, (k, n) and (m, n) make (k, m); most of ``w`` is 0."""
    product = np.zeros((w.shape[0], a.shape[0]))
    for i in range(w.shape[0]):
        for n in range(w.shape[1]):
            factor = w[i, n]
            if factor != 0.0:
                for j in range(a.shape[0]):
                    product[i, j] += factor * a[j, n]
    return product


@kernel
def solve_dense(matrix: Floats, right: Floats) -> Floats:
    """Solve a system of equations with several right-hand sides, shape (n, m), by elimination with pivots."""
    a, x, n = matrix.copy(), right.copy(), matrix.shape[0]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        for j in range(n):
            a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
        for j in range(x.shape[1]):
            x[k, j], x[pivot, j] = x[pivot, j], x[k, j]
        for i in range(k + 1, n):
            factor = a[i, k] / a[k, k]
            if factor != 0.0:
                for j in range(k + 1, n):
                    a[i, j] -= factor * a[k, j]
                for j in range(x.shape[1]):
                    x[i, j] -= factor * x[k, j]
    for k in range(n - 1, -1, -1):
        for i in range(k + 1, n):
            for j in range(x.shape[1]):
                x[k, j] -= a[k, i] * x[i, j]
        for j in range(x.shape[1]):
            x[k, j] /= a[k, k]
    return x


@kernel
def factor_semidefinite(matrix: Floats, negligible: float) -> Floats:
    """Return rows w of a symmetric matrix without negative eigenvalues, which is the sum of ``w w^T``.

    By Cholesky's method with the largest pivot first, until those that are left are ``negligible``.
    """
    left, n = matrix.copy(), matrix.shape[0]
    rows, rank = np.zeros((n, n)), 0
    while rank < n:
        pivot = 0
        for i in range(1, n):
            if left[i, i] > left[pivot, pivot]:
                pivot = i
        if left[pivot, pivot] <= negligible:
            break
        root = math.sqrt(left[pivot, pivot])
        for i in range(n):
            rows[rank, i] = left[pivot, i] / root
        for i in range(n):
            for j in range(n):
                left[i, j] -= rows[rank, i] * rows[rank, j]
        for i in range(n):  # what is left of it is round-off
            left[pivot, i] = left[i, pivot] = 0.0
        rank += 1
    return rows[:rank]


@kernel
def _multiply_stacks(a: Floats, b: Floats) -> Floats:
    product = np.zeros((a.shape[0], a.shape[1], b.shape[2]))
    for t in range(a.shape[0]):
        for i in range(a.shape[1]):
            for j in range(a.shape[2]):
                for k in range(b.shape[2]):
                    product[t, i, k] += a[t, i, j] * b[t, j, k]
    return product


def multiply_stacks(a: Floats, b: Floats) -> Floats:
    """Return the products of two stacks of matrices, one by one; either may be one matrix for all."""
    count = len(a if a.ndim == 3 else b)
    a, b = (np.ascontiguousarray(np.broadcast_to(m, (count, *m.shape[-2:]))) for m in (a, b))
    return np.asarray(_multiply_stacks(a, b))


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the product of a matrix, or a stack of some, and another matrix or a vector."""
    return np.asarray(np.einsum("...ij,jk->...ik" if b.ndim == 2 else "...ij,j->...i", a, b))


def find_null_space(rows: Floats, negligible: float) -> Floats:
    """Return unit vectors, as columns, at right angles to all rows; a part ``negligible`` of the largest counts as 0."""
    spanned = _complete_basis(np.zeros((0, rows.shape[1])), rows, negligible * np.abs(rows).max(initial=0.0))
    return _complete_basis(spanned, np.eye(rows.shape[1]), 0.0)[len(spanned) :].T


def _complete_basis(basis: Floats, vectors: Floats, negligible: float) -> Floats:
    """Add to orthogonal unit vectors (rows) what others add to their span, the longest first (Gram and Schmidt)."""
    left = vectors.copy()
    for unit in basis:
        left -= (left * unit).sum(axis=1)[:, None] * unit
    while len(basis) < vectors.shape[1]:
        square = (left * left).sum(axis=1)
        longest = int(square.argmax())
        if square[longest] <= negligible * negligible:
            break
        unit = left[longest] / math.sqrt(square[longest])
        basis = np.vstack([basis, unit])
        for _ in range(2):  # once more takes away what round-off has left
            left -= (left * unit).sum(axis=1)[:, None] * unit
    return basis
