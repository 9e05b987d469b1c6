"""How C99 writes the operations of straight-line programs."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.emit.c.text import bare
from mbm.emit.reserved import RESERVED
from mbm.emit.statements import ARITHMETIC, Dialect, called
from mbm.machine.c import number
from mbm.machine.program import Operator

HELPERS: Mapping[str, str] = {
    "kernel_sign": "(double a) { return a > 0.0 ? 1.0 : a < 0.0 ? -1.0 : a; }",
    "kernel_square": "(double a) { return a * a; }",
    "kernel_not": "(double a) { return a == 0.0 ? 1.0 : 0.0; }",
    "kernel_less": "(double a, double b) { return a < b ? 1.0 : 0.0; }",
    "kernel_less_equal": "(double a, double b) { return a <= b ? 1.0 : 0.0; }",
    "kernel_equal": "(double a, double b) { return a == b ? 1.0 : 0.0; }",
    "kernel_not_equal": "(double a, double b) { return a != b ? 1.0 : 0.0; }",
    "kernel_and": "(double a, double b) { return a != 0.0 && b != 0.0 ? 1.0 : 0.0; }",
    "kernel_or": "(double a, double b) { return a != 0.0 || b != 0.0 ? 1.0 : 0.0; }",
    "kernel_select": "(double test, double value) { return test != 0.0 ? value : 0.0; }",
}
"""Functions that C does not have; a file holds those that it uses."""

_NAMES = {o: helper if (helper := f"kernel_{o.name.lower()}") in HELPERS else o.value for o in Operator}

DIALECT = Dialect(
    shapes={**{o: called(name, o) for o, name in _NAMES.items()}, **ARITHMETIC},
    number=number,
    reserved=RESERVED.union(name for o, name in _NAMES.items() if o not in ARITHMETIC),
)


def helpers(text: str) -> str:
    """The definitions of the helpers that ``text`` calls."""
    code = bare(text)
    return "".join(f"static double {name}{body}\n" for name, body in HELPERS.items() if f"{name}(" in code)
