"""Which columns an equation measures: those of its measured side, or those that stand apart from the unknowns.
Measured columns in a second role, where their old values would stay or the new ones would name other things.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeAlias

from mbm.expression.nodes import Apply, Column, ColumnMember, Component, Expression, Number, Operation, leaves
from mbm.expression.rows import RowChoice
from mbm.problem.previous import column_before
from mbm.problem.tables import ROW
from mbm.problem.types import Block, BlockRole, Equation, Problem
from mbm.simulation import faults
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

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


_SUMS = frozenset({Operation.ADD, Operation.SUBTRACT, Operation.NEGATE, Operation.WRAP, Operation.AS_ANGLE})


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """One equation of a case of a block, with the columns that it determines and those that it only uses.

    ``projected``: the columns have errors of their own (`:errors`): true values are put on the curve first.
    """

    block: int
    case: int
    equation: int
    columns: tuple[str, ...]
    uses: frozenset[str]
    projected: bool


def measured_equations(
    problem: Problem, named: Mapping[str, tuple[str, ...]]
) -> tuple[tuple[Measured, ...], tuple[Diagnostic, ...]]:
    """All equations with something measured, each after those that determine columns it uses; and warnings.

    ``named`` gives the measured columns of observations by name, where the caller says so.

    Raises:
        MbmError: an equation that does not say what it measures; columns that determine one another.

    """
    blocks = {block.name: block for block in problem.blocks if block.role is BlockRole.OBSERVATION}
    for name in named:
        if name not in blocks:
            raise MbmError(faults.unknown_observation(name, blocks))
    found: list[Measured] = []
    notes: list[Diagnostic] = []
    for number, block in enumerate(problem.blocks):
        if block.role is not BlockRole.OBSERVATION:
            continue
        for case_number, case in enumerate(block.cases):
            for place, equation in enumerate(case.equations):
                own = _own_columns(problem, equation.components, block.table)
                columns, projected = _columns(block, equation, own, named.get(block.name))
                if not columns:
                    notes.append(faults.kept_equation(equation.span, block.name))
                    continue
                found.append(
                    Measured(
                        block=number,
                        case=case_number,
                        equation=place,
                        columns=columns,
                        uses=frozenset(own) - frozenset(columns),
                        projected=projected,
                    )
                )
    return _in_order(problem, found), tuple(notes)


def _own_columns(problem: Problem, nodes: tuple[Expression, ...], table: str | None) -> tuple[str, ...]:
    """The columns of numbers that stand in the table itself and are read from the row at hand; joined ones do not."""
    found: dict[str, None] = {}
    joined = tuple(f"{join.alias}." for plan in problem.plans if plan.name == table for join in plan.joins)
    for leaf in leaves(nodes):
        if isinstance(leaf, Column) and leaf.row is RowChoice.EACH and leaf.table == table and leaf.name != ROW:
            found[leaf.name] = None
    return tuple(name for name in found if not name.startswith(joined)) if joined else tuple(found)


def _columns(
    block: Block, equation: Equation, own: tuple[str, ...], named: tuple[str, ...] | None
) -> tuple[tuple[str, ...], bool]:
    if named is not None:
        wrong = [name for name in named if name not in own]
        if len(wrong) == len(named):
            raise MbmError(faults.unknown_observation(wrong[0], own, f"column in `{block.name}`"))
        return tuple(name for name in named if name in own), False
    uncertain = tuple(c.name for c in block.errors if c.name in own and c.sigma is not None)
    columns = tuple(name for name in own if name in equation.measured_columns)
    if columns:
        return columns, False
    if uncertain:
        return uncertain, True
    apart = _standing_apart(equation.components, own)
    if len(apart) > len(equation.components) or (own and not apart):
        raise MbmError(faults.unclear_measurement(equation.span, block.name, own))
    return apart, False


def _standing_apart(components: tuple[Expression, ...], own: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of terms without unknowns, that occur in no term with unknowns: h = model(x) − f(column)."""
    alone: set[str] = set()
    mixed: set[str] = set()
    for component in components:
        for term in _terms(component):
            found = leaves((term,))
            names = {leaf.name for leaf in found if isinstance(leaf, Column) and leaf.row is RowChoice.EACH}
            (mixed if any(isinstance(leaf, Component) for leaf in found) else alone).update(names)
    return tuple(name for name in own if name in alone - mixed)


def _terms(node: Expression) -> Iterator[Expression]:
    """The terms of a sum; a constant factor or divisor before a sum goes with each of them."""
    stack = [node]
    while stack:
        each = stack.pop()
        if isinstance(each, Apply) and each.operation in _SUMS:
            stack.extend(each.arguments)
        elif isinstance(each, Apply) and each.operation is Operation.DIVIDE and isinstance(each.arguments[1], Number):
            stack.append(each.arguments[0])
        elif isinstance(each, Apply) and each.operation is Operation.MULTIPLY:
            factors = [a for a in each.arguments if not isinstance(a, Number)]
            if len(factors) == 1:
                stack.append(factors[0])
            else:
                yield each
        else:
            yield each


def _in_order(problem: Problem, found: list[Measured]) -> tuple[Measured, ...]:
    """Each equation after those of the same table that determine columns it uses."""
    ordered: list[Measured] = []
    waiting = list(found)
    while waiting:
        for candidate in waiting:
            table = problem.blocks[candidate.block].table
            others = (o for o in waiting if o is not candidate and problem.blocks[o.block].table == table)
            if not any(candidate.uses & frozenset(o.columns) for o in others if not o.projected):
                ordered.append(candidate)
                waiting.remove(candidate)
                break
        else:
            block = problem.blocks[waiting[0].block]
            column = min(waiting[0].uses)
            raise MbmError(faults.measured_elsewhere(block.span, column, "used by an equation that it depends on"))
    return tuple(ordered)
