"""Directions of nonlinear equations that are known far less well than the rest: large problems find them, too."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.types import SolveStatus

MEMBERS = 240
TEXT = """
(problem weak
  (data members external :key k) (data d external) (data steps external)
  (unknowns (a :per members :init 1) (b :per members :init 1))
  (observe d (= y (exp (* 0.3 (+ (* (a k) x) (* (b k) x (+ 1 (* {apart} x))))))) :sigma {sigma})
  (observe steps (= rise (- (a to) (a from))) :sigma 0.1))
"""


@pytest.mark.parametrize("apart", [1e-5, 1e-8])
def test_what_rows_tell_weakly_is_estimated(apart):
    """a + b is known about 1 / ``apart`` times as well as a by itself. The values are those that made the rows."""
    generator = np.random.default_rng(0)
    a = 1.0 + 0.1 * generator.normal(size=MEMBERS)
    k, x, sigma = np.repeat(np.arange(MEMBERS), 4), np.tile([0.5, 1.0, 2.0, 3.0], MEMBERS), 1e-6 * apart
    y = np.exp(0.3 * a[k] * x * (2.0 + apart * x)) + sigma * generator.normal(size=len(x))
    data = {
        "members": {"k": np.arange(MEMBERS)},
        "d": {"k": k, "x": x, "y": y},
        "steps": {"from": np.arange(MEMBERS - 1), "to": np.arange(1, MEMBERS), "rise": np.diff(a)},
    }
    found = mbm.loads(TEXT.format(apart=repr(apart), sigma=repr(sigma))).solve(data=data).first
    assert found.method == "dogleg-sparse"
    assert found.status is SolveStatus.CONVERGED
    for name in ("a", "b"):
        # of 480 normal errors one is beyond 4.5 standard deviations with probability 0.003
        assert float(np.abs((found[name].value - a) / found[name].sigma).max()) < 4.5


PAIRS = """
(problem pairs
  (data members external :key k) (data d external) (data steps external)
  (unknowns (a :per members :init 1) (b :per members :init 1))
  (observe d (= y (+ (a k) (b k))) :sigma 1)
  (observe steps (= rise (- (+ (a to) (b to)) (+ (a from) (b from)))) :sigma 0.1))
"""


@pytest.mark.parametrize(("members", "more"), [(50, False), (MEMBERS, True)])
def test_more_free_directions_than_are_looked_for_are_said(members, more):
    """Only sums are measured, so that as many differences are free; of at most 96 free directions all are found."""
    k = np.arange(members)
    steps = {"from": k[:-1], "to": k[1:], "rise": np.zeros(members - 1)}
    data = {"members": {"k": k}, "d": {"k": k, "y": np.full(members, 2.0)}, "steps": steps}
    found = mbm.loads(PAIRS).solve(data=data).first
    assert found.status is SolveStatus.UNOBSERVABLE
    said = [each.sentence for each in found.observability.unobservable]
    assert any("and perhaps more" in sentence for sentence in said) == more
