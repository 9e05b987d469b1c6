"""Feet of points on curves: against a fine search along the curve, and where there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mbm.equations.corrections.feet import feet
from mbm.equations.corrections.types import Local
from mbm.equations.types import Floats, Indices, Mask


@dataclass
class Ellipse:
    """Points (R, 2) beside the ellipse with half axes 2 and 1, in units of ``sigma``."""

    points: Floats
    sigma: float
    level: float = 1.0
    evaluations: int = 0

    @property
    def noisy(self) -> Mask:
        return np.zeros((len(self.points), 1), dtype=bool)

    @property
    def corrections(self) -> int:
        return 2

    def some(self, components: Indices) -> Ellipse:
        return Ellipse(self.points[components], self.sigma, self.level)

    def at(self, corrections: Floats, multipliers: Floats) -> Local:
        self.evaluations += 1
        place = self.points + self.sigma * corrections
        weights = np.array([0.25, 1.0])
        curvature = np.zeros((len(place), 2, 2))
        curvature[:, [0, 1], [0, 1]] = 2 * weights * self.sigma**2 * multipliers
        return Local(
            values=(place**2 @ weights - self.level)[:, None],
            slopes=(2 * place * weights * self.sigma)[:, None, :],
            curvature=curvature,
        )


def nearest(points: Floats) -> Floats:
    """Distances to the ellipse by a search along it, with steps of 1e-8 rad in the end: good to 1e-12 and better."""
    result = []
    for point in points:
        middle, reach = np.pi, np.pi
        for _ in range(3):
            angle = middle + np.linspace(-reach, reach, 2001)
            square = (2 * np.cos(angle) - point[0]) ** 2 + (np.sin(angle) - point[1]) ** 2
            middle, reach = angle[np.argmin(square)], reach / 500
        result.append(np.sqrt(square.min()))
    return np.array(result)


@pytest.mark.parametrize("spread", [0.02, 0.3, 3.0, 30.0])
def test_the_foot_is_the_nearest_point_however_far_the_measured_one(spread: float) -> None:
    random = np.random.default_rng(5)
    angle = random.uniform(0, 2 * np.pi, 200)
    points = np.stack([2 * np.cos(angle), np.sin(angle)], axis=1) + spread * random.normal(size=(200, 2))
    conditions = Ellipse(points, sigma=0.02)
    found = feet(conditions)
    assert found.found.all()
    reached = points + 0.02 * found.corrections
    distance = 0.02 * np.linalg.norm(found.corrections, axis=1)
    # a further step would be shorter than 1e-10 of 1 + |u| standard deviations, and the steepest slope there is 2
    assert (np.abs(reached**2 @ [0.25, 1.0] - 1) < 2 * 1e-10 * (0.02 + distance)).all()
    np.testing.assert_allclose(distance, nearest(points), rtol=1e-9, atol=1e-9)


def test_a_point_in_the_middle_where_the_slopes_vanish_has_a_foot() -> None:
    points = np.array([[0.0, 0.0], [0.1, 0.0], [1e-9, 1e-9]])
    found = feet(Ellipse(points, sigma=0.02))
    assert found.found.all()
    np.testing.assert_allclose(0.02 * np.linalg.norm(found.corrections, axis=1), nearest(points), rtol=1e-8)


def test_near_feet_take_few_evaluations_and_none_beside_those_already_known() -> None:
    angle = np.linspace(0, 6, 50)
    points = 1.01 * np.stack([2 * np.cos(angle), np.sin(angle)], axis=1)
    conditions = Ellipse(points, sigma=0.02)
    first = feet(conditions)
    assert conditions.evaluations <= 5
    conditions.evaluations = 0
    again = feet(conditions, first)
    assert conditions.evaluations <= 2
    np.testing.assert_allclose(again.corrections, first.corrections, atol=1e-12)


def test_components_that_need_a_search_change_no_others() -> None:
    angle = np.linspace(0, 6, 20)
    points = 1.01 * np.stack([2 * np.cos(angle), np.sin(angle)], axis=1)
    alone = feet(Ellipse(points, sigma=0.02))
    points[7] = [1e-9, 1e-9]
    for near in (None, alone):
        found = feet(Ellipse(points, sigma=0.02), near)
        assert found.found.all()
        assert 0.02 * np.linalg.norm(found.corrections[7]) == pytest.approx(1.0, rel=1e-8)  # the smaller half axis
        others = np.arange(20) != 7
        np.testing.assert_allclose(found.corrections[others], alone.corrections[others], atol=1e-9)


def test_an_empty_curve_has_no_feet() -> None:
    found = feet(Ellipse(np.array([[1.0, 1.0], [3.0, 0.0]]), sigma=0.02, level=-1.0))
    assert not found.found.any()
