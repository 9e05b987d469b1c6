"""What mbm reads off outlines, for calls in rows: equal arguments share one outline."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import pairwise
from threading import RLock
from typing import Any

import numpy as np

from mbm.expression.nodes import Figure, Outlined
from mbm.kernels.backends.numpy_stream import tabulated
from mbm.kernels.outlines.arcs import areas_of_flats
from mbm.kernels.outlines.distances import Feet, feet_of, slopes_of
from mbm.kernels.outlines.marks import Marks, places_of
from mbm.kernels.outlines.measures import SIDES, Measured, area, centroid, extent, extreme, perimeter
from mbm.kernels.outlines.outline import Indices, NoOutline, Outline, outline_of
from mbm.kernels.outlines.surveyor import Surveyor
from mbm.kernels.types import Floats, SheetPrograms, Tabulate
from mbm.values import dataclass

KEPT = 64
"""Outlines that are kept: values and derivatives are asked for one after the other, by several equations."""

BETWEEN = 4
"""Points on a chord of an arc in the lines of an outline."""

_WHOLE: Mapping[str, Callable[[Outline], Measured]] = {
    "area": area,
    "centroid": centroid,
    "perimeter": perimeter,
    "extent": extent,
    **{f"extreme {side}": partial(extreme, side=side) for side in SIDES},
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Traced:
    """An outline as lines (k, 2), and the points (n, 2) of it that are nearest to others."""

    lines: tuple[Floats, ...]
    feet: Floats


class Outlines:
    """The outlines of the figures of one problem, one at a time from whatever thread.

    ``tabulate`` makes ready what evaluates the sheets: NumPy, if nothing else is given.
    """

    def __init__(self, tabulate: Tabulate = tabulated) -> None:
        self._tabulate = tabulate
        self._surveyors: dict[Figure, Surveyor] = {}
        self._kept: OrderedDict[tuple[Figure, bytes], Outline | NoOutline] = OrderedDict()
        self._measured: OrderedDict[tuple[str, Figure, bytes], Measured] = OrderedDict()
        self._last: tuple[Outline, Floats, Feet] | None = None
        self._runs: tuple[Floats, list[Indices | slice]] | None = None
        self._lock = RLock()

    def know(self, figure: Figure, sheets: tuple[SheetPrograms, ...]) -> None:
        """Take the programs of a figure's sheets; figures that are not known are differentiated."""
        with self._lock:
            if figure not in self._surveyors:
                self._surveyors[figure] = Surveyor(figure, sheets, self._tabulate)

    def values(self, call: Outlined, arguments: Floats) -> Floats:
        """Numbers (rows, n); NaN where there is no outline."""
        with self._lock, np.errstate(all="ignore"):
            found = np.full((len(arguments), call.size), np.nan)
            for rows, outline, key in self._outlines(call.figure, arguments):
                if isinstance(outline, NoOutline):
                    continue
                if call.function == "contour-distance":
                    found[rows] = self._feet(outline, arguments[rows, call.figure.size :]).distances[:, None]
                else:
                    found[rows] = self._whole(call, outline, key)[0]
            return found

    def slopes(self, call: Outlined, arguments: Floats, wanted: tuple[int, ...]) -> Floats:
        """Derivatives (rows, n, w) by the arguments at the positions ``wanted``."""
        with self._lock, np.errstate(all="ignore"):
            found = np.full((len(arguments), call.size, len(wanted)), np.nan)
            for rows, outline, key in self._outlines(call.figure, arguments):
                if isinstance(outline, NoOutline):
                    continue
                if call.function == "contour-distance":
                    feet = self._feet(outline, arguments[rows, call.figure.size :])
                    found[rows, 0] = slopes_of(outline, feet)[:, _as_slice(wanted)]
                else:
                    found[rows] = self._whole(call, outline, key)[1][:, wanted]
            return found

    def traced(self, call: Outlined, arguments: Floats) -> Iterator[tuple[Indices | slice, Traced]]:
        """The rows of each outline that there is, with its lines and the points of it nearest to theirs."""
        with self._lock, np.errstate(all="ignore"):
            for rows, outline, _ in self._outlines(call.figure, arguments):
                if isinstance(outline, Outline):
                    feet = feet_of(outline, arguments[rows, call.figure.size :])
                    yield rows, Traced(lines=_lines(outline), feet=feet.spots.x)

    def reason(self, call: Outlined, arguments: Floats) -> str | None:
        """Why there is no outline for arguments (1, m); None if there is one."""
        with self._lock, np.errstate(all="ignore"):
            (found,) = (outline for _, outline, _ in self._outlines(call.figure, arguments))
            return found.value if isinstance(found, NoOutline) else None

    def places(self, figure: Figure, numbers: Floats, marks: tuple[Marks, ...]) -> Floats:
        """What `places_of` gives: u, v and depth of points of a figure's surfaces."""
        with self._lock, np.errstate(all="ignore"):
            return places_of(marks, self._surveyor(figure), numbers)

    def areas_of_flats(self, figure: Figure, numbers: Floats) -> Floats:
        """What `arcs.areas_of_flats` gives, for sets of numbers (S, size): (S, faces and ends)."""
        with self._lock, np.errstate(all="ignore"):
            return np.array([areas_of_flats(self._surveyor(figure), each) for each in numbers])

    def _feet(self, outline: Outline, points: Floats) -> Feet:
        """Those of the last call, if it was about the same points."""
        known = self._last
        if known is None or known[0] is not outline or not np.array_equal(known[1], points):
            known = self._last = outline, points, feet_of(outline, points)
        return known[2]

    def _whole(self, call: Outlined, outline: Outline, key: tuple[Figure, bytes]) -> Measured:
        kept = self._measured.get((call.function, *key))
        if kept is None:
            kept = _WHOLE[call.function](outline)
            _keep(self._measured, (call.function, *key), kept)
        return kept

    def _outlines(
        self, figure: Figure, arguments: Floats
    ) -> Iterator[tuple[Indices | slice, Outline | NoOutline, tuple[Figure, bytes]]]:
        """The rows of each outline; those of the last arguments are known, if these are asked for again."""
        table = arguments[:, : figure.size]
        if self._runs is None or self._runs[0] is not arguments:
            self._runs = arguments, _alike(table)
        for rows in self._runs[1]:
            numbers = table[rows][0].copy()
            key = figure, numbers.tobytes()
            if key not in self._kept:
                _keep(self._kept, key, outline_of(self._surveyor(figure), numbers))
            yield rows, self._kept[key], key

    def _surveyor(self, figure: Figure) -> Surveyor:
        if figure not in self._surveyors:
            from mbm.kernels.outlines.sheets import programs_of

            self._surveyors[figure] = Surveyor(figure, programs_of(figure), self._tabulate)
        return self._surveyors[figure]


