"""Forms in equation position: ``(= MEASURED MODEL)``, or an expression that should be zero (LANGUAGE §4)."""

from __future__ import annotations

from mbm.expression.algebra import apply, wrap
from mbm.expression.nodes import Apply, Column, Component, Expression, Operation, externals, leaves
from mbm.expression.projection import Projection
from mbm.expression.rows import RowChoice
from mbm.expression.units import PLAIN, TAKE_PREFIXES, Unit
from mbm.language import faults as language_faults
from mbm.language.functions import UserMacro
from mbm.language.scope import condition, conditional, difference, is_form, scalar, vector
from mbm.language.special import clauses_of_cond, cond_condition, let_scope
from mbm.language.values import (
    SCALARS,
    Array,
    Call,
    Evaluator,
    ImageLineValue,
    ListValue,
    Placeable,
    PoseValue,
    RotationValue,
    Scope,
    TextColumn,
    Value,
    describe,
)
from mbm.language.vocabulary.lines import line_difference
from mbm.language.vocabulary.rigid import geometric_difference, logarithms
from mbm.problem import faults
from mbm.text.types import Form, Keyword, MbmError, Sequence, Span
from mbm.values import dataclass

_RADIAN, _PIXEL = TAKE_PREFIXES["rad"], PLAIN["px"]


@dataclass(frozen=True, slots=True)
class Residual:
    """Components that should be zero, model − measured; differences of angles are wrapped.

    ``columns`` are those of the row at hand on the measured side, whatever else stands there; ``units`` are those of
    the first components, as far as the kind of thing says: radians of a rotation, pixels of a point in an image.
    ``projection`` is that of the model side, where it is the image of a point. ``model`` is that side, where it is
    a number, or an array of them. ``placed`` as in `Equation`.
    """

    components: tuple[Expression, ...]
    measured: tuple[Expression, ...] | None
    span: Span
    columns: tuple[str, ...] = ()
    units: tuple[Unit, ...] = ()
    projection: Projection | None = None
    model: Value | None = None
    placed: bool = False


def data_only(nodes: tuple[Expression, ...]) -> tuple[Expression, ...] | None:
    """``nodes`` if no unknown occurs in them, and no function in Python."""
    unknown = any(isinstance(leaf, Component) for leaf in leaves(nodes))
    return None if unknown or any(externals(nodes)) else nodes


def residuals(evaluator: Evaluator, form: Form, scope: Scope) -> list[Residual]:
    """The residuals that a form in equation position stands for."""
    head = form.head if isinstance(form, Sequence) else None
    if isinstance(form, Sequence):
        if head in ("let", "let*"):
            inner, body = let_scope(evaluator, form, scope)
            return [r for each in body for r in residuals(evaluator, each, inner)]
        if head == "if" and len(form.items) == 4:
            return _branch(evaluator, form, scope)
        if head == "cond":
            return _cond(evaluator, form, scope)
        if head == "=":
            return [_equation(evaluator, form, scope)]
    value = expanded(evaluator, form, scope)
    if is_form(value) and not isinstance(value, Keyword):
        evaluator.budget.enter(form)
        try:
            return residuals(evaluator, value, scope)  # type: ignore[arg-type]
        finally:
            evaluator.budget.leave()
    components = tuple(_wrapped(e, form.span) for e in _elements(value, form.span))
    return [Residual(components, None, form.span, units=_units(value))]


def expanded(evaluator: Evaluator, form: Form, scope: Scope) -> Value:
    """The value of a form; of a macro's call, the form that it stands for, which may be an equation."""
    if isinstance(form, Sequence) and form.head is not None:
        macro = evaluator.vocabulary.functions.get(form.head)
        if isinstance(macro, UserMacro):
            return macro.expand(Call(evaluator, form, scope, (), form.items[1:]))
    return evaluator.evaluate(form, scope)


def _branch(evaluator: Evaluator, form: Sequence, scope: Scope) -> list[Residual]:
    test_form, then, other = form.items[1:]
    test = condition(evaluator.wanted(test_form, scope), test_form.span)
    if isinstance(test, bool):
        return residuals(evaluator, then if test else other, scope)
    return _either(test, residuals(evaluator, then, scope), residuals(evaluator, other, scope), form.span)


def _cond(evaluator: Evaluator, form: Sequence, scope: Scope) -> list[Residual]:
    pending: list[tuple[Apply, list[Residual]]] = []
    last: list[Residual] | None = None
    for test_form, body in clauses_of_cond(form):
        test = cond_condition(evaluator, test_form, scope)
        if test is False:
            continue
        found = [r for each in body for r in residuals(evaluator, each, scope)]
        if test is True:
            last = found
            break
        pending.append((test, found))
    if last is None:
        raise MbmError(
            language_faults.bad_form(
                form.span, "no clause of `cond` is left for the other rows", "(cond … (else equation))"
            )
        )
    for test, found in reversed(pending):
        last = _either(test, found, last, form.span)
    return last


