"""Equations among the constraints that say the same of what does not move at each step: they tell something once."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, truncnorm

import mbm

TEXT = """(problem p (data d external) (data before external)
  (states :over t (a :init (first before a0) :sigma {sigma}) (b :init (first before b0) :sigma {sigma}))
  (dynamics (static a) (static b))
  (observe d (= y (+ a (* b x))) :sigma 0.1)
  (constraints (= {equation}))
  (solve :method {method}))"""
LINEAR, ROUND = ("(+ a b) 1.5", 0.5), ("(+ (^ a 2) (^ b 2)) 1.25", 0.03)
METHODS = ("ekf", "iterated-ekf", "ekf :hypotheses 3")


def drawn(seed, sigma):
    """Five readings of a line with a = 1 and b = 0.5, and what is known of these before."""
    g = np.random.default_rng(seed)
    a, b = np.array([1.0, 0.5]) + sigma * g.normal(size=2)
    x = g.uniform(-1, 1, 5)
    return {
        "d": {"t": np.arange(5), "x": x, "y": 1 + 0.5 * x + 0.1 * g.normal(size=5)},
        "before": {"a0": [a], "b0": [b]},
    }


def solved(equation, sigma, method, data):
    return mbm.loads(TEXT.format(equation=equation, sigma=sigma, method=method)).solve(data=data)


def least_squares(data, sigma):
    """Estimates, deviations and cost with a + b = 1.5, of one unknown: b = 1.5 - a."""
    x, y, known = data["d"]["x"], data["d"]["y"], data["before"]
    slopes = np.concatenate([[1 / sigma, -1 / sigma], (1 - x) / 0.1])
    values = np.concatenate([[known["a0"][0] / sigma, (known["b0"][0] - 1.5) / sigma], (y - 1.5 * x) / 0.1])
    a = slopes @ values / (slopes @ slopes)
    return a, 1 / np.sqrt(slopes @ slopes), np.square(values - slopes * a).sum()


@pytest.mark.parametrize("method", METHODS)
def test_a_filter_says_what_least_squares_says(method):
    data = drawn(3, 0.5)
    found = solved(*LINEAR, method, data)
    a, sigma, cost = least_squares(data, 0.5)
    assert [found["a"].value[-1], found["b"].value[-1]] == pytest.approx([a, 1.5 - a], rel=1e-9)
    assert [found["a"].sigma[-1], found["b"].sigma[-1]] == pytest.approx([sigma, sigma], rel=1e-9)
    assert found.cost == pytest.approx(cost, rel=1e-9)
    assert found.first.dof == 6  # five rows, one equation, and nothing without a prior


@pytest.mark.parametrize("method", METHODS)
def test_an_equation_that_bends_leaves_the_other_direction_open(method):
    """Linearised anew at each step it took all directions away one after the other, down to deviations of zero."""
    data = drawn(3, ROUND[1])
    found, batch = solved(*ROUND, method, data), solved(*ROUND, "batch", data)
    assert found.first.dof == batch.first.dof == 6
    sigma = np.ravel(batch["a"].sigma)[-1]
    # the tangent where the prior is, 0.03 away, is turned by 0.03 / 0.5 of what a takes of it
    assert found["a"].sigma[-1] == pytest.approx(sigma, rel=0.1)
    assert found["a"].value[-1] == pytest.approx(np.ravel(batch["a"].value)[-1], abs=0.2 * sigma)


def test_a_stream_says_the_same():
    data = drawn(3, ROUND[1])
    problem = mbm.loads(TEXT.format(equation=ROUND[0], sigma=ROUND[1], method="ekf"))
    whole = problem.solve(data=data)["a"]
    stream = problem.compile(data=data).stream()
    for t, x, y in zip(*data["d"].values(), strict=True):
        last = stream.step({"d": {"t": t, "x": x, "y": y}})
    assert last["a"].value == pytest.approx(whole.value[-1], rel=1e-12)
    assert last["a"].sigma == pytest.approx(whole.sigma[-1], rel=1e-12)


MEMBERS = """(problem p
  (data places (table (k) (1) (2) (3)) :key k)
  (data d (table (t k y) (0 1 0.3) (1 2 0.4) (2 1 0.2) (3 2 0.5) (4 3 0.1)) :with (places k))
  (states :over t (p :init 0 :sigma 1)) (unknowns (m :per places :init 0.3 :sigma 1))
  (dynamics (random-walk p :sigma 1))
  (observe d (= y (+ p (m k))) :sigma 0.1)
  (constraints (= (m k) 0.2 :over d))
  (solve :method ekf))"""


def test_an_equation_holds_of_each_member_that_its_rows_pick():
    found = mbm.loads(MEMBERS).solve()
    assert np.ravel(found["m"].value) == pytest.approx([0.2, 0.2, 0.2], abs=1e-12)
    assert np.ravel(found["m"].sigma) == pytest.approx([0, 0, 0], abs=1e-12)
    assert found.first.dof == 8  # five rows, the prior of p, and of each member a prior and an equation, for 6 + 3


@pytest.mark.parametrize("other", [1.0, 1e7])
@pytest.mark.parametrize(("method", "limit"), [("ekf", "="), ("ekf :constraints truncate", ">")])
def test_what_is_known_does_not_depend_on_the_size_of_other_states(method, limit, other):
    """A limit at one deviation of a prior: the normal distribution above it has the mean 1.525 (SciPy's truncnorm)."""
    found = mbm.loads(f"""(problem p (data d (table (t z) (0 0.3) (1 0.4) (2 0.2)))
      (states :over t (a :init 0 :sigma 1e-6) (p :init 0 :sigma {other}))
      (dynamics (static a) (random-walk p :sigma {other}))
      (observe d (= z p) :sigma {other})
      (constraints ({limit} a 1e-6))
      (solve :method {method}))""").solve()
    assert found.first.status.value == "converged"
    mean, spread = (1.0, 0.0) if limit == "=" else (truncnorm.mean(1, np.inf), truncnorm.std(1, np.inf))
    assert found["a"].value[0] == pytest.approx(1e-6 * mean, rel=1e-9)
    assert found["a"].sigma[0] == pytest.approx(1e-6 * spread, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("case", [LINEAR, ROUND])
def test_chi_square_of_a_thousand_runs(case):
    """Probabilities are uniform (Kolmogorov and Smirnov, at 0.1 %)."""
    compiled = mbm.loads(TEXT.format(equation=case[0], sigma=case[1], method="ekf")).compile()
    tails = [compiled.solve(data=drawn(seed, case[1])).first.chi2_p for seed in range(1000)]
    assert kstest(tails, "uniform").pvalue > 1e-3


LATER = """(problem p (data d external) (data c external)
  (states :over t (a :init (first before a0) :sigma {sigma}) (b :init (first before b0) :sigma {sigma}))
  (data before external)
  (dynamics (static a) (static b))
  (observe d (= y (+ a (* b x))) :sigma 0.1)
  (constraints {equation})
  (solve :method {method}))"""


def later(form, equation, sigma, method="ekf"):
    clause = equation.format(form=form)
    return mbm.loads(LATER.format(equation=clause, sigma=sigma, method=method))


@pytest.mark.parametrize(("form", "sigma"), [LINEAR, ROUND])
@pytest.mark.parametrize("rows", [[3.0], [4.0, 3.0, 3.0]])
def test_an_equation_over_rows_holds_from_the_first_of_them_on(form, sigma, rows):
    """Before, a state is given the readings alone; after all, it is that of the equation known from the first on."""
    data = drawn(3, sigma)
    found = later(form, "(= {form} :over c)", sigma).solve(data={**data, "c": {"t": rows}})
    without = later(form, "(<= a 1e9)", sigma).solve(data={**data, "c": {"t": rows}})
    for name in "ab":
        for of in ("value", "sigma"):
            told, alone = (np.ravel(getattr(each[name], of)) for each in (found, without))
            assert told[:3] == pytest.approx(alone[:3], rel=1e-9)
    assert found.first.dof == 6
    if form is LINEAR[0]:
        a, deviation, cost = least_squares(data, sigma)
        assert [found["a"].value[-1], found["a"].sigma[-1]] == pytest.approx([a, deviation], rel=1e-9)
        assert found.cost == pytest.approx(cost, rel=1e-9)
    else:
        batch = later(form, "(= {form} :over c)", sigma, "batch").solve(data={**data, "c": {"t": rows}})
        assert found["a"].sigma[-1] == pytest.approx(np.ravel(batch["a"].sigma)[-1], rel=0.1)  # as above


@pytest.mark.parametrize("compiled", [[], [3.0], [0.0, 1.0, 4.0]])
@pytest.mark.parametrize("given", [[], [3.0], [4.0, 3.0, 3.0]])
def test_a_stream_takes_an_equation_with_the_first_row_that_comes(compiled, given):
    """Whatever rows there were when the stream was made."""
    data = drawn(3, 0.5)
    problem = later(LINEAR[0], "(= {form} :over c)", 0.5)
    stream = problem.compile(data={**data, "c": {"t": np.array(compiled)}}).stream()
    whole = problem.solve(data={**data, "c": {"t": np.array(given)}})
    for k, (t, x, y) in enumerate(zip(*data["d"].values(), strict=True)):
        rows = {"c": {"t": np.full(given.count(t), t)}} if t in given else {}
        now = stream.step({"d": {"t": t, "x": x, "y": y}, **rows})
        for name in "ab":
            assert now[name].value == pytest.approx(np.ravel(whole[name].value)[k], rel=1e-12)
            assert now[name].sigma == pytest.approx(np.ravel(whole[name].sigma)[k], rel=1e-12)


@pytest.mark.parametrize("method", ["ekf", "iterated-ekf", "smoother", "batch"])
def test_a_certain_static_state_is_certain_at_every_step(method):
    text = f"""(problem p (data d (table (t y) (0 0.3) (1 0.4) (2 0.2) (3 0.5)))
      (states :over t (a :init 0.2 :sigma 0) (b :init 1 :sigma 1) (q :init 0 :sigma 1))
      (dynamics (static a) (static b) (random-walk q :sigma 1)) (observe d (= y (+ a q (* b t))) :sigma 0.1)
      (derive (twice (* 2 a))) (solve :method {method}))"""
    solve = mbm.loads(text).solve().first
    for name in ("a", "twice"):
        assert not np.asarray(solve[name].sigma).any()
    assert bool((np.asarray(solve["b"].sigma) > 0.4).all())  # four readings of 1 and a slope over 3 s


@pytest.mark.parametrize(
    "equation", ["(= (+ a b) 1.5)", "(= (+ a b) 1.5 :over d)", "(= (+ a b) (* 1.5 (/ x x)) :over d)"]
)
def test_an_equation_of_states_without_a_prior_determines_one(equation):
    """With b alone left free, y - 1.5 = b (x - 1): least squares of the rows so far, in closed form."""
    x = np.array([-0.8, 0.3, 0.7, -0.2, 0.5])
    y = 1 + 0.5 * x + np.array([0.05, -0.12, 0.08, 0.11, -0.03])
    result = mbm.loads(
        "(problem p (data d external) (states :over t (a) (b)) (dynamics (static a) (static b))"
        f" (observe d (= y (+ a (* b x))) :sigma 0.1) (constraints {equation}) (solve :method ekf))"
    ).solve(data={"d": {"t": np.arange(5.0), "x": x, "y": y}})
    squares = np.cumsum((x - 1) ** 2)
    slope = np.cumsum((x - 1) * (y - 1.5)) / squares
    assert result.status == "ok"
    assert np.ravel(result["b"].value) == pytest.approx(slope, abs=1e-9)
    assert np.ravel(result["a"].value) == pytest.approx(1.5 - slope, abs=1e-9)
    assert np.ravel(result["b"].sigma) == pytest.approx(0.1 / np.sqrt(squares), rel=1e-9)
    assert result.solves[0].dof == 4
