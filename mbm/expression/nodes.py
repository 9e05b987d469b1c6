"""Nodes of the expression DAG. Every node is one scalar; vectors and matrices are tuples of nodes.

Scalars keep the DAG free of shapes: differentiation, units, the wrapping of angles and the printing of equations are
all said once, for numbers. Nodes compare by identity; equal subexpressions are found where it matters, in ``symbolic``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import field
from enum import Enum, StrEnum
from fractions import Fraction
from typing import Self, TypeAlias

from mbm.expression.nets import SeenNet
from mbm.expression.rows import Row, RowChoice
from mbm.expression.units import Dimension
from mbm.machine.program import Operator
from mbm.text.types import Form, Span
from mbm.values import dataclass


class Dimensions(Enum):
    """What an operation asks of the dimensions of its arguments, and what the value has."""

    PURE = "none: they are pure numbers, and so is the value"
    ANY = "nothing; the value is a pure number"
    COMPARED = "both are alike; the value is a pure number"
    ALIKE = "the last two are alike, and so is the value"
    KEPT = "nothing; the value has that of the argument"
    PRODUCT = "nothing; they are multiplied"
    QUOTIENT = "nothing; they are divided"
    ROOT = "nothing; half of each exponent"
    POWER = "the exponent is a pure number, and the base if that is not known"
    OPEN = "nothing; the value takes the dimension that its uses ask for, as a number without a unit does"


class Angles(Enum):
    """Whether the value of an operation is an angle, whose differences wrap."""

    NEVER = "never"
    KEPT = "where one of the last two arguments is"
    MADE = "always"


class Operation(StrEnum):
    """What a node computes from its arguments; the value is the name that the language uses.

    ``operator`` is what computes it in straight-line programs, if one does alone. An elementary function without
    anything of its own is ``NAME = "name", Operator.NAME``: Python's `math`, NumPy, SymPy, CasADi, C and machine code
    have it under the names that the operator says.
    """

    operator: Operator | None
    dimensions: Dimensions
    angles: Angles

    def __new__(
        cls,
        name: str,
        operator: Operator | None = None,
        dimensions: Dimensions = Dimensions.PURE,
        angles: Angles = Angles.NEVER,
    ) -> Self:
        """One operation."""
        made = str.__new__(cls, name)
        made._value_ = name
        made.operator, made.dimensions, made.angles = operator, dimensions, angles
        return made

    ADD = "+", Operator.ADD, Dimensions.ALIKE, Angles.KEPT
    SUBTRACT = "-", Operator.SUB, Dimensions.ALIKE, Angles.KEPT
    NEGATE = "negate", Operator.NEG, Dimensions.KEPT, Angles.KEPT
    MULTIPLY = "*", Operator.MUL, Dimensions.PRODUCT
    DIVIDE = "/", Operator.DIV, Dimensions.QUOTIENT
    POWER = "^", Operator.POW, Dimensions.POWER
    SQRT = "sqrt", Operator.SQRT, Dimensions.ROOT
    EXP = "exp", Operator.EXP
    LOG = "log", Operator.LOG
    ABS = "abs", Operator.ABS, Dimensions.KEPT
    SIGN = "sign", Operator.SIGN, Dimensions.ANY
    FLOOR = "floor", Operator.FLOOR, Dimensions.KEPT
    MINIMUM = "min", Operator.MIN, Dimensions.ALIKE
    MAXIMUM = "max", Operator.MAX, Dimensions.ALIKE
    HYPOT = "hypot", Operator.HYPOT, Dimensions.ALIKE
    SIN = "sin", Operator.SIN
    COS = "cos", Operator.COS
    TAN = "tan", Operator.TAN
    ASIN = "asin", Operator.ASIN
    ACOS = "acos", Operator.ACOS
    ATAN = "atan", Operator.ATAN
    ATAN2 = "atan2", Operator.ATAN2, Dimensions.COMPARED, Angles.MADE
    SINH = "sinh", Operator.SINH
    COSH = "cosh", Operator.COSH
    TANH = "tanh", Operator.TANH
    ASINH = "asinh", Operator.ASINH
    ACOSH = "acosh", Operator.ACOSH
    ATANH = "atanh", Operator.ATANH
    WRAP = "wrap", None, Dimensions.PURE, Angles.MADE
    AS_ANGLE = "angle", None, Dimensions.PURE, Angles.MADE
    HELD = "held", None, Dimensions.KEPT, Angles.KEPT
    IF = "if", None, Dimensions.ALIKE, Angles.KEPT
    LESS = "<", Operator.LESS, Dimensions.COMPARED
    LESS_EQUAL = "<=", Operator.LESS_EQUAL, Dimensions.COMPARED
    EQUAL = "=", Operator.EQUAL, Dimensions.COMPARED
    NOT = "not", Operator.NOT, Dimensions.ANY
    AND = "and", Operator.AND, Dimensions.ANY
    OR = "or", Operator.OR, Dimensions.ANY
    FINITE = "finite", None, Dimensions.ANY
    EXTERNAL = "external", None, Dimensions.OPEN

    # That of `Enum` is a function in Python; operations are looked up in tables all the time.
    __hash__ = str.__hash__


CONDITIONS = frozenset(
    {
        Operation.LESS,
        Operation.LESS_EQUAL,
        Operation.EQUAL,
        Operation.NOT,
        Operation.AND,
        Operation.OR,
        Operation.FINITE,
    }
)
"""Operations whose value is true or false."""


def nearest(value: int | Fraction | float) -> float:
    """The double nearest to an exact number; infinite beyond the largest, as IEEE 754 has it."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


