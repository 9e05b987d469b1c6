"""Windows with consensus: what is said of the rows is said at the estimates that are reported."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

TEXT = """
(problem w (data d (table (t x y))) (unknowns (f :init 1))
  (observe d (= y (sin (* f x))) :sigma 0.05)
  (window t :length 1 :step 1 :min-rows 5) (solve :robust {rule}))
"""


@pytest.mark.parametrize("seed", [0, 2])
@pytest.mark.parametrize("rule", ["lmeds", "ransac", "msac", "gnc"])
def test_residuals_belong_to_the_estimates(rule: str, seed: int) -> None:
    """A frequency that drifts away from the stated start: each window begins where the one before it ended."""
    generator = np.random.default_rng(seed)
    t = np.arange(600) * 0.05
    x = generator.uniform(0, 6, 600)
    y = np.sin((1 + 0.1 * t) * x) + 0.05 * generator.standard_normal(600)
    y += np.where(generator.random(600) < 0.25, generator.uniform(1, 5, 600), 0.0)
    found = mbm.loads(TEXT.format(rule=rule)).compile(data={"d": {"t": t, "x": x, "y": y}}).solve()
    converged = [solve for solve in found.solves if solve.status == "converged"]
    assert len(converged) > 9
    for solve in converged:
        rows = solve.rows()
        which = np.array([row.row for row in rows]) - 1
        expected = np.sin(float(solve.estimates[0].value) * x[which]) - y[which]
        values = np.array([row.value for row in rows])
        # Solves made again agree to the tolerance of steps, 1e-10 standard deviations; the sign is that of the clause.
        np.testing.assert_allclose(np.abs(values), np.abs(expected), atol=1e-8)
