"""Uncertainty budgets against brute force: every input moved and the problem solved again."""

from __future__ import annotations

import pickle
from math import inf, sqrt

import numpy as np
import pytest

import mbm
from mbm.estimation.uncertainty.statistics import RowInfluence
from mbm.report.answer import Solved
from mbm.report.budgets.answer import answer_of
from mbm.report.budgets.types import Budget, InputKind

SUMS = 1e-10
"""What the sum of squares may lack of the variance: what is asked for; roundings of a few dozen products are 1e-14."""

DIFFERENCES = 1e-6
"""Of central differences over 1e-3 standard deviations and more: their error grows with the square of the step."""


def sums_up(budget: Budget) -> None:
    """The squares of the contributions are the variance, and the shares 1."""
    assert sum(row.contribution**2 for row in budget.rows) == pytest.approx(budget.sigma**2, rel=SUMS)
    assert sum(row.share for row in budget.rows) == pytest.approx(1.0 if budget.sigma > 0.0 else 0.0, rel=SUMS)


def moved(text: str, name: str, data: dict[str, list[float]], column: str, row: int, step: float) -> float:
    """The derivative of a quantity by one cell of the table ``d``."""
    ends = []
    for side in (-1.0, 1.0):
        cells = {key: list(values) for key, values in data.items()}
        cells[column][row] += side * step
        result = mbm.loads(text).solve(data={"d": cells})
        ends.append(float(result[name].value))
    return (ends[1] - ends[0]) / (2 * step)


CURVE = """(problem curve (data d external) (unknowns (a :init 2) (b :init 0.3))
  (observe d (= y (* a (exp (- (* b x))))) :sigma s) (derive (half (/ (log 2) b))) (solve :tolerance 1e-14)%s)"""


def curve() -> dict[str, list[float]]:
    """Values without any error: there the derivatives of the estimates hold no residual."""
    x = [0.0, 0.5, 1.0, 2.0, 3.5]
    return {"x": x, "y": [2.0 * np.exp(-0.3 * each) for each in x], "s": [0.01, 0.02, 0.01, 0.03, 0.01]}


@pytest.mark.parametrize("name", ["a", "b", "half"])
@pytest.mark.parametrize("clause", ["", "(constraints (= (+ a b) 2.3))", "(constraints (normal a 2 0.01))"])
def test_rows_of_a_curve_are_those_of_brute_force(name: str, clause: str) -> None:
    text, data = CURVE % clause, curve()
    budget = mbm.loads(text).solve(data={"d": data}).budget(name, by_row=True)
    sums_up(budget)
    rows = [row for row in budget.rows if row.kind is InputKind.ROWS]
    assert [row.row for row in rows] == [1, 2, 3, 4, 5]
    for row in rows:
        found = moved(text, name, data, "y", (row.row or 0) - 1, 1e-4)
        assert row.sensitivity == pytest.approx(found, rel=DIFFERENCES, abs=1e-7)
        assert row.u == pytest.approx(data["s"][(row.row or 0) - 1])
        assert row.value == pytest.approx(data["y"][(row.row or 0) - 1])
        assert row.contribution == pytest.approx(abs(found) * (row.u or 0.0), rel=DIFFERENCES, abs=1e-9)


def test_priors_and_constants_are_those_of_brute_force() -> None:
    text = """(problem line (data d (table (x y) (0 1.02) (1 1.96) (2 3.05)))
      (constants (c 10mm :sigma 1mm)) (unknowns (a :init 1 :sigma 0.2) (b))
      (observe d (= y (+ a (* b x) c)) :sigma 0.1) (constraints (normal b %s 0.05)) (derive (f (+ a (* c b)))))"""
    result = mbm.loads(text % "1.0").solve()
    for name in ("a", "b", "f"):
        sums_up(result.budget(name))
    by_prior = [float(mbm.loads(text % mean).solve()["f"].value) for mean in ("0.99", "1.01")]
    by_constant = [float(mbm.loads(text % "1.0").solve(constants={"c": c})["f"].value) for c in (0.009, 0.011)]
    rows = {row.input: row for row in result.budget("f").rows}
    assert set(rows) == {"d", "prior a", "normal b", "c"}
    assert rows["normal b"].sensitivity == pytest.approx((by_prior[1] - by_prior[0]) / 0.02, rel=DIFFERENCES)
    assert rows["c"].sensitivity == pytest.approx((by_constant[1] - by_constant[0]) / 2.0, rel=DIFFERENCES)
    assert (rows["c"].value, rows["c"].u, rows["c"].unit) == (pytest.approx(10.0), pytest.approx(1.0), "mm")
    assert rows["prior a"].kind is rows["normal b"].kind is InputKind.PRIOR
    assert rows["c"].kind is InputKind.CONSTANT


