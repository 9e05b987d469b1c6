"""Newton's steps where Gauss-Newton's converge slowly: losses of many members, each at its minimum."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.report.types import SolveStatus

MEMBERS, ROWS, C = 200, 12, 1.345
LINES = """
(problem lines
  (data members external :key k) (data d external)
  (unknowns (a :per members :init 0 {a}) (b :per members :init 0))
  (observe d (= y (+ (a k) (* (b k) x))) :sigma 0.1 :loss (huber 1.345))
  (solve :method {method}))
"""


def heavy():
    """Lines with noise of Student's t with two degrees of freedom: half of the rows lie beyond the corner."""
    random = np.random.default_rng(1)
    a, b = random.normal(2, 0.5, MEMBERS), random.normal(-1, 0.5, MEMBERS)
    k = np.repeat(np.arange(MEMBERS), ROWS)
    x = random.uniform(-1, 2, len(k))
    y = a[k] + b[k] * x + 0.1 * random.standard_t(2, len(k))
    return k, x, y


@pytest.mark.parametrize("method", ["auto", "lm"])
@pytest.mark.parametrize("bound", [None, 2.2])
def test_every_member_is_at_its_minimum(method, bound):
    """Huber's cost is convex: it is least where Σ ψ(r) (1, x) is zero, or pushes against the bound of a."""
    k, x, y = heavy()
    data = {"members": {"k": np.arange(float(MEMBERS))}, "d": {"k": k.astype(float), "x": x, "y": y}}
    text = LINES.format(method=method, a="" if bound is None else f":in (-10 {bound})")
    found = mbm.loads(text).solve(data=data)
    assert found.first.method.endswith("-sparse")
    assert found.first.status is SolveStatus.CONVERGED
    a, b = found["a"].value, found["b"].value
    psi = np.clip((a[k] + b[k] * x - y) / 0.1, -C, C)
    pulls = np.array([np.bincount(k, psi), np.bincount(k, psi * x)])
    held = np.zeros(MEMBERS, dtype=bool) if bound is None else a == bound
    assert held.any() == (bound is not None)
    assert (pulls[0][held] < 0.0).all()
    # A step of 1e-10 standard deviations moves a pull of twelve rows by about 1e-9.
    np.testing.assert_allclose(pulls[0][~held], 0.0, atol=1e-8)
    np.testing.assert_allclose(pulls[1], 0.0, atol=1e-8)
