"""Residuals → how well they fit, how much each row is checked by the others, and how large unknown noise is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import exp, sqrt
from typing import TypeAlias

import numpy as np

from mbm.equations.manifolds import of_arrays
from mbm.equations.types import Fit, Floats, Indices, Mask, Noise, NoiseState, Observability, SparseJacobian
from mbm.solver.chi_square import chi_square_tail
from mbm.solver.decisions import fits_exactly, rounding_of_norm
from mbm.solver.noise_factors import (
    BESIDE_ROUNDS,
    BETWEEN,
    LEAST_REDUNDANCY,
    NOISE_ROUNDS,
    SETTLED_FACTORS,
    SHRINKINGS,
    VANISHED,
    fading,
    is_nothing,
    leap,
    noise_ratio,
    nothing_left,
    starting,
)

Reweighted = Callable[[Floats], tuple[Floats, Floats, Floats] | None]
"""From the noise factors (one for each unknown group) to residuals (m,), redundancy numbers (m,) and the squares of the
terms that residuals are made of (m,), as `metric.terms_of_rows` has them, at the minimum with the rows of group k
whitened by its sigma times factor k; None: no minimum was found with the work that is left. The caller starts each
solve where the last one ended."""

Shares: TypeAlias = tuple[Floats, Floats, Floats]
"""Sums (K, groups) over groups of unknown noise: of squares of residuals, of redundancy, and of squares of terms."""


def fit_statistics(
    cost: float, rows: int, rank: int, noise_stated: bool, equalities: int = 0, tested: float | None = None
) -> Fit:
    """Statistics of a minimum: ``dof = rows + equalities - rank``; no χ² test where any noise is unknown.

    ``tested`` is what stands against χ² where the cost lacks something: the tails that consensus cut off.
    """
    dof = rows + equalities - rank
    return Fit(
        cost=cost,
        dof=dof,
        sigma0=sqrt(cost / dof) if dof > 0 else None,
        chi2_p=chi_square_tail(cost if tested is None else tested, dof) if dof > 0 and noise_stated else None,
    )


@np.errstate(all="ignore")
def redundancy_numbers(jacobian: Floats, observed: Observability, blocks: SparseJacobian | None = None) -> Floats:
    """Share of each row (m,) that shows in its residual: 1 - the diagonal of the hat matrix; their sum is m - rank.

    Förstner (1979). 0: the row determines something that nothing else does; 1: it determines nothing. ``blocks`` is
    the Jacobian of a sparse problem.
    """
    if observed.inverse is not None and blocks is not None:
        return np.clip(1.0 - observed.inverse.leverages(blocks.values, observed.fixed), 0.0, 1.0)
    rank = observed.row_space.shape[1]
    left = (jacobian / observed.scale) @ (observed.row_space / observed.singular_values[:rank])
    numbers: Floats = np.clip(1.0 - np.square(left).sum(axis=1), 0.0, 1.0)
    return numbers


def common_factor(cost: float, dof: int, rounding: float) -> Noise:
    """The factor where all rows share one unknown noise and nothing is stated: ``s² = cost/dof``, weights unchanged.

    ``rounding`` is the rounding error of the root of the cost.
    """
    if dof <= 0:
        return Noise(factor=1.0, state=NoiseState.NO_REDUNDANCY)
    if fits_exactly(cost, rounding):
        return Noise(factor=1.0, state=NoiseState.EXACT)
    return Noise(factor=sqrt(cost / dof), state=NoiseState.ESTIMATED)


VARIANCE_ROUNDS = 50
"""Of Fisher's scoring for the variance of one unknown noise beside constants: each leaves less than a half."""


UNMOVED = 1e-12
"""Of the variance of residuals: what constants add to one direction of them that counts as nothing."""


DIFFERENCES = 100.0
"""Rounding errors of residuals that what constants do to them has, found by moving these by a hundredth part."""


def beside_constants(residuals: Floats, moves: Floats, dof: int, rounding: float) -> Noise:
    """The factor of one noise of all residuals e (m,), which uncertain constants move by ``moves`` D (k, m).

    The restricted likelihood of e, whose covariance is v M + Dᵀ D with the projector M on what the unknowns leave: its
    variance v by Fisher's scoring, and twice v² by the variance of that, the degrees of freedom. Moves in as many
    directions as there are degrees of freedom may take up all residuals: then the factor is as without them, if
    anything too large. Fewer take up all of them but for ``rounding``, the rounding error of their norm, where there is
    no noise.
    """
    cost = float(residuals @ residuals)
    _, lengths, axes = np.linalg.svd(moves, full_matrices=False)
    moving = np.square(lengths) > UNMOVED * cost / dof
    lengths, axes = lengths[moving], axes[moving]
    parts, left = axes @ residuals, dof - len(lengths)
    if left <= 0:
        return Noise(factor=sqrt(cost / dof), state=NoiseState.ESTIMATED)
    apart, along, rest = np.square(lengths), np.square(parts), float(np.square(residuals - parts @ axes).sum())
    blurred = rounding * (1.0 + DIFFERENCES * float(np.abs(parts / lengths).sum()))
    if fits_exactly(rest, blurred):
        return Noise(factor=blurred / sqrt(left), state=NoiseState.COVERED)
    variance, told = rest / left, float(left)
    for _ in range(VARIANCE_ROUNDS):
        shares = variance / (variance + apart)
        told = left + float(np.square(shares).sum())
        squares = (rest + float((along * np.square(shares)).sum())) / variance
        step = (squares - left - float(shares.sum())) / told
        variance *= exp(min(max(step, -1.0), 1.0))
        if abs(step) <= SETTLED_FACTORS:
            break
    return Noise(factor=sqrt(variance), state=NoiseState.ESTIMATED, dof=told)


