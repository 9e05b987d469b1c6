"""Tukey's biweight: c²/3 (1 − (1 − s/c²)³), and c²/3 beyond c².

Beaton and Tukey (1974).
"""

from __future__ import annotations

import numpy as np

from mbm.problem.kinds import LossKind
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Tukey:
    """Bounded: what lies beyond c has no weight at all."""

    kind: LossKind = LossKind.TUKEY
    convex: bool = False
    defaults: tuple[float, ...] = (
        4.68506494854367,
        5.12298608995241,
        5.49024920842945,
        5.81031558713486,
        6.09626646884268,
    )

    def rho(self, squares: Floats, scale: float) -> Floats:
        """ρ(s), elementwise."""
        c2 = scale * scale
        inside = np.minimum(squares / c2, 1.0)
        return np.asarray(c2 / 3.0 * inside * (3.0 - inside * (3.0 - inside)))

    def weight(self, squares: Floats, scale: float) -> Floats:
        """ρ'(s), 1 at s = 0."""
        t = squares / (scale * scale)
        return np.square(1.0 - np.minimum(t, 1.0))

    def slope(self, squares: Floats, scale: float) -> Floats:
        """ρ''(s) ≤ 0."""
        c2 = scale * scale
        t = squares / c2
        return np.asarray(-2.0 / c2 * (1.0 - np.minimum(t, 1.0)))


TUKEY = Tukey()
