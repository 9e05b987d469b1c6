"""Robust losses ρ(s) of the squared norm s of a whitened residual, and their square-root form for least squares.

All are normalised to ``ρ(s) = s + O(s²)``, so small residuals count as in least squares. With the parameter c:

=============  ==========================================  =====================================
name           ρ(s)                                        source
=============  ==========================================  =====================================
huber          s up to c², then 2c√s − c²                  Huber (1964)
soft-l1        2c²(√(1 + s/c²) − 1)                        Charbonnier et al. (1994)
cauchy         c² log(1 + s/c²)                            Holland and Welsch (1977)
tukey          c²/3 (1 − (1 − s/c²)³), c²/3 beyond c²      Beaton and Tukey (1974)
geman-mcclure  s / (1 + s/c²)                              Geman and McClure (1985)
barron a       2c² |a−2|/a ((1 + s/(c²|a−2|))^(a/2) − 1)   Barron (2019), a ≤ 2
=============  ==========================================  =====================================
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mbm.problem.kinds import LossKind
from mbm.problem.types import Loss
from mbm.solution.robust.efficiency import tuned
from mbm.solution.types import Floats

NEARLY_ZERO = 1e-3
"""Below this share of c² the difference ρ's − ρ is taken from its series: above it the subtraction keeps 13 digits."""


DEFAULTS: Mapping[LossKind, tuple[float, ...]] = MappingProxyType(
    {
        LossKind.HUBER: (1.34499750851218, 1.50114108352638, 1.62798792027701, 1.73107251338734, 1.81201841989836),
        LossKind.SOFT_L1: (1.28709922426627, 1.30942725552821, 1.29221738349262, 1.24471867626172, 1.17048397200927),
        LossKind.CAUCHY: (2.38494711936238, 2.54863762394513, 2.66556834458433, 2.75158113519718, 2.81540347658326),
        LossKind.TUKEY: (4.68506494854367, 5.12298608995241, 5.49024920842945, 5.81031558713486, 6.09626646884268),
        LossKind.GEMAN_MCCLURE: (
            3.78741876083844,
            4.09555233707449,
            4.33728994951668,
            4.53537207302852,
            4.7023691196057,
        ),
    }
)
"""c of 95 % efficiency for residuals of 1 … 5 components, from `efficiency.tuned`; others are computed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LossFunction:
    """A loss with its parameter ``scale`` c > 0 in standard deviations; ``shape`` is Barron's exponent a ≤ 2."""

    kind: LossKind
    scale: float
    shape: float = 1.0

    @property
    def convex(self) -> bool:
        """Whether ρ(r²) is convex in r: a minimum cannot hide behind another one that the loss itself makes."""
        if self.kind is LossKind.BARRON:
            return self.shape >= 1.0
        return self.kind in (LossKind.HUBER, LossKind.SOFT_L1)

    def wider(self, factor: float) -> LossFunction:
        """The same loss with ``factor`` times the parameter: closer to least squares."""
        return LossFunction(kind=self.kind, scale=self.scale * factor, shape=self.shape)

    def rho(self, squares: Floats) -> Floats:
        """ρ(s), elementwise."""
        c2 = self.scale * self.scale
        t = squares / c2
        match self.kind:
            case LossKind.HUBER:
                return np.where(t <= 1.0, squares, c2 * (2.0 * np.sqrt(t) - 1.0))
            case LossKind.SOFT_L1:
                return 2.0 * squares / (np.sqrt(1.0 + t) + 1.0)
            case LossKind.CAUCHY:
                return c2 * np.log1p(t)
            case LossKind.TUKEY:
                inside = np.minimum(t, 1.0)
                return np.asarray(c2 / 3.0 * inside * (3.0 - inside * (3.0 - inside)))
            case LossKind.GEMAN_MCCLURE:
                return np.asarray(squares / (1.0 + t))
            case LossKind.BARRON:
                return c2 * _barron(t, self.shape)

    def weight(self, squares: Floats) -> Floats:
        """ρ'(s): the weight of the residual in iterated reweighting, 1 at s = 0."""
        t = squares / (self.scale * self.scale)
        match self.kind:
            case LossKind.HUBER:
                return np.asarray(1.0 / np.sqrt(np.maximum(t, 1.0)))
            case LossKind.SOFT_L1:
                return np.asarray(1.0 / np.sqrt(1.0 + t))
            case LossKind.CAUCHY:
                return np.asarray(1.0 / (1.0 + t))
            case LossKind.TUKEY:
                return np.square(1.0 - np.minimum(t, 1.0))
            case LossKind.GEMAN_MCCLURE:
                return np.asarray(1.0 / np.square(1.0 + t))
            case LossKind.BARRON:
                a = self.shape
                return np.ones_like(t) if a == 2.0 else np.exp((a / 2.0 - 1.0) * np.log1p(t / abs(a - 2.0)))

    def slope(self, squares: Floats) -> Floats:
        """ρ''(s) ≤ 0: how the weight falls; one-sided at the corners of huber and tukey."""
        c2 = self.scale * self.scale
        t = squares / c2
        match self.kind:
            case LossKind.HUBER:
                return np.where(t <= 1.0, 0.0, -0.5 / c2 / np.maximum(t, 1.0) ** 1.5)
            case LossKind.SOFT_L1:
                return np.asarray(-0.5 / c2 / (1.0 + t) ** 1.5)
            case LossKind.CAUCHY:
                return np.asarray(-1.0 / c2 / np.square(1.0 + t))
            case LossKind.TUKEY:
                return np.asarray(-2.0 / c2 * (1.0 - np.minimum(t, 1.0)))
            case LossKind.GEMAN_MCCLURE:
                return np.asarray(-2.0 / c2 / (1.0 + t) ** 3)
            case LossKind.BARRON:
                a = self.shape
                if a == 2.0:
                    return np.zeros_like(t)
                return np.asarray(-0.5 / c2 * np.exp((a / 2.0 - 2.0) * np.log1p(t / abs(a - 2.0))))


