"""The columns by which all tables are chosen from: ``column``, or ``table.column`` for the column of that name."""

from __future__ import annotations

from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.text.types import MbmError, Symbol


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
