"""Uncertainty budgets of every kind of random problem that the oracles ask, and of noise that rows share."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.oracles.catalogue import KINDS as CATALOGUE
from tests.oracles.kinds import drawn
from tests.report.test_budgets import sums_up

AT_A_LIMIT = "bounds"
"""The kind whose estimates may all be held by limits."""


@pytest.mark.parametrize("name", [name for name, kind in CATALOGUE.items() if not kind.calls])
def test_contributions_sum_to_the_variance_of_every_kind(name: str) -> None:
    """The random problems that the oracles ask: losses, consensus, constraints, errors in columns, turns, families."""
    kind = CATALOGUE[name]
    result = mbm.loads(kind.text()).solve(data=drawn(name, kind, 1)[0])
    if name == AT_A_LIMIT and all(np.isnan(result[each].sigma).all() for each in result.keys()):  # noqa: SIM118
        with pytest.raises(mbm.MbmError, match="at its bound"):
            result.budgets()
        return
    for budget in result.budgets():
        sums_up(budget)


LOTS = "(data d (table (lot y) (1 1.0) (1 1.2) (1 1.4) (2 3.9) (2 4.2))) (unknowns (a))"


def test_common_errors_have_lines_of_their_own() -> None:
    """Two lots with a common error each: the weights of generalised least squares, with the covariance written out."""
    text = f"(problem p {LOTS} (observe d (= y a) :sigma 0.1 :common ((0.5 :per lot))))"
    result = mbm.loads(text).solve()
    budget = result.budget("a", by_row=True)
    sums_up(budget)
    lots = np.array([[1, 1, 1, 0, 0], [0, 0, 0, 1, 1.0]])
    covariance = 0.01 * np.eye(5) + 0.25 * lots.T @ lots
    weights = np.linalg.solve(covariance, np.ones(5))
    weights /= weights.sum()
    found = {row.label: row for row in budget.rows}
    for row in range(5):
        assert found[f"d row {row + 1}"].sensitivity == pytest.approx(weights[row], rel=1e-9)
    for lot in range(2):
        line = found[f"d per lot [{lot + 1}]"]
        assert (line.u, line.sensitivity) == (pytest.approx(0.5), pytest.approx(weights @ lots[lot], rel=1e-9))
    together = {row.input: row for row in result.budget("a").rows}
    assert together["d per lot"].count == 2
    assert together["d"].contribution == pytest.approx(0.1 * np.sqrt(weights @ weights), rel=1e-9)


@pytest.mark.parametrize("by_row", [False, True])
def test_correlated_rows_count_together(by_row: bool) -> None:
    text = f"(problem p {LOTS} (observe d (= y a) :sigma 0.1 :correlation (ar1 0.5) :common ((0.2 :per lot))))"
    budget = mbm.loads(text).solve().budget("a", by_row=by_row)
    sums_up(budget)
    own = next(row for row in budget.rows if row.input == "d")
    assert (own.count, own.u, own.sensitivity) == (5, None, None)


def test_vectors_of_unknown_covariance_count_row_by_row() -> None:
    """The mean of replicated vectors: each has the same part, and n − 1 degrees of freedom."""
    rows = "(1.0 2.0) (1.2 2.1) (0.9 2.2) (1.1 1.8) (1.3 1.9)"
    text = f"""(problem p (data d (table (u v) {rows})) (unknowns (p (vector 2))) (derive (s (* (p 1) (p 2))))
      (observe d (= [u v] p) :covariance unknown))"""
    budget = mbm.loads(text).solve().budget("s", by_row=True)
    sums_up(budget)
    assert [row.share for row in budget.rows] == pytest.approx([0.2] * 5)
    assert {row.u for row in budget.rows} == {None}


LIKELY = {
    "counts": "(observe d (= n (exp (+ a (* b x)))) :distribution poisson)",
    "model": "(observe d (= n (exp (+ a (* b x)))) :sigma (* 5% model))",
    "factor": "(observe d (= n (exp (+ a (* b x)))) :sigma (unknown model))",
    "limits": "(observe d (= n (exp (+ a (* b x)))) :sigma 3 :above (> x 3))",
    "rounded": "(observe d (= n (exp (+ a (* b x)))) :sigma 3 :resolution 5)",
    "tails": "(observe d (= n (exp (+ a (* b x)))) :sigma 3 :distribution (student 4))",
}


@pytest.mark.parametrize("kind", LIKELY)
def test_rows_with_a_likelihood_have_their_share_of_the_information(kind: str) -> None:
    table = "(table (x n) (0 10) (1 14) (2 25) (3 30) (4 47))"
    text = f"(problem p (data d {table}) (unknowns (a :init 2) (b :init 0.3)) {LIKELY[kind]})"
    for budget in mbm.loads(text).solve().budgets(by_row=True):
        sums_up(budget)
        assert [row.row for row in budget.rows] == [1, 2, 3, 4, 5]
        assert {row.u for row in budget.rows} == {None}
        assert [row.value for row in budget.rows] == [10, 14, 25, 30, 47]


def test_counts_have_the_shares_of_their_fisher_information() -> None:
    """The mean of counts with exposures: μ is ΣN/Σt, and each row has the information t/μ."""
    text = "(problem p (data d (table (t n) (1 9) (2 23) (5 48))) (unknowns (m :init 8)) {})"
    text = text.format("(observe d (= n (* m t)) :distribution poisson)")
    budget = mbm.loads(text).solve().budget("m", by_row=True)
    assert budget.sigma == pytest.approx(np.sqrt(80 / 8) / np.sqrt(8), rel=1e-6)
    assert [row.share for row in budget.rows] == pytest.approx([1 / 8, 2 / 8, 5 / 8], rel=1e-6)
