"""What points of boards and of outlines look like in an image, and the derivatives of that.

The image of an ideal pattern is blurred by a normal distribution of s px in each direction, which stands for the lens
and for the pixels, each of which takes the mean over its square.
"""

from __future__ import annotations

from math import erf as exact_erf

import numpy as np

from mbm.data.images.fitting import Floats
from mbm.values import dataclass

USUAL_BLUR = 1.0
"""Standard deviation in px with which a fit begins."""

LEAST_ANGLE = 1e-3
"""Sine of the angle between two edges below which they count as so far apart: parallel edges do not cross."""

LEAST_PART = 1e-6
"""What q and |Ap|² of `disc` are at least, in units of their values on the ellipse: they vanish in its middle."""

_ROOT = float(np.sqrt(2.0))
_SLOPE = float(np.sqrt(2 / np.pi))
_DENSITY = float(2 / np.pi)
_NODES, _WEIGHTS = (np.asarray(each) / 2 for each in np.polynomial.legendre.leggauss(4))
_NODES = _NODES + 0.5


_FARTHEST, _STEPS = 6.0, 64
_TABLE_AT = np.arange(-_FARTHEST * _STEPS, _FARTHEST * _STEPS + 1) / _STEPS
_TABLE = np.array([exact_erf(x) for x in _TABLE_AT.tolist()])


def _cubics() -> tuple[Floats, ...]:
    """Hermite's cubics between the tabled values: coefficients of 1, t, t², t³, each contiguous."""
    rise, slopes = np.diff(_TABLE), 2 / np.sqrt(np.pi) * np.exp(-(_TABLE_AT**2)) / _STEPS
    first, last = slopes[:-1], slopes[1:]
    return _TABLE[:-1], first, 3 * rise - 2 * first - last, first + last - 2 * rise


_CUBICS = _cubics()


def erf(x: Floats) -> Floats:
    """The error function to 1e-9: Hermite's cubic between tabled values and slopes.

    The import of SciPy's takes as long as the fits of ten images.
    """
    t = (np.minimum(np.maximum(x, -_FARTHEST), _FARTHEST) + _FARTHEST) * _STEPS
    before = np.minimum(t.astype(np.int32), len(_TABLE) - 2)  # of NaN something, to which t stays NaN below
    t -= before
    found = _CUBICS[3].take(before, mode="clip")
    for each in _CUBICS[2::-1]:
        found *= t
        found += each.take(before, mode="clip")
    return np.asarray(found)


