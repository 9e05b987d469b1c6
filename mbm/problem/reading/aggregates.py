"""``(mean TABLE FORM)``, ``rms median min max quantile count``: aggregates over the rows of a table.

In derived quantities an aggregate is an input that is computed from all rows before; its derivatives follow from those
of FORM. In constraints it is written out row by row (`written_aggregates`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from types import MappingProxyType
from typing import TypeAlias

from mbm.expression.algebra import number
from mbm.expression.nodes import (
    Apply,
    Column,
    Component,
    Expression,
    Operation,
    leaves,
)
from mbm.expression.rows import RowChoice
from mbm.language import faults as language_faults
from mbm.language.coerce import condition, scalar, static_number
from mbm.language.scope import LocalScope
from mbm.language.values import SCALARS, Array, Evaluator, ListValue, Scope, TableName, Value
from mbm.problem import faults
from mbm.problem.aggregates import Aggregate
from mbm.problem.elaboration import Workspace
from mbm.problem.kinds import AggregateKind
from mbm.problem.scopes import ProblemScope
from mbm.problem.tables import Table
from mbm.problem.types import Static
from mbm.text.types import Form, MbmError, Sequence, Span, Symbol
from mbm.values import dataclass

LateForm: TypeAlias = Callable[[Evaluator, Sequence, Scope], Value | None]
Elements: TypeAlias = tuple[tuple[int, ...] | None, tuple[Expression, ...]]
"""The shape of a vector or matrix (None: a number) and its elements."""


def usage(kind: AggregateKind) -> str:
    """How an aggregate is written."""
    if kind is AggregateKind.QUANTILE:
        return "(quantile TABLE q form), with q from 0 to 1"
    return "(count TABLE [condition])" if kind is AggregateKind.COUNT else f"({kind.value} TABLE form)"


def _over_rows(kind: AggregateKind) -> LateForm:
    def special(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value | None:
        world, first = evaluator.world, form.items[1] if len(form.items) > 1 else None
        if not isinstance(first, Symbol) or not isinstance(scope.lookup(first.name, first.span), TableName):
            return None
        if not isinstance(world, ProblemScope) or world.gather is None:
            raise MbmError(faults.aggregate_misplaced(form.span, kind.value))
        return world.gather(kind, form, scope)

    return special


OVER_ROWS: Mapping[str, LateForm] = MappingProxyType({kind.value: _over_rows(kind) for kind in AggregateKind})
"""Heads that make an aggregate where their first argument names a table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """An aggregate as it is written."""

    kind: AggregateKind
    table: Table
    level: float
    form: Form | None
    span: Span


def asked_for(work: Workspace, kind: AggregateKind, form: Sequence, scope: Scope) -> Asked:
    """The aggregate that ``form`` says."""
    arguments = form.items[2:]
    wanted = {AggregateKind.QUANTILE: (2,), AggregateKind.COUNT: (0, 1)}.get(kind, (1,))
    if len(arguments) not in wanted:
        message = f"`{kind.value}` over the rows of a table takes {wanted[-1]} more"
        raise MbmError(language_faults.bad_form(form.span, message, usage(kind)))
    level = 0.5
    if kind is AggregateKind.QUANTILE:
        level = float(static_number(work.evaluator.wanted(arguments[0], scope), arguments[0].span))
        if not 0 <= level <= 1:
            message = "a quantile lies between 0 and 1"
            raise MbmError(language_faults.bad_form(arguments[0].span, message, usage(kind)))
    last = arguments[-1] if arguments else None
    return Asked(kind=kind, table=work.table(form.items[1]), level=level, form=last, span=form.span)


def elements_of(work: Workspace, asked: Asked, scope: Scope) -> Elements:
    """What FORM is in a row: numbers, for a count 1 where the condition holds, else 0."""
    if asked.form is None:
        return None, (number(1),)
    value, span = work.evaluator.wanted(asked.form, scope), asked.form.span
    if asked.kind is AggregateKind.COUNT:
        known = condition(value, span)
        if isinstance(known, bool):
            return None, (number(int(known)),)
        return None, (Apply(Operation.IF, (known, number(1), number(0)), span=span),)
    if isinstance(value, SCALARS):
        return None, (value,)
    if isinstance(value, Array):
        return value.shape, value.elements
    if isinstance(value, ListValue):
        return (len(value.items),), tuple(scalar(item, span) for item in value.items)
    return None, (scalar(value, span),)


def assembled(shape: tuple[int, ...] | None, elements: tuple[Expression, ...]) -> Value:
    """The value that elements make."""
    return elements[0] if shape is None else Array(shape, elements)


@dataclass(slots=True)
class Gatherer:
    """Makes the aggregates of derived quantities; ``found`` are those so far."""

    work: Workspace
    found: list[Aggregate] = field(default_factory=list)

    def __call__(self, kind: AggregateKind, form: Sequence, scope: Scope) -> Value:
        """The value of an aggregate: the numbers that stand for it."""
        work, asked = self.work, asked_for(self.work, kind, form, scope)
        outer = _of_the_row(scope)

        def rows(inner: Scope) -> Elements:
            found = elements_of(work, asked, inner)
            if any(id(leaf) in outer for leaf in leaves(found[1])):
                message = "a value of the row at hand cannot stand inside an aggregate, which has rows of its own"
                raise MbmError(language_faults.bad_form(form.span, message, usage(kind)))
            return found

        cases = work.cases(asked.table, rows, form.span, around=scope)
        shapes = {shape for _, (shape, _) in cases}
        if len(shapes) > 1:
            raise MbmError(faults.unequal_branches(form.span))
        shape = next(iter(shapes), None)
        size = len(cases[0][1][1]) if cases else 1
        made = [self._aggregate(asked, [(static, each[i]) for static, (_, each) in cases]) for i in range(size)]
        return assembled(shape, tuple(Component(a.name, (), None, a.angle, form.span) for a in made))

    def _aggregate(self, asked: Asked, cases: list[tuple[Static, Expression]]) -> Aggregate:
        name = plain = f"{asked.kind.value}({asked.table.name})"
        taken, count = {each.name for each in self.found}, 2
        while name in taken:
            name, count = f"{plain[:-1]}, {count})", count + 1
        made = Aggregate(
            name=name,
            kind=asked.kind,
            table=asked.table.name,
            cases=tuple(cases),
            level=asked.level,
            angle=bool(cases) and asked.kind is not AggregateKind.COUNT and all(value.angle for _, value in cases),
            span=asked.span,
        )
        self.found.append(made)
        return made


def _of_the_row(scope: Scope) -> set[int]:
    """The columns of the row at hand that variables around hold."""
    found: set[int] = set()
    while isinstance(scope, LocalScope):
        for value in scope.variables.values():
            nodes = value.elements if isinstance(value, Array) else (value,) if isinstance(value, SCALARS) else ()
            found.update(id(leaf) for leaf in leaves(nodes) if isinstance(leaf, Column) and leaf.row is RowChoice.EACH)
        scope = scope.parent
    return found
