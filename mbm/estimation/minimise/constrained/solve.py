"""Constrained minima by the compiled solver, and what the settings ask of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Conflict, Equations, Floats, Minimum, Reason
from mbm.estimation.minimise.constrained.feasible import feasible_point
from mbm.estimation.minimise.constrained.linearise import constraint_state, linearise, without_constrained_value
from mbm.estimation.minimise.constrained.types import ConstrainedEquations, constrained
from mbm.estimation.minimise.native.minimum import Stopped, linearised_ends, minimum_at, native_minimum
from mbm.estimation.minimise.native.system import NativeEnds, system_of
from mbm.estimation.settings import Settings
from mbm.problem.kinds import ConstraintMethod
from mbm.problem.types import Method
from mbm.solver import description as of


def for_constrained(equations: Equations, settings: Settings) -> ConstrainedEquations | None:
    """The equations if they have constraints, or are for Ipopt."""
    if settings.method is Method.IPOPT and hasattr(equations, "equality"):
        return cast(ConstrainedEquations, equations)
    return constrained(equations)


def method_name(settings: Settings) -> str:
    """What the method that meets the constraints is called."""
    return Method.IPOPT.value if settings.method is Method.IPOPT else settings.constraints.value


def constrained_minimum(
    equations: ConstrainedEquations, start: Floats, settings: Settings, stopped: Stopped | None = None
) -> Minimum:
    """The constrained minimum that the start leads to; ``stopped`` is asked between iterations (None: nobody is).

    Where the search ends with violations, a point that meets the constraints is looked for: from there sequential steps
    go on; without one, what contradicts is named.
    """
    if settings.method is Method.IPOPT:
        # Loads CasADi.
        from mbm.estimation.minimise.constrained.ipopt import interior_point, last_step

        start = interior_point(equations, start, settings.max_iterations)
        settings = replace(settings, method=Method.AUTO, constraints=ConstraintMethod.EXACT)
        if not equations.equality.size:
            return native_minimum(equations, last_step(equations, start), settings, stopped)
    found = _minimum(equations, start, settings, stopped)
    if found.feasible or found.bad_row is not None or found.reason is Reason.INTERRUPTED:
        return found
    point, conflict = feasible_point(equations, found.point, start, settings)
    if conflict is not None:
        return _contradicting(equations, point, found, conflict)
    exactly = replace(settings, constraints=ConstraintMethod.EXACT)
    again = _minimum(equations, point, exactly, stopped)
    return replace(
        again if again.feasible and again.bad_row is None else found,
        iterations=found.iterations + again.iterations,
        evaluations=found.evaluations + again.evaluations,
    )


def constrained_minima(equations: Assembled, starts: Floats, settings: Settings) -> Iterator[Minimum | None]:
    """The same for many starts (T, N) in one call; the ends do not depend on the number of threads.

    None: not by kernels, or its constraints do not hold, or the rank is not full.
    """
    system = system_of(equations, settings) if len(starts) and settings.iterative else None
    if system is None:
        yield from (None for _ in starts)
        return
    for k, ends, at in linearised_ends(equations, system, starts, settings):
        found = None if at is None or not ends.clean[k] else _on_surface(equations, ends, k, sure=True)
        yield found if found is not None and found.feasible else None


def with_constraints(equations: ConstrainedEquations, minimum: Minimum) -> Minimum:
    """A minimum that was found without regard to the constraints, with what became of them."""
    place = linearise(equations, minimum.point)
    state = constraint_state(equations.equality, place, np.zeros(len(place.values)))
    return replace(minimum, constraints=replace(state, forcing=state.forcing & ~state.violated))


def _minimum(equations: ConstrainedEquations, start: Floats, settings: Settings, stopped: Stopped | None) -> Minimum:
    """Where the solver gets."""
    found = kernel_constrained_minimum(equations, start, settings, stopped)
    return function_constrained_minimum(equations, start, settings, stopped) if found is None else found


def kernel_constrained_minimum(
    equations: Equations, start: Floats, settings: Settings, stopped: Stopped | None = None
) -> Minimum | None:
    """The same by kernels that it calls; None: not for these equations, or it is not sure."""
    if not isinstance(equations, Assembled):
        return None
    straight = equations if equations.implicit is None else equations.straightened()
    system = None if straight is None else system_of(straight, settings, strict=False)
    if system is None:
        return None
    sure = equations.implicit is None
    found = _on_surface(equations, system.one(start, stopped=stopped, end="set_end"), 0, sure=sure)
    return found if sure or found is None or found.feasible else None


def function_constrained_minimum(
    equations: ConstrainedEquations, start: Floats, settings: Settings, stopped: Stopped | None = None
) -> Minimum:
    """The same with equations that are asked for all that they have."""
    # Loaded by the problems that need it only, so that the others start at once.
    from mbm.estimation.minimise.native.function import system_of_function

    ends = system_of_function(equations, settings, constrained=True).one(start, stopped=stopped, end="set_end")
    found = _on_surface(equations, ends, 0, sure=True)
    return without_constrained_value(equations, ends.numbers[0]) if found is None else found


def _on_surface(equations: ConstrainedEquations, ends: NativeEnds, k: int, *, sure: bool) -> Minimum | None:
    """The end of solve ``k`` with its constraints; None where it is not to be believed."""
    point = ends.numbers[k]
    if ends.states[k, of.REASON] == of.NOT_FINITE_AT_START:
        return without_constrained_value(equations, point) if sure else None
    place = linearise(equations, point)
    found = minimum_at(equations, ends, k, (place.residuals, place.jacobian), sure=sure)
    if found is None:
        return None
    state = constraint_state(equations.equality, place, ends.multipliers[k, : len(place.values)])
    violated = bool(state.violated.any())
    reason = Reason.FLAT if found.reason.converged and violated else found.reason
    return replace(found, constraints=state, reason=reason)


def _contradicting(equations: ConstrainedEquations, point: Floats, found: Minimum, conflict: Conflict) -> Minimum:
    """The end at the point of least violation."""
    place = linearise(equations, point)
    state = constraint_state(equations.equality, place, np.zeros(len(place.values)))
    return replace(
        found,
        point=point,
        residuals=place.residuals,
        jacobian=place.jacobian,
        cost=place.cost,
        reason=Reason.INFEASIBLE,
        at_bound=np.zeros(equations.dimension, dtype=np.int8),
        constraints=replace(state, conflict=conflict),
    )
