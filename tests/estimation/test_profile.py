"""Profiles of residuals whose ends are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.estimation.trust.profile import Profile


class Bowl:
    """Residuals x and y + z − x²: the profile of x is its square alone, and y and z are told apart by nothing."""

    count, linear = 2, False

    def residuals(self, x: np.ndarray) -> np.ndarray:
        return np.array([x[0], x[1] + x[2] - x[0] ** 2])

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        return np.array([[1.0, 0.0, 0.0], [-2.0 * x[0], 1.0, 1.0]])

    def retract(self, x: np.ndarray, step: np.ndarray) -> np.ndarray:
        return x + step


@pytest.mark.parametrize("others", [1, 2], ids=["told", "dependent"])
def test_the_end_is_where_the_cost_has_grown_by_the_level(others: int) -> None:
    axes = np.eye(3)
    profile = Profile(
        equations=Bowl(), point=np.zeros(3), least=0.0, direction=axes[0], others=axes[:, 1 : 1 + others], level=4.0
    )
    # to the stated relative accuracy of an end; with y and z at rest it would be where x² + x⁴ = 4, at 1.25
    assert profile.end() == pytest.approx(2.0, rel=0.01)
