"""Constants with an uncertainty: considered, not adjusted (Bierman 1977, Factorization Methods, chapter 8).

The estimates are those of the values. Solved again with a constant moved by a share of its standard deviation u to both
sides, half of the difference of the answers, divided by that share, is S u, with S the derivative of everything that is
reported; the covariances gain (S u)(S u)ᵀ, which holds what the constant does to estimates, to derived quantities, and
to both together.

The residuals e move by D, the constants' part of them that the unknowns do not take up: they have the covariance
M + D Dᵀ, with M the projector on what unknowns leave, and e in its range. So (I + D Dᵀ)^-½ e has the covariance M that
residuals have without constants, and is tested in their place; its squares are χ² with the degrees of freedom of the
fit. Unknown noise is estimated from them as they are, by the restricted likelihood of M + D Dᵀ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from mbm.equations.spreads import Freedom, Moved
from mbm.equations.types import NoiseState
from mbm.estimation.settings import Moves
from mbm.estimation.trust.plausibility import OF_RESIDUALS
from mbm.estimation.uncertainty.derived import PINNED
from mbm.estimation.uncertainty.student import coverage_factor
from mbm.problem.tables import CellKey, Table
from mbm.report.elements import difference, element_names
from mbm.report.quantities import value_elsewhere
from mbm.report.spreads import ConsideredConstant, Ends, Floats, Spread
from mbm.report.types import CovarianceMatrix, DerivedValue, Estimate, Examined, Result, SolveReport
from mbm.solver.chi_square import chi_square_tail

MOVED = 0.01
"""Share of its standard deviation by which a constant is moved: what is not linear in it shrinks ten thousandfold, what
a search leaves of a deviation, 1e-8 or less, grows a hundredfold."""

LEAST_MOVED = 1e-6
"""Share of its value by which a constant is moved at least, but no more than a standard deviation, for the rounding."""

Pair = tuple[SolveReport, SolveReport]
"""A solve with a constant below and above its value."""


def share_of(constant: ConsideredConstant) -> float:
    """The share of its standard deviation by which a constant is moved to both sides."""
    return float(min(max(MOVED, LEAST_MOVED * abs(constant.value) / constant.sigma), 1.0))


def considered(result: Result, moved: Sequence[tuple[ConsideredConstant, Result, Result]]) -> Result:
    """The ``result`` with the uncertainties of constants in it.

    ``moved`` has each number of a constant, and the results of the same solves with it `share_of` below and above.
    """
    if not moved:
        return result
    solves = tuple(
        _solve(solve, [(constant, (below.solves[i], above.solves[i])) for constant, below, above in moved])
        for i, solve in enumerate(result.solves)
    )
    return replace(result, solves=solves)


def moves_of(result: Result, moved: Sequence[tuple[ConsideredConstant, Result, Result]]) -> Moves:
    """What a standard deviation of each constant does to the residuals of each solve, as the noise is estimated beside.

    ``moved`` as for `considered`.
    """
    found: dict[tuple[tuple[str, CellKey], ...], Floats] = {}
    shares = shares_of([constant for constant, _, _ in moved])
    for i, solve in enumerate(result.solves):
        both = (result, *(each for _, *pair in moved for each in pair))
        own, *others = (_as_stated(each.solves[i], solve) for each in both)
        if own is not None and all(each is not None and each.shape == own.shape for each in others):
            sides = np.stack([each for each in others if each is not None]).reshape(len(moved), 2, -1)
            found[tuple(solve.key.items())] = (sides[:, 1] - sides[:, 0]) / (2.0 * shares[:, None])
    return lambda key: found.get(tuple(key.items()))


def _as_stated(solve: SolveReport, there: SolveReport) -> Floats | None:
    """The residuals of a solve divided by the noise as it is stated in another (`_restated`); None where it is not
    trusted, or some are out.
    """
    if not solve.status.trusted or solve.robust_cost is not None or solve.made_from is None:
        return None
    solution, residuals = solve.made_from()[1], _restated(solve, there)
    if solution.factors is None:
        return residuals
    return residuals * solution.factors if residuals.shape == solution.factors.shape else None


@np.errstate(all="ignore")
def _restated(solve: SolveReport, there: SolveReport) -> Floats:
    """The residuals (m,) of a solve, divided by what is stated as their noise ``there``, where constants are others."""
    if solve.made_from is None or there.made_from is None:
        return np.zeros(0)
    solution, other = solve.made_from()[1], there.made_from()[1]
    residuals = solution.minimum.residuals.copy()
    if len(residuals) != sum(group.count for group in solution.groups):
        return residuals
    for group, stated in zip(solution.groups, other.groups, strict=True):
        lines = residuals[group.first : group.first + group.count].reshape(group.rows, -1)
        for mine, others in zip(group.whiteners, stated.whiteners, strict=True):
            part, used, wanted = lines[:, mine.first : mine.last], mine.weights, others.weights
            if np.array_equal(used, wanted):
                continue
            if used.ndim == 2:
                part *= np.where(used == wanted, 1.0, wanted / used)
            else:
                part[...] = np.einsum("rij,rjk,rk->ri", wanted, np.linalg.pinv(used), part)
    return residuals


def _solve(solve: SolveReport, moved: Sequence[tuple[ConsideredConstant, Pair]]) -> SolveReport:
    lost = next((constant.name for constant, pair in moved if not all(each.status.trusted for each in pair)), None)
    if not solve.status.trusted or lost is not None:
        reason = f"the solves with `{lost}` moved by a part of its standard deviation did not converge"
        return _without_sigmas(solve, reason) if solve.status.trusted else solve
    estimates, derived = _all_moves(solve, moved)
    dof = np.array([constant.dof for constant, _ in moved])
    let_go = _let_go(solve, moved, estimates, dof)
    known = tuple(
        replace(
            constant,
            estimates=tuple(moves[i] for moves in estimates),
            derived=tuple(moves[i] for moves in derived),
            elsewhere=partial(_elsewhere, pair, share_of(constant)),
        )
        for i, (constant, pair) in enumerate(moved)
    )
    return replace(
        _tested(solve, moved),
        estimates=tuple(
            replace(
                item, sigma=_sigma(item, moves), spread=_spread(item, moves, dof, let_go), reason=_reason(item, moves)
            )
            for item, moves in zip(solve.estimates, estimates, strict=True)
        ),
        derived=tuple(with_moves(item, moves, dof, let_go) for item, moves in zip(solve.derived, derived, strict=True)),
        covariance=_covariance(solve.covariance, solve.estimates, estimates),
        derived_covariance=_covariance(solve.derived_covariance, solve.derived, derived),
        considered=known,
    )


def with_moves(item: DerivedValue, moves: Floats, dof: Floats, let_go: Moved | None = None) -> DerivedValue:
    """A derived quantity with what a standard deviation of each constant, known by ``dof`` (constants,), does to it.

    ``moves`` (constants, …) are of the shape of its sigmas, ``let_go`` as `_let_go` tells it.
    """
    spread = _spread(item, moves, dof, let_go)
    return replace(item, sigma=_sigma(item, moves), spread=spread, reason=_varies(item, moves))


def _elsewhere(pair: Pair, share: float, name: str, table: Table) -> Floats:
    """What a standard deviation of a constant does to a derived quantity for the rows of a table; NaN: not known."""
    found = []
    for each in pair:
        if each.made_from is None:
            raise TypeError(each)
        problem, solution = each.made_from()
        with solution.lock:
            derived = next(one for one in problem.derived if one.name == name)
            item = value_elsewhere(problem, solution, derived, table)
        if item is None:
            raise TypeError(solution)
        found.append(item)
    below, above = found
    return np.asarray(_moves([(below, above)], np.array([share]))[0])


def _tested(solve: SolveReport, moved: Sequence[tuple[ConsideredConstant, Pair]]) -> SolveReport:
    """A solve whose doubts of the noise mind what the constants do to residuals."""
    if not solve.dof or solve.made_from is None:
        return solve
    solution = solve.made_from()[1]
    doubts_of, both = solution.doubts_of, _residuals(solve, moved)
    if both is None or doubts_of is None or solution.factors is not None:
        return solve
    residuals, moves = both
    _, lengths, axes = np.linalg.svd(moves, full_matrices=False)
    parts, stated = axes @ residuals, solve.chi2_p is not None
    covered = any(each.state is NoiseState.COVERED for each in solution.noise.values())
    noise = next((each.factor**2 for each in solution.noise.values()), 1.0)
    residuals = residuals - (1.0 - np.sqrt(noise / (noise + np.square(lengths)))) * parts @ axes
    squares, fit = float(residuals @ residuals), solution.fit
    if stated:
        tail = chi_square_tail(squares, solve.dof)
        fit = replace(fit, sigma0=float(np.sqrt(squares / solve.dof)), chi2_p=tail)

    def examined() -> Examined:
        found = solve.examined()
        others = [each for each in found.diagnostics if each.code not in OF_RESIDUALS]
        return replace(found, diagnostics=(*others, *(() if covered else doubts_of(residuals, fit))))

    return replace(solve, chi2_p=fit.chi2_p, examination=examined)


def _residuals(solve: SolveReport, moved: Sequence[tuple[ConsideredConstant, Pair]]) -> tuple[Floats, Floats] | None:
    """The residuals (m,) whose squares are tested, and what a standard deviation of each constant does to them
    (constants, m); None where others are.
    """
    own = _restated(solve, solve)
    pairs = [(_restated(below, solve), _restated(above, solve)) for _, (below, above) in moved]
    told, squares = solve.chi2_p, float(own @ own)
    if solve.dof is None or solve.cost is None or solve.robust_cost is not None:
        return None
    both = (squares, solve.cost) if told is None else (chi_square_tail(squares, solve.dof), told)
    if not np.isclose(*both, atol=0.0):
        return None
    if any(each.shape != own.shape for pair in pairs for each in pair):
        return None
    shares = shares_of([constant for constant, _ in moved])
    return own, np.stack([(b - a) / (2 * share) for (a, b), share in zip(pairs, shares, strict=True)])


def moves_by_name(solve: SolveReport, moved: Sequence[tuple[ConsideredConstant, Pair]]) -> dict[str, Floats]:
    """What a standard deviation of each constant does to each number of a solve (constants,), by its name, in SI."""
    estimates, derived = _all_moves(solve, moved)
    return {**dict(_named(solve.estimates, estimates)), **dict(_named(solve.derived, derived))}


def _all_moves(
    solve: SolveReport, moved: Sequence[tuple[ConsideredConstant, Pair]]
) -> tuple[list[Floats], list[Floats]]:
    """What a standard deviation of each constant does to the estimates, and to the derived quantities."""
    pairs, shares = [pair for _, pair in moved], shares_of([constant for constant, _ in moved])
    estimates = [
        _moves([(a.estimates[i], b.estimates[i]) for a, b in pairs], shares) for i in range(len(solve.estimates))
    ]
    derived = [_moves([(a.derived[i], b.derived[i]) for a, b in pairs], shares) for i in range(len(solve.derived))]
    return estimates, derived


def shares_of(constants: Sequence[ConsideredConstant]) -> Floats:
    """The share of its standard deviation by which each of the constants is moved (constants,)."""
    return np.array([share_of(constant) for constant in constants])


def without_variance(result: Result, name: str) -> Result:
    """The ``result`` without standard deviations, which it has not if an input called ``name`` has no variance."""
    reason = f"`{name}` has no variance"
    return replace(result, solves=tuple(_without_sigmas(solve, reason) for solve in result.solves))


def _without_sigmas(solve: SolveReport, reason: str) -> SolveReport:
    def bare(matrix: CovarianceMatrix | None) -> CovarianceMatrix | None:
        return None if matrix is None else replace(matrix, matrix=None, reason=reason)

    return replace(
        solve,
        estimates=tuple(replace(item, sigma=None, reason=reason) for item in solve.estimates),
        derived=tuple(replace(item, sigma=None, reason=reason) for item in solve.derived),
        covariance=bare(solve.covariance),
        derived_covariance=bare(solve.derived_covariance),
    )


def _moves(pairs: Sequence[tuple[Estimate | DerivedValue, Estimate | DerivedValue]], shares: Floats) -> Floats:
    """What a standard deviation of each constant (constants, …) does to an item, of the shape of its sigmas, SI."""
    both = (difference(a.quantity, np.asarray(a.value), np.asarray(b.value)) for a, b in pairs)
    return np.stack([each / (2 * share) for each, share in zip(both, shares, strict=True)])


def _sigma(item: Estimate | DerivedValue, moves: Floats) -> Floats | None:
    return None if item.sigma is None else np.sqrt(np.square(item.sigma) + np.square(moves).sum(axis=0))


def _reason(item: Estimate | DerivedValue, moves: Floats) -> str | None:
    return "constants with an uncertainty are not considered for directions" if np.isnan(moves).any() else item.reason


def _varies(item: DerivedValue, moves: Floats) -> str | None:
    if item.reason is None or not np.nan_to_num(moves).any():
        return item.reason
    return item.reason.replace(PINNED, f"{PINNED}, and with uncertain constants")


@np.errstate(all="ignore")
def _spread(item: Estimate | DerivedValue, moves: Floats, dof: Floats, let_go: Moved | None) -> Spread | None:
    """The spread with the constants, known by ``dof`` (constants,), in it; ``let_go`` is what `_let_go` tells."""
    spread = item.spread
    if spread is None or item.sigma is None:
        return spread
    cut = None
    if let_go is not None and spread.released is not None:
        cut = spread.released.ends(replace(let_go, own=np.nan_to_num(moves.reshape(len(moves), -1))))
    each = np.square(moves)
    freedom = Freedom(dof=spread.dof, inflation=spread.inflation).beside(item.sigma, each, dof)
    return replace(
        spread,
        dof=freedom.dof,
        inflation=freedom.inflation,
        ends=None if spread.ends is None else _wider(spread.ends, each.sum(axis=0), cut),
    )


def _let_go(
    solve: SolveReport, moved: Sequence[tuple[ConsideredConstant, Pair]], estimates: Sequence[Floats], dof: Floats
) -> Moved | None:
    """What the constants do to the coordinates (M,), also as they are without the limits that hold them; None: no
    limits are near.
    """
    if _without_limits(solve) is None:
        return None
    free = []
    for (_, pair), share in zip(moved, shares_of([constant for constant, _ in moved]).tolist(), strict=True):
        below, above = (_without_limits(each) for each in pair)
        if below is None or above is None:
            return None
        free.append((above - below) / (2 * share))
    known = np.hstack([each.reshape(len(dof), -1) for each in estimates])
    return Moved(
        coordinates=np.nan_to_num(known), free=np.nan_to_num(np.stack(free)), own=np.zeros((len(dof), 0)), dof=dof
    )


def _without_limits(solve: SolveReport) -> Floats | None:
    """What the coordinates (M,) of a solve would be without limits."""
    released = [None if each.spread is None else each.spread.released for each in solve.estimates]
    known = [each.values().ravel() for each in released if each is not None]
    return np.concatenate(known) if known and len(known) == len(released) else None


def _wider(ends: Ends, added: Floats, cut: Ends | None) -> Ends:
    """The ends of profiles with an independent part of the variance ``added``; where limits decide, those of ``cut``,
    in which it is (None: there are none), NaN where the linear interval is right.
    """

    def wider(level: float) -> tuple[Floats, Floats]:
        reach = coverage_factor(level, inf) * np.sqrt(added)
        own = np.stack(ends(level))
        others = own if cut is None else np.stack(cut(level))
        below, above = np.where((others == own).all(axis=0), np.hypot(own, reach), others)
        return below, above

    return wider


def _covariance(
    found: CovarianceMatrix | None, items: Sequence[Estimate | DerivedValue], moves: Sequence[Floats]
) -> CovarianceMatrix | None:
    """The covariance with what the constants add to it, scalar by scalar by its name."""
    if found is None or found.matrix is None:
        return found
    by_name = dict(_named(items, moves))
    change = np.stack([by_name[name] for name in found.names]) if found.names else np.zeros((0, 0))
    return replace(found, matrix=found.matrix + change @ change.T)


def _named(items: Sequence[Estimate | DerivedValue], moves: Sequence[Floats]) -> Iterator[tuple[str, Floats]]:
    for item, each in zip(items, moves, strict=True):
        flat = each.reshape(len(each), -1)
        yield from zip(element_names(item.quantity, item.keys), flat.T, strict=True)
