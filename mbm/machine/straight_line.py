"""Straight-line programs as LLVM functions: of scalars, one row, once; and over blocks of rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

from mbm.machine import sine_and_cosine
from mbm.machine.kinds import LANES
from mbm.machine.program import Instruction, Operator, Program
from mbm.machine.vector_text import VECTOR, Text, VectorLibrary, scalar
from mbm.machine.vectors import (
    BINARY,
    COMPARISONS,
    INTRINSICS,
    LOGICAL,
    ROUND,
    SCALAR,
    VECTORISED,
    angles_of,
    outputs_of,
)

ONE, MINUS_ONE, NOTHING = scalar(1.0), scalar(-1.0), scalar(0.0)


def function(name: str, program: Program, numbers: int, lines: int, text: Text) -> None:
    """Append ``void name(const double *point, const double *data, double *target, int64 stride)`` to a module.

    The first ``numbers`` inputs are those of the point, the others the data. Outputs come in columns of ``lines``,
    which begin ``stride`` apart in the target.
    """
    arrays = "ptr noalias readonly %point, ptr noalias readonly %data, ptr noalias %target"
    text.lines += [f"define void @{name}({arrays}, i64 %stride) nounwind {{", "entry:"]
    values = _Values(program, text)
    for position, value in enumerate(program.inputs):
        if value >= 0:
            array, at = ("%point", position) if position < numbers else ("%data", position - numbers)
            where = text.new(f"getelementptr inbounds double, ptr {array}, i64 {at}")
            values.reals[value] = text.new(f"load double, ptr {where}, align 8")
    for level in _levels(program):
        values.compute(level)
    for column in range(len(program.outputs) // lines):
        begin = text.new(f"mul i64 %stride, {column}")
        own = text.new(f"getelementptr inbounds double, ptr %target, i64 {begin}")
        for line, value in enumerate(program.outputs[column * lines : (column + 1) * lines]):
            where = text.new(f"getelementptr inbounds double, ptr {own}, i64 {line}")
            text.do(f"store double {NOTHING if value < 0 else values.real(value)}, ptr {where}, align 8")
    text.do("ret void")
    text.lines.append("}")


def _levels(program: Program) -> Iterator[list[Instruction]]:
    """The instructions in such an order that elementary functions follow one another: a list of them, or of others."""
    level = [0] * program.values
    keys = []
    for each in program.instructions:
        known = max((level[a] for a in each.arguments), default=0)
        elementary = each.operator in VECTORISED
        level[each.target] = known + elementary
        keys.append((known, elementary))
    order = sorted(range(len(keys)), key=keys.__getitem__)
    for _, which in groupby(order, key=keys.__getitem__):
        yield [program.instructions[k] for k in which]


class _Values:
    """The values of a program by number, as reals and as conditions; local to one call."""

    def __init__(self, program: Program, text: Text) -> None:
        self._text = text
        self.reals = {value: scalar(constant) for value, constant in program.constants}
        self._tests: dict[int, str] = {}
        self._angles = angles_of(program) if text.library is not None and text.library.fused else frozenset()

    def real(self, value: int) -> str:
        """A value as a real."""
        if value not in self.reals:
            self.reals[value] = self._text.new(f"uitofp i1 {self._tests[value]} to double")
        return self.reals[value]

    def _test(self, value: int) -> str:
        """A value as a condition: whether it is not zero; NaN is not."""
        if value not in self._tests:
            self._tests[value] = self._text.new(f"fcmp une double {self.reals[value]}, {NOTHING}")
        return self._tests[value]

    def compute(self, instructions: Sequence[Instruction]) -> None:
        """Append instructions; if they are elementary functions, none waits for another."""
        if instructions[0].operator not in VECTORISED:
            for each in instructions:
                self._compute(each)
            return
        together: dict[Operator, list[Instruction]] = {}
        round_trip: dict[int, dict[Operator, int]] = {}
        for each in instructions:
            if each.operator in ROUND and each.arguments[0] in self._angles:
                round_trip.setdefault(each.arguments[0], {})[each.operator] = each.target
            else:
                together.setdefault(each.operator, []).append(each)
        for operator, of_one in together.items():
            self._by_library(operator, of_one)
        waiting = list(round_trip.items())
        for first in range(0, len(waiting), LANES):
            some = waiting[first : first + LANES]
            both = sine_and_cosine.call(self._text, self._packed([angle for angle, _ in some]))
            for lane, (_, targets) in enumerate(some):
                for operator, vector in zip(ROUND, both, strict=True):
                    if operator in targets:
                        self.reals[targets[operator]] = self._lane(vector, lane)

    def _by_library(self, operator: Operator, calls: Sequence[Instruction]) -> None:
        """One elementary function, of several arguments at a time where the vector library has it."""
        text = self._text
        if text.library is None or operator.value not in text.library.functions:
            for each in calls:
                arguments = [self.real(a) for a in each.arguments]
                self.reals[each.target] = text.call(operator.value, "double", arguments)
            return
        for first in range(0, len(calls), LANES):
            some = calls[first : first + LANES]
            vectors = [self._packed(values) for values in zip(*(each.arguments for each in some), strict=True)]
            found = text.by_library(operator.value, vectors)
            for lane, each in enumerate(some):
                self.reals[each.target] = self._lane(found, lane)

    def _packed(self, values: Sequence[int]) -> str:
        """Up to `LANES` values in a vector; the first fills what is left."""
        vector = "undef"
        for lane in range(LANES):
            own = self.real(values[lane] if lane < len(values) else values[0])
            vector = self._text.new(f"insertelement {VECTOR} {vector}, double {own}, i32 {lane}")
        return vector

    def _lane(self, vector: str, lane: int) -> str:
        return self._text.new(f"extractelement {VECTOR} {vector}, i32 {lane}")

    def _compute(self, instruction: Instruction) -> None:
        operator, text = instruction.operator, self._text
        test = self._as_test(instruction)
        if test is not None:
            self._tests[instruction.target] = test
            return
        if operator is Operator.SELECT:
            chosen, value = instruction.arguments
            parts = f"i1 {self._test(chosen)}, double {self.real(value)}, double {NOTHING}"
            self.reals[instruction.target] = text.new(f"select {parts}")
            return
        arguments = [self.real(a) for a in instruction.arguments]
        a = arguments[0]
        if operator in BINARY:
            found = text.new(f"{BINARY[operator]} double {a}, {arguments[1]}")
        elif operator in INTRINSICS:
            found = text.call(f"llvm.{INTRINSICS[operator]}.f64", "double", arguments)
        elif operator in SCALAR:
            found = text.call(operator.value, "double", arguments)
        elif operator is Operator.SIGN:
            found = self._sign(a)
        else:
            found = text.new(_SHORT[operator].format(a=a))
        self.reals[instruction.target] = found

    def _sign(self, a: str) -> str:
        """−1, 1, or the argument itself: zeros keep their sign, NaN stays."""
        text = self._text
        above = text.new(f"fcmp ogt double {a}, {NOTHING}")
        positive = text.new(f"select i1 {above}, double {ONE}, double {a}")
        below = text.new(f"fcmp olt double {a}, {NOTHING}")
        return text.new(f"select i1 {below}, double {MINUS_ONE}, double {positive}")

    def _as_test(self, instruction: Instruction) -> str | None:
        operator, text = instruction.operator, self._text
        if operator in COMPARISONS:
            left, right = (self.real(a) for a in instruction.arguments)
            return text.new(f"fcmp {COMPARISONS[operator]} double {left}, {right}")
        if operator is Operator.NOT:
            return text.new(f"xor i1 {self._test(instruction.arguments[0])}, true")
        if operator in LOGICAL:
            left, right = (self._test(a) for a in instruction.arguments)
            return text.new(f"{LOGICAL[operator]} i1 {left}, {right}")
        return None


_SHORT = {
    Operator.NEG: "fneg double {a}",
    Operator.SQUARE: "fmul double {a}, {a}",
    Operator.TWICE: "fadd double {a}, {a}",
    Operator.RECIPROCAL: f"fdiv double {ONE}, {{a}}",
}


ALIGNMENT = 8
"""Bytes: arrays are those of NumPy, wherever they begin."""


def module_of(programs: Mapping[str, Program], library: VectorLibrary | None) -> str:
    """A module with a function for each program, ``void name(const double *inputs, double *outputs, int64 blocks)``.

    Args:
        programs: by the names of their functions.
        library: the vector library to call, if any.
    """
    text = Text(library)
    for name, program in programs.items():
        _function(name, program, text)
    return text.module()


def _function(name: str, program: Program, text: Text) -> None:
    arrays = "ptr noalias readonly %inputs, ptr noalias %outputs"
    text.lines.append(f"define void @{name}({arrays}, i64 %blocks) nounwind {{")
    open_loop(text)
    source = place(text, "%inputs", f"mul i64 %block, {len(program.inputs) * LANES}")
    target = place(text, "%outputs", f"mul i64 %block, {len(program.outputs) * LANES}")
    inputs = [load(text, source, position) if value >= 0 else "undef" for position, value in enumerate(program.inputs)]
    for position, value in enumerate(outputs_of(program, inputs, text)):
        store(text, value, target, position)
    close_loop(text)
    close_function(text)


def open_loop(text: Text) -> None:
    """Go over the blocks ``%block`` from 0 to ``%blocks``; the function may have begun with a block called entry."""
    text.lines += [
        "  br label %start",
        "start:",
        "  %some = icmp sgt i64 %blocks, 0",
        "  br i1 %some, label %each, label %done",
        "each:",
        "  %block = phi i64 [ 0, %start ], [ %onward, %each ]",
    ]


def close_loop(text: Text) -> None:
    """Onward in the loop that `open_loop` began; what follows is done after it."""
    text.lines += [
        "  %onward = add nuw nsw i64 %block, 1",
        "  %more = icmp slt i64 %onward, %blocks",
        "  br i1 %more, label %each, label %done",
        "done:",
    ]


def close_function(text: Text) -> None:
    """Return nothing."""
    text.do("ret void")
    text.lines.append("}")


def place(text: Text, array: str, index: str) -> str:
    """The element of an array of reals whose number is computed by the instruction ``index``."""
    return text.new(f"getelementptr inbounds double, ptr {array}, i64 {text.new(index)}")


def load(text: Text, source: str, position: int) -> str:
    """The vector at a position counted in vectors."""
    where = text.new(f"getelementptr inbounds double, ptr {source}, i64 {position * LANES}")
    return text.new(f"load {VECTOR}, ptr {where}, align {ALIGNMENT}")


def store(text: Text, value: str, target: str, position: int) -> None:
    """Store a vector at a position counted in vectors."""
    where = text.new(f"getelementptr inbounds double, ptr {target}, i64 {position * LANES}")
    text.do(f"store {VECTOR} {value}, ptr {where}, align {ALIGNMENT}")
