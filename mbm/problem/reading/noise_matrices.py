"""``:correlation (matrix "file.csv")``: the file is read as a table that no clause can name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mbm.problem.reading.sources import DataClause
from mbm.problem.tables import TableDeclaration
from mbm.text.types import Form, Keyword, Sequence, Text

READER = "matrix"


def matrix_path(form: Form | None) -> Text | None:
    """The path in ``(matrix "path")``; None where a form is anything else."""
    if isinstance(form, Sequence) and form.head == READER and len(form.items) == 2 and isinstance(form.items[1], Text):
        return form.items[1]
    return None


def matrix_table(path: Text) -> str:
    """What the table of a file is called."""
    return f"matrix {path.value}"


def matrix_forms(clause: Sequence) -> Iterator[tuple[Sequence, Text]]:
    """The matrices that an ``observe`` clause names, with their paths."""
    for option, form in zip(clause.items, clause.items[1:], strict=False):
        path = matrix_path(form) if isinstance(option, Keyword) and option.name == "correlation" else None
        if path is not None and isinstance(form, Sequence):
            yield form, path


def matrices(clauses: Iterable[Sequence]) -> dict[str, DataClause]:
    """Their tables."""
    return {
        matrix_table(path): DataClause(
            declaration=TableDeclaration(name=matrix_table(path), source=READER, path=path.value, span=path.span),
            joins=(),
            where=None,
        )
        for clause in clauses
        for _, path in matrix_forms(clause)
    }
