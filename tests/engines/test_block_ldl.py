"""Factors in blocks: they solve what a dense solver solves, whatever the lattice and its order."""

from __future__ import annotations

import numpy as np
import pytest

from riftberg.engines.quasi_static.lattice.block_ldl import BlockLDL, minimum_degree


def lattice(rows: int, columns: int, seed: int, *, slanted: bool = False):
    """Bonds of a lattice with holes, the stiffness of each a random positive definite 6 by 6 matrix, and springs everywhere."""
    rng = np.random.default_rng(seed)
    number = rng.permutation(rows * columns).reshape(rows, columns)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    pairs += [(number[:-1, :-1], number[1:, 1:])] if slanted else []
    ends = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])
    ends = ends[rng.random(len(ends)) > 0.2]
    diagonal = np.tile(np.diag(rng.uniform(0.1, 1.0, 3)), (rows * columns, 1, 1))
    between = np.empty((len(ends), 3, 3))
    for k, (i, j) in enumerate(ends):
        half = rng.normal(size=(6, 6))
        stiff = half @ half.T
        diagonal[i] += stiff[:3, :3]
        diagonal[j] += stiff[3:, 3:]
        between[k] = stiff[:3, 3:]
    return ends[:, 0].astype(np.int64), ends[:, 1].astype(np.int64), diagonal, between


def dense(first, second, diagonal, between):
    """The matrix, written out."""
    count = diagonal.shape[0]
    a = np.zeros((count, 3, count, 3))
    for i in range(count):
        a[i, :, i] = diagonal[i]
    for i, j, block in zip(first, second, between, strict=True):
        a[i, :, j] += block
        a[j, :, i] += block.T
    return a.reshape(3 * count, 3 * count)


@pytest.mark.parametrize(("rows", "columns", "slanted"), [(1, 1, False), (1, 7, False), (6, 5, False), (5, 8, True)])
def test_it_solves_what_a_dense_solver_solves(rows, columns, slanted) -> None:
    parts = lattice(rows, columns, rows + columns, slanted=slanted)
    right = np.random.default_rng(7).normal(size=3 * rows * columns)
    expected = np.linalg.solve(dense(*parts), right)
    np.testing.assert_allclose(BlockLDL(*parts).solve(right), expected, rtol=1e-9, atol=1e-12)


def test_two_bonds_between_the_same_elements_add_up() -> None:
    diagonal = np.tile(9.0 * np.eye(3), (2, 1, 1))
    twice = np.array([0, 1]), np.array([1, 0]), diagonal, np.array([np.eye(3), 0.5 * np.ones((3, 3))])
    right = np.arange(6.0)
    np.testing.assert_allclose(BlockLDL(*twice).solve(right), np.linalg.solve(dense(*twice), right), rtol=1e-12)


def test_elements_without_bonds_stand_alone() -> None:
    none = np.zeros(0, np.int64)
    diagonal = np.array([2.0 * np.eye(3), 4.0 * np.eye(3)])
    factors = BlockLDL(none, none, diagonal, np.zeros((0, 3, 3)))
    assert factors.factors.row.size == 0
    np.testing.assert_array_equal(factors.solve(np.ones(6)), [0.5] * 3 + [0.25] * 3)


def test_the_order_keeps_the_factors_small() -> None:
    """A band as in the order of the rows would hold 20 blocks for each element; a good order holds some 7."""
    number = np.arange(400).reshape(20, 20)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    order = minimum_degree(400, first, second)
    np.testing.assert_array_equal(np.sort(order), np.arange(400))
    diagonal, between = np.tile(5.0 * np.eye(3), (400, 1, 1)), np.tile(-np.eye(3), (first.size, 1, 1))
    assert BlockLDL(first, second, diagonal, between).factors.row.size < 400 * 9
