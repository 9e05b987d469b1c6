"""Weights that the model decides: residuals whose squares are the log-determinant, and what the weights tell.

With C the covariance of n components, ``-2 log L`` is ``hᵀ C⁻¹ h + log det C``, and the expected information
``JᵀC⁻¹J + ½ tr(C⁻¹ ∂C C⁻¹ ∂C)`` (Magnus 1978). Both are sums over a triangular root L of C.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from mbm.expression.nodes import Operation
from mbm.expression.terms import Term, chosen, function, held, square_root
from mbm.problem.likelihoods.types import SHIFT

Matrix = list[list[Term]]


def determinant(scale: Term, reference: Term, power: float = 2.0) -> Term:
    """√(SHIFT + power · log(scale/reference))."""
    return square_root(SHIFT + power * function(Operation.LOG, scale / reference))


def told_by_scale(scale: Term) -> Term:
    """What a standard deviation tells: its derivative is ``√2 σ'/σ``."""
    return sqrt(2.0) * scale / held(scale)


def above_zero(value: Term) -> Term:
    """A reference, 1 where that is none."""
    return chosen(value > 0.0, value, 1.0)


def square_matrix(entries: Sequence[Term], size: int) -> Matrix:
    """Entries row by row as rows."""
    return [list(entries[i * size : (i + 1) * size]) for i in range(size)]


def triangular_root(matrix: Matrix) -> Matrix:
    """L with L Lᵀ the matrix (Cholesky)."""
    size = len(matrix)
    root: Matrix = [[matrix[0][0] * 0.0] * size for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            left = matrix[i][j]
            for k in range(j):
                left = left - root[i][k] * root[j][k]
            root[i][j] = square_root(left) if i == j else left / root[j][j]
    return root


def solved(root: Matrix, values: Sequence[Term]) -> list[Term]:
    """L⁻¹ v."""
    found: list[Term] = []
    for i, value in enumerate(values):
        left = value
        for k in range(i):
            left = left - root[i][k] * found[k]
        found.append(left / root[i][i])
    return found


def transposed_times(root: Matrix, values: Sequence[Term]) -> list[Term]:
    """Lᵀ v."""
    size = len(values)
    found = []
    for j in range(size):
        total = root[j][j] * values[j]
        for i in range(j + 1, size):
            total = total + root[i][j] * values[i]
        found.append(total)
    return found


def told_by_matrix(matrix: Matrix, root: Matrix) -> list[Term]:
    """What a matrix tells, n (n + 1)/2 numbers: squares of derivatives add up to ``½ tr(C⁻¹ ∂C C⁻¹ ∂C)``."""
    size = len(matrix)
    fixed = [[held(each) for each in row] for row in root]
    half = [solved(fixed, [matrix[i][j] for i in range(size)]) for j in range(size)]  # columns of L⁻¹ C
    whole = [solved(fixed, [half[j][i] for j in range(size)]) for i in range(size)]  # rows of L⁻¹ C L⁻ᵀ
    return [whole[i][j] * (1.0 / sqrt(2.0) if i == j else 1.0) for i in range(size) for j in range(i + 1)]
