"""Few anchors, poses of few points, shapes whose equations read nothing; blocks, limits, priors, outliers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import LINE, autoregressive, drawn, line, normal, problem, scatter, table, with_outliers

ANCHORS = np.array([[0.0, 0], [10, 0], [3, 9], [11, 8]])
CORNERS = np.array([[0.0, 0], [2, 0], [1, 1.5]])
HEIGHTS = np.array([0.0, 1.0, 0.5, -0.7, 0.4])
LEGS = np.array([[1, 2], [2, 3], [3, 4], [4, 5], [5, 1], [1, 3], [2, 5], [3, 5]])
TURN = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
ANGLES = np.deg2rad([50.0, 60.0, 70.0])
DECAY = np.exp(-np.linspace(0.0, 5.0, 15))
FIVE = np.linspace(0.0, 1.0, 5)


def _ranges(count: int, sigma: float, noise: str, start: str = ":init [4 4]") -> Kind:
    x, y = ANCHORS[:count].T
    true = np.hypot(x - 4, y - 3)
    return drawn(
        problem(f"(p (vector 2) {start})", f"(= r (distance p [x y])) :sigma {noise}"),
        lambda rng, runs: {"x": x, "y": y, "r": true + sigma * rng.normal(size=(runs, count))},
        {"p": np.array([[4.0, 3.0]])},
    )


def _placed(count: int, sigma: float, noise: str, kind: str = "pose", scale: float = 1.0) -> Kind:
    """Where a point comes to lie by a motion of the plane that a few points tell."""
    x, y = CORNERS[:count].T
    true = scale * CORNERS[:count] @ TURN.T + [1.0, 2.0]

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        found = true + sigma * rng.normal(size=(runs, count, 2))
        return {"x": x, "y": y, "u": found[..., 0], "v": found[..., 1]}

    text = problem(
        f"(T ({kind} 2))", f"(= [u v] (transform T [x y])) :sigma {noise}", "(derive (q (transform T [5 5])))"
    )
    return drawn(text, draw, {"q": (scale * TURN @ [5.0, 5.0] + [1.0, 2.0])[None]})


def _arc(count: int, first: float, last: float) -> Kind:
    """Distances of points from a circle of ten metres, between two angles in degrees."""
    angle = np.deg2rad(np.linspace(first, last, count))

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        x, y = (0.02 * rng.normal(size=(runs, count)) for _ in range(2))
        return {"x": 1 + 10 * np.cos(angle) + x, "y": 2 + 10 * np.sin(angle) + y}

    text = problem("(p :init 1) (q :init 2) (r :init 10)", "(= 0 (- (hypot (- x p) (- y q)) r)) :sigma unknown")
    return drawn(text, draw, {"p": 1.0, "q": 2.0, "r": 10.0})


def _straight(count: int) -> Kind:
    """Distances of points from a line, by its angle and distance from the origin."""
    along = np.linspace(-3.0, 3.0, count)

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        off = 2 + 0.1 * rng.normal(size=(runs, count))
        return {"x": np.cos(0.5) * off - np.sin(0.5) * along, "y": np.sin(0.5) * off + np.cos(0.5) * along}

    text = problem("(f angle :init 0.5) (r)", "(= 0 (- (+ (* x (cos f)) (* y (sin f))) r)) :sigma unknown")
    return drawn(text, draw, {"f": 0.5, "r": 2.0})


def _levelling(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    rise = HEIGHTS[LEGS[:, 1] - 1] - HEIGHTS[LEGS[:, 0] - 1]
    return {"i": 1.0 * LEGS[:, 0], "j": 1.0 * LEGS[:, 1], "d": rise + 0.01 * rng.normal(size=(runs, 8))}


def _parallel(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    """Two resistors beside one standard, which is not quite what it is said to be."""
    standard = 100 + 0.1 * rng.normal(size=(runs, 1))
    u, v = (each / standard + 1e-3 * rng.normal(size=(runs, 5)) for each in (120.0, 220.0))
    return {"d": table(runs, u=u, v=v)}, {"a": 120.0, "b": 220.0, "r": 120 * 220 / 340}


def _blocks(count: int, rows: int, between: float) -> Kind:
    """A slope within blocks, each of which has an error of its own."""
    block, x = np.repeat(np.arange(1, count + 1), rows), np.tile(np.linspace(0.0, 1.0, rows), count)

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        own = between * rng.normal(size=(runs, count))[:, block - 1]
        y = 10 + 2 * x + own + 0.3 * rng.normal(size=(runs, len(x)))
        tables = {"d": table(runs, g=1.0 * block, x=x, y=y), "blocks": table(runs, g=np.arange(1.0, count + 1))}
        return tables, {"m": 10.0, "s": 2.0}

    text = f"""(problem p (data d external) (data blocks external) (unknowns (m) (s) (b (vector {count})))
      (observe d (= y (+ m (* s x) (b g))) :sigma unknown) (observe blocks (= 0 (b g)) :sigma unknown))"""
    return Kind(text, make)


def _below(rows: int, noise: str) -> Kind:
    """A line, of whose readings a limit of detection hides some."""
    x = np.linspace(0.0, 1.0, rows)

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        y = 1 + 2 * x + 0.3 * rng.normal(size=(runs, rows))
        return {"x": x, "y": np.maximum(y, 1.6), "c": 1.0 * (y < 1.6)}

    text = problem("(a :init 1) (b :init 1)", f"{LINE} :sigma {noise} :below (= c 1)")
    return drawn(text, draw, {"a": 1.0, "b": 2.0})


def _slope(prior: str, draw: Callable[[np.random.Generator, int], Floats]) -> Kind:
    """A slope drawn from its prior, and five readings."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        b = draw(rng, runs)
        return {"d": table(runs, x=FIVE, y=1 + b[:, None] * FIVE + 0.3 * rng.normal(size=(runs, 5)))}, {
            "a": 1.0,
            "b": b,
        }

    return Kind(problem(f"(a) (b :prior {prior})", f"{LINE} :sigma 0.3"), make)


