"""Truncated least squares with any number of unknowns, led there by graduated non-convexity.

Yang, Antonante, Tzoumas and Carlone (2020): from least squares to squares that are cut off at their limit, by weights
that go to 0 or 1. Rows that are trusted keep the weight 1 throughout, and the way begins at a fit to these: the others
gain weight by degrees, and bend it to where most of them agree. Of several ways the answer is the one whose truncated
sum of squares is the least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.formulas import of_arrays
from mbm.equations.types import Floats, Mask
from mbm.estimation.consensus.binding import without_losses
from mbm.estimation.consensus.many import noise_of_inliers
from mbm.estimation.consensus.scores import limits_of, variances_at
from mbm.estimation.consensus.types import Agreed, Asked
from mbm.estimation.consensus.units import Units
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.sparsity import sparse_suits
from mbm.estimation.settings import Settings
from mbm.solver.consensus_gnc import gnc_weight
from mbm.solver.decisions import CONTROL_GROWTH, GRADUATED_ROUNDS, STATED
from mbm.values import dataclass

FIRST_STEPS = 30
"""Iterations of the fit to all rows."""

SETTLED_STEPS = 20
"""Iterations of a fit to the rows that were kept."""

ROUNDS = 20
"""Fits to what is kept, until that stays the same."""

LEAST_WEIGHT = 1e-6
"""Weights nearer to 0 or 1 are these."""


class _Fits:
    """Fits of weighted units; the pattern of large sparse equations is found once for all."""

    def __init__(self, asked: Asked, equations: Assembled, units: Units) -> None:
        self.units = units
        self.plain = without_losses(equations).roughly_corrected()
        self._asked = asked
        self._settings = replace(asked.settings, robust=None)
        self._plan: object = None

    def squares(self, point: Floats) -> Floats:
        """Squared norms (U,) of the units at a point."""
        return self.units.squares(self.plain.plain_residuals(point))

    def fitted(self, point: Floats, weights: Floats, variances: Floats, steps: int) -> Floats:
        """Where so many iterations lead with weights (U,) of the units, and variances (U,) of the noise."""
        counting = weights > LEAST_WEIGHT
        keep = np.ones(int(self.plain.units.max()) + 1, dtype=bool)
        keep[self.units.number] = counting
        factors = self.units.expanded(np.sqrt(variances / np.where(counting, weights, 1.0)))
        factors = factors if self.plain.factors is None else factors * self.plain.factors
        weighted = self.plain.with_factors(factors).kept(keep)
        settings = replace(self._settings, max_iterations=min(steps, self._settings.max_iterations))
        if sparse_suits(weighted) and not weighted.constraints and weighted.implicit is None and settings.iterative:
            return self._sparsely(weighted, point, settings)
        return minimise(weighted, point, settings, self._asked.problem.span).point

    def _sparsely(self, weighted: Assembled, point: Floats, settings: Settings) -> Floats:
        # Loaded by large problems only.
        from mbm.estimation.minimise.sparse import sparse_minimum
        from mbm.sparse.equations import blocked
        from mbm.sparse.system import Plan, plan

        equations = blocked(weighted)
        if not isinstance(self._plan, Plan):
            self._plan = plan(equations.structure(), equations.backend, settings.workers)
        return sparse_minimum(equations, point, settings, self._plan).point


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """A point (N,) to start from, in words where it is from, and the units (U,) that keep their weight on the way."""

    start: Floats
    origin: str
    held: Mask


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rule:
    """Limits (U,) of squares in units of the variance, and which units (U,) are never rejected."""

    cut: Floats
    trusted: Mask
    dimension: int

    def limits(self, squares: Floats, units: Units, noise: Floats | float = 0.0) -> tuple[Floats, Floats]:
        """The variances (U,) and limits (U,) at squares; no limit for what is trusted.

        Where the noise is unknown, it is the robust one, or that of the inliers so far (U,), ``noise``, if that is
        larger: where most rows are hardly checked by others, a fit leaves them small residuals.
        """
        unknown = units.group != STATED
        variances = np.ones(units.count)
        if bool(unknown.any()):
            variances = np.where(unknown, np.maximum(variances_at(squares, units, self.dimension), noise), 1.0)
        return variances, np.where(self.trusted, np.inf, self.cut * variances)


def agree_by_truncation(asked: Asked, equations: Assembled, units: Units, ways: Sequence[Way], trusted: Mask) -> Agreed:
    """The units that agree, by the best of some ways, one at least; those ``trusted`` (U,) do in any case."""
    fits = _Fits(asked, equations, units)
    rule = _Rule(cut=limits_of(units, asked.consensus), trusted=trusted, dimension=equations.dimension)
    ends = [_settled(fits, rule, _graduated(fits, rule, way)) for way in ways if not asked.settings.stopped()]
    best = min(ends, key=lambda end: end[1]) if ends else _settled(fits, rule, ways[0].start)
    return replace(best[0], cut_short=asked.settings.stopped())


def _graduated(fits: _Fits, rule: _Rule, way: Way) -> Floats:
    """Where the weights have become 0 or 1; without rows that are held the way begins at the fit to all of them."""
    units = fits.units
    squares = fits.squares(way.start)
    counting = np.isfinite(squares) & (way.held if way.held.any() else True)
    variances, _ = rule.limits(squares, units)
    point = fits.fitted(way.start, counting.astype(float), variances, FIRST_STEPS)
    squares = fits.squares(point)
    variances, limits = rule.limits(squares, units)
    limits = np.where(way.held, np.inf, limits)
    with np.errstate(divide="ignore", invalid="ignore"):
        over = np.isfinite(squares) & (squares > limits)
        ratio = limits[over] / (2.0 * squares[over] - limits[over])
    if not over.any():
        return point
    control = float(max(ratio.min(), 1e-12))
    for _ in range(GRADUATED_ROUNDS):
        weights = np.where(np.isfinite(squares), of_arrays(gnc_weight)(squares, limits, control), 0.0)
        point = fits.fitted(point, weights, variances, 1)
        squares = fits.squares(point)
        variances, closer = rule.limits(squares, units)
        limits = np.where(way.held, np.inf, closer)
        if bool(((weights <= LEAST_WEIGHT) | (weights >= 1.0 - LEAST_WEIGHT)).all()):
            break
        control *= CONTROL_GROWTH
    return point


def _settled(fits: _Fits, rule: _Rule, point: Floats) -> tuple[Agreed, float]:
    """Fits to the units within their limits until they stay the same, and what it costs: the truncated squares."""
    units = fits.units
    before: Mask | None = None
    noise: Floats | float = 0.0
    squares = fits.squares(point)
    for _ in range(ROUNDS):
        variances, limits = rule.limits(squares, units, noise)
        inliers = squares <= limits
        if before is not None and bool((inliers == before).all()):
            break
        before = inliers
        point = fits.fitted(point, inliers.astype(float), variances, SETTLED_STEPS)
        squares = fits.squares(point)
        noise = noise_of_inliers(squares, inliers, variances, units, rule.dimension, rule.cut * variances)
    cost = float(np.nan_to_num(np.minimum(squares, limits) / variances, nan=np.inf).sum())
    if bool((units.group != STATED).any()):  # each way has a noise of its own: the most rows agree, not the closest
        cost = -float(units.components[inliers].sum())
    return Agreed(point=point, inliers=inliers, limits=limits, variances=np.asarray(noise)), cost
