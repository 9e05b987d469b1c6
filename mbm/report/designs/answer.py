"""What a user has of a design: its numbers as text, JSON and table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbm.problem.naming import key_text
from mbm.report.columns import Pad, aligned, laid_out, left, right
from mbm.report.designs.types import Candidate, ChosenSet, Planned
from mbm.report.digits import plain
from mbm.report.frames import frame
from mbm.report.solve_document import solve_key
from mbm.text.shown import Paint, Style, joined
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
        from mbm.report.figures import figure_bytes, format_of

        if path is not None:
            write_whole(path, figure_bytes(draw(self), format_of(path)))
        return draw(self)

    def table(self) -> Any:
        """The candidates, one row for each. A pandas frame, else a dict of lists."""
        return frame(candidate_columns(self))


def design_document(design: Planned) -> dict[str, Any]:
    """What ``--json`` writes: numbers in the units stated, null for what is not determined."""
    chosen = design.chosen
    return {
        "mbm": __version__,
        "problem": design.problem,
        "design": {
            "key": solve_key(design.key),
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


MOST_LINES = 20
"""Lines of a list that are shown unless all are asked for."""

DIGITS = 4
POINTS = {
    "given": "at the values given",
    "estimates": "at the estimates from what is measured",
    "start": "at the initial values",
}
CRITERIA = {"A": "least sum of variances", "c": "least variance", "D": "least determinant of the covariance"}
SAME_SIGMA = 1.0005
"""Growth of a standard deviation that is not worth a line."""


def text(design: Planned, *, color: bool = False, full: bool = False) -> str:
    """The tables, with a line break at the end; ``full`` shows every line."""
    paint = Paint(color)
    key = "".join(f", {name} = {key_text(value)}" for name, value in design.key.items())
    lines = [f"design of {paint(design.problem, Style.HEADING)}{key}, {POINTS[design.point]}", ""]
    lines += [*_expected(design, paint, full), ""]
    lines += [*_worth(design, paint, full), ""]
    if design.candidates:
        lines += [*_candidates(design, paint, full), ""]
    if design.chosen is not None:
        lines += [*_chosen(design), ""]
    return joined((line.rstrip() for line in lines), color=color).rstrip("\n") + "\n"


def _expected(design: Planned, paint: Paint, full: bool) -> Iterator[str]:
    rows = [
        (each.name, "±", "not determined" if each.sigma is None else _number(each.sigma), each.unit or "")
        for each in design.expected
    ]
    yield "standard deviations to expect" + (" without candidates" if design.candidates else "")
    yield from _table(rows, paint, full, (left, left, aligned, left))


def _worth(design: Planned, paint: Paint, full: bool) -> Iterator[str]:
    what = f" of {design.quantity}" if design.quantity is not None else ""
    yield f"rows that count most: by which factor the standard deviation{what} grows without them"
    rows = [
        (
            each.clause,
            "" if each.row is None else f"row {each.row}",
            "not determined without it" if each.growth is None else f"× {_number(each.growth)}",
            each.quantity if design.quantity is None else "",
        )
        for each in design.worth
        if each.growth is None or each.growth >= SAME_SIGMA or full
    ]
    yield from _table(rows, paint, full, (left, right, left, left))


def _candidates(design: Planned, paint: Paint, full: bool) -> Iterator[str]:
    yield f"{design.quantity or 'estimates'}: {_told(design, design)} without candidates; with one of them"
    rows = [_line(each, design) for each in sorted(design.candidates, key=_rank)]
    yield from _table(rows, paint, full, (right, left, left, right, left))


def _rank(each: Candidate) -> tuple[bool, float, int]:
    """The best first."""
    return not each.determined, each.sigma or 1 / (each.gain or 1), each.row


def _told(found: Planned | Candidate | ChosenSet, design: Planned) -> str:
    """The standard deviation to expect."""
    if not found.determined:
        return "not determined"
    return "determined" if found.sigma is None else f"± {_number(found.sigma)}{_unit(design)}"


def _unit(design: Planned) -> str:
    return f" {design.unit}" if design.unit else ""


def _line(each: Candidate, design: Planned) -> tuple[str, ...]:
    cells = ", ".join(f"{name} {_cell(value)}" for name, value in each.cells.items() if name != "cost")
    sigma = _told(each, design)
    if each.sigma is None and each.gain is not None:
        sigma = f"÷ {_number(each.gain)} on average"
    if each.observable:
        sigma += ", determines it" if each.determined else ", determines more"
    wanted = ""
    if design.wanted is not None:
        often = "never reached" if each.repeats is None else f"{each.repeats} × for {_number(design.wanted)}"
        wanted = often + ("" if each.repeats is None else _unit(design))
    priced = any(one.cost != 1.0 for one in design.candidates)
    return (str(each.row), cells, sigma, f"cost {_number(each.cost)}" if priced else "", wanted)


def _chosen(design: Planned) -> Iterator[str]:
    found = design.chosen
    if found is None:
        return
    how = "the best of all sets" if found.exhaustive else "found greedily, with exchanges"
    yield f"measure next ({CRITERIA[found.criterion]}; {how})"
    pairs = zip(found.rows, found.counts, strict=True)
    rows = ", ".join(f"{row} ({count} times)" if count > 1 else str(row) for row, count in pairs)
    what = f"{design.quantity or 'estimates'} {_told(found, design)}"
    yield f"  rows {rows or 'none'}; cost {_number(found.cost)}; {what}"


def _table(rows: Sequence[Sequence[str]], paint: Paint, full: bool, how: Sequence[Pad]) -> Iterator[str]:
    if not rows:
        yield paint("  none", Style.QUIET)
        return
    shown = rows if full else rows[:MOST_LINES]
    for line in laid_out(shown, how):
        yield "  " + "  ".join(line)
    if len(shown) < len(rows):
        yield paint(f"  … {len(rows) - len(shown)} more (-v shows all)", Style.QUIET)


def _number(value: float) -> str:
    return plain(value, DIGITS)


def _cell(value: object) -> str:
    return _number(value) if isinstance(value, float) else str(value)
