"""What outlier rules act on: units (one equation in one table row), their noise groups, and their limits."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import erfc, sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.losses import Acting
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.minimise.sparsity import sparse_suits
from mbm.problem.types import Block, Consensus, Problem
from mbm.solver import chi_square
from mbm.solver.decisions import CONSENSUS_ROUNDING, STATED
from mbm.values import dataclass

CUT = 2.5
"""Robust standard deviations beyond which a unit of one component is an outlier (Rousseeuw and Leroy 1987, 5.1)."""

MEDIANS = (0.454936423119572, 1.386294361119891, 2.3659738843753377, 3.3566939800333224, 4.351460191095526)
"""Medians of χ²_d for d = 1 … 5; others are computed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Units:
    """The units that an outlier rule may take out.

    ``of_row`` (m,) is the unit of each scalar residual, from 0, or -1 where the rule does not act (priors).
    ``components`` (U,) is the number of residuals of each unit, ``group`` (U,) the block whose unknown noise factor it
    shares, `STATED` where the noise is stated. ``number`` (U,) is what the equations call it, ``rounding`` (U,) the
    squared norm that the arithmetic alone makes.
    """

    of_row: Indices
    components: Indices
    group: Indices
    number: Indices
    rounding: Floats

    @property
    def count(self) -> int:
        """Units."""
        return len(self.components)

    @property
    def scalars(self) -> int:
        """Scalar residuals of all units."""
        return int(self.components.sum())

    def squares(self, residuals: Floats) -> Floats:
        """Squared norms (…, U) of the units from residuals (…, m); infinite where one is not finite."""
        ruled = self.of_row >= 0
        squares = np.square(residuals[..., ruled])
        if self.scalars != self.count:
            order = self.of_row[ruled]
            starts = np.flatnonzero(np.diff(order, prepend=-1))
            squares = np.add.reduceat(squares, starts, axis=-1)
        return np.where(np.isfinite(squares), squares, np.inf)

    def summed(self, values: Floats) -> Floats:
        """The sums (U,) of values (m,) by residual, over the residuals of each unit."""
        ruled = self.of_row >= 0
        return np.bincount(self.of_row[ruled], values[ruled], self.count).astype(float)

    def kept(self, equations: Assembled, inliers: Mask) -> Mask:
        """Which units of the equations stay, by number, where the ``inliers`` (U,) alone do of these."""
        keep = np.ones(int(equations.units.max()) + 1, dtype=bool)
        keep[self.number] = inliers
        return keep

    def expanded(self, values: Floats) -> Floats:
        """Values (…, U) by unit as values (…, m) by residual, 1 where the rule does not act."""
        found = np.ones((*values.shape[:-1], len(self.of_row)))
        ruled = self.of_row >= 0
        found[..., ruled] = values[..., self.of_row[ruled]]
        return found


def by_components(components: Indices, value_of: dict[int, float]) -> Floats:
    """One value for each unit, from a table by number of components."""
    result = np.empty(len(components))
    for size, value in value_of.items():
        result[components == size] = value
    return result


def medians(components: Indices) -> Floats:
    """The median of χ²_d for each unit."""
    sizes = np.unique(components).tolist()
    return by_components(components, {d: MEDIANS[d - 1] if d <= len(MEDIANS) else quantile(0.5, d) for d in sizes})


def limits(components: Indices, deviations: float) -> Floats:
    """Squared norms (U,) beyond which good units lie as rarely as one component beyond so many deviations."""
    sizes = np.unique(components).tolist()
    tail = erfc(deviations / sqrt(2.0))
    return by_components(components, {d: deviations**2 if d == 1 else quantile(tail, d) for d in sizes})


def quantile(tail: float, dof: int) -> float:
    """The value that χ² with ``dof`` degrees of freedom exceeds with probability ``tail``, by bisection."""
    low, high = 0.0, float(dof)
    while chi_square.chi_square_tail(high, dof) > tail:
        high *= 2.0
    while high - low > 1e-13 * high:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if chi_square.chi_square_tail(middle, dof) > tail:
            low = middle
        else:
            high = middle
    return high


def small_sample(scalars: int, dimension: int) -> float:
    """1 + 5/(n − p): a median of residuals of a fit to few of them is small (Rousseeuw and Leroy 1987, 5.1)."""
    return 1.0 + 5.0 / max(scalars - dimension, 1)


def robust_variance(squares: Floats, units: Units, dimension: int, picked: Mask | None = None) -> float:
    """``(1.4826 (1 + 5/(n − p)))² med`` of squared norms, each over the median of its law (1.4826² for one component).

    ``squares`` (U,) at a fit with ``dimension`` p; ``picked`` restricts the units. 0 where there are none.
    """
    normed = squares / medians(units.components)
    if picked is not None:
        normed = normed[picked]
    if not normed.size:
        return 0.0
    return float(np.median(normed)) * small_sample(units.scalars, dimension) ** 2


