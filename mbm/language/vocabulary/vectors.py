"""Vectors and matrices."""

from __future__ import annotations

from collections.abc import Callable

from mbm.expression import algebra
from mbm.expression.algebra import add, apply, dot, number
from mbm.expression.nodes import Expression, Operation
from mbm.language import faults
from mbm.language.scope import integer, matrix, vector
from mbm.language.values import (
    Array,
    Builtin,
    Call,
    ListValue,
    Placeable,
    RotationValue,
    Transform,
    Value,
    describe,
)
from mbm.text.types import MbmError, Span


def norm_of(elements: tuple[Expression, ...], span: Span) -> Expression:
    """The Euclidean length."""
    return apply(Operation.SQRT, algebra.dot(elements, elements, span), span=span)


def pair_of_vectors(call: Call) -> tuple[Array, Array]:
    """Two vectors of one length."""
    a = vector(call.arguments[0], call.forms[0].span)
    b = vector(call.arguments[1], call.forms[1].span)
    if a.shape != b.shape:
        raise MbmError(faults.length_clash(call.span, describe(a), describe(b)))
    return a, b


def product(a: Array, b: Array, span: Span) -> Array:
    """The matrix product; vectors on the right are columns, on the left rows."""
    inner = a.shape[-1]
    if inner != b.shape[0]:
        raise MbmError(faults.length_clash(span, describe(a), describe(b)))
    rows = a.rows() if a.is_matrix else (a.elements,)
    width = b.shape[1] if b.is_matrix else 1
    columns = [tuple(b.elements[i * width + j] for i in range(inner)) for j in range(width)]
    elements = tuple(algebra.dot(row, column, span) for row in rows for column in columns)
    shape = tuple(([a.shape[0]] if a.is_matrix else []) + ([width] if b.is_matrix else []))
    return Array(shape or (1,), elements)


def _dot(call: Call) -> Value:
    a, b = pair_of_vectors(call)
    return algebra.dot(a.elements, b.elements, call.span)


def _cross(call: Call) -> Value:
    a, b = pair_of_vectors(call)
    if a.shape == (2,):
        return algebra.minor(a.elements, b.elements, 0, 1, call.span)
    if a.shape != (3,):
        raise MbmError(faults.length_clash(call.span, describe(a), "the cross product (length 3, or 2)"))
    return Array((3,), algebra.cross(a.elements, b.elements, call.span))


def _norm(call: Call) -> Value:
    return norm_of(vector(call.arguments[0], call.forms[0].span).elements, call.span)


def _distance(call: Call) -> Value:
    a, b = pair_of_vectors(call)
    pairs = zip(a.elements, b.elements, strict=True)
    return norm_of(tuple(algebra.subtract(x, y, call.span) for x, y in pairs), call.span)


def _normalize(call: Call) -> Value:
    v = vector(call.arguments[0], call.forms[0].span)
    length = norm_of(v.elements, call.span)
    return Array(v.shape, tuple(algebra.divide(e, length, call.span) for e in v.elements))


def _counted(operation: Callable[[Expression, Expression, Span], Expression]) -> Callable[[Call], Value]:
    """``(subvv 2 a b)`` of the paper: the length stands first, and may be left out."""

    def function(call: Call) -> Value:
        arguments, forms = call.arguments, call.forms
        if len(arguments) == 3:
            length = integer(arguments[0], forms[0].span, "the length of the vectors")
            arguments, forms = arguments[1:], forms[1:]
        else:
            length = None
        a, b = (vector(v, f.span, length) for v, f in zip(arguments, forms, strict=True))
        if a.shape != b.shape:
            raise MbmError(faults.length_clash(call.span, describe(a), describe(b)))
        pairs = zip(a.elements, b.elements, strict=True)
        return Array(a.shape, tuple(operation(x, y, call.span) for x, y in pairs))

    return function


def _matrix_product(call: Call) -> Value:
    operands = []
    for value, form in zip(call.arguments, call.forms, strict=True):
        is_vector = isinstance(value, ListValue | Placeable) or (isinstance(value, Array) and not value.is_matrix)
        operands.append(vector(value, form.span) if is_vector else matrix(value, form.span))
    result = operands[0]
    for operand in operands[1:]:
        _afford(call, result, operand)
        result = product(result, operand, call.span)
    both_vectors = len(operands) == 2 and not operands[0].is_matrix and not operands[1].is_matrix
    return result.elements[0] if both_vectors else result


def _afford(call: Call, a: Array, b: Array) -> None:
    """A matrix product is cubic work: refused before it is done if it is beyond the budget."""
    call.evaluator.budget.spend(len(a.elements) * (b.shape[1] if b.is_matrix else 1), call.form)


