"""Student's t against SciPy."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm, t

from mbm.estimation.uncertainty.student import beyond, coverage_factor, coverage_factors, shortest

DEGREES = (1.0, 1.3, 2.0, 3.0, 9.5, 40.0, 999.0, 1000.0, 5e4)


@pytest.mark.parametrize("level", [0.5, 0.6827, 0.95, 0.9545, 0.99, 0.9999])
def test_factors_are_quantiles(level: float) -> None:
    wanted = t.ppf(0.5 + level / 2, DEGREES)
    # 1e-9 is what the expansion about the normal distribution is good for from 1000 degrees of freedom on.
    np.testing.assert_allclose(coverage_factors(level, np.array(DEGREES)), wanted, rtol=2e-9)
    assert coverage_factor(level, inf) == pytest.approx(norm.ppf(0.5 + level / 2), rel=1e-12)


@pytest.mark.parametrize("dof", [1.0, 2.5, 30.0])
def test_tails_keep_their_digits(dof: float) -> None:
    for distance in (0.0, 0.3, 2.0, 40.0):
        assert beyond(distance, dof) == pytest.approx(2 * t.sf(distance, dof), rel=1e-10)


@pytest.mark.parametrize(
    ("lower", "upper"), [(-0.1, 0.08), (-3.0, 0.5), (-1.0, inf), (0.0, inf), (2.0, inf), (-9.0, -5.0)]
)
@pytest.mark.parametrize("dof", [3.0, 1e4])
def test_the_shortest_interval_between_limits(lower: float, upper: float, dof: float) -> None:
    low, high = shortest(lower, upper, 0.95, dof)

    def between(a: float, b: float) -> float:
        return float(t.cdf(b, dof) - t.cdf(a, dof) if a < 0 else t.sf(a, dof) - t.sf(b, dof))

    whole = between(lower, upper)
    assert lower <= low < high <= upper
    assert between(low, high) == pytest.approx(0.95 * whole, rel=1e-9)
    # no interval between the limits that holds as much is shorter: move the lower end
    for moved in np.linspace(lower if np.isfinite(lower) else -9.0, high, 9)[1:-1]:
        if between(moved, upper) > 0.95 * whole:
            end = brentq(lambda b, a=moved: between(a, b) - 0.95 * whole, moved, min(upper, 1e6), xtol=1e-12)
            assert end - moved >= (high - low) * (1 - 1e-7)
