"""Random problems with known properties: against SLSQP, with redundant rows, infeasible, undefined in places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from mbm.equations.types import Reason
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.uncertainty.observability import observed_at
from mbm.problem.kinds import ConstraintMethod
from tests.estimation.constrained.toys import Toy, toy

BOTH = pytest.mark.parametrize("method", list(ConstraintMethod))


def settings(method: ConstraintMethod) -> Settings:
    return Settings(constraints=method, max_iterations=200)


def random_problem(seed: int) -> tuple[Toy, np.ndarray, np.ndarray]:
    """A mildly nonlinear problem with equations, inequalities and a box that a known point meets, and a start."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 8))
    m, equations, inequalities = n + int(random.integers(0, 6)), int(random.integers(0, min(3, n))), 3
    model, data = random.normal(size=(m, n)), 3 * random.normal(size=m)
    rows, limits = random.normal(size=(equations, n)), random.normal(size=(inequalities, n))
    inside = random.normal(size=n)
    rooms = random.uniform(0, 1, inequalities)
    bend = 0.2 * (seed % 2)

    def equal(x):
        return rows @ (x - inside) + bend * ((rows @ x) ** 2 - (rows @ inside) ** 2)

    def below(x):
        return limits @ (x - inside) - rooms + 0.3 * bend * (x @ x - inside @ inside)

    start = random.normal(size=n)
    problem = toy(
        lambda x: model @ x - data + bend * np.sin(model @ x),
        start,
        equal=equal if equations else None,
        below=below,
        low=inside - random.uniform(0.1, 1.5, n),
        high=inside + random.uniform(0.1, 1.5, n),
    )
    return problem, start, inside


@BOTH
@pytest.mark.parametrize("seed", range(25))
def test_no_worse_than_slsqp_and_exactly_feasible(seed, method):
    problem, start, _ = random_problem(seed)
    found = minimise(problem, start, settings(method))
    assert found.reason.converged
    values = problem.constraint_values(found.point)
    assert np.where(problem.equality, np.abs(values), values).max() <= 1e-9
    assert (found.point >= problem.lower).all()
    assert (found.point <= problem.upper).all()
    constraints = [
        {"type": kind, "fun": lambda x, p=picked, s=sign: s * problem.constraint_values(x)[p]}
        for kind, picked, sign in (("eq", problem.equality, 1), ("ineq", ~problem.equality, -1))
        if picked.any()
    ]
    other = minimize(
        lambda x: float(problem.residuals(x) @ problem.residuals(x)),
        found.point,
        constraints=constraints,
        bounds=list(zip(problem.lower, problem.upper, strict=True)),
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-15},
    )
    # SLSQP starts at the answer: it must not find anything better there; it allows violations of about 1e-8.
    assert found.cost <= other.fun + 1e-6 * (1 + other.fun)


@BOTH
@pytest.mark.parametrize("seed", range(10))
def test_multipliers_balance_the_gradient(seed, method):
    problem, start, _ = random_problem(seed)
    found = minimise(problem, start, settings(method))
    state = found.constraints
    force = found.residuals @ found.jacobian + state.multipliers @ state.slopes
    free = (found.point > problem.lower) & (found.point < problem.upper)
    # The gradients are of size 10; the offset of 1e-10 standard deviations and their cancellation leave far less.
    np.testing.assert_allclose(force[free], 0, atol=1e-6)
    assert (state.multipliers[~problem.equality] >= 0).all()
    assert (force[~free] * np.where(found.point <= problem.lower, 1, -1)[~free] >= -1e-6).all()


@BOTH
def test_redundant_and_repeated_equations_change_nothing(method):
    random = np.random.default_rng(3)
    model, data = random.normal(size=(8, 5)), random.normal(size=8)
    rows = random.normal(size=(2, 5))
    repeated = np.vstack([rows, 2 * rows[0], rows[0] - 3 * rows[1], rows[1]])
    start = np.zeros(5)
    found = [
        minimise(
            toy(lambda x: model @ x - data, start, equal=lambda x, a=each: a @ x - a @ np.ones(5)),
            start,
            settings(method),
        )
        for each in (rows, repeated)
    ]
    # Lagrange's equations, solved directly.
    matrix = np.block([[model.T @ model, rows.T], [rows, np.zeros((2, 2))]])
    exact = np.linalg.solve(matrix, np.concatenate([model.T @ data, rows @ np.ones(5)]))[:5]
    for each in found:
        np.testing.assert_allclose(each.point, exact, rtol=1e-10, atol=1e-12)
    observed = [observed_at(each, each.point) for each in found]
    assert [(o.rank, o.dimension, o.equalities) for o in observed] == [(5, 5, 2), (5, 5, 2)]


