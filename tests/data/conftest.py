"""What the tests of the data stage share: data clauses, files, and the one way to load."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mbm.data.loader import load
from mbm.data.readers import READERS
from mbm.problem.tables import ColumnDeclaration, InlineTable, Table, TableDeclaration
from mbm.scales import Scale
from mbm.text.types import Diagnostic, MbmError, Source, Span

PROBLEM = Source(
    name="tag.mbm", text='(problem tag\n  (data d (csv "d.csv"))\n  (table (k v)\n    (1 2)\n    (3 4)))\n'
)


def span_of(text: str) -> Span:
    """The place of a piece of the problem's text."""
    start = PROBLEM.text.index(text)
    return Span(source=PROBLEM, start=start, end=start + len(text))


@pytest.fixture
def span() -> Callable[[str], Span]:
    return span_of


@pytest.fixture
def column() -> Callable[..., ColumnDeclaration]:
    def make(name: str, source: str | None = None, unit: str | None = None, factor: float = 1.0) -> ColumnDeclaration:
        return ColumnDeclaration(
            name=name, source=source or name, unit=unit, scale=Scale(factor), span=span_of('(data d (csv "d.csv"))')
        )

    return make


@pytest.fixture
def declare() -> Callable[..., TableDeclaration]:
    def make(source: str = "csv", path: str | None = "d.csv", name: str = "d", **options: Any) -> TableDeclaration:
        return TableDeclaration(name=name, source=source, path=path, span=span_of('(data d (csv "d.csv"))'), **options)

    return make


@pytest.fixture
def inline() -> Callable[..., InlineTable]:
    def make(columns: tuple[str, ...], *rows: tuple[float | str, ...]) -> InlineTable:
        places = (span_of("(1 2)"), span_of("(3 4)"))
        return InlineTable(columns=columns, rows=rows, spans=places[: len(rows)])

    return make


@pytest.fixture
def load_text(tmp_path: Path, declare: Callable[..., TableDeclaration]) -> Callable[..., Table]:
    """Write a file next to the problem and load the table of a data clause that names it."""

    def make(content: str | bytes, source: str = "csv", **options: Any) -> Table:
        name = f"d.{source}"
        (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
        declaration = declare(source, name, **options)
        return load(declaration, base=tmp_path, given={}, paths={}, sandbox=None, readers=READERS)

    return make


@pytest.fixture
def load_given(tmp_path: Path, declare: Callable[..., TableDeclaration]) -> Callable[..., Table]:
    """Load an external table from what the Python API is given."""

    def make(given: object, **options: Any) -> Table:
        declaration = declare("external", None, **options)
        return load(declaration, base=tmp_path, given={"d": given}, paths={}, sandbox=None, readers=READERS)

    return make


@pytest.fixture
def faults_of() -> Callable[..., tuple[Diagnostic, ...]]:
    """The diagnostics with which a call fails, or the use of the columns of the table that it gives."""

    def make(call: Callable[..., object], *arguments: Any, **options: Any) -> tuple[Diagnostic, ...]:
        with pytest.raises(MbmError) as caught:
            for column in call(*arguments, **options).columns.values():
                column.check()
        return caught.value.diagnostics

    return make
