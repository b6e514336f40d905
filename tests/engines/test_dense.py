"""Small dense matrices with sums in a fixed order, against a library of linear algebra."""

import numpy as np
import pytest

from riftberg.engines.quasi_static.lattice import dense


@pytest.mark.parametrize("size", [1, 2, 7, 40])
def test_products_and_solutions_are_those_of_a_library(size: int) -> None:
    rng = np.random.default_rng(size)
    w, a, matrix, right = (
        rng.normal(size=(90, size)),
        rng.normal(size=(90, 5)),
        rng.normal(size=(size, size)),
        rng.normal(size=(size, 3)),
    )
    np.testing.assert_allclose(dense.multiply_rows(w, a), w.T @ a, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(dense.multiply_sparse(w.T.copy(), a.T.copy()), dense.multiply_rows(w, a))
    before = matrix.copy()
    np.testing.assert_allclose(matrix @ dense.solve_dense(matrix, right), right, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(matrix, before)


def test_a_system_whose_first_pivot_is_zero_is_solved() -> None:
    matrix = np.array([[0.0, 2.0], [1.0, 0.0]])
    np.testing.assert_array_equal(dense.solve_dense(matrix, np.array([[4.0], [3.0]])), [[3.0], [2.0]])


@pytest.mark.parametrize("rank", [0, 1, 4, 9])
def test_a_matrix_is_the_sum_of_its_rows_and_no_more_than_its_rank(rank: int) -> None:
    rows = np.random.default_rng(rank).normal(size=(rank, 9)) * np.geomspace(1.0, 1e4, 9)
    matrix = rows.T @ rows
    found = dense.factor_semidefinite(matrix, 1e-12 * max(np.trace(matrix), 1.0))
    assert len(found) == rank
    np.testing.assert_allclose(found.T @ found, matrix, rtol=1e-9, atol=1e-9 * np.abs(matrix).max(initial=0.0))


@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize("rank", [1, 2, 3])
def test_a_null_space_lies_at_right_angles_to_all_rows(count: int, rank: int) -> None:
    """Bug: what completes the basis was not taken at right angles to the rows, so a berg on one roller was not held by it."""
    rng = np.random.default_rng(count)
    rows = rng.normal(size=(count, min(rank, count))) @ rng.normal(size=(min(rank, count), 3))
    space = dense.find_null_space(rows, 1e-9)
    assert space.shape == (3, 3 - min(rank, count))
    np.testing.assert_allclose(rows @ space, 0.0, atol=1e-12)
    np.testing.assert_allclose(space.T @ space, np.eye(space.shape[1]), atol=1e-12)
