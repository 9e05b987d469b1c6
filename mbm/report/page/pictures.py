"""Which pictures a page has, and how one becomes SVG for both kinds of paper, or PNG.

Panels by which residuals are judged: by each column, against normal quantiles, their leverage, their histogram.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm.report import panels
from mbm.report.figures import BLUE, GREY, RED, figure_bytes, finish, show_plainly
from mbm.report.page.types import Block, Picture, Pictures
from mbm.report.plots import REGIONS, RESIDUALS, panels_of
from mbm.report.row_data import ResidualRow, RowData
from mbm.report.types import Floats, Result, SolveReport

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PICTURES = 24
"""Pictures of residuals, and of all else."""
MOST_VECTOR = 1500
"""Marks of one kind beyond which they are pixels, so that a page stays small."""
INK = "#0a0b0c"
"""What takes the colour of the text of the page."""
_GRID, _MARK = "#dddddd", "#0072b2"
_INCHES = (4.4, 3.1)
_STYLE = {
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor", "legend.facecolor"), "none"),
}
_REFERENCE = re.compile(r'(\sid="|\bhref="#|url\(#)')
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)


def result_pictures(result: Result) -> Iterator[Block]:
    """Bounds, maps, data with the model, estimates; residuals of many solves together."""
    left_out = (REGIONS, RESIDUALS) if len(result.solves) == 1 else (REGIONS,)
    shown = {what: found for what, found in panels_of(result).items() if what not in left_out}
    found = [Picture(what, panel) for what, each in shown.items() for panel in each]
    if found:
        yield Pictures(tuple(found[:MOST_PICTURES]))


def residual_pictures(solve: SolveReport) -> Iterator[Picture]:
    """The residuals of each clause: by row, by column, their distribution, their leverage."""
    rows: dict[str, list[ResidualRow]] = {}
    for row in solve.rows():
        rows.setdefault(row.clause, []).append(row)
    data, left = solve.row_data(), MOST_PICTURES
    for clause, own in rows.items():
        pictures = [Picture(f"residuals of {clause} by row", partial(panels.draw_residuals, clause, own))]
        pictures += [Picture(caption, panel) for caption, panel in judging_panels(clause, own, data.get(clause))]
        yield from pictures[: max(left, 0)]
        left -= len(pictures)


def svg(picture: Picture, number: int) -> str:
    """The picture as part of a page: the colours of its text are those of the page, its names nobody else's."""
    text = figure_bytes(_figure(picture), ".svg").decode("utf-8")
    text = _METADATA.sub("", _COMMENT.sub("", text[text.index("<svg") :]))
    text = _REFERENCE.sub(lambda match: f"{match[0]}f{number}-", text)
    return text.replace(INK, "currentColor").replace(_GRID, "var(--rule)").replace(_MARK, "var(--mark)")


def png(picture: Picture) -> BytesIO:
    """The picture for white paper."""
    figure = _figure(picture)
    stream = BytesIO()
    figure.savefig(stream, format="png", dpi=200, metadata={"Software": None})
    stream.seek(0)
    return stream


def _figure(picture: Picture) -> Figure:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=_INCHES, layout="constrained")
        axes = figure.add_subplot()
        picture.panel(axes)
    for line in axes.lines:
        if len(line.get_xdata(orig=True)) > MOST_VECTOR:  # type: ignore[arg-type]
            line.set_rasterized(True)
    show_plainly(figure)
    return figure


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
    axes.set(xlabel=below, ylabel=beside)
    finish(axes, legend=False)
