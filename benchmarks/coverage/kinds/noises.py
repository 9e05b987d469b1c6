"""Several unknown noises, nested designs, results of laboratories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.coverage.judging import Kind, Tables, Truth
from benchmarks.coverage.making import LINE, problem, table


def _instruments(rows: Sequence[int], noise: Sequence[float], *, sloped: bool = False, stated: str = "") -> Kind:
    model = LINE if sloped else "(= y a)"
    clauses = " ".join(
        f"(observe i{i} d {model} :sigma {stated if stated and i == 1 else 'unknown'} :when (= i {i}))"
        for i in range(1, len(rows) + 1)
    )
    text = f"(problem p (data d external) (unknowns (a){' (b)' if sloped else ''}) {clauses})"
    x = np.concatenate([np.linspace(0.0, 1.0, count) for count in rows])
    sigma, i = np.repeat(noise, rows), np.repeat(np.arange(1.0, len(rows) + 1), rows)
    true = 2.0 + (3.0 * x if sloped else 0.0)

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        y = true + sigma * rng.normal(size=(runs, len(x)))
        return {"d": table(runs, x=x, i=i, y=y)}, {"a": 2.0, "b": 3.0} if sloped else {"a": 2.0}

    return Kind(text, make)


def _days(rows: Sequence[int], between: float) -> Kind:
    """Readings on some days, each of which has an error of its own."""
    count = len(rows)
    text = f"""(problem p (data d external) (data days external) (unknowns (m) (b (vector {count})))
      (observe d (= y (+ m (b day))) :sigma unknown)
      (observe days (= 0 (b day)) :sigma unknown))"""
    day = np.repeat(np.arange(1.0, count + 1), rows)

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        own = between * rng.normal(size=(runs, count))
        y = 10 + own[:, day.astype(int) - 1] + rng.normal(size=(runs, len(day)))
        return {"d": table(runs, day=day, y=y), "days": table(runs, day=np.arange(1.0, count + 1))}, {"m": 10.0}

    return Kind(text, make)


def _laboratories(count: int, dark: float, model: str) -> Kind:
    """Results of laboratories, which state their uncertainties u, with a dark part besides, or scaled by one factor."""
    u = np.linspace(0.5, 2.0, count)
    scaled = problem("(m)", "(= y m) :sigma (unknown u)")
    effects = f"""(problem p (data d external) (unknowns (m) (b (vector {count})))
      (observe d (= y (+ m (b lab))) :sigma u)
      (observe dark d (= 0 (b lab)) :sigma unknown))"""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        sigma = np.sqrt(u**2 + dark**2) if model == "dark" else dark * u
        y = 10 + sigma * rng.normal(size=(runs, count))
        return {"d": table(runs, lab=np.arange(1.0, count + 1), u=u, y=y)}, {"m": 10.0}

    return Kind(effects if model == "dark" else scaled, make)


KINDS: Mapping[str, Kind] = {
    "two instruments, 2 × 4": _instruments((4, 4), (1.0, 1.0)),
    "two instruments, 2 × 4, one to five": _instruments((4, 4), (1.0, 5.0)),
    "two instruments, 2 × 3": _instruments((3, 3), (1.0, 1.0)),
    "two instruments, 2 × 6": _instruments((6, 6), (1.0, 1.0)),
    "two instruments, 2 × 10": _instruments((10, 10), (1.0, 2.0)),
    "two instruments, 2 × 25": _instruments((25, 25), (1.0, 3.0)),
    "two instruments, 4 and 20": _instruments((4, 20), (1.0, 1.0)),
    "three instruments, 3 × 2": _instruments((2, 2, 2), (1.0, 1.0, 1.0)),
    "five instruments, 5 × 5": _instruments((5,) * 5, (1.0, 2.0, 3.0, 1.0, 2.0)),
    "two instruments on a line, 2 × 5": _instruments((5, 5), (1.0, 3.0), sloped=True),
    "two instruments on a line, 2 × 12": _instruments((12, 12), (1.0, 3.0), sloped=True),
    "stated and unknown noise, 4 and 4": _instruments((4, 4), (1.0, 1.0), stated="1"),
    "stated and unknown noise, 15 and 15": _instruments((15, 15), (1.0, 2.0), stated="1"),
    "days, 4 × 3": _days((3,) * 4, 2.0),
    "days, 8 × 2": _days((2,) * 8, 2.0),
    "days, 5 × 3, hardly different": _days((3,) * 5, 0.3),
    "days, unbalanced": _days((2, 3, 4, 5, 6, 7), 2.0),
    "6 laboratories, one factor": _laboratories(6, 2.0, "factor"),
    "3 laboratories, dark uncertainty": _laboratories(3, 2.0, "dark"),
    "4 laboratories, dark uncertainty": _laboratories(4, 2.0, "dark"),
    "5 laboratories, dark uncertainty": _laboratories(5, 2.0, "dark"),
    "6 laboratories, dark uncertainty": _laboratories(6, 2.0, "dark"),
    "6 laboratories, hardly any dark uncertainty": _laboratories(6, 0.5, "dark"),
    "4 laboratories, hardly any dark uncertainty": _laboratories(4, 0.5, "dark"),
    "8 laboratories, dark uncertainty": _laboratories(8, 2.0, "dark"),
    "12 laboratories, dark uncertainty": _laboratories(12, 2.0, "dark"),
    "12 laboratories, hardly any dark uncertainty": _laboratories(12, 0.5, "dark"),
}
