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
