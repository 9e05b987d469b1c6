"""From what an equation says of its errors to the likelihood that least squares take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field

from mbm.expression.nodes import Expression, Operation
from mbm.expression.terms import Term, chosen, function, held, square_root
from mbm.problem.likelihoods import deviances, tails, weights
from mbm.problem.likelihoods.types import SHIFT, Law, Likelihood, Truncation
from mbm.values import dataclass


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
            residuals.append(deviances.poisson(y, mean))
            information.append(deviances.poisson_information(mean))
            spread.append(square_root(function(Operation.MAXIMUM, y, 1.0)))
            continue
        trials = Term(errors.parameter)
        residuals.append(deviances.binomial(y, trials, mean))
        information.append(deviances.binomial_information(trials, mean))
        share = (y + 0.5) / (trials + 1.0)
        spread.append(square_root(trials * share * (1.0 - share)))
    return _made(errors, residuals, information, spread)


def _by_scale(errors: Errors) -> Likelihood:
    """Components that are independent, each with a scale of its own."""
    scales = _terms(errors.sigma)
    references = scales if errors.reference is None else [weights.above_zero(r) for r in _terms(errors.reference)]
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
        return deviances.student(ratio, freedom), deviances.student_information(off, scale, freedom)
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
    told = weights.told_by_scale(scale)
    if stated is not None and errors.free:
        told = scale / held(scale)
    if errors.law is Law.STUDENT and errors.parameter is not None:
        freedom = Term(errors.parameter)
        told = square_root(freedom / (freedom + 3.0)) * told
    return weights.determinant(scale, reference), told


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
    matrix = weights.square_matrix(_terms(errors.sigma), size)
    root = weights.triangular_root(matrix)
    fixed = [[held(each) for each in row] for row in root]
    residuals = weights.transposed_times(root, off) if errors.inverse else weights.solved(root, off)
    told = weights.transposed_times(fixed, off) if errors.inverse else weights.solved(fixed, off)
    stated = weights.square_matrix(_terms(errors.reference or errors.sigma), size)
    references = [square_root(weights.above_zero(stated[i][i])) for i in range(size)]
    power = -2.0 if errors.inverse else 2.0
    residuals += [weights.determinant(root[i][i], references[i], power) for i in range(size)]
    rest = weights.told_by_matrix(matrix, root)
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
