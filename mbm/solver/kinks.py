"""Minima at a kink of the equations, where a larger of two changes hands, a size turns, or an edge comes into sight.

There the cost grows on all sides although neither side's gradient vanishes: some mean of both does (Clarke 1983,
Optimization and Nonsmooth Analysis, proposition 2.3.2). No step of one side's linear model finds that out. Where the
mean does not vanish, its step is orthogonal to the difference of both gradients, and leads along the kink.
"""

from __future__ import annotations

from math import isfinite

from mbm.machine.words import Integer, Real
from mbm.solver.description import FLAT, KINK, Problem
from mbm.solver.linear_algebra import copied, dot, solve_transposed, solve_upper, times_transposed
from mbm.solver.linearisation import arrive, judge
from mbm.solver.manifolds import retract
from mbm.solver.step_control import relative_offset
from mbm.solver.trial_steps import cost_of_trial, factor_there
from mbm.solver.workspace import Work

ACROSS = 1e-4
"""Step to the other side, by the relative offset (about in standard deviations): a kink has to be as near as that."""

LEVEL = 1e-3
"""Relative offset that the mean of both gradients may leave."""

ALONG = 20
"""Steps along a kink."""


def settle_at_kink(problem: Problem, work: Work) -> None:
    """Go to the minimum along the kink that the iteration is at, which no step improves any more; `stop` says so.

    FLAT where there is no kink, at a bound, where the rank is not full, and beside penalties, whose rounds need more
    digits than a kink has.
    """
    work.stop = FLAT
    if work.penalised == 1:
        return
    if work.curvature_known == 1:
        work.curvature_known = 0
        judge(problem, work.here, 0, work)
    for _ in range(ALONG):
        offset = offset_at_kink(problem, work)
        if offset <= LEVEL:
            if offset >= 0.0:
                work.stop = KINK
            return
        if try_there(problem, work) == 0 or not work.cost_tried < work.here.cost:
            return
        there = work.other
        arrive(problem, there, 1, 0, work)
        work.other = work.here
        work.here = there
        work.residuals_here = work.residuals_tried


def try_there(problem: Problem, work: Work) -> Integer:
    """Evaluate the point after the step; 0 where it has no value."""
    retract(problem, work.here.point, work.step, work.trial)
    return factor_there(problem, work) if isfinite(cost_of_trial(problem, work.penalised, work)) else 0


def offset_at_kink(problem: Problem, work: Work) -> Real:
    """The relative offset that the mean of the gradients on both sides leaves, with the step that answers it; -1: none.

    The kink lies on the way of the undamped step, if there is one.
    """
    n = problem.n
    here = work.here
    held = here.deficient
    for j in range(n):
        held += 1 if here.free[j] == 0.0 else 0
    if held > 0 or not here.offset > ACROSS:
        return -1.0
    for j in range(n):
        work.step[j] = ACROSS / here.offset * here.full[j]
    if try_there(problem, work) == 0:
        return -1.0
    there = work.other
    arrive(problem, there, 1, 0, work)
    apart = work.scaled
    times_transposed(n, there.factor, there.projected, apart)
    for j in range(n):
        apart[j] *= there.scale[j] / here.scale[j]
    solve_transposed(n, here.factor, apart)
    mean = work.moved
    copied(n, here.projected, mean)
    for j in range(n):
        apart[j] -= mean[j]
    distance = dot(n, apart, apart)
    towards = -dot(n, apart, mean)
    if not (towards > 0.0 and towards < distance):
        return -1.0
    for j in range(n):
        mean[j] += towards / distance * apart[j]
    inside = dot(n, mean, mean)
    outside = here.cost - dot(n, here.projected, here.projected)
    solve_upper(n, here.factor, mean)
    for j in range(n):
        work.step[j] = -mean[j] / here.scale[j]
    return relative_offset(inside, outside, n, here.freedom)
