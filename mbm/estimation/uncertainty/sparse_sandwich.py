"""The covariance of estimates with robust losses for sparse problems.

Each loss with its pooled factors of slope and spread (`mbm.solver.loss_spread`) gives the information
``slope²/spread · Σ w JᵀJ``; their sum is inverted as a whole. That is the sandwich itself where one loss acts on all
rows, and the covariance of the best combination of the parts where there are several.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.losses import LossFunction
from mbm.equations.types import Covariance, Floats, Indices, Mask, Minimum, Observability
from mbm.estimation.uncertainty.freedom import free_combination, free_combinations
from mbm.estimation.uncertainty.sandwich import Sums, Units, summed
from mbm.estimation.uncertainty.sparse import (
    NAMED,
    constrained,
    described,
    held_columns,
    sparse_covariance,
    weighted_rows,
)
from mbm.sparse.equations import blocked
from mbm.sparse.inverse import inverse_of
from mbm.sparse.rank import decided
from mbm.sparse.system import BlockJacobian, blocks_of


@np.errstate(all="ignore")
def sparse_sandwich(
    equations: Assembled, minimum: Minimum, residuals: Floats, observed: Observability, stated: Mask
) -> tuple[Covariance, Observability]:
    """The covariance at the minimum, and ``observed`` with what losses leave free as well, and with the inverse that
    derived quantities are propagated with.

    ``residuals`` (m,) are plain, whitened with the noise that the estimates hold with: ``stated`` (m,) or estimated.
    """
    blocks = informed(equations, minimum, residuals, observed, stated)
    held = held_columns(blocks, observed.fixed)
    point = equations.coordinates(minimum.point)
    final = decided(blocks.plan, blocks.values, held)
    settled = _settled(observed, described(final, point, observed.fixed, minimum.constraints), point)
    return sparse_covariance(settled, 1.0), settled


@np.errstate(all="ignore")
def informed(
    equations: Assembled, minimum: Minimum, residuals: Floats, observed: Observability, stated: Mask
) -> BlockJacobian:
    """The Jacobian, each row as heavy as the information that losses leave of it; parameters as for the sandwich."""
    blocks = blocks_of(minimum)
    own = blocked(equations)
    plain, own_pieces = own.plain_block_jacobian(minimum.point, blocks.plan.arithmetic), len(own.places)
    blocks = replace(blocks, values=[*plain[:own_pieces], *blocks.values[own_pieces:]])
    held = held_columns(blocks, observed.fixed)
    losses = [_of_loss(parts, residuals, stated) for parts in _by_loss(equations)]
    factors = np.ones(len(residuals))
    for places, weight, sums in losses:
        factors[places] = weight * _curvature(sums)
    weighted, limits = weighted_rows(blocks, np.sqrt(factors)), minimum.constraints
    leverages = constrained(decided(blocks.plan, weighted, held), limits).inverse.leverages(weighted, observed.fixed)
    for places, weight, sums in losses:
        spread = float(sums.corrected(leverages[places].sum(keepdims=True))[0])
        factors[places] = weight * _curvature(sums) ** 2 / max(spread, 1e-300)
    return replace(blocks, values=weighted_rows(blocks, np.sqrt(factors)))


def _by_loss(equations: Assembled) -> list[list[Units]]:
    found: dict[LossFunction, list[Units]] = {}
    for loss, lines in loss_lines(equations):
        found.setdefault(loss, []).append((loss, np.zeros(len(lines), dtype=np.int64), lines))
    return list(found.values())


def _of_loss(parts: list[Units], residuals: Floats, stated: Mask) -> tuple[Indices, Floats, Sums]:
    """The places of the residuals that a loss acts on, their weights, and its sums."""
    weights, sums = summed(parts, residuals[None], stated[None].astype(np.float64))
    places = np.concatenate([lines.ravel() for _, _, lines in parts])
    return places, weights[0, places], sums


def _curvature(sums: Sums) -> float:
    """The factor of A in H; the losses of sparse problems leave no information rather than less than none."""
    return max(float(sums.curvature[0]), 0.0)


def _settled(observed: Observability, now: Observability, point: Floats) -> Observability:
    """``observed`` with the inverse of the information that losses leave, ``now``, and what that leaves free."""
    flat, inverse = observed.rank - now.rank, inverse_of(now.inverse)
    if flat <= 0:
        return replace(observed, inverse=inverse, estimable=observed.estimable & ~inverse.single())
    alone = sorted(set(now.unused) - set(observed.unused))[:NAMED]
    each = tuple(free_combination(np.eye(1, len(point), place)[0], now.scale, point) for place in alone)
    common = free_combinations(now.null_space, now.scale, point)
    return replace(
        observed,
        inverse=inverse,
        null_space=now.null_space,
        combinations=(*common, *now.combinations, *each),
        estimable=observed.estimable & now.estimable,
        flat=flat,
    )
