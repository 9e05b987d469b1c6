"""From what an equation says of its errors to the likelihood that least squares take.

Weights that the model decides: with C the covariance of n components, ``-2 log L`` is ``hᵀ C⁻¹ h + log det C``, and the
expected information ``JᵀC⁻¹J + ½ tr(C⁻¹ ∂C C⁻¹ ∂C)`` (Magnus 1978). Both are sums over a triangular root L of C, as
residuals whose squares are the log-determinant. Counts and Student's distribution have signed roots of deviances.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field
from math import sqrt

from mbm.expression.nodes import Expression, Operation
from mbm.expression.terms import Term, chosen, function, held, polynomial, square, square_root
from mbm.problem.likelihoods import tails
from mbm.problem.likelihoods.types import SHIFT, Law, Likelihood, Truncation
from mbm.values import dataclass

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


SERIES = 0.2
"""Relative differences up to which logarithms are series: beyond, they lose one digit at most."""

LEAST = 1e-11
"""Expected counts whose roots have a finite slope down to zero, so that estimates come to rest there if nothing was
counted; of n trials n times that. Rounding of the expectation is less, and no count tells such rates from zero."""

STEEP = 1e5
"""Times as steep as at zero below it: likelihoods of no counts then end within 1e-10 of there."""

_ATANH = [1.0 / (2 * k + 3) for k in range(9)]
"""``(atanh t - t)/t³`` in powers of t²: the last term is below 1e-17 at t = 1/9."""

_LOGARITHM = [1.0 / (2 * k + 1) for k in range(9)]
"""``atanh(t)/t`` in powers of t²."""


def poisson_deviance(counted: Term, mean: Term) -> Term:
    """The signed root of ``2 (μ - y + y log(y/μ))``, of ``2 μ`` for none counted."""
    none = ~(counted > 0.0)
    return chosen(none, _root(2.0 * mean, LEAST), (mean - counted) * square_root(_curvature(counted, mean)))


def binomial_deviance(counted: Term, trials: Term, mean: Term) -> Term:
    """The signed root of ``2 y log(y/μ) + 2 (n - y) log((n - y)/(n - μ))``."""
    off, missed = mean - counted, trials - counted
    own = square(off) * _curvature(counted, mean)
    rest = square(off) * _curvature(missed, trials - mean)
    between = off * square_root(_curvature(counted, mean) + _curvature(missed, trials - mean))
    none = _root(2.0 * mean + rest, LEAST * trials)
    every = -_root(own + 2.0 * (trials - mean), LEAST * trials)
    return chosen(~(counted > 0.0), none, chosen(~(missed > 0.0), every, between))


def student_deviance(ratio: Term, freedom: Term) -> Term:
    """The signed root of ``(ν + 1) log(1 + t²/ν)`` with t the ``ratio`` of the difference to the scale."""
    part = square(ratio) / freedom
    small = part < SERIES
    inner = part / (2.0 + part)
    near = 2.0 / (2.0 + part) * polynomial(_LOGARITHM, square(inner))
    far = function(Operation.LOG, 1.0 + part) / chosen(small, 1.0, part)
    return ratio * square_root((freedom + 1.0) / freedom * chosen(small, near, far))


def poisson_information(mean: Term) -> Term:
    """2 √μ: its derivative is 1/√μ."""
    return 2.0 * _levelled(mean, LEAST)


def binomial_information(trials: Term, mean: Term) -> Term:
    """2 √n atan √(μ/(n - μ)): its derivative is 1/√(μ (1 - μ/n))."""
    hit, missed = (_levelled(each, LEAST * trials) for each in (mean, trials - mean))
    return 2.0 * square_root(trials) * function(Operation.ATAN2, hit, missed)


def student_information(off: Term, scale: Term, freedom: Term) -> Term:
    """The location's: (ν + 1)/(ν + 3) of that of a normal distribution with this scale (Lange et al. 1989)."""
    return square_root((freedom + 1.0) / (freedom + 3.0)) * off / held(scale)


