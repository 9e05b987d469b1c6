"""The conformance suite of solvers: ours conform, and solvers with one fault each are refused with the reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mbm.solution.solvers.box import one_step_suits
from mbm.solution.solvers.linear import LINEAR
from mbm.solution.solvers.marquardt import MARQUARDT
from mbm.solution.solvers.standard import SOLVERS
from mbm.solution.types import Equations, Floats, Minimum, Reason, Solver
from mbm.testing.requirement import NotConformingError
from mbm.testing.solvers import check_solver, samples

MOVING = [solver for solver in SOLVERS.values() if solver.name != "closed-form"]
"""All but the answers of closed forms, which stay where they are."""


@pytest.mark.parametrize("solver", MOVING, ids=lambda solver: solver.name)
def test_our_solvers_conform(solver: Solver) -> None:
    suited = [sample for sample in samples() if solver is not LINEAR or one_step_suits(sample)]
    assert suited
    check_solver(solver, suited)


def test_the_known_answers_are_minima() -> None:
    """Stationary inside the bounds; at a bound the descent leads outwards."""
    for sample in samples():
        gradient = sample.jacobian(sample.answer).T @ sample.residuals(sample.answer)
        inside = sample.answer < sample.upper
        assert np.abs(gradient[inside]).max(initial=0.0) < 1e-12
        assert (gradient[~inside] < 0).all()


class Faulty:
    """Marquardt's method with nothing changed."""

    name = "faulty"

    def init(self, equations: Equations, start: Floats, tolerance: float) -> Any:
        return MARQUARDT.init(equations, start, tolerance)

    def step(self, equations: Equations, state: Any) -> Any:
        return MARQUARDT.step(equations, state)

    def finished(self, state: Any) -> Reason | None:
        return MARQUARDT.finished(state)

    def minimum(self, state: Any, reason: Reason) -> Minimum:
        return MARQUARDT.minimum(state, reason)


class NeverDone(Faulty):
    def finished(self, state: Any) -> Reason | None:
        return None


class DoneTooSoon(Faulty):
    def finished(self, state: Any) -> Reason | None:
        return Reason.SMALL_OFFSET


class Resigning(Faulty):
    def finished(self, state: Any) -> Reason | None:
        return Reason.FLAT


class Climbing(Faulty):
    def minimum(self, state: Any, reason: Reason) -> Minimum:
        found = super().minimum(state, reason)
        return replace(found, cost=found.cost + 1e9)


class Leaving(Faulty):
    def minimum(self, state: Any, reason: Reason) -> Minimum:
        found = super().minimum(state, reason)
        return replace(found, point=found.point + 1e-3)


@pytest.mark.parametrize(
    ("solver", "promise"),
    [
        (NeverDone(), "it finishes within"),
        (DoneTooSoon(), "the minimum is where it is known to be"),
        (Resigning(), "it converges; it stopped because"),
        (Climbing(), "the cost never grows"),
        (Leaving(), "never leaves the bounds|where it is known to be"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Faulty) else "",
)
def test_a_fault_is_told(solver: Solver, promise: str) -> None:
    with pytest.raises(NotConformingError, match=promise):
        check_solver(solver)
