"""Covariances of a solution → matrices with names, as far as they are to be kept."""

from __future__ import annotations

import numpy as np

from mbm.estimation.search.solution import Solution
from mbm.report.elements import GEOMETRIC, coordinate_factors, element_names
from mbm.report.quantities import FREE, Shown
from mbm.report.types import CovarianceMatrix, DerivedValue, Floats

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
