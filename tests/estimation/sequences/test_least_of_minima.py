"""Losses that descend again have several minima along a path: estimators look for the least one alike."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

WALK = """(problem walk
  (data d (table (t z) (0 0)))
  (states :over t (x :init 0 :sigma 2))
  (dynamics (random-walk x :sigma 0.3))
  (observe d (= z x) :sigma 0.1 :loss %s)
  (solve :method %s))"""

END = 4.6850649
"""Of Tukey's loss, in standard deviations: 95 % as efficient as least squares with normal errors."""


def drawn(seed, steps=30):
    """Readings of a random walk that is three times as wide as their noise, three of which are wrong."""
    g = np.random.default_rng(seed)
    z = np.cumsum(0.3 * g.normal(size=steps)) + 0.1 * g.normal(size=steps)
    z[g.choice(steps, 3, replace=False)] += g.uniform(0.8, 4.0, 3)
    return {"d": {"t": np.arange(steps), "z": z}}


def plain_and_robust(x, z):
    """Sums of squares, and of Tukey's losses, with prior and transitions."""
    r = (z - x) / 0.1
    loss = END**2 / 3 * (1 - np.clip(1 - (r / END) ** 2, 0, None) ** 3)
    rest = (x[0] / 2) ** 2 + np.square(np.diff(x) / 0.3).sum()
    return np.square(r).sum() + rest, loss.sum() + rest


@pytest.mark.parametrize("seed", [1, 3, 4, 15, 26])
def test_a_smoother_ends_no_worse_than_all_steps_at_once(seed):
    # From the path of a filter alone it ended between 14 and 67 above in these.
    smoothed, together = (
        mbm.loads(WALK % ("tukey", method)).solve(data=drawn(seed)).solves[0] for method in ("(smoother)", "batch")
    )
    assert smoothed.status == "converged"
    assert smoothed.robust_cost <= together.robust_cost + 1e-6
    plain, robust = plain_and_robust(smoothed["x"].value, drawn(seed)["d"]["z"])
    assert smoothed.robust_cost == pytest.approx(robust, rel=1e-6)
    assert smoothed.cost == pytest.approx(plain, rel=1e-6)


def test_a_filter_tells_the_sum_of_squares_beside_that_of_the_losses():
    # One step: Huber's corner holds the update at z − x = r, where x = 1.345 / σ · 2², and the prior adds (x / 2)².
    solve = mbm.loads(WALK % ("huber", "iterated-ekf")).solve(data={"d": {"t": [0.0], "z": [100.0]}}).solves[0]
    corner = 1.3449975
    x = corner / 0.1 * 2**2
    r = (100.0 - x) / 0.1
    assert solve["x"].value[0] == pytest.approx(x, rel=1e-6)
    assert solve.cost == pytest.approx(r**2 + (x / 2) ** 2, rel=1e-6)
    assert solve.robust_cost == pytest.approx(2 * corner * r - corner**2 + (x / 2) ** 2, rel=1e-6)
