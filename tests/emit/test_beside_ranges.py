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

COUNT = 12
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


def answered(folder: Path, target: str, *, tested: bool = True) -> str:
    """What a generated solver says of its data; its own test, against `mbm solve`, passes."""
    if target == "c":
        made = make(folder, "all", *(["test"] if tested else []), watched=False)
        assert made.returncode == 0, made.stdout + made.stderr
        return run("./places", "data/d.csv", folder=folder).stdout
    done = run("python", "test_places.py", folder=folder) if tested else None
    assert done is None or done.returncode == 0, done.stdout + done.stderr
    return run("python", "places.py", "data/d.csv", folder=folder).stdout


@pytest.mark.parametrize("target", ["c", "python"])
@pytest.mark.parametrize("name", KINDS)
def test_the_lowest_minimum_is_the_answer(name: str, target: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    values, truth = drawn(kind)
    folder = written(of_text(text_of(kind, values), target), tmp_path)
    # Another way leads to the same minimum: it ends within 1e-9 deviations, which is what the solver's own test allows.
    found = estimates(answered(folder, target, tested=False))
    wanted = np.array([lowest(kind, line, true) for line, true in zip(values, truth, strict=True)])
    # MINPACK's and TRF's differences leave 1e-7 of a deviation or so; both sides of a line are whole metres apart.
    np.testing.assert_allclose(found, wanted[:, :-1], atol=1e-5)


@pytest.mark.parametrize("target", ["c", "python"])
@pytest.mark.parametrize("init", [":init [4 4 1]", ""])
def test_of_two_sides_that_fit_alike_it_is_that_of_mbm(init: str, target: str, tmp_path: Path) -> None:
    """All stations are in one plane: rounding alone says which side costs less."""
    generator = np.random.default_rng(3)
    at = np.array([[0, 0, 3], [5, 1, 3], [9, 7, 3], [1, 8, 3], [4, 4, 3.0]])
    rows = []
    for number in range(COUNT):
        truth = np.append(generator.uniform(0, 8, 2), generator.uniform(0.8, 2.0))
        for station in at:
            r = np.linalg.norm(station - truth) + SIGMA * generator.normal()
            rows.append(f"({number} {' '.join(map(str, station))} {r:.17g})")
    text = (
        f"(problem places (data d (table (run x y z r) {' '.join(rows)})) (unknowns (p (vector 3) {init}))"
        f" (observe d (= r (distance p [x y z])) :sigma {SIGMA}) (for-each run))"
    )
    found = estimates(answered(written(of_text(text, target), tmp_path), target))
    assert (found[:, 2] < 3).all()  # where the start is; without one, the side below comes first


@pytest.mark.parametrize("target", ["c", "python"])
@pytest.mark.parametrize("init", [(":init 4", ":init -9"), ("", "")])
def test_a_height_from_the_data_is_that_of_each_data_set(init: tuple[str, str], target: str, tmp_path: Path) -> None:
    generator = np.random.default_rng(5)
    at, rows = AT["ceiling"], []
    for number in range(COUNT):
        truth = np.append(generator.uniform(0, 8, 2), generator.uniform(0.5, 2.5))
        for station in at:
            r = np.linalg.norm(station - truth) + SIGMA * generator.normal()
            rows.append(f"({number} {' '.join(map(str, station))} {r:.17g} {truth[-1]:.17g})")
    text = (
        f"(problem places (data d (table (run x y z r h) {' '.join(rows)}))"
        f" (unknowns (u {init[0]}) (v {init[1]}) (w :init (first d h) :fixed true))"
        f" (observe d (= r (distance [u v w] [x y z])) :sigma {SIGMA}) (for-each run))"
    )
    found = estimates(answered(written(of_text(text, target), tmp_path), target))
    assert (found[:, 1] > -1).all()  # the wrong side is below


@pytest.mark.parametrize("target", ["c", "python"])
def test_a_start_without_a_value_is_left_for_the_ranges(target: str, tmp_path: Path) -> None:
    kind = KINDS["nearly in line"]
    values, truth = drawn(kind)
    text = text_of(kind, values).replace("[4 -3]", "[1e200 1]")
    found = estimates(answered(written(of_text(text, target), tmp_path), target))
    wanted = np.array([lowest(kind, line, true) for line, true in zip(values, truth, strict=True)])
    np.testing.assert_allclose(found, wanted[:, :-1], atol=1e-5)
