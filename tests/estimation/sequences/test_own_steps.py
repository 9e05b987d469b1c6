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
  (constraints (>= (+ x {offset}) 2.5))
  (derive (gap (- x {offset})) (most (max d (- (+ x {offset}) y))) (others (rms d (- z {offset}))))
  (solve :method {method}))"""

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
    result = mbm.loads(TEXT.format(method=method, **WRITTEN[written])).solve()
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
    constraint = report.constraints[0]
    assert constraint.violation == pytest.approx(2.5 - means.sum(axis=1).min(), **close)
    assert list(constraint.violated_rows) == [1 + k for k in np.flatnonzero(means.sum(axis=1) < 2.5)]


def test_what_mentions_no_state_is_at_the_last_step():
    result = mbm.loads(TEXT.format(method="ekf", **WRITTEN["plain"])).solve()
    (last,), (covariance,) = (each[-1:] for each in expected(0))
    offset = result["b"]
    assert (offset.value, offset.sigma) == pytest.approx((last[0], np.sqrt(covariance[0, 0])), rel=1e-9)
    # three rows of it are 0, one is 0.6
    assert result["others"].value == pytest.approx(np.sqrt((3 * last[0] ** 2 + (OFFSET - last[0]) ** 2) / 4), rel=1e-9)
    slope = (4 * last[0] - OFFSET) / 4 / result["others"].value
    assert result["others"].sigma == pytest.approx(abs(slope) * offset.sigma, rel=1e-9)
