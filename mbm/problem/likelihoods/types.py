"""What an equation says of its errors beyond stated weights."""

from __future__ import annotations

from enum import StrEnum

from mbm.expression.nodes import Expression
from mbm.values import dataclass


class Law(StrEnum):
    """Distributions of a measured value; the value is the word behind ``:distribution``."""

    NORMAL = "normal"
    POISSON = "poisson"
    BINOMIAL = "binomial"
    STUDENT = "student"

    @property
    def counts(self) -> bool:
        """Values are whole numbers."""
        return self in (Law.POISSON, Law.BINOMIAL)


SHIFT = 100.0
"""What is added to ``2 log σ/σ_ref`` so that it has a root: σ may fall to e⁻⁵⁰ of its reference. The rounding of a cost
that is larger by so much per row stays below 1e-14 of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Truncation:
    """What a reading says of a value: only that it lies ``below`` or ``above`` (conditions, 0 or 1), or within half of
    ``step`` of it (None: neither was stated).
    """

    below: Expression | None = None
    above: Expression | None = None
    step: Expression | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Likelihood:
    """The likelihood L of what an equation measures, as least squares.

    ``Σ residuals²`` is ``-2 log L/L_max``, L_max being the largest value for this reading whatever the model. Where the
    model decides the weights, the last ``uncounted`` residuals are no part of χ²: the squares of the first of them, one
    for each component, are the log-determinant beside that of ``spread``, each `SHIFT` too large; the others are 0. The
    products of the derivatives of ``information`` (as many as residuals) are the Fisher information; of counts its
    values are ``2√μ``, or ``2√n asin √(μ/n)``.

    ``law`` has the ``parameter`` n or the degrees of freedom. ``measured`` and ``spread`` (standard deviations, those
    of the measured values where the model decides) are known before the solve; ``model`` is the expectation, or the
    location. ``scales`` are unknowns that the scale has of its own, which stand as 1 in ``spread``.
    """

    law: Law
    residuals: tuple[Expression, ...]
    information: tuple[Expression, ...]
    uncounted: int = 0
    measured: tuple[Expression, ...]
    model: tuple[Expression, ...]
    spread: tuple[Expression, ...]
    parameter: Expression | None = None
    truncation: Truncation | None = None
    scales: tuple[str, ...] = ()

    @property
    def normal(self) -> bool:
        """A reading that is no limit is normal, with the noise that the equation states."""
        return self.law is Law.NORMAL and (self.truncation is None or self.truncation.step is None)

    @property
    def own(self) -> tuple[Expression, ...]:
        """What is stated of the readings, beside the equation and its noise."""
        stated = self.truncation
        limits = () if stated is None else (stated.below, stated.above, stated.step)
        return tuple(each for each in (self.parameter, *limits) if each is not None)
