"""Losses against their published formulas and the derivatives of these by mpmath, in every target and in arrays."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from mbm.equations.losses import LossFunction
from mbm.equations.manifolds import of_arrays
from mbm.problem.kinds import LossKind
from mbm.solver.losses import loss_slope, loss_value, loss_weight

SQUARES = np.array([0.0, 1e-30, 1e-9, 1e-4, 0.3, 1.7, 1.9999, 2.3, 40.0, 1e6])
CASES = [(kind, 0.0) for kind in LossKind if kind is not LossKind.BARRON]
CASES += [(LossKind.BARRON, shape) for shape in (2.0, 1.0, 0.5, 0.0, -2.0)]


def formula(kind, shape, scale):
    """ρ as published, by mpmath."""
    c2 = mpmath.mpf(scale) ** 2

    def rho(s):
        t = s / c2
        if kind is LossKind.HUBER:
            return s if t <= 1 else c2 * (2 * mpmath.sqrt(t) - 1)
        if kind is LossKind.SOFT_L1:
            return 2 * c2 * (mpmath.sqrt(1 + t) - 1)
        if kind is LossKind.CAUCHY:
            return c2 * mpmath.log(1 + t)
        if kind is LossKind.TUKEY:
            return c2 / 3 * (1 - (1 - min(t, mpmath.mpf(1))) ** 3)
        if kind is LossKind.GEMAN_MCCLURE:
            return s / (1 + t)
        if shape == 2.0:
            return s
        b = abs(mpmath.mpf(shape) - 2)
        if shape == 0.0:
            return 2 * c2 * mpmath.log(1 + t / b)
        return 2 * c2 * b / shape * ((1 + t / b) ** (mpmath.mpf(shape) / 2) - 1)

    return rho


@pytest.mark.parametrize(("kind", "shape"), CASES)
@pytest.mark.parametrize("scale", [1.0, 1.345])
def test_values_weights_and_slopes(solver, kind, shape, scale):
    """One text for all targets, and element by element in arrays; values and derivatives by mpmath."""
    loss, rho = LossFunction(kind=kind, scale=scale, shape=shape), formula(kind, shape, scale)
    formulas = (loss_value, loss_weight, loss_slope)
    together = [of_arrays(each)(loss.number, SQUARES, scale, shape) for each in formulas]
    for place, s in enumerate(SQUARES.tolist()):
        found = [solver(each.__name__, loss.number, s, scale, shape) for each in formulas]
        with mpmath.workdps(60):
            # From below where there is a corner or an edge.
            wanted = [float(mpmath.diff(rho, mpmath.mpf(s), order, direction=-1 if s > 0 else 1)) for order in range(3)]
        for one, many, true in zip(found, together, wanted, strict=True):
            # Ten operations, of which logarithm, exponential and powers are good to 2 roundings, and their arguments
            # to one: far out, powers magnify that.
            assert one == pytest.approx(true, rel=1e-13, abs=1e-40)
            assert many[place] == pytest.approx(true, rel=1e-13, abs=1e-40)


@pytest.mark.parametrize(("kind", "shape"), CASES)
def test_square_root_form(solver, kind, shape):
    loss, rho = LossFunction(kind=kind, scale=1.345, shape=shape), formula(kind, shape, 1.345)
    factors = loss.root_factor(SQUARES)
    changes = loss.root_slope(SQUARES, factors)
    for s, together, change in zip(SQUARES.tolist(), factors.tolist(), changes.tolist(), strict=True):
        with mpmath.workdps(60):

            def root(square):
                return mpmath.sqrt(rho(square) / square)

            wanted = float(root(mpmath.mpf(s))) if s > 0.0 else 1.0
            slope = float(mpmath.diff(root, mpmath.mpf(s), direction=-1)) if s > 0.0 else None
        factor = solver("root_factor", loss.number, s, 1.345, shape)
        assert factor == pytest.approx(wanted, rel=1e-14)
        assert together == pytest.approx(wanted, rel=1e-14)
        for found in (change, solver("root_slope", loss.number, s, 1.345, shape, factor)):
            # The difference of two nearly equal numbers above NEARLY_ZERO keeps 13 digits; the series below it has an
            # error of the order of the square itself.
            if slope is not None:
                assert found == pytest.approx(slope, rel=1e-6 if s < 2e-3 else 1e-11, abs=1e-13)
