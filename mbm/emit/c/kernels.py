"""Kernels and the programs of data as C functions with named inputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from mbm.emit.c.dialect import DIALECT
from mbm.emit.c.layout import wrapped
from mbm.emit.c.text import comment, remark
from mbm.emit.foreign import Foreign, Word, told
from mbm.emit.statements import statements
from mbm.emit.types import BlockCase
from mbm.machine.program import Program


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
