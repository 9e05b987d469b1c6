"""Result → a picture: maps, data against model, normalised residuals, error ellipses, estimates over the key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.files.writing import checked_target, write_whole
from mbm.report import panels
from mbm.report.budgets.text import budget_panels
from mbm.report.figures import MOST_PANELS, figure_bytes, format_of, panelled
from mbm.report.map_panels import map_panels
from mbm.report.types import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from mbm.report.figures import Panel

REGIONS, RESIDUALS = "joint regions", "residuals of all solves, by row"
_PANEL_INCHES = (4.6, 3.4)


def panels_of(result: Result) -> Mapping[str, Iterator[Panel]]:
    """The panels of a result by what they show, in the order of a picture; each is made when it is taken."""
    only = result.solves if len(result.solves) == 1 else ()
    return {
        "guaranteed bounds": (each for solve in only for each in panels.enclosure_panels(solve)),
        "map": (each for solve in result.solves[:1] for found in solve.maps() for each in map_panels(found)),
        "data and model": panels.data_panels(result),
        "estimates": panels.estimate_panels(result),
        REGIONS: panels.region_panels(result),
        RESIDUALS: panels.residual_panels(result),
    }


def draw(result: Result) -> Figure:
    """The picture of a result as a Matplotlib figure of its own (no global state); where nothing was measured, of what
    makes the uncertainty.

    Raises MbmError (missing-extra) if Matplotlib is not installed.
    """
    found = list(islice(chain.from_iterable(panels_of(result).values()), MOST_PANELS))
    shown = found or list(islice(budget_panels(result), MOST_PANELS))
    return panelled(result.problem, shown, _PANEL_INCHES, "nothing was solved")


def save(result: Result, path: str | Path) -> None:
    """Draws the result into a file, in the format that its name ends in.

    Raises:
        MbmError: missing-extra, plot-format, not-writable; would-overwrite: the result was made from that file.

    """
    ending = format_of(path)
    checked_target(path, reads=result.reads)
    write_whole(path, figure_bytes(draw(result), ending), reads=result.reads)
