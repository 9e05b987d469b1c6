"""What a user has of a design: its numbers as text, JSON and table."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbm.report.designs.text import text
from mbm.report.designs.types import Planned
from mbm.values import dataclass
from mbm.version import __version__

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


def design_document(design: Planned) -> dict[str, Any]:
    """What ``--json`` writes: numbers in the units stated, null for what is not determined."""
    chosen = design.chosen
    return {
        "mbm": __version__,
        "problem": design.problem,
        "design": {
            "point": design.point,
            "expected": {
                each.name: {"value": each.value, "sigma": each.sigma, "unit": each.unit} for each in design.expected
            },
            "free": list(design.free),
            "rows": [
                {"clause": each.clause, "row": each.row, "quantity": each.quantity, "growth": each.growth}
                for each in design.worth
            ],
            "quantity": design.quantity,
            "unit": design.unit,
            "determined": design.determined,
            "sigma": design.sigma,
            "wanted": design.wanted,
            "candidates": [
                {
                    "row": each.row,
                    "cells": dict(each.cells),
                    "cost": each.cost,
                    "determined": each.determined,
                    "sigma": each.sigma,
                    "gain": each.gain,
                    "observable": each.observable,
                    "repeats": each.repeats,
                }
                for each in design.candidates
            ],
            "chosen": None
            if chosen is None
            else {
                "criterion": chosen.criterion,
                "rows": list(chosen.rows),
                "counts": list(chosen.counts),
                "cost": chosen.cost,
                "determined": chosen.determined,
                "sigma": chosen.sigma,
                "sigmas": list(chosen.sigmas),
                "objective": chosen.objective,
                "exhaustive": chosen.exhaustive,
            },
        },
        "diagnostics": [
            {"severity": each.severity.value, "code": each.code.name, "message": each.message} for each in design.notes
        ],
    }


def candidate_columns(design: Planned) -> dict[str, list[Any]]:
    """The candidates, column by column: their cells, then what is known of them; ``chosen`` counts how often."""
    chosen = design.chosen
    times = dict(zip(chosen.rows, chosen.counts, strict=True)) if chosen is not None else {}
    names = list(design.candidates[0].cells) if design.candidates else []
    columns: dict[str, list[Any]] = {"row": [each.row for each in design.candidates]}
    columns |= {name: [each.cells[name] for each in design.candidates] for name in names if name not in columns}
    columns |= {
        "cost": [each.cost for each in design.candidates],
        "sigma": [each.sigma for each in design.candidates],
        "gain": [each.gain for each in design.candidates],
        "observable": [each.observable for each in design.candidates],
        "repeats": [each.repeats for each in design.candidates],
        "chosen": [times.get(each.row, 0) for each in design.candidates],
    }
    return columns


def design_rows(design: Planned) -> str:
    """What ``--csv`` writes: the candidates; without any, what is to be expected."""
    import csv
    from io import StringIO

    if design.candidates:
        columns = candidate_columns(design)
    else:
        columns = {
            name: [getattr(each, name) for each in design.expected] for name in ("name", "value", "sigma", "unit")
        }
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(
        ["" if cell is None else str(cell).lower() if isinstance(cell, bool) else cell for cell in row]
        for row in zip(*columns.values(), strict=True)
    )
    return stream.getvalue()
