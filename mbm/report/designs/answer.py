"""What a user has of a design: its numbers as text, JSON and table."""

from __future__ import annotations

from typing import Any

from mbm.report.designs.document import candidate_columns, design_document
from mbm.report.designs.text import text
from mbm.report.designs.types import Planned
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Design(Planned):
    """The accuracy to expect of an experiment, and what to measure next."""

    def __str__(self) -> str:
        return text(self)

    def document(self) -> dict[str, Any]:
        """The same as JSON holds it."""
        return design_document(self)

    def table(self) -> Any:
        """The candidates, one row for each. A pandas frame, else a dict of lists."""
        columns = candidate_columns(self)
        try:
            from pandas import DataFrame
        except ImportError:
            return columns
        return DataFrame(columns)
