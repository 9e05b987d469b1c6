"""Rows and derived quantities of filters with plain unknowns stand at the point of their own step."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.estimation.sequences.kalman import filtered, jointly

Y = (1.0, 2.2, 2.9, 4.3)
OFFSET = 0.6
"""What measures b alone, at the last step: until then x and b are hardly told apart."""

TEXT = """
(problem own
  (data d (table (k y z) (0 1.0 0) (1 2.2 0) (2 2.9 0) (3 4.3 0.6)))
  (unknowns (b :init 0 :sigma 10))
  (states :over k (x :init 0 :sigma 10) {static})
  (dynamics (random-walk x :sigma 1) {still})
  (observe seen d (= y (+ x {offset})) :sigma 0.3)
  (observe own d (= z {offset}) :sigma 0.5 :when (= k 3))
  {limit}
  (derive (gap (- x {offset})) (most (max d (- (+ x {offset}) y))) (others (rms d (- z {offset}))))
  (solve :method {method}))"""

LIMIT = "(constraints (>= (+ x {offset}) 2.5))"

WRITTEN = {
    "plain": {"static": "", "still": "", "offset": "b"},
    "static": {"static": "(s :init 0 :sigma 10)", "still": "(static s)", "offset": "s"},
}


def expected(lag):
    """Means and covariances of [b x] at each step, with the rows of ``lag`` more."""
    moves = [(np.eye(2), np.diag([0.0, 1.0]))] * 3
    rows = [(np.array([[1.0, 1.0]]), np.array([y]), np.array([[0.09]])) for y in Y]
    H, z, _ = rows[3]
    rows[3] = (np.vstack([H, [1.0, 0.0]]), np.append(z, OFFSET), np.diag([0.09, 0.25]))
    prior = np.zeros(2), 100.0 * np.eye(2)
    if lag == 0:
        return filtered(*prior, moves, rows)[:2]
    whole = [jointly(*prior, moves[: min(k + lag, 3)], rows[: min(k + lag, 3) + 1]) for k in range(4)]
    return np.array([found[0][k] for k, found in enumerate(whole)]), [found[1][k] for k, found in enumerate(whole)]


@pytest.mark.parametrize("written", WRITTEN)
@pytest.mark.parametrize(("method", "lag"), [("ekf", 0), ("(smoother :lag 1)", 1), ("smoother", 3)])
def test_rows_are_at_the_point_of_their_own_step(method, lag, written):
    limit = "" if lag else LIMIT.format(**WRITTEN[written])  # smoothers meet it, which is another answer
    result = mbm.loads(TEXT.format(method=method, limit=limit, **WRITTEN[written])).solve()
    means, covariances = expected(lag)
    residuals = (means.sum(axis=1) - Y) / 0.3
    # what rounding leaves of a filter with inverses, at deviations of 10
    close = {"rel": 1e-9, "abs": 1e-9}
    assert result["gap"].value == pytest.approx(means @ [-1, 1], **close)
    spreads = [np.sqrt(P[0, 0] + P[1, 1] - 2 * P[0, 1]) for P in covariances]
    assert result["gap"].sigma == pytest.approx(spreads, rel=1e-9)
    report = result.result.solves[0]
    assert report.residual_summaries["seen"].rms == pytest.approx(np.sqrt(np.mean(residuals**2)), **close)
    rows = [row for row in report.rows() if row.clause == "seen"]
    assert [row.residual for row in rows] == pytest.approx(residuals, **close)
    assert result["most"].value == pytest.approx(np.max(0.3 * residuals), **close)
    if lag:
        return
    constraint = report.constraints[0]
    assert constraint.violation == pytest.approx(2.5 - means.sum(axis=1).min(), **close)
    assert list(constraint.violated_rows) == [1 + k for k in np.flatnonzero(means.sum(axis=1) < 2.5)]


STILL = """
(problem still
  (data d (table (k y) (0 1.0) (1 2.2) (2 2.9) (3 4.3)))
  (unknowns (b :init 0 :sigma 1))
  (states :over k (x :init 0 :sigma 10) (s :init 0 :sigma 3))
  (dynamics (random-walk x :sigma 1) (static s))
  (observe d (= y (+ x s b)) :sigma 0.3)
  (derive (twice (* 2 s)) (sum (+ s b)) (own (first d s)) (grown (- (last d x) (first d x))))
  (solve :method {method}))"""


def still_expected(lag):
    """Means and covariances of [b s x] at each step, with the rows of ``lag`` more."""
    prior = np.zeros(3), np.diag([1.0, 9.0, 100.0])
    moves = [(np.eye(3), np.diag([0.0, 0.0, 1.0]))] * 3
    rows = [(np.ones((1, 3)), np.array([y]), np.array([[0.09]])) for y in Y]
    if lag == 0:
        return filtered(*prior, moves, rows)[:2]
    whole = [jointly(*prior, moves[: min(k + lag, 3)], rows[: min(k + lag, 3) + 1]) for k in range(4)]
    return np.array([found[0][k] for k, found in enumerate(whole)]), [found[1][k] for k, found in enumerate(whole)]


@pytest.mark.parametrize(("method", "lag"), [("ekf", 0), ("(smoother :lag 1)", 1), ("smoother", 3)])
def test_a_static_state_is_told_as_it_was_known_at_each_step(method, lag):
    result = mbm.loads(STILL.format(method=method)).solve()
    means, covariances = still_expected(lag)
    spreads = np.sqrt([[P[1, 1], P[0, 0] + P[1, 1] + 2 * P[0, 1]] for P in covariances])
    close = {"rel": 1e-9, "abs": 1e-9}  # as above
    assert result["s"].value == pytest.approx(means[:, 1], **close)
    assert result["s"].sigma == pytest.approx(spreads[:, 0], rel=1e-9)
    assert result["twice"].value == pytest.approx(2 * means[:, 1], **close)
    assert result["twice"].sigma == pytest.approx(2 * spreads[:, 0], rel=1e-9)
    assert result["own"].value == pytest.approx(means[0, 1], **close)
    if lag == 3:
        return
    # plain unknowns: what a filter knew of them at the step at hand
    assert result["sum"].value == pytest.approx(means[:, 0] + means[:, 1], **close)
    assert result["sum"].sigma == pytest.approx(spreads[:, 1], rel=1e-9)


def test_covariances_are_those_of_one_step_and_say_so():
    result = mbm.loads(STILL.format(method="ekf")).solve()
    _, covariances = still_expected(0)
    document = result.document()["solves"][0]
    whole = document["covariance"]
    matrix, at = np.array(whole["matrix"], dtype=float), whole["names"].index
    for k, P in enumerate(covariances):
        pair = [at(f"s@{k}"), at(f"x@{k}")]
        np.testing.assert_allclose(matrix[np.ix_(pair, pair)], P[1:, 1:], rtol=1e-9)
        assert np.isnan(matrix[pair[0], at(f"x@{(k + 1) % 4}")])
    last = [at("b"), at("s@3"), at("x@3")]
    np.testing.assert_allclose(matrix[np.ix_(last, last)], covariances[3], rtol=1e-9)
    derived = document["derived_covariance"]
    at = derived["names"].index
    matrix = np.array(derived["matrix"], dtype=float)
    P = covariances[1]
    assert matrix[at("twice@1"), at("sum@1")] == pytest.approx(2 * (P[1, 1] + P[0, 1]), rel=1e-9)
    reason = "this method keeps no covariance between different steps (`:method batch` does)"
    assert document["derived"]["grown"]["sigma"] is None
    assert [document["derived"]["grown"]["reason"], whole["reason"], derived["reason"]] == [reason] * 3


def test_what_mentions_no_state_is_at_the_last_step():
    result = mbm.loads(TEXT.format(method="ekf", limit="", **WRITTEN["plain"])).solve()
    (last,), (covariance,) = (each[-1:] for each in expected(0))
    offset = result["b"]
    assert (offset.value, offset.sigma) == pytest.approx((last[0], np.sqrt(covariance[0, 0])), rel=1e-9)
    # three rows of it are 0, one is 0.6
    assert result["others"].value == pytest.approx(np.sqrt((3 * last[0] ** 2 + (OFFSET - last[0]) ** 2) / 4), rel=1e-9)
    slope = (4 * last[0] - OFFSET) / 4 / result["others"].value
    assert result["others"].sigma == pytest.approx(abs(slope) * offset.sigma, rel=1e-9)


@pytest.mark.parametrize("method", ["ekf", "(smoother)"])
def test_aggregates_that_vary_with_one_step_or_none_have_deviations(method):
    """The greatest state is one step's, a count varies with none; a mean is of all, and tables say so."""
    result = mbm.loads(f"""(problem p
      (data d (table (run t z) ("a" 0 1) ("a" 1 2.2) ("a" 2 2.9) ("b" 0 5) ("b" 2 7) ("b" 3 8.5)))
      (states :over t (x :init 1 :sigma 3))
      (dynamics (random-walk x :sigma 0.5))
      (observe d (= z x) :sigma 0.3)
      (for-each run)
      (derive (m (mean d x)) (most (max d x)) (least (min d x)) (n (count d (> z x)))
        (near (- (max d x) (last d x))) (last (last d x)) (first (first d x)))
      (solve :method {method}))""").solve()
    reason = "this method keeps no covariance between different steps (`:method batch` does)"
    for solve in result.document()["solves"]:
        told = solve["derived"]
        assert told["most"]["sigma"] == pytest.approx(told["last"]["sigma"], rel=1e-12)
        assert told["least"]["sigma"] == pytest.approx(told["first"]["sigma"], rel=1e-12)
        assert told["n"]["sigma"] == 0
        assert told["near"]["sigma"] == pytest.approx(0, abs=1e-12)
        assert [told["m"]["sigma"], told["m"]["reason"]] == [None, reason]
    assert f"no standard deviation of `m`: {reason}" in " ".join(str(result).split())
