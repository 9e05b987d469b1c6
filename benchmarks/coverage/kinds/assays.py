"""What else laboratories try: assays, standards, weighings, few counts, comparisons with an outlier."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import drawn, problem, table

EIGHT = np.linspace(1.0, 8.0, 8)
SPREAD = np.linspace(0.3, 0.1, 8)
KELVIN = np.repeat([300.0, 330.0], 3)
GAS = 8.314
DRIFT = np.arange(8.0)
ITEM = np.array([0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0])
DOSE = np.repeat(np.geomspace(0.01, 100.0, 8), 2)
BATCH = np.repeat([1.0, 2.0, 3.0], 3)
NINE = np.linspace(0.0, 4.0, 9)
LABS = np.linspace(0.5, 1.5, 8)


def _deming(sigma: Floats) -> Kind:
    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        x, y = EIGHT + sigma * rng.normal(size=(runs, 8)), 2 * EIGHT - 1 + 2 * sigma * rng.normal(size=(runs, 8))
        return {"x": x, "y": y, "u": sigma}

    text = problem("(a) (b :init 1)", "(= y (+ a (* b x))) :errors ((x u) (y (* 2 u)))")
    return drawn(text, draw, {"a": -1.0, "b": 2.0})


def _deming_unknown(sigma: Floats) -> Kind:
    """The errors of x are stated, the noise of y is not."""

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        x, y = EIGHT + sigma * rng.normal(size=(runs, 8)), 2 * EIGHT - 1 + 0.4 * rng.normal(size=(runs, 8))
        return {"i": np.arange(8.0), "x": x, "y": y, "u": sigma}

    text = """(problem p (data d external) (unknowns (a) (b) (t (vector 8)))
      (observe xs d (= x (t (+ i 1))) :sigma u) (observe ys d (= y (+ a (* b (t (+ i 1))))) :sigma unknown))"""
    return drawn(text, draw, {"a": -1.0, "b": 2.0})


def _dilution(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    """Isotope dilution: a spike of certified content, whose ratio and that of the sample are known, and five ratios."""
    sample, spike = 10.0, 0.05
    content = 2.0 + 0.01 * rng.normal(size=runs)
    true = 3.0
    blend = (true * sample + content * spike * 1.0) / (true + content)  # ratios of equal reference isotopes
    return {"d": table(runs, r=blend[:, None] * (1 + 0.01 * rng.normal(size=(runs, 5))))}, {"c": true}


def _arrhenius(share: float, noise: str) -> Kind:
    """Rate constants at two temperatures, three times each, and the rate at a third."""
    true = np.exp(20.0 - 50e3 / GAS / KELVIN)

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        return {"t": KELVIN, "k": true * (1 + share * rng.normal(size=(runs, 6)))}

    model = "(exp (- l (/ e 8.314 t)))"
    more = "(derive (k20 (exp (- l (/ e 8.314 293)))))"
    return drawn(
        problem("(l :init 20) (e :init 50000)", f"(= k {model}) :sigma {noise}", more),
        draw,
        {"e": 50e3, "k20": float(np.exp(20.0 - 50e3 / GAS / 293))},
    )


def _weighing(sigma: float) -> Kind:
    """A standard and an item in turn, A B B A A B B A, on a balance that drifts."""

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        return {"t": DRIFT, "b": ITEM, "y": 100 + 0.05 * DRIFT + 0.3 * ITEM + sigma * rng.normal(size=(runs, 8))}

    return drawn(problem("(z) (m) (v)", "(= y (+ z (* v t) (* m b))) :sigma unknown"), draw, {"m": 0.3, "v": 0.05})


def _bracket(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    """One bracket A B B A: four readings, three numbers."""
    return {
        "t": DRIFT[:4],
        "b": ITEM[:4],
        "y": 100 + 0.05 * DRIFT[:4] + 0.3 * ITEM[:4] + 0.01 * rng.normal(size=(runs, 4)),
    }


def _immunoassay(sigma: float, used: int) -> Kind:
    """A logistic curve of four parameters from 16 wells, and an unknown sample in a few."""
    true = 0.1 + 2.0 / (1 + (DOSE / 1.0) ** -1.2)

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        y = true + sigma * rng.normal(size=(runs, len(DOSE)))
        own = 0.1 + 2.0 / (1 + 2.0**-1.2) + sigma * rng.normal(size=(runs, used))
        return {"d": table(runs, x=np.log(DOSE), y=y), "s": table(runs, y=own)}, {"f": float(np.log(2.0))}

    def curve(x: str) -> str:
        return f"(+ low (/ high (+ 1 (exp (* -1 h (- {x} m))))))"

    text = f"""(problem p (data d external) (data s external)
      (unknowns (low :init 0) (high :init 2) (h :init 1) (m :init 0) (f :init 0))
      (observe d (= y {curve("x")}) :sigma (unknown 1 :as e))
      (observe s (= y {curve("f")}) :sigma (unknown 1 :as e)))"""
    return Kind(text, make)


def _horwitz(rows: int, noise: str) -> Kind:
    """Noise in proportion to the content to the power of 0.85."""
    true = np.geomspace(1.0, 20.0, rows)

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        return {"x": true, "y": true * 0.9 + 0.1 * (0.9 * true) ** 0.8495 * rng.normal(size=(runs, rows))}

    return drawn(problem("(b :init 1)", f"(= y (* b x)) :sigma {noise}"), draw, {"b": 0.9})


def _outlying(noise: str) -> Kind:
    """Eight laboratories, one of which is 8 of its standard deviations off."""

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        y = 10 + LABS * rng.normal(size=(runs, 8))
        y[:, 3] += 8 * LABS[3]
        return {"u": LABS, "y": y}

    return drawn(problem("(m)", f"(= y m) {noise}"), draw, {"m": 10.0})


def _few(first: float, second: float) -> Kind:
    text = """(problem p (data d external) (unknowns (a :init 10) (b :init 10))
      (observe one d (= n a) :distribution poisson) (observe two d (= k b) :distribution poisson)
      (derive (r (/ a b))))"""
    return drawn(
        text,
        lambda rng, runs: {"n": 1.0 * rng.poisson(first, (runs, 1)), "k": 1.0 * rng.poisson(second, (runs, 1))},
        {"r": first / second},
    )


def _blank(text: str, *, clipped: bool) -> Kind:
    """Six blanks about zero, of which an instrument shows those below zero as 0, and four readings of a sample."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        blank, own = 0.02 + 0.1 * rng.normal(size=(runs, 6)), 0.17 + 0.1 * rng.normal(size=(runs, 4))
        low, under = blank < 0.0, own < 0.0
        if clipped:
            blank, own = np.maximum(blank, 0.0), np.maximum(own, 0.0)
        return {"b": table(runs, y=blank, c=1.0 * low), "d": table(runs, y=own, c=1.0 * under)}, {"s": 0.15}

    return Kind(text, make)


