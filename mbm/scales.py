"""Scales of units: what numbers in a unit are in SI, and what differences of such numbers are."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from mbm.values import dataclass

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Reals = TypeVar("Reals", float, NDArray[np.float64])


@dataclass(frozen=True, slots=True)
class Scale:
    """Numbers in a unit and in SI: ``SI = factor · number + zero``; in differences the ``zero`` cancels.

    A difference is whatever a shift of the zero leaves as it is: standard deviations, widths, steps, tolerances,
    sensitivities; of covariances, each side.
    """

    factor: float = 1.0
    zero: float = 0.0

    @property
    def is_si(self) -> bool:
        """Whether numbers are the same in SI."""
        return self.factor == 1.0 and self.zero == 0.0

    def to_si(self, value: Reals) -> Reals:
        """A value in the unit → in SI."""
        found = self.difference_to_si(value)
        return found if self.zero == 0.0 else found + self.zero

    def from_si(self, value: Reals) -> Reals:
        """A value in SI → in the unit."""
        return self.difference_from_si(value if self.zero == 0.0 else value - self.zero)

    def difference_to_si(self, value: Reals) -> Reals:
        """A difference of two values in the unit → in SI."""
        return value if self.factor == 1.0 else value * self.factor

    def difference_from_si(self, value: Reals) -> Reals:
        """A difference of two values in SI → in the unit."""
        return value if self.factor == 1.0 else value / self.factor


SI = Scale()
"""The scale of what is in SI."""
