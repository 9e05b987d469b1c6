"""Paths to features: walking them through a shape to what they name (LANGUAGE §3), and carrying points to the world."""

from __future__ import annotations

from collections.abc import Iterator

from mbm.expression.algebra import multiply
from mbm.expression.nodes import Number, Opaque
from mbm.language import faults as language_faults
from mbm.language.curves import CurveValue
from mbm.language.scope import integer, text, vector
from mbm.language.values import Array, Call, PoseValue, Transform, Value
from mbm.language.vocabulary.cameras import project_point
from mbm.language.vocabulary.vectors import move_point
from mbm.shapes import faults
from mbm.shapes.types import (
    CurveNode,
    Group,
    Line,
    ModelCall,
    Moved,
    NamedPoint,
    Node,
    Part,
    Plane,
    Shape,
    SmoothFace,
    Step,
    Surface,
    SweptSide,
)
from mbm.text.types import Bracket, Diagnostic, Form, MbmError, Numeral, Sequence, Span, Symbol, Text
from mbm.values import dataclass

NUMBERED = ("vertex", "line", "plane", "curve")
"""Kinds of features that take a number."""

KINDS = (*NUMBERED, "origin", "axis")
KINDS_NOT_YET = {"silhouette": "silhouettes"}


@dataclass(frozen=True, slots=True)
class ElementName:
    """``(leg 2)`` in a path: the name that an array of the model holds."""

    array: str
    index: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """One step of a path: a name, a number, or an element of an array of names."""

    step: str | int | ElementName
    span: Span

    @property
    def name(self) -> str | None:
        """The step, if it is a name."""
        return self.step if isinstance(self.step, str) else None


def segments_of(value: Value, span: Span, call: Call) -> tuple[Segment, ...]:
    """The segments of a path that is a quoted list, a quoted name, or a text.

    Raises:
        MbmError: not built like a path.
        StaticColumnNeeded: the path stands in a data column.

    """
    if isinstance(value, Sequence | Symbol | Text):
        return tuple(_written(value, call))
    return flat_segments(text(value, span, "a path: a quoted list or a text"), span)


def flat_segments(path: str, span: Span) -> tuple[Segment, ...]:
    """The segments of ``part/part/kind/number``."""
    pieces = [piece.strip() for piece in path.split("/")]
    if not all(pieces):
        raise MbmError(faults.bad_path(span, f"the path `{path}` has an empty piece" if path else "the path is empty"))
    return tuple(Segment(step=int(p) if _is_number(p) else p, span=span) for p in pieces)


def _is_number(piece: str) -> bool:
    return piece.isascii() and piece.isdigit() and len(piece) < 10


def _written(form: Form, call: Call) -> list[Segment]:
    """Lists nest at their end, ``(a (b (vertex 1)))``; what is written flat, ``(a b vertex 1)``, means the same."""
    segments: list[Segment] = []
    waiting: list[Form] = [form]
    while waiting:
        item = waiting.pop()
        if isinstance(item, Sequence) and item.bracket is Bracket.ROUND and item.items:
            head, *rest = item.items
            if isinstance(head, Sequence):
                segments.append(element_segment(head, call))
                waiting.extend(reversed(rest))
            else:
                waiting.extend(reversed(item.items))
        elif isinstance(item, Symbol) and segments and segments[-1].name in NUMBERED:
            segments.append(number_segment(item, call))
        elif isinstance(item, Symbol):
            segments.append(Segment(step=item.name, span=item.span))
        elif isinstance(item, Text):
            segments.extend(flat_segments(item.value, item.span))
        elif isinstance(item, Numeral):
            segments.append(number_segment(item, call))
        else:
            raise MbmError(faults.bad_path(item.span, "this is neither a name nor a number of a path"))
    return segments


def number_segment(form: Form, call: Call) -> Segment:
    """The number of a feature, known while compiling or read from a data column."""
    value = call.evaluator.wanted(form, call.scope)
    if isinstance(value, Opaque):
        raise MbmError(faults.bad_path(form.span, "the number of the feature is not known here"))
    return Segment(step=integer(value, form.span, "the number of a feature"), span=form.span)


