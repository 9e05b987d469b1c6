"""Equations that Python evaluates in the compiled solver: what they raise comes out; the text run as Python agrees."""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter

import numpy as np
import pytest

from mbm.equations.types import Reason
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.native import function
from mbm.estimation.native.callbacks import InterpretedCode
from mbm.estimation.settings import Settings
from mbm.problem.types import Method
from tests.estimation.classics import CLASSICS, Functions
from tests.estimation.constrained.toys import Toy


class Stopping(Functions):
    """Equations whose third evaluation raises."""

    def __init__(self, failure, of):
        super().__init__(function=lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), start=(0, 0))
        self.failure, self.of, self.asked = failure, of, 0

    def _count(self, what):
        if what == self.of:
            self.asked += 1
            if self.asked == 3:
                raise self.failure

    def residuals(self, x):
        self._count("residuals")
        return super().residuals(x)

    def jacobian(self, x):
        self._count("jacobian")
        return super().jacobian(x)


@pytest.mark.parametrize("failure", [ValueError("no sense"), KeyboardInterrupt(), MemoryError()], ids=repr)
@pytest.mark.parametrize("of", ["residuals", "jacobian"])
def test_what_an_evaluation_raises_is_raised_and_nothing_is_asked_after_it(failure, of):
    problem = Stopping(failure, of)
    with pytest.raises(type(failure)) as caught:
        minimise(problem, np.array([-1.2, 1.0]), Settings())
    assert caught.value is failure
    assert problem.asked == 3


def test_values_of_another_shape_are_raised_as_what_an_evaluation_raises_is():
    problem = Functions(function=lambda x: np.array([x[0], x[1], 1.0]), start=(0, 0))
    problem.jacobian = lambda x: np.zeros((3, 5))
    with pytest.raises(ValueError, match="broadcast"):
        minimise(problem, np.array([-1.2, 1.0]), Settings())


def test_an_end_that_has_no_values_when_asked_again_is_none():
    """The last of all evaluations is that of the end."""

    def solved(asked, last):
        problem = Functions(function=lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), start=(0, 0))
        own = problem.residuals

        def residuals(x):
            asked.append(x)
            return own(x) if len(asked) < last else own(x) * [1.0, np.nan]

        problem.residuals = residuals
        return minimise(problem, np.array([-1.2, 1.0]), Settings())

    asked = []
    assert solved(asked, np.inf).reason.converged
    found = solved([], len(asked))
    assert found.reason is Reason.NO_FINITE_STEP
    assert found.bad_row == 1


def test_an_interruption_leaves_the_best_point_so_far():
    class Soon:
        requested = False

    asked = Soon()
    problem = Functions(function=lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), start=(0, 0))
    own = problem.jacobian

    def jacobian(x):
        asked.requested = len(problem.points) > 1
        return own(x)

    problem.jacobian = jacobian
    found = minimise(problem, np.array([-1.2, 1.0]), Settings(interruption=asked))
    assert found.reason is Reason.INTERRUPTED
    assert found.iterations == 1
    assert found.cost < 24.2  # that of the start


@pytest.mark.parametrize("name", ["Rosenbrock", "Meyer", "Kowalik-Osborne", "Osborne 1", "Brown badly scaled"])
@pytest.mark.parametrize("method", [Method.MARQUARDT, Method.DOGLEG])
def test_the_text_as_python_finds_the_listed_minima(name, method, monkeypatch):
    monkeypatch.setattr(function, "solver_code", InterpretedCode)
    residuals, standard, minima, _ = CLASSICS[name]
    start = np.array(standard, dtype=float)
    found = minimise(Functions(function=residuals, start=standard), start, Settings(method=method, max_iterations=300))
    assert found.reason.converged
    # As tests/estimation/test_classics.py: listed to six digits.
    assert any(found.cost == pytest.approx(cost, rel=2e-6, abs=1e-18) for cost in minima)


def test_each_part_of_constrained_equations_is_evaluated_once_at_a_point():
    """The solver asks for their values and derivatives together, and for both again where a round of penalties ends."""
    asked = []

    class Counted(Toy):
        def constraint_values(self, x):
            asked.append(("values", tuple(x)))
            return super().constraint_values(x)

        def constraint_jacobian(self, x):
            asked.append(("slopes", tuple(x)))
            return super().constraint_jacobian(x)

    circle = Counted(
        function=lambda x: x - np.array([3.0, 4.0]), size=2, rows=2, equal=lambda x: [x @ x - 1.0], counts=(1, 0)
    )
    system = function.system_of_function(circle, Settings(), constrained=True)
    ends = system.one(np.array([1.0, 0.0]), end="set_end")
    # the constraint holds to rounding; 1e-10 is where steps count as small
    assert ends.numbers[0] == pytest.approx([0.6, 0.8], abs=1e-10)
    for point, parts in groupby(asked, key=itemgetter(1)):
        told = [part for part, _ in parts]
        assert len(told) == len(set(told)), point
