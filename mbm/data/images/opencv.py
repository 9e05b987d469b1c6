"""The one door to OpenCV (``pip install "mbm[images]"``): decoding, finding boards and outlines to a pixel or so. What
decoders say: libjpeg and libpng tell of damage by lines on standard error, and in no other way.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mbm.data.images import faults
from mbm.data.images.header import may_be_transparent
from mbm.text.faults import missing_extra
from mbm.text.types import DataPlace, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mbm.data.images.fitting import Floats, Grey

STANDARD_ERROR = 2
MOST_HEARD = 100_000
"""Bytes of what was said that are looked at."""

OF_DECODERS = ("Corrupt JPEG data", "Premature end of JPEG", "Invalid", "Unsupported", "libpng ", "[ WARN", "[ERROR")
_lock = threading.Lock()


@contextmanager
def listening() -> Iterator[list[str]]:
    """Inside, lines on standard error are kept back; behind it, the list holds those of decoders.

    Lines of anybody else, in another thread, are passed on then. Where there is no standard error nothing is heard.
    """
    heard: list[str] = []
    with _lock:
        try:
            before = os.dup(STANDARD_ERROR)
        except OSError:
            yield heard
            return
        with TemporaryFile() as said:
            os.dup2(said.fileno(), STANDARD_ERROR)
            try:
                yield heard
            finally:
                os.dup2(before, STANDARD_ERROR)
                os.close(before)
                said.seek(0)
                lines = said.read(MOST_HEARD).decode(errors="replace").splitlines()
                heard.extend(line for line in lines if line.startswith(OF_DECODERS))
                others = [line for line in lines if not line.startswith(OF_DECODERS)]
                if others:
                    os.write(STANDARD_ERROR, ("\n".join(others) + "\n").encode())


SEARCHED = 1200
"""Pixels of the longer side of the image in which something is looked for: a larger one is halved until it fits."""

SMOOTHED = 1.0
"""Pixels by which an image is smoothed before markers are looked for."""

LARGEST_DOUBLED = 1400
"""Pixels of the longer side of an image that is doubled for markers, whose squares may have three pixels."""

WINDOWS = 5, 45, 10
"""Smallest and largest neighbourhood in px, and the step, in which markers are told from light and shadow."""

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
        MbmError: missing-extra, damaged-image, transparent-image.

    """
    cv2 = opencv(place)
    packed, seen_through = np.frombuffer(content, np.uint8), False
    with listening() as heard:
        try:
            if may_be_transparent(content):
                seen_through = _seen_through(cv2.imdecode(packed, cv2.IMREAD_UNCHANGED))
            image = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        except cv2.error:
            image = None
    damage = next((line for line in heard if line.startswith(DAMAGE)), None)
    if image is None or damage is not None:
        raise MbmError(faults.damaged_image(place, damage or "it cannot be decoded"))
    if seen_through:
        raise MbmError(faults.transparent_image(place))
    return np.asarray(image)


def _seen_through(image: NDArray[np.unsignedinteger] | None) -> bool:
    """Whether an image (height, width, channels) has a fourth channel, and pixels that are not opaque by it."""
    if image is None or image.ndim < 3 or image.shape[2] < 4:
        return False
    return bool(image[:, :, 3].min() < np.iinfo(image.dtype).max)


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


def chessboard_beside(image: Grey, columns: int, rows: int, points: Floats) -> bool:
    """Whether an image shows a chessboard beside that with the inner corners ``points``, looked for in haste."""
    import cv2

    hull = cv2.convexHull(points.astype(np.float32))[:, 0]
    middle = hull.mean(axis=0)
    grown = middle + (hull - middle) * (1 + 3 / min(columns, rows))  # the squares outside of the inner corners
    rest = image.copy()
    cv2.fillConvexPoly(rest, np.rint(grown).astype(np.int32), float(np.median(image[::4, ::4])))
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK
    try:
        found, _ = cv2.findChessboardCorners(rest, (columns, rows), flags=flags)
    except cv2.error:
        return False
    return bool(found)


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


def homography(places: Floats, points: Floats) -> Floats | None:
    """The homography (3, 3) by which places (n, 2) of a plane go to points (n, 2), by least squares; None if none does.

    R. Hartley and A. Zisserman, "Multiple View Geometry in Computer Vision" (2004), algorithm 4.2.
    """
    import cv2

    try:
        found, _ = cv2.findHomography(places, points, 0)
    except cv2.error:
        return None
    return None if found is None or not np.isfinite(found).all() else np.asarray(found, dtype=np.float64)


def blobs(image: Grey, *, bright: bool) -> tuple[Floats, Floats]:
    """The middles (n, 2) and radii (n,) of dark or bright spots of an image to a pixel or so."""
    found = _spots(image, bright=bright).detect(image)
    places = np.array([spot.pt for spot in found], dtype=np.float64).reshape(-1, 2)
    return places, np.array([spot.size / 2 for spot in found], dtype=np.float64)


