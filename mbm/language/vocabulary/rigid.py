"""Rotations, poses and similarities: combined, inverted, applied, and their differences in the tangent space.

Differences are ``(Log(R_mᵀ R), R_mᵀ (t − t_m), log(c / c_m))`` with m the measured one: rotation first (LANGUAGE §4).
"""

from __future__ import annotations

from fractions import Fraction

from mbm.expression.algebra import (
    ONE,
    TWO,
    ZERO,
    add,
    apply,
    differences,
    divide,
    dot,
    multiply,
    negate,
    number,
    subtract,
    wrap,
)
from mbm.expression.nodes import Apply, Expression, Number, Operation
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.values import Array, PoseValue, RotationValue, Value, describe, described_with_space
from mbm.language.vocabulary.vectors import norm_of, product, transposed
from mbm.solver.manifolds import SEAM
from mbm.text.types import MbmError, Span

_SMALL_SINE = Number(2.5e-3, NONE)
"""Squared sine below which asin(x)/x is taken from its series (remainder below 1e-16)."""

_SEAM = Number(SEAM, NONE)

_ASIN = (1.0, 6.0, 40 / 3, 112 / 5, 1152 / 35, 2816 / 63)
"""Reciprocal coefficients of asin(x)/x in x²."""


def plane_rotation(angle: Expression, span: Span) -> RotationValue:
    """The rotation of the plane by an angle."""
    c, s = apply(Operation.COS, angle, span=span), apply(Operation.SIN, angle, span=span)
    return RotationValue(Array((2, 2), (c, negate(s, span), s, c)), angle=apply(Operation.AS_ANGLE, angle, span=span))


def quaternion_rotation(unit: tuple[Expression, ...], span: Span) -> RotationValue:
    """The rotation of a quaternion (w, x, y, z) of length 1."""
    w, x, y, z = unit

    def double(a: Expression, b: Expression) -> Expression:
        return multiply(TWO, multiply(a, b, span), span)

    def diagonal(a: Expression, b: Expression) -> Expression:
        return subtract(ONE, add(double(a, a), double(b, b), span), span)

    elements = (
        diagonal(y, z),
        subtract(double(x, y), double(w, z), span),
        add(double(x, z), double(w, y), span),
        add(double(x, y), double(w, z), span),
        diagonal(x, z),
        subtract(double(y, z), double(w, x), span),
        subtract(double(x, z), double(w, y), span),
        add(double(y, z), double(w, x), span),
        diagonal(x, y),
    )
    return RotationValue(Array((3, 3), elements), quaternion=unit)


def rotate_vector(rotation: RotationValue, elements: tuple[Expression, ...], span: Span) -> tuple[Expression, ...]:
    """R x."""
    return tuple(dot(row, elements, span) for row in rotation.matrix.rows())


def pose(value: Value, span: Span) -> PoseValue:
    """A pose or similarity; a rotation is a pose without translation."""
    if isinstance(value, RotationValue):
        return PoseValue(value, (number(0),) * value.dimension)
    if not isinstance(value, PoseValue):
        raise MbmError(faults.wrong_kind(span, "a pose", describe(value)))
    return value


def apply_pose(p: PoseValue, elements: tuple[Expression, ...], span: Span) -> tuple[Expression, ...]:
    """c R x + t."""
    turned = rotate_vector(p.rotation, elements, span)
    if p.scale is not None:
        turned = tuple(multiply(p.scale, e, span) for e in turned)
    return tuple(add(e, t, span) for e, t in zip(turned, p.translation, strict=True))


def inverse_rotation(r: RotationValue, span: Span) -> RotationValue:
    """R⁻¹ = Rᵀ."""
    quaternion = None
    if r.quaternion is not None:
        quaternion = (r.quaternion[0], *(negate(e, span) for e in r.quaternion[1:]))
    angle = None if r.angle is None else negate(r.angle, span)
    return RotationValue(transposed(r.matrix), quaternion, angle)


def compose_rotations(p: RotationValue, q: RotationValue, span: Span) -> RotationValue:
    """The rotation q, then p.

    Raises MbmError (`length-clash`) where one is of the plane and one of space.
    """
    if p.dimension != q.dimension:
        raise MbmError(faults.length_clash(span, "a rotation of the plane", "a rotation of space"))
    quaternion = angle = None
    if p.quaternion is not None and q.quaternion is not None:
        quaternion = _hamilton(p.quaternion, q.quaternion, span)
    if p.angle is not None and q.angle is not None:
        angle = add(p.angle, q.angle, span)
    return RotationValue(product(p.matrix, q.matrix, span), quaternion, angle)


