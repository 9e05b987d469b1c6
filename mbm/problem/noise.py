"""What noise has in common between rows and clauses: a shared factor, common errors, correlation, a free covariance."""

from __future__ import annotations

from enum import StrEnum

from mbm.text.types import Span
from mbm.values import dataclass


class Correlation(StrEnum):
    """How the noise of a row depends on that of other rows of its clause."""

    AR1 = "ar1"
    MATRIX = "matrix"


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseStructure:
    """Beside what an equation states of its own noise.

    ``shared`` is the name of a factor that other clauses may share (None: the clause has its own). ``free``: the
    covariance of the components of a row is unknown. ``per`` are the columns whose values have errors in common, one
    for each of the clause's common errors. ``correlation`` is along the rows; ``unknown``: that of neighbours is to be
    estimated, ``matrix`` names the table that states it for all pairs. ``place`` is where the clause says so.
    """

    shared: str | None = None
    free: bool = False
    per: tuple[str, ...] = ()
    correlation: Correlation | None = None
    unknown: bool = False
    matrix: str | None = None
    place: Span | None = None

    @property
    def joins(self) -> bool:
        """The residuals of a row depend on one another, or on other rows, in ways that no row states."""
        return self.free or bool(self.per) or self.correlation is not None

    @property
    def estimated(self) -> bool:
        """Something of it follows from the residuals."""
        return self.free or self.unknown

    @property
    def what(self) -> str:
        """The option that says so, as a message names it."""
        if self.free:
            return "`:covariance unknown`"
        if self.per:
            return "`:common`"
        return "`:correlation`" if self.correlation is not None else f"the factor `{self.shared}`"


PLAIN = NoiseStructure()
"""Each row has noise of its own."""
