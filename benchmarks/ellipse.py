"""An implicit ellipse with errors in both coordinates: the exact optimum, beside ODRPACK."""

from __future__ import annotations

import numpy as np

import mbm
from benchmarks.figures import Figure, duration, show_figures
from benchmarks.machine import best
from benchmarks.peers import UnavailableError, asked
from tests.evidence.implicit_reference import joint_optimum

COUNTS = (20, 50, 150)
SIGMA = 0.02
TRUTH = np.array([1.0, -0.5, 2.0, 1.0, 0.4])
START = [0.0, 0.0, 1.5, 1.2, 0.0]
ASKED_SECONDS = 10e-3
EXACT = 9.0
"""Digits from which an optimum counts as exact: SciPy's, which it is compared with, has no more."""
PROBLEM = """
(problem ellipse
  (data pts external)
  (unknowns (c (vector 2) :init [0 0]) (a positive :init 1.5) (b positive :init 1.2) (phi angle :init 0))
  (observe pts
    (let ((q (rotate (rot2 (- phi)) (- [x y] c))))
      (- (+ (^ (/ (q 1) a) 2) (^ (/ (q 2) b) 2)) 1))
    :errors ((x 0.02) (y 0.02))))
"""


def rim(values: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Points (k, 2) of the ellipse with middle, half axes and turn ``values``."""
    u, v = values[2] * np.cos(angle), values[3] * np.sin(angle)
    cosine, sine = np.cos(values[4]), np.sin(values[4])
    return np.stack([values[0] + u * cosine - v * sine, values[1] + u * sine + v * cosine], axis=1)


def points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Measured points (k, 2), and the true angles."""
    random = np.random.default_rng(count)
    angle = random.uniform(0, 2 * np.pi, count)
    return rim(TRUTH, angle) + SIGMA * random.normal(size=(count, 2)), angle


def digits(found: np.ndarray, exact: np.ndarray) -> float:
    """Correct digits of the worst parameter."""
    return float(-np.log10(max(np.abs(found / exact - 1).max(), 1e-16)))


def table(count: int) -> dict[str, np.ndarray]:
    """The points as columns."""
    measured = points(count)[0]
    return {"x": measured[:, 0], "y": measured[:, 1]}


def figures() -> list[Figure]:
    """Digits against SciPy's joint optimum, and seconds of a solve with all that `compiled.solve` says."""
    compiled = mbm.loads(PROBLEM).compile(data={"pts": table(COUNTS[0])})
    try:
        arrays = {str(count): points(count)[0] for count in COUNTS}
        answer = asked("ellipse", ("odrpack",), {**arrays, "start": np.array(START)})
        others, versions = answer.found, answer.versions
    except UnavailableError as error:
        others, versions = {}, str(error)
    lines = []
    for count in COUNTS:
        measured, angle = points(count)
        exact = joint_optimum(lambda p, m=measured: ((rim(p[:5], p[5:]) - m) / SIGMA).ravel(), TRUTH, angle).values
        solved = compiled.solve(data={"pts": table(count)})
        seconds = best(lambda n=count: compiled.solve(data={"pts": table(n)}).diagnostics, 20)
        found = np.concatenate([solved["c"].value, [float(solved[n].value) for n in ("a", "b", "phi")]])
        correct = digits(found, exact)
        work, ours = f"implicit ellipse, {count} points", f"{duration(seconds)}, {correct:.1f} digits"
        asked_for, reached = "exact, ≤ 10 ms", seconds <= ASKED_SECONDS and correct >= EXACT
        if not others:
            lines.append(Figure(work=work, ours=ours, asked=asked_for, reached=reached, compared=versions))
        for name, other in others.get(str(count), {}).items():
            lines.append(
                Figure(
                    work=work,
                    ours=ours,
                    peer=f"{versions}, {name} tolerances",
                    theirs=f"{duration(other['seconds'])}, {digits(np.array(other['x']), exact):.1f} digits",
                    ratio=other["seconds"] / seconds,
                    asked=asked_for,
                    reached=reached,
                    compared="SciPy's optimum over parameters and points",
                )
            )
    return lines


def main() -> None:
    show_figures(figures())


if __name__ == "__main__":
    main()
