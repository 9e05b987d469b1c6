"""What forms evaluate to."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Protocol, TypeAlias

from mbm.expression.nodes import (
    Apply,
    Column,
    Component,
    Constant,
    Expression,
    Number,
    Opaque,
    Parameter,
)
from mbm.expression.projection import NEAR, Projection
from mbm.expression.rows import Row, RowChoice
from mbm.text.types import Code, Diagnostic, Form, Keyword, Numeral, Place, Sequence, Span, Symbol, Text
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.language.limits import Budget


@dataclass(frozen=True, slots=True, eq=False)
class Array:
    """A vector (shape (n,)) or matrix (shape (n, m), elements row by row); ``projection``: of what it is the image."""

    shape: tuple[int, ...]
    elements: tuple[Expression, ...]
    projection: Projection | None = None

    @property
    def is_matrix(self) -> bool:
        """Whether there are rows and columns."""
        return len(self.shape) == 2

    def rows(self) -> tuple[tuple[Expression, ...], ...]:
        """The rows of a matrix."""
        height, width = self.shape
        return tuple(self.elements[i * width : (i + 1) * width] for i in range(height))


@dataclass(frozen=True, slots=True, eq=False)
class ListValue:
    """What ``list`` makes: any values. A list of numbers may stand wherever a vector may."""

    items: tuple[Value, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RotationValue:
    """A rotation of the plane (2×2) or of space (3×3) as its matrix; columns are the images of the axes.

    ``quaternion`` (w, x, y, z) of length 1 (space) or ``angle`` (plane) hold the same where they are known: differences
    of rotations are short in them.
    """

    matrix: Array
    quaternion: tuple[Expression, ...] | None = None
    angle: Expression | None = None

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.matrix.shape[0]


@dataclass(frozen=True, slots=True, eq=False)
class PoseValue:
    """A similarity ``y = c R x + t``; ``scale`` None means c = 1, a pose."""

    rotation: RotationValue
    translation: tuple[Expression, ...]
    scale: Expression | None = None

    @property
    def kind(self) -> str:
        """How messages call it."""
        return "a pose" if self.scale is None else "a similarity"


@dataclass(frozen=True, slots=True, eq=False)
class ImageLineValue:
    """A line in an image: direction ``alpha`` (an angle) and ``rho`` = −X sin α + Y cos α."""

    alpha: Expression
    rho: Expression


@dataclass(frozen=True, slots=True, eq=False)
class CameraValue:
    """A camera: focal lengths and principal point in px, distortion (or none), its axes, and how it projects.

    ``distortion``: k1 k2 p1 p2 k3 of a pinhole camera, k1 k2 k3 k4 of a fisheye. Curves nearer than ``near`` are cut.
    """

    name: str
    focal: tuple[Expression, Expression]
    center: tuple[Expression, Expression]
    distortion: tuple[Expression, ...]
    axes: str
    model: str = "pinhole"
    near: Expression = NEAR


@dataclass(frozen=True, slots=True, eq=False)
class TextColumn:
    """A column of texts in the row at hand: a family's key as it stands, static wherever else its text is needed.

    ``sample`` is the first cell that is no number, ``sample_place`` where it stands: what to blame where numbers are
    wanted.
    """

    table: str
    name: str
    row: Row = RowChoice.EACH
    sample: str | None = None
    sample_place: Place | None = None

    @property
    def identity(self) -> tuple[str, str, Row]:
        """What makes two references the same column."""
        return (self.table, self.name, self.row)


@dataclass(frozen=True, slots=True, eq=False)
class FamilyValue:
    """An unknown with one member for each key: ``(cam camera)``, ``(q "waist")``."""

    name: str
    keys: frozenset[str | float]
    member: Callable[[str | float | Column | TextColumn], Value] = field(repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class TableName:
    """A table's name where a form wants the table itself: ``(first TABLE FORM)``."""

    name: str


class Placeable(ABC):
    """Features and shapes: what ``trans``, ``rotate`` and ``scale`` may move.

    An abstract class, for values are asked for their kind all the time, and protocols answer ten times slower.
    """

    __slots__ = ()

    @property
    @abstractmethod
    def kind(self) -> str:
        """How messages call it: ``a line``, ``a shape``."""

    @abstractmethod
    def moved(self, by: Transform) -> Value:
        """The same thing after ``by``."""

    @abstractmethod
    def as_point(self) -> Array | None:
        """Its coordinates, if it is a point."""

    @property
    def dimension(self) -> int:
        """How many coordinates its points have."""
        return 3

    def ends(self) -> tuple[Array, ...] | None:
        """The two points of a line, the three or more of a plane; None for anything else."""
        return None


@dataclass(frozen=True, slots=True, eq=False)
class Transform:
    """x ↦ A x + b with ``matrix`` A (None: unchanged) and ``offset`` b (None: zero); ``form`` is how it was written."""

    matrix: Array | None
    offset: tuple[Expression, ...] | None
    head: str
    argument: Value


class Scope(Protocol):
    """A place in the text: what the names mean there."""

    def lookup(self, name: str, span: Span) -> Value | None:
        """The value of a variable, or None if there is none of this name. ``span`` is where it is used."""

    def names(self) -> Iterator[str]:
        """All names visible, for suggestions."""

    def columns(self) -> tuple[str, tuple[str, ...]] | None:
        """The table whose row is at hand, with its columns; None without one."""


