"""Straight-line programs as CasADi functions; kernels, and all rows of a problem together, as serialised ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import casadi
import numpy as np
from numpy.typing import NDArray

from mbm.kernels.types import Floats, Kernel
from mbm.machine.program import Operator, Program
from mbm.values import dataclass

CODES: Mapping[Operator, int] = {operator: getattr(casadi, f"OP_{operator.value.upper()}") for operator in Operator}
"""What CasADi calls the operations."""


def applied(operator: Operator, *arguments: casadi.SX) -> casadi.SX:
    """One operation."""
    apply = casadi.SX.unary if operator.arguments == 1 else casadi.SX.binary
    return apply(CODES[operator], *arguments)


def function_of(name: str, program: Program) -> casadi.Function:
    """A CasADi function of one dense input vector and one dense output vector that computes what ``program`` does."""
    inputs = casadi.SX.sym("z", len(program.inputs))
    scalars = casadi.vertsplit(inputs) if program.inputs else []
    values: list[casadi.SX] = [casadi.SX(0)] * program.values
    for value, constant in program.constants:
        values[value] = casadi.SX(constant)
    for scalar, value in zip(scalars, program.inputs, strict=True):
        if value >= 0:
            values[value] = scalar
    for instruction in program.instructions:
        arguments = [values[a] for a in instruction.arguments]
        values[instruction.target] = applied(instruction.operator, *arguments)
    outputs = [casadi.SX(0) if value < 0 else values[value] for value in program.outputs]
    return casadi.Function(name, [inputs], [casadi.densify(casadi.vertcat(*outputs))])


Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoundRows:
    """A kernel with the rows that it holds for.

    ``index`` (rows, variables) are places in the vector of all numbers, ``columns`` (rows, tangents) those among the
    estimated coordinates (-1: it stays), ``parameters`` (rows, parameters), ``weights`` (rows, outputs, outputs).
    """

    kernel: Kernel
    index: Indices = field(repr=False)
    columns: Indices = field(repr=False)
    parameters: Floats = field(repr=False)
    weights: Floats = field(repr=False)


def serialised_kernel(name: str, kernel: Kernel) -> str:
    """``name(z) → values, jacobian``: z are the unknowns and then the parameters of one row."""
    both = function_of("both", kernel.jacobian_program)
    z = casadi.SX.sym("z", len(kernel.variables) + len(kernel.parameters))
    found = both(z)
    values = found[: kernel.outputs]
    places = casadi.Sparsity.triplet(
        kernel.outputs, len(kernel.tangents), kernel.jacobian_rows.tolist(), kernel.jacobian_columns.tolist()
    )
    jacobian = casadi.SX(places, _in_order(found[kernel.outputs :], kernel))
    return str(casadi.Function(name, [z], [values, jacobian], ["z"], ["values", "jacobian"]).serialize())


def _in_order(nonzeros: casadi.SX, kernel: Kernel) -> casadi.SX:
    """The nonzeros column by column, as CasADi stores them."""
    order = np.lexsort((kernel.jacobian_rows, kernel.jacobian_columns))
    return casadi.vertcat(*(nonzeros[int(i)] for i in order)) if len(order) else casadi.SX(0, 1)


def serialised_whole(name: str, numbers: int, coordinates: int, bound: Sequence[BoundRows]) -> str:
    """``name(point) → residuals, jacobian``: all whitened residuals (m,), and their derivatives by the coordinates."""
    point = casadi.MX.sym("point", numbers)
    residuals, slopes = [casadi.MX(0, 1)], [casadi.MX(0, coordinates)]
    for rows in bound:
        if not len(rows.parameters):
            continue  # CasADi maps nothing to no rows
        values, jacobian = _group(point, coordinates, rows)
        residuals.append(values)
        slopes.append(jacobian)
    outputs = [casadi.vertcat(*residuals), casadi.vertcat(*slopes)]
    return str(casadi.Function(name, [point], outputs, ["point"], ["residuals", "jacobian"]).serialize())


def _group(point: casadi.MX, coordinates: int, rows: BoundRows) -> tuple[casadi.MX, casadi.MX]:
    kernel, count = rows.kernel, len(rows.parameters)
    places = rows.index.ravel().tolist()
    given = casadi.reshape(point[places], len(kernel.variables), count) if places else casadi.MX(0, count)
    function = function_of("both", kernel.jacobian_program)
    found = function.map(count)(casadi.vertcat(given, casadi.DM(rows.parameters.T)))
    whitening = casadi.diagcat(*(casadi.sparsify(casadi.DM(each)) for each in rows.weights))
    values = casadi.mtimes(whitening, casadi.vec(found[: kernel.outputs, :]))
    lines = (np.arange(count)[:, None] * kernel.outputs + kernel.jacobian_rows).ravel()
    columns = rows.columns[:, kernel.jacobian_columns].ravel()
    kept = columns >= 0
    # two tangents of a row may be one coordinate (the same member named twice): their nonzeros add up
    unique, position = np.unique(columns[kept] * (count * kernel.outputs) + lines[kept], return_inverse=True)
    gather = casadi.DM(
        casadi.Sparsity.triplet(len(unique), len(lines), position.tolist(), np.flatnonzero(kept).tolist()), 1.0
    )
    nonzeros = casadi.mtimes(gather, casadi.vec(found[kernel.outputs :, :]))
    shape = casadi.Sparsity.triplet(
        count * kernel.outputs,
        coordinates,
        (unique % (count * kernel.outputs)).tolist(),
        (unique // (count * kernel.outputs)).tolist(),
    )
    return values, casadi.mtimes(whitening, casadi.MX(shape, nonzeros))
