"""``:errors ((col sigma)…)``: measured columns with errors of their own, and the other equations that they concern."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from mbm.expression.nodes import Column, Number, leaves
from mbm.language import faults as language_faults
from mbm.problem import faults
from mbm.problem.elaboration import Workspace
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, TablePlan, UncertainColumn
from mbm.text.suggest import closest
from mbm.text.types import Diagnostic, Form, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

USAGE = ":errors ((column sigma)…)"


def read_errors(work: Workspace, form: Form | None, table: Table | None) -> tuple[UncertainColumn, ...]:
    """The uncertain columns that an ``observe`` clause over ``table`` names; none without the option.

    Raises:
        MbmError: not pairs of a column and a form, no column of numbers, a sigma that holds an unknown.

    """
    if form is None:
        return ()
    if table is None:
        raise MbmError(language_faults.bad_form(form.span, "`:errors` wants an observation over a table", USAGE))
    if not isinstance(form, Sequence) or not form.items:
        message = "`:errors` wants a list of columns with their sigmas"
        raise MbmError(language_faults.bad_form(form.span, message, USAGE))
    found: dict[str, UncertainColumn] = {}
    for pair in form.items:
        column = _uncertain(work, pair, table)
        if column.name in found:
            raise MbmError(language_faults.duplicate_definition(column.span, column.name, found[column.name].span))
        found[column.name] = column
    return tuple(found.values())


def _uncertain(work: Workspace, pair: Form, table: Table) -> UncertainColumn:
    symbol = pair.items[0] if isinstance(pair, Sequence) and len(pair.items) == 2 else None
    if not isinstance(pair, Sequence) or not isinstance(symbol, Symbol):
        message = "`:errors` takes pairs (column sigma), e.g. `((x 0.1))`"
        raise MbmError(language_faults.bad_form(pair.span, message, USAGE))
    name, sigma = _column_name(symbol, table), pair.items[1]
    head = sigma.head if isinstance(sigma, Sequence) else sigma.name if isinstance(sigma, Symbol) else None
    if head == "unknown":
        message = "the standard deviation of a column's errors must be stated"
        raise MbmError(language_faults.bad_form(sigma.span, message, USAGE))
    values = work.values(sigma, table, (), wanted="the sigma of `:errors`")
    return UncertainColumn(name=name, table=table.name, column=name, key=None, sigma=values, span=pair.span)


def _column_name(symbol: Symbol, table: Table) -> str:
    """The column's name in the table, which may be written with the table's own."""
    name = symbol.name
    if name not in table.columns and name.startswith(f"{table.name}."):
        name = name[len(table.name) + 1 :]
    column = table.columns.get(name)
    if column is None:
        near = closest(symbol.name, table.columns)
        why = f"is no column of `{table.name}`"
        raise MbmError(faults.errors_without_column(symbol.span, symbol.name, why, near))
    if column.is_text:
        why = "is a column of texts, which have no standard deviation"
        raise MbmError(faults.errors_without_column(symbol.span, symbol.name, why, None))
    return name


@dataclass(frozen=True, slots=True)
class _Source:
    """The table and column that a value was measured in, and the column that holds the key of its row there."""

    table: str
    column: str
    key: str | None


def with_shared_errors(
    blocks: tuple[Block, ...], plans: tuple[TablePlan, ...], tables: Mapping[str, Table]
) -> tuple[tuple[Block, ...], tuple[Diagnostic, ...]]:
    """``blocks`` with the uncertain columns of each: those that it names, and those that other observations name.

    A measured value has one error, so every observation that uses it is corrected by it, under whatever name a join
    gives it. The warnings are about columns that are named in vain.

    Raises:
        MbmError: noise of unknown size beside such a column.

    """
    if not any(block.errors for block in blocks):
        return blocks, ()
    joins = {plan.name: plan for plan in plans}
    declared: dict[tuple[str, str], Span] = {}
    for block in blocks:
        for each in block.errors:
            source = _source(each.table, each.name, joins, tables)
            declared.setdefault((source.table, source.column), each.span)
    warnings: list[Diagnostic] = []
    found = []
    for block in blocks:
        if block.role is BlockRole.OBSERVATION and block.table is not None:
            shared = replace(block, errors=tuple(_errors(block, declared, joins, tables)))
            _check_noise(shared, frozenset(e.name for e in block.errors))
            used = {c.name for c in _columns(block)}
            warnings += [faults.errors_unused(e.span, e.name, block.name) for e in block.errors if e.name not in used]
            found.append(shared)
        else:
            found.append(block)
    return tuple(found), tuple(warnings)


def _errors(
    block: Block,
    declared: Mapping[tuple[str, str], Span],
    joins: Mapping[str, TablePlan],
    tables: Mapping[str, Table],
) -> Iterator[UncertainColumn]:
    own = {each.name: each for each in block.errors}
    names = dict.fromkeys((*own, *(c.name for c in _columns(block))))
    for name in names:
        source = _source(block.table or "", name, joins, tables)
        if name in own:
            yield replace(own[name], table=source.table, column=source.column, key=source.key)
        elif (source.table, source.column) in declared:
            span = declared[source.table, source.column]
            yield UncertainColumn(
                name=name, table=source.table, column=source.column, key=source.key, sigma=None, span=span
            )


def _columns(block: Block) -> Iterator[Column]:
    """The columns of the block's own table in its equations."""
    for case in block.cases:
        for equation in case.equations:
            for leaf in leaves(equation.components):
                if isinstance(leaf, Column) and leaf.table == block.table:
                    yield leaf


def _check_noise(block: Block, own: frozenset[str]) -> None:
    names = frozenset(error.name for error in block.errors)
    for case in block.cases if own else ():
        exact = [e for e in case.equations if all(isinstance(n, Number) and n.value == 0 for n in e.noise)]
        if exact and not any(c.name in names for c in _columns(replace(block, cases=(case,)))):
            count = sum(len(e.components) for e in exact)
            raise MbmError(faults.too_few_errors(block.span, block.name, count, 0, None))
    if not block.errors or not block.unknown_factor:
        return
    each = block.errors[0]
    declared = None if each.name in own else each.span
    raise MbmError(faults.errors_with_unknown_noise(block.span, block.name, each.name, declared))


def _source(table: str, name: str, joins: Mapping[str, TablePlan], tables: Mapping[str, Table]) -> _Source:
    """Where the column ``name`` of ``table`` was measured: through its joins, and theirs."""
    plan = joins.get(table)
    for join in plan.joins if plan is not None else ():
        prefix = f"{join.alias}."
        rest = name[len(prefix) :]
        if name.startswith(prefix) and join.table in tables and rest in tables[join.table].columns:
            if join.table == table:
                return _Source(table, rest, join.column)
            inner = _source(join.table, rest, joins, tables)
            key = join.column if inner.key is None else prefix + inner.key
            return _Source(inner.table, inner.column, key)
    return _Source(table, name, None)
