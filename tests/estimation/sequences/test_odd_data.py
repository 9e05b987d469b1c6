"""Data as they come: out of order, twice, one step, none, gaps, numbers beyond all bounds; keys; other backends."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.estimation.sequences.kalman import filtered, jointly

TEXT = """
(problem w (data z external) (states :over k (x :init 0 :sigma 10)) (dynamics {dynamics})
  (observe z (= y x) :sigma 0.5 {when}) {rest} (solve :method {method}))
"""
METHODS = ("ekf", "iterated-ekf", "truncated-ekf", "smoother", "(smoother :lag 2)")


def solved(rows, method, dynamics="(random-walk x :sigma 1)", when="", rest="", **given):
    text = TEXT.format(dynamics=dynamics, when=when, rest=rest, method=method)
    return mbm.loads(text).solve(data={"z": rows}, **given)


def expected(rows, method):
    """By Kalman's filter, or dense least squares."""
    k, y = np.asarray(rows["k"], float), np.asarray(rows["y"], float)
    steps = np.unique(k)
    moves = [(np.eye(1), np.array([[dt]])) for dt in np.diff(steps)]
    each = [(np.ones(((k == s).sum(), 1)), y[k == s], 0.25 * np.eye((k == s).sum())) for s in steps]
    how = jointly if "smoother" in method else filtered
    return how(np.zeros(1), np.array([[100.0]]), moves, each)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "rows",
    [
        {"k": [1], "y": [2.0]},
        {"k": [3, 1, 2, 2], "y": [2.0, 1.0, 5.0, 5.5]},
        {"k": [1.0, 4.5, 1.5], "y": [1.0, 2.0, 3.0]},
    ],
    ids=["one", "mixed", "uneven"],
)
def test_the_order_of_rows_does_not_matter_and_all_count(method, rows):
    found = solved(rows, method)
    means, covariances, cost = expected(rows, method)
    np.testing.assert_allclose(found["x"].value, means[:, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["x"].sigma, np.sqrt(covariances[:, 0, 0]), rtol=1e-12)
    assert found.solves[0].cost == pytest.approx(cost, rel=1e-10)
    assert found.solves[0].dof == len(rows["y"])


@pytest.mark.parametrize("method", METHODS)
def test_a_gap_is_left_out_where_the_problem_allows_it(method):
    gap = {"k": [1, 2, 2, 3], "y": [1.0, np.nan, 5.0, 2.0]}
    found = solved(gap, method, when=":when (finite y)")
    without = solved({"k": [1, 2, 3], "y": [1.0, 5.0, 2.0]}, method)
    np.testing.assert_allclose(found["x"].value, without["x"].value, rtol=0, atol=1e-13)
    with pytest.raises(mbm.MbmError, match="not-finite-cell"):
        solved(gap, method)


@pytest.mark.parametrize("method", METHODS)
def test_no_rows_are_an_error_and_no_numbers_are_no_answer(method):
    with pytest.raises(mbm.MbmError, match="no-equations"):
        solved({"k": [], "y": []}, method)
    far = solved({"k": [1, 2], "y": [1e300, -1e300]}, method).solves[0]
    assert far.status == "not-converged"


@pytest.mark.parametrize("method", METHODS)
def test_every_key_is_a_sequence_of_its_own(method):
    found = solved({"g": [1, 1, 2, 2], "k": [1, 2, 1, 3], "y": [1.0, 2.0, 3.0, 4.0]}, method, rest="(for-each g)")
    for solve, rows in zip(found.solves, [{"k": [1, 2], "y": [1.0, 2.0]}, {"k": [1, 3], "y": [3.0, 4.0]}], strict=True):
        means, _, _ = expected(rows, method)
        np.testing.assert_allclose(solve.estimates[0].value, means[:, 0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("backend", ["numpy", "casadi", "native"])
@pytest.mark.parametrize("method", METHODS)
def test_every_backend_gives_the_same(method, backend):
    rows = {"k": [1, 2, 4], "y": [1.0, 2.0, 3.0]}
    curved = "(= (next x) (+ x (sin x)) :sigma 1)"
    found = solved(rows, method, dynamics=curved, backend=backend)
    plain = solved(rows, method, dynamics=curved)
    np.testing.assert_allclose(found["x"].value, plain["x"].value, rtol=0, atol=1e-12)


ROBUST = [
    *((method, ":loss (tukey)", "") for method in ("iterated-ekf", "smoother", "(smoother :lag 2)", "batch")),
    ("batch", "", ":robust (gnc)"),
    ("batch", "", ":robust (gnc :quantile 99%)"),
]


@pytest.mark.parametrize(("method", "loss", "rule"), ROBUST)
def test_a_step_with_outliers_only_counts_as_one_without_rows(method, loss, rule):
    rows = {"k": [0, 1, 2, 2, 3, 4], "y": [0.1, 0.9, 900.0, -700.0, 2.2, 2.9]}
    good = {"k": [0, 1, 3, 4], "y": [0.1, 0.9, 2.2, 2.9]}
    text = TEXT.replace("(data z external)", "(data z external) (data f (table (k) (0) (1) (2) (3) (4)))")
    filled = {"dynamics": "(random-walk x :sigma 1)", "rest": "", "method": f"{method} {rule}"}
    found = mbm.loads(text.format(when=loss, **filled)).solve(data={"z": rows})
    filled["method"] = method
    without = mbm.loads(text.format(when="", **filled)).solve(data={"z": good})
    # what Tukey's weights take off residuals of good rows, up to a deviation
    np.testing.assert_allclose(found["x"].value, without["x"].value, rtol=0, atol=0.25 if loss else 1e-9)
    row = [each for each in found.result.solves[0].rows() if each.clause == "z"]
    assert [each.weight == 0.0 for each in row] == [False, False, True, True, False, False]


@pytest.mark.parametrize("method", ["iterated-ekf", "(smoother :lag 2)", "smoother"])
def test_a_filter_that_a_loss_has_lost_doubts_itself(method):
    """Rows that cost less where they are left out than where the prediction changes are left out for good."""
    rows = {"k": [0, 1, 2, 3, 4, 5], "y": [0.1, 0.9, 900.0, 9.2, 9.9, 10.1]}
    found = solved(rows, method, when=":loss (tukey)")
    assert "too-few-agree" in [d.code.name for d in found.diagnostics]


@pytest.mark.parametrize("loss", ["tukey", "geman-mcclure"])
@pytest.mark.parametrize("method", ["iterated-ekf", "(smoother :lag 2)", "smoother"])
def test_a_row_that_a_loss_leaves_out_where_it_was_predicted_is_not_lost(method, loss):
    """A walk that is wider than a loss: rows far from the prediction explain themselves by it, one at 80 does not."""
    random = np.random.default_rng(4)
    y = np.cumsum(3.0 * random.normal(size=30)) + 0.5 * random.normal(size=30)
    y[12] += 80.0
    good = np.arange(30) != 12
    walk = "(random-walk x :sigma 3)"
    found = solved({"k": np.arange(30), "y": y}, method, dynamics=walk, when=f":loss ({loss})")
    filled = {"dynamics": walk, "when": "", "rest": "", "method": method}
    text = TEXT.replace("(data z external)", "(data z external) (data f (table (k) (0) (12)))").format(**filled)
    without = mbm.loads(text).solve(data={"z": {"k": np.arange(30)[good], "y": y[good]}})
    # half a deviation: what the weights of good rows take off their residuals
    np.testing.assert_allclose(found["x"].value, without["x"].value, rtol=0, atol=0.25)
    assert found.diagnostics == ()


def test_rules_that_fit_subsets_are_refused():
    for rule in ("lmeds", "(ransac :threshold 3)", "(msac)"):
        with pytest.raises(mbm.MbmError, match="no-subset"):
            solved({"k": [0, 1, 2], "y": [0.1, 900.0, 2.2]}, f"batch :robust {rule}")
