"""How much of a problem is compiled: equations one by one, and the operations in them, are bounded.

The rows of a table share one equation, however many they are: what is counted here is written out in the problem, by
hand, by ``for`` and ``sum``, or by rows that need equations of their own.
"""

from __future__ import annotations

from mbm.expression.nodes import CONDITIONS, Apply, Expression, Operation, postorder
from mbm.language.limits import Limits
from mbm.problem import faults
from mbm.problem.types import Block, Derived, Equation
from mbm.text.types import MbmError, Span

EQUATION, CHOICE = 20, 3
"""Operations that an equation counts for by itself, and a condition or a choice by one: so much longer they take."""

_CHOICES = CONDITIONS | {Operation.IF}


class Extent:
    """Equations and operations so far. Local to one elaboration."""

    def __init__(self, limits: Limits) -> None:
        self._most_equations, self._most_operations = limits.written_out()
        self._equations = 0
        self._operations = 0

    def add(self, made: Block | Derived) -> None:
        """Count what an observation, prior, constraint or derived quantity holds.

        Raises:
            MbmError: too-much-to-compile.

        """
        if isinstance(made, Block):
            cases = [tuple(n for e in case.equations for n in (*e.stated, *_written(e))) for case in made.cases]
        else:
            cases = [case.values for case in made.cases]
        self.more(len(cases), made.span)
        self._operations += EQUATION * len(cases)
        for nodes in cases:
            self._operate(nodes, made.span)

    def more(self, equations: int, span: Span) -> None:
        """Count groups of rows that each have equations of their own.

        Raises:
            MbmError: too-much-to-compile.

        """
        self._equations += equations
        if self._equations > self._most_equations:
            raise MbmError(faults.too_many_equations(span, self._most_equations))

    def _operate(self, nodes: tuple[Expression, ...], span: Span) -> None:
        made = [node.operation for node in postorder(nodes) if isinstance(node, Apply)]
        self._operations += len(made) + (CHOICE - 1) * sum(operation in _CHOICES for operation in made)
        if self._operations > self._most_operations:
            raise MbmError(faults.too_many_operations(span, self._most_operations))


def _written(equation: Equation) -> tuple[Expression, ...]:
    """What mbm writes out for the errors of an equation."""
    return () if equation.likelihood is None else equation.likelihood.residuals
