"""What surveyors and roboticists try: resections, few points of surfaces, times of arrival, filters, priors, losses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.kinds.geometric import euler
from benchmarks.coverage.making import LINE, autoregressive, drawn, line, normal, problem, scatter, table, with_outliers

MARKS = np.array([[0.0, 0.0], [10.0, 0.0], [4.0, 9.0], [-3.0, 6.0], [12.0, 7.0]])
CLOCKS = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [5.0, -2.0]])
FLOOR = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0.5], [2, 1], [1, 2], [2, 2]], dtype=np.float64)
LENGTHS = np.array([20.0, 50, 100, 150, 200, 300, 500, 700, 900, 1000])
EYE = euler(0.2, -0.1, 0.5)
ARM = np.array([0.1, 0.05, 0.2])
SEVEN = np.arange(15.0) * 0.5
PARTS = np.repeat(np.arange(1.0, 9.0), [2, 3, 2, 3, 2, 2, 3, 2])
DAYS = np.array([1.0, 1, 2, 3, 3, 4, 5, 5])


def _resection(count: int, sigma: float, noise: str) -> Kind:
    """Directions from an unknown place, in an unknown orientation, to known marks."""
    marks = MARKS[:count]
    true = np.arctan2(marks[:, 1] - 3, marks[:, 0] - 5) - 0.7
    text = problem(
        "(p (vector 2) :init [4 4]) (o angle :init 0.5)",
        f"(= (angle a) (- (atan2 (- y (p 2)) (- x (p 1))) o)) :sigma {noise}",
    )
    return drawn(
        text,
        lambda rng, runs: {"x": marks[:, 0], "y": marks[:, 1], "a": true + sigma * rng.normal(size=(runs, count))},
        {"p": np.array([[5.0, 3.0]])},
    )


def _triangulation(sigma: float, far: float) -> Kind:
    """Two stations a metre apart."""
    x = np.array([0.0, 1.0])
    text = problem(f"(p (vector 2) :init [0.4 {far}])", f"(= (angle a) (atan2 (p 2) (- (p 1) x))) :sigma {sigma}")
    true = np.arctan2(far, 0.4 - x)
    return scatter(text.replace("(angle a)", "(angle y)"), x, true, normal(sigma), {"p": np.array([[0.4, far]])})


def _plane(count: int, sigma: float) -> Kind:
    x, y = FLOOR[:count].T
    true = 1 + 0.3 * x - 0.2 * y
    return drawn(
        problem("(a) (b) (c)", "(= z (+ a (* b x) (* c y))) :sigma unknown", "(derive (w (atan2 (hypot b c) 1)))"),
        lambda rng, runs: {"x": x, "y": y, "z": true + sigma * rng.normal(size=(runs, count))},
        {"a": 1.0, "b": 0.3, "w": float(np.arctan(np.hypot(0.3, 0.2)))},
    )


def _round(directions: Floats, radius: float, noise: str) -> Kind:
    """A circle or sphere through a few points."""
    count, size = directions.shape
    middle = np.arange(1.0, size + 1)

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        found = middle + radius * directions + 0.05 * rng.normal(size=(runs, count, size))
        return dict(zip("xyz"[:size], np.moveaxis(found, 2, 0), strict=True))

    listed = " ".join(map(str, middle))
    text = problem(
        f"(p (vector {size}) :init [{listed}]) (r :init {radius})",
        f"(= r (distance [{' '.join('xyz'[:size])}] p)) :sigma {noise}",
    )
    return drawn(text, draw, {"p": middle[None], "r": radius})


def _arrivals(count: int, sigma: float, noise: str) -> Kind:
    """Times of arrival with an unknown clock."""
    x, y = CLOCKS[:count].T
    true = np.hypot(x - 3, y - 6) + 2
    return drawn(
        problem("(p (vector 2) :init [4 4]) (c)", f"(= t (+ c (distance p [x y]))) :sigma {noise}"),
        lambda rng, runs: {"x": x, "y": y, "t": true + sigma * rng.normal(size=(runs, count))},
        {"p": np.array([[3.0, 6.0]]), "c": 2.0},
    )


def _too_long(count: int, noise: str, more: str = "") -> Kind:
    """Ranges, 15 % of which are too long by half a metre to four."""
    x, y = np.random.default_rng(3).uniform(-10, 10, (count, 2)).T
    true = np.hypot(x - 1, y - 2)

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        shape = runs, count
        error = np.where(rng.random(shape) < 0.15, rng.uniform(0.5, 4, shape), 0.1 * rng.normal(size=shape))
        return {"x": x, "y": y, "r": true + error}

    text = problem("(p (vector 2) :init [0 0])", f"(= r (distance p [x y])) :sigma {noise}", more)
    return drawn(text, draw, {"p": np.array([[1.0, 2.0]])})


def _motions(noise: str) -> Kind:
    """Three motions of a hand are known, and those of the camera on it measured."""
    rng = np.random.default_rng(9)
    angles, places = rng.uniform(-1, 1, (3, 3)), rng.normal(size=(3, 3)) * 0.3
    turned = EYE @ np.stack([euler(*each) for each in angles]) @ EYE.T
    moved = places @ EYE.T + ARM - turned @ ARM

    def draw(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
        small = np.stack([euler(*each) for each in 0.01 * rng.normal(size=(3 * runs, 3))]).reshape(runs, 3, 3, 3)
        seen, at = turned @ small, moved + np.einsum("tij,rtj->rti", turned, 0.01 * rng.normal(size=(runs, 3, 3)))
        columns = {f"t{i}": places[:, i] for i in range(3)} | {f"e{i}": angles[:, i] for i in range(3)}
        columns |= {f"s{i}": at[..., i] for i in range(3)} | {"b": np.arcsin(-seen[..., 2, 0])}
        columns |= {
            "a": np.arctan2(seen[..., 2, 1], seen[..., 2, 2]),
            "c": np.arctan2(seen[..., 1, 0], seen[..., 0, 0]),
        }
        return columns

    model = "(compose X (pose3 (euler e0 e1 e2) [t0 t1 t2]) (inverse X))"
    text = problem(
        "(X (pose 3))", f"(= (pose3 (euler a b c) [s0 s1 s2]) {model}) :sigma {noise}", "(derive (t (translation X)))"
    )
    return drawn(text, draw, {"t": ARM[None]})


def _walk(method: str) -> Kind:
    """A random walk, and where it ends."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        steps = rng.normal(size=(runs, 12))
        steps[:, 1:] *= 0.1
        x = steps.cumsum(axis=1)
        return {"d": table(runs, t=np.arange(12.0), y=x + 0.2 * rng.normal(size=x.shape))}, {"e": x[:, -1]}

    return Kind(
        f"""(problem p (data d external) (states :over t (x :init 0 :sigma 1)) (dynamics (random-walk x :sigma 0.1))
          (observe d (= y x) :sigma 0.2) (derive (e (last d x))) (solve :method {method}))""",
        make,
    )


