"""Linear algebra of 3 by 3 matrices, written out: one for each fragment or pair of elements, too small for a library.

Sums run in a fixed order, so results do not depend on the compiler.
"""

from __future__ import annotations

from riftberg.compiled.kernels import kernel
from riftberg.state import Floats


@kernel
def multiply(a: Floats, b: Floats, out: Floats) -> None:
    """Set ``out = a b``."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel
def subtract_product(out: Floats, a: Floats, b: Floats) -> None:
    """Set ``out -= a b^T``."""
    for i in range(3):
        for j in range(3):
            out[i, j] -= a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@kernel
def times(a: Floats, x: Floats) -> tuple[float, float, float]:
    """Return ``a x``."""
    return (
        a[0, 0] * x[0] + a[0, 1] * x[1] + a[0, 2] * x[2],
        a[1, 0] * x[0] + a[1, 1] * x[1] + a[1, 2] * x[2],
        a[2, 0] * x[0] + a[2, 1] * x[1] + a[2, 2] * x[2],
    )


@kernel
def solve(a: Floats, x: Floats) -> tuple[float, float, float]:
    """Solve ``a z = x`` by elimination with pivots; both are overwritten."""
    for k in range(3):
        best = k
        for i in range(k + 1, 3):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        for j in range(3):
            a[k, j], a[best, j] = a[best, j], a[k, j]
        x[k], x[best] = x[best], x[k]
        for i in range(k + 1, 3):
            factor = a[i, k] / a[k, k]
            for j in range(k, 3):
                a[i, j] -= factor * a[k, j]
            x[i] -= factor * x[k]
    z = x[2] / a[2, 2]
    y = (x[1] - a[1, 2] * z) / a[1, 1]
    return (x[0] - a[0, 1] * y - a[0, 2] * z) / a[0, 0], y, z


@kernel
def invert(matrices: Floats, out: Floats, scratch: Floats) -> None:
    """Invert each matrix of a stack; ``scratch`` has room for two of them."""
    a, unit = scratch[0], scratch[1, 0]
    for b in range(matrices.shape[0]):
        for j in range(3):
            for i in range(3):
                unit[i] = 1.0 if i == j else 0.0
                for k in range(3):
                    a[i, k] = matrices[b, i, k]
            out[b, 0, j], out[b, 1, j], out[b, 2, j] = solve(a, unit)


@kernel
def invert_symmetric(a: Floats, out: Floats) -> None:
    """Invert a symmetric matrix by its cofactors."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
    c01 = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
    c02 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    scale = 1.0 / (a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02)
    out[0, 0] = scale * c00
    out[0, 1] = out[1, 0] = scale * c01
    out[0, 2] = out[2, 0] = scale * c02
    out[1, 1] = scale * (a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2])
    out[1, 2] = out[2, 1] = scale * (a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2])
    out[2, 2] = scale * (a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1])
