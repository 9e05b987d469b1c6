"""What laboratories try: counts, proportions, rounded and censored readings, calibrations, comparisons, ratios."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import LINE, autoregressive, drawn, line, normal, problem, scatter, table

TIMES = np.linspace(0.0, 6.0, 20)
CHANNELS = np.linspace(0.0, 10.0, 40)
DOSES = np.linspace(-2.0, 2.0, 8)
FORCES = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
TWELVE = np.linspace(0.0, 10.0, 12)
FIFTEEN = np.linspace(0.0, 5.0, 15)
TEN = np.linspace(0.0, 5.0, 10)
SIXTY = np.linspace(0.0, 1.0, 60)
GROUPS = np.repeat([1.0, 2.0], 5)
LOGISTIC = "(/ 1 (+ 1 (exp (* -1 s (- x m)))))"


def _counts(unknowns: str, model: str, x: Floats, mean: Floats, truth: Truth) -> Kind:
    text = problem(unknowns, f"(= y {model}) :distribution poisson")
    return drawn(text, lambda rng, runs: {"x": x, "y": 1.0 * rng.poisson(mean, size=(runs, len(x)))}, truth)


def _doses(doses: Floats, animals: int) -> Kind:
    text = problem("(m :init 0) (s :init 1)", f"(= y (* {animals} {LOGISTIC})) :distribution (binomial {animals})")
    share = 1 / (1 + np.exp(-1.5 * (doses - 0.3)))
    return drawn(
        text,
        lambda rng, runs: {"x": doses, "y": 1.0 * rng.binomial(animals, share, size=(runs, len(doses)))},
        {"m": 0.3, "s": 1.5},
    )


def _differing(rows: int, noise: str, spread: float = 1.0) -> Kind:
    """Of 20 trials 30 % succeed, in some rows more and in others fewer."""

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        share = 0.3 + spread * (rng.beta(3, 7, (runs, rows)) - 0.3)
        return {"n": 1.0 * rng.binomial(20, share)}

    return drawn(problem("(p :init 0.3)", f"(= n (* 20 p)) {noise}"), draw, {"p": 0.3})


def _relative(share: float, model: str = "") -> Kind:
    text = problem("(a :init 2) (b :init 1)", f"{LINE} :sigma {model or f'(* {share} model)'}")
    return drawn(
        text,
        lambda rng, runs: {"x": TEN, "y": (2 + TEN) * (1 + share * rng.normal(size=(runs, 10)))},
        {"a": 2.0, "b": 1.0},
    )


def _rounded(sigma: float, noise: str) -> Kind:
    """Eight readings of one value, in steps of 1."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        a = 5 + rng.random(runs)
        return {"d": table(runs, y=np.round(a[:, None] + sigma * rng.normal(size=(runs, 8))))}, {"a": a}

    return Kind(problem("(a)", f"(= y a) {noise}"), make)


def _ratio(noise: Floats, clauses: str) -> Kind:
    text = f"(problem p (data d external) (unknowns (a :init 10) (b :init 5)) {clauses} (derive (r (/ a b))))"
    true = np.where(GROUPS == 1.0, 10.0, 5.0)
    return drawn(text, lambda rng, runs: {"g": GROUPS, "y": true + noise * rng.normal(size=(runs, 10))}, {"r": 2.0})


def _inverse(sigma: float) -> Kind:
    """A gauge is calibrated at five forces, and then reads an unknown one three times."""
    text = """(problem p (data d external) (data u external) (unknowns (z) (g) (f :init 20))
      (observe d (= y (+ z (* g x))) :sigma (unknown 1 :as s))
      (observe u (= y (+ z (* g f))) :sigma (unknown 1 :as s)))"""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        y, use = 0.2 * FORCES + sigma * rng.normal(size=(runs, 5)), 5.0 + sigma * rng.normal(size=(runs, 3))
        return {"d": table(runs, x=FORCES, y=y), "u": table(runs, y=use)}, {"f": 25.0}

    return Kind(text, make)


def _calibration(sigma: str) -> Kind:
    """Four days of five readings on a line, with an offset each day."""
    day, x = np.repeat([1.0, 2.0, 3.0, 4.0], 5), np.tile(np.arange(5.0), 4)

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        offset = 0.5 * rng.normal(size=(runs, 4))[:, day.astype(int) - 1]
        return {"day": day, "x": x, "y": 2 - x + offset + 0.1 * rng.normal(size=(runs, 20))}

    return drawn(problem("(a) (b)", f"{LINE} :sigma {sigma} :common ((0.5 :per day))"), draw, {"a": 2.0, "b": -1.0})


