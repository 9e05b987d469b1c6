"""Consensus: the units that agree, found from many minimal subsets, improved, and brought to a fixed point.

The estimators differ in where trials come from and in their score only (``estimators``); the best few are improved by
fits to the units that they explain (Chum et al. 2003), the one that explains the data best is fitted to its inliers
until those stay the same. Nothing here knows what is measured.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb, sqrt

import numpy as np

from mbm.problem.types import Consensus
from mbm.solution.robust.estimators.lmeds import LMEDS
from mbm.solution.robust.estimators.msac import MSAC
from mbm.solution.robust.estimators.standard import BY_KIND
from mbm.solution.robust.estimators.types import ConsensusEstimator
from mbm.solution.robust.gnc import graduated
from mbm.solution.robust.joint import joint
from mbm.solution.robust.refine import Refined, Trimmed, Truncated, refined
from mbm.solution.robust.scores import cuts, variances_at
from mbm.solution.robust.subsets import minimal_subsets
from mbm.solution.robust.trials import Trials
from mbm.solution.robust.units import Units, consistency, robust_variance
from mbm.solution.types import Floats, Indices, Mask
from mbm.target.decisions import (
    APART,
    AS_GOOD,
    CANDIDATES,
    CONTRADICTED,
    FEW_STARTS,
    LARGE_SUBSET,
    MEMORY,
    MOST_FITS,
    REFINING_STEPS,
    SETTLING_ROUNDS,
    STATED,
    WIDE,
    WIDE_STEPS,
)
from mbm.target.solver.consensus_sample import FEWEST_TRIALS, trials_for_share
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreed:
    """The units that agree at a point.

    ``inliers`` (U,) have squared norms up to ``limits`` (U,) at ``point`` (N,); ``variances`` (U,) are those of the
    noise: 1 where it is stated, else estimated from the inliers. ``trials`` is the number of subsets; ``ambiguous``
    says that another point explains as much, ``cut_short`` that the trials were interrupted.
    """

    point: Floats
    inliers: Mask
    limits: Floats
    variances: Floats
    trials: int
    ambiguous: bool
    cut_short: bool = False

    @property
    def share(self) -> float:
        """Share of the units that agree."""
        return float(self.inliers.mean()) if self.inliers.size else 1.0


@np.errstate(all="ignore")
def agree(trials: Trials, units: Units, starts: Floats, consensus: Consensus, seed: int) -> Agreed:
    """The units that agree, by random subsets fitted from the ``starts`` (S, N) or by graduated non-convexity."""
    estimator = BY_KIND[consensus.kind]
    cut = cuts(units, consensus.threshold)
    count, size, points = 0, trials.dimension, starts
    if estimator.samples:
        jacobian = trials.linearised(starts[:1])[1][0]
        subsets = minimal_subsets(jacobian, units, consensus.trials, seed)
        count, size = subsets.shape
        if count:
            fits = max(count, min(count * len(starts), MOST_FITS))
            of = np.arange(fits) % count
            begun = starts[(np.arange(fits) // count + of) % len(starts)]
            fitted, which = trials.fitted(begun, subsets[of])
            if consensus.trials is None and count < comb(units.count, size) and bool((units.group == STATED).all()):
                count = _until_sure(trials, units, fitted, of[which], count, size, cut)
            points = np.concatenate((fitted[of[which] < count], starts))
    if not estimator.samples or size >= LARGE_SUBSET:
        unknown = units.group != STATED
        more = np.concatenate([graduated(trials, units, start, cut, unknown) for start in starts[:FEW_STARTS]])
        points = np.concatenate((points, more)) if estimator.samples else more
    if len(points) > CANDIDATES:
        points = _best_few(trials, units, points, estimator, size, cut)
    candidates, best, variances = _improved(trials, units, points, starts[0], cut, size)
    found = _finished(trials, units, candidates.points[best], consensus, variances)
    return replace(found, trials=count, ambiguous=_ambiguous(candidates, best, cut * variances))


@np.errstate(all="ignore")
def agree_near(trials: Trials, units: Units, point: Floats, consensus: Consensus) -> Agreed:
    """The units that agree with a point (N,) that is a consensus already, of some of the units."""
    squares = units.squares(trials.residuals(point[None]))[0]
    return _finished(trials, units, point, consensus, variances_at(squares, units, trials.dimension))


def _finished(trials: Trials, units: Units, point: Floats, consensus: Consensus, variances: Floats) -> Agreed:
    """The fixed point of fit, noise and inliers that is reached from a point."""
    cut = cuts(units, consensus.threshold)
    point, squares, variances = _settled(trials, units, point, cut, variances)
    limits = cut * variances
    inliers = squares <= limits
    if bool((units.group != STATED).any()) and bool(inliers.any()):
        found = joint(trials, units, point, inliers, cut, variances, widening=consensus.threshold is None)
        point, inliers, limits, variances = found.point, found.inliers, found.limits, found.noise
    return Agreed(
        point=point, inliers=inliers, limits=limits, variances=variances, trials=0, ambiguous=False
    )  # fmt: skip


def _until_sure(trials: Trials, units: Units, points: Floats, of: Indices, count: int, size: int, cut: Floats) -> int:
    """How many of the trials are enough: one of them has met only units of a solution as good as the best, or better.

    ``points`` (P, N) are fits to subsets of ``size`` units, ``of`` (P,) the trial that each belongs to.
    """
    inside = np.zeros(count, dtype=np.int64)
    for chunk in _chunks(len(points), units):
        squares = units.squares(trials.residuals(points[chunk]))
        np.maximum.at(inside, of[chunk], (squares <= cut).sum(axis=1))
    for done, most in enumerate(np.maximum.accumulate(inside).tolist(), start=1):
        if done >= FEWEST_TRIALS and done >= trials_for_share(most, units.count, size):
            return done
    return count


def _chunks(count: int, units: Units) -> list[slice]:
    """Points whose residuals are looked at together."""
    step = max(MEMORY // max(len(units.of_row), 1), 1)
    return [slice(first, first + step) for first in range(0, count, step)]


def _best_few(
    trials: Trials, units: Units, points: Floats, estimator: ConsensusEstimator, size: int, cut: Floats
) -> Floats:
    """The points with the lowest scores: by the limits, and by limits as wide as fits to a few units need."""
    chunks = _chunks(len(points), units)

    def ranked(rule: ConsensusEstimator, limits: Floats, few: int) -> Indices:
        parts = [rule.scores(units.squares(trials.residuals(points[c])), units, size, limits) for c in chunks]
        return np.argsort(np.concatenate(parts), kind="stable")[:few]

    by_median = ranked(LMEDS, cut, CANDIDATES)
    if not estimator.knows_limits:
        return np.asarray(points[by_median])
    limits = cut * variances_at(units.squares(trials.residuals(points[by_median[:1]]))[0], units, 0)
    found = [ranked(estimator, limits, CANDIDATES // 2), ranked(MSAC, WIDE * limits, CANDIDATES // 2)]
    if bool((units.group != STATED).any()):
        # The rule needs the noise; where that is unknown, trials with the least median may be the ones that know it.
        found.append(by_median)
    return np.asarray(points[np.unique(np.concatenate(found))])


def _improved(
    trials: Trials, units: Units, points: Floats, start: Floats, cut: Floats, size: int
) -> tuple[Refined, int, Floats]:
    """The candidates after fits to the units that they explain, the best one, and the variance of each unit (U,) there.

    Of equally good ones that nearest to ``start`` (N,) is the best.
    """
    ones = np.ones(units.count)
    unknown = bool((units.group != STATED).any())
    if unknown:
        found = refined(trials, units, points, Trimmed(units, cut, size), iterations=REFINING_STEPS)
    else:
        squares = units.squares(trials.residuals(points))
        own = [max(robust_variance(each, units, trials.dimension), 1.0) for each in squares]
        wide = refined(trials, units, points, Truncated(cut * np.array(own)[:, None], ones), iterations=WIDE_STEPS)
        both = np.concatenate((points, wide.points))  # wide limits help a poor subset, and mislead one of two halves
        found = refined(trials, units, both, Truncated(cut, ones), iterations=REFINING_STEPS)
    best = found.best(_distances(trials, found.points, start))
    return found, best, variances_at(found.squares[best], units, trials.dimension) if unknown else ones


def _distances(trials: Trials, points: Floats, start: Floats) -> Floats:
    """How far the points (K, N) are from the start, in the metric of the Jacobian there, (K,)."""
    jacobian = trials.linearised(start[None])[1][0]
    scale = np.linalg.norm(np.where(np.isfinite(jacobian), jacobian, 0.0), axis=0)
    away = (trials.coordinates(points) - trials.coordinates(start[None])) * scale
    return np.asarray(np.linalg.norm(away, axis=1), dtype=np.float64)


def _settled(
    trials: Trials, units: Units, point: Floats, cut: Floats, variances: Floats
) -> tuple[Floats, Floats, Floats]:
    """Point, squared norms and variances where fit, scale and inliers agree with one another."""
    stated = units.group == STATED
    before: Mask | None = None
    squares = np.empty(units.count)
    for _ in range(SETTLING_ROUNDS):
        found = refined(trials, units, point[None], Truncated(cut * variances, variances), iterations=REFINING_STEPS)
        point, squares = found.points[0], found.squares[0]
        inliers = squares <= cut * variances
        if before is not None and bool((inliers == before).all()):
            break
        before = inliers
        fresh = variances_at(squares, units, trials.dimension)
        if stated.any():
            contradicted = _contradicted(squares, units, trials.dimension, cut, inliers & stated)
            wide = max(robust_variance(squares, units, trials.dimension, stated), 1.0)
            fresh[stated] = wide if contradicted else variances[stated]
        variances = fresh
    return point, squares, variances


def _contradicted(squares: Floats, units: Units, dimension: int, cut: Floats, inliers: Mask) -> bool:
    """Whether the inliers scatter by more than the stated noise."""
    freedom = int(units.components[inliers].sum()) - dimension
    if freedom <= 0:
        return False
    expected = float((units.components * consistency(units.components, cut))[inliers].sum())
    excess = float(squares[inliers].sum()) / freedom * (freedom + dimension) / expected - 1.0
    return excess > CONTRADICTED * sqrt(2.0 / freedom)


def _ambiguous(candidates: Refined, best: int, limits: Floats) -> bool:
    """Whether another candidate explains the data as well, at a place that contradicts the best one's inliers."""
    close = candidates.objective < candidates.objective[best] + AS_GOOD
    inliers = candidates.squares[best] <= limits
    if not inliers.any():
        return False
    sums = np.minimum(candidates.squares[:, inliers], 1e6).sum(axis=1)
    return bool((close & (sums > sums[best] + APART)).any())
