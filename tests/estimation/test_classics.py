"""Moré, Garbow and Hillstrom (1981): the listed minima from the standard starts and from 10 and 100 times as far."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from mbm.equations.types import Reason
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from tests.estimation.classics import CLASSICS, Functions

CASES = [(name, factor) for name, (_, _, _, factors) in CLASSICS.items() for factor in factors]


@pytest.mark.parametrize(("name", "factor"), CASES, ids=[f"{n}-x{f}" for n, f in CASES])
def test_reaches_a_listed_minimum(name, factor):
    function, standard, minima, _ = CLASSICS[name]
    start = factor * np.array(standard, dtype=float)
    found = minimise(Functions(function=function, start=tuple(start)), start, Settings())
    assert found.reason.converged
    # Minima are listed to six digits; a zero minimum must come out as zero beside residuals of order one.
    assert any(found.cost == pytest.approx(cost, rel=2e-6, abs=1e-18) for cost in minima)


@pytest.mark.parametrize("name", CLASSICS)
def test_cost_never_grows(name):
    function, standard, _, _ = CLASSICS[name]
    problem = Functions(function=function, start=standard)
    costs = []
    for most in range(300):
        found = minimise(problem, np.array(standard, dtype=float), Settings(max_iterations=most))
        costs.append(found.cost)
        if found.reason is not Reason.MAX_ITERATIONS:
            break
    assert len(costs) > 2
    # 1e-10: the rounding of a sum of squares whose terms cancel.
    assert all(later <= earlier * (1 + 1e-10) + 1e-25 for earlier, later in pairwise(costs))


def test_same_start_gives_the_same_bits():
    function, standard, _, _ = CLASSICS["Osborne 2"]
    first, second = (
        minimise(Functions(function=function, start=standard), np.array(standard, dtype=float), Settings())
        for _ in range(2)
    )
    assert np.array_equal(first.point, second.point)
    assert first.evaluations == second.evaluations
