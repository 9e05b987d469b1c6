"""Norms, absolute values and squares that should be zero hold as many dimensions as what is in them."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.types import SolveStatus

LINE = """(problem q (data d (table (x y) (0 1.02) (1 1.31) (2 1.19) (3 0.72) (4 -0.21)))
  (unknowns (a) (b) (c)) (observe d (= y (+ a (* b x) (* c x x))) :sigma 0.1) (constraints {constraint}))"""
SAME = [
    "(= (abs (- a b)) 0)",
    "(= 0 (^ (- a b) 2))",
    "(= (norm [(- a b) 0]) 0)",
    "(= (hypot (- a b) 0) 0)",
    "(= (+ (* (- a b) (- a b)) (^ (- b a) 2)) 0)",
    "(= (- (abs (- a b))) 0m)",
]


@pytest.mark.parametrize("constraint", SAME)
def test_each_says_that_two_are_equal(constraint):
    x, y = np.arange(5.0), np.array([1.02, 1.31, 1.19, 0.72, -0.21])
    design = np.column_stack([1 + x, x * x])  # a = b put in
    (a, c), cost, *_ = np.linalg.lstsq(design, y, rcond=None)
    sigma = 0.1 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    found = mbm.loads(LINE.format(constraint=constraint)).solve()
    assert found.first.status is SolveStatus.CONVERGED
    for name, value, deviation in (("a", a, sigma[0]), ("b", a, sigma[0]), ("c", c, sigma[1])):
        assert float(found[name].value) == pytest.approx(value, rel=1e-9)
        assert float(found[name].sigma) == pytest.approx(deviation, rel=1e-9)
    assert found.first.cost == pytest.approx(cost[0] / 0.01, rel=1e-9)
    assert found.first.dof == 3


def test_points_at_no_distance_coincide():
    text = """(problem q (unknowns (p (vector 2) :init [1 1]) (r (vector 2) :init [2 2]))
      (observe (= [0.1 0.2] p) :sigma 0.1) (observe (= [0.2 0.2] r) :sigma 0.1) (constraints (= (distance p r) 0)))"""
    found = mbm.loads(text).solve()
    np.testing.assert_allclose([found["p"].value, found["r"].value], [[0.15, 0.2]] * 2, rtol=1e-9)
    np.testing.assert_allclose(found["p"].sigma, 0.1 / 2**0.5, rtol=1e-9)
    assert found.first.dof == 2


def test_a_square_that_is_not_zero_stays_what_it_is():
    text = "(problem q (unknowns (a :init 1)) (observe (= 2 a) :sigma 0.1) (constraints (= (^ a 2) 2)))"
    assert float(mbm.loads(text).solve()["a"].value) == pytest.approx(2**0.5, rel=1e-9)
