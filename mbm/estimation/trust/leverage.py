"""Rows with leverage under a loss: a loss bounds what a large residual does, but such a row draws the fit to itself.

What shows it is the residual from the fit without the row, over its standard deviation there, and how far the row moves
that fit, in standard deviations of the estimates (Belsley, Kuh and Welsch 1980, Regression Diagnostics, chapter 2).

Where a loss descends again, a row may hold alone what others would hold, whose weight it has taken: a false loop of a
pose graph in the place of the two steps at the ends of a stretch. Without it the fit goes where these want it; if all
rows together, that one too, cost less there, the minimum was not the least.

Noise that consensus estimates from few rows for each unknown comes out several times too small, as most of those that
agree by chance are fitted nearly exactly. The residuals, over their own standard deviations, tell it
again, without the row: by the median of the largest, as many as there are unknowns left out (Street, Carroll and
Ruppert 1988, The American Statistician 42, 152-154).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.excerpt import excerpt
from mbm.equations.losses import loss_weights
from mbm.equations.metric import cost_at
from mbm.equations.surface import plainly_affine
from mbm.equations.types import Covariance, Floats, Indices, Mask, Minimum
from mbm.estimation.consensus.units import MEDIANS
from mbm.estimation.minimise.minimise import minimise
from mbm.estimation.settings import Settings
from mbm.estimation.trust import faults
from mbm.estimation.uncertainty.student import coverage_factor
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.solver.decisions import EPSILON
from mbm.text.types import Diagnostic
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixedWeights:
    """The ``equations`` without losses, times ``roots`` (m,) of weights."""

    equations: Assembled
    roots: Floats

    @property
    def count(self) -> int:
        """m, the residuals."""
        return self.equations.count

    @property
    def linear(self) -> bool:
        """The plain residuals are affine."""
        return plainly_affine(self.equations)

    def residuals(self, x: Floats) -> Floats:
        """Residuals (m,) at a point."""
        return self.roots * self.equations.plain_residuals(x)

    def jacobian(self, x: Floats) -> Floats:
        """Their derivatives (m, n) by a step."""
        return self.roots[:, None] * self.equations.plain_jacobian(x)

    def retract(self, x: Floats, step: Floats) -> Floats:
        """The points after steps."""
        return self.equations.retract(x, step)


def fixed_weights(
    equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[FixedWeights, Minimum, Covariance] | None:
    """The equations, the minimum and the covariance with fixed weights; None where the weights leave too little."""
    plain = equations.plain_residuals(minimum.point)
    roots = np.sqrt(loss_weights(loss_lines(equations), plain))
    fixed = FixedWeights(equations=equations, roots=roots)
    residuals, jacobian = roots * plain, fixed.jacobian(minimum.point)
    image = jacobian @ estimated.factor
    gram = image.T @ image
    if not bool(np.isfinite(gram).all()) or not len(gram):
        return None
    lengths, axes = np.linalg.eigh(gram)
    if not float(lengths[0]) > 0.0:
        return None
    variance = float(np.trace(gram)) / len(gram)
    factor = estimated.factor @ (axes * np.sqrt(variance / lengths)) @ axes.T
    alike = replace(estimated, factor=factor, sigma=np.sqrt(np.square(factor).sum(axis=1)))
    cost = float(residuals @ residuals)
    return fixed, replace(minimum, residuals=residuals, jacobian=jacobian, cost=cost), alike


CHANCE = 0.01
"""Probability that a row of any solve without outliers is as far from the others."""

MOVED = 1.0
"""Standard deviations by which such a row moves the estimates from where the others have them."""

ALONE, KEPT = 0.01, 0.25
"""Share of what is known where a row is that others know, up to which it holds alone, and the weight of rows that are
not left out: the others then have weights below a hundredth, at ten deviations of a Cauchy loss."""

TRIED = 12
"""Rows that are left out by turns, those that move the fit farthest first."""

BETTER = 1.0
"""How much less all rows cost at a better place, in squared standard deviations: more than a minimum is rounded by."""

ROUGH = Settings(tolerance=1e-3, max_iterations=20)
"""Of places that are compared."""


def farthest(rows: Indices) -> Floats:
    """Standard deviations that the farthest of so many ``rows`` (…) without outliers is away, but for `CHANCE`."""
    return np.asarray(np.sqrt(2.0 * np.log(np.maximum(rows, 2) / CHANCE)))


@np.errstate(all="ignore")
def drawn(residuals: Floats, basis: Floats, weights: Floats, rows: Indices, share: float = 0.0) -> Mask:
    """Which rows (…, m) draw the fit to themselves, or nearly: nearer to the limits than by a ``share``.

    ``residuals`` (…, m) are plain, ``basis`` (…, m, k) is their Jacobian times a factor of the inverse of Jᵀ W J with
    the ``weights`` (…, m), of which ``rows`` (…) are there.
    """
    leverage = np.square(basis).sum(axis=-1)
    rest = 1.0 - weights * leverage
    misfit = np.abs(residuals) / np.sqrt(rest)
    moved = weights * np.abs(residuals) * np.sqrt(leverage) / rest
    limit = farthest(rows)[..., None]
    found = (misfit > limit * (1.0 - share)) & (moved > MOVED * (1.0 - share)) & (weights > 0.0)
    return np.asarray(found | ((rest <= 0.0) & (leverage > 0.0)))


@np.errstate(all="ignore")
def _apart(problem: Problem, equations: Assembled, point: Floats, factor: Floats, without: Mask) -> Floats:
    """How far each row (m,) is from the fit ``without`` some, in standard deviations; NaN where that is none.

    That is where the others do not determine all that ``factor`` (n, k) spans, which all rows do. Unknown noise is that
    of the others there, or as estimated, whichever is larger; distances by Student's law are those of the normal law
    that are as rare.
    """
    units = np.setdiff1d(equations.units, equations.units[without])
    if not len(units):
        return np.full(equations.count, np.nan)
    others = excerpt(replace(equations, numbers=point), equations.free, units)
    there = minimise(others, point, ROUGH).point
    residuals, slopes = equations.plain_residuals(there), equations.plain_jacobian(there)
    weights = np.where(without, 0.0, loss_weights(loss_lines(equations), residuals))
    # Scaled by what the others know: beside a row far out it would vanish.
    lengths = np.linalg.norm(np.sqrt(weights)[:, None] * slopes, axis=0)
    scale = np.where(lengths > 0.0, lengths, 1.0)
    slopes = slopes / scale @ np.linalg.svd(scale[:, None] * factor, full_matrices=False)[0]
    _, values, axes = np.linalg.svd(np.sqrt(weights)[:, None] * slopes, full_matrices=False)
    if not values[-1] > EPSILON * max(slopes.shape) * values[0]:
        return np.full(equations.count, np.nan)
    leverage = np.square(slopes @ axes.T / values).sum(axis=1)
    deviations = np.sqrt(1.0 + np.where(without, leverage, -weights * leverage))
    found = np.abs(residuals) / deviations
    for number, block in enumerate(problem.blocks):
        every = equations.noise_rows(number)
        rows = every[~without[every]]
        if block.unknown_factor and len(rows):
            own, rare = float((weights * leverage)[rows].sum()), 1.0 - CHANCE / len(every)
            largest = np.sort(found[rows])[min(max(round(own) - 1, 0), len(rows) - 1) :]
            noise = np.fmax(np.median(largest) / np.sqrt(MEDIANS[0]), 1.0)
            student = coverage_factor(rare, max(len(rows) - own, 1.0)) / coverage_factor(rare, inf)
            found[every] /= noise * student
    return np.asarray(found)


@np.errstate(all="ignore")
def _usurping(equations: Assembled, minimum: Minimum, basis: Floats, weights: Floats) -> Mask:
    """Rows (m,) without which the fit goes to where all rows, these too, cost less; as `drawn` is given them."""
    found = np.zeros(equations.count, dtype=bool)
    if all(loss.convex for loss, _ in loss_lines(equations)):
        return found
    leverage = np.square(basis).sum(axis=1)
    rest = 1.0 - weights * leverage
    moved = weights * np.abs(equations.plain_residuals(minimum.point)) * np.sqrt(leverage) / rest
    alone = (rest < ALONE) & (rest > 0.0) & (weights > KEPT) & (moved > MOVED)
    units, cost = np.unique(equations.units), cost_at(equations, minimum.point)
    farthest = dict.fromkeys(equations.units[alone][np.argsort(-moved[alone], kind="stable")].tolist())
    for unit in list(farthest)[:TRIED]:
        others = excerpt(replace(equations, numbers=minimum.point), equations.free, np.setdiff1d(units, [unit]))
        there = minimise(others, minimum.point, ROUGH).point
        if cost_at(equations, there) < cost - BETTER:
            found |= equations.units == unit
    return found


def _foremost(wrong: Mask, shares: Floats) -> Mask:
    """Those of the ``wrong`` rows with the largest ``shares``; the others are what these draw the fit away from."""
    return np.asarray(wrong & (shares >= np.where(wrong, shares, 0.0).max(initial=0.0) / 2.0))


@np.errstate(all="ignore")
def leverage(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[Diagnostic, ...]:
    """A warning for each clause with a loss some of whose rows draw the fit to themselves."""
    if not equations.lossy or minimum.blocks is not None or equations.rows is not None:
        return ()
    found = fixed_weights(equations, minimum, estimated)
    if found is None:
        return ()
    fixed, weighed, alike = found
    image = weighed.jacobian @ alike.factor
    variance = float(np.square(image).sum()) / image.shape[1]
    basis = equations.plain_jacobian(minimum.point) @ alike.factor / np.sqrt(variance)
    weights, rows = np.square(fixed.roots), np.array(equations.count)
    lossy = np.zeros(equations.count, dtype=bool)
    for _, lines in loss_lines(equations):
        lossy[lines] = True
    residuals, shares = equations.plain_residuals(minimum.point), weights * np.square(basis).sum(axis=1)
    wrong = _foremost(drawn(residuals, basis, weights, rows) & lossy, shares)
    if wrong.any():
        apart = _apart(problem, equations, minimum.point, alike.factor, wrong)
        # What others do not know at all they cannot contradict.
        wrong &= np.where(np.isnan(apart), 1.0 - shares > ALONE, apart > farthest(rows))
    wrong |= _usurping(equations, minimum, basis, weights) & lossy
    wrong = _foremost(wrong, shares)
    told = []
    for group in (each for each in equations.groups if each.rows):
        own = wrong[group.first : group.first + group.count].reshape(group.rows, -1).any(axis=1)
        block = problem.blocks[group.kernel.owner]
        if not own.any() or block.table is None or group.positions is None:
            continue
        numbers = [int(row) for row in tables[block.table].rows[np.asarray(group.positions)[own]]]
        told.append(faults.bad_leverage(block.span, block.name, numbers))
    return tuple(told)
