"""Kernels and the programs of data as C functions with named inputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from mbm.emit.c.layout import wrapped
from mbm.emit.c.text import bare, comment, remark
from mbm.emit.foreign import Foreign, Word, told
from mbm.emit.reserved import RESERVED
from mbm.emit.statements import ARITHMETIC, Dialect, called, statements
from mbm.emit.types import BlockCase
from mbm.machine.c import number
from mbm.machine.program import Operator, Program

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


def kernel_functions(case: BlockCase) -> str:
    """The values of a kernel, and the values with the nonzeros of their Jacobian behind them."""
    head: list[Word] = [f"{case.identifier}: what should be zero in each row.", ""]
    head += [told("    ", line) for line in case.text]
    slopes: list[Word] = [
        f"{case.identifier}: the same, and behind it the derivatives that are not zero everywhere, in the order",
        "",
    ]
    slopes += _nonzeros(case)
    values = function(f"{case.identifier}_values", case.kernel.value_program, case.input_names, head)
    jacobian = function(f"{case.identifier}_slopes", case.kernel.jacobian_program, case.input_names, slopes)
    return f"{values}\n{jacobian}"


def _nonzeros(case: BlockCase) -> Iterator[Word]:
    for row, column in zip(case.kernel.jacobian_rows, case.kernel.jacobian_columns, strict=True):
        slot = case.tangents[int(column)]
        yield told(f"    d(component {int(row) + 1}) / d(", slot.shown, f", coordinate {slot.component + 1})")


def function(name: str, program: Program, names: Sequence[Foreign], doc: Iterable[Word]) -> str:
    """A function ``void name(const double *inputs, double *outputs)``."""
    made = statements(program, names, DIALECT)
    lines = [comment(doc), f"static void {name}(const double *inputs, double *outputs)", "{"]
    for identifier, position in made.inputs:
        shown = "" if names[position] == Foreign(identifier) else f"  {remark(names[position])}"
        lines.append(f"    const double {identifier} = inputs[{position}];{shown}")
    if not made.inputs:
        lines.append("    (void)inputs;")
    lines += wrapped(f"    const double {left} = {right};" for left, right in made.assignments)
    lines.append("")
    if not made.outputs:
        lines.append("    (void)outputs;")
    lines += wrapped(f"    outputs[{i}] = {text};" for i, text in enumerate(made.outputs))
    return "\n".join([*lines, "}", ""])


def helpers(text: str) -> str:
    """The definitions of the helpers that ``text`` calls."""
    code = bare(text)
    return "".join(f"static double {name}{body}\n" for name, body in HELPERS.items() if f"{name}(" in code)
