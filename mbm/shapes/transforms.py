"""Carrying points through the chain of transforms between a feature and the frame of its shape."""

from __future__ import annotations

from mbm.expression.algebra import multiply
from mbm.language.coerce import vector
from mbm.language.values import Array, Call, PoseValue, Transform
from mbm.language.vocabulary.cameras import project_point
from mbm.language.vocabulary.frames import move_point
from mbm.shapes.types import Step
from mbm.text.types import Span


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