def _cart(method: str, beside: float) -> Kind:
    """The distance of a cart that begins ``beside`` the foot of the perpendicular."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        x, v = np.zeros((runs, 15)), np.zeros((runs, 15))
        x[:, 0], v[:, 0] = beside + 0.5 * rng.normal(size=runs), 1 + 0.5 * rng.normal(size=runs)
        for i in range(1, 15):
            a = 0.4 * rng.normal(size=runs)
            x[:, i], v[:, i] = x[:, i - 1] + 0.5 * v[:, i - 1] + 0.125 * a, v[:, i - 1] + 0.5 * a
        r = np.hypot(x, 2) + 0.05 * rng.normal(size=x.shape)
        return {"d": table(runs, t=SEVEN, r=r)}, {"e": x[:, -1], "f": v[:, -1]}

    return Kind(
        f"""(problem p (data d external) (states :over t (x :init {beside} :sigma 0.5))
          (dynamics (constant-velocity x :acceleration 0.4 :velocity 1 :velocity-sigma 0.5))
          (observe d (= r (hypot x 2)) :sigma 0.05) (derive (e (last d x)) (f (last d (rate x))))
          (solve :method {method}))""",
        make,
    )


def _bias(method: str) -> Kind:
    """A sensor with an unknown offset, and another one, coarse, at every fifth step."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        b, steps = 0.5 * rng.normal(size=runs), rng.normal(size=(runs, 20))
        steps[:, 1:] = 1 + 0.05 * steps[:, 1:]
        x = steps.cumsum(axis=1)
        seldom = np.where(np.arange(20) % 5 == 0, x + 0.3 * rng.normal(size=x.shape), np.nan)
        y = x + b[:, None] + 0.1 * rng.normal(size=x.shape)
        return {"d": table(runs, t=np.arange(20.0), y=y, z=seldom)}, {"e": x[:, -1], "b": b}

    return Kind(
        f"""(problem p (data d external) (unknowns (b :init 0 :sigma 0.5)) (states :over t (x :init 0 :sigma 1))
          (dynamics (= (next x) (+ x 1) :sigma 0.05)) (observe d (= y (+ x b)) :sigma 0.1)
          (observe g d (= z x) :sigma 0.3 :when (finite z)) (derive (e (last d x))) (solve :method {method}))""",
        make,
    )


