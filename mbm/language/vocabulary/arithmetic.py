"""Arithmetic and functions of real numbers, element by element on vectors."""

from __future__ import annotations

import math
from collections.abc import Callable

from mbm.expression import algebra
from mbm.expression.algebra import apply
from mbm.expression.nodes import Expression, Number, Operation
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.scope import scalar, vector
from mbm.language.values import SCALARS, Array, Builtin, Call, ListValue, Placeable, RotationValue, Value, describe
from mbm.text.types import MbmError, Span

Scalars = Callable[..., Expression]


def elementwise(function: Scalars, values: tuple[Value, ...], spans: tuple[Span, ...], span: Span) -> Value:
    """``function`` on scalars, or element by element; scalars broadcast to the shape of the vectors."""
    operands = [_operand(v, s) for v, s in zip(values, spans, strict=True)]
    return _broadcast(function, operands, span)


def _broadcast(function: Scalars, operands: list[Expression | Array], span: Span) -> Expression | Array:
    arrays = [o for o in operands if isinstance(o, Array)]
    if not arrays:
        return function(*operands)
    shape = arrays[0].shape
    for array in arrays[1:]:
        if array.shape != shape:
            raise MbmError(faults.length_clash(span, describe(arrays[0]), describe(array)))
    elements = [
        function(*(o.elements[i] if isinstance(o, Array) else o for o in operands))
        for i in range(len(arrays[0].elements))
    ]
    return Array(shape, tuple(elements))


def _operand(value: Value, span: Span) -> Expression | Array:
    # The test that nearly always holds stands first: this runs for every operand of every operation.
    if isinstance(value, SCALARS):
        return scalar(value, span, "a number or a vector")
    if isinstance(value, Array):
        return value
    if isinstance(value, ListValue | Placeable):
        return vector(value, span)
    if isinstance(value, RotationValue):
        raise MbmError(
            faults.wrong_kind(span, "a number or a vector", "a rotation; write `(compose …)` or `(rotate …)`")
        )
    return scalar(value, span, "a number or a vector")


def _spans(call: Call) -> tuple[Span, ...]:
    return tuple([f.span for f in call.forms])


def elementwise_sum(a: Value, b: Value, span: Span) -> Value:
    """a + b for numbers or vectors."""
    return elementwise(lambda x, y: algebra.add(x, y, span), (a, b), (span, span), span)


def _fold(operation: Operation, empty: int | None) -> Callable[[Call], Value]:
    def function(call: Call) -> Value:
        values, spans, span = call.arguments, _spans(call), call.span
        if not values:
            return Number(empty if empty is not None else 0, None, span)
        if operation is Operation.MULTIPLY:
            _refuse_matrices(values, span)

        def both(x: Expression, y: Expression) -> Expression:
            return apply(operation, x, y, span=span)

        result = _operand(values[0], spans[0])
        for value, place in zip(values[1:], spans[1:], strict=True):
            other = _operand(value, place)
            if isinstance(result, Array) or isinstance(other, Array):
                result = _broadcast(both, [result, other], span)
            else:
                result = apply(operation, result, other, span=span)
        return result

    return function


def _refuse_matrices(values: tuple[Value, ...], span: Span) -> None:
    matrices = [v for v in values if isinstance(v, RotationValue) or (isinstance(v, Array) and v.is_matrix)]
    if not matrices:
        return
    vectors = [v for v in values if isinstance(v, Array | ListValue | Placeable)]
    if len(matrices) > 1 or (matrices and len(vectors) > len([m for m in matrices if isinstance(m, Array)])):
        raise MbmError(faults.matrix_product(span))


def _minus(call: Call) -> Value:
    if len(call.arguments) == 1:
        return elementwise(lambda x: algebra.negate(x, call.span), call.arguments, _spans(call), call.span)
    return _fold(Operation.SUBTRACT, None)(call)


def _over(call: Call) -> Value:
    if len(call.arguments) == 1:
        one = Number(1, NONE, call.span)
        return elementwise(lambda x: algebra.divide(one, x, call.span), call.arguments, _spans(call), call.span)
    return _fold(Operation.DIVIDE, None)(call)


