"""The evaluator: one form in one scope gives one value. Pure, lazy at top level, bounded (LANGUAGE §1–2)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TypeVar

from mbm.expression.algebra import UndefinedValueError
from mbm.expression.nodes import Column, Component, Number, Opaque, nearest
from mbm.expression.units import NONE, parse_unit, refused_unit
from mbm.language import faults
from mbm.language.limits import ITEMS_PER_STEP, Budget, Limits
from mbm.language.scope import EmptyScope, assemble, integer, opaque_element, scalar
from mbm.language.values import (
    FORMS,
    SCALARS,
    Array,
    Builtin,
    Call,
    Callable_,
    FamilyValue,
    ListValue,
    Macro,
    Scope,
    TextColumn,
    Value,
    Vocabulary,
    describe,
    size_of,
)
from mbm.text.suggest import closest, how_to_index, infix, listed, suggestion
from mbm.text.types import (
    Bracket,
    Code,
    Diagnostic,
    Form,
    Keyword,
    Label,
    MbmError,
    Numeral,
    Place,
    Sequence,
    Span,
    Symbol,
    Text,
)

T = TypeVar("T")

MAXIMUM_LABELS = 4
"""How many calls an error names on its way out: enough to find the cause, few enough to read."""


class FormEvaluator:
    """Evaluates forms. Holds the vocabulary, counts the work and collects warnings; keeps no other state.

    ``world`` is the scope of the problem being compiled: where ``perse`` finds k0 and k1.
    """

    def __init__(self, vocabulary: Vocabulary, limits: Limits) -> None:
        self.vocabulary = vocabulary
        self.world: Scope = EmptyScope()
        self.budget = Budget(limits)
        self.warnings: dict[tuple[Code, Place | None], Diagnostic] = {}

    def warn(self, diagnostic: Diagnostic) -> None:
        """Keep a warning, once for each place."""
        self.warnings.setdefault((diagnostic.code, diagnostic.place), diagnostic)

    def evaluate(self, form: Form, scope: Scope) -> Value:
        """The value of ``form`` in ``scope``.

        Raises:
            MbmError: with a diagnostic at the innermost form that is wrong.
            StaticColumnNeeded: the value of a data column decides what the expression is.

        """
        if isinstance(form, Numeral):
            return self.number(form)
        if isinstance(form, Symbol):
            return self.name(form, scope)
        if isinstance(form, Text):
            return form.value
        if isinstance(form, Keyword):
            return form
        self.budget.enter(form)
        try:
            if form.bracket is Bracket.SQUARE:
                return self.vector(form, form.items, scope)
            return self._list(form, scope)
        except MbmError as error:
            raise _with_index(error, form) from None
        finally:
            self.budget.leave()

    def wanted(self, form: Form, scope: Scope) -> Value:
        """Like ``evaluate``, where an expression is wanted: a form that arrives is evaluated in its turn."""
        return self.arrived(self.evaluate(form, scope), form, scope)

    def arrived(self, value: Value, at: Form, scope: Scope) -> Value:
        """``value``, or, if it is a form, what that form means here (LANGUAGE §2, forms as observation models)."""
        while isinstance(value, FORMS) and not isinstance(value, Keyword):
            self.budget.enter(at)
            try:
                value = self.evaluate(value, scope)
            except MbmError as error:
                raise _with_label(error, at.span, "in the form that this gave") from None
            finally:
                self.budget.leave()
        return value

    def number(self, form: Numeral) -> Number:
        """A numeral in SI."""
        if form.unit is None:
            return Number(form.value, None, form.span)
        unit = parse_unit(form.unit)
        if unit is None:
            raise MbmError(faults.unknown_unit(form.span, form.unit, refused_unit(form.unit)))
        value = unit.exact_si(form.value)
        if not math.isfinite(value):
            raise MbmError(faults.undefined_value(form.span, form.span.text))
        return Number(value, unit.dimension, form.span, absolute=unit.zero != 0.0)

    def name(self, form: Symbol, scope: Scope) -> Value:
        """What a symbol in argument position denotes: a variable, else a function."""
        value = scope.lookup(form.name, form.span)
        if value is not None:
            return _located(value, form.span)
        if form.name == "pi":
            return Number(math.pi, NONE, form.span)
        if form.name in ("true", "false"):
            return form.name == "true"
        function = self.vocabulary.functions.get(form.name)
        if function is not None:
            return function
        raise MbmError(self._unknown(form, scope))

    def vector(self, form: Form, items: tuple[Form, ...], scope: Scope) -> Array:
        """A vector of scalars, or a matrix of vectors of one length."""
        self.budget.spend(len(items), form)
        return assemble([self.wanted(item, scope) for item in items], [item.span for item in items])

    def _list(self, form: Sequence, scope: Scope) -> Value:
        if not form.items:
            return ListValue(())
        if len(form.items) >= ITEMS_PER_STEP:  # names and numbers take no steps of their own
            self.budget.spend(len(form.items) // ITEMS_PER_STEP, form)
        head = form.items[0]
        if isinstance(head, Symbol):
            special = self.vocabulary.special_forms.get(head.name)
            if special is not None:
                return self._special(special, form, scope)
            function = self.vocabulary.functions.get(head.name)
            late = self.vocabulary.late.get(head.name)
            if late is not None and isinstance(function, Builtin | None) and scope.lookup(head.name, head.span) is None:
                made = self._special(late, form, scope)
                if made is not None:
                    return made
            if function is not None:
                return self.apply(function, form, scope)
            value = scope.lookup(head.name, head.span)
            if value is None and head.name == "pi":
                value = Number(math.pi, NONE, head.span)
            if value is None:
                raise MbmError(self._unknown(head, scope, is_head=True))
        elif isinstance(head, Numeral):
            value = self.number(head)
        elif isinstance(head, Sequence):
            value = self.wanted(head, scope)
        else:
            raise MbmError(faults.bad_head(head.span, None, "a text" if isinstance(head, Text) else "a keyword"))
        return self._headed(value, form, scope)

    def _special(self, special: Callable[..., T], form: Sequence, scope: Scope) -> T:
        try:
            return special(self, form, scope)
        except UndefinedValueError as error:
            raise MbmError(faults.undefined_value(form.span, str(error))) from None

    def _headed(self, value: Value, form: Sequence, scope: Scope) -> Value:
        """A list whose head has a value: a call, an element, or a paren vector."""
        if isinstance(value, SCALARS):
            return self.vector(form, form.items, scope)
        if isinstance(value, _INDEXED):
            arguments = tuple(self.wanted(item, scope) for item in form.items[1:])
            return element(value, arguments, form)
        if isinstance(value, Callable_):
            return self.apply(value, form, scope)
        head = form.items[0]
        raise MbmError(faults.bad_head(head.span, head.name if isinstance(head, Symbol) else None, describe(value)))

    def apply(self, function: Callable_, form: Sequence, scope: Scope) -> Value:
        """Call ``function`` with the arguments that ``form`` holds."""
        forms = form.items[1:]
        if isinstance(function, Builtin):
            _check_arity(function, form)
            values = [self.evaluate(f, scope) for f in forms]
            if not function.takes_forms:
                for i, value in enumerate(values):
                    if isinstance(value, FORMS):
                        values[i] = self.arrived(value, forms[i], scope)
            arguments = tuple(values)
        elif isinstance(function, Macro):
            arguments = ()
        else:
            arguments = tuple([self.evaluate(f, scope) for f in forms])
        return self.call(function, arguments, form, scope)

    def call(self, function: Callable_, arguments: tuple[Value, ...], form: Sequence, scope: Scope) -> Value:
        """Call ``function`` with values; errors inside the user's functions name the call."""
        call = Call(self, form, scope, arguments, form.items[1:])
        if isinstance(function, Builtin):
            size = sum([size_of(a) for a in arguments if isinstance(a, _SIZED)])
            if size:
                self.budget.look(size, form)
        try:
            return function.call(call)
        except UndefinedValueError as error:
            raise MbmError(faults.undefined_value(form.span, str(error))) from None
        except MbmError as error:
            if isinstance(function, Builtin):
                raise
            raise _with_label(error, form.span, f"in this call of `{function.name}`") from None

    def _are_operands(self, names: tuple[str, ...], scope: Scope) -> bool:
        """Whether arithmetic was meant: a sign before a name, or an operator between known names and numbers."""
        known = {"pi", *scope.names()}
        return len(names) == 1 or all(name[0].isdigit() or name in known for name in names)

    def _unknown(self, symbol: Symbol, scope: Scope, *, is_head: bool = False) -> Diagnostic:
        name = symbol.name
        later = self.vocabulary.not_yet.get(name)
        if later is not None:
            return faults.not_available_yet(symbol.span, f"`{name}`", later)
        written = infix(name)
        if written is not None and self._are_operands(written[1], scope):
            return faults.infix(symbol.span, name, *written)
        functions = [*self.vocabulary.functions, *self.vocabulary.special_forms]
        # a value is mostly one of the file's own names; what is called, as often one of the language
        near = closest(name, [*functions, *scope.names()] if is_head else scope.names())
        columns = None if is_head else scope.columns()
        known = None if columns is None else f"the columns of `{columns[0]}` are {listed(columns[1])}"
        return faults.unknown_name(symbol.span, name, near or closest(name, functions), known, is_head=is_head)


