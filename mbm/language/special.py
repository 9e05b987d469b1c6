"""Special forms: what does not evaluate its parts like a function does; among them forms with
holes (quasi-quotation).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from mbm.expression.algebra import number, total
from mbm.expression.forms import to_form
from mbm.expression.nodes import Apply
from mbm.language import faults
from mbm.language.functions import UserFunction, parse_parameters
from mbm.language.limits import ITEMS_PER_STEP
from mbm.language.scope import LocalScope, condition, conditional, integer, is_form, list_items, scalar, vector
from mbm.language.values import (
    SCALARS,
    Array,
    Callable_,
    Evaluator,
    FamilyValue,
    ListValue,
    Scope,
    SpecialForm,
    TextColumn,
    Value,
    describe,
    size_of,
)
from mbm.language.vocabulary.arithmetic import elementwise_sum
from mbm.text.build import sequence, symbol
from mbm.text.types import Bracket, Form, MbmError, Sequence, Span, Symbol, Text


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


LET_USAGE = "(let ((name value)…) body…)"


def _quote(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    if len(form.items) != 2:
        raise MbmError(faults.bad_form(form.span, "`quote` takes one form", "'form"))
    return form.items[1]


def _quasiquote(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    if len(form.items) != 2:
        raise MbmError(faults.bad_form(form.span, "`quasiquote` takes one form", "`form"))
    return fill(evaluator, form.items[1], scope)


def _unquote(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    raise MbmError(
        faults.bad_form(form.span, "a comma stands outside a quasi-quotation", "`(… ,form …); elsewhere write a space")
    )


def _if(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    if len(form.items) != 4:
        raise MbmError(
            faults.bad_form(form.span, "`if` takes a condition and two branches", "(if condition then else)")
        )
    test_form, then, other = form.items[1:]
    test = condition(evaluator.wanted(test_form, scope), test_form.span)
    if isinstance(test, bool):
        return evaluator.evaluate(then if test else other, scope)
    chosen = evaluator.wanted(then, scope)
    evaluator.budget.make(size_of(chosen), form)
    return conditional(test, chosen, evaluator.wanted(other, scope), form.span)


def clauses_of_cond(form: Sequence) -> tuple[tuple[Form, tuple[Form, ...]], ...]:
    """The (condition, body) pairs of a ``cond``; ``else`` and ``true`` stand for the last."""
    clauses = []
    for clause in form.items[1:]:
        if not isinstance(clause, Sequence) or len(clause.items) < 2:
            raise MbmError(
                faults.bad_form(clause.span, "a clause of `cond` is (condition body…)", "(cond (condition body…)…)")
            )
        clauses.append((clause.items[0], clause.items[1:]))
    if not clauses:
        raise MbmError(faults.bad_form(form.span, "`cond` has no clauses", "(cond (condition body…)…)"))
    return tuple(clauses)


def cond_condition(evaluator: Evaluator, form: Form, scope: Scope) -> bool | Apply:
    """The condition of a clause of ``cond``."""
    if isinstance(form, Symbol) and form.name == "else":
        return True
    return condition(evaluator.wanted(form, scope), form.span)


def _cond(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    pending: list[tuple[Apply, Value, Form]] = []
    result: Value | None = None
    for test_form, body in clauses_of_cond(form):
        test = cond_condition(evaluator, test_form, scope)
        if test is False:
            continue
        for each in body[:-1]:
            evaluator.evaluate(each, scope)
        if test is True:
            value = evaluator.evaluate(body[-1], scope)
            if not pending:
                return value
            result = evaluator.arrived(value, body[-1], scope)
            break
        pending.append((test, evaluator.wanted(body[-1], scope), body[-1]))
    if result is None:
        raise MbmError(
            faults.bad_form(form.span, "no clause of `cond` is left for the remaining cases", "(cond … (else form))")
        )
    for test, value, at in reversed(pending):
        evaluator.budget.make(size_of(value), form)
        result = conditional(test, value, result, at.span)
    return result


def let_scope(evaluator: Evaluator, form: Sequence, scope: Scope) -> tuple[LocalScope, tuple[Form, ...]]:
    """The scope that ``let`` or ``let*`` opens, and its body."""
    if len(form.items) < 3 or not isinstance(form.items[1], Sequence):
        raise MbmError(faults.bad_form(form.span, f"`{form.head}` is not complete", LET_USAGE))
    evaluator.budget.spend(len(form.items[1].items) // ITEMS_PER_STEP, form)
    sequential = form.head == "let*"
    variables: dict[str, Value] = {}
    inner = LocalScope(variables, scope)
    for binding in form.items[1].items:
        if not (isinstance(binding, Sequence) and len(binding.items) == 2 and isinstance(binding.items[0], Symbol)):
            raise MbmError(faults.bad_form(binding.span, "a binding is (name value)", LET_USAGE))
        name, value_form = binding.items[0].name, binding.items[1]
        if sequential:
            inner = LocalScope({name: evaluator.evaluate(value_form, inner)}, inner)
        elif name in variables:
            first = next(each for each in form.items[1].items if isinstance(each, Sequence) and each.head == name)
            raise MbmError(faults.duplicate_definition(binding.items[0].span, name, first.span))
        else:
            variables[name] = evaluator.evaluate(value_form, scope)
    return inner, form.items[2:]


def _let(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    inner, body = let_scope(evaluator, form, scope)
    for each in body[:-1]:
        evaluator.evaluate(each, inner)
    return evaluator.evaluate(body[-1], inner)


def _lambda(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    if len(form.items) < 3:
        raise MbmError(faults.bad_form(form.span, "`lambda` is not complete", "(lambda (a b) body…)"))
    return UserFunction("lambda", parse_parameters(form.items[1], "lambda"), form.items[2:], scope)


def _sum(evaluator: Evaluator, form: Sequence, scope: Scope) -> Value:
    usage = "(sum (i first last) form)"
    if len(form.items) != 3 or not isinstance(form.items[1], Sequence) or len(form.items[1].items) != 3:
        raise MbmError(faults.bad_form(form.span, "`sum` is not complete", usage))
    name, first_form, last_form = form.items[1].items
    if not isinstance(name, Symbol):
        raise MbmError(faults.bad_form(name.span, "the counter of `sum` should be a name", usage))
    first = integer(evaluator.wanted(first_form, scope), first_form.span)
    last = integer(evaluator.wanted(last_form, scope), last_form.span)
    evaluator.budget.check_length(last - first + 1, form)
    evaluator.budget.spend(max(0, last - first + 1), form)
    body = form.items[2]
    terms: list[Value] = []
    for i in range(first, last + 1):
        inner = LocalScope({name.name: number(i)}, scope)
        terms.append(evaluator.wanted(body, inner))
    if not terms:
        return number(0, form.span)
    if all(isinstance(t, SCALARS) for t in terms):
        return total(tuple(scalar(t, body.span, "a number or a vector") for t in terms), form.span)
    result: Value = terms[0] if isinstance(terms[0], Array) else vector(terms[0], body.span)
    for term in terms[1:]:
        evaluator.budget.make(size_of(term), form)
        result = elementwise_sum(result, term, body.span)
    return result


SPECIAL_FORMS: Mapping[str, SpecialForm] = MappingProxyType(
    {
        "quote": _quote,
        "quasiquote": _quasiquote,
        "unquote": _unquote,
        "unquote-splicing": _unquote,
        "if": _if,
        "cond": _cond,
        "let": _let,
        "let*": _let,
        "lambda": _lambda,
        "sum": _sum,
    }
)
"""The special forms of LANGUAGE §2."""
