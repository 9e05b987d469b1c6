"""Expressions as text forms: for ``expand``, for messages, and for forms that functions of the user give back."""

from __future__ import annotations

from fractions import Fraction
from math import lcm, prod

from mbm.expression.nodes import (
    Apply,
    Column,
    ColumnMember,
    Component,
    Constant,
    Expression,
    LiteralMember,
    Number,
    Opaque,
    Operation,
    Outlined,
    Output,
    Parameter,
    nearest,
    postorder,
)
from mbm.expression.units import Dimension
from mbm.text.build import numeral, sequence, symbol, text
from mbm.text.types import Bracket, Form, Keyword, Span, Text


def to_form(node: Expression, span: Span) -> Form:
    """The form that evaluates to ``node`` where the names it uses are visible."""
    forms: dict[int, Form] = {}
    for each in postorder((node,)):
        forms[id(each)] = _form(each, forms, span)
    return forms[id(node)]


def number_form(node: Number, span: Span) -> Form:
    """A number as a numeral with its SI unit; ``(* 1.5rad (^ 1m 1/2))`` where a power of the unit is not whole."""
    if node.dimension is not None and any(e.denominator != 1 for e in node.dimension.exponents):
        return _fractional(node.value, node.dimension, span)
    unit = node.dimension.symbol() if node.dimension is not None else ""
    value = node.value
    if isinstance(value, Fraction) and unit:
        value = nearest(value)
    return numeral(value, span, unit or None)


def _fractional(value: int | Fraction | float, dimension: Dimension, span: Span) -> Form:
    """The common denominator of the powers stands outside: the rest is a unit that can be read.

    A factor without a unit would take whatever dimension its use asks for; one in rad has none.
    """
    denominator = lcm(*(e.denominator for e in dimension.exponents))
    whole = numeral(1, span, (dimension**denominator).symbol())
    root = sequence((symbol("^", span), whole, numeral(Fraction(1, denominator), span)), span)
    return sequence((symbol("*", span), numeral(value, span, "rad"), root), span)


def _form(node: Expression, forms: dict[int, Form], span: Span) -> Form:
    match node:
        case Number():
            form = number_form(node, span)
            return sequence((symbol(Operation.AS_ANGLE.value, span), form), span) if node.angle else form
        case Constant():
            return _constant_form(node, span)
        case Column():
            return symbol(node.name, span)
        case Opaque():
            return node.form
        case Parameter():
            return symbol(node.name, span)
        case Component():
            return _component_form(node, span)
        case Apply():
            return _apply_form(node, forms, span)


def _constant_form(node: Constant, span: Span) -> Form:
    """A constant by its name; ``v[2]`` and ``M[1,3]``, elements of one, as ``(v 2)`` and ``(M 1 3)``."""
    name, bracket, index = node.name.partition("[")
    if not bracket:
        return symbol(name, span)
    return sequence((symbol(name, span), *(numeral(int(i), span) for i in index.rstrip("]").split(","))), span)


def _component_form(node: Component, span: Span) -> Form:
    form: Form = symbol(node.unknown, span)
    if isinstance(node.member, LiteralMember):
        key = node.member.key
        form = sequence((form, Text(value=key, span=span) if isinstance(key, str) else _number(key, span)), span)
    elif isinstance(node.member, ColumnMember):
        form = sequence((form, symbol(node.member.column, span)), span)
    if node.index:
        form = sequence((form, *(numeral(i, span) for i in node.index)), span)
    return form


def _number(value: float, span: Span) -> Form:
    return numeral(int(value) if value == int(value) else value, span)


def _apply_form(node: Apply, forms: dict[int, Form], span: Span) -> Form:
    arguments = tuple(forms[id(a)] for a in node.arguments)
    if node.operation is Operation.NEGATE:
        return sequence((symbol("-", span), *arguments), span)
    if node.operation is Operation.WRAP:
        return arguments[0]
    if node.output is not None:
        return _external_form(node.output, arguments, span)
    return sequence((symbol(node.operation.value, span), *arguments), span)


def _external_form(output: Output, elements: tuple[Form, ...], span: Span) -> Form:
    """``((external "module:function" a [b c] :size n) i)``; a function of one number without the index."""
    external = output.external
    if isinstance(external, Outlined):
        call = external.form
        return call if external.size == 1 else sequence((call, numeral(output.index + 1, span)), span)
    left = list(elements)
    items: list[Form] = [symbol(Operation.EXTERNAL.value, span), text(external.function, span)]
    for shape in external.shapes:
        own = [left.pop(0) for _ in range(prod(shape))]
        if len(shape) == 2:
            own = [sequence(own[i : i + shape[1]], span, Bracket.SQUARE) for i in range(0, len(own), shape[1])]
        items.append(sequence(own, span, Bracket.SQUARE) if shape else own[0])
    items += [Keyword(name="size", span=span), numeral(external.size, span)]
    if external.jacobian is not None:
        items += [Keyword(name="jacobian", span=span), text(external.jacobian, span)]
    if external.batch:
        items += [Keyword(name="batch", span=span), symbol("true", span)]
    call = sequence(items, span)
    return call if external.size == 1 else sequence((call, numeral(output.index + 1, span)), span)
