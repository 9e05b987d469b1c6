"""A loss with its parameter, as it acts on the residuals of an equation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbm.solution.types import Floats
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.solution.robust.losses.types import RobustLoss


@dataclass(frozen=True, slots=True, kw_only=True)
class LossFunction:
    """A loss with its parameter ``scale`` c > 0 in standard deviations."""

    loss: RobustLoss
    scale: float

    @property
    def convex(self) -> bool:
        """Whether ρ(r²) is convex in r."""
        return self.loss.convex

    def rho(self, squares: Floats) -> Floats:
        """ρ(s), elementwise."""
        return self.loss.rho(squares, self.scale)

    def weight(self, squares: Floats) -> Floats:
        """ρ'(s): the weight of the residual in iterated reweighting, 1 at s = 0."""
        return self.loss.weight(squares, self.scale)

    def slope(self, squares: Floats) -> Floats:
        """ρ''(s) ≤ 0: how the weight falls."""
        return self.loss.slope(squares, self.scale)