class Evaluator(Protocol):
    """What evaluates forms, as calls and special forms are given it.

    ``vocabulary`` says what heads mean, ``budget`` what the evaluation may still take, ``world`` is the scope of the
    problem being compiled; ``warnings`` are kept once for each place.
    """

    vocabulary: Vocabulary
    budget: Budget
    world: Scope
    warnings: dict[tuple[Code, Place | None], Diagnostic]

    def warn(self, diagnostic: Diagnostic) -> None:
        """Keep a warning, once for each place."""
        ...

    def evaluate(self, form: Form, scope: Scope) -> Value:
        """The value of ``form`` in ``scope``.

        Raises:
            MbmError: with a diagnostic at the innermost form that is wrong.
            StaticColumnNeeded: the value of a data column decides what the expression is.

        """
        ...

    def wanted(self, form: Form, scope: Scope) -> Value:
        """Like ``evaluate``, where an expression is wanted: a form that arrives is evaluated in its turn."""
        ...

    def arrived(self, value: Value, at: Form, scope: Scope) -> Value:
        """``value``, or, if it is a form, what that form means here (LANGUAGE §2, forms as observation models)."""
        ...

    def call(self, function: Callable_, arguments: tuple[Value, ...], form: Sequence, scope: Scope) -> Value:
        """Call ``function`` with values; errors inside the user's functions name the call."""
        ...


class Callable_(ABC):  # noqa: N801 - `Callable` is taken by the standard library
    """What may stand at the head of a list and be called. An abstract class for speed, as ``Placeable``."""

    __slots__ = ()

    if TYPE_CHECKING:  # at run time a property here would become the default of the dataclasses' field

        @property
        def name(self) -> str:
            """The name that messages use."""
            ...

    @abstractmethod
    def call(self, call: Call) -> Value:
        """The value for evaluated arguments."""


class Macro(Callable_):
    """A callable that takes its arguments unevaluated."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """One call: the evaluator, where it stands, and the arguments with the forms they came from."""

    evaluator: Evaluator
    form: Sequence
    scope: Scope
    arguments: tuple[Value, ...]
    forms: tuple[Form, ...]

    @property
    def span(self) -> Span:
        """Where the call stands."""
        return self.form.span


@dataclass(frozen=True, slots=True, eq=False)
class Builtin(Callable_):
    """A function of the vocabulary. ``maximum`` None takes any number of arguments.

    ``takes_forms``: quoted forms among the arguments are data (lists), not to be evaluated where they arrive.
    """

    name: str
    usage: str
    doc: str
    minimum: int
    maximum: int | None
    function: Callable[[Call], Value] = field(repr=False)
    takes_forms: bool = False

    def call(self, call: Call) -> Value:
        """The value for evaluated arguments; their number has been checked."""
        return self.function(call)


Value: TypeAlias = (
    Number
    | Constant
    | Column
    | Component
    | Opaque
    | Parameter
    | Apply
    | bool
    | str
    | Array
    | ListValue
    | RotationValue
    | PoseValue
    | CameraValue
    | ImageLineValue
    | TextColumn
    | FamilyValue
    | TableName
    | Symbol
    | Keyword
    | Numeral
    | Sequence
    | Text
    | Callable_
    | Placeable
)

SCALARS = (Number, Constant, Column, Component, Opaque, Parameter, Apply)
FORMS = (Symbol, Keyword, Numeral, Sequence, Text)


class StaticColumnNeeded(Exception):  # noqa: N818 - not an error: it asks for another pass
    """The value of a column is needed to go on; the caller groups the rows by it and evaluates again for each value."""

    def __init__(self, column: Column | TextColumn, span: Span) -> None:
        super().__init__(column.name)
        self.column = column
        self.span = span


def size_of(value: Value) -> int:
    """Elements that work on a value has to look at: of a vector, a matrix, a list, a quoted list; else none."""
    if isinstance(value, Array):
        return len(value.elements)
    return len(value.items) if isinstance(value, ListValue | Sequence) else 0


def describe(value: Value) -> str:
    """How a message names a value, with article."""
    if isinstance(value, Apply) and value.is_condition:
        return "a condition"
    if isinstance(value, SCALARS):
        return "a number"
    if isinstance(value, bool):
        return "a truth value"
    if isinstance(value, str | TextColumn):
        return "a text"
    if isinstance(value, Array):
        shape = value.shape
        return f"a vector of length {shape[0]}" if len(shape) == 1 else f"a {shape[0]}×{shape[1]} matrix"
    if isinstance(value, ListValue):
        return f"a list of {len(value.items)}"
    if isinstance(value, RotationValue):
        return "a rotation"
    if isinstance(value, ImageLineValue):
        return "an image line"
    if isinstance(value, CameraValue):
        return f"the camera `{value.name}`"
    if isinstance(value, PoseValue | Placeable):
        return value.kind
    if isinstance(value, FamilyValue):
        return f"the family `{value.name}`, of which `({value.name} KEY)` is a member"
    if isinstance(value, TableName):
        return f"the table `{value.name}`"
    if isinstance(value, FORMS):
        return "a quoted form"
    if isinstance(value, Macro):
        return f"the macro `{value.name}`"
    return f"the function `{value.name}`"


def described_with_space(value: Value) -> str:
    """`describe`, and for rotations, poses and similarities the space that they move."""
    if not isinstance(value, RotationValue | PoseValue):
        return describe(value)
    rotation = value if isinstance(value, RotationValue) else value.rotation
    return f"{describe(value)} of {'the plane' if rotation.dimension == 2 else 'space'}"


SpecialForm: TypeAlias = Callable[[Evaluator, Sequence, Scope], Value]
FunctionTable: TypeAlias = Mapping[str, Callable_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Vocabulary:
    """What heads mean; ``not_yet`` come with later versions, ``late`` are forms where no name of the user is meant."""

    special_forms: Mapping[str, SpecialForm]
    functions: FunctionTable
    not_yet: Mapping[str, str]
    late: Mapping[str, Callable[[Evaluator, Sequence, Scope], Value | None]] = field(default_factory=dict)
