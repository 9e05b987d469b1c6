"""``(sample TABLE FORM AT [:by COLUMN] [:order 1|3])``: a form over the rows of a timed table, between two of them.

The form is evaluated with the columns of the row before AT and of the row after it; which rows these are follows from
AT when numbers are known, so AT may hold unknowns and the derivative by them is that of the line between the two.
Numbers and vectors lie on the straight line, or (order 3) on the cubic whose slopes at both rows are those of the
parabolas through them and their neighbours: the derivative has no jumps there. Rotations turn at constant rate.

Values between those of two rows: on the line, on a cubic, on the great circle.
"""

from __future__ import annotations

from collections.abc import Sequence as Many

from mbm.expression import algebra
from mbm.expression.algebra import ONE
from mbm.expression.nodes import (
    Column,
    ColumnMember,
    Component,
    Expression,
    Operation,
    Sampling,
    externals,
    leaves,
)
from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.coerce import difference, integer, list_items, scalar
from mbm.language.values import SCALARS, Array, Evaluator, ListValue, PoseValue, RotationValue, Scope, Value, describe
from mbm.language.vocabulary.rigid import compose_rotations, inverse_rotation, logarithm, plane_rotation
from mbm.language.vocabulary.rotations import exponential
from mbm.problem import faults
from mbm.problem.aggregates import is_aggregate
from mbm.problem.clauses import split_options
from mbm.problem.rows import numbers_of
from mbm.problem.scopes import ProblemScope, RowScope
from mbm.problem.tables import TIME, Table
from mbm.problem.types import Block
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol

USAGE = "(sample TABLE form at [:by column] [:order 1|3])"
TIME_NAMES = (TIME, "time")
"""The column of times where none is named, and none is called as in AT: the first of these that the table has."""


