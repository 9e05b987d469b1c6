"""One linearised step, and the root of its covariance, against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.equations.corrections.elimination import root
from mbm.equations.corrections.search import curved_up, step

SHAPES = [(1, 2, False), (1, 3, True), (2, 3, False), (3, 3, True), (5, 2, True), (6, 1, True)]
"""Equations, corrections, and whether the equations have noise of their own: every way of solving."""


@pytest.mark.parametrize(("k", "q", "noisy"), SHAPES)
def test_a_step_meets_the_linearised_conditions_with_the_smallest_corrections(k: int, q: int, noisy: bool) -> None:
    random = np.random.default_rng(k * 10 + q)
    slopes, values = random.normal(size=(4, k, q)), random.normal(size=(4, k))
    at = random.normal(size=(4, q))
    own = np.full((4, k), noisy)
    found, multipliers = step(slopes, None, own, values, at)
    for i in range(4):
        # minimise |u|² + |e|² subject to B u − e = B u₀ − h: the pseudo-inverse of [B, −I] or of B
        wide = np.hstack([slopes[i], -np.eye(k)]) if noisy else slopes[i]
        expected = np.linalg.pinv(wide) @ (slopes[i] @ at[i] - values[i])
        np.testing.assert_allclose(found[i], expected[:q], atol=1e-12)
        np.testing.assert_allclose(found[i], -slopes[i].T @ multipliers[i], atol=1e-12)


@pytest.mark.parametrize(("k", "q", "noisy"), SHAPES)
def test_newtons_step_is_stationary_for_the_quadratic_model(k: int, q: int, noisy: bool) -> None:
    random = np.random.default_rng(k + 10 * q)
    slopes, values = random.normal(size=(3, k, q)), random.normal(size=(3, k))
    at, bent = random.normal(size=(3, q)), 0.1 * random.normal(size=(3, q, q))
    curvature = bent + bent.transpose(0, 2, 1)
    found, multipliers = step(slopes, curvature, np.full((3, k), noisy), values, at)
    for i in range(3):
        change = found[i] - at[i]
        gradient = found[i] + curvature[i] @ change + slopes[i].T @ multipliers[i]
        np.testing.assert_allclose(gradient, 0, atol=1e-12)
        own = multipliers[i] if noisy else 0.0
        np.testing.assert_allclose(values[i] + slopes[i] @ change, own, atol=1e-12)


@pytest.mark.parametrize(("k", "q", "noisy"), SHAPES)
def test_the_root_squares_to_the_inverse_covariance(k: int, q: int, noisy: bool) -> None:
    slopes = np.random.default_rng(7).normal(size=(3, k, q))
    found = root(slopes, np.full((3, k), noisy))
    applied = found.apply(np.broadcast_to(np.eye(k), (3, k, k)).copy())
    covariance = slopes @ slopes.transpose(0, 2, 1) + noisy * np.eye(k)
    np.testing.assert_allclose(
        applied.transpose(0, 2, 1) @ applied @ covariance, np.tile(np.eye(k), (3, 1, 1)), atol=1e-11
    )


def test_systems_without_a_solution_give_no_numbers() -> None:
    slopes = np.zeros((2, 1, 2))
    slopes[1] = 1.0
    found, _ = step(slopes, None, np.zeros((2, 1), dtype=bool), np.ones((2, 1)), np.zeros((2, 2)))
    assert not np.isfinite(found[0]).any()
    np.testing.assert_allclose(found[1], -0.5)
    assert np.isnan(root(slopes, np.zeros((2, 1), dtype=bool)).apply(np.ones((2, 1, 1)))[0]).all()


@pytest.mark.parametrize(("k", "q"), [(1, 1), (1, 2), (1, 3), (2, 4)])
def test_a_foot_is_a_nearest_point_where_the_reduced_hessian_is_positive(k: int, q: int) -> None:
    """By the eigenvalues of I + W on the null space of exact conditions."""
    random = np.random.default_rng(10 * k + q)
    slopes, bent = random.normal(size=(200, k, q)), random.normal(size=(200, q, q))
    curvature = bent + bent.transpose(0, 2, 1)
    exact = np.zeros((200, k), dtype=bool)
    asked = random.random(200) < 0.9
    found = curved_up(slopes, curvature, exact, asked)
    for i in range(200):
        free = np.linalg.svd(slopes[i])[2][k:]
        reduced = np.linalg.eigvalsh(free @ (np.eye(q) + curvature[i]) @ free.T)
        plain = np.square(curvature[i]).sum() < 1.0
        # conditions have a weight of 1e8, so that values within 1e-6 of zero are not decided
        if not reduced.size or abs(reduced.min()) > 1e-6 or plain:
            assert found[i] == (plain or (asked[i] and (not reduced.size or reduced.min() > 0.0)))
