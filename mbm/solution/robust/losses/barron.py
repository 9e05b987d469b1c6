"""Barron's family: 2c² |a−2|/a ((1 + s/(c²|a−2|))^(a/2) − 1) with an exponent a ≤ 2, and its limits at 2 and 0.

Barron (2019). a = 2 is least squares, a = 1 the soft absolute value, a = 0 Cauchy's loss, a = −2 that of Geman and
McClure, with the parameters that they have there.
"""

from __future__ import annotations

import numpy as np

from mbm.problem.kinds import LossKind
from mbm.solution.types import Floats
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Barron:
    """The member of the family with the exponent ``shape`` a."""

    kind: LossKind = LossKind.BARRON
    shape: float = 1.0
    defaults: tuple[float, ...] = ()

    @property
    def convex(self) -> bool:
        """Whether ρ(r²) is convex in r: from a = 1 on."""
        return self.shape >= 1.0

    def shaped(self, shape: float) -> Barron:
        """The member with another exponent."""
        return Barron(shape=shape)

    def rho(self, squares: Floats, scale: float) -> Floats:
        """ρ(s), elementwise."""
        c2 = scale * scale
        return c2 * _relative(squares / c2, self.shape)

    def weight(self, squares: Floats, scale: float) -> Floats:
        """ρ'(s), 1 at s = 0."""
        t = squares / (scale * scale)
        a = self.shape
        return np.ones_like(t) if a == 2.0 else np.exp((a / 2.0 - 1.0) * np.log1p(t / abs(a - 2.0)))

    def slope(self, squares: Floats, scale: float) -> Floats:
        """ρ''(s) ≤ 0."""
        c2 = scale * scale
        t = squares / c2
        a = self.shape
        if a == 2.0:
            return np.zeros_like(t)
        return np.asarray(-0.5 / c2 * np.exp((a / 2.0 - 2.0) * np.log1p(t / abs(a - 2.0))))


def _relative(t: Floats, a: float) -> Floats:
    """ρ/c² as a function of t = s/c²."""
    if a == 2.0:
        return t
    b = abs(a - 2.0)
    if a == 0.0:
        return np.asarray(2.0 * np.log1p(t / b))
    return np.asarray(2.0 * b / a * np.expm1(0.5 * a * np.log1p(t / b)))


BARRON = Barron()
