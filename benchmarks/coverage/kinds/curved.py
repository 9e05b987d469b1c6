"""Curves that bend within their uncertainty, and such that do not; quantities derived from them; several minima."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import normal, problem, scatter, table, with_outliers

T = np.linspace(0.0, 6.0, 40)
FEW = np.linspace(0.0, 6.0, 6)
DAYS = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 10.0])


def _curve(
    unknowns: str,
    model: str,
    x: Floats,
    true: Any,
    sigma: float,
    truth: Truth,
    *,
    stated: str = "",
    more: str = "",
    loss: str = "",
) -> Kind:
    text = problem(unknowns, f"(= y {model}) :sigma {stated or sigma} {loss}", more)
    return scatter(text, x, np.asarray(true), normal(sigma), truth)


def _reciprocal(sigma: float, more: str, truth: Truth) -> Kind:
    return scatter(
        problem("(b :init 1)", f"(= y b) :sigma {sigma}", more), np.zeros(4), np.ones(4), normal(sigma), truth
    )


def _many_decays(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    """55 decays with one background: 111 unknowns."""
    g = np.repeat(np.arange(1.0, 56.0), 8)
    t = np.tile(np.linspace(0.0, 4.0, 8), 55)
    y = 1 + 5 * np.exp(-t) + 0.3 * rng.normal(size=(runs, len(t)))
    return {"d": table(runs, g=g, t=t, y=y)}, {"k1": 1.0, "c": 1.0}


def _mirrored(far: float) -> Kind:
    """Ranges from stations next to one line: the place mirrored at the line fits nearly as well."""
    stations = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    up = far * np.array([0.0, 1.0, 0.0, -1.0, 0.5])

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        r = np.hypot(1.5 - stations, 2.0 - up) + 0.1 * rng.normal(size=(runs, 5))
        return {"d": table(runs, s=stations, u=up, r=r)}, {"x": 1.5, "y": 2.0}

    text = problem("(x :init 1.5) (y :init {start})", "(= r (distance [x y] [s u])) :sigma 0.1")
    return Kind(text.replace("{start}", "-2"), make)


DECAY = "(* a (exp (* -1 k x)))"
OXYGEN = "(* a (- 1 (exp (* -1 k x))))"
TRUE_OXYGEN = 214 * (1 - np.exp(-0.55 * DAYS))
AK = {"a": 3.0, "k": 0.6}
KINDS: Mapping[str, Kind] = {
    "decay": _curve("(a :init 3) (k :init 0.6)", DECAY, T, 3 * np.exp(-0.6 * T), 0.05, AK),
    "decay, unknown noise, 6 rows": _curve(
        "(a :init 3) (k :init 0.6)", DECAY, FEW, 3 * np.exp(-0.6 * FEW), 0.05, AK, stated="unknown"
    ),
    "decay without starts": _curve("(a) (k)", DECAY, T, 3 * np.exp(-0.6 * T), 0.05, AK),
    "decay under a loss": _curve(
        "(a :init 3) (k :init 0.6)", DECAY, T, 3 * np.exp(-0.6 * T), 0.05, AK, loss=":loss (huber 1.5)"
    ),
    "growth that bends": _curve(
        "(a :init 214) (k :init 0.55)", OXYGEN, DAYS, TRUE_OXYGEN, 20.0, {"a": 214.0, "k": 0.55}
    ),
    "growth that bends, under a loss": _curve(
        "(a :init 214) (k :init 0.55)", OXYGEN, DAYS, TRUE_OXYGEN, 20.0, {"a": 214.0, "k": 0.55}, loss=":loss (huber 2)"
    ),
    "saturation": _curve(
        "(v :init 2) (m :init 1)", "(/ (* v x) (+ m x))", T + 0.1, 2 * (T + 0.1) / (1.1 + T), 0.05, {"v": 2.0, "m": 1.0}
    ),
    "sine": _curve(
        "(a :init 1) (w :init 2) (f :init 0.5)",
        "(* a (sin (+ f (* w x))))",
        T,
        np.sin(2 * T + 0.5),
        0.1,
        {"a": 1.0, "w": 2.0, "f": 0.5},
    ),
    "peak on a slope": _curve(
        "(h :init 5) (c :init 3) (w :init 0.7) (s :init 0)",
        "(+ (* h (exp (* -0.5 (^ (/ (- x c) w) 2)))) (* s x))",
        T,
        5 * np.exp(-0.5 * ((T - 3) / 0.7) ** 2) + 0.1 * T,
        0.2,
        {"h": 5.0, "c": 3.0, "w": 0.7, "s": 0.1},
    ),
    "power law": _curve(
        "(c :init 2) (p :init 1.5)", "(* c (^ x p))", T + 0.5, 2 * (T + 0.5) ** 1.5, 0.5, {"c": 2.0, "p": 1.5}
    ),
    "logistic curve, unknown noise": _curve(
        "(l :init 4) (k :init 2) (m :init 3)",
        "(/ l (+ 1 (exp (* -1 k (- x m)))))",
        T[::3],
        4 / (1 + np.exp(-2 * (T[::3] - 3))),
        0.1,
        {"l": 4.0, "k": 2.0, "m": 3.0},
        stated="unknown",
    ),
    "ratio": _reciprocal(0.1, "(derive (q (/ 1 b)))", {"b": 1.0, "q": 1.0}),
    "ratio with a poor denominator": _reciprocal(0.6, "(derive (q (/ 1 b)))", {"q": 1.0}),
    "square of hardly anything": _reciprocal(2.0, "(derive (q (^ (- b 1) 2)))", {"q": 0.0}),
    "band over a table": _curve(
        "(a :init 3) (k :init 0.6)",
        DECAY,
        T,
        3 * np.exp(-0.6 * T),
        0.05,
        {"f": 3 * np.exp(-0.6 * T[None])},
        more="(derive (f (* a (exp (* -1 k x))) :over d))",
    ),
    "band that bends": _curve(
        "(a :init 214) (k :init 0.55)",
        OXYGEN,
        DAYS,
        TRUE_OXYGEN,
        20.0,
        {"f": 1 / (0.55 * DAYS[None])},
        more="(derive (f (/ 1 (* k x)) :over d))",
    ),
    "a frequency known too badly": _curve(
        "(w :init 2)", "(sin (* w x))", np.array([1.0, 9.0]), np.sin([2.0, 18.0]), 0.7, {"w": 2.0}
    ),
    "111 unknowns": Kind(
        problem(
            "(a (vector 55) :init 5) (k (vector 55) :init 1) (c :init 1)",
            "(= y (+ c (* (a g) (exp (* -1 (k g) t))))) :sigma 0.3",
            "(derive (k1 (k 1)))",
        ),
        _many_decays,
        most=100,
    ),
    "mirrored place": _mirrored(0.05),
    "place that is hardly mirrored": _mirrored(2.0),
    "outliers in a decay, cauchy": scatter(
        problem("(a :init 3) (k :init 0.6)", f"(= y {DECAY}) :sigma 0.05 :loss (cauchy)"),
        T,
        3 * np.exp(-0.6 * T),
        with_outliers(0.1, 20.0, 0.05),
        AK,
    ),
}
