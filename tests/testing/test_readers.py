"""The conformance suite of readers: ours conform, and readers with one fault each are refused with the reason."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbm.data.readers import READERS
from mbm.data.types import RawTable, Reader
from mbm.problem.tables import Column
from mbm.testing.readers import check_reader
from mbm.testing.requirement import NotConformingError

NUMBERS = [1.5, -2e-3, 1e300]
TEXTS = ["p", "q", "é"]
EXPECTED = {"x": NUMBERS, "name": TEXTS}


def _sound(name: str, folder: Path) -> Path:
    path = folder / f"sound.{name}"
    separator = {"csv": ",", "tsv": "\t"}.get(name)
    if separator is not None:
        rows = [f"{x!r}{separator}{text}" for x, text in zip(NUMBERS, TEXTS, strict=True)]
        path.write_text("\n".join([f"x{separator}name", *rows, ""]), encoding="utf-8")
    elif name == "json":
        path.write_text(json.dumps(EXPECTED), encoding="utf-8")
    else:
        np.savez(path, x=np.array(NUMBERS), name=np.array(TEXTS))
    return path


@pytest.mark.parametrize("name", READERS)
def test_our_readers_conform(name: str, tmp_path: Path) -> None:
    faulty = tmp_path / f"faulty.{name}"
    faulty.write_bytes(b"x\x00,,\nq")
    check_reader(READERS[name], _sound(name, tmp_path), EXPECTED, faulty=[faulty])


def _with(change: object) -> Reader:
    """The CSV reader with a fault: ``change`` makes another table of each."""
    csv = READERS["csv"]
    return replace(csv, read=lambda path: change(csv.read(path)))  # type: ignore[operator]


def _other_columns(table: RawTable, *columns: Column) -> RawTable:
    return replace(table, columns=columns)


@pytest.mark.parametrize(
    ("change", "promise"),
    [
        (lambda t: replace(t, sha256="0"), "digest"),
        (lambda t: replace(t, path="elsewhere.csv"), "names the path"),
        (lambda t: replace(t, file_rows=t.file_rows[::-1]), "ascend"),
        (lambda t: replace(t, file_rows=t.file_rows[:1]), "one for each row"),
        (lambda t: _other_columns(t, t.columns[0], t.columns[0]), "each its own"),
        (lambda t: _other_columns(t, *t.columns[::-1]), "the columns are"),
        (
            lambda t: _other_columns(
                t, replace(t.columns[0], numbers=t.columns[0].numbers * (1 + 1e-15)), t.columns[1]
            ),
            "digit",
        ),
        (lambda t: _other_columns(t, replace(t.columns[0], unit="m"), t.columns[1]), "no unit"),
        (lambda t: _other_columns(t, t.columns[0], replace(t.columns[1], texts=("p", "q", "e"))), "the texts are"),
    ],
)
def test_a_wrong_table_is_told(change: object, promise: str, tmp_path: Path) -> None:
    with pytest.raises(NotConformingError, match=promise):
        check_reader(_with(change), _sound("csv", tmp_path), EXPECTED)


def test_another_exception_is_told(tmp_path: Path) -> None:
    csv = READERS["csv"]

    def careless(path: Path) -> RawTable:
        if not path.read_bytes():
            raise ValueError("nothing there")
        return csv.read(path)

    with pytest.raises(NotConformingError, match=r"MbmError and nothing else, not (ValueError|FileNotFoundError)"):
        check_reader(replace(csv, read=careless), _sound("csv", tmp_path), EXPECTED)


def test_a_faulty_file_that_is_read_is_told(tmp_path: Path) -> None:
    path = _sound("csv", tmp_path)
    with pytest.raises(NotConformingError, match=r"it refuses sound\.csv"):
        check_reader(READERS["csv"], path, EXPECTED, faulty=[path])
