"""Rotations and poses as values: how they are made, combined and taken apart.

Convention: a rotation matrix R maps coordinates of the rotated frame to those of the frame it stands in, ``x = R x_b``;
``(euler φ θ ψ)`` is Rz(ψ) Ry(θ) Rx(φ) (Oyama & Tachi 1989, sect. 3 (1), with the misprints of its matrix corrected).
"""

from __future__ import annotations

from mbm.expression import algebra
from mbm.expression.algebra import (
    ONE,
    TWO,
    ZERO,
    add,
    apply,
    constant_value,
    cross,
    differences,
    divide,
    dot,
    multiply,
    negate,
    subtract,
)
from mbm.expression.nodes import Apply, Expression, Number, Operation, nearest
from mbm.expression.units import NONE
from mbm.language import faults
from mbm.language.scope import scalar, vector
from mbm.language.values import Array, Builtin, Call, PoseValue, RotationValue, Value, describe
from mbm.language.vocabulary.rigid import (
    compose,
    compose_rotations,
    inverse_pose,
    inverse_rotation,
    plane_rotation,
    pose,
    power_series,
    quaternion_rotation,
    unit_vector,
)
from mbm.text.types import MbmError, Span

POSE2, POSE3 = "(pose2 x y theta), or (pose2)", "(pose3 R t), or (pose3)"
_SMALL_ANGLE = Number(2.5e-3, NONE)
"""Squared angle below which sin x / x and (1 − cos x)/x² are taken from their series (remainder below 1e-16)."""

ORTHONORMAL_TO = 1e-9
"""How far products of the columns of a constant rotation matrix may be from 0 and 1: its numbers were typed in."""


def euler(angles: tuple[Expression, ...], span: Span) -> RotationValue:
    """Rz(ψ) Ry(θ) Rx(φ) for angles (φ, θ, ψ)."""
    (cf, ct, cp), (sf, st, sp) = (
        tuple(apply(operation, a, span=span) for a in angles) for operation in (Operation.COS, Operation.SIN)
    )
    sf_st, cf_st = multiply(sf, st, span), multiply(cf, st, span)
    return RotationValue(
        Array(
            (3, 3),
            (
                multiply(ct, cp, span),
                subtract(multiply(sf_st, cp, span), multiply(cf, sp, span), span),
                add(multiply(sf, sp, span), multiply(cf_st, cp, span), span),
                multiply(ct, sp, span),
                add(multiply(cf, cp, span), multiply(sf_st, sp, span), span),
                subtract(multiply(cf_st, sp, span), multiply(sf, cp, span), span),
                negate(st, span),
                multiply(sf, ct, span),
                multiply(cf, ct, span),
            ),
        )
    )


def as_rotation(value: Value, span: Span) -> RotationValue:
    """A rotation: as such, as three Euler angles (φ θ ψ), as one angle in the plane, or as a matrix."""
    if isinstance(value, RotationValue):
        return value
    if isinstance(value, PoseValue):
        raise MbmError(faults.wrong_kind(span, "a rotation", f"{value.kind}; write `(transform …)`"))
    if isinstance(value, Array) and value.shape in ((2, 2), (3, 3)):
        if not _may_rotate(value):
            raise MbmError(faults.no_rotation(span))
        return RotationValue(value)
    if isinstance(value, Array) and value.is_matrix:
        raise MbmError(faults.wrong_kind(span, "a rotation", describe(value)))
    if isinstance(value, Number | Apply) or not hasattr(value, "shape"):
        try:
            return plane_rotation(scalar(value, span), span)
        except MbmError:
            pass
    return euler(vector(value, span, 3).elements, span)


def _may_rotate(m: Array) -> bool:
    """Whether the columns of a constant matrix are orthonormal; one that holds data or unknowns is taken at its word."""
    known = [constant_value(e) for e in m.elements]
    values = [nearest(v) for v in known if v is not None]
    if len(values) < len(known):
        return True
    n = m.shape[0]
    columns = [values[j::n] for j in range(n)]
    products = [
        (i == j, sum(a * b for a, b in zip(columns[i], columns[j], strict=True))) for i in range(n) for j in range(n)
    ]
    return all(abs(found - same) <= ORTHONORMAL_TO for same, found in products)


