"""How the native solver goes on from a start, by what the equations are and what is asked."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Equations
from mbm.estimation.settings import Settings
from mbm.problem.kinds import ConstraintMethod
from mbm.problem.types import Method
from mbm.solver import description as of
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Iteration:
    """How a solve goes on: at ``most`` so many iterations, to a relative offset of ``tolerance``.

    ``direct``: the one step of affine equations; the others as in `description.Problem`.
    """

    most: int
    tolerance: float
    direct: bool = False
    strict: bool = True
    rule: int = of.MARQUARDT
    exact: bool = False


def one_step_suits(equations: Equations) -> bool:
    """Whether one linear step is the answer: affine residuals, no constraint, no bound and no `positive` unknown."""
    bounded = np.isfinite(equations.lower) | np.isfinite(equations.upper) | equations.positive
    constrained = bool(getattr(equations, "constraints", ()))
    return equations.linear and not constrained and not bool(bounded.any())


def iteration_of(equations: Equations, settings: Settings, *, direct: bool | None, strict: bool) -> Iteration:
    """How equations are solved; ``direct`` and ``strict`` as in `system_of`."""
    if direct is None:
        direct = settings.method is Method.AUTO and one_step_suits(equations)
    return Iteration(
        most=0 if settings.method is Method.CLOSED_FORM else settings.max_iterations,
        tolerance=settings.tolerance,
        direct=direct,
        strict=strict,
        rule=of.RULES.get(settings.method.value, of.MARQUARDT),
        exact=settings.constraints is ConstraintMethod.EXACT,
    )
