"""Bearings of three points of known position → the poses that see them so (P3P, Grunert's equations)."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.closed_forms.numerics.finite import finite
from mbm.solver.decisions import NEARLY_REAL, SOLVED, SYMMETRIC


def poses_from_three(points: Floats, bearings: Floats) -> tuple[Floats, Floats]:
    """All ``R, t`` with ``R x + t = s d``, s > 0, for three points x and unit bearings d.

    ``points`` and ``bearings`` have shape (…, 3, 3); R (…, 4, 3, 3) and t (…, 4, 3) hold up to four solutions, NaN
    beside them. Grunert's equations as in Haralick, Lee, Ottenberg and Nölle, IJCV 13 (3), 1994, polished by Newton.
    """
    lengths = _lengths(points, bearings)
    placed = lengths[..., :, None] * bearings[..., None, :, :]
    frame = _frame(points)[..., None, :, :]
    R = _frame(placed) @ np.swapaxes(frame, -1, -2)
    t = placed[..., 0, :] - np.einsum("...ij,...j->...i", R, points[..., None, 0, :])
    return R, t


def _frame(points: Floats) -> Floats:
    """An orthonormal frame (…, 3, 3), columns, that goes with a triangle; NaN for points on a line."""
    with np.errstate(invalid="ignore", divide="ignore"):
        first = points[..., 1, :] - points[..., 0, :]
        first = first / np.linalg.norm(first, axis=-1, keepdims=True)
        third = np.cross(first, points[..., 2, :] - points[..., 0, :])
        size = np.linalg.norm(third, axis=-1, keepdims=True)
        third = np.where(size > 0, third / size, np.nan)
    return np.stack([first, np.cross(third, first), third], axis=-1)


def _lengths(points: Floats, bearings: Floats) -> Floats:
    """Distances (…, 4, 3) of the three points from the eye."""
    p1, p2, p3 = (points[..., i, :] for i in range(3))
    d1, d2, d3 = (bearings[..., i, :] for i in range(3))
    a2, b2, c2 = (np.square(p - q).sum(axis=-1) for p, q in ((p2, p3), (p1, p3), (p1, p2)))
    ca, cb, cg = ((p * q).sum(axis=-1) for p, q in ((d2, d3), (d1, d3), (d1, d2)))
    with np.errstate(all="ignore"):
        m, s = (a2 - c2) / b2, (a2 + c2) / b2
        quartic = np.stack(
            [
                (m - 1) ** 2 - 4 * c2 / b2 * ca**2,
                4 * (m * (1 - m) * cb - (1 - s) * ca * cg + 2 * c2 / b2 * ca**2 * cb),
                2 * (m**2 - 1 + 2 * m**2 * cb**2 + 2 * (b2 - c2) / b2 * ca**2 - 4 * s * ca * cb * cg)
                + 4 * (b2 - a2) / b2 * cg**2,
                4 * (-m * (1 + m) * cb + 2 * a2 / b2 * cg**2 * cb - (1 - s) * ca * cg),
                (1 + m) ** 2 - 4 * a2 / b2 * cg**2,
            ],
            axis=-1,
        )
        v = real_roots(quartic)
        m, ca, cb, cg, b2, a2, c2 = (x[..., None] for x in (m, ca, cb, cg, b2, a2, c2))
        below = 2 * (cg - v * ca)
        u = ((m - 1) * v**2 - 2 * m * cb * v + 1 + m) / below
        # Where two sights mirror each other, both sides vanish: then each root of the first two laws, in turn.
        rest = np.sqrt(np.maximum(cg**2 - 1 + c2 / b2 * (1 + v**2 - 2 * v * cb), 0.0))
        u = np.where(np.abs(below) < SYMMETRIC, cg + rest * np.array([1.0, -1.0, 1.0, -1.0]), u)
        first = np.sqrt(b2 / (1 + v**2 - 2 * v * cb))
        found = np.stack([first, u * first, v * first], axis=-1)
        found = _polished(found, (a2, b2, c2), (ca, cb, cg))
    positive = (found > 0).all(axis=-1) & finite(found, -1)
    return np.where(positive[..., None], found, np.nan)


def _polished(s: Floats, squares: tuple[Floats, ...], cosines: tuple[Floats, ...]) -> Floats:
    """Three steps of Newton on the three cosine laws; kept where they end as a solution, NaN elsewhere."""
    pairs = ((1, 2), (0, 2), (0, 1))
    known = finite(s, -1)
    s = np.where(known[..., None], s, 1.0)
    scale = np.maximum.reduce(squares)

    def laws() -> Floats:
        return np.stack(
            [s[..., i] ** 2 + s[..., j] ** 2 - 2 * s[..., i] * s[..., j] * c - q
             for (i, j), q, c in zip(pairs, squares, cosines, strict=True)],
            axis=-1,
        )  # fmt: skip

    for _ in range(3):
        J = np.zeros((*s.shape, 3))
        for k, ((i, j), c) in enumerate(zip(pairs, cosines, strict=True)):
            J[..., k, i] = 2 * (s[..., i] - s[..., j] * c)
            J[..., k, j] = 2 * (s[..., j] - s[..., i] * c)
        adjugate = np.stack(
            [np.cross(J[..., 1, :], J[..., 2, :]), np.cross(J[..., 2, :], J[..., 0, :]),
             np.cross(J[..., 0, :], J[..., 1, :])],
            axis=-1,
        )  # fmt: skip
        determinant = np.einsum("...j,...j->...", J[..., 0, :], adjugate[..., :, 0])
        step = np.einsum("...ij,...j->...i", adjugate, laws()) / determinant[..., None]
        short = finite(step, -1) & (np.abs(step) < 0.1 * np.abs(s)).all(axis=-1)
        s = np.where(short[..., None], s - step, s)
    solved = known & (np.abs(laws()).max(axis=-1) <= SOLVED * scale)
    return np.where(solved[..., None], s, np.nan)


def real_roots(coefficients: Floats) -> Floats:
    """Real roots (…, 4) of ``a₄x⁴ + … + a₀``, coefficients (…, 5) from the highest power; NaN beside them.

    The eigenvalues of the companion matrix, then two steps of Newton; a pair of almost equal roots counts as real.
    """
    leading = coefficients[..., :1]
    with np.errstate(invalid="ignore", divide="ignore"):
        monic = coefficients[..., 1:] / leading
    usable = finite(monic, -1)
    companion = np.zeros((*monic.shape[:-1], 4, 4))
    companion[..., 0, :] = -np.where(usable[..., None], monic, 0.0)
    companion[..., 1, 0] = companion[..., 2, 1] = companion[..., 3, 2] = 1.0
    roots = np.linalg.eigvals(companion)
    x = np.real(roots)
    is_real = (np.abs(np.imag(roots)) <= NEARLY_REAL * (1 + np.abs(x))) & usable[..., None]
    a, b, c, d = (monic[..., i, None] for i in range(4))
    with np.errstate(all="ignore"):
        for _ in range(2):
            value = (((x + a) * x + b) * x + c) * x + d
            slope = ((4 * x + 3 * a) * x + 2 * b) * x + c
            step = value / slope
            x = np.where(np.isfinite(step) & (np.abs(step) < 1e-3 * (1 + np.abs(x))), x - step, x)
    return np.where(is_real, x, np.nan)
