"""How estimates and derived quantities vary together: their correlations, from one covariance of both. Covariances of
a solution → matrices with names, as far as they are to be kept.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.report.elements import GEOMETRIC, coordinate_factors, element_names
from mbm.report.quantities import FREE, Shown
from mbm.report.types import CovarianceMatrix, DerivedValue, Floats, SolveReport
from mbm.values import dataclass

LARGEST_COVARIANCE = 200
"""Rows of a covariance matrix that is kept without being asked for: 200 rows are about 1 MB of text."""

_LEFT_OUT = "left out for its size; `--covariance full` keeps it"


def estimates_covariance(solution: Solution, shown: Shown, unknown: str | None, *, full: bool) -> CovarianceMatrix:
    """The covariance of the free scalars.

    Scalars held at a bound have NaN: their sigma is none, and 0 would say that they are certain. ``unknown`` says why
    nothing of it is known, if nothing is; ``full`` keeps it however large it is.
    """
    factors = shown.factors[solution.free]
    chosen = tuple(shown.names[p] for p in solution.free.tolist())
    if len(chosen) > LARGEST_COVARIANCE and not full:
        return _matrix(chosen, factors, None, _LEFT_OUT)
    if unknown is not None:
        return _matrix(chosen, factors, np.full((len(chosen),) * 2, np.nan), unknown)
    held = solution.minimum.at_bound != 0
    matrix = _whole(solution)
    if matrix is None:
        return _matrix(chosen, factors, None, f"{len(chosen)} scalars are too many")
    reason = _reason(matrix, solution)
    if not bool(held.any()):
        return _matrix(chosen, factors, matrix, reason)
    return _matrix(chosen, factors, np.where(np.logical_or.outer(held, held), np.nan, matrix), reason)


def _reason(matrix: Floats, solution: Solution) -> str | None:
    """Why numbers are missing, where the method is the cause; and the data, if variances are missing too."""
    reason = solution.covariance.reason
    return f"{reason}, or {FREE}" if reason is not None and bool(np.isnan(np.diag(matrix)).any()) else reason


def _whole(solution: Solution) -> Floats | None:
    """The covariance matrix of all coordinates; None where it would be too large."""
    if solution.covariance.inverse is None:
        matrix = solution.covariance.matrix
        return matrix if len(matrix) == len(solution.free) else None
    # Loaded by sparse problems only, so that the others start at once.
    from mbm.estimation.uncertainty.sparse import whole_covariance

    return whole_covariance(solution.covariance)


def derived_covariance(
    solution: Solution, values: tuple[DerivedValue, ...], unknown: str | None, *, full: bool
) -> CovarianceMatrix | None:
    """The common covariance of the derived quantities; None where there are none. Parameters as above."""
    if not values:
        return None
    names: list[str] = []
    factors: list[float] = []
    for value in values:
        quantity = value.quantity
        of_quantity = element_names(quantity, value.keys)
        names.extend(of_quantity)
        by_scalar = [quantity.scale.factor] * len(of_quantity)
        if quantity.kind in GEOMETRIC:
            tangent = coordinate_factors(quantity).tolist()
            by_scalar = tangent * (len(of_quantity) // len(tangent))
        factors.extend(by_scalar)
    chosen, by_row = tuple(names), np.array(factors)
    if len(chosen) > LARGEST_COVARIANCE and not full:
        return _matrix(chosen, by_row, None, _LEFT_OUT)
    if unknown is not None:
        return _matrix(chosen, by_row, np.full((len(chosen),) * 2, np.nan), unknown)
    if solution.derived_covariance is None:
        return _matrix(chosen, by_row, None, f"{len(chosen)} scalars are too many")
    return _matrix(chosen, by_row, solution.derived_covariance, solution.covariance.reason)


def _matrix(names: tuple[str, ...], factors: Floats, matrix: Floats | None, reason: str | None) -> CovarianceMatrix:
    return CovarianceMatrix(names=names, factors=tuple(factors.tolist()), matrix=matrix, reason=reason)


LARGEST = 10 * LARGEST_COVARIANCE
"""Numbers whose correlations are made: 32 MB."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Correlation:
    """Correlations of named scalars: ``matrix`` (n, n), 1 along the diagonal, NaN where there is no deviation.

    ``matrix`` is None where it was left out for its size; ``reason`` then says so, or why derived quantities are left
    out: with filters, and of results that were pickled.
    """

    names: tuple[str, ...]
    matrix: Floats | None
    reason: str | None = None

    def of(self, first: str, second: str) -> float:
        """The correlation of two scalars. Raises KeyError: nothing is called so, LookupError: it was left out."""
        if self.matrix is None:
            raise LookupError(self.reason)
        for name in (first, second):
            if name not in self.names:
                raise KeyError(name)
        return float(self.matrix[self.names.index(first), self.names.index(second)])


