"""Uncertain constants beside limits: what an estimate would be without its limit varies with them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import truncnorm

import mbm

TEXT = """(problem p (data d external) (constants (h 0 :sigma 0.3)) (unknowns {unknown}) {limit} {each}
    (observe d (= y (+ a h)) :sigma 0.2) (derive (twice (* 2 a)) (square (^ a 2))))"""

HELD = ("a", "twice", "square")
NEAR = ("a",)
"""Near a limit that does not hold it, what is derived beside an uncertain constant is not cut."""


@pytest.mark.parametrize(("unknown", "limit"), [("(a :in (0 10))", ""), ("(a)", "(constraints (>= a 0))")])
@pytest.mark.parametrize("each", ["", "(for-each k)"])
@pytest.mark.parametrize(("readings", "names"), [((-0.3, -0.1, 0.02), HELD), ((0.1, 0.04, 0.08), NEAR)])
def test_a_constant_widens_the_interval_at_a_limit(
    unknown: str, limit: str, each: str, readings: tuple[float, ...], names: tuple[str, ...]
) -> None:
    """The interval is that of the normal distribution of both parts that is left between the limits: held and not."""
    text = TEXT.format(unknown=unknown, limit=limit, each=each)
    found = mbm.loads(text).solve(data={"d": {"y": np.array(readings), "k": np.zeros(3)}}).solves[0]
    centre, scale = float(np.mean(readings)), float(np.hypot(0.2 / np.sqrt(3), 0.3))
    far = truncnorm.ppf(0.95, -centre / scale, np.inf, centre, scale)
    assert far > 2 * centre  # the shortest begins at the limit
    for name, end in zip(names, (far, 2 * far, far**2), strict=False):
        # 1e-6: half of a difference of two solves stands for the derivative
        assert found[name].interval() == pytest.approx([0.0, end], rel=1e-6, abs=1e-9)