def test_an_inequality_that_holds_takes_part() -> None:
    """y = x + e with the slope at its limit: the intercept alone is the mean, and each row has c = 1/n."""
    text = """(problem held (data d (table (x y) (0 1) (1 2.5) (2 4))) (unknowns (a) (b))
      (observe d (= y (+ a (* b x))) :sigma 0.3) (constraints (<= b 1)) (derive (s (+ a b))))"""
    budget = mbm.loads(text).solve().budget("s", by_row=True)
    sums_up(budget)
    assert [row.sensitivity for row in budget.rows] == pytest.approx([1 / 3] * 3, rel=1e-9)
    assert budget.sigma == pytest.approx(0.3 / sqrt(3))


def test_measured_columns_with_errors_are_those_of_brute_force() -> None:
    text = """(problem york (data d external) (unknowns (a :init 1) (b :init 0.5))
      (observe d (= y (+ a (* b x))) :sigma 0.1 :errors ((x 0.2)))
      (derive (zero (- (/ a b)))) (solve :tolerance 1e-14))"""
    x = [0.0, 1.0, 2.5, 4.0]
    data = {"x": x, "y": [1.0 + 0.5 * each for each in x]}
    budget = mbm.loads(text).solve(data={"d": data}).budget("zero", by_row=True)
    sums_up(budget)
    for row in budget.rows:
        column = "x" if row.input == "d.x" else "y"
        found = moved(text, "zero", data, column, (row.row or 0) - 1, 1e-3)
        assert row.sensitivity == pytest.approx(found, rel=DIFFERENCES, abs=1e-6)
    together = mbm.loads(text).solve(data={"d": data}).budget("zero")
    assert [(row.input, row.count, row.u) for row in together.rows] == [("d", 4, 0.1), ("d.x", 4, 0.2)]


def test_an_implicit_equation_shares_values_among_equations() -> None:
    """A column of another table that many rows share is one input for each of its rows, of brute force."""
    text = """(problem shared (data r (table (id x) (1 0.0) (2 1.0)) :key id)
      (data d external :with (r k)) (unknowns (p :init 3))
      (observe d (= y (- p r.x)) :sigma 0.1 :errors ((r.x 0.05))))"""
    data = {"k": [1.0, 1.0, 2.0], "y": [3.0, 3.0, 2.0]}
    budget = mbm.loads(text).solve(data={"d": data}).budget("p", by_row=True)
    sums_up(budget)
    # the mean of groups with variances 0.1²/2 + 0.05² and 0.1² + 0.05²
    weight = np.array([1 / (0.1**2 / 2 + 0.05**2), 1 / (0.1**2 + 0.05**2)])
    weight /= weight.sum()
    found = {row.label: row.sensitivity for row in budget.rows}
    assert found["r.x row 1"] == pytest.approx(weight[0], rel=1e-9)
    assert found["r.x row 2"] == pytest.approx(weight[1], rel=1e-9)
    assert found["d row 1"] == pytest.approx(weight[0] / 2, rel=1e-9)


def test_components_with_a_covariance_are_one_input() -> None:
    text = """(problem pair (data d (table (u v) (1 2) (1.2 2.1))) (unknowns (p (vector 2)))
      (observe d (= [u v] p) :covariance [[0.04 0.01] [0.01 0.09]]) (derive (s (+ (p 1) (p 2)))))"""
    budget = mbm.loads(text).solve().budget("s", by_row=True)
    sums_up(budget)
    assert [(row.row, row.component, row.u, row.sensitivity) for row in budget.rows] == [
        (1, None, None, None),
        (2, None, None, None),
    ]
    assert budget.rows[0].contribution == pytest.approx(sqrt(0.15) / 2)