def _items(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    item, second = np.tile(np.arange(1.0, 11.0), 2), np.repeat([0.0, 1.0], 10)
    return {"item": item, "second": second, "y": item + 0.5 * second + 0.2 * rng.normal(size=(runs, 20))}


def _both(sx: Floats | float, sy: Floats | float, errors: str) -> Kind:
    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        x, y = TWELVE + sx * rng.normal(size=(runs, 12)), 2 - TWELVE + sy * rng.normal(size=(runs, 12))
        return {"x": x, "y": y, "sx": np.broadcast_to(sx, (12,)), "sy": np.broadcast_to(sy, (12,))}

    return drawn(problem("(a) (b)", f"{LINE} :errors {errors}"), draw, {"a": 2.0, "b": -1.0})


def _circle(sigma: float, stated: str) -> Kind:
    angle = np.arange(8.0) * np.pi / 4

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        x, y = np.moveaxis(5 * np.array([np.cos(angle), np.sin(angle)]) + sigma * rng.normal(size=(runs, 2, 8)), 1, 0)
        return {"x": 1 + x, "y": 2 + y}

    text = problem("(p (vector 2) :init [1 1]) (r :init 4)", f"(= r (distance [x y] p)) :sigma {stated}")
    return drawn(text, draw, {"p": np.array([1.0, 2.0]), "r": 5.0})


def _ranges(stations: Floats, up: Floats, place: tuple[float, float]) -> Kind:
    true = np.hypot(stations - place[0], up - place[1])
    return drawn(
        problem(f"(x :init {place[0]}) (y :init {place[1]})", "(= r (distance [x y] [s u])) :sigma 0.1"),
        lambda rng, runs: {"s": stations, "u": up, "r": true + 0.1 * rng.normal(size=(runs, len(stations)))},
        {"x": place[0], "y": place[1]},
    )


def _censored(unknowns: str, sigma: str) -> Kind:
    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        y = 0.5 + 0.5 * FIFTEEN + 0.5 * rng.normal(size=(runs, 15))
        return {"x": FIFTEEN, "y": np.maximum(y, 1.0), "c": (y < 1.0) * 1.0}

    return drawn(problem(unknowns, f"{LINE} :sigma {sigma} :below (= c 1)"), draw, {"a": 0.5, "b": 0.5})


def _pendulum(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    length = 1 + 0.1 * rng.normal(size=runs)
    period = 2 * np.pi * np.sqrt(length / 9.81)[:, None] + 0.02 * rng.normal(size=(runs, 5))
    return {"d": table(runs, t=period)}, {"g": 9.81}


WAVE = "(= y (+ (* a (cos x)) (* b (sin x)))) :sigma 0.3"
TWO = "(+ (* a (exp (* -1 k x))) (* b (exp (* -1 l x))))"
DECAYS = np.linspace(0.0, 10.0, 30)
KINDS: Mapping[str, Kind] = {
    "counts: decay above a background": _counts(
        "(a :init 50) (k :init 0.5) (b :init 3)",
        "(+ b (* a (exp (* -1 k x))))",
        TIMES,
        3 + 50 * np.exp(-0.5 * TIMES),
        {"a": 50.0, "k": 0.5, "b": 3.0},
    ),
    "counts: decay, few": _counts(
        "(a :init 6) (k :init 0.5)", "(* a (exp (* -1 k x)))", TIMES, 6 * np.exp(-0.5 * TIMES), {"a": 6.0, "k": 0.5}
    ),
    "counts: ten": _counts("(a :init 3)", "a", np.zeros(1), np.array([10.0]), {"a": 10.0}),
    "counts: nine above five": _counts(
        "(s :init 3) (b :init 3)", "(+ b (* s x))", np.array([0.0, 1.0]), np.array([5.0, 9.0]), {"s": 4.0, "b": 5.0}
    ),
    "counts: a peak": _counts(
        "(h :init 20) (c :init 5) (w :init 1) (b :init 4)",
        "(+ b (* h (exp (* -0.5 (^ (/ (- x c) w) 2)))))",
        CHANNELS,
        4 + 20 * np.exp(-0.5 * (CHANNELS - 5) ** 2),
        {"h": 20.0, "c": 5.0, "w": 1.0, "b": 4.0},
    ),
    "half lethal dose, groups of 6": _doses(DOSES, 6),
    "half lethal dose, groups of 20": _doses(DOSES, 20),
    "single trials": _doses(np.linspace(-3.0, 3.0, 60), 1),
    "3 of 20": drawn(
        problem("(p :init 0.5 :in (0 1))", "(= y (* 20 p)) :distribution (binomial 20)"),
        lambda rng, runs: {"y": 1.0 * rng.binomial(20, 0.15, size=(runs, 1))},
        {"p": 0.15},
    ),
    "shares that differ between 40 rows": _differing(40, ":distribution (binomial 20)"),
    "shares that differ between 15 rows": _differing(15, ":distribution (binomial 20)"),
    "shares that differ between 15 rows, unknown factor": _differing(15, ":sigma (unknown (sqrt model))"),
    "shares of 15 rows": _differing(15, ":distribution (binomial 20)", spread=0.0),
    "line, 5 % of model": _relative(0.05),
    "line, 20 % of model": _relative(0.2),
    "line, unknown share of model": _relative(0.1, "(unknown model)"),
    "line, root of model": drawn(
        problem("(a :init 10) (b :init 5)", f"{LINE} :sigma (sqrt model)"),
        lambda rng, runs: {"x": TEN, "y": 20 + 5 * TEN + np.sqrt(20 + 5 * TEN) * rng.normal(size=(runs, 10))},
        {"a": 20.0, "b": 5.0},
    ),
    "mean of 5, 20 % of model": drawn(
        problem("(a :init 2)", "(= y a) :sigma (* 20% model)"),
        lambda rng, runs: {"y": 3 * (1 + 0.2 * rng.normal(size=(runs, 5)))},
        {"a": 3.0},
    ),
    "rounded, sigma 0.3 steps, said": _rounded(0.3, ":sigma 0.3 :resolution 1"),
    "rounded, sigma 0.3 steps": _rounded(0.3, ":sigma unknown"),
    "rounded, sigma 0.1 steps": _rounded(0.1, ":sigma unknown"),
    "rounded, sigma 1.5 steps": _rounded(1.5, ":sigma unknown"),
    "long tails, student 4": drawn(
        problem("(a) (b)", f"{LINE} :sigma 0.1 :distribution (student 4)"),
        lambda rng, runs: {"x": TWELVE, "y": 2 - TWELVE + 0.1 * rng.standard_t(4, size=(runs, 12))},
        {"a": 2.0, "b": -1.0},
    ),
    "below a limit": _censored("(a :init 1) (b :init 0)", "0.5"),
    "below a limit, unknown sigma": _censored("(a :init 1) (b :init 0)", "unknown"),
    "ratio of means, own noises": _ratio(
        np.where(GROUPS == 1.0, 0.5, 0.4),
        "(observe one d (= y a) :sigma unknown :when (= g 1)) (observe two d (= y b) :sigma unknown :when (= g 2))",
    ),
    "ratio of means, poor": _ratio(np.full(10, 3.0), "(observe d (= y (if (= g 1) a b)) :sigma unknown)"),
    "inverse prediction": _inverse(0.3),
    "inverse prediction, poor": _inverse(2.0),
    "calibration with offsets of days": _calibration("0.1"),
    "calibration with offsets of days, unknown noise": _calibration("unknown"),
    "two instruments on ten items": drawn(
        problem("(m (vector 10)) (o)", "(= y (+ (m item) (* o second))) :sigma unknown"), _items, {"o": 0.5}
    ),
    "both errors by row": _both(np.linspace(0.1, 0.5, 12), np.linspace(0.6, 0.2, 12), "((x sx) (y sy))"),
    "large errors in x": _both(1.0, 0.3, "((x 1) (y 0.3))"),
    "circle through 8 points": _circle(0.1, "0.1"),
    "circle through 8 points, unknown noise": _circle(0.5, "unknown"),
    "two circles": _ranges(np.array([0.0, 4.0]), np.zeros(2), (1.5, 2.0)),
    "anchors near a line": _ranges(np.arange(5.0), 0.6 * np.array([0.0, 1.0, 0.0, -1.0, 0.5]), (1.5, 2.0)),
    "ar1 0.5, unknown": line(
        problem("(a) (b)", f"{LINE} :sigma unknown :correlation (ar1 unknown)"), SIXTY, autoregressive(0.5, 0.1)
    ),
    "ar1 0.7, unknown": line(
        problem("(a) (b)", f"{LINE} :sigma unknown :correlation (ar1 unknown)"), SIXTY, autoregressive(0.7, 0.1)
    ),
    "two exponentials": scatter(
        problem("(a :init 3) (k :init 2) (b :init 2) (l :init 0.3)", f"(= y {TWO}) :sigma 0.02"),
        DECAYS,
        3 * np.exp(-2 * DECAYS) + 2 * np.exp(-0.3 * DECAYS),
        normal(0.02),
        {"a": 3.0, "k": 2.0, "b": 2.0, "l": 0.3},
    ),
    "amplitude of a third of its noise": scatter(
        problem("(a) (b)", WAVE, "(derive (h (hypot a b)))"), TIMES, 0.1 * np.cos(TIMES), normal(0.3), {"h": 0.1}
    ),
    "phase": scatter(
        problem("(a) (b)", WAVE, "(derive (f (atan2 b a)))"), TIMES, 0.3 * np.cos(TIMES), normal(0.3), {"f": 0.0}
    ),
    "exponential of a mean": scatter(
        problem("(a)", "(= y a) :sigma unknown", "(derive (r (exp a)))"),
        np.zeros(5),
        np.ones(5),
        normal(1.0),
        {"r": np.e},
    ),
    "pairs with unknown covariance": drawn(
        problem("(a) (b)", "(= [u v] [a b]) :covariance unknown"),
        lambda rng, runs: dict(
            zip("uv", np.moveaxis([1.0, 2.0] + rng.normal(size=(runs, 6, 2)) @ [[1, 1.2], [0, 1.6]], 2, 0), strict=True)
        ),
        {"a": 1.0, "b": 2.0},
    ),
    "pendulum of uncertain length": Kind(
        "(problem p (data d external) (constants (l 1 :sigma 0.1)) (unknowns (g :init 10))"
        " (observe d (= t (* 2 pi (sqrt (/ l g)))) :sigma 0.02))",
        _pendulum,
    ),
}
