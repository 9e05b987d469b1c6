"""LLVM IR on vectors of `LANES` rows as it is written: values, calls, and what a module has to declare for them."""

from __future__ import annotations

import struct
from dataclasses import field

from mbm.machine.kinds import LANES
from mbm.values import dataclass

VECTOR = f"<{LANES} x double>"
MASK = f"<{LANES} x i1>"


@dataclass(frozen=True, slots=True, kw_only=True)
class VectorLibrary:
    """A vector library: functions on ``width`` doubles are called ``prefix``, ``v`` for each argument, ``_``, name.

    ``functions`` are the names that it has: those of glibc before 2.35 are few. ``fused``: the processor has fused
    products and sums, so that mbm's own functions are exact enough.
    """

    prefix: str
    width: int
    functions: frozenset[str]
    fused: bool = False

    def name(self, function: str, arguments: int) -> str:
        """The symbol of a function."""
        return f"{self.prefix}{'v' * arguments}_{function}"


def scalar(value: float) -> str:
    """A double, to the last bit."""
    return f"0x{int.from_bytes(struct.pack('>d', value), 'big'):016X}"


def number(value: float) -> str:
    """A vector of equal doubles."""
    return f"<{', '.join([f'double {scalar(value)}'] * LANES)}>"


ZERO, ONE, MINUS_ONE = number(0.0), number(1.0), number(-1.0)


@dataclass(slots=True, eq=False)
class Text:
    """IR being written: the lines of the function at hand, and what the module has to declare and define for it.

    ``helpers`` are the lines of functions that other functions call, by name.
    """

    library: VectorLibrary | None
    lines: list[str] = field(default_factory=list)
    declared: dict[str, str] = field(default_factory=dict)
    helpers: dict[str, list[str]] = field(default_factory=dict)
    _count: int = 0

    def new(self, instruction: str) -> str:
        """Append an instruction that gives a value; its name."""
        self._count += 1
        name = f"%t{self._count}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def do(self, instruction: str) -> None:
        """Append an instruction that gives nothing."""
        self.lines.append(f"  {instruction}")

    def module(self) -> str:
        """All that was written."""
        helpers = (line for lines in self.helpers.values() for line in lines)
        return "\n".join((*self.declared.values(), *helpers, *self.lines)) + "\n"

    def intrinsic(self, name: str, arguments: list[str]) -> str:
        """A call of a vector intrinsic of LLVM."""
        return self.call(f"llvm.{name}.v{LANES}f64", VECTOR, arguments)

    def call(self, symbol: str, kind: str, arguments: list[str]) -> str:
        """A call of a function of arguments and a result that all have the type ``kind``."""
        self.declared.setdefault(symbol, f"declare {kind} @{symbol}({', '.join([kind] * len(arguments))}) nounwind")
        return self.new(f"call {kind} @{symbol}({', '.join(f'{kind} {a}' for a in arguments)})")

    def by_library(self, name: str, arguments: list[str]) -> str:
        """An elementary function, by the vector library or else by the C library."""
        if self.library is None or name not in self.library.functions:
            return self.by_lane(name, arguments)
        symbol = self.library.name(name, len(arguments))
        if self.library.width == LANES:
            return self.call(symbol, VECTOR, arguments)
        half = f"<{LANES // 2} x double>"
        halves = []
        for mask in ("<i32 0, i32 1>", "<i32 2, i32 3>"):
            parts = [self.new(f"shufflevector {VECTOR} {a}, {VECTOR} {a}, <2 x i32> {mask}") for a in arguments]
            halves.append(self.call(symbol, half, parts))
        both = "<i32 0, i32 1, i32 2, i32 3>"
        return self.new(f"shufflevector {half} {halves[0]}, {half} {halves[1]}, <4 x i32> {both}")

    def by_lane(self, name: str, arguments: list[str]) -> str:
        """A function of the C library, called for each lane."""
        result = "undef"
        for lane in range(LANES):
            scalars = [self.new(f"extractelement {VECTOR} {a}, i32 {lane}") for a in arguments]
            found = self.call(name, "double", scalars)
            result = self.new(f"insertelement {VECTOR} {result}, double {found}, i32 {lane}")
        return result
