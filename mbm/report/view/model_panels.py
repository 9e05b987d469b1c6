"""A model in the plane of a picture: its lines, visible or hidden, its axes, and the numbers of its features."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.report.figures import BLUE, GREEN, GREY, ORANGE, RED
from mbm.report.types import Floats
from mbm.report.view import faults
from mbm.report.view.hidden import MOST_STROKES, Faces, Stretch, worth_drawing
from mbm.report.view.rulers import Ruler, Wanted, placed, rulers
from mbm.report.view.types import Mark, Solid
from mbm.report.view.viewpoint import View, outlines
from mbm.text.types import MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INCHES = (5.6, 5.0)
"""A panel of a model."""

MOST_LABELS = 300
"""Features whose names are tried; beyond, nobody could read them."""

MOST_OF_A_KIND = {"line": 36, "vertex": 100, "plane": 100}
"""Features up to which those of a kind are numbered: more lines leave the others no room."""

MOST_COMPARISONS = 500_000_000
"""Lines times faces of a model: what is hidden is then found within a minute."""

MOST_MARKS = 3_000
"""Features that are looked at."""

_HIDDEN = "#aaaaaa"
_DASHES = (0, (3.0, 2.0))
_STYLES: Mapping[tuple[bool, str], tuple[str, float, Any]] = MappingProxyType(
    {
        (True, "model"): (_HIDDEN, 0.7, _DASHES),
        (True, "camera"): ("#a9c6dd", 0.7, _DASHES),
        (True, "spread"): ("#e8b795", 0.5, _DASHES),
        (False, "model"): ("#222222", 1.1, "solid"),
        (False, "camera"): (BLUE, 0.9, "solid"),
        (False, "spread"): (RED, 0.6, "solid"),
    }
)
"""Colour, width and dashes of lines, hidden or not, of each kind."""

_KINDS = {"part": (8.5, GREEN), "point": (8.0, RED), "vertex": (8.0, BLUE), "plane": (8.0, ORANGE)}
_KINDS |= {"camera": (8.0, BLUE), "curve": (7.0, GREY), "line": (7.0, GREY)}
_SHOWN = {"line": "l{}", "curve": "c{}", "plane": "[{}]"}
_MARGIN = 34.0
"""Points of the panel around the model, for its axes and numbers."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """A line as it is drawn: ``points`` (n, 2) in the picture, whether hidden, and its ``kind``."""

    points: Floats
    hidden: bool
    kind: str = "model"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seen:
    """A model seen from somewhere: its lines, and its marks with their places (2,) and whether they are hidden.

    ``dots`` (n, 2) are those of the points without a name.
    """

    lines: tuple[Line, ...]
    dots: Floats
    marks: tuple[tuple[Mark, Floats, bool], ...]


def seen(solid: Solid, view: View) -> Seen:
    """What is seen of a model, what is hidden, and where its features are.

    Raises:
        MbmError: too-much-to-draw.

    """
    patches = [view.of(patch) for patch in solid.patches]
    faces = Faces([view.of(face) for face in solid.faces], patches)
    strokes = worth_drawing(solid.strokes, lambda points: np.broadcast_to(view.axes[2], points.shape))
    if len(strokes) * faces.count > MOST_COMPARISONS:
        raise MbmError(faults.too_much_to_draw(f"{MOST_COMPARISONS:,} pairs of a line and a face"))
    lines = []
    for stroke in strokes:
        lines += [_line(each, stroke.kind) for each in faces.stretches(view.of(stroke.points))]
    if len(solid.strokes) > MOST_STROKES:
        lines = [line for line in lines if not line.hidden]
    for patch in patches:
        for outline in outlines(patch):
            lines += [_line(each, "model") for each in faces.stretches(outline, outline=True)]
    named = _named(solid.marks)
    places = view.of(np.array([mark.at for mark in named]).reshape(-1, 3))
    hidden = [bool(faces.hides(place[None])[0]) for place in places]
    dots = view.of(solid.dots)[:, :2]
    marks = tuple(
        (mark, at, away)
        for mark, at, away in zip(named, places[:, :2], hidden, strict=True)
        if mark.normal is None or float(mark.normal @ view.axes[2]) > 0.0  # planes are named where they are seen from
    )
    return Seen(lines=tuple(lines), dots=dots, marks=marks)


def _named(marks: Sequence[Mark]) -> list[Mark]:
    """The features that are named: those of a kind only where they are few, parts and points first."""
    counts = Counter(mark.kind for mark in marks)
    kept = [mark for mark in marks if counts[mark.kind] <= MOST_OF_A_KIND.get(mark.kind, MOST_MARKS)]
    return sorted(kept, key=lambda mark: list(_KINDS).index(mark.kind))[:MOST_MARKS]


def _line(stretch: Stretch, kind: str) -> Line:
    return Line(points=stretch.points[:, :2], hidden=stretch.hidden, kind=kind)


def draw_model(solid: Solid, view: View, axes: Axes) -> None:
    """Draw a model with hidden lines thin, feature numbers and axes; lengths are equal in all directions."""
    found = seen(solid, view)
    _draw_lines(found.lines, axes)
    if len(found.dots):
        size = 2.4 if len(found.dots) < 400 else 1.2
        axes.plot(*found.dots.T, "o", color=ORANGE, markersize=size, markeredgewidth=0.0, zorder=1.5)
    beside = rulers(*solid.bounds(), view, solid.unit)
    scale = _frame(found, beside, view, axes)
    taken = _draw_rulers(beside, view, scale, axes)
    _draw_marks(found, scale, taken, axes)
    axes.set_title(solid.name, fontsize=11)


def _draw_lines(lines: Sequence[Line], axes: Axes) -> None:
    from matplotlib.collections import LineCollection

    for (hidden, kind), (colour, width, style) in _STYLES.items():
        chosen = [line.points for line in lines if line.hidden == hidden and line.kind == kind]
        axes.add_collection(
            LineCollection(
                chosen, colors=colour, linewidths=width, linestyles=[style], zorder=1 if hidden else 2, capstyle="round"
            )
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scale:
    """From the coordinates of a panel to its points (1/72 inch): ``lo`` is its lower left corner."""

    lo: Floats
    per_unit: float
    width: float
    height: float

    def points(self, at: Floats) -> Floats:
        """Places (…, 2) in points of the panel."""
        return np.asarray((at - self.lo) * self.per_unit)

    def back(self, at: Floats) -> Floats:
        """Places in points, in the coordinates of the panel."""
        return np.asarray(at / self.per_unit + self.lo)


def _frame(found: Seen, beside: Sequence[Ruler], view: View, axes: Axes) -> _Scale:
    """Fit everything into the panel with equal scales."""
    ends = [view.of(end)[None, :2] for ruler in beside for end in (ruler.start, ruler.end)]
    points = np.vstack(
        [found.dots, *(line.points for line in found.lines), *(at[None] for _, at, _ in found.marks), *ends]
    )
    lo, hi = points.min(axis=0), points.max(axis=0)
    width, height = (72 * inches * 0.92 for inches in INCHES)
    extent = np.maximum(hi - lo, 1e-12 * max(float(np.abs(points).max()), 1.0))
    scale = float(min((width - 2 * _MARGIN) / extent[0], (height - 2 * _MARGIN) / extent[1]))
    middle = (lo + hi) / 2
    half = np.array([width, height]) / scale / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_aspect("equal")
    axes.axis("off")
    return _Scale(lo=middle - half, per_unit=scale, width=width, height=height)


def _draw_rulers(beside: Sequence[Ruler], view: View, scale: _Scale, axes: Axes) -> list[Floats]:
    """Draw axes; the rectangles (4,) that nothing else may cover, in points."""
    taken = []
    for ruler in beside:
        ends = view.of(np.stack([ruler.start, ruler.end]))[:, :2]
        axes.plot(*ends.T, color=GREY, linewidth=0.7)
        outward = _outward(ends, ruler.upright)
        for at, text in ruler.marks:
            place = scale.points(view.of(at)[:2])
            axes.plot(*scale.back(np.stack([place, place + 3.0 * outward])).T, color=GREY, linewidth=0.7)
            where = scale.back(place + 10.0 * outward)
            taken += [np.concatenate([place + 10.0 * outward - 6.0, place + 10.0 * outward + 6.0])]
            axes.text(float(where[0]), float(where[1]), text, fontsize=7, color=GREY, ha="center", va="center")
        along = scale.points(ends[0] + np.linspace(0.0, 1.0, 40)[:, None] * (ends[1] - ends[0]))
        taken += [np.concatenate([place - 2.0, place + 2.0]) for place in along]
        middle = scale.points(ends).mean(axis=0) + (32.0 if ruler.upright else 22.0) * outward
        x, y = scale.back(middle).tolist()
        axes.text(x, y, ruler.name, fontsize=8, color=GREY, ha="center", va="center")
    return taken


def _outward(ends: Floats, upright: bool) -> Floats:
    """The direction (2,) in which the numbers of an axis stand: left of an upright one, below the others."""
    if upright:
        return np.array([-1.0, 0.0])
    way = ends[1] - ends[0]
    across = np.array([way[1], -way[0]])
    if across[1] > 0:
        across = -across
    return np.asarray(across / max(float(np.hypot(*across)), 1e-300))


def _draw_marks(found: Seen, scale: _Scale, taken: Sequence[Floats], axes: Axes) -> None:
    """Write what has room, parts first, then what is seen, then what is hidden (in grey)."""
    order = list(_KINDS)
    marks = sorted(
        _distinct(found.marks, scale),
        key=lambda m: (m[0].kind not in ("part", "camera") and m[2], order.index(m[0].kind)),
    )
    marks = marks[:MOST_LABELS]
    if not marks:
        return
    middle = np.mean([at for _, at, _ in marks], axis=0)
    for mark, at, hidden in marks:
        if mark.kind in ("vertex", "point"):
            axes.plot(*at, "o", color=_HIDDEN if hidden else _KINDS[mark.kind][1], markersize=2.6, zorder=5)
    wanted = [
        Wanted(
            text=_SHOWN.get(mark.kind, "{}").format(mark.text),
            at=scale.points(at),
            size=_KINDS[mark.kind][0],
            away=at - middle,
            centred=mark.kind in ("plane", "part"),
        )
        for mark, at, _ in marks
    ]
    dots = [scale.points(at) for mark, at, _ in marks if mark.kind in ("vertex", "point")]
    taken = [*taken, *(np.concatenate([dot - 1.5, dot + 1.5]) for dot in dots)]
    for each in placed(wanted, (np.zeros(2), np.array([scale.width, scale.height])), taken):
        mark, _, hidden = marks[each.number]
        size, colour = _KINDS[mark.kind]
        x, y = scale.back(each.at).tolist()
        text = axes.text(
            x,
            y,
            wanted[each.number].text,
            fontsize=size,
            color=_HIDDEN if hidden and mark.kind != "part" else colour,
            ha="center",
            va="center_baseline",
            fontweight="bold" if mark.kind == "part" else "normal",
            zorder=4,
        )
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4})


def _distinct(marks: Sequence[tuple[Mark, Floats, bool]], scale: _Scale) -> Iterator[tuple[Mark, Floats, bool]]:
    """Of equal texts at one place, one."""
    known = set()
    for mark, at, hidden in marks:
        place = (mark.kind, mark.text, *np.round(scale.points(at)).tolist())
        if place not in known:
            known.add(place)
            yield mark, at, hidden
