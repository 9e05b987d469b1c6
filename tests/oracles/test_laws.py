"""The laws of probability that mbm computes, against mpmath with thirty digits.

The tails themselves are one text, which `tests/solver/test_chi_square.py` tries in all its languages.
Student's t and F are computed nowhere yet.
"""

from __future__ import annotations

import numpy as np
import pytest

from mbm.equations.losses import LossFunction, tuned
from mbm.estimation.consensus import units
from mbm.estimation.trust import nonlinearity
from mbm.problem.kinds import LossKind
from tests.oracles.laws import EXACT, tail


@pytest.mark.parametrize("dof", [1, 2, 3, 6, 20, 200])
@pytest.mark.parametrize("probability", [0.5, 0.1, 0.0027, 1e-6, 1e-12, 0.999, 1 - 1e-6])
def test_quantiles_of_chi_square(dof, probability):
    """Bisection ends at 1e-13 of the quantile; a tail near 1 is known to 1e-16 only, which moves what is far below."""
    found = EXACT.mpf(units.quantile(probability, dof))
    missed = abs(tail(found, dof) - EXACT.mpf(probability))
    density = EXACT.exp(-found / 2) * found ** (EXACT.mpf(dof) / 2 - 1) / EXACT.gamma(EXACT.mpf(dof) / 2)
    density /= EXACT.mpf(2) ** (EXACT.mpf(dof) / 2)
    assert missed <= density * found * 1e-12 + 1e-15 * (1 + dof)


def test_medians_and_limits():
    sizes = np.arange(1, 9)
    for size, median in zip(sizes.tolist(), units.medians(sizes).tolist(), strict=True):
        assert abs(tail(median, size) - 0.5) < 1e-13
    for deviations in (1.0, 2.5, 3.0, 5.0, 7.0):
        outside = EXACT.erfc(EXACT.mpf(deviations) / EXACT.sqrt(2))
        for size, limit in zip(sizes.tolist(), units.limits(sizes, deviations).tolist(), strict=True):
            assert abs(tail(limit, size) / outside - 1) < 1e-11


@pytest.mark.parametrize("size", [1, 2, 3, 6, 12])
def test_variance_that_is_left_inside_a_limit(size):
    """E[s; s ≤ limit]/(d P(s ≤ limit)), integrated by parts: a quotient of the laws with d + 2 and d degrees."""
    for limit in (0.5, 1.0, 4.0, 6.25, 9.0, 25.0, 60.0):
        inside = [1 - tail(limit, size + more) for more in (2, 0)]
        found = units.consistency(np.array([size]), np.array([limit]))[0]
        # Both probabilities are differences from 1, known to 1e-16 beside themselves.
        assert abs(found - inside[0] / inside[1]) < 1e-14 / inside[1]


def test_the_quantile_of_the_normal_law():
    half = EXACT.erfc(EXACT.mpf(nonlinearity.NORMAL_95) / EXACT.sqrt(2)) / 2
    assert abs(half - EXACT.mpf("0.025")) < 1e-15


@pytest.mark.parametrize("kind", [LossKind.HUBER, LossKind.CAUCHY, LossKind.TUKEY, LossKind.GEMAN_MCCLURE])
@pytest.mark.parametrize("size", [1, 3])
def test_losses_are_tuned_to_the_efficiency_that_is_stated(kind, size):
    """(E[w s])²/(d E[w² s]) with s ~ χ²_d and w = ρ', by mpmath: 95 %."""
    formulas = {
        LossKind.HUBER: lambda t: 1 if t <= 1 else t**-0.5,
        LossKind.CAUCHY: lambda t: 1 / (1 + t),
        LossKind.TUKEY: lambda t: (1 - t) ** 2 if t <= 1 else 0,
        LossKind.GEMAN_MCCLURE: lambda t: (1 + t) ** -2,
    }
    scale = EXACT.mpf(tuned(LossFunction(kind=kind, scale=1.0).weight, size))

    def mean(power):
        def integrand(u):
            weight = formulas[kind]((u / scale) ** 2)
            return weight**power * u ** (size + 1) * EXACT.exp(-u * u / 2)

        return EXACT.quad(integrand, [0, scale, 3 * scale, 30])

    with EXACT.workdps(20):
        total = EXACT.gamma(EXACT.mpf(size) / 2) * EXACT.mpf(2) ** (EXACT.mpf(size) / 2 - 1)
        found = mean(1) ** 2 / (size * mean(2) * total)
    assert abs(found - EXACT.mpf("0.95")) < 1e-11
