"""Normal equations: sums of products of the rows of ``[J r]``, and the triangular factor that follows from them.

They cost a fraction of a factor of the rows themselves, and the square of the condition in accuracy: see `sweeps`.
"""

from __future__ import annotations

from math import inf, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals, call_normal, distinct_arrays
from mbm.solver.description import Block, DataBlock
from mbm.solver.linear_algebra import cholesky, dot, filled, inverted_upper, solve_transposed
from mbm.solver.workspace import Rows


def add_sums(
    n: Integer,
    block: Block,
    part: DataBlock,
    groups: Integer,
    rows: Rows,
    inputs: ConstantReals,
    whitening: ConstantReals,
    target: Reals,
) -> None:
    """The normal equations of a block, added to the upper triangle (n + 1, n + 1)."""
    columns = rows.columns[part.columns :]
    sums = rows.outputs
    tangents = block.tangents
    lower = tangents * (tangents + 1) // 2
    losses = rows.constants[block.units[0].loss_at :]
    filled(lower + tangents + 2, 0.0, sums)
    call_normal(block.normal, inputs, whitening, losses, sums, groups)
    for a in range(tangents):
        row = columns[a]
        if row >= 0:
            target[row * (n + 1) + n] += sums[lower + a]
            for b in range(a + 1):
                column = columns[b]
                value = sums[a * (a + 1) // 2 + b]
                if column == row and a != b:
                    target[row * (n + 1) + row] += 2.0 * value
                elif column >= row:
                    target[row * (n + 1) + column] += value
                elif column >= 0:
                    target[column * (n + 1) + row] += value


@distinct_arrays
def add_products(width: Integer, rows: Integer, stride: Integer, chunk: ConstantReals, target: Reals) -> None:
    """The products of the columns of a chunk, added to the upper triangle (width, width)."""
    for i in range(width - 1):
        for j in range(i, width):
            target[i * width + j] += dot(rows, chunk[i * stride :], chunk[j * stride :])


@distinct_arrays
def rooted(n: Integer, cost: Real, triangle: Reals, scale: Reals, lower: Reals, upper: Reals, inverse: Reals) -> Real:
    """The products in ``triangle`` (n + 1, n + 1) → the factor of ``[J r]``; its squared condition, column by column
    scaled to one, or more. Infinite where they are not positive definite: then the products stay.

    ``cost`` is ``rᵀr``; ``scale`` (n,) and the matrices (n, n) are scratch.
    """
    width = n + 1
    for j in range(n):
        if not triangle[j * width + j] > 0.0:
            return inf
        scale[j] = sqrt(triangle[j * width + j])
    for i in range(n):
        for j in range(i + 1):
            lower[i * n + j] = triangle[j * width + i] / scale[j] / scale[i]
    if cholesky(n, lower) == 0:
        return inf
    for i in range(n):
        for j in range(n):
            upper[i * n + j] = lower[j * n + i] if j >= i else 0.0
    inverted_upper(n, upper, inverse)
    for i in range(n):
        for j in range(n):
            triangle[i * width + j] = upper[i * n + j] * scale[j]
        scale[i] = triangle[i * width + n] / scale[i]
        triangle[n * width + i] = 0.0
    solve_transposed(n, upper, scale)
    rest = cost
    for i in range(n):
        triangle[i * width + n] = scale[i]
        rest -= scale[i] * scale[i]
    triangle[n * width + n] = sqrt(rest) if rest > 0.0 else 0.0
    return float(n) * dot(n * n, inverse, inverse)
