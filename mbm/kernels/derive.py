"""Blocks of equations → differentiated kernels."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from mbm.files.memory import check_memory
from mbm.kernels.charts import tangent_map
from mbm.kernels.corrections import corrections_of
from mbm.kernels.differentiation import differentiated
from mbm.kernels.instructions import program_of
from mbm.kernels.lowering import lower
from mbm.kernels.types import Kernel, KernelSet
from mbm.problem.manifold import Piece
from mbm.symbolic.types import ResidualBlock, SymbolicModel

PER_PLACE = 400
"""Bytes for one unknown number of an equation in one element of its Jacobian, where each depends on each."""


def derive(model: SymbolicModel) -> KernelSet:
    """The kernels of all blocks: values and analytic Jacobians as programs of one input vector per row."""
    return KernelSet(name=model.name, kernels=tuple(kernel_of(block) for block in model.blocks))


def kernel_of(block: ResidualBlock) -> Kernel:
    """One block, differentiated with respect to its unknowns."""
    count = len(block.variables)
    inputs = casadi.SX.sym("z", count + len(block.parameters))
    scalars = casadi.vertsplit(inputs) if inputs.numel() else []
    symbols = dict(zip((*block.variable_symbols, *block.parameter_symbols), scalars, strict=True))
    values, jacobian = differentiated(lower(block.expressions, symbols), inputs[:count])
    if any(chart.piece is not Piece.NUMBER for chart in block.charts):
        jacobian = casadi.sparsify(casadi.mtimes(jacobian, tangent_map(block, scalars)))
    rows, columns = jacobian.sparsity().get_triplet()
    scalars_of_jacobian: Any = jacobian.nonzeros()  # CasADi's stubs do not know their own type here
    nonzeros = casadi.vertcat(*scalars_of_jacobian) if rows else casadi.SX(0, 1)
    outputs = casadi.cse(casadi.vertcat(values, nonzeros))
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
        dependence=_dependence(block, nonzeros, inputs[:count]),
        value_program=program_of(casadi.Function("values", [inputs], [casadi.cse(values)])),
        jacobian_program=program_of(casadi.Function("values_and_jacobian", [inputs], [outputs])),
        corrections=corrections_of(block) if block.corrected else None,
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
    tangents = np.full((count, max(len(chart.tangents) for chart in block.charts)), -1, dtype=np.int64)
    for chart in block.charts:
        tangents[list(chart.variables), : len(chart.tangents)] = chart.tangents
    pattern = casadi.jacobian_sparsity(nonzeros, unknowns)
    rows, columns = (np.asarray(found, dtype=np.int64) for found in pattern.get_triplet())
    for each in tangents.T:
        moved = each[columns]
        dependence[rows[moved >= 0], moved[moved >= 0]] = True
    return dependence
