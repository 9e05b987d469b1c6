"""Inequalities that cut what a smoother of all steps knows: each once, against closed forms and sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

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


def sampled(limit, low=-np.inf, count=2_000_000):
    """Means and deviations of the five states given all rows and that none is beyond limits, by rejection."""
    moves = (np.eye(5)[1:] - np.eye(5)[:-1]) / 0.8
    rows = np.vstack([np.eye(5)[:1] / 3, moves, np.eye(5) / 0.3])
    covariance = np.linalg.inv(rows.T @ rows)
    mean = covariance @ rows.T @ np.concatenate([np.zeros(5), Y / 0.3])
    points = np.random.default_rng(3).multivariate_normal(mean, covariance, count, method="cholesky")
    points = points[((points <= limit) & (points >= low)).all(axis=1)]
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


LIMITS_BY_ROW = {
    "the same": "(<= c (+ l (* 0 k)) :over d)",
    "the least of all": "(<= c (+ l (* 0.1 k)) :over d)",
    "other scales": "(<= (* (+ k 1) c) (* (+ k 1) l) :over d)",
    "with one of all steps": "(<= c (+ l (* 0.1 k)) :over d) (<= (* 2 c) (+ l l))",
}


@pytest.mark.parametrize("written", LIMITS_BY_ROW)
@pytest.mark.parametrize("static", [False, True])
def test_limits_of_all_rows_on_a_constant_are_one_cut_and_exact(written, static):
    """The least limit counts, once: the moments of a normal distribution cut by a half space are known."""
    rows = [(k, round(float(np.sin(k)), 6)) for k in range(STEPS)]
    stated = "(c :init 0.3 :sigma 1)"
    given = {"plain": "" if static else stated, "states": stated if static else "", "moves": "(static c)"}
    given["moves"] = given["moves"] if static else ""
    text = HIDDEN.replace("(k y)", "(k y l)")
    joined = " ".join(f"({k} {y} 0)" for k, y in rows)
    free = mbm.loads(text.format(method="smoother", limits="", rows=joined, **given)).solve()["c"]
    mean, sigma = (np.ravel(each)[-1] for each in (free.value, free.sigma))
    joined = " ".join(f"({k} {y} {float(mean - 0.7 * sigma)!r})" for k, y in rows)
    limits = LIMITS_BY_ROW[written]
    if "(+ l l)" in limits:
        limits = limits.replace("(+ l l)", repr(2 * float(mean - 0.7 * sigma)))
    found = mbm.loads(text.format(method=CUTTING, limits=limits, rows=joined, **given)).solve()
    assert found.first.status == "converged"
    hazard = norm.pdf(-0.7) / norm.cdf(-0.7)
    # rows of cuts are found to 1e-6 of a deviation
    np.testing.assert_allclose(np.ravel(found["c"].value)[-1], mean - hazard * sigma, rtol=0, atol=1e-5 * sigma)
    np.testing.assert_allclose(np.ravel(found["c"].sigma)[-1], sigma * np.sqrt(1 + 0.7 * hazard - hazard**2), rtol=1e-5)


def test_limits_far_away_change_nothing():
    found, free = solved(CUTTING, ":in (-90 90)", ""), solved("smoother")
    np.testing.assert_allclose(found["x"].value, free["x"].value, rtol=0, atol=1e-9)
    assert found.solves[0].cost == pytest.approx(free.solves[0].cost, rel=1e-9)


ONE = """
(problem one
  (data d (table (k y) (0 {y})))
  (states :over k (x :init {prior} :sigma {sigma} {option}))
  (dynamics (random-walk x :sigma 0.3))
  (observe d (= y x) :sigma {sigma})
  {constraints}
  (solve :method smoother :constraints truncate))"""
TWO_SIDED = {
    "constraint": ("", "(constraints (<= 0 x 0.2))"),
    "bounds": (":in (0 0.2)", ""),
    "uniform": ("", "(constraints (uniform x 0 0.2))"),
    "a bound and a constraint": (":in (0 9)", "(constraints (<= (* 3 x) 0.6))"),
    "other scales": ("", "(constraints (<= (* 3 x) 0.6) (>= (/ x 7) 0))"),
    "curved alike": ("", "(constraints (<= (^ (+ x 2) 2) 4.84) (>= (+ x 2) 2))"),
    "more than once": (":in (0 0.2)", "(constraints (<= x 0.2) (<= (* 2 x) 0.4) (>= x -0.1) (>= x 0))"),
}


@pytest.mark.parametrize("written", TWO_SIDED)
@pytest.mark.parametrize(("sigma", "mean"), [(10.0, 0.05), (0.1, 0.15), (0.05, 0.4)])
def test_all_limits_of_one_quantity_are_one_cut_and_exact(written, sigma, mean):
    option, constraints = TWO_SIDED[written]
    text = ONE.format(y=mean, prior=mean, sigma=sigma, option=option, constraints=constraints)
    found = mbm.loads(text).solve()
    deviation = sigma / np.sqrt(2)
    expected = truncnorm(-mean / deviation, (0.2 - mean) / deviation, loc=mean, scale=deviation)
    # rows of cuts are found to 1e-6 of a deviation; a square linearised in the middle has its limit off by 0.1²/4.2
    accuracy = 0.04 if written == "curved alike" else 1e-5
    assert found.status == "ok" or sigma == 0.05
    assert found.solves[0].status == "converged"
    np.testing.assert_allclose(found["x"].value, expected.mean(), rtol=0, atol=accuracy * expected.std())
    np.testing.assert_allclose(found["x"].sigma, expected.std(), rtol=accuracy)


def test_several_states_between_two_limits_are_close():
    found = solved(CUTTING, ":in (0.4 2)", "")
    mean, deviation = sampled(2.0, 0.4, count=4_000_000)
    np.testing.assert_allclose(found["x"].value, mean, rtol=0, atol=0.03 * deviation.min())
    np.testing.assert_allclose(found["x"].sigma, deviation, rtol=0.03)


PLANE = """
(problem plane
  (data d (table (t u v) (0 0.3 0.2) (1 0.1 0.1) (2 -0.2 0.1) (3 -0.5 0.4)))
  (states :over t (x :init 0 :sigma 1) (y :init 0 :sigma 1))
  (dynamics (random-walk x :sigma 0.3) (random-walk y :sigma 0.3))
  (observe d (= u x) :sigma 0.4)
  (observe d (= v y) :sigma 0.4)
  (constraints {})
  (solve :method smoother :constraints truncate))"""
CONTRARY = {
    "one quantity": ("(>= x 0)", "(<= x -1)"),
    "nearly": ("(>= x 0)", "(<= x -0.01)"),
    "several quantities": ("(>= x 0)", "(>= y 0)", "(<= (+ x y) -1)"),
}


@pytest.mark.parametrize("case", CONTRARY)
def test_limits_that_contradict_one_another_are_infeasible_and_named(case):
    found = mbm.loads(PLANE.format(" ".join(CONTRARY[case]))).solve()
    assert found.first.status == "infeasible"
    for limit in CONTRARY[case]:
        assert f"`{limit}`" in found.first.message
    assert np.isfinite(found["x"].value).all()
    # about 0 the rows cost 3.8, a deviation at -1 at most some ten each
    assert 0.0 < found.first.cost < 100.0


def test_limits_that_leave_one_place_hold_it():
    found = mbm.loads(PLANE.format("(>= x 0) (<= x 0)")).solve()
    assert found.first.status == "converged"
    np.testing.assert_allclose(found["x"].value, 0.0, atol=1e-12)
    assert (found["x"].sigma < 1e-6).all()
    without = mbm.loads(PLANE.format("(<= x 90)").replace("(= u x) :sigma 0.4", "(= u (* 0 x)) :sigma 0.4")).solve()
    np.testing.assert_allclose(found["y"].value, without["y"].value, atol=1e-6)
