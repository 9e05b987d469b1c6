"""When two calls of a model have the same arguments: values compared by what they are, not by where they were made."""

from __future__ import annotations

from collections.abc import Hashable

from mbm.expression.nodes import Apply, Column, Component, Constant, Expression, Leaf, Number, Opaque, postorder
from mbm.language.values import (
    FORMS,
    SCALARS,
    Array,
    CameraValue,
    FamilyValue,
    ListValue,
    PoseValue,
    RotationValue,
    TextColumn,
    Value,
)


class Identities:
    """Gives equal values equal keys. Subexpressions are numbered as they are met, so that shared ones cost once."""

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}

    def key(self, value: Value) -> Hashable:
        """A key that two values share if and only if they are the same value.

        Functions and shapes are the same only if they are one object; their keys hold while they live.
        """
        if isinstance(value, SCALARS):
            return self._expression(value)
        match value:
            case Array():
                return ("array", value.shape, tuple(self._expression(e) for e in value.elements))
            case ListValue():
                return ("list", tuple(self.key(item) for item in value.items))
            case RotationValue():
                return ("rotation", self.key(value.matrix))
            case PoseValue():
                scale = None if value.scale is None else self._expression(value.scale)
                translation = tuple(self._expression(e) for e in value.translation)
                return ("pose", self.key(value.rotation), translation, scale)
            case TextColumn():
                return ("texts", value.identity)
            case FamilyValue():
                return ("family", type(value), value.name)
            case CameraValue():
                numbers = (*value.focal, *value.center, *value.distortion)
                return ("camera", value.name, tuple(self._expression(e) for e in numbers), value.axes)
            case bool() | str():
                return (type(value), value)
        return ("form", value) if isinstance(value, FORMS) else ("object", id(value))

    def _expression(self, root: Expression) -> int:
        numbers: dict[int, int] = {}
        for node in postorder((root,)):
            key: Hashable
            if isinstance(node, Apply):
                key = (node.operation, tuple(numbers[id(a)] for a in node.arguments))
            else:
                key = _leaf(node)
            numbers[id(node)] = self._numbers.setdefault(key, len(self._numbers))
        return numbers[id(root)]


def _leaf(node: Leaf) -> Hashable:
    match node:
        case Number():
            return ("number", type(node.value), node.value, node.dimension, node.angle)
        case Constant():
            return ("constant", node.name, node.value)
        case Column():
            return ("column", node.identity)
        case Component():
            return ("unknown", node.identity)
        case Opaque():
            return ("opaque", node.form)
