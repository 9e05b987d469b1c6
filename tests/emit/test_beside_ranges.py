"""Generated solvers compare a start with the ranges: each kind against SciPy's lowest minimum from a fan of starts."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.emit.making import make, of_text, run, written

COUNT = 25
SIGMA = 0.1
AT = {
    "line": np.array([[0, 0], [5, 0.3], [10, 0], [14, -0.2]]),
    "triangle": np.array([[0, 0], [5, 4.0], [10, 0]]),
    "ceiling": np.array([[0, 0, 3], [5, 1, 3.05], [9, 7, 2.9], [1, 8, 3], [4, 4, 3.1]]),
    "space": np.array([[0, 0, 0], [8, 1, 5], [9, 7, 1], [1, 8, 3], [4, 4, 9], [7, 2, 2]]),
}
"""Stations."""


@dataclass(frozen=True)
class Kind:
    """A kind of problem; ``residuals`` of the unknowns, of measured values (n,) and stations (n, d)."""

    stations: str
    unknowns: str
    equation: str
    residuals: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    measured: Callable[[np.ndarray], np.ndarray] = lambda r: r
    lower: tuple[float, ...] | None = None
    known: float | None = None
    """The last coordinate, if it is no unknown."""
    noise: str = str(SIGMA)

    @property
    def size(self) -> int:
        return AT[self.stations].shape[1]


def distances(p: np.ndarray, at: np.ndarray) -> np.ndarray:
    return np.linalg.norm(at - p[: at.shape[1]], axis=1)


KINDS: Mapping[str, Kind] = {
    "nearly in line": Kind(
        "line", "(p (vector 2) :init [4 -3])", "(= r (distance p [x y]))", lambda p, r, at: distances(p, at) - r
    ),
    "without a start": Kind(
        "line", "(p (vector 2))", "(= r (distance p [x y]))", lambda p, r, at: distances(p, at) - r
    ),
    "unknown noise": Kind(
        "line",
        "(p (vector 2) :init [4 -3])",
        "(= r (distance p [x y]))",
        lambda p, r, at: distances(p, at) - r,
        noise="unknown",
    ),
    "ceiling": Kind(
        "ceiling",
        "(p (vector 3) :init [4 4 6])",
        "(= r (distance p [x y z]))",
        lambda p, r, at: distances(p, at) - r,
    ),
    "squares": Kind(
        "line",
        "(a :init 4) (b :init -3)",
        "(= (+ (^ (- a x) 2) (^ (- b y) 2)) r)",
        lambda p, r, at: distances(p, at) ** 2 - r,
        measured=np.square,
    ),
    "a common offset": Kind(
        "space",
        "(p (vector 3) :init [20 20 -20]) (o :init 0)",
        "(= r (+ (distance p [x y z]) o))",
        lambda p, r, at: distances(p, at) + p[-1] - r,
        measured=lambda r: r + 0.7,
    ),
    "a known height": Kind(
        "ceiling",
        "(u :init 4) (v :init -9)",
        "(= r (distance [u v 0.5] [x y z]))",
        lambda p, r, at: np.linalg.norm(at - [*p, 0.5], axis=1) - r,
        known=0.5,
    ),
    "a bound": Kind(
        "triangle",
        "(u :init 4 :in (-10 20)) (v :init 0.1 :in (0 20))",
        "(= r (distance [u v] [x y]))",
        lambda p, r, at: distances(p, at) - r,
        lower=(-10.0, 0.0),
    ),
}


def drawn(kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    """Measured values (COUNT, n) and what they should have been measured at (COUNT, d)."""
    generator, at = np.random.default_rng(7), AT[kind.stations]
    truth = generator.uniform(0, 8, size=(COUNT, kind.size))
    truth[:, -1] = generator.uniform(1.0, 2.5, COUNT) if kind.known is None else kind.known
    r = np.linalg.norm(at - truth[:, None], axis=2)
    scale = SIGMA * (2 * r if kind.equation.startswith("(= (+") else 1.0)
    return kind.measured(r) + scale * generator.normal(size=r.shape) * 0.5, truth


def text_of(kind: Kind, values: np.ndarray) -> str:
    at = AT[kind.stations]
    names = ("x", "y", "z")[: kind.size]
    rows = " ".join(
        f"({run} {' '.join(f'{number:.17g}' for number in station)} {value:.17g})"
        for run, line in enumerate(values, 1)
        for station, value in zip(at, line, strict=True)
    )
    return (
        f"(problem places (data d (table (run {' '.join(names)} r) {rows}))"
        f" (unknowns {kind.unknowns}) (observe d {kind.equation} :sigma {kind.noise}) (for-each run))"
    )


def lowest(kind: Kind, line: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The lowest minimum that SciPy finds."""
    at = AT[kind.stations]
    size = kind.size + ("(o " in kind.unknowns) - (kind.known is not None)
    below, above = np.ones(kind.size), np.zeros(kind.size)
    below[-1], above[-1] = -1.0, 6.0
    fan = [truth, 2 * at.mean(axis=0) - truth, truth * below, truth + above]
    ends = []
    for start in fan:
        begin = np.append(start, 0.5)[:size]
        box = (-np.inf, np.inf) if kind.lower is None else (np.array(kind.lower), np.inf)
        begin = begin if kind.lower is None else np.maximum(begin, np.array(kind.lower) + 1e-3)
        ends.append(
            least_squares(
                lambda p: kind.residuals(p, line, at) / SIGMA, begin, bounds=box, xtol=1e-14, ftol=1e-14, gtol=1e-14
            )
        )
    best = min(ends, key=lambda end: end.cost)
    return np.append(best.x, 2 * best.cost)


def estimates(output: str) -> np.ndarray:
    """The values (COUNT, unknowns) that a program prints."""
    found: dict[str, list[float]] = {}
    for line in csv.DictReader(io.StringIO(output)):
        found.setdefault(line["run"], []).append(float(line["value"]))
    return np.array(list(found.values()))


@pytest.mark.parametrize("target", ["c", "python"])
@pytest.mark.parametrize("name", KINDS)
def test_the_lowest_minimum_is_the_answer(name: str, target: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    values, truth = drawn(kind)
    folder = written(of_text(text_of(kind, values), target), tmp_path)
    if target == "c":
        made = make(folder)
        assert made.returncode == 0, made.stdout + made.stderr
        done = run("./places", "data/d.csv", folder=folder)
    else:
        done = run("python", "places.py", "data/d.csv", folder=folder)
    found = estimates(done.stdout)
    wanted = np.array([lowest(kind, line, true) for line, true in zip(values, truth, strict=True)])
    # MINPACK's and TRF's differences leave 1e-7 of a deviation or so; both sides of a line are whole metres apart.
    np.testing.assert_allclose(found, wanted[:, :-1], atol=1e-5)
