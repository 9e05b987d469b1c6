"""Which method meets the constraints, as the settings ask."""

from __future__ import annotations

from mbm.problem.types import ConstraintMethod
from mbm.solution.constrained.answer import minimum_of
from mbm.solution.constrained.minimise import by_penalties, by_sequential_steps
from mbm.solution.constrained.types import ConstrainedEquations
from mbm.solution.settings import Settings
from mbm.solution.types import Floats, Minimum


def constrained_minimum(equations: ConstrainedEquations, start: Floats, settings: Settings) -> Minimum:
    """The constrained minimum that the start leads to."""
    solve = by_sequential_steps if settings.constraints is ConstraintMethod.EXACT else by_penalties
    found = solve(
        equations, start, tolerance=settings.tolerance, limit=settings.max_iterations, seed=settings.seed
    )
    return minimum_of(equations, found)
