"""Where the rank is a matter of decision, a bare estimator and a whole solve decide alike."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

pytest.importorskip("llvmlite")

LINE = """
(problem line
  (data points external)
  (unknowns (a :init 0) (b :init 0))
  (observe points (= y (+ a (* b x))) :sigma 1))
"""


@pytest.mark.parametrize("apart", [1e-6, 1e-8, 6e-9, 4e-9, 3e-9, 2.5e-9, 1e-9, 1e-11, 1e-12, 5e-13, 2e-13, 1e-13, 0.0])
def test_a_line_through_nearly_one_abscissa(apart):
    """The singular values of the scaled columns are √2 and a third of the distance: none below 1e-13 of the larger."""
    x, y = np.array([1.0, 1.0, 1.0 + apart]), np.array([1.0, 1.1, 1.2])
    compiled = mbm.loads(LINE).compile(data={"points": {"x": x, "y": y}}, backend="native")
    scaled = np.column_stack([np.ones(3), x]) / np.sqrt([3.0, np.square(x).sum()])
    shares = np.linalg.svd(scaled, compute_uv=False)
    expected = "converged" if shares[1] > 1e-13 * shares[0] else "unobservable"
    solve = compiled.solve()
    assert solve.result.solves[0].status == expected
    estimates = compiled.estimator("x", "y")(x, y)
    assert estimates.status == expected
    assert bool(np.isfinite(estimates.sigma).all()) == (expected == "converged")
