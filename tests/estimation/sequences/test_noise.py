"""Roots of the noise of transitions, by machine code and interpreted: ``L Lᵀ`` is what was stated, singular or not."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.solver.noise_roots import root_of_covariance, root_of_sigma, roots_of_covariances

RANKS = {"full": 4, "three": 3, "one": 1, "none": 0}


@pytest.mark.parametrize("rank", RANKS)
def test_a_root_gives_the_matrix_back(rank):
    generator = np.random.default_rng(3)
    wide = generator.standard_normal((5, 4, RANKS[rank])) * np.array([1e3, 1.0, 1e-3, 1.0])[:, None]
    matrices = wide @ np.swapaxes(wide, 1, 2)
    roots = np.zeros_like(matrices)
    assert roots_of_covariances(5, 4, matrices.ravel().copy(), roots.reshape(-1)) == 5
    size = np.abs(matrices).max(axis=(1, 2), keepdims=True)
    # what is left out is below 1e-12 of the largest variance
    assert np.abs(roots @ np.swapaxes(roots, 1, 2) - matrices).max(initial=0.0) <= 4e-12 * size.max()
    assert not roots[:, :, RANKS[rank] :].any()


@pytest.mark.parametrize(
    "matrix", [[[1.0, 2.0], [2.0, 1.0]], [[1.0, 0.2], [0.1, 1.0]], [[-1.0, 0.0], [0.0, 1.0]], [[np.nan, 0.0], [0.0, 1]]]
)
def test_what_is_no_covariance_has_no_root(matrix):
    assert root_of_covariance(np.array(matrix).ravel(), 2, 2, 2, np.zeros(4)) == 0


def test_a_matrix_of_a_higher_rank_than_there_are_columns_has_no_root():
    assert root_of_covariance(np.eye(2).ravel(), 2, 1, 1, np.zeros(2)) == 0
    assert root_of_covariance(np.ones(4), 2, 1, 1, np.zeros(2)) == 1


@pytest.mark.parametrize(("sigma", "good"), [(0.0, 1), (2.0, 1), (-1.0, 0), (np.inf, 0), (np.nan, 0)])
def test_a_standard_deviation_may_be_zero(sigma, good):
    assert root_of_sigma(sigma, np.zeros(1)) == good
