"""Least median of squares (Rousseeuw 1984): the trial whose middle residual is smallest; needs to know no noise."""

from __future__ import annotations

import numpy as np

from mbm.problem.types import ConsensusKind
from mbm.solution.robust.units import Units, medians
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastMedianOfSquares:
    """Random subsets, scored by an order statistic of the squared norms."""

    kind: ConsensusKind = ConsensusKind.LMEDS
    samples: bool = True
    knows_limits: bool = False

    def scores(self, squares: Floats, units: Units, size: int, limits: Floats) -> Floats:
        """``Σ n log q`` (T,) over the noise groups with their order statistic q; ``limits`` play no part.

        q is the squared norm (over its median under the law) of rank ``⌊n/2⌋ + ⌊(k + 1)/2⌋``, with subsets of ``size``
        k units, which breaks down last (Rousseeuw and Leroy 1987, 3.4). With one group the trials are ordered as q is.
        """
        normed = squares / medians(units.components)
        total = np.zeros(len(squares))
        for group in np.unique(units.group).tolist():
            mine = normed[:, units.group == group]
            count = mine.shape[1]
            place = min(count // 2 + (size + 1) // 2, count) - 1
            middle = np.partition(mine, place, axis=1)[:, place]
            total += count * np.log(np.maximum(middle, 1e-30))
        return np.where(np.isfinite(total), total, np.inf)


LMEDS = LeastMedianOfSquares()