def _root(value: Term, least: Term | float) -> Term:
    """√a of what is above the ``least``; else 0 at 0, and `STEEP` below."""
    share = value / least
    near = _whole_root(least) * chosen(share < 0.0, 1.5 * STEEP, 1.5 - 0.5 * share) * share
    return chosen(value > least, square_root(chosen(value > least, value, least)), near)


def _whole_root(least: Term | float) -> Term | float:
    return square_root(least) if isinstance(least, Term) else sqrt(least)


def _levelled(value: Term, least: Term | float) -> Term:
    """√a of what is above the ``least``; else smooth, and level at 0: what has come to its end tells no more."""
    near = _whole_root(least) * (0.75 + 0.25 * square(value / least))
    return chosen(value > least, square_root(chosen(value > least, value, least)), near)


def _curvature(counted: Term, mean: Term) -> Term:
    """``2 (μ - y + y log(y/μ))/(μ - y)²``, 1/y where the two are equal; anything for y = 0."""
    whole = chosen(counted > 0.0, counted, 1.0)
    apart = (mean - whole) / whole
    small = function(Operation.ABS, apart) < SERIES
    t = apart / (2.0 + apart)
    near = (1.0 - t) - square(1.0 - t) * t * polynomial(_ATANH, square(t))
    far = 2.0 * (apart - function(Operation.LOG, mean / whole)) / chosen(small, 1.0, square(apart))
    return chosen(small, near, far) / whole


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """What is stated: ``off`` is model − measured, ``sigma`` the scale of each component, or the matrix row by row.

    ``reference`` is ``sigma`` with the measurement in place of the model, where the model occurs in it (None: it does
    not), and 1 in place of unknowns that are its own (``scales`` names them). ``inverse``: the matrix is that of
    ``:information``.
    """

    off: tuple[Expression, ...]
    measured: tuple[Expression, ...]
    model: tuple[Expression, ...]
    sigma: tuple[Expression, ...] = ()
    reference: tuple[Expression, ...] | None = None
    matrix: bool = False
    inverse: bool = False
    law: Law = Law.NORMAL
    parameter: Expression | None = None
    truncation: Truncation | None = field(default=None)
    scales: tuple[str, ...] = ()

    @property
    def free(self) -> bool:
        """Whether unknowns of its own decide the scale."""
        return bool(self.scales)


def likelihood(errors: Errors) -> Likelihood:
    """The likelihood of one equation."""
    if errors.law.counts:
        return _counts(errors)
    return _by_matrix(errors) if errors.matrix else _by_scale(errors)


def _counts(errors: Errors) -> Likelihood:
    residuals, information, spread = [], [], []
    for y, mean in zip(_terms(errors.measured), _terms(errors.model), strict=True):
        if errors.law is Law.POISSON or errors.parameter is None:
            residuals.append(poisson_deviance(y, mean))
            information.append(poisson_information(mean))
            spread.append(square_root(function(Operation.MAXIMUM, y, 1.0)))
            continue
        trials = Term(errors.parameter)
        residuals.append(binomial_deviance(y, trials, mean))
        information.append(binomial_information(trials, mean))
        share = (y + 0.5) / (trials + 1.0)
        spread.append(square_root(trials * share * (1.0 - share)))
    return _made(errors, residuals, information, spread)


def _by_scale(errors: Errors) -> Likelihood:
    """Components that are independent, each with a scale of its own."""
    scales = _terms(errors.sigma)
    references = scales if errors.reference is None else [above_zero(r) for r in _terms(errors.reference)]
    residuals, information = [], []
    for off, scale in zip(_terms(errors.off), scales, strict=True):
        whitened, told = _one(errors, off, scale)
        residuals.append(whitened)
        information.append(told)
    if errors.reference is None:
        return _made(errors, residuals, information, scales)
    exact = _where_exact(errors.truncation)
    for off, scale, reference in zip(_terms(errors.off), scales, references, strict=True):
        height, told = _of_scale(errors, off / scale, scale, reference)
        residuals.append(exact(height, SHIFT**0.5))
        information.append(exact(told, 0.0))
    return _made(errors, residuals, information, references)


