"""Arguments that stay forms: what ``get-vertex-from-model`` evaluates a quoted model with."""

from __future__ import annotations

from mbm.expression.algebra import number
from mbm.expression.forms import number_form
from mbm.expression.nodes import Column, Number, Opaque, Parameter, leaves
from mbm.language.coerce import opaque_element
from mbm.language.values import SCALARS, Array, Evaluator, FamilyValue, ListValue, TextColumn, Value
from mbm.text.build import sequence, symbol, text
from mbm.text.types import Bracket, Form, Keyword, Numeral, Sequence, Span, Symbol, Text


class OpaqueFamily(FamilyValue):
    """A family of unknowns whose members are forms ``(name key)``."""

    __slots__ = ()


def opaque_argument(evaluator: Evaluator, form: Form) -> Value:
    """What stands for an argument that is evaluated only where the form built from it arrives.

    Literals are what they are, literal vectors go element by element. A name that the problem knows as a vector, matrix
    or family keeps its shape, with forms for elements; everything else is one number given by its form.
    """
    if isinstance(form, Numeral | Text):
        return evaluator.evaluate(form, evaluator.world)
    if isinstance(form, Keyword):
        return form
    if isinstance(form, Symbol):
        return _opaque_name(evaluator, form)
    if form.bracket is Bracket.SQUARE or form.head == "list":
        items = form.items if form.bracket is Bracket.SQUARE else form.items[1:]
        return ListValue(tuple([opaque_argument(evaluator, item) for item in items]))
    return Opaque(form, form.span)


def _opaque_name(evaluator: Evaluator, form: Symbol) -> Value:
    known = evaluator.world.lookup(form.name, form.span)
    if isinstance(known, FamilyValue):
        return OpaqueFamily(known.name, known.keys, lambda key: Opaque(_member(form, key), form.span))
    if isinstance(known, Array):
        name = Opaque(form, form.span)
        rows = [opaque_element(name, i + 1) for i in range(known.shape[0])]
        if known.is_matrix:
            return Array(known.shape, tuple(_inner(row, j + 1) for row in rows for j in range(known.shape[1])))
        return Array(known.shape, tuple(rows))
    return Opaque(form, form.span)


def _inner(row: Opaque, column: int) -> Opaque:
    """``(M i j)`` for the row ``(M i)``."""
    items = row.form.items if isinstance(row.form, Sequence) else (row.form,)
    span = row.form.span
    return Opaque(sequence((*items, number_form(number(column), span)), span), row.span)


def _member(name: Symbol, key: str | float | Column | TextColumn) -> Form:
    return sequence((name, _key(key, name.span)), name.span)


def _key(key: str | float | Column | TextColumn, span: Span) -> Form:
    if isinstance(key, str):
        return text(key, span)
    if isinstance(key, Column | TextColumn):
        return symbol(key.name, span)
    return number_form(Number(int(key) if key == int(key) else key), span)


def is_opaque(value: Value) -> bool:
    """Whether a value holds forms that are not evaluated yet, or what runs along a curve."""
    if isinstance(value, SCALARS):
        return any(isinstance(leaf, Opaque | Parameter) for leaf in leaves((value,)))
    if isinstance(value, Array):
        return any(isinstance(leaf, Opaque | Parameter) for leaf in leaves(value.elements))
    if isinstance(value, ListValue):
        return any(is_opaque(item) for item in value.items)
    return isinstance(value, OpaqueFamily)