def without_constants(residuals: Floats, redundancy: Floats, moves: Floats) -> tuple[Floats, Floats]:
    """Residuals (m,) in units of their noise and their redundancy numbers, as a variance component is scored beside
    constants that move them by D (k, m): of (1 + Dᵀ D)⁻¹ e, and the diagonal of what that leaves of the redundancy.
    """
    _, lengths, axes = np.linalg.svd(moves, full_matrices=False)
    taken = np.square(lengths) / (1.0 + np.square(lengths))
    return residuals - (taken * (axes @ residuals)) @ axes, redundancy - taken @ np.square(axes)


def starting_factors(jacobian: Floats, redundancy: Floats, groups: Sequence[Indices]) -> Floats:
    """Factors (groups,) of unknown noise to start from, of the derivatives (m, n) and redundancy (m,) with factors 1.

    Groups whose unknowns others share come first: rows of stated noise, then groups whose factor is found.
    """
    own = [_column_squares(jacobian[rows]) for rows in groups]
    stated = np.ones(len(redundancy), dtype=bool)
    stated[np.concatenate(groups)] = False
    known = _column_squares(jacobian[np.flatnonzero(stated)])
    factors, waiting = np.ones(len(groups)), list(range(len(groups)))
    while waiting:
        k = next((k for k in waiting if bool(((own[k] > 0.0) & (known > 0.0)).any())), waiting[0])
        waiting.remove(k)
        both = (own[k] > 0.0) & (known > 0.0)
        ratios = own[k][both] / known[both]
        least, most = float(ratios.min(initial=np.inf)), float(ratios.max(initial=0.0))
        factors[k] = starting(least, most, float(redundancy[groups[k]].sum()), float(len(groups[k])))
        known = known + own[k] / factors[k] ** 2
    return factors


def _column_squares(rows: Floats) -> Floats:
    """Sums (n,) of the squares of derivatives (k, n), which may be sparse."""
    return np.asarray((rows**2).sum(axis=0)).ravel()


def _fits_exactly(squares: Floats, terms: Floats) -> Mask:
    return np.asarray(of_arrays(fits_exactly)(squares, of_arrays(rounding_of_norm)(terms, squares)) != 0.0)


class Helmert:
    """Noise factors (K, groups) of K solves: simplified Helmert iteration (Förstner 1979), round by round.

    ``s_k² ← s_k² · SSE_k / r_k`` with the whitened residuals and the redundancy of group k. Groups that
    are fitted exactly but for rounding (``exact``, (K, groups)), or have no redundancy (``untold``), keep their last
    factor. Groups that had some in the first round (``checked``) lose it as their factor vanishes beside others' noise.
    """

    def __init__(self, start: Floats) -> None:
        self.factors = start.copy()
        self.exact = np.zeros(start.shape, dtype=bool)
        self.untold = self.exact.copy()
        self.checked = self.exact.copy()
        self._ratios = np.ones(start.shape)
        self._first: Floats | None = None
        self._rounds = 0

    @np.errstate(all="ignore")
    def advance(self, which: Indices, shares: Shares) -> tuple[Mask, Mask]:
        """A round of some solves (k,), from their ``shares`` (k, groups): which are settled, and which are sound.

        Squares that are no finite numbers tell nothing of noise: such solves are not sound, and keep their factors.
        """
        squares, redundancy, terms = shares
        before = self.factors[which]
        self.untold[which] = redundancy <= LEAST_REDUNDANCY
        exact = self.exact[which] | (~self.untold[which] & _fits_exactly(squares, terms))
        ratio = np.where(exact, 1.0, of_arrays(noise_ratio)(squares, redundancy))
        after = before * ratio
        sound: Mask = np.asarray(np.isfinite(after + squares + redundancy).all(axis=1))
        if self._first is None:
            self._first = np.ones(self.factors.shape)
            self._first[which] = after
            self.checked[which] = ~self.untold[which]
            after = np.where(self.untold[which], 1.0, after)
        vanished = after < VANISHED * self._first[which]
        after = np.where(vanished | ~sound[:, None], before, after)
        self.exact[which] = exact | (vanished & sound[:, None])
        near = (np.abs(after / before - 1.0) <= SETTLED_FACTORS).all(axis=1)
        self._rounds += 1
        if self._rounds % BETWEEN == 0:
            after = np.where(after == before, after, after * of_arrays(leap)(self._ratios[which], ratio))
        self._ratios[which] = ratio
        self.factors[which] = after
        return np.asarray(sound & near), sound


