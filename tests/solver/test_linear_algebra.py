"""The solver's dense algebra against NumPy's, in every target."""

from __future__ import annotations

import numpy as np
import pytest

EPSILON = np.finfo(float).eps


def matrix(rows, columns, seed=1):
    return np.random.default_rng(seed).standard_normal((rows, columns))


def upper(n, seed=1):
    return np.triu(matrix(n, n, seed)) + 3 * np.eye(n)


def chunk_of(rows, stride):
    """Column by column, each ``stride`` long, as the solver keeps rows that it works on."""
    found = np.zeros((rows.shape[1], stride))
    found[:, : len(rows)] = rows.T
    return found.ravel()


def test_triangle_of_rows_that_come_in_portions(solver):
    whole = matrix(50, 5)
    triangle = np.zeros((5, 5))
    for first in range(0, 50, 20):
        part = whole[first : first + 20]
        solver("append_rows", 5, len(part), 24, chunk_of(part, 24), triangle)
    # Q is orthogonal to a few roundings for each of the 5 reflections; the sums have 50 terms.
    np.testing.assert_allclose(triangle.T @ triangle, whole.T @ whole, rtol=0, atol=50 * EPSILON * (whole**2).sum())
    np.testing.assert_array_equal(triangle, np.triu(triangle))


def test_columns_of_zeros_and_signs_do_no_harm(solver):
    whole = matrix(8, 3)
    whole[:, 1] = 0.0
    whole[:, 0] = np.abs(whole[:, 0])
    triangle = np.zeros((3, 3))
    solver("append_rows", 3, 8, 8, chunk_of(whole, 8), triangle)
    np.testing.assert_allclose(triangle.T @ triangle, whole.T @ whole, rtol=0, atol=1e-14)
    assert triangle[1, 1] == 0.0


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_triangular_systems(solver, n):
    a, right = upper(n), matrix(n, 1).ravel()
    # Diagonals of 3 and more beside entries of 1: a condition far below 1e3.
    x = right.copy()
    solver("solve_upper", n, a, x)
    np.testing.assert_allclose(a @ x, right, rtol=1e-12, atol=1e-13)
    x = right.copy()
    solver("solve_transposed", n, a, x)
    np.testing.assert_allclose(a.T @ x, right, rtol=1e-12, atol=1e-13)
    found = np.zeros(n)
    solver("times_upper", n, a, right, found)
    np.testing.assert_allclose(found, a @ right, rtol=1e-12, atol=1e-14)
    solver("times_transposed", n, a, right, found)
    np.testing.assert_allclose(found, a.T @ right, rtol=1e-12, atol=1e-14)
    inverse = np.zeros((n, n))
    solver("inverted_upper", n, a, inverse)
    np.testing.assert_allclose(inverse @ a, np.eye(n), rtol=0, atol=1e-12)


def test_a_zero_on_the_diagonal_gives_a_basic_solution(solver):
    a, x = upper(3), np.ones(3)
    a[1, 1] = 0.0
    solver("solve_upper", 3, a, x)
    assert x[1] == 0.0
    assert np.isfinite(x).all()


@pytest.mark.parametrize("damping", [0.0, 1e-6, 0.3, 1e4])
def test_damped_triangle(solver, damping):
    a, image = upper(6), matrix(6, 1, 2).ravel()
    triangle, right, row = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    solver("damped_triangle", 6, a, image, damping, triangle, right, row)
    wanted = a.T @ a + damping * np.eye(6)
    np.testing.assert_allclose(triangle.T @ triangle, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())
    np.testing.assert_allclose(triangle.T @ right, a.T @ image, rtol=0, atol=1e-13 * np.abs(wanted).max())


def test_cholesky(solver):
    base = matrix(5, 5)
    wanted = base @ base.T + np.eye(5)
    found = wanted.copy()
    assert solver("cholesky", 5, found) == 1
    np.testing.assert_allclose(np.tril(found), np.linalg.cholesky(wanted), rtol=1e-13, atol=1e-14)
    assert solver("cholesky", 2, np.array([[1.0, 2.0], [2.0, 1.0]])) == 0
    assert solver("cholesky", 1, np.array([np.nan])) == 0


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_lower_triangles_and_products(solver, n):
    lower, right = upper(n).T.copy(), matrix(n, 1).ravel()
    # What is above the diagonal is not read; a condition as in `test_triangular_systems`.
    filled = lower + np.triu(np.full((n, n), np.nan), 1)
    x = right.copy()
    solver("solve_lower", n, filled, x)
    np.testing.assert_allclose(lower @ x, right, rtol=1e-12, atol=1e-13)
    x = right.copy()
    solver("solve_lower_transposed", n, filled, x)
    np.testing.assert_allclose(lower.T @ x, right, rtol=1e-12, atol=1e-13)
    a, b, found = matrix(2, n, 3), matrix(n, 4, 4), np.full((2, 4), np.nan)
    solver("product", 2, n, 4, a, b, found)
    np.testing.assert_allclose(found, a @ b, rtol=1e-12, atol=1e-14)
    a, b, found = matrix(5, n, 3), matrix(5, n, 4), np.full((n, n), np.nan)
    solver("sum_of_products", 5, n, a, b, found)
    np.testing.assert_allclose(found, a.T @ b, rtol=1e-12, atol=1e-14)


def test_columns_corners_and_transposes(solver):
    whole = matrix(5, 4)
    flat = whole.ravel()
    assert solver("column_product", 3, 4, flat[1:], flat[3:]) == pytest.approx(whole[:3, 1] @ whole[:3, 3], rel=1e-13)
    found = np.zeros((3, 3))
    solver("corner", 3, 4, whole, found)
    np.testing.assert_array_equal(found, whole[:3, :3])
    solver("transposed", 3, found)
    np.testing.assert_array_equal(found, whole[:3, :3].T)
    solver("symmetrised", 3, 2.0, found)
    np.testing.assert_allclose(found, whole[:3, :3] + whole[:3, :3].T, rtol=1e-15)
