"""RANSAC (Fischler and Bolles 1981): the trial with which most units agree."""

from __future__ import annotations

import numpy as np

from mbm.problem.types import ConsensusKind
from mbm.solution.robust.scores import truncated
from mbm.solution.robust.units import Units
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomSampleConsensus:
    """Random subsets, scored by the number of outliers."""

    kind: ConsensusKind = ConsensusKind.RANSAC
    samples: bool = True
    knows_limits: bool = True

    def scores(self, squares: Floats, units: Units, size: int, limits: Floats) -> Floats:
        """The number of outliers (T,); of trials with equally many the truncated sum decides, as a share below 1."""
        return np.asarray((squares > limits).sum(axis=1) + truncated(squares, limits) / (units.count + 1.0))


RANSAC = RandomSampleConsensus()