def _barron(t: Floats, a: float) -> Floats:
    """2 |a−2|/a ((1 + t/|a−2|)^(a/2) − 1), with its limits at a = 2 and a = 0."""
    if a == 2.0:
        return t
    b = abs(a - 2.0)
    if a == 0.0:
        return np.asarray(2.0 * np.log1p(t / b))
    return np.asarray(2.0 * b / a * np.expm1(0.5 * a * np.log1p(t / b)))


def loss_function(loss: Loss, components: int) -> LossFunction:
    """The loss for residuals of so many components; a parameter left out is the one of 95 % efficiency."""
    shape = 1.0 if loss.shape is None else loss.shape
    scale = loss.scale
    if scale is None:
        known = DEFAULTS.get(loss.kind, ())
        unit = LossFunction(kind=loss.kind, scale=1.0, shape=shape)
        scale = known[components - 1] if components <= len(known) else tuned(unit.weight, components)
    return LossFunction(kind=loss.kind, scale=scale, shape=shape)


def root_factors(loss: LossFunction, squares: Floats) -> tuple[Floats, Floats]:
    """``q = √(ρ(s)/s)`` and dq/ds, so that ``r̃ = q r`` has ``|r̃|² = ρ(s)``; shapes as ``squares``."""
    rho = loss.rho(squares)
    weight = loss.weight(squares)
    tiny = squares <= NEARLY_ZERO * loss.scale * loss.scale
    safe = np.where(squares > 0.0, squares, 1.0)
    factor = np.where(squares > 0.0, np.sqrt(rho / safe), 1.0)
    # ρ's − ρ = s²ρ''/2 − s³ρ'''/6 …; the slope at 2s/3 holds the two terms: ∫₀ˢ u ρ''(u) du with one Gauss point.
    difference = np.where(tiny, 0.5 * loss.slope(squares * (2.0 / 3.0)), (weight - rho / safe) / safe)
    return factor, np.asarray(0.5 * difference / factor)


def rooted(loss: LossFunction, residuals: Floats) -> Floats:
    """``r̃ = r √(ρ(s)/s)`` for each unit; ``residuals`` (units, components), whitened."""
    factor, _ = root_factors(loss, np.square(residuals).sum(axis=1))
    return np.asarray(residuals * factor[:, None])


def rooted_jacobian(loss: LossFunction, residuals: Floats, jacobian: Floats) -> Floats:
    """dr̃/dx = q J + 2 q' r (rᵀJ), exact; ``jacobian`` (units, components, n) belongs to the plain ``residuals``."""
    factor, change = root_factors(loss, np.square(residuals).sum(axis=1))
    along = np.einsum("uk,ukn->un", residuals, jacobian)
    bent = (2.0 * change[:, None] * residuals)[:, :, None] * along[:, None, :]
    return np.asarray(factor[:, None, None] * jacobian + bent)
