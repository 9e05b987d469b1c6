"""What may go wrong on the way, and linear equations."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mbm.equations.types import Reason
from mbm.estimation.minimise import minimise as module
from mbm.estimation.minimise.minimise import minimise, solver_name
from mbm.estimation.minimise.native.iteration import one_step_suits
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from mbm.text.types import MbmError
from tests.estimation.classics import Functions


def linear(matrix, right, start):
    return Functions(function=lambda x: matrix @ x - right, gradient=lambda _: matrix, start=tuple(start), linear=True)


def test_linear_problem_takes_one_step():
    random = np.random.default_rng(3)
    matrix, truth = random.normal(size=(50, 7)), random.normal(size=7)
    right = matrix @ truth + random.normal(size=50)
    found = minimise(linear(matrix, right, np.zeros(7)), np.full(7, 1e6), Settings())
    assert (found.reason, found.iterations) == (Reason.ONE_STEP, 1)
    # A start 1e6 away costs six digits, which refinement restores.
    np.testing.assert_allclose(found.point, np.linalg.lstsq(matrix, right, rcond=None)[0], rtol=1e-12)


def test_linear_problem_without_unique_answer_stays_near_the_start():
    matrix = np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    found = minimise(linear(matrix, np.array([2.0, 4.0]), np.zeros(3)), np.array([3.0, 1.0, 7.0]), Settings())
    # x + y = 2, nearest to (3, 1); z appears nowhere and keeps its start.
    np.testing.assert_allclose(found.point, [2.0, 0.0, 7.0], atol=1e-12)


@pytest.mark.parametrize(
    ("method", "name"),
    [
        (Method.AUTO, "linear"),
        (Method.MARQUARDT, "lm"),
        (Method.DOGLEG, "dogleg"),
        (Method.GAUSS_NEWTON, "gauss-newton"),
        (Method.CLOSED_FORM, "closed-form"),
        (Method.DIRECT_SEARCH, "lm"),
        (Method.IPOPT, "lm"),
    ],
)
def test_choice_of_solver(method, name):
    problem = linear(np.eye(2), np.zeros(2), (0, 0))
    assert solver_name(problem, Settings(method=method)) == name


def test_bounds_are_not_for_the_one_step_solver():
    problem = linear(np.eye(2), np.zeros(2), (0, 0))
    problem.lower = np.array([1.0, -np.inf])
    assert not one_step_suits(problem)
    assert minimise(problem, np.zeros(2), Settings()).point.tolist() == [1.0, 0.0]


def test_product_of_unknowns_moves_least_and_others_are_found():
    y = np.arange(1.0, 6.0)
    problem = Functions(
        function=lambda p: np.concatenate([p[0] * p[1] * y - 6 * y, p[2] - np.array([3.0, 5.0])]), start=(1, 1, 0)
    )
    found = minimise(problem, np.array([2.0, 1.0, 0.0]), Settings())
    assert found.reason.converged
    assert found.point[0] * found.point[1] == pytest.approx(6.0, rel=1e-12)
    assert found.point[2] == pytest.approx(4.0, rel=1e-12)


def test_unused_unknown_keeps_its_start():
    problem = Functions(function=lambda p: np.array([p[0] ** 2 - 2, p[0] - 1]), start=(1, 1))
    found = minimise(problem, np.array([3.0, 17.25]), Settings())
    assert found.reason.converged
    assert found.point[1] == 17.25


@pytest.mark.parametrize("method", [Method.MARQUARDT, Method.DOGLEG, Method.GAUSS_NEWTON])
def test_trial_points_without_a_value_are_refused(method):
    # log of a negative number beyond 0; the Gauss-Newton step from 20 leads there.
    def function(x):
        return np.array([np.log(x[0]) if x[0].real > 0 else np.nan * x[0], 0 * x[0]])

    found = minimise(Functions(function=function, start=(1,)), np.array([20.0]), Settings(method=method))
    assert found.reason.converged
    assert found.point[0] == pytest.approx(1.0, abs=1e-12)


def test_points_without_a_jacobian_are_refused():
    # The derivative is infinite at exactly the point that the first full step meets.
    def gradient(x):
        return np.array([[2.0], [1.0]]) if abs(x[0] - 1.0) > 1e-300 else np.array([[np.inf], [1.0]])

    problem = Functions(function=lambda x: np.array([2 * x[0] - 2, x[0] - 1]), gradient=gradient, start=(0,))
    found = minimise(problem, np.array([3.0]), Settings(method=Method.MARQUARDT))
    assert np.isfinite(found.jacobian).all()
    assert found.point[0] == pytest.approx(1.0, abs=1e-6)


def test_overflow_on_the_way_is_survived():
    x = np.linspace(0, 1, 12)
    problem = Functions(function=lambda b: np.exp(b[0] * x) - np.exp(3 * x), start=(1,))
    found = minimise(problem, np.array([-400.0]), Settings())
    assert np.isfinite(found.cost)
    found = minimise(problem, np.array([200.0]), Settings(max_iterations=300))
    assert found.point[0] == pytest.approx(3.0, rel=1e-12)


def test_no_value_at_the_start_names_the_row():
    problem = Functions(function=lambda x: np.array([x[0], x[0] - 1, 1 / x[0]]), start=(1,))
    problem.function = lambda x: np.array([x[0], np.nan, np.inf])
    found = minimise(problem, np.array([1.0]), Settings())
    assert (found.reason, found.bad_row, found.iterations) == (Reason.NOT_FINITE_AT_START, 1, 0)
    assert not found.reason.converged


def test_no_derivative_at_the_start_names_the_row():
    problem = Functions(
        function=lambda x: np.array([x[0], x[0]]), gradient=lambda _: np.array([[1.0], [np.nan]]), start=(1,)
    )
    found = minimise(problem, np.array([1.0]), Settings())
    assert (found.reason, found.bad_row) == (Reason.JACOBIAN_NOT_FINITE_AT_START, 1)


def test_wrong_jacobian_does_not_count_as_converged():
    problem = Functions(
        function=lambda x: np.array([x[0] - 1, x[0] + 1.5]), gradient=lambda _: np.array([[-1.0], [-1.0]]), start=(4,)
    )
    found = minimise(problem, np.array([4.0]), Settings())
    assert found.reason is Reason.FLAT
    assert found.point[0] == 4.0


def test_only_the_start_is_finite():
    def function(x):
        return np.array([2.0, 1.0]) * (1.0 if x[0] == 1 else np.nan)

    problem = Functions(function=function, gradient=lambda _: np.array([[1.0], [1.0]]), start=(1,))
    found = minimise(problem, np.array([1.0]), Settings())
    assert found.reason is Reason.NO_FINITE_STEP
    # A quarter each time would take 27 trials from 1 to its last digit, 2^-53; each may be a search for corrections.
    assert found.evaluations < 15


@pytest.mark.parametrize("gap", [1e-1, 1e-4, 1e-8])
def test_a_start_beside_the_end_of_what_is_defined(gap):
    """The square root's minimum of one residual: steps that lead below zero shrink, and then grow again."""

    def function(x):
        with np.errstate(invalid="ignore"):
            return np.array([np.sqrt(x[0]) - 3.0, 0.5 * (x[0] - 9.0)])

    def gradient(x):
        return np.array([[0.5 / np.sqrt(x[0])], [0.5]])

    found = minimise(Functions(function=function, gradient=gradient, start=(gap,)), np.array([gap]), Settings())
    assert found.reason.converged
    assert found.point[0] == pytest.approx(9.0, rel=1e-9)


