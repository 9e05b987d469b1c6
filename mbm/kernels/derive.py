"""Blocks of equations → differentiated kernels: by the unknowns, and by the measured columns that are uncertain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from mbm.files.memory import check_memory
from mbm.kernels.differentiation import differentiated
from mbm.kernels.instructions import program_of
from mbm.kernels.lowering import lower
from mbm.kernels.types import Corrections, Kernel, KernelSet
from mbm.machine.program import Operator, Program
from mbm.problem.manifold import Piece
from mbm.rotations import tangents
from mbm.solver.manifolds import SEAM
from mbm.symbolic.types import ConstantInput, ResidualBlock, SymbolicModel

PER_PLACE = 400
"""Bytes for one unknown number of an equation in one element of its Jacobian, where each depends on each."""

COMPARISONS = frozenset((Operator.LESS, Operator.LESS_EQUAL, Operator.EQUAL, Operator.NOT_EQUAL))
STEPS = COMPARISONS | {Operator.SIGN, Operator.COPYSIGN, Operator.FLOOR, Operator.CEIL}
"""What jumps with its arguments, or decides between two formulas; whole turns of angles (remainders) are none."""


def derive(model: SymbolicModel) -> KernelSet:
    """The kernels of all blocks: values and analytic Jacobians as programs of one input vector per row."""
    return KernelSet(name=model.name, kernels=tuple(kernel_of(block) for block in model.blocks))


def kernel_of(block: ResidualBlock) -> Kernel:
    """One block, differentiated with respect to its unknowns; where it has a likelihood, that and what is beside it."""
    if not block.likelihood:
        return _kernel(block)
    found, plain, information = (
        _kernel(replace(block, expressions=expressions, likelihood=(), information=()))
        for expressions in (block.likelihood, block.expressions, block.information)
    )
    return replace(found, plain=plain, information=information)


def _kernel(block: ResidualBlock) -> Kernel:
    count = len(block.variables)
    inputs = casadi.SX.sym("z", count + len(block.parameters))
    scalars = casadi.vertsplit(inputs) if inputs.numel() else []
    symbols = dict(zip((*block.variable_symbols, *block.parameter_symbols), scalars, strict=True))
    moving = (symbol for i, symbol in enumerate(block.variable_symbols) if i not in block.fixed)
    found = differentiated(lower(block.expressions, symbols, moving), inputs[:count])
    values, jacobian, whole = found.values, found.jacobian, found.with_results(inputs)
    if any(chart.piece is not Piece.NUMBER for chart in block.charts):
        jacobian = casadi.sparsify(casadi.mtimes(jacobian, tangent_map(block, scalars)))
    rows, columns = jacobian.sparsity().get_triplet()
    scalars_of_jacobian: Any = jacobian.nonzeros()  # CasADi's stubs do not know their own type here
    nonzeros = casadi.vertcat(*scalars_of_jacobian) if rows else casadi.SX(0, 1)
    outputs = casadi.cse(casadi.vertcat(values, nonzeros))
    value_program = program_of(casadi.Function("values", [whole], [casadi.cse(values)]))
    return Kernel(
        name=block.name,
        purpose=block.purpose,
        owner=block.owner,
        case=block.case,
        variables=block.variables,
        tangents=block.tangents,
        charts=block.charts,
        parameters=block.parameters,
        outputs=len(block.expressions),
        jacobian_rows=np.asarray(rows, dtype=np.int64),
        jacobian_columns=np.asarray(columns, dtype=np.int64),
        dependence=_dependence(block, found.with_stand_ins(nonzeros), inputs[:count]),
        steps=_reaching(block, value_program, STEPS),
        value_program=value_program,
        jacobian_program=program_of(casadi.Function("values_and_jacobian", [whole], [outputs])),
        corrections=corrections_of(block) if block.corrected else None,
        calls=found.programs(inputs),
        span=block.span,
    )


def _dependence(block: ResidualBlock, nonzeros: casadi.SX, unknowns: casadi.SX) -> NDArray[np.bool_]:
    """Which elements of the Jacobian (nonzeros,) vary with which tangents: (nonzeros, tangents).

    Raises:
        MbmError: too-much-memory.

    """
    count, elements = int(unknowns.numel()), int(nonzeros.numel())
    what = f"an equation of {count:,} unknown numbers, with {elements:,} derivatives,"
    check_memory(PER_PLACE * count * elements, what, block.span)
    dependence = np.zeros((elements, len(block.tangents)), dtype=bool)
    if not count or not elements:
        return dependence
    tangents = _tangents(block, count)
    pattern = casadi.jacobian_sparsity(nonzeros, unknowns)
    rows, columns = (np.asarray(found, dtype=np.int64) for found in pattern.get_triplet())
    for each in tangents.T:
        moved = each[columns]
        dependence[rows[moved >= 0], moved[moved >= 0]] = True
    return dependence


def _tangents(block: ResidualBlock, count: int) -> NDArray[np.int64]:
    """The tangents (variables, …) that move each of the ``count`` variables; -1: no further one."""
    tangents = np.full((count, max((len(chart.tangents) for chart in block.charts), default=0)), -1, dtype=np.int64)
    for chart in block.charts:
        tangents[list(chart.variables), : len(chart.tangents)] = chart.tangents
    return tangents


def _reaching(block: ResidualBlock, program: Program, operators: frozenset[Operator]) -> NDArray[np.bool_]:
    """Which tangents (tangents,) reach an argument of some operators in the program of the values."""
    found = np.zeros(len(block.tangents), dtype=bool)
    if not any(each.operator in operators for each in program.instructions):
        return found
    count, reached = len(block.variables), 0
    holds = {value: 1 << i for i, value in enumerate(program.inputs[:count]) if value >= 0}
    for each in program.instructions:
        own = 0
        for argument in each.arguments:
            own |= holds.get(argument, 0)
        holds[each.target] = own
        if each.operator in operators:
            reached |= own
    moved = _tangents(block, count)[[i for i in range(count) if reached >> i & 1]]
    found[moved[moved >= 0]] = True
    return found


def corrections_of(block: ResidualBlock) -> Corrections:
    """The kernel of values, slopes and curvature with respect to the ``corrected`` parameters of ``block``.

    The curvature is that of λᵀh, with one multiplier λ for each output behind the other inputs.
    """
    variables, parameters, outputs = len(block.variables), len(block.parameters), len(block.expressions)
    inputs = casadi.SX.sym("z", variables + parameters + outputs)
    scalars = casadi.vertsplit(inputs)
    symbols = dict(zip((*block.variable_symbols, *block.parameter_symbols), scalars[:-outputs], strict=True))
    measured = casadi.vertcat(*(scalars[variables + column] for column in block.corrected))
    found = differentiated(lower(block.expressions, symbols), measured)
    values, slopes = found.values, found.jacobian
    multipliers = casadi.vertcat(*scalars[variables + parameters :])
    found, curvature = found.derivative(casadi.mtimes(slopes.T, multipliers), measured)
    whole = found.with_results(inputs)
    slope_rows, slope_columns = slopes.sparsity().get_triplet()
    curvature_rows, curvature_columns = curvature.sparsity().get_triplet()
    nonzeros: list[Any] = [*slopes.nonzeros(), *curvature.nonzeros()]
    everything = casadi.vertcat(values, *nonzeros)
    kernel = Kernel(
        name=block.name,
        purpose=block.purpose,
        owner=block.owner,
        case=block.case,
        variables=block.variables,
        tangents=block.tangents,
        charts=block.charts,
        parameters=(*block.parameters, *(ConstantInput(f"multiplier {i + 1}") for i in range(outputs))),
        outputs=outputs,
        jacobian_rows=np.asarray([*slope_rows, *curvature_rows], dtype=np.int64),
        jacobian_columns=np.asarray([*slope_columns, *curvature_columns], dtype=np.int64),
        dependence=np.ones((len(nonzeros), len(block.tangents)), dtype=bool),
        steps=np.zeros(len(block.tangents), dtype=bool),
        value_program=program_of(casadi.Function("values", [whole], [casadi.cse(values)])),
        jacobian_program=program_of(casadi.Function("values_and_slopes", [whole], [casadi.cse(everything)])),
        calls=found.programs(inputs),
        span=block.span,
    )
    return Corrections(
        columns=block.corrected,
        kernel=kernel,
        slope_rows=np.asarray(slope_rows, dtype=np.int64),
        slope_columns=np.asarray(slope_columns, dtype=np.int64),
        curvature_rows=np.asarray(curvature_rows, dtype=np.int64),
        curvature_columns=np.asarray(curvature_columns, dtype=np.int64),
    )


def tangent_map(block: ResidualBlock, scalars: list[casadi.SX]) -> casadi.SX:
    """Derivative of the variables with respect to the tangents, at no step: sparse, (variables, tangents).

    ``scalars`` are the inputs of the block, the variables first. Conventions as `mbm.problem.manifold`.
    """
    result = casadi.SX(len(block.variables), len(block.tangents))
    for chart in block.charts:
        numbers = [scalars[i] for i in chart.variables]
        for i, row in zip(chart.variables, _slopes(chart.piece, numbers), strict=True):
            for j, slope in zip(chart.tangents, row, strict=True):
                result[i, j] = slope
    return result


def _slopes(piece: Piece, numbers: list[casadi.SX]) -> list[list[casadi.SX | float]]:
    if piece is Piece.NUMBER:
        return [[1.0]]
    if piece is Piece.SCALE:
        return [[numbers[0]]]
    if piece is Piece.QUATERNION:
        w, x, y, z = (0.5 * q for q in numbers)
        return [[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]
    return _sphere(*numbers)


def _sphere(x: casadi.SX, y: casadi.SX, z: casadi.SX) -> list[list[casadi.SX | float]]:
    first, second = tangents(x, y, z, casadi.if_else(z < SEAM, -1.0, 1.0))
    return [list(row) for row in zip(first, second, strict=True)]
