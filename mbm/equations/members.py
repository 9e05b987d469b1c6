"""Which members of a family the rows of a table speak of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np

from mbm.equations.layout import Entry
from mbm.equations.types import Indices
from mbm.expression.nodes import ColumnMember, LiteralMember, Member
from mbm.expression.rows import RowChoice, chosen_place
from mbm.problem import faults as problem_faults
from mbm.problem.rows import Positions
from mbm.problem.tables import ROW, CellKey, Table
from mbm.text.types import MbmError

MemberPicker: TypeAlias = Callable[[Entry, Member, Table | None, Positions | None, Mapping[str, Table]], Indices | int]
"""Numbers of members as `picked_members` gives them."""


def picked_members(
    entry: Entry, member: Member, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> Indices | int:
    """Numbers (from 0) of the members that ``member`` names, for each row at ``positions``.

    Raises:
        MbmError: a key that is no member's.

    """
    where = f"the family `{entry.unknown.name}`"
    if isinstance(member, LiteralMember):
        literal = entry.index.get(member.key)
        if literal is None:
            raise MbmError(problem_faults.dangling_key(entry.unknown.span, member.key, where, None, None))
        return literal
    cells = member_cells(member, table, positions, tables)
    found = list(map(entry.index.get, cells))
    if None in found:
        row = found.index(None)
        if table is None or positions is None or member.row is not RowChoice.EACH:
            raise MbmError(problem_faults.dangling_key(entry.unknown.span, cells[row], where, None, None))
        place = table.place(int(positions[row]), member.column)
        raise MbmError(problem_faults.dangling_key(place, cells[row], where, None, entry.unknown.span))
    return np.array(found, dtype=np.int64)


def member_cells(
    member: ColumnMember, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> list[CellKey]:
    """The keys that ``member`` names, for each row at ``positions``."""
    if member.row is RowChoice.EACH and table is not None and positions is not None:
        if member.column == ROW and ROW not in table.columns:
            return [float(r) for r in table.rows[positions]]
        keys = table.keys(member.column)
        return list(map(keys.__getitem__, positions.tolist()))
    if member.row is RowChoice.EACH:
        message = f"a key of `{member.table}.{member.column}` is wanted where there is no row"
        raise TypeError(message)
    keys = tables[member.table].keys(member.column)
    if not keys:
        raise MbmError(problem_faults.aggregate_of_nothing(None, member.table))
    return [keys[chosen_place(member.row, len(keys))]]
