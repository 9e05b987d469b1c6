"""The pose of a desk in one image, solved again and again: the bare estimator, one by one and in batches; SciPy.

SciPy gets the model twice: as the functions of the compiled problem, and written by hand in NumPy for this one desk.
What `compiled.solve` takes for one data set, with covariance, doubts and report, is shown for smaller problems too.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

import numpy as np

import mbm
from benchmarks.figures import Figure, duration, show_figures
from benchmarks.machine import best
from benchmarks.peers import UnavailableError, asked

FOLDER = Path(__file__).parents[1] / "problems" / "desk"
POINTS = np.array(
    [[0.6, 0.35, 0.7], [-0.6, 0.35, 0.7], [-0.6, -0.35, 0.7], [0.6, -0.35, 0.7], [0.57, 0.32, 0], [0.57, -0.32, 0]]
)
"""The corners in the order of the data, m: four of the board, the feet of legs 1 and 4."""
BATCH = 1000
LINE = """
(problem line
  (data points external)
  (unknowns (a :init 0) (b :init 0))
  (observe points (= y (+ a (* b x))) :sigma 0.1))
"""
POSITION = """
(problem position
  (data points external)
  (unknowns (p (vector 2) :init [3 3]))
  (observe points (= d (distance p [x y])) :sigma 0.05))
"""
ASKED = {"finite differences": 150.0, "exact Jacobian": 25.0}


def figures() -> list[Figure]:
    """Seconds of a solve from the same start, and the same image in a batch."""
    compiled = mbm.load(FOLDER / "desk.mbm").named("desk").compile()
    estimator = compiled.estimator("X", "Y")
    table = np.genfromtxt(FOLDER / "corners.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    image = np.array([table["X"], table["Y"]])
    one = estimator(*image)
    batch = [np.tile(axis, (BATCH, 1)) for axis in image]
    estimator.many(*batch)
    alone = best(lambda: estimator(*image), 2000)
    together = best(lambda: estimator.many(*batch, workers=1), 100) / BATCH
    shared = best(lambda: estimator.many(*batch), 100, perf_counter) / BATCH
    moved = {name: table[name] for name in table.dtype.names}
    other = {"corners": moved | {"X": moved["X"] + 0.1}}
    api = best(lambda: compiled.solve(data=other).diagnostics, 200)
    arrays = {"points": POINTS, "image": image.T, "start": np.array([np.radians(10), 2.5, 0.0])}
    found = [
        Figure(work="desk pose, one data set a call, with covariance", ours=duration(alone), asked="some 17 µs"),
        Figure(work=f"… {BATCH:,} data sets a call, each, one processor", ours=duration(together), asked="some 3.5 µs"),
        Figure(work="… all processors", ours=duration(shared)),
        Figure(work="… through `compiled.solve(data=…)`, with all that it says", ours=duration(api)),
        Figure(work="… of a straight line through 10 points", ours=duration(_whole_solve(LINE, _line()))),
        Figure(work="… of a position in the plane from 8 ranges", ours=duration(_whole_solve(POSITION, _ranges()))),
    ]
    ways = (("one a call", alone), (f"{BATCH:,} a call", together))
    for name, seconds in _over_ours(compiled).items():
        peer = f"SciPy lm over the compiled equations, {name}"
        found += [_compared(way, ours, peer, seconds, ASKED[name]) for way, ours in ways]
    try:
        answer = asked("desk", ("numpy", "scipy"), arrays)
    except UnavailableError as error:
        return [*found, Figure(work="… SciPy", ours="", compared=str(error))]
    for name, other in answer.found.items():
        same = float(np.abs(one.values - np.array(other["x"])).max())
        answers = f"differ by {same:.0e} (rad, m); costs {one.cost:.6f} and {other['cost']:.6f}"
        peer = f"{answer.versions.split(', ')[1]} lm over NumPy by hand, {name}"
        found += [_compared(way, ours, peer, other["seconds"], ASKED[name], answers) for way, ours in ways]
    return found


def _compared(way: str, ours: float, peer: str, theirs: float, asked: float, answers: str = "") -> Figure:
    """One line of ours beside one of a peer."""
    return Figure(
        work=f"desk pose, per solve, {way}",
        ours=duration(ours),
        peer=peer,
        theirs=duration(theirs),
        ratio=theirs / ours,
        asked=f"≥ {asked:.0f} ×",
        reached=theirs / ours >= asked,
        compared=answers,
    )


def _line() -> dict[str, np.ndarray]:
    """Points near a straight line."""
    x = np.arange(10.0)
    return {"x": x, "y": 1 + 2 * x + 0.1 * np.random.default_rng(0).normal(size=10)}


def _ranges() -> dict[str, np.ndarray]:
    """Ranges of (4, 5) from stations in a square."""
    random = np.random.default_rng(0)
    x, y = random.uniform(0, 10, size=(2, 8))
    return {"x": x, "y": y, "d": np.hypot(x - 4, y - 5) + 0.05 * random.normal(size=8)}


def _whole_solve(text: str, points: dict[str, np.ndarray]) -> float:
    """Seconds of `compiled.solve` of one data set, and of reading its report."""
    compiled = mbm.loads(text).compile(data={"points": points})
    return best(lambda: compiled.solve(data={"points": points}).diagnostics, 200)


def _over_ours(compiled: mbm.CompiledProblem) -> dict[str, float]:
    """Seconds of SciPy's solve with residuals and Jacobian of the compiled problem, from its start."""
    from scipy.optimize import least_squares

    equations, start = compiled._assembled()
    found = {}
    for name, options in (("finite differences", {}), ("exact Jacobian", {"jac": equations.jacobian})):

        def solve(options: dict = options) -> object:
            return least_squares(equations.residuals, start, method="lm", **options)

        found[name] = best(solve, 50)
    return found


def main() -> None:
    show_figures(figures())


if __name__ == "__main__":
    main()
