"""An unknown that no residual feels to first order has no standard deviation, however its derivative is rounded."""

from __future__ import annotations

import pytest

import mbm
from mbm.report.types import SolveStatus


@pytest.mark.parametrize("noise", [":sigma 0.1", ""], ids=["stated", "unknown"])
@pytest.mark.parametrize("start", ["3.141592653589793", "3"], ids=["there", "near"])
def test_a_cosine_at_half_a_turn(start, noise):
    text = (
        f"(problem p (data d (table (y) (-1) (-1.01))) (unknowns (t :init {start})) (observe d (= y (cos t)) {noise}))"
    )
    found = mbm.loads(text).solve()
    assert found.first.status is SolveStatus.UNOBSERVABLE
    assert float(found["t"].value) == pytest.approx(3.141592653589793, abs=1e-6)  # the cost is flat to 1e-12 there
    assert "no equation changes with `t`" in found.observability.unobservable[0].sentence
    assert found.observability.rank == 0


def test_the_others_keep_their_deviations():
    text = """(problem p (data d (table (y) (-1) (-1))) (unknowns (t :init 3.141592653589793) (a :init 0))
      (observe d (= y (+ a (cos t))) :sigma 0.1) (constraints (normal a 0 1)))"""
    found = mbm.loads(text).solve()
    assert float(found["a"].sigma) == pytest.approx((2 / 0.01 + 1) ** -0.5, rel=1e-9)


def test_a_weakly_determined_unknown_keeps_its_deviation():
    text = """(problem p (data d (table (x y) (1 0.001) (2 0.002) (3 -0.001))) (unknowns (p :init 1) (q :init 0))
      (observe d (= y (+ (* p x) (* 1e-9 q))) :sigma 1e-3))"""
    found = mbm.loads(text).solve()
    assert found.first.status is SolveStatus.CONVERGED
    # Two-parameter line: var(q) = 1e18 σ² Σx² / (n Σ(x − x̄)²)
    assert float(found["q"].sigma) == pytest.approx(1e9 * 1e-3 * (14 / 6) ** 0.5, rel=1e-9)