def _axis_rotation(axis: int, call: Call) -> Value:
    angle = scalar(call.arguments[0], call.forms[0].span)
    angles = tuple(angle if i == axis else ZERO for i in range(3))
    return euler(angles, call.span)


def _euler(call: Call) -> Value:
    angles = tuple(scalar(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True))
    return euler(angles, call.span)


def _rot2(call: Call) -> Value:
    return plane_rotation(scalar(call.arguments[0], call.forms[0].span), call.span)


def _axis_angle(call: Call) -> Value:
    return exponential(vector(call.arguments[0], call.forms[0].span, 3).elements, call.span)


def exponential(v: tuple[Expression, ...], span: Span) -> RotationValue:
    """Rodrigues' formula R = I + a K + b K², a = sin θ/θ, b = (1 − cos θ)/θ², by series near θ = 0."""
    squared = dot(v, v, span)
    a, b = _sinc_pair(squared, span)
    rows = []
    for i in range(3):
        for j in range(3):
            outer = multiply(b, multiply(v[i], v[j], span), span)
            if i == j:
                diagonal = subtract(ONE, multiply(b, squared, span), span)
                rows.append(add(diagonal, outer, span))
            else:
                k = 3 - i - j
                term = multiply(a, v[k], span)
                positive = (i, j) in ((1, 0), (2, 1), (0, 2))
                rows.append(add(outer, term, span) if positive else subtract(outer, term, span))
    return RotationValue(Array((3, 3), tuple(rows)))


def _sinc_pair(squared: Expression, span: Span) -> tuple[Expression, Expression]:
    small = Apply(Operation.LESS, (squared, _SMALL_ANGLE), span=span)
    safe = apply(Operation.IF, small, ONE, squared, span=span)
    angle = apply(Operation.SQRT, safe, span=span)
    half_sine = apply(Operation.SIN, divide(angle, TWO, span), span=span)
    exact_a = divide(apply(Operation.SIN, angle, span=span), angle, span)
    exact_b = divide(multiply(TWO, multiply(half_sine, half_sine, span), span), safe, span)
    series_a = power_series(squared, (1, -6, 120, -5040), span)
    series_b = power_series(squared, (2, -24, 720, -40320), span)
    return (
        apply(Operation.IF, small, series_a, exact_a, span=span),
        apply(Operation.IF, small, series_b, exact_b, span=span),
    )


def _quaternion(call: Call) -> Value:
    """The rotation of the quaternion w + xi + yj + zk, which need not have length 1."""
    span = call.span
    elements = tuple(scalar(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True))
    return quaternion_rotation(unit_vector(elements, span), span)


def _look_at(call: Call) -> Value:
    """The pose of a frame at ``eye`` whose x axis points to ``target``, with z as near to ``up`` as can be."""
    span = call.span
    eye, target = (vector(v, f.span, 3) for v, f in zip(call.arguments[:2], call.forms[:2], strict=True))
    up: tuple[Expression, ...] = (ZERO, ZERO, ONE)
    if len(call.arguments) == 3:
        up = vector(call.arguments[2], call.forms[2].span, 3).elements
    forward = unit_vector(differences(target.elements, eye.elements, span), span)
    left = unit_vector(cross(up, forward, span), span)
    top = cross(forward, left, span)
    columns = (forward, left, top)
    elements = tuple(columns[j][i] for i in range(3) for j in range(3))
    return PoseValue(RotationValue(Array((3, 3), elements)), eye.elements)


def _nowhere(call: Call, size: int) -> tuple[Expression, ...]:
    """The translation of the identity; zeros whose dimension, one for all, is that of what they go with."""
    return (Number(0.0, span=call.span),) * size


def _pose2(call: Call) -> Value:
    if not call.arguments:
        return PoseValue(plane_rotation(Number(0, NONE), call.span), _nowhere(call, 2))
    if len(call.arguments) != 3:
        raise MbmError(faults.wrong_arity(call.span, "pose2", POSE2, len(call.arguments)))
    x, y, theta = (scalar(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True))
    return PoseValue(plane_rotation(theta, call.span), (x, y))


