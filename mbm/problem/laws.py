"""Laws of distribution: what a prior or a constant follows beside its mean and standard deviation."""

from __future__ import annotations

from mbm.values import dataclass

NORMAL, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = "normal", "rectangular", "triangular", "trapezoidal"
ARCSINE, STUDENT, LOGNORMAL = "arcsine", "student", "lognormal"
"""The names of the laws, as LANGUAGE §10 has them."""


@dataclass(frozen=True, slots=True)
class Law:
    """The law of (X − mean)/sigma, which location and scale leave: its name, and the ``shape`` of those that have one.

    The shape is the ratio of top to base (trapezoidal), the degrees of freedom (student), or the geometric standard
    deviation (lognormal). Without a variance, ``sigma`` stands for the scale.
    """

    name: str = NORMAL
    shape: float = 1.0

    @property
    def has_variance(self) -> bool:
        """Whether there is a standard deviation."""
        return self.name != STUDENT or self.shape > 2.0


NORMAL_LAW = Law()
