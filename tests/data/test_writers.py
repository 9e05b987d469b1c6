"""What is written reads back as the same columns, to the last bit, in every format that can be written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mbm.data.readers import READERS
from mbm.data.writers import WRITERS
from mbm.problem.tables import Column

NUMBERS = np.array([0.1, -1 / 3, 1e300, 5e-324, 0.0, 3.0, 2.0**60, np.nan, 123456789.0])
COLUMNS = (
    Column(name="x", numbers=NUMBERS),
    Column(name="with space, and comma", numbers=np.arange(9.0)),
    Column(
        name="part",
        texts=("a", 'quote " here', "comma, here", "Größe", "1x", "b c", "line\nbreak", "a\rb", "=1+1"),
    ),
    Column(name="@name\rof two lines", texts=("-1", "@a", "+b", "'=c", "\x1b[2J", "\u202ed", ",", ";", "x")),
)

TABLES = [name for name in WRITERS if name != "matrix"]
"""Formats that know the names of columns, and texts."""


@pytest.mark.parametrize("name", TABLES)
def test_what_is_written_reads_back(name: str, tmp_path: Path) -> None:
    path = tmp_path / f"table.{name}"
    path.write_bytes(WRITERS[name](COLUMNS))
    found = {column.name: column for column in READERS[name].read(path).columns}
    assert list(found) == [column.name for column in COLUMNS]
    for column in COLUMNS:
        if column.texts is not None:
            assert found[column.name].texts == column.texts
        else:
            np.testing.assert_array_equal(np.asarray(found[column.name].numbers), np.asarray(column.numbers))


def test_whole_numbers_are_written_without_a_point() -> None:
    numbers = np.array([-0.5, 1000.0, -123456789.0, 2.0**53 - 1, 2.0**53])
    text = WRITERS["csv"]([Column(name="x", numbers=numbers)]).decode()
    assert text.split() == ["x", "-0.5", "1000", "-123456789", "9007199254740991", "9007199254740992.0"]


@pytest.mark.parametrize("name", TABLES)
def test_the_same_columns_give_the_same_bytes(name: str) -> None:
    assert WRITERS[name](COLUMNS) == WRITERS[name](COLUMNS)


def test_a_matrix_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "matrix.csv"
    rows = np.array([[1.0, -1 / 3], [5e-324, 1e300]])
    path.write_bytes(WRITERS["matrix"]([Column(name=str(k), numbers=column) for k, column in enumerate(rows.T)]))
    found = READERS["matrix"].read(path).columns
    np.testing.assert_array_equal(np.column_stack([column.numbers for column in found]), rows)
