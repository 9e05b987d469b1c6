"""Noise that rows share, drawn: common errors, correlation along the rows, a covariance that was estimated. What
readings of a stated distribution are drawn as: counts, long tails, rounded values, limits that stay.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbm.equations.structure import Chains
from mbm.equations.structuring import chained, correlation_root, stated_rho
from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.expression.nodes import Column, Expression
from mbm.problem.checks import used_rows
from mbm.problem.likelihoods.types import Law, Likelihood
from mbm.problem.naming import key_text
from mbm.problem.previous import chains
from mbm.problem.rows import row_values
from mbm.problem.types import Block, Equation
from mbm.simulation.noise import stream
from mbm.simulation.rows import Rows
from mbm.simulation.types import KnownNoise


def correlated(block: Block, known: KnownNoise, rows: Rows, normal: Floats, numbers: Indices, sets: Indices) -> Floats:
    """Standard normal ``normal`` (N, k) with the correlation along the rows in use.

    ``numbers`` (rows of the table,) say which of them each row of the table takes, ``sets`` which data set it is of.
    """
    table = rows.table
    if block.structure.correlation is None or table is None:
        return normal
    if block.structure.matrix is not None:
        return _by_matrix(block, rows, normal, numbers, sets)
    stated = None if block.structure.unknown else stated_rho(block.shared[-1], rows.tables)
    rho = (known.rho or 0.0) if stated is None else stated
    mask = used_rows(block, rows.tables)
    used = np.arange(len(table)) if mask is None else np.flatnonzero(mask)
    chain, place = chains(table)
    order, gaps = chained(place[used], chain[used], sets[used])
    found, mine = normal.copy(), numbers[used][order]
    found[mine] = Chains(gaps=gaps, rho=rho).correlated(normal[mine])
    return found


def _by_matrix(block: Block, rows: Rows, normal: Floats, numbers: Indices, sets: Indices) -> Floats:
    """The same of a matrix that is stated for all rows."""
    table = rows.table
    if table is None or block.structure.matrix is None:
        return normal
    mask = used_rows(block, rows.tables)
    used = np.arange(len(table)) if mask is None else np.flatnonzero(mask)
    found = normal.copy()
    for one in np.unique(sets[used]):
        mine = used[sets[used] == one]
        lower = correlation_root(block, rows.tables[block.structure.matrix], table, mine)
        found[numbers[mine]] = lower @ normal[numbers[mine]]
    return found


def root_of(known: KnownNoise, size: int) -> Floats | None:
    """The Cholesky factor (k, k) of the covariance of a row's components, where it is known."""
    if known.covariance is None or known.covariance.shape != (size, size):
        return None
    try:
        return np.asarray(np.linalg.cholesky(known.covariance))
    except np.linalg.LinAlgError:
        return None


def common_errors(block: Block, rows: Rows, seeds: Sequence[int], sets: Indices, components: slice) -> Floats | float:
    """The errors (rows, k) of the rows at hand that others share; ``sets`` (rows,) are their data sets."""
    if rows.table is None or rows.positions is None or not block.structure.per:
        return 0.0
    total: Floats | float = 0.0
    for number, (column, form) in enumerate(zip(block.structure.per, block.shared, strict=False)):
        cells = rows.table.keys(column)
        drawn: dict[tuple[int, object], float] = {}
        variates = np.empty(len(rows.positions))
        for i, (position, which) in enumerate(zip(rows.positions.tolist(), sets.tolist(), strict=True)):
            key = which, cells[position]
            if key not in drawn:
                rng = stream(seeds[which], block.name, "common", number, key_text(cells[position]))
                drawn[key] = float(rng.standard_normal())
            variates[i] = drawn[key]
        total = total + row_values(form, rows.tables)[rows.positions][:, components] * variates[:, None]
    return total


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
