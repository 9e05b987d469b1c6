"""Equations made of other equations: what stays as those have it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbm.equations.metric import turning
from mbm.equations.types import Equations, Floats, Mask


class Forwarding:
    """A base of equations over the same points and steps as ``equations``, the field that subclasses bring.

    Bounds are not among what is forwarded: a dataclass would take an inherited property for the default of its field.
    """

    __slots__ = ()

    if TYPE_CHECKING:
        equations: Equations

    @property
    def dimension(self) -> int:
        """Free coordinates, n."""
        return self.equations.dimension

    @property
    def count(self) -> int:
        """Residuals, m."""
        return self.equations.count

    @property
    def positive(self) -> Mask:
        """Coordinates that stay above zero (n,)."""
        return self.equations.positive

    @property
    def turning(self) -> Mask | None:
        """Coordinates of rotations, directions and scales (n,); None where there are none."""
        return turning(self.equations)

    def residuals(self, x: Floats) -> Floats:
        """Whitened residuals (m,)."""
        return self.equations.residuals(x)

    def jacobian(self, x: Floats) -> Floats:
        """Their derivative by a step (m, n)."""
        return self.equations.jacobian(x)

    def retract(self, x: Floats, step: Floats) -> Floats:
        """The point after a step (n,)."""
        return self.equations.retract(x, step)

    def coordinates(self, x: Floats) -> Floats:
        """The numbers that steps add to (n,)."""
        return self.equations.coordinates(x)

    def placed(self, x: Floats, coordinates: Floats) -> Floats:
        """The point with other coordinates."""
        return self.equations.placed(x, coordinates)
