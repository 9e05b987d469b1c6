"""Temperatures on a scale with a zero of its own (degC, degF), and differences of temperatures.

An expression is kept in kelvin, but only one that a shift of the zero moves once is a temperature, and only one that it
does not move is a difference. The *weight* of an expression is how often the shift moves it: 1 for ``20degC`` and for
what is stated in degC, 0 for the difference of two of these, 2 for their sum, 1 for their mean. What is stated in
kelvin may be either. So a standard deviation of ``0.1degC``, which is 273.25 K, is found before anything is solved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from typing import TypeAlias, TypeGuard

from mbm.expression.algebra import UndefinedValueError, constant_value
from mbm.expression.nodes import (
    Apply,
    Column,
    Component,
    Constant,
    Expression,
    Leaf,
    Number,
    Operation,
    leaves,
    postorder,
)
from mbm.expression.units import Dimension, base

Weights: TypeAlias = frozenset[float] | None
"""The weights that an expression may have; None: any."""

TEMPERATURE, DIFFERENCE = 1.0, 0.0
"""The weight of a temperature, and that of a difference."""

_EITHER = frozenset({DIFFERENCE, TEMPERATURE})
_MOST = 64
"""Weights that are looked at: a longer sum of what is stated in kelvin may have any."""
_DECIMALS = 9
"""Weights of means are sums of rounded parts."""
KELVIN = base("K")
"""The dimension of temperatures and of their differences."""
_OF_NOISE = (KELVIN, KELVIN**2, KELVIN**-2, KELVIN**-1)
"""Dimensions of standard deviations, variances and informations."""
_CHOSEN = (Operation.IF, Operation.MINIMUM, Operation.MAXIMUM)
_ADDING = (Operation.ADD, Operation.SUBTRACT)
_KEPT = (Operation.ABS, Operation.FLOOR, Operation.HELD)


class ZeroPoints:
    """The weights of expressions. ``absolute`` says of a leaf that it is stated on a scale with a zero of its own.

    ``dimension`` gives the dimension of an expression, where it is known, ``known`` the weights of unknowns and
    aggregates by their names.
    """

    def __init__(
        self,
        absolute: Callable[[Leaf], bool],
        dimension: Callable[[Expression], Dimension | None],
        known: Mapping[str, Weights] | None = None,
    ) -> None:
        self._absolute, self._dimension = absolute, dimension
        self._named = {} if known is None else known
        self._known: dict[int, Weights] = {}
        self._alive: list[Expression] = []

    def weights(self, node: Expression) -> Weights:
        """The weights that ``node`` may have."""
        for each in postorder((node,)):
            if id(each) not in self._known:
                self._known[id(each)] = self._of(each)
                self._alive.append(each)  # ids stay unique only while the nodes live
        return self._known[id(node)]

    def may_be(self, node: Expression, weight: float) -> bool:
        """Whether ``node`` may have the weight."""
        found = self.weights(node)
        return found is None or weight in found

    def misplaced(self, node: Expression) -> Expression | None:
        """A part of some noise that should be a difference and is none: itself, or what a variance is the square of."""
        stack = [node]
        while stack:
            each = stack.pop()
            if not self.may_be(each, DIFFERENCE):
                return each
            if isinstance(each, Apply) and self._dimension(each) in _OF_NOISE[1:]:
                stack.extend(part for part in each.arguments if self._dimension(part) in _OF_NOISE)
        return None

    def mixed(self, node: Expression) -> Expression | None:
        """A part of ``node`` that compares a temperature with a difference, or uses a sum with ``5degC`` in it."""
        for each in postorder((node,)):
            if not isinstance(each, Apply):
                continue
            if each.operation in (Operation.LESS, Operation.LESS_EQUAL, Operation.EQUAL, *_CHOSEN):
                left, right = (self.weights(side) for side in each.arguments[-2:])
                if left is not None and right is not None and not left & right:
                    return each
            elif self.weights(each) is None:
                for part in each.arguments:
                    found = self.weights(part)
                    if found is not None and not found & _EITHER and self._adds_literal(part):
                        return part
        return None

    def plain(self, node: Expression) -> Iterator[Expression]:
        """Numbers without a unit that ``node`` adds to temperatures in degC, or subtracts from them."""
        for each in postorder((node,)):
            if isinstance(each, Apply) and each.operation in _ADDING:
                left, right = each.arguments
                for number, beside in ((right, left), (left, right)):
                    if self._is_plain(number) and not self.may_be(beside, DIFFERENCE):
                        yield number

    def _is_plain(self, node: Expression) -> bool:
        return self.weights(node) == frozenset({DIFFERENCE}) and all(map(without_unit, leaves((node,))))

    def _adds_literal(self, node: Expression) -> bool:
        """Whether a temperature that was written as a number is added to something."""
        return any(
            isinstance(each, Apply)
            and each.operation in _ADDING
            and any(isinstance(part, Number) and part.absolute for part in each.arguments)
            for each in postorder((node,))
        )

    def _of(self, node: Expression) -> Weights:
        if not isinstance(node, Apply):
            return self._of_leaf(node)
        parts = [self._known[id(each)] for each in node.arguments]
        if node.operation in _ADDING:
            return _sum(parts[0], parts[1], 1.0 if node.operation is Operation.ADD else -1.0)
        if node.operation is Operation.NEGATE:
            return _scaled(parts[0], -1.0)
        if node.operation in _KEPT:
            return parts[0]
        if node.operation in _CHOSEN:
            left, right = parts[-2:]
            return None if left is None or right is None else (left & right) or (left | right)
        if node.operation in (Operation.MULTIPLY, Operation.DIVIDE) and self._dimension(node) == KELVIN:
            return self._product(node, parts)
        return None

    def _of_leaf(self, node: Leaf) -> Weights:
        if self._absolute(node):
            return frozenset({TEMPERATURE})
        if isinstance(node, Component) and node.unknown in self._named:
            return self._named[node.unknown]
        if without_unit(node):
            return frozenset({DIFFERENCE})  # nobody means 20 K by a plain 20 beside 20degC
        return _EITHER if isinstance(node, Number | Constant | Column | Component) else None

    def _product(self, node: Apply, parts: list[Weights]) -> Weights:
        """A temperature or a difference times a pure number, or by one."""
        left, right = node.arguments
        if self._dimension(left) == KELVIN:
            factor = _static(right)
            if factor is None or (factor == 0 and node.operation is Operation.DIVIDE):
                return parts[0] if parts[0] == frozenset({DIFFERENCE}) else None
            return _scaled(parts[0], float(factor) if node.operation is Operation.MULTIPLY else 1.0 / float(factor))
        if self._dimension(right) == KELVIN and node.operation is Operation.MULTIPLY:
            factor = _static(left)
            return _scaled(parts[1], float(factor)) if factor is not None else None
        return None


def without_unit(leaf: Leaf) -> TypeGuard[Number | Constant]:
    """Whether ``leaf`` is a number or constant that states no unit; 0 needs none."""
    return isinstance(leaf, Number | Constant) and leaf.dimension is None and leaf.value != 0


def _sum(left: Weights, right: Weights, sign: float) -> Weights:
    if left is None or right is None:
        return None
    found = frozenset(round(a + sign * b, _DECIMALS) + 0.0 for a in left for b in right)
    return found if len(found) <= _MOST else None


def _scaled(weights: Weights, factor: float) -> Weights:
    return None if weights is None else frozenset(round(factor * each, _DECIMALS) + 0.0 for each in weights)


def _static(node: Expression) -> int | Fraction | float | None:
    """The value of a number, if it is one."""
    try:
        return constant_value(node)
    except UndefinedValueError:
        return None
