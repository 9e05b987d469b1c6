"""The loss of Geman and McClure: s / (1 + s/c²).

Geman and McClure (1985).
"""

from __future__ import annotations

import numpy as np

from mbm.problem.kinds import LossKind
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GemanMcClure:
    """Bounded by c², which it comes near to smoothly."""

    kind: LossKind = LossKind.GEMAN_MCCLURE
    convex: bool = False
    defaults: tuple[float, ...] = (
        3.78741876083844,
        4.09555233707449,
        4.33728994951668,
        4.53537207302852,
        4.7023691196057,
    )

    def rho(self, squares: Floats, scale: float) -> Floats:
        """ρ(s), elementwise."""
        t = squares / (scale * scale)
        return np.asarray(squares / (1.0 + t))

    def weight(self, squares: Floats, scale: float) -> Floats:
        """ρ'(s), 1 at s = 0."""
        t = squares / (scale * scale)
        return np.asarray(1.0 / np.square(1.0 + t))

    def slope(self, squares: Floats, scale: float) -> Floats:
        """ρ''(s) ≤ 0."""
        c2 = scale * scale
        t = squares / c2
        return np.asarray(-2.0 / c2 / (1.0 + t) ** 3)


GEMAN_MCCLURE = GemanMcClure()
