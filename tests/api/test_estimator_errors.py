"""Estimators of problems with errors in measured columns: these are inputs, and answers those of whole solves."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.kernels.native.engine import available
from tests.api.test_estimator import agree

CIRCLE = """
(problem rim (data d external) (unknowns (p (vector 2) :init [0 0]) (r positive :init 1.5))
  (observe d (= (hypot (- x (p 1)) (- y (p 2))) r) :errors ((x 0.02) (y s))){more})"""


def rim(seed: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2 * np.pi, 16)
    x, y = 0.1 + 2.0 * np.cos(angle), 0.2 + 2.0 * np.sin(angle)
    noise = 0.02 * random.standard_normal((2, 16))
    return {"x": x + noise[0], "y": y + noise[1], "s": np.full(16, 0.02)}


@pytest.mark.parametrize("more", ["", "(constraints (= (p 1) (* 0.5 (p 2))))", "(constraints (normal r 2.0 0.01))"])
def test_answers_are_those_of_whole_solves(more: str) -> None:
    compiled = mbm.loads(CIRCLE.format(more=more)).compile(data={"d": rim(0)})
    estimator = compiled.estimator()
    assert estimator.inputs == ("d.x", "d.y")
    assert estimator.fast is available()
    sets = [rim(seed) for seed in range(1, 6)]
    many = estimator.many(*(np.stack([each[name] for each in sets]) for name in "xy"))
    for t, each in enumerate(sets):
        found = estimator(each["x"], each["y"])
        agree(found, compiled.solve(data={"d": each}), ("p", "r"))
        np.testing.assert_array_equal(many.values[t], found.values)
        assert bool(many.clean[t]) is found.clean is estimator.fast


def test_points_near_the_centre_go_the_general_way() -> None:
    """Which the nearest point is takes a search there; nor is a cost of that size explained by noise."""
    compiled = mbm.loads(CIRCLE.format(more="")).compile(data={"d": rim(0)})
    other = rim(1)
    other["x"][3], other["y"][3] = 0.15, 0.21
    found = compiled.estimator("x", "y")(other["x"], other["y"])
    assert not found.clean
    agree(found, compiled.solve(data={"d": other}), ("p", "r"))


@pytest.mark.parametrize("more", ["(observe d (= x (p 1)) :sigma 5.0 :errors ((x 0.02)))", "(solve :robust lmeds)"])
def test_values_that_several_equations_use_and_consensus_go_the_general_way(more: str) -> None:
    compiled = mbm.loads(CIRCLE.format(more=more)).compile(data={"d": rim(0)})
    estimator = compiled.estimator("x", "y")
    assert not estimator.fast
    other = rim(2)
    agree(estimator(other["x"], other["y"]), compiled.solve(data={"d": other}), ("p", "r"))


@pytest.mark.parametrize(("column", "what"), [("s", "the noise"), ("m.x", "a correction")])
def test_deviations_and_values_of_joined_rows_are_no_inputs(column: str, what: str) -> None:
    text = """
    (problem p (data marks (table (id x) (1 0) (2 1)) :key id) (data d external :with (m marks mark))
      (unknowns (a :init 1))
      (observe d (= y (+ a m.x)) :errors ((y s) (m.x 0.1))))"""
    data = {"mark": [1.0, 2.0], "y": [1.0, 2.0], "s": [0.1, 0.1]}
    compiled = mbm.loads(text).compile(data={"d": data})
    with pytest.raises(mbm.MbmError, match="deciding-input") as caught:
        compiled.estimator(column)
    assert what in caught.value.diagnostics[0].message
