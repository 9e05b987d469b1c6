"""Equalities straight and curved, inequalities, bounds, limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Kind, Tables, Truth
from benchmarks.coverage.making import LINE, line, normal, problem, scatter, table

X = np.linspace(-1.0, 2.0, 25)


def _triangle(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    k = np.repeat([1.0, 2.0, 3.0], 4)
    true = np.array([0.9, 1.1, np.pi - 2.0])
    return {"d": table(runs, k=k, y=true[k.astype(int) - 1] + 0.01 * rng.normal(size=(runs, 12)))}, {"w": true[None]}


def _on_circle(sigma: float) -> Kind:
    """A point of the unit circle, measured twice in both coordinates."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        u, v = (each + sigma * rng.normal(size=(runs, 2)) for each in (0.8, 0.6))
        return {"d": table(runs, u=u, v=v)}, {"x": 0.8, "y": 0.6}

    text = problem(
        "(x :init 0.8) (y :init 0.6)",
        f"(= [u v] [x y]) :sigma {sigma}",
        "(constraints (= (+ (^ x 2) (^ y 2)) 1))",
    )
    return Kind(text, make, most=1_000_000 if sigma < 0.2 else 200)


def _hyperbola(sigma: float) -> Kind:
    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        u, v = (each + sigma * rng.normal(size=(runs, 3)) for each in (2.0, 0.5))
        return {"d": table(runs, u=u, v=v)}, {"x": 2.0, "y": 0.5}

    text = problem("(x :init 2) (y :init 0.5)", f"(= [u v] [x y]) :sigma {sigma}", "(constraints (= (* x y) 1))")
    return Kind(text, make)


def _limited(low: float, high: float, limit: str, unknown: str = "(d)", *, sigma: float = 5.0) -> Kind:
    """A value of which all between ``low`` and ``high`` is as probable before it is measured."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        d = rng.uniform(low, high, runs)
        return {"d": table(runs, y=d[:, None] + sigma * rng.normal(size=(runs, 4)))}, {"d": d}

    return Kind(problem(unknown, f"(= y d) :sigma {sigma}", limit), make)


def _shares(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    true: Any = np.array([0.2, 0.3, 0.5])
    k = np.repeat([1.0, 2.0, 3.0], 5)
    y = true[k.astype(int) - 1] + 0.05 * rng.normal(size=(runs, 15))
    return {"d": table(runs, k=k, y=y)}, {"w": true[None]}


STATED = f"{LINE} :sigma 0.1"
KINDS: Mapping[str, Kind] = {
    "angles of a triangle": Kind(
        problem("(w (vector 3))", "(= y (w k)) :sigma 0.01", "(constraints (= (+ (w 1) (w 2) (w 3)) pi))"), _triangle
    ),
    "shares of a whole": Kind(
        problem("(w (vector 3) :in (0 1))", "(= y (w k)) :sigma 0.05", "(constraints (= (+ (w 1) (w 2) (w 3)) 1))"),
        _shares,
    ),
    "point of a circle": _on_circle(0.02),
    "point of a circle, coarse": _on_circle(0.5),
    "point of a circle, very coarse": _on_circle(0.8),
    "product known": _hyperbola(0.02),
    "product known, coarse": _hyperbola(0.6),
    "product of intercept and slope": scatter(
        problem("(a :init 2) (b :init -1)", "(= y (+ a (* b (^ x 2)))) :sigma 0.1", "(constraints (= (* a b) -2))"),
        X,
        2 - X**2,
        normal(0.1),
        {"a": 2.0, "b": -1.0},
    ),
    "bounds far away": line(problem("(a :in (0 5)) (b :in (-3 3))", STATED), X, normal(0.1)),
    "inequality far away": line(problem("(a) (b)", STATED, "(constraints (<= (+ a b) 4))"), X, normal(0.1)),
    "truth at an inequality": line(problem("(a) (b)", STATED, "(constraints (<= a 2))"), X, normal(0.1)),
    "truth at a bound": line(problem("(a :in (2 5)) (b)", STATED), X, normal(0.1)),
    "hard limits within the interval": _limited(-0.5, 0.5, "(constraints (uniform d -0.5 0.5))"),
    "bounds within the interval": _limited(-0.5, 0.5, "", "(d :in (-0.5 0.5))"),
    "one limit, mostly far": _limited(0.0, 40.0, "(constraints (>= d 0))", sigma=2.0),
    "positive": _limited(0.0, 10.0, "", "(d positive :init 1)", sigma=1.0),
}
