"""CSV files, read back by Python's own reader."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import replace
from typing import TextIO

import pytest

from mbm.report.exports import write_residuals, write_solves
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
