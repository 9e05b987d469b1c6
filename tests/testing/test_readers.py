"""The conformance suite of readers: ours conform, and readers with one fault each are refused with the reason."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbm.data.readers import READERS
from mbm.data.types import ManyReader, RawTable, Reader
from mbm.problem.tables import Column
from mbm.testing.readers import check_reader
from mbm.testing.requirement import NotConformingError

NUMBERS = [1.5, -2e-3, 1e300]
TEXTS = ["p", "q", "é"]
TABLES = ("csv", "tsv", "json", "npz", "parquet")
EXPECTED = {"x": NUMBERS, "name": TEXTS}


POSE = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
RECORDS = {
    "tum": (
        "# t x y z q\n1.5 1 2 3 0 0 0.6 0.8\n",
        dict(zip(POSE, [[1.5], [1], [2], [3], [0], [0], [0.6], [0.8]], strict=True)),
    ),
    "kitti": ("1 0 0 4 0 1 0 5 0 0 1 6\n", dict(zip(POSE, [[0], [4], [5], [6], [0], [0], [0], [1]], strict=True))),
    "matrix": ("1,0.5\n0.5,1\n", {"1": [1, 0.5], "2": [0.5, 1]}),
    "euroc": ("#t\n2000000000,1,2,3,1,0,0,0\n", dict(zip(POSE, [[2], [1], [2], [3], [0], [0], [0], [1]], strict=True))),
    "bal:points": ("0 2 0\n1 2 3\n4 5 6\n", {"point": [0, 1], "x": [1, 4], "y": [2, 5], "z": [3, 6]}),
    "g2o:vertices": ("VERTEX_SE2 3 1 2 0.5\n", {"id": [3], "x": [1], "y": [2], "theta": [0.5], "fixed": [0]}),
}
"""Formats with columns of their own: a sound file and what is in it."""

BOARDS = ("chessboard", "circles", "charuco", "aruco", "apriltag")
ELSEWHERE = ("colmap", "bundler", "opencv", "kalibr", "rosbag", *BOARDS, "contour", "image")
"""Folders, and files of several tables, which `tests/data` has tests for by these names; `tests/images` has images."""


def _sound(name: str, folder: Path) -> Path:
    path = folder / f"sound.{name}"
    separator = {"csv": ",", "tsv": "\t"}.get(name)
    if separator is not None:
        rows = [f"{x!r}{separator}{text}" for x, text in zip(NUMBERS, TEXTS, strict=True)]
        path.write_text("\n".join([f"x{separator}name", *rows, ""]), encoding="utf-8")
    elif name == "json":
        path.write_text(json.dumps(EXPECTED), encoding="utf-8")
    elif name == "parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
        parquet.write_table(pytest.importorskip("pyarrow").table(EXPECTED), path)
    else:
        np.savez(path, x=np.array(NUMBERS), name=np.array(TEXTS))
    return path


@pytest.mark.parametrize("name", RECORDS)
def test_our_readers_of_records_conform(name: str, tmp_path: Path) -> None:
    text, expected = RECORDS[name]
    path, faulty = tmp_path / "sound", tmp_path / "faulty"
    path.write_text(text)
    faulty.write_bytes(b"x\x00,,\nq")
    kind, _, part = name.partition(":")
    reader = READERS[kind]
    check_reader(reader.part(part) if isinstance(reader, ManyReader) else reader, path, expected, faulty=[faulty])


def test_every_reader_is_shown_to_conform() -> None:
    assert {*TABLES, *(name.partition(":")[0] for name in RECORDS), *ELSEWHERE} == set(READERS)


@pytest.mark.parametrize("name", TABLES)
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
