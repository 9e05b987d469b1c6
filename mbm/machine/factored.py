"""Small matrices in straight-line programs: products, triangular factors and what is solved with them.

Elements are values of a `Merged` program; what is known to be `ZERO` costs nothing. Matrices are lists of lines.
"""

from __future__ import annotations

from collections.abc import Sequence

from mbm.machine.merged import ZERO, Merged
from mbm.machine.program import Operator

Vector = list[int]
Matrix = list[list[int]]


def transposed(matrix: Matrix) -> Matrix:
    """Lines for columns."""
    return [list(line) for line in zip(*matrix, strict=True)]


class Factored:
    """Linear algebra in one program."""

    def __init__(self, merged: Merged) -> None:
        self._merged = merged

    def plus(self, a: int, b: int) -> int:
        """``a + b``."""
        return self._merged.sum(a, b)

    def minus(self, a: int, b: int) -> int:
        """``a − b``."""
        if b == ZERO:
            return a
        return self.negative(b) if a == ZERO else self._merged.applied(Operator.SUB, a, b)

    def negative(self, a: int) -> int:
        """``−a``."""
        return a if a == ZERO else self._merged.applied(Operator.NEG, a)

    def times(self, a: int, b: int) -> int:
        """``a b``."""
        return ZERO if ZERO in (a, b) else self._merged.applied(Operator.MUL, a, b)

    def over(self, a: int, b: int) -> int:
        """``a / b``."""
        return a if a == ZERO else self._merged.applied(Operator.DIV, a, b)

    def dot(self, a: Sequence[int], b: Sequence[int]) -> int:
        """``Σ a b``."""
        found = ZERO
        for one, other in zip(a, b, strict=True):
            found = self.plus(found, self.times(one, other))
        return found

    def largest(self, values: Sequence[int]) -> int:
        """The largest magnitude, the constant 0 of none; NaN is not seen beside others."""
        sizes = [self._merged.applied(Operator.ABS, value) for value in values if value != ZERO]
        found = sizes[0] if sizes else self._merged.constant(0.0)
        for size in sizes[1:]:
            found = self._merged.applied(Operator.MAX, found, size)
        return found

    def factors(self, matrix: Matrix) -> tuple[Matrix, Vector]:
        """``L`` with ones on its diagonal (which are not there) and the pivots ``d`` of ``A = L diag(d) Lᵀ``.

        ``matrix`` is symmetric; its lower triangle is read. A pivot of 0 leaves what is not finite.
        """
        n = len(matrix)
        lower: Matrix = [[ZERO] * n for _ in range(n)]
        pivots: Vector = []
        for j in range(n):
            scaled = [self.times(lower[j][k], pivots[k]) for k in range(j)]
            pivots.append(self.minus(matrix[j][j], self.dot(lower[j][:j], scaled)))
            for i in range(j + 1, n):
                left = self.minus(matrix[i][j], self.dot(lower[i][:j], scaled))
                lower[i][j] = self.over(left, pivots[j])
        return lower, pivots

    def solved(self, factors: tuple[Matrix, Vector], right: Sequence[int]) -> Vector:
        """``A⁻¹ b`` with the `factors` of A."""
        lower, pivots = factors
        n = len(pivots)
        found: Vector = []
        for i in range(n):
            found.append(self.minus(right[i], self.dot(lower[i][:i], found)))
        found = [self.over(value, pivot) for value, pivot in zip(found, pivots, strict=True)]
        for i in reversed(range(n)):
            above = [lower[j][i] for j in range(i + 1, n)]
            found[i] = self.minus(found[i], self.dot(above, found[i + 1 :]))
        return found

    def root(self, matrix: Matrix) -> Matrix:
        """The lower triangle L of the symmetric ``A = L Lᵀ``; not finite where A is not positive definite."""
        lower, pivots = self.factors(matrix)
        roots = [pivot if pivot == ZERO else self._merged.applied(Operator.SQRT, pivot) for pivot in pivots]
        n = len(roots)
        return [
            [roots[i] if i == j else self.times(lower[i][j], roots[j]) if j < i else ZERO for j in range(n)]
            for i in range(n)
        ]

    def lower_solved(self, lower: Matrix, right: Sequence[int]) -> Vector:
        """``L⁻¹ b``."""
        found: Vector = []
        for i, line in enumerate(lower):
            found.append(self.over(self.minus(right[i], self.dot(line[:i], found)), line[i]))
        return found
