"""The soft absolute value: 2c²(√(1 + s/c²) − 1).

Charbonnier, Blanc-Féraud, Aubert and Barlaud (1994).
"""

from __future__ import annotations

import numpy as np

from mbm.problem.kinds import LossKind
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftL1:
    """Squares near zero, linear in the norm far out, smooth everywhere."""

    kind: LossKind = LossKind.SOFT_L1
    convex: bool = True
    defaults: tuple[float, ...] = (
        1.28709922426627,
        1.30942725552821,
        1.29221738349262,
        1.24471867626172,
        1.17048397200927,
    )

    def rho(self, squares: Floats, scale: float) -> Floats:
        """ρ(s), elementwise."""
        t = squares / (scale * scale)
        return 2.0 * squares / (np.sqrt(1.0 + t) + 1.0)

    def weight(self, squares: Floats, scale: float) -> Floats:
        """ρ'(s), 1 at s = 0."""
        t = squares / (scale * scale)
        return np.asarray(1.0 / np.sqrt(1.0 + t))

    def slope(self, squares: Floats, scale: float) -> Floats:
        """ρ''(s) ≤ 0."""
        c2 = scale * scale
        t = squares / c2
        return np.asarray(-0.5 / c2 / (1.0 + t) ** 1.5)


SOFT_L1 = SoftL1()
