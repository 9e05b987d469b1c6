"""Rows whose equations use measured values with errors: found in bound groups, or in a problem that only is checked."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.types import Indices, Mask
from mbm.equations.whitening import whitener
from mbm.expression.nodes import Column, leaves
from mbm.problem.checks import used_rows
from mbm.problem.rows import rows_of
from mbm.problem.tables import Table
from mbm.problem.types import Block, EquationCase, Problem
from mbm.symbolic.types import ColumnInput
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UncertainRows:
    """Rows of one block with the same equations.

    ``owner`` is the block, ``positions`` (from 0) are those in its table, ``columns`` the uncertain inputs, ``noisy``
    (rows, outputs) says which equations have noise of their own, ``lossy`` that a loss acts on them.
    """

    owner: int
    positions: Indices
    columns: tuple[ColumnInput, ...]
    noisy: Mask
    lossy: bool


def rows_of_groups(groups: tuple[Group, ...]) -> dict[int, UncertainRows]:
    """The rows with uncertain values, by the number of their group."""
    found = {}
    for number, group in enumerate(groups):
        corrections = group.kernel.corrections
        if corrections is None:
            continue
        inputs = [group.kernel.parameters[column] for column in corrections.columns]
        found[number] = UncertainRows(
            owner=group.kernel.owner,
            positions=group.positions if group.positions is not None else np.zeros(1, dtype=np.int64),
            columns=tuple(each for each in inputs if isinstance(each, ColumnInput)),
            noisy=np.hstack([w.noisy for w in group.whiteners]),
            lossy=bool(group.losses),
        )
    return found


def rows_of_problem(problem: Problem, tables: Mapping[str, Table]) -> dict[int, UncertainRows]:
    """The same without kernels, numbered in the order of the blocks' cases.

    Raises:
        MbmError: noise that is none.

    """
    found: dict[int, UncertainRows] = {}
    for owner, block in enumerate(problem.blocks):
        if not block.errors or block.table is None:
            continue
        table, mask = tables[block.table], used_rows(block, tables)
        for case in block.cases:
            columns = uncertain_columns(block, case)
            positions = rows_of(case.static, table)
            positions = positions if mask is None else positions[mask[positions]]
            if not columns:
                continue
            parts = [
                whitener(equation, 0, table, positions, tables, may_be_exact=True).noisy for equation in case.equations
            ]
            found[len(found)] = UncertainRows(
                owner=owner, positions=positions, columns=columns, noisy=np.hstack(parts), lossy=block.loss is not None
            )
    return found


def uncertain_columns(block: Block, case: EquationCase) -> tuple[ColumnInput, ...]:
    """The inputs of a case that are uncertain columns of its block."""
    names = {error.name for error in block.errors}
    components = tuple(c for equation in case.equations for c in equation.components)
    return tuple(
        dict.fromkeys(
            ColumnInput(leaf.table, leaf.name, leaf.row)
            for leaf in leaves(components)
            if isinstance(leaf, Column) and leaf.table == block.table and leaf.name in names
        )
    )
