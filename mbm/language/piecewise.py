"""Formulas that differ from piece to piece, as one formula whose numbers are chosen.

The pieces of a spline are one cubic with other coefficients, whatever moved and projected it. To choose the
coefficients is a choice among numbers; what is made of them is then computed once, not once for each piece.
"""

from __future__ import annotations

from itertools import groupby

from mbm.expression.algebra import ONE, apply, multiply, negate
from mbm.expression.nodes import Apply, Expression, Number, Operation, Parameter
from mbm.expression.substitution import depending
from mbm.text.types import Span

Formulas = tuple[Expression, ...]

LEVELS = 200
"""So deep formulas are compared; below, the whole of each is computed and one chosen."""


def less(a: Expression, b: Expression, span: Span) -> Apply:
    """a < b."""
    return Apply(Operation.LESS, (a, b), span=span)


def both(a: Expression, b: Expression, span: Span) -> Apply:
    """a and b."""
    return Apply(Operation.AND, (a, b), span=span)


def negative(a: Expression, span: Span) -> Apply:
    """a < 0, whatever the dimension."""
    return less(a, Number(0), span)


def positive(a: Expression, span: Span) -> Apply:
    """0 < a, whatever the dimension."""
    return less(Number(0), a, span)


def equal(a: Expression, b: Expression, span: Span) -> Apply:
    """a = b."""
    return Apply(Operation.EQUAL, (a, b), span=span)


def opposite(a: Expression, span: Span) -> Apply:
    """Not a."""
    return Apply(Operation.NOT, (a,), span=span)


def either(a: Expression, b: Expression, span: Span) -> Apply:
    """a or b."""
    return Apply(Operation.OR, (a, b), span=span)


def defined(test: Expression, value: Expression, span: Span) -> Expression:
    """``value`` where the test holds; elsewhere the root of a negative number, which is NaN."""
    sign = chosen(test, ONE, negate(ONE, span), span)
    return multiply(apply(Operation.SQRT, sign, span=span), value, span)


def chosen(test: Expression, then: Expression, other: Expression, span: Span) -> Expression:
    """``then`` where the test holds, else ``other``."""
    return then if _same(then, other) else apply(Operation.IF, test, then, other, span=span)


def merged(pieces: tuple[Formulas, ...], before: tuple[Expression, ...], parameter: Parameter, span: Span) -> Formulas:
    """The formulas of the first of ``pieces`` whose test in ``before`` holds, of the last one where none does."""
    every = tuple(formula for piece in pieces for formula in piece)
    merger = _Merger({id(node) for node in depending(every, frozenset((parameter,)))}, parameter, span)
    return tuple(merger.merge(column, before) for column in zip(*pieces, strict=True))


class _Merger:
    """Goes down as long as formulas that hold the parameter do the same; local to one merging."""

    def __init__(self, depending_on_parameter: set[int], parameter: Parameter, span: Span) -> None:
        self._depending = depending_on_parameter
        self._parameter = parameter
        self._span = span
        self._memo: dict[tuple[tuple[int, ...], tuple[int, ...]], Expression] = {}

    def merge(self, nodes: Formulas, before: Formulas, level: int = 0) -> Expression:
        """One formula of those of several pieces in a row; ``before`` has one test less."""
        if all(_same(nodes[0], node) for node in nodes[1:]):
            return nodes[0]
        key = (tuple(map(id, nodes)), tuple(map(id, before)))
        if key not in self._memo:
            self._memo[key] = self._merged(nodes, before, level)
        return self._memo[key]

    def _merged(self, nodes: Formulas, before: Formulas, level: int) -> Expression:
        runs = [list(run) for _, run in groupby(range(len(nodes)), key=lambda i: self._kind(nodes[i]))]
        whole = [self._alike(nodes[r[0] : r[-1] + 1], before[r[0] : r[-1]], level) for r in runs]
        found = whole[-1]
        for run, formula in zip(reversed(runs[:-1]), reversed(whole[:-1]), strict=True):
            found = chosen(before[run[-1]], formula, found, self._span)
        return found

    def _kind(self, node: Expression) -> object:
        if node is self._parameter:
            return self._parameter.name
        if id(node) not in self._depending or not isinstance(node, Apply):
            return None
        return (node.operation, len(node.arguments), node.output)

    def _alike(self, nodes: Formulas, before: Formulas, level: int) -> Expression:
        """One formula of several of one kind."""
        first = nodes[0]
        if len(nodes) > 1 and level < LEVELS and isinstance(first, Apply) and id(first) in self._depending:
            columns = zip(*(node.arguments for node in nodes if isinstance(node, Apply)), strict=True)
            arguments = tuple(self.merge(column, before, level + 1) for column in columns)
            if first.output is not None:
                return Apply(first.operation, arguments, first.angle, first.span, first.output)
            return apply(first.operation, *arguments, span=first.span)
        found = nodes[-1]
        for node, test in zip(reversed(nodes[:-1]), reversed(before), strict=True):
            found = chosen(test, node, found, self._span)
        return found


def _same(a: Expression, b: Expression) -> bool:
    """Whether two nodes are one, or the same number."""
    if isinstance(a, Number) and isinstance(b, Number):
        return (a.value, a.dimension, a.angle) == (b.value, b.dimension, b.angle)
    return a is b
