"""What a robust loss ρ(s) of the squared norm s of a whitened residual says about itself.

All are normalised to ``ρ(s) = s + O(s²)``, so small residuals count as in least squares; the parameter c, in standard
deviations, is where they begin to count less.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from mbm.problem.kinds import LossKind
from mbm.solution.types import Floats


class RobustLoss(Protocol):
    """A loss; ``squares`` are s ≥ 0 of any shape, which the answers have too, and ``scale`` is c > 0.

    Values of it are immutable and hashable: residuals with equal losses are treated together.
    """

    @property
    def kind(self) -> LossKind:
        """Its name in ``:loss``."""
        ...

    @property
    def defaults(self) -> tuple[float, ...]:
        """c of 95 % efficiency for residuals of 1, 2 … components, as far as known; others are computed."""
        ...

    @property
    def convex(self) -> bool:
        """Whether ρ(r²) is convex in r: a minimum cannot hide behind another one that the loss itself makes."""
        ...

    def rho(self, squares: Floats, scale: float) -> Floats:
        """ρ(s), elementwise."""
        ...

    def weight(self, squares: Floats, scale: float) -> Floats:
        """ρ'(s): the weight of the residual in iterated reweighting, 1 at s = 0."""
        ...

    def slope(self, squares: Floats, scale: float) -> Floats:
        """ρ''(s) ≤ 0: how the weight falls; one-sided where ρ has a corner."""
        ...


@runtime_checkable
class LossFamily(RobustLoss, Protocol):
    """A loss that a second number shapes."""

    def shaped(self, shape: float) -> RobustLoss:
        """The member of the family with that number."""
        ...
