"""Problems of sequences that are not the usual ones: nothing moves, nothing varies, no rows at first, aggregates."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import truncnorm

import mbm

METHODS = ("ekf", "iterated-ekf", "truncated-ekf", "smoother", "(smoother :lag 2)")
SEEN = np.array([1.0, 2.3, 2.9, 4.4])
TEXT = """
(problem p
  (data z (table (k y) (0 1) (1 2.3) (2 2.9) (3 4.4)))
  (unknowns {unknowns})
  (states :over k {states})
  (dynamics {dynamics})
  {rest}
  (solve :method {method}))
"""


def solved(method, **given):
    usual = {
        "unknowns": "(v :init 1 :sigma 0.5)",
        "states": "(x :init 1 :sigma 1)",
        "dynamics": "(= (next x) (+ x v) :sigma 0.1)",
        "rest": "(observe z (= y x) :sigma 0.2)",
    }
    return mbm.loads(TEXT.format(method=method, **{**usual, **given})).solve()


def cut_above(mean, sigma, limit):
    """Mean and deviation of a normal distribution without what is above a limit."""
    found = truncnorm(-np.inf, (limit - mean) / sigma, loc=mean, scale=sigma)
    return found.mean(), found.std()


@pytest.mark.parametrize("method", METHODS)
def test_states_that_never_move_are_recursive_least_squares(method):
    found = solved(method, dynamics="(static x)", unknowns="(v :init 1 :sigma 0.5)")
    precision = 1 + len(SEEN) / 0.04
    assert found["x"].value[-1] == pytest.approx((1 + SEEN.sum() / 0.04) / precision, rel=1e-12)
    assert found["x"].sigma[-1] == pytest.approx(precision**-0.5, rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_nothing_that_varies_is_an_error(method):
    with pytest.raises(mbm.MbmError, match="every unknown is fixed"):
        solved(method, states="(x :init 1 :fixed true)", unknowns="(v :init 1 :fixed true)", dynamics="(static x)")


def test_a_lag_of_more_steps_than_there_are_is_all_of_them():
    long, whole = solved("(smoother :lag 1000000000)"), solved("smoother")
    np.testing.assert_allclose(long["x"].value, whole["x"].value, rtol=0, atol=1e-12)


@pytest.mark.parametrize("limits", ["(constraints (<= c 0))", "(constraints (<= c limit :over limits))"])
def test_a_prior_is_no_row_so_that_cuts_wait_for_the_first_step_with_rows(limits):
    """LANGUAGE §11: what mentions no state is cut once, after the first step with rows; step -1 has none."""
    rest = f"(observe z (= y (+ c x)) :sigma 0.2 :when (= k 0)) {limits}"
    rest += "(data early (table (k) (-1))) (data limits (table (limit) (0)))"
    given = {"unknowns": "(c :init 0 :sigma 1)", "dynamics": "(random-walk x :sigma 0.5)", "rest": rest}
    found = solved("truncated-ekf", **given)
    total = 1 + 1.25 + 0.04  # c, x after a step, noise
    mean, sigma = cut_above((1 - 1) / total, np.sqrt(1 - 1 / total), 0)
    assert found["c"].value == pytest.approx(mean, rel=1e-10)
    assert found["c"].sigma == pytest.approx(sigma, rel=1e-10)


def test_a_positive_state_is_cut_at_zero():
    rest = "(observe z (= (- y 1.5) x) :sigma 0.2 :when (= k 0))"
    found = solved("truncated-ekf", states="(x positive :init 1 :sigma 1)", rest=rest)
    gain = 1 / 1.04
    mean, sigma = cut_above(-(1 + gain * (-0.5 - 1)), np.sqrt(1 - gain), 0)
    assert found["x"].value[0] == pytest.approx(-mean, rel=1e-10)
    assert found["x"].sigma[0] == pytest.approx(sigma, rel=1e-10)


def test_states_inside_an_aggregate_are_those_of_its_rows_in_constraints_too():
    limit = "(observe z (= y x) :sigma 0.2) (constraints (<= (mean z x) 2))"
    found = solved("batch", rest=limit)

    def cost(at):
        x, v = at[:4], at[4]
        parts = ((x - SEEN) / 0.2, (v - 1) / 0.5, x[0] - 1, (np.diff(x) - v) / 0.1)
        return sum(float(np.sum(np.square(part))) for part in parts)

    within = {"type": "ineq", "fun": lambda at: 2 - at[:4].mean()}
    expected = minimize(cost, [1, 2, 3, 4, 1.0], constraints=[within], method="SLSQP", options={"ftol": 1e-14})
    # SLSQP differentiates numerically
    np.testing.assert_allclose(found["x"].value, expected.x[:4], rtol=0, atol=1e-5)
    with pytest.raises(mbm.MbmError, match="states of several steps"):
        solved("truncated-ekf", rest=limit)


@pytest.mark.parametrize("method", ["ekf", "iterated-ekf", "(smoother :lag 1)"])
def test_estimates_of_filters_need_not_meet_exact_transitions(method):
    """Each step has the mean of the rows so far, and of a lag more: no step has the number of the next one."""
    rows = np.array([0.0, 0.3, 0.5, 0.9, 1.1])
    text = f"""(problem still (data seen external) (states :over t (a :init 0 :sigma 1))
      (dynamics (random-walk a :sigma 0)) (observe seen (= x a) :sigma 0.1) (solve :method {method}))"""
    result = mbm.loads(text).solve(data={"seen": {"t": np.arange(5.0), "x": rows}})
    weights = 1.0 + 100.0 * np.arange(1, 6)
    means = 100.0 * np.cumsum(rows) / weights
    if "lag" in method:
        means, weights = (np.append(each[1:], each[-1]) for each in (means, weights))
    assert result.solves[0].status.value == "converged"
    np.testing.assert_allclose(result["a"].value, means, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result["a"].sigma, weights**-0.5, rtol=1e-9)
