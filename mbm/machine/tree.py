"""A small imperative language as a tree: what solvers are written in, before they become C, Python or LLVM.

Numbers are doubles (REAL) and 64-bit integers (INTEGER), arrays are pointers to them; conditions are INTEGER 0 and 1.
There is no allocation: scratch space is passed in. A record is passed by reference. A function is a straight list of
statements with loops and branches.
"""

from __future__ import annotations

from typing import TypeAlias

from mbm.machine.kinds import Kind, Member, Record, Type
from mbm.machine.program import LIBRARY
from mbm.values import dataclass

ATOM = 9
"""Precedence, in printed text, of what never needs brackets: names, numbers, elements, calls."""


INTRINSICS = frozenset({"max", "min", "isfinite", *(operator.value for operator in LIBRARY)})
"""Functions that every target brings, by their names in solvers. All take reals and give one.

``max(a, b)`` is a where a > b, else b, and ``min`` likewise: what they make of NaN is the same in every target.
The others are those of C99's ``math.h``: ``fmin`` and ``fmax`` give the number where one argument is NaN.
"""


@dataclass(frozen=True, slots=True)
class Literal:
    """A number; the type of the Python value decides."""

    value: float | int

    @property
    def type(self) -> Type:
        """REAL or INTEGER."""
        return Type.REAL if isinstance(self.value, float) else Type.INTEGER


@dataclass(frozen=True, slots=True)
class Name:
    """A parameter or local variable."""

    name: str
    type: Kind


@dataclass(frozen=True, slots=True)
class Element:
    """``array[index]``."""

    array: Expression
    index: Expression

    @property
    def type(self) -> Kind | None:
        """What the array holds."""
        return None if self.array.type is None else self.array.type.element


@dataclass(frozen=True, slots=True)
class Offset:
    """``array + index``: the array from an element on; written ``array[index:]``."""

    array: Expression
    index: Expression

    @property
    def type(self) -> Kind | None:
        """That of the array."""
        return self.array.type


@dataclass(frozen=True, slots=True)
class Field:
    """``record.member``."""

    record: Expression
    member: Member

    @property
    def type(self) -> Kind:
        """That of the member."""
        return self.member.type


@dataclass(frozen=True, slots=True)
class View:
    """An array of numbers as a flat record, from its beginning on; written ``view(Record, array)``."""

    array: Expression
    type: Record


@dataclass(frozen=True, slots=True)
class Binary:
    """``+ - * /`` of two numbers of one type, ``//`` and ``%`` of integers that are not negative."""

    operator: str
    left: Expression
    right: Expression

    @property
    def type(self) -> Kind | None:
        """That of the arguments."""
        return self.left.type


@dataclass(frozen=True, slots=True)
class Negate:
    """``-x``."""

    argument: Expression

    @property
    def type(self) -> Kind | None:
        """That of the argument."""
        return self.argument.type


@dataclass(frozen=True, slots=True)
class Compare:
    """``< <= > >= == !=`` of two numbers of one type; false where one is NaN, except for ``!=``."""

    operator: str
    left: Expression
    right: Expression

    @property
    def type(self) -> Type:
        """A condition."""
        return Type.INTEGER


@dataclass(frozen=True, slots=True)
class Logical:
    """``and`` and ``or`` (the right side only where it decides), ``not`` (one argument)."""

    operator: str
    arguments: tuple[Expression, ...]

    @property
    def type(self) -> Type:
        """A condition."""
        return Type.INTEGER


@dataclass(frozen=True, slots=True)
class Choose:
    """``then if condition else otherwise``; only the one that is taken is evaluated."""

    condition: Expression
    then: Expression
    otherwise: Expression

    @property
    def type(self) -> Kind | None:
        """That of both."""
        return self.then.type


@dataclass(frozen=True, slots=True)
class Convert:
    """An integer as a real."""

    argument: Expression

    @property
    def type(self) -> Type:
        """REAL."""
        return Type.REAL


@dataclass(frozen=True, slots=True)
class Primitive:
    """An intrinsic function of reals; ``isfinite`` gives a condition."""

    function: str
    arguments: tuple[Expression, ...]

    @property
    def type(self) -> Type:
        """REAL, of ``isfinite`` INTEGER."""
        return Type.INTEGER if self.function == "isfinite" else Type.REAL


