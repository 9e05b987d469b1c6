"""Jacobian → normal equations: products of blocks, gradient, image of a step; and the Jacobian from kernel outputs."""

from __future__ import annotations

from mbm.target.words import ConstantIntegers, ConstantReals, Integer, Reals, distinct_arrays

OUTPUTS = 2
RIGHT = 3
"""Residuals of a row and columns of the right one of two blocks that are multiplied. Each problem has its own."""


@distinct_arrays
def add_products(
    first: Integer,
    last: Integer,
    targets: ConstantIntegers,
    starts: ConstantIntegers,
    rows: ConstantIntegers,
    width: Integer,
    high: Integer,
    left: Integer,
    right: Integer,
    values: ConstantReals,
    blocks: Reals,
) -> None:
    """``blocks[targets[t]] += Σ_r J_leftᵀ J_right`` for the targets ``first … last``.

    The rows of target t are ``rows[starts[t]:starts[t + 1]]``. ``values`` are (rows, OUTPUTS, width); in them the
    blocks' columns start at ``left`` and ``right``. ``blocks`` are (…, high, RIGHT).
    """
    for t in range(first, last):
        block = targets[t] * (high * RIGHT)
        for s in range(starts[t], starts[t + 1]):
            row = rows[s] * (OUTPUTS * width)
            for i in range(high):
                for j in range(RIGHT):
                    total = 0.0
                    for o in range(OUTPUTS):
                        total += values[row + o * width + left + i] * values[row + o * width + right + j]
                    blocks[block + i * RIGHT + j] += total


@distinct_arrays
def add_gradient(
    first: Integer,
    last: Integer,
    outputs: Integer,
    width: Integer,
    count: Integer,
    starts: ConstantIntegers,
    sizes: ConstantIntegers,
    heads: ConstantIntegers,
    members: ConstantIntegers,
    rows: Integer,
    values: ConstantReals,
    residuals: ConstantReals,
    gradient: Reals,
) -> None:
    """``gradient += Jᵀ r`` for the rows ``first … last`` of a piece with ``rows`` rows.

    Its ``count`` local blocks start at ``starts``, are ``sizes`` wide, and are of families whose columns begin at
    ``heads``; ``members`` (count, rows). ``values`` (rows, outputs, width), ``residuals`` (rows, outputs).
    """
    for r in range(first, last):
        for b in range(count):
            size = sizes[b]
            column = heads[b] + members[b * rows + r] * size
            for o in range(outputs):
                place = (r * outputs + o) * width + starts[b]
                factor = residuals[r * outputs + o]
                for c in range(size):
                    gradient[column + c] += values[place + c] * factor


@distinct_arrays
def add_squares(
    first: Integer,
    last: Integer,
    outputs: Integer,
    width: Integer,
    count: Integer,
    starts: ConstantIntegers,
    sizes: ConstantIntegers,
    heads: ConstantIntegers,
    members: ConstantIntegers,
    rows: Integer,
    values: ConstantReals,
    squares: Reals,
) -> None:
    """``squares += `` those of the columns of ``J``; the arguments are those of `add_gradient`.

    Where a row has the same member twice, its columns are added before they are squared.
    """
    for r in range(first, last):
        for b in range(count):
            column = heads[b] + members[b * rows + r] * sizes[b]
            for d in range(b + 1):
                factor = 1.0 if d == b else 2.0
                if heads[d] + members[d * rows + r] * sizes[d] == column:
                    for o in range(outputs):
                        place = (r * outputs + o) * width
                        for c in range(sizes[b]):
                            product = values[place + starts[b] + c] * values[place + starts[d] + c]
                            squares[column + c] += factor * product


@distinct_arrays
def put_image(
    first: Integer,
    last: Integer,
    outputs: Integer,
    width: Integer,
    count: Integer,
    starts: ConstantIntegers,
    sizes: ConstantIntegers,
    heads: ConstantIntegers,
    members: ConstantIntegers,
    rows: Integer,
    values: ConstantReals,
    step: ConstantReals,
    image: Reals,
) -> None:
    """``image = J step`` for the rows ``first … last`` of a piece; the arguments are those of `add_gradient`."""
    for r in range(first, last):
        for o in range(outputs):
            total = 0.0
            for b in range(count):
                column = heads[b] + members[b * rows + r] * sizes[b]
                place = (r * outputs + o) * width + starts[b]
                for c in range(sizes[b]):
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
    first: Integer,
    last: Integer,
    count: Integer,
    chosen: ConstantIntegers,
    targets: ConstantIntegers,
    lines: ConstantIntegers,
    outputs: Integer,
    length: Integer,
    wide: Integer,
    nonzeros: ConstantReals,
    weights: ConstantReals,
    values: Reals,
) -> None:
    """The whitened Jacobian of the rows ``first … last`` from the nonzeros of a kernel.

    Nonzero ``chosen[k]`` of a row, of output ``lines[k]``, goes to its place ``targets[k]``. ``nonzeros`` has rows of
    ``length`` numbers, ``values`` rows of ``wide`` numbers, zero elsewhere; ``weights`` (rows, outputs).
    """
    for r in range(first, last):
        for k in range(count):
            weight = weights[r * outputs + lines[k]]
            values[r * wide + targets[k]] = nonzeros[r * length + chosen[k]] * weight
