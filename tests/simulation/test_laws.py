"""Variates of the laws of priors, against the distributions of SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

import mbm
from mbm.problem.overrides import Law
from mbm.simulation.noise import log_densities, standard_variates

WHOLE = {
    Law("normal"): stats.norm(),
    Law("rectangular"): stats.uniform(-np.sqrt(3.0), 2.0 * np.sqrt(3.0)),
    Law("triangular"): stats.triang(0.5, -np.sqrt(6.0), 2.0 * np.sqrt(6.0)),
    Law("trapezoidal", 0.5): stats.trapezoid(0.25, 0.75, -np.sqrt(4.8), 2.0 * np.sqrt(4.8)),
    Law("arcsine"): stats.arcsine(-np.sqrt(2.0), 2.0 * np.sqrt(2.0)),
    Law("student", 5.0): stats.t(5, scale=np.sqrt(3.0 / 5.0)),
    Law("student", 1.0): stats.t(1),
    Law("lognormal", 2.0): stats.lognorm(
        np.log(2.0),
        loc=-1.0 / np.sqrt(np.expm1(np.log(2.0) ** 2)),
        scale=np.exp(-(np.log(2.0) ** 2) / 2.0) / np.sqrt(np.expm1(np.log(2.0) ** 2)),
    ),
}


@pytest.mark.parametrize("law", WHOLE, ids=str)
def test_variates_have_their_distribution(law: Law) -> None:
    exact: Any = WHOLE[law]
    if law.has_variance:
        assert (exact.mean(), exact.std()) == (pytest.approx(0.0, abs=1e-12), pytest.approx(1.0))
    drawn = standard_variates(law, np.random.default_rng(4), (50, 400))
    assert stats.kstest(drawn.ravel(), exact.cdf).pvalue > 1e-4
    at = np.linspace(-4.0, 4.0, 33)
    np.testing.assert_allclose(log_densities(law, at), exact.logpdf(at), rtol=1e-9, atol=1e-12)


def test_priors_are_simulated_by_their_laws() -> None:
    text = (
        "(problem p (data d (table (y) (0))) (unknowns (x :prior (rectangular 2 4))) (observe d (= y x) :sigma 1e-3))"
    )
    problem = mbm.loads(text)
    drawn = [
        problem.simulate(draw_priors=True, seed=s).truth["solves"][0]["estimates"]["x"]["value"] for s in range(60)
    ]
    assert 2.0 < min(drawn) < 2.2
    assert 3.8 < max(drawn) < 4.0
    assert np.std(drawn) == pytest.approx(1.0 / np.sqrt(3.0), rel=0.25)
