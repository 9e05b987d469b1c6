"""Singular values, the rank that they decide, and the covariance of what is determined: against NumPy."""

import numpy as np
import pytest

from mbm.solver.decisions import SHARE
from mbm.solver.description import HEADER, Problem
from tests.solver.scratch import Scratch
from tests.solver.test_linear_algebra import matrix


def values_and_vectors(solver, triangle):
    """The singular values of a triangle (w, w), and the right singular vectors, one to a row."""
    width = len(triangle)
    small = np.zeros((width + 1, width + 1))
    small[:width, :width] = np.triu(triangle)
    small[np.tril_indices(width, -1)] = np.nan  # is not looked at
    found, vectors = np.zeros(width), np.zeros((width, width))
    solver("singular_values", width, small, np.zeros((width, width)), vectors, found)
    return found, vectors


@pytest.mark.parametrize("width", [1, 2, 5, 12])
def test_singular_values(width, solver):
    triangle = np.triu(matrix(width, width))
    found, vectors = values_and_vectors(solver, triangle)
    wanted = np.linalg.svd(triangle, compute_uv=False)
    # Rotations keep norms to a few roundings each; both methods do so beside the largest value.
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * width * wanted[0])
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(width), rtol=0, atol=1e-14 * width)
    np.testing.assert_allclose(np.linalg.norm(triangle @ vectors.T, axis=0), found, rtol=1e-13, atol=0)


def test_a_triangle_that_hides_how_small_its_least_singular_value_is(solver):
    """Kahan (1966): no pivot is small, yet the matrix is nearly singular."""
    width, sine, cosine = 30, np.sin(1.0), np.cos(1.0)
    triangle = sine ** np.arange(width)[:, None] * (np.eye(width) - cosine * np.triu(np.ones((width, width)), 1))
    found, _ = values_and_vectors(solver, triangle)
    wanted = np.linalg.svd(triangle, compute_uv=False)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * wanted[0])
    assert found[-1] < 1e-3 * triangle[-1, -1]


def test_a_gap_parts_singular_values_that_are_none(solver):
    def ranked(*values, affine=0):
        return solver("decided_rank", len(values), np.array(values), affine)

    assert ranked(1.0, 1e-8) == 2
    assert ranked(1.0, 1e-10) == 1
    # a polynomial of high degree: they fall step by step
    assert ranked(1.0, 1e-3, 1e-6, 1e-8, 1e-10) == 5
    assert ranked(1.0, 1e-13) == 1
    # constant derivatives: only roundings are none
    assert ranked(1.0, 1e-10, affine=1) == 2
    assert ranked(1.0, 1e-12, affine=1) == 2
    assert ranked(1.0, 1e-14, affine=1) == 1
    assert ranked(0.0) == 0
    assert ranked() == 0


def covariance_of(solver, jacobian, sides):
    """Covariance, masked, condition, rank, free directions and the scratch of rows (m, n) without constraints."""
    n = jacobian.shape[1]
    system = np.zeros(HEADER, dtype=np.int64)
    system[Problem.n] = n  # nothing else matters to scratch without residuals
    work = Scratch(system)
    triangle = np.zeros((n + 1, n + 1))
    upper = np.linalg.qr(np.hstack([jacobian, np.ones((len(jacobian), 1))]), mode="r")
    triangle[: len(upper)] = upper
    covariance = np.zeros((n, n))
    nothing = np.zeros(1)
    condition = solver("set_covariance", system, triangle, sides, 0, nothing, work, covariance)
    return system, work, condition, covariance


def test_what_is_determined_has_the_covariance_of_the_pseudoinverse(solver):
    jacobian = matrix(9, 6) * np.array([1.0, 1e3, 1.0, 1e-4, 1.0, 1.0])
    jacobian[:, 4] = 2.0 * jacobian[:, 2]
    system, work, condition, covariance = covariance_of(solver, jacobian, np.zeros(6, dtype=np.int64))
    assert condition == np.inf
    assert (work.record.rank, work.record.loose) == (5, 1)
    assert work.record.touched[:6].tolist() == [0.0, 0.0, 1.0, 0.0, 1.0, 0.0]
    # the others do not depend on how the free direction is closed: here by leaving one of the two columns out
    kept = [0, 1, 2, 3, 5]
    wanted = np.linalg.inv(jacobian[:, kept].T @ jacobian[:, kept])
    known, there = [0, 1, 3, 5], [0, 1, 3, 4]
    # inverted with the square of a condition of 1e7 after scaling of about 10
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))[np.ix_(there, there)]
    difference = covariance[np.ix_(known, known)] - wanted[np.ix_(there, there)]
    assert np.abs(difference / scale).max() < 1e-8
    # x3 + 2 x5 is determined, x3 alone is not
    gradient = np.array([0.0, 0.0, 1.0, 0.0, 2.0, 0.0])
    assert solver("determines", system, gradient, work) == 1
    assert gradient @ covariance @ gradient == pytest.approx(wanted[2, 2], rel=1e-8)
    gradient[4] = 0.0
    assert solver("determines", system, gradient, work) == 0
    solver("mask_undetermined", system, work, covariance)
    assert np.isnan(covariance).any(axis=0).all()
    assert np.isnan(np.diag(covariance)).tolist() == [False, False, True, False, True, False]


def test_fewer_rows_than_coordinates_and_one_at_a_bound(solver):
    jacobian = np.array([[1.0, 1.0, 3.0, 0.0], [0.0, 0.0, 5.0, 2.0]])
    sides = np.array([0, 0, 1, 0])
    system, work, condition, covariance = covariance_of(solver, jacobian, sides)
    assert condition == np.inf
    assert (work.record.rank, work.record.loose) == (2, 1)
    solver("mask_undetermined", system, work, covariance)
    assert np.diag(covariance)[2:] == pytest.approx([0.0, 0.25])
    assert np.isnan(np.diag(covariance)[:2]).all()


def test_what_is_well_determined_is_not_decomposed(solver):
    jacobian = matrix(7, 3)
    _, work, condition, covariance = covariance_of(solver, jacobian, np.zeros(3, dtype=np.int64))
    assert np.linalg.cond(jacobian) <= condition < 1e3
    assert (work.record.rank, work.record.loose) == (3, 0)
    np.testing.assert_allclose(covariance @ (jacobian.T @ jacobian), np.eye(3), rtol=0, atol=1e-12)
    assert not work.record.touched[:3].any()
    assert work.record.chosen[:3].tolist() == [0, 1, 2]


@pytest.mark.parametrize(("share", "felt"), [(0.0, False), (0.9, False), (1.1, True), (1e3, True)])
@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_a_gradient_feels_free_directions_from_a_millionth_on(solver, share, felt, scale):
    """Of three coordinates the third is free; the second counts in units of ``scale``."""
    jacobian = np.array([[1.0, 0.0, 0.0], [0.0, 1.0 / scale, 0.0], [0.0, 0.0, 0.0]])
    system, work, _, _ = covariance_of(solver, jacobian, np.zeros(3, dtype=np.int64))
    assert (work.record.rank, work.record.loose) == (2, 1)
    # A column of zeros counts as one of length 1; its share is that of the whole gradient in such units.
    gradient = np.array([0.0, 1.0 / scale, share * SHARE])
    assert solver("determines", system, gradient, work) == int(not felt)
