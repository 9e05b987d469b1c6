"""What the error of each measured value does to the estimates, to first order: the parts that a covariance sums up.

With the factor F of the covariance, Σ = F Fᵀ, and the whitened Jacobian J, an error of one standard deviation in row k
moves the estimates by ``F Fᵀ Jₖᵀ/s``, where s is the standard deviation of residuals that `:sigma unknown` leaves. The
squares of these add up to Σ, as ``FᵀJᵀJF = s²``. With losses the same holds of the sandwich, whose middle is a sum over
rows (`mbm.estimation.uncertainty.robust`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.types import Covariance, Floats, Mask, Minimum, Observability
from mbm.estimation.uncertainty.covariance import in_datum
from mbm.estimation.uncertainty.degrees import Freedoms
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.corrections.types import MeasuredErrors


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowInfluence:
    """Protocol `Influence`: the equations at a minimum, and the covariance that was made there.

    ``observed`` is the rank decision before losses changed it, ``stated`` (m,) says whose noise is not estimated;
    ``freedoms`` as `Statistics` has them. ``informing`` (m,) multiplies the rows of the Jacobian where
    consensus cut off tails (None: nothing does).
    """

    equations: Assembled
    minimum: Minimum
    observed: Observability
    covariance: Covariance
    stated: Mask
    freedoms: Freedoms
    informing: Floats | None = None

    @property
    def deviation(self) -> float:
        """The standard deviation of whitened residuals."""
        return float(np.sqrt(self.covariance.variance))

    @property
    def factors(self) -> Floats:
        """As the protocol has it."""
        own = self.equations.factors
        return np.full(self.equations.whole, self.deviation) * (1.0 if own is None else own)

    @np.errstate(all="ignore")
    def of_residuals(self, gradient: Floats) -> Floats:
        """As the protocol has it."""
        parts = self._sparse(gradient) if self.minimum.blocks is not None else self._dense(gradient)
        if self.informing is not None:
            parts = parts * self.informing
        if self.equations.rows is None:
            return parts
        whole = np.zeros((len(gradient), self.equations.whole))
        whole[:, self.equations.rows] = parts
        return whole

    def of_shared(self, parts: Floats) -> tuple[Floats, Mapping[int, Floats]]:
        """As the protocol has it."""
        structure = self.equations.structure
        return (parts, {}) if structure is None else structure.shared_out(parts)

    def of_measured(self, parts: Floats) -> tuple[Floats, MeasuredErrors | None]:
        """As the protocol has it."""
        if self.equations.implicit is None:
            return parts, None
        return self.equations.implicit.shared_out(self.minimum.point, parts)

    def _dense(self, gradient: Floats) -> Floats:
        equations, minimum = self.equations, self.minimum
        if not equations.lossy:
            if not self.deviation > 0.0:
                return np.zeros((len(gradient), equations.count))
            image = gradient @ self.covariance.factor
            return np.asarray(image @ (minimum.jacobian @ self.covariance.factor).T / self.deviation)
        from mbm.estimation.uncertainty.robust import bread

        found = bread(
            loss_lines(equations),
            equations.plain_residuals(minimum.point),
            equations.plain_jacobian(minimum.point),
            self.observed,
            self.stated,
            equations.coordinates(minimum.point),
        )
        moved = gradient @ in_datum(found.basis @ found.inverse, found.observed)
        return np.asarray(moved @ found.along.T * np.sqrt(found.spread))

    def _sparse(self, gradient: Floats) -> Floats:
        # Loaded by sparse problems only, so that the others start at once.
        from mbm.estimation.uncertainty.sparse import sparse_rows

        if not self.equations.lossy:
            return sparse_rows(gradient, self.minimum, self.covariance) * self.deviation
        from mbm.estimation.uncertainty.sparse_sandwich import informed

        plain = self.equations.plain_residuals(self.minimum.point)
        weighted = informed(self.equations, self.minimum, plain, self.observed, self.stated)
        return sparse_rows(gradient, replace(self.minimum, blocks=weighted), self.covariance)

    def dof_of_noise(self, block: int) -> float:
        """As the protocol has it."""
        return self.freedoms.of_noise(block)
