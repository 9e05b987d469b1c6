"""What a result was made from."""

from __future__ import annotations

from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class InputFile:
    """A file that was read: the path as messages print it, SHA-256 (None for tables given through the API), rows."""

    path: str
    sha256: str | None
    rows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StartsTally:
    """Starts that were tried, that converged, and that led to the best cost (by whichever minimum has it)."""

    tried: int
    converged: int
    best_found: int
