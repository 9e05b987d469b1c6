"""Constraints that say the same up to the digits they were typed with."""

from __future__ import annotations

import pytest

import mbm
from mbm.report.types import SolveStatus


@pytest.mark.parametrize("how", ["penalty", "exact"])
@pytest.mark.parametrize("second", ["1.00000000001", "1.000000001"])
def test_the_last_digits_differ(second, how):
    text = f"""(problem q (unknowns (a :init 0) (b :init 0)) (observe (= [1 2] [a b]) :sigma 0.1)
      (constraints (= (+ a b) 1) (= (+ a b) {second})) (solve :constraints {how}))"""
    found = mbm.loads(text).solve()
    assert found.first.status is SolveStatus.CONVERGED
    assert float(found["a"].value) == pytest.approx(0, abs=1e-8)  # the constraints themselves differ by as much
    assert float(found["a"].sigma) == pytest.approx(0.1 / 2**0.5, rel=1e-9)
    assert found.first.dof == 1
