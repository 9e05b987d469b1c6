"""Values of the shapes stage: what a model describes, and the features that are picked from it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import field
from typing import TypeAlias

from mbm.expression.nets import Net
from mbm.expression.nodes import Expression, Parameter
from mbm.language import faults
from mbm.language.curves import CurveValue, Point
from mbm.language.functions import Parameters
from mbm.language.values import Array, Call, Callable_, ListValue, Placeable, Scope, Transform, Value, describe
from mbm.language.vocabulary.comparison import Unitable
from mbm.language.vocabulary.vectors import move_point
from mbm.text.types import Form, MbmError, Sequence, Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """``(perse S)``: what is inside is seen in the image; ``form`` is the list that says so."""

    form: Sequence


Step: TypeAlias = Transform | Projection
"""What takes points from the frame inside a form to the frame outside of it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """A surface model (Oyama & Tachi 1989, Fig. 3): points of shape (3,), and lines and planes over their numbers.

    ``net`` holds the same of a mesh.
    """

    vertexes: Mapping[int, Array]
    lines: Mapping[int, tuple[int, ...]]
    planes: Mapping[int, tuple[int, ...]]
    span: Span
    net: Net | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NamedPoint:
    """``(point foot (0 0 0))``; ``position`` has shape (3,)."""

    name: str
    position: Array
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CurveNode:
    """A curve of space; it is numbered by its place among those of its part."""

    curve: CurveValue
    span: Span


ParameterRange: TypeAlias = tuple[Parameter, Expression, Expression]
"""A parameter with its first and last value."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patch:
    """A smooth stretch of a surface; ``point`` holds both parameters, ∂/∂first × ∂/∂second points outward."""

    first: ParameterRange
    second: ParameterRange
    point: Point


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SweptSide:
    """The smooth side that a curve, or a line on a smooth way, sweeps: as what it is, not as facets.

    ``ends`` are loops of sides of patches, as `mbm.expression.nodes.Figure` has them, that bound the flat first and
    last sections where the curve is closed.
    """

    patches: tuple[Patch, ...]
    ends: tuple[tuple[tuple[int, int, bool], ...], ...]
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SmoothFace:
    """``(surface (s a b) (t c d) [x y z])``: a smooth face, whose model's planes are features of it, no faces."""

    patch: Patch
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moved:
    """A transform and what stands in it; points have ``dimension`` coordinates outside (2 once projected, else 3)."""

    step: Step
    children: tuple[Node, ...]
    dimension: int
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A part: one level of a path."""

    name: str
    children: tuple[Node, ...]
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """What ``or``, ``for``, ``let``, ``if`` and functions of the user hold: no level of a path, no transform."""

    children: tuple[Node, ...]
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelConstraint:
    """One entry ``(kind form…)`` of a model's constraints block, to be evaluated in ``scope``."""

    kind: str
    forms: tuple[Form, ...]
    scope: Scope = field(repr=False)
    span: Span


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelCall:
    """A model with its arguments (defaults among them), its declared arrays, its constraints and what it describes."""

    name: str
    arguments: Mapping[str, Value]
    arrays: Mapping[str, ListValue]
    constraints: tuple[ModelConstraint, ...]
    children: tuple[Node, ...]
    span: Span


Node: TypeAlias = Surface | CurveNode | SweptSide | SmoothFace | NamedPoint | Moved | Part | Group | ModelCall


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape(Unitable):
    """What a model describes, as a value: it may be moved, asked for features, and stand in another model."""

    content: Node
    span: Span

    @property
    def kind(self) -> str:
        """How messages call it."""
        return f"the shape `{self.content.name}`" if isinstance(self.content, ModelCall) else "a shape"

    def moved(self, by: Transform) -> Shape:
        """The shape after ``by``."""
        dimension = dimension_of(self.content)
        return Shape(
            content=Moved(step=by, children=(self.content,), dimension=dimension, span=self.span), span=self.span
        )

    def united(self, call: Call) -> Shape:
        """The union of shapes, which is no level of a path.

        Raises:
            MbmError: an argument is no shape.

        """
        parts: list[Node] = []
        for value, form in zip(call.arguments, call.forms, strict=True):
            if not isinstance(value, Shape):
                raise MbmError(faults.wrong_kind(form.span, "a shape", describe(value)))
            parts.append(value.content)
        return Shape(content=Group(children=tuple(parts), span=call.span), span=call.span)

    def as_point(self) -> Array | None:
        """A shape is no point."""
        return None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line(Placeable):
    """A line feature: from one point to another."""

    start: Array
    end: Array
    span: Span

    @property
    def kind(self) -> str:
        """How messages call it."""
        return "a line"

    def moved(self, by: Transform) -> Line:
        """The line after ``by``."""
        start, end = (move_point(by, p, self.span) for p in (self.start, self.end))
        return Line(start=start, end=end, span=self.span)

    def as_point(self) -> Array | None:
        """A line is no point."""
        return None

    def ends(self) -> tuple[Array, ...] | None:
        """From where to where it runs."""
        return (self.start, self.end)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plane(Placeable):
    """A plane feature: three or more points, counter-clockwise seen from outside."""

    points: tuple[Array, ...]
    span: Span

    @property
    def kind(self) -> str:
        """How messages call it."""
        return "a plane"

    def moved(self, by: Transform) -> Plane:
        """The plane after ``by``."""
        return Plane(points=tuple(move_point(by, p, self.span) for p in self.points), span=self.span)

    def as_point(self) -> Array | None:
        """A plane is no point."""
        return None

    def ends(self) -> tuple[Array, ...] | None:
        """Its points."""
        return self.points


class ModelFunction(Callable_):
    """A model as what stands at the head of a list."""

    @property
    @abstractmethod
    def name(self) -> str:
        """The model's name."""

    @property
    @abstractmethod
    def parameters(self) -> Parameters:
        """Its argument block."""

    @property
    @abstractmethod
    def from_library(self) -> bool:
        """Whether it came with the package: then a part may have its name."""

    @abstractmethod
    def call(self, call: Call) -> Value:
        """The shape for evaluated arguments."""


def dimension_of(node: Node) -> int:
    """How many coordinates the points of a shape have, seen from outside of it: 3, or 2 where it is projected."""
    while isinstance(node, Part | Group | ModelCall):
        if not node.children:
            return 3
        node = node.children[0]
    return node.dimension if isinstance(node, Moved) else 3
