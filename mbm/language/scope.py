"""Where names are looked up: a chain of scopes; and asking a value for what a form wants: numbers, vectors, counts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence as Many
from contextlib import contextmanager
from fractions import Fraction

from mbm.expression.algebra import UndefinedValueError, apply, constant_value, subtract, wrap
from mbm.expression.nodes import (
    Apply,
    Column,
    Component,
    Expression,
    Number,
    Opaque,
    Operation,
    Parameter,
    leaves,
    nearest,
)
from mbm.language import faults
from mbm.language.values import (
    FORMS,
    SCALARS,
    Array,
    Builtin,
    Callable_,
    ListValue,
    Placeable,
    RotationValue,
    Scope,
    StaticColumnNeeded,
    TextColumn,
    Value,
    describe,
)
from mbm.text.build import numeral, sequence
from mbm.text.types import MbmError, Sequence, Span, Symbol
from mbm.values import dataclass


@contextmanager
def opened(names: list[str], name: str, span: Span) -> Iterator[None]:
    """A name is being evaluated inside, one more of ``names``.

    Raises:
        MbmError: it is one of them: its definition needs itself.

    """
    if name in names:
        raise MbmError(faults.circular_definition(span, (*names[names.index(name) :], name)))
    names.append(name)
    try:
        yield
    finally:
        names.pop()


@dataclass(frozen=True, slots=True, eq=False)
class EmptyScope:
    """The outermost scope: nothing."""

    def lookup(self, name: str, span: Span) -> Value | None:
        """Nothing is known here."""
        return None

    def names(self) -> Iterator[str]:
        """No names."""
        return iter(())

    def columns(self) -> None:
        """No row is at hand."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalScope:
    """Names bound by ``let``, ``lambda``, parameters and ``for`` over those of ``parent``."""

    variables: Mapping[str, Value]
    parent: Scope

    def lookup(self, name: str, span: Span) -> Value | None:
        """The innermost binding. Not recursive: a long `let*` nests as many scopes as it has names."""
        scope: Scope = self
        while isinstance(scope, LocalScope):
            value = scope.variables.get(name)
            if value is not None:
                return value
            scope = scope.parent
        return scope.lookup(name, span)

    def names(self) -> Iterator[str]:
        """The names bound here, then those around."""
        scope: Scope = self
        while isinstance(scope, LocalScope):
            yield from scope.variables
            scope = scope.parent
        yield from scope.names()

    def columns(self) -> tuple[str, tuple[str, ...]] | None:
        """Those of the scope around."""
        scope: Scope = self
        while isinstance(scope, LocalScope):
            scope = scope.parent
        return scope.columns()


_ROWS = (Array, ListValue, Placeable)
"""What may be the row of a matrix, or a vector."""


def scalar(value: Value, span: Span, wanted: str = "a number") -> Expression:
    """A number, not a condition."""
    if isinstance(value, SCALARS) and not (isinstance(value, Apply) and value.is_condition):
        return value
    if isinstance(value, TextColumn):
        raise MbmError(faults.text_in_number_column(span, value.name, value.sample, value.sample_place))
    first = None
    if isinstance(value, Callable_):
        used = value.usage if isinstance(value, Builtin) and value.usage.startswith("((") else f"({value.name} …)"
        first = f"a function stands first in a list: `{used}`"
    raise MbmError(faults.wrong_kind(span, wanted, describe(value), first))


def assemble(values: Many[Value], spans: Many[Span]) -> Array:
    """A vector of scalars, or a matrix of vectors of one length."""
    if values and all(isinstance(v, _ROWS) for v in values):
        rows = [vector(v, s).elements for v, s in zip(values, spans, strict=True)]
        width = len(rows[0])
        for row, span in zip(rows, spans, strict=True):
            if len(row) != width:
                raise MbmError(faults.ragged_matrix(span, width, len(row)))
        return Array((len(rows), width), tuple(e for row in rows for e in row))
    return Array((len(values),), tuple(scalar(v, s) for v, s in zip(values, spans, strict=True)))


def vector(value: Value, span: Span, length: int | None = None, hint: str | None = None) -> Array:
    """A vector: also a list of numbers, a point, and (with ``length``) the elements of an opaque name."""
    wanted = "a vector" if length is None else f"a vector of length {length}"
    if isinstance(value, Placeable):
        point = value.as_point()
        if point is None:
            raise MbmError(faults.wrong_kind(span, wanted, value.kind, hint))
        value = point
    if isinstance(value, ListValue):
        value = Array((len(value.items),), tuple(scalar(v, span) for v in value.items))
    if isinstance(value, Opaque) and length is not None:
        value = Array((length,), tuple(opaque_element(value, i + 1) for i in range(length)))
    if isinstance(value, TextColumn):
        raise MbmError(faults.text_in_number_column(span, value.name, value.sample, value.sample_place))
    if not isinstance(value, Array) or value.is_matrix:
        raise MbmError(faults.wrong_kind(span, wanted, describe(value), hint))
    if length is not None and value.shape[0] != length:
        raise MbmError(faults.length_clash(span, describe(value), wanted, hint))
    return value