_SIZED = (Array, ListValue, Sequence)
_INDEXED = (Array, ListValue, FamilyValue)


def _located(value: Value, span: Span) -> Value:
    """Numbers carry the place where they are used, so that a clash of units shows both places."""
    if isinstance(value, Component) and value.span is None:
        return Component(value.unknown, value.index, value.member, value.angle, span)
    if isinstance(value, SCALARS) and value.span is None and not isinstance(value, Number):
        return replace(value, span=span)
    return value


def _check_arity(function: Builtin, form: Sequence) -> None:
    count = len(form.items) - 1
    if count < function.minimum or (function.maximum is not None and count > function.maximum):
        raise MbmError(faults.wrong_arity(form.span, function.name, function.usage, count))


def _with_label(error: MbmError, span: Span, message: str) -> MbmError:
    return MbmError(
        *(
            replace(d, labels=(*d.labels, Label(span, message)))
            if len(d.labels) < MAXIMUM_LABELS and d.place != span
            else d
            for d in error.diagnostics
        )
    )


def _with_index(error: MbmError, form: Sequence) -> MbmError:
    """The error, with how an element is written where it speaks of ``name[index]``, which is read as two forms."""
    for name, index in pairwise(form.items):
        if isinstance(name, Symbol) and isinstance(index, Sequence) and name.span.end == index.span.start:
            hint = how_to_index(name.name, index.span.text)
            both = replace(name.span, end=index.span.end)
            return MbmError(*(replace(d, hint=hint) if _speaks_of(d, form, both) else d for d in error.diagnostics))
    return error


