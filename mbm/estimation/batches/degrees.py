"""Effective degrees of freedom in many solves.

Likelihoods in many solves: what their covariances follow from, and what of their residuals is χ².
"""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np

from mbm.equations.likelihoods import Readings, likely, untested
from mbm.equations.spreads import Freedom
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.components import several_noises
from mbm.estimation.batches.factor import Spread
from mbm.estimation.batches.portion import DerivedColumns, Portion
from mbm.estimation.batches.stack import Stack
from mbm.estimation.batches.types import DegreesColumns, Ends, Which
from mbm.estimation.uncertainty.degrees import (
    LEAST,
    effective,
    enough,
    few_told,
    of_scale,
    scaled,
    scaled_blocks,
    untold,
)
from mbm.problem.likelihoods.types import SHIFT
from mbm.problem.types import Problem
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


@np.errstate(all="ignore")
def degrees_columns(
    problem: Problem,
    portion: Portion,
    spread: Spread,
    derived: tuple[DerivedColumns, ...],
    cost: Floats,
    dof: Indices,
    tally: Counted,
) -> DegreesColumns:
    """The degrees of freedom of K solves, by the rules of `uncertainty.degrees.freedoms`.

    ``cost`` (K,) is that of the minima with the final weights, ``dof`` (K,) the redundancy, and ``tally`` what
    they count.

    With several noises the factor of the covariance that is estimated is 1, so that the basis of the ``spread`` is the
    whitened Jacobian times the factor of the covariance.
    """
    basis = spread.basis
    unknown = [owner for owner, block in enumerate(problem.blocks) if block.unknown_factor]
    images = [spread.factor, *(one.image for one in derived)]
    if not unknown or portion.equations.lossy or not several_noises(problem):
        if (sharing := scaled_blocks(portion.equations)) and not unknown:
            return _of_scale(portion, spread, images, sharing, tally.limits)
        told = bool(unknown) or portion.equations.lossy
        of_solve = np.maximum(dof.astype(np.float64), LEAST) if told else np.full(len(dof), inf)
        found = [_alike(of_solve, image.shape[:2]) for image in images]
        few: Mask = np.asarray(dof < enough(portion.equations, consensus=portion.consensus))
        poor = few if unknown or scaled(portion.equations) else np.zeros(len(dof), dtype=bool)
        return DegreesColumns(estimates=found[0], derived=tuple(found[1:]), poor=poor)
    grams = np.zeros((len(basis), len(unknown), basis.shape[2], basis.shape[2]))
    counts = np.zeros((len(basis), len(unknown)))
    for place, owner in enumerate(unknown):
        own = np.zeros(basis.shape[:2], dtype=bool)
        own[portion.block_slots(owner)] = True
        picked = np.where(own[:, :, None], basis, 0.0)
        grams[:, place] = np.matmul(picked.transpose(0, 2, 1), picked)
        counts[:, place] = own.sum(axis=1)
    misfit = cost / np.maximum(dof, 1)
    found = [effective(image, grams, counts, misfit) for image in images]
    poor = np.asarray(untold(spread.factor, grams, counts).any(axis=1))
    return DegreesColumns(estimates=found[0], derived=tuple(found[1:]), poor=poor)


def _of_scale(
    portion: Portion, spread: Spread, images: list[Floats], blocks: tuple[int, ...], limits: Floats
) -> DegreesColumns:
    """Those of K solves where some ``blocks`` share one unknown scale, and so many rows are ``limits`` (K,)."""
    told, count = np.zeros(portion.count), np.zeros(portion.count)
    for group, solve, slots in portion.bound_groups():
        if group.kernel.owner in blocks and group.readings is not None:
            each = np.square(spread.basis[solve[:, None], slots]).sum(axis=(1, 2))
            told += np.bincount(solve, weights=each, minlength=portion.count)
            count += np.bincount(solve, minlength=portion.count) * int(group.counting.sum())
    dof, inflation = of_scale(count, limits, told)
    found = [_alike(dof, image.shape[:2], inflation) for image in images]
    return DegreesColumns(estimates=found[0], derived=tuple(found[1:]), poor=dof < few_told(portion.equations))


def _alike(dof: Floats, shape: tuple[int, ...], inflation: Floats | float = 1.0) -> Freedom:
    growth = np.broadcast_to(inflation, len(dof))[:, None]
    return Freedom(dof=np.broadcast_to(dof[:, None], shape), inflation=np.broadcast_to(growth, shape))