def test_components_of_a_row_are_inputs_of_their_own() -> None:
    text = """(problem pair (data d (table (u v) (1 2) (1.2 2.1))) (unknowns (p (vector 2)))
      (observe d (= [u v] p) :sigma [0.2 0.3]))"""
    result = mbm.loads(text).solve()
    budget = result.budget("p[2]", by_row=True)
    sums_up(budget)
    assert [row.label for row in budget.rows] == [f"d row {row} [{place}]" for row in (1, 2) for place in (1, 2)]
    assert [row.sensitivity for row in budget.rows] == pytest.approx([0, 0.5, 0, 0.5])
    with pytest.raises(mbm.MbmError, match="2 numbers"):
        result.budget("p")
    assert [each.quantity for each in result.budgets("p")] == ["p[1]", "p[2]"]


TABLE = "(table (x y) (0 0.1) (1 1.2) (2 1.9) (3 3.1) (4 9.0) (5 4.9) (6 6.1) (7 6.9) (8 8.2))"
LINE = "(unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma {sigma} {more}) (derive (f (+ a (* 10 b))))"
KINDS = {
    "unknown": (LINE.format(sigma="unknown", more=""), 7.0),
    "huber": (LINE.format(sigma="0.1", more=":loss huber"), 7.0),
    "tukey-unknown": (LINE.format(sigma="unknown", more=":loss tukey"), 7.0),
    "consensus": (LINE.format(sigma="0.1", more="") + "(solve :robust (ransac :threshold 3))", inf),
    "several": (
        LINE.format(sigma="unknown", more=":when (< x 4)") + "(observe e d (= y (+ a (* b x))) :when (> x 4))",
        None,
    ),
    "gauge": (
        """(unknowns (h (array 3))) (observe d (= (mod y 1) (- (h 1) (h 2))) :sigma 0.1)
           (observe e d (= (mod y 1) (- (h 2) (h 3))) :sigma 0.2) (derive (f (- (h 1) (h 3)))) (solve :gauge free)""",
        inf,
    ),
    "family": ("(unknowns (m :per d.x)) (observe d (= y (m x)) :sigma 0.1) (derive (f (+ (m 1) (m 2))))", inf),
    "over": ("(unknowns (b)) (observe d (= y (* b x)) :sigma 0.1) (derive (f (* b (^ x 2)) :over d))", inf),
    "rotation": (
        """(unknowns (R (rotation 2)) ) (observe d (= [(cos (/ x 9)) (sin (/ x 9))] (rotate R [1 0])) :sigma 0.1)
           (derive (f (heading R)))""",
        inf,
    ),
}  # fmt: skip


def solved(kind: str) -> Solved:
    """One of these kinds of problems."""
    return mbm.loads(f"(problem p (data d {TABLE} :key x) {KINDS[kind][0]})").solve()


@pytest.mark.parametrize("kind", KINDS)
def test_contributions_sum_to_the_variance(kind: str) -> None:
    result, dof = solved(kind), KINDS[kind][1]
    budgets = result.budgets()
    assert budgets
    for budget in budgets:
        sums_up(budget)
        found = [row.dof for row in budget.rows if row.kind is InputKind.ROWS]
        assert dof is None or set(found) == {dof}


def test_several_noises_have_their_own_degrees_of_freedom() -> None:
    """Two instruments that share no unknown: each has the redundancy of its own rows, and the budget of one is its own.

    The effective degrees of freedom of a sum are those of Welch and Satterthwaite.
    """
    text = """(problem two (data d (table (y) (1.0) (1.2) (0.9) (1.1))) (data e (table (z) (5.0) (5.5) (4.9)))
      (unknowns (a) (b)) (observe d (= y a)) (observe e (= z b)) (derive (s (+ a b))))"""
    budget = mbm.loads(text).solve().budget("s")
    sums_up(budget)
    rows = {row.input: row for row in budget.rows}
    assert rows["d"].dof == pytest.approx(3.0, rel=1e-9)
    assert rows["e"].dof == pytest.approx(2.0, rel=1e-9)
    assert rows["d"].contribution == pytest.approx(np.std([1.0, 1.2, 0.9, 1.1], ddof=1) / 2, rel=1e-9)
    welch = budget.sigma**4 / sum(row.contribution**4 / row.dof for row in budget.rows)
    assert budget.dof == pytest.approx(welch, rel=1e-9)
    assert budget.inflation == pytest.approx(1.0, abs=1e-9)


