"""Priors in their three spellings, against Bayes' rule for normal distributions in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import mbm
from tests.noise.peer import check, linear, matrix_text, sigmas, solved, table, values

RANDOM = np.random.default_rng(9)
X = np.linspace(0.0, 3.0, 7)
Y = 1.0 + 2.0 * X + RANDOM.normal(0, 0.3, X.size)
DATA = table("t", x=X, y=Y)
LINE = np.column_stack([np.ones_like(X), X])
MEAN = np.array([0.7, 2.3])
COVARIANCE = np.array([[0.04, -0.018], [-0.018, 0.09]])


def posterior(mean, covariance):
    """N(mean, covariance) times the likelihood of the line with sigma 0.3 (e.g. Bishop 2006, 2.113-2.117)."""
    information = np.linalg.inv(covariance)
    total = np.linalg.inv(information + LINE.T @ LINE / 0.09)
    return total @ (information @ mean + LINE.T @ Y / 0.09), total


SCALARS = "(a :init 0.7 :sigma 0.2) (b :init 2.3 :sigma 0.3)"


@pytest.mark.parametrize(
    ("unknowns", "constraints", "names", "covariance"),
    [
        ("(a :init 0.7 :sigma 0.2) (b :init 2.3 :sigma 0.3)", "", "ab", np.diag([0.04, 0.09])),
        ("(a :init 0) (b :init 0)", "(constraints (normal a 0.7 0.2) (normal b 2.3 0.3))", "ab", np.diag([0.04, 0.09])),
        ("(p (vector 2) :init [0.7 2.3] :sigma [0.2 0.3])", "", "p", np.diag([0.04, 0.09])),
        ("(p (vector 2) :init [0.7 2.3] :sigma 0.25)", "", "p", np.diag([0.0625, 0.0625])),
        (f"(p (vector 2) :init [0.7 2.3] :covariance {matrix_text(COVARIANCE)})", "", "p", COVARIANCE),
        ("(p (array 2) :init [0.7 2.3] :sigma [0.2 0.3])", "", "p", np.diag([0.04, 0.09])),
        ("(p (vector 2) :init 0)", "(constraints (for (i 1 2) (normal (p i) (- (* 1.6 i) 0.9) (+ 0.1 (/ i 10)))))", "p",
         np.diag([0.04, 0.09])),
    ],
)  # fmt: skip
def test_posterior_is_that_of_bayes(unknowns, constraints, names, covariance):
    a, b = ("a", "b") if names == "ab" else ("(p 1)", "(p 2)")
    result = solved(f"""(problem q {DATA} (unknowns {unknowns})
      (observe t (= y (+ {a} (* {b} x))) :sigma 0.3) {constraints})""")
    mean, total = posterior(MEAN, covariance)
    np.testing.assert_allclose(values(result, *names), mean, rtol=1e-10)
    np.testing.assert_allclose(result.covariance.matrix, total, rtol=1e-10)
    # Priors are observations: they count in cost and degrees of freedom.
    away = mean - MEAN
    line = (LINE @ mean - Y) / 0.3
    cost = line @ line + away @ np.linalg.solve(covariance, away)
    assert (result.first.dof, result.first.cost) == (7, pytest.approx(cost, rel=1e-10))
    assert result.first.chi2_p == pytest.approx(chi2.sf(cost, 7), rel=1e-8)


def test_prior_alone_gives_itself_back():
    result = solved("""(problem q (unknowns (a :init 2m :sigma 3mm) (b angle :init 10deg :sigma 1deg))
      (derive (c (* a a))))""")
    np.testing.assert_allclose(values(result, "a", "b"), [2, np.deg2rad(10)], rtol=1e-14)
    np.testing.assert_allclose(sigmas(result, "a", "b"), [0.003, np.deg2rad(1)], rtol=1e-14)
    assert (float(result["c"].value), float(result["c"].sigma)) == pytest.approx((4, 0.012), rel=1e-13)
    assert (result.status, result.first.dof) == ("ok", 0)


def test_normal_of_a_combination():
    result = solved(f"""(problem q {DATA} (unknowns (a :init 0) (b :init 0))
      (observe t (= y (+ a (* b x))) :sigma 0.3)
      (constraints (normal (- b (* 2 a)) 0.1 0.02)))""")
    matrix, right = np.vstack([LINE, [-2.0, 1.0]]), np.append(Y, 0.1)
    check(result, linear(matrix, right, np.append(np.full(7, 0.3), 0.02)), "a", "b")


def test_normal_over_a_table():
    result = solved(f"""(problem q {DATA} {table("g", v=[1.0, 1.4, 0.9], e=[0.1, 0.2, 0.05])}
      (unknowns (a :init 0) (b :init 0))
      (observe t (= y (+ a (* b x))) :sigma 0.3)
      (constraints (normal a v e :over g :name given)))""")
    matrix = np.vstack([LINE, [[1.0, 0.0]] * 3])
    fit = linear(matrix, [*Y, 1.0, 1.4, 0.9], [*np.full(7, 0.3), 0.1, 0.2, 0.05])
    check(result, fit, "a", "b")
    assert all("given" in p.name for p in result.first.priors)
    np.testing.assert_allclose([p.mean for p in result.first.priors], [1.0, 1.4, 0.9])


def test_prior_for_each_member_of_a_family():
    result = solved("""(problem q (data s (table (k m e) (1 0.5 0.1) (2 1.5 0.2) (3 2.5 0.3)) :key k)
      (data t (table (s y) (1 0.7) (2 1.2) (1 0.8)))
      (unknowns (q :per s :init m :sigma e))
      (observe t (= y (q s)) :sigma 0.2))""")
    # Each member alone: weights add.
    first = (0.5 / 0.01 + 1.5 / 0.04) / (1 / 0.01 + 2 / 0.04)
    second = (1.5 / 0.04 + 1.2 / 0.04) / (2 / 0.04)
    np.testing.assert_allclose(result["q"].value, [first, second, 2.5], rtol=1e-12)
    np.testing.assert_allclose(result["q"].sigma, [1 / np.sqrt(150), 1 / np.sqrt(50), 0.3], rtol=1e-12)


def test_start_from_outside_does_not_move_the_prior():
    text = f"(problem q {DATA} (unknowns {SCALARS}) (observe t (= y (+ a (* b x))) :sigma 0.3))"
    mean, _ = posterior(MEAN, np.diag([0.04, 0.09]))
    for init in (None, {"a": -50.0, "b": 9.0}):
        np.testing.assert_allclose(values(solved(text, init=init), "a", "b"), mean, rtol=1e-10)


@pytest.mark.parametrize(
    ("option", "code"),
    [(":init [0 0] :sigma [0.1 0]", "bad-noise"), (":init [0 0] :covariance [[1 2] [2 1]]", "bad-noise"),
     (":sigma 0.1", "prior-without-init"), (":init [0 0] :sigma 1 :covariance [[1 0] [0 1]]", "two-noises")],
)  # fmt: skip
def test_prior_that_is_none(option, code):
    with pytest.raises(mbm.MbmError) as caught:
        solved(
            f"(problem q {DATA} (unknowns (p (vector 2) {option})) (observe t (= y (+ (p 1) (* (p 2) x))) :sigma 1))"
        )
    assert [d.code.name for d in caught.value.diagnostics] == [code]
