"""Straight lines and other linear models, noise as stated or wrongly stated, priors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.coverage.judging import Kind, Tables, Truth
from benchmarks.coverage.making import LINE, autoregressive, line, normal, problem, scatter, table, with_outliers

X = np.linspace(-1.0, 2.0, 25)
LONG = np.linspace(-1.0, 2.0, 60)
HUNDRED = np.linspace(-1.0, 2.0, 100)


def _line(sigma: str, more: str = "", unknowns: str = "(a) (b)") -> str:
    return problem(unknowns, f"{LINE} :sigma {sigma}", more)


def _with_priors(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    a, b = 2 + 0.05 * rng.normal(size=runs), -1 + 0.1 * rng.normal(size=runs)
    y = a[:, None] + b[:, None] * X + 0.2 * rng.normal(size=(runs, 25))
    return {"d": table(runs, x=X, y=y)}, {"a": a, "b": b}


def _heteroscedastic(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    s = np.linspace(0.05, 0.5, 25)
    return {"d": table(runs, x=X, y=2 - X + s * rng.normal(size=(runs, 25)), s=s)}, {"a": 2.0, "b": -1.0}


def _correlated(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    root = np.linalg.cholesky(np.array([[0.04, 0.03], [0.03, 0.09]]))
    u, v = np.moveaxis(rng.normal(size=(runs, 25, 2)) @ root.T + np.stack([2 - X, 2 + X], axis=1), 2, 0)
    return {"d": table(runs, x=X, u=u, v=v)}, {"a": 2.0, "b": -1.0}


def _errors(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    x, y = (each + 0.1 * rng.normal(size=(runs, 25)) for each in (X, 2 - X))
    return {"d": table(runs, x=x, y=y)}, {"a": 2.0, "b": -1.0}


def _lines_by_group(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    g = np.repeat(np.arange(1.0, 6.0), 4)
    x = np.tile(np.arange(4.0), 5)
    return {
        "d": table(runs, g=g, x=x, y=g + 0.5 * x + 0.1 * rng.normal(size=(runs, 20))),
    }, {"a": np.broadcast_to(np.arange(1.0, 6.0), (runs, 5)), "b": 0.5}


def _levels(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    """A net of 130 heights, each levelled from the three before it."""
    h = np.sin(np.arange(130.0))
    i = np.concatenate([np.arange(step, 130) for step in (1, 2, 3)])
    j = np.concatenate([np.arange(0, 130 - step) for step in (1, 2, 3)])
    y = h[i] - h[j] + 0.01 * rng.normal(size=(runs, len(i)))
    return {"d": table(runs, i=i + 1.0, j=j + 1.0, y=y)}, {"h5": h[4], "h130": h[129]}


def _powers(count: int, x: np.ndarray, sigma: str, noise: float) -> Kind:
    names = "abcdefg"[:count]
    terms = " ".join(f"(* {name} (^ x {power}))" for power, name in enumerate(names))
    text = problem(" ".join(f"({name})" for name in names), f"(= y (+ {terms})) :sigma {sigma}")
    true = sum((power + 1) * x**power for power in range(count))
    return scatter(text, x, np.asarray(true), normal(noise), {n: p + 1.0 for p, n in enumerate(names)})


MISSED = "(a :init 2.4 :sigma 0.05) (b)"
KINDS: Mapping[str, Kind] = {
    "line": line(_line("0.1"), X, normal(0.1)),
    "line, unknown noise": line(_line("unknown"), X, normal(0.1)),
    "line, 5 rows, unknown noise": line(_line("unknown"), X[::6], normal(0.1)),
    "line, 3 rows, unknown noise": line(_line("unknown"), X[::12], normal(0.1)),
    "line, noise that grows twentyfold, 60 rows": line(_line("unknown"), LONG, normal(0.1 + 2.0 * (LONG + 1.0) / 3.0)),
    "line, stated factor of known weights": line(_line("(unknown (+ 1 (abs x)))"), X, normal(0.1 * (1 + np.abs(X)))),
    "line, sigma by row": Kind(_line("s"), _heteroscedastic),
    "line, covariance by row": Kind(
        problem("(a) (b)", "(= [u v] [(+ a (* b x)) (- a (* b x))]) :covariance [[0.04 0.03] [0.03 0.09]]"), _correlated
    ),
    "line, errors on both sides": Kind(problem("(a) (b)", f"{LINE} :errors ((x 0.1) (y 0.1))"), _errors),
    "line, derived": scatter(
        _line("0.1", "(derive (at (+ a (* 3 b))) (sum (+ a b)))"), X, 2 - X, normal(0.1), {"at": -1.0, "sum": 1.0}
    ),
    "line, good leverage point": line(_line("0.1"), np.append(X, 20.0), normal(0.1)),
    "line far from its origin": scatter(_line("0.1"), 1000 + X, 2 - X, normal(0.1), {"a": 1002.0, "b": -1.0}),
    "mean of 4": scatter(problem("(a)", "(= y a) :sigma unknown"), np.zeros(4), np.ones(4), normal(0.3), {"a": 1.0}),
    "mean of 2": scatter(problem("(a)", "(= y a) :sigma unknown"), np.zeros(2), np.ones(2), normal(0.3), {"a": 1.0}),
    "parabola": _powers(3, X, "0.1", 0.1),
    "polynomial of degree 5": _powers(6, np.linspace(0.0, 1.0, 30), "0.1", 0.1),
    "cubic, 9 rows, unknown noise": _powers(4, X[::3], "unknown", 0.1),
    "lines of one slope": Kind(problem("(a (vector 5)) (b)", "(= y (+ (a g) (* b x))) :sigma 0.1"), _lines_by_group),
    "net of 130 heights": Kind(
        problem(
            "(h (vector 130))",
            "(= y (- (h i) (h j))) :sigma 0.01",
            "(constraints (= (h 1) 0)) (derive (h5 (h 5)) (h130 (h 130)))",
        ),
        _levels,
        most=200,
    ),
    "priors": Kind(_line("0.2", unknowns="(a :init 2 :sigma 0.05) (b :init -1 :sigma 0.1)"), _with_priors),
    "prior against data": line(_line("0.1", unknowns=MISSED), X, normal(0.1)),
    "stated twice too large": line(_line("0.2"), X, normal(0.1)),
    "stated half too small": line(_line("0.05"), X, normal(0.1)),
    "stated a third too small, 100 rows": line(_line("0.067"), HUNDRED, normal(0.1)),
    "stated 1.4 times too large, 100 rows": line(_line("0.14"), HUNDRED, normal(0.1)),
    "outliers without a loss": line(_line("0.1"), LONG, with_outliers(0.1, 10.0, 0.1)),
    "outliers without a loss, unknown noise": line(_line("unknown"), LONG, with_outliers(0.1, 10.0, 0.1)),
    "neighbours correlated 0.5": line(_line("0.1"), LONG, autoregressive(0.5, 0.1)),
    "neighbours correlated 0.9": line(_line("0.1"), LONG, autoregressive(0.9, 0.1)),
    "neighbours correlated 0.5, unknown noise": line(_line("unknown"), LONG, autoregressive(0.5, 0.1)),
    "neighbours correlated 0.9, unknown noise": line(_line("unknown"), LONG, autoregressive(0.9, 0.1)),
    "a parabola taken for a line": scatter(
        _line("unknown"), LONG, 2 - LONG + 0.3 * LONG**2, normal(0.1), {"a": 2.0, "b": -1.0}
    ),
}
