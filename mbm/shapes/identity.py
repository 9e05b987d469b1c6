"""When two calls of a model have the same arguments: values compared by what they are, not by where they were made."""

from __future__ import annotations

from collections.abc import Hashable

from mbm.expression.nodes import Apply, Column, Component, Constant, Expression, Leaf, Number, Opaque
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
        self._known: dict[int, tuple[int, Expression]] = {}
        """The number of each node by its address, which it keeps as long as it is held here."""

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
        known = self._known
        waiting = [root]
        while waiting:
            node = waiting[-1]
            arguments = node.arguments if isinstance(node, Apply) else ()
            missing = [a for a in arguments if id(a) not in known]
            if missing and id(node) not in known:
                waiting += missing
                continue
            waiting.pop()
            if id(node) not in known:
                own = tuple(known[id(a)][0] for a in arguments)
                key = (node.operation, own) if isinstance(node, Apply) else _leaf(node)
                known[id(node)] = (self._numbers.setdefault(key, len(self._numbers)), node)
        return known[id(root)][0]


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
