"""Equations and a start → a minimum: chooses the solver and turns its crank."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from mbm.problem.types import Method
from mbm.solution import faults
from mbm.solution.nudging import SINGULAR, beside
from mbm.solution.pushing import with_pushed_bounds
from mbm.solution.settings import Settings
from mbm.solution.solvers.box import one_step_suits
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

SPARSE, LINEAR, MARQUARDT = "lm-sparse", "linear", Method.MARQUARDT.value
"""Names of solvers that nobody asks for by name, and of the one that takes over from methods that only begin."""


def solver_for(equations: Equations, settings: Settings) -> Solver:
    """The solver that ``settings`` names; `auto` is one step for linear equations without bounds, else Marquardt."""
    # Here and below: methods that few problems need are loaded by those that do, so that small ones start at once.
    name = _name(equations, settings)
    if name == SPARSE:
        from mbm.solution.sparse.marquardt import SparseMarquardt

        return SparseMarquardt(workers=settings.workers)
    from mbm.solution.solvers.standard import SOLVERS

    return SOLVERS[name]


def _name(equations: Equations, settings: Settings) -> str:
    """The name of that solver."""
    method = settings.method
    if _sparse(equations, settings):
        return SPARSE
    if method is Method.AUTO and one_step_suits(equations):
        return LINEAR
    return MARQUARDT if method in (Method.AUTO, Method.DIRECT_SEARCH, Method.IPOPT) else method.value


def solver_name(equations: Equations, settings: Settings) -> str:
    """The name of the method that ``minimise`` takes."""
    if settings.method is Method.CLOSED_FORM or _bound(equations, settings) is None:
        return _name(equations, settings)
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
    size = max(equations.count, equations.dimension) * equations.dimension
    bound = _bound(equations, settings)
    if (not _sparse(equations, settings) or bound is not None) and size > DENSE_LIMIT:
        raise MbmError(faults.too_many_unknowns(equations.count, equations.dimension, DENSE_LIMIT, place))
    # asked first, as looking for all that a protocol wants takes longer than a small solve
    if getattr(equations, "profiled", False) and isinstance(equations, Correctable):
        from mbm.solution.implicit.approach import approached

        start = approached(equations, start, lambda plain, point: _roughly(plain, point, settings))
    if _compiled(equations) and _name(equations, settings) in (LINEAR, MARQUARDT):
        from mbm.solution.native.minimum import native_minimum

        native = native_minimum(equations, start, settings)
        if native is not None:
            return with_pushed_bounds(equations, native)
    solver = solver_for(equations, settings)
    found = _from(equations, bound, solver, start, settings)
    if found.reason in SINGULAR and settings.method is not Method.CLOSED_FORM:
        others = (_from(equations, bound, solver, point, settings) for point in beside(equations, start, settings.seed))
        found = next((other for other in others if other.reason not in SINGULAR), found)
    return with_pushed_bounds(equations, found)


def minima(equations: Equations, starts: Floats, settings: Settings, place: Place | None = None) -> Iterator[Minimum]:
    """The minimum that each of many starts (T, N) leads to, as `minimise` finds it; native solves are made at once."""
    found: Iterable[Minimum | None] = (None for _ in starts)
    alone = len(starts) < 2 or getattr(equations, "profiled", False) or not _compiled(equations)
    if not alone and _name(equations, settings) in (LINEAR, MARQUARDT):
        from mbm.solution.native.minimum import native_minima

        found = native_minima(equations, starts, settings)
    for start, native in zip(starts, found, strict=True):
        each = minimise(equations, start, settings, place) if native is None else native
        yield with_pushed_bounds(equations, each)


def _compiled(equations: Equations) -> bool:
    """Whether there may be machine code for the equations."""
    return getattr(equations, "machine_code", None) is not None


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
    if settings.method is not Method.CLOSED_FORM and bound is not None:
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
