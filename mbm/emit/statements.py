"""Straight-line programs as statements: names for what occurs more than once, expressions for the rest. Expressions of
data → straight-line programs: noise, filters, starts and bounds, computed where the solver runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from math import pi

from mbm.emit.foreign import Foreign
from mbm.emit.identifiers import Identifiers
from mbm.emit.types import InputValue
from mbm.expression.nodes import Apply, Expression, Leaf, Number, Opaque, Operation, Parameter, postorder
from mbm.machine.program import Instruction, Operator, Program
from mbm.machine.tree import ATOM
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


LONGEST = 90
"""Characters of an expression that is written into another: longer ones get a name."""


@dataclass(frozen=True, slots=True)
class Shape:
    """How an operation is written: a template, its precedence, and the precedence wanted of each argument."""

    template: str
    precedence: int = ATOM
    wanted: tuple[int, ...] = ()


def called(name: str, operator: Operator) -> Shape:
    """An operation that is written as a call."""
    return Shape(f"{name}({', '.join(['{0}', '{1}'][: operator.arguments])})")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """A language: how operations and numbers are written."""

    shapes: Mapping[Operator, Shape]
    number: Callable[[float], str]
    reserved: frozenset[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Statements:
    """``inputs`` are the names of those in use with their numbers; then ``assignments``; then one text per output."""

    inputs: tuple[tuple[str, int], ...]
    assignments: tuple[tuple[str, str], ...]
    outputs: tuple[str, ...]


def statements(program: Program, names: Sequence[Foreign], dialect: Dialect) -> Statements:
    """The text of a program whose inputs are called ``names``."""
    taken = Identifiers()
    uses = [0] * program.values
    for instruction in program.instructions:
        for argument in instruction.arguments:
            uses[argument] += 1
    for output in program.outputs:
        if output >= 0:
            uses[output] += 1
    written: dict[int, tuple[str, int]] = {}
    for value, number in program.constants:
        text = dialect.number(number)
        written[value] = (text, 8 if text.startswith("-") else ATOM)
    inputs = []
    for position, value in enumerate(program.inputs):
        if value >= 0 and uses[value]:
            name = taken.made(names[position], words=dialect.reserved)
            inputs.append((name, position))
            written[value] = (name, ATOM)
    assignments: list[tuple[str, str]] = []
    for instruction in program.instructions:
        if not uses[instruction.target]:
            continue
        shape = dialect.shapes[instruction.operator]
        arguments = [_inside(written[a], shape, i) for i, a in enumerate(instruction.arguments)]
        text = shape.template.format(*arguments)
        many = shape.template.count("{0}") > 1
        if uses[instruction.target] > 1 or len(text) > LONGEST or many:
            name = taken.made(f"t{len(assignments) + 1}", words=dialect.reserved)
            assignments.append((name, text))
            written[instruction.target] = (name, ATOM)
        else:
            written[instruction.target] = (text, shape.precedence)
    outputs = tuple(dialect.number(0.0) if o < 0 else written[o][0] for o in program.outputs)
    return Statements(inputs=tuple(inputs), assignments=tuple(assignments), outputs=outputs)


def _inside(written: tuple[str, int], shape: Shape, position: int) -> str:
    text, precedence = written
    wanted = shape.wanted[position] if position < len(shape.wanted) else 0
    return f"({text})" if precedence < wanted else text


ARITHMETIC: Mapping[Operator, Shape] = {
    Operator.ADD: Shape("{0} + {1}", 5, (5, 6)),
    Operator.SUB: Shape("{0} - {1}", 5, (5, 6)),
    Operator.MUL: Shape("{0} * {1}", 6, (6, 7)),
    Operator.DIV: Shape("{0} / {1}", 6, (6, 7)),
    Operator.NEG: Shape("-{0}", 8, (9,)),
    Operator.TWICE: Shape("2.0 * {0}", 6, (7,)),
    Operator.RECIPROCAL: Shape("1.0 / {0}", 6, (7,)),
}
"""What is written alike in C and in Python."""
