"""Effective degrees of freedom in many solves."""

from __future__ import annotations

from math import inf

import numpy as np

from mbm.equations.spreads import Freedom
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.components import several_noises
from mbm.estimation.batches.degree_types import DegreesColumns
from mbm.estimation.batches.derived import DerivedColumns
from mbm.estimation.batches.factor import Spread
from mbm.estimation.batches.likelihoods import Counted
from mbm.estimation.batches.portion import Portion
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
from mbm.problem.types import Problem


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
