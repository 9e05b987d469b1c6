"""Bounds and inequalities: smoothers of all steps meet them, those of fixed lag refuse them, filters tell."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import mbm

TEXT = """
(problem limits
  (data d (table (k y) (0 0.2) (1 0.9) (2 2.4) (3 2.3) (4 1.1)))
  (states :over k (x :init 0 :sigma 3 {option}))
  (dynamics (random-walk x :sigma 0.8))
  (observe d (= y x) :sigma 0.3)
  {constraint}
  (solve :method {method}))"""
Y = np.array([0.2, 0.9, 2.4, 2.3, 1.1])
WRITTEN = {"bound": (":in (-5 2)", ""), "inequality": ("", "(constraints (<= x 2))")}


def solved(method, option="", constraint=""):
    return mbm.loads(TEXT.format(method=method, option=option, constraint=constraint)).solve()


def bounded(limit):
    """The least squares of all rows with x ≤ limit, by SciPy."""
    moves = (np.eye(5)[1:] - np.eye(5)[:-1]) / 0.8
    rows = np.vstack([np.eye(5)[:1] / 3, moves, np.eye(5) / 0.3])
    return lsq_linear(rows, np.concatenate([np.zeros(5), Y / 0.3]), bounds=(-np.inf, limit), tol=1e-14).x


@pytest.mark.parametrize("written", WRITTEN)
def test_the_smoother_meets_what_limits_states(written):
    found = solved("smoother", *WRITTEN[written])
    # a penalty is multiplied until limits are met to 1e-8 of what they compare
    np.testing.assert_allclose(found["x"].value, bounded(2.0), rtol=0, atol=1e-6)
    assert found.solves[0].status == "converged"
    assert found.solves[0].method.startswith("smoother, limits by ")


@pytest.mark.parametrize("written", WRITTEN)
def test_limits_that_hold_anyway_change_nothing(written):
    option, constraint = (each.replace("2)", "3)") for each in WRITTEN[written])
    found, free = solved("smoother", option, constraint), solved("smoother")
    np.testing.assert_array_equal(found["x"].value, free["x"].value)
    assert found.solves[0].method == "smoother"


@pytest.mark.parametrize("written", WRITTEN)
def test_a_fixed_lag_takes_none_and_says_so(written):
    with pytest.raises(mbm.MbmError, match=r"not-for-filters(.|\n)*meet it at steps that are over"):
        solved("(smoother :lag 2)", *WRITTEN[written])


@pytest.mark.parametrize("written", WRITTEN)
def test_a_filter_says_the_same_of_a_bound_and_of_a_constraint_that_do_not_hold(written):
    found = solved("ekf", *WRITTEN[written])
    assert found.status == "attention"
    assert found.first.status == "infeasible"


def test_a_filter_tells_what_is_outside_its_bounds():
    found = solved("ekf", ":in (-5 2)")
    above = int((found["x"].value > 2).sum())
    assert above > 0
    (warning,) = (d for d in found.diagnostics if d.code.name == "beyond-bounds")
    assert f"at {above} step" in warning.message
    assert found.first.message == warning.message
    cut = solved("ekf :constraints truncate", ":in (-5 2)")
    assert (cut["x"].value <= 2).all()
    assert not [d for d in cut.diagnostics if d.code.name == "beyond-bounds"]
