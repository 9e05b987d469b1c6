"""Panels → one picture, in bytes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from mbm.report.figures import MOST_PANELS, figure_bytes, grid_of, show_plainly
from mbm.report.view import faults
from mbm.report.view.model_panels import INCHES
from mbm.text.types import MbmError

if TYPE_CHECKING:
    from mbm.report.figures import Panel

EDGE = 0.04
"""Share of a panel's height that is left free below and above: texts reach a little beyond the layout of a panel."""


def page_bytes(panels: Sequence[Panel], ending: str) -> bytes:
    """A page with all panels, three to a row at most, in the format ``ending``. Equal panels, equal bytes.

    Raises:
        MbmError: too-much-to-draw.

    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    if len(panels) > MOST_PANELS:
        raise MbmError(faults.too_much_to_draw(f"{MOST_PANELS} panels"))
    rows, columns = grid_of(len(panels))
    edge = EDGE / rows
    layout = ConstrainedLayoutEngine(rect=(0.0, edge, 1.0, 1.0 - 2.0 * edge))
    figure = Figure(figsize=(INCHES[0] * columns, INCHES[1] * rows), layout=layout)
    for number, panel in enumerate(panels, start=1):
        panel(figure.add_subplot(rows, columns, number))
    show_plainly(figure)
    return figure_bytes(figure, ending)
