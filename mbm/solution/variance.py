"""Residuals → how well they fit, how much each row is checked by the others, and how large unknown noise is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt

import numpy as np

from mbm.solution.types import Components, Fit, Floats, Indices, Noise, NoiseState, Observability, SparseJacobian
from mbm.target.chi_square import chi_square_tail
from mbm.target.decisions import LEAST_REDUNDANCY, NOISE_ROUNDS, SETTLED_FACTORS

Reweighted = Callable[[Floats], tuple[Floats, Floats] | None]
"""From the noise factors (one for each unknown group) to the residuals (m,) and redundancy numbers (m,) at the minimum
with the rows of group k whitened by its sigma times factor k; None: no minimum was found with the work that is left.
The caller starts each solve where the last one ended."""

VANISHED = 1e-12
"""A factor that falls below this share of its first value belongs to a group that is fitted exactly."""


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


@np.errstate(all="ignore")
def variance_components(solve: Reweighted, groups: Sequence[Indices]) -> Components:
    """Factors of several groups of unknown noise; rows in none of the ``groups`` have stated noise and keep it.

    Simplified Helmert iteration (Förstner 1979): ``s_k² ← s_k² · SSE_k / r_k`` with the whitened residuals and the
    redundancy of group k, until all factors settle. A group that is fitted exactly, or that has no redundancy, keeps
    its last factor and says so. Residuals of no minimum, or whose squares are no finite numbers, tell nothing of
    noise: the factors that led to them are the last, unsettled.
    """
    factors = np.ones(len(groups))
    first = np.ones(len(groups))
    states = [NoiseState.ESTIMATED] * len(groups)
    for rounds in range(1, NOISE_ROUNDS + 1):
        at_minimum = solve(factors)
        if at_minimum is None:
            break
        residuals, redundancy = at_minimum
        ratios = np.ones(len(groups))
        for k, rows in enumerate(groups):
            share = float(redundancy[rows].sum())
            squares = float(residuals[rows] @ residuals[rows])
            if states[k] is not NoiseState.EXACT:
                states[k] = _state_of(share, squares)
            if states[k] is NoiseState.ESTIMATED:
                ratios[k] = sqrt(squares / share)
        updated = factors * ratios
        if not np.isfinite(updated).all():
            break
        if rounds == 1:
            first = updated
        for k in range(len(groups)):
            if updated[k] < VANISHED * first[k]:
                states[k] = NoiseState.EXACT
                updated[k] = factors[k]
        change = float(np.abs(updated / factors - 1.0).max(initial=0.0))
        factors = updated
        if change <= SETTLED_FACTORS:
            return _components(factors, states, settled=True)
    return _components(factors, states, settled=False)


def _state_of(redundancy: float, squares: float) -> NoiseState:
    if redundancy <= LEAST_REDUNDANCY:
        return NoiseState.NO_REDUNDANCY
    return NoiseState.EXACT if squares == 0.0 else NoiseState.ESTIMATED


def _components(factors: Floats, states: Sequence[NoiseState], *, settled: bool) -> Components:
    noises = tuple(Noise(factor=float(f), state=s) for f, s in zip(factors, states, strict=True))
    return Components(noises=noises, settled=settled)
