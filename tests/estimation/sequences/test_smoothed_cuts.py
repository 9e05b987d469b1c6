"""Inequalities that cut what a smoother of all steps knows: each once, against closed forms and sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

import mbm
from tests.estimation.sequences.test_limits import WRITTEN, Y, solved

CUTTING = "smoother :constraints truncate"
HIDDEN = """
(problem hidden
  (data d (table (k y) {rows}))
  (unknowns {plain})
  (states :over k (x :init 0 :sigma 1) {states})
  (dynamics (random-walk x :sigma 1) {moves})
  (observe d (= y (+ x c)) :sigma 1)
  (constraints {limits})
  (solve :method {method}))"""
STEPS = 40


def sampled(limit, count=2_000_000):
    """Means and deviations of the five states given all rows and that none is above a limit, by rejection."""
    moves = (np.eye(5)[1:] - np.eye(5)[:-1]) / 0.8
    rows = np.vstack([np.eye(5)[:1] / 3, moves, np.eye(5) / 0.3])
    covariance = np.linalg.inv(rows.T @ rows)
    mean = covariance @ rows.T @ np.concatenate([np.zeros(5), Y / 0.3])
    points = np.random.default_rng(3).multivariate_normal(mean, covariance, count, method="cholesky")
    points = points[(points <= limit).all(axis=1)]
    assert len(points) > 50_000
    return points.mean(axis=0), points.std(axis=0)


@pytest.mark.parametrize("written", WRITTEN)
def test_states_are_those_of_the_whole_distribution_within_its_limits(written):
    found = solved(CUTTING, *WRITTEN[written])
    mean, deviation = sampled(2.0)
    # samples tell a mean to 0.5 % of a deviation; beyond one cut the moments of a normal distribution are approximate
    np.testing.assert_allclose(found["x"].value, mean, rtol=0, atol=0.02 * deviation.min())
    np.testing.assert_allclose(found["x"].sigma, deviation, rtol=0.02)
    assert found["x"].value.max() < 2.0
    assert found.status == "ok"
    one_by_one = solved("truncated-ekf", *WRITTEN[written])
    assert np.abs(one_by_one["x"].value - mean).max() > 0.1


@pytest.mark.parametrize("kind", ["an unknown", "its bound", "a static state"])
def test_a_constant_is_cut_once_and_exactly(kind):
    """However many steps there are: mean and deviation of a normal distribution cut by a half space are known."""
    rows = " ".join(f"({k} {np.sin(k):.6f})" for k in range(STEPS))
    static = kind == "a static state"
    stated = "(c :init 0.3 :sigma 1)"
    given = {"rows": rows, "plain": "" if static else stated, "states": stated if static else ""}
    given["moves"] = "(static c)" if static else ""
    free = mbm.loads(HIDDEN.format(method="smoother", limits="", **given)).solve()["c"]
    mean, sigma = (np.ravel(each)[-1] for each in (free.value, free.sigma))
    limit = mean - 0.7 * sigma
    limits = f"(<= c {float(limit)!r})"
    if kind == "its bound":
        given["plain"], limits = f"(c :init 0.3 :sigma 1 :in (-50 {float(limit)!r}))", ""
    found = mbm.loads(HIDDEN.format(method=CUTTING, limits=limits, **given)).solve()
    hazard = norm.pdf(-0.7) / norm.cdf(-0.7)
    # rows of cuts are found to 1e-6 of a deviation
    np.testing.assert_allclose(found["c"].value, mean - hazard * sigma, rtol=0, atol=1e-5 * sigma)
    np.testing.assert_allclose(found["c"].sigma, sigma * np.sqrt(1 + 0.7 * hazard - hazard**2), rtol=1e-5)


def test_limits_far_away_change_nothing():
    found, free = solved(CUTTING, ":in (-90 90)", ""), solved("smoother")
    np.testing.assert_allclose(found["x"].value, free["x"].value, rtol=0, atol=1e-9)
    assert found.solves[0].cost == pytest.approx(free.solves[0].cost, rel=1e-9)