def crossing(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Where four squares meet: E[sgn(a + g) sgn(b + h)]. Parameters (n, 3): angles of the edges (rad), ln s.

    a and b are the distances of the pixel from the two edges in units of s; g and h are standard normal with the
    cosine ρ of the angle between the edges as correlation, because one blur moves the place against both edges.
    The mean is erf(a/√2) erf(b/√2) + ∫ 4 φ₂(a, b; r) dr from 0 to ρ (R. L. Plackett, "A reduction formula for normal
    multivariate integrals", 1954), the integral by four Gauss points: exact to 1e-5 for angles above 45°.

    It is even about the point, and so are four squares that meet, blurred in any even way: no bias remains.
    """
    edges = _Edges.of(parameters, x, y)
    return edges.expected()


def corner(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """The corner of a square by itself, 1 inside: E[H(a + g) H(b + h)], H the unit step. Parameters as of `crossing`.

    Inside, both distances are positive: the interior lies clockwise of the first edge's direction, as of the second's.
    """
    edges = _Edges.of(parameters, x, y)
    value, by_place, by_shape = edges.expected()
    blurred = erf(edges.a / _ROOT) + erf(edges.b / _ROOT)
    by_a, by_b = (_SLOPE * np.exp(-each * each / 2) for each in (edges.a, edges.b))
    by_place = by_place + edges.along(by_a, by_b)
    turned = np.stack([by_a * edges.a_turned, by_b * edges.b_turned, -edges.a * by_a - edges.b * by_b], axis=1)
    return (1 + blurred + value) / 4, by_place / 4, (by_shape + turned) / 4


@dataclass(frozen=True, slots=True, kw_only=True)
class _Edges:
    """Distances a and b (n, pixels) from two edges in units of the blur, and their derivatives; see `crossing`."""

    a: Floats
    b: Floats
    a_turned: Floats
    b_turned: Floats
    a_place: Floats
    b_place: Floats
    correlation: Floats
    sine: Floats

    @classmethod
    def of(cls, parameters: Floats, x: Floats, y: Floats) -> _Edges:
        """Those of edges at two angles (rad), blurred by exp of the third parameter."""
        first, second, blur = parameters.T[:, :, None]
        a, a_turned, a_place = _distance(first, blur, x, y)
        b, b_turned, b_place = _distance(second, blur, x, y)
        return cls(
            a=a,
            b=b,
            a_turned=a_turned,
            b_turned=b_turned,
            a_place=a_place,
            b_place=b_place,
            correlation=np.cos(second - first),
            sine=np.sin(second - first),
        )

    def along(self, by_a: Floats, by_b: Floats) -> Floats:
        """The derivative by x and y (n, 2, pixels) of what has these derivatives by a and b."""
        return np.asarray(by_a[:, None] * self.a_place + by_b[:, None] * self.b_place)

    def expected(self) -> tuple[Floats, Floats, Floats]:
        """E[sgn(a + g) sgn(b + h)], and its derivatives."""
        a, b, correlation = self.a, self.b, self.correlation
        root = np.maximum(np.abs(self.sine), LEAST_ANGLE)
        value = erf(a / _ROOT) * erf(b / _ROOT)
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            value = value + weight * correlation * _by_correlation(a, b, node * correlation)
        by_a = _SLOPE * np.exp(-a * a / 2) * erf((b - correlation * a) / (_ROOT * root))
        by_b = _SLOPE * np.exp(-b * b / 2) * erf((a - correlation * b) / (_ROOT * root))
        turned = _by_correlation(a, b, correlation) * self.sine
        shape = [by_a * self.a_turned + turned, by_b * self.b_turned - turned, -a * by_a - b * by_b]
        return np.asarray(value), self.along(by_a, by_b), np.stack(shape, axis=1)


def disc(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """An ellipse pᵀAp ≤ 1 about the point: erf(d/√2 s). Parameters (n, 4): A₁₁, A₁₂, A₂₂ in 1/px², ln s.

    d = (√q − q)/|Ap| with q = pᵀAp is the distance from the ellipse to first order, positive inside (P. D. Sampson,
    "Fitting conic sections to 'very scattered' data", 1982). It is even about the point: no bias remains.
    """
    first, mixed, last, blur = parameters.T[:, :, None]
    along, down = first * x + mixed * y, mixed * x + last * y
    q = np.maximum(along * x + down * y, LEAST_PART)
    w = np.maximum(along**2 + down**2, LEAST_PART * (first + last) ** 2)
    scale = np.exp(-blur) / np.sqrt(w)
    distance = (np.sqrt(q) - q) * scale
    slope = _SLOPE * np.exp(-distance * distance / 2)
    by_q, by_w = (0.5 / np.sqrt(q) - 1) * scale, -distance / (2 * w)
    q_by = (2 * along, 2 * down, x * x, 2 * x * y, y * y)
    w_by = (
        2 * (first * along + mixed * down),
        2 * (mixed * along + last * down),
        2 * x * along,
        2 * (y * along + x * down),
        2 * y * down,
    )
    parts = [slope * (by_q * dq + by_w * dw) for dq, dw in zip(q_by, w_by, strict=True)]
    by_shape = np.stack([*parts[2:], -slope * distance], axis=1)
    return np.asarray(erf(distance / _ROOT)), np.stack(parts[:2], axis=1), by_shape


def edge(parameters: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """An edge along x: erf(d/√2 s). Parameters (n, 3): how far it is turned from x (rad), its bend k (1/px), ln s.

    It is bent towards y. Blur takes the mean of k x²/2 over the places that it moves a point to, k (x² + s²)/2, and so
    moves the edge towards its centre of curvature (H. Bouma et al., "Correction for the dislocation of curved surfaces
    caused by the PSF in 2D and 3D CT images", 2005).
    """
    turn, bend, blur = parameters.T[:, :, None]
    straight, turned, place = _distance(turn, blur, x, y)
    s = np.exp(blur)
    bent = -(x * x / s + s) / 2
    distance = straight + bend * bent
    slope = _SLOPE * np.exp(-distance * distance / 2)
    blurred = -straight + bend * (x * x / s - s) / 2
    by_shape = np.stack([slope * turned, slope * bent, slope * blurred], axis=1)
    return np.asarray(erf(distance / _ROOT)), slope[:, None] * place[:, 1:], by_shape


def _distance(angle: Floats, blur: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """The distance (n, p) from an edge at ``angle`` in units of s; derivatives by the angle, and by x, y (n, 2, 1)."""
    c, s, scale = np.cos(angle), np.sin(angle), np.exp(-blur)
    by_place = np.stack([-s * scale, c * scale], axis=1)
    return (c * y - s * x) * scale, -(c * x + s * y) * scale, by_place


def _by_correlation(a: Floats, b: Floats, correlation: Floats) -> Floats:
    """4 φ₂(a, b; ρ): the derivative of the mean by the correlation."""
    rest = np.maximum(1 - correlation**2, LEAST_ANGLE**2)
    square = a * a - 2 * correlation * a * b + b * b
    return np.asarray(_DENSITY / np.sqrt(rest) * np.exp(-square / (2 * rest)))
