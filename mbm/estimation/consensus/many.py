"""Consensus with very many connected unknowns: no subset is clean, so losses lead from least squares to the inliers.

The Geman-McClure loss is narrowed by degrees (Black and Rangarajan 1996), each minimum starting where the wider one
ended; then inliers are chosen and fitted until they stay the same. Any solver does, sparse ones included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.losses import LossFunction
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.consensus.binding import without_losses
from mbm.estimation.consensus.scores import cuts, variances_at
from mbm.estimation.consensus.types import Agreed, Asked
from mbm.estimation.consensus.units import Units
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.problem.kinds import LossKind
from mbm.problem.types import Problem
from mbm.solver.consensus_records import Units as SolverUnits
from mbm.solver.consensus_truncation import untruncated
from mbm.solver.decisions import LEAST_SHARE, STATED

WIDTHS = (64.0, 16.0, 8.0, 4.0, 2.0, 1.0)
"""Parameters of the loss one after the other, in multiples of the limit."""

NARROW = (2.0, 1.0)
"""… and where the start is so good that it tells wrong equations from good ones, which the wide losses would spoil."""

FEW_STEPS = 30
"""Iterations of a minimum that is only on the way."""

ROUNDS = 10


def agree_by_losses(asked: Asked, equations: Assembled, units: Units, start: Floats) -> Agreed:
    """The units that agree, from a start (N,) that is not too far off."""
    problem = asked.problem
    cut = cuts(units, asked.consensus.threshold)
    way = replace(asked.settings, max_iterations=FEW_STEPS, robust=None)
    plain = without_losses(equations)
    acting = np.zeros(equations.whole, dtype=bool)
    acting[units.of_row >= 0] = True

    def narrowed(widths: tuple[float, ...], point: Floats) -> Agreed:
        squares = units.squares(plain.plain_residuals(point))
        for width in widths:
            variances = _variances(squares, units, equations.dimension)
            factors = _by_row(np.sqrt(variances), units, plain)
            lossy = _with_loss(plain, acting, width * float(np.sqrt(cut.max()))).with_factors(factors)
            point = minimise(lossy, point, way, problem.span).point
            squares = units.squares(plain.plain_residuals(point))
        return _settled(problem, plain, units, point, cut, way)

    found = _best([narrowed(WIDTHS, start), narrowed(NARROW, start)], units)
    if found.share >= LEAST_SHARE:
        return found
    # So far from the start that the losses hold next to nothing: least squares see every row.
    fitted = minimise(plain, start, replace(way, max_iterations=asked.settings.max_iterations), problem.span).point
    return _best([found, narrowed(WIDTHS, fitted)], units)


def _best(candidates: Sequence[Agreed], units: Units) -> Agreed:
    """The one that most residuals agree with; of equals the first."""
    counts = [int(units.components[candidate.inliers].sum()) for candidate in candidates]
    return candidates[int(np.argmax(counts))]


def _settled(
    problem: Problem, plain: Assembled, units: Units, point: Floats, cut: Floats, settings: Settings
) -> Agreed:
    """Fits to the inliers until they stay the same."""
    before = None
    squares = units.squares(plain.plain_residuals(point))
    for _ in range(ROUNDS):
        variances = _variances(squares, units, plain.dimension)
        inliers = squares <= cut * variances
        if before is not None and bool((inliers == before).all()):
            break
        before = inliers
        keep = np.ones(int(plain.units.max()) + 1, dtype=bool)
        keep[units.number] = inliers
        weighted = plain.with_factors(_by_row(np.sqrt(variances), units, plain)).kept(keep)
        point = minimise(weighted, point, settings, problem.span).point
        squares = units.squares(plain.plain_residuals(point))
    limits = cut * variances
    return Agreed(
        point=point,
        inliers=inliers,
        limits=limits,
        variances=noise_of_inliers(squares, squares <= limits, variances, units, plain.dimension, limits),
    )


def noise_of_inliers(
    squares: Floats, inliers: Mask, variances: Floats, units: Units, dimension: int, limits: Floats
) -> Floats:
    """The variance (U,) of the noise, as stated or ``SSE/((n − p) κ)`` of the ``inliers`` (U,).

    κ is what normal noise has left inside the ``limits`` (U,), which are equal for units of as many components in a
    group; unknowns are shared out by the number of residuals. Without redundancy ``variances`` (U,) stay.
    """
    noise = variances.copy()
    total = int(units.components[inliers].sum())
    for group in np.unique(units.group[units.group != STATED]).tolist():
        mine = np.flatnonzero(inliers & (units.group == group))
        freedom = int(units.components[mine].sum()) * (1.0 - dimension / total) if total else 0.0
        if freedom > 0.0:
            least = max(float(units.rounding[mine].max()), 1e-300)
            raw = max(float(squares[mine].sum()) / freedom, least)
            noise[units.group == group] = untruncated(_listed(units.components[mine], limits[mine]), 0, 0, raw)
    return noise


def _listed(components: Indices, limits: Floats) -> SolverUnits:
    """Inliers of one group as the solver's text reads them, those of one size side by side; of one size only, once."""
    order = np.argsort(components, kind="stable")
    order = order[:1] if bool((components == components[0]).all()) else order
    count = len(order)
    found = SimpleNamespace(
        count=count,
        group=[0] * count,
        inlier=[1] * count,
        components=components[order].tolist(),
        limits=limits[order].tolist(),
    )
    return cast("SolverUnits", found)


def _variances(squares: Floats, units: Units, dimension: int) -> Floats:
    """Stated ones are 1; the median of squared norms tells the others, with its correction for few residuals."""
    return variances_at(squares, units, dimension) if bool((units.group != STATED).any()) else np.ones(units.count)


def _by_row(deviations: Floats, units: Units, equations: Assembled) -> Floats:
    found = units.expanded(deviations)
    return found if equations.factors is None else found * equations.factors


def _with_loss(equations: Assembled, acting: Mask, scale: float) -> Assembled:
    """The equations with a Geman-McClure loss on the blocks that the rule acts on."""
    loss = LossFunction(kind=LossKind.GEMAN_MCCLURE, scale=scale)
    groups = tuple(
        replace(g, losses=(loss,) * len(g.whiteners)) if g.count and acting[g.first] else g for g in equations.groups
    )
    return replace(equations, groups=groups, linear=False)