class _Rounds:
    """The rounds of one solve."""

    def __init__(self, solve: Reweighted, groups: Sequence[Indices], start: Floats) -> None:
        self.helmert = Helmert(start[None])
        self._solve = solve
        self._groups = groups
        self._stated = False
        self._tried = np.zeros(len(groups), dtype=bool)
        self.moving = np.zeros(len(groups), dtype=bool)
        """Groups whose factors changed in the last of all rounds."""

    def _told(self, factors: Floats) -> Shares | None:
        """Sums of squares and redundancy (1, groups) with some factors; None: no minimum was found."""
        found = self._solve(factors.copy())
        if found is None:
            return None
        self._stated = sum(map(len, self._groups)) < len(found[0])
        squares, redundancy, terms = (
            np.array([[each[rows].sum() for rows in self._groups]]) for each in (np.square(found[0]), *found[1:])
        )
        return squares, redundancy, terms

    def run(self) -> None:
        """Rounds until all factors settle, or as many as are made."""
        helmert, only = self.helmert, np.zeros(1, dtype=np.int64)
        for number in range(1, NOISE_ROUNDS + 1):
            before = helmert.factors[0].copy()
            shares = self._told(before)
            if shares is None:
                return
            (settled,), (sound,) = helmert.advance(only, shares)
            if not sound or (settled and not self._forgo(shares)):
                return
            if not settled and number % BETWEEN == 0:
                self._fade(shares)
        self.moving = np.abs(helmert.factors[0] / before - 1.0) > SETTLED_FACTORS

    def _fade(self, shares: Shares) -> None:
        """Let factors vanish that fall, and do where nothing is left, with the other factors as they then are."""
        squares, redundancy = (each[0].tolist() for each in shares[:2])
        for k, rows in enumerate(self._groups):
            faded = fading(squares[k], redundancy[k], float(len(rows)))
            if self.helmert.checked[0, k] and faded != 1.0:
                there = self._beside(k, faded)
                if there is not None and is_nothing(*there[1]):
                    there[0][k] *= nothing_left(there[1][1])
                    self.helmert.factors[0] = there[0]

    def _beside(self, k: int, faded: float) -> tuple[Floats, tuple[float, float]] | None:
        """All factors with that of group k ``faded``, and its squares and redundancy there."""
        factors = self.helmert.factors[0].copy()
        factors[k] *= faded
        stays = self.helmert.exact[0].copy()
        stays[k] = True
        for number in range(1, BESIDE_ROUNDS + 1):
            shares = self._told(factors)
            if shares is None:
                break
            ratio = np.where(stays, 1.0, of_arrays(noise_ratio)(shares[0][0], shares[1][0]))
            if not np.isfinite(ratio).all():
                break
            factors = factors * ratio
            if number == BESIDE_ROUNDS or (np.abs(ratio - 1.0) <= SETTLED_FACTORS).all():
                return factors, (float(shares[0][0, k]), float(shares[1][0, k]))
        return None

    def _forgo(self, shares: Shares) -> bool:
        """Whether a group that is fitted exactly is nothing beside noise that is told; once for each."""
        helmert = self.helmert
        beside = self._stated or bool((~helmert.exact & ~helmert.untold).any())
        for k in np.flatnonzero(helmert.exact[0] & ~self._tried & beside).tolist():
            self._tried[k] = True
            factors, left = helmert.factors[0].copy(), float(shares[1][0, k])
            for _ in range(SHRINKINGS):
                factors[k] *= nothing_left(left)
                there = self._told(factors)
                if there is None or there[1][0, k] > 0.5 * left:
                    break
                left = float(there[1][0, k])
                if left <= LEAST_REDUNDANCY and (there[1][helmert.untold] <= LEAST_REDUNDANCY).all():
                    helmert.exact[0, k], helmert.factors[0] = False, factors
                    return True
        return False


@np.errstate(all="ignore")
def variance_components(solve: Reweighted, groups: Sequence[Indices], start: Floats | None = None) -> tuple[Noise, ...]:
    """Factors of several groups of unknown noise; rows in none of the ``groups`` have stated noise and keep it.

    Rounds of `Helmert` from ``start`` (groups,; None: 1) until all factors settle. Residuals of no minimum, or whose
    squares are no finite numbers, tell nothing of noise: the factors that led to them are the last, unsettled.
    """
    rounds = _Rounds(solve, groups, np.ones(len(groups)) if start is None else start)
    rounds.run()
    helmert = rounds.helmert
    return tuple(
        Noise(factor=float(factor), state=_state(exact=exact, untold=untold, checked=checked), settled=not moving)
        for factor, exact, untold, checked, moving in zip(
            helmert.factors[0], helmert.exact[0], helmert.untold[0], helmert.checked[0], rounds.moving, strict=True
        )
    )


def _state(*, exact: bool, untold: bool, checked: bool) -> NoiseState:
    if exact:
        return NoiseState.EXACT
    if untold:
        return NoiseState.NOTHING if checked else NoiseState.NO_REDUNDANCY
    return NoiseState.ESTIMATED
