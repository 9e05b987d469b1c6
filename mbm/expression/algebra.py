"""Building expressions: constants fold, neutral elements vanish, angles stay angles.

Folding never hides a clash of units: a literal without a unit may still take one (LANGUAGE §6), so only numbers whose
dimensions are both open, or both known, are combined; and no temperatures that are counted from a zero of their own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction

from mbm.expression.nodes import (
    CONDITIONS,
    Angles,
    Apply,
    Constant,
    Dimensions,
    Expression,
    Number,
    Operation,
    postorder,
)  # fmt: skip
from mbm.expression.units import NONE, Dimension
from mbm.text.types import Span

ZERO, ONE, TWO = (Number(value, NONE) for value in range(3))
"""Numbers without a dimension."""

MAXIMUM_BITS = 4096
"""Exact integers and fractions that grow longer than this become floating-point numbers or an error."""


MAXIMUM_RIGHT_ANGLES = 8
"""Two turns: beyond, a float is no longer sure to mean a whole number of right angles."""


class UndefinedValueError(ArithmeticError):
    """An operation on constants has no finite value; the message says which."""


def wrap_angle(value: float) -> float:
    """The representative of an angle in (-π, π]."""
    wrapped = math.remainder(value, 2 * math.pi)
    return math.pi if wrapped <= -math.pi else wrapped


def number(value: int | Fraction | float, span: Span | None = None, dimension: Dimension | None = None) -> Number:
    """A number; fractions that are whole become integers, so that they may index."""
    if isinstance(value, Fraction) and value.denominator == 1:
        value = int(value)
    return Number(value, dimension, span)


def apply(operation: Operation, *arguments: Expression, span: Span | None = None) -> Expression:
    """``operation`` on ``arguments``, folded where all are numbers.

    Raises:
        UndefinedValueError: constants outside the operation's domain, division by zero, overflow.

    """
    numbers = [a for a in arguments if isinstance(a, Number)]
    if numbers or operation is Operation.NEGATE:
        simpler = _simplify(operation, arguments)
        if simpler is not None:
            return simpler
    if len(numbers) == len(arguments) and True not in [a.absolute for a in numbers]:
        folded = _fold(operation, numbers, span)
        if folded is not None:
            return folded
    return Apply(operation, arguments, _is_angle(operation, arguments), span)


def _is_angle(operation: Operation, arguments: Sequence[Expression]) -> bool:
    if operation.angles is Angles.KEPT:
        return True in [a.angle for a in arguments[-2:]]
    return operation.angles is Angles.MADE


def add(a: Expression, b: Expression, span: Span | None = None) -> Expression:
    """a + b."""
    return apply(Operation.ADD, a, b, span=span)


def subtract(a: Expression, b: Expression, span: Span | None = None) -> Expression:
    """a − b."""
    return apply(Operation.SUBTRACT, a, b, span=span)


def multiply(a: Expression, b: Expression, span: Span | None = None) -> Expression:
    """a · b."""
    return apply(Operation.MULTIPLY, a, b, span=span)


def divide(a: Expression, b: Expression, span: Span | None = None) -> Expression:
    """a / b."""
    return apply(Operation.DIVIDE, a, b, span=span)


def negate(a: Expression, span: Span | None = None) -> Expression:
    """−a."""
    return apply(Operation.NEGATE, a, span=span)


def wrap(a: Expression, span: Span | None = None) -> Expression:
    """The representative of an angle in (−π, π]; its derivative is 1 everywhere."""
    return apply(Operation.WRAP, a, span=span)


def total(terms: tuple[Expression, ...], span: Span | None = None) -> Expression:
    """The sum of ``terms``; zero if there are none."""
    if not terms:
        return number(0, span)
    result = terms[0]
    for term in terms[1:]:
        result = add(result, term, span)
    return result


def dot(a: tuple[Expression, ...], b: tuple[Expression, ...], span: Span | None = None) -> Expression:
    """Σ aᵢ bᵢ for tuples of one length."""
    return total(tuple(multiply(x, y, span) for x, y in zip(a, b, strict=True)), span)


def differences(
    a: tuple[Expression, ...], b: tuple[Expression, ...], span: Span | None = None
) -> tuple[Expression, ...]:
    """aᵢ − bᵢ for tuples of one length."""
    return tuple(subtract(x, y, span) for x, y in zip(a, b, strict=True))


def minor(a: tuple[Expression, ...], b: tuple[Expression, ...], i: int, j: int, span: Span | None = None) -> Expression:
    """aᵢ bⱼ − aⱼ bᵢ."""
    return subtract(multiply(a[i], b[j], span), multiply(a[j], b[i], span), span)


def cross(a: tuple[Expression, ...], b: tuple[Expression, ...], span: Span | None = None) -> tuple[Expression, ...]:
    """a × b for tuples of three."""
    return tuple(minor(a, b, i, j, span) for i, j in ((1, 2), (2, 0), (0, 1)))


def _simplify(operation: Operation, arguments: tuple[Expression, ...]) -> Expression | None:
    if operation is Operation.ADD:
        if _is_zero(arguments[0]):
            return arguments[1]
        return arguments[0] if _is_zero(arguments[1]) else None
    if operation is Operation.SUBTRACT:
        if _is_zero(arguments[1]):
            return arguments[0]
        return negate(arguments[1]) if _is_zero(arguments[0]) else None
    if operation is Operation.MULTIPLY:
        if _is_zero(arguments[0]) or _is_zero(arguments[1]):
            return Number(0, None, None)
        if _is_one(arguments[0]):
            return arguments[1]
        return arguments[0] if _is_one(arguments[1]) else None
    if operation is Operation.DIVIDE and _is_one(arguments[1]):
        return arguments[0]
    if operation is Operation.POWER and isinstance(arguments[1], Number) and arguments[1].value == 1:
        return arguments[0]
    if operation is Operation.NEGATE:
        inner = arguments[0]
        if isinstance(inner, Apply) and inner.operation is Operation.NEGATE:
            return inner.arguments[0]
    return None


def _is_zero(node: Expression) -> bool:
    """A zero that vanishes without a trace: it asks for no dimension, and makes no angle of what it is added to."""
    if not isinstance(node, Number) or node.value != 0 or node.angle:
        return False
    return node.dimension is None or node.dimension.is_none


def _is_one(node: Expression) -> bool:
    return isinstance(node, Number) and node.value == 1 and node.dimension is not None and node.dimension.is_none


def _fold(operation: Operation, arguments: list[Number], span: Span | None) -> Expression | None:
    known = [a.dimension for a in arguments]
    dimension = _folded_dimension(operation, arguments, known)
    if dimension is _CLASH:
        return None
    value = fold_values(operation, [a.value for a in arguments])
    if isinstance(value, bool):
        return None
    return Number(value, dimension, span, _is_angle(operation, arguments))


_CLASH = Dimension(())
"""Stands for: do not fold, unit inference must see this node."""


def _folded_dimension(operation: Operation, arguments: list[Number], known: list[Dimension | None]) -> Dimension | None:
    first, second, rule = known[0], known[-1], operation.dimensions
    if rule is Dimensions.ALIKE:
        if first is None or second is None:
            return first or second
        return first if first == second else _CLASH
    if rule is Dimensions.KEPT:
        return first
    if rule in (Dimensions.PRODUCT, Dimensions.QUOTIENT):
        if first is None and (second is None or second.is_none):
            return None  # a number whose dimension is open stays one when a pure number multiplies or divides it
        if second is None and first is not None and first.is_none and rule is Dimensions.PRODUCT:
            return None
        if first is None or second is None:
            return _CLASH
        return first * second if rule is Dimensions.PRODUCT else first / second
    if rule is Dimensions.POWER:
        if second is not None and not second.is_none:
            return _CLASH
        if first is None:
            return None
        exponent = arguments[1].value
        return first**exponent if isinstance(exponent, int | Fraction) else (NONE if first.is_none else _CLASH)
    if rule is Dimensions.ROOT:
        return first ** Fraction(1, 2) if first is not None else None
    if rule is Dimensions.COMPARED:
        return NONE if first == second or None in known else _CLASH
    return NONE if rule is Dimensions.ANY or all(d is None or d.is_none for d in known) else _CLASH


def fold_values(operation: Operation, values: list[int | Fraction | float]) -> int | Fraction | float | bool:
    """The value of ``operation`` on plain numbers: exact where they are, checked to be finite.

    Raises:
        UndefinedValueError: outside the domain, division by zero, overflow.

    """
    try:
        value = _fold_values(operation, values)
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        shown = " ".join(_shown(v) for v in values)
        raise UndefinedValueError(f"({operation.value} {shown})") from error
    if isinstance(value, complex) or (isinstance(value, float) and not math.isfinite(value)):
        shown = " ".join(_shown(v) for v in values)
        raise UndefinedValueError(f"({operation.value} {shown})")
    if isinstance(value, Fraction) and value.denominator == 1:
        value = value.numerator  # whole: it may index, and its roots may be exact
    if isinstance(value, int | Fraction) and not isinstance(value, bool):
        numerator, denominator = (value, 1) if isinstance(value, int) else (value.numerator, value.denominator)
        if max(numerator.bit_length(), denominator.bit_length()) > MAXIMUM_BITS:
            return _finite_float(operation, value)
    return value


def _finite_float(operation: Operation, value: int | Fraction) -> float:
    try:
        return float(value)
    except OverflowError as error:
        raise UndefinedValueError(f"({operation.value} …)") from error


def _shown(value: int | Fraction | float) -> str:
    if isinstance(value, int) and value.bit_length() > 200:
        return "…"
    if isinstance(value, float):
        return f"{value:g}"
    return str(value) if abs(value.numerator) < 10**15 else f"{float(value):g}"


def _fold_values(operation: Operation, v: list[int | Fraction | float]) -> int | Fraction | float | bool:
    match operation:
        case Operation.ADD:
            return v[0] + v[1]
        case Operation.SUBTRACT:
            return v[0] - v[1]
        case Operation.NEGATE:
            return -v[0]
        case Operation.MULTIPLY:
            return v[0] * v[1]
        case Operation.DIVIDE:
            return _quotient(v[0], v[1])
        case Operation.POWER:
            return _power(v[0], v[1])
        case Operation.ABS:
            return v[0] if v[0] >= 0 else -v[0]
        case Operation.SIGN:
            return _sign(v[0])
        case Operation.FLOOR:
            return math.floor(v[0])
        case Operation.MINIMUM:
            return v[0] if v[0] <= v[1] else v[1]
        case Operation.MAXIMUM:
            return v[0] if v[0] >= v[1] else v[1]
        case Operation.WRAP:
            return wrap_angle(float(v[0]))
        case Operation.LESS:
            return v[0] < v[1]
        case Operation.LESS_EQUAL:
            return v[0] <= v[1]
        case Operation.EQUAL:
            return v[0] == v[1]
        case Operation.FINITE:
            return True
        case _:
            return _function(operation, v)


def _function(operation: Operation, v: list[int | Fraction | float]) -> int | Fraction | float:
    if operation.operator is None:
        return v[0]
    if operation is Operation.SQRT and isinstance(v[0], int) and v[0] >= 0 and math.isqrt(v[0]) ** 2 == v[0]:
        return math.isqrt(v[0])
    exact = _right_angle(operation, float(v[0]))
    if exact is not None:
        return exact
    found: float = getattr(math, operation.operator.value)(*map(float, v))
    return found


def _right_angle(operation: Operation, angle: float) -> int | None:
    """Sine and cosine of what was written as a whole number of right angles: 0, 1 or −1, not 6e-17.

    A model turned by 90deg then has equations without rotations in them.
    """
    if operation not in (Operation.SIN, Operation.COS) or abs(angle) > MAXIMUM_RIGHT_ANGLES * math.pi / 2:
        return None
    turns = round(angle / (math.pi / 2))
    if angle != turns * (math.pi / 2):
        return None
    return (0, 1, 0, -1)[(turns + (operation is Operation.COS)) % 4]


def _sign(a: int | Fraction | float) -> int:
    return 0 if a == 0 else 1 if a > 0 else -1


def _quotient(a: int | Fraction | float, b: int | Fraction | float) -> int | Fraction | float:
    if isinstance(a, int | Fraction) and isinstance(b, int | Fraction):
        return Fraction(a) / Fraction(b)
    return a / b


def _power(a: int | Fraction | float, b: int | Fraction | float) -> int | Fraction | float:
    if isinstance(a, int | Fraction) and isinstance(b, int):
        size = max(abs(a.numerator).bit_length(), a.denominator.bit_length())
        if size * abs(b) <= MAXIMUM_BITS:
            power: Fraction = Fraction(a) ** b
            return int(power) if power.denominator == 1 else power
    return math.pow(float(a), float(b))


_UNFOLDED = CONDITIONS | {Operation.IF, Operation.EXTERNAL}
"""Operations whose value is no number, or that choose one, or that only a solve computes."""


_asked: ContextVar[set[str] | None] = ContextVar("asked", default=None)


@contextmanager
def noting_constants(names: set[str]) -> Iterator[None]:
    """Inside, the ``names`` of constants whose values decide what is compiled are noted, wherever it is deep inside."""
    token = _asked.set(names)
    try:
        yield
    finally:
        _asked.reset(token)


def known_value(node: Number | Constant) -> int | Fraction | float:
    """The value of a number or constant, that decides what is compiled."""
    names = _asked.get()
    if names is not None and isinstance(node, Constant):
        names.add(node.name)
    return node.value


def constant_value(node: Expression) -> int | Fraction | float | None:
    """The value of an expression over numbers and constants only, or None if it holds anything else.

    Raises:
        UndefinedValueError: outside an operation's domain, division by zero, overflow.

    """
    if isinstance(node, Number | Constant):
        return known_value(node)
    if not isinstance(node, Apply):
        return None
    values: dict[int, int | Fraction | float] = {}
    order = postorder((node,))
    for each in order:
        known = isinstance(each, Number | Constant) or (isinstance(each, Apply) and each.operation not in _UNFOLDED)
        if not known:
            return None
    for each in order:
        if isinstance(each, Apply):
            values[id(each)] = fold_values(each.operation, [values[id(a)] for a in each.arguments])
        elif isinstance(each, Number | Constant):
            values[id(each)] = known_value(each)
    return values[id(node)]
