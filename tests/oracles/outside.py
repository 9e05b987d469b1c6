"""What NumPy and SciPy make of a data set of a kind: the numbers that every path of mbm is compared with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tests.oracles.kinds import Answer, Kind, Tables
from tests.oracles.numerics import (
    Minimum,
    Statement,
    along,
    covariance,
    jacobian,
    lossy_covariance,
    minimum,
    polished,
    sizes,
)

FAR = 3e-7
"""Standard deviations between two ends of one minimum. The offset is 1e-10 where the next step ends a solve, ten times
that where Gauss-Newton's steps shrink slowly. Where rounding of the cost ends it, it is √(2⁻⁵² cost): 1e-7 for 45."""

APART = 1e-6
"""Between two standard deviations: to first order in the offset, times the curvature within one standard deviation;
differences of gradients (`numerics.STEP`) leave 1e-9 of second derivatives of losses."""

NEVER = 1e-9
"""Of the objective, by which a minimum of mbm may be larger than SciPy's: far above rounding, far below a σ²."""


@dataclass(frozen=True, kw_only=True)
class Outside:
    """Estimates, standard deviations (NaN at bounds), cost, freedom, factors of unknown noise, objective.

    ``sizes`` are what movements are measured by; ``clear`` as in `Minimum`.
    """

    x: np.ndarray
    sigmas: np.ndarray
    cost: float
    dof: int
    factors: np.ndarray
    objective: float
    sizes: np.ndarray
    clear: bool


_KNOWN: dict[tuple[object, ...], tuple[Kind, Outside]] = {}
"""What was found; a kind is kept as long as its identity is part of a key."""


def outside(kind: Kind, tables: Tables, near: np.ndarray | None = None) -> Outside:
    """The minimum from the stated start; ``near``: from there. Found once for all paths that are compared with it."""
    cells = repr({table: {name: np.asarray(c).tolist() for name, c in each.items()} for table, each in tables.items()})
    key = id(kind), cells, None if near is None else near.tobytes()
    if key not in _KNOWN:
        _KNOWN[key] = kind, _outside(kind, tables, near)
    return _KNOWN[key][1]


def _outside(kind: Kind, tables: Tables, near: np.ndarray | None) -> Outside:
    factors = np.ones(len(kind.groups))
    found = _solved(kind, tables, factors, near)
    while kind.components:
        before = factors
        factors = _components(kind, tables, factors, found)
        found = _solved(kind, tables, factors, found[0])
        if np.abs(factors / before - 1).max() < 1e-11:
            break
    base, statement, end = found
    n = len(kind.start) if kind.moved is None else len(end.x)
    m = len(statement.residuals(end.x))
    dof = m - along(end.holding, len(end.x)).shape[1]
    squares = np.real(statement.residuals(end.x)) ** 2
    if len(factors) == 1 and kind.components:
        squares[kind.rows(tables)[0]] *= factors[0] ** 2  # a single unknown factor counts as 1 in the cost
    matrix = covariance(statement, end) if kind.loss is None else lossy_covariance(statement, end)
    cost = float(squares.sum())
    if kind.groups and not kind.components:
        factors, matrix = np.array([np.sqrt(cost / dof)]), matrix * cost / dof
    return Outside(
        x=(end.x if kind.moved is None else base)[: max(n, len(base) if kind.moved else 0)],
        sigmas=np.where(_at_bound(statement, end), np.nan, np.sqrt(np.diag(matrix)))[:n],
        cost=cost, dof=dof, factors=factors, objective=end.objective, sizes=sizes(statement, end.x)[:n],
        clear=end.clear,
    )  # fmt: skip


def _solved(kind: Kind, tables: Tables, factors: np.ndarray, near) -> tuple[np.ndarray, Statement, Minimum]:
    """The point about which coordinates are taken (none: all zero), the statement, and its minimum."""
    if kind.moved is not None:
        base = np.array(kind.start if near is None else near, dtype=float)
        for _ in range(4):  # until the coordinates about the point are zero
            statement = kind.statement(tables, factors, base)
            end = minimum(statement)
            base = np.real(kind.moved(base, end.x))
        return base, statement, replace(end, x=np.zeros_like(end.x))
    statement = kind.statement(tables, factors)
    if near is not None:
        start = np.concatenate([near, statement.start[len(near) :]])
        return (
            start,
            statement,
            minimum(replace(statement, start=start)) if len(near) < len(start) else polished(statement, start),
        )
    ends = [minimum(replace(statement, start=start)) for start in _starts(kind, statement)]
    return statement.start, statement, min(ends, key=lambda each: each.objective)


