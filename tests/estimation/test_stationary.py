"""An unknown that no residual feels to first order has no standard deviation, however its derivative is rounded."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.uncertainty.informed import without_stationary
from mbm.report.types import SolveStatus
from mbm.solver.decisions import MOST_GROUPS


@pytest.mark.parametrize("noise", [":sigma 0.1", ""], ids=["stated", "unknown"])
@pytest.mark.parametrize("start", ["3.141592653589793", "3"], ids=["there", "near"])
def test_a_cosine_at_half_a_turn(start, noise):
    text = (
        f"(problem p (data d (table (y) (-1) (-1.01))) (unknowns (t :init {start})) (observe d (= y (cos t)) {noise}))"
    )
    found = mbm.loads(text).solve()
    assert found.first.status is SolveStatus.UNOBSERVABLE
    assert float(found["t"].value) == pytest.approx(3.141592653589793, abs=1e-6)  # the cost is flat to 1e-12 there
    assert "no equation changes with `t`" in found.observability.unobservable[0].sentence
    assert found.observability.rank == 0


def test_the_others_keep_their_deviations():
    text = """(problem p (data d (table (y) (-1) (-1))) (unknowns (t :init 3.141592653589793) (a :init 0))
      (observe d (= y (+ a (cos t))) :sigma 0.1) (constraints (normal a 0 1)))"""
    found = mbm.loads(text).solve()
    assert float(found["a"].sigma) == pytest.approx((2 / 0.01 + 1) ** -0.5, rel=1e-9)


def test_a_weakly_determined_unknown_keeps_its_deviation():
    text = """(problem p (data d (table (x y) (1 0.001) (2 0.002) (3 -0.001))) (unknowns (p :init 1) (q :init 0))
      (observe d (= y (+ (* p x) (* 1e-9 q))) :sigma 1e-3))"""
    found = mbm.loads(text).solve()
    assert found.first.status is SolveStatus.CONVERGED
    # Two-parameter line: var(q) = 1e18 σ² Σx² / (n Σ(x − x̄)²)
    assert float(found["q"].sigma) == pytest.approx(1e9 * 1e-3 * (14 / 6) ** 0.5, rel=1e-9)


class Cosines:
    """The sum of the cosines of many angles, and each of a few more by itself: how often is the Jacobian made?"""

    def __init__(self, together, alone):
        self.together, self.dimension, self.count, self.jacobians = together, together + alone, 1 + alone, 0
        self.lower, self.upper = np.full(self.dimension, -np.inf), np.full(self.dimension, np.inf)
        self.positive, self.turning, self.linear = np.zeros(self.dimension, bool), None, False

    def residuals(self, x):
        return np.concatenate([[np.cos(x[: self.together]).sum() - self.together], x[self.together :] - 1.0])

    def jacobian(self, x):
        self.jacobians += 1
        found = np.zeros((self.count, self.dimension))
        found[0, : self.together] = -np.sin(x[: self.together])
        found[1:, self.together :] = np.eye(self.count - 1)
        return found

    def retract(self, x, step):
        return x + step

    def coordinates(self, x):
        return x

    def placed(self, _, coordinates):
        return coordinates


@pytest.mark.parametrize("angles", [5, 400])
def test_many_suspects_are_looked_into_together(angles):
    # Of angles near zero the cosine has a derivative of 1e-9 and a curvature of 1.
    equations = Cosines(angles, 3)
    found = minimise(equations, np.concatenate([np.full(angles, 1e-9), np.full(3, 2.0)]), Settings())
    before = equations.jacobians
    kept = without_stationary(equations, found)
    assert equations.jacobians - before <= MOST_GROUPS
    assert not kept.jacobian[:, :angles].any()
    np.testing.assert_array_equal(kept.jacobian[:, angles:], found.jacobian[:, angles:])


def test_the_second_order_term_is_not_taken_of_many_unknowns():
    """A Jacobian for each of 400 unknowns would be made for it, where a few iterations are enough."""
    equations = Cosines(400, 3)
    minimise(equations, np.full(403, 0.3), Settings())
    assert equations.jacobians < 100


@pytest.mark.parametrize("noise", [":sigma 0.1", ":sigma unknown"], ids=["stated", "unknown"])
def test_a_bare_estimator_leaves_no_deviation_either(noise):
    text = f"(problem p (data d (table (y) (1) (1.03))) (unknowns (t :init 0.3)) (observe d (= y (cos t)) {noise}))"
    found = mbm.loads(text).compile().estimator("y")([1.0, 1.03])
    assert (found.status, found.clean) == ("unobservable", False)
    assert np.isnan(found.sigma).all()
