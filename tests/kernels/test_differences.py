"""Derivatives by differences against closed forms, on every scale that arguments may have."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mbm.kernels.python_functions import EXACT, ROUNDED, differences

GOOD = 1e-9
"""Ten times what a step of the third root of ε leaves, for functions that vary on the scale of their argument."""


def slope(function: Callable[[np.ndarray], np.ndarray], at: float, noise: float = EXACT) -> float:
    found = differences(lambda points: function(points[:, 0])[:, None], np.array([[at]]), (0,), noise)
    assert found.shape == (1, 1, 1)
    return float(found[0, 0, 0])


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e-3, 1.0, 1e6, 1e12])
@pytest.mark.parametrize("share", [1.0, -0.3, 2.5])
def test_functions_that_vary_on_the_scale_of_the_argument(scale: float, share: float) -> None:
    at = share * scale
    assert slope(lambda a: np.exp(a / scale), at) == pytest.approx(np.exp(share) / scale, rel=GOOD)


@pytest.mark.parametrize("at", [0.0, 1e-12, -1e-9, 1e-7, 1e-5, 1e-3])
def test_near_zero_the_scale_is_found(at: float) -> None:
    """A step of the argument's own size would leave nothing but rounding errors: 1 + a is 1 for it."""
    assert slope(lambda a: 1.0 + np.sin(a), at) == pytest.approx(np.cos(at), rel=GOOD)


@pytest.mark.parametrize("scale", [1e-6, 1e-4])
def test_a_small_scale_is_not_stepped_over_at_zero(scale: float) -> None:
    """The widest step is 6 µ in SI, beyond a whole wave of the shortest: narrower ones contradict it."""
    assert slope(lambda a: np.sin(a / scale + 0.4), 0.0) == pytest.approx(np.cos(0.4) / scale, rel=1e-8)


def test_a_large_constant_costs_its_digits_and_no_more() -> None:
    # ε·10⁶ is a tenth of a millionth of a millionth, over the widest step of 6e-6
    assert slope(lambda a: 1e6 + a, 1e-8) == pytest.approx(1.0, abs=1e-4)


def test_what_does_not_depend_has_no_slope() -> None:
    found = differences(lambda points: np.full((len(points), 2), 3.0), np.array([[0.0, 5.0]]), (0, 1), EXACT)
    assert np.array_equal(found, np.zeros((1, 2, 2)))


def test_wanted_arguments_stand_in_their_order_and_others_are_left() -> None:
    points = np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 2.0]])

    def product(p: np.ndarray) -> np.ndarray:
        return np.stack([p[:, 0] * p[:, 1] * p[:, 2], p[:, 2] ** 2], axis=1)

    found = differences(product, points, (2, 0), EXACT)
    wanted = [[[a * b, b * c], [2 * c, 0.0]] for a, b, c in points]
    np.testing.assert_allclose(found, wanted, rtol=GOOD, atol=1e-10)


def test_each_point_is_differenced_for_itself() -> None:
    """What stands beside a point changes nothing, to the last bit: solves together and alone are the same."""
    points = np.array([[0.0], [1e-9], [3.0], [1e5]])

    def function(p: np.ndarray) -> np.ndarray:
        return np.cos(p) + p

    together = differences(function, points, (0,), EXACT)
    alone = [differences(function, point[None], (0,), EXACT)[0] for point in points]
    assert np.array_equal(together, np.array(alone))


def test_no_value_no_derivative() -> None:
    found = differences(lambda p: np.where(p > 1, np.nan, p), np.array([[0.5], [1.0], [2.0]]), (0,), EXACT)
    assert found[0, 0, 0] == pytest.approx(1.0, rel=GOOD)
    assert np.isnan(found[1:]).all()


def test_wider_steps_for_values_that_are_differences_themselves() -> None:
    generator = np.random.default_rng(3)

    def rounded(a: np.ndarray) -> np.ndarray:
        return np.sin(a) * (1 + ROUNDED * generator.uniform(-1, 1, a.shape))

    # ε^⅔ of the rounded values, 1.1e-7, and ten times that for safety
    assert slope(rounded, 0.8, ROUNDED) == pytest.approx(np.cos(0.8), rel=1e-6)