def _hamilton(p: tuple[Expression, ...], q: tuple[Expression, ...], span: Span) -> tuple[Expression, ...]:
    """The product of two quaternions."""
    signs = (
        ((1, 0, 0), (-1, 1, 1), (-1, 2, 2), (-1, 3, 3)),
        ((1, 0, 1), (1, 1, 0), (1, 2, 3), (-1, 3, 2)),
        ((1, 0, 2), (-1, 1, 3), (1, 2, 0), (1, 3, 1)),
        ((1, 0, 3), (1, 1, 2), (-1, 2, 1), (1, 3, 0)),
    )
    found = []
    for terms in signs:
        total = multiply(p[terms[0][1]], q[terms[0][2]], span)
        for sign, i, j in terms[1:]:
            term = multiply(p[i], q[j], span)
            total = add(total, term, span) if sign > 0 else subtract(total, term, span)
        found.append(total)
    return tuple(found)


def inverse_pose(p: PoseValue, span: Span) -> PoseValue:
    """x = c⁻¹ Rᵀ (y − t)."""
    rotation = inverse_rotation(p.rotation, span)
    moved = rotate_vector(rotation, tuple(negate(t, span) for t in p.translation), span)
    if p.scale is None:
        return PoseValue(rotation, moved)
    scale = divide(ONE, p.scale, span)
    return PoseValue(rotation, tuple(multiply(scale, e, span) for e in moved), scale)


def compose(p: PoseValue, q: PoseValue, span: Span) -> PoseValue:
    """x ↦ p(q(x))."""
    if p.rotation.dimension != q.rotation.dimension:
        raise MbmError(faults.length_clash(span, "a pose of the plane", "a pose of space"))
    rotation = compose_rotations(p.rotation, q.rotation, span)
    scale = p.scale if q.scale is None else q.scale if p.scale is None else multiply(p.scale, q.scale, span)
    return PoseValue(rotation, apply_pose(p, q.translation, span), scale)


def unit_vector(v: tuple[Expression, ...], span: Span) -> tuple[Expression, ...]:
    """v / |v|."""
    length = norm_of(v, span)
    return tuple(divide(e, length, span) for e in v)


def power_series(x: Expression, denominators: tuple[float, ...], span: Span) -> Expression:
    """Σ xⁱ / dᵢ by Horner's rule."""
    result: Expression = Number(1 / denominators[-1], NONE)
    for denominator in reversed(denominators[:-1]):
        result = add(Number(1 / denominator, NONE), multiply(x, result, span), span)
    return result


def logarithm(r: RotationValue, span: Span) -> tuple[Expression, ...]:
    """Log R: the angle (plane, wrapped), or the vector of the axis times the angle in [0, π] (space)."""
    if r.dimension == 2:
        m = r.matrix.elements
        return (wrap(r.angle if r.angle is not None else apply(Operation.ATAN2, m[2], m[0], span=span), span),)
    w, *v = r.quaternion if r.quaternion is not None else _quaternion_of(r.matrix.elements, span)
    squared = dot(tuple(v), tuple(v), span)
    small = Apply(Operation.LESS, (squared, _SMALL_SINE), span=span)
    sine = apply(Operation.SQRT, apply(Operation.IF, small, ONE, squared, span=span), span=span)
    positive = _positive(w, span)
    # q and −q are one rotation: the one with w ≥ 0 has the shorter angle.
    ahead = divide(apply(Operation.ATAN2, sine, w, span=span), sine, span)
    behind = divide(negate(apply(Operation.ATAN2, sine, negate(w, span), span=span), span), sine, span)
    series = power_series(squared, _ASIN, span)
    factor = apply(
        Operation.IF,
        positive,
        apply(Operation.IF, small, series, ahead, span=span),
        apply(Operation.IF, small, negate(series, span), behind, span=span),
        span=span,
    )
    doubled = multiply(TWO, factor, span)
    return tuple(multiply(doubled, e, span) for e in v)


def _quaternion_of(m: tuple[Expression, ...], span: Span) -> tuple[Expression, ...]:
    """The unit quaternion of a rotation matrix (3×3, row by row), by the largest of its four numbers (Shepperd 1978)."""
    diagonal = (m[0], m[4], m[8])
    trace = add(add(m[0], m[4], span), m[8], span)
    pairs = (subtract(m[7], m[5], span), subtract(m[2], m[6], span), subtract(m[3], m[1], span))
    sums = {(1, 2): add(m[3], m[1], span), (1, 3): add(m[6], m[2], span), (2, 3): add(m[7], m[5], span)}
    candidates = []
    for k in range(4):
        signed = trace
        if k:
            signed = subtract(multiply(TWO, diagonal[k - 1], span), trace, span)
        # 1 at least where this candidate is the one chosen; elsewhere it only has to be a number.
        fourfold = apply(Operation.MAXIMUM, add(ONE, signed, span), Number(Fraction(1, 2), NONE), span=span)
        root = apply(Operation.SQRT, fourfold, span=span)
        divisor = multiply(TWO, root, span)
        found: list[Expression] = []
        for j in range(4):
            if j == k:
                found.append(divide(root, TWO, span))
            else:
                low, high = sorted((j, k))
                entry = pairs[high - 1] if low == 0 else sums[low, high]
                found.append(divide(entry, divisor, span))
        candidates.append(tuple(found))
    result = candidates[3]
    for k, rivals in ((2, (3,)), (1, (2, 3))):
        test: Expression = Apply(Operation.LESS_EQUAL, (diagonal[rivals[0] - 1], diagonal[k - 1]), span=span)
        for rival in rivals[1:]:
            other = Apply(Operation.LESS_EQUAL, (diagonal[rival - 1], diagonal[k - 1]), span=span)
            test = Apply(Operation.AND, (test, other), span=span)
        pairs_ = zip(candidates[k], result, strict=True)
        result = tuple(apply(Operation.IF, test, a, b, span=span) for a, b in pairs_)
    test = Apply(Operation.LESS, (ZERO, trace), span=span)
    return tuple(apply(Operation.IF, test, a, b, span=span) for a, b in zip(candidates[0], result, strict=True))


