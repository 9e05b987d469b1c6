"""Which estimates of an estimator are clean."""

from __future__ import annotations

import numpy as np
import pytest

import mbm


def test_a_fit_that_the_stated_noise_makes_improbable_is_not_clean() -> None:
    """Its values and status are those of whole solves all the same: a line has one minimum."""
    text = "(problem p (data d external) (unknowns (a :init 0) (b :init 0)) (observe d (= y (+ a (* b x))) :sigma {}))"
    x = np.arange(20.0)
    fits = 1.0 + 2.0 * x + 0.1 * (-1.0) ** np.arange(20)
    off = fits + np.where(x < 4, 10.0, 0.0)
    for sigma, expected in (("0.1", [True, False]), ("unknown", [True, True])):
        estimator = mbm.loads(text.format(sigma)).compile(data={"d": {"x": x, "y": fits}}).estimator("x", "y")
        many = estimator.many(np.array([x, x]), np.array([fits, off]))
        assert many.clean.tolist() == expected
        assert [bool(estimator(x, y).clean) for y in (fits, off)] == expected
        assert many.status.tolist() == ["converged", "converged"]
        slope = np.polyfit(x, off, 1)[0]
        assert many["b"][1] == pytest.approx(slope, rel=1e-9)
        assert "b" in many