def matrix(value: Value, span: Span) -> Array:
    """A matrix; a rotation is its matrix."""
    if isinstance(value, RotationValue):
        return value.matrix
    if not isinstance(value, Array) or not value.is_matrix:
        raise MbmError(faults.wrong_kind(span, "a matrix", describe(value)))
    return value


def condition(value: Value, span: Span) -> bool | Apply:
    """A truth value known while compiling, or a condition."""
    if isinstance(value, bool) or (isinstance(value, Apply) and value.is_condition):
        return value
    raise MbmError(faults.not_a_condition(span, describe(value)))


def text(value: Value, span: Span, wanted: str = "a text") -> str:
    """A text known while compiling; a column of texts is asked for by way of ``StaticColumnNeeded``."""
    if isinstance(value, TextColumn):
        raise StaticColumnNeeded(value, span)
    if not isinstance(value, str):
        raise MbmError(faults.wrong_kind(span, wanted, describe(value)))
    return value


def static_number(value: Value, span: Span, wanted: str = "a number known while compiling") -> int | Fraction | float:
    """The value of a number that is needed while compiling.

    Raises:
        StaticColumnNeeded: it depends on a data column.
        MbmError: it depends on an unknown, or is no number.

    """
    node = scalar(value, span, wanted)
    if isinstance(node, Number):
        return node.value
    for leaf in leaves((node,)):
        if isinstance(leaf, Column):
            raise StaticColumnNeeded(leaf, span)
        if isinstance(leaf, Component):
            raise MbmError(faults.not_static(span, f"`{leaf.unknown}`" if leaf is node else "this"))
        if isinstance(leaf, Opaque | Parameter):
            raise MbmError(faults.not_static(span, "this"))
    try:
        found = constant_value(node)
    except UndefinedValueError as error:
        raise MbmError(faults.undefined_value(span, str(error))) from None
    if found is None:
        raise MbmError(faults.not_static(span, "this condition"))
    return found


def difference(a: Expression, b: Expression, span: Span) -> Expression:
    """``a`` − ``b``, wrapped where it is an angle.

    Raises MbmError (`undefined-value`) where constants differ by more than a number can hold.
    """
    try:
        node = subtract(a, b, span)
    except UndefinedValueError as error:
        raise MbmError(faults.undefined_value(span, str(error))) from None
    return wrap(node, span) if node.angle else node


def integer(value: Value, span: Span, wanted: str = "a whole number") -> int:
    """A whole number known while compiling."""
    found = static_number(value, span, wanted)
    if isinstance(found, int):
        return found
    if not math.isfinite(nearest(found)) or found != int(found):
        raise MbmError(faults.wrong_kind(span, wanted, f"{nearest(found):g}"))
    return int(found)


def list_items(value: Value, span: Span) -> tuple[Value, ...]:
    """The elements of what may be walked along: a list, a vector, the rows of a matrix, a quoted list."""
    if isinstance(value, ListValue):
        return value.items
    if isinstance(value, Array):
        return tuple(Array((value.shape[1],), r) for r in value.rows()) if value.is_matrix else value.elements
    if isinstance(value, Sequence):
        return value.items
    raise MbmError(faults.wrong_kind(span, "a list or a vector", describe(value)))


def opaque_element(value: Opaque, index: int) -> Opaque:
    """The element of a name that is not evaluated yet."""
    return Opaque(sequence((value.form, numeral(index, value.form.span)), value.form.span), value.span)


def conditional(test: Apply, then: Value, other: Value, span: Span) -> Value:
    """The piecewise value of ``if`` with a condition on data or unknowns."""
    if isinstance(then, Array | ListValue | Placeable) and isinstance(other, Array | ListValue | Placeable):
        first = then if isinstance(then, Array) else vector(then, span)
        second = other if isinstance(other, Array) else vector(other, span)
        if first.shape != second.shape:
            raise MbmError(faults.length_clash(span, describe(first), describe(second)))
        pairs = zip(first.elements, second.elements, strict=True)
        return Array(first.shape, tuple(apply(Operation.IF, test, a, b, span=span) for a, b in pairs))
    if isinstance(then, bool) or isinstance(other, bool):
        raise MbmError(faults.wrong_kind(span, "a number or a vector in each branch", "a truth value"))
    return apply(Operation.IF, test, scalar(then, span), scalar(other, span), span=span)


def is_form(value: Value) -> bool:
    """Whether a value is a quoted form."""
    return isinstance(value, FORMS)


def symbol_name(value: Value, span: Span) -> str:
    """The name that a quoted symbol or a text holds."""
    if isinstance(value, Symbol):
        return value.name
    return text(value, span, "a name")
