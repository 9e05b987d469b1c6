"""Residual statistics and variance components."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chi2

import mbm
from mbm.equations.types import NoiseState
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.uncertainty.observability import observability
from mbm.estimation.uncertainty.variance import common_factor, fit_statistics, redundancy_numbers, variance_components
from mbm.solver.chi_square import chi_square_tail
from tests.estimation.classics import Functions


@pytest.mark.parametrize("dof", [1, 2, 3, 10, 57, 400, 10_000])
@pytest.mark.parametrize("share", [0.01, 0.5, 0.97, 1.0, 1.02, 1.5, 4.0])
def test_tail_of_chi_square(dof, share):
    # The front factor exp(a log x - x - lgamma a) loses digits in proportion to a.
    assert chi_square_tail(share * dof, dof) == pytest.approx(chi2.sf(share * dof, dof), rel=1e-9, abs=1e-250)


def test_statistics():
    fit = fit_statistics(42.1, 45, 3, noise_stated=True)
    assert fit.dof == 42
    assert fit.sigma0 == pytest.approx(np.sqrt(42.1 / 42), rel=1e-15)
    assert fit.chi2_p == pytest.approx(chi2.sf(42.1, 42), rel=1e-10)
    assert fit_statistics(42.1, 45, 3, noise_stated=False).chi2_p is None
    exact = fit_statistics(0.0, 3, 3, noise_stated=True)
    assert (exact.dof, exact.sigma0, exact.chi2_p) == (0, None, None)
    assert fit_statistics(1.0, 4, 3, noise_stated=True, equalities=2).dof == 3


def test_redundancy_is_the_diagonal_of_the_residual_projection():
    random = np.random.default_rng(0)
    jacobian = random.normal(size=(14, 4))
    jacobian[:, 3] = jacobian[:, 0] - jacobian[:, 2]
    observed = observability(jacobian, np.ones(4), np.zeros(4, bool))
    numbers = redundancy_numbers(jacobian, observed)
    expected = 1 - np.diag(jacobian @ np.linalg.pinv(jacobian))
    np.testing.assert_allclose(numbers, expected, atol=1e-12)
    assert numbers.sum() == pytest.approx(14 - 3, rel=1e-12)


def test_common_factor():
    assert common_factor(8.0, 2, 0.0).factor == pytest.approx(2.0, rel=1e-15)
    assert common_factor(0.0, 2, 0.0).state is NoiseState.EXACT
    assert common_factor(1e-30, 2, 1e-14).state is NoiseState.EXACT  # 1e-15 is within a rounding of 1e-14
    assert common_factor(3.0, 0, 0.0).state is NoiseState.NO_REDUNDANCY


class Line:
    """A straight line through several groups of rows, whose noise is not known; counts its solves."""

    def __init__(self, x, y, groups, base=None):
        self.x, self.y, self.groups = x, y, groups
        self.base = np.ones(x.size) if base is None else base
        self.solves = 0

    def __call__(self, factors):
        self.solves += 1
        sigma = self.base.copy()
        for factor, rows in zip(factors, self.groups, strict=True):
            sigma[rows] *= factor
        matrix = np.stack([np.ones_like(self.x), self.x], axis=1) / sigma[:, None]
        found = minimise(
            Functions(
                function=lambda b: matrix @ b - self.y / sigma, gradient=lambda _: matrix, start=(0, 0), linear=True
            ),
            np.zeros(2),
            Settings(),
        )
        observed = observability(found.jacobian, found.point, np.zeros(2, bool))
        return found.residuals, redundancy_numbers(found.jacobian, observed), np.zeros(self.x.size)


def test_two_unknown_groups_maximise_the_restricted_likelihood():
    random = np.random.default_rng(8)
    x = np.linspace(0, 10, 90)
    groups = (np.arange(60), np.arange(60, 90))
    y = 1 + 2 * x + np.where(np.arange(90) < 60, 0.02, 3.0) * random.normal(size=90)
    found = variance_components(Line(x, y, groups), groups)
    assert [n.state for n in found] == [NoiseState.ESTIMATED] * 2

    def restricted(logarithms):
        sigma = np.where(np.arange(90) < 60, *np.exp(logarithms))
        matrix = np.stack([np.ones(90), x], axis=1) / sigma[:, None]
        rest = y / sigma - matrix @ np.linalg.lstsq(matrix, y / sigma, rcond=None)[0]
        return 2 * np.log(sigma).sum() + np.linalg.slogdet(matrix.T @ matrix)[1] + rest @ rest

    peer = minimize(restricted, np.log([0.02, 3.0]), method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-13})
    # The fixed point of Helmert's iteration is the restricted maximum likelihood; the peer ends at half the digits.
    np.testing.assert_allclose([n.factor for n in found], np.exp(peer.x), rtol=1e-5)


def test_stated_noise_is_never_scaled():
    random = np.random.default_rng(9)
    x = np.linspace(0, 10, 80)
    groups = (np.arange(40),)
    y = 1 + 2 * x + 0.5 * random.normal(size=80)
    base = np.where(np.arange(80) < 40, 1.0, 1e-3)
    line = Line(x, y, groups, base)
    found = variance_components(line, groups)
    residuals, redundancy, _ = line(np.array([found[0].factor]))
    # The condition that defines the factor; the stated rows, whose sigma is far too small, keep their misfit.
    assert residuals[:40] @ residuals[:40] == pytest.approx(redundancy[:40].sum(), rel=1e-8)
    assert residuals[40:] @ residuals[40:] > 1e4


def test_group_that_is_fitted_exactly_or_unchecked():
    x = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    y = np.array([1.0, 3.0, 5.2, 6.9, 9.1])
    found = variance_components(Line(x, np.ones(5), (np.arange(2), np.arange(2, 5))), (np.arange(2), np.arange(2, 5)))
    assert {n.state for n in found} <= {NoiseState.EXACT, NoiseState.ESTIMATED}

    # One row alone determines an unknown of its own.
    matrix = np.zeros((6, 3))
    matrix[:5, 0], matrix[:5, 1], matrix[5, 2] = 1.0, x, 1.0
    right = np.append(y, 7.0)
    groups = (np.arange(5), np.array([5]))

    def solve(factors):
        sigma = np.repeat(factors, [5, 1])
        observed = observability(matrix / sigma[:, None], np.ones(3), np.zeros(3, bool))
        answer = np.linalg.lstsq(matrix / sigma[:, None], right / sigma, rcond=None)[0]
        return (matrix @ answer - right) / sigma, redundancy_numbers(matrix / sigma[:, None], observed), np.zeros(6)

    found = variance_components(solve, groups)
    assert found[1].state is NoiseState.NO_REDUNDANCY
    # Three redundant rows: s² = SSE/3 of the line alone.
    rest = np.linalg.lstsq(matrix[:5, :2], y, rcond=None)[1][0]
    assert found[0].factor == pytest.approx(np.sqrt(rest / 3), rel=1e-9)


@pytest.mark.parametrize("at_minimum", [None, (np.array([1e200, 1.0]), np.ones(2), np.zeros(2))])
def test_rounds_end_where_nothing_is_told_of_the_noise(at_minimum):
    asked = []

    def solve(factors):
        asked.append(factors.copy())
        return (np.array([2.0, 1.0]), np.ones(2), np.zeros(2)) if len(asked) == 1 else at_minimum

    found = variance_components(solve, [np.array([0])])
    assert [noise.factor for noise in found] == [2.0]
    assert len(asked) == 2


@pytest.mark.parametrize("solves", ["", "(for-each run)"])
def test_where_no_minimum_is_reached_noise_is_not_estimated(solves):
    """Constraints that no values meet end the rounds at once: what is left over there says nothing of noise."""
    problem = mbm.loads(f"""(problem p
      (data d (table (run y) (1 1.0) (1 1.2) (1 0.7) (1 1.1)))
      (unknowns (a :init 1) (b :init 2))
      (observe known d (= y b) :sigma 0.1)
      (observe d (= y a) :sigma unknown)
      (constraints (= a 3) (= (+ a b) 1) (= b 5)) {solves})""")
    (found,) = problem.compile().solve().document()["solves"]
    assert found["status"] == "infeasible"
    assert found["noise"]["d"] == 1.0  # what it was before the first round
