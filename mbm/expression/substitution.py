"""Expressions with other expressions in the place of leaves."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.expression.algebra import apply
from mbm.expression.nodes import Apply, Expression, Leaf, postorder
from mbm.values import dataclass


def substituted(roots: tuple[Expression, ...], values: Mapping[Leaf, Expression]) -> tuple[Expression, ...]:
    """``roots`` with ``values`` in the place of their keys; what holds no key stays the same node.

    Raises:
        UndefinedValueError: constants that now meet lie outside an operation's domain.

    """
    return _rebuilt(roots, depending(roots, frozenset(values)), values)


@dataclass(frozen=True, slots=True, eq=False)
class Formula:
    """Expressions in one ``leaf``, to be had at many values of it; ``steps`` are the operations that depend on it."""

    roots: tuple[Expression, ...]
    leaf: Leaf
    steps: tuple[Apply, ...]

    @classmethod
    def of(cls, roots: tuple[Expression, ...], leaf: Leaf) -> Formula:
        """The formula of ``roots``."""
        return cls(roots, leaf, depending(roots, frozenset((leaf,))))

    def at(self, value: Expression) -> tuple[Expression, ...]:
        """The roots where the leaf is ``value``.

        Raises:
            UndefinedValueError: constants that now meet lie outside an operation's domain.

        """
        return _rebuilt(self.roots, self.steps, {self.leaf: value})


def depending(roots: tuple[Expression, ...], leaves: frozenset[Leaf]) -> tuple[Apply, ...]:
    """The operations below ``roots`` that depend on one of ``leaves``, arguments first."""
    found = {id(leaf) for leaf in leaves}
    steps = []
    for node in postorder(roots):
        if isinstance(node, Apply) and any(id(a) in found for a in node.arguments):
            found.add(id(node))
            steps.append(node)
    return tuple(steps)


def _rebuilt(
    roots: tuple[Expression, ...], steps: tuple[Apply, ...], values: Mapping[Leaf, Expression]
) -> tuple[Expression, ...]:
    found: dict[int, Expression] = {id(leaf): value for leaf, value in values.items()}
    for node in steps:
        arguments = tuple(found.get(id(a), a) for a in node.arguments)
        found[id(node)] = (
            apply(node.operation, *arguments, span=node.span)
            if node.output is None
            else Apply(node.operation, arguments, node.angle, node.span, node.output)
        )
    return tuple(found.get(id(root), root) for root in roots)
