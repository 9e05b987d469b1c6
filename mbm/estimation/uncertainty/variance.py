"""Residuals → how well they fit, how much each row is checked by the others, and how large unknown noise is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt
from typing import TypeAlias

import numpy as np

from mbm.equations.formulas import of_arrays
from mbm.equations.types import Components, Fit, Floats, Indices, Mask, Noise, NoiseState, Observability, SparseJacobian
from mbm.solver.chi_square import chi_square_tail
from mbm.solver.noise_factors import (
    BETWEEN,
    LEAST_REDUNDANCY,
    NOISE_ROUNDS,
    SETTLED_FACTORS,
    VANISHED,
    fading,
    noise_ratio,
)

Reweighted = Callable[[Floats], tuple[Floats, Floats] | None]
"""From the noise factors (one for each unknown group) to the residuals (m,) and redundancy numbers (m,) at the minimum
with the rows of group k whitened by its sigma times factor k; None: no minimum was found with the work that is left.
The caller starts each solve where the last one ended."""

Shares: TypeAlias = tuple[Floats, Floats]
"""Sums of squares and redundancy (K, groups) of groups of unknown noise."""


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


def common_factor(cost: float, dof: int) -> Noise:
    """The factor where all rows share one unknown noise and nothing is stated: ``s² = cost/dof``, weights unchanged."""
    if dof <= 0:
        return Noise(factor=1.0, state=NoiseState.NO_REDUNDANCY)
    if cost == 0.0:
        return Noise(factor=1.0, state=NoiseState.EXACT)
    return Noise(factor=sqrt(cost / dof), state=NoiseState.ESTIMATED)


class Helmert:
    """Noise factors (K, groups) of K solves: simplified Helmert iteration (Förstner 1979), round by round.

    ``s_k² ← s_k² · SSE_k / r_k`` with the whitened residuals and the redundancy of group k. Groups that
    are fitted exactly (``exact``, (K, groups)), or have no redundancy (``untold``), keep their last factor. Groups that
    had some in the first round (``checked``) lose it as their factor vanishes beside the noise of others.
    """

    def __init__(self, solves: int, groups: int) -> None:
        self.factors = np.ones((solves, groups))
        self.exact = np.zeros((solves, groups), dtype=bool)
        self.untold = self.exact.copy()
        self.checked = self.exact.copy()
        self._first: Floats | None = None

    @np.errstate(all="ignore")
    def advance(self, which: Indices, squares: Floats, redundancy: Floats) -> tuple[Mask, Mask]:
        """A round of some solves (k,), from ``SSE`` and r (k, groups): which are settled, and which are sound.

        Squares that are no finite numbers tell nothing of noise: such solves are not sound, and keep their factors.
        """
        before = self.factors[which]
        self.untold[which] = redundancy <= LEAST_REDUNDANCY
        exact = self.exact[which] | (~self.untold[which] & (squares == 0.0))
        after = before * np.where(exact, 1.0, of_arrays(noise_ratio)(squares, redundancy))
        sound: Mask = np.asarray(np.isfinite(after + squares + redundancy).all(axis=1))
        if self._first is None:
            self._first = np.ones(self.factors.shape)
            self._first[which] = after
            self.checked[which] = ~self.untold[which]
        vanished = after < VANISHED * self._first[which]
        after = np.where(vanished | ~sound[:, None], before, after)
        self.exact[which] = exact | (vanished & sound[:, None])
        self.factors[which] = after
        near = (np.abs(after / before - 1.0) <= SETTLED_FACTORS).all(axis=1)
        return np.asarray(sound & near), sound

    def fade(self, told: Callable[[Floats], Shares | None], shares: Shares, rows: Sequence[int]) -> None:
        """Let factors of the first solve vanish that fall with the ``shares`` of a round, and do where nothing is left.

        ``told`` gives the shares with other factors (groups,).
        """
        squares, redundancy = (each[0].tolist() for each in shares)
        for k, count in enumerate(rows):
            faded = fading(squares[k], redundancy[k], count)
            if self.checked[0, k] and faded != 1.0:
                factors = self.factors[0].copy()
                factors[k] *= faded
                there = told(factors)
                if there is not None and there[0][0, k] < there[1][0, k]:
                    self.factors[0] = factors


@np.errstate(all="ignore")
def variance_components(solve: Reweighted, groups: Sequence[Indices]) -> Components:
    """Factors of several groups of unknown noise; rows in none of the ``groups`` have stated noise and keep it.

    Rounds of `Helmert` until all factors settle. Residuals of no minimum, or whose squares are no finite numbers, tell
    nothing of noise: the factors that led to them are the last, unsettled.
    """
    helmert, only = Helmert(1, len(groups)), np.zeros(1, dtype=np.int64)
    settled = False

    def told(factors: Floats) -> Shares | None:
        found = solve(factors.copy())
        if found is None:
            return None
        squares, redundancy = ([[each[rows].sum() for rows in groups]] for each in (np.square(found[0]), found[1]))
        return np.array(squares), np.array(redundancy)

    for number in range(1, NOISE_ROUNDS + 1):
        shares = told(helmert.factors[0])
        if shares is None:
            break
        (settled,), (sound,) = helmert.advance(only, *shares)
        if settled or not sound:
            break
        if number % BETWEEN == 0:
            helmert.fade(told, shares, [len(rows) for rows in groups])
    noises = (
        Noise(factor=float(factor), state=_state(exact=exact, untold=untold, checked=checked))
        for factor, exact, untold, checked in zip(
            helmert.factors[0], helmert.exact[0], helmert.untold[0], helmert.checked[0], strict=True
        )
    )
    return Components(noises=tuple(noises), settled=bool(settled))


def _state(*, exact: bool, untold: bool, checked: bool) -> NoiseState:
    if exact:
        return NoiseState.EXACT
    if untold:
        return NoiseState.NOTHING if checked else NoiseState.NO_REDUNDANCY
    return NoiseState.ESTIMATED
