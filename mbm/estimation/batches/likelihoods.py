"""Likelihoods in many solves: what their covariances follow from, and what of their residuals is χ²."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.likelihoods import Readings, likely, untested
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.portion import Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import Ends, Which
from mbm.problem.likelihoods.types import SHIFT
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Counted:
    """What K solves count: χ² and the number of its residuals, log L (None: no likelihood), whether χ² is none, how
    many rows with an unknown scale are ``limits``, and the squares of residuals that are ``uncounted``.
    """

    cost: Floats
    rows: Indices
    log_likelihood: Floats | None
    untested: Mask
    limits: Floats
    uncounted: Floats

    def tested(self, scattered: Floats) -> Floats:
        """What stands against χ² (K,): ``scattered`` where there is no likelihood."""
        return scattered if self.log_likelihood is None else self.cost


def informing_slopes(stack: Stack, which: Which, ends: Ends, slopes: Floats) -> Floats:
    """Derivatives (K, m, n) whose squares are the Fisher information; ``slopes`` where there is no likelihood."""
    if not stack.equations.likely:
        return slopes
    told = replace(stack, equations=stack.equations.informing())
    return Portion(told, which, ends.kept, ends.factors).linearised(ends.points)[1]


def counted_of(stack: Stack, which: Which, residuals: Floats, rows: Indices) -> Counted:
    """What solves count of their plain ``residuals`` (K, m), of which they have so many ``rows`` (K,)."""
    squares = np.square(residuals)
    cost, none = squares.sum(axis=1), np.zeros(len(residuals), dtype=bool)
    if not stack.equations.likely:
        zeros = np.zeros(len(cost))
        return Counted(cost=cost, rows=rows, log_likelihood=None, untested=none, limits=zeros, uncounted=zeros)
    surprise, excess, lines, limits = (np.zeros(len(cost)) for _ in range(4))
    whole, taken = cost, np.zeros(len(cost), dtype=np.int64)
    every: dict[int, Readings] = {group.number: stated for group, stated in likely(stack.equations.groups)}
    for number, group in enumerate(stack.equations.groups):
        solve, places = stack.lines(number, which)
        count, outputs = np.bincount(solve, minlength=len(cost)), group.kernel.outputs
        stated = every.get(group.number)
        if stated is None:
            each = -np.log(np.hstack([_roots(w.weights[places]) for w in group.whiteners])) + 0.5 * np.log(2.0 * np.pi)
            surprise += np.bincount(solve, weights=each.sum(axis=1), minlength=len(cost))
        else:
            own = np.arange(len(solve)) - (np.cumsum(count) - count)[solve]
            slots = (taken[solve] + own * outputs)[:, None] + np.flatnonzero(stated.uncounted)
            left = np.bincount(solve, weights=squares[solve[:, None], slots].sum(axis=1), minlength=len(cost))
            cost = cost - left
            rows = rows - count * int(stated.uncounted.sum())
            surprise += np.bincount(solve, weights=stated.surprise[places], minlength=len(cost))
            surprise -= 0.5 * SHIFT * int(stated.shifted.sum()) * count
            excess += np.bincount(solve, weights=stated.excess[places], minlength=len(cost))
            lines += count
            if stated.scales:
                limits += np.bincount(solve, weights=stated.limits[places], minlength=len(cost))
        taken += count * outputs
    log_likelihood, none = -0.5 * whole - surprise, untested(excess, lines)
    return Counted(
        cost=cost, rows=rows, log_likelihood=log_likelihood, untested=none, limits=limits, uncounted=whole - cost
    )


def _roots(weights: Floats) -> Floats:
    """The diagonal (R, k) of weights."""
    return np.abs(weights if weights.ndim == 2 else np.diagonal(weights, axis1=1, axis2=2))