def _triangle(times: int, noise: str) -> Kind:
    which = np.tile(np.arange(1, 4), times)
    return drawn(
        problem(
            "(w (vector 3) :init [1 1 1])",
            f"(= y (w k)) :sigma {noise}",
            "(constraints (= (+ (w 1) (w 2) (w 3)) 180deg))",
        ),
        lambda rng, runs: {"k": 1.0 * which, "y": ANGLES[which - 1] + 0.01 * rng.normal(size=(runs, 3 * times))},
        {"w": ANGLES[None]},
    )


def _gross(rows: int, share: float, noise: str, more: str = "") -> Kind:
    """A line with a ``share`` of outliers, of forty times the noise."""
    x = np.linspace(0.0, 1.0, rows)
    return line(problem("(a) (b)", f"{LINE} :sigma {noise}", more), x, with_outliers(share, 40.0, 0.1))


LMEDS, TRUNCATED = "(solve :robust lmeds)", "(solve :robust (gnc :quantile 99%))"
KINDS: Mapping[str, Kind] = {
    "ranges from 2 anchors": _ranges(2, 0.1, "0.1"),
    "ranges from 3 anchors, unknown noise": _ranges(3, 0.1, "unknown"),
    "ranges from 3 anchors, coarse, no start": _ranges(3, 1.0, "1", ""),
    "ranges from 4 anchors, coarse, unknown noise, no start": _ranges(4, 1.5, "unknown", ""),
    "pose of the plane, 2 points, unknown noise": _placed(2, 0.05, "unknown"),
    "pose of the plane, 3 points, coarse": _placed(3, 0.4, "0.4"),
    "similarity of the plane, 3 points, unknown noise": _placed(3, 0.05, "unknown", "similarity", 2.0),
    "distances from a circle, 8 points on 60°": _arc(8, 10.0, 70.0),
    "distances from a circle, 40 points on 20°": _arc(40, 10.0, 30.0),
    "distances from a line, 8 points": _straight(8),
    "distances from a line, 40 points": _straight(40),
    "levelling, 5 heights, 8 legs": drawn(
        problem(
            "(h (vector 5) :fixed [true false false false false] :init 0)",
            "(= d (- (h j) (h i))) :sigma unknown",
            "(derive (top (h 2)) (foot (h 4)) (last (h 5)))",
        ),
        _levelling,
        {"top": 1.0, "foot": -0.7, "last": 0.4},
    ),
    "resistances in parallel, one standard": Kind(
        """(problem p (data d external) (constants (s 100 :sigma 0.1)) (unknowns (a :init 100) (b :init 200))
          (observe one d (= u (/ a s)) :sigma 0.001) (observe two d (= v (/ b s)) :sigma 0.001)
          (derive (r (/ (* a b) (+ a b)))))""",
        _parallel,
    ),
    "slope in 6 blocks of 5": _blocks(6, 5, 1.0),
    "slope in 3 blocks of 4": _blocks(3, 4, 1.0),
    "slope in 4 blocks of 4, hardly different": _blocks(4, 4, 0.05),
    "line, 15 rows, a third below a limit": _below(15, "0.3"),
    "line, 15 rows, a third below a limit, unknown sigma": _below(15, "unknown"),
    "line, 15 rows, neighbours correlated 0.5": line(
        problem("(a) (b)", f"{LINE} :sigma unknown"), np.linspace(0.0, 1.0, 15), autoregressive(0.5, 0.1)
    ),
    "mean of 40, ar1 0.7, known": scatter(
        problem("(a)", "(= y a) :sigma unknown :correlation (ar1 0.7)"),
        np.zeros(40),
        np.full(40, 2.0),
        autoregressive(0.7, 0.1),
        {"a": 2.0},
    ),
    "slope with rectangular prior": _slope("(rectangular 1 3)", lambda rng, runs: 1 + 2 * rng.random(runs)),
    "slope with triangular prior": _slope("(triangular 1 3)", lambda rng, runs: rng.triangular(1, 2, 3, runs)),
    "slope with student prior": _slope("(student 2 0.3 3)", lambda rng, runs: 2 + 0.3 * rng.standard_t(3, runs)),
    "slope with lognormal prior": _slope("(lognormal 2 1.3)", lambda rng, runs: 2 * 1.3 ** rng.normal(size=runs)),
    "amplitude that is positive, unknown noise": scatter(
        problem("(a positive :init 0.1) (b)", "(= y (+ b (* a (exp (* -1 x))))) :sigma unknown"),
        np.linspace(0.0, 5.0, 15),
        1 + 0.1 * DECAY,
        normal(0.2),
        {"a": 0.1, "b": 1.0},
    ),
    "share near 1, 8 rows": scatter(
        problem("(p :in (0 1))", "(= y p) :sigma unknown"), np.zeros(8), np.full(8, 0.97), normal(0.1), {"p": 0.97}
    ),
    "triangle, one reading each, unknown noise": _triangle(1, "unknown"),
    "triangle, three readings each, unknown noise": _triangle(3, "unknown"),
    "huber, 8 rows, 5 % outliers": _gross(8, 0.05, "0.1 :loss (huber 1.345)"),
    "huber, unknown noise, 15 rows, 5 % outliers": _gross(15, 0.05, "unknown :loss (huber 1.345)"),
    "tukey, 15 rows, 15 % outliers": _gross(15, 0.15, "0.1 :loss tukey"),
    "cauchy, 8 rows, 5 % outliers": _gross(8, 0.05, "0.1 :loss cauchy"),
    "consensus, 15 rows, 15 % outliers": _gross(15, 0.15, "0.1", LMEDS),
    "consensus, 20 rows, 30 % outliers": _gross(20, 0.3, "0.1", LMEDS),
    "consensus, unknown noise, 15 rows, 30 % outliers": _gross(15, 0.3, "unknown", LMEDS),
    "truncated least squares, 15 rows, 15 % outliers": _gross(15, 0.15, "0.1", TRUNCATED),
}
