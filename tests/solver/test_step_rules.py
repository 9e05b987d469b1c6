"""Steps of each rule: their lengths, what they minimise, and the shortest one where columns are dependent."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.solver.description import DOGLEG, GAUSS_NEWTON, HEADER, MARQUARDT, Problem
from tests.solver.scratch import Scratch

RANDOM = np.random.default_rng(7)
SIZE = 4
FACTOR = np.triu(RANDOM.normal(size=(SIZE, SIZE))) + 2.0 * np.eye(SIZE)
IMAGE = RANDOM.normal(size=SIZE)


def step_of(solver, radius, rule, factor=FACTOR, image=IMAGE):
    """The step inside a radius."""
    n = len(image)
    system = np.zeros(HEADER, dtype=np.int64)
    system[Problem.n], system[Problem.rule] = n, rule
    step = np.zeros(n)
    solver("limited_step", system, n, factor.copy(), image, radius, Scratch(system), step)
    return step


FULL = np.linalg.solve(FACTOR, -IMAGE)


@pytest.mark.parametrize("share", [0.9, 0.3, 1e-2, 1e-6])
def test_a_damped_step_has_the_length_asked_for_and_is_the_best_of_that_length(solver, share):
    radius = share * np.linalg.norm(FULL)
    step = step_of(solver, radius, MARQUARDT)
    length = np.linalg.norm(step)
    # Moré's iteration ends within a tenth of the radius; steps of up to 1.1 radii are taken whole.
    assert abs(length - radius) <= 0.1 * radius * (1 + 1e-9)
    # On the sphere of its length the gradient of ‖A s + image‖² points along the step (Kuhn-Tucker).
    gradient = FACTOR.T @ (FACTOR @ step + IMAGE)
    if length < 0.999 * np.linalg.norm(FULL):
        assert gradient @ step / (np.linalg.norm(gradient) * length) == pytest.approx(-1.0, abs=1e-9)


@pytest.mark.parametrize("rule", [MARQUARDT, DOGLEG, GAUSS_NEWTON])
def test_short_steps_are_undamped(solver, rule):
    np.testing.assert_allclose(step_of(solver, 1.01 * np.linalg.norm(FULL), rule), FULL, rtol=1e-13)


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1, 1e-4])
def test_powell_s_path_goes_along_the_gradient_and_then_to_the_undamped_step(solver, share):
    """The point of the path at the radius, found by bisection along it."""
    radius = share * np.linalg.norm(FULL)
    gradient = FACTOR.T @ IMAGE
    cauchy = -(gradient @ gradient) / np.sum((FACTOR @ gradient) ** 2) * gradient

    def path(t):
        return t * cauchy if t <= 1.0 else cauchy + (t - 1.0) * (FULL - cauchy)

    low, high = 0.0, 2.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.linalg.norm(path(middle)) < radius else (low, middle)
    np.testing.assert_allclose(step_of(solver, radius, DOGLEG), path(low), rtol=1e-9)


@pytest.mark.parametrize("share", [0.9, 1e-3])
def test_a_shortened_step_keeps_its_direction(solver, share):
    np.testing.assert_allclose(step_of(solver, share * np.linalg.norm(FULL), GAUSS_NEWTON), share * FULL, rtol=1e-12)


@pytest.mark.parametrize("free", [(1,), (0, 3), (3,), (0, 1, 2, 3)])
def test_of_all_steps_that_do_equally_well_the_shortest_is_taken(solver, free):
    factor = FACTOR.copy()
    for row in free:
        factor[row] = 0.0
    wanted = -np.linalg.pinv(factor) @ IMAGE
    # The rows that are left have a condition of about ten; one refinement leaves rounding.
    np.testing.assert_allclose(step_of(solver, np.inf, GAUSS_NEWTON, factor), wanted, rtol=0, atol=1e-13)
