"""Losses ρ(s) of the squared norm s of a whitened residual, with slope and curvature, as `robust.losses` defines them.

``scale`` is the parameter c in standard deviations, ``shape`` the exponent of Barron's family. In square-root form
residuals become ``q r`` with ``q = √(ρ(s)/s)``, so that least squares minimises ρ.
"""

from __future__ import annotations

from math import exp, expm1, fabs, log1p, sqrt

from mbm.target.decisions import NEARLY_ZERO
from mbm.target.solver.description import CAUCHY, GEMAN_MCCLURE, HUBER, SOFT_L1, TUKEY
from mbm.target.words import Integer, Real


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