def test_one_of_many_solves_has_the_budget_of_its_own_rows() -> None:
    """Twenty solves are made together, as columns; the budget of each is that of the problem solved alone."""
    rows = " ".join(f"({k} {x} {k * x + 0.1 * ((k * x) % 3)})" for k in range(20) for x in range(4))
    text = f"""(problem p (data d (table (k x y) {rows})) (unknowns (b)) (observe d (= y (* b x)) :sigma %s)
      (for-each k))"""
    every = mbm.loads(text % "0.1").solve().budgets("b", by_row=True)
    assert [budget.key["k"] for budget in every] == list(range(20))
    for budget in every:
        sums_up(budget)
        used = [row for row in budget.rows if row.contribution > 0]
        assert [row.sensitivity for row in used] == pytest.approx([x / 14 for x in (1, 2, 3)])
        assert [row.value for row in used] == pytest.approx(
            [budget.key["k"] * x + 0.1 * ((budget.key["k"] * x) % 3) for x in (1, 2, 3)]  # type: ignore[operator]
        )


def test_large_sparse_problems_have_budgets() -> None:
    """A chain of 320 heights from a known one: the variance of the last is that of all steps before it."""
    rows = " ".join(f"({i} {i + 1} 1.0)" for i in range(320))
    text = f"""(problem chain (data d (table (i j dh) {rows})) (unknowns (h :per (d.i d.j)))
      (observe d (= dh (- (h j) (h i))) :sigma 0.1 %s) (observe (= 0 (h 0)) :sigma 0.01) (derive (last (h 320))))"""
    for loss in (":loss huber", ""):
        sums_up(mbm.loads(text % loss).solve().budget("last"))
    result = mbm.loads(text % "").solve()
    assert result.record.made_from is not None
    assert result.record.made_from()[1].minimum.blocks is not None
    budget = result.budget("last")
    sums_up(budget)
    assert budget.sigma == pytest.approx(sqrt(320 * 0.01 + 1e-4), rel=1e-9)
    assert {row.input: row.count for row in budget.rows}["d"] == 320


def test_a_batch_of_states_has_budgets_and_a_filter_has_none() -> None:
    text = """(problem track (data d (table (t y) (0 0.0) (1 1.1) (2 1.9) (3 3.2)))
      (states :over t (x :init 0 :sigma 1)) (dynamics (random-walk x :sigma 0.5))
      (observe d (= y x) :sigma 0.2) (solve :method %s))"""
    result = mbm.loads(text % "batch").solve()
    for budget in result.budgets("x"):
        sums_up(budget)
        assert {row.kind for row in budget.rows} >= {InputKind.ROWS, InputKind.TRANSITION}
    with pytest.raises(mbm.MbmError, match="filter"):
        mbm.loads(text % "ekf").solve().budgets()


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("(unknowns (a) (b :init 1 :fixed true)) (observe d (= y (* a b)) :sigma 1)", "b", "fixed"),
        ("(unknowns (a) (b)) (observe d (= y (+ a b)) :sigma 1)", "a", "do not determine"),
        ("(unknowns (a :in (10 20))) (observe d (= y a) :sigma 1)", "a", "bound"),
        ("(unknowns (a)) (observe d (= y a) :sigma 1)", "b", "neither estimated nor derived"),
        ("(unknowns (a :in (0 9))) (observe d (= y a) :bound 9) (solve :method (interval))", "a", "interval"),
    ],
)
def test_what_has_no_budget_says_why(text: str, name: str, said: str) -> None:
    result = mbm.loads(f"(problem p (data d {TABLE}) {text})").solve()
    with pytest.raises(mbm.MbmError, match=said) as caught:
        result.budget(name)
    assert caught.value.diagnostics[0].code.name == ("unknown-quantity" if "neither" in said else "no-budget")


