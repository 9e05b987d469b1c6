"""Equations and a start → a minimum: chooses the solver and turns its crank."""

from __future__ import annotations

from dataclasses import replace

from mbm.problem.types import Method
from mbm.solution import faults
from mbm.solution.constrained.solve import constrained_minimum, for_constrained, method_name, with_constraints
from mbm.solution.constrained.types import ConstrainedEquations
from mbm.solution.implicit.approach import approached
from mbm.solution.nudging import SINGULAR, beside
from mbm.solution.settings import Settings
from mbm.solution.solvers.dogleg import DOGLEG
from mbm.solution.solvers.gauss_newton import GAUSS_NEWTON
from mbm.solution.solvers.linear import LINEAR
from mbm.solution.solvers.marquardt import MARQUARDT
from mbm.solution.solvers.standing import STANDING
from mbm.solution.sparse.equations import sparse_suits
from mbm.solution.sparse.marquardt import SPARSE_MARQUARDT
from mbm.solution.types import Equations, Floats, Minimum, Reason, Solver
from mbm.text.types import MbmError, Place

DENSE_LIMIT = 200_000_000
"""Numbers in a dense Jacobian: 1.6 GB, and as much again while it is decomposed."""

ROUGH = 20
ROUGHLY = 0.05
"""Iterations and relative offset of a fit whose end is only a start."""

METHODS: dict[Method, Solver] = {
    Method.MARQUARDT: MARQUARDT,
    Method.DOGLEG: DOGLEG,
    Method.GAUSS_NEWTON: GAUSS_NEWTON,
    Method.CLOSED_FORM: STANDING,
    Method.DIRECT_SEARCH: MARQUARDT,
    Method.IPOPT: MARQUARDT,
}


def solver_for(equations: Equations, settings: Settings) -> Solver:
    """The solver that ``settings`` names; `auto` is one step for linear equations without bounds, else Marquardt."""
    if settings.method in (Method.AUTO, Method.MARQUARDT) and sparse_suits(equations):
        return SPARSE_MARQUARDT
    if settings.method is not Method.AUTO:
        return METHODS[settings.method]
    return LINEAR if LINEAR.supports(equations) else MARQUARDT


def solver_name(equations: Equations, settings: Settings) -> str:
    """The name of the method that ``minimise`` takes."""
    solver = solver_for(equations, settings)
    return solver.name if solver is STANDING or for_constrained(equations, settings) is None else method_name(settings)


def minimise(equations: Equations, start: Floats, settings: Settings, place: Place | None = None) -> Minimum:
    """The minimum of ``Σ r²`` (where the constraints hold) that the start leads to; never worse than the start.

    Raises MbmError (`no-equations`, `no-unknowns`, `too-many-unknowns`), with ``place`` to point at.
    """
    if equations.dimension == 0:
        raise MbmError(faults.no_unknowns(place))
    if equations.count == 0:
        raise MbmError(faults.no_equations(equations.dimension, place))
    solver = solver_for(equations, settings)
    size = max(equations.count, equations.dimension) * equations.dimension
    bound = for_constrained(equations, settings)
    if (solver is not SPARSE_MARQUARDT or bound is not None) and size > DENSE_LIMIT:
        raise MbmError(faults.too_many_unknowns(equations.count, equations.dimension, DENSE_LIMIT, place))
    start = approached(equations, start, lambda plain, point: _roughly(plain, point, settings))
    found = _from(equations, bound, solver, start, settings)
    if found.reason in SINGULAR and solver is not STANDING:
        others = (_from(equations, bound, solver, point, settings) for point in beside(equations, start))
        found = next((other for other in others if other.reason not in SINGULAR), found)
    return found


def _from(
    equations: Equations, bound: ConstrainedEquations | None, solver: Solver, start: Floats, settings: Settings
) -> Minimum:
    """Where the solver gets from the start; ``bound`` are the equations if they have constraints."""
    if solver is not STANDING and bound is not None:
        return constrained_minimum(bound, start, settings)
    state = solver.init(equations, start, settings.tolerance)
    reason = solver.finished(state)
    iterations = 0
    while reason is None and iterations < settings.max_iterations:
        if settings.stopped():
            reason = Reason.INTERRUPTED
            break
        state = solver.step(equations, state)
        iterations += 1
        reason = solver.finished(state)
    found = solver.minimum(state, reason or Reason.MAX_ITERATIONS)
    return found if bound is None else with_constraints(bound, found)


def _roughly(equations: Equations, start: Floats, settings: Settings) -> Floats:
    """Where a few iterations lead."""
    short = replace(settings, max_iterations=min(ROUGH, settings.max_iterations), tolerance=ROUGHLY)
    return minimise(equations, start, short).point
