"""Rows of several programs as one straight-line program: what they have in common is computed once.

Blocks of one to three rows, such as a row for each feature of a drawing or a prior, would fill few lanes each and call
a function each. Fused, they share the sine of an angle that all of them turn by, and leave whitened residuals and the
columns of the Jacobian where the solver wants them.
"""

from __future__ import annotations

from collections.abc import Sequence

from mbm.machine.merged import ZERO, Merged
from mbm.machine.program import Program
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """Some rows of one kernel.

    ``program`` gives ``outputs`` values, and nonzeros of their Jacobian behind them: ``derivatives`` has the output and
    the column of each (-1: of no interest). Its inputs are the ``numbers`` of the point, the same in all ``rows``, then
    ``parameters`` of the row. Residual i is the sum of weight times output over ``whitening[i]``, where weights are
    those of the row, ``weights`` in all.
    """

    program: Program
    rows: int
    outputs: int
    derivatives: tuple[tuple[int, int], ...]
    numbers: tuple[int, ...]
    parameters: int
    whitening: tuple[tuple[tuple[int, int], ...], ...]
    weights: int


def fused(parts: Sequence[Part], numbers: int, columns: int) -> Program:
    """The rows of all parts as one program.

    Inputs are the ``numbers`` of the point, then for each part the parameters of its rows, row by row, and their
    weights. Outputs are the derivatives of the m residuals by each of the ``columns`` (m each), then the residuals.
    """
    merged = Merged(numbers + sum(each.rows * (each.parameters + each.weights) for each in parts))
    residuals: list[int] = []
    slopes: list[dict[int, int]] = []
    first = numbers
    for part in parts:
        heavy = first + part.rows * part.parameters
        for row in range(part.rows):
            own = range(first + row * part.parameters, first + (row + 1) * part.parameters)
            found = merged.run(part.program, (*part.numbers, *own))
            weights = range(heavy + row * part.weights, heavy + (row + 1) * part.weights)
            lines: list[dict[int, int]] = [{} for _ in range(part.outputs)]
            for (output, column), value in zip(part.derivatives, found[part.outputs :], strict=True):
                if column >= 0:
                    lines[output][column] = merged.sum(lines[output].get(column, ZERO), value)
            for terms in part.whitening:
                residuals.append(merged.weighted([(weights[w], found[output]) for w, output in terms]))
                touched = sorted({column for _, output in terms for column in lines[output]})
                slopes.append(
                    {c: merged.weighted([(weights[w], lines[o].get(c, ZERO)) for w, o in terms]) for c in touched}
                )
        first = heavy + part.rows * part.weights
    outputs = [line.get(column, ZERO) for column in range(columns) for line in slopes]
    return merged.program([*outputs, *residuals])
