"""Equations with a shift of each component, by which what was measured, or known before, differs in a trial.

Model − measured becomes model − (measured − shift): an equation h states the standard deviation of h, whatever it is
made of, so that every equation can be shifted. Shifts are columns of the block's table, or of one row that all blocks
without a table share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.expression.algebra import add
from mbm.expression.nodes import Apply, Column, Expression, Operation, RowChoice
from mbm.problem.tables import Column as TableColumn
from mbm.problem.tables import Provenance, Table
from mbm.problem.types import Block, BlockRole, Equation, EquationCase, Problem

SHIFTS = "shift table"
"""The table of blocks without one; no table of a file has a blank in its name."""

SHIFTED = (BlockRole.OBSERVATION, BlockRole.PRIOR)
"""What is drawn."""


def shift_name(block: int, equation: int, component: int) -> str:
    """The column with the shifts of a component; no column of an equation is called so."""
    return f"shift {block} {equation} {component}"


def with_shifts(problem: Problem) -> Problem:
    """The problem with shifted observations and priors."""
    return replace(problem, blocks=tuple(_block(number, block) for number, block in enumerate(problem.blocks)))


def shifted_tables(problem: Problem, tables: Mapping[str, Table]) -> dict[str, Table]:
    """The tables with columns for the shifts of `with_shifts`, all of them zero."""
    names: dict[str, dict[str, None]] = {SHIFTS: {}}
    for number, block in enumerate(problem.blocks):
        if block.role in SHIFTED:
            own = names.setdefault(SHIFTS if block.table is None else block.table, {})
            for case in block.cases:
                own.update(dict.fromkeys(_names(number, case)))
    found = dict(tables)
    for name, columns in names.items():
        table = tables[name] if name != SHIFTS else _one_row()
        zero = np.zeros(len(table))
        added = {each: TableColumn(name=each, numbers=zero) for each in columns}
        found[name] = replace(table, columns={**table.columns, **added})
    return found


def _names(number: int, case: EquationCase) -> tuple[str, ...]:
    return tuple(
        shift_name(number, place, k) for place, each in enumerate(case.equations) for k in range(len(each.components))
    )


def _block(number: int, block: Block) -> Block:
    if block.role not in SHIFTED:
        return block
    cases = tuple(
        replace(
            case,
            equations=tuple(
                _equation(equation, number, place, block.table) for place, equation in enumerate(case.equations)
            ),
        )
        for case in block.cases
    )
    return replace(block, cases=cases)


def _equation(equation: Equation, block: int, place: int, table: str | None) -> Equation:
    row = RowChoice.FIRST if table is None else RowChoice.EACH
    shifts = (
        Column(SHIFTS if table is None else table, shift_name(block, place, k), row, equation.span)
        for k in range(len(equation.components))
    )
    shifted = tuple(_shifted(node, shift) for node, shift in zip(equation.components, shifts, strict=True))
    return replace(equation, components=shifted)


def _shifted(node: Expression, shift: Column) -> Expression:
    """The component with its shift; a difference of angles is wrapped behind it."""
    if isinstance(node, Apply) and node.operation is Operation.WRAP:
        return replace(node, arguments=(add(node.arguments[0], shift),))
    return add(node, shift)


def _one_row() -> Table:
    """The table of blocks without one, without columns."""
    none = Provenance(path=SHIFTS, sha256=None, rows=1, file_rows=np.arange(1, 2))
    return Table(name=SHIFTS, columns={}, rows=np.arange(1, 2), provenance=none)
