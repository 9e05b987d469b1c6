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


CORRECTED = {
    "separate": "(observe t (= y (+ (a k) (* b x))) :errors ((x 0.1) (y 0.2)) :sigma 0.1)",
    "shared": "(observe t (= y (+ (a k) (* b m.x))) :errors ((m.x 0.1) (y 0.2)) :sigma 0.1)",
}


@pytest.mark.parametrize("sharing", CORRECTED)
def test_corrections_are_those_that_its_units_need(sharing):
    """As of equations without the other units, where rows share values or not."""
    text = f"""(problem p (data m external :key j) (data t external :with (m j))
      (unknowns (a :per t.k :init 1) (b :init 2)) {CORRECTED[sharing]})"""
    j = np.array([0.0, 1, 2, 0, 1, 2, 3])
    data = {"m": {"j": np.arange(4.0), "x": np.arange(4.0) ** 2}}
    data["t"] = {"j": j, "k": np.array([0.0, 0, 0, 1, 1, 1, 1]), "x": j**2, "y": np.sin(np.arange(7.0))}
    equations = mbm.loads(text).compile(data=data)._assembled()[0]
    alone = [part.alone for system in equations.implicit.systems for part in system.parts]
    assert all(alone) == (sharing == "separate")
    for units in ([0, 2, 3, 6], [0, 1, 2], np.arange(7)):
        kept = equations.kept(np.isin(np.arange(7), units))
        part = excerpt(equations, equations.free, np.array(units))
        np.testing.assert_allclose(part.residuals(part.numbers), kept.residuals(kept.numbers), rtol=1e-13)
        np.testing.assert_allclose(part.jacobian(part.numbers), kept.jacobian(kept.numbers), rtol=1e-12, atol=1e-13)


def test_of_equations_without_some_rows_corrections_are_what_is_left():
    text = "(problem p (data t external) (unknowns (b :init 2)) (observe t (= y (* b x)) :errors ((x 0.1)) :sigma 0.1))"
    data = {"t": {"x": np.arange(5.0), "y": np.sin(np.arange(5.0))}}
    equations = mbm.loads(text).compile(data=data)._assembled()[0]
    less = equations.kept(np.array([True, False, True, True, True]))
    part = excerpt(less, less.free, np.array([0, 2, 4]))
    np.testing.assert_allclose(part.residuals(part.numbers), less.residuals(less.numbers)[[0, 1, 3]], rtol=1e-13)
