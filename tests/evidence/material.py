"""Where the reference answers and real measurements lie, and how tests turn arrays into files beside a problem."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

import mbm


def shared(*parts: str) -> Path:
    """A file or folder of the shared material: below MBM_SHARED, or beside the checkout. Skips the test without it."""
    root = Path(os.environ.get("MBM_SHARED", Path(__file__).parents[2].parent / "shared"))
    path = root.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"not here: {path} (set MBM_SHARED)")
    return path


def shared_json(*parts: str) -> Any:
    return json.loads(shared(*parts).read_text())


def write_table(path: Path, columns: Mapping[str, Sequence[object]]) -> None:
    """A CSV file; floats with all their digits."""
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow([repr(float(c)) if isinstance(c, float) else c for c in row])


def write_problem(folder: Path, text: str, tables: Mapping[str, Mapping[str, Sequence[object]]]) -> Path:
    """``text`` as ``problem.mbm`` with its tables beside it."""
    for name, columns in tables.items():
        write_table(folder / f"{name}.csv", columns)
    path = folder / "problem.mbm"
    path.write_text(text)
    return path


def loaded(folder: Path, text: str, **tables: Mapping[str, Sequence[object]]) -> Any:
    """``write_problem``, and the file loaded."""
    return mbm.load(write_problem(folder, text, tables))
