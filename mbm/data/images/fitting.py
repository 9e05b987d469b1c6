"""Points of an image to a fraction of a pixel: a patch of the image is compared with what it should look like there.

The grey value of a pixel at p is b₀ + b₁x + b₂y + c·f(p − q) plus noise: the background, its slope, the contrast, and a
pattern f about the point q that is sought. What else describes the pattern, such as the directions of its edges and
the blur, is estimated with q by least squares (Levenberg and Marquardt), all patches of an image at once. Of a point
on an edge only the place across it is sought. The covariance of q is
that of least squares, s² (JᵀJ)⁻¹ with s² = Σr²/(n − k): Σ∇I∇Iᵀ of the patch, less what the other parameters take of
it, and the noise that this patch has.

Sources: W. Förstner and E. Gülch, "A fast operator for detection and precise location of distinct points, corners and
centres of circular features" (1987), for s² (Σ∇I∇Iᵀ)⁻¹; the pattern of an edge is a step blurred by a normal
distribution, an error function.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.values import dataclass

Floats: TypeAlias = NDArray[np.float64]
Grey: TypeAlias = NDArray[np.uint8]
"""A grey image (height, width)."""

Image: TypeAlias = Grey | NDArray[np.int16]
"""A grey image, or the difference of two."""

Pattern: TypeAlias = Callable[[Floats, Floats, Floats], tuple[Floats, Floats, Floats]]
"""Values (n, pixels) of a pattern with parameters (n, k) at x, y (n, pixels) from its point; their derivatives with
respect to x and y (n, 2, pixels), or y alone (n, 1, pixels) in strips, and to the parameters (n, k, pixels)."""

MOST_TRIALS = 60
LEAST_MOVE = 1e-4
"""Pixels of a step of the point below which a fit has converged: the step after it would be a hundredth of that."""

NEAR_ENOUGH = 0.05
"""The same of a fit that only says where another one begins."""

DAMPED_FIRST, DAMPED, EASED, LEAST_DAMPING, MOST_DAMPING = 1e-3, 10.0, 0.1, 1e-9, 1e9
SINGULAR = 1e-10
"""Smallest eigenvalue of a normal matrix with a unit diagonal that is not singular."""

AT_ONCE = 100_000
"""Pixels of patches that are fitted together: it bounds the memory of their Jacobians."""

ROUNDING = 1 / 12
"""Variance of the rounding to whole grey values: no image has less noise."""

FARTHEST = 0.75
"""A point is left out that the fit moves farther than this part of its patch's radius."""

BACKGROUND = 4
"""Parameters of every patch: background, its two slopes, contrast."""

FEWEST_SPARE = 8
"""Pixels that a patch must have beyond its parameters, for the noise is told by them."""

