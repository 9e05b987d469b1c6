"""What points of boards look like: where four squares meet, the corner of a marker, a disk; and their derivatives.

An edge is a step blurred by a normal distribution of s px: erf(d/(√2 s)) at the distance d from it.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from mbm.data.images.fitting import Floats

USUAL_BLUR = 1.0
"""Standard deviation in px with which a fit begins."""

_ROOT = float(np.sqrt(2.0))
_SLOPE = float(2 / np.sqrt(np.pi))


def _edge(angle: Floats, blur: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """A blurred step (n, p) across an edge at ``angle``; derivatives by x, y, and by angle, ln blur."""
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    width = _ROOT * np.exp(blur)[:, None]
    z = (c * y - s * x) / width
    slope = _SLOPE * np.exp(-z * z)
    by_place = np.stack([-s * slope / width, c * slope / width], axis=2)
    by_shape = np.stack([-(c * x + s * y) * slope / width, -z * slope], axis=2)
    return np.asarray(erf(z)), by_place, by_shape


def _product(parameters: Floats, x: Floats, y: Floats, offset: float) -> tuple[Floats, Floats, Floats]:
    """(o + e₁)(o + e₂) of two edges; the parameters are their angles and ln of their blur."""
    first, second, blur = parameters.T
    a, a_place, a_shape = _edge(first, blur, x, y)
    b, b_place, b_shape = _edge(second, blur, x, y)
    a, b = a[:, :, None] + offset, b[:, :, None] + offset
    by_angles = (a_shape[:, :, :1] * b, a * b_shape[:, :, :1])
    by_blur = a_shape[:, :, 1:] * b + a * b_shape[:, :, 1:]
    return (a * b)[:, :, 0], a_place * b + a * b_place, np.concatenate([*by_angles, by_blur], axis=2)


def crossing(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Where four squares meet: the product of two edges. Parameters: their angles (rad), ln blur.

    It is even about the point, and so are four squares that meet, blurred in any even way: no bias remains.
    """
    return _product(parameters, x, y, 0.0)


def quadrant(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """The corner of one dark or bright region: on the left of both edges (in px, y down: clockwise of them)."""
    return _product(parameters, x, y, 1.0)


def disk(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """An ellipse about the point: erf(e^k (1 − ρ)), ρ² = (l₁x + l₂y)² + (l₃y)². Parameters: l₁ l₂ l₃ (1/px), k.

    Even about the point as `crossing` is.
    """
    l1, l2, l3, k = parameters.T[:, :, None]
    p, q = l1 * x + l2 * y, l3 * y
    rho = np.sqrt(p * p + q * q + 1e-12)
    sharp = np.exp(k)
    z = sharp * (1 - rho)
    slope = _SLOPE * np.exp(-z * z)
    radial = -slope * sharp / rho
    by_place = np.stack([radial * p * l1, radial * (p * l2 + q * l3)], axis=2)
    by_shape = np.stack([radial * p * x, radial * p * y, radial * q * y, slope * z], axis=2)
    return np.asarray(erf(z)), by_place, by_shape
