"""Losses ρ(s) of the squared norm s of a whitened residual, with slope and curvature.

All are normalised to ``ρ(s) = s + O(s²)``, so small residuals count as in least squares; the parameter c, ``scale``, in
standard deviations, is where they begin to count less. ``shape`` is the exponent a of Barron's family. In square-root
form residuals become ``q r`` with ``q = √(ρ(s)/s)``, so that least squares minimises ρ.

| kind | ρ(s), with t = s/c² | source |
| --- | --- | --- |
| huber | s up to c², then 2c√s − c² | Huber (1964) |
| soft-l1 | 2c² (√(1 + t) − 1) | Charbonnier et al. (1994) |
| cauchy | c² log(1 + t) | Holland and Welsch (1977) |
| tukey | c²/3 (1 − (1 − t)³), and c²/3 beyond c² | Beaton and Tukey (1974) |
| geman-mcclure | s/(1 + t) | Geman and McClure (1987) |
| barron | 2c² |a−2|/a ((1 + t/|a−2|)^(a/2) − 1), its limits at a = 2 and 0 | Barron (2019) |
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, expm1, fabs, log1p, sqrt
from types import MappingProxyType

from mbm.machine.words import Integer, Real
from mbm.solver.decisions import NEARLY_ZERO
from mbm.values import dataclass

HUBER = 1
SOFT_L1 = 2
CAUCHY = 3
TUKEY = 4
GEMAN_MCCLURE = 5
BARRON = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class LossTraits:
    """What a loss says of itself beside its formulas.

    ``number`` is its kind in them. ``convex``: ρ(r²) is convex in r, so that no minimum hides behind another one that
    the loss itself makes; of a family that a second number shapes, where that is at least ``convex_from``. ``scales``
    are c of 95 % efficiency for residuals of 1, 2 … components, as far as known; others are computed.
    """

    number: int
    convex: bool = False
    convex_from: float | None = None
    scales: tuple[float, ...] = ()

    @property
    def shaped(self) -> bool:
        """A second number shapes it."""
        return self.convex_from is not None


LOSSES: Mapping[str, LossTraits] = MappingProxyType(
    {
        "huber": LossTraits(
            number=HUBER,
            convex=True,
            scales=(1.34499750851218, 1.50114108352638, 1.62798792027701, 1.73107251338734, 1.81201841989836),
        ),
        "soft-l1": LossTraits(
            number=SOFT_L1,
            convex=True,
            scales=(1.28709922426627, 1.30942725552821, 1.29221738349262, 1.24471867626172, 1.17048397200927),
        ),
        "cauchy": LossTraits(
            number=CAUCHY,
            scales=(2.38494711936238, 2.54863762394513, 2.66556834458433, 2.75158113519718, 2.81540347658326),
        ),
        "tukey": LossTraits(
            number=TUKEY,
            scales=(4.68506494854367, 5.12298608995241, 5.49024920842945, 5.81031558713486, 6.09626646884268),
        ),
        "geman-mcclure": LossTraits(
            number=GEMAN_MCCLURE,
            scales=(3.78741876083844, 4.09555233707449, 4.33728994951668, 4.53537207302852, 4.7023691196057),
        ),
        "barron": LossTraits(number=BARRON, convex_from=1.0),
    }
)
"""By the names that ``:loss`` knows."""


def loss_value(kind: Integer, square: Real, scale: Real, shape: Real) -> Real:
    """ρ(s)."""
    c2 = scale * scale
    t = square / c2
    if kind == HUBER:
        if t <= 1.0:
            return square
        return c2 * (2.0 * sqrt(t) - 1.0)
    if kind == SOFT_L1:
        return 2.0 * square / (sqrt(1.0 + t) + 1.0)
    if kind == CAUCHY:
        return c2 * log1p(t)
    if kind == TUKEY:
        inside = t
        if t > 1.0:
            inside = 1.0
        return c2 / 3.0 * inside * (3.0 - inside * (3.0 - inside))
    if kind == GEMAN_MCCLURE:
        return square / (1.0 + t)
    if shape == 2.0:
        return square
    b = fabs(shape - 2.0)
    if shape == 0.0:
        return c2 * 2.0 * log1p(t / b)
    return c2 * 2.0 * b / shape * expm1(0.5 * shape * log1p(t / b))


def loss_weight(kind: Integer, square: Real, scale: Real, shape: Real) -> Real:
    """ρ'(s), 1 at 0."""
    t = square / (scale * scale)
    if kind == HUBER:
        if t <= 1.0:
            return 1.0
        return 1.0 / sqrt(t)
    if kind == SOFT_L1:
        return 1.0 / sqrt(1.0 + t)
    if kind == CAUCHY:
        return 1.0 / (1.0 + t)
    if kind == TUKEY:
        if t > 1.0:
            return 0.0
        return (1.0 - t) * (1.0 - t)
    if kind == GEMAN_MCCLURE:
        return 1.0 / ((1.0 + t) * (1.0 + t))
    if shape == 2.0:
        return 1.0
    return exp((shape / 2.0 - 1.0) * log1p(t / fabs(shape - 2.0)))


def loss_slope(kind: Integer, square: Real, scale: Real, shape: Real) -> Real:
    """ρ''(s) ≤ 0, one-sided from below at a corner."""
    c2 = scale * scale
    t = square / c2
    if kind == HUBER:
        if t <= 1.0:
            return 0.0
        return -0.5 / c2 / (t * sqrt(t))
    if kind == SOFT_L1:
        return -0.5 / c2 / ((1.0 + t) * sqrt(1.0 + t))
    if kind == CAUCHY:
        return -1.0 / c2 / ((1.0 + t) * (1.0 + t))
    if kind == TUKEY:
        if t > 1.0:
            return 0.0
        return -2.0 / c2 * (1.0 - t)
    if kind == GEMAN_MCCLURE:
        return -2.0 / c2 / ((1.0 + t) * (1.0 + t) * (1.0 + t))
    if shape == 2.0:
        return 0.0
    return -0.5 / c2 * exp((shape / 2.0 - 2.0) * log1p(t / fabs(shape - 2.0)))


def root_factor(kind: Integer, square: Real, scale: Real, shape: Real) -> Real:
    """``q = √(ρ(s)/s)``, 1 at 0."""
    if not square > 0.0:
        return 1.0 + square
    return sqrt(loss_value(kind, square, scale, shape) / square)


def root_slope(kind: Integer, square: Real, scale: Real, shape: Real, factor: Real) -> Real:
    """dq/ds, with ``factor`` q."""
    if square <= NEARLY_ZERO * scale * scale:
        difference = 0.5 * loss_slope(kind, square * (2.0 / 3.0), scale, shape)
    else:
        weight = loss_weight(kind, square, scale, shape)
        difference = (weight - loss_value(kind, square, scale, shape) / square) / square
    return 0.5 * difference / factor
