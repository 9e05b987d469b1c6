"""What a loss leaves out for many steps after one another, though it agrees, may be where the track went."""

from __future__ import annotations

import re

import numpy as np
import pytest

import mbm

TEXT = """(problem p
  (data m external)
  (states :over t (x :init 0 :sigma 1))
  (dynamics (constant-velocity x :acceleration 0.02 :velocity 1 :velocity-sigma 0.2))
  (observe m (= z x) :sigma 0.3 {loss})
  (solve :method {method}))"""
SMOOTHER = {"loss": ":loss tukey", "method": "(smoother)"}
WAYS = [SMOOTHER, {**SMOOTHER, "method": "iterated-ekf"}]


def told(way, jump, seed, share=0.1):
    """How far off the track is, and what is said of runs; ``share`` of the readings are up to 30 m off."""
    g, t = np.random.default_rng(seed), np.arange(100.0)
    x = t + jump * (t >= 50)
    wrong = g.random(100) < share
    z = x + 0.3 * g.normal(size=100) + wrong * g.uniform(-30, 30, 100)
    found = mbm.loads(TEXT.format(**way)).solve(data={"m": {"t": t, "z": z}})
    off = np.abs(found["x"].value - x).max()
    return off, [each.message for each in found.first.diagnostics if "after one another" in each.message]


@pytest.mark.parametrize("way", WAYS, ids=["smoother", "iterated"])
def test_a_jump_that_the_dynamics_does_not_expect_is_said(way):
    off, said = told(way, 8.0, 1)
    assert off > 2.0  # seven deviations of a reading
    ((begins, ends),) = (re.findall(r"t = (\d+) to (\d+),", each)[0] for each in said)
    assert int(begins) <= 50 <= int(ends)


def test_wrong_readings_by_themselves_are_no_run():
    """Of ten tracks with three readings in ten wrong none."""
    assert [said for seed in range(10) for off, said in [told(SMOOTHER, 0.0, seed, 0.3)] if said] == []
