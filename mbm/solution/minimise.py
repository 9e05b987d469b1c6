"""Equations and a start → a minimum: chooses the solver and turns its crank."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from mbm.problem.types import Method
from mbm.solution import faults
from mbm.solution.nudging import SINGULAR, beside
from mbm.solution.settings import Settings
from mbm.solution.solvers.dogleg import DOGLEG
from mbm.solution.solvers.gauss_newton import GAUSS_NEWTON
from mbm.solution.solvers.linear import LINEAR
from mbm.solution.solvers.marquardt import MARQUARDT
from mbm.solution.solvers.standing import STANDING
from mbm.solution.sparsity import sparse_suits
from mbm.solution.types import Correctable, Equations, Floats, Minimum, Reason, Solver
from mbm.text.types import MbmError, Place

if TYPE_CHECKING:
    from mbm.solution.constrained.types import ConstrainedEquations

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
    if _sparse(equations, settings):
        # Here and below: methods that few problems need are loaded by those that do, so that small ones start at once.
        from mbm.solution.sparse.marquardt import SPARSE_MARQUARDT

        return SPARSE_MARQUARDT
    if settings.method is not Method.AUTO:
        return METHODS[settings.method]
    return LINEAR if LINEAR.supports(equations) else MARQUARDT


def solver_name(equations: Equations, settings: Settings) -> str:
    """The name of the method that ``minimise`` takes."""
    solver = solver_for(equations, settings)
    if solver is STANDING or _bound(equations, settings) is None:
        return solver.name
    from mbm.solution.constrained.solve import method_name

    return method_name(settings)


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
    bound = _bound(equations, settings)
    if (not _sparse(equations, settings) or bound is not None) and size > DENSE_LIMIT:
        raise MbmError(faults.too_many_unknowns(equations.count, equations.dimension, DENSE_LIMIT, place))
    if isinstance(equations, Correctable) and equations.profiled:
        from mbm.solution.implicit.approach import approached

        start = approached(equations, start, lambda plain, point: _roughly(plain, point, settings))
    if solver in (LINEAR, MARQUARDT):
        from mbm.solution.native.minimum import native_minimum

        native = native_minimum(equations, start, settings)
        if native is not None:
            return native
    found = _from(equations, bound, solver, start, settings)
    if found.reason in SINGULAR and solver is not STANDING:
        others = (_from(equations, bound, solver, point, settings) for point in beside(equations, start, settings.seed))
        found = next((other for other in others if other.reason not in SINGULAR), found)
    return found


def minima(equations: Equations, starts: Floats, settings: Settings, place: Place | None = None) -> Iterator[Minimum]:
    """The minimum that each of many starts (T, N) leads to, as `minimise` finds it; native solves are made at once."""
    found: Iterable[Minimum | None] = (None for _ in starts)
    profiled = isinstance(equations, Correctable) and equations.profiled
    if len(starts) > 1 and not profiled and solver_for(equations, settings) in (LINEAR, MARQUARDT):
        from mbm.solution.native.minimum import native_minima

        found = native_minima(equations, starts, settings)
    for start, native in zip(starts, found, strict=True):
        yield minimise(equations, start, settings, place) if native is None else native


def _sparse(equations: Equations, settings: Settings) -> bool:
    """Whether the sparse solver is taken."""
    return settings.method in (Method.AUTO, Method.MARQUARDT) and sparse_suits(equations)


def _bound(equations: Equations, settings: Settings) -> ConstrainedEquations | None:
    """The equations if a method for constraints is to take them."""
    equality = getattr(equations, "equality", None)
    if equality is None or (not equality.size and settings.method is not Method.IPOPT):
        return None
    from mbm.solution.constrained.solve import for_constrained

    return for_constrained(equations, settings)


def _from(
    equations: Equations, bound: ConstrainedEquations | None, solver: Solver, start: Floats, settings: Settings
) -> Minimum:
    """Where the solver gets from the start; ``bound`` are the equations if they have constraints."""
    if solver is not STANDING and bound is not None:
        from mbm.solution.constrained.solve import constrained_minimum

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
    if bound is None:
        return found
    from mbm.solution.constrained.solve import with_constraints

    return with_constraints(bound, found)


def _roughly(equations: Equations, start: Floats, settings: Settings) -> Floats:
    """Where a few iterations lead."""
    short = replace(settings, max_iterations=min(ROUGH, settings.max_iterations), tolerance=ROUGHLY)
    return minimise(equations, start, short).point
