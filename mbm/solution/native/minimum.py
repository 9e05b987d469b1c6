"""One minimum by the native solver, as every solver answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.problem.types import ConstraintMethod, Method
from mbm.solution.assembly import Assembled
from mbm.solution.native.system import native_code, system_of
from mbm.solution.settings import Settings
from mbm.solution.types import Equations, Floats, Minimum, Reason
from mbm.target.solver import description as of

REASONS = {
    of.RUNNING: Reason.INTERRUPTED,
    of.SMALL_OFFSET: Reason.SMALL_OFFSET,
    of.ROUNDING: Reason.ROUNDING,
    of.EXACT_FIT: Reason.EXACT_FIT,
    of.ONE_STEP: Reason.ONE_STEP,
}
"""Ends that are believed; after any other the general path starts anew, and finds the words for it."""


UNPAID = 100
"""Minima of one problem after which compiling the solver pays where nothing keeps it: it takes as long as they do."""


def native_minimum(equations: Equations, start: Floats, settings: Settings) -> Minimum | None:
    """The minimum that a start (N,) leads to; None: the equations are not for the native solver, or it is not sure."""
    if not isinstance(equations, Assembled) or settings.method not in (Method.AUTO, Method.MARQUARDT):
        return None
    if equations.constraints and settings.constraints is not ConstraintMethod.PENALTY:
        return None
    system = system_of(equations, settings) if pays(equations, 1) else None
    if system is None:
        return None
    ends = system.one(start, stopped=settings.stopped if settings.interruption is not None else None)
    reason = REASONS.get(int(ends.states[0, of.REASON]))
    if reason is None or not (ends.clean[0] or reason is Reason.INTERRUPTED):
        return None
    point = ends.numbers[0]
    with np.errstate(all="ignore"):
        residuals, jacobian = equations.residuals(point), equations.jacobian(point)
    if not (np.isfinite(residuals).all() and np.isfinite(jacobian).all()):
        return None
    found = Minimum(
        point=point,
        residuals=residuals,
        jacobian=jacobian,
        cost=float(residuals @ residuals),
        reason=reason,
        iterations=int(ends.states[0, of.STEPS]),
        evaluations=int(ends.states[0, of.EVALUATIONS]),
        offset=float(ends.results[0, of.OFFSET]),
        at_bound=ends.sides[0].astype(np.int8),
    )
    return _with_constraints(equations, found, ends.multipliers[0]) if equations.constraints else found


def _with_constraints(equations: Assembled, found: Minimum, multipliers: Floats) -> Minimum | None:
    """The minimum with its constraints; None where they do not all hold."""
    # Loaded by problems with constraints only, so that the others start at once.
    from mbm.solution.constrained.answer import constraint_state
    from mbm.solution.constrained.linearise import linearise

    place = linearise(equations, found.point)
    state = constraint_state(equations.equality, place, multipliers[: len(place.values)])
    return None if bool(state.violated.any()) else replace(found, constraints=state)


def pays(equations: Assembled, minima: int) -> bool:
    """Whether machine code is kept, or there are ``minima`` enough to make it for, with those asked for before."""
    from mbm.kernels.backends.native import NativeBackend

    groups = (*equations.groups, *equations.constraints)
    backend = groups[0].cache.backend if groups else None
    if not isinstance(backend, NativeBackend):
        return False
    code = native_code(groups[0].cache.native, backend.store)
    code.asked += minima
    return backend.store is not None or code.asked > UNPAID
