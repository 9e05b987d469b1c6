"""Values of the data stage: what a reader is, and what it hands over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbm.problem.tables import Column


@dataclass(frozen=True, slots=True, kw_only=True)
class RawTable:
    """A table as its origin has it: no column renamed, no unit applied, no row left out.

    ``path`` is what messages print, ``sha256`` the digest of the file's bytes in hexadecimal (None without a file).
    All columns have the length of ``file_rows``, which holds each row's number as in the origin (header = 1; formats
    without a header count their records from 1).
    """

    path: str
    sha256: str | None
    columns: tuple[Column, ...]
    file_rows: NDArray[np.int64] = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """A file format: its name in a data clause, the endings of its files (``.csv``, lower case) and how to read it.

    ``read`` takes the path as messages shall print it, reads the file once, and raises MbmError for whatever is wrong.
    """

    name: str
    extensions: tuple[str, ...]
    read: Callable[[Path], RawTable]
