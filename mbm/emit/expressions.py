"""Expressions of data → straight-line programs: noise, filters, starts and bounds, computed where the solver runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field
from math import pi

from mbm.emit.types import InputValue
from mbm.expression.nodes import Apply, Expression, Leaf, Number, Opaque, Operation, Parameter, postorder
from mbm.machine.program import Instruction, Operator, Program
from mbm.values import dataclass

PlaceOf = Callable[[Leaf], InputValue]
"""Where the number of a column or constant stands."""


def program_of(roots: tuple[Expression, ...], place_of: PlaceOf) -> tuple[tuple[InputValue, ...], Program]:
    """The inputs and the program of expressions without unknowns.

    Cells that are missing are the caller's to refuse: the conditions here are two-valued.
    """
    build = _Builder()
    values: dict[int, int] = {}
    for node in postorder(roots):
        if isinstance(node, Number):
            values[id(node)] = build.constant(float(node.value))
        elif isinstance(node, Apply):
            values[id(node)] = build.applied(node.operation, [values[id(a)] for a in node.arguments])
        elif isinstance(node, Opaque | Parameter):
            raise TypeError(node)
        else:
            values[id(node)] = build.input(place_of(node))
    return tuple(build.inputs), Program(
        values=build.count,
        inputs=tuple(build.inputs.values()),
        constants=tuple((value, number) for number, value in build.constants.items()),
        instructions=tuple(build.instructions),
        outputs=tuple(values[id(root)] for root in roots),
    )


@dataclass(slots=True)
class _Builder:
    """A program under construction; local to one call."""

    count: int = 0
    inputs: dict[InputValue, int] = field(default_factory=dict)
    constants: dict[float, int] = field(default_factory=dict)
    instructions: list[Instruction] = field(default_factory=list)

    def _next(self) -> int:
        self.count += 1
        return self.count - 1

    def constant(self, number: float) -> int:
        if number not in self.constants:
            self.constants[number] = self._next()
        return self.constants[number]

    def input(self, place: InputValue) -> int:
        if place not in self.inputs:
            self.inputs[place] = self._next()
        return self.inputs[place]

    def apply(self, operator: Operator, *arguments: int) -> int:
        target = self._next()
        self.instructions.append(Instruction(target, operator, arguments))
        return target

    def applied(self, operation: Operation, given: list[int]) -> int:
        """An operation of the language; those without an operator of their own are made of others."""
        if operation in (Operation.AS_ANGLE, Operation.HELD):
            return given[0]
        if operation is Operation.WRAP:
            turn, half = self.constant(2 * pi), self.constant(0.5)
            turns = self.apply(Operator.CEIL, self.apply(Operator.SUB, self.apply(Operator.DIV, given[0], turn), half))
            return self.apply(Operator.SUB, given[0], self.apply(Operator.MUL, turn, turns))
        if operation is Operation.IF:
            test, then, other = given
            chosen = self.apply(Operator.SELECT, test, then)
            left = self.apply(Operator.SELECT, self.apply(Operator.NOT, test), other)
            return self.apply(Operator.ADD, chosen, left)
        if operation is Operation.FINITE:
            difference = self.apply(Operator.SUB, given[0], given[0])
            return self.apply(Operator.EQUAL, difference, self.constant(0.0))
        if operation.operator is None:
            raise TypeError(operation)
        return self.apply(operation.operator, *given)
