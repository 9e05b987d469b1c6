"""Corrections of measured values, eliminated in a straight line: one program for a row's residuals and their slopes.

For fixed unknowns the smallest corrections that meet the equations of a row are found by Newton's method (Nocedal and
Wright 2006, ch. 18) from the measured values on, so many steps as nearly every row needs; a row that needs more care
has no finite value. `mbm.equations.corrections.elimination` says what is minimised, and why residuals and slopes serve;
its searches take over where this has no value. There are no loops and branches, so that rows go through in vectors.
"""

from __future__ import annotations

from collections.abc import Sequence

from mbm.machine.merged import ZERO, Merged
from mbm.machine.program import Operator, Program
from mbm.values import dataclass

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


STEPS = 6
"""Newton's steps, of which the last must be next to nothing; three or four are the rule."""

SETTLED = 1e-8
"""A last step shorter than this, beside 1 + |u| standard deviations: its square is below rounding."""

SHRINKING = 0.5
"""Each step is shorter than this share of the one before: Newton's method goes well."""

ROUNDING = 1e-10
"""… or shorter than this, beside 1 + |u|, where rounding decides."""

LEAST_PIVOT = 0.1
"""Of the cost's second derivative ``I + W`` by the corrections: far from the centres of curvature, where a foot is the
nearest point and no other one is near."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """The equations of a row with k ``outputs`` in ``variables`` and ``parameters``, c of them (``columns``) uncertain.

    ``equations`` gives the outputs, then the nonzeros of their derivatives by the unknowns, at ``derivatives`` (output,
    tangent). ``corrections`` has a multiplier λ for each output behind the same inputs, and gives the outputs, then
    those of their ``slopes`` (output, column) by the uncertain parameters, then of the ``curvature`` (column, column)
    of λᵀh. Output i is whitened to the sum of weight times output over ``whitening[i]``, with ``weights`` in all.
    """

    equations: Program
    corrections: Program
    variables: int
    parameters: int
    columns: tuple[int, ...]
    outputs: int
    derivatives: tuple[tuple[int, int], ...]
    slopes: tuple[tuple[int, int], ...]
    curvature: tuple[tuple[int, int], ...]
    whitening: tuple[tuple[tuple[int, int], ...], ...]
    weights: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Eliminated:
    """The program of the residuals alone, and the one with the nonzeros of their derivatives behind them.

    Inputs are those of the equations, then the standard deviations (c) of the uncertain parameters, the weights, and
    for each whitened output 1 where it has noise of its own, else 0. The residuals have variance 1.
    """

    values: Program
    jacobian: Program
    derivatives: tuple[tuple[int, int], ...]


def eliminated(of: Conditions) -> Eliminated:
    """The corrections eliminated."""
    making = _Making(of)
    values, factor = making.residuals()
    slopes = making.slopes(factor)
    places = tuple((output, tangent) for output, line in enumerate(slopes) for tangent in sorted(line))
    nonzeros = [slopes[output][tangent] for output, tangent in places]
    return Eliminated(
        values=making.merged.program(values),
        jacobian=making.merged.program([*values, *nonzeros]),
        derivatives=places,
    )


class _Making:
    """The program as it grows; local to one call."""

    def __init__(self, of: Conditions) -> None:
        self._of = of
        width = of.variables + of.parameters
        c, k = len(of.columns), of.outputs
        self.merged = Merged(width + c + of.weights + k)
        self._algebra = Factored(self.merged)
        self._inputs = list(range(width))
        self._sigma = list(range(width, width + c))
        self._weights = range(width + c, width + c + of.weights)
        self._own = list(range(width + c + of.weights, width + c + of.weights + k))
        self._fine: list[int] = []
        self._corrections: Vector = [ZERO] * c

    def residuals(self) -> tuple[Vector, Matrix]:
        """The residuals, infinite or NaN where the steps do not lead to a foot, and what the slopes are divided by."""
        algebra = self._algebra
        multipliers: Vector = [ZERO] * self._of.outputs
        last = None
        for number in range(STEPS if self._of.curvature else 1):
            values, slopes, curvature = self._local(multipliers)
            target, multipliers = self._step(values, slopes, curvature if number else None)
            moves = [algebra.minus(new, old) for new, old in zip(target, self._corrections, strict=True)]
            self._corrections = target
            last = self._shrinks(algebra.largest(moves), last)
        if self._of.curvature and last is not None:
            self._fine.append(self._below(last, SETTLED))
        values, slopes, _ = self._local(multipliers)
        misclosures = [
            algebra.minus(v, algebra.dot(line, self._corrections)) for v, line in zip(values, slopes, strict=True)
        ]
        factor = algebra.root(self._spread(slopes, transposed(slopes)))
        return algebra.lower_solved(factor, [self._checked(value) for value in misclosures]), factor

    def slopes(self, factor: Matrix) -> list[dict[int, int]]:
        """The derivatives of the residuals by tangent, output by output."""
        of, algebra = self._of, self._algebra
        found = self.merged.run(of.equations, self._corrected())[of.outputs :]
        tangents = sorted({tangent for _, tangent in of.derivatives})
        lines: list[dict[int, int]] = [{} for _ in range(of.outputs)]
        for tangent in tangents:
            plain: Vector = [ZERO] * of.outputs
            for (output, column), value in zip(of.derivatives, found, strict=True):
                if column == tangent:
                    plain[output] = value
            for line, value in zip(lines, algebra.lower_solved(factor, self._whitened(plain)), strict=True):
                if value != ZERO:
                    line[tangent] = value
        return lines

    def _corrected(self) -> list[int]:
        """The inputs of the equations with corrected values."""
        inputs = list(self._inputs)
        algebra = self._algebra
        for column, sigma, correction in zip(self._of.columns, self._sigma, self._corrections, strict=True):
            place = self._of.variables + column
            inputs[place] = algebra.plus(inputs[place], algebra.times(sigma, correction))
        return inputs

    def _local(self, multipliers: Vector) -> tuple[Vector, Matrix, Matrix]:
        """Whitened values (k,), slopes (k, c) and curvature (c, c) by corrections in standard deviations."""
        of, algebra = self._of, self._algebra
        c = len(of.columns)
        given = [self._constant_of(value) for value in self._unwhitened(multipliers)]
        found = self.merged.run(of.corrections, (*self._corrected(), *given))
        plain: Matrix = [[ZERO] * c for _ in range(of.outputs)]
        nonzeros = found[of.outputs :]
        for (output, column), value in zip(of.slopes, nonzeros, strict=False):
            plain[output][column] = algebra.times(value, self._sigma[column])
        curvature: Matrix = [[ZERO] * c for _ in range(c)]
        for (row, column), value in zip(of.curvature, nonzeros[len(of.slopes) :], strict=True):
            scale = algebra.times(self._sigma[row], self._sigma[column])
            curvature[row][column] = algebra.times(value, scale)
        slopes = transposed([self._whitened(line) for line in transposed(plain)])
        return self._whitened(found[: of.outputs]), slopes, curvature

    def _step(self, values: Vector, slopes: Matrix, curvature: Matrix | None) -> tuple[Vector, Vector]:
        """Corrections u and multipliers λ: ``M u + Bᵀλ = W u₀``, ``h + B (u − u₀) = D λ`` with ``M = I + W``."""
        algebra, here = self._algebra, self._corrections
        if curvature is None:  # no multipliers yet
            multipliers = self._solved(self._spread(slopes, transposed(slopes)), values)
            return [algebra.negative(algebra.dot(line, multipliers)) for line in transposed(slopes)], multipliers
        one = self.merged.constant(1.0)
        second = [
            [algebra.plus(one, value) if i == j else value for j, value in enumerate(line)]
            for i, line in enumerate(curvature)
        ]
        factors = algebra.factors(second)
        bound = self.merged.constant(LEAST_PIVOT)
        self._fine += [self.merged.applied(Operator.LESS, bound, pivot) for pivot in factors[1]]
        kept = algebra.solved(factors, [algebra.dot(line, here) for line in curvature])
        turned = transposed([algebra.solved(factors, line) for line in slopes])
        gaps = [algebra.minus(new, old) for new, old in zip(kept, here, strict=True)]
        left = [algebra.plus(value, algebra.dot(line, gaps)) for value, line in zip(values, slopes, strict=True)]
        multipliers = self._solved(self._spread(slopes, turned), left)
        target = [algebra.minus(k, algebra.dot(line, multipliers)) for k, line in zip(kept, turned, strict=True)]
        return target, multipliers

    def _spread(self, slopes: Matrix, turned: Matrix) -> Matrix:
        """``B M⁻¹ Bᵀ`` with the noise of the equations' own, ``turned`` being ``M⁻¹ Bᵀ``."""
        algebra = self._algebra
        columns = transposed(turned)
        found = [[algebra.dot(line, column) for column in columns] for line in slopes]
        for i, own in enumerate(self._own):
            found[i][i] = algebra.plus(found[i][i], own)
        return found

    def _solved(self, matrix: Matrix, right: Vector) -> Vector:
        return self._algebra.solved(self._algebra.factors(matrix), right)

    def _shrinks(self, size: int, last: int | None) -> int:
        """The size of a step, which is demanded to be well below the last one."""
        if last is not None:
            merged = self.merged
            half = merged.applied(Operator.MUL, merged.constant(SHRINKING), last)
            shorter = merged.applied(Operator.LESS, size, half)
            self._fine.append(merged.applied(Operator.OR, shorter, self._below(size, ROUNDING)))
        return size

    def _below(self, size: int, share: float) -> int:
        """Whether a size is at most a share of 1 + |u|."""
        merged = self.merged
        wide = merged.applied(Operator.ADD, merged.constant(1.0), self._algebra.largest(self._corrections))
        return merged.applied(Operator.LESS_EQUAL, size, merged.applied(Operator.MUL, merged.constant(share), wide))

    def _checked(self, value: int) -> int:
        """The value, over 0 where something demanded does not hold."""
        if not self._fine or value == ZERO:
            return value
        merged = self.merged
        every = self._fine[0]
        for other in self._fine[1:]:
            every = merged.applied(Operator.AND, every, other)
        return merged.applied(Operator.DIV, value, merged.applied(Operator.SELECT, every, merged.constant(1.0)))

    def _whitened(self, plain: Sequence[int]) -> Vector:
        """Values of the outputs with their noise divided out."""
        return [
            self.merged.weighted([(self._weights[w], plain[output]) for w, output in terms])
            for terms in self._of.whitening
        ]

    def _unwhitened(self, multipliers: Vector) -> Vector:
        """Multipliers of the outputs as they are."""
        found: Vector = [ZERO] * self._of.outputs
        for terms, multiplier in zip(self._of.whitening, multipliers, strict=True):
            for weight, output in terms:
                term = self._algebra.times(self._weights[weight], multiplier)
                found[output] = self._algebra.plus(found[output], term)
        return found

    def _constant_of(self, value: int) -> int:
        return self.merged.constant(0.0) if value == ZERO else value
