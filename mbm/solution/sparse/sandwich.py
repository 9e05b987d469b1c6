"""The covariance of estimates with robust losses for sparse problems.

Each loss with its pooled factors of slope and spread (as `mbm.solution.robust.covariance` has them for dense problems)
gives the information ``slope²/spread · Σ w JᵀJ``; their sum is inverted as a whole. That is the sandwich itself where
one loss acts on all rows, and the covariance of the best combination of the parts where there are several.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.solution.assembly import Assembled, loss_lines
from mbm.solution.freedom import free_combination, free_combinations
from mbm.solution.robust.covariance import curved, least_spread
from mbm.solution.robust.losses import LossFunction
from mbm.solution.sparse.equations import blocked
from mbm.solution.sparse.observability import NAMED, described, sparse_covariance
from mbm.solution.sparse.rank import Decision, decided
from mbm.solution.sparse.system import BlockJacobian, blocks_of
from mbm.solution.types import Covariance, Floats, Indices, Mask, Minimum, Observability
from mbm.target.decisions import EXHAUSTED


@np.errstate(all="ignore")
def sparse_sandwich(
    equations: Assembled, minimum: Minimum, residuals: Floats, observed: Observability, stated: Mask
) -> tuple[Covariance, Observability]:
    """The covariance at the minimum, and ``observed`` with what losses leave free as well, and with the inverse that
    derived quantities are propagated with.

    ``residuals`` (m,) are plain, whitened with the noise that the estimates hold with: ``stated`` (m,) or estimated.
    """
    blocks = blocks_of(minimum)
    plain = blocked(equations).plain_block_jacobian(minimum.point, blocks.plan.arithmetic)
    blocks = replace(blocks, values=plain)
    layout = blocks.plan.structure
    found = list(loss_lines(equations))
    weight, slope = np.ones(len(residuals)), np.ones(len(residuals))
    every = np.arange(len(residuals)) if layout.rows is None else layout.rows
    for loss, lines in found:
        squares = np.square(residuals[lines]).sum(axis=1)
        weight[lines] = loss.weight(squares)[:, None]
        slope[lines] = (loss.weight(squares) + 2.0 * loss.slope(squares) * squares / lines.shape[1])[:, None]
    pools = [(loss, np.concatenate([p.ravel() for other, p in found if other == loss])) for loss in _each(found)]
    held = _held(blocks, observed.fixed)
    factors = weight.copy()
    for _, places in pools:
        factors[places] *= _factor(slope[places], weight[places])
    inverse = decided(blocks.plan, _weighted(blocks, np.sqrt(np.maximum(factors, 0.0)), every), held).inverse
    leverages = inverse.leverages(_weighted(blocks, np.sqrt(np.maximum(factors, 0.0)), every), observed.fixed)
    for _, places in pools:
        total = max(float(weight[places].sum()), 1e-300)
        mean = _factor(slope[places], weight[places])
        spread = float(np.square(weight[places] * residuals[places]).sum()) / total
        share = float(leverages[places].sum())
        bend = float(slope[places].var()) / float(slope[places].mean()) ** 2 if mean > 0.0 else 0.0
        if len(places) - share <= EXHAUSTED * len(places):
            spread = 1.0
        else:
            spread *= (1.0 + share / len(places) * bend) ** 2 * len(places) / (len(places) - share)
            known = float(weight[places][stated[places]].sum())
            spread = max(spread, float(least_spread(mean, total, known, share)))
        factors[places] = weight[places] * mean * mean / max(spread, 1e-300)
    final = decided(blocks.plan, _weighted(blocks, np.sqrt(factors), every), held)
    settled = _settled(observed, final, equations.coordinates(minimum.point))
    return sparse_covariance(settled, 1.0), settled


def _factor(slope: Floats, weight: Floats) -> float:
    """The factor of A in H; the pools of sparse problems leave no information rather than less than none."""
    return max(float(curved(float(slope.sum()) / max(float(weight.sum()), 1e-300))), 0.0)


def _settled(observed: Observability, final: Decision, point: Floats) -> Observability:
    """``observed`` with the inverse of the information that losses leave, and what that leaves free beside it."""
    now = described(final, point, observed.fixed)
    flat = observed.rank - now.rank
    if flat <= 0:
        return replace(observed, inverse=final.inverse, estimable=observed.estimable & ~final.inverse.single())
    alone = sorted(set(now.unused) - set(observed.unused))[:NAMED]
    each = tuple(free_combination(np.eye(1, len(point), place)[0], now.scale, point) for place in alone)
    common = free_combinations(now.null_space, now.scale, point)
    return replace(
        observed,
        inverse=final.inverse,
        null_space=now.null_space,
        combinations=(*common, *now.combinations, *each),
        estimable=observed.estimable & now.estimable,
        flat=flat,
    )


def _each(losses: list[tuple[LossFunction, Indices]]) -> list[LossFunction]:
    return list(dict.fromkeys(loss for loss, _ in losses))


def _held(blocks: BlockJacobian, fixed: Mask) -> Mask:
    layout = blocks.plan.structure
    held = np.zeros(layout.columns, dtype=bool)
    held[layout.free] = fixed
    return held


def _weighted(blocks: BlockJacobian, factors: Floats, every: Indices) -> list[Floats]:
    """The Jacobian with its rows multiplied; ``every`` (m,) places the factors among all residuals."""
    layout = blocks.plan.structure
    whole = np.zeros(layout.count)
    whole[every] = factors
    return [
        values * whole[piece.residuals].reshape(values.shape[:2])[:, :, None]
        for piece, values in zip(layout.pieces, blocks.values, strict=True)
    ]
