"""Other minima that the data do not exclude."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.equations import faults
from mbm.equations.types import Minimum
from mbm.estimation.search.search import Alternative
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic


def rivals(problem: Problem, best: Minimum, alternatives: Sequence[Alternative], most: float) -> tuple[Diagnostic, ...]:
    """A warning where other minima cost ``most`` at most, so that the data do not exclude them."""
    near = [a for a in alternatives if a.minimum.cost <= most]
    if not near:
        return ()
    first = near[0]
    return (faults.another_solution(problem.span, len(near), first.minimum.cost, best.cost, mirrored=first.mirrored),)
