"""An isolated object in an image: where it stands out from its surroundings, as closed lines of pixels about it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mbm.data.images import opencv
from mbm.data.images.fitting import Floats, Grey, Image
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