def _lines(outline: Outline) -> tuple[Floats, ...]:
    """The pieces of an outline, curved ones with `BETWEEN` points on each chord."""
    found = []
    for arc, first, last in zip(outline.arc, outline.first, outline.last, strict=True):
        count = 2 if outline.arcs.straight[arc] else 2 + int(np.ceil(abs(last - first) * BETWEEN))
        found.append(outline.spots(np.full(count, arc), np.linspace(first, last, count)).x)
    return tuple(found)


def _alike(table: Floats) -> list[Indices | slice]:
    """The rows of each set of numbers (rows, m); equal rows mostly follow each other."""
    if not len(table):
        return []
    if bool((table == table[0]).all()):
        return [slice(0, len(table))]
    bounds = [0, *(np.flatnonzero((table[1:] != table[:-1]).any(axis=1)) + 1).tolist(), len(table)]
    found: dict[bytes, list[slice]] = {}
    for run in (slice(a, b) for a, b in pairwise(bounds)):
        found.setdefault(table[run.start].tobytes(), []).append(run)
    return [
        runs[0] if len(runs) == 1 else np.concatenate([np.arange(r.start, r.stop) for r in runs])
        for runs in found.values()
    ]


def _as_slice(places: tuple[int, ...]) -> tuple[int, ...] | slice:
    """The same as a slice where they follow each other, which costs no copy."""
    first = places[0] if places else 0
    return slice(first, first + len(places)) if places == tuple(range(first, first + len(places))) else places


def _keep(kept: OrderedDict[Any, Any], key: object, value: object) -> None:
    kept[key] = value
    if len(kept) > KEPT:
        kept.popitem(last=False)
