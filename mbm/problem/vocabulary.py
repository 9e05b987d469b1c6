"""What knows the problem: ``(first TABLE FORM)``, ``(last TABLE FORM)``, ``(sample …)``; ``(dt)``,
``(rate x)``; and ``(previous FORM)``, FORM with the columns of the row before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence as Many
from dataclasses import field, replace
from types import MappingProxyType

import numpy as np

from mbm.expression import algebra
from mbm.expression.algebra import ONE
from mbm.expression.nodes import Column, ColumnMember, Component, Expression, Operation, Sampling, externals, leaves
from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.scope import LocalScope, difference, integer, list_items, scalar
from mbm.language.values import (
    SCALARS,
    Array,
    Builtin,
    Call,
    Evaluator,
    FunctionTable,
    ListValue,
    Macro,
    PoseValue,
    RotationValue,
    Scope,
    SpecialForm,
    Value,
    describe,
)
from mbm.language.vocabulary.rigid import compose_rotations, inverse_rotation, logarithm, plane_rotation
from mbm.language.vocabulary.rotations import exponential
from mbm.problem import faults
from mbm.problem.aggregates import is_aggregate
from mbm.problem.clauses import split_options
from mbm.problem.previous import column_before, looks_back, name_before, row_before, with_rows_before
from mbm.problem.rows import numbers_of
from mbm.problem.scopes import ProblemScope, RowScope
from mbm.problem.sequence.types import RATE
from mbm.problem.tables import TIME, Column as TableColumn, Table
from mbm.problem.types import Block
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

SAMPLE_USAGE = "(sample TABLE form at [:by column] [:order 1|3])"
TIME_NAMES = (TIME, "time")
"""The column of times where none is named, and none is called as in AT: the first of these that the table has."""


def sample(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    """The special form."""
    options = split_options(form.items[1:], form.span, owner="`sample`", known=("by", "order"))
    if len(options.positional) != 3 or not isinstance(options.positional[0], Symbol):
        raise MbmError(language_faults.bad_form(form.span, "`sample` takes a table, a form and a time", SAMPLE_USAGE))
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
        raise MbmError(language_faults.bad_form(form.span, "the order of `sample` is 1 or 3", SAMPLE_USAGE))
    if order == 3 and len(table) < LEAST_CUBIC and form is not None:
        message = f"a cubic takes {LEAST_CUBIC} rows of `{table.name}`, which has {len(table)}"
        raise MbmError(language_faults.bad_form(form.span, message, SAMPLE_USAGE))
    return order == 3


def _time_column(table: Table, form: Form | None, at: Expression, span: Span) -> str:
    """The column that AT is looked up in: the one named, one called as in AT, else the usual one."""
    if form is not None:
        if not isinstance(form, Symbol):
            raise MbmError(language_faults.bad_form(form.span, "`:by` names a column", SAMPLE_USAGE))
        if form.name not in table.columns:
            raise MbmError(faults.unknown_column(form.span, form.name, table.name, tuple(table.columns)))
        return numbers_of(table, form.name, form.span)
    named = [leaf.name for leaf in leaves((at,)) if isinstance(leaf, Column)]
    found = next((name for name in (*named, *TIME_NAMES) if name in table.columns), None)
    if found is None:
        raise MbmError(faults.unknown_column(span, TIME_NAMES[0], table.name, tuple(table.columns)))
    return numbers_of(table, found, span)


def _elements(value: Value, span: Span) -> tuple[Expression, ...]:
    if isinstance(value, (*SCALARS, Array, ListValue)):
        return _numbers(value, span)
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
            raise MbmError(language_faults.bad_form(span, message, SAMPLE_USAGE))
        if isinstance(leaf, Column) and leaf.sampling is not own and leaf.sampling is not None:
            raise MbmError(language_faults.bad_form(span, "`sample` cannot stand inside `sample`", SAMPLE_USAGE))


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


USAGE = "(previous form), where the row of a table is at hand"


class EarlierScope(RowScope):
    """The columns of the row before, over the problem's names."""

    def _reference(self, column: TableColumn, span: Span) -> Value:
        return super()._reference(self.table.columns[name_before(column.name)], span)

    def _row_number(self, span: Span) -> Value:
        return super()._reference(self.table.columns[row_before()], span)


