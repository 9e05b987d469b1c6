"""``get-vertex-from-model``: the form of a point in its model's frame (LANGUAGE §2; Oyama & Tachi 1989, Fig. 6)."""

from __future__ import annotations

from mbm.expression.forms import to_form
from mbm.language import faults as language_faults
from mbm.language.coerce import list_items
from mbm.language.values import SCALARS, Array, Call, PoseValue, RotationValue, Value, describe
from mbm.shapes import faults
from mbm.shapes.features import resolve
from mbm.shapes.model import Model
from mbm.shapes.opaque import opaque_argument
from mbm.shapes.paths import segments_of
from mbm.shapes.types import ModelFunction, Projection, Shape, Step
from mbm.text.build import call as list_form
from mbm.text.build import sequence
from mbm.text.suggest import closest
from mbm.text.types import Bracket, Form, MbmError, Sequence, Span, Symbol


def vertex_form(call: Call) -> Value:
    """``(get-vertex-from-model MODEL PATH)``; MODEL is a shape or a quoted call of a model."""
    model, path = call.arguments
    at = [f.span for f in call.forms] if len(call.forms) == 2 else [call.span, call.span]
    shape = _quoted_shape(model, call) if isinstance(model, Sequence | Symbol) else model
    if not isinstance(shape, Shape):
        raise MbmError(language_faults.wrong_kind(at[0], "a model with its arguments, quoted", describe(shape)))
    feature = resolve(call, shape, segments_of(path, at[1], call))
    if len(feature.points) > 1:
        raise MbmError(faults.bad_path(feature.span, f"a point is wanted, but the path leads to a {feature.kind}"))
    form = vector_form(feature.points[0], call.span)
    for step in reversed(feature.steps):
        form = _wrapped(step, form, call.span)
    return form


def _quoted_shape(form: Form, call: Call) -> Value:
    """The shape of a quoted call of a model whose arguments are names of the place where the result will stand."""
    evaluator = call.evaluator
    if not isinstance(form, Sequence) or form.head is None:
        raise MbmError(language_faults.bad_form(form.span, "a quoted model is a list", "'(desk x y r h)"))
    function = evaluator.vocabulary.functions.get(form.head)
    if not isinstance(function, ModelFunction):
        models = [n for n, f in evaluator.vocabulary.functions.items() if isinstance(f, ModelFunction)]
        head = form.items[0].span
        raise MbmError(language_faults.unknown_name(head, form.head, closest(form.head, models), is_head=True))
    if isinstance(function, Model) and function.log is not None:
        function.log.note_quoted(form)
    arguments = tuple([opaque_argument(evaluator, item) for item in form.items[1:]])
    return evaluator.call(function, arguments, form, call.scope)


def _wrapped(step: Step, inner: Form, span: Span) -> Form:
    """``inner`` in the form of one step."""
    if isinstance(step, Projection):
        return list_form("perse", (inner,), span)
    argument = step.argument
    if step.head == "transform" and isinstance(argument, PoseValue):
        turned = list_form("rotate", (_argument_form(argument.rotation, span), inner), span)
        if argument.scale is not None:
            turned = list_form("scale", (to_form(argument.scale, span), turned), span)
        offset = Array((len(argument.translation),), argument.translation)
        return list_form("trans", (vector_form(offset, span), turned), span)
    return list_form(step.head, (_argument_form(argument, span), inner), span)


def _argument_form(value: Value, span: Span) -> Form:
    if isinstance(value, SCALARS):
        return to_form(value, span)
    if isinstance(value, RotationValue):
        value = value.matrix
    if isinstance(value, Array) and value.is_matrix:
        rows = tuple(sequence(tuple(to_form(e, span) for e in row), span, Bracket.SQUARE) for row in value.rows())
        return sequence(rows, span, Bracket.SQUARE)
    return vector_form(value, span)


def vector_form(value: Value, span: Span) -> Form:
    """``(list a b c)`` for a vector or a list of numbers."""
    items = [item for item in list_items(value, span) if isinstance(item, SCALARS)]
    return list_form("list", tuple(to_form(item, span) for item in items), span)