def sample(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    """The special form."""
    options = split_options(form.items[1:], form.span, owner="`sample`", known=("by", "order"))
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
    by = _time_column(table, options.get("by"), at, name.span)
    keys, passing = world.divided
    passing = tuple(column for column in passing if column != by)
    sampling = Sampling(table=table.name, by=by, at=at, span=form.span, keys=keys, passing=passing)
    cubic = _is_cubic(evaluator, options.get("order"), scope, table)

    def evaluated(row: RowChoice) -> Value:
        with world.standing(None):
            value = evaluator.wanted(sampled, RowScope(world, table, {}, row, scope, sampling))
        _refuse_nested(_elements(value, sampled.span), sampled.span, sampling)
        return value

    sides = _AROUND if cubic else _SIDES
    times = tuple(Column(table.name, by, row, form.span, sampling=sampling) for row in sides)
    before, after = times[cubic], times[cubic + 1]
    way = algebra.divide(algebra.subtract(at, before), algebra.subtract(after, before), form.span)
    values = [evaluated(row) for row in sides]
    return between(values, times if cubic else (), way, sampled.span)


_SIDES = (RowChoice.BEFORE, RowChoice.AFTER)
_AROUND = (RowChoice.TWO_BEFORE, *_SIDES, RowChoice.TWO_AFTER)
LEAST_CUBIC = 3
"""Rows that a cubic takes at least."""


def _is_cubic(evaluator: Evaluator, form: Form | None, scope: Scope, table: Table) -> bool:
    order = 1 if form is None else integer(evaluator.wanted(form, scope), form.span, "the order of `sample`, 1 or 3")
    if order not in (1, 3) and form is not None:
        raise MbmError(language_faults.bad_form(form.span, "the order of `sample` is 1 or 3", USAGE))
    if order == 3 and len(table) < LEAST_CUBIC and form is not None:
        message = f"a cubic takes {LEAST_CUBIC} rows of `{table.name}`, which has {len(table)}"
        raise MbmError(language_faults.bad_form(form.span, message, USAGE))
    return order == 3


def _time_column(table: Table, form: Form | None, at: Expression, span: Span) -> str:
    """The column that AT is looked up in: the one named, one called as in AT, else the usual one."""
    if form is not None:
        if not isinstance(form, Symbol):
            raise MbmError(language_faults.bad_form(form.span, "`:by` names a column", USAGE))
        if form.name not in table.columns:
            raise MbmError(faults.unknown_column(form.span, form.name, table.name, tuple(table.columns)))
        return numbers_of(table, form.name, form.span)
    named = [leaf.name for leaf in leaves((at,)) if isinstance(leaf, Column)]
    found = next((name for name in (*named, *TIME_NAMES) if name in table.columns), None)
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
    if isinstance(value, RotationValue):
        return value.matrix.elements
    if isinstance(value, PoseValue):
        scale = () if value.scale is None else (value.scale,)
        return (*value.rotation.matrix.elements, *value.translation, *scale)
    raise MbmError(language_faults.wrong_kind(span, "a number, a vector, a rotation or a pose", describe(value)))


def _refuse_nested(nodes: tuple[Expression, ...], span: Span, own: Sampling | None = None) -> None:
    """What is sampled, and when, follows from the row at hand alone; members of families are not sampled."""
    for leaf in leaves(nodes):
        keyed = leaf.member if isinstance(leaf, Column | Component) else None
        if isinstance(keyed, ColumnMember) and keyed.row in _AROUND:
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


def between(values: Many[Value], times: Many[Expression], way: Expression, span: Span) -> Value:
    """The value a part ``way`` of the distance from one row to the next.

    ``values`` are those of the two rows, on whose line it lies; or, with the ``times`` of all four, those of a row
    before them and of one after, for a cubic. Rotations take the shorter way round at constant rate; of poses they do,
    and translations as vectors do; scales by their logarithms. Angles take the shorter way.
    """
    first = values[0]
    if isinstance(first, RotationValue):
        return _turned([value for value in values if isinstance(value, RotationValue)], way, span)
    if isinstance(first, PoseValue):
        return _moved([value for value in values if isinstance(value, PoseValue)], times, way, span)
    rows = [_numbers(value, span) for value in values]
    found = tuple(_blended(each, times, way, span) for each in zip(*rows, strict=True))
    if isinstance(first, SCALARS):
        return found[0]
    return Array(first.shape if isinstance(first, Array) else (len(found),), found)


def _numbers(value: Value, span: Span) -> tuple[Expression, ...]:
    if isinstance(value, Array):
        return value.elements
    if isinstance(value, ListValue):
        return tuple(scalar(item, span) for item in list_items(value, span))
    return (scalar(value, span),)


def _moved(poses: list[PoseValue], times: Many[Expression], way: Expression, span: Span) -> PoseValue:
    where = zip(*(pose.translation for pose in poses), strict=True)
    scales = [pose.scale for pose in poses if pose.scale is not None]
    scale = None
    if scales:
        logs = tuple(algebra.apply(Operation.LOG, each, span=span) for each in scales)
        scale = algebra.apply(Operation.EXP, _blended(logs, times, way, span), span=span)
    return PoseValue(
        rotation=_turned([pose.rotation for pose in poses], way, span),
        translation=tuple(_blended(each, times, way, span) for each in where),
        scale=scale,
    )


def _turned(rotations: list[RotationValue], way: Expression, span: Span) -> RotationValue:
    """On the great circle between the two in the middle: ``R Exp(w Log(Rᵀ S))``."""
    middle = len(rotations) // 2
    start, end = rotations[middle - 1], rotations[middle]
    turn = logarithm(compose_rotations(inverse_rotation(start, span), end, span), span)
    part = tuple(algebra.multiply(way, each, span) for each in turn)
    step = plane_rotation(part[0], span) if start.dimension == 2 else exponential(part, span)
    return compose_rotations(start, step, span)


def _blended(values: tuple[Expression, ...], times: Many[Expression], way: Expression, span: Span) -> Expression:
    """A number on the line between two, or on the cubic between the middle ones of four."""
    if len(values) == 2:
        start, end = values
        return algebra.add(start, algebra.multiply(way, difference(end, start, span), span), span)
    start, rise = values[1], difference(values[2], values[1], span)
    width = algebra.subtract(times[2], times[1], span)
    slopes = (_slope(values[:3], times[:3], span), _slope(values[1:], times[1:], span))
    first, last = (algebra.multiply(width, slope, span) for slope in slopes)
    # Hermite: s + w (d₁ + w (3 r − 2 d₁ − d₂ + w (d₁ + d₂ − 2 r))), with the rise r and the slopes d times the width
    both = algebra.add(first, last, span)
    third = algebra.subtract(both, algebra.add(rise, rise, span), span)
    second = algebra.subtract(
        algebra.add(rise, algebra.add(rise, rise, span), span), algebra.add(both, first, span), span
    )
    inner = algebra.add(second, algebra.multiply(way, third, span), span)
    outer = algebra.add(first, algebra.multiply(way, inner, span), span)
    return algebra.add(start, algebra.multiply(way, outer, span), span)


def _slope(values: Many[Expression], times: Many[Expression], span: Span) -> Expression:
    """The slope, at the middle one of three points in any order, of the parabola through them."""
    before, after = (algebra.subtract(times[i + 1], times[i], span) for i in (0, 1))
    rises = [
        algebra.divide(difference(values[i + 1], values[i], span), width, span)
        for i, width in enumerate((before, after))
    ]
    share = algebra.divide(before, algebra.add(before, after, span), span)
    first = algebra.multiply(algebra.subtract(ONE, share, span), rises[0], span)
    return algebra.add(first, algebra.multiply(share, rises[1], span), span)
