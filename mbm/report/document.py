"""Result → the result document of CONTRACT §2: a tree of dictionaries, lists, texts and numbers that JSON can hold."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from pathlib import PurePath
from typing import Any

from mbm.report.blocks import ManyReports
from mbm.report.solve_document import solve_document
from mbm.report.types import (
    Result,
    SolveReport,
)
from mbm.text.render import as_json


def document(result: Result) -> dict[str, Any]:
    """The document of a result; keys stand in the contract's order, so equal results give equal texts.

    Numbers are in the units of their quantities, undefined ones None with a ``reason`` (or ``reasons``) beside them.
    What belongs to later versions (gauges) has its key and an empty value.
    """
    written = lazy_document(result)
    written["solves"] = [_copied(solve) for solve in written["solves"]]
    return written


def _copied(entry: Any) -> Any:
    """A tree of dictionaries and lists of its own, so that solves share nothing that a caller may change."""
    if type(entry) is dict:
        return {name: _copied(each) for name, each in entry.items()}
    return [_copied(each) for each in entry] if type(entry) is list else entry


def lazy_document(result: Result) -> dict[str, Any]:
    """The document, the solves of which are made while one goes through them: to be written, and not to be changed."""
    return {
        "mbm": result.version,
        "file": result.file,
        "problem": result.problem,
        "status": result.status.value,
        "seed": result.seed,
        "options": {name: plain(value) for name, value in result.options.items()},
        "inputs": [{"path": entry.path, "sha256": entry.sha256, "rows": entry.rows} for entry in result.inputs],
        "diagnostics": [as_json(diagnostic) for diagnostic in result.diagnostics],
        "solves": _Solves(result.solves),
    }


class _Solves(Sequence[dict[str, Any]]):
    """The documents of solves, made anew each time that one goes through them."""

    def __init__(self, solves: Sequence[SolveReport]) -> None:
        self._solves = solves

    def __len__(self) -> int:
        return len(self._solves)

    def __getitem__(self, index: Any) -> Any:
        return list(self)[index]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        if not isinstance(self._solves, ManyReports):
            yield from map(solve_document, self._solves)
            return
        # Loaded where there are many solves only, so that the others start at once.
        from mbm.report.block_documents import block_documents

        yield from self._solves.each(block_documents, solve_document)


def plain(value: object) -> Any:
    """A value as JSON holds it: what is not finite is null."""
    if isinstance(value, Enum):
        return plain(value.value)
    if isinstance(value, Mapping):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(entry) for entry in value]
    if isinstance(value, PurePath):
        return value.as_posix()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)
