"""What points of boards and of outlines look like in an image, and the derivatives of that.

The image of an ideal pattern is blurred by a normal distribution of s px in each direction, which stands for the lens
and for the pixels, each of which takes the mean over its square.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from mbm.data.images.fitting import Floats

USUAL_BLUR = 1.0
"""Standard deviation in px with which a fit begins."""

LEAST_ANGLE = 1e-3
"""Sine of the angle between two edges below which they count as so far apart: parallel edges do not cross."""

_ROOT = float(np.sqrt(2.0))
_SLOPE = float(np.sqrt(2 / np.pi))
_DENSITY = float(2 / np.pi)
_NODES, _WEIGHTS = (np.asarray(each) / 2 for each in np.polynomial.legendre.leggauss(4))
_NODES = _NODES + 0.5


def crossing(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Where four squares meet: E[sgn(a + g) sgn(b + h)]. Parameters (n, 3): angles of the edges (rad), ln s.

    a and b are the distances of the pixel from the two edges in units of s; g and h are standard normal with the
    cosine ρ of the angle between the edges as correlation, because one blur moves the place against both edges.
    The mean is erf(a/√2) erf(b/√2) + ∫ 4 φ₂(a, b; r) dr from 0 to ρ (R. L. Plackett, "A reduction formula for normal
    multivariate integrals", 1954), the integral by four Gauss points: exact to 1e-5 for angles above 45°.

    It is even about the point, and so are four squares that meet, blurred in any even way: no bias remains.
    """
    first, second, blur = parameters.T[:, :, None]
    a, a_turned, a_place = _distance(first, blur, x, y)
    b, b_turned, b_place = _distance(second, blur, x, y)
    correlation, sine = np.cos(second - first), np.sin(second - first)
    root = np.maximum(np.abs(sine), LEAST_ANGLE)
    value = erf(a / _ROOT) * erf(b / _ROOT)
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        value = value + weight * correlation * _by_correlation(a, b, node * correlation)
    by_a = _SLOPE * np.exp(-a * a / 2) * erf((b - correlation * a) / (_ROOT * root))
    by_b = _SLOPE * np.exp(-b * b / 2) * erf((a - correlation * b) / (_ROOT * root))
    turned = _by_correlation(a, b, correlation) * sine
    by_place = by_a[:, :, None] * a_place + by_b[:, :, None] * b_place
    by_shape = np.stack([by_a * a_turned + turned, by_b * b_turned - turned, -a * by_a - b * by_b], axis=2)
    return np.asarray(value), by_place, by_shape


def edge(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """An edge along x: erf(d/√2 s). Parameters (n, 2): how far it is turned from x (rad), ln s."""
    turn, blur = parameters.T[:, :, None]
    distance, turned, place = _distance(turn, blur, x, y)
    slope = _SLOPE * np.exp(-distance * distance / 2)
    by_shape = np.stack([slope * turned, -slope * distance], axis=2)
    return np.asarray(erf(distance / _ROOT)), slope[:, :, None] * place[:, :, 1:], by_shape


def _distance(angle: Floats, blur: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """The distance (n, p) from an edge at ``angle`` in units of s; its derivatives by the angle, and by x, y."""
    c, s, scale = np.cos(angle), np.sin(angle), np.exp(-blur)
    by_place = np.stack([np.broadcast_to(-s * scale, x.shape), np.broadcast_to(c * scale, x.shape)], axis=2)
    return (c * y - s * x) * scale, -(c * x + s * y) * scale, by_place


def _by_correlation(a: Floats, b: Floats, correlation: Floats) -> Floats:
    """4 φ₂(a, b; ρ): the derivative of the mean by the correlation."""
    rest = np.maximum(1 - correlation**2, LEAST_ANGLE**2)
    square = a * a - 2 * correlation * a * b + b * b
    return np.asarray(_DENSITY / np.sqrt(rest) * np.exp(-square / (2 * rest)))