def element_segment(form: Sequence, call: Call) -> Segment:
    """``(leg 2)``."""
    if form.head is None or len(form.items) != 2:
        raise MbmError(faults.bad_path(form.span, "a part's name is a symbol or an array element `(leg 2)`"))
    index = integer(call.evaluator.wanted(form.items[1], call.scope), form.items[1].span, "an index")
    return Segment(step=ElementName(form.head, index), span=form.span)


_NODES_PER_STEP = 4
"""Looking at a node is that much cheaper than evaluating a form."""

_ZERO = Array((3,), (Number(0),) * 3)
_UP = Array((3,), (Number(0), Number(0), Number(1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A level of a path: what stands there, the steps around it (outermost first), and how messages call it."""

    nodes: tuple[Node, ...]
    steps: tuple[Step, ...]
    owner: str
    own_name: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Feature:
    """A feature in the frame inside of ``steps`` (outermost first): its points, each of shape (3,), or its curve."""

    kind: str
    points: tuple[Array, ...]
    steps: tuple[Step, ...]
    span: Span
    curve: CurveValue | None = None

    def value(self, call: Call) -> Value:
        """The feature in the frame of its shape: a vector for a point, else a line, a plane or a curve."""
        if self.curve is not None:
            return carried_curve(self.curve, self.steps, call)
        points = tuple(carried(p, self.steps, call) for p in self.points)
        if self.kind == "plane":
            return Plane(points=points, span=self.span)
        return points[0] if len(points) == 1 else Line(start=points[0], end=points[1], span=self.span)


def root(shape: Shape) -> Place:
    """Where a path begins."""
    name = _root_name(shape.content)
    owner = f"`{name}`" if name is not None else "the shape"
    return Place(nodes=(shape.content,), steps=(), owner=owner, own_name=name)


def resolve(call: Call, shape: Shape, segments: tuple[Segment, ...]) -> Feature:
    """The feature that a path leads to; the root's own name may stand in front.

    Raises:
        MbmError: no such part or feature, more than one, or a path that ends at a part.

    """
    place = root(shape)
    if len(segments) > 1 and segments[0].name == place.own_name and not find_parts(call, place, segments[0].name or ""):
        segments = segments[1:]
    position = 0
    while position < len(segments):
        rest = segments[position:]
        name = rest[0].name
        if len(rest) == 2 and name in NUMBERED and isinstance(rest[1].step, int):
            return numbered(call, place, name, rest[1].step, rest[1].span)
        if len(rest) == 1 and name is not None:
            return _last(call, place, name, rest[0].span)
        if len(rest) == 2 and name is not None and isinstance(rest[1].step, int) and not find_parts(call, place, name):
            raise MbmError(_unknown(call, place, name, rest[0].span))
        place = enter(call, place, rest[0])
        position += 1
    raise MbmError(faults.bad_path(call.span, "the path is empty"))


def enter(call: Call, place: Place, segment: Segment) -> Place:
    """The level inside a part."""
    if isinstance(segment.step, int):
        message = f"the number {segment.step} does not follow a kind of feature"
        raise MbmError(faults.bad_path(segment.span, message))
    name = (
        _element_name(call, place, segment.step, segment.span)
        if isinstance(segment.step, ElementName)
        else segment.step
    )
    found = find_parts(call, place, name)
    if len(found) > 1:
        spans = tuple(part.span for part, _ in found)
        raise MbmError(faults.ambiguous_feature(segment.span, f"part `{name}`", place.owner, spans))
    if not found:
        raise MbmError(faults.unknown_part(segment.span, name, place.owner, part_names(call, place)))
    part, steps = found[0]
    return Place(nodes=part.children, steps=steps, owner=f"the part `{name}`")


def find_parts(call: Call, place: Place, name: str) -> list[tuple[Part, tuple[Step, ...]]]:
    """The parts of this name at a level, with the steps around them."""
    return [(n, steps) for n, steps in contents(call, place) if isinstance(n, Part) and n.name == name]


def part_names(call: Call, place: Place) -> tuple[str, ...]:
    """The names of the parts at a level."""
    return tuple(dict.fromkeys(n.name for n, _ in contents(call, place) if isinstance(n, Part)))


def numbered(call: Call, place: Place, kind: str, number: int, span: Span) -> Feature:
    """``vertex n``, ``line n`` or ``plane n`` of the surfaces at a level, or the ``curve n`` there."""
    if kind == "curve":
        curves = [(n, steps) for n, steps in contents(call, place) if isinstance(n, CurveNode)]
        if not 1 <= number <= len(curves):
            raise MbmError(faults.unknown_number(span, kind, number, place.owner, range(1, len(curves) + 1)))
        node, steps = curves[number - 1]
        return Feature(kind=kind, points=(), steps=steps, span=span, curve=node.curve)
    surfaces = [(n, steps) for n, steps in contents(call, place) if isinstance(n, Surface)]
    found = [(s, steps) for s, steps in surfaces if number in _of_kind(s, kind)]
    if len(found) > 1:
        spans = tuple(s.span for s, _ in found)
        raise MbmError(faults.ambiguous_feature(span, f"{kind} {number}", place.owner, spans))
    if not found:
        known = {n for s, _ in surfaces for n in _of_kind(s, kind)}
        raise MbmError(faults.unknown_number(span, kind, number, place.owner, known))
    surface, steps = found[0]
    if kind == "vertex":
        points: tuple[Array, ...] = (surface.vertexes[number],)
    else:
        corners = surface.lines[number] if kind == "line" else surface.planes[number]
        points = tuple(surface.vertexes[corner] for corner in corners)
    return Feature(kind=kind, points=points, steps=steps, span=span)


def frame(place: Place) -> tuple[Step, ...]:
    """The steps to the frame of a part: on through the transforms with one child that wrap all of its content."""
    steps, nodes = list(place.steps), place.nodes
    while len(nodes) == 1 and isinstance(node := nodes[0], Moved) and len(node.children) == 1:
        if not isinstance(node.step, Transform):
            break
        steps.append(node.step)
        nodes = node.children
    return tuple(steps)


def frame_feature(place: Place, kind: str, span: Span) -> Feature:
    """``origin``, or ``axis``: the line from the origin to (0 0 1) of the part's frame."""
    points = (_ZERO,) if kind == "origin" else (_ZERO, _UP)
    return Feature(kind=kind, points=points, steps=frame(place), span=span)


def _last(call: Call, place: Place, name: str, span: Span) -> Feature:
    """The feature that the last name of a path says: a named point, or one of the part's frame."""
    found = tuple(contents(call, place))
    points = [(n, steps) for n, steps in found if isinstance(n, NamedPoint) and n.name == name]
    if len(points) > 1:
        spans = tuple(p.span for p, _ in points)
        raise MbmError(faults.ambiguous_feature(span, f"point `{name}`", place.owner, spans))
    if points:
        point, steps = points[0]
        return Feature(kind="point", points=(point.position,), steps=steps, span=span)
    if any(isinstance(n, Part) and n.name == name for n, _ in found):
        raise MbmError(faults.bad_path(span, f"the path ends at the part `{name}`, not at a feature of it"))
    if name in ("origin", "axis"):
        return frame_feature(place, name, span)
    if name in NUMBERED:
        raise MbmError(faults.bad_path(span, f"`{name}` wants a number behind it"))
    raise MbmError(_unknown(call, place, name, span))


def _unknown(call: Call, place: Place, name: str, span: Span) -> Diagnostic:
    """The fault of a name that is no feature here, with what there is."""
    if name in KINDS_NOT_YET:
        return language_faults.not_available_yet(span, f"the feature `{name}`", KINDS_NOT_YET[name])
    found = [node for node, _ in contents(call, place)]
    listed = []
    for kind in NUMBERED:
        known = faults.numbers(_numbers(found, kind))
        if known:
            listed.append(f"{kind} {known}")
    listed += ["origin", "axis"]
    points = tuple(dict.fromkeys(n.name for n in found if isinstance(n, NamedPoint)))
    parts = tuple(dict.fromkeys(n.name for n in found if isinstance(n, Part)))
    if points:
        listed.append("points " + " ".join(f"`{p}`" for p in points[:8]))
    if parts:
        listed.append("parts " + " ".join(f"`{p}`" for p in parts[:8]))
    return faults.unknown_feature(span, name, place.owner, tuple(listed), (*KINDS, *points, *parts))


def _numbers(nodes: list[Node], kind: str) -> set[int]:
    """The numbers of the features of a kind among ``nodes``."""
    if kind == "curve":
        return set(range(1, sum(isinstance(node, CurveNode) for node in nodes) + 1))
    return {n for s in nodes if isinstance(s, Surface) for n in _of_kind(s, kind)}


def _of_kind(surface: Surface, kind: str) -> frozenset[int]:
    table = {"vertex": surface.vertexes, "line": surface.lines, "plane": surface.planes}[kind]
    return frozenset(table)


def _element_name(call: Call, place: Place, element: ElementName, span: Span) -> str:
    """The part name that an array of the models at this level holds."""
    for node, _ in contents(call, place):
        array = node.arrays.get(element.array) if isinstance(node, ModelCall) else None
        if array is None:
            continue
        if not 1 <= element.index <= len(array.items):
            message = f"index {element.index} is outside 1 … {len(array.items)}"
            raise MbmError(language_faults.bad_index(span, message, "indices count from 1"))
        item = array.items[element.index - 1]
        if isinstance(item, Symbol | str):
            return item if isinstance(item, str) else item.name
    raise MbmError(faults.bad_path(span, f"{place.owner} declares no array of names `{element.array}`"))


def _root_name(node: Node) -> str | None:
    while isinstance(node, Moved | Group) and len(node.children) == 1:
        node = node.children[0]
    return node.name if isinstance(node, ModelCall) else None


def contents(call: Call, place: Place) -> Iterator[tuple[Node, tuple[Step, ...]]]:
    """What stands at a level, in the order written, with the steps around: parts, model calls, what has features."""
    stack = [(node, place.steps) for node in reversed(place.nodes)]
    seen = 0
    while stack:
        node, steps = stack.pop()
        seen += 1
        if seen % _NODES_PER_STEP == 0:
            call.evaluator.budget.spend(1, call.form)
        if isinstance(node, Part | Surface | CurveNode | SweptSide | SmoothFace | NamedPoint | ModelCall):
            yield node, steps
        if isinstance(node, Moved):
            stack.extend((child, (*steps, node.step)) for child in reversed(node.children))
        elif isinstance(node, Group | ModelCall):
            stack.extend((child, steps) for child in reversed(node.children))


def pose_transform(p: PoseValue, span: Span) -> Transform:
    """The transform ``c R x + t``."""
    matrix = p.rotation.matrix
    if p.scale is not None:
        matrix = Array(matrix.shape, tuple(multiply(p.scale, e, span) for e in matrix.elements))
    return Transform(matrix, p.translation, "transform", p)


def carried(point: Array, steps: tuple[Step, ...], call: Call) -> Array:
    """``point`` seen from outside of ``steps``, which stand outermost first."""
    for step in reversed(steps):
        if isinstance(step, Transform):
            point = move_point(step, point, call.span)
        else:
            projection = Call(call.evaluator, step.form, call.scope, (point,), (step.form,))
            point = project_point(projection, None, vector(point, step.form.span, 3).elements)
    return point


def carried_curve(curve: CurveValue, steps: tuple[Step, ...], call: Call) -> CurveValue:
    """``curve`` seen from outside of ``steps``."""
    return curve.mapped(lambda p: carried(Array((len(p),), p), steps, call).elements)
