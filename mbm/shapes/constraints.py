"""The constraints that the models of a shape bring along."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.shapes.types import Group, ModelCall, Moved, Node, Part, Shape


def calls_with_constraints(shapes: Iterable[Shape]) -> tuple[ModelCall, ...]:
    """The model calls in ``shapes`` that have constraints, each distinct model-with-arguments once, outermost first.

    Equal arguments give one and the same ``ModelCall`` (see ``Model``), so that identity of objects decides.
    """
    found: dict[int, ModelCall] = {}
    seen: set[int] = set()
    stack: list[Node] = [shape.content for shape in shapes][::-1]
    while stack:
        node = stack.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, ModelCall) and node.constraints:
            found[id(node)] = node
        if isinstance(node, Moved | Part | Group | ModelCall):
            stack.extend(reversed(node.children))
    return tuple(found.values())
