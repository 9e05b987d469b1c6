"""Expressions with other expressions in the place of leaves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mbm.expression.algebra import apply
from mbm.expression.nodes import Apply, Expression, Leaf, postorder


def substituted(roots: tuple[Expression, ...], values: Mapping[Leaf, Expression]) -> tuple[Expression, ...]:
    """``roots`` with ``values`` in the place of their keys; what holds no key stays the same node.

    Raises:
        UndefinedValueError: constants that now meet lie outside an operation's domain.

    """
    found: dict[int, Expression] = {id(leaf): value for leaf, value in values.items()}
    for node in _depending(roots, found):
        arguments = tuple(found.get(id(a), a) for a in node.arguments)
        made = apply(node.operation, *arguments, span=node.span)
        found[id(node)] = made
    return tuple(found.get(id(root), root) for root in roots)


def _depending(roots: tuple[Expression, ...], found: Mapping[int, Expression]) -> Iterator[Apply]:
    """The operations one of whose arguments is, when its turn comes, in ``found``: arguments first."""
    for node in postorder(roots):
        if isinstance(node, Apply) and any(id(a) in found for a in node.arguments):
            yield node
