"""How the numbers that hold rotations, directions and scales vary with the coordinates of their tangent spaces."""

from __future__ import annotations

import casadi

from mbm.problem.manifold import Piece
from mbm.symbolic.types import ResidualBlock


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
    """Two orthonormal tangents as columns (Duff et al. 2017), as `mbm.equations.manifolds.tangent_axes` has them."""
    sign = casadi.if_else(z < 0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return [[1.0 + sign * x * x * a, b], [sign * b, sign + y * y * a], [-sign * x, -y]]
