"""``(sample TABLE FORM AT [:by COLUMN])``: a form over the rows of a timed table, on the line between two of them.

The form is evaluated twice, with the columns of the row before AT and of the row after it; which rows these are follows
from AT when numbers are known, so AT may hold unknowns and the derivative by them is that of the straight line.
"""

from __future__ import annotations

from mbm.expression import algebra
from mbm.expression.nodes import (
    Column,
    ColumnMember,
    Component,
    Expression,
    RowChoice,
    Sampling,
    externals,
    leaves,
)
from mbm.language import faults as language_faults
from mbm.language.coerce import difference, list_items, scalar
from mbm.language.values import SCALARS, Array, Evaluator, ListValue, Scope, Value, describe
from mbm.problem import faults
from mbm.problem.aggregates import is_aggregate
from mbm.problem.options import split_options
from mbm.problem.scopes import ProblemScope, RowScope
from mbm.problem.tables import Table
from mbm.problem.times import numbers_of
from mbm.problem.types import Block
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol

USAGE = "(sample TABLE form at [:by column])"
TIME_NAMES = ("t", "time")
"""The column of times where none is named: the first of these that the table has."""


def sample(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    """The special form."""
    options = split_options(form.items[1:], form.span, owner="`sample`", known=("by",))
    if len(options.positional) != 3 or not isinstance(options.positional[0], Symbol):
        raise MbmError(language_faults.bad_form(form.span, "`sample` takes a table, a form and a time", USAGE))
    name, sampled, at_form = options.positional
    world = evaluator.world
    tables = world.tables if isinstance(world, ProblemScope) else {}
    if not isinstance(world, ProblemScope) or not isinstance(name, Symbol) or name.name not in tables:
        raise MbmError(faults.unknown_table(name.span, name.span.text, tuple(tables)))
    table = tables[name.name]
    at = scalar(evaluator.wanted(at_form, scope), at_form.span)
    _refuse_nested((at,), at_form.span)
    if any(isinstance(leaf, Component) and is_aggregate(leaf.unknown) for leaf in leaves((at,))):
        raise MbmError(faults.aggregate_as_time(at_form.span))
    external = next(externals((at,)), None)
    if external is not None:
        raise MbmError(faults.external_misplaced(external, "the time of `sample`"))
    sampling = Sampling(table=table.name, by=_time_column(table, options.get("by"), name.span), at=at, span=form.span)

    def evaluated(row: RowChoice) -> Value:
        with world.standing(None):
            value = evaluator.wanted(sampled, RowScope(world, table, {}, row, scope, sampling))
        _refuse_nested(_elements(value, sampled.span), sampled.span, sampling)
        return value

    before, after = (Column(table.name, sampling.by, row, form.span, sampling=sampling) for row in _SIDES)
    way = algebra.divide(algebra.subtract(at, before), algebra.subtract(after, before), form.span)
    return _between(evaluated(RowChoice.BEFORE), evaluated(RowChoice.AFTER), way, sampled.span)


_SIDES = (RowChoice.BEFORE, RowChoice.AFTER)


def _time_column(table: Table, form: Form | None, span: Span) -> str:
    if form is not None:
        if not isinstance(form, Symbol):
            raise MbmError(language_faults.bad_form(form.span, "`:by` names a column", USAGE))
        if form.name not in table.columns:
            raise MbmError(faults.unknown_column(form.span, form.name, table.name, tuple(table.columns)))
        return numbers_of(table, form.name, form.span)
    found = next((name for name in TIME_NAMES if name in table.columns), None)
    if found is None:
        raise MbmError(faults.unknown_column(span, TIME_NAMES[0], table.name, tuple(table.columns)))
    return numbers_of(table, found, span)


def _elements(value: Value, span: Span) -> tuple[Expression, ...]:
    if isinstance(value, SCALARS):
        return (value,)
    if isinstance(value, Array):
        return value.elements
    if isinstance(value, ListValue):
        return tuple(scalar(item, span) for item in list_items(value, span))
    raise MbmError(language_faults.wrong_kind(span, "a number, a vector or a matrix", describe(value)))


def _between(start: Value, end: Value, way: Expression, span: Span) -> Value:
    """On the straight line from ``start`` to ``end``; angles go the shorter way round."""
    blended = tuple(
        algebra.add(a, algebra.multiply(way, difference(b, a, span)), span)
        for a, b in zip(_elements(start, span), _elements(end, span), strict=True)
    )
    if isinstance(start, SCALARS):
        return blended[0]
    return Array(start.shape if isinstance(start, Array) else (len(blended),), blended)


def _refuse_nested(nodes: tuple[Expression, ...], span: Span, own: Sampling | None = None) -> None:
    """What is sampled, and when, follows from the row at hand alone; members of families are not sampled."""
    for leaf in leaves(nodes):
        keyed = leaf.member if isinstance(leaf, Column | Component) else None
        if isinstance(keyed, ColumnMember) and keyed.row in _SIDES:
            message = "a member cannot be picked by a column that is sampled"
            raise MbmError(language_faults.bad_form(span, message, USAGE))
        if isinstance(leaf, Column) and leaf.sampling is not own and leaf.sampling is not None:
            raise MbmError(language_faults.bad_form(span, "`sample` cannot stand inside `sample`", USAGE))


def refuse_corrected(blocks: tuple[Block, ...]) -> None:
    """Columns with errors of their own are not corrected where they are sampled.

    Raises:
        MbmError: an equation that samples such a table, or has errors beside.

    """
    corrected = {column.table for block in blocks for column in block.errors}
    if not corrected:
        return
    for block in blocks:
        nodes = tuple(c for case in block.cases for e in case.equations for c in e.components)
        for leaf in leaves(nodes):
            found = leaf.sampling if isinstance(leaf, Column) else None
            if found is not None and (block.errors or found.table in corrected):
                raise MbmError(language_faults.not_available_yet(found.span, "`sample` beside `:errors`", "sequences"))