def _speaks_of(fault: Diagnostic, form: Sequence, part: Span) -> bool:
    """Whether a fault is of all of a form, or of a part of it."""
    places = (fault.place, *(label.place for label in fault.labels))
    return any(p == form.span or (isinstance(p, Span) and part.start <= p.start < part.end) for p in places)


def element(value: Value, arguments: tuple[Value, ...], form: Sequence) -> Value:
    """``(v 2)``, ``(M 1 3)``, ``(leg i)``, ``(cam camera)``, ``(theta finger 2)``; more arguments go on inside."""
    if not arguments:
        raise MbmError(faults.bad_index(form.span, f"{describe(value)} is indexed, but no index is given"))
    forms = form.items[1:]
    position = 0
    while position < len(arguments):
        value, used = _step(value, arguments[position:], forms[position:], form)
        position += used
    return value


def _step(value: Value, arguments: tuple[Value, ...], forms: tuple[Form, ...], form: Sequence) -> tuple[Value, int]:
    span = forms[0].span
    if isinstance(value, FamilyValue):
        return value.member(family_key(value, arguments[0], span)), 1
    if isinstance(value, Opaque):
        return opaque_element(value, integer(arguments[0], span, "an index")), 1
    if isinstance(value, ListValue):
        return value.items[_position(arguments[0], len(value.items), span)], 1
    if not isinstance(value, Array):
        before = " ".join(each.span.text for each in form.items[: len(form.items) - len(forms)])
        shown = f"`({before})` is {describe(value)}, which" if len(forms) < len(form.items) - 1 else describe(value)
        raise MbmError(faults.bad_index(form.span, f"{shown} cannot be indexed"))
    if not value.is_matrix:
        return value.elements[_position(arguments[0], value.shape[0], span)], 1
    height, width = value.shape
    first = _position(arguments[0], height, span) * width
    row = value.elements[first : first + width]
    if len(arguments) == 1:
        return Array((len(row),), row), 1
    return row[_position(arguments[1], len(row), forms[1].span)], 2


def _position(value: Value, length: int, span: Span) -> int:
    index = integer(value, span, "an index (a whole number)")
    if not 1 <= index <= length:
        raise MbmError(faults.bad_index(span, f"index {index} is outside 1 … {length}", "indices count from 1"))
    return index - 1


def family_key(family: FamilyValue, value: Value, span: Span) -> str | float | Column | TextColumn:
    """A literal key, checked, or the column that holds the key of each row."""
    if isinstance(value, Column | TextColumn):
        return value
    key: str | float
    if isinstance(value, str):
        key = value
    else:
        number = scalar(value, span, f"a key of `{family.name}`")
        if not isinstance(number, Number):
            raise MbmError(
                faults.bad_index(span, f"the key of `{family.name}` is computed", "use a literal or a column as key")
            )
        key = nearest(number.value)
    if key not in family.keys:
        shown = f"`{key}`" if isinstance(key, str) else _key_text(key)
        hint = suggestion(_key_text(key), sorted(_key_text(k) for k in family.keys), None)
        raise MbmError(faults.bad_index(span, f"`{family.name}` has no member {shown}", hint))
    return key


def _key_text(key: str | float) -> str:
    return key if isinstance(key, str) else f"{key:g}"
