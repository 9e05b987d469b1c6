"""Standard deviations against simulation: data drawn by NumPy, thousands of runs solved together by `for-each`.

The actual over the stated standard deviation of a number is known from R runs to 1/√(2R), as the root of the variance
of a normal sample is: 1.6 % for 2,000 runs, and for 1,000 where it is pooled over two numbers or three (those take the
longest); 1.1 % for 2,000 pooled over two. The corridor of 3 % is nearly
three deviations of chance; the draws are the same in every run of this test. What is said of losses holds for
many rows: of 24, two of them outliers, the deviations under Tukey's loss are 4 % too large, so theirs are 72. A linear
problem needs no chance: its covariance is compared with fractions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import sympy

import mbm

RUNS = 2000
CORRIDOR = 0.03

X = np.linspace(-1.0, 2.0, 25)
TIME = np.linspace(0.0, 4.0, 24)
STATIONS = 8 * np.array([[np.cos(t), np.sin(t)] for t in np.linspace(0.3, 5.9, 24)])
TURN = np.linspace(0.2, 6.1, 30)
SENSOR = np.arange(18) % 3


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """A problem of the table ``d``, the true values by columns of the result, and a table with new noise."""

    text: str
    truth: dict[str, float]
    draw: Callable[[np.random.Generator], dict[str, np.ndarray]]
    runs: int = RUNS


def normal(generator, sigma, like):
    return sigma * generator.normal(size=len(like))


def about_a_line(generator):
    return {"x": X, "y": 2 - X + normal(generator, 0.1, X)}


def few_about_a_line(generator):
    return {"x": X[::3], "y": 2 - X[::3] + normal(generator, 0.1, X[::3])}


def decaying(generator):
    return {"x": TIME, "y": 3 * np.exp(-0.6 * TIME) + normal(generator, 0.05, TIME)}


def ranged(generator, wrong=0, times=1):
    stations = np.tile(STATIONS, (times, 1))
    r = np.hypot(*(stations - [2.0, 1.0]).T) + normal(generator, 0.05, stations)
    r[generator.choice(len(r), wrong, replace=False)] += 2.0 * generator.choice([-1, 1], wrong)
    return {"x": stations[:, 0], "y": stations[:, 1], "r": r}


def turned(generator):
    u = np.cos(0.4) * STATIONS[:, 0] - np.sin(0.4) * STATIONS[:, 1] + 1 + normal(generator, 0.1, STATIONS)
    v = np.sin(0.4) * STATIONS[:, 0] + np.cos(0.4) * STATIONS[:, 1] - 2 + normal(generator, 0.1, STATIONS)
    return {"x": STATIONS[:, 0], "y": STATIONS[:, 1], "u": u, "v": v}


def both_uncertain(generator):
    return {"x": X + normal(generator, 0.05, X), "y": 2 - X + normal(generator, 0.1, X)}


def round_a_rim(generator):
    x, y = 3 * np.cos(TURN) + normal(generator, 0.05, TURN), 2 * np.sin(TURN) + normal(generator, 0.05, TURN)
    return {"x": x, "y": y}


def sensed(generator):
    x = np.linspace(-1, 1, 18)
    return {"sensor": SENSOR, "x": x, "y": np.array([0.3, -0.2, 0.1])[SENSOR] + 1.5 * x + normal(generator, 0.1, x)}


def bent(generator):
    return {"x": X, "y": 2 - X**2 / 2 + normal(generator, 0.1, X)}


LINE = "(unknowns (a :init 2) (b :init -1)) (observe d (= y (+ a (* b x)))"
PLACE = "(unknowns (p (vector 2) :init [2 1])) (observe d (= r (distance p [x y])) :sigma 0.05"
KINDS = {
    "nonlinear": Simulated(
        text="(unknowns (a :init 3) (k :init 0.6)) (observe d (= y (* a (exp (* -1 k x)))) :sigma 0.05)",
        truth={"a": 3.0, "k": 0.6}, draw=decaying,
    ),
    "ranges": Simulated(text=f"{PLACE})", truth={"p[1]": 2.0, "p[2]": 1.0}, draw=ranged),
    "plane pose": Simulated(
        text="(unknowns (T (pose 2) :init (pose2 1 -2 0.4))) (observe d (= [u v] (transform T [x y])) :sigma 0.1)",
        truth={"T.rot[1]": 0.4, "T.trans[1]": 1.0, "T.trans[2]": -2.0}, draw=turned, runs=1000,
    ),
    "unknown noise": Simulated(text=f"{LINE})", truth={"a": 2.0, "b": -1.0}, draw=few_about_a_line),
    "a prior that is right": Simulated(
        text=f"{LINE} :sigma 0.1) (constraints (normal b -1 1e-3))", truth={"a": 2.0}, draw=about_a_line,
    ),
    "an equation": Simulated(
        text="(unknowns (a :init 2) (b :init -0.5)) (observe d (= y (+ a (* b x x))) :sigma 0.1)"
        " (constraints (= (* a b) -1))", truth={"a": 2.0, "b": -0.5}, draw=bent,
    ),
    "an inequality that nothing touches": Simulated(
        text=f"{LINE} :sigma 0.1) (constraints (<= (* a a) 9))", truth={"a": 2.0, "b": -1.0}, draw=about_a_line,
    ),
    "bounds that nothing touches": Simulated(
        text="(unknowns (a :init 2 :in (0 5)) (b :init -1 :in (-3 3))) (observe d (= y (+ a (* b x))) :sigma 0.1)",
        truth={"a": 2.0, "b": -1.0}, draw=about_a_line,
    ),
    "huber": Simulated(
        text=f"{PLACE} :loss huber)", truth={"p[1]": 2.0, "p[2]": 1.0}, draw=lambda g: ranged(g, times=3)
    ),
    "tukey, outliers": Simulated(
        text=f"{PLACE} :loss tukey)", truth={"p[1]": 2.0, "p[2]": 1.0}, draw=lambda g: ranged(g, 6, 3)
    ),
    "consensus, outliers": Simulated(
        text=f"{PLACE}) (solve :robust lmeds)", truth={"p[1]": 2.0, "p[2]": 1.0}, draw=lambda g: ranged(g, 3)
    ),
    "errors in both": Simulated(
        text=f"{LINE} :errors ((x 0.05) (y 0.1)))", truth={"a": 2.0, "b": -1.0}, draw=both_uncertain, runs=1000,
    ),
    "a rim": Simulated(
        text="(unknowns (a :init 3) (b :init 2))"
        " (observe d (- (+ (^ (/ x a) 2) (^ (/ y b) 2)) 1) :errors ((x 0.05) (y 0.05)))",
        truth={"a": 3.0, "b": 2.0}, draw=round_a_rim,
    ),
    "a family": Simulated(
        text="(unknowns (b :init 1.5) (o :per d.sensor :init 0)) (observe d (= y (+ (o sensor) (* b x))) :sigma 0.1)",
        truth={"b": 1.5, "o[0]": 0.3, "o[1]": -0.2, "o[2]": 0.1}, draw=sensed,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_estimates_scatter_as_they_say(name):
    kind = KINDS[name]
    generator = np.random.default_rng(sum(name.encode()))
    tables = [kind.draw(generator) for _ in range(kind.runs)]
    rows = len(next(iter(tables[0].values())))
    data = {column: np.concatenate([table[column] for table in tables]) for column in tables[0]}
    data["run"] = np.repeat(np.arange(kind.runs), rows)
    solved = mbm.loads(f"(problem p (data d external) {kind.text} (for-each run))").solve(data={"d": data}).table()
    assert list(solved["status"]) == ["converged"] * kind.runs
    ratios = []
    for number, truth in kind.truth.items():
        errors, stated = np.asarray(solved[number]) - truth, np.asarray(solved[f"{number}.sigma"])
        # The mean of the variances: with noise that is estimated, that is what has no bias.
        ratios.append(float(np.sqrt((errors**2).mean() / (stated**2).mean())))
    pooled = float(np.sqrt(np.mean(np.square(ratios))))
    assert abs(pooled - 1) < CORRIDOR, ratios
    # One number alone: four deviations of chance, which for six numbers happen once in 2,600.
    assert np.abs(np.array(ratios) - 1).max() < 4 / np.sqrt(2 * kind.runs) + 0.01, ratios


@pytest.mark.parametrize("backend", ["native", "casadi", "numpy"])
def test_the_covariance_of_a_linear_problem_is_exact(backend):
    """Small integers and standard deviations of 1/2 and 1/4: the inverse of the normal equations in fractions."""
    generator = np.random.default_rng(3)
    for _ in range(5):
        matrix, weights = generator.integers(-4, 5, (7, 3)), generator.choice([2, 4], 7)
        columns = dict(zip("abc", matrix.T.astype(float), strict=True))
        data = {"d": {**columns, "y": np.zeros(7), "s": 1 / weights}}
        text = (
            "(problem p (data d external) (unknowns (q (vector 3) :init 0)) (observe d (= y (dot q [a b c])) :sigma s))"
        )
        whole = sympy.Matrix((weights[:, None] * matrix).tolist())
        normal_equations = whole.T * whole
        if normal_equations.det() == 0:
            continue
        exact = np.array(normal_equations.inv().tolist(), dtype=float)
        found = mbm.loads(text).solve(data=data, backend=backend).covariance.matrix
        # Rounding times a condition below a hundred.
        np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-13 * np.abs(exact).max())