def _starts(kind: Kind, statement: Statement) -> Iterator[np.ndarray]:
    """The stated start, and others; for losses that let go of outliers, whose minima are many, a grid about it."""
    yield statement.start
    yield from (np.array(point, dtype=float) for point in kind.elsewhere)
    if kind.many:
        for step in np.ndindex(*(3,) * len(statement.start)):
            yield statement.start + 1.5 * (np.array(step) - 1.0)


def _components(kind: Kind, tables: Tables, factors: np.ndarray, found) -> np.ndarray:
    """Förstner's (1979) next factors: the squares of each group by what its rows keep of their residuals."""
    _, statement, end = found
    rows = jacobian(statement.residuals, end.x)
    basis = np.linalg.qr(rows)[0]
    kept, squares = 1.0 - (basis**2).sum(axis=1), np.real(statement.residuals(end.x)) ** 2
    return factors * np.sqrt([squares[part].sum() / kept[part].sum() for part in kind.rows(tables)])


def _at_bound(statement: Statement, end: Minimum) -> np.ndarray:
    """Coordinates that a bound holds: conditions with one slope, behind the stated constraints."""
    held = np.zeros(len(end.x), dtype=bool)
    for lower, upper in ((statement.lower, statement.upper),):
        for limit in (lower, upper):
            if limit is not None:
                held |= np.abs(end.x - limit) < 1e-9 * sizes(statement, end.x)
    return held


def faults(kind: Kind, tables: Tables, answer: Answer, wanted: Outside) -> list[str]:
    """What is wrong with an answer: empty where all is as it should be."""
    answer = kind.told(answer)
    if answer.status != "converged":
        return [f"status {answer.status}"]
    away = kind.apart(answer.values, wanted.x) / wanted.sizes
    wrong = []
    if np.abs(away).max() > FAR:
        other = outside(kind, tables, answer.values)
        gained = wanted.objective - other.objective
        if gained < -NEVER * (1 + wanted.objective):
            return [f"a worse minimum: {other.objective:.12g}, SciPy's is {wanted.objective:.12g}"]
        away = kind.apart(answer.values, other.x) / other.sizes
        wanted = other
        if np.abs(away).max() > FAR:
            return [f"{np.abs(away).max():.1e} standard deviations from the minimum"]
    if wanted.clear:
        wrong += _of_statistics(answer, wanted)
    return wrong


def _of_statistics(answer: Answer, wanted: Outside) -> list[str]:
    wrong = []
    if answer.sigmas is not None:
        held = np.isnan(wanted.sigmas)
        # What constraints alone determine has a σ of zero, up to rounding of the others; bounds may be among them.
        told = np.isnan(answer.sigmas) | (answer.sigmas <= 1e-9 * wanted.sizes)
        close = np.abs(answer.sigmas - wanted.sigmas) <= APART * wanted.sigmas + 1e-9 * wanted.sizes
        if not np.where(held, told, close).all():
            wrong.append(f"σ {answer.sigmas} for {wanted.sigmas}")
    room = APART * np.sqrt(wanted.cost) + NEVER * wanted.cost + FAR**2
    if answer.cost is not None and abs(answer.cost - wanted.cost) > room:
        wrong.append(f"cost {answer.cost:.12g} for {wanted.cost:.12g}")
    if answer.dof is not None and answer.dof != wanted.dof:
        wrong.append(f"{answer.dof} degrees of freedom for {wanted.dof}")
    # Rounds end where factors change by less than 1e-10; each moves them by a part of what is left.
    named = answer.factors is not None and len(wanted.factors) > 0
    if named and np.abs(answer.factors / wanted.factors - 1).max() > APART:
        wrong.append(f"factors {answer.factors} for {wanted.factors}")
    return wrong
