"""Other minima that the data do not exclude."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.equations import faults
from mbm.equations.assembly import Assembled
from mbm.equations.metric import rounding_at
from mbm.equations.types import Minimum
from mbm.estimation.search.search import Alternative
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic


def rivals(
    problem: Problem, equations: Assembled, best: Minimum, alternatives: Sequence[Alternative], most: float
) -> tuple[Diagnostic, ...]:
    """A warning where other minima cost ``most`` at most, so that the data do not exclude them."""
    near = [a for a in alternatives if a.minimum.cost <= most]
    if not near:
        return ()
    first = near[0]
    least = rounding_at(equations, best) ** 2
    costs = tuple(cost if cost > least else 0.0 for cost in (first.minimum.cost, best.cost))
    what = "sum of the losses" if equations.lossy else "cost"
    return (faults.another_solution(problem.span, len(near), costs, what, mirrored=first.mirrored),)
