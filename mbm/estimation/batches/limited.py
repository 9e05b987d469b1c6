"""Hard limits of single coordinates in many solves, by the formulas of `intervals.limits`."""

from __future__ import annotations

import numpy as np

from mbm.equations.binding import affine
from mbm.equations.spreads import Limited
from mbm.equations.types import Floats, Mask
from mbm.estimation.batches.factor import Spread
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.surface import Held
from mbm.estimation.batches.types import DegreesColumns, Ends
from mbm.estimation.coverage.limits import Lines, box, narrow, single_limits
from mbm.estimation.uncertainty.student import coverage_factors
from mbm.problem.types import Problem


@np.errstate(all="ignore")
def limited_columns(portion: Portion, found: Held | None, points: Floats) -> Limited | None:
    """The limits at the ends ``points`` (K, N) of K solves; None where there are none.

    What a limit holds is no matter of columns.
    """
    equations = portion.equations
    shape = (portion.count, equations.dimension)
    lower, upper = (np.broadcast_to(each, shape).copy() for each in box(equations))
    held = np.zeros(shape, dtype=bool)
    if found is not None:
        plain = np.zeros(len(equations.layout.number), dtype=bool)
        plain[equations.free] = True
        exact = np.zeros(found.there.shape, dtype=bool)
        for group, solve, slots in portion.limits():
            exact[solve[:, None], slots] = affine(group, plain)
        single, owner = single_limits(found.slopes, exact & found.there & ~found.equality)
        places = equations.layout.number[equations.free]
        place = np.where(places >= 0, points[:, places], 0.0)
        held = narrow(lower, upper, place, Lines(found.values, found.slopes, found.forcing, single, owner))
    if not (held.any() or np.isfinite(lower).any() or np.isfinite(upper).any()):
        return None
    return Limited(lower=lower, upper=upper, step=np.where(held, np.inf, np.nan), sigma=np.full(shape, np.nan))


def held_back(found: Held) -> Mask:
    """Solves (K,) that an inequality holds: where it lets go of them is looked for one by one."""
    return np.asarray((found.forcing & ~found.equality).any(axis=1))


@np.errstate(all="ignore")
def near_limits(
    problem: Problem,
    portion: Portion,
    ends: Ends,
    limits: tuple[Held | None, Limited | None],
    spread: Spread,
    degrees: DegreesColumns,
) -> Mask:
    """Solves (K,) of likelihoods, and with derived quantities, with an estimate that a limit holds, or is within twice
    the linear interval of; so, too, of inequalities of several.

    Such intervals are looked for one by one.
    """
    found, limited = limits
    near = np.zeros(portion.count, dtype=bool)
    if not (portion.equations.likely or problem.derived):
        return near
    freedom, places = degrees.estimates, portion.equations.layout.number[portion.equations.free]
    factors = 2.0 * coverage_factors(problem.request.coverage, freedom.dof) * freedom.inflation
    if limited is not None:
        reach, place = factors * spread.sigma, ends.points[:, places]
        close = ~np.isnan(limited.step) | (place - reach < limited.lower) | (place + reach > limited.upper)
        near |= (close & (places >= 0)).any(axis=1)
    if found is not None:
        sigma = np.sqrt(np.square(np.matmul(found.slopes, spread.factor)).sum(axis=2))
        close = -found.values < sigma * factors.max(axis=1, keepdims=True)
        near |= (close & found.there & ~found.equality).any(axis=1)
    return near
