"""Kernels and the programs of data as C functions with named inputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from mbm.emit.c.dialect import DIALECT
from mbm.emit.c.layout import comment, wrapped
from mbm.emit.statements import statements
from mbm.emit.types import BlockCase
from mbm.expression.nodes import ColumnMember
from mbm.symbolic.types import Slot
from mbm.target.program import Program


def kernel_functions(case: BlockCase) -> str:
    """The values of a kernel, and the values with the nonzeros of their Jacobian behind them."""
    head = [f"{case.identifier}: what should be zero in each row.", "", *(f"    {line}" for line in case.text)]
    slopes = [f"{case.identifier}: the same, and behind it the derivatives that are not zero everywhere, in the order"]
    slopes += ["", *_nonzeros(case)]
    values = function(f"{case.identifier}_values", case.kernel.value_program, case.input_names, head)
    jacobian = function(f"{case.identifier}_jacobian", case.kernel.jacobian_program, case.input_names, slopes)
    return f"{values}\n{jacobian}"


def _nonzeros(case: BlockCase) -> Iterator[str]:
    kernel = case.kernel
    for row, column in zip(kernel.jacobian_rows, kernel.jacobian_columns, strict=True):
        slot = kernel.tangents[int(column)]
        yield f"    d(component {int(row) + 1}) / d({_named(slot)}, coordinate {slot.component + 1})"


def _named(slot: Slot) -> str:
    """An unknown, with the member that is meant."""
    if slot.member is None:
        return slot.unknown
    key = slot.member.column if isinstance(slot.member, ColumnMember) else f'"{slot.member.key}"'
    return f"{slot.unknown}[{key}]"


def function(name: str, program: Program, names: Sequence[str], doc: Iterable[str]) -> str:
    """A function ``void name(const double *inputs, double *outputs)``."""
    made = statements(program, names, DIALECT)
    lines = [comment(doc), f"static void {name}(const double *inputs, double *outputs)", "{"]
    for identifier, position in made.inputs:
        shown = "" if names[position] == identifier else f"  /* {names[position].replace('*/', '')} */"
        lines.append(f"    const double {identifier} = inputs[{position}];{shown}")
    if not made.inputs:
        lines.append("    (void)inputs;")
    lines += wrapped(f"    const double {left} = {right};" for left, right in made.assignments)
    lines.append("")
    if not made.outputs:
        lines.append("    (void)outputs;")
    lines += wrapped(f"    outputs[{i}] = {text};" for i, text in enumerate(made.outputs))
    return "\n".join([*lines, "}", ""])