def _nested(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    """Readings of runs within days, of both of which there are more and less."""
    day, part = DAYS[PARTS.astype(int) - 1], PARTS.astype(int) - 1
    days, parts = rng.normal(size=(runs, 5)), 0.7 * rng.normal(size=(runs, 8))
    y = 10 + days[:, day.astype(int) - 1] + parts[:, part] + 0.5 * rng.normal(size=(runs, len(day)))
    tables = {
        "d": table(runs, day=day, part=PARTS, y=y),
        "days": table(runs, day=np.arange(1.0, 6)),
        "parts": table(runs, part=np.arange(1.0, 9)),
    }
    return tables, {"m": 10.0}


def _prior(stated: str, draw: Callable[[np.random.Generator, int], Floats]) -> Kind:
    """Three readings of what has a prior, from which it is drawn."""

    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        a = draw(rng, runs)
        return {"d": table(runs, y=a[:, None] + 0.5 * rng.normal(size=(runs, 3)))}, {"a": a}

    return Kind(f"(problem p (data d external) (unknowns (a :prior {stated})) (observe d (= y a) :sigma 0.5))", make)


def _lossy(loss: str, rows: int, sigma: str) -> Kind:
    return line(problem("(a) (b)", f"{LINE} :sigma {sigma} :loss {loss}"), np.linspace(-1, 1, rows), normal(0.1))


def _alike(rows: int, rho: float, sigma: str) -> Kind:
    """The mean of a thermometer's readings."""
    text = problem("(a)", f"(= y a) :sigma {sigma} :correlation (ar1 unknown)")
    return scatter(text, np.zeros(rows), np.full(rows, 2.0), autoregressive(rho, 0.1), {"a": 2.0})


def _three(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    mixed = rng.normal(size=(runs, 6, 3)) @ np.array([[1, 0.5, -0.3], [0, 1, 0.4], [0, 0, 0.7]])
    return dict(zip("uvw", np.moveaxis(mixed + np.arange(1.0, 4.0), 2, 0), strict=True))


def _groups(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    g = np.repeat(np.arange(1.0, 6), 3)
    return {"g": g, "y": 2 + np.repeat(0.2 * rng.normal(size=(runs, 5)), 3, axis=1) + 0.1 * rng.normal(size=(runs, 15))}


def _sides(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    return {name: side + 0.05 * rng.normal(size=(runs, 2)) for name, side in (("x", 5.0), ("y", 5.0), ("z", 9.6))}


def _course(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    t = np.arange(6.0)
    return {"t": t, "x": 0.3 * t + 0.3 * rng.normal(size=(runs, 6)), "y": 0.1 * t + 0.3 * rng.normal(size=(runs, 6))}


def _refraction(rng: np.random.Generator, runs: int) -> Mapping[str, Any]:
    s = np.array([500.0, 800, 1200, 1500])
    bent = 1 - 0.13 - 0.05 * rng.normal(size=(runs, 1))
    return {"s": s, "y": 3 + s**2 * bent * 7.8e-8 + 0.003 * rng.normal(size=(runs, 4))}


def _around(count: int, most: float) -> Floats:
    angle = np.linspace(0, most, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _sphere(count: int) -> Floats:
    found = np.random.default_rng(5).normal(size=(count, 3))
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


HALF = "(let ((h (/ (+ a b c) 2))) (sqrt (* h (- h a) (- h b) (- h c))))"
KINDS: Mapping[str, Kind] = {
    "resection from three marks": _resection(3, 0.01, "0.01"),
    "resection from five marks, unknown noise": _resection(5, 0.01, "unknown"),
    "resection from three marks, coarse": _resection(3, 0.1, "0.1"),
    "triangulation": _triangulation(0.005, 2.0),
    "triangulation, far away": _triangulation(0.01, 15.0),
    "plane, 4 points, unknown noise": _plane(4, 0.05),
    "plane, 8 points, unknown noise, coarse": _plane(8, 0.5),
    "sphere, 6 points, unknown noise": _round(_sphere(6), 2.0, "unknown"),
    "sphere, 10 points": _round(_sphere(10), 2.0, "0.05"),
    "circle, 4 points": _round(_around(4, 4.5), 3.0, "0.05"),
    "circle, 5 points, a quarter, unknown noise": _round(_around(5, 1.57), 3.0, "unknown"),
    "times of arrival": _arrivals(5, 0.1, "0.1"),
    "times of arrival, 4 stations, unknown noise": _arrivals(4, 0.1, "unknown"),
    "times of arrival, 4 stations, coarse": _arrivals(4, 1.0, "1"),
    "ranges too long, cauchy": _too_long(12, "0.1 :loss cauchy"),
    "ranges too long, truncated least squares": _too_long(12, "0.1", "(solve :robust (gnc :quantile 99%))"),
    "ranges too long, unknown noise": _too_long(12, "unknown"),
    "baselines of a distance meter": scatter(
        problem("(a) (k)", "(= y (+ a (* x (+ 1 (* k 1e-6))))) :sigma unknown"),
        LENGTHS,
        LENGTHS * (1 + 5e-6) + 0.003,
        normal(0.001),
        {"a": 0.003, "k": 5.0},
    ),
    "hand and eye, 3 motions": _motions("0.01"),
    "hand and eye, 3 motions, unknown noise": _motions("(unknown 0.01)"),
    "walk, filter": _walk("ekf"),
    "walk, smoother": _walk("smoother"),
    "walk, batch": _walk("batch"),
    "cart, filter": _cart("iterated-ekf", 3.0),
    "cart, batch": _cart("batch", 3.0),
    "bias, filter": _bias("ekf"),
    "bias, smoother": _bias("smoother"),
    "mean of 15, ar1 0.5, unknown": _alike(15, 0.5, "unknown"),
    "mean of 30, ar1 0.8, unknown": _alike(30, 0.8, "unknown"),
    "mean of 25, ar1 0.5, stated sigma": _alike(25, 0.5, "0.1"),
    "days and runs, unbalanced": Kind(
        """(problem p (data d external) (data days external) (data parts external)
          (unknowns (m) (a (vector 5)) (b (vector 8))) (observe d (= y (+ m (a day) (b part))) :sigma unknown)
          (observe days (= 0 (a day)) :sigma unknown) (observe parts (= 0 (b part)) :sigma unknown))""",
        _nested,
    ),
    "prediction beyond the data": scatter(
        problem("(a) (b)", f"{LINE} :sigma unknown", "(derive (f (+ a (* b t))) :over (grid t 0 2 3))"),
        np.linspace(0, 1, 8),
        2 + 3 * np.linspace(0, 1, 8),
        normal(0.2),
        {"f": np.array([[2.0, 5.0, 8.0]])},
    ),
    "rectangular prior": _prior("(rectangular 0 2)", lambda rng, runs: 2 * rng.random(runs)),
    "triangular prior": _prior("(triangular 0 2)", lambda rng, runs: rng.triangular(0, 1, 2, runs)),
    "lognormal prior": _prior("(lognormal 1 2)", lambda rng, runs: np.exp(np.log(2) * rng.normal(size=runs))),
    "student prior": _prior("(student 1 0.5 4)", lambda rng, runs: 1 + 0.5 * rng.standard_t(4, runs)),
    "arcsine prior": _prior("(arcsine 0 2)", lambda rng, runs: 1 + np.sin(np.pi * (rng.random(runs) - 0.5))),
    "soft-l1, unknown noise, 10 rows": _lossy("soft-l1", 10, "unknown"),
    "soft-l1, unknown noise, 18 rows": _lossy("soft-l1", 18, "unknown"),
    "huber, unknown noise, 10 rows": _lossy("huber", 10, "unknown"),
    "cauchy, unknown noise, 10 rows": _lossy("cauchy", 10, "unknown"),
    "geman-mcclure, unknown noise, 14 rows": _lossy("geman-mcclure", 14, "unknown"),
    "huber, stated, 5 rows": _lossy("huber", 5, "0.1"),
    "tukey, stated, 8 rows": _lossy("tukey", 8, "0.1"),
    "truncated least squares, 12 rows": line(
        problem("(a) (b)", f"{LINE} :sigma 0.1", "(solve :robust (gnc :quantile 99%))"),
        np.linspace(0, 1, 12),
        with_outliers(0.1, 20, 0.1),
    ),
    "three quantities, unknown covariance, 6 rows": drawn(
        problem("(a) (b) (c)", "(= [u v w] [a b c]) :covariance unknown", "(derive (s (+ a b c)))"),
        _three,
        {"a": 1.0, "c": 3.0, "s": 6.0},
    ),
    "common part of groups, stated": drawn(
        problem("(a)", "(= y a) :sigma 0.1 :common ((0.2 :per g))"), _groups, {"a": 2.0}
    ),
    "area of a flat triangle": drawn(
        f"""(problem p (data d external) (unknowns (a :init 5) (b :init 5) (c :init 9.6))
          (observe d (= x a) :sigma 0.05) (observe e d (= y b) :sigma 0.05) (observe f d (= z c) :sigma 0.05)
          (derive (s {HALF})))""",
        _sides,
        {"s": float(np.sqrt(9.8 * 4.8 * 4.8 * 0.2))},
    ),
    "speed and course": drawn(
        problem(
            "(p (vector 2)) (v (vector 2))",
            "(= [x y] (+ p (* t v))) :sigma unknown",
            "(derive (s (norm v)) (w (atan2 (v 2) (v 1))))",
        ),
        _course,
        {"s": float(np.hypot(0.3, 0.1)), "w": float(np.arctan2(0.1, 0.3))},
    ),
    "refraction of uncertain size": drawn(
        "(problem p (data d external) (constants (r 0.13 :sigma 0.05)) (unknowns (h))"
        " (observe d (= y (+ h (* s s (- 1 r) 7.8e-8))) :sigma unknown))",
        _refraction,
        {"h": 3.0},
    ),
}
