"""A block of equations → its derivatives by the measured columns that are uncertain, first and second."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

from mbm.kernels.differentiation import differentiated
from mbm.kernels.instructions import program_of
from mbm.kernels.lowering import lower
from mbm.kernels.types import Corrections, Kernel
from mbm.symbolic.types import ConstantInput, ResidualBlock


def corrections_of(block: ResidualBlock) -> Corrections:
    """The kernel of values, slopes and curvature with respect to the ``corrected`` parameters of ``block``.

    The curvature is that of λᵀh, with one multiplier λ for each output behind the other inputs.
    """
    variables, parameters, outputs = len(block.variables), len(block.parameters), len(block.expressions)
    inputs = casadi.SX.sym("z", variables + parameters + outputs)
    scalars = casadi.vertsplit(inputs)
    symbols = dict(zip((*block.variable_symbols, *block.parameter_symbols), scalars[:-outputs], strict=True))
    measured = casadi.vertcat(*(scalars[variables + column] for column in block.corrected))
    values, slopes = differentiated(lower(block.expressions, symbols), measured)
    multipliers = casadi.vertcat(*scalars[variables + parameters :])
    curvature = casadi.jacobian(casadi.mtimes(slopes.T, multipliers), measured)
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
        value_program=program_of(casadi.Function("values", [inputs], [casadi.cse(values)])),
        jacobian_program=program_of(casadi.Function("values_and_slopes", [inputs], [casadi.cse(everything)])),
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
