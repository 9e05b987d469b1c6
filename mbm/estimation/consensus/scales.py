"""The noise factors of rows with a loss, from the units that agree."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Noise, NoiseState
from mbm.estimation.consensus.truncated import fitted, noise_of_inliers, redundancy_by_row, redundancy_of
from mbm.estimation.consensus.types import Agreed, Asked, Checked
from mbm.estimation.consensus.units import Units, cuts, variances_at, without_losses
from mbm.solver.decisions import STATED
from mbm.solver.noise_factors import LEAST_REDUNDANCY, noise_ratio

FITS = 200
"""Fits until the variances settle: each leaves about half of what they are off, and more of several noises."""

SETTLED_VARIANCES = 1e-3
"""Relative change of all variances that ends the fits: far below what a thousand rows tell of them."""


LEAST_SHOWN = 1.0
"""Redundancy of all units of a noise together, in readings, below which they tell next to nothing of it: where a state
is read far better than transitions tell it, each shows hardly at all."""


def loss_noise(
    asked: Asked, equations: Assembled, units: Units, found: Agreed
) -> tuple[Floats | None, Mapping[int, Noise]]:
    """Factors (all residuals,) and noise of the blocks that have a loss and unknown noise."""
    groups = np.unique(units.group[units.group != STATED]).tolist()
    lossy = [number for number in groups if asked.problem.blocks[number].loss is not None]
    if not lossy:
        return None, {}
    redundancy = found.redundancy
    if redundancy is None:
        redundancy = redundancy_of(asked, without_losses(equations), units, found)
    least = LEAST_REDUNDANCY if asked.problem.sequence is None else LEAST_SHOWN
    factors = np.ones(equations.whole)
    noise: dict[int, Noise] = {}
    for number in lossy:
        mine = units.group == number
        variance = float(found.variances[mine].mean())
        checked = float(redundancy[mine & found.inliers].sum()) > least
        exact = variance <= units.rounding[mine & found.inliers].max(initial=0.0)
        state = NoiseState.NO_REDUNDANCY if not checked else NoiseState.EXACT if exact else NoiseState.ESTIMATED
        factor = sqrt(variance) if state is NoiseState.ESTIMATED else 1.0
        noise[number] = Noise(factor=factor, state=state, settled=found.settled)
        factors[equations.block_rows(number)] = factor
    return factors, noise


@np.errstate(all="ignore")
def agree_beside_others(asked: Asked, equations: Assembled, units: Units, point: Floats, checked: Checked) -> Agreed:
    """The units that agree where other rows tell the unknowns as well (transitions, priors).

    From a fit at ``point`` (N,) to all rows with the noise as it stands, or a larger one if its residuals say so,
    rounds of fits to the units within their limits. What is judged is the squared norm of a unit by its redundancy, and
    the variance is that of the inliers by theirs: a row that few others check has a small residual however large its
    noise is. Unknown noise of the other rows is estimated beside (Förstner 1979).
    """
    plain = without_losses(equations)
    others = [i for i, block in enumerate(asked.problem.blocks) if block.unknown_factor and not _within(i, units)]
    factors = np.ones(equations.whole)
    cut = cuts(units, None)
    squares = units.squares(plain.plain_residuals(point))
    found = Agreed(
        point=point,
        inliers=np.isfinite(squares),
        limits=np.full(units.count, np.inf),
        variances=np.maximum(variances_at(squares, units, 0), 1.0),
    )
    for _ in range(FITS):
        end = fitted(asked, plain.with_factors(factors), units, found)
        by_row = redundancy_by_row(checked, plain, units, found.inliers, end)
        redundancy = units.summed(by_row)
        residuals = plain.plain_residuals(end.point)
        squares = units.squares(residuals)
        told = redundancy > LEAST_REDUNDANCY
        normed = np.where(told, squares * units.components / redundancy, 0.0)
        variances = variances_at(normed, units, 0, told)
        limits = cut * variances
        inliers = normed <= limits
        variances = noise_of_inliers(squares, inliers, variances, units, redundancy, limits)
        ratios = [variances / found.variances]
        for rows in map(plain.noise_rows, others):
            left = float(np.square(residuals[rows] / factors[rows]).sum()), float(by_row[rows].sum())
            ratios.append(np.full(1, noise_ratio(*left) ** 2))
            factors[rows] *= noise_ratio(*left)
        found = Agreed(point=end.point, inliers=inliers, limits=limits, variances=variances, redundancy=redundancy)
        ended = bool((variances <= units.rounding).all()) or not np.isfinite(end.cost) or not inliers.any()
        if (
            ended
            or asked.settings.stopped()
            or max(float(np.abs(each - 1.0).max()) for each in ratios) <= SETTLED_VARIANCES
        ):
            return found
    return replace(found, settled=False)


def _within(number: int, units: Units) -> bool:
    """Whether the noise of a block is that of some units."""
    return bool((units.group == number).any())
