"""The words of shapes and features, and the whole vocabulary that a program is evaluated with.

`get-vertex-from-model` gives the form of a point in its model's frame (LANGUAGE §2; Oyama & Tachi 1989, Fig. 6).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from types import MappingProxyType

from mbm.expression.forms import to_form
from mbm.language import faults as language_faults
from mbm.language.scope import list_items, symbol_name
from mbm.language.special import SPECIAL_FORMS
from mbm.language.values import (
    SCALARS,
    Array,
    Builtin,
    Call,
    Callable_,
    Macro,
    PoseValue,
    RotationValue,
    Value,
    Vocabulary,
    describe,
)
from mbm.language.vocabulary import (
    arithmetic,
    comparison,
    curve_observables,
    curves,
    directions,
    external,
    frames,
    lines,
    lists,
    rotations,
    vectors,
)
from mbm.shapes import faults, silhouettes
from mbm.shapes.description import swept_shape
from mbm.shapes.features import (
    Place,
    Segment,
    element_segment,
    enter,
    find_parts,
    flat_segments,
    frame_feature,
    number_segment,
    numbered,
    part_names,
    resolve,
    root,
    segments_of,
)
from mbm.shapes.heads import SWEEP_USAGES
from mbm.shapes.library import library_models
from mbm.shapes.meshes.form import MeshMaker
from mbm.shapes.model import Model, opaque_argument
from mbm.shapes.types import ModelFunction, Projection, Shape, Step
from mbm.text.build import call as list_form, sequence
from mbm.text.suggest import closest
from mbm.text.types import Bracket, Form, MbmError, Numeral, Sequence, Span, Symbol
from mbm.values import dataclass


def vertex_form(call: Call) -> Value:
    """``(get-vertex-from-model MODEL PATH)``; MODEL is a shape or a quoted call of a model."""
    model, path = call.arguments
    at = [f.span for f in call.forms] if len(call.forms) == 2 else [call.span, call.span]
    shape = _quoted_shape(model, call) if isinstance(model, Sequence | Symbol) else model
    if not isinstance(shape, Shape):
        raise MbmError(language_faults.wrong_kind(at[0], "a model with its arguments, quoted", describe(shape)))
    feature = resolve(call, shape, segments_of(path, at[1], call))
    if len(feature.points) != 1:
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


@dataclass(frozen=True, slots=True, eq=False)
class FeatureFunction(Macro):
    """A function ``(kind MODEL part… [n])`` whose parts are names, not variables."""

    name: str
    usage: str
    doc: str
    minimum: int
    function: Callable[[Call, Shape, tuple[Form, ...]], Value] = field(repr=False)

    def call(self, call: Call) -> Value:
        """The feature in the frame of the model.

        Raises:
            MbmError: no such part or feature, or MODEL is no shape.
            StaticColumnNeeded: a part or a number stands in a data column.

        """
        if len(call.forms) < self.minimum:
            raise MbmError(language_faults.wrong_arity(call.span, self.name, self.usage, len(call.forms)))
        model = call.forms[0]
        shape = _shape(call.evaluator.wanted(model, call.scope), model.span)
        return self.function(call, shape, call.forms[1:])


@dataclass(frozen=True, slots=True, eq=False)
class ShapeMaker(Macro):
    """A shape description that has a value of its own: what a profile sweeps."""

    name: str
    usage: str
    doc: str

    def call(self, call: Call) -> Shape:
        """The shape.

        Raises:
            MbmError: with a diagnostic at the innermost form that is wrong.
            StaticColumnNeeded: the value of a data column decides what the shape is.

        """
        return swept_shape(call)


_SWEEPS = {
    "extrude": "What a plane shape sweeps from z = 0 to z = length.",
    "revolve": "What a plane shape sweeps about z, its x pointing outward and its y up.",
    "sweep": "What a plane shape sweeps along a curve, its z pointing along the curve.",
}


def _shape(value: Value, span: Span) -> Shape:
    if not isinstance(value, Shape):
        raise MbmError(language_faults.wrong_kind(span, "a model with its arguments", describe(value)))
    return value


def _numbered(kind: str) -> Callable[[Call, Shape, tuple[Form, ...]], Value]:
    def function(call: Call, shape: Shape, forms: tuple[Form, ...]) -> Value:
        place = _inside(call, root(shape), forms[:-1])
        number = number_segment(forms[-1], call)
        if not isinstance(number.step, int):
            raise MbmError(faults.bad_path(number.span, "the number of a feature is wanted"))
        return numbered(call, place, kind, number.step, number.span).value(call)

    return function


def _of_frame(kind: str) -> Callable[[Call, Shape, tuple[Form, ...]], Value]:
    def function(call: Call, shape: Shape, forms: tuple[Form, ...]) -> Value:
        return frame_feature(_inside(call, root(shape), forms), kind, call.span).value(call)

    return function


def _inside(call: Call, place: Place, forms: tuple[Form, ...]) -> Place:
    """The level that a row of part names leads to."""
    for form in forms:
        for segment in _part_segments(call, place, form):
            place = enter(call, place, segment)
    return place


def _part_segments(call: Call, place: Place, form: Form) -> tuple[Segment, ...]:
    """What stands in the place of a part: its name, an array element, or a variable or text that holds names."""
    if isinstance(form, Symbol):
        value = call.scope.lookup(form.name, form.span)
        if find_parts(call, place, form.name):
            if value is not None:
                raise MbmError(faults.ambiguous_part(form.span, form.name, place.owner))
            return (Segment(step=form.name, span=form.span),)
        if value is None:
            raise MbmError(faults.unknown_part(form.span, form.name, place.owner, part_names(call, place)))
        return flat_segments(symbol_name(value, form.span), form.span)
    if isinstance(form, Numeral):
        raise MbmError(faults.bad_path(form.span, "the name of a part is wanted here; numbers stand last"))
    if isinstance(form, Sequence) and form.head is not None and _is_element(call, form):
        return (element_segment(form, call),)
    return flat_segments(symbol_name(call.evaluator.evaluate(form, call.scope), form.span), form.span)


def _is_element(call: Call, form: Sequence) -> bool:
    """Whether ``(leg 2)`` can only mean an array of the model: its head is nothing here."""
    words = call.evaluator.vocabulary
    head = form.head or ""
    known = head in words.functions or head in words.special_forms
    return not known and call.scope.lookup(head, form.items[0].span) is None


def _feature(call: Call) -> Value:
    model, path = call.arguments
    at = call.forms if len(call.forms) == 2 else (call.form, call.form)
    shape = _shape(call.evaluator.arrived(model, at[0], call.scope), at[0].span)
    return resolve(call, shape, segments_of(path, at[1].span, call)).value(call)


FEATURE_FUNCTIONS: tuple[FeatureFunction | ShapeMaker | MeshMaker | Builtin, ...] = (
    MeshMaker(),
    *(ShapeMaker(name, usage, _SWEEPS[name]) for name, usage in SWEEP_USAGES.items()),
    FeatureFunction("vertex", "(vertex MODEL part… n)", "Vertex n of a part, as a vector.", 2, _numbered("vertex")),
    FeatureFunction("line", "(line MODEL part… n)", "Line n of a part.", 2, _numbered("line")),
    FeatureFunction("plane", "(plane MODEL part… n)", "Plane n of a part.", 2, _numbered("plane")),
    FeatureFunction("origin", "(origin MODEL part…)", "The origin of a part's frame.", 1, _of_frame("origin")),
    FeatureFunction("axis", "(axis MODEL part…)", "The line along z of a part's frame.", 1, _of_frame("axis")),
    Builtin(
        name="feature",
        usage="(feature MODEL PATH)",
        doc='The feature at the end of a path: \'(board (vertex 1)) or "board/vertex/1".',
        minimum=2,
        maximum=2,
        function=_feature,
        takes_forms=True,
    ),
    Builtin(
        name="get-vertex-from-model",
        usage="(get-vertex-from-model 'MODEL 'PATH)",
        doc="The form of a vertex, or of another point, in the frame of its model.",
        minimum=2,
        maximum=2,
        function=vertex_form,
        takes_forms=True,
    ),
)
"""What this stage adds to the functions of the language."""


def vocabulary() -> Vocabulary:
    """Special forms, functions, the library's models, and the names that come later."""
    rooms = (
        arithmetic,
        comparison,
        curve_observables,
        curves,
        directions,
        external,
        frames,
        lines,
        lists,
        rotations,
        vectors,
    )
    functions: dict[str, Callable_] = {f.name: f for room in rooms for f in room.FUNCTIONS}
    functions.update((f.name, f) for f in (*FEATURE_FUNCTIONS, *silhouettes.FUNCTIONS))
    words = Vocabulary(
        special_forms=SPECIAL_FORMS, functions=MappingProxyType(dict(functions)), not_yet=MappingProxyType({})
    )
    functions.update(library_models(words))
    return Vocabulary(special_forms=SPECIAL_FORMS, functions=MappingProxyType(functions), not_yet=MappingProxyType({}))