def test_limit_of_iterations():
    problem = Functions(function=lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0], 0.1]), start=(0, 0))
    found = minimise(problem, np.array([-1.2, 1.0]), Settings(max_iterations=1))
    assert (found.reason, found.iterations) == (Reason.MAX_ITERATIONS, 1)


def test_start_at_the_minimum_is_recognised():
    problem = Functions(function=lambda x: np.array([x[0] - 1, x[0] - 3]), start=(2,))
    found = minimise(problem, np.array([2.0]), Settings())
    assert (found.reason, found.iterations) == (Reason.SMALL_OFFSET, 0)


def test_exact_fit():
    problem = Functions(
        function=lambda x: np.array([np.exp(x[0]) - 2, np.exp(2 * x[0]) - 4, x[0] - np.log(2)]), start=(0,)
    )
    found = minimise(problem, np.array([0.0]), Settings())
    assert found.reason in (Reason.EXACT_FIT, Reason.ROUNDING)
    assert found.point[0] == pytest.approx(np.log(2), rel=1e-14)


def test_every_reason_has_a_sentence():
    assert all(len(reason.sentence) > 20 for reason in Reason)


def test_units_of_the_unknowns_do_not_matter():
    x = np.linspace(0, 3, 25)
    y = 2 * np.exp(-1.3 * x) + 0.01 * np.sin(40 * x)
    plain = Functions(function=lambda b: b[0] * np.exp(-b[1] * x) - y, start=(1, 1))
    small = Functions(function=lambda b: 1e9 * b[0] * np.exp(-1e-7 * b[1] * x) - y, start=(1, 1))
    one = minimise(plain, np.array([1.0, 0.3]), Settings())
    other = minimise(small, np.array([1e-9, 0.3e7]), Settings())
    np.testing.assert_allclose(other.point * [1e9, 1e-7], one.point, rtol=1e-11)
    assert other.iterations == one.iterations


def test_nothing_to_estimate_and_no_equations_are_said():
    problem = linear(np.eye(2), np.zeros(2), (0, 0))
    problem.count = 0
    with pytest.raises(MbmError, match="no-equations"):
        minimise(problem, np.zeros(2), Settings())
    problem.dimension = 0
    with pytest.raises(MbmError, match="no-unknowns"):
        minimise(problem, np.zeros(2), Settings())


def test_too_large_a_matrix_is_refused():
    problem = linear(np.eye(2), np.zeros(2), (0, 0))
    problem.count = module.DENSE_LIMIT
    with pytest.raises(MbmError, match="too-many-unknowns"):
        minimise(problem, np.zeros(2), Settings())


def test_a_solve_loads_no_scipy():
    code = (
        "import sys; from mbm.estimation.minimise import minimise;"
        "from mbm.estimation.uncertainty import observability, variance;"
        "variance.fit_statistics(3.0, 5, 2, True); sys.exit('scipy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[2], check=False).returncode == 0
