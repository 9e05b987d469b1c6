"""``(constants (name form)…)``: known numbers, which the caller may override."""

from __future__ import annotations

import math

from mbm.expression.algebra import UndefinedValueError, constant_value
from mbm.expression.dimension import Dimension
from mbm.expression.inference import Declared, Inference
from mbm.expression.nodes import Constant, Expression, Number, leaves
from mbm.language import faults as language_faults
from mbm.language.coerce import vector
from mbm.language.values import SCALARS, Array, ListValue, Value
from mbm.problem.elaboration import Workspace
from mbm.problem.scopes import Entry
from mbm.problem.types import ConstantValue, Override, Overrides
from mbm.text.reader import read
from mbm.text.types import Form, MbmError, Sequence, Source, Span, Symbol

USAGE = "(constants (name form)…)"


def read_constants(work: Workspace, clause: Sequence, overrides: Overrides) -> list[str]:
    """Declare the constants of a clause; returns their names in order."""
    names = []
    for item in clause.items[1:]:
        with work.collecting():
            if not (isinstance(item, Sequence) and len(item.items) == 2 and isinstance(item.items[0], Symbol)):
                raise MbmError(language_faults.bad_form(item.span, "a constant is (name form)", USAGE))
            name, form = item.items[0], item.items[1]
            _declare(work, name.name, form, name.span, overrides.get(name.name))
            names.append(name.name)
    return names


def _declare(work: Workspace, name: str, form: Form, span: Span, override: Override | None) -> None:
    def make() -> Value:
        value = work.evaluator.wanted(form, work.scope)
        if override is not None:
            value = _overridden(work, value, override)
        return _named(value, name, form.span)

    work.scope.add(name, Entry("constant", span, make))


def given_value(work: Workspace, name: str, text: str) -> Value:
    """The value of a text given from outside for a name."""
    source = Source(f"<{name}>", text)
    forms = read(source)
    if len(forms) != 1:
        span = Span(source=source, start=0, end=len(text))
        raise MbmError(language_faults.wrong_kind(span, "one value", f"{len(forms)} forms"))
    return work.evaluator.wanted(forms[0], work.scope)


def _overridden(work: Workspace, declared: Value, override: Override) -> Value:
    if override.text is not None:
        return given_value(work, override.name, override.text)
    values = override.values or ()
    old = declared.elements if isinstance(declared, Array) else (declared,) * len(values)
    dimensions = [o.dimension if isinstance(o, Number | Constant) else None for o in old]
    dimensions += [None] * (len(values) - len(dimensions))
    numbers = tuple(Number(v, d) for v, d in zip(values, dimensions, strict=False))
    return numbers[0] if len(numbers) == 1 and not isinstance(declared, Array) else Array((len(numbers),), numbers)


def _named(value: Value, name: str, span: Span) -> Value:
    """The value as constants that carry their name, so that equations show it."""
    if isinstance(value, str | bool):
        return value
    if isinstance(value, SCALARS):
        return _constant(value, name, span)
    if isinstance(value, ListValue):
        value = vector(value, span)
    if isinstance(value, Array):
        elements = tuple(_constant(e, f"{name}[{i + 1}]", span) for i, e in enumerate(value.elements))
        return Array(value.shape, elements)
    return value


def _constant(node: Expression, name: str, span: Span) -> Constant:
    try:
        found = constant_value(node)
    except UndefinedValueError as error:
        raise MbmError(language_faults.undefined_value(span, str(error))) from None
    if found is None:
        raise MbmError(language_faults.not_static(span, f"the constant `{name}`"))
    dimension = node.dimension if isinstance(node, Number | Constant) else _dimension(node)
    number = float(found)
    if not math.isfinite(number):
        raise MbmError(language_faults.undefined_value(span, name))
    return Constant(name, number, dimension, span, node.angle)


def _dimension(node: Expression) -> Dimension | None:
    stated = any(isinstance(leaf, Number | Constant) and leaf.dimension is not None for leaf in leaves((node,)))
    return Inference(Declared(components={}, columns={}, same_column={})).dimension(node) if stated else None


def constant_values(work: Workspace, names: list[str], span: Span) -> tuple[ConstantValue, ...]:
    """The numeric constants with their values, evaluated now so that faults show even in unused ones."""
    found = []
    for name in names:
        with work.collecting():
            value = work.scope.own(name, span)
            entry = work.scope.entries[name]
            elements = value.elements if isinstance(value, Array) else (value,)
            numbers = tuple(e.value for e in elements if isinstance(e, Constant))
            if numbers:
                found.append(ConstantValue(name=name, values=numbers, span=entry.span))
    return tuple(found)
