"""Distances from known stations → positions: linear differences, stations in a plane, three spheres (Nishida, LIN)."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats
from mbm.estimation.starts.closed_forms.numerics.finite import finite

FLAT = 1e-6
"""Extent of the stations across their plane (or line) beside the extent along it, below which they count as flat."""

NEARLY_FLAT = 0.1
"""The same, below which the coordinate across is also taken from the mean of the squares: differences barely tell."""


def positions(stations: Floats, squares: Floats, weights: Floats | None = None) -> Floats:
    """Positions p with ``|p − sᵢ|² = squaresᵢ``, by linear least squares; shape (…, 3, d), NaN where there is none.

    ``stations`` (…, n, d), ``squares`` (…, n), ``weights`` (…, n); d = 2 or 3. First, differences to the mean equation,
    which are linear in p (Nishida et al., eqs 6–11, with all stations as reference). Where the stations lie in a plane
    (on a line in two dimensions), or nearly so, the coordinate across it follows from the mean of the squares, with two
    signs: the second (below, seen along the axis that grows most) and third positions. Three stations in space, two in
    the plane, are such a case.
    """
    w = np.ones(squares.shape) if weights is None else weights
    w = w / w.sum(axis=-1, keepdims=True)
    centre = np.einsum("...n,...nd->...d", w, stations)
    s = stations - centre[..., None, :]
    spread = np.einsum("...n,...ni,...nj->...ij", w, s, s)
    values, axes = np.linalg.eigh(np.where(np.isfinite(spread), spread, 0.0))
    squared = np.square(s).sum(axis=-1)
    first = axes[..., 0]
    largest = np.take_along_axis(first, np.argmax(np.abs(first), axis=-1)[..., None], axis=-1)
    axes[..., 0] = np.where(largest < 0, -first, first)
    excess = squared - squares
    excess = excess - np.einsum("...n,...n->...", w, excess)[..., None]
    right = 0.5 * np.einsum("...n,...nd,...n->...d", w, s, excess)
    with np.errstate(invalid="ignore", divide="ignore"):
        local = np.einsum("...ji,...j->...i", axes, right) / values
        extent = values[..., -1]
        flatness = np.sqrt(np.maximum(values[..., 0], 0.0) / extent)
        usable = (extent > 0) & (values[..., 1] > FLAT**2 * extent)
    within = local.copy()
    within[..., 0] = 0.0
    mean_square = np.einsum("...n,...n->...", w, squares - squared)
    across = np.sqrt(np.maximum(mean_square - np.square(within).sum(axis=-1), 0.0))
    found = np.stack([local, within, within], axis=-2)
    found[..., 1, 0] -= across
    found[..., 2, 0] += across
    flat = flatness < FLAT
    found[..., 0, :] = np.where((flat | ~usable)[..., None], np.nan, found[..., 0, :])
    found[..., 1:, :] = np.where((usable & (flatness < NEARLY_FLAT))[..., None, None], found[..., 1:, :], np.nan)
    return np.asarray(centre[..., None, :] + np.einsum("...ij,...kj->...ki", axes, found))


def positions_and_offset(
    stations: Floats, lengths: Floats, slopes: Floats, extra: Floats, weights: Floats | None = None
) -> tuple[Floats, Floats]:
    """``p, b`` with ``|p − sᵢ|² + eᵢ = (lᵢ + βᵢ b)²``: pseudo-ranges with a common offset, circles, spheres.

    ``stations`` (…, n, d), the others (…, n), β equal in all rows. Linear in p, b and ``q = |p|² − β²b²``; the
    equation of q then decides along the line that is left where the stations leave one (n = d + 1, or all lengths
    equal, as in fits of circles). Up to two solutions: p (…, 2, d), b (…, 2), NaN beside them.
    """
    d = stations.shape[-1]
    w = np.ones(lengths.shape) if weights is None else weights
    root = np.sqrt(w / w.sum(axis=-1, keepdims=True))
    centre = stations.mean(axis=-2)
    s = stations - centre[..., None, :]
    scale = np.sqrt(np.square(s).sum(axis=(-2, -1)) / s.shape[-2])[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        s, r, e = s / scale[..., None], lengths / scale, extra / scale**2
    beta = slopes.mean(axis=-1)
    mean_length = r.mean(axis=-1)
    r0 = r - mean_length[..., None]  # b counts from the mean length
    matrix = np.concatenate([2 * s, 2 * r0[..., None], -np.ones((*r.shape, 1))], axis=-1)
    right = np.square(s).sum(axis=-1) + e - r0**2
    particular, free = _solved(matrix * root[..., None], right * root)
    p, b = _on_the_quadric(particular, free, d)
    p = centre[..., None, :] + p * scale[..., None]
    with np.errstate(invalid="ignore", divide="ignore"):
        offset = (b - mean_length[..., None]) * scale / beta[..., None]
    return p, offset


def _solved(matrix: Floats, right: Floats) -> tuple[Floats, Floats]:
    """The least-norm solution (…, m), and the direction (…, m) that is free, 0 if none is; NaN if several are."""
    known = finite(matrix, (-2, -1)) & finite(right, -1)
    rows, columns = matrix.shape[-2:]
    if rows < columns:
        padding = [(0, 0)] * (matrix.ndim - 2) + [(0, columns - rows), (0, 0)]
        matrix = np.pad(matrix, padding)
        right = np.pad(right, padding[:-1])
    U, values, Vt = np.linalg.svd(np.where(known[..., None, None], matrix, 0.0), full_matrices=False)
    full = values > 1e-9 * values[..., :1]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(full, 1 / values, 0.0)
    solution = np.einsum("...ji,...j,...kj,...k->...i", Vt, inverse, U, np.nan_to_num(right))
    free = np.where(full[..., -1:], 0.0, Vt[..., -1, :])
    usable = full[..., -2] & known
    return np.where(usable[..., None], solution, np.nan), free


def _on_the_quadric(particular: Floats, free: Floats, d: int) -> tuple[Floats, Floats]:
    """Solutions of ``q = |p|² − b²`` on the line ``particular + λ free``; the particular one where that is a point."""

    def form(x: Floats, y: Floats) -> Floats:
        product: Floats = np.einsum("...i,...i->...", x[..., :d], y[..., :d]) - x[..., d] * y[..., d]
        return product

    a, b, c = form(free, free), form(particular, free), form(particular, particular)
    half = b - free[..., d + 1] / 2
    constant = c - particular[..., d + 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(np.maximum(half**2 - a * constant, 0.0))
        quadratic = np.abs(a) > 1e-12
        first = np.where(quadratic, (-half + root) / a, -constant / (2 * half))
        second = np.where(quadratic, (-half - root) / a, np.nan)
    line = (free != 0).any(axis=-1)
    steps = np.stack([np.where(line, first, 0.0), np.where(line, second, np.nan)], axis=-1)
    points = particular[..., None, :] + steps[..., None] * free[..., None, :]
    return points[..., :d], points[..., d]