def _either(test: Apply, then: list[Residual], other: list[Residual], span: Span) -> list[Residual]:
    if [len(r.components) for r in then] != [len(r.components) for r in other]:
        raise MbmError(faults.unequal_branches(span))
    return [
        Residual(
            tuple(apply(Operation.IF, test, a, b, span=span) for a, b in zip(t.components, o.components, strict=True)),
            _either_measured(test, t, o, span),
            t.span,
            tuple(dict.fromkeys((*t.columns, *o.columns))),
            t.units if t.units == o.units else (),
            model=None if t.model is None or o.model is None else conditional(test, t.model, o.model, span),
            placed=t.placed and o.placed,
        )
        for t, o in zip(then, other, strict=True)
    ]


def _either_measured(test: Apply, then: Residual, other: Residual, span: Span) -> tuple[Expression, ...] | None:
    if then.measured is None or other.measured is None:
        return None
    pairs = zip(then.measured, other.measured, strict=True)
    return data_only(tuple(apply(Operation.IF, test, a, b, span=span) for a, b in pairs))


def _equation(evaluator: Evaluator, form: Sequence, scope: Scope) -> Residual:
    if len(form.items) != 3:
        message = f"`=` in `observe` takes two sides, here it has {len(form.items) - 1}"
        raise MbmError(language_faults.bad_form(form.span, message, "(= MEASURED MODEL)"))
    measured_form, model_form = form.items[1:]
    measured = evaluator.wanted(measured_form, scope)
    model = evaluator.wanted(model_form, scope)
    geometric, units = geometric_difference(measured, model, form.span), _units(measured)
    if geometric is None:
        geometric, units = line_difference(measured, model, form.span), (_RADIAN,)
    if geometric is not None:
        told = _elements(measured, measured_form.span)
        columns = _columns(told)
        placed = bool(columns) and data_only(told) is not None
        return Residual(geometric, None, form.span, columns, units, placed=placed)
    left, right = _elements(measured, measured_form.span), _elements(model, model_form.span)
    if len(left) != len(right) or _is_vector(measured) != _is_vector(model):
        raise MbmError(faults.unequal_sides(form.span, describe(measured), describe(model)))
    pairs = zip(left, right, strict=True)
    components = tuple(difference(b, a, form.span) for a, b in pairs)
    projection = model.projection if isinstance(model, Array) else None
    units = _units(model) or _units(measured)
    side = Array((len(right),), right) if _is_vector(model) else right[0]
    return Residual(components, data_only(left), form.span, _columns(left), units, projection, side)


def _units(value: Value) -> tuple[Unit, ...]:
    """The units of the first numbers by which a value differs from others of its kind."""
    if isinstance(value, ImageLineValue):
        return (_RADIAN,)
    if isinstance(value, Array):
        return (_PIXEL,) * 2 if value.projection is not None and value.projection.in_pixels else ()
    rotation = value.rotation if isinstance(value, PoseValue) else value
    return (_RADIAN,) * (1 if rotation.dimension == 2 else 3) if isinstance(rotation, RotationValue) else ()


def _columns(nodes: tuple[Expression, ...]) -> tuple[str, ...]:
    """Columns of the row at hand that nodes read."""
    found = (leaf for leaf in leaves(nodes) if isinstance(leaf, Column) and leaf.row is RowChoice.EACH)
    return tuple(dict.fromkeys(leaf.name for leaf in found))


def _is_vector(value: Value) -> bool:
    return not isinstance(value, SCALARS)


def _elements(value: Value, span: Span) -> tuple[Expression, ...]:
    if isinstance(value, bool) or (isinstance(value, Apply) and value.is_condition):
        raise MbmError(faults.condition_as_equation(span))
    if isinstance(value, RotationValue | PoseValue):
        return logarithms(value, span)
    if isinstance(value, ImageLineValue):
        return value.alpha, value.rho
    if isinstance(value, Array) and value.is_matrix:
        return value.elements
    if isinstance(value, ListValue | Array):
        return vector(value, span).elements
    if isinstance(value, Placeable) and not isinstance(value, TextColumn):
        if value.as_point() is None:
            raise MbmError(language_faults.not_available_yet(span, f"an equation of {value.kind}", "lines and curves"))
        return vector(value, span).elements
    return (scalar(value, span),)


def _wrapped(node: Expression, span: Span) -> Expression:
    return wrap(node, span) if node.angle else node
