"""Losses of the solver against the definitions that the general path uses, and against derivatives by mpmath."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.problem.kinds import LossKind
from mbm.solution.robust.losses.function import LossFunction
from mbm.solution.robust.losses.rooted import root_factors
from mbm.solution.robust.losses.standard import BY_KIND
from mbm.target.solver.description import LOSSES

SQUARES = np.array([0.0, 1e-30, 1e-9, 1e-4, 0.3, 1.7, 1.9999, 2.3, 40.0, 1e6])
CASES = [(kind, 0.0) for kind in LossKind if kind is not LossKind.BARRON]
CASES += [(LossKind.BARRON, shape) for shape in (2.0, 1.0, 0.5, 0.0, -2.0)]


def loss_of(kind, shape, scale):
    loss = BY_KIND[kind]
    return LossFunction(loss=loss.shaped(shape) if kind is LossKind.BARRON else loss, scale=scale)


@pytest.mark.parametrize(("kind", "shape"), CASES)
@pytest.mark.parametrize("scale", [1.0, 1.345])
def test_values_weights_and_slopes(solver, kind, shape, scale):
    loss, number = loss_of(kind, shape, scale), LOSSES[kind]
    for name, wanted in (("loss_value", loss.rho), ("loss_weight", loss.weight), ("loss_slope", loss.slope)):
        found = [solver(name, number, s, scale, shape) for s in SQUARES.tolist()]
        # Ten operations, of which logarithm, exponential and powers are good to 2 roundings.
        np.testing.assert_allclose(found, wanted(SQUARES), rtol=1e-14, atol=1e-300)


@pytest.mark.parametrize(("kind", "shape"), CASES)
def test_square_root_form(solver, kind, shape):
    loss, number = loss_of(kind, shape, 1.345), LOSSES[kind]
    factors, changes = root_factors(loss, SQUARES)
    for s, factor, change in zip(SQUARES.tolist(), factors.tolist(), changes.tolist(), strict=True):
        assert solver("root_factor", number, s, 1.345, shape) == pytest.approx(factor, rel=1e-14)
        # The difference of two nearly equal numbers above NEARLY_ZERO keeps 13 digits.
        assert solver("root_slope", number, s, 1.345, shape, factor) == pytest.approx(change, rel=1e-11, abs=1e-15)


@pytest.mark.parametrize(("kind", "shape"), CASES)
@pytest.mark.parametrize("square", [0.2, 1.1, 5.0])
def test_weights_are_the_slopes_of_the_values(solver, kind, shape, square):
    step = 1e-6
    ends = [solver("loss_value", LOSSES[kind], square + d, 1.5, shape) for d in (-step, step)]
    slope = (ends[1] - ends[0]) / (2 * step)
    # Central differences: 1e-12 of curvature, and rounding of 1e-16 / 1e-6 in values of about 1.
    assert solver("loss_weight", LOSSES[kind], square, 1.5, shape) == pytest.approx(slope, rel=1e-8, abs=1e-8)
