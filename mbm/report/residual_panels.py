"""Panels by which residuals are judged: by each column, against normal quantiles, their leverage, their histogram."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.report.panels import BLUE, GREY, RED, finish
from mbm.report.row_data import ResidualRow, RowData
from mbm.report.types import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_COLUMNS = 6
"""Columns over which the residuals of a clause are drawn."""

MOST_POINTS = 20_000
"""Points of one panel; of more rows, evenly spaced ones."""

FEWEST = 3
"""Residuals below which there is no distribution to look at."""


def judging_panels(
    clause: str, rows: Sequence[ResidualRow], data: RowData | None
) -> Iterator[tuple[str, partial[None]]]:
    """Captions and panels of the residuals of a clause in one solve; rows that were left out are not in them."""
    used = [row for row in rows if row.used and np.isfinite(row.residual)]
    step = -(-len(used) // MOST_POINTS) or 1
    shown = used[::step]
    values = np.array([row.residual for row in shown])
    for name, cells in _columns(shown, data).items():
        yield f"residuals of {clause} over {name}", partial(_draw_over, name, cells, values)
    if len(shown) >= FEWEST:
        yield f"residuals of {clause} against normal quantiles", partial(_draw_quantiles, values)
        yield f"histogram of the residuals of {clause}", partial(_draw_histogram, values)
    leverages = [(row.leverage, row.residual) for row in shown if row.leverage is not None]
    if leverages:
        yield f"leverage of the rows of {clause}", partial(_draw_leverage, np.array(leverages))


def _columns(rows: Sequence[ResidualRow], data: RowData | None) -> Mapping[str, Floats]:
    """The columns of numbers that are not the same in all rows, in SI."""
    if data is None or not rows:
        return {}
    places = np.searchsorted(data.rows, [row.row or 0 for row in rows])
    found: dict[str, Floats] = {}
    for name, cells in data.columns.items():
        if cells.dtype == object or len(found) == MOST_COLUMNS:
            continue
        chosen = np.asarray(cells[places], dtype=float)
        if np.isfinite(chosen).all() and np.ptp(chosen) > 0.0:
            found[name] = chosen
    return found


def _draw_over(name: str, cells: Floats, values: Floats, axes: Axes) -> None:
    axes.axhspan(-2, 2, color=GREY, alpha=0.12, linewidth=0)
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.plot(cells, values, "o", color=BLUE, markersize=3.5)
    limit = max(3.5, 1.15 * float(np.abs(values).max()))
    axes.set_ylim(-limit, limit)
    _titled(axes, name, "residual / standard deviation")


def _draw_quantiles(values: Floats, axes: Axes) -> None:
    """Ordered residuals over the quantiles of the normal distribution at (i − 3/8)/(n + 1/4) (Blom 1958)."""
    from scipy.special import ndtri

    count = len(values)
    quantiles = ndtri((np.arange(1, count + 1) - 0.375) / (count + 0.25))
    axes.axline((0, 0), slope=1, color=GREY, linewidth=0.8)
    axes.plot(quantiles, np.sort(values), "o", color=BLUE, markersize=3.5)
    _titled(axes, "normal quantile", "residual / standard deviation")


def _draw_histogram(values: Floats, axes: Axes) -> None:
    """The histogram, and the normal distribution of standard deviation 1."""
    limit = max(3.5, float(np.abs(values).max()))
    axes.hist(values, bins=int(np.clip(np.sqrt(len(values)), 5, 60)), color=BLUE, alpha=0.6, density=True)
    grid = np.linspace(-limit, limit, 200)
    axes.plot(grid, np.exp(-(grid**2) / 2) / np.sqrt(2 * np.pi), color=RED, linewidth=1.2)
    _titled(axes, "residual / standard deviation", "density")


def _draw_leverage(pairs: Any, axes: Axes) -> None:
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.plot(pairs[:, 0], pairs[:, 1], "o", color=BLUE, markersize=3.5)
    axes.set_xlim(left=0.0)
    _titled(axes, "leverage", "residual / standard deviation")


def _titled(axes: Axes, below: str, beside: str) -> None:
    axes.set_xlabel(below)
    axes.set_ylabel(beside)
    finish(axes, legend=False)
