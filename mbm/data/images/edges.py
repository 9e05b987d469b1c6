"""Points of closed edges in an image to a fraction of a pixel, each from pixels that no other point uses. An isolated
object in an image: where it stands out from its surroundings, as closed lines of pixels about it.

Points stand at equal distances along the edge. About each lies a strip across the edge, as wide as points are apart.
A blurred step is fitted to its pixels, bent as the edge is. So errors of different points are independent. The points
beside it tell how much it is bent, as far as they agree; where they do not, as near a corner or at the end of a thin
ellipse, the strip has to tell itself, and its point is less certain. A point is left out where the strip shows
something else: a corner, a second edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from mbm.data.images import opencv
from mbm.data.images.features import USUAL_BLUR, edge
from mbm.data.images.fitting import Fitted, Floats, Grey, Image, Patches, Strips, fit
from mbm.values import dataclass

DARK, BRIGHT = "dark", "bright"

LEAST_AREA = 30.0
"""Square pixels below which a region, or a hole in one, is a speck."""

NOTHING = f"nothing of {LEAST_AREA:g} pixels or more stands out"

ALONE = 0.1
"""Part of the object's area that any other region may have: a larger one is an object too."""

CONTRAST = 4.0
"""Difference between the means of both sides in standard deviations within them, from which an object stands out.

Noise without an object, parted at its mean, has 2.6, an even slope 3.5.
"""

NOISY, SIGMAS, LEAST_DIFFERENCE = 6.0, 1.4826, 4.0
"""An object differs from the background by so many standard deviations of the noise, of which its median absolute
deviation tells one; and by so many grey values."""


class NoObjectError(Exception):
    """Why there is no isolated object, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """What is taken for the object: the side of a threshold that is given, or found; both sides where none is given."""

    threshold: float | None
    side: str | None
    holes: bool


def object_outlines(image: Image, choice: Choice) -> list[Floats]:
    """Closed lines of pixels (n, 2) about the object and then its holes; the object is on the right of each.

    ``image`` is a grey image, or the difference between one and its background.

    Raises:
        NoObjectError

    """
    mask = _differing(image, choice) if image.dtype == np.int16 else _parted(np.asarray(image, np.uint8), choice)
    regions = [(_area(outer), outer, holes) for outer, holes in opencv.outlines(mask)]
    regions = [region for region in regions if abs(region[0]) >= LEAST_AREA]
    if not regions:
        raise NoObjectError(NOTHING)
    areas = np.abs([area for area, _, _ in regions])
    largest = int(np.argmax(areas))
    _, outer, holes = regions[largest]
    height, width = mask.shape
    if outer.min() <= 0 or (outer.max(axis=0) >= [width - 1, height - 1]).any():
        raise NoObjectError("the object is cut by the border of the image")
    others = int((areas > ALONE * areas[largest]).sum())
    if others > 1:
        raise NoObjectError(f"there are {others:,} objects")
    kept = [hole for hole in holes if abs(_area(hole)) >= LEAST_AREA] if choice.holes else []
    return [_turned(outer, clockwise=True), *(_turned(hole, clockwise=False) for hole in kept)]


def _differing(difference: Image, choice: Choice) -> NDArray[np.bool_]:
    """Where an image differs from its background by more than the threshold, or than noise does.

    What most pixels differ by is light that has changed. The noise is their median deviation from it.
    """
    signed = difference - np.median(difference)
    away = signed if choice.side == BRIGHT else -signed if choice.side == DARK else np.abs(signed)
    threshold = choice.threshold
    if threshold is None:
        threshold = max(NOISY * SIGMAS * float(np.median(np.abs(signed))), LEAST_DIFFERENCE)
    return np.asarray(away > threshold)


def _parted(image: Grey, choice: Choice) -> NDArray[np.bool_]:
    """Where an image is brighter than the threshold, or darker; as that side which has less of the border."""
    threshold = choice.threshold
    bright = image > (opencv.threshold_of(image) if threshold is None else threshold)
    if threshold is None and not _stands_out(image, bright):
        raise NoObjectError(NOTHING)
    side = choice.side
    if side is None:
        border = np.concatenate([bright[0], bright[-1], bright[:, 0], bright[:, -1]])
        side = DARK if border.mean() > 0.5 else BRIGHT
    return bright if side == BRIGHT else ~bright


def _stands_out(image: Grey, bright: NDArray[np.bool_]) -> bool:
    sides = image[bright].astype(np.float64), image[~bright].astype(np.float64)
    if not all(len(side) for side in sides):
        return False
    within = sum(side.var() * len(side) for side in sides) / image.size
    return bool(sides[0].mean() - sides[1].mean() > CONTRAST * np.sqrt(within))


def _area(line: Floats) -> float:
    """The signed area in px²: positive where the line runs clockwise, as seen with y down."""
    x, y = line.T
    return float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2)


def _turned(line: Floats, *, clockwise: bool) -> Floats:
    """The line in the sense that is wanted, from its topmost point, of several the leftmost."""
    line = line if (_area(line) > 0) == clockwise else line[::-1]
    return np.roll(line, -int(np.lexsort((line[:, 0], line[:, 1]))[0]), axis=0)


REACHES = 6.0, 3.0
"""How far strips reach to either side in px; the second where the first does not fit, as in thin parts."""

WHOLE = 0.4
"""Part of the reach that the blur may have: then 99 % of a step lie in the strip."""

WIDEST = 2.0
"""Half the width of the widest strip in px: a wider one would see more of a bend than its curvature says."""

SMOOTHED = 1.5
"""Pixels over which the staircase of an outline is smoothed."""

OPEN = 0.1
"""Standard deviation of a curvature in 1/px of which nothing is known."""

CERTAIN = 1e-6
"""The least that is stated of one in 1/px: it moves no edge."""

BLURRED = np.log(2.0)
"""Standard deviation of ln s of the blur beforehand. Of a faint edge noise would tell one that is sharper than pixels
are wide, of which a strip says the place to a hundredth of what it knows."""

CORNER = 0.4
"""Angle in rad by which half a strip turns at a corner, more than the points beside it tell."""

BEND, BLUR = 1, 2
"""Places of the pattern's parameters."""

