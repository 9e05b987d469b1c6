"""The χ² law as Python, machine code and C, against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import chi2


def test_tails_are_those_of_scipy(solver):
    generator = np.random.default_rng(3)
    dof = generator.integers(1, 400, 500)
    values = dof * generator.uniform(0.0, 4.0, 500)
    tails = np.empty(500)
    assert solver("chi_square_tails", 500, values, dof, tails) == 0
    # the stated accuracy of some hundred degrees of freedom; probabilities near 0 relative to themselves
    np.testing.assert_allclose(tails, chi2.sf(values, dof), rtol=1e-11, atol=1e-300)


def test_a_tail_is_all_at_zero_and_nothing_far_out(solver):
    tails = np.empty(3)
    solver("chi_square_tails", 3, np.array([0.0, 1e6, np.inf]), np.array([3, 3, 3]), tails)
    assert tails.tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("dof", [10_000, 1_000_000])
@pytest.mark.parametrize("deviations", [-4.0, 0.0, 3.0])
def test_many_degrees_of_freedom_keep_nine_digits(solver, dof, deviations):
    value = dof + deviations * np.sqrt(2.0 * dof)
    assert solver("chi_square_tail", float(value), dof) == pytest.approx(chi2.sf(value, dof), rel=1e-9)


@pytest.mark.parametrize("dof", [*range(1, 8), 62, 63, 64, 65, 66, 101, 1000, 100_001])
def test_the_logarithm_of_the_gamma_function(solver, dof):
    # sums of up to 32 logarithms, and Stirling's series beyond: a few roundings of numbers of that size
    assert solver("log_gamma_of_half", dof) == pytest.approx(gammaln(0.5 * dof), rel=2e-15, abs=2e-15)


@pytest.mark.parametrize("components", [1, 2, 3, 6])
@pytest.mark.parametrize("limit", [0.01, 0.7, 3.0, 9.0, 40.0])
def test_what_is_left_inside_a_limit(solver, components, limit):
    inside = chi2.cdf(limit, components + 2)
    # a small share is what a tail near 1 leaves of it, and has the rounding of 1
    tolerance = 1e-12 + 1e-15 / inside
    expected = pytest.approx(inside / chi2.cdf(limit, components), rel=tolerance)
    assert solver("consistency", limit, components) == expected
