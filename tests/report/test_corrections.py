"""What `:errors` leaves in the document, the residuals and the explanation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.api import explain

CIRCLE = """
(problem circle
  (data pts (table (x y) (1.1 0.0) (0.0 1.0) (-0.9 0.1) (0.1 -1.0) (0.7 0.75) (9 9)))
  (unknowns (r :init 1))
  (observe pts (- (hypot x y) r) :errors ((x 0.1) (y 0.1)) :when (< x 5)))
"""


def test_corrections_move_the_points_onto_the_curve() -> None:
    document = mbm.loads(CIRCLE).solve().document()["solves"][0]
    found = document["corrections"]["pts"]
    assert list(found) == ["x", "y"]
    assert found["x"]["rows"] == found["y"]["rows"] == [1, 2, 3, 4, 5]
    assert found["x"]["sigma"] == [0.1] * 5
    assert "keys" not in found["x"]
    points = np.array([[1.1, 0.0], [0.0, 1.0], [-0.9, 0.1], [0.1, -1.0], [0.7, 0.75]])
    moved = points + np.stack([found["x"]["value"], found["y"]["value"]], axis=1)
    # the nearest point of a circle lies on the ray: the radius is the mean distance, whatever the points
    distance = np.hypot(*points.T)
    assert document["estimates"]["r"]["value"] == pytest.approx(distance.mean(), rel=1e-12)
    np.testing.assert_allclose(moved, points * (distance.mean() / distance)[:, None], atol=1e-12)
    assert document["cost"] == pytest.approx(((distance - distance.mean()) ** 2).sum() / 0.01, rel=1e-12)
    assert document["estimates"]["r"]["sigma"] == pytest.approx(0.1 / 5**0.5, rel=1e-9)


def test_a_residual_is_the_misclosure_at_the_measured_values_and_whitened() -> None:
    solved = mbm.loads(CIRCLE).solve()
    row = solved.first.rows()[0]
    radius = float(solved["r"].value)
    assert row.value == pytest.approx(1.1 - radius, rel=1e-12)
    assert row.residual == pytest.approx((1.1 - radius) / 0.1, rel=1e-9)


def test_without_errors_there_are_no_corrections() -> None:
    text = CIRCLE.replace(":errors ((x 0.1) (y 0.1))", ":sigma 0.1")
    assert "corrections" not in mbm.loads(text).solve().document()["solves"][0]


def test_the_explanation_names_the_corrected_columns(tmp_path: Path) -> None:
    path = tmp_path / "circle.mbm"
    path.write_text(CIRCLE)
    said = explain(path)
    assert "noise: none of their own" in said
    assert "errors in measured columns, corrected: x, y" in said
    assert "H_y: 1 × 2, with respect to x, y" in said
    assert "measured columns have errors, whose corrections are eliminated" in said
