"""CSV files, read back by Python's own reader."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TextIO

import pytest
from hypothesis import given, strategies as st

from mbm.report.exports import text_cell, write_residuals, write_solves
from mbm.report.types import Result


def written(write: Callable[[Result, TextIO], None], result: Result) -> list[dict[str, str]]:
    stream = io.StringIO(newline="")
    write(result, stream)
    return list(csv.DictReader(io.StringIO(stream.getvalue(), newline="")))


def test_one_row_per_solve(epochs: Result) -> None:
    rows = written(write_solves, epochs)
    assert list(rows[0]) == ["epoch", "status", "cost", "dof", "sigma0", "chi2_p", "x", "x.sigma"]
    assert [row["epoch"] for row in rows] == ["1", "2", "3"]
    assert [row["status"] for row in rows] == ["converged", "not-converged", "unobservable"]
    assert [row["x"] for row in rows] == ["1.25", "", "-10.5"]
    assert rows[0]["x.sigma"] == "0.0123"


def test_scalars_have_the_names_and_units_of_the_document(tag_result: Result) -> None:
    """740 mm and 12.3 mm: one division away from the SI value, hence 1e-15."""
    (row,) = written(write_solves, tag_result)
    assert float(row["p[3]"]) == pytest.approx(740.0, rel=1e-15)
    assert float(row["p[3].sigma"]) == pytest.approx(12.3, rel=1e-15)
    assert row['offset["right"].sigma'] == ""
    assert row["k0.sigma"] == "0.0"
    assert row["height[2]"] == "0.75"


def test_keys_never_hide_other_columns(epochs: Result) -> None:
    solves = tuple(replace(solve, key={"status": "a,b", "x": 2.5}) for solve in epochs.solves[:1])
    (row,) = written(write_solves, replace(epochs, solves=solves))
    assert row["key.status"] == "a,b"
    assert row["key.x"] == "2.5"
    assert row["status"] == "converged"


def test_residuals(tag_result: Result) -> None:
    rows = written(write_residuals, tag_result)
    assert list(rows[0])[:5] == ["clause", "row", "value", "residual", "weight"]
    assert [row["row"] for row in rows] == ["1", "2", "3", "4"]
    assert [float(row["value"]) for row in rows] == [0.001, -0.002, 0.05, 0.0005]
    assert [row["used"] for row in rows] == ["true", "true", "false", "true"]
    assert rows[2]["file_row"] == "4"


def test_residuals_of_many_solves_name_the_key(epochs: Result) -> None:
    rows = written(write_residuals, epochs)
    assert [row["epoch"] for row in rows] == ["1"] * 4 + ["3"] * 4


FORMULAS = [
    "=1+1",
    "+1",
    "-1",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "\n=1",
    " =1",
    "\ufeff=1",
    "\u200b @x",
    "\uff1d1",
    '=1"',
    "=a,b",
]


@pytest.mark.parametrize("text", FORMULAS)
def test_texts_that_begin_as_formulas_do_get_an_apostrophe(text: str) -> None:
    assert text_cell(text) == f"'{text}"


@given(st.text(st.characters(exclude_categories=("Cs",))))
def test_a_cell_never_begins_as_a_formula_and_others_are_as_they_were(text: str) -> None:
    """The signs are those that OWASP lists under CSV injection (equals, plus, minus, at, tabulator, line breaks)."""
    cell = text_cell(text)
    assert cell[:1] not in set("=+-@\t\r\n")
    assert cell in (text, f"'{text}")
    assert cell == text or not text[0].isalnum()


@pytest.mark.parametrize("text", [*FORMULAS, "a\r=1", "a\n=1", 'a",=1', "a\r\n@x"])
def test_formulas_in_keys_names_and_headers(text: str, epochs: Result) -> None:
    """As another reader takes the file apart; numbers below zero stay numbers."""
    solves = tuple(
        replace(
            solve,
            key={text: text},
            estimates=tuple(replace(e, quantity=replace(e.quantity, name=text)) for e in solve.estimates),
            rows=partial(tuple, [replace(row, clause=text) for row in solve.rows()]),
        )
        for solve in epochs.solves
    )
    result = replace(epochs, solves=solves)
    for write in (write_solves, write_residuals):
        stream = io.StringIO(newline="")
        write(result, stream)
        header, *rows = csv.reader(io.StringIO(stream.getvalue(), newline=""))
        assert {len(row) for row in rows} == {len(header)}
        texts = [*header, *(cell for row in rows for cell in row if not _is_number(cell))]
        assert text_cell(text) in texts
        assert all(cell[:1] not in set("=+-@\t\r\n") for cell in texts if cell)
        assert "-10.5" in rows[-1] or "-0.002" in rows[1]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return cell[:1] != "+"