def _pose3(call: Call) -> Value:
    if not call.arguments:
        unit = tuple(Number(float(i == 0), NONE) for i in range(4))
        return PoseValue(quaternion_rotation(unit, call.span), _nowhere(call, 3))
    if len(call.arguments) != 2:
        raise MbmError(faults.wrong_arity(call.span, "pose3", POSE3, len(call.arguments)))
    rotation = as_rotation(call.arguments[0], call.forms[0].span)
    if rotation.dimension != 3:
        raise MbmError(faults.wrong_kind(call.forms[0].span, "a rotation of space", "a rotation of the plane"))
    return PoseValue(rotation, vector(call.arguments[1], call.forms[1].span, 3).elements)


def _inverse(call: Call) -> Value:
    value = call.arguments[0]
    if isinstance(value, RotationValue):
        return inverse_rotation(value, call.span)
    return inverse_pose(pose(value, call.forms[0].span), call.span)


def _compose(call: Call) -> Value:
    if all(isinstance(v, RotationValue) for v in call.arguments):
        result = as_rotation(call.arguments[0], call.span)
        for value in call.arguments[1:]:
            result = compose_rotations(result, as_rotation(value, call.span), call.span)
        return result
    poses = [pose(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True)]
    combined = poses[0]
    for each in poses[1:]:
        combined = compose(combined, each, call.span)
    return combined


def _between(call: Call) -> Value:
    first, second = (pose(v, f.span) for v, f in zip(call.arguments, call.forms, strict=True))
    relative = compose(inverse_pose(first, call.span), second, call.span)
    both_rotations = all(isinstance(v, RotationValue) for v in call.arguments)
    return relative.rotation if both_rotations else relative


def _rotation_of(call: Call) -> Value:
    return pose(call.arguments[0], call.forms[0].span).rotation


def _translation_of(call: Call) -> Value:
    p = pose(call.arguments[0], call.forms[0].span)
    return Array((len(p.translation),), p.translation)


def _heading(call: Call) -> Value:
    m = pose(call.arguments[0], call.forms[0].span).rotation.matrix
    return algebra.apply(Operation.ATAN2, m.elements[m.shape[1]], m.elements[0], span=call.span)


FUNCTIONS: tuple[Builtin, ...] = (
    Builtin("euler", "(euler phi theta psi)", "The rotation Rz(ψ) Ry(θ) Rx(φ).", 3, 3, _euler),
    Builtin("rot-x", "(rot-x a)", "Rotation about x.", 1, 1, lambda call: _axis_rotation(0, call)),
    Builtin("rot-y", "(rot-y a)", "Rotation about y.", 1, 1, lambda call: _axis_rotation(1, call)),
    Builtin("rot-z", "(rot-z a)", "Rotation about z.", 1, 1, lambda call: _axis_rotation(2, call)),
    Builtin("rot2", "(rot2 a)", "Rotation of the plane.", 1, 1, _rot2),
    Builtin("axis-angle", "(axis-angle v)", "Rotation about v by the angle |v|.", 1, 1, _axis_angle),
    Builtin("quaternion", "(quaternion w x y z)", "Rotation of a quaternion of any length.", 4, 4, _quaternion),
    Builtin("look-at", "(look-at eye target [up])", "Pose of a frame at eye: x towards target, y left, z up.", 2, 3, _look_at),
    Builtin("pose2", "(pose2 [x] [y] [theta])", "Pose in the plane; without arguments the identity.", 0, 3, _pose2),
    Builtin("pose3", "(pose3 [R] [t])", "Pose in space; without arguments the identity.", 0, 2, _pose3),
    Builtin("rotation", "(rotation P)", "The rotation of a pose.", 1, 1, _rotation_of),
    Builtin("translation", "(translation P)", "The translation of a pose.", 1, 1, _translation_of),
    Builtin("heading", "(heading P)", "The angle about z of a pose; its differences wrap.", 1, 1, _heading),
    Builtin("inverse", "(inverse P)", "The inverse of a pose, similarity or rotation.", 1, 1, _inverse),
    Builtin("compose", "(compose P Q …)", "The composition; the last one is applied first.", 1, None, _compose),
    Builtin("between", "(between P Q)", "Q as seen from P: P⁻¹ Q.", 2, 2, _between),
)  # fmt: skip
