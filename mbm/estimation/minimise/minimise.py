"""Equations and a start → a minimum: chooses the solver."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations import faults
from mbm.equations.assembly import Assembled
from mbm.equations.layout import half_turns
from mbm.equations.metric import first_bad
from mbm.equations.types import Correctable, Equations, Floats, Minimum, Reason
from mbm.estimation.minimise.native.iteration import one_step_suits
from mbm.estimation.minimise.native.minimum import native_minima, native_minimum
from mbm.estimation.minimise.sparsity import sparse_suits, touch_few
from mbm.estimation.settings import Settings
from mbm.estimation.starts.nudging import SINGULAR, beside
from mbm.problem.types import Method
from mbm.solver.description import RULES
from mbm.text.types import MbmError, Place

if TYPE_CHECKING:
    from mbm.estimation.minimise.constrained.types import ConstrainedEquations

DENSE_LIMIT = 200_000_000
"""Numbers in a dense Jacobian: 1.6 GB, and as much again while it is decomposed."""

ROUGH = 20
ROUGHLY = 0.05
"""Iterations and relative offset of a fit whose end is only a start."""

MANY = 120
"""Unknowns from which on the sparse solver comes to the minimum faster, of equations that touch few of them."""

MANY_TURNS = 1e4
"""Radians from which on the rounding of an angle is looked at."""

LINEAR, EVALUATION = "linear", "evaluation"
"""The names of methods that nobody asks for by name; the second is for problems without unknowns."""

SPARSE = {
    # The dogleg: fewer iterations than Marquardt's on every pose graph tried, as many on bundles.
    **dict.fromkeys((Method.AUTO, Method.DIRECT_SEARCH), "dogleg-sparse"),
    **{Method(rule): f"{rule}-sparse" for rule in RULES},
}
"""The methods that the sparse solver has, and what it calls them."""

PENALTY_SPARSE = "penalty-sparse"
"""What it calls the way in which it meets constraints."""


def solver_name(equations: Equations, settings: Settings) -> str:
    """The name of the method that ``minimise`` takes: one step for linear equations without bounds, else Marquardt's,
    where the settings name none that goes on from any start; of equations without unknowns, that there is none.
    """
    if equations.dimension == 0:
        return EVALUATION
    method = settings.method
    if method is not Method.CLOSED_FORM and _bound(equations, settings) is not None:
        from mbm.estimation.minimise.constrained.solve import method_name

        return PENALTY_SPARSE if _sparse(equations, settings) else method_name(settings)
    if _sparse(equations, settings):
        return SPARSE[method]
    if method is Method.AUTO and one_step_suits(equations):
        return LINEAR
    only_begin = (Method.AUTO, Method.DIRECT_SEARCH, Method.IPOPT)
    return Method.MARQUARDT.value if method in only_begin else method.value


def minimise(equations: Equations, start: Floats, settings: Settings, place: Place | None = None) -> Minimum:
    """The minimum of ``Σ r²`` (where the constraints hold) that the start leads to; never worse than the start.

    Raises MbmError (`no-equations`, `no-unknowns`, `too-many-unknowns`), with ``place`` to point at.
    """
    if equations.dimension == 0:
        return _unmoved(equations, start, settings, place)
    if equations.count == 0:
        raise MbmError(faults.no_equations(equations.dimension, place))
    size = max(equations.count, equations.dimension) * equations.dimension
    bound = _bound(equations, settings)
    if not _sparse(equations, settings) and size > DENSE_LIMIT:
        raise MbmError(faults.too_many_unknowns(equations.count, equations.dimension, DENSE_LIMIT, place))
    # asked first, as looking for all that a protocol wants takes longer than a small solve
    if getattr(equations, "profiled", False) and isinstance(equations, Correctable):
        from mbm.equations.corrections.search import approached

        start = approached(equations, start, lambda plain, point: _roughly(plain, point, settings))
    found = _from(equations, bound, start, settings)
    if found.reason in SINGULAR and settings.method is not Method.CLOSED_FORM:
        others = (_from(equations, bound, point, settings) for point in beside(equations, start, settings.seed))
        found = next((other for other in others if other.reason not in SINGULAR), found)
    return _unwound(equations, bound, found, settings)


def _unwound(equations: Equations, bound: ConstrainedEquations | None, found: Minimum, settings: Settings) -> Minimum:
    """The minimum, from within half a turn once more where a free angle has gone so far that rounding stops it there.

    Steps in angles that hardly matter at a start (the axes of a circle that becomes an ellipse) may be of any length.
    """
    if not isinstance(equations, Assembled):
        return found
    layout = equations.layout
    own = equations.free[layout.angle[equations.free] & (layout.number[equations.free] >= 0)]
    places = layout.number[own[~(np.isfinite(layout.lower[own]) | np.isfinite(layout.upper[own]))]]
    far = places[np.abs(found.point[places]) > MANY_TURNS]
    if not far.size:
        return found
    near = found.point.copy()
    near[far] = half_turns(near[far])
    again = _from(equations, bound, near, settings)
    return again if again.reason.converged and again.cost <= found.cost else found


def _unmoved(equations: Equations, start: Floats, settings: Settings, place: Place | None) -> Minimum:
    """The point of equations without unknowns, which has no numbers.

    Raises:
        MbmError: there are unknowns, and all are fixed.

    """
    if start.size:
        raise MbmError(faults.no_unknowns(place))
    residuals = equations.residuals(start)
    row = first_bad(residuals)
    found = Minimum(
        point=start,
        residuals=residuals,
        jacobian=np.zeros((len(residuals), 0)),
        cost=float(residuals @ residuals),
        reason=Reason.NO_UNKNOWNS if row is None else Reason.NOT_FINITE_AT_START,
        iterations=0,
        evaluations=1,
        at_bound=np.zeros(0, dtype=np.int8),
        bad_row=row,
    )
    bound = _bound(equations, settings)
    if bound is None:
        return found
    from mbm.estimation.minimise.constrained.solve import with_constraints

    return with_constraints(bound, found)


def minima(equations: Equations, starts: Floats, settings: Settings, place: Place | None = None) -> Iterator[Minimum]:
    """The minimum that each of many starts (T, N) leads to, as `minimise` finds it; native solves are made at once."""
    found: Iterable[Minimum | None] = (None for _ in starts)
    alone = len(starts) < 2 or _sparse(equations, settings) or settings.method in (Method.CLOSED_FORM, Method.IPOPT)
    if not alone and isinstance(equations, Assembled) and not equations.profiled:
        if equations.constraints:
            from mbm.estimation.minimise.constrained.solve import constrained_minima

            found = constrained_minima(equations, starts, settings)
        else:
            found = native_minima(equations, starts, settings)
    for start, native in zip(starts, found, strict=True):
        each = native if native is not None and native.reason not in SINGULAR else None
        yield minimise(equations, start, settings, place) if each is None else _unwound(equations, None, each, settings)


def _sparse(equations: Equations, settings: Settings) -> bool:
    """Whether the sparse solver is taken."""
    return settings.method in SPARSE and sparse_suits(equations)


def _bound(equations: Equations, settings: Settings) -> ConstrainedEquations | None:
    """The equations if a method for constraints is to take them."""
    equality = getattr(equations, "equality", None)
    if equality is None or (not equality.size and settings.method is not Method.IPOPT):
        return None
    from mbm.estimation.minimise.constrained.solve import for_constrained

    return for_constrained(equations, settings)


def _from(equations: Equations, bound: ConstrainedEquations | None, start: Floats, settings: Settings) -> Minimum:
    """Where the solver gets from the start; ``bound`` are the equations if they have constraints."""
    if settings.method is not Method.CLOSED_FORM and bound is not None:
        sparse = _sparse(equations, settings) or (settings.method is Method.IPOPT and sparse_suits(equations))
        if sparse and isinstance(equations, Assembled) and equations.constraints:
            from mbm.estimation.minimise.constrained.sparse import sparse_constrained_minimum

            return sparse_constrained_minimum(equations, start, settings)
        from mbm.estimation.minimise.constrained.solve import constrained_minimum

        return constrained_minimum(bound, start, settings, stopped(settings))
    if _sparse(equations, settings):
        # Here and below: methods that few problems need are loaded by those that do, so that small ones start at once.
        from mbm.estimation.minimise.sparse import sparse_minimum

        found = sparse_minimum(equations, start, settings)
    else:
        begun = _begun_sparsely(equations, start, settings)
        point = start if begun is None else begun.point
        found = native_minimum(equations, point, settings, stopped(settings))
        if begun is not None:
            iterations, evaluations = found.iterations + begun.iterations, found.evaluations + begun.evaluations
            found = replace(found, iterations=iterations, evaluations=evaluations)
    if settings.method is Method.CLOSED_FORM and found.bad_row is None:
        found = replace(found, reason=Reason.CLOSED_FORM)
    if bound is None:
        return found
    from mbm.estimation.minimise.constrained.solve import with_constraints

    return with_constraints(bound, found)


def _begun_sparsely(equations: Equations, start: Floats, settings: Settings) -> Minimum | None:
    """The minimum that the sparse solver finds, for the dense one to confirm; None: that is to find it."""
    if settings.method is not Method.AUTO or not touch_few(equations, MANY) or one_step_suits(equations):
        return None
    from mbm.estimation.minimise.sparse import sparse_minimum

    found = sparse_minimum(equations, start, settings)
    return found if found.reason.converged else None


def stopped(settings: Settings) -> Callable[[], bool] | None:
    """What is asked between iterations; None: nobody may interrupt."""
    return settings.stopped if settings.interruption is not None else None


def _roughly(equations: Equations, start: Floats, settings: Settings) -> Floats:
    """Where a few iterations lead."""
    short = replace(settings, max_iterations=min(ROUGH, settings.max_iterations), tolerance=ROUGHLY)
    return minimise(equations, start, short).point
