"""The words of shapes and features, and the whole vocabulary that a program is evaluated with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from types import MappingProxyType

from mbm.language import faults as language_faults
from mbm.language.coerce import symbol_name
from mbm.language.special import SPECIAL_FORMS
from mbm.language.values import Builtin, Call, Callable_, Macro, Value, Vocabulary, describe
from mbm.language.vocabulary import (
    arithmetic,
    comparison,
    directions,
    frames,
    lines,
    lists,
    rotations,
    vectors,
)
from mbm.shapes import faults
from mbm.shapes.features import Place, enter, find_parts, frame_feature, numbered, part_names, resolve, root
from mbm.shapes.heads import FORMS_NOT_YET, LIBRARY_NOT_YET
from mbm.shapes.library import library_models
from mbm.shapes.paths import Segment, element_segment, flat_segments, number_segment, segments_of
from mbm.shapes.types import Shape
from mbm.shapes.vertex_form import vertex_form
from mbm.text.types import Form, MbmError, Numeral, Sequence, Span, Symbol
from mbm.values import dataclass

_OBSERVABLES_NOT_YET = {
    **dict.fromkeys(
        ("silhouette", "area", "centroid", "perimeter", "extent", "extreme", "contour-distance"), "silhouettes"
    ),
    **dict.fromkeys(("curve-distance", "extrema"), "image curves"),
}

NOT_YET = MappingProxyType({**FORMS_NOT_YET, **LIBRARY_NOT_YET, **_OBSERVABLES_NOT_YET})
"""Names of the language that come later, with the topic that brings them."""


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


FEATURE_FUNCTIONS: tuple[FeatureFunction | Builtin, ...] = (
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
    rooms = (arithmetic, comparison, directions, frames, lines, lists, rotations, vectors)
    functions: dict[str, Callable_] = {f.name: f for room in rooms for f in room.FUNCTIONS}
    functions.update((f.name, f) for f in FEATURE_FUNCTIONS)
    words = Vocabulary(
        special_forms=SPECIAL_FORMS, functions=MappingProxyType(dict(functions)), not_yet=MappingProxyType({})
    )
    functions.update(library_models(words))
    return Vocabulary(special_forms=SPECIAL_FORMS, functions=MappingProxyType(functions), not_yet=NOT_YET)
