"""Equations under losses with the weights that they have at a minimum, for looking at the curvature of the model.

A robust cost is no likelihood, and its growth tells no interval. What bends is the model alone: with fixed weights the
minimum stays where it is (Σ Jᵀ w r = 0), and weighted least squares with a variance that makes the stated covariance as
large as it is shows how far.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled, loss_lines
from mbm.equations.surface import plainly_affine
from mbm.equations.types import Covariance, Floats, Minimum
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


def loss_weights(equations: Assembled, plain: Floats) -> Floats:
    """ρ' of the residuals ``plain`` (m,); 1 without a loss."""
    weights = np.ones(len(plain))
    for loss, lines in loss_lines(equations):
        weights[lines] = loss.weight(np.square(plain[lines]).sum(axis=1))[:, None]
    return weights


def fixed_weights(
    equations: Assembled, minimum: Minimum, estimated: Covariance
) -> tuple[FixedWeights, Minimum, Covariance] | None:
    """The equations, the minimum and the covariance with fixed weights; None where the weights leave too little."""
    plain = equations.plain_residuals(minimum.point)
    roots = np.sqrt(loss_weights(equations, plain))
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
