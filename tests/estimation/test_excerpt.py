"""Some units over some coordinates: the residuals and derivatives of the whole, picked."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.equations.excerpt import excerpt
from tests.estimation.varied import PROBLEMS


@pytest.fixture(params=PROBLEMS)
def equations(request):
    return mbm.loads(PROBLEMS[request.param]).compile()._assembled()[0]


@pytest.mark.parametrize("step", [1, 2, 3])
def test_it_has_the_numbers_of_the_whole(equations, step):
    """Every second or third unit leaves rows of which some equations are in use and others are not."""
    factors = 1.0 + np.arange(equations.whole) / 10
    equations = equations.with_factors(factors)
    units = np.unique(equations.units)[::step]
    columns = equations.free[::2]
    part = excerpt(equations, columns, units)
    lines = np.isin(equations.units, units)
    point = equations.numbers
    # The same operations on fewer rows.
    np.testing.assert_allclose(part.residuals(point), equations.residuals(point)[lines], rtol=1e-13, atol=1e-14)
    whole = equations.jacobian(point)[lines][:, ::2]
    np.testing.assert_allclose(part.jacobian(point), whole, rtol=1e-13, atol=1e-14)
    assert (part.count, part.dimension) == whole.shape


def test_of_equations_without_some_rows_it_takes_what_is_left(equations):
    every = np.unique(equations.units)
    kept = np.ones(len(every), dtype=bool)
    kept[1] = False
    less = equations.kept(kept)
    part = excerpt(less, less.free, np.unique(less.units))
    np.testing.assert_allclose(part.residuals(less.numbers), less.residuals(less.numbers), rtol=1e-13, atol=1e-14)


def test_without_any_unit_nothing_is_left(equations):
    part = excerpt(equations, equations.free, np.empty(0, dtype=np.int64))
    assert part.count == 0
