"""Measured columns in a second role, where their old values would stay or the new ones would name other things."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeAlias

from mbm.expression.nodes import Column, ColumnMember, Component, leaves
from mbm.expression.rows import RowChoice
from mbm.problem.previous import column_before
from mbm.problem.types import Block, Problem
from mbm.simulation import faults
from mbm.simulation.measured import Measured
from mbm.text.types import MbmError

Use: TypeAlias = tuple[str | None, str, str]
"""A table (None: any one), a column of it, and what the column is used as."""


def refuse_other_uses(problem: Problem, equations: tuple[Measured, ...]) -> None:
    """Refuse what a simulation of the measured columns would contradict.

    Raises:
        MbmError: `measured-elsewhere`.

    """
    measured = {
        (problem.blocks[m.block].table, column): problem.blocks[m.block] for m in equations for column in m.columns
    }
    for table, column, how in (*_names(problem), *_old_values(problem)):
        for (own, name), block in measured.items():
            if name == column and table in (None, own):
                raise MbmError(faults.measured_elsewhere(block.span, name, how))


def _names(problem: Problem) -> Iterator[Use]:
    """Columns whose cells say which things a row is about: numbers with noise would be about others, or none."""
    for plan in problem.plans:
        if plan.declaration.key is not None:
            yield plan.name, plan.declaration.key, "the key of its table"
        for join in plan.joins:
            yield plan.name, join.column, f"a key of the table `{join.table}`"
    for pair in problem.pairs:
        what = "the time of a pair" if pair.steps is None else "what rows are paired by"
        for column in pair.deciding:
            yield pair.name, column, what
            for alias, table in pair.sides:
                yield pair.name, f"{alias}.{column}", what
                yield table, column, what
    for unknown in problem.unknowns:
        if unknown.family is not None and unknown.family.column is not None:
            yield unknown.family.table, unknown.family.column, f"the key of the family `{unknown.name}`"
    yield from ((None, column, "in `for-each`") for column in problem.request.for_each)
    if problem.request.window is not None:
        yield None, problem.request.window.column, "in `window`"
    for block in problem.blocks:
        yield from ((block.table, column, "in `:distinct`") for column in block.distinct)
        yield from ((block.table, column, "in `:common`") for column in block.structure.per)
        yield from ((block.table, e.key, f"a key of the table `{e.table}`") for e in block.errors if e.key is not None)
        yield from _decisive(block)


def _decisive(block: Block) -> Iterator[Use]:
    """Columns that decide which equation a row has, or which member of a family stands in it."""
    for case in block.cases:
        yield from ((block.table, column, "what decides which equation a row has") for column, _ in case.static)
        for leaf in leaves(tuple(c for e in case.equations for c in e.stated)):
            if isinstance(leaf, Column | Component) and isinstance(leaf.member, ColumnMember):
                owner = leaf.unknown if isinstance(leaf, Component) else leaf.table
                yield leaf.member.table, leaf.member.column, f"a key of `{owner}`"


def _old_values(problem: Problem) -> Iterator[Use]:
    """Columns read from the first or last row, or through a join: equations would see the value before the draw."""
    aliases: Mapping[tuple[str, str], str] = {(p.name, j.alias): j.table for p in problem.plans for j in p.joins}
    for block in problem.blocks:
        for case in block.cases:
            for leaf in leaves(tuple(c for e in case.equations for c in e.stated)):
                if not isinstance(leaf, Column):
                    continue
                before = column_before(leaf.name)
                if leaf.row is not RowChoice.EACH or before is not None:
                    yield leaf.table, before or leaf.name, "read from one row of its table"
                alias, _, name = leaf.name.partition(".")
                if (leaf.table, alias) in aliases:
                    yield aliases[leaf.table, alias], name, "joined to another table"
