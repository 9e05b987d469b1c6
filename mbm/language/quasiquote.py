"""Quasi-quotation: forms with holes, and values as forms."""

from __future__ import annotations

from mbm.expression.forms import to_form
from mbm.language import faults
from mbm.language.coerce import is_form, list_items
from mbm.language.values import (
    SCALARS,
    Array,
    Callable_,
    Evaluator,
    FamilyValue,
    ListValue,
    Scope,
    TextColumn,
    Value,
    describe,
    size_of,
)
from mbm.text.build import sequence, symbol
from mbm.text.types import Bracket, Form, MbmError, Sequence, Span, Text


def fill(evaluator: Evaluator, form: Form, scope: Scope, depth: int = 1) -> Form:
    """``form`` with what stands behind a comma evaluated, and what stands behind ``,@`` spliced in."""
    if not isinstance(form, Sequence):
        return form
    evaluator.budget.enter(form)
    try:
        head = form.head
        if head in ("unquote", "unquote-splicing") and len(form.items) == 2:
            if depth == 1:
                value = evaluator.evaluate(form.items[1], scope)
                evaluator.budget.look(size_of(value), form)
                return value_form(value, form.items[1].span)
            inner = fill(evaluator, form.items[1], scope, depth - 1)
            return Sequence(items=(form.items[0], inner), bracket=form.bracket, span=form.span)
        deeper = depth + 1 if head == "quasiquote" else depth
        items: list[Form] = []
        for item in form.items:
            if isinstance(item, Sequence) and item.head == "unquote-splicing" and len(item.items) == 2 and deeper == 1:
                items.extend(_spliced(evaluator, item, scope))
            else:
                items.append(fill(evaluator, item, scope, deeper))
        evaluator.budget.check_length(len(items), form)
        return Sequence(items=tuple(items), bracket=form.bracket, span=form.span)
    finally:
        evaluator.budget.leave()


def _spliced(evaluator: Evaluator, form: Sequence, scope: Scope) -> list[Form]:
    value = evaluator.evaluate(form.items[1], scope)
    evaluator.budget.look(size_of(value), form)
    return [value_form(item, form.span) for item in list_items(value, form.items[1].span)]


def value_form(value: Value, span: Span) -> Form:
    """The form that evaluates to ``value``; a list that occurs several times is one form. Not recursive: lists nest."""
    forms: dict[int, Form] = {}
    waiting: list[tuple[Value, bool]] = [(value, False)]
    while waiting:
        part, ready = waiting.pop()
        if not isinstance(part, ListValue):
            forms[id(part)] = _part_form(part, span)
        elif ready:
            forms[id(part)] = sequence((forms[id(item)] for item in part.items), span)
        elif id(part) not in forms:
            waiting.append((part, True))
            waiting.extend((item, False) for item in part.items if id(item) not in forms)
    return forms[id(value)]


def _part_form(value: Value, span: Span) -> Form:
    """The form of anything but a list."""
    if is_form(value):
        return value  # type: ignore[return-value]
    if isinstance(value, SCALARS):
        return to_form(value, span)
    if isinstance(value, bool):
        return symbol("true" if value else "false", span)
    if isinstance(value, str):
        return Text(value=value, span=span)
    if isinstance(value, Array):
        items = tuple(_part_form(item, span) for item in list_items(value, span))
        return Sequence(items=items, bracket=Bracket.SQUARE, span=span)
    if isinstance(value, TextColumn | FamilyValue | Callable_):
        return symbol(value.name, span)
    raise MbmError(faults.wrong_kind(span, "something that can stand in a form", describe(value)))
