"""Which observations a derived quantity is the MODEL of: their noise is that of a new reading of it."""

from __future__ import annotations

from binascii import crc32
from collections.abc import Mapping

import numpy as np

from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import (
    Column,
    ColumnMember,
    Component,
    Constant,
    Expression,
    Leaf,
    Member,
    externals,
    leaves,
)
from mbm.expression.rows import RowChoice
from mbm.problem.types import BlockRole, Derived, Equation, Problem
from mbm.values import dataclass

POINTS = 12
"""Points at which two forms are compared: functions that differ agree at none of them but by a freak."""

ALIKE = 1e-9
"""Relative difference of equal forms that were written otherwise: thousands of roundings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Modelled:
    """A block, a case and an equation of it; ``columns`` leads from those of the derived form to those of the block."""

    block: int
    case: int
    equation: int
    columns: Mapping[str, str]


def observations_of(problem: Problem, derived: Derived) -> tuple[Modelled, ...]:
    """The observations whose MODEL is the form of a derived quantity, however it is written.

    Both have one case. The names of the columns are the same, or each depends on one column. The forms are compared at
    some points.
    """
    if derived.kind is not None or len(derived.cases) != 1:
        return ()
    form = derived.cases[0].values
    found = []
    for number, block in enumerate(problem.blocks):
        if block.role is not BlockRole.OBSERVATION or len(block.cases) != 1:
            continue
        for place, equation in enumerate(block.cases[0].equations):
            if equation.measured is None or len(equation.components) != len(form):
                continue
            columns = _columns(form, derived.table, equation, block.table)
            if columns is not None and _alike(form, derived, equation, block.table, columns):
                found.append(Modelled(block=number, case=0, equation=place, columns=columns))
    return tuple(found)


def columns_of(nodes: tuple[Expression, ...], table: str | None) -> frozenset[str]:
    """The columns of the row at hand that forms depend on, keys of members among them."""
    found = set()
    for leaf in leaves(nodes):
        if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and leaf.table == table:
            found.add(leaf.name)
        member = leaf.member if isinstance(leaf, Component | Column) else None
        if isinstance(member, ColumnMember) and member.row is RowChoice.EACH and member.table == table:
            found.add(member.column)
    return frozenset(found)


def _columns(
    form: tuple[Expression, ...], own: str | None, equation: Equation, table: str | None
) -> Mapping[str, str] | None:
    """From the columns of a form to those of a model; None where they do not correspond."""
    mine = columns_of(form, own)
    theirs = columns_of(equation.components, table) - columns_of(equation.measured or (), table)
    if mine == theirs:
        return {name: name for name in sorted(mine)}
    if len(mine) == len(theirs) == 1:
        return dict(zip(mine, theirs, strict=True))
    return None


def _alike(
    form: tuple[Expression, ...],
    derived: Derived,
    equation: Equation,
    table: str | None,
    columns: Mapping[str, str],
) -> bool:
    """Whether MODEL − MEASURED and MEASURED add up to the form, at all points where these have values."""
    every = (*form, *equation.components)
    if next(externals(every), None) is not None:
        return False
    own = evaluate(form, lambda leaf: _number(leaf, derived.table, columns))
    away = evaluate(equation.components, lambda leaf: _number(leaf, table, {}))
    measured = evaluate(equation.measured or (), lambda leaf: _number(leaf, table, {}))
    compared = False
    with np.errstate(all="ignore"):
        for mine, difference, reading in zip(own, away, measured, strict=True):
            apart = np.asarray(difference + reading - mine)
            apart = apart - 2 * np.pi * np.rint(apart / (2 * np.pi)) if derived.angle else apart
            known = np.isfinite(apart)
            compared |= bool(known.any())
            size = np.abs(mine) + np.abs(difference) + np.abs(reading)
            if bool((known & (np.abs(apart) > ALIKE * size)).any()):
                return False
    return compared


def _number(leaf: Leaf, table: str | None, columns: Mapping[str, str]) -> Values:
    """Numbers between 0 and 1 for a leaf, the same for one that means the same in another table."""
    if isinstance(leaf, Constant):
        return leaf.value
    if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and leaf.table == table:
        identity: tuple[object, ...] = ("row", columns.get(leaf.name, leaf.name))
    elif isinstance(leaf, Column):
        identity = (leaf.table, leaf.name, leaf.row, _member(leaf.member, table, columns), id(leaf.sampling))
    elif isinstance(leaf, Component):
        identity = (leaf.unknown, leaf.index, _member(leaf.member, table, columns))
    else:
        identity = (id(leaf),)
    return np.random.default_rng(crc32(repr(identity).encode())).uniform(0.1, 1.0, POINTS)


def _member(member: Member | None, table: str | None, columns: Mapping[str, str]) -> object:
    if isinstance(member, ColumnMember) and member.row is RowChoice.EACH and member.table == table:
        return ("row", columns.get(member.column, member.column))
    return member
