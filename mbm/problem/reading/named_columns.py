"""The columns by which all tables are chosen from: ``column``, or ``table.column`` for the column of that name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.problem.tables import Table
from mbm.text.types import MbmError, Sequence, Symbol


def named_column(work: Workspace, form: Symbol) -> str:
    """The name of the column.

    Raises:
        MbmError: no table has it, or not the one that is named.

    """
    if any(form.name in table.columns for table in work.tables.values()):
        return form.name
    name, _, column = form.name.partition(".")
    table = work.tables.get(name) if column else None
    if table is None:
        every = tuple(dict.fromkeys(c for each in work.tables.values() for c in each.columns))
        raise MbmError(faults.unknown_column(form.span, form.name, "any table", every))
    if column not in table.columns:
        raise MbmError(faults.unknown_column(form.span, column, name, tuple(table.columns)))
    return column


def names_in(clauses: Iterable[Sequence], head: str) -> tuple[str, ...]:
    """The names of columns in the clauses with a head, as they are written."""
    return tuple(form.name for c in clauses if c.head == head for form in c.items[1:] if isinstance(form, Symbol))


def meant(names: Iterable[str], tables: Mapping[str, Table]) -> tuple[str, ...]:
    """What columns are called in ``tables``, the pairs not yet among them: ``run`` for ``P.A.run``.

    A joined column keeps the name before it; names of no column stay as they are.
    """
    known = {column for table in tables.values() for column in table.columns}
    return tuple(next((end for end in _ends(name) if end in known), name) for name in names)


def _ends(name: str) -> Iterable[str]:
    """The name, and what is left of it without the first part, the first two …"""
    parts = name.split(".")
    return (".".join(parts[i:]) for i in range(len(parts)))
