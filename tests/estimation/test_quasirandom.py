"""Random starts: equidistribution of Sobol points, uniform rotations and directions, and that more only append."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from mbm.estimation.starts.random_starts import _directions, directions, rotations, sobol


def test_direction_numbers_are_those_of_an_independent_implementation():
    """SciPy holds the numbers of Joe and Kuo too; unscrambled points in Gray code order show all of them."""
    expected = qmc.Sobol(40, scramble=False).random(1024)
    gray = np.arange(1024) ^ (np.arange(1024) >> 1)
    points = np.zeros((1024, 40), dtype=np.uint64)
    for bit in range(10):
        points ^= np.where((gray[:, None] >> bit) & 1, _directions()[:, bit], 0).astype(np.uint64)
    assert np.array_equal(points / 2.0**32, expected)


@pytest.mark.parametrize("seed", [0, 7, 2**40])
def test_every_axis_is_stratified_after_scrambling(seed):
    """2^k points have exactly one coordinate in each of the 2^k intervals: a property that scrambling keeps."""
    points = sobol(256, 40, seed)
    assert points.min() > 0
    assert points.max() < 1
    for axis in range(40):
        assert sorted(np.floor(points[:, axis] * 256).astype(int)) == list(range(256))


def test_the_first_two_axes_fill_the_square():
    """A (0, 8, 2)-net: one point in each of the 16 × 16 squares, and in each of the other elementary rectangles."""
    points = sobol(256, 2, 3)
    for rows in (1, 2, 4, 16, 64):
        cells = np.floor(points * [rows, 256 // rows]).astype(int)
        assert len({tuple(c) for c in cells}) == 256


def test_more_points_only_append_and_another_seed_gives_others():
    few, many = sobol(100, 45, 7), sobol(1000, 45, 7)
    assert np.array_equal(few, many[:100])
    assert not np.any(np.all(sobol(100, 45, 8) == few, axis=0))


def test_rotations_and_directions_are_uniform():
    """Second moments of the uniform distributions: I/4 on the sphere of quaternions, I/3 on that of directions."""
    turned, pointed = rotations(sobol(4096, 3, 1)), directions(sobol(4096, 2, 1))
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1, rtol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(pointed, axis=1), 1, rtol=1e-14)
    # 4096 quasi-random points integrate smooth functions to about 1e-3.
    np.testing.assert_allclose(turned.T @ turned / 4096, np.eye(4) / 4, atol=2e-3)
    np.testing.assert_allclose(pointed.T @ pointed / 4096, np.eye(3) / 3, atol=2e-3)
    np.testing.assert_allclose(pointed.mean(axis=0), 0, atol=2e-3)
