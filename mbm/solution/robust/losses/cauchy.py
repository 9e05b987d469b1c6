"""Cauchy's loss: c² log(1 + s/c²).

Holland and Welsch (1977).
"""

from __future__ import annotations

import numpy as np

from mbm.problem.kinds import LossKind
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Cauchy:
    """Grows with the logarithm: what is far off hardly pulls."""

    kind: LossKind = LossKind.CAUCHY
    convex: bool = False
    defaults: tuple[float, ...] = (
        2.38494711936238,
        2.54863762394513,
        2.66556834458433,
        2.75158113519718,
        2.81540347658326,
    )

    def rho(self, squares: Floats, scale: float) -> Floats:
        """ρ(s), elementwise."""
        c2 = scale * scale
        t = squares / c2
        return c2 * np.log1p(t)

    def weight(self, squares: Floats, scale: float) -> Floats:
        """ρ'(s), 1 at s = 0."""
        t = squares / (scale * scale)
        return np.asarray(1.0 / (1.0 + t))

    def slope(self, squares: Floats, scale: float) -> Floats:
        """ρ''(s) ≤ 0."""
        c2 = scale * scale
        t = squares / c2
        return np.asarray(-1.0 / c2 / np.square(1.0 + t))


CAUCHY = Cauchy()