def _standards(noise: str) -> Kind:
    """A quadratic calibration by three batches of standards, each with an error of its own, and a point read off it."""

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        common = 0.05 * rng.normal(size=(runs, 3))[:, BATCH.astype(int) - 1]
        y = 1 + 2 * NINE - 0.1 * NINE**2 + common + 0.03 * rng.normal(size=(runs, 9))
        return {"x": NINE, "y": y, "batch": BATCH}

    return drawn(
        problem(
            "(a) (b) (c)",
            f"(= y (+ a (* b x) (* c x x))) :sigma {noise} :common ((0.05 :per batch))",
            "(derive (f (+ a (* 1.7 b) (* 1.7 1.7 c))))",
        ),
        draw,
        {"b": 2.0, "f": 1 + 3.4 - 0.289},
    )


BLANKED = """(problem p (data b external) (data d external) (unknowns (z :init 0.1) (s :init 0.1))
  (observe b (= y z) :sigma {noise}{below}) (observe d (= y (+ z s)) :sigma {noise}{below}) {more})"""
ONE = "(unknown 0.1 :as e)"
KINDS: Mapping[str, Kind] = {
    "deming, errors by row": _deming(SPREAD),
    "deming, unknown noise of y": _deming_unknown(SPREAD),
    "isotope dilution": Kind(
        """(problem p (data d external) (constants (w 2 :sigma 0.01)) (unknowns (c :init 2))
          (observe d (= r (/ (+ (* 10 c) (* 0.05 w)) (+ c w))) :sigma (unknown r)))""",
        _dilution,
    ),
    "arrhenius, two temperatures, 5 %": _arrhenius(0.05, "(* 5% model)"),
    "arrhenius, two temperatures, unknown share": _arrhenius(0.05, "(unknown model)"),
    "weighing, two brackets": _weighing(0.01),
    "weighing, one bracket": drawn(
        problem("(z) (m) (v)", "(= y (+ z (* v t) (* m b))) :sigma unknown"), _bracket, {"m": 0.3}
    ),
    "immunoassay, 3 wells": _immunoassay(0.05, 3),
    "immunoassay, 1 well, noisy": _immunoassay(0.15, 1),
    "horwitz, 4 rows": _horwitz(4, "(* 0.1 (^ model 0.8495))"),
    "horwitz, 4 rows, unknown factor": _horwitz(4, "(unknown (^ model 0.8495))"),
    "horwitz, 3 rows, by reading": _horwitz(3, "(unknown (^ y 0.8495))"),
    "8 laboratories, one outlier": _outlying(":sigma u"),
    "8 laboratories, one outlier, student 4": _outlying(":sigma u :distribution (student 4)"),
    "8 laboratories, one outlier, unknown factor": _outlying(":sigma (unknown u)"),
    "ratio of two counts, 8 and 15": _few(8.0, 15.0),
    "ratio of two counts, 3 and 4": _few(3.0, 4.0),
    "blank, limited": _blank(BLANKED.format(noise=ONE, below="", more="(constraints (>= s 0))"), clipped=False),
    "blank, shown as zero": _blank(BLANKED.format(noise=ONE, below="", more=""), clipped=True),
    "blank, shown as zero, said": _blank(BLANKED.format(noise="0.1", below=" :below (= c 1)", more=""), clipped=True),
    "standards with a common part": _standards("0.03"),
    "standards with a common part, unknown noise": _standards("unknown"),
}