def geometric_difference(measured: Value, model: Value, span: Span) -> tuple[Expression, ...] | None:
    """The difference of two rotations, poses or similarities; None where neither is one.

    Raises MbmError (`length-clash`) where the two are not of one kind.
    """
    if not (isinstance(measured, RotationValue | PoseValue) or isinstance(model, RotationValue | PoseValue)):
        return None
    if _kind(measured) != _kind(model):
        raise MbmError(faults.length_clash(span, described_with_space(measured), described_with_space(model)))
    first, second = pose(measured, span), pose(model, span)
    back = inverse_rotation(first.rotation, span)
    turned = logarithm(compose_rotations(back, second.rotation, span), span)
    if isinstance(measured, RotationValue):
        return turned
    moved = differences(second.translation, first.translation, span)
    moved = rotate_vector(back, moved, span)
    if first.scale is None or second.scale is None:
        return (*turned, *moved)
    return (*turned, *moved, apply(Operation.LOG, divide(second.scale, first.scale, span), span=span))


def logarithms(value: RotationValue | PoseValue, span: Span) -> tuple[Expression, ...]:
    """The difference from the identity: what ``h`` is where a rotation, pose or similarity stands for an equation."""
    turned = logarithm(value if isinstance(value, RotationValue) else value.rotation, span)
    if isinstance(value, RotationValue):
        return turned
    scale = () if value.scale is None else (apply(Operation.LOG, value.scale, span=span),)
    return (*turned, *value.translation, *scale)


def direction_difference(
    measured: tuple[Expression, ...], model: tuple[Expression, ...], span: Span
) -> tuple[Expression, ...]:
    """The two coordinates of the direction ``model`` in the tangent plane at ``measured``: the angle, along its course.

    The plane's axes are those that `tangent_axes` gives. Lengths do not matter.
    """
    m, d = unit_vector(measured, span), unit_vector(model, span)
    first, second = tangent_axes(m, span)
    across = (dot(first, d, span), dot(second, d, span))
    along = dot(m, d, span)
    squared = dot(across, across, span)
    small = Apply(
        Operation.AND, (Apply(Operation.LESS, (squared, _SMALL_SINE), span=span), _positive(along, span)), span=span
    )
    sine = apply(Operation.SQRT, apply(Operation.IF, small, ONE, squared, span=span), span=span)
    exact = divide(apply(Operation.ATAN2, sine, along, span=span), sine, span)
    series = power_series(squared, _ASIN, span)
    factor = apply(Operation.IF, small, series, exact, span=span)
    return tuple(multiply(factor, e, span) for e in across)


def tangent_axes(unit: tuple[Expression, ...], span: Span) -> tuple[tuple[Expression, ...], tuple[Expression, ...]]:
    """Two unit vectors orthogonal to a unit vector and to one another (Duff et al. 2017)."""
    x, y, z = unit
    sign = apply(Operation.IF, Apply(Operation.LESS, (z, _SEAM), span=span), negate(ONE, span), ONE, span=span)
    a = divide(negate(ONE, span), add(sign, z, span), span)
    b = multiply(multiply(x, y, span), a, span)
    first = (
        add(ONE, multiply(sign, multiply(multiply(x, x, span), a, span), span), span),
        multiply(sign, b, span),
        negate(multiply(sign, x, span), span),
    )
    second = (b, add(sign, multiply(multiply(y, y, span), a, span), span), negate(y, span))
    return first, second


def _positive(node: Expression, span: Span) -> Expression:
    return Apply(Operation.LESS, (ZERO, node), span=span)


def _kind(value: Value) -> tuple[str, int]:
    if isinstance(value, RotationValue):
        return "a rotation", value.dimension
    return (value.kind, value.rotation.dimension) if isinstance(value, PoseValue) else (describe(value), 0)
