"""Places, angles, rotations, poses; circles and other implicit curves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.coverage.judging import Floats, Kind, Tables, Truth
from benchmarks.coverage.making import problem, table

TURN = np.linspace(0.2, 6.1, 30)
ARC = np.linspace(0.2, 0.9, 12)
POINTS = np.random.default_rng(1).uniform(-1.0, 1.0, (12, 3))
STATIONS = np.array([[0.0, 0, 0], [5, 0, 1], [0, 5, 2], [5, 5, 0], [2, 0, 3], [0, 2, 3], [5, 3, 3], [3, 5, 2]])
CLOUD = {name: POINTS[:, i] for i, name in enumerate("xyz")}


def euler(phi: float, theta: float, psi: float) -> Floats:
    """Rz(psi) Ry(theta) Rx(phi)."""
    (a, b), (c, d), (e, f) = ((np.cos(each), np.sin(each)) for each in (phi, theta, psi))
    x = np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
    y = np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]])
    z = np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)


TURNED = euler(0.3, -0.4, 2.0)


def _ranges(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    place = np.tile(STATIONS, (3, 1))
    r = np.linalg.norm(place - [2, 1, 1], axis=1) + 0.05 * rng.normal(size=(runs, 24))
    return {"d": table(runs, x=place[:, 0], y=place[:, 1], z=place[:, 2], r=r)}, {"p": np.array([[2.0, 1.0, 1.0]])}


def _rounded(angles: Floats, a: float, b: float, noise: float) -> Kind:
    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        shape = (runs, len(angles))
        x, y = a * np.cos(angles) + 1, b * np.sin(angles) + 2
        x, y = (each + noise * rng.normal(size=shape) for each in (x, y))
        truth = {"r": a, "p": 1.0, "q": 2.0} if a == b else {"a": a, "b": b}
        return {"d": table(runs, x=x, y=y)}, truth

    if a == b:
        model, unknowns = "(- (+ (^ (- x p) 2) (^ (- y q) 2)) (^ r 2))", f"(p :init 1) (q :init 2) (r :init {a})"
    else:
        model = "(- (+ (^ (/ (- x 1) a) 2) (^ (/ (- y 2) b) 2)) 1)"
        unknowns = f"(a :init {a}) (b :init {b})"
    return Kind(problem(unknowns, f"{model} :errors ((x {noise}) (y {noise}))"), make)


def _cloud(text: str, true: Floats, sigma: float, truth: Truth) -> Kind:
    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        measured = true + sigma * rng.normal(size=(runs, *true.shape))
        columns = {name: measured[:, :, i] for i, name in enumerate("uvw"[: true.shape[1]])}
        return {"d": table(runs, **CLOUD, **columns)}, truth

    return Kind(text, make)


def _bearings(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    x, y = 4 * np.cos(TURN), 4 * np.sin(TURN)
    t = np.arctan2(y - 2, x - 1) - np.deg2rad(179.9) + np.deg2rad(0.5) * rng.normal(size=(runs, 30))
    return {"d": table(runs, x=x, y=y, t=t)}, {"h": np.deg2rad(179.9), "p": np.array([[1.0, 2.0]])}


def _direction(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
    n = np.array([1.0, 2.0, -2.0]) / 3
    return {"d": table(runs, **CLOUD, h=POINTS @ n + 0.1 * rng.normal(size=(runs, 12)))}, {
        "q": np.array([n @ [1.0, 0.0, 1.0]])
    }


def _compass(sigma: float) -> Kind:
    def make(rng: np.random.Generator, runs: int) -> tuple[Tables, Truth]:
        t = np.deg2rad(178.0) + np.deg2rad(sigma) * rng.normal(size=(runs, 9))
        return {"d": table(runs, t=t)}, {"h": np.deg2rad(178.0)}

    return Kind(problem("(h angle)", f"(= (angle t) h) :sigma {sigma}deg"), make, turning=("h",))


SHIFTED = POINTS @ TURNED.T + [1.0, 2.0, 3.0]
Q = (TURNED @ [1.0, 1.0, 0.0] + [1.0, 2.0, 3.0])[None]
KINDS: Mapping[str, Kind] = {
    "place from ranges": Kind(
        problem("(p (vector 3) :init [2 1 1])", "(= r (distance p [x y z])) :sigma 0.05"), _ranges
    ),
    "place from ranges, unknown noise, no start": Kind(
        problem("(p (vector 3))", "(= r (distance p [x y z])) :sigma unknown"), _ranges
    ),
    "circle": _rounded(TURN, 3.0, 3.0, 0.05),
    "circle from a short arc": _rounded(ARC, 3.0, 3.0, 0.05),
    "ellipse": _rounded(TURN, 3.0, 2.0, 0.05),
    "bearings, heading near half a turn": Kind(
        problem(
            "(h angle :init 179deg) (p (vector 2) :init [1 2])",
            "(= (angle t) (- (atan2 (- y (p 2)) (- x (p 1))) h)) :sigma 0.5deg",
        ),
        _bearings,
        turning=("h",),
    ),
    "compass near half a turn": _compass(5.0),
    "direction": Kind(
        problem("(n direction :init [1 2 -2])", "(= h (dot n [x y z])) :sigma 0.1", "(derive (q (dot n [1 0 1])))"),
        _direction,
    ),
    "rotation": _cloud(
        problem(
            "(R (rotation 3) :init (euler 0.3 -0.4 2))",
            "(= [u v w] (rotate R [x y z])) :sigma 0.1",
            "(derive (q (rotate R [1 1 0])))",
        ),
        POINTS @ TURNED.T,
        0.1,
        {"q": (TURNED @ [1.0, 1.0, 0.0])[None]},
    ),
    "rotation, unknown noise": _cloud(
        problem("(R (rotation 3))", "(= [u v w] (rotate R [x y z])) :sigma unknown", "(derive (q (rotate R [1 1 0])))"),
        POINTS @ TURNED.T,
        0.1,
        {"q": (TURNED @ [1.0, 1.0, 0.0])[None]},
    ),
    "pose": _cloud(
        problem("(T (pose 3))", "(= [u v w] (transform T [x y z])) :sigma 0.1", "(derive (q (transform T [1 1 0])))"),
        SHIFTED,
        0.1,
        {"q": Q},
    ),
    "pose of the plane": _cloud(
        problem("(T (pose 2))", "(= [u v] (transform T [x y])) :sigma 0.1", "(derive (q (transform T [1 1])))"),
        POINTS[:, :2] @ euler(0, 0, 3)[:2, :2].T + [1.0, 2.0],
        0.1,
        {"q": (euler(0, 0, 3)[:2, :2] @ [1.0, 1.0] + [1.0, 2.0])[None]},
    ),
    "similarity": _cloud(
        problem(
            "(S (similarity 3))", "(= [u v w] (transform S [x y z])) :sigma 0.1", "(derive (q (transform S [1 1 0])))"
        ),
        2 * POINTS @ TURNED.T + [1.0, 2.0, 3.0],
        0.1,
        {"q": (2 * TURNED @ [1.0, 1.0, 0.0] + [1.0, 2.0, 3.0])[None]},
    ),
}
