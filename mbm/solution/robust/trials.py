"""What consensus asks of the equations: residuals and derivatives at many points, fits to subsets of the units."""

from __future__ import annotations

from typing import Protocol

from mbm.solution.types import Floats, Indices


class Trials(Protocol):
    """The equations of one solve, without losses, at many points at once; points are rows of (T, N).

    Residuals stand in the order of the equations' own, m of them; those that no outlier rule touches (priors) take
    part in every fit.
    """

    @property
    def dimension(self) -> int:
        """n, the coordinates of a step."""
        ...

    def residuals(self, points: Floats) -> Floats:
        """Whitened residuals (T, m); NaN or inf where a model has no value."""
        ...

    def linearised(self, points: Floats) -> tuple[Floats, Floats]:
        """Whitened residuals (T, m) and their derivatives (T, m, n)."""
        ...

    def coordinates(self, points: Floats) -> Floats:
        """The numbers that steps add to (T, n), 0 for rotations, directions and scales."""
        ...

    def moved(self, points: Floats, steps: Floats) -> Floats:
        """The points after steps (T, n), inside the bounds."""
        ...

    def fitted(self, starts: Floats, subsets: Indices) -> tuple[Floats, Indices]:
        """Points (P, N) that fit the units of subsets (T, k), -1 for none, and the priors; not finite if none does.

        And which subset (P,) each is for; a subset may have several, and of equal subsets one stands for all.
        """
        ...
