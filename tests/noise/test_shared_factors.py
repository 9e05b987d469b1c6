"""One unknown factor of several clauses, and factors that belong to one dimension."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from tests.noise.peer import check, helmert, linear, sigmas, solved, table, values

RANDOM = np.random.default_rng(15)
X = np.linspace(0.0, 4.0, 9)
Y = 1.0 + 0.5 * X + RANDOM.normal(0, 0.4, 9)
T = np.linspace(1.0, 3.0, 5)
Z = 1.0 - 0.7 * T + RANDOM.normal(0, 0.2, 5)
DATA = f"{table('t', x=X, y=Y)} {table('o', x=T, z=Z)}"
MATRIX = np.vstack([np.column_stack([np.ones(9), X]), np.column_stack([np.ones(5), -1.4 * T])])
RIGHT = np.append(Y, Z)
SIGMA = np.repeat([2.0, 1.0], [9, 5])
FIXED_POINT = 1e-7
"""Relative: the rounds end when factors move by less than 1e-9, and converge linearly."""


def problem(first, second, rest=""):
    return f"""(problem p {DATA} (unknowns (a :init 0) (b :init 0))
      (observe one t (= y (+ a (* b x))) {first})
      (observe two o (= z (- a (* 1.4 b x))) {second}) {rest})"""


SHARED = (":sigma (unknown 2 :as s)", ":sigma (unknown 1 :as s)")


def test_one_factor_of_two_clauses_is_that_of_all_rows():
    result = solved(problem(*SHARED))
    fit = linear(MATRIX, RIGHT, SIGMA)
    factor = np.sqrt(fit.cost / 12)
    check(result, fit, "a", "b", scale=factor)
    assert dict(result.first.noise) == {"s": pytest.approx(factor, rel=1e-12)}
    assert (result.first.dof, result.first.cost) == (12, pytest.approx(fit.cost, rel=1e-12))
    assert result["a"].dof == pytest.approx(12)  # Student's t of all rows, as for one clause


def test_shared_factor_beside_stated_noise_is_that_of_helmerts_equations():
    result = solved(problem(*SHARED, "(constraints (normal b 0.6 0.05))"))
    matrix, right, sigma = np.vstack([MATRIX, [0, 1]]), np.append(RIGHT, 0.6), np.append(SIGMA, 0.05)
    (factor,) = helmert(matrix, right, sigma, (np.arange(14),))
    assert result.first.noise["s"] == pytest.approx(factor, rel=FIXED_POINT)
    fit = linear(matrix, right, sigma * np.append(np.full(14, factor), 1.0))
    check(result, fit, "a", "b", rtol=FIXED_POINT)


def test_two_clauses_share_a_factor_beside_a_third():
    third = "(observe three t (= (* x 0.2) (* b 0.1)) :sigma (unknown x :as other) :when (> x 1))"
    result = solved(problem(*SHARED, third))
    used = X > 1
    matrix = np.vstack([MATRIX, np.column_stack([np.zeros(9), np.full(9, 0.1)])[used]])
    right, sigma = np.append(RIGHT, 0.2 * X[used]), np.append(SIGMA, X[used])
    factors = helmert(matrix, right, sigma, (np.arange(14), np.arange(14, len(right))))
    np.testing.assert_allclose([result.first.noise[n] for n in ("s", "other")], factors, rtol=1e-6)


def test_keys_have_factors_of_their_own():
    key = np.repeat([1, 2], [5, 4])
    data = f"{table('t', k=key, x=X, y=Y)} {table('o', k=np.array([1, 1, 1, 2, 2]), x=T, z=Z)}"
    text = problem(*SHARED, "(for-each k)").replace(DATA, data)
    result = solved(text)
    columns = result.table()
    for k, solve in zip((1, 2), result.solves, strict=True):
        mine = np.append(key == k, np.array([1, 1, 1, 2, 2]) == k)
        fit = linear(MATRIX[mine], RIGHT[mine], SIGMA[mine])
        assert solve.noise["s"] == pytest.approx(np.sqrt(fit.cost / (mine.sum() - 2)), rel=1e-10)
        np.testing.assert_allclose([columns[name][k - 1] for name in "ab"], fit.x, rtol=1e-10)


def test_compiled_problems_share_it_too():
    text = problem(*SHARED)
    one, two = mbm.loads(text).solve(), mbm.loads(text).compile().solve()
    np.testing.assert_allclose(values(two, "a", "b"), values(one, "a", "b"), rtol=1e-12)
    np.testing.assert_allclose(sigmas(two, "a", "b"), sigmas(one, "a", "b"), rtol=1e-12)
    assert two.first.noise == one.first.noise


VECTOR = """(problem p (data r (table (u i) (5.007 0.019663) (4.994 0.019639) (5.005 0.019640)) {units})
  (unknowns (v {v}) (c {c})) (observe o r (= [u i] [v c]) {sigma}))"""


@pytest.mark.parametrize("sigma", ["", ":sigma unknown", ":sigma (unknown 2)", ":sigma (unknown [1 1])"])
def test_one_factor_of_volts_and_amperes_is_refused(sigma):
    units = ":columns ((u :unit V) (i :unit A))"
    with pytest.raises(mbm.MbmError) as error:
        mbm.loads(VECTOR.format(units=units, v=":unit V", c=":unit A", sigma=sigma)).solve()
    (diagnostic,) = error.value.diagnostics
    assert diagnostic.code.name == "factor-of-several-dimensions"
    assert "`:sigma (unknown [1V 1A])`" in str(diagnostic.hint)


@pytest.mark.parametrize(
    ("units", "sigma"),
    [
        (":columns ((u :unit V) (i :unit A))", ":sigma (unknown [1mV 1uA])"),
        (":columns ((u :unit V) (i :unit V))", ""),  # one dimension
        ("", ""),  # nothing is known of the units
        ("", ":sigma (unknown [1mV 1uA])"),
    ],
)
def test_factors_of_one_dimension_are_not(units, sigma):
    mbm.loads(VECTOR.format(units=units, v="", c="", sigma=sigma)).solve()
