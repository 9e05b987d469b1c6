"""Constants with an uncertainty: quantities that bend with them, and laws that are not normal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import table

Draw = Callable[[np.random.Generator, int], Floats]


def _of_constants(stated: Sequence[tuple[float, float]], form: str, quantity: Callable[..., Floats]) -> Kind:
    """A quantity of constants `a`, `b` … alone, which differ from their values by what is stated."""
    named = " ".join(f"({name} {value} :sigma {u})" for name, (value, u) in zip("abc", stated, strict=False))

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        true = [value + u * rng.normal(size=runs) for value, u in stated]
        return {"d": table(runs, y=np.zeros((runs, 1)))}, {"q": quantity(*true)}

    return Kind(f"(problem p (data d external) (constants {named}) (derive (q {form})))", make)


def _factor(stated: str, draw: Draw, sigma: float, power: int = 1) -> Kind:
    """The mean of four readings times a power of a constant."""
    text = f"""(problem p (data d external) (constants (c 1 {stated})) (unknowns (a)) (observe d (= y a) :sigma unknown)
      (derive (q (* a (^ c {power})))))"""

    def make(rng: np.random.Generator, runs: int) -> tuple[Mapping[str, Any], Truth]:
        return {"d": table(runs, y=2 + sigma * rng.normal(size=(runs, 4)))}, {"q": 2 * draw(rng, runs) ** power}

    return Kind(text, make)


def _beside_noise(form: str, unknowns: str, u: float, count: int) -> Kind:
    """Readings of unknown noise at ``count`` places x, which a constant h of 0 ± ``u`` moves in a way they show."""
    text = f"""(problem p (data d external) (constants (h 0 :sigma {u})) (unknowns {unknowns})
      (observe d (= y {form}) :sigma unknown))"""
    x = np.arange(count) - 0.5 * (count - 1)

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        moved = u * rng.normal(size=(runs, 1)) * (x**2 if "(b)" in unknowns else x + 1.0)
        true = {"a": np.ones(runs), **({"b": np.full(runs, 2.0)} if "(b)" in unknowns else {})}
        y = sum(each[:, None] * part for each, part in zip(true.values(), (1.0, x), strict=False))
        return {"d": table(runs, x=np.tile(x, (runs, 1)), y=y + moved + 0.3 * rng.normal(size=(runs, count)))}, true

    return Kind(text, make)


KINDS: Mapping[str, Kind] = {
    "constants: product of three": _of_constants(
        [(1, 0.05), (2, 0.1), (3, 0.1)], "(* a b c)", lambda a, b, c: a * b * c
    ),
    "constants: ratio of two": _of_constants([(1, 0.5), (1, 0.3)], "(/ a b)", lambda a, b: a / b),
    "constants: square next to zero": _of_constants([(0.1, 0.5)], "(^ a 2)", np.square),
    "constants: sum of squares at zero": _of_constants(
        [(0, 0.005), (0, 0.005)], "(+ (* a a) (* b b))", lambda a, b: a * a + b * b
    ),
    "constants: radius of an area, 10 %": _factor(":sigma 0.1", lambda g, n: 1 + 0.1 * g.normal(size=n), 0.05, -2),
    "constants: radius of an area, 25 %": _factor(":sigma 0.25", lambda g, n: 1 + 0.25 * g.normal(size=n), 0.05, -2),
    "constants: rectangular": _factor(":prior (rectangular 0.5 1.5)", lambda g, n: 0.5 + g.random(n), 0.1),
    "constants: rectangular, a third": _factor(
        ":prior (rectangular 0.97 1.03)", lambda g, n: 0.97 + 0.06 * g.random(n), 0.1
    ),
    "constants: lognormal": _factor(":prior (lognormal 1 1.5)", lambda g, n: 1.5 ** g.normal(size=n), 0.1),
    "constants: slope, noise unknown": _beside_noise("(+ a (* h (+ x 1)))", "(a)", 0.3, 6),
    "constants: curvature, noise unknown": _beside_noise("(+ a (* b x) (* h x x))", "(a) (b)", 0.1, 6),
}
