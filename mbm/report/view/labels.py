"""Where names and numbers go in a picture, so that none covers another: each takes the first free place around it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mbm.report.types import Floats
from mbm.values import dataclass

WIDTH, HEIGHT = 0.62, 1.15
"""Of a character and of a line of text, in font sizes; taken a little large."""

_TURNS = np.deg2rad([45.0, 135.0, -45.0, -135.0, 90.0, -90.0, 0.0, 180.0])
_REACHES = (1.0, 1.6, 2.4)
"""How far the middle of a text may be from its place, in font sizes beside half of its own extent."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wanted:
    """A text that belongs to ``at`` (2,), in points of the picture; ``away`` (2,) is the side it would best be on.

    ``centred``: the place itself is the best.
    """

    text: str
    at: Floats
    size: float
    away: Floats | None = None
    centred: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placed:
    """A text with its middle (2,), in points of the picture; ``number`` is its place among those that were wanted."""

    number: int
    at: Floats


def placed(wanted: Sequence[Wanted], frame: tuple[Floats, Floats], taken: Iterable[Floats] = ()) -> tuple[Placed, ...]:
    """The texts that have room, in their order: the first are the most important.

    Args:
        wanted: what is to be written.
        frame: the least and greatest coordinates, each (2,).
        taken: rectangles (4,) of left, bottom, right, top that nothing may cover.

    """
    boxes = np.array([*taken]).reshape(-1, 4)
    found = []
    for number, each in enumerate(wanted):
        half = np.array([WIDTH * len(each.text), HEIGHT]) * each.size / 2
        for middle in _places(each, half):
            box = np.concatenate([middle - half, middle + half])
            if (box[:2] < frame[0]).any() or (box[2:] > frame[1]).any():
                continue
            clash = (boxes[:, :2] < box[2:]).all(axis=1) & (boxes[:, 2:] > box[:2]).all(axis=1)
            if not clash.any():
                boxes = np.vstack([boxes, box])
                found.append(Placed(number=number, at=middle))
                break
    return tuple(found)


def _places(each: Wanted, half: Floats) -> Iterable[Floats]:
    """Middles that a text may have, the best first."""
    if each.centred:
        yield each.at
    turns = _TURNS
    if each.away is not None and bool(np.any(each.away)):
        best = np.arctan2(each.away[1], each.away[0])
        turns = turns[np.argsort(-np.cos(turns - best), kind="stable")]
    for reach in _REACHES:
        for turn in turns:
            way = np.array([np.cos(turn), np.sin(turn)])
            yield each.at + way * (half + (reach - 0.5) * each.size)
