"""Which method meets the constraints, as the settings ask."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from mbm.problem.types import ConstraintMethod, Method
from mbm.solution.constrained.answer import constraint_state, minimum_of
from mbm.solution.constrained.ipopt import by_interior_points
from mbm.solution.constrained.linearise import linearise
from mbm.solution.constrained.minimise import by_penalties, by_sequential_steps
from mbm.solution.constrained.types import ConstrainedEquations, constrained
from mbm.solution.settings import Settings
from mbm.solution.types import Equations, Floats, Minimum


def for_constrained(equations: Equations, settings: Settings) -> ConstrainedEquations | None:
    """The equations if they have constraints, or are for Ipopt."""
    if settings.method is Method.IPOPT and hasattr(equations, "equality"):
        return cast(ConstrainedEquations, equations)
    return constrained(equations)


def method_name(settings: Settings) -> str:
    """What the method that meets the constraints is called."""
    return Method.IPOPT.value if settings.method is Method.IPOPT else settings.constraints.value


def constrained_minimum(equations: ConstrainedEquations, start: Floats, settings: Settings) -> Minimum:
    """The constrained minimum that the start leads to."""
    solve = by_sequential_steps if settings.constraints is ConstraintMethod.EXACT else by_penalties
    if settings.method is Method.IPOPT:
        solve = by_interior_points
    found = solve(
        equations,
        start,
        tolerance=settings.tolerance,
        limit=settings.max_iterations,
        seed=settings.seed,
        stopped=settings.stopped,
    )
    return minimum_of(equations, found)


def with_constraints(equations: ConstrainedEquations, minimum: Minimum) -> Minimum:
    """A minimum that was found without regard to the constraints, with what became of them."""
    place = linearise(equations, minimum.point)
    state = constraint_state(equations.equality, place, np.zeros(len(place.values)))
    return replace(minimum, constraints=replace(state, forcing=state.forcing & ~state.violated))
