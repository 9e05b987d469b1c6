"""Corrections at a minimum do not hang on the way there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import mbm
from mbm.equations.types import Minimum, Reason
from mbm.estimation.minimise import sparsity
from mbm.estimation.minimise.sparse import sparse_minimum
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import assemble, confirmed

# Exact but for the corrections of x: none meet it where a is above zero.
ROOT = """
(problem root
  (data t external)
  (unknowns (a :init -1))
  (observe t (= 0 (+ a (* x x))) :errors ((x 0.1)) :loss huber))
"""


def equations():
    compiled = mbm.loads(ROOT).compile(data={"t": {"x": [1.0, 1.1, 0.9]}})
    found = compiled.elaborated
    return assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)[0]


def minimum_at(a: float) -> Minimum:
    return Minimum(
        point=np.array([a]),
        residuals=np.zeros(3),
        jacobian=np.ones((3, 1)),
        cost=0.0,
        reason=Reason.EXACT_FIT,
        iterations=4,
        evaluations=5,
        at_bound=np.zeros(1, dtype=np.int8),
    )


def test_a_minimum_with_corrections_stays():
    minimum, found = minimum_at(-1.0), equations()
    assert confirmed(found, minimum) is minimum


def test_a_minimum_without_corrections_is_none():
    rootless = equations()
    found = confirmed(rootless, minimum_at(2.0))
    assert found.reason is Reason.NO_FINITE_STEP
    assert not found.reason.converged
    assert (found.bad_row, found.iterations) == (0, 4)


def test_of_blocks_nothing_is_left_either(monkeypatch):
    monkeypatch.setattr(sparsity, "MOST_DENSE", 0)
    monkeypatch.setattr(sparsity, "SPARSE", 1.0)
    rootless = equations()
    minimum = sparse_minimum(rootless, np.array([-1.0]), Settings())
    assert confirmed(rootless, minimum) is minimum
    found = confirmed(rootless, replace(minimum, point=np.array([2.0])))
    assert found.reason is Reason.NO_FINITE_STEP
    assert (found.bad_row, found.iterations) == (0, minimum.iterations)
    assert found.jacobian.shape == (3, 1)
    assert abs(found.jacobian).sum() == 0.0


def test_corrections_do_not_depend_on_what_was_asked_before():
    """Seen as an internal fault: residuals that were finite on the way had no value when they were asked for again."""
    text = """
    (problem p
      (data t external)
      (unknowns (a :init 1) (b :init 2) (v (vector 3) :init [1 2 3]))
      (constants (k0 1))
      (observe t `(= ,y (+ ,(let ((a x)) id) ((transform (pose3 (axis-angle [id b a]) v) v) 3)))
        (let ((q (dot (normalize (perse [t.x pi x])) [(exp t.x) (length (list 20deg))]))) (= q a))
        :sigma 1 :loss geman-mcclure :errors ((x 0.1)))
      (window x :length 2.5 :step 1))
    """
    table = {"id": [1.0, 2.0, 3.0], "x": [0.0, 4.0, 0.0], "y": [0.0, 0.0, 4.0]}
    solved = mbm.loads(text).solve(data={"t": table})
    assert [solve.status for solve in solved.solves][:3] == ["not-converged"] * 3
