"""Panels → one picture, in bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

from mbm.report.plots import MOST_PANELS, figure_bytes, show_plainly
from mbm.report.view import faults
from mbm.report.view.model_panels import INCHES
from mbm.text.faults import missing_extra
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EDGE = 0.04
"""Share of a panel's height that is left free below and above: texts reach a little beyond the layout of a panel."""

Panel: TypeAlias = "Callable[[Axes], None]"


def require_matplotlib() -> None:
    """Say that nothing can be drawn before the work is done.

    Raises:
        MbmError: missing-extra.

    """
    try:
        import matplotlib  # noqa: F401 - only looked for
    except ImportError as error:
        raise MbmError(missing_extra("pictures", "plot")) from error


def page(panels: Sequence[Panel]) -> Figure:
    """A figure of its own with all panels, three to a row at most.

    Raises:
        MbmError: too-much-to-draw.

    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    if len(panels) > MOST_PANELS:
        raise MbmError(faults.too_much_to_draw(f"{MOST_PANELS} panels"))
    columns = 1 if len(panels) < 2 else 2 if len(panels) < 5 else 3
    rows = -(-len(panels) // columns)
    edge = EDGE / rows
    layout = ConstrainedLayoutEngine(rect=(0.0, edge, 1.0, 1.0 - 2.0 * edge))
    figure = Figure(figsize=(INCHES[0] * columns, INCHES[1] * rows), layout=layout)
    for number, panel in enumerate(panels, start=1):
        panel(figure.add_subplot(rows, columns, number))
    show_plainly(figure)
    return figure


def page_bytes(panels: Sequence[Panel], ending: str) -> bytes:
    """The page in the format ``ending``. Equal panels, equal bytes."""
    return figure_bytes(page(panels), ending)
