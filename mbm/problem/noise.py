"""What noise has in common between rows and clauses: a shared factor, common errors, correlation, a free covariance."""

from __future__ import annotations

from mbm.text.types import Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseStructure:
    """Beside what an equation states of its own noise.

    ``shared`` is the name of a factor that other clauses may share (None: the clause has its own), ``place`` where the
    clause says so.
    """

    shared: str | None = None
    place: Span | None = None


PLAIN = NoiseStructure()
"""Each row has noise of its own."""
