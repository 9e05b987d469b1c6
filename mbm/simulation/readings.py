"""What readings of a stated distribution are drawn as: counts, long tails, rounded values, limits that stay."""

from __future__ import annotations

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Column, Expression
from mbm.problem.likelihoods.types import Law, Likelihood
from mbm.problem.types import Equation
from mbm.simulation.places import Rows


def drawn_off(equation: Equation, rows: Rows, replaced: dict[str, Values], spread: Floats, normal: Floats) -> Floats:
    """Measured − model (rows, k), from standard normal numbers (rows, k); ``spread`` (rows, k, k) is L with L Lᵀ = C.

    A count is the quantile of its distribution that the normal number is of its own, so that each row has its draw.
    """
    errors = equation.likelihood
    if errors is None or (errors.law is Law.NORMAL and errors.truncation is None):
        return np.asarray(np.einsum("rij,rj->ri", spread, normal))
    model = _numbers(errors.model, rows, replaced)
    if errors.law is not Law.NORMAL:
        return _of_law(errors, rows, replaced, model, np.einsum("rii->ri", spread), normal)
    off = np.einsum("rij,rj->ri", spread, normal)
    step = errors.truncation.step if errors.truncation is not None else None
    if step is None:
        return np.asarray(off)
    width = _numbers((step,), rows, replaced)
    return np.asarray(width * np.rint((model + off) / width) - model)


def limits(equation: Equation, rows: Rows) -> Mask:
    """Which rows (rows,) say a limit: nothing is drawn for these."""
    stated = None if equation.likelihood is None else equation.likelihood.truncation
    found = np.zeros(rows.count, dtype=bool)
    for limit in () if stated is None else (stated.below, stated.above):
        if limit is not None:
            found |= _numbers((limit,), rows, {})[:, 0] != 0.0
    return found


def counts_itself(equation: Equation) -> bool:
    """Whether a column holds the count, so that it is a whole number to the last digit."""
    errors = equation.likelihood
    return errors is not None and errors.law.counts and all(isinstance(each, Column) for each in errors.measured)


def _of_law(
    errors: Likelihood, rows: Rows, replaced: dict[str, Values], model: Floats, scale: Floats, normal: Floats
) -> Floats:
    from scipy.stats import binom, norm, poisson, t

    share = norm.cdf(normal)
    if errors.law is Law.POISSON:
        return np.asarray(poisson.ppf(share, model) - model)
    parameter = np.zeros((rows.count, 1))
    if errors.parameter is not None:
        parameter = _numbers((errors.parameter,), rows, replaced)
    if errors.law is Law.BINOMIAL:
        return np.asarray(binom.ppf(share, parameter, model / parameter) - model)
    return np.asarray(scale * t.ppf(share, parameter))


def _numbers(nodes: tuple[Expression, ...], rows: Rows, replaced: dict[str, Values]) -> Floats:
    """Numbers (rows, k) at the true values."""
    found = np.empty((rows.count, len(nodes)))
    for j, column in enumerate(evaluate(nodes, rows.lookup(replaced))):
        found[:, j] = column
    return found
