"""What pictures have in common: formats, colours, a figure of their own, panels side by side."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from mbm.report import faults
from mbm.text.faults import missing_extra
from mbm.text.shown import cut
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Panel: TypeAlias = Callable[[Axes], None]
    """Draws into axes that are its own."""

FORMATS = (".png", ".svg", ".pdf")
MOST_PANELS = 12
"""Panels of one picture."""

LONGEST_LABEL = 80
"""Characters of a title or label; longer ones would leave no room for the panel."""

BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#666666"
"""Colours that people with colour-blindness tell apart (Okabe and Ito 2008)."""

SERIES = (BLUE, ORANGE, GREEN, RED, "#CC79A7", "#56B4E9")
CHI_95_2D = 2.447746830680816
"""Radius in standard deviations that holds 95 % of a normal distribution of the plane: sqrt(-2 ln 0.05)."""

_TITLE = 0.4
"""Inches of a title above all panels."""


def format_of(path: str | Path) -> str:
    """The format that the name of a file ends in, one of ``FORMATS``. Raises MbmError (plot-format)."""
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise MbmError(faults.plot_format(str(path), ", ".join(FORMATS)))
    return ending


def require_matplotlib() -> None:
    """Say that nothing can be drawn before the work is done. Raises MbmError (missing-extra)."""
    try:
        import matplotlib.figure  # noqa: F401 - only looked for
    except ImportError as error:
        raise MbmError(missing_extra("pictures", "plot")) from error


def titled(title: str, width: float, height: float) -> Figure:
    """A figure of its own (no global state), so many inches wide and high. Raises MbmError (missing-extra)."""
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(title, fontsize=11, fontweight="bold")
    return figure


def grid_of(count: int) -> tuple[int, int]:
    """Rows and columns for so many panels."""
    columns = 1 if count < 2 else 2 if count < 5 else 3
    return max(-(-count // columns), 1), columns


def panelled(title: str, panels: Sequence[Panel], inches: tuple[float, float], without: str) -> Figure:
    """A picture of panels, each so many ``inches`` wide and high; it says ``without`` where there are none.

    Raises MbmError (missing-extra) if Matplotlib is not installed.
    """
    rows, columns = grid_of(len(panels))
    figure = titled(title, inches[0] * columns, inches[1] * rows + _TITLE)
    for number, panel in enumerate(panels, start=1):
        panel(figure.add_subplot(rows, columns, number))
    if not panels:
        figure.text(0.5, 0.5, without, ha="center", va="center")
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


def finish(axes: Axes, *, legend: bool) -> None:
    """Grid, small ticks, no frame above and at the right."""
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    if legend:
        axes.legend(fontsize=7, framealpha=0.8, edgecolor="none")


def round_step(about: float) -> float:
    """The number 1, 2 or 5 times a power of ten that is next to ``about``, which is above 0."""
    power = 10.0 ** math.floor(math.log10(about))
    ratio = about / power
    return power * (1 if ratio < 1.5 else 2 if ratio < 3.5 else 5 if ratio < 7.5 else 10)


def figure_bytes(figure: Figure, ending: str) -> bytes:
    """A figure in the format ``ending``, without a date. Equal figures, equal bytes."""
    import matplotlib as mpl

    dateless = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(ending, {})
    stream = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "mbm"}), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a character that the font lacks, or of little room
        figure.savefig(stream, format=ending.removeprefix("."), dpi=130, metadata=dateless)
    return stream.getvalue()