def circles(image: Grey, columns: int, rows: int, *, asymmetric: bool, bright: bool) -> Floats | None:
    """Spots of an image (rows·columns, 2) that make a grid, row by row from any of its corners; None if none do."""
    import cv2

    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    for flags in (kind, kind | cv2.CALIB_CB_CLUSTERING):  # the second sees through more perspective
        try:
            found, grid = cv2.findCirclesGrid(
                image, (columns, rows), flags=flags, blobDetector=_spots(image, bright=bright)
            )
        except cv2.error:
            continue
        if found:
            return _places(grid)
    return None


def without_spots(image: Grey, spots: Floats, radius: float) -> Grey:
    """The image with everything within a radius in px of spots (n, 2) painted over."""
    import cv2

    rest, middle = image.copy(), float(np.median(image))
    for u, v in np.rint(spots).astype(int).tolist():
        cv2.circle(rest, (u, v), int(np.ceil(radius)), middle, cv2.FILLED)
    return rest


def _spots(image: Grey, *, bright: bool) -> Any:
    """The detector of spots with 12 pixels at least, convex outlines, and one axis at most ten times the other."""
    import cv2

    library: Any = cv2  # whose stubs lack the detector of spots
    wanted = library.SimpleBlobDetector_Params()
    wanted.blobColor = 255 if bright else 0
    wanted.minArea, wanted.maxArea = 12, image.size / 9
    wanted.minDistBetweenBlobs = 4
    wanted.minThreshold, wanted.maxThreshold, wanted.thresholdStep = 20, 240, 15
    wanted.minConvexity = 0.9
    return library.SimpleBlobDetector_create(wanted)


def dictionary_size(name: str) -> int:
    """How many markers a dictionary of OpenCV has."""
    import cv2

    return len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)).bytesList)


def dictionary_side(name: str) -> int:
    """Squares along a side of the pattern of a marker, its black border apart."""
    import cv2

    return int(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)).markerSize)


def markers(image: Grey, dictionary: str, border: int) -> tuple[NDArray[np.int64], Floats]:
    """The numbers (n,) of markers from 0, and their corners (n, 4, 2) to a pixel or so, clockwise.

    ``border`` is the width of the black border in squares of the pattern.
    """
    import cv2

    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    prepared, scale = _smooth(image)
    found, numbers, _ = cv2.aruco.ArucoDetector(known, _of_markers(border)).detectMarkers(prepared)
    if numbers is None:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
    return np.asarray(numbers, dtype=np.int64).ravel(), _scaled(_places(found), scale).reshape(-1, 4, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Charuco:
    """A chessboard with markers in its white squares: so many squares, the side of a marker in parts of a square's.

    ``legacy``: the first square of a board with an even number of rows is white, as OpenCV had it before 4.6.
    """

    columns: int
    rows: int
    marker: float
    dictionary: str
    legacy: bool


def charuco(image: Grey, board: Charuco) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    """The numbers (n,) of inner corners from 0, row by row, and the corners (n, 2) to a pixel or so; markers' numbers.

    Partly seen boards have some of their corners.
    """
    import cv2

    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    made = cv2.aruco.CharucoBoard((board.columns, board.rows), 1.0, board.marker, known)
    made.setLegacyPattern(board.legacy)
    prepared, scale = _smooth(image)
    try:
        finder = cv2.aruco.CharucoDetector(made, detectorParams=_of_markers(1))
        points, numbers, _, seen = finder.detectBoard(prepared)
    except cv2.error:
        points = numbers = seen = None
    none = np.zeros(0, dtype=np.int64)
    markers_seen = none if seen is None else np.asarray(seen, dtype=np.int64).ravel()
    if numbers is None or points is None:
        return none, np.zeros((0, 2)), markers_seen
    return np.asarray(numbers, dtype=np.int64).ravel(), _scaled(_places(points), scale), markers_seen


def _smooth(image: Grey) -> tuple[Grey, int]:
    """The image without the noise that breaks the outlines of markers, and how many times as large a small one is."""
    import cv2

    scale = 2 if 2 * max(image.shape) <= LARGEST_DOUBLED else 1
    if scale > 1:
        image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC))
    return np.asarray(cv2.GaussianBlur(image, (0, 0), SMOOTHED)), scale


def _scaled(points: Floats, scale: int) -> Floats:
    """Points of an image from those of one so many times as large: pixel centres are at whole numbers in both."""
    return (points + 0.5) / scale - 0.5


def _of_markers(border: int) -> Any:
    """How markers are looked for."""
    import cv2

    wanted = cv2.aruco.DetectorParameters()
    wanted.markerBorderBits = border
    wanted.adaptiveThreshWinSizeMin, wanted.adaptiveThreshWinSizeMax, wanted.adaptiveThreshWinSizeStep = WINDOWS
    return wanted
