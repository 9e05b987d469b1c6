"""What an examiner of a workshop tries: curves of more numbers, counts, errors in both coordinates, calibrations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import LINE, drawn, normal, problem, scatter, table

DOSES = np.array([0, 0.3, 0.6, 1.2, 2.5, 5, 10, 20])
WIDE = np.geomspace(0.1, 30.0, 12)
HALF = WIDE**1.5 / (2**1.5 + WIDE**1.5)
MINUTES = np.linspace(0.0, 20.0, 15)
SHORT = np.linspace(0.0, 2.0, 15)
SECONDS = np.linspace(0.0, 10.0, 40)
FIVE = np.linspace(-2.0, 2.0, 5)
CENTRED = np.linspace(-3.0, 3.0, 15)
TENS = np.array([1.0, 2, 4, 6, 8, 10, 15, 20])
KELVIN = np.linspace(300.0, 400.0, 8)
CLOCK = np.arange(8.0)


FEW_TIMES = np.array([1.0, 2.0, 1.0, 3.0])


def _curve(
    unknowns: str, model: str, x: Floats, true: Floats, sigma: float, truth: Truth, *, stated: str = "", more: str = ""
) -> Kind:
    text = problem(unknowns, f"(= y {model}) :sigma {stated or 'unknown'}", more)
    return scatter(text, x, true, normal(sigma), truth)


def _kinetics(x: Floats) -> Kind:
    """An enzyme by Michaelis and Menten, above a blank."""
    return _curve(
        "(v :init 2) (m :init 1.5) (b :init 0)",
        "(+ b (/ (* v x) (+ m x)))",
        x,
        0.1 + 2 * x / (1.5 + x),
        0.05,
        {"v": 2.0, "m": 1.5, "b": 0.1},
    )


def _wave(x: Floats, sigma: float, unknowns: str, more: str, truth: Truth) -> Kind:
    """A wave of unknown frequency by sine and cosine."""
    return _curve(
        unknowns,
        "(+ (* a (sin (* w x))) (* b (cos (* w x))))",
        x,
        0.8 * np.sin(2 * x) + 0.6 * np.cos(2 * x),
        sigma,
        {"w": 2.0, **truth},
        more=more,
    )


def _peak(x: Floats) -> Kind:
    """A peak by Lorentz on a background."""
    return _curve(
        "(h :init 5) (c :init 0) (w :init 1) (b :init 1)",
        "(+ b (/ h (+ 1 (^ (/ (- x c) w) 2))))",
        x,
        1 + 5 / (1 + ((x - 0.2) / 0.8) ** 2),
        0.3,
        {"h": 5.0, "c": 0.2, "w": 0.8, "b": 1.0},
    )


def _net(first: float, second: float, background: float) -> Kind:
    """The ratio of two counts above one background, which was counted twice as long."""
    text = """(problem p (data d external) (unknowns (s :init 50) (t :init 50) (b :init 10))
      (observe one d (= n (+ s b)) :distribution poisson) (observe two d (= k (+ t b)) :distribution poisson)
      (observe three d (= m (* 2 b)) :distribution poisson) (derive (r (/ s t))))"""

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        means = {"n": first + background, "k": second + background, "m": 2 * background}
        return {name: 1.0 * rng.poisson(mean, (runs, 1)) for name, mean in means.items()}

    return drawn(text, draw, {"s": first, "r": first / second})


def _counted(model: str, unknowns: str, x: Floats, expected: Floats, truth: Truth) -> Kind:
    return drawn(
        problem(unknowns, f"(= y {model}) :distribution poisson"),
        lambda rng, runs: {"x": x, "y": 1.0 * rng.poisson(expected, (runs, len(x)))},
        truth,
    )


def _both(count: int, across: Any, along: Any, stated: str) -> Kind:
    """A line through readings with errors in both coordinates."""
    true = np.linspace(0.0, 10.0, count)
    u, v = (np.broadcast_to(each, count) for each in (across, along))

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        shape = (runs, count)
        x, y = true + u * rng.normal(size=shape), 1 + 0.5 * true + v * rng.normal(size=shape)
        return {"x": x, "y": y, "u": u, "v": v}

    return drawn(problem("(a) (b :init 1)", f"{LINE} {stated}"), draw, {"a": 1.0, "b": 0.5})


def _backwards(curve: str, samples: int, sigma: float, noise: tuple[str, str], bend: float) -> Kind:
    """A calibration by eight standards, and readings of a sample at 2.5; ``noise`` as stated of both."""
    x = np.linspace(0.0, 5.0, 8)

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        y = 1 + 2 * x - bend * x**2 + 0.05 * rng.normal(size=(runs, 8))
        own = 6 - bend * 2.5**2 + sigma * rng.normal(size=(runs, samples))
        return {"d": table(runs, x=x, y=y), "s": table(runs, y=own)}, {"f": 2.5}

    unknowns = "(a) (b :init 2) (c) (f :init 2.5)" if bend else "(a) (b :init 2) (f :init 2.5)"
    text = f"""(problem p (data d external) (data s external) (unknowns {unknowns})
      (observe d (= y {curve.format("x")}) :sigma {noise[0]})
      (observe s (= y {curve.format("f")}) :sigma {noise[1]}))"""
    return Kind(text, make)


def _mean(form: str, truth: float, mean: float, rows: int) -> Kind:
    """What is derived of a mean."""
    text = problem("(a :init 1)", "(= y a) :sigma unknown", f"(derive (q {form}))")
    return scatter(text, np.zeros(rows), np.full(rows, mean), normal(0.3), {"q": truth})


ONE = "(unknown 1 :as e)"
KINDS: Mapping[str, Kind] = {
    "cooling, time to a temperature": _curve(
        "(e :init 20) (d :init 60) (k :init 0.1)",
        "(+ e (* d (exp (* -1 k x))))",
        MINUTES,
        20 + 60 * np.exp(-0.15 * MINUTES),
        0.5,
        {"e": 20.0, "d": 60.0, "k": 0.15, "t": float(np.log(3.0) / 0.15)},
        more="(derive (t (/ (log (/ d (- 40 e))) k)))",
    ),
    "enzyme above a blank, 8 rows": _kinetics(DOSES),
    "enzyme above a blank, 5 rows": _kinetics(DOSES[[0, 2, 4, 6, 7]]),
    "hill curve, 12 rows, noisy": _curve(
        "(v :init 1) (m :init 2) (h :init 1.5)",
        "(/ (* v (^ x h)) (+ (^ m h) (^ x h)))",
        WIDE,
        HALF,
        0.04,
        {"v": 1.0, "m": 2.0, "h": 1.5},
    ),
    "wave of unknown frequency, 15 rows": _wave(
        np.linspace(0.0, 5.0, 15),
        0.3,
        "(a :init 1) (b :init 1) (w :init 2)",
        "(derive (r (hypot a b)) (f (atan2 b a)))",
        {"r": 1.0, "f": float(np.arctan2(0.6, 0.8))},
    ),
    "wave of unknown frequency within bounds, no start": _wave(
        SECONDS, 0.3, "(a) (b) (w :in (1 3))", "", {"a": 0.8, "b": 0.6}
    ),
    "wave that decays, quality": _curve(
        "(a :init 1) (k :init 0.2) (w :init 2) (f :init 0)",
        "(* a (exp (* -1 k x)) (cos (+ f (* w x))))",
        SECONDS,
        np.exp(-0.2 * SECONDS) * np.cos(2 * SECONDS + 0.3),
        0.05,
        {"k": 0.2, "w": 2.0, "f": 0.3, "q": 5.0},
        more="(derive (q (/ w (* 2 k))))",
    ),
    "vapour pressure by antoine, 8 rows": _curve(
        "(a :init 10) (b :init 1500) (c :init -50)",
        "(- a (/ b (+ x c)))",
        KELVIN,
        10 - 1500 / (KELVIN - 50),
        0.01,
        {"a": 10.0, "b": 1500.0, "c": -50.0},
        stated="0.01",
    ),
    "peak by lorentz, 15 rows": _peak(CENTRED),
    "peak by lorentz, 8 rows": _peak(np.linspace(-3.0, 3.0, 8)),
    "power law with offset, 8 rows": _curve(
        "(a :init 1) (b :init 2) (c :init 0.5)",
        "(+ a (* b (^ x c)))",
        TENS,
        1 + 2 * TENS**0.5,
        0.1,
        {"a": 1.0, "b": 2.0, "c": 0.5},
    ),
    "dead time and lag": _curve(
        "(g :init 1) (t :init 1) (l :init 2)",
        "(* g (- 1 (exp (/ (* -1 (max 0 (- x t))) l))))",
        SECONDS,
        1 - np.exp(-np.maximum(0.0, SECONDS - 1.1) / 2),
        0.05,
        {"g": 1.0, "t": 1.1, "l": 2.0},
    ),
    "half-life from a short decay": _curve(
        "(a :init 3) (k :init 0.6)",
        "(* a (exp (* -1 k x)))",
        SHORT,
        3 * np.exp(-0.3 * SHORT),
        0.2,
        {"h": float(np.log(2) / 0.3)},
        more="(derive (h (/ (log 2) k)))",
    ),
    "parabola, 5 rows, vertex": _curve(
        "(a) (b) (c)",
        "(+ a (* b x) (* c x x))",
        FIVE,
        1 + FIVE + FIVE**2,
        0.2,
        {"v": -0.5, "h": 0.75},
        more="(derive (v (/ (* -1 b) (* 2 c))) (h (- a (/ (* b b) (* 4 c)))))",
    ),
    "clock offset and drift, 8 rows": _curve(
        "(o) (d)",
        "(+ o (* d x))",
        CLOCK,
        0.3 + 1e-3 * CLOCK,
        1e-3,
        {"o": 0.3, "d": 1e-3, "p": 0.32},
        more="(derive (p (+ o (* 20 d))))",
    ),
    "counts: ratio above one background": _net(400.0, 900.0, 100.0),
    "counts: a line, 5 rows": _counted(
        "(+ a (* b x))",
        "(a :init 5) (b :init 2)",
        np.linspace(0.0, 10.0, 5),
        5 + 2 * np.linspace(0.0, 10.0, 5),
        {"a": 5.0, "b": 2.0},
    ),
    "counts: growth, 8 rows": _counted(
        "(exp (+ a (* b x)))",
        "(a :init 1) (b :init 0.2)",
        np.linspace(0.0, 10.0, 8),
        np.exp(1 + 0.2 * np.linspace(0.0, 10.0, 8)),
        {"a": 1.0, "b": 0.2},
    ),
    "counts: a rate of few events in unequal times": drawn(
        problem("(r)", "(= n (* r t)) :distribution poisson"),
        lambda rng, runs: {"n": 1.0 * rng.poisson(0.3 * FEW_TIMES, (runs, 4)), "t": FEW_TIMES},
        {"r": 0.3},
    ),
    "counts: root of the count as sigma": drawn(
        problem("(a)", "(= y a) :sigma (sqrt y)"),
        lambda rng, runs: {"y": 1.0 * rng.poisson(30.0, (runs, 8))},
        {"a": 30.0},
    ),
    "a tenth of each reading as sigma, 20 rows": scatter(
        problem("(b :init 1)", "(= y (* b x)) :sigma (* 10% y)"),
        np.arange(1.0, 21.0),
        2.0 * np.arange(1.0, 21.0),
        normal(0.2 * np.arange(1.0, 21.0)),
        {"b": 2.0},
    ),
    "quadratic calibration read backwards": _backwards("(+ a (* b {0}) (* c {0} {0}))", 2, 0.05, (ONE, ONE), 0.1),
    "calibration with stated noise, sample without": _backwards("(+ a (* b {0}))", 3, 0.2, ("0.05", "unknown"), 0.0),
    "equal errors in both coordinates, 5 rows": _both(5, 0.3, 0.3, ":sigma 0.3 :errors ((x 0.3))"),
    "equal errors in both coordinates, 40 rows": _both(40, 0.3, 0.3, ":sigma 0.3 :errors ((x 0.3))"),
    "york, 10 rows": _both(10, np.geomspace(0.05, 0.8, 10), np.geomspace(0.8, 0.05, 10), ":sigma v :errors ((x u))"),
    "errors in x not stated, 15 rows": _both(15, 0.3, 0.3, ":sigma 0.3"),
    "logarithm of a mean, 5 rows": _mean("(log a)", 0.0, 1.0, 5),
    "fourth power of a mean, 5 rows": _mean("(^ a 4)", 1.0, 1.0, 5),
    "exponential of three means, 8 rows": _mean("(exp (* 3 a))", float(np.exp(3)), 1.0, 8),
    "reciprocal of a difference, 5 rows": _mean("(/ 1 (- a 0.2))", 1.25, 1.0, 5),
}
