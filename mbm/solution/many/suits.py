"""Which problems can be solved many at once: those whose equations look at one row at a time, whatever the others."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.expression.nodes import Column, Component, Expression, RowChoice, leaves
from mbm.kernels.types import KernelSet
from mbm.problem.types import BlockRole, Method, Problem
from mbm.solution.layouts import reads_tables
from mbm.solution.sampling import samplings
from mbm.solution.settings import Settings
from mbm.symbolic.types import ColumnInput


def suits(problem: Problem, kernels: KernelSet, split: frozenset[str]) -> bool:
    """Whether the equations of all solves can be bound together; ``split`` names the tables that are divided by key.

    Then each row of a divided table gives equations that are the same in the whole table as in its own solve, and what
    is the same for all solves looks at no divided table. Problems with constraints or errors in measured columns, and
    with losses of unknown noise beside other equations, are left to the general path.
    """
    if any(reads_tables(unknown) for unknown in problem.unknowns):
        return False
    for block in problem.blocks:
        if block.role is BlockRole.CONSTRAINT or block.errors or block.distinct:
            return False
        if block.loss is not None and block.unknown_factor and len(problem.blocks) > 1:
            return False
    if any(block.table is not None and block.table not in split for block in problem.blocks):
        return False
    if any(derived.table is not None for derived in problem.derived):
        return False
    if any(samplings(kernel) for kernel in kernels.kernels):
        return False
    return _one_row_at_a_time(problem, kernels, split)


def asks_for_one_search(settings: Settings) -> bool:
    """Whether each solve is one descent, from the start that the problem states or from where consensus is."""
    return settings.method in (Method.AUTO, Method.MARQUARDT) and settings.starts is None and settings.routine is None


def _one_row_at_a_time(problem: Problem, kernels: KernelSet, split: frozenset[str]) -> bool:
    for owner, nodes in _expressions(problem):
        for leaf in leaves(nodes):
            if isinstance(leaf, Component) and leaf.member is not None:
                return False
            if isinstance(leaf, Column) and not _local(leaf.table, leaf.row, owner, split):
                return False
    inputs = (p for kernel in kernels.kernels for p in kernel.parameters if isinstance(p, ColumnInput))
    return all(p.row is RowChoice.EACH or p.table not in split for p in inputs)


def _local(table: str, row: RowChoice, owner: str | None, split: frozenset[str]) -> bool:
    """Whether a column is that of the row at hand, or of a table that no solve has a part of only."""
    return table not in split or (row is RowChoice.EACH and table == owner)


def _expressions(problem: Problem) -> Iterator[tuple[str | None, tuple[Expression, ...]]]:
    """What is evaluated for rows, with the table whose rows they are."""
    for block in problem.blocks:
        for case in block.cases:
            for equation in case.equations:
                yield block.table, (*equation.components, *equation.noise)
        if block.when is not None:
            yield from ((block.table, case.values) for case in block.when.cases)
    for derived in problem.derived:
        yield from ((derived.table, case.values) for case in derived.cases)
