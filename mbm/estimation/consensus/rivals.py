"""Other minima that the data do not exclude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mbm.equations import faults
from mbm.equations.types import Fit, Minimum, Noise
from mbm.estimation.search.search import Alternative
from mbm.problem.types import Problem
from mbm.text.types import Diagnostic

PLAUSIBLE = 9.0
"""A minimum whose Σ r² is larger by less is not excluded: three standard deviations, were it one of two hypotheses."""

BOTH_ZERO = 1e-6
"""What Σ r² may differ by where both are zero."""


def rivals(
    problem: Problem, best: Minimum, alternatives: Sequence[Alternative], fit: Fit, noise: Mapping[int, Noise]
) -> tuple[Diagnostic, ...]:
    """A warning where another minimum fits about as well as the best; with unknown noise, in units of its estimate."""
    spread = best.cost / fit.dof if noise and fit.dof > 0 else 1.0
    near = [a for a in alternatives if a.minimum.cost - best.cost <= PLAUSIBLE * spread + BOTH_ZERO]
    if not near:
        return ()
    first = near[0]
    return (faults.another_solution(problem.span, len(near), first.minimum.cost, best.cost, mirrored=first.mirrored),)
