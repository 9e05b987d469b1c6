"""Result → CSV: a row for each solve, scalar estimate, or scalar residual. Floats with the digits that give them back.

Spreadsheets compute what begins as a formula does. Texts of a problem or of its data, in cells or in the header, are
therefore written by `text_cell`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite
from typing import TextIO

import numpy as np

from mbm.data.writers import DelimitedLines
from mbm.report.elements import Scalar, own_name, plain_key, scalars, unit_text
from mbm.report.intervals import intervals
from mbm.report.numbers import USUAL
from mbm.report.solve_columns import solve_columns
from mbm.report.types import DerivedValue, Estimate, Key, Result, SolveReport

SOLVE_COLUMNS = ("status", *USUAL)
INTERVAL_COLUMNS = ("dof", "k", "U", "low", "high", "interval_kind")
ESTIMATE_COLUMNS = ("name", "key", "component", "value", "sigma", "unit", "kind", "scalar", *INTERVAL_COLUMNS)
RESIDUAL_COLUMNS = ("clause", "row", "value", "residual", "weight", "component", "file_row", "used")


FORMULAS = "=+-@\uff1d\uff0b\uff0d\uff20"
"""Signs with which formulas begin in spreadsheets; the last four are their full-width forms."""


def text_cell(text: str) -> str:
    """A text that no spreadsheet takes for a formula: before a sign of `FORMULAS`, a tabulator or a line break that it
    begins with, an apostrophe.

    Blanks and what is invisible do not count as a beginning, as some programs leave them out.
    """
    seen = next((character for character in text if character.isprintable() and not character.isspace()), "")
    return f"'{text}" if text[:1] in ("\t", "\r", "\n") or (seen and seen in FORMULAS) else text


def write_solves(result: Result, stream: TextIO) -> None:
    """One row for each solve: key columns, ``SOLVE_COLUMNS``, then ``name`` and ``name.sigma`` of every scalar
    (``name``, ``name.low`` and ``name.high`` where there are guaranteed bounds).

    Scalars are those of the estimates, then of the derived values, by their names in the document (``p[1]``), in the
    unit of their quantity. Cells are empty where there is no number. A key column that is called as another column is
    written ``key.NAME``. Open ``stream`` with ``newline=""``.
    """
    found = solve_columns(result.solves)
    columns = [
        (scalar.name + end, numbers)
        for scalar in found.scalars
        for end, numbers in (("", scalar.values), *scalar.sides)
    ]
    taken = {*SOLVE_COLUMNS, *(name for name, _ in columns)}
    keys = found.key_names
    lines = DelimitedLines(stream)
    lines.row([*key_titles(keys, taken), *SOLVE_COLUMNS, *(text_cell(name) for name, _ in columns)])
    cells = [[key_cell(key.get(name)) for key in found.keys] for name in keys]
    cells.append([status.value for status in found.statuses])
    cells += [[number_cell(number) for number in numbers] for numbers in found.fits.values()]
    cells += [[number_cell(number) for number in numbers.tolist()] for _, numbers in columns]  # NaN: not there
    lines.rows(zip(*cells, strict=True))


def write_estimates(result: Result, stream: TextIO) -> None:
    """One row for each scalar estimated or derived: key columns where there are any, then ``ESTIMATE_COLUMNS``.

    ``name`` is that of the quantity, ``key`` that of the member of a family, ``component`` what tells its scalars apart
    (``[1]``, ``rot[1]``), ``scalar`` all of it as the covariance is named; ``kind`` is `estimate`, `fixed`, `at-bound`
    or `derived`. Value and sigma are in ``unit``, cells empty where there is no number. ``INTERVAL_COLUMNS`` are as
    documents have them: dof is empty where there are infinitely many; guaranteed bounds are low and high without the
    others. Open ``stream`` with ``newline=""``.
    """
    keys = _key_columns(result.solves)
    lines = DelimitedLines(stream)
    lines.row([*key_titles(keys, set(ESTIMATE_COLUMNS)), *ESTIMATE_COLUMNS])
    for solve in result.solves:
        key = _key_cells(solve.key, keys)
        items: list[Estimate | DerivedValue] = [*solve.estimates, *solve.derived]
        for item in items:
            found = list(scalars(item))
            cells = list(_interval_cells(item, solve.coverage))
            each = len(found) // max(len(item.keys), 1) if item.keys is not None else len(found)
            for place, scalar in enumerate(found):
                member = None if item.keys is None else item.keys[place // each]
                beginning = own_name(item.quantity, member)
                lines.row(
                    [
                        *key,
                        text_cell(item.quantity.name),
                        key_cell(member),
                        scalar.name.removeprefix(beginning).removeprefix("."),
                        number_cell(scalar.value),
                        number_cell(scalar.sigma),
                        text_cell(unit_text(scalar.quantity)),
                        _kind(scalar),
                        text_cell(scalar.name),
                        *(
                            cells[place]
                            if scalar.bounds is None
                            else ["", "", "", *map(number_cell, scalar.bounds), ""]
                        ),
                    ]
                )


def _interval_cells(item: Estimate | DerivedValue, coverage: float) -> Iterator[list[str]]:
    """The cells of ``INTERVAL_COLUMNS`` of each scalar."""
    found = intervals(item, coverage)
    parts = (found.dof, found.k, found.expanded, found.low, found.high)
    for *numbers, kind in zip(*(np.ravel(part).tolist() for part in (*parts, found.names())), strict=True):
        yield [*map(number_cell, numbers), kind or ""]


def _kind(scalar: Scalar) -> str:
    if scalar.derived:
        return "derived"
    return "fixed" if scalar.fixed else "at-bound" if scalar.at_bound else "estimate"


def write_residuals(result: Result, stream: TextIO) -> None:
    """One row for each scalar residual: key columns where there are any, then ``RESIDUAL_COLUMNS``.

    ``row`` counts the rows of the unfiltered table from 1, ``file_row`` as in the file; ``value`` is MODEL − MEASURED
    in SI, ``residual`` normalised. Open ``stream`` with ``newline=""``.
    """
    keys = _key_columns(result.solves)
    lines = DelimitedLines(stream)
    lines.row([*key_titles(keys, set(RESIDUAL_COLUMNS)), *RESIDUAL_COLUMNS])
    for solve in result.solves:
        key = _key_cells(solve.key, keys)
        for row in solve.rows():
            lines.row(
                [
                    *key,
                    text_cell(row.clause),
                    number_cell(row.row),
                    number_cell(row.value),
                    number_cell(row.residual),
                    number_cell(row.weight),
                    row.component,
                    number_cell(row.file_row),
                    "true" if row.used else "false",
                ]
            )


def _key_columns(solves: Sequence[SolveReport]) -> list[str]:
    return list(dict.fromkeys(name for solve in solves for name in solve.key))


def key_titles(keys: Iterable[str], taken: set[str]) -> list[str]:
    """The names of key columns, beside columns called as in ``taken``."""
    return [f"key.{name}" if name in taken else text_cell(name) for name in keys]


def _key_cells(key: Mapping[str, Key], columns: Iterable[str]) -> list[str]:
    return [key_cell(key.get(name)) for name in columns]


def key_cell(key: Key | None) -> str:
    """A key as a cell of a CSV file."""
    cell = None if key is None else plain_key(key)
    return "" if cell is None else text_cell(cell) if isinstance(cell, str) else str(cell)


def number_cell(number: float | int | None) -> str:
    """A number as a cell of a CSV file, empty where there is none."""
    if number is None or not isfinite(number):
        return ""
    return str(number) if isinstance(number, int) else repr(float(number))
