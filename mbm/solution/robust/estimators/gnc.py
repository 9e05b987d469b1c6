"""Graduated non-convexity alone (Yang, Antonante, Tzoumas and Carlone 2020): the truncated loss, without subsets."""

from __future__ import annotations

from mbm.problem.types import ConsensusKind
from mbm.solution.robust.scores import truncated
from mbm.solution.robust.units import Units
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GraduatedNonConvexity:
    """The points of graduated non-convexity, scored by the loss that they minimise."""

    kind: ConsensusKind = ConsensusKind.GNC
    samples: bool = False
    knows_limits: bool = True

    def scores(self, squares: Floats, units: Units, size: int, limits: Floats) -> Floats:
        """The sum of truncated squares (T,)."""
        return truncated(squares, limits)


GNC = GraduatedNonConvexity()
