"""Which problems can be solved many at once: those whose equations look at one row at a time, whatever the others."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.equations.gathering import samplings
from mbm.equations.layouts import columns_of, stated
from mbm.estimation.settings import Settings
from mbm.expression.nodes import Column, Component, Expression, LiteralMember, Member, leaves
from mbm.expression.rows import Row, RowChoice
from mbm.kernels.types import KernelSet
from mbm.problem.factors import shares_factors
from mbm.problem.types import Problem, UncertainColumn, Unknown
from mbm.symbolic.types import ColumnInput


def suits(problem: Problem, kernels: KernelSet, split: frozenset[str]) -> bool:
    """Whether the equations of all solves can be bound together; ``split`` names the tables that are divided by key.

    Then each row of a divided table gives equations that are the same in the whole table as in its own solve, but for
    the numbers of members, and what is the same for all solves looks at no divided table.
    """
    if not all(_readable(unknown, split) for unknown in problem.unknowns):
        return False
    for block in problem.blocks:
        if block.structure.joins or block.distinct:
            return False
        if not all(_stated(error, block.table, split) for error in block.errors):
            return False
    if problem.aggregates or shares_factors(problem) or any(derived.table is not None for derived in problem.derived):
        return False
    if any(samplings(kernel) for kernel in kernels.kernels):
        return False
    return _one_row_at_a_time(problem, kernels, split)


def asks_for_one_search(settings: Settings) -> bool:
    """Whether each solve is one descent, from the start that the problem states or from where consensus is."""
    return settings.iterative and settings.starts is None and settings.routine is None


def _one_row_at_a_time(problem: Problem, kernels: KernelSet, split: frozenset[str]) -> bool:
    own = frozenset(u.name for u in problem.unknowns if u.family is not None and u.family.rows in split)
    for owner, nodes in _expressions(problem):
        for leaf in leaves(nodes):
            if isinstance(leaf, Component) and not _picks(leaf.member, owner, split, own=leaf.unknown in own):
                return False
            if isinstance(leaf, Column) and not (
                _local(leaf.table, leaf.row, owner, split) and _picks(leaf.member, owner, split, own=False)
            ):
                return False
    inputs = (p for kernel in kernels.kernels for p in kernel.parameters if isinstance(p, ColumnInput))
    return all(p.row is RowChoice.EACH or p.table not in split for p in inputs)


def _readable(unknown: Unknown, split: frozenset[str]) -> bool:
    """Whether what is stated of an unknown follows from the rows of its members, or from tables that are whole."""
    rows = None if unknown.family is None else unknown.family.rows
    columns = (column for option in stated(unknown) for column in columns_of(option))
    return all(_local(column.table, column.row, rows, split) for column in columns)


def _stated(error: UncertainColumn, owner: str | None, split: frozenset[str]) -> bool:
    """Whether the standard deviation of a measured value follows from the row at hand, or from whole tables."""
    return error.sigma is None or all(_local(c.table, c.row, owner, split) for c in columns_of(error.sigma))


def _picks(member: Member | None, owner: str | None, split: frozenset[str], *, own: bool) -> bool:
    """Whether a key follows from the row at hand; ``own``: it names a member of those that each solve has."""
    if member is None:
        return True
    if isinstance(member, LiteralMember):
        return not own
    if member.row is RowChoice.EACH:
        return owner in split or not own
    return not own and member.table not in split


def _local(table: str, row: Row, owner: str | None, split: frozenset[str]) -> bool:
    """Whether a column is that of the row at hand, or of a table that no solve has a part of only."""
    return table not in split or (row is RowChoice.EACH and table == owner)


def _expressions(problem: Problem) -> Iterator[tuple[str | None, tuple[Expression, ...]]]:
    """What is evaluated for rows, with the table whose rows they are."""
    for block in problem.blocks:
        for case in block.cases:
            for equation in case.equations:
                yield block.table, equation.stated
        if block.when is not None:
            yield from ((block.table, case.values) for case in block.when.cases)
    for derived in problem.derived:
        yield from ((derived.table, case.values) for case in derived.cases)
