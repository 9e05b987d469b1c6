"""The covariances of a smoother under losses: the sandwich ``H⁻¹ G H⁻¹`` of all steps at once, step by step.

The blocks of H⁻¹ at the steps are the smoother's covariances with rows that weigh as much as H has it, and with
``H⁻¹ G H⁻¹ = H⁻¹ − ∂(H + t(G − H))⁻¹/∂t`` those of the sandwich are as well: time grows with the number of steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import loss_lines
from mbm.equations.binding import Group
from mbm.equations.losses import LossFunction
from mbm.equations.types import Floats, Indices
from mbm.estimation.sequences.local import WORTH_MACHINE_CODE, Local, local
from mbm.estimation.uncertainty.sandwich import Units, summed

WEIGHTS_MOVED = 1e-3
"""Relative change of the weights of rows by which covariances are differenced: to a millionth of themselves."""


@np.errstate(all="ignore")
def sandwiched(seen: Local, points: Floats, given: Callable[[Local], Floats], factors: Floats) -> Floats:
    """Factors (T, n, n) of the covariances at the ``points`` (T, N) of a path that the rows ``seen`` lead to.

    ``given`` makes factors from rows without losses along the same path. Where the losses leave no curvature, or
    something is not finite, the ``factors`` (T, n, n) of the path stay.
    """
    equations = seen.equations
    if any(group.gathered is not None or group.sampled for group in equations.groups):
        return factors
    residuals, slopes, steps = _linearised(seen, points)
    by_loss: dict[LossFunction, list[Units]] = {}
    for loss, lines in loss_lines(equations):
        if len(lines):
            by_loss.setdefault(loss, []).append((loss, np.zeros(len(lines), dtype=np.int64), lines))
    ones = np.ones((1, len(residuals)))
    losses = [summed(parts, residuals[None], ones) for parts in by_loss.values()]
    if any(not sums.curvature[0] > 0.0 for _, sums in losses):
        return factors
    curvature, spread = np.ones(len(residuals)), np.ones(len(residuals))
    acting = [np.concatenate([lines.ravel() for _, _, lines in parts]) for parts in by_loss.values()]
    for mine, (weights, sums) in zip(acting, losses, strict=True):
        curvature[mine] = weights[0, mine] * sums.curvature[0]
    inner = given(_weighed(seen, curvature))
    leverages = curvature * np.square(np.matmul(inner[steps], slopes[:, :, None])[:, :, 0]).sum(axis=1)
    for mine, (weights, sums) in zip(acting, losses, strict=True):
        spread[mine] = weights[0, mine] * sums.corrected(leverages[mine].sum(keepdims=True))[0]
    share = np.where(curvature > 0.0, spread / curvature - 1.0, 0.0)
    step = WEIGHTS_MOVED / max(float(np.abs(share).max(initial=0.0)), 1.0)
    more, less = (given(_weighed(seen, curvature * (1.0 + sign * step * share))) for sign in (1.0, -1.0))
    found = _squares(inner) - (_squares(more) - _squares(less)) / (2.0 * step)
    return _factors(found) if bool(np.isfinite(found).all()) else factors


def _squares(factors: Floats) -> Floats:
    return np.asarray(np.swapaxes(factors, 1, 2) @ factors)


def _factors(covariances: Floats) -> Floats:
    """U (T, n, n) with ``UᵀU`` the covariances, which may be singular."""
    lengths = np.sqrt(np.maximum(np.einsum("tii->ti", covariances), 0.0))
    lengths[lengths == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariances / lengths[:, :, None] / lengths[:, None, :])
    roots = np.sqrt(np.maximum(values, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2)
    return np.ascontiguousarray(roots * lengths[:, None, :])


def _linearised(seen: Local, points: Floats) -> tuple[Floats, Floats, Indices]:
    """Plain whitened residuals (m,) of all rows, each at the point of its step, slopes (m, n) and steps (m,)."""
    equations = seen.equations
    column = equations.columns
    residuals = np.zeros(equations.whole)
    slopes, of_rows = np.zeros((equations.whole, equations.dimension)), np.zeros(equations.whole, dtype=np.int64)
    for number, group in enumerate(equations.groups):
        steps = np.repeat(np.arange(seen.steps), seen.counts[number])
        placed = replace(
            group, index=group.index + steps[:, None] * points.shape[1], shared=(False,) * len(group.shared)
        )
        dense = placed.dense_jacobian(points.ravel(), column, equations.dimension)
        group.whiten_rows(dense)
        lines = slice(group.first, group.first + group.count)
        residuals[lines] = group.whitened(placed.values(points.ravel())).ravel()
        slopes[lines] = dense.reshape(group.count, equations.dimension)
        of_rows[lines] = np.repeat(steps, group.kernel.outputs)
    return residuals, slopes, of_rows


def _weighed(seen: Local, factors: Floats) -> Local:
    """The rows without losses, their squares multiplied by ``factors`` (m,), which components of a unit share."""
    equations = seen.equations
    groups = tuple(_weighed_group(group, factors) for group in equations.groups)
    whole = replace(equations, groups=groups, _scatters=())
    return local(whole, seen.first, seen.counts, equations.groups[0].cache, calls=WORTH_MACHINE_CODE)


def _weighed_group(group: Group, factors: Floats) -> Group:
    roots = np.sqrt(factors[group.first : group.first + group.count]).reshape(group.rows, group.kernel.outputs)
    whiteners = []
    for each in group.whiteners:
        own = roots[:, each.first].reshape(-1, *(1,) * (each.weights.ndim - 1))
        whiteners.append(replace(each, weights=each.weights * own))
    return replace(group, losses=(), whiteners=tuple(whiteners))
