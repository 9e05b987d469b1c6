"""A design → a picture: the standard deviation to expect with each candidate, and what each row is worth."""

from __future__ import annotations

from functools import partial
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from mbm.report.designs.types import Candidate, Planned
from mbm.report.figures import panelled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from mbm.report.figures import Panel

MOST_WORTH = 24
"""Rows of a panel: those that are worth most."""

_PANEL = (5.6, 3.8)


def draw(design: Planned) -> Figure:
    """The picture as a Matplotlib figure of its own (no global state).

    Raises MbmError (missing-extra) if Matplotlib is not installed.
    """
    panels: list[Panel] = []
    if design.candidates:
        panels.append(partial(_candidates, design=design))
    if any(each.growth is not None for each in design.worth):
        panels.append(partial(_worth, design=design))
    return panelled(f"design of {design.problem}", panels, _PANEL, "nothing is determined")


def _candidates(axes: Axes, design: Planned) -> None:
    """What is to be expected with one candidate more, over what tells the candidates apart; those chosen are ringed."""
    told = "sigma" if any(each.sigma is not None for each in design.candidates) else "gain"
    values = np.array([_number(getattr(each, told)) for each in design.candidates])
    names, places = _places(design.candidates)
    chosen = set() if design.chosen is None else set(design.chosen.rows)
    ringed = np.array([each.row in chosen for each in design.candidates])
    known = np.isfinite(values)
    label = _label(design, told)
    if len(names) == 2:
        across, up = places
        dots = axes.scatter(across[known], up[known], c=values[known], s=40)
        axes.figure.colorbar(dots, ax=axes, label=label)
        axes.scatter(across[~known], up[~known], marker="x", color="0.5", s=30)
        axes.scatter(across[ringed], up[ringed], s=140, facecolors="none", edgecolors="C3", label="chosen")
        axes.set(xlabel=names[0], ylabel=names[1])
    else:
        axes.plot(places[0, known], values[known], "o", color="C0", label="with this candidate")
        axes.scatter(places[0, ringed & known], values[ringed & known], s=140, facecolors="none", edgecolors="C3",
                     label="chosen")  # fmt: skip
        if told == "sigma" and design.sigma is not None:
            axes.axhline(design.sigma, color="0.4", linewidth=1, label="without candidates")
        if told == "sigma" and design.wanted is not None:
            axes.axhline(design.wanted, color="C2", linewidth=1, linestyle="--", label="wanted")
        axes.set(xlabel=names[0], ylabel=label)
    left = int((~known).sum())
    axes.set_title("with one candidate" + (f"; {left} leave it open" if left else ""), fontsize=9)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


def _worth(axes: Axes, design: Planned) -> None:
    """By which factor the standard deviation grows without each row."""
    rows = [each for each in design.worth if each.growth is not None][:MOST_WORTH]
    labels = [each.clause + ("" if each.row is None else f" row {each.row}") for each in rows]
    axes.barh(range(len(rows)), [_number(each.growth) - 1.0 for each in rows], left=1.0, color="C0", height=0.7)
    axes.set_yticks(range(len(rows)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel(f"standard deviation of {design.quantity or 'the number that suffers most'} without the row, ×")
    needed = sum(each.growth is None for each in design.worth)
    axes.set_title("what rows are worth" + (f"; {needed} cannot be left out" if needed else ""), fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)


def _label(design: Planned, told: str) -> str:
    name = design.quantity or "the estimates"
    if told == "gain":
        return f"{name}: factor by which deviations shrink"
    unit = "" if design.unit is None else f" ({design.unit})"
    return f"standard deviation of {name}{unit}"


def _places(candidates: tuple[Candidate, ...]) -> tuple[tuple[str, ...], np.ndarray]:
    """One or two columns of numbers that differ, else the number of the row; and them (k, candidates)."""
    found = {}
    for name in candidates[0].cells:
        cells = [each.cells[name] for each in candidates]
        if name != "cost" and all(isinstance(cell, Real) and np.isfinite(float(cell)) for cell in cells):
            numbers = np.array([float(cell) for cell in cells])
            if len(candidates) == 1 or np.ptp(numbers) > 0.0:
                found[name] = numbers
    if len(found) not in (1, 2):
        found = {"row": np.array([float(each.row) for each in candidates])}
    return tuple(found), np.array(list(found.values()))


def _number(value: float | None) -> float:
    return float("nan") if value is None else value
