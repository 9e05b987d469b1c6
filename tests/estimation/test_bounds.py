"""Hard bounds: the Kuhn-Tucker conditions to the last digits, and agreement with SciPy's bounded solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear

from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from tests.estimation.classics import CLASSICS, Functions

BOUNDED = {
    # Bounds that cut off the free minimum.
    "Rosenbrock": ((-2, -1), (0.5, 2)),
    "Beale": ((0.6, 0.5), (2, 10)),
    "Wood": ((-100, -100, -100, -100), (0, 10, 100, 100)),
    "Kowalik-Osborne": ((0, 0, 0, 0.15), (1, 0.2, 1, 1)),
    "Osborne 1": ((0, 1, -2, 0.0130, 0.0), (1, 3, 0, 0.1, 0.1)),
    "Bard": ((0.1, 0, 0), (10, 10, 2)),
    "Brown-Dennis": ((-10, 0, -100, -20), (100, 15, 0, 0.2)),
    "Powell singular": ((0.1, -20, -1, -1), (100, 20, 1, 50)),
}


def stationarity(found, lower, upper):
    """The gradient in units of ‖J_j‖ ‖r‖, only what the bounds do not excuse."""
    gradient = found.jacobian.T @ found.residuals
    gradient = np.where((found.point <= lower) & (gradient > 0), 0.0, gradient)
    gradient = np.where((found.point >= upper) & (gradient < 0), 0.0, gradient)
    return np.abs(gradient) / (np.linalg.norm(found.jacobian, axis=0) * np.sqrt(found.cost))


@pytest.mark.parametrize("name", BOUNDED)
def test_bounded_minimum(name):
    function, standard, _, _ = CLASSICS[name]
    lower, upper = (np.array(side, dtype=float) for side in BOUNDED[name])
    start = np.clip(np.array(standard, dtype=float), lower, upper)
    found = minimise(Functions(function=function, start=standard, lower=lower, upper=upper), start, Settings())
    assert found.reason.converged
    assert (found.point >= lower).all()
    assert (found.point <= upper).all()
    assert (found.at_bound != 0).any()
    # The relative offset of 1e-10 that ends the iteration, times its share of the residual.
    assert stationarity(found, lower, upper).max() < 1e-8
    middle = np.where(start == lower, lower + 0.01 * (upper - lower), start)
    middle = np.where(start == upper, upper - 0.01 * (upper - lower), middle)
    peer = least_squares(function, middle, bounds=(lower, upper), xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=5000)
    # SciPy's interior method ends a little inside the bounds.
    assert found.cost <= 2 * peer.cost * (1 + 1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_linear_problem_in_a_box_is_exact(seed):
    random = np.random.default_rng(seed)
    matrix, right = random.normal(size=(20, 6)), random.normal(size=20)
    lower, upper = np.full(6, -0.1), np.full(6, 0.1)
    problem = Functions(
        function=lambda x: matrix @ x - right,
        gradient=lambda _: matrix,
        start=(0.0,) * 6,
        linear=True,
        lower=lower,
        upper=upper,
    )
    found = minimise(problem, np.zeros(6), Settings())
    peer = lsq_linear(matrix, right, bounds=(lower, upper), method="bvls", tol=1e-14)
    assert found.reason.converged
    # Both solve the same small system on the same active set: rounding times the condition.
    np.testing.assert_allclose(found.point, peer.x, atol=1e-12)
    assert np.array_equal(found.at_bound, peer.active_mask)


def test_start_outside_is_projected_and_never_left():
    problem = Functions(function=lambda x: np.array([x[0] - 5, x[1] - 1]), start=(0, 0), lower=[0, 0], upper=[2, 3])
    found = minimise(problem, np.array([-7.0, 9.0]), Settings())
    assert found.point.tolist() == [2.0, 1.0]
    assert found.at_bound.tolist() == [1, 0]
    assert all((p >= 0).all() and (p <= [2, 3]).all() for p in problem.points)


def test_coordinate_fixed_by_equal_bounds_stays():
    problem = Functions(
        function=lambda x: np.array([x[0] + x[1] - 3, x[1] - x[0]]), start=(1, 1), lower=[1, -9], upper=[1, 9]
    )
    found = minimise(problem, np.array([1.0, 0.0]), Settings())
    # min (y-2)² + (y-1)² at 1.5.
    np.testing.assert_allclose(found.point, [1.0, 1.5], atol=1e-12)


@pytest.mark.parametrize("method", [Method.MARQUARDT, Method.DOGLEG, Method.GAUSS_NEWTON])
def test_positive_coordinate_never_reaches_zero(method):
    x = np.linspace(0, 4, 30)
    y = 3 * np.exp(-x / 0.7)
    problem = Functions(function=lambda b: b[0] * np.exp(-x / b[1]) - y, start=(1, 5), positive=np.array([False, True]))
    found = minimise(problem, np.array([1.0, 5.0]), Settings(method=method))
    # An exact fit: rounding only.
    np.testing.assert_allclose(found.point, [3.0, 0.7], rtol=1e-12)
    assert all(p[1].real > 0 for p in problem.points)


def test_positive_coordinate_drawn_to_zero_counts_as_at_its_bound():
    problem = Functions(
        function=lambda x: np.array([x[0] + 1, x[1] - 2, x[1] - 3]), start=(1, 1), positive=np.array([True, False])
    )
    found = minimise(problem, np.array([1.0, 1.0]), Settings())
    assert found.reason.converged
    assert 0 < found.point[0] < 1e-9
    assert found.at_bound.tolist() == [-1, 0]
    # min over y of (y-2)² + (y-3)².
    assert found.point[1] == pytest.approx(2.5, rel=1e-12)
