"""What ``:loss`` says as functions of residuals: the formulas of `mbm.solver.losses`, element by element."""

from __future__ import annotations

import numpy as np

from mbm.equations.efficiency import tuned
from mbm.equations.formulas import of_arrays
from mbm.equations.types import Floats
from mbm.problem.kinds import LossKind
from mbm.problem.types import Loss
from mbm.solver import losses as formulas
from mbm.solver.loss_spread import loss_trace
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class LossFunction:
    """A loss with its parameter ``scale`` c > 0 in standard deviations; ``shape`` is that of Barron's family.

    ``squares`` are s ≥ 0 of any shape, which the answers have too. Residuals with equal losses are treated together.
    """

    kind: LossKind
    scale: float
    shape: float = 0.0

    @property
    def convex(self) -> bool:
        """Whether ρ(r²) is convex in r."""
        traits = formulas.LOSSES[self.kind]
        return traits.convex if traits.convex_from is None else self.shape >= traits.convex_from

    @property
    def number(self) -> int:
        """Its kind for the solver."""
        return formulas.LOSSES[self.kind].number

    def rho(self, squares: Floats) -> Floats:
        """ρ(s)."""
        return of_arrays(formulas.loss_value)(self.number, squares, self.scale, self.shape)

    def weight(self, squares: Floats) -> Floats:
        """ρ'(s): the weight of the residual in iterated reweighting, 1 at s = 0."""
        return of_arrays(formulas.loss_weight)(self.number, squares, self.scale, self.shape)

    def slope(self, squares: Floats) -> Floats:
        """ρ''(s) ≤ 0: how the weight falls; one-sided where ρ has a corner."""
        return of_arrays(formulas.loss_slope)(self.number, squares, self.scale, self.shape)

    def trace(self, squares: Floats, components: int) -> Floats:
        """tr Dψ of residuals of so many components."""
        return of_arrays(loss_trace)(self.number, squares, self.scale, self.shape, components)

    def root_factors(self, squares: Floats) -> tuple[Floats, Floats]:
        """``q = √(ρ(s)/s)`` and dq/ds, so that ``r̃ = q r`` has ``|r̃|² = ρ(s)``."""
        factor = of_arrays(formulas.root_factor)(self.number, squares, self.scale, self.shape)
        return factor, of_arrays(formulas.root_slope)(self.number, squares, self.scale, self.shape, factor)


def loss_function(asked: Loss, components: int) -> LossFunction:
    """The loss for residuals of so many components; a parameter left out is the one of 95 % efficiency."""
    shape = 0.0 if asked.shape is None else asked.shape
    if asked.scale is not None:
        return LossFunction(kind=asked.kind, scale=asked.scale, shape=shape)
    known = formulas.LOSSES[asked.kind].scales
    if components <= len(known):
        return LossFunction(kind=asked.kind, scale=known[components - 1], shape=shape)
    unit = LossFunction(kind=asked.kind, scale=1.0, shape=shape)
    return LossFunction(kind=asked.kind, scale=tuned(unit.weight, components), shape=shape)


def rooted(loss: LossFunction, residuals: Floats) -> Floats:
    """``r̃ = r √(ρ(s)/s)`` for each unit; ``residuals`` (units, components), whitened."""
    factor, _ = loss.root_factors(np.square(residuals).sum(axis=1))
    return np.asarray(residuals * factor[:, None])


def rooted_jacobian(loss: LossFunction, residuals: Floats, jacobian: Floats) -> Floats:
    """dr̃/dx = q J + 2 q' r (rᵀJ), exact; ``jacobian`` (units, components, n) belongs to the plain ``residuals``."""
    factor, change = loss.root_factors(np.square(residuals).sum(axis=1))
    along = np.einsum("uk,ukn->un", residuals, jacobian)
    bent = (2.0 * change[:, None] * residuals)[:, :, None] * along[:, None, :]
    return np.asarray(factor[:, None, None] * jacobian + bent)
