"""Linear sequences against Kalman's filter in NumPy, and against one dense least-squares problem."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.estimation.sequences.types import Prior, Rules
from tests.estimation.sequences.chains import cart_sequence
from tests.estimation.sequences.kalman import filtered, jointly

STEPS = 30


def matrices(tables, moves):
    """The cart as textbooks have it: (F, Q) of each transition, (H, z, R) of each step."""
    made = []
    for dt in moves["steps"]["dt"]:
        noise = np.array([0.0, dt * dt / 2, dt]) * 0.3
        made.append((np.array([[1.0, 0, 0], [0, 1, dt], [0, 0, 1]]), np.outer(noise, noise)))
    rows = []
    z = tables["z"]
    for k in range(len(moves["steps"]["dt"]) + 1):
        mine = np.flatnonzero(z["k"] == k)
        second = mine[z["w"][mine] > -1e9]
        H = [[1.0, 1, 0]] * len(mine) + [[-1.0, 1, 0]] * len(second)
        R = np.diag(np.concatenate([z["s"][mine] ** 2, np.full(len(second), 0.25)]))
        rows.append((np.array(H).reshape(-1, 3), np.concatenate([z["y"][mine], z["w"][second]]), R))
    return made, rows


COVARIANCES = {
    "full": np.array([[0.5, 0.1, 0], [0.1, 2.0, 0.3], [0, 0.3, 1.0]]),
    "singular": np.outer([1.0, 2.0, 0.5], [1.0, 2.0, 0.5]),
    "none": np.zeros((3, 3)),
}


@pytest.mark.parametrize("kind", COVARIANCES)
def test_a_filter_is_kalmans(kind):
    sequence, tables, moves = cart_sequence(STEPS)
    mean, covariance = np.array([0.3, -0.2, 0.1]), COVARIANCES[kind]
    found = sequence.walk(Prior.of(point=mean, covariance=covariance, unknown=np.zeros(3, bool)), Rules())
    means, covariances, cost = filtered(mean, covariance, *matrices(tables, moves))
    assert found.made == STEPS
    # a textbook's filter subtracts covariances: 30 steps of rounding
    np.testing.assert_allclose(found.points, means, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.covariances, covariances, rtol=0, atol=1e-12)
    assert found.costs.sum() == pytest.approx(cost, rel=1e-11)


def test_without_a_prior_it_is_the_least_squares_estimate():
    """Nothing is known of the first step: from the step on that determines all, it is what all rows up to there say."""
    sequence, tables, moves = cart_sequence(STEPS)
    found = sequence.walk(Prior.of(point=np.zeros(3), covariance=np.zeros((3, 3)), unknown=np.ones(3, bool)), Rules())
    made, rows = matrices(tables, moves)
    diffuse = 1e8 * np.eye(3)
    assert found.opens[0] == 1
    assert (found.opens[2:] == 0).all()
    for last in (3, STEPS - 1):
        means, covariances, _ = jointly(np.zeros(3), diffuse, made[:last], rows[: last + 1])
        # the dense problem has a prior of deviation 1e4, which shifts by 1e-8 of what it is compared with
        np.testing.assert_allclose(found.points[last], means[last], rtol=0, atol=1e-6)
        np.testing.assert_allclose(found.covariances[last], covariances[last], rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", COVARIANCES)
def test_a_smoother_is_the_batch_solution(kind):
    """With noise of rank 1, which no inverse of a covariance would survive, and a first covariance that is singular."""
    sequence, tables, moves = cart_sequence(STEPS)
    mean, covariance = np.array([0.3, -0.2, 0.1]), COVARIANCES[kind]
    found = sequence.walk(Prior.of(point=mean, covariance=covariance, unknown=np.zeros(3, bool)), Rules(smooth=True))
    means, covariances, cost = jointly(mean, covariance, *matrices(tables, moves))
    assert found.settled
    np.testing.assert_allclose(found.points, means, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.covariances, covariances, rtol=0, atol=1e-12)
    assert found.cost == pytest.approx(cost, rel=1e-11)
    assert cost == pytest.approx(filtered(mean, covariance, *matrices(tables, moves))[2], rel=1e-10)


def test_a_smoother_needs_no_prior():
    sequence, tables, moves = cart_sequence(STEPS)
    prior = Prior.of(point=np.zeros(3), covariance=np.zeros((3, 3)), unknown=np.ones(3, bool))
    found = sequence.walk(prior, Rules(smooth=True))
    means, covariances, _ = jointly(np.zeros(3), 1e8 * np.eye(3), *matrices(tables, moves))
    assert not found.opens.any()
    np.testing.assert_allclose(found.points, means, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.covariances, covariances, rtol=0, atol=1e-6)


@pytest.mark.parametrize("lag", [0, 1, 4])
@pytest.mark.parametrize("kind", COVARIANCES)
def test_a_fixed_lag_gives_each_step_the_rows_of_so_many_more(kind, lag):
    sequence, tables, moves = cart_sequence(STEPS)
    mean, covariance = np.array([0.3, -0.2, 0.1]), COVARIANCES[kind]
    prior = Prior.of(point=mean, covariance=covariance, unknown=np.zeros(3, bool))
    found = sequence.walk(prior, Rules(smooth=True, lag=lag))
    made, rows = matrices(tables, moves)
    for k in range(0, STEPS, 3):
        last = min(k + lag, STEPS - 1)
        means, covariances, _ = jointly(mean, covariance, made[:last], rows[: last + 1])
        np.testing.assert_allclose(found.points[k], means[k], rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.covariances[k], covariances[k], rtol=0, atol=1e-12)