def _one(errors: Errors, off: Term, scale: Term) -> tuple[Term, Term]:
    """The residual of one component, and what it tells."""
    ratio = off / scale
    if errors.law is Law.STUDENT and errors.parameter is not None:
        freedom = Term(errors.parameter)
        return student_deviance(ratio, freedom), student_information(off, scale, freedom)
    residual, told = ratio, off / held(scale)
    stated = errors.truncation
    if stated is None:
        return residual, told
    if errors.free:
        told = ratio
    if stated.step is not None:
        half = 0.5 * Term(stated.step) / scale
        residual, told = tails.within(ratio, half), tails.within_information(ratio, half)
        if errors.reference is not None:
            told = tails.scaled_information(ratio, half)[0]
    if stated.above is not None:
        beyond = Term(stated.above)
        residual = chosen(beyond, -tails.below(ratio), residual)
        told = chosen(beyond, tails.below_information(ratio), told)
    if stated.below is not None:
        beyond = Term(stated.below)
        residual = chosen(beyond, tails.below(-ratio), residual)
        told = chosen(beyond, tails.below_information(-ratio), told)
    return residual, told


def _of_scale(errors: Errors, ratio: Term, scale: Term, reference: Term) -> tuple[Term, Term]:
    """The residual of a scale that the solve decides, and what a reading tells of it beside the model.

    Beside limits the information is the observed one: log L is concave in ``1/σ`` and ``model/σ`` (Olsen 1978).
    """
    stated = errors.truncation
    if stated is not None and stated.step is not None:
        half = 0.5 * Term(stated.step)
        return tails.highest(half / scale, half / reference), tails.scaled_information(ratio, half / scale)[1]
    told = told_by_scale(scale)
    if stated is not None and errors.free:
        told = scale / held(scale)
    if errors.law is Law.STUDENT and errors.parameter is not None:
        freedom = Term(errors.parameter)
        told = square_root(freedom / (freedom + 3.0)) * told
    return determinant(scale, reference), told


def _where_exact(stated: Truncation | None) -> Callable[[Term, float], Term]:
    """What picks a value for readings that are no limits, another number for limits."""

    def picked(value: Term, other: float) -> Term:
        for limit in (None, None) if stated is None else (stated.below, stated.above):
            if limit is not None:
                value = chosen(Term(limit), other, value)
        return value

    return picked


def _by_matrix(errors: Errors) -> Likelihood:
    """Components with a covariance that the model decides."""
    size = len(errors.off)
    off = _terms(errors.off)
    matrix = square_matrix(_terms(errors.sigma), size)
    root = triangular_root(matrix)
    fixed = [[held(each) for each in row] for row in root]
    residuals = transposed_times(root, off) if errors.inverse else solved(root, off)
    told = transposed_times(fixed, off) if errors.inverse else solved(fixed, off)
    stated = square_matrix(_terms(errors.reference or errors.sigma), size)
    references = [square_root(above_zero(stated[i][i])) for i in range(size)]
    power = -2.0 if errors.inverse else 2.0
    residuals += [determinant(root[i][i], references[i], power) for i in range(size)]
    rest = told_by_matrix(matrix, root)
    residuals += [off[0] * 0.0] * (len(rest) - size)
    spread = [1.0 / each if errors.inverse else each for each in references]
    return _made(errors, residuals, [*told, *rest], spread)


def _made(errors: Errors, residuals: Sequence[Term], information: Sequence[Term], spread: Sequence[Term]) -> Likelihood:
    return Likelihood(
        law=errors.law,
        residuals=tuple(each.node for each in residuals),
        information=tuple(each.node for each in information),
        uncounted=len(residuals) - len(errors.off),
        measured=errors.measured,
        model=errors.model,
        spread=tuple(each.node for each in spread),
        parameter=errors.parameter,
        truncation=errors.truncation,
        scales=errors.scales,
    )


def _terms(nodes: Sequence[Expression]) -> list[Term]:
    return [Term(node) for node in nodes]