@BOTH
def test_degenerate_vertex_does_not_cycle(method):
    """Twelve planes through one point, of which the nearest point to the data is that point."""
    random = np.random.default_rng(5)
    normals = random.normal(size=(12, 3)) + np.array([0.0, 0.0, 2.0])
    start = np.array([0.0, 0.0, -5.0])
    problem = toy(lambda x: x - np.array([0.0, 0.0, 3.0]), start, below=lambda x: normals @ x)
    found = minimise(problem, start, settings(method))
    assert found.reason.converged
    other = minimize(
        lambda x: float(problem.residuals(x) @ problem.residuals(x)), start, method="SLSQP",
        constraints={"type": "ineq", "fun": lambda x: -(normals @ x)}, options={"ftol": 1e-15},
    )  # fmt: skip
    assert found.cost == pytest.approx(other.fun, rel=1e-7)


@BOTH
def test_contradictions_name_the_smallest_set(method):
    start = np.zeros(3)
    problem = toy(
        lambda x: x - np.array([1.0, 2.0, 3.0]),
        start,
        equal=lambda x: np.stack([x[0] - x[1]]),
        below=lambda x: np.stack([x[2] - 10, 4 - x[0], x[1] - 3, -x[2], x[0] ** 2 + x[2] ** 2 - 100]),
        high=np.array([5.0, np.inf, np.inf]),
    )
    found = minimise(problem, start, settings(method))
    assert found.reason is Reason.INFEASIBLE
    # x0 = x1, x0 >= 4 and x1 <= 3; the bound x0 <= 5 and the others take no part.
    assert found.constraints.conflict.constraints == (0, 2, 3)
    assert found.constraints.conflict.lower == found.constraints.conflict.upper == ()
    assert found.constraints.conflict.smallest


@BOTH
def test_contradiction_with_a_bound_and_a_curve(method):
    start = np.array([0.5, 0.5])
    problem = toy(
        lambda x: x - 1.0,
        start,
        below=lambda x: np.stack([x @ x - 1, x[1] - 5]),
        low=np.array([1.5, -9.0]),
    )
    found = minimise(problem, start, settings(method))
    assert found.reason is Reason.INFEASIBLE
    assert found.constraints.conflict.constraints == (0,)
    assert found.constraints.conflict.lower == (0,)


@BOTH
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_units_of_constraints_do_not_matter(unit, method):
    start = np.array([2.0, 2.0])
    problem = toy(
        lambda x: np.stack([x[0] - 2, x[1] - 1]),
        start,
        equal=lambda x: unit * np.stack([x[0] - 2 * x[1] + 1]),
        below=lambda x: np.stack([0.25 * x[0] ** 2 + x[1] ** 2 - 1]) / unit,
    )
    found = minimise(problem, start, settings(method))
    assert found.reason.converged
    assert found.cost == pytest.approx(9 - 2.875 * np.sqrt(7), rel=1e-9)


@BOTH
def test_trial_points_without_a_value_are_survived(method):
    """log(x) has no value on the way that the first step takes."""
    start = np.array([5.0, 0.1])

    def residuals(x):
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.stack([3 * (np.log(x[0]) + 2), x[1] - 2])

    problem = toy(residuals, start, below=lambda x: np.stack([x[0] + x[1] - 1]))
    found = minimise(problem, start, settings(method))
    assert found.reason.converged
    assert found.constraints.violated.tolist() == [False]
    assert found.constraints.active.tolist() == [True]


@BOTH
def test_constraint_without_a_value_at_the_start_says_which(method):
    start = np.array([-1.0, 0.0])

    def below(x):
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.stack([x[1] - 1, np.log(x[0])])

    found = minimise(toy(lambda x: x - 3.0, start, below=below), start, settings(method))
    assert found.reason is Reason.NOT_FINITE_AT_START
    assert found.bad_row == 2 + 1  # two residuals, then the second constraint


@BOTH
@pytest.mark.parametrize("seed", range(10))
def test_inequalities_that_do_not_bind_leave_the_plain_minimum(seed, method):
    random = np.random.default_rng(seed)
    model, data = random.normal(size=(9, 4)), random.normal(size=9)
    plain = np.linalg.lstsq(model, data, rcond=None)[0]
    limits = random.normal(size=(5, 4))
    start = 5 * random.normal(size=4)
    problem = toy(lambda x: model @ x - data, start, below=lambda x: limits @ (x - plain) - 0.1)
    found = minimise(problem, start, settings(method))
    np.testing.assert_allclose(found.point, plain, rtol=1e-9, atol=1e-9)
    assert not found.constraints.active.any()
    assert observed_at(found, found.point).dimension == 4


@BOTH
def test_interruption_gives_the_best_point_so_far(method):
    problem, start, _ = random_problem(7)

    class After:
        """A user who interrupts when asked for the third time."""

        asked = 0

        @property
        def requested(self):
            self.asked += 1
            return self.asked > 2

    found = minimise(problem, start, replace(settings(method), interruption=After()))
    assert found.reason is Reason.INTERRUPTED
    assert 0 < found.iterations <= 2
    assert np.isfinite(found.cost)
