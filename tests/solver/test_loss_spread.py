"""Factors of the sandwich covariance against closed forms, and differences of ψ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from mbm.equations.losses import LossFunction
from mbm.estimation.uncertainty.sandwich import pools
from mbm.problem.kinds import LossKind
from mbm.solver.loss_spread import curvature_factor, loss_trace, spread_factor


@pytest.mark.parametrize("kind", [LossKind.HUBER, LossKind.CAUCHY, LossKind.TUKEY, LossKind.GEMAN_MCCLURE])
@pytest.mark.parametrize("place", [(0.3, -0.4), (1.1, 2.3), (4.0, 0.5)])
def test_trace_is_the_divergence_of_psi(kind, place):
    loss = LossFunction(kind=kind, scale=1.7)

    def psi(component, *at):
        square = float(sum(x * x for x in at))
        return float(loss.weight(np.array([square]))[0]) * at[component]

    # central differences over 1e-4 in double precision: 1e-8 of curvature, 1e-12 of rounding
    found = sum(
        (psi(i, *(x + (j == i) * 1e-4 for j, x in enumerate(place)))
         - psi(i, *(x - (j == i) * 1e-4 for j, x in enumerate(place)))) / 2e-4
        for i in range(2)
    )  # fmt: skip
    square = sum(x * x for x in place)
    assert loss_trace(loss.number, square, loss.scale, loss.shape, 2) == pytest.approx(found, abs=1e-7)


def test_without_a_loss_it_is_the_variance_of_residuals():
    # all weights 1: G/A is the unbiased variance RSS/(n − p), and at least 1 where fewer than two rows tell it
    assert spread_factor(3.0, 10.0, 10.0, 10.0, 14.0, 10.0, 10.0) == pytest.approx(14.0 / 7.0, rel=1e-15)
    assert spread_factor(9.0, 10.0, 10.0, 10.0, 0.0, 10.0, 10.0) == pytest.approx(0.5, rel=1e-15)
    assert spread_factor(10.0, 10.0, 10.0, 10.0, 0.0, 10.0, 10.0) == 1.0
    assert curvature_factor(1e-12, 1.0) == 0.0


def test_location_by_huber_has_the_published_asymptotic_variance():
    # Huber (1964): E ψ²/(E ψ')² at the normal law; a million quantiles stand for the sample
    c, n = 1.345, 1_000_001
    residuals = norm.ppf((np.arange(n) + 0.5) / n)[None]
    loss = LossFunction(kind=LossKind.HUBER, scale=c)
    units = [(loss, np.zeros(n, dtype=np.int64), np.arange(n)[:, None])]
    found = pools(units, residuals, np.ones((1, n, 1)), np.ones((1, n)))
    inverse = 1.0 / found.curvature
    variance = float((inverse * found.spread(inverse) * inverse)[0, 0, 0])
    square = 2 * (quad(lambda r: r * r * norm.pdf(r), 0, c)[0] + c * c * norm.sf(c))
    assert n * variance == pytest.approx(square / (1 - 2 * norm.sf(c)) ** 2, rel=1e-5)


def test_solves_side_by_side_are_those_one_by_one():
    random = np.random.default_rng(3)
    residuals, along = random.standard_t(3, size=(4, 9)), random.normal(size=(4, 9, 2))
    loss, other = LossFunction(kind=LossKind.HUBER, scale=1.3), LossFunction(kind=LossKind.TUKEY, scale=4.0)
    pairs, single = np.array([[0, 1], [2, 3]]), np.array([[4], [5], [6]])

    def both(solves):
        return [
            (kind, np.repeat(np.arange(solves), len(slots)), np.tile(slots, (solves, 1)))
            for kind, slots in ((loss, pairs), (other, single))
        ]

    known = np.ones((4, 9))
    whole = pools(both(4), residuals, along, known)
    for k in range(4):
        one = pools(both(1), residuals[k : k + 1], along[k : k + 1], known[:1])
        np.testing.assert_allclose(one.curvature[0], whole.curvature[k], rtol=1e-13)
        inverse = np.linalg.inv(whole.curvature)
        np.testing.assert_allclose(one.spread(inverse[k : k + 1])[0], whole.spread(inverse)[k], rtol=1e-13)
