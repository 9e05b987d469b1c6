"""Points of closed edges in an image to a fraction of a pixel, each from pixels that no other point uses.

Points stand at equal distances along the edge. About each lies a strip across the edge, as wide as points are apart.
A blurred step is fitted to its pixels, bent as the edge is. So errors of different points are independent. A point is
left out where the strip shows something else: a corner, a second edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from mbm.data.images.features import USUAL_BLUR, edge
from mbm.data.images.fitting import Fitted, Floats, Image, Patches, Strips, fit

REACHES = 6.0, 3.0
"""How far strips reach to either side in px; the second where the first does not fit, as in thin parts."""

WHOLE = 0.4
"""Part of the reach that the blur may have: then 99 % of a step lie in the strip."""

WIDEST = 2.0
"""Half the width of the widest strip in px: a wider one would see more of a bend than its curvature says."""

SMOOTHED = 1.5
"""Pixels over which the staircase of an outline is smoothed."""

APART = 2
"""Points from one to the next of the three that tell the curvature: the noise of nearer ones bends a line."""

ALIKE = 2.0
"""Curvatures along a smooth edge differ by less, from one point to the next."""

FEWEST = 8
"""Points on an edge."""

MISFIT, LEAST_NOISE = 4.0, 1.0
"""A strip that shows something else has so many times the usual variance about the fit, which counts as 1 at least."""


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
            line = _on_edge(level, line, np.zeros(len(line)), spacing, None).points
        found.append(_on_edge(levels[0], line, _bends(line), spacing, usual))
        usual = usual or _usual(found[-1])
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


def _bends(line: Floats) -> Floats:
    """The curvature (n,) of a closed line in 1/px, that of the circle through three points (K. Menger, 1930).

    The mean of those by the points before, about and behind each; the least where they differ much, 0 where they
    disagree: so a corner does not bend the straight edge beside it.
    """
    before, after = np.roll(line, APART, axis=0) - line, np.roll(line, -APART, axis=0) - line
    across = after[:, 1] * before[:, 0] - after[:, 0] * before[:, 1]
    sides = np.hypot(*before.T) * np.hypot(*after.T) * np.hypot(*(after - before).T)
    own = -2 * across / np.maximum(sides, 1e-9)
    three = np.stack([np.roll(own, APART), own, np.roll(own, -APART)])
    least, greatest = np.abs(three).min(axis=0), np.abs(three).max(axis=0)
    agree = (three > 0).all(axis=0) | (three < 0).all(axis=0)
    return np.where(agree, np.where(greatest < ALIKE * least, three.mean(axis=0), np.sign(own) * least), 0.0)


def _on_edge(image: Image, line: Floats, bends: Floats, spacing: float, usual: float | None) -> Fitted:
    """The points of a line moved across it onto the edge; those that cannot be stay, and are not good.

    A blur of s px moves an edge of curvature κ by s²κ/2 towards the centre of curvature (H. Bouma et al., "Correction
    for the dislocation of curved surfaces caused by the PSF in 2D and 3D CT images", 2005), which is taken off.
    """
    strips = Strips(angles=_directions(line), bends=bends, half=min(spacing / 2, WIDEST))
    shape = np.tile([0.0, np.log(USUAL_BLUR)], (len(line), 1))
    patches = Patches(points=line, radii=np.full(len(line), REACHES[0]), parameters=shape, strips=strips)
    found = _without_misfits(_fitted(image, patches), usual)
    for reach in REACHES[1:]:
        again = ~found.good
        if again.any():
            shorter = replace(patches, radii=np.full(len(line), reach)).of(again)
            found = _without_misfits(_replaced(found, _fitted(image, shorter), again), usual)
    variance = np.exp(2 * np.where(found.good, found.parameters[:, 1], 0.0))
    across = patches.axes[:, 0] * (variance * bends / 2)[:, None]
    return replace(found, points=np.where(found.good[:, None], found.points - across, line))


def _fitted(image: Image, patches: Patches) -> Fitted:
    """Edges in strips; those are not good whose blur is so wide that a strip does not show both sides."""
    found = fit(image, patches, edge)
    return replace(found, good=found.good & (found.parameters[:, 1] <= np.log(WHOLE * patches.radii)))


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
