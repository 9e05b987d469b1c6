"""Guaranteed bounds as a picture: a bar for each scalar, in parts where the set is in pieces."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import isfinite
from typing import TYPE_CHECKING, TypeAlias

from mbm.report.digits import enclosed
from mbm.report.elements import Scalar, scalars, unit_text
from mbm.report.panels import BLUE, Panel
from mbm.report.types import DerivedValue, Estimate, SolveReport
from mbm.text.shown import cut

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LONGEST_LABEL = 70
"""Characters above a bar."""

MOST_BARS = 16
"""Scalars that are drawn, the first ones."""

Ends: TypeAlias = tuple[float, float]


def enclosure_panels(solve: SolveReport) -> Iterator[Panel]:
    """One panel with the bounds of a solve by interval methods, none of another."""
    wholes = _bounded([*solve.estimates, *solve.derived])
    if not wholes:
        return
    pieces = [_bounded([*piece.estimates, *piece.derived]) for piece in solve.pieces]
    bars = []
    for name, (scalar, ends) in list(wholes.items())[:MOST_BARS]:
        parts = [piece[name][1] for piece in pieces if name in piece] or [ends]
        bars.append((scalar, ends, parts))
    yield partial(_draw, bars)


def _bounded(items: list[Estimate | DerivedValue]) -> dict[str, tuple[Scalar, Ends]]:
    """The scalars that have finite bounds, and are not fixed."""
    every = (scalar for item in items for scalar in scalars(item) if not scalar.fixed and scalar.bounds is not None)
    return {s.name: (s, s.bounds) for s in every if s.bounds is not None and all(map(isfinite, s.bounds))}


def _draw(bars: list[tuple[Scalar, Ends, list[Ends]]], axes: Axes) -> None:
    """Each bar from the low to the high end of its own scalar."""
    for place, (scalar, (low, high), parts) in enumerate(bars):
        width = (high - low) or 1.0
        for begin, end in parts:
            axes.barh(-place, (end - begin) / width, left=(begin - low) / width, height=0.3, color=BLUE, alpha=0.6)
        label = f"{scalar.name}  {enclosed(low, high)} {unit_text(scalar.quantity)}".rstrip()
        axes.text(0.0, 0.22 - place, cut(label, LONGEST_LABEL), fontsize=8, va="bottom")
    axes.set(xlim=(-0.02, 1.02), ylim=(-len(bars) + 0.5, 0.9), xticks=[], yticks=[])
    axes.set_title("guaranteed bounds", fontsize=10)
