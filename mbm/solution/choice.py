"""Which solver a problem is given to, and why: the decision that solving makes, without solving."""

from __future__ import annotations

from dataclasses import dataclass

from mbm.kernels.types import KernelSet
from mbm.problem.builder import Elaborated
from mbm.problem.types import Method
from mbm.solution.assembly import Assembled, blank
from mbm.solution.binding import Binder, EvaluationCache
from mbm.solution.layout import layout
from mbm.solution.minimise import solver_for
from mbm.solution.selection import selections
from mbm.solution.settings import settings_of


@dataclass(frozen=True, slots=True)
class Choice:
    """The name of a solver, and the reason for it in words."""

    solver: str
    reason: str


def chosen_solver(found: Elaborated, kernels: KernelSet, cache: EvaluationCache) -> Choice | None:
    """The choice for the first solve that the data ask for; None where they ask for none.

    Raises:
        MbmError: weights that are none, bounds the wrong way round.

    """
    problem = found.problem
    selection = next(selections(problem, found.tables)[1], None)
    if selection is None:
        return None
    places = layout(problem, selection.tables, {})
    binder = Binder(problem=problem, layout=places, tables=selection.tables, cache=cache)
    equations = blank(binder, kernels)
    solver = solver_for(equations, settings_of(problem.request))
    return Choice(solver.name, _reason(equations, problem.request.method))


def _reason(equations: Assembled, method: Method) -> str:
    if method is not Method.AUTO:
        return "it is asked for"
    if not equations.linear:
        return "the equations are not affine in the unknowns"
    if bool(equations.positive.any()):
        return "every equation is affine in the unknowns, but some must stay positive"
    if equations.dimension and not bool(
        (equations.lower == -float("inf")).all() and (equations.upper == float("inf")).all()
    ):
        return "every equation is affine in the unknowns, but some are bounded"
    return "every equation is affine in the unknowns, and none is bounded"
