"""What chemists and clinicians try: additions, kinetics, exposures, crossing lines, limits of detection, doses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import LINE, drawn, normal, problem, scatter, table

ADDED = np.repeat(np.arange(4.0), 2)
CONTENTS = np.array([0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
CHANNELS = np.linspace(-5.0, 5.0, 31)
SHORT = np.linspace(0.0, 4.0, 8)
START = np.linspace(0.0, 1.2, 20)
ENDS = np.concatenate([np.linspace(0.0, 4.0, 5), np.linspace(6.0, 10.0, 5)])
NINE = np.linspace(-2.0, 2.0, 9)
SIXTEEN = np.linspace(-3.0, 3.0, 16)
SCALE = np.linspace(0.0, 10.0, 15)
HOURS = np.array([0.25, 0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 12.0])
STANDARDS = np.arange(1.0, 6.0)
TURN = np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0])


def _additions(added: Floats, sigma: float) -> Kind:
    text = problem("(a) (k :init 1)", "(= y (+ a (* k x))) :sigma unknown", "(derive (c (/ a k)))")
    return scatter(text, added, 2.0 + added, normal(sigma), {"c": 2.0})


def _kinetics(x: Floats, sigma: float, noise: str, *, relative: bool = False) -> Kind:
    """The velocity of an enzyme by Michaelis and Menten."""
    true = 10 * x / (3 + x)
    size = sigma * true if relative else sigma
    text = problem("(v :init 8) (k :init 2)", f"(= y (/ (* v x) (+ k x))) :sigma {noise}")
    return scatter(text, x, true, normal(size), {"v": 10.0, "k": 3.0})


def _exposures(gross: float, blank: float, rate: float, background: float) -> Kind:
    text = """(problem p (data g external) (data b external) (unknowns (s :init 1) (b :init 1))
      (observe g (= n (* t (+ s b))) :distribution poisson) (observe b (= n (* t b)) :distribution poisson))"""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        first, second = rng.poisson(gross * (rate + background), (runs, 1)), rng.poisson(blank * background, (runs, 1))
        tables = {
            "g": table(runs, t=np.array([gross]), n=1.0 * first),
            "b": table(runs, t=np.array([blank]), n=1.0 * second),
        }
        return tables, {"s": rate, "b": background}

    return Kind(text, make)


def _decay(x: Floats, noise: str) -> Kind:
    text = problem("(a :init 4) (k :init 0.8) (b :init 0)", f"(= y (+ b (* a (exp (* -1 k x))))) :sigma {noise}")
    return scatter(text, x, 1 + 5 * np.exp(-x), normal(0.1), {"a": 5.0, "k": 1.0, "b": 1.0})


def _crossing(sigma: float) -> Kind:
    """A titration: where two lines cross."""
    text = """(problem p (data d external) (unknowns (a) (b) (c) (e))
      (observe one d (= y (+ a (* b x))) :sigma (unknown 1 :as s) :when (< x 5))
      (observe two d (= y (+ c (* e x))) :sigma (unknown 1 :as s) :when (> x 5)) (derive (v (/ (- a c) (- e b)))))"""
    return scatter(text, ENDS, np.where(ENDS < 5, 1 + 0.1 * ENDS, -2.5 + 0.8 * ENDS), normal(sigma), {"v": 5.0})


def _maximum(bend: float, sigma: float) -> Kind:
    text = problem(
        "(a) (b) (c :init -1)", "(= y (+ a (* b x) (* c x x))) :sigma unknown", "(derive (m (/ b (* -2 c))))"
    )
    return scatter(text, NINE, 3 + bend * NINE - bend * NINE**2, normal(sigma), {"m": 0.5})


def _both_limits(sigma: str) -> Kind:
    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        y = 0.5 * SIXTEEN + 0.5 * rng.normal(size=(runs, 16))
        return {"x": SIXTEEN, "y": np.clip(y, -1, 1), "low": 1.0 * (y < -1), "high": 1.0 * (y > 1)}

    text = problem("(a) (b)", f"{LINE} :sigma {sigma} :below (= low 1) :above (= high 1)")
    return drawn(text, draw, {"a": 0.0, "b": 0.5})


def _entered(value: float, rows: int, mean: float) -> Kind:
    """Readings below 0.1 are entered as a value."""

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        y = mean + 0.4 * rng.normal(size=(runs, rows))
        return {"y": np.where(y < 0.1, value, y)}

    return drawn(problem("(a)", "(= y a) :sigma unknown"), draw, {"a": mean})


def _cut(low: float, high: float, a: float, b: float, sigma: float, noise: str) -> Kind:
    """An instrument stops at the ends of its scale, and nothing says so."""
    text = problem("(a) (b)", f"{LINE} :sigma {noise}")

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        return {"x": SCALE, "y": np.clip(a + b * SCALE + sigma * rng.normal(size=(runs, 15)), low, high)}

    return drawn(text, draw, {"a": a, "b": b})


def _steps(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    a = 5 + rng.random(runs)
    return {"d": table(runs, y=np.round(a[:, None] + 0.6 * rng.normal(size=(runs, 10))))}, {"a": a}


def _stock(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    """Standards made of one stock, whose content is known to 1 %, and a sample measured twice."""
    y = 0.2 + 2 * (1 + 0.01 * rng.normal(size=(runs, 1))) * STANDARDS + 0.03 * rng.normal(size=(runs, 5))
    return {"d": table(runs, x=STANDARDS, y=y), "u": table(runs, y=5.2 + 0.03 * rng.normal(size=(runs, 2)))}, {"c": 2.5}


def _dose(noise: str) -> Kind:
    """A substance that is absorbed and excreted."""
    true = 10 * 1.5 / 1.2 * (np.exp(-0.3 * HOURS) - np.exp(-1.5 * HOURS))
    model = "(* c (/ ka (- ka ke)) (- (exp (* -1 ke x)) (exp (* -1 ka x))))"
    text = problem("(c :init 8) (ka :init 2) (ke :init 0.2)", f"(= y {model}) :sigma {noise}", "(derive (s (/ c ke)))")
    return scatter(text, HOURS, true, normal(0.1 * true), {"ka": 1.5, "ke": 0.3, "s": 10 / 0.3})


def _two_groups(model: str, unknowns: str, quantity: float) -> Kind:
    """Successes among 25 treated, 40 % of whom succeed, and 25 others, of whom 20 % do."""
    first, second = (f"(= {name} {model.format(each)}) :distribution (binomial 25)" for name, each in ("au", "bv"))
    text = f"""(problem p (data d external) (unknowns {unknowns}) (observe one d {first}) (observe two d {second})
      (derive (r (- u v))))"""
    return drawn(
        text,
        lambda rng, runs: {"a": 1.0 * rng.binomial(25, 0.4, (runs, 1)), "b": 1.0 * rng.binomial(25, 0.2, (runs, 1))},
        {"r": quantity},
    )


def _survival(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    y = 2 + 0.6 * rng.normal(size=(runs, 20))
    return {"y": np.minimum(y, 2.3), "c": 1.0 * (y > 2.3)}


def _between(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    true = (10 - 0.2 * np.arange(9.0)) * np.where(TURN == 1.0, 1.3, 1.0)
    return {"t": np.arange(9.0), "s": TURN, "y": true * (1 + 0.004 * rng.normal(size=(runs, 9)))}


PEAK = "(+ p (* q x) (* h (exp (* -0.5 (^ (/ (- x c) w) 2)))))"
KINDS: Mapping[str, Kind] = {
    "standard additions": _additions(ADDED, 0.1),
    "standard additions, 3 rows, noisy": _additions(np.array([0.0, 2.0, 4.0]), 0.15),
    "standard additions, poor slope": _additions(ADDED, 0.8),
    "enzyme, unknown share of model": _kinetics(CONTENTS, 0.05, "(unknown model)", relative=True),
    "enzyme, far below saturation": _kinetics(CONTENTS[:6] / 2, 0.03, "0.03"),
    "enzyme, 5 rows, unknown noise": _kinetics(CONTENTS[1:6], 0.15, "unknown"),
    "area of a peak on a slope": scatter(
        problem(
            "(h :init 4) (c :init 0.2) (w :init 1) (p :init 0) (q :init 0)",
            f"(= y {PEAK}) :sigma unknown",
            "(derive (area (* h w 2.5066282746310002)))",
        ),
        CHANNELS,
        1 + 0.1 * CHANNELS + 5 * np.exp(-0.5 * (CHANNELS - 0.3) ** 2),
        normal(0.4),
        {"area": 5 * np.sqrt(2 * np.pi), "c": 0.3},
    ),
    "counts: exposures": _exposures(10.0, 50.0, 1.0, 0.5),
    "counts: exposures, few": _exposures(2.0, 10.0, 2.0, 0.5),
    "decay with offset, 8 rows, unknown noise": _decay(SHORT, "unknown"),
    "decay with offset, beginning alone": _decay(START, "0.1"),
    "crossing of two lines": _crossing(0.05),
    "crossing of two lines, noisy": _crossing(0.4),
    "maximum of a parabola": _maximum(0.5, 0.2),
    "maximum of a parabola, hardly bent": _maximum(0.2, 0.3),
    "limits on both sides": _both_limits("0.5"),
    "limits on both sides, unknown sigma": _both_limits("unknown"),
    "limit entered for readings below, 30 rows": _entered(0.1 / np.sqrt(2), 30, 0.4),
    "end of a scale": _cut(-np.inf, 9.0, 1.0, 1.0, 0.3, "unknown"),
    "line, shown as zero": _cut(0.0, np.inf, -0.5, 0.5, 0.4, "0.4"),
    "rounded, unknown sigma, said": Kind(problem("(a)", "(= y a) :sigma unknown :resolution 1"), _steps),
    "standards of one stock": Kind(
        """(problem p (data d external) (data u external) (constants (k 1 :sigma 0.01))
          (unknowns (z) (g :init 1) (c :init 2))
          (observe d (= y (+ z (* g k x))) :sigma (unknown 1 :as e))
          (observe u (= y (+ z (* g c))) :sigma (unknown 1 :as e)))""",
        _stock,
    ),
    "dose, 10 % of model": _dose("(* 10% model)"),
    "dose, unknown share of model": _dose("(unknown model)"),
    "odds ratio": _two_groups(
        "(/ 25 (+ 1 (exp (- {}))))", "(u :init 0) (v :init 0)", float(np.log(0.4 / 0.6 / 0.2 * 0.8))
    ),
    "difference of two shares": _two_groups("(* 25 {})", "(u :init 0.5 :in (0 1)) (v :init 0.5 :in (0 1))", 0.2),
    "survival, censored, unknown sigma": drawn(
        problem("(m :init 2)", "(= y m) :sigma unknown :above (= c 1)"), _survival, {"m": 2.0}
    ),
    "sample between standards": drawn(
        problem("(q :init 10) (v) (r :init 1)", "(= y (* (+ q (* v t)) (if (= s 1) r 1))) :sigma (unknown model)"),
        _between,
        {"r": 1.3},
    ),
}
