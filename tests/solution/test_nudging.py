"""Starts where a derivative has no value: the solve goes on from beside them."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.types import SolveStatus

CORNERS = """(data q (table (x y z u v w) (0 0 0 1 2 3) (1 0 0 1 3 3) (0 1 0 0 2 3) (0 0 1 1 2 4)))
  (unknowns (T (pose 3) :init (pose3 (euler 0 0 0) [0 0 0])))
  (observe q (= [u v w] (transform T [x y z])) :sigma 0.01)"""


@pytest.mark.parametrize("how", ["penalty", "exact"])
def test_a_constraint_on_a_norm_that_is_zero(how):
    text = f"(problem p {CORNERS} (constraints (= (norm (translation T)) 3.7)) (solve :constraints {how}))"
    found = mbm.loads(text).solve().first
    assert found.status is SolveStatus.CONVERGED
    elsewhere = mbm.loads(text.replace("[0 0 0])))", "[1 2 3])))")).solve().first
    assert found.cost == pytest.approx(elsewhere.cost, rel=1e-9)


def test_a_point_that_starts_on_its_station():
    """No closed form knows the factor k, so that nothing else rescues the start."""
    stations = np.array([[0, 0], [4, 0], [0, 5], [4, 5.0]])
    ranges = np.hypot(*(stations - [1, 2]).T)
    text = """(problem p (data s external) (unknowns (p (vector 2) :init [0 0]) (k :init 1 :sigma 0.01))
      (observe s (= r (* (exp (* 0.1 (- k 1))) (distance p [x y]))) :sigma 0.01))"""
    found = mbm.loads(text).solve(data={"s": {"x": stations[:, 0], "y": stations[:, 1], "r": ranges}})
    assert found.first.status is SolveStatus.CONVERGED
    np.testing.assert_allclose(found["p"].value, [1, 2], atol=1e-8)  # exact ranges


def test_the_edge_of_a_domain_is_left_inwards():
    found = mbm.loads("(problem p (unknowns (p :init 1)) (observe (= 0.5 (acos p)) :sigma 0.1))").solve()
    assert float(found["p"].value) == pytest.approx(np.cos(0.5), rel=1e-9)


def test_no_value_at_the_start_is_still_said():
    found = mbm.loads("(problem p (unknowns (a :init 0)) (observe (= 2 (log a)) :sigma 1))").solve().first
    assert found.status is SolveStatus.NOT_CONVERGED
    assert [d.code.name for d in found.diagnostics] == ["not-finite-at-start"]