@dataclass(frozen=True, slots=True, eq=False)
class Number:
    """A number in SI; ``dimension`` None: as its uses ask. ``absolute``: ``20degC``, whose scale has its own zero."""

    value: int | Fraction | float
    dimension: Dimension | None = None
    span: Span | None = field(default=None, repr=False)
    angle: bool = False
    absolute: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Constant:
    """A constant of the problem: a value that a caller may override without compiling again; as a `Number` else."""

    name: str
    value: float
    dimension: Dimension | None = None
    span: Span | None = field(default=None, repr=False)
    angle: bool = False
    absolute: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LiteralMember:
    """The member of a family with a known key."""

    key: str | float


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnMember:
    """The member of a family whose key stands in a column of the row at hand (or of one chosen)."""

    table: str
    column: str
    row: Row = RowChoice.EACH


Member: TypeAlias = LiteralMember | ColumnMember


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sampling:
    """A time ``at`` for the row at hand, and the column ``by`` of ``table`` that it is looked up in.

    Among rows that differ in ``keys``, or in a column ``passing`` with which times start anew, nothing lies between.
    """

    table: str
    by: str
    at: Expression = field(repr=False)
    span: Span = field(repr=False)
    keys: tuple[str, ...] = ()
    passing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A number from a table: from the row at hand, from one chosen of ``table``, or from one by its key.

    ``member`` names the key where ``row`` is KEYED, ``sampling`` the time where it is one of those around it.
    """

    table: str
    name: str
    row: Row = RowChoice.EACH
    span: Span | None = field(default=None, repr=False)
    angle: bool = False
    member: Member | None = None
    sampling: Sampling | None = None

    @property
    def identity(self) -> tuple[str, str, Row, Member | Sampling | None]:
        """What makes two references the same number."""
        return (self.table, self.name, self.row, self.member if self.sampling is None else self.sampling)


@dataclass(frozen=True, slots=True, eq=False)
class Component:
    """One number of an unknown: ``index`` counts from 1, empty for a scalar; ``member`` picks from a family."""

    unknown: str
    index: tuple[int, ...] = ()
    member: Member | None = None
    angle: bool = False
    span: Span | None = field(default=None, repr=False)

    @property
    def identity(self) -> tuple[str, tuple[int, ...], Member | None]:
        """What makes two references the same number."""
        return (self.unknown, self.index, self.member)


@dataclass(frozen=True, slots=True, eq=False)
class Opaque:
    """A scalar that stands for a form not yet evaluated; only in forms that a function of the user gives back."""

    form: Form
    span: Span | None = field(default=None, repr=False)
    angle: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class External:
    """A function in Python that gives ``size`` numbers: texts that say where it is, nothing that runs.

    ``function`` and ``jacobian`` are ``module:function``; ``shapes`` are those of the arguments, () for a number.
    ``batch``: one call takes all rows, each argument with a leading axis for them; else one row is a call.
    """

    function: str
    jacobian: str | None
    size: int
    shapes: tuple[tuple[int, ...], ...]
    batch: bool
    span: Span = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A piece of what is seen: u, v and the depth in terms of constants that are called by their position, from "0".

    The first ``parameters`` of them run from 0 to 1: one along a line, two over a surface. The other ``inputs`` stand
    for numbers that a `Figure` is drawn from. ``straight``: a line that takes u, v and the depth of both ends.
    """

    parameters: int
    inputs: int
    point: tuple[Expression, ...] = field(repr=False, compare=False)
    straight: bool = False
    key: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """What a silhouette is drawn from: ``size`` numbers, and sheets that take theirs from places among these.

    ``lines`` and ``patches`` are (number of a sheet, places of its inputs). ``faces`` are flat, bounded by lines: each
    is (number of a line, whether it runs along). ``ends`` are flat as well, bounded by sides of patches: (number of a
    patch, side, whether it runs along), with sides 0…3: t = 0, s = 1, t = 1, s = 0, counter-clockwise in (s, t).
    ``nets`` have points and faces of their own.
    """

    size: int
    sheets: tuple[Sheet, ...]
    lines: tuple[tuple[int, tuple[int, ...]], ...]
    faces: tuple[tuple[tuple[int, bool], ...], ...]
    patches: tuple[tuple[int, tuple[int, ...]], ...]
    ends: tuple[tuple[tuple[int, int, bool], ...], ...]
    nets: tuple[SeenNet, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlined:
    """``size`` numbers that mbm reads off the outline of a ``figure``; ``function`` is called as in the language.

    Arguments are those of the figure, and behind them the coordinates of a point if the function takes one. ``form``
    is how it was written.
    """

    function: str
    size: int
    figure: Figure
    form: Form = field(repr=False, compare=False)
    span: Span = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class Output:
    """Number ``index`` (from 0) of those that a call gives: of a function in Python, or of one that mbm has itself."""

    external: External | Outlined
    index: int


@dataclass(frozen=True, slots=True, eq=False)
class Parameter:
    """The parameter of a curve: what runs along it. Each is itself alone; the values of a problem hold none."""

    name: str
    span: Span | None = field(default=None, repr=False)
    angle: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Apply:
    """An operation on nodes, which its printed form leaves out: written out, shared ones may be without end. ``angle``:
    differences of this number wrap.

    ``output`` says what an EXTERNAL one calls; its arguments are those of the call, element by element.
    """

    operation: Operation
    arguments: tuple[Expression, ...] = field(repr=False)
    angle: bool = False
    span: Span | None = field(default=None, repr=False)
    output: Output | None = None

    @property
    def is_condition(self) -> bool:
        """Whether the value is true or false."""
        node: Expression = self
        while isinstance(node, Apply) and node.operation is Operation.IF:
            node = node.arguments[1]
        return isinstance(node, Apply) and node.operation in CONDITIONS


Expression: TypeAlias = Number | Constant | Column | Component | Opaque | Parameter | Apply
Leaf: TypeAlias = Number | Constant | Column | Component | Opaque | Parameter


def postorder(roots: tuple[Expression, ...]) -> list[Expression]:
    """Every node below ``roots`` once, arguments before the nodes that use them. Not recursive: DAGs may be deep."""
    seen: set[int] = set()
    order: list[Expression] = []
    stack: list[tuple[Expression, bool]] = [(root, False) for root in reversed(roots)]
    while stack:
        node, expanded = stack.pop()
        if expanded:
            order.append(node)
            continue
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, Apply):
            stack.append((node, True))
            stack.extend((argument, False) for argument in reversed(node.arguments) if id(argument) not in seen)
        else:
            order.append(node)
    return order


def externals(roots: tuple[Expression, ...]) -> Iterator[External | Outlined]:
    """What is called below ``roots``: functions in Python, and what is read off outlines; one may come again."""
    for node in postorder(roots):
        if isinstance(node, Apply) and node.output is not None:
            yield node.output.external


def leaves(roots: tuple[Expression, ...]) -> list[Leaf]:
    """The leaves below ``roots``, each node once, in the order in which they are met."""
    seen: set[int] = set()
    found: list[Leaf] = []
    stack = list(reversed(roots))
    while stack:
        node = stack.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, Apply):
            stack.extend(reversed(node.arguments))
        else:
            found.append(node)
    return found