FEWEST = 8
"""Points on an edge."""

MISFIT, LEAST_NOISE = 4.0, 1.0
"""A strip that shows something else has so many times the usual variance about the fit, which counts as 1 at least."""

CURVED, SPREAD = 6.0, 44.0
"""Variance of a curvature for errors of 1 in points 1 apart; mean square of the range of five in a row (simulated)."""

UNEVEN = 42.0
"""Variance of the curvatures at the points beside one less those at the next, for errors of 1 in points 1 apart:
-1, 3, -3, 2, -3, 3, -1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bends:
    """The curvature (n,) of a line at its points in 1/px, positive to the right as seen with y down, and its σ (n,).

    ``own`` (n,) is that of the circle through a point and the two beside it.
    """

    mean: Floats
    sigma: Floats
    own: Floats

    @classmethod
    def unknown(cls, count: int) -> Bends:
        """That of so many points of a line that was not measured yet."""
        return cls(mean=np.zeros(count), sigma=np.full(count, OPEN), own=np.zeros(count))


def smoothed(line: Floats) -> Floats:
    """A closed line of pixels without its stairs."""
    return np.asarray(gaussian_filter1d(line, SMOOTHED, axis=0, mode="wrap"))


def refined(levels: Sequence[Image], lines: Sequence[Floats], spacing: float) -> tuple[Fitted, ...]:
    """Points ``spacing`` px apart on edges that lie near closed lines (n, 2) of the last of the levels.

    Each level has half the size of the one before it; the points are in px of the first. What variance is usual, the
    first edge tells for all: of a thin hole every strip may show both sides.
    """
    found: list[Fitted] = []
    usual = None
    for line in lines:
        for number, level in enumerate(reversed(levels)):
            if number:
                line = 2 * line + 0.5
            line = _spaced(line, spacing)
            coarse = _on_edge(level, line, Bends.unknown(len(line)), spacing, LEAST_NOISE, None)
            line = coarse.points
        noise = usual or _usual(coarse) or LEAST_NOISE
        bends = _bends(line, coarse.covariances[:, 0, 0], spacing)
        fitted = _on_edge(levels[0], line, bends, spacing, noise, usual)
        usual = usual or _usual(fitted)
        found.append(_with_corners(fitted, bends, coarse.covariances[:, 0, 0], spacing))
    return tuple(found)


def _spaced(line: Floats, spacing: float) -> Floats:
    """Points at equal distances along a closed line, from its first."""
    closed = np.concatenate([line, line[:1]])
    ways = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    count = max(round(float(ways[-1]) / spacing), FEWEST)
    at = np.arange(count) * (ways[-1] / count)
    return np.column_stack([np.interp(at, ways, each) for each in closed.T])


def _directions(line: Floats) -> Floats:
    """The angle (n,) of a closed line at each of its points."""
    along = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    return np.arctan2(along[:, 1], along[:, 0])


def _bends(line: Floats, variances: Floats, spacing: float) -> Bends:
    """The curvature of a closed line, that of the circle through three points (K. Menger, 1930).

    It is the mean of those by the points before, about and behind each; as uncertain as these and the next two are
    farther apart than the ``variances`` (n,) of the points make them.
    """
    before, after = np.roll(line, 1, axis=0) - line, np.roll(line, -1, axis=0) - line
    across = after[:, 1] * before[:, 0] - after[:, 0] * before[:, 1]
    sides = np.hypot(*before.T) * np.hypot(*after.T) * np.hypot(*(after - before).T)
    own = -2 * across / np.maximum(sides, 1e-9)
    five = np.stack([np.roll(own, k) for k in range(-2, 3)])
    chance = variances / spacing**4
    sigma = np.sqrt(np.maximum(np.square(np.ptp(five, axis=0)) - SPREAD * chance, 0.0) + CURVED * chance)
    return Bends(mean=five[1:4].mean(axis=0), sigma=np.maximum(sigma, CERTAIN), own=own)


def _on_edge(image: Image, line: Floats, bends: Bends, spacing: float, noise: float, usual: float | None) -> Fitted:
    """The points of a line moved across it onto the edge; those that cannot be stay, and are not good.

    ``noise`` is the variance of grey values, ``usual`` that of a strip that shows one edge, where it is known.
    """
    strips = Strips(angles=_directions(line), half=min(spacing / 2, WIDEST))
    none = np.zeros(len(line))
    patches = Patches(
        points=line,
        radii=np.full(len(line), REACHES[0]),
        parameters=np.column_stack([none, bends.mean, none + np.log(USUAL_BLUR)]),
        known=np.column_stack([none, noise / bends.sigma**2, none + noise / BLURRED**2]),
        strips=strips,
    )
    found = _without_misfits(_fitted(image, patches), usual)
    for reach in REACHES[1:]:
        again = ~found.good
        if again.any():
            shorter = replace(patches, radii=np.full(len(line), reach)).of(again)
            found = _without_misfits(_replaced(found, _fitted(image, shorter), again), usual)
    good = found.good & (np.abs(found.parameters[:, BEND] - bends.mean) * strips.half < CORNER)
    return replace(found, points=np.where(good[:, None], found.points, line), good=good)


def _with_corners(found: Fitted, bends: Bends, variances: Floats, spacing: float) -> Fitted:
    """With the error of strips in which a line does not bend evenly, as it seems.

    A line that turns by an angle θ in the middle of a strip of half width h lies 3θh/32 from the parabola through it,
    and a quarter of that at most if it turns elsewhere in it. The point in the middle of a corner is moved inwards:
    so about three quarters of θ show at the points beside it, more than at those farther away. ``variances`` (n,) are
    those of the points that curvatures are from.
    """
    beside, farther = (np.roll(bends.own, k) + np.roll(bends.own, -k) for k in (1, 2))
    more = np.maximum(np.abs(beside) - np.abs(farther), 0.0) * spacing
    turns = np.maximum(np.square(more) - UNEVEN * variances / spacing**2, 0.0)
    squares = turns * (min(spacing / 2, WIDEST) / 8) ** 2
    return replace(found, covariances=found.covariances + squares[:, None, None] * np.eye(2))


def _fitted(image: Image, patches: Patches) -> Fitted:
    """Edges in strips; those are not good whose blur is so wide that a strip does not show both sides."""
    found = fit(image, patches, edge)
    return replace(found, good=found.good & (found.parameters[:, BLUR] <= np.log(WHOLE * patches.radii)))


def _without_misfits(found: Fitted, usual: float | None) -> Fitted:
    """Good are those about as noisy as usual (None: as they are themselves)."""
    usual = usual or _usual(found)
    return replace(found, good=found.good & (found.noise <= MISFIT * (usual or LEAST_NOISE)))


def _usual(found: Fitted) -> float | None:
    """The median variance of grey values about the good fits; None without any."""
    return max(float(np.median(found.noise[found.good])), LEAST_NOISE) if found.good.any() else None


def _replaced(found: Fitted, other: Fitted, where: NDArray[np.bool_]) -> Fitted:
    """What was found, with ``other`` in the place of some of it."""
    place = np.where(where, np.cumsum(where) - 1 + len(where), np.arange(len(where)))
    return Fitted(
        points=np.concatenate([found.points, other.points])[place],
        covariances=np.concatenate([found.covariances, other.covariances])[place],
        parameters=np.concatenate([found.parameters, other.parameters])[place],
        noise=np.concatenate([found.noise, other.noise])[place],
        good=np.concatenate([found.good, other.good])[place],
    )
