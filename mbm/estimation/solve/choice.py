"""Which solver a problem is given to, and why: the decision that solving makes, without solving."""

from __future__ import annotations

import numpy as np

from mbm.equations.assembling import blank
from mbm.equations.assembly import Assembled
from mbm.equations.binder import Binder
from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import layout
from mbm.equations.selection import selections
from mbm.estimation.minimise.minimise import solver_name
from mbm.estimation.minimise.sparsity import sparse_suits
from mbm.estimation.search.challenge import uncompared
from mbm.estimation.search.starting import GIVEN, beginnings, blank_numbers
from mbm.estimation.settings import Settings, settings_of
from mbm.estimation.starts.closed_forms.completion import completions
from mbm.estimation.starts.closed_forms.rows import ENOUGH
from mbm.estimation.starts.closed_forms.standard import STANDARD
from mbm.estimation.starts.closed_forms.types import ClosedForm, Situation
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.sequence.types import SequenceMethod
from mbm.problem.types import Method
from mbm.sparse.equations import blocked
from mbm.sparse.system import plan
from mbm.values import dataclass


@dataclass(frozen=True, slots=True)
class Choice:
    """The name of a solver, the reason for it in words, and where it begins."""

    solver: str
    reason: str
    start: str


@np.errstate(all="ignore")  # what is no value shows in the numbers
def chosen_solver(
    found: Elaborated, kernels: KernelSet, cache: EvaluationCache, closed_forms: tuple[ClosedForm, ...] = STANDARD
) -> Choice | None:
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
    settings = settings_of(problem.request, forms=lambda: closed_forms)
    sequence = problem.sequence
    if sequence is not None and sequence.estimator.method is not SequenceMethod.BATCH:
        return Choice(sequence.estimator.method.value, "it is asked for", "the prior of the first step")
    reason = _reason(equations, problem.request.method)
    return Choice(solver_name(equations, settings), reason, _start(equations, settings))


def _start(equations: Assembled, settings: Settings) -> str:
    """Where the solver begins, and which closed forms were recognised."""
    if not equations.dimension:
        return GIVEN
    origin = beginnings(equations, settings)[0].origin
    if not uncompared(equations, settings, origin):
        return origin
    situation = Situation(
        layout=equations.layout, groups=equations.groups, numbers=blank_numbers(equations)[0], most=ENOUGH
    )
    used = completions(situation, settings.closed_forms)[0].used
    return f"{origin}; closed forms are compared with what they lead to: {'; '.join(used)}" if used else origin


def _reason(equations: Assembled, method: Method) -> str:
    if not equations.dimension:
        return "there is nothing to estimate"
    if method is not Method.AUTO:
        return "it is asked for"
    if equations.equality.size:
        equal = int(equations.equality.sum())
        return f"there are constraints: {equal} equations and {len(equations.equality) - equal} inequalities"
    sparse = sparse_suits(equations)
    if equations.implicit is not None:
        eliminated = "measured columns have errors, whose corrections are eliminated"
        return f"{eliminated}; {solved_how(equations)}" if sparse else eliminated
    if sparse:
        return solved_how(equations)
    if equations.lossy:
        return "the loss makes the equations count for less the less they fit"
    if not equations.linear:
        return "the equations are not affine in the unknowns"
    if bool(equations.positive.any()):
        return "every equation is affine in the unknowns, but some must stay positive"
    if equations.dimension and not bool(
        (equations.lower == -float("inf")).all() and (equations.upper == float("inf")).all()
    ):
        return "every equation is affine in the unknowns, but some are bounded"
    return "every equation is affine in the unknowns, and none is bounded"


def solved_how(equations: Assembled) -> str:
    """Which family is eliminated, and what is left: for `mbm explain`."""
    free = set(equations.free.tolist())
    names = [
        entry.unknown.name
        for entry in equations.layout.entries
        if any(place in free for place in range(entry.coordinates.start, entry.coordinates.stop))
    ]
    found = plan(blocked(equations).structure(), equations.backend)
    many = f"there are {equations.dimension} scalar unknowns, of which each equation touches few"
    rest = "densely" if found.fronts is None else f"by sparse Cholesky ({found.fronts.count} fronts)"
    if found.elimination is None:
        return f"{many}: all are solved {rest}"
    return f"{many}: `{names[found.elimination.family]}` is eliminated, the other {found.width} are solved {rest}"
