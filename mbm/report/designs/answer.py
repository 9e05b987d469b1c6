"""What a user has of a design: its numbers as text, JSON and table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbm.report.designs.document import candidate_columns, design_document
from mbm.report.designs.text import text
from mbm.report.designs.types import Planned
from mbm.values import dataclass

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class Design(Planned):
    """The accuracy to expect of an experiment, and what to measure next."""

    def __str__(self) -> str:
        return text(self)

    def document(self) -> dict[str, Any]:
        """The same as JSON holds it."""
        return design_document(self)

    def plot(self, path: str | Path | None = None) -> Figure:
        """The candidates over what tells them apart, and what rows are worth: a matplotlib figure; drawn into ``path``
        if one is given.

        Raises:
            MbmError: `plot-format`, `missing-extra`, `not-writable`.

        """
        from mbm.files.writing import write_whole
        from mbm.report.designs.plots import draw
        from mbm.report.plots import figure_bytes, format_of

        if path is not None:
            write_whole(path, figure_bytes(draw(self), format_of(path)))
        return draw(self)

    def table(self) -> Any:
        """The candidates, one row for each. A pandas frame, else a dict of lists."""
        columns = candidate_columns(self)
        try:
            from pandas import DataFrame
        except ImportError:
            return columns
        return DataFrame(columns)
