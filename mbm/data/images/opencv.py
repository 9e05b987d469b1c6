"""The one door to OpenCV (``pip install "mbm[images]"``): decoding, finding boards and outlines to a pixel or so."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mbm.data.images import faults
from mbm.data.images.hearing import listening
from mbm.text.faults import missing_extra
from mbm.text.types import DataPlace, MbmError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mbm.data.images.fitting import Floats, Grey

SEARCHED = 1200
"""Pixels of the longer side of the image in which something is looked for: a larger one is halved until it fits."""

Picture = TypeVar("Picture", "NDArray[np.uint8]", "NDArray[np.int16]")

DAMAGE = ("Corrupt JPEG data", "Premature end of JPEG", "libpng error")
"""How lines of decoders begin that tell of damage; the image is filled up then, and given as if nothing was wrong."""


def opencv(place: DataPlace) -> Any:
    """The module.

    Raises:
        MbmError: missing-extra.

    """
    try:
        import cv2
    except ImportError:
        raise MbmError(missing_extra("images", "images", place)) from None
    return cv2


def decoded(content: bytes, place: DataPlace) -> Grey:
    """The grey values of an image file as the sensor has them, whatever it says of how to turn it.

    Raises:
        MbmError: missing-extra, damaged-image.

    """
    cv2 = opencv(place)
    with listening() as heard:
        try:
            image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        except cv2.error:
            image = None
    damage = next((line for line in heard if line.startswith(DAMAGE)), None)
    if image is None or damage is not None:
        raise MbmError(faults.damaged_image(place, damage or "it cannot be decoded"))
    return np.asarray(image)


def pyramid(image: Picture) -> list[Picture]:
    """The image, and copies at half the size each, down to one that is no longer than `SEARCHED`."""
    levels = [image]
    while max(levels[-1].shape) > SEARCHED and min(levels[-1].shape) > 1:
        levels.append(halved(levels[-1]))
    return levels


def halved(image: Picture) -> Picture:
    """The image at half the size: each pixel the mean of four. What is at u there is at 2u + 1/2 here."""
    import cv2

    height, width = image.shape
    even = image[: height - height % 2, : width - width % 2]
    return np.asarray(cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA))


def chessboard(image: Grey, columns: int, rows: int) -> Floats | None:
    """The inner corners (rows·columns, 2) of a chessboard to a pixel or so, row by row from any of its corners."""
    import cv2

    # The fast check spares images without a board: of noise, all that might be a square is compared with all else.
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    try:
        found, corners = cv2.findChessboardCorners(image, (columns, rows), flags=flags)
        if not found:  # slower, and better where the board is blurred or unevenly lit
            found, corners = cv2.findChessboardCornersSB(image, (columns, rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    except cv2.error:
        return None
    return np.asarray(corners, dtype=np.float64).reshape(-1, 2) if found else None


def threshold_of(image: Grey) -> float:
    """The grey value that parts an image into dark and bright: those up to it are dark.

    N. Otsu, "A threshold selection method from gray-level histograms" (1979).
    """
    import cv2

    value, _ = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return float(value)


def outlines(mask: NDArray[np.bool_]) -> list[tuple[Floats, list[Floats]]]:
    """The outermost pixels (n, 2) of each connected region, in their order about it, and those about its holes."""
    import cv2

    found, order = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    regions: dict[int, tuple[Floats, list[Floats]]] = {}
    for number, points in enumerate(found):
        if order[0, number, 3] < 0:
            regions[number] = _places(points), []
    for number, points in enumerate(found):
        parent = int(order[0, number, 3])
        if parent >= 0:
            regions[parent][1].append(_places(points))
    return list(regions.values())


def _places(points: Any) -> Floats:
    return np.asarray(points, dtype=np.float64).reshape(-1, 2)
