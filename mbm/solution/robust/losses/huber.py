"""Huber's loss: s up to c², then 2c√s − c².

Huber (1964).
"""

from __future__ import annotations

import numpy as np

from mbm.problem.kinds import LossKind
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Huber:
    """Squares near zero, linear in the norm beyond c."""

    kind: LossKind = LossKind.HUBER
    convex: bool = True
    defaults: tuple[float, ...] = (
        1.34499750851218,
        1.50114108352638,
        1.62798792027701,
        1.73107251338734,
        1.81201841989836,
    )

    def rho(self, squares: Floats, scale: float) -> Floats:
        """ρ(s), elementwise."""
        c2 = scale * scale
        t = squares / c2
        return np.where(t <= 1.0, squares, c2 * (2.0 * np.sqrt(t) - 1.0))

    def weight(self, squares: Floats, scale: float) -> Floats:
        """ρ'(s), 1 at s = 0."""
        t = squares / (scale * scale)
        return np.asarray(1.0 / np.sqrt(np.maximum(t, 1.0)))

    def slope(self, squares: Floats, scale: float) -> Floats:
        """ρ''(s) ≤ 0, that from below at the corner c²."""
        c2 = scale * scale
        t = squares / c2
        return np.where(t <= 1.0, 0.0, -0.5 / c2 / np.maximum(t, 1.0) ** 1.5)


HUBER = Huber()