FAINTEST = 4.0
"""The contrast must be so many standard deviations of its own from zero."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Strips:
    """Patches about points of a curve: x runs along it, y across.

    ``angles`` (n,) in rad of the curve in the image; ``half`` the width of the strip along it, in px to either side.
    """

    angles: Floats
    half: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Patches:
    """What is fitted: a point (n, 2) in each patch, its radius (n,) in px, and the pattern's parameters (n, k).

    Patches are round, or strips across a curve that reach as far as the radius. How well the parameters are known
    beforehand, ``known`` (n, k) tells: the variance of grey values over that of a parameter; None if nothing is.
    """

    points: Floats
    radii: Floats
    parameters: Floats
    known: Floats | None = None
    strips: Strips | None = None

    def of(self, which: slice | NDArray[np.bool_]) -> Patches:
        """Some of the patches."""
        strips = self.strips
        if strips is not None:
            strips = Strips(angles=strips.angles[which], half=strips.half)
        return Patches(
            points=self.points[which],
            radii=self.radii[which],
            parameters=self.parameters[which],
            known=None if self.known is None else self.known[which],
            strips=strips,
        )

    @property
    def reach(self) -> int:
        """How far in px the pixels of a patch are from its point at most; 0 without patches."""
        widest = float(self.radii.max(initial=0.0))
        return int(np.ceil(widest if self.strips is None else np.hypot(widest, self.strips.half)))

    @property
    def axes(self) -> Floats:
        """The directions (n, m, 2) in the image in which a point is sought: both, or that across a curve."""
        if self.strips is None:
            return np.broadcast_to(np.eye(2), (len(self.points), 2, 2))
        angles = self.strips.angles
        return np.column_stack([-np.sin(angles), np.cos(angles)])[:, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """Points (n, 2) in px, their covariances (n, m, m) in px², and which of them are to be relied on (n,).

    m is 2, or 1 where points are sought across a curve. ``parameters`` (n, k) are those of the pattern, ``noise`` (n,)
    is the variance of the grey values about it.
    """

    points: Floats
    covariances: Floats
    parameters: Floats
    noise: Floats
    good: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pixels:
    """Pixels of patches (n, pixels): their places from the point, grey values, and 1 where they count, else 0.

    ``expected`` and ``known`` (n, parameters) are what the pattern's parameters are beforehand, and how well.
    """

    x: Floats
    y: Floats
    grey: Floats
    counts: Floats
    expected: Floats
    known: Floats

    def of(self, which: NDArray[np.bool_]) -> _Pixels:
        """Those of some of the patches."""
        own = (each[which] for each in (self.x, self.y, self.grey, self.counts, self.expected, self.known))
        x, y, grey, counts, expected, known = own
        return _Pixels(x=x, y=y, grey=grey, counts=counts, expected=expected, known=known)


def fit(image: Image, patches: Patches, pattern: Pattern, enough: float = LEAST_MOVE) -> Fitted:
    """The points of all patches; pixel centres are at whole numbers.

    A fit has converged when a step moves its point by less than ``enough`` px.
    """
    together = max(AT_ONCE // (2 * patches.reach + 1) ** 2, 1)
    starts = range(0, len(patches.points), together)
    with np.errstate(all="ignore"):  # steps that lead nowhere are not taken
        parts = [_fit(image, patches.of(slice(k, k + together)), pattern, enough) for k in starts]
    dimension = patches.axes.shape[1]
    return Fitted(
        points=np.concatenate([patches.points[:0], *(part.points for part in parts)]),
        covariances=np.concatenate([np.zeros((0, dimension, dimension)), *(part.covariances for part in parts)]),
        parameters=np.concatenate([patches.parameters[:0], *(part.parameters for part in parts)]),
        noise=np.concatenate([np.zeros(0), *(part.noise for part in parts)]),
        good=np.concatenate([np.zeros(0, dtype=bool), *(part.good for part in parts)]),
    )


def _pixels(image: Image, patches: Patches) -> _Pixels:
    """The pixels of each patch; those outside of the image do not count."""
    height, width = image.shape
    strips, reach = patches.strips, patches.reach
    steps = np.arange(-reach, reach + 1, dtype=np.float64)
    across, down = np.tile(steps, len(steps)), np.repeat(steps, len(steps))
    round_ones = across**2 + down**2 <= (reach + 1) ** 2
    middle = np.rint(np.clip(patches.points, 0, [width - 1, height - 1]))
    u, v = middle[:, :1] + across[round_ones], middle[:, 1:] + down[round_ones]
    x, y = u - patches.points[:, :1], v - patches.points[:, 1:]
    if strips is None:
        near = np.hypot(x, y) <= patches.radii[:, None]
    else:
        c, s = np.cos(strips.angles)[:, None], np.sin(strips.angles)[:, None]
        x, y = c * x + s * y, c * y - s * x
        near = (np.abs(x) <= strips.half) & (np.abs(y) <= patches.radii[:, None])
    inside = near & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    rows, columns = (np.clip(p, 0, n - 1).astype(np.intp) for p, n in ((v, height), (u, width)))
    return _Pixels(
        x=x,
        y=y,
        grey=image[rows, columns].astype(np.float64),
        counts=inside.astype(np.float64),
        expected=patches.parameters,
        known=np.zeros_like(patches.parameters) if patches.known is None else patches.known,
    )


def _fit(image: Image, patches: Patches, pattern: Pattern, enough: float) -> Fitted:
    pixels = _pixels(image, patches)
    axes = patches.axes
    dimension = axes.shape[1]
    first = _with_background(patches, pixels, pattern)
    found, sums, settled = _minimised(first, pixels, pattern, dimension, enough)
    spare = pixels.counts.sum(axis=1) + (pixels.known > 0).sum(axis=1) - found.shape[1]
    variance = np.maximum(sums.squares / np.maximum(spare, 1), ROUNDING)
    inverse, regular = _inverse(sums.normal)
    covariances = variance[:, None, None] * inverse
    moved = found[:, :dimension]
    clear = np.abs(found[:, -1]) > FAINTEST * np.sqrt(np.maximum(covariances[:, -1, -1], 0.0))
    near = np.linalg.norm(moved, axis=1) <= FARTHEST * patches.radii
    return Fitted(
        points=patches.points + np.einsum("nm,nmi->ni", moved, axes),
        covariances=covariances[:, :dimension, :dimension],
        parameters=found[:, dimension:-BACKGROUND],
        noise=variance,
        good=settled & regular & clear & near & (spare >= FEWEST_SPARE),
    )


def _with_background(patches: Patches, pixels: _Pixels, pattern: Pattern) -> Floats:
    """All parameters (n, m + k + 4) at the start: background and contrast are those that go best with the pattern."""
    value, _, _ = pattern(patches.parameters, pixels.x, pixels.y)
    count = np.maximum(pixels.counts.sum(axis=1), 1)

    def mean(of: Floats) -> Floats:
        return np.asarray((of * pixels.counts).sum(axis=1) / count)

    spread = np.maximum(mean(value**2) - mean(value) ** 2, 1e-6)
    contrast = (mean(value * pixels.grey) - mean(value) * mean(pixels.grey)) / spread
    level = mean(pixels.grey) - contrast * mean(value)
    none = np.zeros(len(level))
    return np.column_stack([np.zeros(patches.axes.shape[:2]), patches.parameters, level, none, none, contrast])


def _linearised(parameters: Floats, pixels: _Pixels, pattern: Pattern, dimension: int) -> tuple[Floats, Floats]:
    """Residuals (n, pixels), model less image, and their derivatives (n, k, pixels); zero where pixels do not count.

    The first ``dimension`` parameters are how far the point has moved: along x and y, or along y alone.
    """
    x = pixels.x - parameters[:, :1] if dimension == 2 else pixels.x
    y = pixels.y - parameters[:, dimension - 1 : dimension]
    shape = parameters[:, dimension:-BACKGROUND]
    level, along, down, contrast = parameters[:, -BACKGROUND:].T[:, :, None]
    value, by_place, by_shape = pattern(shape, x, y)
    model = level + along * pixels.x + down * pixels.y + contrast * value
    residuals = (model - pixels.grey) * pixels.counts
    steep = (contrast * pixels.counts)[:, None]
    jacobian = np.empty((len(x), parameters.shape[1], x.shape[1]))
    np.multiply(-steep, by_place, out=jacobian[:, :dimension])
    np.multiply(steep, by_shape, out=jacobian[:, dimension:-BACKGROUND])
    jacobian[:, -BACKGROUND] = pixels.counts
    for row, by_background in enumerate((pixels.x, pixels.y, value), 1 - BACKGROUND):
        np.multiply(pixels.counts, by_background, out=jacobian[:, row])
    return residuals, jacobian


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sums:
    """Of each patch: the sum of squares (n,) of the residuals r, Jᵀr (n, k), and JᵀJ (n, k, k).

    What is known of parameters beforehand counts as residuals.
    """

    squares: Floats
    gradient: Floats
    normal: Floats

    def of(self, which: NDArray[np.bool_]) -> _Sums:
        """Those of some of the patches."""
        return _Sums(squares=self.squares[which], gradient=self.gradient[which], normal=self.normal[which])

    def replaced(self, other: _Sums, where: NDArray[np.intp] | NDArray[np.bool_]) -> _Sums:
        """These, with others in the place of some."""
        made = _Sums(squares=self.squares.copy(), gradient=self.gradient.copy(), normal=self.normal.copy())
        made.squares[where], made.gradient[where], made.normal[where] = other.squares, other.gradient, other.normal
        return made


def _summed(parameters: Floats, pixels: _Pixels, pattern: Pattern, dimension: int) -> _Sums:
    residuals, jacobian = _linearised(parameters, pixels, pattern, dimension)
    squares, gradient = (residuals**2).sum(axis=1), (jacobian @ residuals[:, :, None])[:, :, 0]
    normal = jacobian @ jacobian.transpose(0, 2, 1)
    shape = np.arange(dimension, parameters.shape[1] - BACKGROUND)
    away = parameters[:, shape] - pixels.expected
    gradient[:, shape] += pixels.known * away
    normal[:, shape, shape] += pixels.known
    return _Sums(squares=squares + (pixels.known * away**2).sum(axis=1), gradient=gradient, normal=normal)


def _minimised(
    start: Floats, pixels: _Pixels, pattern: Pattern, dimension: int, enough: float
) -> tuple[Floats, _Sums, NDArray[np.bool_]]:
    """The parameters of least squares, the sums there, and which of the fits have converged; only others go on."""
    found = start.copy()
    settled = np.zeros(len(found), dtype=bool)
    going = np.arange(len(found))
    damping = np.full(len(found), DAMPED_FIRST)
    here, own = start, pixels
    sums = all_sums = _summed(here, own, pattern, dimension)
    for _ in range(MOST_TRIALS):
        step = _step(sums, damping)
        tried = here + step
        there = _summed(tried, own, pattern, dimension)
        better = there.squares <= sums.squares
        done = (np.abs(step[:, :dimension]).max(axis=1) < enough) & (better | (damping <= DAMPED_FIRST))
        here = np.where(better[:, None], tried, here)
        sums = sums.replaced(there.of(better), better)
        found[going], settled[going] = here, done
        all_sums = all_sums.replaced(sums, going)
        if done.all():
            break
        damping = np.clip(damping * np.where(better, EASED, DAMPED), LEAST_DAMPING, MOST_DAMPING)[~done]
        here, going, own, sums = here[~done], going[~done], own.of(~done), sums.of(~done)
    return found, all_sums, settled


def _step(sums: _Sums, damping: Floats) -> Floats:
    """The damped steps (n, k)."""
    normal = sums.normal.copy()
    diagonal = np.einsum("nii->ni", sums.normal)
    normal[:, range(normal.shape[1]), range(normal.shape[1])] += damping[:, None] * diagonal + 1e-9
    return np.asarray(-np.linalg.solve(normal, sums.gradient[:, :, None])[:, :, 0])


def _inverse(normal: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """The inverses of normal matrices (n, k, k), and which of them are regular; the others are infinite."""
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-300))
    scaled = normal / scale[:, :, None] / scale[:, None, :]
    finite = np.isfinite(scaled).all(axis=(1, 2))
    scaled = np.where(finite[:, None, None], scaled, 0.0)
    regular = np.linalg.eigvalsh(scaled)[:, 0] > SINGULAR
    safe = np.where(regular[:, None, None], scaled, np.eye(normal.shape[1]))
    inverse = np.linalg.inv(safe) / scale[:, :, None] / scale[:, None, :]
    return np.where(regular[:, None, None], inverse, np.inf), regular
