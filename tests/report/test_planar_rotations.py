"""A rotation of the plane is an angle and a matrix in documents (LANGUAGE §11), of states and of unknowns."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

TEXT = """
(problem drive
  (data wheels (table (k forward turn) (1 1.02 0.10) (2 0.98 0.12)))
  (data start (table (k) (0)))
  (unknowns (R (rotation 2) :init (rot2 0.2) :sigma 0.1))
  (states :over k (at (pose 2) :init (pose2 0 0 3) :sigma 0.01))
  (dynamics (= (next at) (compose at (pose2 forward 0 turn)) :sigma [0.03 0.05 0.02]))
  (solve :method ekf))"""


def test_they_have_no_quaternion():
    document = mbm.loads(TEXT).solve().document()
    estimates = document["solves"][0]["estimates"]
    assert set(estimates["R"]["value"]) == {"angle", "matrix"}
    assert estimates["R"]["value"]["angle"] == pytest.approx(0.2)
    for value, angle in zip(estimates["at"]["value"], (3.0, 3.1, 3.22 - 2 * np.pi), strict=True):
        assert set(value) == {"angle", "matrix", "translation"}
        assert value["angle"] == pytest.approx(angle)
        np.testing.assert_allclose(
            value["matrix"], [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]], rtol=1e-12
        )
    again = mbm.loads(TEXT.replace("(solve :method ekf)", "")).solve(init=document)
    assert again["at"].value[-1, 0] == pytest.approx(3.22 - 2 * np.pi)


def test_angles_are_within_half_a_turn_everywhere():
    """In the text, in Python and for each of many keys as in documents: 3.25 rad are -3.03 rad."""
    text = """(problem p (data d (table (k h) (1 -3.04) (1 -3.03) (2 -3.02)))
      (unknowns (R (rotation 2) :init (rot2 3.1)) (P (pose 2) :init (pose2 0 0 3.1) :sigma [1 1 1]))
      (observe d (= (rot2 h) R) :sigma 0.1) (observe d (= h (heading P)) :sigma 0.1))"""
    single = mbm.loads(text).solve()
    many = mbm.loads(text[:-1] + " (for-each k))").solve()
    for result, angle in ((single.first, -3.03), (many.solves[0], -3.035), (many.solves[1], -3.02)):
        np.testing.assert_allclose(result["R"].value, angle, atol=1e-9)  # the tolerance of the solve
        assert result["P"].value[0] == pytest.approx(-3.03, abs=0.02)
    assert "-3.030" in str(single)
