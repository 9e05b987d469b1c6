"""Which pictures a page has, and how one becomes SVG for both kinds of paper, or PNG."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from io import BytesIO
from typing import TYPE_CHECKING

from mbm.report import map_panels, panels
from mbm.report.page.types import Block, Picture, Pictures
from mbm.report.plots import figure_bytes, show_plainly
from mbm.report.residual_panels import judging_panels
from mbm.report.row_data import ResidualRow
from mbm.report.types import Result, SolveReport

if TYPE_CHECKING:
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
    found: list[Picture] = []
    solves = result.solves
    if len(solves) == 1:
        found += [Picture("guaranteed bounds", each) for each in panels.enclosure_panels(solves[0])]
    if solves:
        found += [Picture("map", each) for one in solves[0].maps() for each in map_panels.map_panels(one)]
    found += [Picture("data and model", each) for each in panels.data_panels(result)]
    found += [Picture("estimates", each) for each in panels.estimate_panels(result)]
    if len(solves) > 1:
        found += [Picture("residuals of all solves, by row", each) for each in panels.residual_panels(result)]
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
