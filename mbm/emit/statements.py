"""Straight-line programs as statements: names for what occurs more than once, expressions for the rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from mbm.emit.foreign import Foreign
from mbm.emit.identifiers import Identifiers
from mbm.machine.program import Operator, Program
from mbm.machine.tree import ATOM
from mbm.values import dataclass

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
