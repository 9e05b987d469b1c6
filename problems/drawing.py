"""What pictures are drawn with: answers, tables and colours."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

import mbm

HERE = Path(__file__).parent
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#999999"


def solve(folder: str, name: str) -> Any:
    """The answer to a problem."""
    return mbm.load(HERE / folder / f"{folder}.mbm").named(name).solve()


def rows(folder: str, file: str) -> list[dict[str, str]]:
    """The rows of a data file."""
    with (HERE / folder / file).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def column(table: list[dict[str, str]], name: str) -> Any:
    """A column as numbers."""
    return np.array([float(r[name]) for r in table])
