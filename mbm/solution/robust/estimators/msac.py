"""MSAC (Torr and Zisserman 2000): the trial with which most units agree, and agree closely."""

from __future__ import annotations

from mbm.problem.types import ConsensusKind
from mbm.solution.robust.scores import truncated
from mbm.solution.robust.units import Units
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleConsensusOfSquares:
    """Random subsets, scored by the sum of truncated squares."""

    kind: ConsensusKind = ConsensusKind.MSAC
    samples: bool = True
    knows_limits: bool = True

    def scores(self, squares: Floats, units: Units, size: int, limits: Floats) -> Floats:
        """The sum of truncated squares (T,)."""
        return truncated(squares, limits)


MSAC = SampleConsensusOfSquares()
