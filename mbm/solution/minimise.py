"""Equations and a start → a minimum: chooses the solver and turns its crank."""

from __future__ import annotations

from mbm.problem.types import Method
from mbm.solution import faults
from mbm.solution.constrained.solve import constrained_minimum
from mbm.solution.constrained.types import ConstrainedEquations
from mbm.solution.settings import Settings
from mbm.solution.solvers.dogleg import DOGLEG
from mbm.solution.solvers.gauss_newton import GAUSS_NEWTON
from mbm.solution.solvers.linear import LINEAR
from mbm.solution.solvers.marquardt import MARQUARDT
from mbm.solution.types import Equations, Floats, Minimum, Reason, Solver
from mbm.text.types import MbmError, Place

DENSE_LIMIT = 200_000_000
"""Numbers in a dense Jacobian: 1.6 GB, and as much again while it is decomposed."""

METHODS: dict[Method, Solver] = {
    Method.MARQUARDT: MARQUARDT,
    Method.DOGLEG: DOGLEG,
    Method.GAUSS_NEWTON: GAUSS_NEWTON,
}


def solver_for(equations: Equations, settings: Settings) -> Solver:
    """The solver that ``settings`` names; `auto` is one step for linear equations without bounds, else Marquardt."""
    if settings.method is not Method.AUTO:
        return METHODS[settings.method]
    return LINEAR if LINEAR.supports(equations) else MARQUARDT


def minimise(equations: Equations, start: Floats, settings: Settings, place: Place | None = None) -> Minimum:
    """The minimum of ``Σ r²`` (where the constraints hold) that the start leads to; never worse than the start.

    Raises MbmError (`no-equations`, `no-unknowns`, `too-many-unknowns`), with ``place`` to point at.
    """
    if equations.dimension == 0:
        raise MbmError(faults.no_unknowns(place))
    if equations.count == 0:
        raise MbmError(faults.no_equations(equations.dimension, place))
    if max(equations.count, equations.dimension) * equations.dimension > DENSE_LIMIT:
        raise MbmError(faults.too_many_unknowns(equations.count, equations.dimension, DENSE_LIMIT, place))
    if isinstance(equations, ConstrainedEquations) and equations.equality.size:
        return constrained_minimum(equations, start, settings)
    solver = solver_for(equations, settings)
    state = solver.init(equations, start, settings.tolerance)
    reason = solver.finished(state)
    iterations = 0
    while reason is None and iterations < settings.max_iterations:
        state = solver.step(equations, state)
        iterations += 1
        reason = solver.finished(state)
    return solver.minimum(state, reason or Reason.MAX_ITERATIONS)
