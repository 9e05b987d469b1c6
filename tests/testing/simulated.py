"""Kinds of problems whose data mbm itself simulates, for the harness of `mbm.testing.coverage`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

import mbm
from mbm.testing.coverage import Coverage, coverage

X = np.linspace(-1.0, 2.0, 25)
TURN = np.linspace(0.2, 6.1, 30)
POINTS = np.random.default_rng(1).uniform(-1.0, 1.0, (12, 3))
STATIONS = np.array([[0.0, 0, 0], [5, 0, 1], [0, 5, 2], [5, 5, 0], [2, 0, 3], [0, 2, 3], [5, 3, 3], [3, 5, 2]])


@dataclass(frozen=True)
class Kind:
    """A problem whose starts are its true values (or ``at``), tables for it, and how its data sets are made."""

    text: str
    data: Mapping[str, object]
    outliers: tuple[float, float] | None = None
    draw_priors: bool = False
    noise: Mapping[str, object] = field(default_factory=dict)
    at: Mapping[str, object] = field(default_factory=dict)


def columns(**given: object) -> dict[str, object]:
    return {"d": given}


LINE = columns(x=X, y=np.zeros(25))
CURVE = columns(x=np.linspace(0.0, 6.0, 40), y=np.ones(40))
CLOUD = {name: POINTS[:, i] for i, name in enumerate("xyz")} | {name: np.ones(12) for name in "uvw"}
RANGES = {"x": np.tile(STATIONS[:, 0], 6), "y": np.tile(STATIONS[:, 1], 6), "z": np.tile(STATIONS[:, 2], 6)}
RANGES |= {"r": np.ones(48)}
TAG = "(= r (distance p [x y z]))"
NET = {
    "nodes": {"name": list("abcdefgh"), "x0": STATIONS[:, 0], "y0": STATIONS[:, 1] + 0.2},
    "d": {
        "a": [p for i, p in enumerate("abcdefgh") for q in "abcdefgh"[i + 1 :]],
        "b": [q for i, p in enumerate("abcdefgh") for q in "abcdefgh"[i + 1 :]],
        "r": np.ones(28),
        "g": np.zeros(28),
    },
}


def problem(unknowns: str, observe: str, more: str = "") -> str:
    return f"(problem p (data d external) (unknowns {unknowns}) (observe d {observe}) {more})"


KINDS: dict[str, Kind] = {
    "linear": Kind(problem("(a :init 2) (b :init -1)", "(= y (+ a (* b x))) :sigma 0.1"), LINE),
    "nonlinear": Kind(problem("(a :init 3) (k :init 0.6)", "(= y (* a (exp (* -1 k x)))) :sigma 0.05"), CURVE),
    "unknown noise": Kind(
        problem("(a :init 2) (b :init -1)", "(= y (+ a (* b x)))", "(derive (at-two (+ a (* 2 b))))"),
        columns(x=X[:8], y=np.zeros(8)),
        noise={"d": 0.2},
    ),
    "two unknown noises": Kind(
        "(problem p (data d external) (data e external) (unknowns (a :init 2) (b :init -1))"
        " (observe d (= y (+ a (* b x)))) (observe e (= y (+ a (* b x)))))",
        {**columns(x=X, y=np.zeros(25)), "e": {"x": X, "y": np.zeros(25)}},
        noise={"d": 0.1, "e": 0.3},
    ),
    "angle": Kind(
        problem(
            "(h angle :init 179deg) (p (vector 2) :init [1 2])",
            "(= (angle t) (- (atan2 (- y (p 2)) (- x (p 1))) h)) :sigma 0.5deg",
        ),
        columns(x=4 * np.cos(TURN), y=4 * np.sin(TURN), t=np.zeros(30)),
    ),
    "prior": Kind(
        problem("(a :init 2 :sigma 0.05) (b :init -1 :sigma 0.1)", "(= y (+ a (* b x))) :sigma 0.2"),
        LINE,
        draw_priors=True,
    ),
    "pose": Kind(
        problem(
            "(T (pose 3) :init (pose3 (euler 0.3 -0.4 2) [1 2 3]))", "(= [u v w] (transform T [x y z])) :sigma 0.1"
        ),
        {"d": CLOUD},
    ),
    "plane pose": Kind(
        problem("(T (pose 2) :init (pose2 1 2 3))", "(= [u v] (transform T [x y])) :sigma 0.1"), {"d": CLOUD}
    ),
    "similarity": Kind(
        problem("(S (similarity 3))", "(= [u v w] (transform S [x y z])) :sigma 0.1"),
        {"d": CLOUD},
        at={"S": {"quaternion": [0.5, 0.5, -0.5, 0.5], "translation": [1, 2, 3], "scale": 2.0}},
    ),
    "rotation measured": Kind(
        problem("(R (rotation 3) :init (euler 0.3 -0.4 2))", "(= (quaternion a b c e) R) :sigma [0.1 0.2 0.3]"),
        columns(a=np.full(6, 0.5), b=np.full(6, 0.5), c=np.full(6, 0.5), e=np.full(6, 0.5)),
    ),
    "direction": Kind(
        problem("(n direction :init [1 2 -2])", "(= h (dot n [x y z])) :sigma 0.1"),
        {"d": {**CLOUD, "h": np.zeros(12)}},
    ),
    "rotation prior": Kind(
        problem(
            "(R (rotation 3) :init (euler 0.3 -0.4 2))",
            "(= [u v w] (rotate R [x y z])) :sigma 0.3",
            "(constraints (normal R (euler 0.3 -0.4 2) 0.1))",
        ),
        {"d": CLOUD},
        draw_priors=True,
    ),
    "bounds, inactive": Kind(
        problem("(a :init 2 :in (0 5)) (b :init -1 :in (-3 3))", "(= y (+ a (* b x))) :sigma 0.1"), LINE
    ),
    "inequality, half active": Kind(
        problem("(a :init 2) (b :init -1)", "(= y (+ a (* b x))) :sigma 0.1", "(constraints (<= a 2))"), LINE
    ),
    "equality": Kind(
        problem("(a :init 2) (b :init -1)", "(= y (+ a (* b (^ x 2)))) :sigma 0.1", "(constraints (= (* a b) -2))"),
        LINE,
    ),
    "loss": Kind(problem("(p (vector 3) :init [2 1 1])", f"{TAG} :sigma 0.05 :loss (huber)"), {"d": RANGES}),
    "loss, 10 % outliers": Kind(
        problem("(p (vector 3) :init [2 1 1])", f"{TAG} :sigma 0.05 :loss (cauchy)"), {"d": RANGES}, (0.1, 40.0)
    ),
    "consensus": Kind(
        problem("(p (vector 3) :init [2 1 1])", f"{TAG} :sigma 0.05", "(solve :robust lmeds)"), {"d": RANGES}
    ),
    "consensus, 10 % outliers": Kind(
        problem("(p (vector 3) :init [2 1 1])", f"{TAG} :sigma 0.05", "(solve :robust lmeds)"),
        {"d": RANGES},
        (0.1, 40.0),
    ),
    "implicit": Kind(
        problem("(a :init 3) (b :init 2)", "(- (+ (^ (/ x a) 2) (^ (/ y b) 2)) 1) :errors ((x 0.05) (y 0.05))"),
        columns(x=3 * np.cos(TURN), y=2 * np.sin(TURN)),
    ),
    "errors on both sides": Kind(
        problem("(a :init 2) (b :init -1)", "(= y (+ a (* b x))) :errors ((x 0.1) (y 0.1))"), LINE
    ),
    "family": Kind(
        """(problem p (data nodes external :key name) (data d external)
          (unknowns (q (vector 2) :per nodes :init [x0 y0] :fixed (or (= name "a") (= name "b"))))
          (observe d (= r (distance (q a) (q b))) :sigma 0.02)
          (derive (side (distance (q "c") (q "d")))))""",
        NET,
    ),
}


def judged(kind: Kind, runs: int, seed: int = 1) -> Coverage:
    """One kind of problem, simulated and solved."""
    return coverage(
        mbm.loads(kind.text),
        runs=runs,
        seed=seed,
        data=kind.data,
        at=kind.at,
        noise=kind.noise,
        outliers=kind.outliers,
        draw_priors=kind.draw_priors,
    )
