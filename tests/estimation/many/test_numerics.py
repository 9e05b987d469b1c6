"""Factors of many solves at once, against those of one; solves of very many rows."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.batches.factor import factors


@pytest.mark.parametrize("width", [1, 2, 3, 7])
def test_the_root_is_that_of_the_inverse_of_the_normal_equations(width):
    generator = np.random.default_rng(width)
    jacobian = generator.standard_normal((20, 30, width)) * 10.0 ** generator.uniform(-6, 6, (20, 1, width))
    found = factors(jacobian)
    assert found.good.all()
    for k in range(20):
        scaled = jacobian[k] / found.scale[k]
        expected = np.linalg.inv(scaled.T @ scaled)
        root = found.root[k] * found.scale[k][:, None]
        # inverting the normal equations by NumPy loses the square of a condition below 30
        np.testing.assert_allclose(root @ root.T, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())
        np.testing.assert_allclose(found.basis[k].T @ found.basis[k], np.eye(width), atol=1e-14)
        np.testing.assert_allclose(found.basis[k], jacobian[k] @ found.root[k], rtol=1e-9, atol=1e-13)


def test_an_ill_conditioned_factor_is_as_good_as_householders():
    """Cholesky's decomposition once would lose twice the digits of the condition, 1e5 here; twice does not."""
    generator = np.random.default_rng(1)
    left, _ = np.linalg.qr(generator.standard_normal((40, 4)))
    right, _ = np.linalg.qr(generator.standard_normal((4, 4)))
    jacobian = left @ np.diag([1.0, 1.0, 1.0, 1e-5]) @ right.T
    found = factors(jacobian[None])
    assert found.good[0]
    triangle = np.linalg.qr(jacobian, mode="r")
    inverse = np.linalg.inv(triangle)
    expected = inverse @ inverse.T
    # both are in error by the condition times the rounding of a number, 1e5 · 2e-16, and their sums by some more
    np.testing.assert_allclose(found.root[0] @ found.root[0].T, expected, rtol=1e-9)


@pytest.mark.parametrize("spoil", ["zero", "equal", "nearly", "nan"])
def test_what_is_not_of_full_rank_beyond_doubt_is_not_good(spoil):
    jacobian = np.random.default_rng(2).standard_normal((3, 10, 3))
    if spoil == "zero":
        jacobian[1, :, 2] = 0.0
    elif spoil == "nan":
        jacobian[1, 4, 0] = np.nan
    else:
        jacobian[1, :, 2] = jacobian[1, :, 0] + (1e-9 if spoil == "nearly" else 0.0) * jacobian[1, :, 1]
    assert factors(jacobian).good.tolist() == [True, False, True]


def test_solves_of_very_many_rows_are_those_of_gauss_and_newton():
    """50,000 rows, from which on normal equations are summed: places from ranges, beside Gauss-Newton in NumPy."""
    random = np.random.default_rng(5)
    solves, stations = 1050, random.uniform(0, 10, (48, 2))
    places = random.uniform(3, 7, (solves, 2))
    ranges = np.linalg.norm(places[:, None] - stations, axis=2) + 0.01 * random.standard_normal((solves, 48))
    x, y = np.tile(stations, (solves, 1)).T
    data = {"d": {"k": np.repeat(np.arange(solves), 48), "x": x, "y": y, "r": ranges.ravel()}}
    text = """(problem p (data d external) (unknowns (p (vector 2) :init [5 5]))
      (observe d (= r (distance p [x y])) :sigma 0.01) (for-each k))"""
    solved = mbm.loads(text).solve(data=data).table()
    found = np.full((solves, 2), 5.0)
    for _ in range(12):
        apart = found[:, None] - stations
        length = np.linalg.norm(apart, axis=2)
        slopes = apart / length[:, :, None]
        gram = np.einsum("kmi,kmj->kij", slopes, slopes)
        pull = np.einsum("kmi,km->ki", slopes, ranges - length)
        found += np.linalg.solve(gram, pull[:, :, None])[:, :, 0]
    # offsets of 1e-10 standard deviations (0.002) leave far less than this, and so do roundings
    assert np.stack([solved["p[1]"], solved["p[2]"]], axis=1) == pytest.approx(found, abs=1e-10)
    sigma = 0.01 * np.sqrt(np.linalg.inv(gram)[:, [0, 1], [0, 1]])
    # the curvature of the slopes between the last two steps is nothing
    assert np.stack([solved["p[1].sigma"], solved["p[2].sigma"]], axis=1) == pytest.approx(sigma, rel=1e-9)
