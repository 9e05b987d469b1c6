"""What outlier rules act on: units (one equation in one table row), their noise groups, and their robust scale.

A unit of d independent components with variance 1 has a squared norm with the law χ²_d. Rules are stated for one
component and carried over to d by the probability: all units of good measurements are cut as often.
"""

from __future__ import annotations

from math import erfc, sqrt

import numpy as np

from mbm.equations.types import Floats, Indices, Mask
from mbm.solver import chi_square
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
    """Variance that normal residuals have left inside ``limit`` (U,): below 1 since the tails are cut off.

    Hard rejection at ``s ≤ limit`` is the M-estimator with ψ(r) = r inside, so ``E ψψᵀ = E Dψ = κ F`` with the share F
    of good units kept and this κ: the information of the kept rows has to be multiplied by it.
    """
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
