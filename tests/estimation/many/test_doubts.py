"""What solves made together leave to a second look, and what they do not."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.kernels.native.engine import available
from mbm.report.blocks import ManyReports

pytestmark = pytest.mark.skipif(not available(), reason="without machine code solves are made one by one")

DIRECTIONS = """
(problem p (data t external) (unknowns (v (vector 2) :init [1 1]))
  (observe t (= [x y] v) :sigma {sigma})
  (derive (direction (atan2 (v 2) (v 1))))
  (for-each k))
"""
COUNT = 200


def accepted(x, y, sigma):
    """Which of the solves are taken without a second look."""
    data = {"t": {"k": np.arange(COUNT), "x": x, "y": y}}
    result = mbm.loads(DIRECTIONS.format(sigma=sigma)).solve(data=data).result
    assert result.status.value == "ok"
    assert isinstance(result.solves, ManyReports)
    return np.concatenate([block.block.columns.clean for block in result.solves.blocks])


def test_angles_that_jump_by_a_turn_within_their_interval_need_none():
    """180° ± 0.6°, on both sides of the cut."""
    y = np.linspace(-0.05, 0.05, COUNT)
    assert accepted(np.full(COUNT, -10.0), y, 0.1).all()


def test_angles_with_wide_intervals_need_one():
    """atan(±1.96 σ / x) beside ±1.96 σ / x: the profile is followed from a fifth less on (1.96 σ = 0.949 x)."""
    x = np.linspace(1.0, 2.0, COUNT)
    sigma = 1.6 / 1.959963984540054
    clear = np.abs(np.arctan(1.6 / x) / (1.6 / x) - 0.8)
    found = accepted(x, np.zeros(COUNT), sigma)
    wanted = np.arctan(1.6 / x) / (1.6 / x) > 0.8
    assert found[clear > 1e-3].tolist() == wanted[clear > 1e-3].tolist()
    assert {True, False} == set(found.tolist())
