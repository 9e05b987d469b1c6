"""The χ² law in all languages of the solver's text, against mpmath; the grids have extreme arguments."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mbm.solver import chi_square
from tests.oracles.laws import EXACT, FREEDOM, GRID, close, tail


@pytest.mark.parametrize("dof", FREEDOM)
def test_tails(solver, dof):
    points = [point for point in GRID if point[1] == dof]
    tails = np.empty(len(points))
    values = np.array([value for value, _ in points])
    assert solver("chi_square_tails", len(points), values, np.full(len(points), dof), tails) == 0
    for point, found in zip(points, tails.tolist(), strict=True):
        assert close(found, point), (point, float(tail(*point)))
        assert solver("chi_square_tail", point[0], dof) == found


def test_digits_that_are_stated(solver):
    """Relative errors of 1e-12 for some hundred degrees of freedom, 1e-9 for a million."""
    for dof, error in ((100, 1e-12), (301, 1e-12), (1_000_000, 1e-9)):
        for share in (0.9, 0.999, 1.0, 1.001, 1.01):
            wanted = tail(share * dof, dof)
            assert wanted < 1e-290 or abs(solver("chi_square_tail", share * dof, dof) / wanted - 1) < error


def test_a_continued_fraction_ends_where_rounding_does(monkeypatch):
    """Factors that stay two units of the last place from 1 kept it going for a hundred thousand terms: 10 ms each."""
    asked = []
    monkeypatch.setattr(chi_square, "fabs", lambda number: asked.append(number) or abs(number))
    for dof in (1, 2, 3, 5, 40):
        for value in np.geomspace(2 * dof + 4.0, 1e6, 300).tolist():
            asked.clear()
            chi_square.chi_square_tail(value, dof)
            assert len(asked) < 300  # three for each term; from twice the mean on less than a hundred are needed


@pytest.mark.parametrize("dof", FREEDOM)
def test_a_tail_is_all_at_zero_and_nothing_far_out(solver, dof):
    tails = np.empty(3)
    solver("chi_square_tails", 3, np.array([0.0, -1.0, math.inf]), np.full(3, dof), tails)
    assert tails.tolist() == [1.0, 1.0, 0.0]


@pytest.mark.parametrize("size", [1, 2, 3, 6, 12])
def test_variance_that_is_left_inside_a_limit(solver, size):
    for limit in (0.01, 0.5, 1.0, 4.0, 6.25, 9.0, 25.0, 60.0):
        inside = [1 - tail(limit, size + more) for more in (2, 0)]
        # Both probabilities are differences from 1, known to 1e-16 beside themselves.
        assert abs(solver("consistency", limit, size) - inside[0] / inside[1]) < 1e-14 / inside[1]


@pytest.mark.parametrize("dof", [*range(1, 8), 30, 31, 62, 63, 64, 65, 66, 101, 1000, 30_001, 1_000_000])
def test_the_logarithm_of_gamma(solver, dof):
    wanted = EXACT.loggamma(EXACT.mpf(dof) / 2)
    # sums of up to 32 logarithms, and Stirling's series beyond: a few roundings of numbers of that size
    assert abs(solver("log_gamma_of_half", dof) - wanted) <= 2e-15 * max(abs(wanted), 1)
