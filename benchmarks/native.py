"""Whole solves in native code: one call, a batch, and by two threads; beside them the same minimum by the general path.

``python benchmarks/native.py``
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np

import mbm
from mbm.api.problem import Problem
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.native import minimum as native
from mbm.estimation.minimise.native.system import system_of
from mbm.solver import description as of

PROBLEMS = Path(__file__).parent.parent / "problems"
BATCH = 400
TIMES = 15


def seconds(work: Callable[[], object]) -> float:
    """The least time of several."""
    taken = []
    for _ in range(TIMES):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return min(taken)


def ranges() -> tuple[Problem, dict[str, dict[str, np.ndarray]]]:
    """A place from 48 ranges."""
    random = np.random.default_rng(1)
    at, place = random.uniform([0, 0, 2], [10, 10, 3], (48, 3)), np.array([4.0, 5.0, 1.0])
    measured = np.linalg.norm(at - place, axis=1) + 0.01 * random.standard_normal(48)
    text = """(problem ranges (data t external) (unknowns (p (vector 3) :init [3m 4m 1.5m]))
      (observe t (= range (distance p [x y z])) :sigma 10mm))"""
    return mbm.loads(text), {"t": {"x": at[:, 0], "y": at[:, 1], "z": at[:, 2], "range": measured}}


def alignment() -> tuple[Problem, dict[str, dict[str, np.ndarray]]]:
    """A similarity between 2,174 pairs of points, from the closed form."""
    random = np.random.default_rng(1)
    here = 3 * random.standard_normal((2174, 3))
    turned = here[:, [1, 2, 0]] * 1.2 + [1, 2, 3] + 0.02 * random.standard_normal((2174, 3))
    text = """(problem alignment (data t external) (unknowns (T (similarity 3)))
      (observe t (= [b0 b1 b2] (transform T [a0 a1 a2])) :sigma 0.02))"""
    return mbm.loads(text), {"t": {f"{n}{i}": v[:, i] for n, v in (("a", here), ("b", turned)) for i in range(3)}}


def report(name: str, problem: Problem, data: dict[str, dict[str, np.ndarray]] | None) -> None:
    """One line."""
    asked = []
    own = native.kernel_minimum
    with mock.patch.object(native, "kernel_minimum", lambda *a: asked.append(a) or own(*a)):
        problem.solve(data=data)
    equations, start, settings, _ = asked[0]
    start = np.array(start)
    system = system_of(equations, settings)
    assert system is not None
    points = np.repeat(start[None], BATCH, axis=0)
    steps = int(system.one(start).states[0, of.STEPS])
    alone, whole = seconds(lambda: system.one(start)), seconds(lambda: own(equations, start, settings))
    batch, threads = (seconds(lambda w=w: system.solve(points, workers=w)) / BATCH for w in (1, 2))
    with mock.patch.object(native, "kernel_minimum", lambda *_: None):
        general = seconds(lambda: minimise(equations, start, settings))
    print(f"{name:>12} {equations.count:6d} {equations.dimension:4d} {steps:5d}", end="")
    print("".join(f"{1e6 * each:12.1f}" for each in (alone, batch, threads, whole, general)))


def main() -> None:
    """All of them, in microseconds."""
    print(" " * 12, "  rows    n steps        call       batch   2 threads     minimum     general   [µs]")
    report("desk", mbm.load(PROBLEMS / "desk" / "desk.mbm").named("desk"), None)
    report("48 ranges", *ranges())
    report("skeleton", mbm.load(PROBLEMS / "skeleton" / "skeleton.mbm").named("skeleton-near"), None)
    report("alignment", *alignment())


if __name__ == "__main__":
    main()
