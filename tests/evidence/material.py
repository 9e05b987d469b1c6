"""Where data and real measurements lie, and how tests turn arrays into files beside a problem."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mbm

ROOT = Path(__file__).parents[2]
PROBLEMS = ROOT / "problems"
EXAMPLES = ROOT / "tests" / "problems" / "examples"


def measured(*parts: str) -> Path:
    """A file or folder of measurements made by others, which are too large to be typed in or not ours to give away.

    Below MBM_SHARED, or beside the checkout; skips the test without it.
    """
    path = Path(os.environ.get("MBM_SHARED", ROOT.parent / "shared")).joinpath("data", *parts)
    if not path.exists():
        pytest.skip(f"real measurements that are not here: {parts[0]} (set MBM_SHARED)")
    return path


def read_table(path: Path) -> dict[str, list[str]]:
    """The columns of a CSV file, as texts."""
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {name: [row[name] for row in rows] for name in rows[0]}


def read_numbers(path: Path) -> dict[str, NDArray[np.float64]]:
    """The columns of a CSV file of numbers."""
    return {name: np.array([float(cell) for cell in cells]) for name, cells in read_table(path).items()}


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
