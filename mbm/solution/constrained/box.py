"""Hard bounds of coordinates."""

from __future__ import annotations

import numpy as np

from mbm.solution.types import Equations, Floats, Mask
from mbm.target.decisions import POSITIVE_KEPT
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """Bounds of the coordinates; ``present`` is False where there are none at all and nothing need be looked at."""

    lower: Floats
    upper: Floats
    positive: Mask
    present: bool

    def project(self, x: Floats) -> Floats:
        """The nearest point of the box; a `positive` coordinate that is not becomes 1 (or half its upper bound)."""
        if not self.present:
            return x
        inside = np.clip(x, self.lower, self.upper)
        bad = self.positive & (inside <= 0.0)
        return np.where(bad, np.where(np.isfinite(self.upper), 0.5 * self.upper, 1.0), inside)

    def gaps(self, x: Floats) -> tuple[Floats, Floats]:
        """Largest movement down (≤ 0) and up (≥ 0) of each coordinate in one step."""
        down = np.where(self.positive, np.maximum(self.lower - x, (POSITIVE_KEPT - 1.0) * x), self.lower - x)
        return down, self.upper - x


def box_of(equations: Equations) -> Box:
    """The bounds of a system of equations."""
    lower, upper, positive = equations.lower, equations.upper, equations.positive
    present = bool(np.isfinite(lower).any() or np.isfinite(upper).any() or positive.any())
    return Box(lower=lower, upper=upper, positive=positive, present=present)