def previous(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value | None:
    """The form, in a problem."""
    world = evaluator.world
    if not isinstance(world, ProblemScope) or world.earlier is None:
        return None
    if len(form.items) != 2:
        raise MbmError(language_faults.bad_form(form.span, "`previous` takes one form", USAGE))
    inner = scope
    while isinstance(inner, LocalScope):
        inner = inner.parent
    if not isinstance(inner, RowScope) or isinstance(inner, EarlierScope) or not inner.at_hand:
        raise MbmError(language_faults.bad_form(form.span, "there is no row at hand that another could precede", USAGE))
    table, here = world.earlier(inner.table), world.here
    if here.table == table.name and isinstance(here.member, ColumnMember):
        here = replace(here, member=replace(here.member, column=name_before(here.member.column)))
    with world.at(here):
        return evaluator.wanted(form.items[1], EarlierScope(world, table, inner.static, around=scope))


@dataclass(slots=True)
class Earlier:
    """Gives tables the columns of the row before when they are asked for.

    ``tables`` are those at work, ``unfiltered`` the same with all rows, ``keys`` what divides them.
    """

    tables: dict[str, Table]
    unfiltered: dict[str, Table]
    keys: tuple[str, ...] = ()
    asked: dict[str, None] = field(default_factory=dict)

    def __call__(self, table: Table) -> Table:
        """The table, with the columns of the row before."""
        name = table.name
        if name not in self.asked:
            self.asked[name] = None
            whole = self.unfiltered.get(name, table)
            self.unfiltered[name] = with_rows_before(whole, self.keys)
            own = self.tables.get(name, table)
            added = self.unfiltered[name].take(np.searchsorted(self.unfiltered[name].rows, own.rows))
            columns = {n: c for n, c in added.columns.items() if column_before(n) is not None}
            provenance = self.unfiltered[name].provenance
            made = Table(
                name=name,
                columns={**own.columns, **columns},
                rows=own.rows,
                provenance=provenance,
                key=own.key,
                groups=own.groups,
            )
            self.tables[name] = made
        return self.tables[name]


def looking_back(block: Block) -> Block:
    """The block; if it mentions the row before, the first rows of keys are unused."""
    nodes = [n for case in block.cases for e in case.equations for n in e.stated]
    nodes += [n for case in (block.when.cases if block.when is not None else ()) for n in case.values]
    return replace(block, earlier=looks_back(nodes, (case.static for case in block.cases)))


def _chosen(row: RowChoice) -> SpecialForm:
    def special(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
        usage = f"({row.value} TABLE form)"
        if len(form.items) != 3 or not isinstance(form.items[1], Symbol):
            raise MbmError(language_faults.bad_form(form.span, f"`{row.value}` takes a table and a form", usage))
        world, name = evaluator.world, form.items[1]
        tables = world.tables if isinstance(world, ProblemScope) else {}
        if not isinstance(world, ProblemScope) or name.name not in tables:
            raise MbmError(faults.unknown_table(name.span, name.name, tuple(tables)))
        table = tables[name.name]
        with world.standing(table, row):
            return evaluator.wanted(form.items[2], RowScope(world, table, {}, row, scope))

    return special


SPECIAL_FORMS: Mapping[str, SpecialForm] = MappingProxyType(
    {**{choice.value: _chosen(choice) for choice in (RowChoice.FIRST, RowChoice.LAST)}, "sample": sample}
)
"""Added to the special forms while a problem is compiled."""


def _interval(call: Call) -> Value:
    world = call.evaluator.world
    interval = world.here.interval if isinstance(world, ProblemScope) else None
    if interval is None:
        message = "`(dt)` is the time to the step that a transition reaches"
        raise MbmError(language_faults.bad_form(call.span, message, "(= (next x) (+ x (* (dt) v)) :sigma q)"))
    return interval


class _Rate(Macro):
    """``(rate x)``."""

    __slots__ = ()
    name, usage = "rate", "(rate x)"
    doc = "The rate of a state that goes on with constant velocity, per unit of the steps' column in SI."

    def call(self, call: Call) -> Value:
        """The state that ``constant-velocity`` adds."""
        world, forms = call.evaluator.world, call.forms
        if len(forms) != 1 or not isinstance(forms[0], Symbol):
            raise MbmError(language_faults.bad_form(call.span, "`rate` takes the name of a state", "(rate x)"))
        name = forms[0].name + RATE
        if not isinstance(world, ProblemScope) or name not in world.entries:
            raise MbmError(faults.state_without_rate(forms[0].span, forms[0].name))
        return call.evaluator.wanted(Symbol(name=name, span=call.span), call.scope)


FUNCTIONS: FunctionTable = MappingProxyType(
    {
        "dt": Builtin("dt", "(dt)", "The time to the step that a transition reaches.", 0, 0, _interval),
        "rate": _Rate(),
    }
)
"""Functions of problems with states; a definition of the user's goes before."""
