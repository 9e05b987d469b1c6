"""Minima by the native solver, as every solver answers: one, or those of many starts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mbm.problem.types import ConstraintMethod, Method
from mbm.solution.assembly import Assembled
from mbm.solution.batch import batch
from mbm.solution.native.system import NativeEnds, NativeSystem, system_of
from mbm.solution.settings import Settings
from mbm.solution.types import Equations, Floats, Minimum, Reason
from mbm.target.decisions import MEMORY
from mbm.target.solver import description as of

ENDINGS = {
    of.SMALL_OFFSET: Reason.SMALL_OFFSET,
    of.ROUNDING: Reason.ROUNDING,
    of.EXACT_FIT: Reason.EXACT_FIT,
    of.ONE_STEP: Reason.ONE_STEP,
}
"""Ends that are believed; after any other the general path starts anew, and finds the words for it."""

SAME, TINY = 1e-9, 1e-9
"""Relative difference of costs up to which corrections that were found in two ways are the same, and the cost below
which only rounding is left."""


def native_minimum(equations: Equations, start: Floats, settings: Settings) -> Minimum | None:
    """The minimum that a start (N,) leads to; None: the equations are not for the native solver, or it is not sure."""
    if not isinstance(equations, Assembled):
        return None
    system = _system(equations if equations.implicit is None else equations.straightened(), settings)
    if system is None:
        return None
    ends = system.one(start, stopped=settings.stopped if settings.interruption is not None else None)
    point = ends.numbers[0]
    with np.errstate(all="ignore"):
        return _minimum(equations, ends, 0, equations.residuals(point), equations.jacobian(point))


def native_minima(equations: Equations, starts: Floats, settings: Settings) -> Iterator[Minimum | None]:
    """The same for many starts (T, N) in one call; the ends do not depend on the number of threads."""
    system = _system(equations, settings) if len(starts) else None
    if system is None or not isinstance(equations, Assembled):
        yield from (None for _ in starts)
        return
    ends = system.solve(starts, workers=settings.threads(len(starts)), stopped=settings.stopped)
    stack = batch(equations)
    step = max(1, MEMORY // max(1, stack.count * stack.dimension))
    for first in range(0, len(starts), step):
        which = np.arange(first, min(first + step, len(starts)))
        with np.errstate(all="ignore"):
            residuals, jacobian = stack.linearised(ends.numbers[which], which - first)
        for k, here, slopes in zip(which.tolist(), residuals, jacobian, strict=True):
            made = ends.states[k, of.EVALUATIONS] > 0
            yield _minimum(equations, ends, k, here.copy(), slopes.copy()) if made else None


def _system(equations: Equations | None, settings: Settings) -> NativeSystem | None:
    """What the native solver is given; None where it should not take part."""
    if not isinstance(equations, Assembled) or settings.method not in (Method.AUTO, Method.MARQUARDT):
        return None
    if equations.constraints and settings.constraints is not ConstraintMethod.PENALTY:
        return None
    return system_of(equations, settings)


def _minimum(equations: Assembled, ends: NativeEnds, k: int, residuals: Floats, jacobian: Floats) -> Minimum | None:
    """The end of solve ``k`` as a minimum; None where it is not to be believed."""
    code = int(ends.states[k, of.REASON])
    interrupted = code == of.RUNNING
    if not interrupted and (code not in ENDINGS or not ends.clean[k]):
        return None
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        return None
    cost = float(residuals @ residuals)
    if equations.implicit is not None and not abs(ends.results[k, of.COST] - cost) <= SAME * max(cost, TINY):
        return None
    found = Minimum(
        point=ends.numbers[k],
        residuals=residuals,
        jacobian=jacobian,
        cost=cost,
        reason=Reason.INTERRUPTED if interrupted else ENDINGS[code],
        iterations=int(ends.states[k, of.STEPS]),
        evaluations=int(ends.states[k, of.EVALUATIONS]),
        offset=float(ends.results[k, of.OFFSET]),
        at_bound=ends.sides[k].astype(np.int8),
    )
    return _with_constraints(equations, found, ends.multipliers[k]) if equations.constraints else found


def _with_constraints(equations: Assembled, found: Minimum, multipliers: Floats) -> Minimum | None:
    """The minimum with its constraints; None where they do not all hold."""
    # Loaded by problems with constraints only, so that the others start at once.
    from mbm.solution.constrained.answer import constraint_state
    from mbm.solution.constrained.linearise import linearise

    place = linearise(equations, found.point)
    state = constraint_state(equations.equality, place, multipliers[: len(place.values)])
    return None if bool(state.violated.any()) else replace(found, constraints=state)