def _mulmv(call: Call) -> Value:
    return product(
        matrix(call.arguments[0], call.forms[0].span), vector(call.arguments[1], call.forms[1].span), call.span
    )


def _transpose(call: Call) -> Value:
    value = call.arguments[0]
    if isinstance(value, RotationValue):
        return RotationValue(transposed(value.matrix))
    return transposed(matrix(value, call.forms[0].span))


def transposed(m: Array) -> Array:
    """The transpose of a matrix."""
    rows, columns = m.shape
    return Array((columns, rows), tuple(m.elements[i * columns + j] for j in range(columns) for i in range(rows)))


def _outer(call: Call) -> Value:
    a = vector(call.arguments[0], call.forms[0].span)
    b = vector(call.arguments[1], call.forms[1].span)
    call.evaluator.budget.check_length(a.shape[0] * b.shape[0], call.form)
    call.evaluator.budget.make(a.shape[0] * b.shape[0], call.form)
    elements = tuple(algebra.multiply(x, y, call.span) for x in a.elements for y in b.elements)
    return Array((a.shape[0], b.shape[0]), elements)


def _determinant(call: Call) -> Value:
    m = matrix(call.arguments[0], call.forms[0].span)
    if m.shape[0] != m.shape[1]:
        raise MbmError(faults.length_clash(call.span, describe(m), "the determinant (a square matrix)"))
    if not 1 <= m.shape[0] <= 6:
        raise MbmError(faults.length_clash(call.span, describe(m), "the determinant (1×1 to 6×6)"))
    return _expand(m.rows(), call.span)


def _expand(rows: tuple[tuple[Expression, ...], ...], span: Span) -> Expression:
    if len(rows) == 1:
        return rows[0][0]
    result: Expression = number(0, span)
    for j, head in enumerate(rows[0]):
        minor = tuple(row[:j] + row[j + 1 :] for row in rows[1:])
        term = algebra.multiply(head, _expand(minor, span), span)
        result = algebra.add(result, term, span) if j % 2 == 0 else algebra.subtract(result, term, span)
    return result


def _identity(call: Call) -> Value:
    n = integer(call.arguments[0], call.forms[0].span, "the size of the matrix")
    if n < 1:
        raise MbmError(faults.bad_index(call.forms[0].span, f"there is no identity matrix of size {n}"))
    call.evaluator.budget.check_length(n * n, call.form)
    call.evaluator.budget.make(n * n, call.form)
    return Array((n, n), tuple(number(int(i == j)) for i in range(n) for j in range(n)))


def move_point(by: Transform, point: Array, span: Span) -> Array:
    """A x + b."""
    elements = point.elements
    size = by.matrix.shape[1] if by.matrix is not None else len(by.offset or ())
    if size != len(elements):
        raise MbmError(faults.length_clash(span, f"a point of {len(elements)} coordinates", f"`{by.head}` in {size}"))
    if by.matrix is not None:
        elements = tuple(dot(row, elements, span) for row in by.matrix.rows())
    if by.offset is not None:
        elements = tuple(add(e, b, span) for e, b in zip(elements, by.offset, strict=True))
    return Array((len(elements),), elements)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("dot", "(dot a b)", "Scalar product.", 2, 2, _dot),
    Builtin("cross", "(cross a b)", "Vector product in space; in the plane, the number a₁b₂ − a₂b₁.", 2, 2, _cross),
    Builtin("norm", "(norm v)", "Euclidean length.", 1, 1, _norm),
    Builtin("distance", "(distance p q)", "Distance of two points.", 2, 2, _distance),
    Builtin("normalize", "(normalize v)", "The unit vector along v.", 1, 1, _normalize),
    Builtin("addvv", "(addvv [n] a b)", "a + b for vectors of length n.", 2, 3, _counted(algebra.add)),
    Builtin("subvv", "(subvv [n] a b)", "a − b for vectors of length n, as in the paper.", 2, 3, _counted(algebra.subtract)),
    Builtin("mulmv", "(mulmv M v)", "The matrix M times the vector v.", 2, 2, _mulmv),
    Builtin("@", "(@ A B …)", "Matrix product.", 2, None, _matrix_product),
    Builtin("transpose", "(transpose M)", "Transpose; of a rotation, its inverse.", 1, 1, _transpose),
    Builtin("outer", "(outer a b)", "The matrix aᵢbⱼ.", 2, 2, _outer),
    Builtin("det", "(det M)", "Determinant, up to 6×6.", 1, 1, _determinant),
    Builtin("identity", "(identity n)", "The n×n identity matrix.", 1, 1, _identity),
)  # fmt: skip