def _plain(operation: Operation) -> Callable[[Call], Value]:
    def function(call: Call) -> Value:
        return elementwise(lambda *xs: apply(operation, *xs, span=call.span), call.arguments, _spans(call), call.span)

    return function


def _log10(call: Call) -> Value:
    ten = Number(math.log(10), NONE)

    def log10(x: Expression) -> Expression:
        if isinstance(x, Number) and x.value > 0:
            return Number(math.log10(x.value), NONE, call.span)
        return algebra.divide(apply(Operation.LOG, x, span=call.span), ten, call.span)

    return elementwise(log10, call.arguments, _spans(call), call.span)


def _modulo(call: Call) -> Value:
    def modulo(a: Expression, b: Expression) -> Expression:
        whole = apply(Operation.FLOOR, algebra.divide(a, b, call.span), span=call.span)
        return algebra.subtract(a, algebra.multiply(b, whole, call.span), call.span)

    return elementwise(modulo, call.arguments, _spans(call), call.span)


def _function(operation: Operation, doc: str, usage: str = "x", count: int = 1) -> Builtin:
    return Builtin(operation.value, f"({operation.value} {usage})", doc, count, count, _plain(operation))


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("+", "(+ a b …)", "Sum.", 1, None, _fold(Operation.ADD, 0)),
    Builtin("-", "(- a b …) or (- a)", "Difference; with one argument, the negative.", 1, None, _minus),
    Builtin("*", "(* a b …)", "Product, element by element; `@` is the matrix product.", 1, None, _fold(Operation.MULTIPLY, 1)),
    Builtin("/", "(/ a b …) or (/ a)", "Quotient; with one argument, the reciprocal.", 1, None, _over),
    Builtin("^", "(^ a b)", "Power.", 2, 2, _plain(Operation.POWER)),
    Builtin("min", "(min a b …)", "The least.", 1, None, _fold(Operation.MINIMUM, None)),
    Builtin("max", "(max a b …)", "The greatest.", 1, None, _fold(Operation.MAXIMUM, None)),
    Builtin("log10", "(log10 x)", "Logarithm to base 10.", 1, 1, _log10),
    Builtin("mod", "(mod a b)", "a − b·floor(a/b), with the sign of b.", 2, 2, _modulo),
    Builtin("hypot", "(hypot a b)", "√(a² + b²).", 2, 2, _plain(Operation.HYPOT)),
    Builtin("atan2", "(atan2 y x)", "The angle of the direction (x, y), in (−π, π]; its differences wrap.", 2, 2, _plain(Operation.ATAN2)),
    Builtin("angle", "(angle x)", "x as an angle: its differences wrap.", 1, 1, _plain(Operation.AS_ANGLE)),
    Builtin("held", "(held x)", "x as a constant: derivatives with respect to unknowns leave it as it is.", 1, 1, _plain(Operation.HELD)),
    _function(Operation.SQRT, "Square root."),
    _function(Operation.EXP, "Exponential."),
    _function(Operation.LOG, "Natural logarithm."),
    _function(Operation.ABS, "Absolute value."),
    _function(Operation.SIGN, "−1, 0 or 1."),
    _function(Operation.FLOOR, "The greatest whole number not above x."),
    _function(Operation.SIN, "Sine of an angle in rad."),
    _function(Operation.COS, "Cosine of an angle in rad."),
    _function(Operation.TAN, "Tangent of an angle in rad."),
    _function(Operation.ASIN, "Inverse sine, in rad."),
    _function(Operation.ACOS, "Inverse cosine, in rad."),
    _function(Operation.ATAN, "Inverse tangent, in rad; `atan2` knows the quadrant."),
    _function(Operation.SINH, "Hyperbolic sine."),
    _function(Operation.COSH, "Hyperbolic cosine."),
    _function(Operation.TANH, "Hyperbolic tangent."),
    _function(Operation.ASINH, "Inverse hyperbolic sine."),
    _function(Operation.ACOSH, "Inverse hyperbolic cosine."),
    _function(Operation.ATANH, "Inverse hyperbolic tangent."),
)  # fmt: skip
