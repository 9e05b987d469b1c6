"""Sheets of silhouettes at many points at once."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nodes import Figure
from mbm.kernels.types import Floats, SheetPrograms, Tabulate, Tabulated
from mbm.values import dataclass

Indices = NDArray[np.int64]

_MEASURED, _SELDOM = ("geometry", "motion"), ("bending", "slant")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flats:
    """Lines as columns (lines,): the sheet, the net (−1: none) and the ``places`` (lines, most inputs) of the inputs.

    Around flat faces run ``sides``, numbers of lines, and whether ``along`` these; of face i from ``first[i]`` on.
    """

    sheet: Indices
    net: Indices
    places: Indices
    sides: Indices
    along: NDArray[np.bool_]
    first: Indices


def _flats(figure: Figure, corners: list[int]) -> Flats:
    """Those of a figure whose nets have their corners at places from ``corners`` on."""
    lines, faces = figure.lines, figure.faces
    table = np.zeros((len(lines), max((len(places) for _, places in lines), default=0)), dtype=np.int64)
    for row, (_, places) in zip(table, lines, strict=True):
        row[: len(places)] = places
    sheets, nets, tables = [np.array([k for k, _ in lines], dtype=np.int64)], [np.full(len(lines), -1)], [table]
    sides = [np.array([line for face in faces for line, _ in face], dtype=np.int64)]
    along = [np.array([forward for face in faces for _, forward in face], dtype=bool)]
    counts = np.array([len(face) for face in faces], dtype=np.int64)
    first = [np.cumsum(counts) - counts]
    for number, (seen, corner) in enumerate(zip(figure.nets, corners, strict=True)):
        net, count = seen.net, len(seen.net.edges)
        ends = corner + (3 * net.edges[:, :, None] + np.arange(3)).reshape(count, 6)
        others = np.tile(np.array(seen.of_line, dtype=np.int64), (count, 1))
        first.append(sum(map(len, sides)) + net.first)
        sides.append(sum(map(len, sheets)) + net.sides)
        along.append(net.along)
        sheets.append(np.full(count, seen.line))
        nets.append(np.full(count, number))
        tables.append(np.concatenate([ends, others], axis=1))
    widest = max(each.shape[1] for each in tables)
    return Flats(
        sheet=np.concatenate(sheets),
        net=np.concatenate(nets),
        places=np.concatenate([np.pad(each, ((0, 0), (0, widest - each.shape[1]))) for each in tables]),
        sides=np.concatenate(sides),
        along=np.concatenate(along),
        first=np.concatenate(first),
    )


class Surveyor:
    """Evaluates the sheets of one figure, by what ``tabulate`` makes ready when it is first asked for."""

    def __init__(self, figure: Figure, sheets: tuple[SheetPrograms, ...], tabulate: Tabulate) -> None:
        self.figure = figure
        self.sheets = sheets
        self._tabulate = tabulate
        self._ready: dict[str, Tabulated] = {}

    def table(self, sheet: int, what: str, at: Floats, inputs: Floats) -> Floats:
        """What the program ``what`` of a sheet gives (points, outputs).

        Args:
            sheet: its number.
            what: ``geometry``, ``bending``, ``motion`` or ``slant``, see `mbm.kernels.outlines.sheets`; ``places`` are
                u, v and depth alone.
            at: parameters (points, 2); of a line the first counts.
            inputs: numbers of the figure (points, inputs), or (inputs,) if they are the same for all points.
        """
        name = f"{what} {sheet}"
        if name not in self._ready:
            self._make_ready(what)
        own = self.sheets[sheet]
        given = np.empty((len(at), own.parameters + own.inputs))
        given[:, : own.parameters] = at[:, : own.parameters]
        given[:, own.parameters :] = inputs
        return self._ready[name](given)

    @cached_property
    def flats(self) -> Flats:
        """The lines and faces of the figure."""
        return _flats(self.figure, self._corners)

    @cached_property
    def _corners(self) -> list[int]:
        """The places from which on the corners of each net stand."""
        counts = [3 * len(each.net.points) for each in self.figure.nets]
        return [self.figure.size + sum(counts[:k]) for k in range(len(counts))]

    def with_corners(self, numbers: Floats) -> Floats:
        """Numbers of the figure (size,), and behind them what the lines of nets take of these nets' points."""
        if not self.figure.nets:
            return numbers
        found = [numbers]
        for number, seen in enumerate(self.figure.nets):
            points = seen.net.points
            if self.sheets[seen.line].straight:
                points = self._of_points("geometry", number, slice(None), numbers)
            found.append(points.ravel())
        return np.concatenate(found)

    def _of_points(self, what: str, number: int, own: Indices | slice, numbers: Floats) -> Floats:
        seen = self.figure.nets[number]
        points = seen.net.points[own]
        others = np.tile(numbers[list(seen.of_point)], (len(points), 1))
        return self.table(seen.point, what, points[:, :0], np.concatenate([points, others], axis=1))

    def by_numbers(self, net: int, places: Indices, slopes: Floats, numbers: Floats) -> tuple[Indices, Floats]:
        """Derivatives (k, 2, m) by inputs of lines at ``places`` (k, m) as those by the figure's own numbers."""
        if net < 0:
            return places, slopes
        seen = self.figure.nets[net]
        if not self.sheets[seen.line].straight:
            return places[:, 6:], slopes[:, :, 6:]
        ends, inverse = np.unique((places[:, 0:6:3] - self._corners[net]) // 3, return_inverse=True)
        moved = self._of_points("motion", net, ends, numbers).reshape(len(ends), 3, -1)[:, :, 3:]
        both = moved[inverse.reshape(-1)].reshape(len(places), 6, -1)
        return np.tile(np.array(seen.of_point, dtype=np.int64), (len(places), 1)), slopes @ both

    def _make_ready(self, what: str) -> None:
        """That of all sheets, with what is asked for together with it."""
        if what == "places":
            programs = {f"places {k}": each.geometry.restricted(range(3)) for k, each in enumerate(self.sheets)}
        else:
            together = _MEASURED if what in _MEASURED else _SELDOM
            programs = {f"{name} {k}": getattr(each, name) for name in together for k, each in enumerate(self.sheets)}
        self._ready |= self._tabulate(programs)
