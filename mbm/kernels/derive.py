"""Blocks of equations → differentiated kernels."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

from mbm.kernels.lowering import Lowered, lower
from mbm.kernels.types import Kernel, KernelSet
from mbm.symbolic.types import ResidualBlock, SymbolicModel


def derive(model: SymbolicModel) -> KernelSet:
    """The kernels of all blocks: values and analytic Jacobians as CasADi functions of one input vector per row."""
    return KernelSet(name=model.name, kernels=tuple(kernel_of(block) for block in model.blocks))


def kernel_of(block: ResidualBlock) -> Kernel:
    """One block, differentiated with respect to its unknowns."""
    count = len(block.variables)
    inputs = casadi.SX.sym("z", count + len(block.parameters))
    scalars = casadi.vertsplit(inputs) if inputs.numel() else []
    symbols = dict(zip((*block.variable_symbols, *block.parameter_symbols), scalars, strict=True))
    values, jacobian = _differentiated(lower(block.expressions, symbols), inputs[:count])
    rows, columns = jacobian.sparsity().get_triplet()
    scalars_of_jacobian: Any = jacobian.nonzeros()  # CasADi's stubs do not know their own type here
    nonzeros = casadi.vertcat(*scalars_of_jacobian) if rows else casadi.SX(0, 1)
    outputs = casadi.cse(casadi.vertcat(values, nonzeros))
    dependence = np.zeros((len(rows), count), dtype=bool)
    if rows and count:
        pattern = casadi.jacobian_sparsity(nonzeros, inputs[:count])
        found_rows, found_columns = pattern.get_triplet()
        dependence[found_rows, found_columns] = True
    return Kernel(
        name=block.name,
        purpose=block.purpose,
        owner=block.owner,
        case=block.case,
        variables=block.variables,
        parameters=block.parameters,
        outputs=len(block.expressions),
        jacobian_rows=np.asarray(rows, dtype=np.int64),
        jacobian_columns=np.asarray(columns, dtype=np.int64),
        dependence=dependence,
        value_function=casadi.Function("values", [inputs], [casadi.cse(values)]),
        jacobian_function=casadi.Function("values_and_jacobian", [inputs], [outputs]),
        span=block.span,
    )


def _differentiated(lowered: Lowered, variables: casadi.SX) -> tuple[casadi.SX, casadi.SX]:
    """Values and Jacobian. Piecewise values are differentiated branch by branch and then chosen from.

    Automatic differentiation of a choice multiplies the derivative of the branch not taken by zero, which makes NaN of
    the infinite slope of ``sqrt`` at zero that the condition was there to avoid.
    """
    values = casadi.densify(casadi.vertcat(*lowered.expressions))
    if not lowered.choices:
        return values, casadi.jacobian(values, variables)
    count = int(variables.numel())
    slopes: dict[int, casadi.SX] = {}
    known: list[casadi.SX] = []
    chosen: list[casadi.SX] = []

    def total(expression: casadi.SX) -> casadi.SX:
        """The Jacobian with those of the choices that ``expression`` uses, by the chain rule."""
        result = casadi.jacobian(expression, variables)
        for symbol in casadi.symvar(expression):
            slope = slopes.get(symbol.element_hash())
            if slope is not None:
                result = result + casadi.mtimes(casadi.jacobian(expression, symbol), slope)
        return result

    for choice in lowered.choices:
        then, other = casadi.densify(total(choice.then)), casadi.densify(total(choice.other))
        pairs = [casadi.if_else(choice.test, then[j], other[j]) for j in range(count)]
        slopes[choice.symbol.element_hash()] = casadi.sparsify(casadi.horzcat(*pairs)) if pairs else casadi.SX(1, 0)
        known.append(choice.symbol)
        chosen.append(casadi.if_else(choice.test, choice.then, choice.other))
    _, (values, jacobian) = casadi.substitute_inplace(known, chosen, [values, total(values)])
    return values, jacobian
