"""What filters and smoothers begin with, and what they keep of a step."""

from __future__ import annotations

from math import fabs

from mbm.machine.words import ConstantReals, Integer
from mbm.solver.filter_losses import POOLED
from mbm.solver.filter_records import Walk, share_out_walk
from mbm.solver.linear_algebra import copied, filled

UNTOUCHED = 1e-9
"""A component of an open vector, which is of length 1 at first, up to which it is rounding."""


def begin_walk(walk: Walk) -> None:
    """Room for everything; `point`, `factor` and `open` are to be filled then."""
    share_out_walk(walk)
    walk.failed = 0
    walk.iterations = 0
    walk.evaluations = 0
    walk.settled = 1
    walk.unsettled = 0
    walk.left_cost = 0.0
    walk.last_equations = 0
    walk.equations = 0
    walk.open_count = 0
    walk.counted = 0
    filled(walk.chain.pools * POOLED, 0.0, walk.pools)


def keep_step(walk: Walk, k: Integer, factor: ConstantReals) -> None:
    """Let the answer for step k be where the walk is, with a factor of its covariance."""
    chain = walk.chain
    place = k % chain.held
    copied(chain.numbers, walk.point, walk.points[place * chain.numbers :])
    copied(chain.n * chain.n, factor, walk.factors[place * chain.n * chain.n :])
    walk.costs[place] = walk.last_cost
    walk.equations += walk.last_equations
    walk.opens[place] = walk.open_count
    for j in range(chain.n):
        walk.touched[place * chain.n + j] = 0
        for i in range(walk.open_count):
            if fabs(walk.open[i * chain.n + j]) > UNTOUCHED:
                walk.touched[place * chain.n + j] = 1