def consistency(components: Indices, limit: Floats) -> Floats:
    """Variance κ that normal residuals have left inside ``limit`` (U,): below 1 since the tails are cut off."""
    result = np.ones(len(components))
    for size in _distinct(components):
        of_size = components == size
        for value in _distinct(limit[of_size]):
            if np.isfinite(value):
                result[of_size & (limit == value)] = chi_square.consistency(value, int(size))
    return result


def _distinct(values: Floats | Indices) -> list[float]:
    """The values that occur; mostly all are equal, which takes less than to sort them."""
    if values.size and bool((values == values[0]).all()):
        return [values[0].item()]
    found: list[float] = np.unique(values).tolist()
    return found


def units_of(equations: Assembled, problem: Problem, point: Floats, ruled: Callable[[Block], bool]) -> Units:
    """The units of the blocks that ``ruled`` picks; ``point`` (N,) is where the rounding of residuals is judged."""
    numbers = equations.units
    act = np.zeros(equations.whole, dtype=bool)
    group = np.full(equations.whole, STATED, dtype=np.int64)
    for each in equations.groups:
        block = problem.blocks[each.kernel.owner]
        lines = slice(each.first, each.first + each.count)
        act[lines] = ruled(block)
        group[lines] = each.kernel.owner if block.unknown_factor else STATED
    number, first, of_row, sizes = np.unique(numbers[act], return_index=True, return_inverse=True, return_counts=True)
    rows = np.full(equations.whole, -1, dtype=np.int64)
    rows[act] = of_row
    terms = np.abs(equations.plain_residuals(point))
    if not sparse_suits(equations):
        terms = terms + np.abs(equations.plain_jacobian(point)) @ np.abs(equations.coordinates(point))
    terms = np.where(np.isfinite(terms), terms, 0.0)[act]
    return Units(
        of_row=rows,
        components=np.asarray(sizes, dtype=np.int64),
        group=group[act][first],
        number=np.asarray(number, dtype=np.int64),
        rounding=np.square(CONSENSUS_ROUNDING * np.maximum.reduceat(terms, first)) if first.size else np.empty(0),
    )


def without_losses(equations: Assembled) -> Assembled:
    """The same equations, every unit with its plain squares."""
    return replace(equations, groups=tuple(replace(g, losses=()) for g in equations.groups))


STATED_CUT = 3.0
"""Stated standard deviations beyond which a unit is an outlier: 0.3 % of good units, at 1.5 % of the precision."""


def cuts(units: Units, threshold: float | None) -> Floats:
    """Squared limits (U,) for unit variance: at ``threshold`` deviations, else 3 stated or 2.5 robust ones."""
    if threshold is not None:
        return limits(units.components, threshold)
    stated = limits(units.components, STATED_CUT)
    return np.where(units.group == STATED, stated, limits(units.components, CUT))


def limits_of(units: Units, consensus: Consensus) -> Floats:
    """Squared limits (U,) for unit variance, as `:quantile` or `:threshold` state them, else as `cuts` has them."""
    if consensus.quantile is None:
        return cuts(units, consensus.threshold)
    tail = 1.0 - consensus.quantile
    return by_components(units.components, {d: quantile(tail, d) for d in np.unique(units.components).tolist()})


def variances_at(squares: Floats, units: Units, dimension: int, picked: Mask | None = None) -> Floats:
    """The variance (U,) of each unit's noise at a point: 1 where it is stated, else the robust one of its group.

    ``picked`` (U,) are the units that tell it (None: all).

    It is no smaller than what rounding makes of most of them: that of a unit that is grossly wrong says nothing.
    """
    found = np.ones(units.count)
    for group in np.unique(units.group).tolist():
        if group != STATED:
            mine = units.group == group
            least = float(np.median(units.rounding[mine]))
            told = mine if picked is None else mine & picked
            found[mine] = max(robust_variance(squares, units, dimension, told), least, 1e-300)
    return found


def outlying(acting: Iterable[Acting], residuals: Floats) -> Mask:
    """Which residuals are those of units beyond three stated deviations; ``acting`` as for `rooted_residuals`."""
    found = np.zeros(residuals.shape, dtype=bool)
    for _, at in acting:
        own = residuals[at]
        limit = limits(np.full(1, own.shape[-1]), STATED_CUT)[0]
        found[at] = ~(np.square(own).sum(axis=-1) <= limit)[..., None]
    return found
