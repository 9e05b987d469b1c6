"""Corrections eliminated in a straight line, against closed forms of the distance to lines, circles and parabolas."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mbm
from mbm.kernels.eliminated import eliminated_kernel
from mbm.kernels.types import Kernel
from tests.machine.test_fused import evaluated


def kernel_of(equation: str, unknowns: str = "(a :init 1) (b :init 1)", noise: str = "") -> Kernel:
    text = f"""(problem p (data t (table (x y) (1 2) (2 1) (3 5))) (unknowns {unknowns})
      (observe t {equation} :errors ((x 1) (y 1)) {noise}))"""
    (kernel,) = mbm.loads(text).compile().kernels.kernels
    return kernel


class Row:
    """One row of a kernel with its corrections eliminated."""

    def __init__(self, kernel: Kernel, noises: tuple[tuple[int, int, bool], ...] = ((0, 1, False),)) -> None:
        made = eliminated_kernel(kernel, noises)
        assert made is not None
        self.kernel = made
        self._names = [variable.unknown for variable in kernel.variables]
        self._given = [parameter.name for parameter in kernel.parameters]
        self._columns = [self._given[i] for i in kernel.corrections.columns]

    def at(self, noise: tuple[float, ...] = (1.0, 0.0), **known: float) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (k,) and slopes (k, tangents); ``noise`` are weights, and 1 for noise of its own."""
        sigma = [known[f"s{name}"] for name in self._columns]
        row = [known[name] for name in (*self._names, *self._given)]
        found = np.array(evaluated(self.kernel.jacobian_program, [*row, *sigma, *noise]))
        values = evaluated(self.kernel.value_program, [*row, *sigma, *noise])
        k = self.kernel.outputs
        np.testing.assert_array_equal(values, found[:k])
        slopes = np.zeros((k, len(self.kernel.tangents)))
        slopes[self.kernel.jacobian_rows, self.kernel.jacobian_columns] = found[k:]
        return found[:k], slopes


@pytest.mark.parametrize("own", [0.0, 0.5])
def test_a_line(own: float) -> None:
    """``(y − a − b x)² / (σ² + s_y² + b² s_x²)``, and no more operations than one step takes."""
    row = Row(kernel_of("(= y (+ a (* b x)))"))
    weight = 1.0 / own if own else 1.0
    found, slopes = row.at((weight, float(own > 0)), a=0.3, b=0.7, x=1.4, y=2.0, sx=0.1, sy=0.2)
    wide = math.sqrt(own**2 + 0.2**2 + 0.7**2 * 0.1**2)
    assert abs(found[0]) == pytest.approx(abs(2.0 - 0.3 - 0.7 * 1.4) / wide, rel=1e-14)
    # the slope of the model by b is the corrected x
    share = 0.7 * 0.1**2 * (2.0 - 0.3 - 0.7 * 1.4) / wide**2
    assert np.abs(slopes[0]) == pytest.approx(np.array([1.0, 1.4 + share]) / wide, rel=1e-14)
    assert len(row.kernel.value_program.instructions) < 60


CIRCLES = {"distances": "(- (hypot (- x a) (- y b)) 2)", "squares": "(- (+ (^ (- x a) 2) (^ (- y b) 2)) 4)"}


@pytest.mark.parametrize("form", CIRCLES)
@pytest.mark.parametrize("radius", [1.5, 1.7, 1.99, 2.0, 2.02, 2.6])
def test_a_circle(form: str, radius: float) -> None:
    """The misfit is the distance from the circle, whatever equation says it; its slope is the direction."""
    row = Row(kernel_of(CIRCLES[form]))
    angle, size = 0.8, 0.01
    x, y = 1.0 + radius * math.cos(angle), -0.5 + radius * math.sin(angle)
    found, slopes = row.at(a=1.0, b=-0.5, x=x, y=y, sx=size, sy=size)
    # Newton's last step is below 1e-8, and squared beside the distance; rounding is that of a foot of size 1/0.01.
    assert found[0] == pytest.approx((radius - 2.0) / size, rel=1e-11, abs=1e-11)
    assert slopes[0] == pytest.approx([-math.cos(angle) / size, -math.sin(angle) / size], rel=1e-10)


def test_near_the_middle_there_is_no_value() -> None:
    """From there feet all around are about as near: the general path looks for the nearest."""
    row = Row(kernel_of(CIRCLES["squares"]))
    assert not np.isfinite(row.at(a=0.0, b=0.0, x=0.05, y=0.0, sx=0.1, sy=0.1)[0]).any()


def test_two_equations_with_a_matrix() -> None:
    """Linear equations: ``wᵀ S⁻¹ w`` with ``S = B Bᵀ + Σ``, and slopes ``L⁻¹ A``."""
    kernel = kernel_of("(= [x y] [(+ a b) (* b 2)])", noise=":covariance [[4 1] [1 2]]")
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    weights = np.linalg.inv(np.linalg.cholesky(covariance))
    row = Row(kernel, ((0, 2, True),))
    found, slopes = row.at((*weights.ravel(), 1.0, 1.0), a=0.3, b=0.7, x=1.4, y=2.0, sx=0.5, sy=3.0)
    spread = covariance + np.diag([0.25, 9.0])
    misfit = np.array([0.3 + 0.7 - 1.4, 2 * 0.7 - 2.0])
    assert found @ found == pytest.approx(misfit @ np.linalg.solve(spread, misfit), rel=1e-13)
    plain = np.array([[1.0, 1.0], [0.0, 2.0]])
    assert slopes.T @ slopes == pytest.approx(plain.T @ np.linalg.solve(spread, plain), rel=1e-13)
    assert found @ slopes == pytest.approx(misfit @ np.linalg.solve(spread, plain), rel=1e-13)


def test_what_would_be_too_large_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mbm.kernels.eliminated.LARGEST", 100)
    assert eliminated_kernel(kernel_of(CIRCLES["squares"]), ((0, 1, False),)) is None
