"""Losses against numerical derivatives, published constants, and the square-root form against its definition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi

from mbm.equations.losses import LossFunction, efficiency, loss_function, rooted, rooted_jacobian, tuned
from mbm.equations.manifolds import of_arrays
from mbm.problem.kinds import LossKind
from mbm.problem.types import Loss
from mbm.solver.losses import LOSSES as TRAITS, loss_slope, loss_value

TUNED = tuple(kind for kind in LossKind if TRAITS[kind].scales)
PUBLISHED = {LossKind.HUBER: 1.345, LossKind.CAUCHY: 2.385, LossKind.TUKEY: 4.685}
"""Holland and Welsch (1977): tuning constants of 95 % efficiency for one component, to their three digits."""


def rho(loss, squares):
    return of_arrays(loss_value)(loss.number, squares, loss.scale, loss.shape)


def each_loss():
    for kind in LossKind:
        if kind is LossKind.BARRON:
            yield from (LossFunction(kind=kind, shape=a, scale=1.7) for a in (2.0, 1.0, 0.5, 0.0, -2.0, -40.0))
        else:
            yield LossFunction(kind=kind, scale=1.7)


LOSSES = tuple(each_loss())


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_derivatives_are_those_of_rho(loss):
    s = np.array([1e-3, 0.1, 0.9, 2.0, 2.8, 3.1, 9.0, 400.0])
    h = 1e-6 * s
    numerical = (rho(loss, s + h) - rho(loss, s - h)) / (2 * h)
    # Central differences with a relative step of 1e-6 hold nine digits of these smooth functions.
    np.testing.assert_allclose(loss.weight(s), numerical, rtol=1e-7, atol=1e-9)
    second = (loss.weight(s + h) - loss.weight(s - h)) / (2 * h)
    np.testing.assert_allclose(
        of_arrays(loss_slope)(loss.number, s, loss.scale, loss.shape), second, rtol=1e-6, atol=1e-9
    )
    assert rho(loss, np.array([1e-12]))[0] == pytest.approx(1e-12, rel=1e-9)


def test_known_values():
    s = np.array([4.0])
    assert rho(LossFunction(kind=LossKind.HUBER, scale=1.0), s)[0] == pytest.approx(3.0)
    assert rho(LossFunction(kind=LossKind.SOFT_L1, scale=1.0), s)[0] == pytest.approx(2 * (5**0.5 - 1))
    assert rho(LossFunction(kind=LossKind.CAUCHY, scale=2.0), s)[0] == pytest.approx(4 * np.log(2))
    assert rho(LossFunction(kind=LossKind.TUKEY, scale=1.0), s)[0] == pytest.approx(1 / 3)
    assert rho(LossFunction(kind=LossKind.GEMAN_MCCLURE, scale=2.0), s)[0] == pytest.approx(2.0)
    # Barron's family holds the others: a = 1 is soft-l1, a = 0 Cauchy with c√2, a = -2 Geman-McClure with 2c.
    barron = {a: rho(LossFunction(kind=LossKind.BARRON, shape=a, scale=1.0), s)[0] for a in (1.0, 0.0, -2.0)}
    assert barron[1.0] == pytest.approx(2 * (5**0.5 - 1))
    assert barron[0.0] == pytest.approx(2 * np.log(3))
    assert barron[-2.0] == pytest.approx(2.0)


@pytest.mark.parametrize("kind", TUNED)
def test_default_parameters(kind):
    for components, scale in enumerate(TRAITS[kind].scales, start=1):
        unit = LossFunction(kind=kind, scale=1.0)
        assert scale == pytest.approx(tuned(unit.weight, components), rel=1e-12)
        assert loss_function(Loss(kind=kind), components).scale == scale
        if components == 1 and kind in PUBLISHED:
            assert scale == pytest.approx(PUBLISHED[kind], abs=5e-4)


@pytest.mark.parametrize("kind", TUNED)
@pytest.mark.parametrize("components", [1, 2, 3])
def test_default_parameters_have_95_percent_efficiency(kind, components):
    loss = loss_function(Loss(kind=kind), components)
    density = chi(components).pdf

    def expected(power):
        def integrand(u):
            return density(u) * loss.weight(np.array([u * u]))[0] ** power * u * u

        return quad(integrand, 0, loss.scale)[0] + quad(integrand, loss.scale, 12)[0]

    # quad's own error estimate is below 1e-8 here.
    assert expected(1) ** 2 / (components * expected(2)) == pytest.approx(0.95, abs=1e-7)


def test_parameters_are_found_for_more_components_and_for_barrons_family():
    for loss in (Loss(kind=LossKind.TUKEY), Loss(kind=LossKind.BARRON, shape=-1.0)):
        found = loss_function(loss, 9)
        unit = replace(found, scale=1.0)
        assert efficiency(unit.weight, found.scale, 9) == pytest.approx(0.95, abs=1e-9)
    assert loss_function(Loss(kind=LossKind.BARRON, shape=2.0), 4).scale == 2.0


@pytest.mark.parametrize("loss", LOSSES, ids=str)
def test_square_root_form(loss):
    generator = np.random.default_rng(1)
    units, components, n = 40, 3, 4
    slope = generator.normal(size=(units, components, n))
    curve = generator.normal(size=(units, components))
    sizes = 10 ** generator.uniform(-4, 1.5, size=(units, 1))

    def residuals(x):
        return sizes * curve + slope @ x

    plain = residuals(np.zeros(n))
    bent = rooted(loss, plain)
    np.testing.assert_allclose(np.square(bent).sum(axis=1), rho(loss, np.square(plain).sum(axis=1)), rtol=1e-13)
    step = 1e-6
    numerical = np.stack(
        [(rooted(loss, residuals(step * e)) - rooted(loss, residuals(-step * e))) / (2 * step) for e in np.eye(n)],
        axis=2,
    )
    # Central differences: h² times third derivatives, large for the units with the smallest residuals.
    np.testing.assert_allclose(rooted_jacobian(loss, plain, slope), numerical, atol=2e-5)


def test_square_root_form_at_zero():
    for loss in LOSSES:
        jacobian = np.ones((1, 2, 3))
        np.testing.assert_array_equal(rooted_jacobian(loss, np.zeros((1, 2)), jacobian), jacobian)


def test_each_name_of_the_language_has_formulas():
    assert sorted(TRAITS) == sorted(LossKind)
    assert len({traits.number for traits in TRAITS.values()}) == len(TRAITS)


def test_convex_losses_are_those_whose_value_is_convex_in_the_residual():
    r = np.linspace(0.01, 12.0, 400)
    for loss in LOSSES:
        values = rho(loss, np.square(r))
        assert loss.convex == bool((np.diff(values, 2) > -1e-9).all())
