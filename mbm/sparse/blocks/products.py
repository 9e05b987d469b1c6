"""Jacobian → normal equations: products of blocks, gradient, image of a step; and the Jacobian from kernel outputs."""

from __future__ import annotations

from mbm.machine.words import ConstantIntegers, ConstantReals, Integer, Reals, distinct_arrays
from mbm.sparse.blocks.parts import Nonzeros, Piece, Products

OUTPUTS = 2
RIGHT = 3
"""Residuals of a row and columns of the right one of two blocks that are multiplied. Each problem has its own."""


@distinct_arrays
def add_products(first: Integer, last: Integer, products: Products, blocks: Reals) -> None:
    """``blocks[targets[t]] += Σ_r J_leftᵀ J_right`` for the targets ``first … last``; ``blocks`` (…, high, RIGHT)."""
    width = products.width
    high = products.high
    left = products.left
    right = products.right
    values = products.values
    for t in range(first, last):
        block = products.targets[t] * (high * RIGHT)
        for s in range(products.starts[t], products.starts[t + 1]):
            row = products.rows[s] * (OUTPUTS * width)
            for i in range(high):
                for j in range(RIGHT):
                    total = 0.0
                    for o in range(OUTPUTS):
                        total += values[row + o * width + left + i] * values[row + o * width + right + j]
                    blocks[block + i * RIGHT + j] += total


def column_of(piece: Piece, block: Integer, row: Integer) -> Integer:
    """The first column that a local block of a row belongs to."""
    return piece.heads[block] + piece.members[block * piece.rows + row] * piece.sizes[block]


@distinct_arrays
def add_gradient(first: Integer, last: Integer, piece: Piece, residuals: ConstantReals, gradient: Reals) -> None:
    """``gradient += Jᵀ r`` for the rows ``first … last`` of a piece; ``residuals`` (rows, outputs)."""
    outputs = piece.outputs
    values = piece.values
    for r in range(first, last):
        for b in range(piece.count):
            size = piece.sizes[b]
            column = column_of(piece, b, r)
            for o in range(outputs):
                place = (r * outputs + o) * piece.width + piece.starts[b]
                factor = residuals[r * outputs + o]
                for c in range(size):
                    gradient[column + c] += values[place + c] * factor


@distinct_arrays
def add_squares(first: Integer, last: Integer, piece: Piece, squares: Reals) -> None:
    """``squares += `` those of the columns of ``J``, for the rows ``first … last`` of a piece.

    Where a row has the same member twice, its columns are added before they are squared.
    """
    outputs = piece.outputs
    values = piece.values
    for r in range(first, last):
        for b in range(piece.count):
            column = column_of(piece, b, r)
            for d in range(b + 1):
                factor = 1.0 if d == b else 2.0
                if column_of(piece, d, r) == column:
                    for o in range(outputs):
                        place = (r * outputs + o) * piece.width
                        for c in range(piece.sizes[b]):
                            product = values[place + piece.starts[b] + c] * values[place + piece.starts[d] + c]
                            squares[column + c] += factor * product


@distinct_arrays
def put_image(first: Integer, last: Integer, piece: Piece, step: ConstantReals, image: Reals) -> None:
    """``image = J step`` for the rows ``first … last`` of a piece."""
    outputs = piece.outputs
    values = piece.values
    for r in range(first, last):
        for o in range(outputs):
            total = 0.0
            for b in range(piece.count):
                column = column_of(piece, b, r)
                place = (r * outputs + o) * piece.width + piece.starts[b]
                for c in range(piece.sizes[b]):
                    total += values[place + c] * step[column + c]
            image[r * outputs + o] = total


@distinct_arrays
def put_inputs(
    first: Integer,
    last: Integer,
    variables: Integer,
    parameters: Integer,
    index: ConstantIntegers,
    numbers: ConstantReals,
    data: ConstantReals,
    inputs: Reals,
) -> None:
    """The inputs of a kernel for the rows ``first … last``: the ``numbers`` at ``index``, and behind them the data."""
    length = variables + parameters
    for r in range(first, last):
        for j in range(variables):
            inputs[r * length + j] = numbers[index[r * variables + j]]
        for j in range(parameters):
            inputs[r * length + variables + j] = data[r * parameters + j]


@distinct_arrays
def put_nonzeros(
    first: Integer, last: Integer, pattern: Nonzeros, nonzeros: ConstantReals, weights: ConstantReals, values: Reals
) -> None:
    """The whitened Jacobian of the rows ``first … last`` from the nonzeros of a kernel.

    ``values`` are zero elsewhere; ``weights`` (rows, outputs).
    """
    for r in range(first, last):
        for k in range(pattern.count):
            weight = weights[r * pattern.outputs + pattern.lines[k]]
            value = nonzeros[r * pattern.length + pattern.chosen[k]]
            values[r * pattern.wide + pattern.targets[k]] = value * weight
