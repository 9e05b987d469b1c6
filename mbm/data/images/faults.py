"""What may be wrong with images, and with what is looked for in them."""

from __future__ import annotations

from collections.abc import Sequence

from mbm.data.faults import MOST_NAMES_SHOWN
from mbm.text.faults import shown
from mbm.text.types import Code, DataPlace, Diagnostic, Severity


class NoBoardError(Exception):
    """An image shows no board; ``reason`` says why in words, if that is known."""

    def __init__(self, reason: str | None = None) -> None:
        super().__init__(reason or "")
        self.reason = reason


NOT_AN_IMAGE = Code(
    "not-an-image",
    "A file of a source of images is no image of a kind that is read.",
    "Convert it to PNG, which loses nothing. A narrower pattern leaves other files out.",
)
DAMAGED_IMAGE = Code(
    "damaged-image",
    "An image file is cut short or damaged. Decoders fill up with grey what a file lacks, so it is refused.",
    "Copy it anew from the camera, or leave it out by a narrower pattern.",
)
TRANSPARENT_IMAGE = Code(
    "transparent-image",
    "An image has transparent pixels: which grey value they have depends on what lies beneath.",
    "Save it without transparency, on a background of one colour that differs from the object.",
)
NO_BOARD = Code(
    "no-board",
    "The board that a data clause describes is in none of its images.",
    "Count again: the columns and rows of a chessboard are the inner corners, where four squares meet; those of a"
    " `charuco` are squares, of others circles or markers. A board without markers must be seen whole, with a white"
    " margin around it. With markers, look at `:dictionary`.",
)
BOARD_LEFT_OUT = Code(
    "board-left-out",
    "The board was not found in some of the images; they give no rows.",
    "Usually it is not whole in the image, blurred, or a lamp is reflected in it. An image with two boards does not"
    " tell which is meant. Nothing is wrong with the others.",
)
BAD_BOARD = Code(
    "bad-board",
    "There is no board as the data clause describes it.",
    "A marker is smaller than the square around it, and a dictionary has as many markers as the board at least.",
)
POINTS_LEFT_OUT = Code(
    "points-left-out",
    "Some points of a board were found but could not be refined: their surroundings do not look as they should.",
    "Usually they are at the border of the image, hidden in part, or blurred. Nothing is wrong with the others.",
)

NO_OBJECT = Code(
    "no-object",
    "No isolated object stands out in any of the images of a data clause, or not one alone.",
    "`:threshold` says from which grey value on, `:object dark` or `bright` on which side, `:background` what the scene"
    " looks like without the object. The object must be whole in the image, and alone.",
)
OBJECT_LEFT_OUT = Code(
    "object-left-out",
    "In some of the images no isolated object stands out, or not one alone; they give no rows.",
    "Usually it is cut by the border, or something else is seen. Nothing is wrong with the others.",
)
OTHER_SIZE = Code(
    "other-size",
    "An image and its background have different sizes.",
    "The background is a photograph of the same camera, from the same place, without the object.",
)


def not_an_image(place: DataPlace, kinds: str) -> Diagnostic:
    """The content of a file begins as that of no known kind of images does."""
    return Diagnostic(
        code=NOT_AN_IMAGE,
        message=f"`{shown(place.file)}` is no image of a kind that is read: {kinds}",
        place=place,
        hint="convert it to PNG",
    )


def damaged_image(place: DataPlace, reason: str) -> Diagnostic:
    """``reason`` says what is wrong with the file."""
    return Diagnostic(code=DAMAGED_IMAGE, message=f"the image `{shown(place.file)}` is damaged: {reason}", place=place)


def transparent_image(place: DataPlace) -> Diagnostic:
    """Something is seen through an image."""
    message = f"the image `{shown(place.file)}` has transparent pixels, which have no grey value"
    hint = "save it without transparency, on a background that differs from the object"
    return Diagnostic(code=TRANSPARENT_IMAGE, message=message, place=place, hint=hint)


def pixels_of(path: str, width: int, height: int) -> str:
    """What a message about memory calls an image."""
    return f"the image `{shown(path)}` of {width:,} × {height:,} pixels"


def no_board(place: DataPlace, board: str, reasons: Sequence[tuple[str, str | None]]) -> Diagnostic:
    """``board`` says what was looked for in all images, of which each has a reason by its name, if that is known."""
    where = "the image" if len(reasons) == 1 else f"any of the {len(reasons):,} images"
    known = [reason for _, reason in reasons if reason is not None]
    return Diagnostic(
        code=NO_BOARD,
        message=f"no {board} was found in {where} `{shown(place.file)}`{': ' + known[0] if known else ''}",
        place=place,
        hint="look whether the whole board is seen, and count its columns and rows again",
    )


def board_left_out(place: DataPlace, board: str, reasons: Sequence[tuple[str, str | None]], images: int) -> Diagnostic:
    """Some of so many images show no board."""
    names = [name if reason is None else f"{name} ({reason})" for name, reason in reasons]
    return Diagnostic(
        code=BOARD_LEFT_OUT,
        message=f"no {board} was found in {len(names):,} of {images:,} images, which give no rows: {_listed(names)}",
        place=place,
        severity=Severity.WARNING,
    )


def bad_board(place: DataPlace, reason: str) -> Diagnostic:
    """``reason`` says what contradicts what."""
    return Diagnostic(code=BAD_BOARD, message=f"there is no such board: {reason}", place=place)


def points_left_out(place: DataPlace, counts: Sequence[tuple[str, int]]) -> Diagnostic:
    """So many points of each of these images could not be refined."""
    total = sum(count for _, count in counts)
    names = [f"{name} ({count})" for name, count in counts]
    return Diagnostic(
        code=POINTS_LEFT_OUT,
        message=f"{total:,} points of the board could not be refined and give no rows: {_listed(names)}",
        place=place,
        severity=Severity.WARNING,
    )


def no_object(place: DataPlace, reasons: Sequence[tuple[str, str]]) -> Diagnostic:
    """Why there is no object, by the names of all images."""
    said = reasons[0][1] if len(reasons) == 1 else _listed([f"{name} ({reason})" for name, reason in reasons])
    return Diagnostic(
        code=NO_OBJECT,
        message=f"no isolated object was found in `{shown(place.file)}`: {said}",
        place=place,
        hint="look at the image; `:threshold`, `:object` and `:background` say what the object is",
    )


def object_left_out(place: DataPlace, reasons: Sequence[tuple[str, str]], images: int) -> Diagnostic:
    """Why some of so many images show no object."""
    said = _listed([f"{name} ({reason})" for name, reason in reasons])
    return Diagnostic(
        code=OBJECT_LEFT_OUT,
        message=f"no isolated object was found in {len(reasons):,} of {images:,} images, which give no rows: {said}",
        place=place,
        severity=Severity.WARNING,
    )


def other_size(place: DataPlace, size: tuple[int, int], background: str, other: tuple[int, int]) -> Diagnostic:
    """Sizes are (height, width)."""
    message = (
        f"the image `{shown(place.file)}` has {size[1]:,} × {size[0]:,} pixels,"
        f" its background `{shown(background)}` {other[1]:,} × {other[0]:,}"
    )
    return Diagnostic(code=OTHER_SIZE, message=message, place=place, hint="they must be of one size")


def _listed(names: Sequence[str]) -> str:
    more = len(names) - MOST_NAMES_SHOWN
    listed = ", ".join(shown(name) for name in names[:MOST_NAMES_SHOWN])
    return f"{listed} and {more:,} more" if more > 0 else listed
