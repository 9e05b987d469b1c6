"""What is kept from one data set to the next does not show in any answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm

PROBLEMS = Path(__file__).parents[2] / "problems"

RANGES = """
(problem position
  (data anchors external)
  (constants (near 0.05))
  (unknowns (p (vector 2) :init [3 3]) (offset :init 0))
  (observe close anchors (= d (+ offset (distance p [x y]))) :sigma near :when (< d 4))
  (observe far anchors (= d (+ offset (distance p [x y]))) :sigma (* 0.02 d) :when (>= d 4))
  (observe slope (= 0 offset) :sigma 0.1)
  (derive (reach (norm p))))
"""
DRIFTS = """
(problem levels
  (data readings external)
  (data places external :key name)
  (unknowns (level :per places) (drift :init 0))
  (observe readings (= value (+ (level place) (* drift time))) :sigma 0.1 :loss (huber 1.5)))
"""


def anchors(count: int, seed: int, *, nearest: float = 0.0) -> dict[str, np.ndarray]:
    """Ranges from (4, 5) to stations in a square of ten metres, none of them nearer than ``nearest``."""
    random = np.random.default_rng(seed)
    angle, distance = random.uniform(0, 2 * np.pi, count), random.uniform(max(nearest, 1), 8, count)
    x, y = 4 + distance * np.cos(angle), 5 + distance * np.sin(angle)
    return {"x": x, "y": y, "d": distance + 0.05 * random.normal(size=count)}


def said(result: mbm.Solved) -> object:
    """The document without how long it took."""
    document = result.document()
    for solve in document["solves"]:
        del solve["seconds"]
    return document


# numbers of rows that come back, and rows that one clause has none of
STREAM = [anchors(8, 1), anchors(8, 2), anchors(5, 3), anchors(7, 4, nearest=4.5), anchors(8, 5), anchors(5, 6)]


def test_a_data_set_is_solved_alike_after_others_and_alone():
    """Bit by bit: the same arithmetic is done on the same numbers."""
    compiled = mbm.loads(RANGES).compile(data={"anchors": STREAM[0]})
    for data in STREAM:
        alone = mbm.loads(RANGES).compile(data={"anchors": data}).solve()
        assert said(compiled.solve(data={"anchors": data})) == said(alone)


def test_starts_from_outside_are_not_remembered():
    compiled = mbm.loads(RANGES).compile(data={"anchors": STREAM[0]})
    before = said(compiled.solve())
    assert said(compiled.solve(init={"p": [6.0, 1.0]})) != before
    assert said(compiled.solve()) == before


def test_members_that_rows_name_are_those_of_the_data_at_hand():
    """The truth is that of a plain least squares fit: residuals of 0.01 stay far from where the loss bends, at 0.15."""
    compiled = None
    random = np.random.default_rng(7)
    for count in (6, 9, 6):
        place = random.permutation(np.array(["a", "b"] * count)[:count])
        place[:2] = ["a", "b"]
        time = np.arange(count, dtype=float)
        value = np.where(place == "a", 1.0, 5.0) + 0.2 * time + 0.01 * random.normal(size=count)
        data = {"readings": {"place": place, "time": time, "value": value}, "places": {"name": np.array(["a", "b"])}}
        compiled = compiled or mbm.loads(DRIFTS).compile(data=data)
        found = compiled.solve(data=data)
        matrix = np.column_stack([place == "a", place == "b", time]).astype(float)
        expected = np.linalg.lstsq(matrix, value, rcond=None)[0]
        # both are solutions of the same linear equations, of condition below 100
        np.testing.assert_allclose([*found["level"].value, found["drift"].value], expected, rtol=1e-10)


LONG = ("office-walk", "chain-intervals")
"""Problems that take a second or more each time."""


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=pytest.mark.slow) if path.stem in LONG else path
        for path in sorted(PROBLEMS.glob("*/*.mbm"))
    ],
    ids=lambda path: path.stem,
)
def test_a_problem_solved_twice_says_the_same(path):
    program = mbm.load(path)
    for name in program.names:
        compiled = program.named(name).compile()
        assert said(compiled.solve()) == said(compiled.solve())


@pytest.mark.parametrize(
    "path",
    # bounds are no residuals, and the end gauge has none
    [path for path in sorted(PROBLEMS.glob("*/*.mbm")) if path.stem not in ("chain-intervals", "end-gauge")],
    ids=lambda path: path.stem,
)
def test_residuals_at_many_points_and_beside_the_jacobian_are_those_at_each(path):
    """Losses, matrices of weights, sampled tables, families and corrected columns are among the problems."""
    program = mbm.load(path)
    for name in program.names:
        equations, start = program.named(name).compile()._assembled()
        steps = 1e-3 * np.random.default_rng(1).normal(size=(3, equations.dimension))
        points = np.stack([start, *(equations.retract(start, step) for step in steps)])
        found = equations.residuals_at(points)
        each = np.stack([equations.residuals(point) for point in points])
        # kernels are the same to the last bit; sums over the components of a row may be taken in another order
        close = {"rtol": 1e-12, "atol": 1e-12 * np.abs(each).max(), "equal_nan": True}
        np.testing.assert_allclose(found, each, **close)
        np.testing.assert_allclose(equations.linearised(points[1])[0], each[1], **close)