def correlation_of(solve: SolveReport) -> Correlation | None:
    """The correlations of the estimates of a solve, then of its derived quantities; None without a covariance."""
    own, derived = solve.covariance, solve.derived_covariance
    if own is None:
        return None
    names = (*own.names, *(() if derived is None else derived.names))
    if len(names) > LARGEST:
        return Correlation(names=names, matrix=None, reason=f"{len(names)} numbers are too many")
    if own.matrix is None or (derived is not None and derived.matrix is None):
        reason = own.reason if own.matrix is None else None if derived is None else derived.reason
        return Correlation(names=names, matrix=None, reason=reason)
    if derived is None or derived.matrix is None:
        return Correlation(names=names, matrix=_normalised(own.matrix))
    both = _between(solve)
    if both is None:
        reason = "derived quantities are left out: how they vary with the estimates is not known"
        return Correlation(names=own.names, matrix=_normalised(own.matrix), reason=reason)
    return Correlation(names=names, matrix=_normalised(np.block([[own.matrix, both], [both.T, derived.matrix]])))


@np.errstate(all="ignore")
def _normalised(matrix: Floats) -> Floats:
    deviations = np.sqrt(np.diag(matrix))
    deviations = np.where(deviations > 0.0, deviations, np.nan)
    found = np.clip(matrix / np.outer(deviations, deviations), -1.0, 1.0)
    found[np.diag_indices_from(found)] = np.where(np.isfinite(deviations), 1.0, np.nan)
    return np.asarray(found)


def _between(solve: SolveReport) -> Floats | None:
    """The covariance (n, k) of estimates with derived quantities; None where it is not known."""
    if solve.made_from is None:
        return None
    _, solution = solve.made_from()
    gradients = [one.gradient for one in solution.derived]
    if any(gradient is None for gradient in gradients) or solution.influence is None:
        return None
    gradient = np.vstack([each for each in gradients if each is not None])
    own = _times(solution, gradient)
    moves = list(_moves(solve, solution))
    if moves:
        free, derived = (np.stack([pair[side] for pair in moves]) for side in (0, 1))
        own = own + free.T @ derived
    return own


@np.errstate(all="ignore")
def _times(solution: Solution, gradient: Floats) -> Floats:
    """The covariance of the estimates times the gradient (k, n) of derived quantities, (n, k)."""
    estimated = solution.covariance
    if estimated.inverse is None:
        return np.asarray(estimated.factor @ (gradient @ estimated.factor).T)
    # Loaded by sparse problems only, so that the others start at once.
    from mbm.sparse.inverse import inverse_of

    return inverse_of(estimated.inverse).solve(gradient.T) * estimated.variance


def _moves(solve: SolveReport, solution: Solution) -> Iterator[tuple[Floats, Floats]]:
    """What each uncertain constant does to the free coordinates (n,), and to the derived numbers (k,)."""
    free = {name: place for place, name in enumerate(solve.covariance.names)} if solve.covariance is not None else {}
    for constant in solve.considered:
        every = np.zeros(len(solution.free))
        for estimate, moves in zip(solve.estimates, constant.estimates, strict=True):
            for name, move in zip(element_names(estimate.quantity, estimate.keys), np.ravel(moves), strict=True):
                if name in free:
                    every[free[name]] = move
        yield every, np.concatenate([np.ravel(moves) for moves in constant.derived])
