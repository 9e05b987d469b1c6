"""Losses where the data leave no residual: the stated noise is all that is known of the spread."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

LINE = """
(problem line
  (data d (table (x y) (0 1.1) (1 2.9)))
  (unknowns (a :init 1) (b :init 0))
  (observe d (= y (+ (* a x) b)) :sigma 0.2 {loss}))
"""


@pytest.mark.parametrize("backend", ["auto", "numpy", "casadi"])
@pytest.mark.parametrize("loss", ["", ":loss huber", ":loss cauchy", ":loss soft-l1"])
def test_two_points_give_a_line_with_the_uncertainty_of_the_points(loss, backend):
    result = mbm.loads(LINE.format(loss=loss)).solve(backend=backend)
    # a = y2 - y1, b = y1
    np.testing.assert_allclose([result["a"].value, result["b"].value], [1.8, 1.1], rtol=1e-9)
    # the loss counts residuals of zero in full, so that the covariance is that of least squares
    np.testing.assert_allclose([result["a"].sigma, result["b"].sigma], [0.2 * np.sqrt(2), 0.2], rtol=1e-6)


RANGES = """
(problem rob
  (data ranges external)
  (unknowns (p (vector 3) :unit m))
  (observe ranges (= range (distance p [x y z])) :sigma 5mm)
  (solve :robust gnc))
"""


@pytest.mark.parametrize("backend", ["auto", "casadi"])
def test_graduated_non_convexity_tries_both_sides_of_the_stations(backend):
    """Stations nearly in a plane: from the mirror image that the closed form also gives, too few agree."""
    stations = np.array([[x, y, 2.5 + 0.05 * ((x + y) % 2)] for x in (0, 1, 2, 3) for y in (0, 1)], dtype=float)
    truth = np.array([1.2, 0.6, 0.7])
    measured = np.linalg.norm(stations - truth, axis=1)
    measured[3] += 0.5
    table = {"x": stations[:, 0], "y": stations[:, 1], "z": stations[:, 2], "range": measured}
    result = mbm.loads(RANGES).solve(data={"ranges": table}, backend=backend)
    # without noise the good ranges agree exactly
    np.testing.assert_allclose(result["p"].value, truth, atol=1e-7)
