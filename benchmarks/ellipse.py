"""An implicit ellipse with errors in both coordinates: the exact optimum, beside ODRPACK (in its own environment)."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

import numpy as np

import mbm
from benchmarks.machine import best, machine, show
from tests.evidence.implicit_reference import joint_optimum

COUNTS = (20, 50, 150)
SIGMA = 0.02
TRUTH = np.array([1.0, -0.5, 2.0, 1.0, 0.4])
START = [0.0, 0.0, 1.5, 1.2, 0.0]
PROBLEM = """
(problem ellipse
  (data pts external)
  (unknowns (c (vector 2) :init [0 0]) (a positive :init 1.5) (b positive :init 1.2) (phi angle :init 0))
  (observe pts
    (let ((q (rotate (rot2 (- phi)) (- [x y] c))))
      (- (+ (^ (/ (q 1) a) 2) (^ (/ (q 2) b) 2)) 1))
    :errors ((x 0.02) (y 0.02))))
"""
PEER = Path(__file__).with_name("ellipse_odrpack.py")


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


def peers(folder: Path) -> dict[int, dict[str, list[float]]]:
    """What ODRPACK says for each number of points, by kind of tolerance: parameters, then seconds."""
    environment = folder / "environment"
    venv.create(environment, with_pip=True)
    python = str(environment / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "odrpack"], check=True)
    found = {}
    for count in COUNTS:
        table = folder / f"{count}.npy"
        np.save(table, points(count)[0])
        command = [python, str(PEER), str(table), json.dumps(START)]
        found[count] = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return found


def main() -> None:
    print(machine())
    compiled = mbm.loads(PROBLEM).compile(data={"pts": table(COUNTS[0])})
    with tempfile.TemporaryDirectory() as folder:
        others = peers(Path(folder)) if "--alone" not in sys.argv else {}
    lines = []
    for count in COUNTS:
        measured, angle = points(count)
        exact = joint_optimum(lambda p, m=measured: ((rim(p[:5], p[5:]) - m) / SIGMA).ravel(), TRUTH, angle).values
        solved = compiled.solve(data={"pts": table(count)})
        seconds = best(lambda n=count: compiled.solve(data={"pts": table(n)}), 20)
        found = np.concatenate([solved["c"].value, [float(solved[n].value) for n in ("a", "b", "phi")]])
        solve = solved.first
        cells = [f"{digits(found, exact):.1f}", f"{1e3 * (solve.seconds or 0.0):.1f}", f"{1e3 * seconds:.1f}"]
        lines.append([f"mbm, {count} points", *cells, str(solve.evaluations)])
        for name, (*values, taken) in others.get(count, {}).items():
            lines.append([f"odrpack {name}", f"{digits(np.array(values), exact):.1f}", "", f"{1e3 * taken:.1f}", ""])
    show(["points", "digits", "first solve ms", "solve ms", "evaluations"], lines)


def table(count: int) -> dict[str, np.ndarray]:
    """The points as columns."""
    measured = points(count)[0]
    return {"x": measured[:, 0], "y": measured[:, 1]}


if __name__ == "__main__":
    main()
