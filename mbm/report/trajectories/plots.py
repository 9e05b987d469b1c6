"""Trajectories → a picture: both paths from above, the path coloured by its error, errors over time and in order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mbm.report.figures import show_plainly, titled
from mbm.report.trajectories.answer import TrajectoryAnswer
from mbm.report.trajectories.types import DEGREE, Floats, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_SHOWN = 4
"""Trajectories of one picture: a row of panels for each."""

PANELS = 4
_INCHES = (4.6, 3.6)
_REFERENCE, _ESTIMATE = "0.55", "C0"


def draw(answer: TrajectoryAnswer) -> Figure:
    """The picture as a Matplotlib figure of its own (no global state).

    Raises MbmError (missing-extra) if Matplotlib is not installed.
    """
    shown = answer.trajectories[:MOST_SHOWN]
    figure = titled(answer.result.problem, _INCHES[0] * PANELS, _INCHES[1] * len(shown) + 0.4)
    for row, found in enumerate(shown):
        panels = [figure.add_subplot(len(shown), PANELS, row * PANELS + i + 1) for i in range(PANELS)]
        _paths(panels[0], found)
        _coloured(panels[1], found)
        _over_time(panels[2], found)
        _cumulative(panels[3], found)
    show_plainly(figure)
    return figure


def _unit(found: Trajectory) -> str:
    return f" ({found.ape.unit})" if found.ape.unit else ""


def _axes(axes: Axes, found: Trajectory) -> None:
    axes.set(xlabel=f"x{_unit(found)}", ylabel=f"y{_unit(found)}")
    axes.set_aspect("equal", adjustable="datalim")


def _paths(axes: Axes, found: Trajectory) -> None:
    """Both paths from above."""
    factor = found.ape.factor
    for path, name, colour in (
        (found.reference, found.sides[1], _REFERENCE),
        (found.estimate, found.sides[0], _ESTIMATE),
    ):
        axes.plot(*(path.positions[:, :2] / factor).T, color=colour, lw=1.2, label=name.rstrip(".") or "-")
    axes.legend(fontsize=8)
    axes.set_title("from above", fontsize=9)
    _axes(axes, found)


def _coloured(axes: Axes, found: Trajectory) -> None:
    """The estimated path, coloured by the error of each pose."""
    from matplotlib.collections import LineCollection

    points = found.estimate.positions[:, :2] / found.ape.factor
    errors = found.ape.translation / found.ape.factor
    lines = LineCollection(np.stack([points[:-1], points[1:]], axis=1).tolist(), cmap="viridis", linewidths=2.0)
    lines.set_array((errors[:-1] + errors[1:]) / 2)
    axes.add_collection(lines)
    axes.autoscale()
    if axes.figure is not None and len(points) > 1:
        axes.figure.colorbar(lines, ax=axes, label=f"error{_unit(found)}")
    axes.set_title("error of the position", fontsize=9)
    _axes(axes, found)


def _over_time(axes: Axes, found: Trajectory) -> None:
    """The errors of the poses over time, those of rotations on an axis of their own."""
    at, label = (found.rows.astype(float), "row") if found.times is None else (found.times, "t")
    order = np.argsort(at, kind="stable")
    errors = found.ape.translation / found.ape.factor
    axes.plot(at[order], errors[order], color=_ESTIMATE, lw=1.0)
    rmse = float(np.sqrt(np.mean(np.square(errors))))
    axes.axhline(rmse, color="C3", lw=1.0, ls="--", label=f"rmse {rmse:.4g}")
    axes.set_xlabel(label)
    axes.set_ylabel(f"error of the position{_unit(found)}", color=_ESTIMATE)
    if found.ape.rotation is not None:
        other = axes.twinx()
        other.plot(at[order], found.ape.rotation[order] / DEGREE, color="C1", lw=0.8, alpha=0.8)
        other.set_ylabel("error of the rotation (deg)", color="C1")
    axes.legend(fontsize=8)
    axes.set_title("over time", fontsize=9)


def _cumulative(axes: Axes, found: Trajectory) -> None:
    """Which part of the errors lies below a value: of poses, and over steps."""
    _share(axes, found.ape.translation / found.ape.factor, "poses")
    for each in found.rpe:
        label = f"steps of {each.step:g} {each.unit or 'rows'}"
        _share(axes, each.errors.translation / each.errors.factor, label)
    axes.set(xlabel=f"error{_unit(found)}", ylabel="part of the errors below")
    axes.set_ylim(0, 1)
    axes.legend(fontsize=8, loc="lower right")
    axes.set_title("cumulative", fontsize=9)


def _share(axes: Axes, errors: Floats, label: str) -> None:
    axes.plot(np.sort(errors), np.arange(1, len(errors) + 1) / len(errors), lw=1.2, label=label)
