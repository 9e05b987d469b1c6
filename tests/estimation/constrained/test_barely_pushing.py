"""An inequality holds an estimate where the data push against it by more than a millionth of a standard deviation."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.kernels.native.engine import available
from mbm.report.blocks import ManyReports
from mbm.solver.decisions import PUSHED

SIGMA = 0.01
LIMITED = """(problem limited (data t external) (unknowns (x :init -1) (y :init 0))
  (observe t (= [p q] [x (+ x y)]) :sigma 0.01)
  (constraints (<= x 0)) {clause})"""
"""x, measured as ``p`` above its limit 0, ends there; without the limit its deviation is σ and that of y is √2 σ.

What counts is the deviation σ/√2 that x has while y stands still: the limit holds from p = √2 · 1e-6 σ on.
"""
SHARES = [(-1e3, False), (0.5, False), (1.3, False), (1.5, True), (2.0, True), (1e3, True)]
"""Of p in 1e-6 σ, and whether x is held."""


def check(solve, held):
    """The constraint holds x, whose deviation is 0 and that of y σ, or only touches it."""
    sigma = {estimate.name: float(estimate.sigma) for estimate in solve.estimates}
    assert sigma["x"] == pytest.approx(0.0 if held else SIGMA, rel=1e-9)
    assert sigma["y"] == pytest.approx(SIGMA if held else np.sqrt(2) * SIGMA, rel=1e-9)
    assert ("active-constraint" in [d.code.name for d in solve.diagnostics]) == held
    assert solve.dof == int(held)


@pytest.mark.parametrize("backend", ["numpy", "auto"])
@pytest.mark.parametrize(("share", "held"), SHARES)
def test_a_limit_that_the_data_push_against(share, held, backend):
    data = {"t": {"p": [share * PUSHED * SIGMA], "q": [1.0]}}
    solve = mbm.loads(LIMITED.format(clause="")).solve(data=data, backend=backend).first
    check(solve, held)


@pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")
def test_limits_of_many_solves():
    shares, held = (np.tile(side, 20) for side in zip(*SHARES, strict=True))
    data = {"t": {"p": shares * PUSHED * SIGMA, "q": np.ones(shares.size), "k": np.arange(shares.size)}}
    result = mbm.loads(LIMITED.format(clause="(for-each k)")).solve(data=data)
    assert isinstance(result.result.solves, ManyReports)
    for one, solve in zip(held, result.solves, strict=True):
        check(solve, one)


def test_limits_in_a_stream():
    """The bare estimator: next to where a limit begins to hold the full solver decides, elsewhere it does not."""
    compiled = mbm.loads(LIMITED.format(clause="")).compile(data={"t": {"p": [0.0], "q": [1.0]}})
    estimator = compiled.estimator("p", "q")
    for share, held in SHARES:
        found = estimator([share * PUSHED * SIGMA], [1.0])
        wanted = [0.0, SIGMA] if held else [SIGMA, np.sqrt(2) * SIGMA]
        np.testing.assert_allclose(found.sigma, wanted, rtol=1e-9, atol=1e-15)
        assert found.clean or not estimator.fast or 1 < share < 2
