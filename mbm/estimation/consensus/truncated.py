"""Truncated least squares with any number of unknowns, led there by graduated non-convexity.

Yang, Antonante, Tzoumas and Carlone (2020): from least squares to squares that are cut off at their limit, by weights
that go to 0 or 1. Rows that are trusted keep the weight 1 throughout, and the way begins at a fit to these: the others
gain weight by degrees, and bend it to where most of them agree. Of several ways the answer is the one whose truncated
sum of squares is the least.

Consensus with very many connected unknowns: no subset is clean, so losses lead from least squares to the inliers.

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
from mbm.equations.manifolds import of_arrays
from mbm.equations.types import Floats, Indices, Mask, Minimum
from mbm.estimation.consensus.types import Agreed, Asked, Checked
from mbm.estimation.consensus.units import Units, cuts, limits_of, variances_at, without_losses
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.minimise.sparsity import sparse_suits
from mbm.estimation.settings import Settings
from mbm.problem.kinds import LossKind
from mbm.solver.chi_square import inform_units, untruncated
from mbm.solver.consensus_records import Units as SolverUnits
from mbm.solver.consensus_refine import gnc_weight
from mbm.solver.decisions import CONTROL_GROWTH, GRADUATED_ROUNDS, LEAST_SHARE, STATED
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
        self.asked = asked
        self._settings = replace(asked.settings, robust=None)
        self._plan: object = None

    def squares(self, point: Floats) -> Floats:
        """Squared norms (U,) of the units at a point."""
        return self.units.squares(self.plain.plain_residuals(point))

    def fitted(self, point: Floats, weights: Floats, variances: Floats, steps: int) -> Minimum:
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
        return minimise(weighted, point, settings, self.asked.problem.span)

    def _sparsely(self, weighted: Assembled, point: Floats, settings: Settings) -> Minimum:
        # Loaded by large problems only.
        from mbm.estimation.minimise.sparse import sparse_minimum
        from mbm.sparse.equations import blocked
        from mbm.sparse.system import Plan, plan

        equations = blocked(weighted)
        if not isinstance(self._plan, Plan):
            self._plan = plan(equations.structure(), equations.backend, settings.workers)
        return sparse_minimum(equations, point, settings, self._plan)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """A point (N,) to start from, in words where it is from, and the units (U,) that keep their weight on the way.

    ``whole``: these are nearly all that agree, and the others get no weight before they do.
    """

    start: Floats
    origin: str
    held: Mask
    whole: bool = False


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
    rule = _Rule(cut=limits_of(units, asked.consensus), trusted=trusted, dimension=asked.spent(equations))
    ends = [_settled(fits, rule, _graduated(fits, rule, way)) for way in ways if not asked.settings.stopped()]
    best = min(ends, key=lambda end: end[1]) if ends else _settled(fits, rule, ways[0].start)
    return replace(best[0], cut_short=asked.settings.stopped())


def _graduated(fits: _Fits, rule: _Rule, way: Way) -> Floats:
    """Where the weights have become 0 or 1; without rows that are held the way begins at the fit to all of them."""
    units = fits.units
    squares = fits.squares(way.start)
    counting = np.isfinite(squares) & (way.held if way.held.any() else True)
    variances, _ = rule.limits(squares, units)
    point = fits.fitted(way.start, counting.astype(float), variances, FIRST_STEPS).point
    squares = fits.squares(point)
    variances, limits = rule.limits(squares, units)
    limits = np.where(way.held, np.inf, limits)
    with np.errstate(divide="ignore", invalid="ignore"):
        over = np.isfinite(squares) & (squares > limits)
        ratio = limits[over] / (2.0 * squares[over] - limits[over])
    if way.whole or not over.any():
        return point
    control = float(max(ratio.min(), 1e-12))
    for _ in range(GRADUATED_ROUNDS):
        weights = np.where(np.isfinite(squares), of_arrays(gnc_weight)(squares, limits, control), 0.0)
        point = fits.fitted(point, weights, variances, 1).point
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
        end = fits.fitted(point, inliers.astype(float), variances, SETTLED_STEPS)
        point, squares = end.point, fits.squares(end.point)
        kept = Agreed(point=point, inliers=inliers, limits=limits, variances=variances)
        redundancy = redundancy_of(fits.asked, fits.plain, units, kept, end)
        noise = noise_of_inliers(squares, inliers, variances, units, redundancy, rule.cut * variances)
    cost = float(np.nan_to_num(np.minimum(squares, limits) / variances, nan=np.inf).sum())
    if bool((units.group != STATED).any()):  # each way has a noise of its own: the most rows agree, not the closest
        cost = -float(units.components[inliers].sum())
    return Agreed(point=point, inliers=inliers, limits=limits, variances=np.asarray(noise)), cost


WIDTHS = (64.0, 16.0, 8.0, 4.0, 2.0, 1.0)
"""Parameters of the loss one after the other, in multiples of the limit."""

NARROW = (2.0, 1.0)
"""… and where the start is so good that it tells wrong equations from good ones, which the wide losses would spoil."""

FEW_STEPS = 30
"""Iterations of a minimum that is only on the way."""

NARROWED_ROUNDS = 10


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
            variances = _variances(squares, units, asked.spent(plain))
            factors = _by_row(np.sqrt(variances), units, plain)
            lossy = _with_loss(plain, acting, width * float(np.sqrt(cut.max()))).with_factors(factors)
            point = minimise(lossy, point, way, problem.span).point
            squares = units.squares(plain.plain_residuals(point))
        return _fitted_to_inliers(replace(asked, settings=way), plain, units, point, cut)

    found = most_agreeing([narrowed(WIDTHS, start), narrowed(NARROW, start)], units)
    if found.share >= LEAST_SHARE:
        return found
    # So far from the start that the losses hold next to nothing: least squares see every row.
    fitted = minimise(plain, start, replace(way, max_iterations=asked.settings.max_iterations), problem.span).point
    return most_agreeing([found, narrowed(WIDTHS, fitted)], units)


def most_agreeing(candidates: Sequence[Agreed], units: Units) -> Agreed:
    """The one that most residuals agree with; of equals the first."""
    counts = [int(units.components[candidate.inliers].sum()) for candidate in candidates]
    return candidates[int(np.argmax(counts))]


def fitted(asked: Asked, equations: Assembled, units: Units, found: Agreed) -> Minimum:
    """The fit to the units that agree, weighted by their noise, where the constraints hold."""
    plain = without_losses(equations)
    weighted = plain.with_factors(_by_row(np.sqrt(found.variances), units, plain)).kept(
        units.kept(plain, found.inliers)
    )
    return minimise(weighted, found.point, asked.settings, asked.problem.span)


def _fitted_to_inliers(asked: Asked, plain: Assembled, units: Units, point: Floats, cut: Floats) -> Agreed:
    """Fits to the inliers until they stay the same."""
    before, spent = None, asked.spent(plain)
    squares = units.squares(plain.plain_residuals(point))
    for _ in range(NARROWED_ROUNDS):
        variances = _variances(squares, units, spent)
        inliers = squares <= cut * variances
        if before is not None and bool((inliers == before).all()):
            break
        before = inliers
        kept = Agreed(point=point, inliers=inliers, limits=cut * variances, variances=variances)
        point = fitted(asked, plain, units, kept).point
        squares = units.squares(plain.plain_residuals(point))
    limits = cut * variances
    inliers = squares <= limits
    found = Agreed(point=point, inliers=inliers, limits=limits, variances=variances)
    redundancy = redundancy_of(asked, plain, units, found)
    noise = noise_of_inliers(squares, inliers, variances, units, redundancy, limits)
    return replace(found, variances=noise, redundancy=redundancy)


def redundancy_of(asked: Asked, plain: Assembled, units: Units, found: Agreed, end: Minimum | None = None) -> Floats:
    """The redundancy (U,) of each unit that agrees, at the ``end`` of a fit to these (None: it is made).

    Where all rows have one noise, unknowns are shared out by number of residuals, which leaves the sum as it is.
    """
    total = int(units.components[found.inliers].sum())
    unknown = units.group != STATED
    alike = not unknown.any() or bool((units.of_row >= 0).all() and (units.group == units.group[0]).all())
    if alike or asked.checked is None or not total:
        return np.asarray(units.components * (1.0 - asked.spent(plain) / total if total else 0.0))
    end = fitted(asked, plain, units, found) if end is None else end
    return units.summed(redundancy_by_row(asked.checked, plain, units, found.inliers, end))


def redundancy_by_row(checked: Checked, plain: Assembled, units: Units, inliers: Mask, end: Minimum) -> Floats:
    """How much of each residual (all,) shows at a minimum of the units that agree; of a unit left out, all."""
    found = np.ones(plain.whole)
    found[units.expanded(inliers.astype(float)) > 0.0] = checked(plain, end)
    return found


def noise_of_inliers(
    squares: Floats, inliers: Mask, variances: Floats, units: Units, redundancy: Floats, limits: Floats
) -> Floats:
    """The variance (U,) of the noise, as stated or ``SSE/(r κ)`` of the ``inliers`` (U,) with ``redundancy`` r (U,).

    κ is what normal noise has left inside the ``limits`` (U,), which are equal for units of as many components in a
    group. Without redundancy ``variances`` (U,) stay.
    """
    noise = variances.copy()
    for group in np.unique(units.group[units.group != STATED]).tolist():
        mine = np.flatnonzero(inliers & (units.group == group))
        freedom = float(redundancy[mine].sum())
        if freedom > 0.0:
            least = max(float(units.rounding[mine].max()), 1e-300)
            raw = max(float(squares[mine].sum()) / freedom, least)
            noise[units.group == group] = untruncated(_listed(units.components[mine], limits[mine]), 0, 0, raw)
    return noise


def informing(units: Units, squares: Floats, found: Agreed) -> Floats:
    """What the units inform by (U,) where they agree, at squared norms (U,): `chi_square.inform_units`."""
    known, numbers = np.unique(units.group, return_inverse=True)
    unknown = known[known != STATED]
    listed = SimpleNamespace(
        count=units.count,
        group=(numbers - 1 if len(unknown) < len(known) else numbers).tolist(),
        inlier=found.inliers.tolist(),
        components=units.components.tolist(),
        limits=found.limits.tolist(),
        noise=found.variances.tolist(),
        information=[1.0] * units.count,
    )
    inform_units(cast("SolverUnits", listed), len(unknown), squares.tolist())
    return np.array(listed.information)


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