def test_correlations_are_of_estimates_and_derived_quantities() -> None:
    """Against those of the propagated covariance, with a constant that moves both."""
    text = f"""(problem p (data d {TABLE}) (constants (c 1 :sigma 0.2)) (unknowns (a) (b))
      (observe d (= y (+ a (* b x) c)) :sigma 0.1) (derive (f (+ a c)) (g (* b 2))))"""
    found = mbm.loads(text).solve().correlation
    assert found is not None
    assert found.matrix is not None
    assert found.names == ("a", "b", "f", "g")
    x = np.arange(9.0)
    design = np.stack([np.ones(9), x], axis=1)
    own = 0.01 * np.linalg.inv(design.T @ design)
    slopes = np.array([[1, 0], [0, 1], [1, 0], [0, 2.0]])
    by_constant = np.array([-1.0, 0.0, 0.0, 0.0])  # a takes up what c is too large, so that a + c stays
    covariance = slopes @ own @ slopes.T + 0.04 * np.outer(by_constant, by_constant)
    deviations = np.sqrt(np.diag(covariance))
    # constants are moved by their deviations and solved again: exact to rounding where the model is linear
    assert found.matrix == pytest.approx(covariance / np.outer(deviations, deviations), abs=1e-7)
    assert found.of("b", "g") == pytest.approx(1.0)


def test_noises_have_degrees_of_freedom() -> None:
    text = """(problem two (data d (table (y) (1.0) (1.2) (0.9) (1.1))) (data e (table (z) (5.0) (5.5) (4.9)))
      (unknowns (a) (b)) (observe d (= y a)) (observe e (= z b) :sigma %s))"""
    assert mbm.loads(text % "unknown").solve().noise_dof == pytest.approx({"d": 3.0, "e": 2.0})
    assert mbm.loads(text % "0.1").solve().noise_dof == pytest.approx({"d": 3.0})
    shared = text.replace("(= y a)", "(= y a) :sigma (unknown 1 :as s)") % "(unknown 2 :as s)"
    assert mbm.loads(shared).solve().noise_dof == pytest.approx({"s": 5.0})


def test_solves_of_several_without_a_budget_are_named() -> None:
    text = """(problem p (data d (table (k y) ("a" 1.1) ("a" 2.1) ("b" 1.0))) (unknowns (m))
      (observe d (= y m) :sigma unknown) (for-each k))"""
    answer = answer_of(mbm.loads(text).solve().result)
    assert [len(each) for each in answer.solves] == [1, 0]
    assert [each.message.partition(":")[0] for each in answer.refused] == ['k = "b"']


def test_unknown_noise_that_nothing_tells_has_no_standard_uncertainty() -> None:
    text = """(problem p (data d (table (y) (1.1))) (unknowns (a) (b :init 1 :sigma 0.1))
      (observe d (= y (* a b)) :sigma unknown))"""
    rows = {row.input: row for row in mbm.loads(text).solve().budget("b").rows}
    assert rows["d"].u is None
    assert rows["prior b"].share == pytest.approx(1.0)


def test_a_covariance_that_is_no_sum_over_rows_has_no_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    result = solved("unknown")
    monkeypatch.setattr(RowInfluence, "of_residuals", lambda self, g: np.zeros((len(g), self.equations.whole)))
    with pytest.raises(mbm.MbmError, match="not the sum"):
        result.budget("a")


def test_pickled_results_say_why_they_have_no_budget() -> None:
    result = solved("unknown")
    again, budgets = pickle.loads(pickle.dumps((result, result.budgets())))  # noqa: S301 - our own
    with pytest.raises(mbm.MbmError, match="pickled") as caught:
        again.budget("a")
    assert "`result.budgets()`" in caught.value.diagnostics[0].hint
    assert budgets == result.budgets()
    assert again.correlation.names == ("a", "b")
    assert "derived quantities" in again.correlation.reason


def test_thousands_of_numbers_want_names() -> None:
    table = " ".join(f"({i} {i % 7})" for i in range(1100))
    text = f"(problem p (data d (table (k y) {table})) (unknowns (m :per d.k)) (observe d (= y (m k)) :sigma 1))"
    result = mbm.loads(text).solve()
    with pytest.raises(mbm.MbmError, match="too many"):
        result.budgets()
    assert result.budget("m[1000]").sigma == pytest.approx(1.0)
