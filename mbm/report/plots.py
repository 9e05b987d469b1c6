"""Result → a picture: maps, data against model, normalised residuals, error ellipses, estimates over the key."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from mbm.files.writing import checked_target, write_whole
from mbm.report import faults
from mbm.report.types import Result
from mbm.text.faults import missing_extra
from mbm.text.shown import cut
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = (".png", ".svg", ".pdf")
MOST_PANELS = 12
"""Panels of one picture; maps come first, then data, then estimates, then residuals."""

Panel: TypeAlias = "Callable[[Axes], None]"

LONGEST_LABEL = 80
"""Characters of a title or label; longer ones would leave no room for the panel."""

_PANEL_INCHES = (4.6, 3.4)


def draw(result: Result) -> Figure:
    """The picture of a result as a Matplotlib figure of its own (no global state).

    Raises MbmError (missing-extra) if Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MbmError(missing_extra("plotting", "plot")) from error
    panels = _shown(result)
    columns = 1 if len(panels) < 2 else 2 if len(panels) < 5 else 3
    rows = max(-(-len(panels) // columns), 1)
    width, height = _PANEL_INCHES
    figure = Figure(figsize=(width * columns, height * rows + 0.4), layout="constrained")
    figure.suptitle(f"{result.problem}", fontsize=11, fontweight="bold")
    for number, panel in enumerate(panels, start=1):
        panel(figure.add_subplot(rows, columns, number))
    if not panels:
        figure.text(0.5, 0.5, "nothing was solved", ha="center", va="center")
    show_plainly(figure)
    return figure


def show_plainly(figure: Figure) -> None:
    """Every text of the figure on one line, as it is: dollar signs begin no formula, and nothing is handed to TeX."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if isinstance(text, Text):
            text.set_usetex(False)
            text.set_parse_math(False)
            text.set_text(cut(text.get_text(), LONGEST_LABEL))


def save(result: Result, path: str | Path) -> None:
    """Draws the result into a file, in the format that its name ends in.

    Raises:
        MbmError: missing-extra, plot-format, not-writable; would-overwrite: the result was made from that file.

    """
    ending = format_of(path)
    checked_target(path, reads=result.reads)
    write_whole(path, picture(result, ending), reads=result.reads)


def format_of(path: str | Path) -> str:
    """The format that the name of a file ends in, one of ``FORMATS``. Raises MbmError (plot-format)."""
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise MbmError(faults.plot_format(str(path), ", ".join(FORMATS)))
    return ending


def picture(result: Result, ending: str) -> bytes:
    """The picture of a result in the format ``ending``. Equal results, equal bytes. Raises MbmError (missing-extra)."""
    return figure_bytes(draw(result), ending)


def figure_bytes(figure: Figure, ending: str) -> bytes:
    """A figure in the format ``ending``, without a date. Equal figures, equal bytes."""
    import matplotlib as mpl

    dateless = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(ending, {})
    stream = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "mbm"}), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a character that the font lacks, or of little room
        figure.savefig(stream, format=ending.removeprefix("."), dpi=130, metadata=dateless)
    return stream.getvalue()


def _panels(result: Result) -> Iterator[Panel]:
    from mbm.report import map_panels, panels

    if len(result.solves) == 1:
        yield from panels.enclosure_panels(result.solves[0])
    if result.solves:
        for found in result.solves[0].maps():
            yield from map_panels.map_panels(found)
    yield from panels.data_panels(result)
    yield from panels.estimate_panels(result)
    yield from panels.region_panels(result)
    yield from panels.residual_panels(result)


def _shown(result: Result) -> list[Panel]:
    """The panels of the picture: what makes the uncertainty, where nothing was measured."""
    found = list(_panels(result))[:MOST_PANELS]
    if not found:
        from mbm.report.budgets.panels import budget_panels

        found = list(budget_panels(result))[:MOST_PANELS]
    return found
