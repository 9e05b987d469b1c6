"""How estimates and derived quantities vary together: their correlations, from one covariance of both."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.report.covariances import LARGEST_COVARIANCE
from mbm.report.elements import element_names
from mbm.report.types import Floats, SolveReport
from mbm.values import dataclass

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