@dataclass(frozen=True, slots=True)
class Call:
    """A function of the module; ``type`` None where it gives nothing."""

    function: str
    arguments: tuple[Expression, ...]
    type: Kind | None


Expression: TypeAlias = (
    Literal
    | Name
    | Element
    | Offset
    | Field
    | View
    | Binary
    | Negate
    | Compare
    | Logical
    | Choose
    | Convert
    | Primitive
    | Call
)


@dataclass(frozen=True, slots=True)
class Assign:
    """``target = value``; the first assignment to a name declares it."""

    target: Name | Element | Field
    value: Expression


@dataclass(frozen=True, slots=True)
class For:
    """``for name in range(start, stop)``: up by 1; the bounds are taken once."""

    variable: Name
    start: Expression
    stop: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class While:
    """While the condition holds."""

    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class If:
    """One of two branches."""

    condition: Expression
    then: tuple[Statement, ...]
    otherwise: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True)
class Break:
    """Out of the innermost loop."""


@dataclass(frozen=True, slots=True)
class Continue:
    """On with the innermost loop."""


@dataclass(frozen=True, slots=True)
class Return:
    """Back to the caller."""

    value: Expression | None


@dataclass(frozen=True, slots=True)
class Perform:
    """A call for its effect."""

    call: Call


@dataclass(frozen=True, slots=True)
class Comment:
    """Words for the reader of the printed text."""

    text: str


Statement: TypeAlias = Assign | For | While | If | Break | Continue | Return | Perform | Comment


@dataclass(frozen=True, slots=True, kw_only=True)
class Function:
    """A function; ``public`` ones can be called from outside of the module. ``locals`` are its variables in order.

    ``distinct``: no array that it writes overlaps another one that it is given. ``external``: the target brings it,
    ``body`` is empty.
    """

    name: str
    parameters: tuple[Name, ...]
    returns: Kind | None
    body: tuple[Statement, ...]
    locals: tuple[Name, ...]
    doc: str = ""
    public: bool = False
    distinct: bool = False
    external: bool = False


CALL_KERNEL = Function(
    name="call_kernel",
    parameters=(
        Name("address", Type.INTEGER),
        Name("inputs", Type.CONSTANT_REALS),
        Name("outputs", Type.REALS),
        Name("blocks", Type.INTEGER),
    ),
    returns=None,
    body=(),
    locals=(),
    doc="Evaluate a kernel for blocks of rows: LLVM calls what begins at the address, C the kernel of that number.",
    distinct=True,
    external=True,
)
"""How solvers reach the kernels; every module may call it."""

CALL_NORMAL = Function(
    name="call_normal",
    parameters=(
        Name("address", Type.INTEGER),
        Name("inputs", Type.CONSTANT_REALS),
        Name("weights", Type.CONSTANT_REALS),
        Name("losses", Type.CONSTANT_REALS),
        Name("sums", Type.REALS),
        Name("blocks", Type.INTEGER),
    ),
    returns=None,
    body=(),
    locals=(),
    doc="Add the normal equations of blocks of rows to sums (`mbm.kernels.native.normal`): in the process only.",
    distinct=True,
    external=True,
)

CALL_FUSED = Function(
    name="call_fused",
    parameters=(
        Name("address", Type.INTEGER),
        Name("point", Type.CONSTANT_REALS),
        Name("data", Type.CONSTANT_REALS),
        Name("target", Type.REALS),
        Name("stride", Type.INTEGER),
    ),
    returns=None,
    body=(),
    locals=(),
    doc="Evaluate rows of several kernels at once, as `mbm.machine.straight_line` says: in the process only.",
    distinct=True,
    external=True,
)

EXTERNAL = (CALL_KERNEL, CALL_FUSED, CALL_NORMAL)


@dataclass(frozen=True, slots=True, kw_only=True)
class Module:
    """Functions, those that are called before those that call them, and the records that they use, likewise."""

    name: str
    functions: tuple[Function, ...]
    records: tuple[Record, ...] = ()

    def function(self, name: str) -> Function:
        """A function by name."""
        return next(f for f in self.functions if f.name == name)
